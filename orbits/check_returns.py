"""Verifies saved theorems about hops that come back, from their statement alone: see `orbits.check_proof`.

Of the word of a theorem, the number of impacts of each hop, follow its unknowns and its arcs (`Word`). One motion goes
along all of them (`Hops`): a flight from the launch, or from an impact, ends where the gap is 0; a contact ends at the
place of the launch. The rates after a landing are those of the contact with the same momentum along it. Krawczyk's test
is that of orbits. The derivative of the map of launches is the Schur complement of the equations' Jacobian. Derivatives
of hops along the map are states too, with rates that are derived from the formulas (`Jets`): no event needs a
correction, as each arc lasts from 0 to 1 and its time is a state.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import partial
from itertools import chain
from typing import Any

from flint import arb, arb_mat, ctx

from .check_formulas import Tree, dot, is_zero, number, replaced, slope, tree
from .check_proof import (
    Contraction,
    Field,
    Machine,
    Passage,
    ball,
    check,
    check_halved,
    check_positive,
    check_radius,
    check_said,
    moved,
)
from .check_statement import (
    CHECKS,
    LIMIT,
    RETURNS,
    Bounds,
    Unverified,
    Word,
    bounds_of,
    decimal,
    unknowns_of_doubling,
    word_of,
)

Row = tuple[arb, list[arb]]  # a function of the unknowns: its value at the middle of the box, its derivatives on it


class Jets(Field):
    """The motion of the states and of their derivatives up to an order along a curve of motions."""

    def __init__(self, machine: Machine, contact: bool, order: int):
        super().__init__(machine, contact)
        levels, rates = [machine.states], self.rates
        for _ in range(order):
            levels.append([tree("name", value=f"d {each.value}") for each in levels[-1]])
        later = zip(chain(*levels[:-1]), chain(*levels[1:]), strict=True)
        self.order, self.later = order, {each.value: following for each, following in later}
        self.states = [*chain(*levels)]
        self.rates = [*chain(*zip(*map(self.jet, rates), strict=True))]
        self.slopes = self.changes()

    def jet(self, of: Tree) -> list[Tree]:
        """A function of the states and its derivatives along the curve."""
        found = [of]
        for _ in range(self.order):
            found.append(dot([slope(found[-1], name) for name in self.later], [*self.later.values()]))
        return found


class Hops(Contraction):
    """The equations of hops that come back, on a box of their unknowns and of their derivatives by alpha; of these what
    is not in the box is 0.

    flights, contacts : the motions of each hop
    equations : for each order of derivatives those of the events, and last that of the last launch
    """

    def __init__(self, machine: Machine, inject: Bounds, word: Word, box: Mapping[str, arb], order: int, degree: int):
        super().__init__(machine, box)
        self.inject, self.orders, self.degree, self.unknowns = inject, range(order + 1), degree, word.unknowns
        self.flight, self.contact = Jets(machine, False, order), Jets(machine, True, order)
        self.flights, self.contacts = list[list[Passage]](), list[Passage]()
        self.equations: list[list[Row]] = [[] for _ in self.orders]
        landed = [self.flight.jet(each) for each in landing(machine)]
        for hop, (launch, times, stay) in enumerate(word.hops):
            start = [self._launched(k, launch) for k in self.orders]
            if hop == 0:
                self._add(self.contact, self._start(start, times[0]), self.contact.force)
            self.flights.append([])
            for time in times:
                self.flights[-1].append(self._passage(self.flight, self._start(start, time)))
                end = self.flights[-1][-1].end
                self._add(self.flight, end, machine.gap)
                start = [[self.flight.linear(end, each[k]) for each in landed] for k in self.orders]
            self.contacts.append(self._passage(self.contact, self._start(start, stay)))
            end, (own,) = self.contacts[-1].end, machine.unknowns
            self._add(self.contact, end, machine.states[own], "liftoff")
            self._add(self.contact, end, machine.rates[own], word.hops[(hop + 1) % len(word.hops)][0], self._injected())

    def _add(self, field: Jets, end: tuple, of: Tree, less: str | None = None, more: Row | None = None) -> None:
        """Add the equation that a function of the states is 0 somewhere, less an unknown and with more added to it."""
        for k, each in enumerate(field.jet(of)):
            value, row = field.linear(end, each)
            if less:
                other, places = self._known(k, less)
                value, row = value - other, [a - b for a, b in zip(row, places, strict=True)]
            if more and k == 0:
                value, row = value + more[0], [a + b for a, b in zip(row, more[1], strict=True)]
            self.equations[k].append((value, row))

    def _known(self, order: int, name: str) -> Row:
        """The derivative of an order of an unknown by alpha."""
        full, names = "d" * order + name, [*self.box]
        if order and name == "alpha":
            return arb(int(order == 1)), [arb(0)] * len(names)
        value = self.centre[names.index(full)] if full in names else arb(0)
        return value, [arb(int(each == full)) for each in names]

    def _injected(self) -> Row:
        if "inject" in self.box:
            return self._known(0, "inject")
        low, high = self.inject["inject"]
        return ball((low + high) / 2), [ball((high - low) / 2) * (each == "place of inject") for each in self.box]

    def _launched(self, order: int, launch: str) -> list[Row]:
        """The derivative of an order of the state at a launch."""
        weights, known = [ball(row[0].value) for row in self.machine.embedded], list[Row]()
        for value, row in (self._known(order, name) for name in ("liftoff", launch)):
            known += [(weight * value, [weight * each for each in row]) for weight in weights]
        return known

    def _start(self, states: Sequence[list[Row]], time: str) -> tuple[list[arb], list[arb], arb_mat]:
        """The states at the beginning of an arc: from the middle of the box, from all of it, and their derivatives."""
        constants = [each.value for each in self.machine.constants]
        pairs = [
            pair for k in self.orders for pair in (*states[k], *(self._known(k, name) for name in (time, *constants)))
        ]
        centre, seeds = [value for value, _ in pairs], arb_mat([row for _, row in pairs])
        return centre, moved(centre, seeds, self.reach), seeds

    def _passage(self, field: Field, start: tuple[list[arb], list[arb], arb_mat]) -> Passage:
        if len(field.pieces_of(start[1])) > 1:
            raise Unverified("a flight or a contact begins where two pieces of a law meet")
        passage = Passage(field, start[0], start[2], self.reach, self.degree)
        for part in (each for each in passage.parts if len(each.pieces) > 1):
            if part.values(arb(0).union(part.h))[field.along(field.edges[max(part.pieces)], 1)].contains(0):
                raise Unverified("the place where two pieces of a law meet is not shown to be crossed with a speed")
        return passage

    def values(self, order: int) -> list[arb]:
        """The functions of an order that vanish in the equations, on all of the box."""
        return [value + dot(row, self.reach, arb(0)) for value, row in self.equations[order]]

    def slope(self) -> arb:
        """The derivative of the last equation by alpha along the hops whose events happen: the Schur complement."""
        *events, last = [row[[*self.box].index("alpha")] for _, row in self.equations[0]]
        return self.following(events, last)[1]

    def following(self, events: Sequence[arb], last: arb) -> tuple[dict[str, arb], arb]:
        """The derivatives of the unknowns along a curve on which the events happen, and that of the last equation: from
        what these would be with the unknowns but alpha at rest."""
        places = {name: [*self.box].index(name) for name in self.unknowns if name != "alpha"}
        *rows, end = [[row[i] for i in places.values()] for _, row in self.equations[0]]
        try:
            found = arb_mat(rows).solve(arb_mat([[-each] for each in events])).tolist()
        except ZeroDivisionError:
            raise Unverified("the events are not shown to be transversal") from None
        moves = dict(zip(places, (each for (each,) in found), strict=True))
        return moves, last + dot(end, [*moves.values()], arb(0))


def landing(machine: Machine) -> list[Tree]:
    """The states after a plastic landing, coordinates and rates, as functions of those before."""
    (own,), along = machine.unknowns, [row[0] for row in machine.embedded]
    places = [weight * machine.states[own] for weight in along]
    closed = dict(zip(machine.names, places, strict=True))
    inertia = [[replaced(each, closed) for each in row] for row in machine.inertia]
    heavy = dot(along, [dot(row, along) for row in inertia])
    rate = dot(along, [dot(row, machine.rates) for row in inertia]) / heavy
    return [*places, *(weight * rate for weight in along)]


def check_saved(document: Mapping[str, Any], limit: float = LIMIT) -> list[str]:
    """Why a saved proof, of an orbit or of hops that come back, is not verified, in words; empty where all of its
    theorem is. Raises `OutOfTime` where that takes more than `limit` seconds of processor time."""
    of_returns = isinstance(document, dict) and document.get("kind") in RETURNS
    return check(document, limit, _check_returns if of_returns else None)


def _check_returns(document: Mapping[str, Any]) -> None:
    """See that what a file says of hops that come back holds; raises `Unverified`."""
    stated, word = document["machine"], word_of(document)
    if len({*stated["coordinates"]}) != 2:
        raise Unverified("this program verifies hops of machines of two coordinates")
    if "inject" in stated["parameters"]:
        raise Unverified("a parameter has the name of the injection")
    pairs = stated["parameters"] | ({"inject": stated["injection"]} if stated["injection"] else {})
    check_said(document, document["kind"], pairs)
    doubled, (part,) = document["kind"] == "period doubling", document["parts"]
    further = ("multiplier_rate", "cubic_coefficient") if doubled else ("multiplier",)
    said, claims, bounds = (bounds_of(each) for each in (document["enclosures"], part["unknowns"], pairs))
    main = {name: claims[name] for name in (*word.unknowns, *(["inject"] if doubled else []))}
    if said.keys() != {*main, *further} or any(said[name] != each for name, each in main.items()):
        raise Unverified("the file encloses quantities that this program does not verify")
    if bounds_of(part["parameters"]) != bounds or document["family"] is not None or not document["motion"]:
        raise Unverified(
            "the part has other parameters than the machine, or the hops have a family, or are not a motion"
        )
    check_radius(document, said)
    conditions = [
        "clearance",
        "contact_force",
        "liftoff",
        *(["separation"] if stated["separation"] is not None else []),
    ]
    conditions += ["bounces"] * any(len(times) > 1 for _, times, _ in word.hops)
    conditions += ["least_period"] * (len(word.hops) > 1)
    if document["conditions"] != dict.fromkeys(conditions, "proved"):
        raise Unverified("the file claims fewer conditions of hops as proved, or others")
    radius = decimal(part["uniqueness_radius"])
    if radius <= 0 or any(claims[name][0] <= 0 for name in word.unknowns if name != "liftoff"):
        raise Unverified("the radius of uniqueness, a launch speed or a time is not positive")
    all_said = {**claims, **said}
    wide = {name: each for name, each in all_said.items() if each[0] < each[1] and name != "dliftoff"}
    check_halved(wide, bounds, partial(_check_cell, document, word, all_said, radius), CHECKS.splits)


def _check_cell(document: Mapping[str, Any], word: Word, claims: Bounds, radius: Fraction, cell: Bounds) -> None:
    """See that the theorem holds for parameters in a box."""
    doubled, stated = document["kind"] == "period doubling", document["machine"]
    machine = Machine(stated | {"eliminated": next(n for n in stated["coordinates"] if n != stated["launch"])}, cell)
    force = [slope(Field(machine, True).force, each.value) for each in machine.states[: 2 * len(machine.names)]]
    if doubled and len(machine.edges) > 2:
        raise Unverified("this program verifies doublings of smooth laws")
    if not all(is_zero(each, k) for each in force[2:] for k in range(len(machine.edges) - 1)):
        raise Unverified("the contact force depends on speeds")
    names = unknowns_of_doubling(word) if doubled else word.unknowns
    around = {name: ball(claims[name][0] - radius).union(ball(claims[name][1] + radius)) for name in names}

    def hops(box: Mapping[str, arb], degree: int) -> Hops:
        found = Hops(machine, cell, word, box, int(doubled), degree)
        *equations, (value, row) = chain(*found.equations)
        found.contract([*equations, (value + 2 if doubled else value, row)])  # the last is 0, or P' - 1, which is -2
        return found

    lowest = CHECKS.derived_order
    with ctx.workprec(CHECKS.bits_of_uniqueness):
        known = hops(around | {place.value: arb(0, 1) for place in machine.places}, lowest)
        for _ in range(CHECKS.images):
            known = known if known.inside else hops(known.common, lowest)
        box = hops(known.common, lowest).common if known.inside else known.common
    if not known.inside:
        raise Unverified("the solution is not shown to be the only one within the radius of uniqueness")
    for degree in (lowest, *CHECKS.higher_degrees):
        known = hops(box, degree)
        box, missed = known.common, _missed(known, claims, names, force)
        if missed or degree == lowest:
            continue
        further = _further(known, word) if doubled else {"multiplier": 1 + known.slope()}
        if not (missed := _missing(further, claims)):
            _check_motion(known, claims, word, claims.get("inject") or cell["inject"])
            return
    raise Unverified(f"{missed[0]} is not shown to lie in its enclosure")


def _missing(found: Mapping[str, arb], claims: Bounds) -> list[str]:
    """The names of values that are not shown to lie inside their enclosures; raises `Unverified` for one outside."""
    pairs = {name: (ball(claims[name][0]), ball(claims[name][1])) for name in found}
    if outside := [name for name, (low, high) in pairs.items() if found[name] < low or found[name] > high]:
        raise Unverified(f"{outside[0]} lies outside of its enclosure")
    return [name for name, (low, high) in pairs.items() if not low < found[name] < high]


def _missed(known: Hops, claims: Bounds, names: Sequence[str], force: Sequence[Tree]) -> list[str]:
    """The unknowns that are not shown to lie in their enclosures. The contact force at the launch is a function of the
    place alone. Where it is strictly monotone on the box, the place does not vary along the hops, and is a number at
    which the force vanishes exactly."""
    machine, weights, exact = known.machine, [each for (each,) in known.machine.embedded], set[str]()
    start = known.flights[0][0].start[1]
    pieces = known.contact.pieces_of(start)
    if not known.contact.values(start, pieces)[dot(weights, force[:2])].contains(0):
        low, high = claims["liftoff"]
        closed = {name: weight * number(low) for name, weight in zip(machine.names, weights, strict=True)}
        if low == high and known.box["liftoff"].contains(ball(low)):
            exact |= {"liftoff"} if is_zero(replaced(known.contact.force, closed), *pieces) else set()
        low, high = claims.get("dliftoff", (Fraction(1), Fraction(1)))
        exact |= {"dliftoff"} if low <= 0 <= high else set()
    return _missing({name: known.common[name] for name in names if name not in exact}, claims)


def _further(known: Hops, word: Word) -> dict[str, arb]:
    """The rate of the multiplier and the coefficient of the cycles at a doubling, from the second and third derivatives
    of the map: in the equations' derivatives of these orders the highest ones of the unknowns stand linearly."""
    box, found = dict(known.common), list[arb]()
    for order in (2, 3):
        jets = Hops(known.machine, known.inject, word, box, order, CHECKS.derived_order)
        *events, last = jets.values(order)
        moves, value = known.following(events, last)
        box |= {"d" * order + name: each for name, each in moves.items()}
        found.append(value)
    return {"multiplier_rate": found[0] / 2, "cubic_coefficient": found[0] * found[0] / 2 + found[1] / 3}


def _check_motion(known: Hops, claims: Bounds, word: Word, inject: tuple[Fraction, Fraction]) -> None:
    """See that the hops are motions, and those of the map, and that they come back no earlier."""
    machine = known.machine
    for flights, contact in zip(known.flights, known.contacts, strict=True):
        for i, flight in enumerate(flights):
            order = 2 if i else 3
            check_positive("that the gap stays open in flight", flight.parts, machine.gap, at_start=order, at_end=1)
            check_positive("that the separation is positive in flight", flight.parts, machine.separation)
        check_positive("that the contact pushes", contact.parts, contact.field.force, at_end=1)
        check_positive("that the separation is positive in contact", contact.parts, machine.separation)
    low, high = inject
    first, *others = launches = [claims[launch] for launch, _, _ in word.hops]
    if any(launch[0] <= high for launch in launches) or low <= 0:
        raise Unverified("the injection, or the speed of a lift-off, is not positive")
    for hops, after in enumerate(others, 1):
        if len(launches) % hops == 0 and first[0] <= after[1] and after[0] <= first[1]:
            raise Unverified(f"the launch speed may come back after {hops} hops")
