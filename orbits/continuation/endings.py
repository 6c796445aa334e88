"""How a curve of orbits ends: at a bound, where it closes, on its way to infinity or to nothing, or lost."""

from collections.abc import Sequence

import numpy as np

from .arguments import Options
from .curve import Curve, CurvePoint
from .events import Segment
from .family import End, Point
from .limits import limit

History = Sequence[tuple[float, float]]


class Endings:
    """The tests for the end of a run along a curve.

    origin, start : the first orbit of all, and the parameter's value there
    bounds : of the parameter, ascending
    """

    def __init__(self, curve: Curve, origin: Point, start: float, bounds: tuple[float, float], options: Options):
        self.curve, self.origin, self.start, self.bounds = curve, origin, start, bounds
        self.stop_inadmissible, self.control = options.stop_inadmissible, options.step_control

    def cut(self, segment: Segment) -> tuple[Segment, End | None]:
        """The segment up to where the curve ends on it, and that end; all of it and None where the curve goes on."""
        curve, a, b = self.curve, segment.a, segment.b
        if again := self._closing(segment):
            return Segment(curve, a, again), End("closed", "the curve comes back to its first orbit")
        if self._within(b) and segment.fold is not None:  # the fold in between may lie beyond a bound
            fold = segment(segment.fold)
            b = b if self._within(fold) else fold
        if not self._within(b):
            bound = self.bounds[0] if b.value <= self.bounds[0] else self.bounds[1]
            back = " again, on another sheet" if bound == self.start else ""
            sheets = segment.sheets()[-1 if a.value == bound else 0 :]  # a sheet that starts at the bound leaves it
            sheet = next((part for part in sheets if part.reaches(bound)), sheets[-1])
            return Segment(curve, a, sheet.point_at(bound)), End("reached", f"{curve.along} = {bound:g}{back}")
        if self.stop_inadmissible and not b.point.admissible:
            return segment, End("stopped", "no motion from here: " + b.point.violations[0])
        return segment, None

    def _within(self, point: CurvePoint) -> bool:
        return self.bounds[0] < point.value < self.bounds[1]

    def _closing(self, segment: Segment) -> CurvePoint | None:
        """The first point of all, if the curve passes it again on a segment."""
        a, b, curve = segment.a, segment.b, self.curve
        # The length of the step is about that of the chord.
        if a.point is self.origin or abs(self.start - a.value) > 3 * b.length * curve.span:
            return None
        size, origin = curve.size(a.x), np.array([*self.origin.u, self.start])
        chord, away = (b.x - a.x) / size, (origin - a.x) / size
        share = float(away @ chord / (chord @ chord))
        near = np.linalg.norm(away) <= 2 * np.linalg.norm(chord)
        if not near or not 0 < share <= 1 + self.control.same_point:
            return None
        point = segment(share)
        same = np.max(np.abs(point.x - origin) / size) < self.control.same_point
        if not same or point.tangent @ np.array(self.origin.tangent) <= 0:
            return None
        return curve.certify_at(point, self.start)

    def far(self, last: CurvePoint, history: History) -> End | None:
        """The end of a curve that goes to infinity or to nothing before the parameter gets to a bound; `history` are
        alpha and value of the points up to the last."""
        orbit, first, ratio = last.point, self.origin, self.control.escape_ratio
        name, value = self.curve.along, last.value
        if last.amplification > self.control.largest_amplification:
            reason = f"small changes grow {last.amplification:.0e}-fold over the flight, and rounding decides"
            return self.lost(reason, last, history)
        if orbit.alpha > ratio * first.alpha or orbit.flight_time > ratio * first.flight_time:
            if (found := limit(history, self.bounds, -1)) is None:
                return None
            if orbit.flight_time / orbit.alpha > ratio * first.flight_time / first.alpha:
                return End("degenerate", f"gravity no longer returns the machine near {name} = {value:.6g}", *found)
            if abs(orbit.liftoff_extension) > ratio * (1 + abs(first.liftoff_extension)):
                return End("degenerate", f"the spring no longer lifts the foot near {name} = {value:.6g}", *found)
            return End("escaped", "the launch speed grows without bound", *found)
        if orbit.alpha < first.alpha / ratio and (found := limit(history, self.bounds, 1)) is not None:
            return End("degenerate", f"the flight shrinks to nothing near {name} = {value:.6g}", *found)
        return None

    def lost(self, reason: str, last: CurvePoint, history: History) -> End:
        """The end of a curve that cannot be followed beyond its last point."""
        alpha, value = last.point.alpha, last.value
        where = f"{reason}, at {self.curve.along} = {value:.10g}, alpha = {alpha:.10g}"
        grown = alpha > self.control.running_ratio * self.origin.alpha
        if grown and (found := limit(history, self.bounds, -1)) is not None:
            return End("escaped", f"the launch speed grows, and the curve is lost: {where}", *found)
        if abs(value - self.start) < self.control.least_progress * self.curve.span:
            where += "; a parameter over decades is followed by its inverse or its logarithm"
        return End("stuck", where)
