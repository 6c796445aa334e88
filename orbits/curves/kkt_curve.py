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
from dataclasses import replace

import numpy as np

from ..errors import NoOrbit
from ..numerics import Array, at_level, bracketed_root
from .kkt_conditions import ParametricProgram
from .kkt_limits import CriticalPoint, ExclusiveLimits, limits_changed, rooms_at
from .kkt_options import POINTS_OF_MINIMA, STEPS_OF_MINIMA, KktOptions
from .kkt_points import LostCurve, PointsOfCurve
from .kkt_start import first_minimum
from .protocol import End, Event
from .step_options import Steps

# The events at which a curve ceases to be one of minima, and what they are.
ENDS_OF_MINIMA = {
    "fold": "the minimum meets a saddle: beyond it there is no minimum nearby",
    "bifurcation": "the minimum becomes a saddle: the second-order condition is lost at",
}


class MinimumCurve:
    """Minima of a program along p, from a point near a minimum at p = `start` towards `stop`.

    x, multipliers : (n,) and (n + m,) near those of the minimum
    steps : lengths and their ratios, aim, corrected, memory, corrections, most, width and same; other fields have no
        effect

    At first those limits are active that the multipliers show. Limits that may be active with multipliers 0 become so
    where the curve needs them.

    What happens is an `Event`: a limit, number `which`, "enters" or "leaves" the active ones, or there is a "fold" or a
    "bifurcation", where the curve ends as one of minima.

    Raises `NoOrbit` where there is no minimum nearby that can be followed.
    """

    def __init__(
        self, program: ParametricProgram, x: Array, multipliers: Array, start: float, stop: float,
        steps: Steps = STEPS_OF_MINIMA, options: KktOptions = POINTS_OF_MINIMA,
    ):  # fmt: skip
        self.program, self.steps, self.options, self.start, self.stop = program, steps, options, start, stop
        x, multipliers = np.array(x, dtype=float), np.array(multipliers, dtype=float)
        span = abs(stop - start) or 1.0
        self.newton = PointsOfCurve(program, x, multipliers, start, span, steps.corrections, options)
        self.first = first_minimum(self.newton, x, multipliers, start, stop - start)

    def run(self, at: Sequence[float] = ()) -> Iterator[CriticalPoint | Event | End]:
        """The points from the first to the last, with some at these values of the parameter, each event after the point
        at which it happens, and the end."""
        steps, passed, count, crowd = self.steps, [self.first], 1, 0
        length = steps.first
        targets = sorted({*map(float, at), self.stop}, reverse=self.stop < self.start)
        targets = [each for each in targets if (each - self.start) * (self.stop - self.start) > 0]
        yield self.first
        while targets and count < steps.most:
            last = passed[-1]
            try:
                new, error, held = self._next(passed, length, targets)
                event = self._event(last, new, held, count)
            except (LostCurve, NoOrbit):
                length *= steps.shorter
                if length < steps.shortest:
                    text = f"no point, or no place of the next event, is found beyond {last.value:.10g}"
                    yield End("stuck", text)
                    return
                continue
            if event is None:
                ratio = float(steps.ratios(error, len(passed)))
                length = min(self.newton.distance(last, new) * ratio, steps.longest)
                passed, crowd = [*passed, new][-steps.memory :], 0
                count += 1
                yield new
                if new.value == targets[0]:
                    targets.pop(0)
                continue
            after, end = self._beyond(event)
            crowd = crowd + 1 if self.newton.distance(last, event.point) < steps.same else 0
            event = Event(event.kind, point=after or event.point, after=event.after, which=event.which)
            yield event.point
            yield event
            if after is None or crowd > self.options.crowd:
                yield end or End("degenerate", f"limits enter and leave without end at {event.point.value:.10g}")
                return
            count += 1
            passed, length = [after], min(length, steps.first)
        stopped = End("stopped", f"after {count} points: raise `most` to go on")
        yield stopped if targets else End("reached")

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
            return self.newton.at_parameter(z, near.sides, value, near.tangent)
        except (LostCurve, NoOrbit):
            raise NoOrbit(f"no minimum is found at {value:.10g}, starting from the one at {near.value:.10g}") from None

    def _next(self, passed: list[CriticalPoint], length: float, targets: list[float]):
        """The next point, the distance from its prediction to it, and the coordinate that is held with its level."""
        last = passed[-1]
        self.newton.dual_size = max(self.newton.dual_size, float(np.abs(last.multipliers).max(initial=0.0)))
        weights = self.newton.weights(last.z)
        scaled = weights * last.tangent
        scaled /= np.abs(scaled).max()
        fastest = int(np.argmax(np.abs(scaled[: self.newton.n])))
        held = len(scaled) - 1 if abs(scaled[-1]) >= self.options.steep * abs(scaled[fastest]) else fastest
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
        if error > max(self.options.harmless * self.steps.aim, self.steps.corrected * length):
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

    def _event(self, a: CriticalPoint, b: CriticalPoint, held: int, after: int) -> Event | None:
        """The first event between two points, if there is one; `after` - 1 is the number of the first point."""
        rooms = self._rooms(b)
        if (rooms < -self.options.tolerated).any():
            return self._change(a, b, held, rooms, after)
        if a.tangent[-1] * b.tangent[-1] < 0:
            test = lambda point: point.tangent[-1] * np.sign(a.tangent[-1])  # noqa: E731
            return Event("fold", point=self._located(a, b, held, test), after=after)
        if a.negative != b.negative:
            level = (a.negative + b.negative) / 2
            test = lambda point: np.sign(level - point.negative) * np.sign(level - a.negative)  # noqa: E731
            return Event("bifurcation", point=self._located(a, b, held, test), after=after)
        return None

    def _change(self, a: CriticalPoint, b: CriticalPoint, held: int, behind: Array, after: int) -> Event:
        """The first change of an active limit between two points; the second one has these rooms (n + m,)."""
        before, tolerated = self._rooms(a), self.options.tolerated
        while True:
            changes = np.flatnonzero(behind < -tolerated)
            share = np.maximum(before[changes], 0.0) / (np.maximum(before[changes], 0.0) - behind[changes])
            i = int(changes[np.argmin(share)])
            point = a if before[i] <= tolerated else self._located(a, b, held, lambda at: float(self._rooms(at)[i]))  # noqa: B023
            rooms = self._rooms(point)
            others = (rooms < -tolerated) & (np.arange(len(rooms)) != i)
            if not others.any():
                return Event("leaves" if point.sides[i] else "enters", point=point, after=after, which=i)
            b, behind = point, np.where(others, rooms, np.inf)

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

        level = bracketed_root(value, *ends, test(a), test(b), width=self.steps.width * abs(ends[1] - ends[0]))
        if level not in found:
            value(level)
        return found[level]

    def _beyond(self, event: Event) -> tuple[CriticalPoint | None, End | None]:
        """The point of an event with the active limits and the tangent beyond it, None where the minima end there."""
        point, options = event.point, self.options
        if event.kind in ENDS_OF_MINIMA:
            return None, End(event.kind, f"{ENDS_OF_MINIMA[event.kind]} {point.value:.10g}")
        along = np.zeros(len(point.tangent))
        along[-1] = np.sign(point.tangent[-1])
        for dependent in (options.dependent, options.nearly_dependent):
            try:
                sides, multipliers = limits_changed(self.program, point, event.which, dependent)
                z = np.concatenate([point.x, multipliers, [point.value]])
                after = self.newton.at_parameter(z, sides, point.value, along)
                break
            except ExclusiveLimits:
                text = f"the limits exclude each other beyond {point.value:.10g}: no point satisfies all of them"
                return None, End("infeasible", text)
            except (LostCurve, NoOrbit):
                continue
        else:
            return None, End("degenerate", f"no minimum is found beyond the limit at {point.value:.10g}")
        if after.negative > point.negative:
            text = f"the minimum ends at {point.value:.10g}, where a limit {event.kind} and leaves a saddle"
            return None, End("fold", text)
        return after, None


def _predicted(points: Sequence[CriticalPoint], held: int, level: float) -> Array:
    """x, multipliers and parameter at a level of the coordinate that is held, by Hermite interpolation of points, or
    extrapolation from those among which the coordinate goes the same way as at the last."""
    usable = [each for each in points if each.tangent[held] * points[-1].tangent[held] > 0]
    return at_level([each.z for each in usable], [each.tangent for each in usable], held, level)
