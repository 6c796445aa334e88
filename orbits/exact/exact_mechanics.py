"""The equations of a stated machine: Lagrange's equations of `mechanics.kinetics` under the forces Q(y) of springs,
weights and potentials that the theorem states.

All is in units of length and time that suit the motion, powers of 2: with y = L q and t = T u, the same equations
hold of q and u with the forces L T^2 Q.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from ..mechanics import Closed, ClosedGap, Kinetics, Square
from ..symbolic import (
    ZERO,
    Column,
    ExactExpression,
    ExactRows,
    Factors,
    depends_on,
    derivative_by,
    exact_number,
    expression,
    inner_product,
    rows_of,
    substitute,
    symbol,
    total,
    vanishes,
)
from .decimals import exact_fraction
from .exact_symmetry import ExactReversor
from .formulas import Domains, expression_of
from .refusal import Unproved
from .stated import StatedMachine, StatedSpring


@dataclass(frozen=True)
class Scale:
    """Units of the coordinates and of time in which the equations are of order 1."""

    length: Fraction = Fraction(1)
    time: Fraction = Fraction(1)

    @property
    def speed(self) -> Fraction:
        """The unit of the rates."""
        return self.length / self.time

    @classmethod
    def of(cls, speed: float, time: float, swings: int = 1) -> "Scale":
        """The units of a motion with this launch speed and half time of flight, in which the extension swings to and
        fro `swings` times; powers of 2, as any units would do."""
        unit = nearest_power_of_two(time / (3 * swings))
        return cls(nearest_power_of_two(speed * float(unit) / 3), unit)


def nearest_power_of_two(value: float) -> Fraction:
    """The power of 2 that is nearest to a number above 0; 1 for any other value."""
    if not 0 < value < math.inf:
        return Fraction(1)
    return Fraction(2) ** round(math.log2(value))


@dataclass(frozen=True)
class ExactPieces:
    """The breakpoints of a law along a sum of coordinates: the weights (n,) of the sum, and the places, ascending."""

    weights: tuple[Fraction, ...]
    breaks: tuple[ExactExpression, ...]


@dataclass(frozen=True)
class LoneExtension:
    """The extension r of two coordinates whose springs all act along it under constant gravity: it moves alone, and a
    sum w of the coordinates is in free fall, w'' = fall.

    weights, thrown : of the coordinates in r and in w
    accelerations : of r, for each law, as functions of the symbol `place`
    domains : the conditions of each law there
    """

    place: ExactExpression
    weights: Column
    thrown: Column
    accelerations: list[ExactExpression]
    fall: ExactExpression
    domains: list[Domains]


class ExactMechanics:
    """The equations of motion of a stated machine.

    free : the name of a parameter that is an unknown
    tuned : the symbols by name of those parameters that are unknowns of the orbit, and `tuned_units` their units
    y, v : symbols (n,) of the coordinates and their rates, in the units of `scale`
    parameters : the expression of each name: a number, a function of the `share` of an interval, or the symbol of an
        unknown
    kinetics, closed : the kinetic energy, and that while the gap is closed; inertia : M (n, n)
    gap, height : its weights (n,), exact; the largest one is 1. Where it is a formula, these are of the only coordinate
        with which it vanishes, and `height` is the formula, otherwise None
    sticks : the coordinates that stick; `places`, those of them that stick at any place, with the unknowns of where
    along, centre : for these, the place along the ground of the point that opens, and that of the centre of mass, None
        where that is not known
    independent, embed : the coordinates that move in contact, and the exact matrix (n, n - 1 - sticks) from these to
        all; `contact`, all coordinates and rates by their symbols, as functions of s and w
    conservative, forces : (laws, n), Q and Q - C
    accelerations : (laws, n) in flight
    s, w : symbols of the coordinates of the contact and their rates
    contact_accelerations, contact_force : (laws, contact's coordinates) and (laws,) in contact, as functions of s and w
    holding_forces : (laws, sticks), the forces on what sticks. Under a gap that is a formula they are along the ground
        on the point that opens, and the contact force is across it
    reversor, contact_reversor : of y and v in flight, and of s and w in contact; without stated maps both reverse time
        alone
    order, contact_order : 1 where these leave the pieces of a law in order, -1 where they are in the opposite order
    domains : the conditions along the motion of each formula that is not the law of a spring
    law_domains : the conditions of each law of a machine in pieces; one entry where there are no pieces
    """

    def __init__(
        self, stated: StatedMachine, scale: Scale, free: str | None = None, units: Mapping[str, Fraction] | None = None
    ):
        self.stated, self.size, self.scale = stated, len(stated.coordinates), scale
        bounds = stated.parameters.items()
        self.parameters = {name: symbol(name) if name == free else parameter_of(name, *ends) for name, ends in bounds}
        self.tuned = {name: unknown(name) for name in stated.tuned}
        self.tuned_units = {name: (units or {}).get(name, Fraction(1)) for name in self.tuned}
        self.parameters |= {name: self.tuned_units[name] * each for name, each in self.tuned.items()}
        self.y = [symbol(name) for name in stated.coordinates]
        self.v = [symbol(f"{name}'") for name in stated.coordinates]
        places = [scale.length * each for each in self.y]
        self.names = {**self.parameters, **dict(zip(stated.coordinates, places, strict=True))}
        self.domains = Domains()
        self.kinetics = self._kinetics()
        self.inertia = self.kinetics.matrix
        self.sticks = [stated.coordinates.index(name) for name in stated.sticks]
        self.gap, self.height = self._gap()
        self.places = {stated.coordinates.index(name): unknown(name) for name, _ in stated.places}
        self.along = [self.formula(place) for _, place in stated.places]
        self.centre = self.formula(stated.centre) if self.places and stated.centre else None
        held = tuple(self.sticks), self.y, self.v, tuple(self.places)
        closed_gap = ClosedGap(self.gap, *held, self.height, tuple(self.along))
        if self.height is not None and len(self.places) < len(self.sticks):
            raise Unproved(f"a coordinate sticks at 0 under the gap '{stated.gap}', which is not a sum of coordinates")
        self.independent = closed_gap.left[: closed_gap.own]
        self.embed = [row[: closed_gap.own] for row in closed_gap.exact_embed]
        self.s, self.w = ([each[i] for i in self.independent] for each in (self.y, self.v))
        stays = {self.y[i]: place for i, place in self.places.items()}
        self.inside = lambda functions: substitute(closed_gap.inside(functions), stays)
        self.in_contact = lambda weights: closed_gap.weights_inside(weights)[: closed_gap.own]
        names = [stated.coordinates[i] for i in self.independent]
        if stated.launch not in names:
            raise Unproved(f"'{stated.launch}' is not a coordinate of the contact")
        self.launched = names.index(stated.launch)
        self.counts = self.formula(stated.counts)
        self.separation = None if stated.separation is None else self.formula(stated.separation)
        self.heights = [(name, self.formula(height)) for name, height in stated.heights]
        self.pieces, self.law_domains, self.conservative = self._forces()
        if self.pieces and any(closed_gap.weights_inside(self.pieces.weights)[closed_gap.own :]):
            raise Unproved("a law in pieces acts along a coordinate that sticks at any place")
        centrifugal = self.kinetics.centrifugal
        self.forces = [[q - c for q, c in zip(force, centrifugal, strict=True)] for force in self.conservative]
        self.accelerations = [self.kinetics.accelerations(loads, bent=True) for loads in self.conservative]
        self.closed = Closed(self.kinetics, closed_gap)
        columns = rows_of(self.conservative, self.size)
        accelerations = rows_of(self.closed.accelerations(columns, bent=True), len(columns[0]))
        self.contact_accelerations = [substitute(row, stays) for row in accelerations]
        forces = closed_gap.on_points(self.closed.forces(rows_of(self.accelerations, self.size)))
        self.contact_force, *holding = (substitute(row, stays) for row in forces)
        self.holding_forces = rows_of(holding, len(columns[0]))
        if depends_on(self.functions, [self.y[i] for i in self.sticks if i not in self.places]):
            raise Unproved("the machine depends on the place of a coordinate that sticks")
        self.reversor, whole = self._reversors()
        self.contact_reversor, self.order, self.contact_order = whole.on(self.independent), 1, 1
        if stated.steps:
            self._check_reversors(whole)

    def formula(self, text: str, **names: ExactExpression) -> ExactExpression:
        """The expression of a formula; its domains are stored."""
        return expression_of(text, {**self.names, **names}, self.domains)

    def gradient(self, of: ExactExpression) -> Column:
        """The gradient (n,) by the coordinates."""
        return [derivative_by(of, place) for place in self.y]

    def _of_parameters(self, text: str) -> ExactExpression:
        """A mass, which does not depend on the coordinates."""
        found = self.formula(text)
        if depends_on([found], self.y):
            raise Unproved(f"mass '{text}' depends on coordinates")
        return found

    def _kinetics(self) -> Kinetics:
        s, square = self.stated, self.scale.length**2
        stated = [[square * self.formula(entry) for entry in row] for row in s.inertia] or None
        for i, row in enumerate(stated or []):
            if not all(vanishes(row[j] - other[i]) for j, other in enumerate(stated or []) if j < i):
                raise Unproved("the stated inertia is not shown to be symmetric")
        paths = [
            [Square.of(self._of_parameters(size), self.formula(place), self.y, self.v)]
            for place, size in (*s.masses, *s.inerters)
        ]
        found = Kinetics.of(paths, stated, self.y, self.v)
        for pivot in Factors(found.matrix).pivots:
            self.domains.need("the inverse of the inertia", pivot, positive=True)
        return found

    def _gap(self) -> tuple[list[Fraction], ExactExpression | None]:
        """The weights (n,) of the gap, the largest one being 1, and its formula where it is not their sum."""
        gap = self.formula(self.stated.gap)
        weights = self.gradient(gap)
        if not all(each.is_number for each in weights):
            at_closed = [ZERO if i in self.sticks else substitute([gap], {y: ZERO})[0] for i, y in enumerate(self.y)]
            closing = [i not in self.sticks and vanishes(each) for i, each in enumerate(at_closed)]
            if closing.count(True) == 1:
                return [Fraction(each) for each in closing], gap
        (at_zero,) = substitute([gap], dict.fromkeys(self.y, ZERO))
        if not all(each.is_number for each in weights) or not at_zero.is_(0):
            raise Unproved(
                f"gap '{self.stated.gap}' is not a sum of coordinates with numbers before them, and no formula that "
                "vanishes with one of them alone"
            )
        largest = max(each.value for each in weights)
        if largest <= 0:
            raise Unproved(f"gap '{self.stated.gap}' has no coordinate with a weight above 0 that could close it")
        return [each.value / largest for each in weights], None

    def _forces(self) -> tuple[ExactPieces | None, list[Domains], ExactRows]:
        """The pieces of the springs' laws, their domains, and the forces (laws, n) without those of the speeds."""
        s, constant = self.stated, [ZERO] * self.size
        for place, mass in (*s.masses, *s.weights):
            height = self.formula(place)
            weight = self._of_parameters(mass) * self.gravity(height)
            constant = [f - weight * slope for f, slope in zip(constant, self.gradient(height), strict=True)]
        for energy in s.potentials:
            constant = [f - slope for f, slope in zip(constant, self.gradient(self.formula(energy)), strict=True)]
        in_pieces = [each for each in s.springs if each.meetings]
        if len(in_pieces) > 1:
            raise Unproved("more than one spring has a law in pieces")
        domains = [Domains() for _ in range(1 + (len(in_pieces[0].meetings) if in_pieces else 0))]
        laws = list[Column]()
        for law, own in enumerate(domains):
            force = list(constant)
            for spring in s.springs:
                extension = self.formula(spring.extension)
                pull = self.pull(spring, law if spring.meetings else 0, extension, own)
                force = [f - pull * slope for f, slope in zip(force, self.gradient(extension), strict=True)]
            laws.append(force)
        scaled = [[self.scale.time**2 * each for each in force] for force in laws]
        return (self._pieces(in_pieces[0]) if in_pieces else None), domains, scaled

    def gravity(self, height: ExactExpression) -> ExactExpression:
        """The acceleration of gravity at a height."""
        return self.formula(self.stated.surface_gravity) * self.formula(self.stated.gravity, z=height)

    def pull(self, spring: StatedSpring, piece: int, extension: ExactExpression, domains: Domains) -> ExactExpression:
        """The force of a spring at an extension, on a piece of its law; its domains are added to these."""
        r, own = symbol("r"), Domains()
        if spring.rows:
            law = expression_of(spring.force[0], self.parameters, own) * polynomial_between(
                spring.rows[piece : piece + 2], r
            )
            if piece == 0:
                own.need("the spring's table", r - exact_fraction("a row", spring.rows[0][0]), positive=True)
            if piece == len(spring.rows) - 2:
                own.need("the spring's table", exact_fraction("a row", spring.rows[-1][0]) - r, positive=True)
        else:
            law = expression_of(spring.force[piece], {**self.parameters, "r": r}, own)
        force, *places = substitute(
            [derivative_by(law, r) if spring.potential else law, *(each.place for each in own)], {r: extension}
        )
        for each, place in zip(own, places, strict=True):
            domains.need(each.what, place, each.positive)
        return force

    def _pieces(self, spring: StatedSpring) -> ExactPieces:
        extension = self.formula(spring.extension)
        weights = self.gradient(extension)
        (offset,) = substitute([extension], dict.fromkeys(self.y, ZERO))
        if not all(each.is_number for each in weights):
            raise Unproved("a law in pieces must act along a sum of coordinates with numbers before them")
        breaks = tuple(expression_of(each, self.parameters, self.domains) - offset for each in spring.meetings)
        for k, place in enumerate(breaks):
            low, high = (self.pull(spring, piece, place + offset, Domains()) for piece in (k, k + 1))
            if not vanishes(low - high):
                raise Unproved("the spring's force is not shown to be continuous at a breakpoint")
        return ExactPieces(tuple(each.value for each in weights), breaks)

    @property
    def functions(self) -> Column:
        """What the motion and its conditions are functions of: the entries of inertia and forces, the extensions that
        count and that separate, the friction, the heights, and places along the ground."""
        extensions = [self.counts, *self.along]
        extensions += [each for each in (self.separation, self.height, self.centre) if each is not None]
        extensions += [self.formula(self.stated.friction)] if self.sticks and self.stated.friction is not None else []
        return [
            *extensions,
            *(height for _, height in self.heights),
            *(each for row in (*self.inertia, *self.forces) for each in row),
        ]

    def _reversors(self) -> tuple[ExactReversor, ExactReversor]:
        """The reversor of the flight, and that of the contact for all coordinates."""
        names, maps = self.stated.coordinates, (dict(self.stated.reversor), dict(self.stated.symmetry))
        images = ([self.formula(each.get(name, name)) / self.scale.length for name in names] for each in maps)
        back, anew = (ExactReversor.of(each, self.y, names) for each in images)
        return back, anew.after(back)

    def _check_reversors(self, whole: ExactReversor) -> None:
        """Raise `Unproved` unless the stated maps turn the equations back, and the gaps are images of one another."""
        gap, back, own = self.formula(self.stated.gap), self.reversor, self.contact_reversor
        (closes,), (again,) = back.turned([gap], self.y, self.v), whole.turned([gap], self.y, self.v)
        for (name, formula), expected in zip(self.stated.gaps, (gap, closes), strict=False):
            if not vanishes(self.formula(formula) - expected):
                raise Unproved(f"the gap of the {name}, {formula}, is neither the one that opens nor its image")
        if len(self.stated.gaps) > 2 or not (vanishes(again - gap) or vanishes(again + gap)):
            raise Unproved("the reversor and the symmetry do not map the closed gap to itself")
        if self.stated.grazes:
            each = zip(back.signs, back.shifts, self.y, self.v, strict=True)
            middle = {v if sign > 0 else y: ZERO if sign > 0 else shift / 2 for sign, shift, y, v in each}
            rate = inner_product(self.gradient(gap), self.v)
            if not all(map(vanishes, substitute([gap, rate], middle))):
                raise Unproved("the gap and its rate do not vanish wherever the reversor leaves a state as it is")
        moved = [i for i in self.places if whole.signs[i] < 0]
        if moved or not all(vanishes(whole.shifts[i]) for i in self.sticks):
            raise Unproved(
                "the reversor and the symmetry do not map a coordinate that sticks to the place where it sticks"
            )
        weights, breaks = (self.pieces.weights, self.pieces.breaks) if self.pieces else ([Fraction(0)] * self.size, ())
        self.order = back.check_turns("the reversor", self.y, self.v, self.inertia, self.forces, weights, breaks)
        self.contact_order = own.check_turns(
            "the symmetry after the reversor",
            self.s,
            self.w,
            [self.inside(row) for row in self.closed.own.matrix],
            [self.closed.along(self.inside(force)) for force in self.forces],
            self.in_contact(weights),
            breaks,
        )

    @property
    def landed_force(self) -> Column:
        """The contact force on the point that has landed, for each law: that on the one that opens, at the image of the
        state."""
        if not self.stated.steps:
            return self.contact_force
        return self.contact_reversor.turned(self.contact_force[:: self.contact_order], self.s, self.w)

    def embedded(self, s: Sequence[ExactExpression], rates: bool = False) -> Column:
        """All coordinates, or rates, from those of the contact."""
        found = [total(weight * x for weight, x in zip(row, s, strict=True)) for row in self.embed]
        return found if rates else [self.places.get(i, each) for i, each in enumerate(found)]

    @cached_property
    def contact(self) -> dict[ExactExpression, ExactExpression]:
        """All coordinates and rates by their symbols, in a state of the contact."""
        return dict(zip([*self.y, *self.v], [*self.embedded(self.s), *self.embedded(self.w, rates=True)], strict=True))

    def lone_extension(self) -> LoneExtension | None:
        """The extension that moves alone; None where none evidently does."""
        s, height = self.stated, symbol("z")
        gravity = expression_of(s.gravity, {**self.names, "z": height}, Domains())
        load = [ZERO] * self.size
        for at, mass in (*s.masses, *s.weights):
            weight = self._of_parameters(mass) * self.gravity(ZERO)
            load = [f + weight * slope for f, slope in zip(load, self.gradient(self.formula(at)), strict=True)]
        varying = [*load, *(entry for row in self.inertia for entry in row)]
        if self.size != 2 or s.potentials or not s.springs or depends_on([gravity], [height, *self.y]):
            return None
        if depends_on(varying, self.y):
            return None
        actions = list[tuple[Fraction, ExactExpression]]()
        along: list[Fraction] = []
        for spring in s.springs:
            extension = self.formula(spring.extension)
            slopes = self.gradient(extension)
            if not all(each.is_number for each in slopes):
                return None
            weights = [each.value for each in slopes]
            along = along or [each / self.scale.length for each in weights]
            first = next((i for i in (0, 1) if along[i]), 0)
            factor = weights[first] / along[first] if along[first] else Fraction(0)
            if not factor or [factor * each for each in along] != weights:
                return None
            (offset,) = substitute([extension], dict.fromkeys(self.y, ZERO))
            actions.append((factor, offset))
        place, r = symbol("lone extension"), [expression(each) for each in along]
        mobility = self.kinetics.accelerations(r)
        thrown = [mobility[1], -mobility[0]]
        falling = [self.scale.time**2 * each for each in self.kinetics.accelerations(load)]
        accelerations, domains, squared = list[ExactExpression](), [Domains() for _ in self.forces], self.scale.time**2
        for law, own in enumerate(domains):
            pull = total(
                squared * factor * self.pull(each, law if each.meetings else 0, factor * place + offset, own)
                for each, (factor, offset) in zip(s.springs, actions, strict=True)
            )
            accelerations.append(-(pull * inner_product(r, mobility) + inner_product(r, falling)))
        return LoneExtension(place, r, thrown, accelerations, -inner_product(thrown, falling), domains)


def polynomial_between(rows: Sequence[Sequence[str]], r: ExactExpression) -> ExactExpression:
    """The polynomial of degree 5 with the value, slope and curvature of two rows (r, value, slope, curvature)."""
    (a, *low), (b, *high) = ([exact_fraction("a row", each) for each in row] for row in rows)
    h, u, v = b - a, r - a, r - b
    first = [low[0], low[1], low[2] / 2]
    # Beyond the Taylor polynomial at the first row there is u**3 (g[0] + g[1] v + g[2] v**2).
    rest = [high[0] - (first[0] + first[1] * h + first[2] * h**2), high[1] - first[1] - low[2] * h, high[2] - low[2]]
    g = [rest[0] / h**3]
    g.append(rest[1] / h**3 - 3 * g[0] / h)
    g.append(rest[2] / (2 * h**3) - 3 * g[0] / h**2 - 3 * g[1] / h)
    return first[0] + u * (first[1] + u * (first[2] + u * (g[0] + v * (g[1] + v * g[2]))))


def unknown(name: str) -> ExactExpression:
    """The symbol of an unknown."""
    return symbol(f"unknown {name}")


def place_of(name: str) -> ExactExpression:
    """The symbol of a parameter's place in its interval, from -1 to 1."""
    return symbol(f"share of {name}")


def parameter_of(name: str, low: Fraction, high: Fraction) -> ExactExpression:
    """The expression of a parameter between bounds."""
    return exact_number((low + high) / 2) + exact_number((high - low) / 2) * place_of(name)
