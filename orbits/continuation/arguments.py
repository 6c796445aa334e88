"""What a run along a curve is asked for: options and arguments, checked, with messages that name value and bound."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..errors import InputError, finite_number, whole_number
from ..model.machine import Machine, check_parameters
from ..periodic.formulations import equations_of
from ..periodic.orbit import Orbit
from .curve import TEST_FUNCTIONS
from .family import RESERVED_NAMES, Point
from .step_control import DEFAULT_CONTROL, StepControl

# Events that are no test function's, whose names the functions of a user cannot have.
OTHER_EVENTS = ("fold", "branch point", "family", "asked")
# The largest step is at least this many times as long as the shortest, so that step-size control has some play.
LEAST_PLAY = 10


@dataclass(frozen=True)
class Options:
    """What a run is asked for, as in `follow`."""

    at: tuple[float, ...] = ()
    watch: Mapping[str, Callable[[Orbit], float]] = field(default_factory=dict)
    longest: float = 0.02
    most: int = 10_000
    stop_inadmissible: bool = False
    step_control: StepControl = DEFAULT_CONTROL


def checked_options(
    at: Any = Options.at,
    watch: Any = None,
    longest: Any = Options.longest,
    most: Any = Options.most,
    stop_inadmissible: Any = Options.stop_inadmissible,
    step_control: Any = Options.step_control,
) -> Options:
    """The options of `follow`; raises `InputError` for what cannot be meant."""
    if not isinstance(at, Iterable) or isinstance(at, str):
        raise InputError(f"at = {at!r}; it is a list of values")
    if watch is not None and not isinstance(watch, Mapping):
        raise InputError(f"watch = {watch!r}; it is a mapping of names to functions of the orbit")
    if not isinstance(step_control, StepControl):
        raise InputError(f"step_control = {step_control!r}; it is a StepControl")
    values = tuple(sorted({finite_number("at", value) for value in at}))
    shortest = LEAST_PLAY * step_control.shortest_step
    if not shortest <= finite_number("longest", longest) <= 1:
        raise InputError(f"longest = {longest:g}; a step is a share of the way, from {shortest:g} to 1")
    most = whole_number("most", most, "points")
    for name, function in (watch or {}).items():
        if not callable(function) or name in (*TEST_FUNCTIONS, *OTHER_EVENTS):
            raise InputError(f"watch '{name}' is a function of the orbit, under a name of its own")
    return Options(values, dict(watch or {}), float(longest), most, bool(stop_inadmissible), step_control)


def check_followed(machine: Machine, *names: str) -> None:
    """Raise `InputError` for a name that is none of the machine's parameters, or that a table of orbits has already."""
    check_parameters(machine, *names)
    for name in names:
        if name in RESERVED_NAMES:
            raise InputError(f"a parameter called '{name}' cannot be told from the orbit's own; give it another name")


def machine_at(machine: Machine, point: Point, along: str, method: str | None) -> tuple[Machine, str]:
    """The machine at a point of its family along a parameter, and the method: the simplest when None is given."""
    check_followed(machine, along)
    if not isinstance(point, Point):
        raise InputError("where to begin is the `point` of a family's event")
    machine = machine.with_values(**{along: point.value})
    method = method or ("relative" if machine.model.reduction else "half orbit")
    if len(point.u) != equations_of(machine.model, method, tuple(machine.values)).size:
        raise InputError("this point was found by another method; give that method")
    return machine, method


def bounds_of(along: str, start: float, stop: Any, at: tuple[float, ...]) -> tuple[float, float]:
    """The bounds behind the start and ahead of it, of which `stop` states one or both; the values `at` lie between."""
    behind, ahead = stop if isinstance(stop, tuple | list) and len(stop) == 2 else (start, stop)
    behind, ahead = finite_number("stop", behind), finite_number("stop", ahead)
    if start == ahead:
        raise InputError(f"{along} goes from {start:g} to {ahead:g}: there is no way between")
    if (behind - start) * (ahead - start) > 0:
        raise InputError(f"stop = ({behind:g}, {ahead:g}): {along} starts at {start:g}, which does not lie between")
    for value in at:
        if not min(behind, ahead) <= value <= max(behind, ahead):
            raise InputError(f"at = {value:g} is not reached: {along} lies between {behind:g} and {ahead:g}")
    return behind, ahead
