"""The kinetic energy of a mechanism on exact expressions, and what follows from it: accelerations under loads.

Masses m_k that move along places h_k with the gradients J_k (n,) have the inertia M = sum of m_k J_k J_k^T, and with
the bends b_k = v^T (Hessian of h_k) v Lagrange's equations under loads Q (n,) are

    M y'' + C = Q,    C = sum of m_k b_k J_k;

a stated inertia S that varies adds (d(S v)/dy) v - grad(v^T S v)/2 to C. While a gap w . y = 0 is closed, with the
largest weight 1 on the eliminated coordinate, and coordinates that stick are 0, the others s move by y = E s, and with
the gradients of the gap and of what sticks as the rows of G there are the forces lambda,

    E^T M E s'' + E^T C = E^T Q,    lambda = -(G M^-1 G^T)^-1 G M^-1 (Q - C).

The inverse is written without subtracting masses where that is short. By the formula of Cauchy and Binet the
determinant of M is the sum, over all n of the masses, of the product of these and the square of the determinant of
their gradients; its adjugate that, over all n - 1 of them, of the product of their masses and a a^T, with the vector a
of the minors of their gradients. So all digits remain however far apart the masses are; elimination loses those of a
light mass on a heavy one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import combinations
from math import comb, prod
from typing import NamedTuple

import numpy as np

from ..symbolic import (
    ONE,
    ZERO,
    Column,
    ExactExpression,
    ExactRows,
    Factors,
    along,
    derivative_by,
    exact_number,
    inner_product,
    jacobian,
    nonzero,
    number_of,
    rows_of,
    simplified,
    solved_by_parts,
    substitute,
    total,
    vanishes,
)

# Sums of more products than these are longer than an elimination.
MOST_PRODUCTS = 70


class Square(NamedTuple):
    """The square of a speed in a kinetic energy: the mass, the gradient (n,) of a place whose second derivative by time
    is the gradient times the accelerations and the bend."""

    mass: ExactExpression
    gradient: Column
    bend: ExactExpression = ZERO

    @classmethod
    def of(
        cls, mass: ExactExpression, place: ExactExpression, y: Sequence[ExactExpression], v: Sequence[ExactExpression]
    ) -> "Square":
        """The square of a mass that moves along a place."""
        bend = along(along(place, y, v), y, v)
        return cls(mass, [derivative_by(place, each) for each in y], ZERO if vanishes(bend) else bend)


class Kinetics:
    """A kinetic energy.

    size : n
    squares : of masses that move along functions of the coordinates
    matrix : M (n, n)
    turning : (n,), the part of C that is not of the squares, None without
    centrifugal : C (n,)
    """

    def __init__(
        self, size: int, squares: Sequence[Square], matrix: ExactRows, turning: Column | None, centrifugal: Column
    ):
        self.size, self.matrix, self.turning, self.centrifugal = size, matrix, turning, centrifugal
        together = dict[tuple, Square]()
        for each in squares:  # masses that move along one function are one
            if any(not slope.is_(0) for slope in each.gradient):
                known = together.get(tuple(each.gradient))
                mass = each.mass + known.mass if known else each.mass
                together[tuple(each.gradient)] = Square(mass, each.gradient, each.bend)
        self.squares, self._minors = list(together.values()), dict[tuple, ExactExpression]()

    @classmethod
    def of(
        cls, paths: Sequence[Sequence[Square]], stated: ExactRows | None, y: Sequence[ExactExpression],
        v: Sequence[ExactExpression],
    ) -> "Kinetics":  # fmt: skip
        """The kinetic energy of masses, each with the squares of its paths, and of a `stated` inertia (n, n), None
        without one."""
        n, squares = len(y), [each for path in paths for each in path]
        matrix, turning, centrifugal = [list(row) for row in stated or [[ZERO] * n] * n], None, [ZERO] * n
        for each in squares:
            matrix = [
                [entry + each.mass * a * b for entry, b in zip(row, each.gradient, strict=True)]
                for row, a in zip(matrix, each.gradient, strict=True)
            ]
        for path in paths:
            bends = [total(each.bend * each.gradient[i] for each in path) for i in range(n)]
            if len(path) == 1 or not all(map(vanishes, bends)):  # those of a mass on a circle vanish together
                centrifugal = [a + path[0].mass * b for a, b in zip(centrifugal, bends, strict=True)]
        if stated:
            squares += squares_of(stated)
            momentum = [inner_product(row, v) for row in stated]
            energy = inner_product(v, momentum) / 2
            turned = [inner_product(row, v) for row in jacobian(momentum, y)]
            own = [a - derivative_by(energy, each) for a, each in zip(turned, y, strict=True)]
            if not all(map(vanishes, own)):
                turning, centrifugal = own, [a + b for a, b in zip(centrifugal, own, strict=True)]
        return cls(n, squares, matrix, turning, centrifugal)

    @cached_property
    def bends(self) -> bool:
        """Whether there are forces quadratic in the rates."""
        return not all(map(vanishes, self.centrifugal))

    def accelerations(self, loads: Sequence[ExactExpression], bent: bool = False) -> Column:
        """M^-1 times loads (n,); with `bent` those of the loads and of the rates, M^-1 (loads - C)."""
        return [each for (each,) in self.per_force([[each] for each in loads], bent)]

    def per_force(self, loads: ExactRows, bent: bool = False) -> ExactRows:
        """The accelerations of several loads at once, (n, k)."""
        known = {
            i: rates for i, each in enumerate(zip(*loads, strict=True)) if not bent and (rates := self._uniform(each))
        }
        if known:
            others = [[each for i, each in enumerate(row) if i not in known] for row in loads]
            rows = iter(zip(*self.per_force(others), strict=True)) if others[0] else iter(())
            return rows_of([known[i] if i in known else next(rows) for i in range(len(loads[0]))], self.size)
        if len(self.squares) == self.size and (found := self._one_by_one(loads, bent)) is not None:
            return found
        left = _less(loads, self.centrifugal if bent else None)
        columns = list(map(list, zip(*left, strict=True)))
        products = max(comb(len(self.squares), self.size), comb(len(self.squares), self.size - 1))
        if products > MOST_PRODUCTS:
            return rows_of(list(map(self._factors.solve, columns)), self.size)
        return rows_of(list(map(self._by_products, columns)), self.size)

    def _uniform(self, load: Sequence[ExactExpression]) -> Column | None:
        """The accelerations by a load that moves one coordinate alone, as weights do; None for another load."""
        for i, row in enumerate(self.matrix if self.size > 1 else ()):
            if not load[i].is_(0) and all(vanishes(row[i] * b - load[i] * a) for a, b in zip(row, load, strict=True)):
                return [simplified(load[i] / row[i]) if j == i else ZERO for j in range(self.size)]
        return None

    def _one_by_one(self, loads: ExactRows, bent: bool) -> ExactRows | None:
        """The accelerations of n masses by those along their own paths, G^T D (G y'' + b) = loads with the gradients G
        as rows and the masses D; None where G is not easily solved."""
        rows = [each.gradient for each in self.squares]
        pulls = solved_by_parts(rows_of(rows, self.size), _less(loads, self.turning if bent else None))
        if pulls is None:
            return None
        own = [[pull / each.mass for pull in row] for row, each in zip(pulls, self.squares, strict=True)]
        return solved_by_parts(rows, _less(own, [each.bend for each in self.squares] if bent else None))

    @cached_property
    def _factors(self) -> Factors:
        return Factors(self.matrix)

    def _by_products(self, load: Sequence[ExactExpression]) -> Column:
        """The adjugate, the sum of m a a^T, times a load over the determinant; numbers are taken together first, so
        that what cancels is not rounded."""
        if all(slope.is_number for each in self.squares for slope in each.gradient):
            pulls = [(mass * inner_product(a, load), a) for mass, a in self._parts]
            return [total(pull * a[i] for pull, a in pulls) / self._determinant for i in range(self.size)]
        return [inner_product(row, load) / self._determinant for row in self._adjugate]

    @cached_property
    def _adjugate(self) -> ExactRows:
        count = range(self.size)
        return [[total(mass * (a[i] * a[j]) for mass, a in self._parts) for j in count] for i in count]

    @cached_property
    def _determinant(self) -> ExactExpression:
        chosen = combinations(range(len(self.squares)), self.size)
        return total(self._masses(each) * self._minor(tuple(range(self.size)), each) ** 2 for each in chosen)

    @cached_property
    def _parts(self) -> list[tuple[ExactExpression, Column]]:
        """The products m of n - 1 masses, each with the vector a (n,) of their minors."""
        n, found = self.size, list[tuple[ExactExpression, Column]]()
        for chosen in combinations(range(len(self.squares)), n - 1):
            minors = [self._minor(tuple(j for j in range(n) if j != i), chosen) for i in range(n)]
            a = [(-1) ** i * minor for i, minor in enumerate(minors)]
            if not all(each.is_(0) for each in a):
                found.append((self._masses(chosen), a))
        return found

    def _masses(self, chosen: Sequence[int]) -> ExactExpression:
        return prod((self.squares[k].mass for k in chosen), start=ONE)

    def _minor(self, rows: tuple[int, ...], chosen: tuple[int, ...]) -> ExactExpression:
        """The determinant of these rows of these gradients."""
        if not rows:
            return ONE
        if (rows, chosen) not in self._minors:
            found = ZERO
            for j, k in enumerate(chosen):
                entry = self.squares[k].gradient[rows[-1]]
                if not entry.is_(0):
                    sign = (-1) ** (len(rows) - 1 + j)
                    found = found + sign * entry * self._minor(rows[:-1], (*chosen[:j], *chosen[j + 1 :]))
            value = number_of(found)
            self._minors[rows, chosen] = found if value is None else exact_number(value)
        return self._minors[rows, chosen]


@dataclass(frozen=True, eq=False)
class ClosedGap:
    """The gap as a sum of coordinates, and the coordinates that remain while it is closed.

    weights : (n,), the largest being 1: the contact force is the force on its coordinate, which is eliminated; all 0
        without a gap
    sticks : the places of the coordinates that stick while it is closed
    y, v : the symbols (n + k,) of all places and rates
    anywhere : those of `sticks` that stick at any place, on which the motion depends; the others are at 0
    height : the gap as a formula that vanishes with that coordinate, None where it is the sum itself
    along : the place along the ground that each of `sticks` holds, an expression
    """

    weights: list[Fraction]
    sticks: tuple[int, ...]
    y: Column
    v: Column
    anywhere: tuple[int, ...] = ()
    height: ExactExpression | None = None
    along: tuple[ExactExpression, ...] = ()

    @property
    def eliminated(self) -> list[int]:
        """The place of the coordinate that is eliminated; none without a gap."""
        return [self.weights.index(Fraction(1))] if any(self.weights) else []

    @cached_property
    def left(self) -> list[int]:
        """The places of the remaining ones among the coordinates and displacements: what moves, and then what
        sticks anywhere."""
        n, moving = len(self.weights), [i for i in range(len(self.y)) if i not in (*self.eliminated, *self.sticks)]
        return [*(i for i in moving if i < n), *self.anywhere, *(i for i in moving if i >= n)]

    @property
    def own(self) -> int:
        """The number of coordinates that move while it is closed."""
        return len(self.weights) - len(self.eliminated) - len(self.sticks)

    @property
    def s(self) -> Column:
        """The symbols of the remaining coordinates and displacements."""
        return [self.y[i] for i in self.left]

    @property
    def w(self) -> Column:
        """The symbols of their rates."""
        return [self.v[i] for i in self.left]

    @cached_property
    def held(self) -> ExactRows:
        """The gradients (1 + sticks, n) of the gap and of what sticks."""
        size = len(self.weights)
        return [
            *(list(map(exact_number, self.weights)) for _ in self.eliminated),
            *([ONE if j == i else ZERO for j in range(size)] for i in self.sticks),
        ]

    @cached_property
    def numbers(self) -> np.ndarray:
        """The weights (n,) as doubles."""
        return np.array(self.weights, dtype=float)

    @cached_property
    def exact_embed(self) -> list[list[Fraction]]:
        """The matrix (n + k, own + k) from the remaining coordinates and displacements to all of them."""
        gap = [*self.weights, *(Fraction(0) for _ in self.y[len(self.weights) :])]
        rows = [[Fraction(i == j) for j in self.left] for i in range(len(self.y))]
        for i in self.eliminated:
            rows[i] = [-gap[j] for j in self.left]
        return rows

    @cached_property
    def embed(self) -> np.ndarray:
        """The matrix as doubles."""
        return np.array(self.exact_embed, dtype=float)

    @cached_property
    def _places(self) -> dict[ExactExpression, ExactExpression]:
        """The coordinates that do not remain, and their rates, by the remaining ones."""
        lost = [*self.eliminated, *self.sticks]
        pairs = (
            (symbols[i], own, self.exact_embed[i])
            for i in lost
            for symbols, own in ((self.y, self.s), (self.v, self.w))
        )
        found = {each: total(a * b for a, b in zip(row, own, strict=True) if a) for each, own, row in pairs}
        return found | {self.v[i]: ZERO for i in self.anywhere}

    def on_points(self, forces: ExactRows) -> ExactRows:
        """The forces (1 + sticks, k) across and along the ground on the point that closes the gap, from those on its
        coordinate and on what sticks."""
        if self.height is None:
            return forces
        (lost,), slopes = self.eliminated, [*self.along, self.height]
        by = lambda of, i: self.inside([derivative_by(of, self.y[i])])[0]  # noqa: E731
        first, *others = forces
        held = [[each / by(of, i) for each in row] for of, i, row in zip(slopes, self.sticks, others, strict=False)]
        for of, row in zip(self.along, held, strict=True):
            first = [a - by(of, lost) * b for a, b in zip(first, row, strict=True)]
        return [[simplified(each / by(self.height, lost)) for each in first], *held]

    def inside(self, expressions: Sequence[ExactExpression]) -> Column:
        """Expressions of the coordinates and rates as ones of the remaining ones."""
        return substitute(expressions, self._places)

    def weights_inside(self, weights: Sequence[Fraction]) -> list[Fraction]:
        """The weights of the remaining ones in a sum of all coordinates and displacements."""
        lost = sum(weights[i] for i in self.eliminated)
        gap = [*self.weights, *(Fraction(0) for _ in range(len(weights) - len(self.weights)))]
        return [weights[i] - lost * gap[i] for i in self.left]


class Closed:
    """A kinetic energy while a gap is closed.

    own : that of the coordinates that remain
    kick : M^-1 G^T (n, held) in flight
    masses : (G M^-1 G^T)^-1 (held, held) in flight
    """

    def __init__(self, kinetics: Kinetics, gap: ClosedGap):
        """Of n coordinates, or of these and of displacements without inertia."""
        self._held, self._inside = gap.held, gap.inside
        embed = [row[: gap.own] for row in gap.exact_embed[: kinetics.size]]
        self._embed = [list(map(exact_number, column)) for column in zip(*embed, strict=True)]
        # Without a gap nothing is held.
        self.kick = kinetics.per_force(rows_of(gap.held, kinetics.size)) if gap.held else [[]] * kinetics.size
        self.masses = _inverse(
            [[inner_product(row, kick) for kick in zip(*self.kick, strict=True)] for row in gap.held]
        )
        self._masses = [gap.inside(row) for row in self.masses]
        projected = [self.along(row) for row in map(gap.inside, kinetics.matrix)]
        reduced = [self.along(column) for column in zip(*projected, strict=True)]
        squares = [
            Square(gap.inside([each.mass])[0], self.along(gap.inside(each.gradient)), gap.inside([each.bend])[0])
            for each in kinetics.squares
        ]
        turning = kinetics.turning and self.along(gap.inside(kinetics.turning))
        centrifugal = self.along(gap.inside(kinetics.centrifugal))
        self.own = Kinetics(len(self._embed), squares, reduced, turning, centrifugal)

    def along(self, loads: Sequence[ExactExpression]) -> Column:
        """Loads (n,) as those on the coordinates that remain."""
        return [inner_product(column, loads) for column in self._embed]

    def accelerations(self, loads: ExactRows, bent: bool = False) -> ExactRows:
        """The accelerations of the remaining coordinates under loads (n, k) of the flight, as of `Kinetics`."""
        inside = [self._inside(row) for row in loads]
        columns = [self.along(column) for column in zip(*inside, strict=True)]
        return self.own.per_force(rows_of(columns, self.own.size), bent)

    def forces(self, accelerations: ExactRows) -> ExactRows:
        """The forces (held, k) that take away the accelerations (n, k) of the flight of what is held."""
        columns = list(zip(*(self._inside(row) for row in accelerations), strict=True))
        opening = [[inner_product(row, column) for row in self._held] for column in columns]
        return [[simplified(-inner_product(row, each)) for each in opening] for row in self._masses]


def _inverse(matrix: ExactRows) -> ExactRows:
    """The inverse of a symmetric positive definite matrix; entries that vanish are left out."""
    size, factors = len(matrix), Factors([list(map(nonzero, row)) for row in matrix])
    return [factors.solve([ONE if j == i else ZERO for j in range(size)]) for i in range(size)]


def _less(rows: ExactRows, column: Column | None) -> ExactRows:
    """A matrix, less a column."""
    return rows if column is None else [[a - b for a in row] for row, b in zip(rows, column, strict=True)]


def squares_of(matrix: ExactRows) -> list[Square]:
    """A symmetric matrix as a sum of masses times squares of gradients."""
    size, found, rest = len(matrix), list[Square](), [list(row) for row in matrix]
    while (i := next((i for i in range(size) if not vanishes(rest[i][i])), None)) is not None:
        column = [ONE if j == i else rest[j][i] / rest[i][i] for j in range(size)]
        found.append(Square(rest[i][i], column))
        rest = [
            [ZERO if i in (j, k) else rest[j][k] - rest[i][i] * column[j] * column[k] for k in range(size)]
            for j in range(size)
        ]
    for i, j in combinations(range(size), 2):
        if not vanishes(rest[i][j]):  # 2 a b = (a + b)^2 / 2 - (a - b)^2 / 2
            for sign in (1, -1):
                direction = [ONE if k == i else exact_number(sign) if k == j else ZERO for k in range(size)]
                found.append(Square(sign * rest[i][j] / 2, direction))
    return found
