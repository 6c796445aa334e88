"""Minima of a nonlinear program followed in a parameter, by its optimality conditions (see `kkt_conditions`).

Along a curve of minima the derivatives d(x, y)/dp are exact. The value function V(p) has the slope dV/dp = dL/dp. The
curve bends where a limit with a multiplier 0 leaves the active ones, or a limit that is reached enters them: these
events are located. It ends as one of minima where the Hessian of L on the null space of the active gradients becomes
singular: at a fold, where p turns round, or at a bifurcation; and where the active gradients are dependent and no limit
can leave. Sources: Guddat, Guerra Vazquez and Jongen, "Parametric Optimization: Singularities, Pathfollowing and Jumps"
(1990); Rheinboldt, "Numerical analysis of parametrized nonlinear equations" (1986), for the coordinate that is held in
each step.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import NoOrbit
from .hermite import at_level
from .kkt_conditions import ParametricProgram
from .kkt_limits import DEPENDENT, NEARLY_DEPENDENT, CriticalPoint, ExclusiveLimits, limits_changed, rooms_at
from .kkt_points import LostCurve, PointsOfCurve
from .kkt_start import TOLERATED, first_minimum
from .roots import Array, bracketed_root

NEARLY_FOLD = 0.2  # share of the parameter in a tangent below which the fastest unknown is held in its place
POINTS_OF_PREDICTOR = 3
MOST_EVENTS_AT_ONCE = 12
# The events at which a curve ceases to be one of minima, and what they are.
ENDS_OF_MINIMA = {
    "fold": "the minimum meets a saddle: there is none near it beyond",
    "bifurcation": "the minimum becomes a saddle: the second-order condition is lost at",
}


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


DEFAULT_OPTIONS_OF_CURVE = CurveOptions()


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
        x, multipliers = np.array(x, dtype=float), np.array(multipliers, dtype=float)
        self.newton = PointsOfCurve(program, x, multipliers, start, abs(stop - start) or 1.0, options.exact)
        self.first = first_minimum(self.newton, x, multipliers, start, stop - start, sides)

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
            except (LostCurve, NoOrbit):
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
                taken = self.newton.distance(point, new)
                length = min(taken * min(max(0.8 * grown, 0.3), 2.5), self.options.longest_step)
                passed, point, crowd = [*passed, new][-POINTS_OF_PREDICTOR:], new, 0
                count += 1
                yield point
                if point.value == targets[0]:
                    targets.pop(0)
                if not targets:
                    yield CurveEnd("reached", "")
                    return
                continue
            crowd = crowd + 1 if self.newton.distance(point, event.point) < 1e-9 else 0
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
        n, z = len(points[-1].x), _predicted(points, len(points[-1].z) - 1, value)
        return replace(points[-1], value=value, x=z[:n], multipliers=z[n:-1])

    def at(self, value: float, near: CriticalPoint) -> CriticalPoint:
        """The minimum at a value of the parameter near a point of the curve, with the same active limits; its tangent
        is exact. Raises `NoOrbit` where there is none."""
        z = near.z
        if near.tangent[-1]:
            z = z + near.tangent / near.tangent[-1] * (value - near.value)
        try:
            return self.newton.at_parameter(z, near.sides, value, near.tangent, exact=True)
        except (LostCurve, NoOrbit):
            raise NoOrbit(f"no minimum is found at {value:.10g} from that at {near.value:.10g}") from None

    def _next(self, passed: list[CriticalPoint], length: float, targets: list[float]):
        """The next point, the distance from its prediction to it, and the coordinate that is held with its level."""
        last = passed[-1]
        self.newton.dual_size = max(self.newton.dual_size, float(np.abs(last.multipliers).max(initial=0.0)))
        weights = self.newton.weights(last.z)
        scaled = weights * last.tangent
        scaled /= np.abs(scaled).max()
        fastest = int(np.argmax(np.abs(scaled[: self.newton.n])))
        held = len(scaled) - 1 if abs(scaled[-1]) >= NEARLY_FOLD * abs(scaled[fastest]) else fastest
        here = last.z[held]
        level = here + length * scaled[held] / weights[held]
        if held == len(scaled) - 1 and (targets[0] - here) * (targets[0] - level) <= 0:
            level = targets[0]
        elif held < len(scaled) - 1:
            reached = self._crossing(last, held, level, targets[0])
            if reached is not None:
                return reached
        predicted = _predicted(passed, held, level)
        new, error = self.newton.corrected(predicted, last.sides, held, level, last.tangent)
        if error > max(50 * self.options.aim, 0.5 * length):
            raise LostCurve
        return new, error, held

    def _crossing(self, last: CriticalPoint, held: int, level: float, target: float):
        """The point at a value of the parameter that is passed on the way to a level of another coordinate."""
        ahead = _predicted([last], held, level)[-1]
        if (target - last.value) * (target - ahead) > 0 or target == last.value:
            return None
        z = last.z + last.tangent / last.tangent[-1] * (target - last.value)
        new, error = self.newton.corrected(z, last.sides, len(z) - 1, target, last.tangent)
        return new, error, len(z) - 1

    def _rooms(self, point: CriticalPoint) -> Array:
        return rooms_at(point, self.newton.limits, self.newton.dual_size)

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
            z = _predicted([a, b], held, level)
            found[level], _ = self.newton.corrected(z, a.sides, held, level, a.tangent, exact=True)
            return float(test(found[level]))

        level = bracketed_root(value, *ends, test(a), test(b), width=1e-13 * abs(ends[1] - ends[0]))
        if level not in found:
            value(level)
        return found[level]

    def _beyond(self, event: CurveEvent) -> tuple[CriticalPoint | None, CurveEnd | None]:
        """The point of an event with the active limits and the tangent beyond it, None where the minima end there."""
        point = event.point
        (i,) = event.limits
        along = np.zeros(len(point.tangent))
        along[-1] = np.sign(point.tangent[-1])
        for dependent in (DEPENDENT, NEARLY_DEPENDENT):
            try:
                sides, multipliers = limits_changed(self.program, point, i, dependent)
                z = np.concatenate([point.x, multipliers, [point.value]])
                after = self.newton.at_parameter(z, sides, point.value, along, exact=True)
                break
            except ExclusiveLimits:
                text = f"the limits exclude each other beyond {point.value:.10g}: no point satisfies all of them"
                return None, CurveEnd("infeasible", text)
            except (LostCurve, NoOrbit):
                continue
        else:
            return None, CurveEnd("degenerate", f"no minimum is found beyond the limit at {point.value:.10g}")
        if after.negative > point.negative and not self.options.beyond:
            text = f"the minimum ends at {point.value:.10g}, where a limit {event.kind} and leaves a saddle"
            return None, CurveEnd("fold", text)
        return after, None


def _predicted(points: Sequence[CriticalPoint], held: int, level: float) -> Array:
    """x, multipliers and parameter at a level of the coordinate that is held, by Hermite interpolation of points, or
    extrapolation from those among which the coordinate goes the same way as at the last."""
    usable = [each for each in points if each.tangent[held] * points[-1].tangent[held] > 0]
    return at_level([each.z for each in usable], [each.tangent for each in usable], held, level)
