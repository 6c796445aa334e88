"""How a curve of orbits ends: at a bound, closed, lost, or as its orbits tend to infinity or shrink to nothing."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ..errors import BreaksDown, InputError, NoStep, OrbitsError, RunsAway
from ..numerics.roots import bracketed_root
from ..shooting.division import DIVIDED_GROWTH, LARGEST_ARC_GROWTH
from ..units import LIFTOFF_SPEED, TIME, Message, Quantity, in_units
from .curve import Curve, CurvePoint, CurvePoints
from .events import Segment
from .homoclinic import Homoclinic, Passed, homoclinic
from .point import End, Point
from .step_control import Options
from .tuned_curve import TunedCurve

# A limit is extrapolated from the last points, over the first of these factors of alpha that holds enough of them.
WIDTHS = (2.0, 4.0, 16.0)
# A limit is clear where its error is less than a share of the parameter's distance to it, or where the parameter has
# come close to it, as a share of the range of its values.
CLEAR, ARRIVED = 0.1, 1e-6
# Powers of the scale in the series of a parameter: some curves have a first power of 1/alpha and some have none.
POWERS = ([0, 1, 2, 3, 4, 5], [0, 2, 3, 4, 5, 6])
# Bounds of the power by which a parameter tends to its limit, where its values show it: a spring r - d r**n, whose
# barrier lies at d**(-1/(n - 1)), has the power n - 1.
SLOWEST_POWER, FASTEST_POWER = 0.5, 16.0
# A parameter has settled where it will change by less than this share of its range.
SETTLED_SHARE = 1e-4
# The error is taken as this many times the change by the last term, since the terms left out may be larger.
CAUTION = 3
# A flight shrinks to nothing with the launch speed if it lasts less than this share of its first time when the speed is
# less than the reciprocal of `StepControl.escape_ratio` of its first value.
SHRUNK = 0.3
# The component of the tangent along the parameter, relative to its range, where it has settled but for rounding.
SETTLED_RATE = 1e-13

History = Sequence[tuple[float, float]]


def limit(history: History, bounds: tuple[float, float], power: int) -> tuple[float, float] | None:
    """The value that the parameter tends to as alpha grows (power -1) or vanishes (1), and its error; None where that
    is not clear or lies behind or beyond a bound. `history` are alpha and value of the points of a curve, in order.

    It is extrapolated by powers of alpha, with the first or without, by the series whose last term matters less. Where
    both fail, the values show a single power.
    """
    alpha, value = np.array(history).T
    # Where a launch has several speeds, this one may have changed its sign along the curve.
    since = np.append(0, np.flatnonzero(alpha[:-1] * alpha[-1] <= 0) + 1)[-1]
    alpha, value = alpha[since:], value[since:]
    scale = (alpha / alpha[-1]) ** power
    for widest in WIDTHS:
        found = [pair for powers in POWERS if (pair := _extrapolated(scale, value, powers, widest))]
        if len(found) < len(POWERS):
            continue
        behind = value[-1] - value[int(np.abs(np.log(scale / widest)).argmin())]
        for error, end in (min(found), *_by_own_power(scale, value, widest)):
            ahead = end - value[-1]
            towards = error < CLEAR * abs(ahead) and ahead * behind >= 0
            arrived = abs(ahead) + error < ARRIVED * np.ptp(value)  # rounding then decides on which side the limit lies
            if towards or arrived:
                return (end, error) if bounds[0] - error <= end <= bounds[1] + error else None
        return None
    # Few points are left where long steps lead to a limit by which the parameter hardly changes any more.
    near = (scale >= 1) & (scale <= WIDTHS[-1])
    error = CAUTION * float(np.ptp(value[near]))
    arrived = scale[near].max() >= WIDTHS[0] and error < ARRIVED * np.ptp(value)
    return (float(value[-1]), error) if arrived else None


def _extrapolated(scale, value, powers: list[int], widest: float) -> tuple[float, float] | None:
    """The error and the limit of `value` as `scale` vanishes; None where scales up to `widest` have too few points."""
    limits = []
    for count in (len(powers), len(powers) - 1):
        chosen = [int(np.abs(np.log(scale / ratio)).argmin()) for ratio in np.geomspace(1.0, widest, count)]
        if len(set(chosen)) < count:
            return None
        limits.append(float(np.linalg.solve(scale[chosen][:, None] ** np.array(powers[:count]), value[chosen])[0]))
    return CAUTION * abs(limits[0] - limits[1]), limits[0]


def _by_own_power(scale, value, widest: float) -> list[tuple[float, float]]:
    """The error and the limit of `value` by one power of the scale, over scales up to `widest` and up to its root; none
    where no such power fits."""
    limits = []
    for factor in (widest, widest**0.5):
        chosen = [int(np.abs(np.log(scale / ratio)).argmin()) for ratio in (factor**0.5, factor)]
        (middle, far), logs = value[chosen] - value[-1], np.log(scale[chosen])

        def excess(power: float, gaps=(-far, middle), logs=logs) -> float:
            return float(np.expm1(power * logs) @ gaps)

        ends = [excess(power) for power in (SLOWEST_POWER, FASTEST_POWER)]
        if ends[0] * ends[1] >= 0:
            return []
        power = bracketed_root(excess, SLOWEST_POWER, FASTEST_POWER, *ends)
        limits.append(float(value[-1] - middle / np.expm1(power * logs[0])))
    return [(CAUTION * abs(limits[0] - limits[1]), limits[0])]


class Endings:
    """The tests for the end of a run from the orbit `origin` at the parameter's value `start`; bounds ascend."""

    def __init__(self, curve: Curve, origin: Point, start: float, bounds: tuple[float, float], options: Options):
        self.curve, self.origin, self.start, self.bounds = curve, origin, start, bounds
        self.stop_inadmissible, self.control, self.at = options.stop_inadmissible, options.step_control, options.at

    def may_end(self, before: CurvePoint, points: Sequence[CurvePoint]) -> np.ndarray:
        """Whether the curve may end between each of certified points (m,) and the one before it, or at that point,
        (m,); a fold between them is an event."""
        points = CurvePoints.of(points)
        orbits, first, ratio = points.orbits, self.origin, self.control.escape_ratio
        values, alpha, time = points.values, orbits.column("alpha"), orbits.column("flight_time")
        ends = (values <= self.bounds[0]) | (values >= self.bounds[1])
        ends |= self._passed(np.concatenate([before.x[None], points.xs[:-1]]), points.xs) > 0
        speed = np.abs(alpha / first.alpha)
        ends |= (speed > ratio) | (time > ratio * first.flight_time) | (speed < 1 / ratio)
        if (place := self._place_of_liftoff) is not None:
            ends |= np.abs(np.array([u[place] for u in orbits.column("u")])) > ratio * (1 + self._reach(first))
        if isinstance(self.curve, TunedCurve):
            ends |= (self.curve.growth(points.xs) > ratio).any(1)
        growths = np.append(self.curve.largest_growths([before]), self.curve.largest_growths(points))
        ends |= (growths[:-1] <= LARGEST_ARC_GROWTH) & (growths[1:] > LARGEST_ARC_GROWTH)
        ends |= self.curve.asks_for_nodes(points) | (self.curve.growths(points) > self.control.largest_amplification)
        return ends | (self.stop_inadmissible & np.array([*map(bool, orbits.column("violations"))], bool))

    def cut(self, segment: Segment) -> tuple[Segment, End | None]:
        """The segment up to the end of the curve on it, and that end; the whole segment and None without an end."""
        curve, a, b = self.curve, segment.a, segment.b
        if first := self._closing(segment):
            return type(segment)(curve, a, first), End("closed", "the curve comes back to its first orbit")
        if self._within(b) and segment.fold is not None:  # the fold in between may lie beyond a bound
            fold = segment(segment.fold)
            b = b if self._within(fold) else fold
        if not self._within(b):
            bound = self.bounds[0] if b.value <= self.bounds[0] else self.bounds[1]
            back = " again, on another sheet" if bound == self.start else ""
            sheets = segment.sheets()[-1 if a.value == bound else 0 :]  # a sheet that starts at the bound leaves it
            sheet = next((part for part in sheets if (part.a.value - bound) * (part.b.value - bound) <= 0), sheets[-1])
            return type(segment)(curve, a, sheet.point_at(bound)), End("reached", f"{curve.along} = {bound:g}{back}")
        if self.stop_inadmissible and not b.point.admissible:
            return segment, End("stopped", f"no motion from here: {self.curve.in_units(b.point).violations[0]}")
        return segment, None

    def _within(self, point):
        return self.bounds[0] < point.value < self.bounds[1]

    def _closing(self, segment: Segment) -> CurvePoint | None:
        """The first point of the curve, if the curve passes it again on a segment."""
        a, curve = segment.a, self.curve
        if a.point is self.origin or not (share := float(self._passed(a.x, segment.b.x))):
            return None
        point = segment(share)
        x, tangent, sizes = map(curve.bare, (point.x, point.tangent, curve.size(a.x)))
        same = np.max(np.abs(x - self._first) / sizes) < self.control.same_point
        onward = tangent @ self.origin.tangent > 0
        return curve.certify_at(point, self.start) if same and onward else None

    @property
    def _first(self) -> np.ndarray:
        """The first point X of the curve, (n + 1,)."""
        return np.array([*self.origin.u, self.start])

    def _passed(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """The shares (...) at which chords from a to b (..., n + 1) pass the first point, 0 where they do not."""
        a, b, size = map(self.curve.bare, (a, b, self.curve.size(a)))
        chord, away = (b - a) / size, (self._first - a) / size
        along, square = (away * chord).sum(-1), (chord * chord).sum(-1)
        near = ((away * away).sum(-1) <= 4 * square) & (along > 0) & (along <= (1 + self.control.same_point) * square)
        return np.where(near, along / square, 0.0)

    def far(self, last: CurvePoint, history: History, way: Passed = ()) -> End | None:
        """The end of a curve that goes to infinity or to nothing before the parameter reaches a bound."""
        orbit, first, ratio = last.point, self.origin, self.control.escape_ratio
        place = f"near {self.curve.along} = {last.value:.6g}"
        if (most := float(self.curve.growths([last])[0])) > self.control.largest_amplification:
            if way and (orbit_at_rest := homoclinic(self.curve, last, way)):
                return self._homoclinic(orbit_at_rest, last)
            growth = f"{most:.0e}-fold"
            return self.lost(f"small changes grow {growth} over the flight, and rounding decides", last, history)
        if self.curve.largest_growths([last])[0] > LARGEST_ARC_GROWTH and (end := self._hanging(last, history, way)):
            return end
        if isinstance(self.curve, TunedCurve) and (away := self._tuned_away(self.curve, last)):
            return away
        speed, time = abs(orbit.alpha / first.alpha), orbit.flight_time / first.flight_time
        if speed > ratio or time > ratio:
            if not (found := limit(history, self.bounds, -1)):
                return None
            if time > ratio * speed:
                return End("degenerate", f"gravity no longer returns the machine {place}", *found)
            if abs(orbit.liftoff_extension) > ratio * (1 + abs(first.liftoff_extension)):
                return End("degenerate", f"the spring no longer lifts the foot {place}", *found)
            return End("escaped", "the launch speed grows without bound", *found)
        if self._reach(orbit) > ratio * (1 + self._reach(first)) and (found := self._limit_by_reach(history, way)):
            return End(
                "degenerate", f"the extension at lift-off grows without bound in the machine's units {place}", *found
            )
        # Where a launch has several speeds, this one may vanish without the flight's shrinking.
        shrunk = time < SHRUNK
        ends = speed < 1 / ratio and (shrunk or self.curve.machine.model.one_speed)
        if ends and (found := limit(history, self.bounds, 1)):
            what = "flight shrinks" if shrunk else "launch speed falls"
            return End("degenerate", f"the {what} to nothing {place}", *found)
        return None

    @cached_property
    def _place_of_liftoff(self) -> int | None:
        """The place of the extension at lift-off among the unknowns; None where it is none of them, and where a launch
        has several unknowns, of which one is the place of a mass and grows as the speed does."""
        names = self.curve.equations_of_orbits.statement.unknowns
        return names.index("liftoff") if "liftoff" in names and self.curve.machine.model.one_speed else None

    def _reach(self, point: Point) -> float:
        """The extension at lift-off, 0 where it is no unknown."""
        return 0.0 if self._place_of_liftoff is None else abs(point.u[self._place_of_liftoff])

    def _limit_by_reach(self, history: History, way: Passed) -> tuple[float, float] | None:
        """The `limit` of the parameter as the extension at lift-off grows."""
        if (place := self._place_of_liftoff) is None or not way:
            return None
        reaches = [(abs(u[place]), value) for (u, _), (_, value) in zip(way, history, strict=True)]
        return limit(reaches, self.bounds, -1)

    def _hanging(self, last: CurvePoint, history: History, way: Passed) -> End | None:
        """The end of a curve whose motions stay near an unstable equilibrium, where more points say no more about it;
        None where it is followed on."""
        end = self.lost("", last, history)
        if end.kind == "escaped" and end.limit is not None:
            farthest = end.limit + np.copysign(end.limit_error or 0.0, end.limit - last.value)
            low, high = sorted((last.value, farthest))
            return None if any(low < value < high for value in self.at) else end
        found = (
            homoclinic(self.curve, last, way)
            if way and abs(last.tangent[-1]) < SETTLED_RATE * self.curve.span
            else None
        )
        return self._homoclinic(found, last) if found and found.name == self.curve.along else None

    def _homoclinic(self, found: Homoclinic, last: CurvePoint) -> End:
        """The end of a curve in a homoclinic orbit."""
        units = self.curve.units_at(last.value, last.point.also)
        limit, error = (found.limit, found.error) if found.name == self.curve.along else (None, None)
        growth = found.measured * (units.of(TIME) if units else 1.0)
        return End("homoclinic", in_units(found.reason, units), limit, error, growth)

    def _tuned_away(self, curve: TunedCurve, last: CurvePoint) -> End | None:
        """The end of a curve along which a tuned parameter grows without bound, while that of the curve settles."""
        (growths,), equations = curve.growth(last.x[None]), curve.equations
        for i in (growths > self.control.escape_ratio).nonzero()[0].tolist():
            # It settles by this much where its distance to the limit falls as the inverse of the tuned parameter.
            x, by = last.x[equations.own + i], last.tangent[equations.own + i]
            left = float(last.tangent[-1] * x / by) if by else np.inf
            if abs(left) < SETTLED_SHARE * curve.span:
                name = equations.statement.tuned[i]
                return End("escaped", f"{name} grows without bound", last.value + left, abs(left))
        return None

    def _in_words(self, error: OrbitsError | str, last: CurvePoint) -> OrbitsError | Message | str:
        """The error of a step as what happens beyond the last point of a curve, with the remedy."""
        if not isinstance(error, NoStep | RunsAway | BreaksDown):
            return error
        growth = float(self.curve.largest_growths([last])[0])
        text = "no orbit is found beside it" if isinstance(error, NoStep) else "the motion beside it does not come back"
        text += " ({error}): "
        if growth > DIVIDED_GROWTH:
            text += "as near an unstable equilibrium, small changes grow {growth:.0e}-fold. Follow another parameter"
        else:
            text += "allow steps shorter than {step:.0e} by `shortest_step` of `StepControl`"
        return Message(text, error=error, growth=growth, step=self.control.shortest_step)

    def lost(self, error: OrbitsError | str, last: CurvePoint, history: History) -> End:
        """The end of a curve that cannot be followed beyond its last point. The reason is the error where the curve
        stays bounded; where it escapes, the limit is more informative."""
        alpha, value = last.point.alpha, last.value
        units, speed = self.curve.units_at(last.value, last.point.also), Quantity(alpha, LIFTOFF_SPEED)
        where = Message("{name} = {value:.10g}, alpha = {alpha:.10g}", name=self.curve.along, value=value, alpha=speed)
        where = in_units(where, units)
        if abs(alpha / self.origin.alpha) > self.control.running_ratio and (found := limit(history, self.bounds, -1)):
            return End("escaped", f"the launch speed grows without bound, and was followed to {where}", *found)
        reason = in_units(self._in_words(error, last), units)
        if isinstance(error, InputError):
            return End("degenerate", f"there is no such machine any more at {where}: {reason}")
        if abs(value - self.start) < self.control.least_progress * self.curve.span:
            reason += "; a parameter over decades is followed by its inverse or its logarithm"
        return End("stuck", f"at {where}: {reason}")
