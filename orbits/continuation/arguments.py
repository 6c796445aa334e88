"""What may be asked of a family: arguments checked, each complaint naming the value and what is allowed."""

from collections.abc import Iterable, Mapping

from ..errors import InputError, finite_number, whole_number
from ..model.machine import Machine, check_parameters
from ..periodic.formulations import equations_of
from .events import MARGINS, SIGNS
from .family import RESERVED_NAMES, Point
from .tracer import SHORTEST_ARC, Options


def checked_options(at, watch, longest, most, stop_inadmissible) -> Options:
    """The options of `follow`, checked."""
    if not isinstance(at, Iterable) or isinstance(at, str):
        raise InputError(f"at = {at!r}; it is a list of values")
    if watch is not None and not isinstance(watch, Mapping):
        raise InputError(f"watch = {watch!r}; it is a mapping of names to functions of the orbit")
    values = tuple(sorted({finite_number("at", value) for value in at}))
    if not 10 * SHORTEST_ARC <= finite_number("longest", longest) <= 1:
        raise InputError(f"longest = {longest:g}; a step is a share of the way, from {10 * SHORTEST_ARC:g} to 1")
    most = whole_number("most", most, "points")
    for name, function in (watch or {}).items():
        if not callable(function) or name in (*MARGINS, *SIGNS, "asked"):
            raise InputError(f"watch '{name}' is a function of the orbit, under a name of its own")
    return Options(values, dict(watch or {}), float(longest), most, bool(stop_inadmissible))


def check_followed(machine: Machine, *names: str) -> None:
    """Raise `InputError` for a name that is none of the machine's parameters, or that a table of orbits has already."""
    check_parameters(machine, *names)
    for name in names:
        if name in RESERVED_NAMES:
            raise InputError(f"a parameter called '{name}' cannot be told from the orbit's own; give it another name")


def machine_at(machine, point: Point, along: str, method: str | None):
    """The machine at a point of its family along a parameter, and the method: the simplest when None is given."""
    check_followed(machine, along)
    if not isinstance(point, Point):
        raise InputError("where to begin is the `point` of a family's event")
    machine = machine.with_values(**{along: point.value})
    method = method or ("relative" if machine.model.reduction else "half orbit")
    if len(point.u) != equations_of(machine.model, method, tuple(machine.values)).size:
        raise InputError("this point was found by another method; give that method")
    return machine, method


def bounds_of(along: str, start: float, stop) -> tuple[float, float]:
    """The bounds behind the start and ahead of it, of which `stop` states one or both."""
    behind, stop = stop if isinstance(stop, tuple | list) and len(stop) == 2 else (start, stop)
    behind, stop = finite_number("stop", behind), finite_number("stop", stop)
    if start == stop:
        raise InputError(f"{along} goes from {start:g} to {stop:g}: there is no way between")
    if (behind - start) * (stop - start) > 0:
        raise InputError(f"stop = ({behind:g}, {stop:g}): {along} starts at {start:g}, which does not lie between")
    return behind, stop
