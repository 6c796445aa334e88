"""Verifies a saved proof from its statement alone: a second program, with another method than the one that proved it.

It reads the formulas of the stated machine (`orbits.check_formulas`), derives Lagrange's equations from them
(`Machine`, `Field`), and follows motions by Taylor series in Arb's balls with direct bounds (`Part`): a box B that
holds the motion over a step by Picard's inclusion X + [0, h] f(B) in B, the Taylor coefficients from the box X at its
start, and the next one over B as remainder. So are the derivatives by the start; over several steps they are P + Q E
with a rounded matrix P, a nearly orthogonal Q and a small E (`Passage`), so that errors grow as the motions spread. By
the mean value theorem the states of a set are those of its centre and the derivatives times the deviations. Existence
and uniqueness follow from Krawczyk's test (`Solution`), on the stated enclosures and on these with the radius of
uniqueness around them. Signs along the motion are those of functions, and of their derivatives by time, on stretches of
it (`signs`). Where a law has pieces, a step stays on one of them, or crosses to the next one in the hull of both
(`in_pieces`). Nothing of the prover and of CasADi is used. All fields of the file are verified but `about`, `digits`,
`seconds` and `name`, its printed statement by `orbits.check_statement`. An exception other than `Unverified` is a fault
of this program.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from functools import partial, reduce
from itertools import chain, groupby, pairwise, product
from typing import Any

from flint import arb, arb_mat, arb_poly, arb_series, ctx, fmpq

from .check_formulas import (
    LESS,
    ONE,
    OPERATIONS,
    ZERO,
    Names,
    Tree,
    dot,
    is_zero,
    law_of,
    number,
    parse,
    replaced,
    slope,
    solved,
    solved_apart,
    tree,
)
from .check_statement import (
    CHECKS,
    LIMIT,
    MAPS,
    PHASES,
    Bounds,
    Unverified,
    bounds_of,
    check_document,
    check_printed,
    decimal,
    heed,
    limited,
    within,
)

ENDS = "liftoff_extension", "mid_flight_extension"


class Values(dict[Tree, Any]):
    """Balls, or power series of balls, that enclose trees, each computed once, where names have such values and states
    are on these pieces of a law; raises `Unverified` where an operation has no finite value."""

    def __init__(self, known: Iterable[tuple[Tree, Any]], pieces: Sequence[int] = ()):
        super().__init__(known)
        self.pieces = pieces

    def __missing__(self, of: Tree) -> Any:
        if of.kind == "pieces":
            x, *rest = [self[of.parts[k]] for k in self.pieces]
            x = reduce(arb.union, [coefficient(each, 0) for each in (x, *rest)]) if rest else x
        elif of.kind in OPERATIONS:
            x = OPERATIONS[of.kind](self[of.parts[0]], self[of.parts[1]])
        else:
            x = getattr(self[of.parts[0]], of.kind)() if of.parts else ball(of.value)
        if not coefficient(x, 0).is_finite():
            raise Unverified(f"a formula ({of.kind}) has no value on the motion, or no motion is in the enclosures")
        return self.setdefault(of, x)


def ball(value: Fraction) -> arb:
    """An enclosure of a fraction."""
    return arb(fmpq(value.numerator, value.denominator))


def coefficient(value: Any, order: int) -> arb:
    """A coefficient of a series, no number where that is cut off before, or of a constant."""
    if isinstance(value, arb_series):
        return value[order] if order < value.prec else arb("nan")
    return value if order == 0 else arb(0)


class Turn:
    """The map of coordinates y to signs y + shifts, and of their rates v to -signs v, which reverses time.

    places : the images of both by name
    flips : whether it takes the pieces of a law to those in the opposite order
    """

    def __init__(self, names: Sequence[str], states: Sequence[Tree], images: Sequence[Tree]):
        slopes = [[slope(image, name) for name in names] for image in images]
        self.signs, self.flips, n = [1 if row[i] is ONE else -1 for i, row in enumerate(slopes)], False, len(names)
        if slopes != [[number(sign * (i == j)) for j in range(n)] for i, sign in enumerate(self.signs)]:
            raise Unverified("a coordinate must be mapped to itself or its negative, plus an amount")
        self.shifts = [replaced(each, dict.fromkeys(names, ZERO)) for each in images]
        each = list(zip(self.signs, self.shifts, states[:n], states[n : 2 * n], strict=True))
        rates = [number(-sign) * v for sign, *_, v in each]
        self.places = dict(zip((x.value for x in states), [*images, *rates], strict=False))
        self.fixed = [v if sign > 0 else y - shift / number(2) for sign, shift, y, v in each]

    def of(self, tree: Tree) -> Tree:
        """A function of the image of a state, as one of the state."""
        return replaced(tree, self.places, self.flips)

    def midway(self, tree: Tree) -> Tree:
        """A function of a state that is its own image."""
        halves = [ZERO if sign > 0 else shift / number(2) for sign, shift in zip(self.signs, self.shifts, strict=True)]
        names, n = [*self.places], len(self.signs)
        still = [names[i + n * (sign > 0)] for i, sign in enumerate(self.signs)]
        return replaced(tree, dict(zip(still, halves, strict=True)))

    def check(self, m: "Machine", along: list[list[Tree]], free: Sequence[int], closed: Names) -> None:
        """See that the map is its own inverse for the free coordinates, and turns the equations of motion along some
        directions, where the gap is `closed` or not."""
        ends = m.edges, [LESS * each for each in m.edges[::-1]]
        same = [all(is_zero(replaced(self.of(a) - b, closed)) for a, b in zip(m.edges, e, strict=True)) for e in ends]
        self.flips, signs = not same[0], [self.signs[i] for i in free]
        inertia = [[dot(a, [dot(row, b) for row in m.inertia]) for b in along] for a in along]
        pairs = [(s * r, x) for s, row in zip(signs, inertia, strict=True) for r, x in zip(signs, row, strict=True)]
        pairs += [(s, dot(a, m.forces)) for s, a in zip(signs, along, strict=True)]
        zeros = [replaced(self.of(each) - number(sign) * each, closed) for sign, each in pairs]
        zeros += [self.shifts[i] for i in free if self.signs[i] > 0]
        if not any(same) or not all(is_zero(each, k) for each in zeros for k in range(len(m.edges) - 1)):
            raise Unverified("the stated maps do not reverse the equations of motion")


class Machine:
    """Lagrange's equations of a stated machine, with exact bounds of its parameters.

    states : the n coordinates, their rates, half a phase's time, and constants: parameters that are unknowns, and
        the places of others in their intervals
    inertia, forces, needed : M (n, n), what M y'' is without contact, and what has to have a value
    loads, squares : the same without the terms of the rates, and masses, gradients of places, and what the second
        derivatives by time of these are without accelerations, where the kinetic energy is half the sum of masses times
        squares of speeds and M varies
    weights : of the coordinates in the gap, or unless it is a sum, of the coordinate with which it vanishes
    unknowns : the names of the places and the rates at the launch of the coordinates that move in contact, by their
        numbers
    out, sticks : the coordinate that the closed gap determines, and the coordinates that rest in contact too: at 0, or
        at any place where `places` has that of the point along the ground
    embedded : the matrix from the others to all
    launch : of all coordinates and of their rates at the launch, the weights of the unknowns
    edges : functions that end the pieces of a spring's law, see `law_of`
    steps, back, again : whether maps are stated, and the reversors of the flight and of the contact
    landing : the gap that closes at landing
    """

    def __init__(self, stated: Mapping[str, Any], bounds: Bounds):
        names, needed = list(stated["coordinates"]), list[Tree]()
        n, wide = len(names), [name for name, (low, high) in bounds.items() if low < high]
        self.tuned = list(stated.get("tuned", ()))
        rates, places = [f"{name}'" for name in names], [f"place of {name}" for name in wide]
        states = [*names, *rates, "half time", *self.tuned, *places]
        self.names, self.needed, self.states = names, needed, [tree("name", value=each) for each in states]
        self.rates, self.constants = self.states[n : 2 * n], self.states[2 * n + 1 :]
        self.places = self.constants[len(self.tuned) :]
        one = [*names, *bounds, *self.tuned, "pi", "liftoff", "alpha", *PHASES, *ENDS]
        one += ["r"] * bool(stated["springs"]) + re.findall(r"\bz\b", stated["gravity"])[:1]
        special = {stated["eliminated"], stated["launch"], *stated.get("sticks", ())}
        if len({*one}) < len(one) or not all(map(str.isidentifier, one)) or not special <= {*names}:
            raise Unverified("a name stands for two things, or is not a name")
        known = {name: number((low + high) / 2) for name, (low, high) in bounds.items()}
        for name, place in zip(wide, self.places, strict=True):
            known[name] += number((bounds[name][1] - bounds[name][0]) / 2) * place
        known |= dict(zip(self.tuned, self.constants, strict=False))
        known["pi"], v = parse("4*atan(1)", {}, []), self.rates
        both = {**dict(zip(names, self.states, strict=False)), **known}
        masses, weights, inerters = ([(parse(m, known, needed), parse(h, both, needed)) for h, m in stated[kind]]
                                     for kind in ("masses", "weights", "inerters"))  # fmt: skip
        rows = [[parse(entry, both, needed) for entry in row] for row in stated["inertia"]] or [[ZERO] * n] * n
        if [*map(len, rows)] != [n] * n or any(rows[i][j] is not rows[j][i] for i, j in product(range(n), repeat=2)):
            raise Unverified("the stated inertia is not shown to be symmetric")

        def rate(of: Tree) -> Tree:
            return dot([slope(of, name) for name in names], v)

        twice = sum((rows[i][j] * v[i] * v[j] for i, j in product(range(n), repeat=2)), ZERO)
        energy = number(Fraction(1, 2)) * sum((m * rate(place) * rate(place) for m, place in masses + inerters), twice)
        momentum = [slope(energy, each.value) for each in v]
        self.inertia = [[slope(each, w.value) for w in v] for each in momentum]
        turning = [rate(p) - slope(energy, y) for p, y in zip(momentum, names, strict=True)]
        pull = parse(stated["surface_gravity"], both, needed)
        along = [(m * pull * parse(stated["gravity"], {**both, "z": h}, needed), h) for m, h in masses + weights]
        self.weight = sum((each for each, _ in along), ZERO)
        along += [(ONE, parse(each, both, needed)) for each in stated["potentials"]]
        self.edges = [ONE, LESS]
        for spring in stated["springs"]:
            extension = parse(spring["extension"], both, needed)
            law, edges = law_of(spring, known, extension, needed)
            along.append((ONE, law) if spring["potential"] else (law, extension))
            if len(edges) > 2 < len(self.edges):
                raise Unverified("more than one spring has a law in pieces")
            self.edges = max(self.edges, edges, key=len)
        self.loads = [sum((LESS * size * slope(at, y) for size, at in along), ZERO) for y in names]
        alone = all(rows[i][j] is ZERO or i == j for i, j in product(range(n), repeat=2))
        squares = masses + inerters + [(rows[i][i], self.states[i]) for i in range(n) if rows[i][i] is not ZERO]
        fixed = all(slope(mass, y) is ZERO for mass, _ in squares for y in names)
        varies = any(slope(each, y) is not ZERO for each in chain(*self.inertia) for y in names)
        self.squares = [(mass, [slope(place, y) for y in names], rate(rate(place)))
                        for mass, place in squares if alone and fixed and varies]  # fmt: skip
        if self.squares:  # the same, without terms that cancel
            self.inertia = [[sum((mass * to[min(i, j)] * to[max(i, j)] for mass, to, _ in self.squares), ZERO)
                             for j in range(n)] for i in range(n)]  # fmt: skip
            turning = [sum((mass * to[i] * bend for mass, to, bend in self.squares), ZERO) for i in range(n)]
        self.forces = [load - each for load, each in zip(self.loads, turning, strict=True)]
        self.gap, self.counts = (parse(stated[name], both, needed) for name in ("gap", "counts"))
        self.separation = ONE if stated["separation"] is None else parse(stated["separation"], both, needed)
        out, launch = names.index(stated["eliminated"]), names.index(stated["launch"])
        self.weights = self._weights(stated["eliminated"])
        if self.weights[out] is ZERO or launch == out:
            raise Unverified("the gap does not determine the coordinate that the file names")
        self.sticks = [names.index(name) for name in stated.get("sticks", ())]
        self.along = {names.index(x): parse(place, both, needed) for x, place in stated.get("places", ())}
        self._check_sticks(out, launch)
        self.unknowns = {i: (name, f"{name}'") for i, name in enumerate(names) if i not in (out, *self.sticks)}
        self.unknowns[launch] = "liftoff", "alpha"
        embedded = [[Fraction(int(i == j)) for j in self.unknowns] for i in range(n)]
        embedded[out] = [-self.weights[j].value / self.weights[out].value for j in self.unknowns]
        ends = list(zip(*self.unknowns.values(), strict=True))
        self.launch = [[dict(zip(end, row, strict=True)) for row in embedded] for end in ends]
        for i in self.along:
            self.launch[0][i] = {names[i]: Fraction(1)}
        self.out, self.embedded = out, [[number(each) for each in row] for row in embedded]
        maps = [dict(stated.get(kind, ())) for kind in MAPS[:2]]
        if not {*maps[0], *maps[1]} <= {*names}:
            raise Unverified("a map is stated for something that is not a coordinate")
        first, then = ([parse(each.get(name, name), both, needed) for name in names] for each in maps)
        self.back, self.steps = Turn(names, self.states, first), any(kind in stated for kind in MAPS)
        self.again = Turn(names, self.states, [replaced(each, self.back.places) for each in then])
        self.landing, sticks = self.back.of(self.gap), [names[i] for i in self.sticks if i not in self.along]
        self.friction = parse(stated["friction"], known, needed) if self.sticks else ZERO
        heights = [parse(height, both, needed) for _, height in stated.get("heights", ())]
        self.above = [each for each in heights if not is_zero(each - self.gap)]
        moving = [*chain(*self.inertia), *self.forces, self.counts, self.separation, *heights]
        if any(not is_zero(slope(each, x), k) for each in moving for x in sticks for k in range(len(self.edges) - 1)):
            raise Unverified("the machine depends on the place of the coordinate that sticks")
        self.prescribed = [self._off(name, number(decimal(value)), stated, both)
                           for name, value in stated.get("prescribed", ())]  # fmt: skip
        if self.sticks and not self.steps:
            raise Unverified("a machine that sticks states no maps")
        self.grazes = stated.get("grazes", False)
        if self.grazes and not all(is_zero(self.back.midway(each)) for each in (self.gap, rate(self.gap))):
            raise Unverified("the gap and its rate do not vanish in the middle of the flight")
        self.masses, self.heavy = masses, masses + weights
        self.centre = parse(stated["centre"], both, needed) if self.along else ZERO
        if self.steps:
            self._check_steps([parse(gap, both, needed) for _, gap in stated.get("gaps", ())])

    def _check_sticks(self, out: int, launch: int) -> None:
        """See that what sticks is not in the gap's sum, and has a place along the ground unless the gap is a sum."""
        if out in self.sticks or launch in self.sticks or any(self.weights[i] is not ZERO for i in self.sticks):
            raise Unverified("the coordinate that sticks is the gap, or is launched")
        if not {*self.along} <= {*self.sticks} or not (self.summed or [*self.along] == self.sticks):
            raise Unverified("a place along the ground is stated for what does not stick, or not for what does")

    def _weights(self, closing: str) -> list[Tree]:
        """The weights of the coordinates in the gap, or those of the coordinate with which it vanishes."""
        weights = [slope(self.gap, name) for name in self.names]
        self.summed = all(each.kind == "number" for each in weights)
        if not is_zero(replaced(self.gap, dict.fromkeys(self.names if self.summed else [closing], ZERO))):
            raise Unverified(
                "the gap is not a sum of coordinates with numbers before them, nor vanishes with a single one"
            )
        return weights if self.summed else [number(int(name == closing)) for name in self.names]

    def on_point(self, force: Tree, held: Sequence[Tree]) -> list[Tree]:
        """The forces across and along the ground on the point that opens, from those on the coordinate with which the
        gap vanishes and on what sticks."""
        if self.summed:
            return [force, *held]
        out, along = self.names[self.out], [*self.along.items()]
        held = [each / slope(place, self.names[i]) for each, (i, place) in zip(held, along, strict=True)]
        pulls = dot([slope(place, out) for _, place in along], held)
        return [(force - pulls) / slope(self.gap, out), *held]

    def forces_in_flight(self, field: "Field") -> list[Tree]:
        """The forces of the ground in flight, across and along it, times the square of half the time: from weights, and
        from masses and their accelerations. See that the image of a state has the same, or the second's negative."""
        time, image = self.states[2 * len(self.names)], self.back.of(self.centre)
        mirrored = any(map(is_zero, (image - self.centre, image + self.centre)))
        if not mirrored or not all(is_zero(self.back.of(height) - height) for _, height in self.heavy):
            raise Unverified("the stated maps do not leave the heights of the masses as they are, or their centre")
        across = sum((mass * field.along(height, 2) for mass, height in self.masses), time * time * self.weight)
        return [across, sum((mass for mass, _ in self.masses), ZERO) * field.along(self.centre, 2)]

    def is_zero(self, of: Tree) -> bool:
        """Whether a tree is 0 in contact, on each piece of the law."""
        return all(is_zero(replaced(of, self.closed), k) for k in range(len(self.edges) - 1))

    def _off(self, name: str, value: Tree, stated: Mapping[str, Any], both: Names) -> list[Tree]:
        """Functions of the states at the starts of flight and contact whose sum is 0 where a quantity has a value."""
        twice = number(2) * self.states[2 * len(self.names)]
        match name:
            case "alpha":
                return [self.rates[self.names.index(stated["launch"])] - value, ZERO]
            case "liftoff_extension":
                return [self.counts - value, ZERO]
            case "flight_time":
                return [twice - value, ZERO]
            case "contact_time":
                return [ZERO, twice - value]
            case "period":
                return [twice - value, twice]
            case "frequency" if value is not ZERO:
                return [twice - ONE / value, twice]
            case "speed":
                centre = parse(stated["centre"], both, self.needed)
                return [dot([slope(centre, name) for name in self.names], self.rates) - value, ZERO]
            case _ if (place := name.removesuffix("_at_landing")) != name and place in {
                self.names[i] for i in self.along
            }:
                return [self.back.places[place] - value, ZERO]
            case "step" if self.sticks and "step" in self.tuned:
                return [both["step"] - value, ZERO]
            case "mean_speed" if self.sticks and "step" in self.tuned:
                return [both["step"] - value * twice, LESS * value * twice]
        raise Unverified(f"this program does not verify that '{name}' is prescribed")

    def _check_steps(self, gaps: Sequence[Tree]) -> None:
        """See that the stated maps turn the motions back, and that the stated gaps are images of one another."""
        n, columns, again = len(self.names), list(map(list, zip(*self.embedded, strict=True))), self.again.of(self.gap)
        self.closed = {each[i].value: dot(self.embedded[i], [each[j] for j in self.unknowns])
                       for i in (self.out, *self.sticks)
                       for each in (*([] if i in self.along else [self.states]), self.rates)}  # fmt: skip
        self.back.check(self, [[number(int(i == j)) for j in range(n)] for i in range(n)], range(n), {})
        self.again.check(self, columns, [*self.unknowns], self.closed)
        zeros = [each - own for each, own in zip(gaps, (self.gap, self.landing), strict=False)]
        if len(gaps) > 2 or not all(map(is_zero, zeros)) or not any(map(is_zero, (again - self.gap, again + self.gap))):
            raise Unverified("the gaps are not mapped to one another")
        moved = [i for i in self.along if self.again.signs[i] < 0]
        if moved or not all(is_zero(self.again.shifts[i]) for i in self.sticks):
            raise Unverified("the coordinate that sticks is not mapped to where it sticks")


class Field:
    """The motion of the states in half a phase, with time scaled such that it lasts from 0 to 1; the first 2 n move.
    `force` is the contact force that keeps the gap's acceleration 0, `held` are the forces that do so for what sticks,
    and `slopes` the derivatives of `rates` by the states.
    """

    def __init__(self, machine: Machine, contact: bool):
        m, time, out = machine, machine.states[2 * len(machine.names)], machine.out
        self.states, self.needed, self.edges = m.states, m.needed, m.edges
        if m.steps:  # the other half of the phase is the image of this one
            self.needed = [*m.needed, *map((m.again if contact else m.back).of, m.needed)]
        along = list(zip(*m.embedded, strict=True))
        self.pivots, (free,) = solved(m.inertia, m.forces)
        reduced = [[dot(a, [dot(row, b) for row in m.inertia]) for b in along] for a in along]
        _, (inside,) = solved(reduced, [dot(a, m.forces) for a in along])
        one = [[number(int(i == j)) for j in range(len(m.names))] for i in range(len(m.names))]
        flying, standing = self._of_squares(m, one), self._of_squares(m, along)
        if flying and standing:  # with positive masses M is positive definite where these have values
            free, inside, self.pivots = flying, standing, [mass for mass, *_ in m.squares]
        held = [dot(row, inside) for row in m.embedded]
        self.force = (dot(m.inertia[out], held) - m.forces[out]) / m.weights[out]
        self.held = [dot(m.inertia[i], held) - m.forces[i] for i in m.sticks]
        self.force, *self.held = m.on_point(self.force, self.held)
        self.rates = [time * each for each in (*m.rates, *(held if contact else free))]
        self.rates += [ZERO] * (len(m.states) - len(self.rates))
        self.slopes = self.changes()

    def changes(self) -> dict[tuple[int, int], Tree]:
        """The derivatives of the rates by the states that are not 0, by the numbers of both."""
        rows = enumerate(map(self.gradient, self.rates))
        return {(i, j): each for i, row in rows for j, each in enumerate(row) if each is not ZERO}

    @staticmethod
    def _of_squares(m: Machine, along: Sequence[Sequence[Tree]]) -> list[Tree] | None:
        """The accelerations y'' along directions: G' D (G y'' + bends) = loads, with the gradients G of as many squares
        as there are directions and their masses D; None where there are others, or this is not solved easily."""
        squares = [(mass, [dot(to, a) for a in along], bend) for mass, to, bend in m.squares]
        squares = [each for each in squares if any(x is not ZERO for x in each[1])]
        rows = [to for _, to, _ in squares]
        if len(rows) != len(along):
            return None
        pulls = solved_apart([list(row) for row in zip(*rows, strict=True)], [dot(a, m.loads) for a in along])
        if pulls is None:
            return None
        return solved_apart(rows, [pull / mass - bend for pull, (mass, _, bend) in zip(pulls, squares, strict=True)])

    def gradient(self, of: Tree) -> list[Tree]:
        """The derivatives of a tree by all states."""
        return [slope(of, each.value) for each in self.states]

    def along(self, of: Tree, order: int) -> Tree:
        """A derivative by the scaled time of a function of the states."""
        for _ in range(order):
            of = dot(self.gradient(of), self.rates)
        return of

    def values(self, x: Sequence[Any], pieces: Sequence[int] = ()) -> Values:
        """The values of trees at states, which are on pieces of a law."""
        return Values(zip(self.states, x, strict=True), pieces)

    def pieces_of(self, x: Sequence[arb]) -> tuple[int, ...]:
        """The pieces of a law that states may be on."""
        ends = enumerate(pairwise(map(self.values(x).__getitem__, self.edges)))
        return tuple(k for k, (low, high) in ends if not (low < 0 or high > 0))

    def linear(self, end: tuple[list[arb], list[arb], arb_mat], of: Tree) -> tuple[arb, list[arb]]:
        """A function of the states at an end of a passage: its value for c, and its derivatives by w for all."""
        centre, at = (self.values(x, self.pieces_of(x)) for x in end[:2])
        return centre[of], (arb_mat([[at[each] for each in self.gradient(of)]]) * end[2]).tolist()[0]

    def time_across(self, x: Sequence[arb], edge: int) -> arb:
        """About the time in which states cross an edge, and more; no number where they do not."""
        values, of = self.values(x), self.edges[edge]
        return 3 * values[of].abs_upper() / abs(values[self.along(of, 1)].mid()) + arb(2) ** (16 - ctx.prec)

    def step(self, rows: list[list[Any]], length: Fraction, order: int) -> "Part":
        """A step from rows, at most as long as said: on the piece that they are on, up to its end, or across that.
        Raises `Unverified` where it is too long."""
        pieces = self.pieces_of(start := [row[0] for row in rows])
        edge = max(pieces)
        if len(pieces) == 1:
            part = Part(self, pieces, rows, length, order)
            edge = max(part.touched)
            if part.time == length or part.h > self.time_across(part.states(part.h), edge):
                return part
        across = self.time_across(start, edge)
        if across < ball(length):
            part = Part(self, (edge - 1, edge), rows, time := Fraction(float(across)), order)
            if part.time == time and len(self.pieces_of(part.states(part.h))) == 1:
                return part
        raise Unverified("the place where two pieces of a law meet is not crossed")

    def end(self, x: Sequence[arb], time: Fraction) -> Sequence[arb]:
        """The states a time after these. Raises `Unverified` where a step adds much to their errors."""
        small, left = arb(2) ** (12 - ctx.prec), time
        while left:
            part = self.step([[each] for each in x], left, int(CHECKS.order_per_bit * ctx.prec))
            spread, x, left = 4 * max(each.rad() for each in x), part.states(part.h), left - part.time
            if not all(each.rad() <= small * (1 + abs(each)) + spread for each in x):
                raise Unverified("the step is too long")
        return x


class Part:
    """A step from rows of balls over a time, or as long as the motion is on pieces of a law: Taylor polynomials, with
    the next coefficient over the whole step as the last. Across an edge they have degree 1. Raises `Unverified` where
    the time is too long.

    time, h : of the step
    touched : the pieces on which the motion may be at its end or, where it leaves its pieces, right after that
    """

    def __init__(self, field: Field, pieces: Sequence[int], rows: list[list[Any]], time: Fraction, order: int):
        self.field, self.pieces, order = field, pieces, order if len(pieces) == 1 else 1
        rests = self.taylor(self.inclusion(rows, ball(time)), order)
        self.polynomials = [[arb_poly([*each, rest[order]]) for each, rest in zip(*both, strict=True)]
                            for both in zip(self.taylor(rows, order - 1), rests, strict=True)]  # fmt: skip
        self.time, self.touched, waiting = Fraction(0), pieces, [time]
        while waiting and waiting[-1] * 2**ctx.prec > time:
            length = waiting.pop()
            self.touched = field.pieces_of(self.states(ball(self.time).union(ball(self.time + length))))
            if {*self.touched} <= {*pieces}:
                self.time += length
            else:
                waiting += [length / 2] * 2
        self.h = ball(self.time)

    def taylor(self, rows: list[list[Any]], order: int) -> list[list[list[arb]]]:
        """Taylor coefficients of the rows, one list for each entry: of the states from their rates, and of the
        derivatives from the linear equations that these obey."""
        heed()
        cap, found, columns = ctx.cap, [[row[0]] for row in rows], [arb_mat([row[1:] for row in rows])]
        try:
            for k in range(order):
                ctx.cap = k + 1
                at = self.field.values([arb_series(each, k + 1) for each in found], self.pieces)
                for each, rate in zip(found, [at[rate] for rate in self.field.rates], strict=True):
                    each.append(coefficient(rate, k) / (k + 1))
            slopes = [arb_mat(len(rows), len(rows)) for _ in range(order if len(rows[0]) > 1 else 0)]
            for place, change in self.field.slopes.items() if slopes else ():
                for k, matrix in enumerate(slopes):
                    matrix[place] = coefficient(at[change], k)
        except (ZeroDivisionError, ValueError):
            raise Unverified("the motion reaches a place where a formula has no value") from None
        finally:
            ctx.cap = cap
        for k in range(len(slopes)):
            columns.append(dot(slopes[: k + 1], columns[::-1], 0 * columns[0]) * (arb(1) / (k + 1)))
        derived = zip(*(each.tolist() for each in columns), strict=True)
        return [[x, *map(list, zip(*d, strict=True))] for x, d in zip(found, derived, strict=True)]

    def inclusion(self, rows: list[list[Any]], h: arb) -> list[list[Any]]:
        """Rows that hold the motion for a time h from these: Picard's inclusion. All that is needed has a value there,
        and the inertia is positive definite."""
        box, times, least = rows, arb(0).union(h), arb(2) ** (8 - ctx.prec)
        for _ in range(12):
            new = [[x + times * rate for x, (_, rate) in zip(*both, strict=True)]
                   for both in zip(rows, self.taylor(box, 1), strict=True)]  # fmt: skip
            pairs = [pair for both in zip(new, box, strict=True) for pair in zip(*both, strict=True)]
            if all(inner.is_finite() and outer.contains(inner) for inner, outer in pairs):
                at, field = self.field.values([row[0] for row in new], self.pieces), self.field
                if all(at[each] > 0 for each in field.pivots) and all(at[each].is_finite() for each in field.needed):
                    return new
            box = [[x + arb(0, 0.1) * (x - x.mid()) + arb(0, least) * (abs(x) + 1) for x in row] for row in new]
        raise Unverified("no box holds the motion, or the inertia is not positive definite")

    def states(self, t: arb) -> list[arb]:
        """Enclosures of the states at a time, or at all times of a ball, within the step."""
        return [row[0](t) for row in self.polynomials]

    def values(self, t: arb) -> Values:
        """The values of trees then."""
        return self.field.values(self.states(t), self.pieces)


def moved(values: Sequence[arb], matrix: arb_mat, deviations: Sequence[arb]) -> list[arb]:
    """Values and a matrix times deviations from these."""
    return [value + dot(row, deviations, arb(0)) for value, row in zip(values, matrix.tolist(), strict=True)]


def orthogonal(matrix: arb_mat) -> arb_mat:
    """About the columns of a matrix made orthogonal in turn, by Gram and Schmidt's method."""
    found = list[list[arb]]()
    for row in matrix.mid().transpose().tolist():
        for other in found:
            row = moved(row, arb_mat([[-x] for x in other]), [dot(row, other, arb(0))])
        found.append([(x / dot(row, row, arb(0)).sqrt()).mid() for x in row])
    return arb_mat(found).transpose()


class Passage:
    """The motions of a field over the scaled times from 0 to 1, from starts c + S w with a
    box of w: steps, and at their `starts` and at either end enclosures of the motion from c, and derivatives by w.
    A step with the derivatives T takes P + Q E to T P + (T Q) E. The next Q is T Q made orthogonal (Lohner): E
    grows by a matrix that is nearly triangular, as the motions spread, and not by products of absolute values."""

    def __init__(self, field: Field, centre: Sequence[arb], seeds: arb_mat, reach: Sequence[arb],
                 order: int = CHECKS.derived_order):  # fmt: skip
        one, rounded, frame, error = (arb_mat(len(centre), len(centre), each) for each in (1, 1, 1, 0))
        self.field, box = field, moved(centre, seeds, reach)
        self.start, slopes, length, self.starts = (list(centre), box, seeds), seeds, CHECKS.first, list[tuple]()
        left = Fraction(1)
        while left:
            length = min(length, left)
            try:
                rows = [[x, *row] for x, row in zip(box, one.tolist(), strict=True)]
                part = field.step(rows, length, order)
                transition = arb_mat([[each(part.h) for each in row[1:]] for row in part.polynomials])
                turned, whole = transition * frame, transition * rounded
                back = (turning := orthogonal(turned)).inv()
                before, centre = centre, field.end(centre, part.time)
            except (Unverified, ZeroDivisionError) as reason:
                if length < CHECKS.shortest:
                    raise Unverified(f"the motion is not enclosed: {reason}") from None
                length /= 2
                continue
            self.starts.append((part, before, slopes))
            rounded, frame = whole.mid(), turning
            error = back * (whole - rounded) + (back * turned) * error
            box = moved(centre, slopes := rounded * seeds + frame * (error * seeds), reach)
            left, length = left - part.time, length * Fraction(5, 4)
        self.end, self.parts = (list(centre), box, slopes), [part for part, *_ in self.starts]


def signs(parts: Sequence[Part], of: Tree, orders: Callable[..., Sequence[int]]) -> list[list[int]]:
    """On stretches of a motion, in order, the first of some derivatives of a function that has a sign there, and that
    sign; the function itself may have it by the mean value theorem. Which orders are tried depends on whether orders
    above 0 decided all stretches before, and whether one holds the end."""
    found, last = list[list[int]](), len(parts) - 1
    waiting = [(each, arb(0), each.h, i == last, ctx.prec) for i, each in enumerate(parts)][::-1]
    while waiting:
        heed()
        part, low, high, ends, left = waiting.pop()
        at, middle, along = part.values(low.union(high)), (low + high) / 2, part.field.along
        tried = orders(all(order for order, _ in found), ends)
        values = ((order, at[along(of, order)]) for order in tried)
        smooth = 0 in tried and len(part.pieces) == 1
        means = ((0, part.values(middle)[of] + at[along(of, 1)] * (low.union(high) - middle)) for _ in range(smooth))
        both = chain(values, means)
        if decided := next(([order, 1 if each > 0 else -1] for order, each in both if each > 0 or each < 0), None):
            found.append(decided)
        elif left:
            waiting += [(part, middle, high, ends, left - 1), (part, low, middle, False, left - 1)]
        else:
            raise Unverified("a sign along the motion cannot be decided")
    return found


def check_positive(what: str, parts: Sequence[Part], of: Tree, at_start: int = 0, at_end: int = 0) -> None:
    """See that a function is positive inside the motion. At one end it may be known to have a zero of some order: it is
    positive near that zero by Taylor's formula where the derivative of that order has the fitting sign."""
    found = signs(parts, of, lambda begins, ends: [at_end if ends else 0, *([at_start] if begins and at_start else [])])
    if [sign for _, sign in found] != [1] * (len(found) - 1) + [(-1) ** at_end]:
        raise Unverified(f"it is false {what}")


def turns(parts: Sequence[Part], of: Tree, at_end: bool) -> int:
    """How often a function turns inside the motion, at whose end it is known to turn if `at_end`. On each stretch its
    rate has a sign, or the rate's rate has: then the rate has one zero there or none, as the signs before and after
    tell."""
    found, field = signs(parts, of, lambda *_: (1, 2)), parts[0].field
    start, end = (part.values(t)[field.along(of, 1)] for part, t in ((parts[0], arb(0)), (parts[-1], parts[-1].h)))
    turned = (order == 2 and len({sign for _, sign in group}) > 1 for order, group in groupby(found, lambda x: x[0]))
    if not at_end and found[-1][0] == 2 and (end > 0 or end < 0):
        found.append([1, 1 if end > 0 else -1])
    if not (start > 0 or start < 0) or (found[-1][0] == 1) == at_end or any(turned):
        raise Unverified(
            "turns of the extension cannot be told apart, or it is stationary where the motion begins or ends"
        )
    rates = [1 if start > 0 else -1, *(sign for order, sign in found if order == 1)]
    return sum(a != b for a, b in pairwise(rates))


class Contraction:
    """Equations on a box of unknowns, for all values of the parameters, and Krawczyk's image: that holds what solutions
    the box has, and where it is inside, just one.

    common : what box and image have in common, the parameters' places too
    moved, inside : how far the image is from the middle of the box, and whether it is in the interior of it
    """

    def __init__(self, machine: Machine, box: Mapping[str, arb]):
        self.machine, self.box = machine, box
        self.centre = [each.mid() for each in box.values()]
        self.reach = [each - c for each, c in zip(box.values(), self.centre, strict=True)]

    def contract(self, equations: Sequence[tuple[arb, list[arb]]]) -> None:
        """Find the image from the equations: their values at the middle of the box, and their derivatives on it."""
        names, reach = list(self.box), self.reach
        by_all, count = arb_mat([row for _, row in equations]), len(equations)
        if count != len(names) - len(self.machine.places):
            raise Unverified("the numbers of equations and unknowns differ")
        try:
            inverse = arb_mat([row[:count] for row in by_all.tolist()]).mid().inv().mid()
        except ZeroDivisionError:
            raise Unverified("the equations are singular") from None
        change = moved([arb(0)] * count, arb_mat(count, len(names), 1) - inverse * by_all, reach)
        change = moved(change, inverse, [-value for value, _ in equations])
        self.moved = [*change, *reach[count:]]
        image = {name: c + d for name, c, d in zip(names, self.centre, self.moved, strict=True)}
        self.common = {n: image[n].intersection(own) if image[n].overlaps(own) else arb("nan")
                       for n, own in self.box.items()}  # fmt: skip
        self.inside = all(abs(d) < each.rad() for d, each in zip(change, self.box.values(), strict=False))


class Solution(Contraction):
    """The equations of half an orbit.

    passages : half a phase each, from the launch, in contact from its image
    """

    def __init__(self, machine: Machine, box: Mapping[str, arb]):
        super().__init__(machine, box)
        names, centre, reach = list(box), self.centre, self.reach
        self.passages, phases = list[Passage](), [name for name in PHASES if name in names]
        at_centre, at_all = (Values((each, at[names.index(each.value)]) for each in machine.constants)
                             for at in (centre, [*box.values()]))  # fmt: skip
        for phase, turn in zip(phases, (None, machine.again), strict=False):
            signs = [*turn.signs, *(-sign for sign in turn.signs)] if turn else [1] * (2 * len(machine.names))
            rows = [{n: s * w for n, w in row.items()} for s, row in zip(signs, chain(*machine.launch), strict=True)]
            rows += [{phase: Fraction(1, 2)}, *({each.value: Fraction(1)} for each in machine.constants)]
            seeds = [[ball(row.get(name, Fraction(0))) for name in names] for row in rows]
            start = moved([arb(0)] * len(rows), arb_mat(seeds), centre)
            for i, shift in enumerate(turn.shifts if turn else ()):
                start[i] += at_centre[shift]
                seeds[i] = [each + at_all[slope(shift, name)] for each, name in zip(seeds[i], names, strict=True)]
            self.passages.append(Passage(Field(machine, turn is not None), start, arb_mat(seeds), reach))
        first = self.passages[0].field
        equations = [first.linear(self.passages[0].start, each) for each in (first.force, *first.held)]
        ends = machine.back.fixed, [machine.again.fixed[i] for i in machine.unknowns]
        for passage, those in zip(self.passages, ends, strict=False):
            equations += [passage.field.linear(passage.end, each) for each in those]
        for each in machine.prescribed:
            pairs = [p.field.linear(p.start, off) for p, off in zip(self.passages, each, strict=True)]
            (value, row), (other, more) = pairs
            equations.append((value + other, [a + b for a, b in zip(row, more, strict=True)]))
        self.contract(equations)


def check(document: Mapping[str, object], limit: float = LIMIT, verify: Callable | None = None) -> list[str]:
    """Why a saved proof, of an orbit or what a function verifies, is not verified, in words; empty where all of its
    theorem is. Raises `OutOfTime` where that takes more than `limit` seconds of processor time."""
    try:
        with limited(limit):
            check_document(document)
            (verify or _check_orbit)(document)
    except Unverified as error:
        return [str(error)]
    except RecursionError:
        return ["the formulas of the file, or what follows from them, are nested too deeply"]
    return []


def check_said(document: Mapping[str, Any], kind: str, bounds: Mapping[str, Any]) -> None:
    """See that the file has this kind, that all is proved, and that it says the same where it repeats itself, also the
    bounds of the parameters; raises `Unverified`."""
    found = [document[name] for name in ("format", "kind", "proved", "attraction_radius")]
    if found != ["persistent-orbits proof 2", kind, True, None] or document["radius"] is None:
        raise Unverified(
            "this program verifies proofs of orbits and of hops that come back, by this version, all proved, without "
            "attraction"
        )
    machine, parts, again = document["machine"], document["parts"], dict.fromkeys(("alpha", *PHASES, "bounce_side"))
    said, parameters = ({name: {"low": low, "high": high} for name, (low, high) in pairs.items()}
                        for pairs in (document["enclosures"], bounds))  # fmt: skip
    said = {name: each for name, each in said.items() if name not in machine.get("tuned", ())}
    radius = parts[0]["uniqueness_radius"] if len(parts) == 1 else None
    again |= {**said, "parameters": parameters, "units": machine["units"], "uniqueness_radius": radius, "reasons": []}
    if false := [name for name, value in again.items() if document.get(name) != value]:
        raise Unverified(f"'{false[0]}' is not what the file says elsewhere, or this program does not verify it")
    check_printed(document)


def check_radius(document: Mapping[str, Any], said: Bounds) -> None:
    """See that the radius is half the width of the enclosure of alpha, or more; raises `Unverified`."""
    if 2 * decimal(document["radius"]) < said["alpha"][1] - said["alpha"][0]:
        raise Unverified("the radius is less than half the width of the enclosure of alpha")


def _check_orbit(document: Mapping[str, Any]) -> None:
    """See that the theorem holds in each part of the parameters' intervals, and that the parts cover these."""
    machine = document["machine"]
    check_said(document, "orbit", machine["parameters"])
    speed = dict(machine.get("prescribed", ())).get("speed")
    if not ("friction" in machine) == ("heights" in machine) == ("sticks" in machine) or ("centre" in machine) != (
        speed is not None or bool(machine.get("places"))
    ):
        raise Unverified("the machine states friction but nothing that sticks, or a centre of mass without its speed")
    if not 0 <= decimal(machine.get("restitution", "0")) <= 1:
        raise Unverified("the restitution does not lie between 0 and 1")
    whole, said = bounds_of(document["machine"]["parameters"]), bounds_of(document["enclosures"])
    parts = [(bounds_of(part["parameters"]), bounds_of(part["unknowns"]), part) for part in document["parts"]]
    motion, stated = document["motion"], document["machine"]["separation"] is not None
    conditions = [*(["separation"] if stated else []), "clearance", "contact_force", "contact_end"] if motion else []
    conditions += ["heights", "friction"] if motion and machine.get("sticks") else []
    conditions += ["stance"] if motion and machine.get("places") else []
    main = "alpha", *PHASES, *document["machine"].get("tuned", ())
    if document["conditions"] != dict.fromkeys(conditions, "proved") or (document["family"] is not None) != motion:
        raise Unverified("the file claims fewer conditions of a motion as proved, or others")
    for box, unknowns, _ in parts:
        same = {name: unknowns[name] for name in main if name in unknowns}
        if said.keys() != {*same, *(ENDS if motion else ())}:
            raise Unverified(f"the file encloses quantities that this program does not verify: {', '.join(said)}")
        check_radius(document, said)
        if box.keys() != whole.keys() or not (within(box, whole) and within(same, said)):
            raise Unverified(
                "a part has other parameters than the machine, or its unknowns lie outside those of the whole"
            )
    cuts = [sorted({edge for box in (whole, *(box for box, *_ in parts)) for edge in box[name]}) for name in whole]
    for edges in product(*(list(pairwise(each)) or [(each[0], each[0])] for each in cuts)):
        heed()
        if not any(within(dict(zip(whole, edges, strict=True)), box) for box, *_ in parts):
            raise Unverified("the parts do not cover the intervals of the parameters")
    for box, unknowns, part in parts:
        radius = decimal(part["uniqueness_radius"])
        if radius <= 0:
            raise Unverified("the radius of uniqueness is not positive")
        check_halved(unknowns, box, partial(_check_cell, document, unknowns, radius), CHECKS.splits)


def check_halved(claims: Bounds, cell: Bounds, verify: Callable[[Bounds], None], left: int) -> None:
    """See that a function verifies claims for parameters in a box, which is halved where it does not at once; it works
    with some more bits than the claims have."""
    narrow = min((high - low) / (abs(high) + abs(low) + Fraction(1, 10**9)) for low, high in claims.values())
    if not narrow:
        raise Unverified("an enclosure has no width")
    bits = narrow.denominator.bit_length() - narrow.numerator.bit_length()
    if bits > CHECKS.bits:
        raise Unverified("the enclosures have more digits than this program verifies")
    try:
        with ctx.workprec(max(CHECKS.bits_of_uniqueness, bits + CHECKS.guard_bits)):
            verify(cell)
    except Unverified:
        widest = max(cell, key=lambda n: (cell[n][1] - cell[n][0]) / (abs(cell[n][0] + cell[n][1]) or 1), default=None)
        if left == 0 or widest is None or cell[widest][0] == cell[widest][1]:
            raise
        middle = (cell[widest][0] + cell[widest][1]) / 2
        for half in ((cell[widest][0], middle), (middle, cell[widest][1])):
            check_halved(claims, {**cell, widest: half}, verify, left - 1)


def _check_cell(document: Mapping[str, Any], claims: Bounds, radius: Fraction, cell: Bounds) -> None:
    """See that the theorem holds for parameters in a box: the solution that is claimed within bounds exists there,
    is the only one within a radius, and is the motion that the file says."""
    machine = Machine(document["machine"], cell)
    phases = [name for name in PHASES if name in claims]
    names = [name for pair in machine.unknowns.values() for name in pair] + [machine.names[i] for i in machine.along]
    names += phases + machine.tuned
    both = len(machine.names) > 2 or document["motion"] or machine.tuned
    other = claims.keys() != {*names} or len(claims) != len(names) or (both and len(phases) < 2)
    if other or any(claims[name][0] <= 0 for name in ("alpha", *phases)):
        raise Unverified("the enclosed unknowns are not those of the equations, or the speed or a time is not positive")
    stated, around = ({name: ball(claims[name][0] - more).union(ball(claims[name][1] + more)) for name in names}
                      | {place.value: arb(0, 1) for place in machine.places} for more in (0, radius))  # fmt: skip
    with ctx.workprec(CHECKS.bits_of_uniqueness):
        known = Solution(machine, around)
        for _ in range(3):
            known = known if known.inside else Solution(machine, known.common)
    if not known.inside:
        raise Unverified("the solution is not shown to be the only one within the radius of uniqueness")
    solution = Solution(machine, stated)
    for _ in range(3):  # where the enclosures do not suffice, from the boxes that are known to hold the solution
        lies = all(ball(claims[name][0]) < solution.common[name] < ball(claims[name][1]) for name in names)
        if solution.inside and lies:
            return _check_motion(document, solution) if document["motion"] else None
        if not all(known.common[name].overlaps(stated[name]) for name in names):
            break
        known = solution = Solution(machine, known.common)
    raise Unverified("the solution is not shown to lie in its enclosures")


def _check_motion(document: Mapping[str, Any], solution: Solution) -> None:
    """See that what is said of the motion holds."""
    machine, passages, said = solution.machine, solution.passages, bounds_of(document["enclosures"])
    force, moving = passages[1].field.force, [*machine.unknowns]
    flight, contact = (each.parts for each in passages)
    back, again, middle = machine.back, machine.again, machine.again.fixed[moving[0]]
    if str(document["family"]) != str(turns(flight, machine.counts, is_zero(back.of(machine.counts) - machine.counts))):
        raise Unverified("the family is wrong")
    check_positive("that the gap stays open in flight", flight, machine.gap, at_start=3, at_end=2 * machine.grazes)
    landed = again.of(force)
    same = not machine.steps or machine.is_zero(landed - force)
    if same:
        check_positive("that the contact pushes", contact, force, at_start=1)
    else:
        check_positive("that the point that has landed pushes", contact, landed, at_start=1)
        check_positive("that the point that opens pushes", contact, force)
    _check_friction(machine, passages, landed, same)
    for what, of in [("separation is", machine.separation), *(("height is", each) for each in machine.above)]:
        for each in {of, back.of(of)}:
            check_positive(f"that the {what} positive in flight", flight, each)
        for each in {of, again.of(of)}:
            check_positive(f"that the {what} positive in contact", contact, each)
    if not is_zero(machine.landing - machine.gap):
        check_positive("that the gap that lands stays open in flight", flight, machine.landing)
        for each in {machine.landing, again.of(machine.landing)}:
            check_positive("that the gap that lands next stays open in contact", contact, each)
    if len(moving) == 1:
        sign = 1 if contact[0].values(arb(0))[middle] > 0 else -1
        check_positive("that the contact first rests midway", contact, number(sign) * middle, at_end=1)
    for name, end in zip(ENDS, (passages[0].start, passages[0].end), strict=True):
        value, row = passages[0].field.linear(end, machine.counts)
        if not ball(said[name][0]) <= value + dot(row, solution.moved, arb(0)) <= ball(said[name][1]):
            raise Unverified(f"{name} is not shown to lie in its enclosure")


def _check_friction(machine: Machine, passages: Sequence[Passage], landed: Tree, same: bool) -> None:
    """See that friction holds what sticks, and that the ground pushes and holds what stands in flight.

    landed, same : the contact force on the point that has landed, and whether it is that on the point that opens
    """
    flight, contact, again, field = passages[0].parts, passages[1].parts, machine.again, passages[1].field
    for each in field.held:
        image = again.of(each)
        same = same and any(map(machine.is_zero, (image - each, image + each)))
        if not same and not machine.along:
            raise Unverified("the forces of the ground are not the same, or the negative, at the image of a state")
        for across, along, order in [(landed, image, 1), (field.force, each, 0)][: 1 if same else 2]:
            for other in (along, LESS * along):
                check_positive("that what sticks does not slide", contact, machine.friction * across + other, order)
    if machine.along:
        across, along = machine.forces_in_flight(passages[0].field)
        check_positive("that the ground pushes in flight", flight, across)
        for other in (along, LESS * along):
            check_positive("that what stands in flight does not slide", flight, machine.friction * across + other)
