"""How a curve of orbits ends: at a bound, closed, lost, or as its orbits tend to infinity or shrink to zero."""

from collections.abc import Sequence
from copy import copy
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from ..curves import End, Event, Points, Test
from ..errors import BreaksDown, InputError, NoStep, OrbitsError, RunsAway
from ..numerics import bracketed_root
from ..shooting import DIVISION
from ..units import LIFTOFF_SPEED, TIME, Message, Quantity, in_units
from .curve import Curve
from .homoclinic import Homoclinic, homoclinic
from .point import Point
from .step_control import Options
from .tuned_curve import TunedCurve

# Powers of the scale in the series of a parameter: some curves have a first power of 1/alpha and some have none.
POWERS = ([0, 1, 2, 3, 4, 5], [0, 2, 3, 4, 5, 6])
# A parameter has settled where it will change by less than this share of its range.
SETTLED_SHARE = 1e-4
# A flight shrinks to nothing with the launch speed if it lasts less than this share of its first time when the speed is
# less than the reciprocal of `StepControl.escape_ratio` of its first value.
SHRUNK = 0.3
# The component of the tangent along the parameter, relative to its range, where it has settled up to rounding.
SETTLED_RATE = 1e-13


class Extrapolation(NamedTuple):
    """The extrapolation of the value that a parameter tends to.

    widths : factors of alpha; the last points over the first of them that holds enough are used
    clear, arrived : a limit is clear where its error is less than this share of the parameter's distance to it, or
        where the parameter has come this close to it, as a share of the range of its values
    slowest, fastest : bounds of the power by which a parameter tends to its limit, where its values show it: a spring
        r - d r**n, whose barrier lies at d**(-1/(n - 1)), has the power n - 1
    caution : the error is this many times the change by the last term, since the terms left out may be larger
    """

    widths: tuple[float, ...] = (2.0, 4.0, 16.0)
    clear: float = 0.1
    arrived: float = 1e-6
    slowest: float = 0.5
    fastest: float = 16.0
    caution: float = 3.0


EXTRAPOLATION = Extrapolation()


def _passed(passed: Sequence[Points], *names: str) -> list[np.ndarray]:
    """Columns of the certified points passed, each point once: where the curve continues with nodes or behind a corner,
    it begins again at the same place or just beyond it, with a length of 0."""
    once = [points.lengths > 0 for points in passed]
    once[0][0] = True
    return [
        np.concatenate([each.own.column(name)[own] for each, own in zip(passed, once, strict=True)]) for name in names
    ]


def _history(passed: Sequence[Points]) -> np.ndarray:
    """alpha and value (m, 2) of the points passed."""
    return np.column_stack(_passed(passed, "alpha", "value"))


def _way(passed: Sequence[Points]) -> list[np.ndarray]:
    """The unknowns (m, n) and the tangents (m, n + 1) of the points passed, without nodes."""
    return _passed(passed, "u", "tangent")


def limit(
    history: np.ndarray, bounds: tuple[float, float], power: int, options: Extrapolation = EXTRAPOLATION
) -> tuple[float, float] | None:
    """The value that the parameter tends to as alpha grows (power -1) or vanishes (1), and its error; None where that
    is not clear or lies behind or beyond a bound. The history has alpha and value (m, 2) of the points of a curve, in
    order.

    It is extrapolated by powers of alpha, with the first or without, by the series whose last term matters less. Where
    both fail, the values show a single power.
    """
    alpha, value = np.asarray(history).T
    # Where a launch has several speeds, this one may have changed its sign along the curve.
    since = np.append(0, np.flatnonzero(alpha[:-1] * alpha[-1] <= 0) + 1)[-1]
    alpha, value = alpha[since:], value[since:]
    scale = (alpha / alpha[-1]) ** power
    for widest in options.widths:
        found = [pair for powers in POWERS if (pair := _extrapolated(scale, value, powers, widest, options))]
        if len(found) < len(POWERS):
            continue
        behind = value[-1] - value[int(np.abs(np.log(scale / widest)).argmin())]
        for error, end in (min(found), *_by_own_power(scale, value, widest, options)):
            ahead = end - value[-1]
            towards = error < options.clear * abs(ahead) and ahead * behind >= 0
            # Where the parameter has arrived, rounding decides on which side the limit lies.
            arrived = abs(ahead) + error < options.arrived * np.ptp(value)
            if towards or arrived:
                return (end, error) if bounds[0] - error <= end <= bounds[1] + error else None
        return None
    # Few points are left where long steps lead to a limit by which the parameter hardly changes any more.
    near = (scale >= 1) & (scale <= options.widths[-1])
    error = options.caution * float(np.ptp(value[near]))
    arrived = scale[near].max() >= options.widths[0] and error < options.arrived * np.ptp(value)
    return (float(value[-1]), error) if arrived else None


def _extrapolated(scale, value, powers: list[int], widest: float, options: Extrapolation) -> tuple[float, float] | None:
    """The error and the limit of `value` as `scale` vanishes; None where scales up to `widest` have too few points."""
    limits = []
    for count in (len(powers), len(powers) - 1):
        chosen = [int(np.abs(np.log(scale / ratio)).argmin()) for ratio in np.geomspace(1.0, widest, count)]
        if len(set(chosen)) < count:
            return None
        limits.append(float(np.linalg.solve(scale[chosen][:, None] ** np.array(powers[:count]), value[chosen])[0]))
    return options.caution * abs(limits[0] - limits[1]), limits[0]


def _by_own_power(scale, value, widest: float, options: Extrapolation) -> list[tuple[float, float]]:
    """The error and the limit of `value` by one power of the scale, over scales up to `widest` and up to its root; none
    where no such power fits."""
    limits = []
    for factor in (widest, widest**0.5):
        chosen = [int(np.abs(np.log(scale / ratio)).argmin()) for ratio in (factor**0.5, factor)]
        (middle, far), logs = value[chosen] - value[-1], np.log(scale[chosen])

        def excess(power: float, gaps=(-far, middle), logs=logs) -> float:
            return float(np.expm1(power * logs) @ gaps)

        ends = [excess(power) for power in (options.slowest, options.fastest)]
        if ends[0] * ends[1] >= 0:
            return []
        power = bracketed_root(excess, options.slowest, options.fastest, *ends)
        limits.append(float(value[-1] - middle / np.expm1(power * logs[0])))
    return [(options.caution * abs(limits[0] - limits[1]), limits[0])]


class Endings:
    """The tests for the end of a run from the orbit `origin`, None until it is certified, at the parameter's value
    `start`; bounds ascend."""

    kinds: Sequence[str] = ()  # of the tests that end the curve between two points

    def __init__(self, curve: Curve, origin: Point | None, start: float, bounds: tuple[float, float], options: Options):
        self.curve, self.origin, self.start, self.bounds = curve, origin, start, bounds
        self.stop_inadmissible, self.control = options.stop_inadmissible, options.step_control
        self.requested = options.at

    @property
    def first(self) -> Point:
        """The first orbit, once it is certified."""
        assert self.origin is not None
        return self.origin

    def with_curve(self, curve: Curve) -> Self:
        """The limits for another curve, such as one whose motions are divided at nodes."""
        endings = copy(self)
        endings.curve = curve
        return endings

    def tests(self) -> list[Test]:
        """Tests of what ends the curve between two points."""
        return []

    def at(self, event: Event) -> End:
        """The end of the curve where one of these tests vanishes."""
        raise NotImplementedError

    def asks(self, points: Points) -> np.ndarray:
        """At which certified points (m,) the curve may end."""
        orbits, first, ratio = points.own, self.first, self.control.escape_ratio
        alpha, time = orbits.column("alpha"), orbits.column("flight_time")
        speed = np.abs(alpha / first.alpha)
        ends = (speed > ratio) | (time > ratio * first.flight_time) | (speed < 1 / ratio)
        if (place := self._place_of_liftoff) is not None:
            ends |= np.abs(orbits.column("u")[:, place]) > ratio * (1 + self._reach(first))
        if isinstance(self.curve, TunedCurve):
            ends |= (self.curve.growth(points.xs) > ratio).any(1)
        ends |= self.curve.growths(points) > self.control.largest_amplification
        return ends | (self.stop_inadmissible & np.array([*map(bool, orbits.column("violations"))], bool))

    def hangs(self, points: Points) -> np.ndarray:
        """At which points (m,) motions stay near an unstable equilibrium."""
        return self.curve.largest_growths(points) > DIVISION.arc_growth

    def after(self, last: Points, passed: Sequence[Points]) -> End | None:
        """The end of the curve at its last point (1), if it ends there. Motions that hang are judged where they begin
        to hang, and where they are divided."""
        before = passed[-1][-2:-1] if len(passed[-1]) > 1 else passed[-2][-1:] if len(passed) > 1 else last
        hung = before.evaluation is not None and self.hangs(before)[0]
        here = float(last.values[0]) in self.requested
        if hung and not (here or self.asks(last)[0] or self.curve.asks_for_nodes(last)[0]):
            return None
        if self.stop_inadmissible and not last.own[0].admissible:
            return End("stopped", f"no motion from here: {self.curve.in_units(last.own[0]).violations[0]}")
        return self.far(last, passed)

    def far(self, last: Points, passed: Sequence[Points]) -> End | None:
        """The end of a curve that goes to infinity or to zero before the parameter reaches a bound."""
        orbit, first, ratio, history = last.own[0], self.first, self.control.escape_ratio, _history(passed)
        place = f"near {self.curve.along} = {last.values[0]:.6g}"
        if (most := float(self.curve.growths(last)[0])) > self.control.largest_amplification:
            if orbit_at_rest := homoclinic(self.curve, last, *_way(passed)):
                return self._homoclinic(orbit_at_rest, last)
            growth = f"{most:.0e}-fold"
            return self.lost(f"small changes grow {growth} over the flight, so rounding decides", last, passed)
        if self.curve.largest_growths(last)[0] > DIVISION.arc_growth and (end := self._hanging(last, passed)):
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
        if self._reach(orbit) > ratio * (1 + self._reach(first)) and (found := self._limit_by_reach(passed)):
            return End(
                "degenerate", f"the extension at lift-off grows without bound in the machine's units {place}", *found
            )
        # Where a launch has several speeds, this one may vanish without the flight's shrinking.
        shrunk = time < SHRUNK
        ends = speed < 1 / ratio and (shrunk or self.curve.machine.model.one_speed)
        if ends and (found := limit(history, self.bounds, 1)):
            what = "flight shrinks" if shrunk else "launch speed falls"
            return End("degenerate", f"the {what} to zero {place}", *found)
        return None

    @cached_property
    def _place_of_liftoff(self) -> int | None:
        """The place of the extension at lift-off among the unknowns; None where it is not one of them, and where a
        launch has several unknowns, since then one is the place of a mass and grows as the speed does."""
        names = self.curve.equations_of_orbits.statement.unknowns
        return names.index("liftoff") if "liftoff" in names and self.curve.machine.model.one_speed else None

    def _reach(self, point: Point) -> float:
        """The extension at lift-off, 0 where it is not an unknown."""
        return 0.0 if self._place_of_liftoff is None else abs(point.u[self._place_of_liftoff])

    def _limit_by_reach(self, passed: Sequence[Points]) -> tuple[float, float] | None:
        """The `limit` of the parameter as the extension at lift-off grows."""
        if (place := self._place_of_liftoff) is None:
            return None
        reaches = np.abs(_way(passed)[0][:, place])
        return limit(np.column_stack([reaches, _history(passed)[:, 1]]), self.bounds, -1)

    def _hanging(self, last: Points, passed: Sequence[Points]) -> End | None:
        """The end of a curve whose motions stay near an unstable equilibrium, where more points say no more about it;
        None where it is followed on."""
        end, here = self.lost("", last, passed), float(last.values[0])
        if end.kind == "escaped" and end.limit is not None:
            farthest = end.limit + np.copysign(end.limit_error or 0.0, end.limit - here)
            low, high = sorted((here, farthest))
            return None if any(low < value < high for value in self.requested) else end
        settled = abs(last.tangents[0, -1]) < SETTLED_RATE * self.curve.span
        found = homoclinic(self.curve, last, *_way(passed)) if settled else None
        return self._homoclinic(found, last) if found and found.name == self.curve.along else None

    def _homoclinic(self, found: Homoclinic, last: Points) -> End:
        """The end of a curve in a homoclinic orbit."""
        units = self.curve.units_at(last.values[0], last.own[0].also)
        limit, error = (found.limit, found.error) if found.name == self.curve.along else (None, None)
        growth = found.measured * (units.of(TIME) if units else 1.0)
        return End("homoclinic", in_units(found.reason, units), limit, error, growth)

    def _tuned_away(self, curve: TunedCurve, last: Points) -> End | None:
        """The end of a curve along which a tuned parameter grows without bound, while that of the curve settles."""
        (growths,), (tangent,), equations = curve.growth(last.xs), last.tangents, curve.equations
        for i in (growths > self.control.escape_ratio).nonzero()[0].tolist():
            # It settles by this much where its distance to the limit falls as the inverse of the tuned parameter.
            x, by = last.xs[0, equations.own + i], tangent[equations.own + i]
            left = float(tangent[-1] * x / by) if by else np.inf
            if abs(left) < SETTLED_SHARE * curve.span:
                name = equations.statement.tuned[i]
                return End("escaped", f"{name} grows without bound", float(last.values[0]) + left, abs(left))
        return None

    def _in_words(self, error: OrbitsError | str, last: Points) -> OrbitsError | Message | str:
        """The error of a step as what happens beyond the last point of a curve, with the remedy."""
        if not isinstance(error, NoStep | RunsAway | BreaksDown):
            return error
        growth = float(self.curve.largest_growths(last)[0])
        text = "no orbit is found near it" if isinstance(error, NoStep) else "the motion near it does not come back"
        text += " ({error}): "
        if growth > DIVISION.growth:
            text += "small changes grow {growth:.0e}-fold, as near an unstable equilibrium. Follow another parameter"
        else:
            text += "allow steps shorter than {step:.0e} with `shortest_step` of `StepControl`"
        return Message(text, error=error, growth=growth, step=self.control.shortest_step)

    def lost(self, error: OrbitsError | str, last: Points, passed: Sequence[Points]) -> End:
        """The end of a curve that cannot be followed beyond its last point. The reason is the error where the curve
        stays bounded; where it escapes, the limit is more informative."""
        alpha, value, history = last.own[0].alpha, float(last.values[0]), _history(passed)
        units, speed = self.curve.units_at(value, last.own[0].also), Quantity(alpha, LIFTOFF_SPEED)
        where = Message("{name} = {value:.10g}, alpha = {alpha:.10g}", name=self.curve.along, value=value, alpha=speed)
        where = in_units(where, units)
        if abs(alpha / self.first.alpha) > self.control.running_ratio and (found := limit(history, self.bounds, -1)):
            return End("escaped", f"the launch speed grows without bound, and was followed to {where}", *found)
        reason = in_units(self._in_words(error, last), units)
        if isinstance(error, InputError):
            return End("degenerate", f"the machine ceases to exist at {where}: {reason}")
        if abs(value - self.start) < self.control.least_progress * self.curve.span:
            reason += "; over several decades, follow the inverse or the logarithm of the parameter"
        return End("stuck", f"at {where}: {reason}")
