"""Follow a family of lossless orbits along a parameter, past folds, to its end, and keep it as it grows."""

import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from . import interrupts
from .curve import At, Curve
from .errors import InputError
from .events import MARGINS, SIGNS, watched
from .family import COLUMNS, Event, Family, Point, record
from .orbit import Orbit
from .search import find
from .statements import equations_of
from .walk import Options, Walk


def follow(
    machine,
    along: str,
    stop: float | tuple[float, float],
    start: float | None = None,
    family: int = 1,
    *,
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
    options = options_of(at, watch, longest, most, stop_inadmissible)
    return record_of(_begin(machine, along, start, stop, family, method, options, resume), resume, output, progress)


def record_of(walk: Walk, resume: Family | None = None, output=None, progress=None) -> Family:
    """The family that a walk finds; the others as in `follow`."""
    growing = _Record(walk, resume, output)
    for item in _uninterrupted(walk):
        growing.add(item)
        if progress and isinstance(item, At):
            progress(walk.share(item.value))
    return growing.finish()


def trace(machine, along: str, stop, start: float | None = None, family: int = 1, **options) -> Iterator:
    """The orbits of a family one by one, as `follow` finds them: `Orbit`s, each `Event` before the orbit that comes
    after it, and the `End` last. The options are those of `follow`, from `at` to `method`."""
    given = {field.name: field.default for field in fields(Options)}
    method = options.pop("method", None)
    if unknown := options.keys() - given.keys():
        raise InputError(f"trace has no option '{min(unknown)}'; it knows {', '.join(given)} and method")
    walk = _begin(machine, along, start, stop, family, method, options_of(**{**given, **options}), None)
    return (walk.curve.orbit(item) if isinstance(item, At) else item for item in _uninterrupted(walk))


def _uninterrupted(walk: Walk) -> Iterator:
    """The items of a walk; an interrupt is raised between two of them."""
    items = iter(walk)
    while True:
        with interrupts.deferred():
            item = next(items, None)
        if item is None:
            return
        yield item


def options_of(at, watch, longest, most, stop_inadmissible) -> Options:
    """The options of `follow`, checked."""
    if not isinstance(at, Iterable) or isinstance(at, str):
        raise InputError(f"at = {at!r}; it is a list of values")
    if watch is not None and not isinstance(watch, Mapping):
        raise InputError(f"watch = {watch!r}; it is a mapping of names to functions of the orbit")
    values = tuple(sorted(number_of("at", value) for value in at))
    if not 0 < number_of("longest", longest) <= 1:
        raise InputError(f"longest = {longest:g}; a step is a share of the way, above 0 and up to 1")
    if isinstance(most, bool) or not isinstance(most, int | np.integer) or most < 1:
        raise InputError(f"most = {most!r}; it is a number of points, from 1")
    for name, function in (watch or {}).items():
        if not callable(function) or name in (*MARGINS, *SIGNS, "asked"):
            raise InputError(f"watch '{name}' is a function of the orbit, under a name of its own")
    return Options(values, dict(watch or {}), float(longest), int(most), bool(stop_inadmissible))


def number_of(name: str, value) -> float:
    """`value` as a finite float; raises `InputError` that names it."""
    if isinstance(value, bool | str) or not np.isscalar(value) or not np.isfinite(value):
        raise InputError(f"{name} = {value!r} is not a finite number")
    return float(value)


def known(machine, *names: str):
    """Raises `InputError` for a name that is none of the machine's parameters to follow."""
    values = getattr(machine, "values", {})
    free = [name for name in values if name != machine.model.homotopy] if values else []
    for name in names:
        if name not in free:
            raise InputError(f"the machine has no parameter '{name}' to follow; it has {', '.join(free)}")
        if name in COLUMNS:
            raise InputError(f"a parameter called '{name}' cannot be told from the orbit's own; give it another name")


def at_point(machine, point: Point, along: str, method: str | None):
    """The machine at a point of its family along a parameter, and the method: the simplest when None is given."""
    known(machine, along)
    if not isinstance(point, Point):
        raise InputError("where to begin is the `point` of a family's event")
    machine = machine.with_values(**{along: point.value})
    method = method or ("relative" if machine.model.reduction else "half orbit")
    if len(point.u) != equations_of(machine.model, method, tuple(machine.values)).size:
        raise InputError("this point was found by another method; give that method")
    return machine, method


def orbit_at(machine, point: Point, along: str, method: str | None = None) -> Orbit:
    """The whole orbit at a point of a family, with its motion.

    machine, along : as the family was followed with; `method` that of the family, None for the simplest
    """
    machine, method = at_point(machine, point, along, method)
    curve, x, row = Curve(machine, along, method, 1.0), np.array([*point.u, point.value]), np.array(point.tangent)
    with interrupts.deferred():
        return curve.orbit(curve.onto(curve.correct(x, row, row @ x, row), point.value))


def _begin(machine, along, start, stop, family, method, options: Options, resume: Family | None) -> Walk:
    """A walk from the first orbit, or from the last of a family."""
    known(machine, along)
    start = machine.values[along] if start is None else number_of("start", start)
    behind, stop = _bounds(along, start, stop)
    for value in options.at:
        if not min(behind, stop) <= value <= max(behind, stop):
            raise InputError(f"at = {value:g} is not reached: {along} lies between {behind:g} and {stop:g}")
    machine = machine.with_values(**{along: start})
    if resume is not None:
        return _resumed(machine, along, behind, stop, resume, options)
    with interrupts.deferred():
        orbit = find(machine, family, method=method)
        method = "relative" if orbit.method == "closed form" else orbit.method
        curve = Curve(machine, along, method, abs(stop - behind))
        unknowns = {
            "liftoff": orbit.liftoff_extension,
            "alpha": orbit.alpha,
            "duration": orbit.flight_time / (2 if machine.model.reversor else 1),
            "unfolding": orbit.certificate.unfolding,
        }
        x = np.array([*(unknowns[name] for name in curve.equations.statement.unknowns), start])
    return walk_from(curve, x, start, behind, stop, options)


def _bounds(along: str, start: float, stop) -> tuple[float, float]:
    """The bounds behind the start and ahead of it, of which `stop` states one or both."""
    behind, stop = stop if isinstance(stop, tuple | list) and len(stop) == 2 else (start, stop)
    behind, stop = number_of("stop", behind), number_of("stop", stop)
    if start == stop:
        raise InputError(f"{along} goes from {start:g} to {stop:g}: there is no way between")
    if (behind - start) * (stop - start) > 0:
        raise InputError(f"stop = ({behind:g}, {stop:g}): {along} starts at {start:g}, which does not lie between")
    return behind, stop


def walk_from(curve: Curve, x, start: float, behind: float, stop: float, options: Options) -> Walk:
    """A walk from near `x`, where the parameter has the value `start`, towards `stop`."""
    with interrupts.deferred():
        ahead = np.eye(len(x))[-1]
        first = curve.correct(x, ahead, start, ahead * np.sign(stop - start))
        first = curve.onto(first, start)
        for name, function in options.watch.items():
            watched(name, function, curve.orbit(first))
    return Walk(curve, first, behind, stop, options)


def _resumed(machine, along, behind, stop, resume: Family, options: Options) -> Walk:
    """A walk from the last point of a family, in the direction that it was going."""
    if not isinstance(resume, Family) or any(point.also for point in resume.points[:1]):
        raise InputError("what is resumed is a family of `follow`, as Family.load gives it")
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
        first = curve.check(curve.correct(x, row, row @ x, tangent))
    return Walk(curve, first, behind, stop, options, resume.points[:-1])


class _Record:
    """The family as it grows, in memory and on disk."""

    def __init__(self, walk: Walk, resume: Family | None, output):
        options = walk.options
        settings = {
            "start": walk.origin.value,
            "behind": walk.behind,
            "stop": walk.stop,
            "family": walk.first.point.family,
            "method": walk.curve.method,
            "longest": options.longest,
            "at": list(options.at),
            "watch": list(options.watch),
            "stop_inadmissible": options.stop_inadmissible,
        }
        versions = {name: version(name) for name in ("persistent-orbits", "casadi", "numpy")}
        versions["python"] = platform.python_version()
        machine = walk.curve.machine.describe() if resume is None else resume.machine
        # A resumed family has its last point from the walk, solved again.
        points = resume.points[:-1] if resume else ()
        events = tuple(event for event in resume.events if event.after < len(points)) if resume else ()
        self.family = Family(walk.curve.along, machine, points, events, None, settings, versions)
        self.points, self.events, self.end = list(points), list(events), None
        self.offset = len(points)
        self.file = None
        if output is not None:
            try:
                self.file = open(Path(output), "w", encoding="utf-8")  # noqa: SIM115 - open while the family grows
            except OSError as error:
                raise InputError(f"the family cannot be written to {output}: {error}") from None
            self.file.writelines(line + "\n" for line in self.family.records())

    def add(self, item):
        if isinstance(item, At):
            self.points.append(item.point)
        elif isinstance(item, Event):
            self.events.append(replace(item, after=item.after + self.offset))
        else:
            self.end = item
        if self.file:
            kept = self.points if isinstance(item, At) else self.events if isinstance(item, Event) else [self.end]
            self.file.write(record(kept[-1]) + "\n")
            self.file.flush()

    def finish(self) -> Family:
        if self.file:
            self.file.close()
        return replace(self.family, points=tuple(self.points), events=tuple(self.events), end=self.end)
