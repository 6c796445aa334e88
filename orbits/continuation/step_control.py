"""The options of a run along a family, in the form that users state, and as steps along its curve."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from ..curves import Steps, check_bounds, from_to
from ..errors import InputError, finite_number, is_list, true_or_false, whole_number
from ..hops import CROSSINGS
from ..shooting import DIVISION
from .curve import TEST_FUNCTIONS, Watch

# Events that are not among `TEST_FUNCTIONS`. The functions of a user cannot have these names.
OTHER_EVENTS = ("fold", "branch point", "corner", "family", "value", *CROSSINGS)
# The largest step is at least this many times as long as the shortest, so that step-size control has some range.
LEAST_PLAY = 10


@dataclass(frozen=True, kw_only=True)
class StepControl:
    """The constants of a continuation run: step sizes, acceptance of steps, and the conditions that end a run.

    Lengths are measured along the curve, with the parameter as a share of its whole range and each unknown as a share
    of its value. Raises `InputError` for a value that is out of its bounds.

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
        shrink to zero
    running_ratio : a curve is taken to escape if it is lost after the launch speed has grown by this factor
    least_progress : a curve that is lost within this share of the parameter's range counts as not begun
    same_point : relative distance below which two points are the same, so that the curve is closed

    >>> from orbits import follow
    >>> from orbits.continuation.step_control import StepControl
    >>> from problems import Hopper
    >>> family = follow(Hopper("tanh"), "b", 0.2, start=0.1, step_control=StepControl(first_step=0.01))
    >>> family.end.kind
    'reached'
    """

    first_step: float = from_to(1e-8, 1.0, 5e-3, of_steps="first")
    shortest_step: float = from_to(1e-12, 0.1, 1e-5, of_steps="shortest")
    longest_step: float = from_to(1e-8, 1.0, 0.2, of_steps="longest")
    largest_shortening: float = from_to(0.01, 0.99, 0.3, of_steps="shorten")
    largest_lengthening: float = from_to(1.01, 100.0, 2.0, of_steps="lengthen")
    safety: float = from_to(0.01, 1.0, 0.9, of_steps="safety")
    target_correction: float = from_to(1e-14, 0.1, 1e-5, of_steps="aim")
    largest_correction: float = from_to(1e-10, 1.0, 1e-2, of_steps="corrected")
    largest_turn: float = from_to(1e-3, 1.5, 0.25, of_steps="turned")
    steepest_rate: float = from_to(0.0, 1.0, 0.1)
    largest_batch: int = from_to(1, 100_000, 640, of_steps="batch")
    batch_growth: int = from_to(1, 1000, 4, of_steps="growth")
    neighbours: int = from_to(1, 8, 3, of_steps="beside")
    separation: float = from_to(0.0, 0.5, 0.1, of_steps="separation")
    most_rejections: int = from_to(0, 100_000, 16, of_steps="rejections")
    recovery: int = from_to(1, 100_000, 20, of_steps="recovery")
    largest_amplification: float = from_to(10.0, 1e15, DIVISION.most_growth)
    escape_ratio: float = from_to(1.5, 1e12, 1e2)
    running_ratio: float = from_to(1.01, 1e12, 2.0)
    least_progress: float = from_to(0.0, 0.5, 1e-3)
    same_point: float = from_to(1e-13, 1e-3, 1e-9, of_steps="same")

    def __post_init__(self):
        check_bounds(self, "step_control")
        if not self.shortest_step < self.first_step <= self.longest_step:
            bounds = f"shortest_step = {self.shortest_step:g} and longest_step = {self.longest_step:g}"
            raise InputError(f"step_control.first_step = {self.first_step:g}: it must lie between {bounds}")


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

    def steps(self, batch: int) -> Steps:
        """The steps along a curve; a batch has at most this number of points."""
        control = self.step_control
        pairs = ((each.metadata.get("of_steps"), each.name) for each in fields(control))
        own: dict[str, Any] = {of_steps: getattr(control, name) for of_steps, name in pairs if of_steps}
        own |= {"first": min(own["first"], self.longest), "batch": min(batch, own["batch"], self.most)}
        grown = min(DIVISION.arc_growth, control.largest_amplification)
        return Steps(**own, apart=self.longest, most=self.most, grown=grown)


def checked_options(*args: Any, **options: Any) -> Options:
    """The `Options` of these values, where `watch` may be None; raises `InputError` for an invalid value."""
    unchecked = Options(*args, **options)
    at, longest, control = unchecked.at, unchecked.longest, unchecked.step_control
    watch = {} if unchecked.watch is None else unchecked.watch
    if not is_list(at):
        raise InputError(f"at = {at!r}; it must be a list of values")
    if not isinstance(watch, Mapping):
        raise InputError(f"watch = {watch!r}; it must be a mapping of names to functions of the orbit")
    if not isinstance(control, StepControl):
        raise InputError(f"step_control = {control!r}; it must be a StepControl")
    at = tuple(sorted({finite_number("at", value) for value in at}))
    if not (shortest := LEAST_PLAY * control.shortest_step) <= finite_number("longest", longest) <= 1:
        raise InputError(f"longest = {longest:g}; it must be a share of the way, from {shortest:g} to 1")
    most = whole_number("most", unchecked.most, "points")
    for name, function in watch.items():
        if not callable(function) or name in (*TEST_FUNCTIONS, *OTHER_EVENTS):
            raise InputError(f"watch '{name}' must be a function of the orbit, with a name that nothing else has")
    flags: Any = {name: true_or_false(name, getattr(unchecked, name)) for name in ("stop_inadmissible", "multipliers")}
    return replace(unchecked, at=at, watch=dict(watch), longest=float(longest), most=most, **flags)
