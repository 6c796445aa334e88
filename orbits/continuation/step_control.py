"""What a run is asked for, and the constants of step-size control and of the tests that accept or reject points."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from ..errors import InputError, finite_number, whole_number
from .curve import TEST_FUNCTIONS, Watch

# Events that are no test function's, whose names the functions of a user cannot have.
OTHER_EVENTS = ("fold", "branch point", "family", "asked")
# The largest step is at least this many times as long as the shortest, so that step-size control has some play.
LEAST_PLAY = 10


def _between(low: float, high: float, default: float) -> Any:
    """A field with its default, which lies between two bounds; a whole number where the default is one."""
    return field(default=default, metadata={"bounds": (low, high)})


@dataclass(frozen=True, kw_only=True)
class StepControl:
    """How a curve of orbits is stepped along: step sizes, acceptance of steps, and when a run gives up.

    Lengths are measured along the curve, the parameter in shares of its whole way, each unknown in shares of its value.
    `InputError` names a value that is out of its bounds.

    first_step : length of the first step, and of a step that Ipopt has rescued
    shortest_step : a run ends as "stuck" when a step of this length is still rejected
    longest_step : largest length of a step, unless `longest` of `follow` is larger; the points between are interpolated
    largest_shortening, largest_lengthening : bounds on the ratio of the next step to this one
    safety : factor by which the next step stays below the estimate of the step-size control
    target_correction : correction that step-size control aims at, divided by the root of the orbit's amplification;
        the second Newton step is then mostly the last
    largest_correction : distance from prediction to point, in shares of the step; a larger one may lead elsewhere
    largest_turn : angle between two neighbouring tangents, in radians
    steepest_rate : share of the parameter in the tangent above which Ipopt may solve at a fixed value of the parameter
    largest_batch : points in one batch; it is reduced to one after a rejection
    batch_growth : factor by which a batch grows after each one without a rejection
    similar_counts : points are solved in one call when that needs at most this many times their own Taylor steps
    neighbours : ends of steps on either side that the points between two of them are interpolated from
    separation : least distance of a regular point from a value asked for, as a share of the points' distance
    most_rejections : a run ends after so many rejections, each of which is offset by `recovery` accepted points
    recovery : accepted points that offset one rejection
    largest_amplification : growth of a small change over the motion beyond which rounding decides about the orbit
    escape_ratio : an orbit this many times faster, longer or smaller than the first goes to infinity or to nothing
    running_ratio : a curve is taken to escape if it is lost after the launch speed has grown by this factor
    least_progress : share of the parameter's way within which a lost curve has not really begun
    same_point : relative distance below which two points are the same, so that the curve has closed
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
    largest_batch: int = _between(1, 100_000, 160)
    batch_growth: int = _between(1, 1000, 4)
    similar_counts: float = _between(1.0, 100.0, 1.1)
    neighbours: int = _between(1, 8, 3)
    separation: float = _between(0.0, 0.5, 0.1)
    most_rejections: int = _between(0, 100_000, 16)
    recovery: int = _between(1, 100_000, 20)
    largest_amplification: float = _between(10.0, 1e15, 3e7)
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


DEFAULT_CONTROL = StepControl()


@dataclass(frozen=True)
class Options:
    """What a run is asked for, as in `follow`."""

    at: tuple[float, ...] = ()
    watch: Watch = field(default_factory=dict)
    longest: float = 0.02
    most: int = 10_000
    stop_inadmissible: bool = False
    step_control: StepControl = DEFAULT_CONTROL


def checked_options(*args: Any, **options: Any) -> Options:
    """The `Options` of these values, where `watch` may be None; raises `InputError` for what cannot be meant."""
    asked = Options(*args, **options)
    at, watch, longest = asked.at, {} if asked.watch is None else asked.watch, asked.longest
    if not isinstance(at, Iterable) or isinstance(at, str):
        raise InputError(f"at = {at!r}; it is a list of values")
    if not isinstance(watch, Mapping):
        raise InputError(f"watch = {watch!r}; it is a mapping of names to functions of the orbit")
    if not isinstance(asked.step_control, StepControl):
        raise InputError(f"step_control = {asked.step_control!r}; it is a StepControl")
    at = tuple(sorted({finite_number("at", value) for value in at}))
    shortest = LEAST_PLAY * asked.step_control.shortest_step
    if not shortest <= finite_number("longest", longest) <= 1:
        raise InputError(f"longest = {longest:g}; a step is a share of the way, from {shortest:g} to 1")
    most = whole_number("most", asked.most, "points")
    for name, function in watch.items():
        if not callable(function) or name in (*TEST_FUNCTIONS, *OTHER_EVENTS):
            raise InputError(f"watch '{name}' is a function of the orbit, under a name of its own")
    stops = bool(asked.stop_inadmissible)
    return replace(asked, at=at, watch=dict(watch), longest=float(longest), most=most, stop_inadmissible=stops)
