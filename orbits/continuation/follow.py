"""Follow a family of lossless orbits along a parameter, past folds, to its end; or a curve from a branch point."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from numbers import Real
from pathlib import Path
from typing import Any, Literal, TypeGuard, overload

import numpy as np

from ..curves import Points
from ..errors import InputError, NoOrbit, finite_number
from ..model import Machine, machine_in_words
from ..periodic import (
    METHOD,
    LinearSearch,
    Orbit,
    Oscillation,
    OscillationFamily,
    Solved,
    StartLike,
    Swing,
    SwingFamily,
    another_family,
    check_determined,
    check_start,
    family_number,
    first_tuned,
    follow_energy,
    follow_swings,
    grip_of,
    is_quantity,
    lowest_of_family,
    solve_family,
    solve_near,
    start_in_file,
    tuned_values,
)
from ..result import Progress
from ..running import LOCK, TimeOver, exclusive, interrupts, running, time_limit
from ..shooting import ENERGY_OF_CYCLE, iterative, method_of
from ..units import without_units
from .both_ways import both_ways
from .checkpoint import check_output, collect_family
from .curve import Curve, Watch, machine_at, tuned_at
from .curve_ends import Endings
from .families import Families, followed_families, numbers_of_families
from .family import Family
from .family_problem import FamilyProblem
from .family_run import FamilyRun
from .point import End, Event, Point
from .step_control import Options, StepControl, checked_options
from .tuned_curve import TunedCurve, checked_tuning, curve_at

Stop = float | tuple[float, float]
# The square of a longer way, and its inverse, are finite numbers.
SHORTEST_CURVE = 1e-150
# The first point of the other curve may lie this many steps away, since the curves need not meet at a right angle.
LONGEST_FIRST_STEP = 10.0


@overload
def follow(  # type: ignore[overload-overlap]
    machine: Machine, along: Literal["energy"], stop: Stop,
    start: Oscillation | Mapping[str, float] | float | None = None, family: int = 1, *,
    at: Sequence[float] = Options.at, longest: float = Options.longest, most: int = Options.most,
    step_control: StepControl = Options.step_control, progress: Progress = None,
) -> OscillationFamily: ...  # fmt: skip


@overload
def follow(
    machine: Machine, along: str, stop: Stop, start: StartLike | float | None = None, family: int = 1, *,
    families: None = None, tune: str | Iterable[str] | None = None, at: Sequence[float] = Options.at,
    watch: Watch | None = None, longest: float = Options.longest, most: int = Options.most,
    stop_inadmissible: bool = Options.stop_inadmissible, step_control: StepControl = Options.step_control,
    multipliers: bool = Options.multipliers, method: str | None = None, output: str | Path | None = None,
    resume: Family | None = None, progress: Progress = None,
) -> Family: ...  # fmt: skip


@overload
def follow(
    machine: Machine, along: str, stop: Stop, start: float | None = None, *, families: Iterable[int],
    tune: str | Iterable[str] | None = None, at: Sequence[float] = Options.at, watch: Watch | None = None,
    longest: float = Options.longest, most: int = Options.most,
    stop_inadmissible: bool = Options.stop_inadmissible, step_control: StepControl = Options.step_control,
    multipliers: bool = Options.multipliers, method: str | None = None, progress: Progress = None,
) -> Families: ...  # fmt: skip


@exclusive
def follow(
    machine: Machine,
    along: str,
    stop: Stop,
    start: StartLike | Oscillation | Swing | float | None = None,
    family: int = 1,
    *,
    families: Iterable[int] | None = None,
    tune: str | Iterable[str] | None = None,
    at: Sequence[float] = Options.at,
    watch: Watch | None = None,
    longest: float = Options.longest,
    most: int = Options.most,
    stop_inadmissible: bool = Options.stop_inadmissible,
    step_control: StepControl = Options.step_control,
    multipliers: bool = Options.multipliers,
    method: str | None = None,
    output: str | Path | None = None,
    resume: Family | None = None,
    progress: Progress = None,
) -> Family | Families | OscillationFamily | SwingFamily:
    """Follow a family of lossless orbits as a parameter goes from a first value to `stop`, past folds, to its end.

    machine : as in `find`
    along : name of the parameter: "mass_ratio", "rest_length", or one of the spring's or gravity's; or, with `tune`, a
        quantity of the orbits, such as "period", "frequency" or "alpha"; or "energy", for an `OscillationFamily`: the
        periodic motions of a machine without a gap, of one that stands, or of one that bounces with a restitution of 1,
        from the normal mode of the number `family` on, or through the motion in `start`, see `Oscillation`
    stop : its last value, in the machine's units; or a range (first, last) around its start, which is followed both
        ways. The family then goes from the first value, or from where the curve ends before it, to the last one
    start : its first value, by default the machine's own; or, as in `find`, the first orbit or one near it at the
        machine's own value, instead of the lowest orbit of `family`. The curve ends where it returns to this value,
        unless `stop` is a range
    family : number of the family, from 1
    families : numbers of several families instead, such as (1, 2, 3), each from its own first orbit. The result is then
        a `Families`, which draws them in one figure
    tune : names of parameters that become unknowns, as in `find`; their values are columns of the family
    at : values to hit exactly, each time the curve passes them. A family that escapes ends where small changes grow
        3e7-fold, since its limit is known by then, unless one of these values lies beyond
    watch : functions of the orbit whose zeros are events, by name
    longest : largest distance of two points, as a share of the parameter's whole range and of the unknowns' size
    most : largest number of points, in each direction
    stop_inadmissible : whether to end where the orbits cease to be motions
    step_control : the constants of step-size control, of acceptance, and of the end of a run
    multipliers : whether to locate where multipliers of the map of launches cross the unit circle, at 1 ("multiplier
        1"), at -1 ("flip"), or as a complex pair ("Neimark-Sacker"). The multiplier of the energy is always 1. Where a
        launch is one speed there is no other, and this is an `InputError`
    method : the method of `find`; "shooting" uses Ipopt for the first orbit only
    output : a file to which the points are written as they are found, from the first batch on, for `Family.load` and
        `resume`
    resume : a family to continue from its last point, and also from its first one if it went both ways; the other
        arguments must be the same
    progress : called with the completed share of the parameter's range

    Of a machine with a `Grip` the family is a `SwingFamily`, which leads from the fastest swing at the first value, or
    from the one near a start, to the last value.

    Returns the `Family`, whose `end` says how it ended; a curve that is lost is "stuck", with the reason. Raises
    `NoOrbit` if there is no first orbit, and `InputError` for invalid arguments. Source: pseudo-arclength continuation,
    Keller 1977.

    >>> from orbits import follow
    >>> from problems import Hopper
    >>> family = follow(Hopper("cubic", rest_length=30.0), "beta", -0.02, start=0.0)
    >>> [event.kind for event in family.events], family.end.kind
    (['collapse', 'fold'], 'escaped')
    >>> round(family.events[1].point.value, 9)
    -0.010695215
    """
    options = checked_options(at, watch, longest, most, stop_inadmissible, step_control, multipliers)
    check_output(output)
    of_energy = along == ENERGY_OF_CYCLE and tune is None and along not in machine.values
    if of_energy or grip_of(machine):
        others: dict[str, object] = {
            "families": families, "watch": watch, "stop_inadmissible": stop_inadmissible or None, "method": method,
            "output": output, "resume": resume, "tune": tune,
        }  # fmt: skip
        if not of_energy:
            others |= {"family": None if family == 1 else family, "multipliers": multipliers or None}
        what = "along its energy" if of_energy else "of swings"
        if stated := [name for name, value in others.items() if value is not None]:
            raise InputError(f"a family {what} is followed without {stated[0]}=")
        steps = options.steps(step_control.largest_batch)
        if of_energy and (start is None or isinstance(start, Real | Mapping | Oscillation)):
            return follow_energy(machine, stop, start, family_number(family), options.at, steps, progress)
        if not of_energy and (start is None or isinstance(start, Real | Mapping | Swing)):
            return follow_swings(machine, along, stop, start, options.at, steps, progress)
        one = "an energy, or at an oscillation" if of_energy else "a value of its parameter, or at a swing"
        raise InputError(f"a family {what} starts at {one}")
    if isinstance(start, Oscillation | Swing):
        raise InputError("an oscillation begins a family along its energy alone: along='energy'")
    first = start

    def followed(number: int, progress: Progress) -> Family:
        def begun(stop: Stop, resume: Family | None) -> FamilyRun:
            try:
                return begin_run(machine, along, first, stop, number, method, options, resume, tune)
            except TimeOver as over:
                raise over.reached("the first orbit is not found yet") from None

        if is_range(stop):
            return both_ways(begun, stop, collect_family, resume, output, progress)
        return collect_family(begun(stop, resume), resume, output, progress)

    if families is None:
        return followed(family, progress)
    if family != 1 or output is not None or resume is not None or not (start is None or isinstance(start, Real)):
        raise InputError("several families start from their own orbits: leave out family, start, output and resume")
    return followed_families(numbers_of_families(families), followed, progress)


@exclusive
def trace(
    machine: Machine, along: str, stop: Stop, start: StartLike | float | None = None, family: int = 1, **options: object
) -> Iterator[Orbit | Event | End]:
    """The orbits of a family one by one, as `follow` finds them: each `Orbit`, each `Event` before the orbit that
    follows it, and finally the `End`. It takes the options of `follow`, from `tune` to `method`, and raises the same
    errors. If `stop` is a range, the orbits go one way, from the start to the last value; the first value is a bound
    behind the start.

    >>> from orbits import trace
    >>> from problems import Hopper
    >>> hops = trace(Hopper("cubic"), "beta", 0.01, start=0.0)
    >>> round(next(hops).alpha, 6), list(hops)[-1].kind
    (4.493409, 'reached')
    """
    known = [field.name for field in fields(Options)]
    method, tune = options.pop("method", None), options.pop("tune", None)
    if unknown := options.keys() - set(known):
        raise InputError(f"trace has no option '{min(unknown)}'; it knows {', '.join(known)}, method and tune")
    return _orbits(begin_run(machine, along, start, stop, family, method, checked_options(**options), None, tune))


def _orbits(run: FamilyRun) -> Iterator[Orbit | Event | End]:
    """The items of a run, its points as orbits; between items interrupts are raised and other threads may compute."""
    items, item = _one_by_one(run), None
    while not isinstance(item, End):
        with LOCK, running("trace"), interrupts.deferred():
            item = next(items)
        yield item


def _one_by_one(run: FamilyRun) -> Iterator[Orbit | Event | End]:
    """The items of a run in the form that is returned to the user."""
    for item in run:
        if isinstance(item, Points):
            yield from (run.curve.orbit(item[i : i + 1]) for i in range(len(item)))
        else:
            yield replace(item, point=run.curve.in_units(item.point)) if isinstance(item, Event) else item


@exclusive
def follow_branch(
    machine: Machine,
    branch: Point,
    along: str,
    stop: float,
    *,
    upper: bool = True,
    at: Sequence[float] = Options.at,
    watch: Watch | None = None,
    longest: float = Options.longest,
    most: int = Options.most,
    step_control: StepControl = Options.step_control,
    method: str | None = None,
    output: str | Path | None = None,
) -> Family:
    """Follow the other curve through a branch point of a family, from a first step on.

    machine, along, method : as the family was followed with; method None for the simplest
    branch : the point of a "branch point" event
    stop : last value of the parameter; the curve also ends where it returns to the branch point's value
    upper : whether to start towards higher launch speeds, instead of lower ones
    at, watch, longest, most, step_control, output : as in `follow`

    The direction is the one across the curve in which the equations do not change to first order (Keller 1977). Raises
    `NoOrbit` when no other curve goes through the point, and `InputError` when it leads away from `stop`.
    """
    machine, method = machine_at(machine, branch, along, method)
    options, stop = checked_options(at, watch, longest, most, False, step_control), finite_number("stop", stop)
    check_output(output)
    if stop == branch.value:
        raise InputError(f"stop = {stop:g} is the branch point itself: choose another stop")
    curve = curve_at(machine, along, method, abs(stop - branch.value), tuned_at(machine, branch, along), branch)
    x = np.array([*branch.u, branch.value])
    size = curve.size(x)
    with interrupts.deferred(), without_units(curve.units_at(branch.value)):
        *_, first, second = np.linalg.svd(curve.evaluate(x[None]).jacobian[0] * size)[2]
        own = branch.tangent / size
        across = first * (second @ own) - second * (first @ own)
        side = across[curve.equations.statement.unknowns.index("alpha")]
        across *= np.copysign(1.0 / np.linalg.norm(across), side if upper else -side)
        problem = FamilyProblem(curve, options)
        step = _first_point(problem, x, across * size, across / size, step_control.first_step)
        if ((value := float(step.values[0])) - branch.value) * (stop - branch.value) < 0:
            way = f"towards {'higher' if upper else 'lower'} launch speeds {along} goes to {value:.6g}, away from"
            raise InputError(f"{way} stop = {stop:g}: give upper = {not upper} or a stop on the other side")
        run = FamilyRun(problem, step, branch.value, stop, options)
    return collect_family(run, output=output)


def _first_point(problem: FamilyProblem, x, direction, row, first_step: float) -> Points:
    """The first point (1) of the other curve, one step across from `x`, or a shorter step where that leads
    elsewhere."""
    curve = problem.curve
    for length in first_step * np.logspace(0, -3, 4):
        try:
            step = problem.solved(x + length * direction, row, row @ x + length, direction)
        except NoOrbit:
            continue
        if np.linalg.norm((step.xs[0] - x) / curve.size(x)) < LONGEST_FIRST_STEP * length:
            return step
    raise NoOrbit(f"no other curve is found near {curve.along} = {x[-1]:.10g}")


@exclusive
def orbit_at(machine: Machine, point: Point, along: str, method: str | None = None) -> Orbit:
    """The whole orbit at a point of a family, with its motion.

    machine, along, method : as the family was followed with; method None for the simplest
    point : of the family, or of one of its events

    Raises `NoOrbit` where the orbit cannot be certified, and `InputError` for an unknown parameter or method.

    >>> from orbits import follow, orbit_at
    >>> from problems import Hopper
    >>> machine = Hopper("cubic", rest_length=9.0)
    >>> family = follow(machine, "beta", 0.3, start=0.2)
    >>> round(orbit_at(machine, family[-1], "beta").flight_time, 6)
    5.872918
    """
    machine, method = machine_at(machine, point, along, method)
    curve = curve_at(machine, along, method, 1.0, tuned_at(machine, point, along), point)
    x, row = np.array([*point.u, point.value]), np.array(point.tangent)
    with interrupts.deferred(), without_units(curve.units_at(point.value)):
        problem, known = FamilyProblem(curve, Options()).known(x, row, row)
        return problem.curve.orbit(problem.certified_at(known, point.value))


def is_range(stop: object) -> TypeGuard[tuple[float, float]]:
    """Whether the last value of a parameter is a pair of bounds."""
    return isinstance(stop, tuple | list) and len(stop) == 2


def bounds_of(along: str, start: float, stop: Any, at: Sequence[float] = ()) -> tuple[float, float]:
    """The bounds behind the start and ahead of it; `stop` states one or both. The values `at` must lie between them."""
    behind, ahead = stop if is_range(stop) else (start, stop)
    behind, ahead = finite_number("stop", behind), finite_number("stop", ahead)
    if is_range(stop) and start == ahead:
        behind, ahead = ahead, behind
    if start == ahead:
        raise InputError(f"{along} goes from {start:g} to {ahead:g}: choose another stop")
    if not (abs(ahead - start) >= SHORTEST_CURVE and abs(ahead - behind) <= 1 / SHORTEST_CURVE):
        bounds = f"its range must have a length from {SHORTEST_CURVE:g} to {1 / SHORTEST_CURVE:g}"
        raise InputError(f"{along} goes from {behind:g} to {ahead:g}: {bounds}; state the parameter in another unit")
    if (behind - start) * (ahead - start) > 0:
        bounds = f"({behind:g}, {ahead:g}): {along} starts at {start:g}, which is not between them"
        raise InputError(f"stop = {bounds}: give bounds around it, or another start")
    if outside := [value for value in at if not min(behind, ahead) <= value <= max(behind, ahead)]:
        raise InputError(f"at = {outside[0]:g} is not reached: {along} goes from {behind:g} to {ahead:g}")
    return behind, ahead


def begin_run(
    machine: Machine, along: str, start: StartLike | float | None, stop: Any, family: int | None, method: Any,
    options: Options, resume: Family | None = None, tune: Any = None,
    located: tuple[Sequence[str], float] | None = None,
) -> FamilyRun:  # fmt: skip
    """A run from the first orbit, or from the last of a family that is resumed; `located` as in `FamilyRun`."""
    family = None if family is None else family_number(family)
    orbit, start = (start, None) if isinstance(start, Orbit | Mapping | str | Path) else (None, start)
    tuned = checked_tuning(machine, along, tune)
    if resume is not None and not (isinstance(resume, Family) and resume.settings.get("tune", []) == [*tuned]):
        raise InputError("resume takes a family of `follow` with the same `tune`, such as Family.load returns")
    if tuned and resume is None:
        return _begin_tuned(machine, along, orbit, start, stop, family, method, options, tuned, located)
    if start is None:
        start = machine.values[along] if resume is None else resume.settings["start"]
    start = finite_number("start", start)
    behind, stop = bounds_of(along, start, stop, options.at)
    machine = machine if is_quantity(machine, along) else machine.with_values(**{along: start})
    if resume is not None:
        if (family, method or resume.settings["method"]) != (resume.settings["family"], resume.settings["method"]):
            which = f"number {resume.settings['family']}, by the method '{resume.settings['method']}'"
            raise InputError(f"the family to resume is {which}: pass the same")
        return _resumed(machine, along, behind, stop, resume, options, located)
    with interrupts.deferred(), without_units(machine.units):
        family, method = 1 if family is None else family, method_of(machine.model, method)
        check_start(machine, orbit)
        orbit = start_in_file(orbit) if isinstance(orbit, str | Path) else orbit
        solved = _of_family(machine, family, method) if orbit is None else solve_near(machine, orbit, method)
        curve = Curve(machine, along, iterative(solved.method), abs(stop - behind))
    run = start_run(curve, np.append(solved.us[0], start), start, behind, stop, options, located=located)
    if orbit is None and run.point.family != family:
        raise NoOrbit(another_family(family, run.point.family))
    return run


def _begin_tuned(
    machine, along, orbit, start, stop, family, method, options, tuned: tuple[str, ...], located
) -> FamilyRun:
    """A run with tuned parameters from the machine's own orbit, or from the one with the first value."""
    if method not in (None, METHOD):
        raise InputError(f"method '{method}' tunes no parameters; leave it out")
    if start is not None:
        start = finite_number("start", start)
    if not is_quantity(machine, along):
        machine = machine.with_values(**({} if start is None else {along: start}))
    prescribed = {along: start} if is_quantity(machine, along) else {}
    first, solved = first_tuned(machine, orbit, family, tuned, prescribed)
    machine = machine.with_values(**tuned_values(solved.equations, solved.us[0]))
    value = float(solved.ps[0, solved.equations.parameters.index(along)])
    behind, stop = bounds_of(along, value, stop, options.at)
    x = np.append(solved.us[0], value)
    curve = TunedCurve(machine, along, tuned, abs(stop - behind), x)
    run = start_run(curve, x, value, behind, stop, options, located=located)
    wanted: Any = first or (family if orbit is None else None)
    if wanted not in (None, run.point.family):
        raise NoOrbit(another_family(wanted, run.point.family))
    return run


def _of_family(machine: Machine, family: int, method: str) -> Solved:
    """The solution of the orbit that `find` returns for a family. Where the first solution is taken for the lowest
    orbit, it is certified together with the points that follow."""
    search = machine.model.search and machine.model.search(machine.values)
    if (search is None or search.single) and not LinearSearch.finds_families(machine):
        try:
            return solve_family(machine, family, method)
        except NoOrbit:
            if search is None:
                raise
    with time_limit(None):
        lowest = lowest_of_family(machine, family, method)
    return solve_near(machine, lowest, method)


def start_run(
    curve: Curve, x: np.ndarray, start: float, behind: float, stop: float, options: Options,
    kind: type[Endings] = Endings, located: tuple[Sequence[str], float] | None = None,
) -> FamilyRun:  # fmt: skip
    """A run from near `x` (n + 1,), where the parameter has the value `start`, towards `stop`; `kind` and `located` as
    in `FamilyRun`."""
    with interrupts.deferred(), without_units(curve.units_at(start)):
        along_parameter = np.eye(len(x))[-1]
        problem = FamilyProblem(curve, options)
        problem, first = problem.known(x, along_parameter, along_parameter * np.sign(stop - start))
        if isinstance(curve, TunedCurve):
            check_determined(*problem.curve.solutions(first))
        return FamilyRun(problem, first, behind, stop, options, kind=kind, located=located)


def _resumed(machine, along: str, behind: float, stop: float, resume: Family, options: Options, located) -> FamilyRun:
    """A run from the last point of a family, in the direction in which the family was followed."""
    _check_resumable(machine, along, behind, stop, resume)
    last, settings = resume.points[-1], resume.settings
    curve = curve_at(machine, along, settings["method"], abs(stop - behind), settings.get("tune", ()), last)
    _check_unknowns(last, curve)
    x, tangent = np.array([*last.u, last.value]), np.array(last.tangent)
    with interrupts.deferred(), without_units(curve.units_at(last.value)):
        problem, first = FamilyProblem(curve, options).known(x, tangent / curve.size(x) ** 2, tangent)
        first = problem.certified_at(first, last.value)
        earlier = [curve.dimensionless(point) for point in resume.points[:-1]]
        return FamilyRun(problem, first, behind, stop, options, earlier, located=located)


def _check_unknowns(point: Point, curve: Curve) -> None:
    """Raise `InputError` where a point of a family does not have the unknowns of a curve's equations."""
    names = curve.equations.statement.unknowns
    if len(point.u) != len(names):
        raise InputError(
            f"a point of the family has {len(point.u)} unknowns, but its equations have {', '.join(names)}"
        )


def _check_resumable(machine: Machine, along: str, behind: float, stop: float, resume: Family) -> None:
    """Raise `InputError` where a family belongs to another machine, or has already reached its end."""
    mine, theirs = machine_in_words(machine), dict(resume.machine)
    for name in (along, *resume.settings.get("tune", ()), "parameters"):
        mine.pop(name, None), theirs.pop(name, None)
    varied = (along, *resume.settings.get("tune", ()))
    others = {name: value for name, value in resume.machine["parameters"].items() if name not in varied}
    other = any(machine.values.get(name) != value for name, value in others.items())
    if along != resume.name or mine != theirs or other:
        which = f"{resume.machine} along {resume.name}"
        raise InputError(f"the family to resume has another machine or parameter: {which}")
    if not resume.points:
        raise InputError("the family to resume has no points: start it anew")
    if resume.end.kind == "closed":
        raise InputError("the family to resume has closed: nothing is left to follow")
    last = resume.points[-1]
    if not min(behind, stop) <= last.value <= max(behind, stop):
        where = f"{along} = {last.value:g}, not between {behind:g} and {stop:g}"
        raise InputError(f"the family to resume has reached {where}")
    if (last.value - stop) * (stop - behind) >= 0 and last.tangent[-1] * (stop - behind) > 0:
        raise InputError(f"the family to resume has reached {along} = {stop:g} already")
