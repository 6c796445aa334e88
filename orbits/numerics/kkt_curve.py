"""Minima of a nonlinear program followed in a parameter, by its optimality conditions of Karush, Kuhn and Tucker.

The program is to minimise f(x, p) under lower <= (x, g(x, p)) <= upper. With the Lagrangian L = f + y . (x, g) and a
set of active limits A, a minimum solves

    dL/dx = 0,  (x, g)_A = limits_A,  y = 0 elsewhere;   y <= 0 at a lower limit and y >= 0 at an upper one.

Along a curve of minima the derivatives d(x, y)/dp are exact. The value function V(p) has the slope dV/dp = dL/dp. The
curve bends where a limit with a multiplier 0 leaves A, or a limit that is reached enters it: these events are located.
It ends as one of minima where the Hessian of L on the null space of the active gradients becomes singular: at a fold,
where p turns round, or at a bifurcation; and where the active gradients are dependent and no limit can leave. Sources:
Guddat, Guerra Vazquez and Jongen, "Parametric Optimization: Singularities, Pathfollowing and Jumps" (1990); Rheinboldt,
"Numerical analysis of parametrized nonlinear equations" (1986), for the coordinate that is held in each step.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from ..errors import NoOrbit
from .roots import Array, bracketed_root

# Marks of the limits: not active, at the lower or upper limit, or an equality.
FREE, LOWER, UPPER, EQUAL = 0, -1, 1, 2
# Newton's step, relative to the size of the unknowns, after which the next is below rounding; that at which it may not
# become any smaller; and the contraction above which its matrix is renewed.
CONVERGED, STAGNATED, STALE = 1e-10, 1e-8, 0.1
INEXACT_TANGENT = 1e-5  # distance from a prediction to a point above which the tangent is not that of the matrix there
STEPS_TO_A_POINT = 12  # of Newton's iteration to a point
# A limit is reached, and a multiplier has passed 0, at this distance beyond it; within the second one both a limit and
# its multiplier may be 0 at the first point.
TOLERATED, WEAK = 1e-10, 1e-6
MOST_WEAK = 8  # limits at whose directions a first point is examined: the sets of active ones are tried in turn
# Weights of the active gradients, relative to the Hessian, beside which its signs are those on their null space: where
# one of them is too small, or too large beside rounding, there seem to be more negative ones.
WEIGHTS = (1e6, 1e4, 1e8)
# Multipliers below this share of the Hessian, and below this size, are rounding.
RELATIVE_DUAL, SMALLEST_DUAL = 1e-4, 1e-12
# The share of a gradient beside the others below which it depends on them, and where no minimum is found otherwise.
DEPENDENT, NEARLY_DEPENDENT = 1e-8, 1e-3
NEARLY_FOLD = 0.2  # share of the parameter in a tangent below which the fastest unknown is held in its place
POINTS_OF_PREDICTOR = 3
MOST_EVENTS_AT_ONCE = 12
# Active limits that change at the first point, and the distance by which a limit is passed there.
MOST_CHANGES_AT_START, TOLERATED_AT_START = 30, 1e-9
# The events at which a curve ceases to be one of minima, and what they are.
ENDS_OF_MINIMA = {
    "fold": "the minimum meets a saddle: there is none near it beyond",
    "bifurcation": "the minimum becomes a saddle, and others branch off, at",
}


class FirstDerivatives(NamedTuple):
    """A program at a point: its cost, the gradient (n,) of f + y . g, the constraints (m,), and d(f + y . g)/dp."""

    cost: float
    gradient: Array
    values: Array
    slope: float


class SecondDerivatives(NamedTuple):
    """The Jacobian (m, n) of the constraints, the Hessian (n, n) of f + y . g, dense or sparse with fixed patterns, and
    the derivatives by p of the gradient (n,) of f + y . g and of the constraints (m,); and the first derivatives there
    where they are at hand."""

    jacobian: Array | sp.csc_matrix
    hessian: Array | sp.csc_matrix
    gradient_slope: Array
    values_slope: Array
    first: FirstDerivatives | None = None


class ParametricProgram(Protocol):
    """A nonlinear program with n unknowns of order one, m constraints and a parameter.

    limits : (n + m,) lower and upper ones, of the unknowns and then of the constraints; these do not depend on p
    first, second : (x, p, multipliers (m,) of the constraints) -> derivatives; raise `NoOrbit` where there are none
    """

    @property
    def limits(self) -> tuple[Array, Array]: ...

    def first(self, x: Array, p: float, y: Array) -> FirstDerivatives: ...

    def second(self, x: Array, p: float, y: Array) -> SecondDerivatives: ...


@dataclass(frozen=True, kw_only=True)
class CurveOptions:
    """The constants of a run.

    first_step, shortest_step, longest_step : lengths along the curve, with p as a share of its range, unknowns relative
        to one plus their size, and multipliers to the largest one
    most : points of a run
    aim : distance from prediction to point that step control aims at
    exact : whether the tangent of each point is exact, for programs whose second derivatives come with the first
    beyond : whether the curve goes on beyond folds and bifurcations, where its points are no minima
    """

    first_step: float = 0.01
    shortest_step: float = 1e-7
    longest_step: float = 0.1
    most: int = 1000
    aim: float = 1e-4
    exact: bool = False
    beyond: bool = False


SYMMETRIC = {"SymmetricMode": True}
DEFAULT_OPTIONS_OF_CURVE = CurveOptions()


@dataclass(frozen=True, eq=False)
class CriticalPoint:
    """A point of a curve of minima.

    value : of the parameter
    x : (n,)
    multipliers : (n + m,), of the limits of the unknowns and then of the constraints
    sides : (n + m,), which limits are active: -1 lower, 1 upper, 2 an equality, 0 none
    values : (n + m,), x and the constraints
    cost, slope : of the value function V, and dV/dp
    negative : number of negative eigenvalues of the Hessian of L on the null space of the active gradients, 0 for a
        minimum
    tangent : (2n + m + 1,), direction of the curve in (x, multipliers, p)
    """

    value: float
    x: Array
    multipliers: Array
    sides: Array
    values: Array
    cost: float
    slope: float
    negative: int
    tangent: Array

    @property
    def z(self) -> Array:
        """x, the multipliers and the parameter."""
        return np.concatenate([self.x, self.multipliers, [self.value]])

    @property
    def rates(self) -> tuple[Array, Array]:
        """The derivatives of x and of the multipliers by the parameter."""
        rates = self.tangent[:-1] / self.tangent[-1]
        return rates[: len(self.x)], rates[len(self.x) :]

    @property
    def active(self) -> tuple[int, ...]:
        """The indices of the active limits that are no equalities, of unknowns and then of constraints."""
        return tuple(np.flatnonzero(np.abs(self.sides) == 1).tolist())


@dataclass(frozen=True, eq=False)
class CurveEvent:
    """What happens on a curve of minima at a point: a limit "enters", "leaves", or "exchanges" with another one, a
    "fold" or a "bifurcation".

    limits : the indices of the limits that change
    """

    kind: str
    point: CriticalPoint
    limits: tuple[int, ...] = ()


@dataclass(frozen=True)
class CurveEnd:
    """The end of a curve of minima: "reached", "fold", "bifurcation", "infeasible", "degenerate", "stuck" or "stopped",
    and the reason in words."""

    kind: str
    reason: str


class _LostCurve(Exception):
    """Newton's iteration does not converge."""


class MinimumCurve:
    """Minima of a program along p, from a point near a minimum at p = `start` towards `stop`.

    x, multipliers : (n,) and (n + m,) near those of the minimum
    sides : (n + m,) of the active limits, as in `CriticalPoint`; by default those that the multipliers tell. Limits
        that may be active with multipliers 0 become so where the curve needs them

    Raises `NoOrbit` where there is no minimum nearby that can be followed.
    """

    def __init__(
        self, program: ParametricProgram, x: Array, multipliers: Array, start: float, stop: float,
        options: CurveOptions = DEFAULT_OPTIONS_OF_CURVE, sides: Array | None = None,
    ):  # fmt: skip
        self.program, self.options, self.start, self.stop = program, options, start, stop
        self.lower, self.upper = program.limits
        self.n, self.span = len(x), abs(stop - start) or 1.0
        self._patterns: dict[tuple, tuple] = {}
        self._dual_size = max(float(np.abs(multipliers).max(initial=0.0)), self._negligible_dual(x, multipliers))
        self.first = self._first(np.array(x, dtype=float), np.array(multipliers, dtype=float), sides)

    def __iter__(self) -> Iterator[CriticalPoint | CurveEvent | CurveEnd]:
        """The points from the first to the last, each event after the point at which it happens, and the end."""
        return self.run()

    def run(self, at: Sequence[float] = ()) -> Iterator[CriticalPoint | CurveEvent | CurveEnd]:
        """The same, with points at these values of the parameter among them."""
        point, length, passed, count, crowd = self.first, self.options.first_step, [self.first], 1, 0
        targets = sorted({*map(float, at), self.stop}, reverse=self.stop < self.start)
        targets = [each for each in targets if (each - self.start) * (self.stop - self.start) > 0]
        yield point
        if not targets:
            yield CurveEnd("reached", "")
            return
        while count < self.options.most:
            try:
                new, error, held = self._next(passed, length, targets)
                event = self._event(point, new, held)
            except (_LostCurve, NoOrbit):
                length /= 4
                if length < self.options.shortest_step:
                    yield CurveEnd(
                        "stuck", f"no point is found, or what happens is not located, beyond {point.value:.10g}"
                    )
                    return
                continue
            if event and event.kind in ENDS_OF_MINIMA:
                yield event.point
                yield event
                if not self.options.beyond:
                    yield CurveEnd(event.kind, f"{ENDS_OF_MINIMA[event.kind]} {event.point.value:.10g}")
                    return
                event = None
            grown = (self.options.aim / max(error, 1e-16)) ** (1 / (2 * min(len(passed), POINTS_OF_PREDICTOR)))
            if event is None:
                length = min(self._distance(point, new) * min(max(0.8 * grown, 0.3), 2.5), self.options.longest_step)
                passed, point, crowd = [*passed, new][-POINTS_OF_PREDICTOR:], new, 0
                count += 1
                yield point
                if point.value == targets[0]:
                    targets.pop(0)
                if not targets:
                    yield CurveEnd("reached", "")
                    return
                continue
            crowd = crowd + 1 if self._distance(point, event.point) < 1e-9 else 0
            after, end = self._beyond(event)
            event = replace(event, point=after or event.point)
            yield event.point
            yield event
            if after is None or crowd > MOST_EVENTS_AT_ONCE:
                yield end or CurveEnd("degenerate", f"limits enter and leave for ever at {event.point.value:.10g}")
                return
            count += 1
            passed, point, length = [after], after, min(length, self.options.first_step)
        yield CurveEnd("stopped", f"after {count} points: no more than {self.options.most} were asked for")

    @staticmethod
    def between(points: Sequence[CriticalPoint], value: float) -> CriticalPoint:
        """The last of some points with unknowns and multipliers interpolated from all of them at a value of the
        parameter, near those of the minimum there."""
        n, z = len(points[-1].x), _hermite(points, len(points[-1].z) - 1, value)
        return replace(points[-1], value=value, x=z[:n], multipliers=z[n:-1])

    def at(self, value: float, near: CriticalPoint) -> CriticalPoint:
        """The minimum at a value of the parameter near a point of the curve, with the same active limits; its tangent
        is exact. Raises `NoOrbit` where there is none."""
        z = near.z
        if near.tangent[-1]:
            z = z + near.tangent / near.tangent[-1] * (value - near.value)
        try:
            return self._corrected(z, near.sides, len(z) - 1, value, near.tangent, exact=True)[0]
        except (_LostCurve, NoOrbit):
            raise NoOrbit(f"no minimum is found at {value:.10g} from that at {near.value:.10g}") from None

    # The first point

    def _first(self, x: Array, multipliers: Array, sides: Array | None) -> CriticalPoint:
        values = np.concatenate([x, self.program.first(x, self.start, multipliers[self.n :]).values])
        below, above = values - self.lower, self.upper - values
        if sides is None:
            sides = np.where(multipliers < 0, LOWER, UPPER).astype(np.int8)
            room = np.where(sides == LOWER, below, above)
            sides = np.where(np.abs(multipliers) / self._dual_size > room, sides, FREE).astype(np.int8)
        sides = np.where(self.lower == self.upper, EQUAL, sides).astype(np.int8)
        sides, multipliers = self._independent(x, multipliers, sides)
        self._dual_size = max(float(np.abs(multipliers).max(initial=0.0)), self._negligible_dual(x, multipliers))
        weak = (np.minimum(below, above) < WEAK) & (np.abs(multipliers) < WEAK * max(self._dual_size, 1.0))
        unsure = np.flatnonzero(weak & (sides != EQUAL))[:MOST_WEAK]
        nearest = np.where(below[unsure] < above[unsure], LOWER, UPPER)
        z, along = np.concatenate([x, multipliers, [self.start]]), np.zeros(len(x) + len(multipliers) + 1)
        along[-1] = np.sign(self.stop - self.start) or 1.0
        likely = [i for i in range(len(unsure)) if sides[unsure[i]]]
        choices = [likely, *(list(c) for r in range(len(unsure) + 1) for c in combinations(range(len(unsure)), r))]
        for chosen in choices:
            trial = sides.copy()
            trial[unsure] = FREE
            trial[unsure[chosen]] = nearest[chosen]
            try:
                point = self._with_right_signs(z, trial, along)
            except (_LostCurve, NoOrbit):
                continue
            if point.negative == 0 and not self._leads_out(point, unsure, nearest):
                return point
        reason = "no minimum that can be followed is at the start: second-order conditions or independence are lost"
        raise NoOrbit(reason)

    def _with_right_signs(self, z: Array, sides: Array, along: Array) -> CriticalPoint:
        """The first point with these active limits, of which those change that are passed or have multipliers of the
        wrong sign."""
        for _ in range(MOST_CHANGES_AT_START):
            point = self._corrected(z, sides, len(z) - 1, self.start, along, exact=True)[0]
            rooms = self._rooms(point)
            i = int(np.argmin(rooms))
            if rooms[i] >= -TOLERATED_AT_START:
                return point
            sides, _, end = self._changed(point, i, "leaves" if sides[i] else "enters", DEPENDENT)
            if end is not None:
                break
            z = point.z
        raise _LostCurve

    def _independent(self, x: Array, multipliers: Array, sides: Array) -> tuple[Array, Array]:
        """The active limits at the start without those whose gradients depend on others' before them, and the
        multipliers of the others, which a solver shares out among all of them as it likes."""
        second = self.program.second(x, self.start, multipliers[self.n :])
        independent = np.where(sides == EQUAL, sides, FREE).astype(np.int8)
        for i in np.flatnonzero(np.abs(sides) == 1).tolist():
            if _dependence(second, independent, i) is None:
                independent[i] = sides[i]
        if (independent == sides).all():
            return independent, multipliers
        gradient = self.program.first(x, self.start, 0 * multipliers[self.n :]).gradient
        own = np.zeros(len(multipliers))
        own[np.flatnonzero(independent)] = -_projected(second, independent, gradient)[1]
        return independent, own

    def _negligible_dual(self, x: Array, multipliers: Array) -> float:
        """The size of multipliers at the start below which they are rounding."""
        second = self.program.second(x, self.start, multipliers[self.n :])
        return max(_size_of_duals(second, self.span), SMALLEST_DUAL)

    def _leads_out(self, point: CriticalPoint, unsure: Array, nearest: Array) -> bool:
        """Whether a limit is passed, or a multiplier changes its sign, from a point at which both may be 0."""
        if len(unsure) == 0:
            return False
        values, rates = point.values, self._rates_of_values(point)
        multiplier = point.multipliers[unsure] * nearest, point.tangent[self.n : -1][unsure] * nearest
        room = np.minimum(values - self.lower, self.upper - values)[unsure], -nearest * rates[unsure]
        active = point.sides[unsure] != FREE
        size, rate = (np.where(active, one, other) for one, other in zip(multiplier, room, strict=True))
        scale = np.where(active, self._dual_size, 1.0)
        return bool(((size < -TOLERATED * scale) | ((size < WEAK * scale) & (rate < -TOLERATED * scale))).any())

    # Steps and points

    def _next(self, passed: list[CriticalPoint], length: float, targets: list[float]):
        """The next point, the distance from its prediction to it, and the coordinate that is held with its level."""
        last = passed[-1]
        weights = self._weights(last)
        scaled = weights * last.tangent
        scaled /= np.abs(scaled).max()
        fastest = int(np.argmax(np.abs(scaled[: self.n])))
        held = len(scaled) - 1 if abs(scaled[-1]) >= NEARLY_FOLD * abs(scaled[fastest]) else fastest
        here = last.z[held]
        level = here + length * scaled[held] / weights[held]
        if held == len(scaled) - 1 and (targets[0] - here) * (targets[0] - level) <= 0:
            level = targets[0]
        elif held < len(scaled) - 1:
            reached = self._crossing(last, held, level, targets[0])
            if reached is not None:
                return reached
        predicted = _hermite(passed, held, level)
        new, error = self._corrected(predicted, last.sides, held, level, last.tangent)
        if error > max(50 * self.options.aim, 0.5 * length):
            raise _LostCurve
        return new, error, held

    def _crossing(self, last: CriticalPoint, held: int, level: float, target: float):
        """The point at a value of the parameter that is passed on the way to a level of another coordinate."""
        ahead = _hermite([last], held, level)[-1]
        if (target - last.value) * (target - ahead) > 0 or target == last.value:
            return None
        z = last.z + last.tangent / last.tangent[-1] * (target - last.value)
        new, error = self._corrected(z, last.sides, len(z) - 1, target, last.tangent)
        return new, error, len(z) - 1

    def _corrected(
        self, z: Array, sides: Array, held: int, level: float, along: Array, exact: bool = False
    ) -> tuple[CriticalPoint, float]:
        """The point of the curve at a level of the coordinate that is held, and its distance from the prediction z."""
        n, start, before, linear = self.n, z, np.inf, None
        z = z.copy()
        z[held] = level
        active = np.flatnonzero(sides)
        z[n:-1][sides == FREE] = 0.0
        places = np.concatenate([np.arange(n), n + active, [len(z) - 1]])
        weights = self._weights_of(z)
        for _ in range(STEPS_TO_A_POINT):
            if linear is None:
                linear = self._linear(z, active, places, held)
                first = linear.second.first or self.program.first(z[:n], z[-1], z[2 * n : -1])
            else:
                first = self.program.first(z[:n], z[-1], z[2 * n : -1])
            values = np.concatenate([z[:n], first.values])
            missed = values[active] - np.where(sides[active] == UPPER, self.upper[active], self.lower[active])
            residual = np.concatenate([first.gradient + z[n : 2 * n], missed, [z[held] - level]])
            if not np.isfinite(residual).all():
                raise _LostCurve
            step = linear.solve(residual)
            size = float(np.abs(weights[places] * step).max())
            if not size < 1e3 * (1 + before):
                raise _LostCurve
            # Up to the square of the step, the value function is the Lagrangian and its slope that of the Lagrangian.
            cost, slope = first.cost + float(z[n + active] @ missed), first.slope - float(linear.slopes @ step[:-1])
            z[places] -= step
            if size <= CONVERGED or STAGNATED >= size > 0.5 * before:
                break
            if size > STALE * before:
                linear = None
            before = size
        else:
            raise _LostCurve
        z[held] = level
        error = float(np.abs(weights * (z - start)).max())
        if exact or self.options.exact or linear is None or error > INEXACT_TANGENT:
            linear = self._linear(z, active, places, held)
        tangent = np.zeros(len(z))
        tangent[places] = linear.solve(np.append(np.zeros(len(places) - 1), 1.0))
        tangent /= np.abs(weights * tangent).max()
        if tangent @ (weights**2 * along) < 0:
            tangent = -tangent
        if not np.isfinite(tangent).all():
            raise _LostCurve
        if exact and tangent[-1]:
            rate = np.abs(tangent[n:-1] / tangent[-1]).max(initial=0.0)
            self._dual_size = max(self._dual_size, _size_of_duals(linear.second, self.span), self.span * rate)
        own = z[:n], z[n:-1], sides, values, cost, slope, linear.negative, tangent
        return CriticalPoint(float(z[-1]), *own), error

    def _linear(self, z: Array, active: Array, places: Array, held: int) -> "_LinearisedConditions":
        """The linearised conditions at a point, with one coordinate held."""
        n = self.n
        second = self.program.second(z[:n], z[-1], z[2 * n : -1])
        hessian, jacobian = _sparse(second.hessian), _sparse(second.jacobian)
        key = (hessian.nnz, jacobian.nnz, active.tobytes())
        if key not in self._patterns:
            self._patterns[key] = _pattern(hessian, jacobian, active)
        gather, matrix, squares = self._patterns[key]
        data, size = np.concatenate([hessian.data, jacobian.data, [1.0]]), n + len(active)
        matrix.data = data[gather]
        slopes = np.concatenate([second.gradient_slope, np.concatenate([np.zeros(n), second.values_slope])[active]])
        negative = squares.negative_eigenvalues(data)
        try:
            if held == len(z) - 1:
                factors = splu(matrix)
                column = factors.solve(slopes)

                def solve(right: Array) -> Array:
                    return np.append(factors.solve(right[:-1]) - column * right[-1], right[-1])

            else:
                row = sp.csr_matrix(([1.0], ([0], np.flatnonzero(places == held))), (1, size))
                solve = splu(sp.bmat([[matrix, slopes[:, None]], [row, None]], format="csc")).solve
        except RuntimeError:  # exactly singular
            raise _LostCurve from None
        return _LinearisedConditions(solve, negative, slopes, second)

    # Sizes

    def _weights_of(self, z: Array) -> Array:
        """What unknowns, multipliers and the parameter are multiplied with to be of order one."""
        n, weights = self.n, np.full(len(z), 1 / self._dual_size)
        weights[:n], weights[-1] = 1 / (1 + np.abs(z[:n])), 1 / self.span
        return weights

    def _weights(self, point: CriticalPoint) -> Array:
        self._dual_size = max(self._dual_size, float(np.abs(point.multipliers).max(initial=0.0)))
        return self._weights_of(point.z)

    def _distance(self, a: CriticalPoint, b: CriticalPoint) -> float:
        return float(np.abs(self._weights_of(a.z) * (b.z - a.z)).max())

    # Events

    def _rates_of_values(self, point: CriticalPoint) -> Array:
        second = self.program.second(point.x, point.value, point.multipliers[self.n :])
        along = point.tangent[: self.n]
        return np.concatenate([along, second.jacobian @ along + second.values_slope * point.tangent[-1]])

    def _rooms(self, point: CriticalPoint) -> Array:
        """Of each limit how far it is from changing, negative once it should have: the distance of a value to it, or
        the size of its multiplier."""
        values, size = point.values, point.sides * point.multipliers / self._dual_size
        distance = np.minimum(values - self.lower, self.upper - values)
        return np.where(point.sides == EQUAL, np.inf, np.where(point.sides == FREE, distance, size))

    def _event(self, a: CriticalPoint, b: CriticalPoint, held: int) -> CurveEvent | None:
        """The first event between two points, if there is one."""
        rooms = self._rooms(b)
        changes = np.flatnonzero(rooms < -TOLERATED)
        if len(changes):
            return self._change(a, b, held, self._rooms(a), rooms)
        if a.tangent[-1] * b.tangent[-1] < 0:
            test = lambda point: point.tangent[-1] * np.sign(a.tangent[-1])  # noqa: E731
            return CurveEvent("fold", self._located(a, b, held, test))
        if a.negative != b.negative:
            level = (a.negative + b.negative) / 2
            test = lambda point: np.sign(level - point.negative) * np.sign(level - a.negative)  # noqa: E731
            return CurveEvent("bifurcation", self._located(a, b, held, test))
        return None

    def _change(self, a: CriticalPoint, b: CriticalPoint, held: int, before: Array, after: Array) -> CurveEvent:
        """The first change of an active limit between two points, at which these have room `before` and `after`."""
        while True:
            changes = np.flatnonzero(after < -TOLERATED)
            share = np.maximum(before[changes], 0.0) / (np.maximum(before[changes], 0.0) - after[changes])
            i = int(changes[np.argmin(share)])
            point = a if before[i] <= TOLERATED else self._located(a, b, held, lambda at: float(self._rooms(at)[i]))  # noqa: B023
            rooms = self._rooms(point)
            others = (rooms < -TOLERATED) & (np.arange(len(rooms)) != i)
            if not others.any():
                return CurveEvent("leaves" if point.sides[i] else "enters", point, (i,))
            b, after = point, np.where(others, rooms, np.inf)

    def _located(
        self, a: CriticalPoint, b: CriticalPoint, held: int, test: Callable[[CriticalPoint], float]
    ) -> CriticalPoint:
        """The point between two points at which a test function changes its sign."""
        found: dict[float, CriticalPoint] = {}
        ends = float(a.z[held]), float(b.z[held])

        def value(level: float) -> float:
            z = _hermite([a, b], held, level)
            found[level], _ = self._corrected(z, a.sides, held, level, a.tangent, exact=True)
            return float(test(found[level]))

        level = bracketed_root(value, *ends, test(a), test(b), width=1e-13 * abs(ends[1] - ends[0]))
        if level not in found:
            value(level)
        return found[level]

    def _beyond(self, event: CurveEvent) -> tuple[CriticalPoint | None, CurveEnd | None]:
        """The point of an event with the active limits and the tangent beyond it, None where the minima end there."""
        point = event.point
        (i,) = event.limits
        for dependent in (DEPENDENT, NEARLY_DEPENDENT):
            sides, multipliers, end = self._changed(point, i, event.kind, dependent)
            if end is not None:
                return None, end
            z, along = np.concatenate([point.x, multipliers, [point.value]]), np.zeros(len(point.tangent))
            along[-1] = np.sign(point.tangent[-1])
            try:
                after, _ = self._corrected(z, sides, len(z) - 1, point.value, along, exact=True)
                break
            except (_LostCurve, NoOrbit):
                continue
        else:
            return None, CurveEnd("degenerate", f"no minimum is found beyond the limit at {point.value:.10g}")
        if after.negative > point.negative and not self.options.beyond:
            text = f"the minimum ends at {point.value:.10g}, where a limit {event.kind} and leaves a saddle"
            return None, CurveEnd("fold", text)
        return after, None

    def _changed(
        self, point: CriticalPoint, i: int, kind: str, dependent: float
    ) -> tuple[Array, Array, CurveEnd | None]:
        """The active limits and the multipliers after a limit has entered or left, or the end where all limits exclude
        each other."""
        sides, multipliers = point.sides.copy(), point.multipliers.copy()
        if kind == "leaves":
            sides[i], multipliers[i] = FREE, 0.0
            return sides, multipliers, None
        sides[i] = LOWER if point.values[i] - self.lower[i] < self.upper[i] - point.values[i] else UPPER
        second = self.program.second(point.x, point.value, point.multipliers[self.n :])
        shares = _dependence(second, point.sides, i, dependent)
        if shares is not None:  # the gradients are dependent: a limit leaves for the one that enters
            j, size = _leaving(multipliers, point.sides, shares, sides[i])
            if j is None:
                text = f"the limits exclude each other beyond {point.value:.10g}: no point satisfies all of them"
                return sides, multipliers, CurveEnd("infeasible", text)
            multipliers -= shares * size * sides[i]
            multipliers[i], multipliers[j], sides[j] = size * sides[i], 0.0, FREE
        return sides, multipliers, None


class _LinearisedConditions(NamedTuple):
    """Linearised conditions: residual -> Newton's step, with the level's last; the number of negative eigenvalues of
    the reduced Hessian; the derivatives of the conditions by the parameter; and those of the program."""

    solve: Callable[[Array], Array]
    negative: int
    slopes: Array
    second: SecondDerivatives


def _size_of_duals(second: SecondDerivatives, span: float) -> float:
    """The size of multipliers that matter, as far as second derivatives show it."""
    largest = np.abs(_sparse(second.hessian).data).max(initial=0.0)
    return max(span * float(np.abs(second.gradient_slope).max(initial=0.0)), RELATIVE_DUAL * float(largest))


def _projected(second: SecondDerivatives, sides: Array, gradient: Array) -> tuple[Array, Array]:
    """What is left (n,) of a gradient beside the active gradients, and the nearest combination of these."""
    jacobian, active = _sparse(second.jacobian), np.flatnonzero(sides)
    n = jacobian.shape[1]
    rows = sp.vstack([sp.identity(n), jacobian]).tocsr()[active]
    if not len(active):
        return gradient, np.zeros(0)
    matrix = sp.bmat([[sp.identity(n), rows.T], [rows, None]], format="csc")
    return tuple(np.split(splu(matrix).solve(np.append(gradient, np.zeros(len(active)))), [n]))  # type: ignore


def _dependence(second: SecondDerivatives, sides: Array, i: int, dependent: float = DEPENDENT) -> Array | None:
    """The combination (n + m,) of the active gradients that a limit's gradient is; None if it is independent."""
    n = len(second.gradient_slope)
    mine = np.eye(1, n, i)[0] if i < n else np.asarray(_sparse(second.jacobian)[[i - n]].todense()).ravel()
    left, combined = _projected(second, sides, mine)
    if np.linalg.norm(left) > dependent * np.linalg.norm(mine):
        return None
    shares = np.zeros(len(sides))
    shares[np.flatnonzero(sides)] = combined
    return shares


def _leaving(multipliers: Array, sides: Array, shares: Array, side: int) -> tuple[int | None, float]:
    """The active limit whose multiplier is the first to become 0 as that of an entering limit at this side, whose
    gradient is a combination of theirs, grows; and its size then."""
    falls = np.where(np.abs(sides) == 1, sides * shares * side, 0.0)
    sizes = np.where(falls > 1e-12, sides * multipliers / np.where(falls > 1e-12, falls, 1.0), np.inf)
    j = int(np.argmin(sizes))
    return (j, float(max(sizes[j], 0.0))) if np.isfinite(sizes[j]) else (None, 0.0)


def _sparse(matrix: Array | sp.csc_matrix) -> sp.csc_matrix:
    """A matrix in columns; the pattern of a dense one is all of it, whatever is 0."""
    if isinstance(matrix, np.ndarray):
        rows, columns = matrix.shape
        ends = np.arange(columns + 1) * rows
        return sp.csc_matrix((matrix.ravel(order="F"), np.tile(np.arange(rows), columns), ends), matrix.shape)
    return matrix


def _pattern(hessian: sp.csc_matrix, jacobian: sp.csc_matrix, active: Array) -> tuple[Array, sp.csc_matrix, "_Squares"]:
    """Where each entry of the matrix [[H, A'], [A, 0]] is in (entries of H, entries of the Jacobian, 1), and the matrix
    to be filled, for the rows A of the active limits; and the squares of these rows."""
    n, first = hessian.shape[0], hessian.nnz + 1
    places = [(hessian, np.arange(1, first)), (jacobian, first + np.arange(jacobian.nnz))]
    ordered = [
        sp.csc_matrix((numbers.astype(float), of.indices, of.indptr), of.shape, copy=True) for of, numbers in places
    ]
    unit = sp.diags(np.full(n, float(first + jacobian.nnz)))
    rows = sp.vstack([unit, ordered[1]]).tocsr()[active]
    matrix = sp.bmat([[ordered[0], rows.T], [rows, None]], format="csc") if len(active) else ordered[0]
    matrix.sort_indices()  # else the factorisation would, with the entries that are filled in later
    return matrix.data.astype(int) - 1, matrix, _Squares.of(ordered[0], rows)


class _Squares(NamedTuple):
    """The matrix H + w A'A for a large w and rows A of length one, whose negative eigenvalues are as many as H has on
    the null space of A: H and A to be filled, in the order of elimination, which depends on the pattern alone; where
    their entries are in (entries of H, entries of the Jacobian, 1); and the row of each entry of A."""

    hessian: sp.csc_matrix
    rows: sp.csr_matrix
    entries_of_hessian: Array
    entries_of_rows: Array
    row: Array

    @classmethod
    def of(cls, hessian: sp.csc_matrix, rows: sp.csr_matrix) -> "_Squares":
        """Those of matrices whose entries are one more than their places in the data."""
        n = hessian.shape[0]
        pattern = abs(hessian) + abs(rows).T @ abs(rows)
        pattern = (pattern + n * (1.0 + pattern.max()) * sp.identity(n)).tocsc()
        order = splu(pattern, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=SYMMETRIC).perm_c
        inverse = np.argsort(order)
        moved, across = hessian[inverse][:, inverse].tocsc(), rows[:, inverse].tocsr()
        moved.sort_indices()
        across.sort_indices()
        row = np.repeat(np.arange(rows.shape[0]), np.diff(across.indptr))
        return cls(moved, across, moved.data.astype(int) - 1, across.data.astype(int) - 1, row)

    def negative_eigenvalues(self, data: Array) -> int:
        """Their number, by the signs of pivots, where `data` are the entries of H, of the Jacobian, and 1."""
        own, entries = data[self.entries_of_hessian], data[self.entries_of_rows]
        sizes = np.bincount(self.row, entries**2)
        scale = np.sqrt((np.abs(own).max(initial=0.0) or 1.0) / np.where(sizes > 0, sizes, 1.0))
        self.hessian.data, self.rows.data = own, entries * scale[self.row]
        squares, fewest = self.rows.T @ self.rows, len(own)
        for weight in WEIGHTS:
            fewest = min(fewest, _negative_pivots((self.hessian + weight * squares).tocsc()))
            if fewest == 0:
                break
        return fewest


def _negative_pivots(matrix: sp.csc_matrix) -> int:
    """The number of negative eigenvalues of a symmetric matrix in its order of elimination."""
    try:
        factors = splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options=SYMMETRIC)
        if (factors.perm_r == factors.perm_c).all():
            return int((factors.U.diagonal() < 0).sum())
    except RuntimeError:  # a pivot is exactly 0
        pass
    return int((np.linalg.eigvalsh(matrix.toarray()) < 0).sum())


def _hermite(points: Sequence[CriticalPoint], held: int, level: float) -> Array:
    """x, multipliers and parameter at a level of the coordinate that is held, by Hermite interpolation of points, or
    extrapolation from those among which the coordinate goes the same way as at the last."""
    way = points[-1].tangent[held]
    usable = [each for each in points if each.tangent[held] * way > 0]
    nodes, table, rates = list[float](), list[Array](), list[Array]()
    for each in usable:
        z, rate = each.z, each.tangent / each.tangent[held]
        if any(z[held] == node for node in nodes):
            continue
        nodes += [z[held]] * 2
        table += [z, z]
        rates.append(rate)
    differences, coefficients = table, [table[0]]
    for order in range(1, len(nodes)):
        differences = [
            rates[i // 2]
            if order == 1 and nodes[i] == nodes[i + 1]
            else (differences[i + 1] - differences[i]) / (nodes[i + order] - nodes[i])
            for i in range(len(nodes) - order)
        ]
        coefficients.append(differences[0])
    value = coefficients[-1]
    for node, coefficient in zip(nodes[-2::-1], coefficients[-2::-1], strict=True):
        value = value * (level - node) + coefficient
    return value
