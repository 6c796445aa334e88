"""Follow a family of lossless orbits along a parameter, past folds, to its end, and keep it as it grows."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, NoOrbit, finite_number
from ..model.machine import Machine
from ..periodic.find import another_family, solve_family, solve_near
from ..periodic.orbit import Orbit
from ..symbolic import interrupts
from .arguments import Options, bounds_of, check_followed, checked_options, machine_at
from .checkpoint import Checkpoint
from .corrector import correct
from .curve import Curve, CurvePoint
from .events import watched
from .family import End, Event, Family, Point
from .step_control import StepControl
from .tracer import Tracer


def follow(
    machine: Machine,
    along: str,
    stop: float | tuple[float, float],
    start: float | None = None,
    family: int = 1,
    *,
    orbit: Orbit | None = None,
    at: Sequence[float] = Options.at,
    watch: Mapping[str, Callable[[Orbit], float]] | None = None,
    longest: float = Options.longest,
    most: int = Options.most,
    stop_inadmissible: bool = Options.stop_inadmissible,
    step_control: StepControl = Options.step_control,
    method: str | None = None,
    output: str | Path | None = None,
    resume: Family | None = None,
    progress: Callable[[float], None] | None = None,
) -> Family:
    """Follow a family of lossless orbits as a parameter goes from `start` to `stop`, past folds, to its end.

    machine : as in `find`
    along : name of the parameter: "mass_ratio", "rest_length", or one of the spring's or gravity's
    stop : its last value; of a pair the second, and the first is another bound, behind the start
    start : its first value, by default the machine's own; where a fold brings the curve back here it ends too, unless
        there is another bound
    orbit : the first one, or one near it, instead of the lowest of `family`
    at : values to hit exactly, each time the curve passes them
    watch : functions of the orbit whose zeros are events, by name
    longest : largest distance of two points, as a share of the parameter's whole way and of the unknowns' size
    most : largest number of points
    stop_inadmissible : end where the orbits are no motions any more, instead of going on
    step_control : the constants of step-size control, of acceptance and of giving up
    method : the method of `find`; "shooting" uses Ipopt for the first orbit alone
    output : a file that every point is written to as it is found, for `Family.load` and `resume`
    resume : a family to go on with from its last point, the other arguments being the same
    progress : called with the share of the parameter's way that is done

    Returns the `Family`, whose `end` says how it ended: a curve that is lost on the way is "stuck", with the reason.
    Raises `NoOrbit` without a first orbit, and `InputError` for what cannot be meant.
    """
    options = checked_options(at, watch, longest, most, stop_inadmissible, step_control)
    tracer = _begin(machine, along, start, stop, family, orbit, method, options, resume)
    return collect_family(tracer, resume, output, progress)


def collect_family(
    tracer: Tracer,
    resume: Family | None = None,
    output: str | Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> Family:
    """The family that a run finds; the others as in `follow`."""
    with Checkpoint(tracer, resume, output) as checkpoint, interrupts.deferred():
        for item in tracer:
            checkpoint.add(item)
            if progress and isinstance(item, CurvePoint):
                progress(tracer.share(item.value))
            interrupts.check()
        return checkpoint.whole()


def trace(
    machine: Machine,
    along: str,
    stop: float | tuple[float, float],
    start: float | None = None,
    family: int = 1,
    **options: Any,
) -> Iterator[Orbit | Event | End]:
    """The orbits of a family one by one, as `follow` finds them: `Orbit`s, each `Event` before the orbit that comes
    after it, and the `End` last. The options are those of `follow`, from `orbit` to `method`."""
    known = [field.name for field in fields(Options)]
    method, orbit = options.pop("method", None), options.pop("orbit", None)
    if unknown := options.keys() - set(known):
        raise InputError(f"trace has no option '{min(unknown)}'; it knows orbit, {', '.join(known)} and method")
    tracer = _begin(machine, along, start, stop, family, orbit, method, checked_options(**options), None)
    items = _interruptible(tracer)
    return (tracer.curve.orbit(item) if isinstance(item, CurvePoint) else item for item in items)


def _interruptible(tracer: Tracer) -> Iterator[CurvePoint | Event | End]:
    """The items of a run; an interrupt is raised between two of them."""
    items = iter(tracer)
    while True:
        with interrupts.deferred():
            item = next(items, None)
        if item is None:
            return
        yield item


def orbit_at(machine: Machine, point: Point, along: str, method: str | None = None) -> Orbit:
    """The whole orbit at a point of a family, with its motion.

    machine, along : as the family was followed with; `method` that of the family, None for the simplest
    """
    machine, method = machine_at(machine, point, along, method)
    curve, x, row = Curve(machine, along, method, 1.0), np.array([*point.u, point.value]), np.array(point.tangent)
    with interrupts.deferred():
        return curve.orbit(curve.certify_at(correct(curve, x, row, row @ x, row), point.value))


def _begin(machine, along, start, stop, family, orbit, method, options: Options, resume: Family | None) -> Tracer:
    """A run from the first orbit, or from the last of a family that is resumed."""
    check_followed(machine, along)
    if resume is not None and (not isinstance(resume, Family) or any(point.also for point in resume.points[:1])):
        raise InputError("what is resumed is a family of `follow`, as Family.load gives it")
    if start is None:
        start = machine.values[along] if resume is None else resume.settings["start"]
    start = finite_number("start", start)
    behind, stop = bounds_of(along, start, stop, options.at)
    machine = machine.with_values(**{along: start})
    if resume is not None:
        if (family, method or resume.settings["method"]) != (resume.settings["family"], resume.settings["method"]):
            raise InputError(
                f"the family to resume is number {resume.settings['family']}, by the method "
                f"'{resume.settings['method']}': ask for the same"
            )
        return _resumed(machine, along, behind, stop, resume, options)
    with interrupts.deferred():
        family = 1 if family is None else family
        method, root = solve_family(machine, family, method) if orbit is None else solve_near(machine, orbit, method)
        curve = Curve(machine, along, "relative" if method == "closed form" else method, abs(stop - behind))
    tracer = start_tracer(curve, np.append(root.u, start), start, behind, stop, options)
    if orbit is None and tracer.first.point.family != family:
        raise NoOrbit(another_family(family, tracer.first.point.family))
    return tracer


def start_tracer(curve: Curve, x: np.ndarray, start: float, behind: float, stop: float, options: Options) -> Tracer:
    """A run from near `x` (n + 1,), where the parameter has the value `start`, towards `stop`."""
    with interrupts.deferred():
        along_parameter = np.eye(len(x))[-1]
        first = correct(curve, x, along_parameter, start, along_parameter * np.sign(stop - start))
        if options.stop_inadmissible or options.watch:  # otherwise it is certified in one call with those that follow
            first = curve.certify(first)
        for name, function in options.watch.items():
            watched(name, function, curve.orbit(first))
        return Tracer(curve, first, behind, stop, options)


def _resumed(machine: Machine, along: str, behind: float, stop: float, resume: Family, options: Options) -> Tracer:
    """A run from the last point of a family, in the direction that it was going."""
    _check_resumable(machine, along, behind, stop, resume)
    last = resume.points[-1]
    curve = Curve(machine, along, resume.settings["method"], abs(stop - behind))
    x, tangent = np.array([*last.u, last.value]), np.array(last.tangent)
    with interrupts.deferred():
        row = tangent / curve.size(x) ** 2
        first = curve.certify_at(correct(curve, x, row, row @ x, tangent), last.value)
    return Tracer(curve, first, behind, stop, options, resume.points[:-1])


def _check_resumable(machine: Machine, along: str, behind: float, stop: float, resume: Family) -> None:
    """Raise `InputError` where a family is another machine's, or has nothing left to follow."""
    mine, theirs = machine.describe(), dict(resume.machine)
    for name in (along, "parameters"):
        mine.pop(name, None), theirs.pop(name, None)
    others = {k: v for k, v in resume.machine["parameters"].items() if k != along}
    if along != resume.name or mine != theirs or any(machine.values[name] != value for name, value in others.items()):
        raise InputError(
            f"the family to resume is of another machine or parameter: {resume.machine} along {resume.name}"
        )
    if not resume.points:
        raise InputError("the family to resume has no points: start it anew")
    if resume.end.kind == "closed":
        raise InputError("the family to resume has closed: there is nothing to go on to")
    last = resume.points[-1]
    if not min(behind, stop) <= last.value <= max(behind, stop):
        raise InputError(
            f"the family to resume has got to {along} = {last.value:g}, not between {behind:g} and {stop:g}"
        )
    if (last.value - stop) * (stop - behind) >= 0 and last.tangent[-1] * (stop - behind) > 0:
        raise InputError(f"the family to resume has reached {along} = {stop:g} already")
