"""Steps along a curve of orbits, with step-size control, and the points between their ends; the options of a run.

A step of length s along the unit tangent t from X0 solves F(X) = 0, t . (X - X0) = s. A correction that is large
relative to s may have led to another curve, so a shorter step is tried. At one point or more in each step, Newton's
method must also converge to the curve from the interpolant through the ends of the steps.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from ..errors import InputError, NoStep, OrbitsError, finite_number, is_list, true_or_false, whole_number
from ..numerics.hermite import around
from ..shooting.division import LARGEST_ARC_GROWTH, MOST_GROWTH
from ..simulation.lossless_hops import CROSSINGS
from .corrector import MEMORY, correct, correct_all, predict_and_correct
from .curve import TEST_FUNCTIONS, Curve, CurvePoint, CurvePoints, StepEnd, Watch, interpolated
from .curve_corners import AWAY_FROM_CORNER, CurveCorner

# Events that are not among `TEST_FUNCTIONS`. The functions of a user cannot have these names.
OTHER_EVENTS = ("fold", "branch point", "corner", "family", "value", *CROSSINGS)
# The largest step is at least this many times as long as the shortest, so that step-size control has some range.
LEAST_PLAY = 10
Points = Sequence[CurvePoint | StepEnd]


def _between(low: float, high: float, default: float) -> Any:
    """A field with its default and bounds; a whole number where the default is a whole number."""
    return field(default=default, metadata={"bounds": (low, high)})


@dataclass(frozen=True, kw_only=True)
class StepControl:
    """The constants of a continuation run: step sizes, acceptance of steps, and the conditions that end a run.

    Lengths are measured along the curve, with the parameter as a share of its whole range and each unknown as a share
    of its value. Raises `InputError`, which names a value that is out of its bounds.

    first_step : length of the first step, and of the first step after a point that Ipopt had to solve
    shortest_step : a run ends as "stuck" when a step of this length is still rejected
    longest_step : largest length of a step, unless `longest` of `follow` is larger; points in between are interpolated
    largest_shortening, largest_lengthening : bounds on the ratio of the next step to this one
    safety : factor by which the next step stays below the estimate of the step-size control
    target_correction : correction that step-size control aims at, divided by the square root of the orbit's
        amplification; the second Newton step is then usually the last
    largest_correction : distance from prediction to point, as a share of the step; a larger one may lead to another
        curve
    largest_turn : angle between two neighbouring tangents, in radians
    steepest_rate : component of the tangent along the parameter above which Ipopt may solve at a fixed value of the
        parameter
    largest_batch : points in one batch; it is reduced to one after a rejection
    batch_growth : factor by which a batch grows after each one without a rejection
    neighbours : number of step ends on either side from which the points between two of them are interpolated
    separation : least distance of a regular point from a value in `at`, as a share of the points' distance
    most_rejections, recovery : a run ends after `most_rejections` rejections; `recovery` accepted points offset one
    largest_amplification : growth of a small change over the motion beyond which rounding errors dominate the orbit,
        even where it is divided at nodes; where the growth between nodes is larger than 3e7 there are more of them
    escape_ratio : an orbit this many times faster, longer or smaller than the first is taken to tend to infinity or to
        shrink to nothing
    running_ratio : a curve is taken to escape if it is lost after the launch speed has grown by this factor
    least_progress : share of the parameter's range within which a lost curve counts as not begun
    same_point : relative distance below which two points are the same, so that the curve is closed

    >>> from orbits import follow
    >>> from orbits.continuation.step_control import StepControl
    >>> from problems import Hopper
    >>> family = follow(Hopper("tanh"), "b", 0.2, start=0.1, step_control=StepControl(first_step=0.01))
    >>> family.end.kind
    'reached'
    """

    first_step: float = _between(1e-8, 1.0, 5e-3)
    shortest_step: float = _between(1e-12, 0.1, 1e-5)
    longest_step: float = _between(1e-8, 1.0, 0.2)
    largest_shortening: float = _between(0.01, 0.99, 0.3)
    largest_lengthening: float = _between(1.01, 100.0, 2.0)
    safety: float = _between(0.01, 1.0, 0.9)
    target_correction: float = _between(1e-14, 0.1, 1e-5)
    largest_correction: float = _between(1e-10, 1.0, 1e-2)
    largest_turn: float = _between(1e-3, 1.5, 0.25)
    steepest_rate: float = _between(0.0, 1.0, 0.1)
    largest_batch: int = _between(1, 100_000, 640)
    batch_growth: int = _between(1, 1000, 4)
    neighbours: int = _between(1, 8, 3)
    separation: float = _between(0.0, 0.5, 0.1)
    most_rejections: int = _between(0, 100_000, 16)
    recovery: int = _between(1, 100_000, 20)
    largest_amplification: float = _between(10.0, 1e15, MOST_GROWTH)
    escape_ratio: float = _between(1.5, 1e12, 1e2)
    running_ratio: float = _between(1.01, 1e12, 2.0)
    least_progress: float = _between(0.0, 0.5, 1e-3)
    same_point: float = _between(1e-13, 1e-3, 1e-9)

    def __post_init__(self):
        for knob in fields(self):
            (low, high), value, name = knob.metadata["bounds"], getattr(self, knob.name), f"step_control.{knob.name}"
            if isinstance(knob.default, int):
                whole_number(name, value, "points or steps", low)
            if not low <= finite_number(name, value) <= high:
                raise InputError(f"{name} = {value:g}: it lies between {low:g} and {high:g}")
        if not self.shortest_step < self.first_step <= self.longest_step:
            bounds = f"shortest_step = {self.shortest_step:g} and longest_step = {self.longest_step:g}"
            raise InputError(f"step_control.first_step = {self.first_step:g}: it lies between {bounds}")


@dataclass(frozen=True)
class Options:
    """The options of a run, as in `follow`."""

    at: tuple[float, ...] = ()
    watch: Watch = field(default_factory=dict)
    longest: float = 0.02
    most: int = 10_000
    stop_inadmissible: bool = False
    step_control: StepControl = StepControl()
    multipliers: bool = False


def checked_options(*args: Any, **options: Any) -> Options:
    """The `Options` of these values, where `watch` may be None; raises `InputError` for an invalid value."""
    unchecked = Options(*args, **options)
    at, longest, control = unchecked.at, unchecked.longest, unchecked.step_control
    watch = {} if unchecked.watch is None else unchecked.watch
    if not is_list(at):
        raise InputError(f"at = {at!r}; it is a list of values")
    if not isinstance(watch, Mapping):
        raise InputError(f"watch = {watch!r}; it is a mapping of names to functions of the orbit")
    if not isinstance(control, StepControl):
        raise InputError(f"step_control = {control!r}; it is a StepControl")
    at = tuple(sorted({finite_number("at", value) for value in at}))
    if not (shortest := LEAST_PLAY * control.shortest_step) <= finite_number("longest", longest) <= 1:
        raise InputError(f"longest = {longest:g}; a step is a share of the way, from {shortest:g} to 1")
    most = whole_number("most", unchecked.most, "points")
    for name, function in watch.items():
        if not callable(function) or name in (*TEST_FUNCTIONS, *OTHER_EVENTS):
            raise InputError(f"watch '{name}' is a function of the orbit, under a name of its own")
    flags: Any = {name: true_or_false(name, getattr(unchecked, name)) for name in ("stop_inadmissible", "multipliers")}
    return replace(unchecked, at=at, watch=dict(watch), longest=float(longest), most=most, **flags)


class Stepper:
    """Steps along a curve within bounds; `start` is the parameter's first value."""

    def __init__(self, curve: Curve, bounds: tuple[float, float], start: float, options: Options):
        self.curve, self.bounds, self.longest, self.control = curve, bounds, options.longest, options.step_control
        self.requested = np.array([value for value in options.at if value != start])

    def steps(
        self, ends: Points, length: float, batch_size: int
    ) -> tuple[Sequence[StepEnd], float, OrbitsError | None]:
        """The ends of the next steps, of about `batch_size` points; the next length; and the error that ends them.

        The first step is shortened until it is accepted. A later one that is rejected ends the batch: the points before
        it may be the last that can be certified, and shorter steps beyond them would be in vain.
        """
        new: list[StepEnd] = []
        while sum(end.parts for end in new) < batch_size:
            take = self._attempt if new else self._step
            try:
                end, length = take([*ends, *new][-MEMORY:], length, batch_size == 1)
            except OrbitsError as error:
                return (new, 0.5 * length, None) if new else (new, length, error)
            new.append(end)
            inside = self.bounds[0] < end.value < self.bounds[1]
            folds = end.tangent[-1] * (new[-2] if len(new) > 1 else ends[-1]).tangent[-1] < 0
            if (
                not inside
                or folds
                or self._corner(end, 2 * AWAY_FROM_CORNER)
                or end.amplification > min(LARGEST_ARC_GROWTH, self.control.largest_amplification)
            ):
                break
        return new, length, None

    def _step(self, ends: Points, length: float, alone: bool) -> tuple[StepEnd, float]:
        """The end of a step and the length of the next; a rejected step is halved. Raises the error of the last one."""
        failure: OrbitsError = NoStep("no step is short enough")
        while length > self.control.shortest_step:
            try:
                return self._attempt(ends, length, alone)
            except OrbitsError as error:
                failure, length = error, 0.5 * length
        try:
            return self._rescued(ends[-1]), self.control.first_step
        except OrbitsError:
            raise failure from None

    def _attempt(self, ends: Points, length: float, alone: bool) -> tuple[StepEnd, float]:
        """The end of a step of this length, or up to a corner or to the bound ahead, and the length of the next; raises
        `NoOrbit` for a rejected step."""
        rate = ends[-1].tangent[-1]
        bound = self.bounds[int(rate > 0)]
        left = (bound - ends[-1].value) / rate if rate else np.inf
        if corner := self._corner(ends[-1], min(length, left) if left > 0 else length):
            return self._accepted(ends, length, corner.left, alone, corner)
        if 0 < left <= length:
            try:
                return self._accepted(ends, length, left, alone, bound)
            except OrbitsError:  # the curve folds before the bound, or crosses it elsewhere
                return self._accepted(ends, length, min(length, left + self.longest), alone)
        return self._accepted(ends, length, length, alone)

    def _corner(self, point: CurvePoint | StepEnd, longest: float) -> CurveCorner | None:
        """The next corner of the curve within a length of a point."""
        return self.curve.corners.ahead(point.x, point.tangent, longest) if self.curve.corners else None

    def _accepted(
        self, ends: Points, planned: float, length: float, alone: bool, to: float | CurveCorner | None = None
    ):
        """The end of a step of length `length`, or of about that length to a value of the parameter or to a corner, and
        the length of the next; `planned` is the length that step-size control allowed. Raises `NoStep` for a rejected
        step."""
        control = self.control
        end, guess, rests = predict_and_correct(self.curve, ends, length, to)
        if self.curve.corners and self.curve.corners.between(ends[-1].x, end.x):
            raise NoStep("the step passes a corner of the curve")
        moved = self._correction(ends[-1], end.x[None], end.tangent[None], guess[None], np.array([length]))
        parts = max(2, int(np.ceil(length / self.longest)))
        end = end._replace(length=length / parts, parts=parts)
        if alone:  # otherwise the points between the ends of several steps are later solved together
            self.points_between(ends, [end], 1)
        # The interpolant of k points with tangents has an error of order 2k in the step.
        ratio = (control.target_correction / max(moved * np.sqrt(end.amplification), 1e-300)) ** (1 / (2 * rests))
        ratio = min(max(control.safety * ratio, control.largest_shortening), control.largest_lengthening)
        return end, min(max(planned, length) * ratio, max(control.longest_step, self.longest))

    def _rescued(self, last: CurvePoint | StepEnd) -> StepEnd:
        """The point one first step away, solved by Ipopt at a fixed value of the parameter as a last resort."""
        curve, length, row = self.curve, self.control.first_step, last.tangent / self.curve.size(last.x) ** 2
        if abs(last.tangent[-1]) < self.control.steepest_rate * curve.span:
            raise NoStep("the parameter's value does not fix the orbit here")
        # Earlier points are left out of the prediction, since they may lie too close.
        guess = interpolated([last], row, np.array([row @ last.x + length]))
        x, along_parameter = curve.rescued(guess[0]), np.eye(len(last.x))[-1]
        point = correct(curve, x, along_parameter, x[-1], last.tangent)
        self._correction(last, point.x[None], point.tangent[None], guess, np.array([length]))
        return StepEnd(point.x, point.tangent, point.amplification, along_parameter, length)

    def _correction(self, last: CurvePoint | StepEnd, xs, tangents, guesses, lengths) -> float:
        """The largest correction from guesses (m, n + 1) to points (m, n + 1) with tangents, `lengths` (m,) apart;
        raises `NoStep` when this correction, or an angle between neighbouring tangents, is too large for one curve."""
        sizes = self.curve.size(guesses)
        moved = np.linalg.norm((xs - guesses) / sizes, axis=1)
        tangents = np.concatenate([last.tangent[None], tangents])
        a, b = tangents[:-1] / sizes, tangents[1:] / sizes
        cosines = np.einsum("mi,mi->m", a, b) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
        turned = float(np.arccos(np.clip(cosines.min(), -1.0, 1.0)))
        if (moved > self.control.largest_correction * lengths).any() or turned > self.control.largest_turn:
            step = f"{moved.max():.1e} in a step of {lengths.min():.1e}"
            raise NoStep(f"the corrector moves {step}, the tangent turns by {turned:.2g}")
        return float(moved.max())

    def points_between(self, ends: Points, new: Sequence[StepEnd], batch_size: int) -> CurvePoints:
        """The points after the last of `ends`, up to and including the `new` ends; raises `NoStep` when one of them
        may lie on another curve."""
        steps, guesses, rows, levels, parts = self._targets(ends[-self.control.neighbours :], new, batch_size > 1)
        tangents = np.array([point.tangent for point in (ends[-1], *new)])[steps]
        lengths = np.array([end.length for end in new])[steps]
        points = correct_all(self.curve, guesses, rows, levels, tangents, lengths, parts)
        self._correction(ends[-1], points.xs, points.tangents, guesses, lengths)
        return points

    def _targets(self, before: Points, ends: Sequence[StepEnd], with_at: bool) -> tuple[np.ndarray, ...]:
        """The equations to solve on the steps from the last point before to their ends, in order: the step (q,), and
        guess (q, n + 1), row (q, n + 1), level (q,) and parts (q,) as in `correct_all`; if `with_at`, also those at
        the requested values of the parameter."""
        chain, first = (*before, *ends), len(before) - 1
        xs, tangents = np.array([point.x for point in chain]), np.array([point.tangent for point in chain])
        tangents = self.curve.steady(xs, tangents)
        side, n, each = self.control.neighbours, xs.shape[1], np.arange(len(ends))
        chords, places = np.diff(xs[first:], axis=0), np.arange(first + 1, len(chain))
        rows = chords / self.curve.size(xs[first:-1]) ** 2
        rows /= np.einsum("gi,gi->g", rows, chords)[:, None]
        starts, parts = np.einsum("gi,gi->g", rows, xs[first:-1]), np.array([end.parts for end in ends])
        steps = np.repeat(np.arange(len(parts)), parts - 1)
        shares = np.concatenate([np.arange(1, count) / count for count in parts])
        requested = self.requested if with_at else self.requested[:0]
        passed, values = self._passed(xs[first:, -1], tangents[first:, -1], requested)
        along_parameter = np.tile(np.eye(n)[-1], (len(passed), 1))
        at_values, _ = around(xs, tangents, places[passed], side, side, along_parameter, values)
        taken = np.einsum("qi,qi->q", rows[passed], at_values) - starts[passed]
        crowded = np.abs(shares[:, None] - taken) * parts[steps][:, None] <= self.control.separation
        free = ~(crowded & (steps[:, None] == passed)).any(1)
        steps, shares = steps[free], shares[free]
        levels = starts[steps] + shares
        guesses, _ = around(xs, tangents, places[steps], side, side, rows[steps], levels)
        rows_of_ends, xs_of_ends = np.array([end.row for end in ends]), xs[first + 1 :]
        groups = (
            (steps, passed, each),
            (guesses, at_values, xs_of_ends),
            (rows[steps], along_parameter, rows_of_ends),
            (levels, values, np.einsum("gi,gi->g", rows_of_ends, xs_of_ends)),
            (0 * steps, 0 * passed, parts),
        )
        order = np.lexsort((np.concatenate([shares, taken, np.ones(len(ends))]), np.concatenate(groups[0])))
        return tuple(np.concatenate(group)[order] for group in groups)

    @staticmethod
    def _passed(values: np.ndarray, rates: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The steps (h,) on which the parameter passes a requested value without a fold, and that value (h,)."""
        a, b, onward = values[:-1, None], values[1:, None], (rates[:-1] * rates[1:] > 0)[:, None]
        steps, which = np.nonzero((np.minimum(a, b) < wanted) & (wanted < np.maximum(a, b)) & onward)
        return steps, wanted[which]
