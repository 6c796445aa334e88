"""The equations of a stated machine, derived on exact expressions.

With the kinetic energy v' M(y) v/2 and the forces Q(y) of springs, weights and potentials, Lagrange's equations are

    M y'' = Q - C,    C = (d(M v)/dy) v - grad(v' M v)/2,

in contact with + lambda g, g the gap's gradient, and g y'' = 0: the closed gap determines one coordinate, y = E s.
Coordinates that stick are 0 in contact too, with a force on each of them.

All is in units of length and time that suit the motion, powers of 2: with y = L q and t = T u, the same equations
hold of q and u with the forces L T^2 Q.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from .decimals import exact_fraction
from .exact_linear import ExactRows, inner_product, pivots, solved, solved_by_parts
from .exact_symmetry import Column, ExactReversor
from .expressions import (
    ONE,
    ZERO,
    ExactExpression,
    along,
    depends_on,
    derivative_by,
    exact_number,
    expression,
    jacobian,
    substitute,
    symbol,
    total,
    vanishes,
)
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


@dataclass(frozen=True)
class Square:
    """The square of a speed in a kinetic energy: the gradient (n,) of a place whose second derivative by time is the
    gradient times the accelerations and the bend."""

    mass: ExactExpression
    gradient: Column
    bend: ExactExpression


class ExactMechanics:
    """The equations of motion of a stated machine.

    free : the name of a parameter that is an unknown
    squares : the kinetic energy as a sum of squares, where the inertia varies and it is one
    tuned : the symbols by name of those parameters that are unknowns of the orbit, and `tuned_units` their units
    y, v : symbols (n,) of the coordinates and their rates, in the units of `scale`
    parameters : the expression of each name: a number, a function of the `share` of an interval, or the symbol of an
        unknown
    inertia : M (n, n)
    gap : its weights (n,), exact, the largest of which is 1
    sticks : the coordinates that stick
    independent, embed : the coordinates of the contact, and the exact matrix (n, n - 1 - sticks) from these to all
    conservative, forces : (laws, n), Q and Q - C
    accelerations : (laws, n) in flight
    s, w : symbols of the coordinates of the contact and their rates
    contact_accelerations, contact_force : (laws, contact's coordinates) and (laws,) in contact, as functions of s and w
    holding_forces : (laws, sticks), the forces on what sticks
    reversor, contact_reversor : of y and v in flight, and of s and w in contact; without stated maps both reverse time
        alone
    order, contact_order : 1 where these leave the pieces of a law in order, -1 where they are in the opposite order
    domains : the conditions of each formula that is no spring's law along the motion
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
        self.inertia = self._inertia()
        self.gap = self._gap()
        self.eliminated = max(range(self.size), key=lambda i: self.gap[i])
        self.sticks = [stated.coordinates.index(name) for name in stated.sticks]
        self.independent = [i for i in range(self.size) if i not in (self.eliminated, *self.sticks)]
        if stated.launch not in [stated.coordinates[i] for i in self.independent]:
            raise Unproved(f"'{stated.launch}' is no coordinate of the contact")
        self.launched = [stated.coordinates[i] for i in self.independent].index(stated.launch)
        rows = {i: [Fraction(int(i == j)) for j in self.independent] for i in self.independent}
        rows[self.eliminated] = [-self.gap[j] for j in self.independent]
        rows |= {i: [Fraction(0)] * len(self.independent) for i in self.sticks}
        self.embed = [rows[i] for i in range(self.size)]
        self.counts = self.formula(stated.counts)
        self.separation = None if stated.separation is None else self.formula(stated.separation)
        self.heights = [(name, self.formula(height)) for name, height in stated.heights]
        self.pieces, self.law_domains, self.conservative = self._forces()
        self.squares = self._squares() if depends_on([each for row in self.inertia for each in row], self.y) else []
        centrifugal = self._centrifugal()
        self.forces = [[q - c for q, c in zip(force, centrifugal, strict=True)] for force in self.conservative]
        self.accelerations = [
            of_squares(self.squares, loads) or solved(self.inertia, force)
            for loads, force in zip(self.conservative, self.forces, strict=True)
        ]
        self.s, self.w = [self.y[i] for i in self.independent], [self.v[i] for i in self.independent]
        self.contact_accelerations, self.contact_force, self.holding_forces = self._contact()
        if depends_on(self.functions, [self.y[i] for i in self.sticks]):
            raise Unproved("something depends on the place of a coordinate that sticks")
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

    def _inertia(self) -> ExactRows:
        s, matrix = self.stated, [[ZERO] * self.size for _ in range(self.size)]
        if s.inertia:
            square = self.scale.length**2
            matrix = [[square * self.formula(entry) for entry in row] for row in s.inertia]
            for i in range(self.size):
                for j in range(i):
                    if not vanishes(matrix[i][j] - matrix[j][i]):
                        raise Unproved("the stated inertia is not plainly symmetric")
        for place, size in (*s.masses, *s.inerters):
            along, mass = self.gradient(self.formula(place)), self._of_parameters(size)
            matrix = [[matrix[i][j] + mass * along[i] * along[j] for j in range(self.size)] for i in range(self.size)]
        for pivot in pivots(matrix):
            self.domains.need("the inverse of the inertia", pivot, positive=True)
        return matrix

    def _gap(self) -> list[Fraction]:
        """The weights (n,) of the gap, the largest of which is 1."""
        gap = self.formula(self.stated.gap)
        weights = self.gradient(gap)
        (at_zero,) = substitute([gap], dict.fromkeys(self.y, ZERO))
        if not all(each.is_number for each in weights) or not at_zero.is_(0):
            raise Unproved(f"gap '{self.stated.gap}' is no sum of coordinates with numbers before them")
        largest = max(each.value for each in weights)
        if largest <= 0:
            raise Unproved(f"gap '{self.stated.gap}' is closed by no coordinate that rises")
        return [each.value / largest for each in weights]

    def _squares(self) -> list["Square"]:
        """The kinetic energy as a sum of squares of speeds; empty where it is stated otherwise."""
        s, square, found = self.stated, self.scale.length**2, list[Square]()
        for i, row in enumerate(s.inertia):
            entries = [square * self.formula(entry) for entry in row]
            if depends_on(entries, self.y) or not all(each.is_(0) for j, each in enumerate(entries) if j != i):
                return []
            if not entries[i].is_(0):
                found.append(Square(entries[i], [ONE if j == i else ZERO for j in range(self.size)], ZERO))
        for place, size in (*s.masses, *s.inerters):
            gradient = self.gradient(self.formula(place))
            bend = along(along(self.formula(place), self.y, self.v), self.y, self.v)
            found.append(Square(self._of_parameters(size), gradient, bend))
        return found

    def _centrifugal(self) -> Column:
        if self.squares:
            bends = [(each.mass * each.bend, each.gradient) for each in self.squares]
            return [total(bend * gradient[i] for bend, gradient in bends) for i in range(self.size)]
        momentum = [total(m * v for m, v in zip(row, self.v, strict=True)) for row in self.inertia]
        energy = total(v * p for v, p in zip(self.v, momentum, strict=True)) / 2
        turned = [total(s * v for s, v in zip(row, self.v, strict=True)) for row in jacobian(momentum, self.y)]
        return [a - b for a, b in zip(turned, self.gradient(energy), strict=True)]

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
            raise Unproved("a law in pieces acts along no sum of coordinates with numbers before them")
        breaks = tuple(expression_of(each, self.parameters, self.domains) - offset for each in spring.meetings)
        for k, place in enumerate(breaks):
            low, high = (self.pull(spring, piece, place + offset, Domains()) for piece in (k, k + 1))
            if not vanishes(low - high):
                raise Unproved("the spring's force is not plainly continuous at a breakpoint")
        return ExactPieces(tuple(each.value for each in weights), breaks)

    @property
    def functions(self) -> Column:
        """What the motion and its conditions are functions of: the entries of inertia and forces, the extensions that
        count and that separate, the friction, and the heights."""
        extensions = [self.counts, *([] if self.separation is None else [self.separation])]
        extensions += [self.formula(self.stated.friction)] if self.sticks and self.stated.friction is not None else []
        return [
            *extensions,
            *(height for _, height in self.heights),
            *(each for row in (*self.inertia, *self.forces) for each in row),
        ]

    def _contact(self) -> tuple[ExactRows, Column, ExactRows]:
        """Accelerations in contact, contact force, and the forces on what sticks, for each law, as functions of s and
        w."""
        places = {**dict(zip(self.y, self.embedded(self.s), strict=True))}
        places |= dict(zip(self.v, self.embedded(self.w), strict=True))
        inertia = [substitute(row, places) for row in self.inertia]
        count = range(len(self.independent))
        projected = [[total(row[i] * self.embed[i][j] for i in range(self.size)) for j in count] for row in inertia]
        reduced = [[total(self.embed[i][k] * projected[i][j] for i in range(self.size)) for j in count] for k in count]
        self._reduced = reduced, [self.along(substitute(force, places)) for force in self.forces]
        accelerations, contact_force, holding = list[Column](), list[ExactExpression](), list[Column]()
        squares = [
            Square(each.mass, self.along(substitute(each.gradient, places)), substitute([each.bend], places)[0])
            for each in self.squares
        ]
        squares = [each for each in squares if not all(x.is_(0) for x in each.gradient)]
        for loads, force in zip(self.conservative, self.forces, strict=True):
            inside = substitute(force, places)
            rates = of_squares(squares, self.along(substitute(loads, places))) or solved(reduced, self.along(inside))
            held = [inner_product(projected[i], rates) - inside[i] for i in (self.eliminated, *self.sticks)]
            accelerations.append(rates)
            contact_force.append(held[0])
            holding.append([each - self.gap[i] * held[0] for i, each in zip(self.sticks, held[1:], strict=True)])
        return accelerations, contact_force, holding

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
                raise Unproved(f"the gap of the {name}, {formula}, is not the one that opens or its image")
        if len(self.stated.gaps) > 2 or not (vanishes(again - gap) or vanishes(again + gap)):
            raise Unproved("the reversor and the symmetry do not take the closed gap to itself")
        if not all(vanishes(whole.shifts[i]) for i in self.sticks):
            raise Unproved("the reversor and the symmetry do not take what sticks to where it sticks")
        weights, breaks = (self.pieces.weights, self.pieces.breaks) if self.pieces else ([Fraction(0)] * self.size, ())
        self.order = back.check_turns("the reversor", self.y, self.v, self.inertia, self.forces, weights, breaks)
        self.contact_order = own.check_turns(
            "the symmetry after the reversor", self.s, self.w, *self._reduced, self.in_contact(weights), breaks
        )

    @property
    def landed_force(self) -> Column:
        """The contact force on the point that has landed, for each law: that on the one that opens, at the image of the
        state."""
        if not self.stated.steps:
            return self.contact_force
        return self.contact_reversor.turned(self.contact_force[:: self.contact_order], self.s, self.w)

    def in_contact(self, weights: Sequence[Fraction]) -> list[Fraction]:
        """The weights of the contact's coordinates in a sum of all of them."""
        count = range(len(self.independent))
        return [sum((weights[i] * self.embed[i][j] for i in range(self.size)), Fraction(0)) for j in count]

    def embedded(self, s: Sequence[ExactExpression]) -> Column:
        """All coordinates, or rates, from those of the contact."""
        return [total(weight * x for weight, x in zip(row, s, strict=True)) for row in self.embed]

    def along(self, forces: Sequence[ExactExpression]) -> Column:
        """Forces on all coordinates as those on the coordinates of the contact."""
        count = range(len(self.independent))
        return [total(self.embed[i][j] * forces[i] for i in range(self.size)) for j in count]

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
        mobility = solved(self.inertia, r)
        thrown = [mobility[1], -mobility[0]]
        falling = [self.scale.time**2 * each for each in solved(self.inertia, load)]
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


def of_squares(squares: Sequence[Square], loads: Column) -> Column | None:
    """The accelerations under loads (n,) of a kinetic energy that is a sum of n squares, with the gradients G as rows
    and the masses D: G' D (G y'' + bends) = loads. None for other numbers of squares, and where G is not easily solved.
    """
    if len(squares) != len(loads):
        return None
    rows = [each.gradient for each in squares]
    pulls = solved_by_parts([list(column) for column in zip(*rows, strict=True)], loads)
    if pulls is None:
        return None
    return solved_by_parts(rows, [pull / each.mass - each.bend for pull, each in zip(pulls, squares, strict=True)])
