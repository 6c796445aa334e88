"""Follow a family of lossless orbits along a parameter, past folds, to its end, and keep it as it grows."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields

import numpy as np

from ..errors import InputError, NoOrbit, finite_number
from ..periodic.find import another_family, solve_family, solve_near
from ..periodic.orbit import Orbit
from ..symbolic import interrupts
from .arguments import bounds_of, check_followed, checked_options, machine_at
from .checkpoint import Checkpoint
from .corrector import Curve, CurvePoint, placed
from .events import watched
from .family import Family, Point
from .tracer import Options, Tracer


def follow(
    machine,
    along: str,
    stop: float | tuple[float, float],
    start: float | None = None,
    family: int = 1,
    *,
    orbit: Orbit | None = None,
    at: Sequence[float] = Options.at,
    watch: Mapping[str, Callable[[Orbit], float]] | None = Options.watch,
    longest: float = Options.longest,
    most: int = Options.most,
    stop_inadmissible: bool = Options.stop_inadmissible,
    method: str | None = None,
    output=None,
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
    longest : step, as a share of the parameter's whole way and of the unknowns' size
    most : points
    stop_inadmissible : end where the orbits are no motions any more, instead of going on
    method : the way of `find`; "shooting" is Ipopt's for the first orbit alone
    output : a file that every point is written to as it is found, for `Family.load` and `resume`
    resume : a family to go on with from its last point, the other arguments being the same
    progress : called with the share of the way done

    Returns the `Family`, whose `end` says how it ended: a curve that is lost on the way is "stuck", with the reason.
    Raises `NoOrbit` without a first orbit, and `InputError` for what cannot be meant.
    """
    options = checked_options(at, watch, longest, most, stop_inadmissible)
    walk = _begin(machine, along, start, stop, family, orbit, method, options, resume)
    return collect_family(walk, resume, output, progress)


def collect_family(walk: Tracer, resume: Family | None = None, output=None, progress=None) -> Family:
    """The family that a walk finds; the others as in `follow`."""
    with Checkpoint(walk, resume, output) as growing, interrupts.deferred():
        for item in walk:
            growing.add(item)
            if progress and isinstance(item, CurvePoint):
                progress(walk.share(item.value))
            interrupts.check()
        return growing.whole()


def trace(machine, along: str, stop, start: float | None = None, family: int = 1, **options) -> Iterator:
    """The orbits of a family one by one, as `follow` finds them: `Orbit`s, each `Event` before the orbit that comes
    after it, and the `End` last. The options are those of `follow`, from `orbit` to `method`."""
    given = {field.name: field.default for field in fields(Options)}
    method, orbit = options.pop("method", None), options.pop("orbit", None)
    if unknown := options.keys() - given.keys():
        raise InputError(f"trace has no option '{min(unknown)}'; it knows orbit, {', '.join(given)} and method")
    walk = _begin(machine, along, start, stop, family, orbit, method, checked_options(**{**given, **options}), None)
    return (walk.curve.orbit(item) if isinstance(item, CurvePoint) else item for item in _uninterrupted(walk))


def _uninterrupted(walk: Tracer) -> Iterator:
    """The items of a walk; an interrupt is raised between two of them."""
    items = iter(walk)
    while True:
        with interrupts.deferred():
            item = next(items, None)
        if item is None:
            return
        yield item


def orbit_at(machine, point: Point, along: str, method: str | None = None) -> Orbit:
    """The whole orbit at a point of a family, with its motion.

    machine, along : as the family was followed with; `method` that of the family, None for the simplest
    """
    machine, method = machine_at(machine, point, along, method)
    curve, x, row = Curve(machine, along, method, 1.0), np.array([*point.u, point.value]), np.array(point.tangent)
    with interrupts.deferred():
        return curve.orbit(curve.onto(curve.correct(x, row, row @ x, row), point.value))


def _begin(machine, along, start, stop, family, orbit, method, options: Options, resume: Family | None) -> Tracer:
    """A walk from the first orbit, or from the last of a family."""
    check_followed(machine, along)
    if resume is not None and (not isinstance(resume, Family) or any(point.also for point in resume.points[:1])):
        raise InputError("what is resumed is a family of `follow`, as Family.load gives it")
    if start is None:
        start = machine.values[along] if resume is None else resume.settings["start"]
    start = finite_number("start", start)
    behind, stop = bounds_of(along, start, stop)
    for value in options.at:
        if not min(behind, stop) <= value <= max(behind, stop):
            raise InputError(f"at = {value:g} is not reached: {along} lies between {behind:g} and {stop:g}")
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
    walk = start_tracer(curve, np.append(root.u, start), start, behind, stop, options)
    if orbit is None and walk.first.point.family != family:
        raise NoOrbit(another_family(family, walk.first.point.family))
    return walk


def start_tracer(curve: Curve, x, start: float, behind: float, stop: float, options: Options) -> Tracer:
    """A walk from near `x`, where the parameter has the value `start`, towards `stop`."""
    with interrupts.deferred():
        ahead = np.eye(len(x))[-1]
        first = placed(curve.correct(x, ahead, start, ahead * np.sign(stop - start)), start)
        if options.stop_inadmissible or options.watch:  # else it is certified with those that follow
            curve.check(first)
        for name, function in options.watch.items():
            watched(name, function, curve.orbit(first))
        return Tracer(curve, first, behind, stop, options)


def _resumed(machine, along, behind, stop, resume: Family, options: Options) -> Tracer:
    """A walk from the last point of a family, in the direction that it was going."""
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
    curve = Curve(machine, along, resume.settings["method"], abs(stop - behind))
    x, tangent = np.array([*last.u, last.value]), np.array(last.tangent)
    with interrupts.deferred():
        row = tangent / curve.size(x) ** 2
        first = curve.onto(curve.correct(x, row, row @ x, tangent), last.value)
    return Tracer(curve, first, behind, stop, options, resume.points[:-1])
