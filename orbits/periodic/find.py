"""Find one lossless orbit: the simplest statement that the machine allows, solved, measured and certified."""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..consistency.accepted import check_machine
from ..errors import FlowError, InputError, NoOrbit, finite_number
from ..laws.law import NOISE
from ..model.machine import Machine
from ..model.model import Model
from ..running import interrupts
from ..running.exclusive import exclusive
from ..running.time_limit import time_limit
from ..units import LIFTOFF_SPEED, TIME, Message, Quantity, in_own_units, in_units
from .certificate import certify
from .error_bound import error_bounds, noise_of_alpha
from .family_search import Cells, Lateness
from .formulations import contact_reversor, equations_of, interpret, or_none, vector
from .homotopy import solve_by_homotopy
from .orbit import Orbit, Shape, orbit_of, start_in_file
from .single_shooting import Evaluation, Shooting

Progress: TypeAlias = Callable[[float], None] | None  # called with the share that is done
METHODS = ("closed form", "relative", "half orbit", "shooting")
LARGEST_FAMILY = 10_000
# Orbits whose launch speeds, times and states agree to this share are the same.
SAME_ORBIT = 1e-9
# A start with a longer time than this describes no machine in its own units, and would take long to integrate.
LONGEST_START = 1e4


class Root(NamedTuple):
    """A solution (n,) of a method's equations, these there, and a bound on the error of alpha where it is known."""

    u: np.ndarray
    evaluation: Evaluation
    error: float | None = None


@exclusive
def find(
    machine: Machine,
    family: int | None = None,
    *,
    start: Orbit | Mapping[str, float] | str | Path | None = None,
    method: str | None = None,
    progress: Progress = None,
    limit: float | None = None,
) -> Orbit:
    """Find the lossless orbit of a family, with its certificate.

    machine : a `problems.Hopper`, a `problems.Juggler`, or anything with their `model`, `values`, `describe`, `units`
    family : from 1, which is what None means; family n has n + 1 stationary points of the extension from lift-off to
        mid-flight
    start : an orbit nearby, the file of one, which may have been changed since it was written, or the unknowns of a
        half orbit by name, to start from instead of the model's guess; an orbit of any family is then returned, unless
        `family` is given too
    method : one of `METHODS`, None for the simplest that the machine allows; "shooting" is multiple shooting by Ipopt
    progress : called with the share of the homotopy that is done, where there is one
    limit : how many seconds it may take; None for 30, or as many as a `time_limit` around it allows

    Where a family has several orbits, this is the one of least launch speed. A machine whose laws bend often, or there
    and back at once, is searched for all of them as by `find_all`, and so is one where none is found otherwise. For
    others it is the first under constant gravity, or what that becomes as gravity's variation is brought in, and its
    `known_in_family` is None. It may be inadmissible: see its `violations`. Raises `NoOrbit` when there is none or a
    solve ends on another family or takes longer, and `InputError` for a family, method or limit that cannot be.

    >>> from orbits import find
    >>> from problems import Hopper
    >>> orbit = find(Hopper("cubic", rest_length=8.0, parameters={"beta": 0.3}))
    >>> round(orbit.alpha, 9), orbit.admissible
    (2.936459188, True)
    """
    check_machine(machine)
    number = None if family is None else _family_number(family)
    if isinstance(start, str | Path):
        start = start_in_file(start)
    with interrupts.deferred(), time_limit(limit):
        return _found_from(machine, number, start, method, progress)


@in_own_units(lambda orbit, machine: orbit_of(machine, orbit), start=())
def _found_from(machine: Machine, family: int | None, start: Any, method: str | None, progress: Progress) -> Orbit:
    """The orbit of a family, or the one that a start leads to."""
    if start is None:
        return lowest_of_family(machine, family or 1, method, progress)
    began = time.perf_counter()
    method, root = solve_near(machine, start, method)
    orbit = certified_orbit(machine, method, *root, began=began)
    if family not in (None, orbit.family):
        raise NoOrbit(f"the start leads to an orbit of family {orbit.family}, not {family}")
    return orbit


@exclusive
def find_all(
    machine: Machine,
    starts: Iterable[Orbit | Mapping[str, float]] | None = None,
    *,
    family: int | None = None,
    fastest: float | None = None,
    method: str | None = None,
    progress: Progress = None,
    limit: float | None = None,
) -> tuple[Orbit, ...]:
    """All orbits of a family, or the different ones that `find` comes to from several starts, by launch speed.

    family : as in `find`, where no starts are given
    fastest : the largest launch speed that is searched for a family; None for 1e4 times the family in multiples of the
        inverse root of the spring's slope at rest, and 30 times where gravity varies and where the spring has a narrow
        feature or bends often. The slowest is 1e-3 in these multiples.
    progress : called with the share that is done of the launches that lie near an orbit, or of the starts
    limit : how many seconds the search may take, or each start, as in `find`

    The orbits of a family are the zeros of one function of the launch speed (see `family_search`), whose bends between
    sampled speeds are taken to be at most four times those that its second differences show: no proof, but the samples
    go where that matters. A search that is stopped after 20,000 launches may miss some. Starts that lead to no orbit
    are left out. Raises `NoOrbit` where there is none, with what was searched or the last reason.

    >>> from orbits import find_all
    >>> from problems import Hopper
    >>> hops = find_all(Hopper("cubic", rest_length=30.0, parameters={"beta": -0.005}), family=1)
    >>> [round(hop.alpha, 4) for hop in hops]
    [4.7432, 9.924]
    """
    if starts is None:
        check_machine(machine)
        if fastest is not None and not finite_number("fastest", fastest) > 0:
            raise InputError(f"fastest = {fastest:g} is no launch speed; it lies above 0")
        family, method = _family_number(1 if family is None else family), _possible_method(machine.model, method)
        with interrupts.deferred(), time_limit(limit):
            return _orbits_of_family(machine, family, method, fastest, progress)
    if family is not None or fastest is not None:
        raise InputError("find_all takes starts, or a family with the fastest launch speed to search, not both")
    if isinstance(starts, Mapping | Orbit | int):
        raise InputError("starts is a list of starts: for one there is find(machine, start=...); or give family=")
    found, reason, starts = list[Orbit](), None, list(starts)
    for i, start in enumerate(starts):
        if progress:
            progress(i / len(starts))
        try:
            orbit = find(machine, start=start, method=method, limit=limit)
            if not any(_same(orbit, other) for other in found):
                found.append(orbit)
        except NoOrbit as error:
            reason = error
    if reason and not found:
        raise NoOrbit(f"none of the starts leads to an orbit; the last: {reason}")
    return tuple(sorted(found, key=lambda orbit: orbit.alpha))


@in_own_units(lambda orbits, machine: tuple(orbit_of(machine, orbit) for orbit in orbits), fastest=LIFTOFF_SPEED)
def _orbits_of_family(
    machine: Machine, family: int, method: str | None, fastest: float | None, progress: Progress
) -> tuple[Orbit, ...]:
    """`_all_of_family` of a machine that may have units."""
    return _all_of_family(machine, family, method, fastest, progress)


def lowest_of_family(machine: Machine, family: int, method: str | None, progress: Progress = None) -> Orbit:
    """The orbit of a family of least launch speed, as in `find`."""
    model, began = machine.model, time.perf_counter()
    search = model.search(machine.values) if model.search and model.reversor else None
    if search and not model.is_guessed:
        orbits = _all_of_family(machine, family, method, progress=progress)
        return replace(orbits[0], seconds=time.perf_counter() - began)
    try:
        solved_by, root = solve_family(machine, family, method, progress)
        orbit = certified_orbit(machine, solved_by, *root, began=began)
        if orbit.family != family:
            raise NoOrbit(another_family(family, orbit.family))
    except NoOrbit as error:
        if search is None:
            raise
        try:
            orbits = _all_of_family(machine, family, method, refusal=str(in_units(error, None)))
            return replace(orbits[0], seconds=time.perf_counter() - began)
        except NoOrbit as none:
            raise with_search(error, none) from None
    if search is None or search.single or solved_by == "closed form":
        return orbit
    try:
        orbits = _all_of_family(machine, family, method)
    except NoOrbit:
        orbits = ()
    orbits = (orbit, *(other for other in orbits if not _same(orbit, other)))
    lowest = min(orbits, key=lambda one: one.alpha)
    return replace(lowest, known_in_family=len(orbits), seconds=time.perf_counter() - began)


def _all_of_family(
    machine: Machine, family: int, method: str | None, fastest: float | None = None, progress: Progress = None,
    refusal: str = "",
) -> tuple[Orbit, ...]:  # fmt: skip
    """All orbits of a family, as in `find_all`; what is said with a `refusal` already is not said again."""
    model, p, began = machine.model, machine.values, time.perf_counter()
    if not (model.search and model.reversor):
        raise InputError(f"the families of a {model.name} are not searched: give find_all starts")
    method = _possible_method(model, method)
    if method == "closed form":
        _, root = solve_family(machine, family, method)
        only = certified_orbit(machine, method, *root, began=began)
        if only.family != family:
            raise NoOrbit(another_family(family, only.family))
        if fastest is not None and only.alpha > fastest:
            text = "the only orbit of family {family} has the launch speed {alpha:.6g}, above {fastest:g}"
            speeds = {"alpha": Quantity(only.alpha, LIFTOFF_SPEED), "fastest": Quantity(fastest, LIFTOFF_SPEED)}
            raise NoOrbit(Message(text, family=family, **speeds))
        return (replace(only, known_in_family=1),)
    solved_by = "relative" if method == "relative" else "half orbit"
    lateness = Lateness(model, solved_by, tuple(p), vector(p)[None], family, [model.search(p)])
    found, refused = list[Orbit](), Message("")
    (cells,) = lateness.cells(fastest)
    for i, (cell, about) in enumerate(zip(cells.cells, cells.abouts, strict=True)):
        if progress:
            progress(i / len(cells.cells))
        try:
            orbit = _orbit_in_cell(machine, lateness, cell, about)
            if orbit and not any(_same(orbit, other) for other in found):
                found.append(orbit)
        except NoOrbit as error:
            text = "; the one near {about:.6g} is refused" + ("" if in_units(error, None) in refusal else ": {error}")
            refused = Message(text, about=Quantity(float(about), LIFTOFF_SPEED), error=error)
    if not found:
        raise none_found(cells, refused)
    return tuple(replace(orbit, known_in_family=len(found)) for orbit in found)


def none_found(cells: Cells, refused: str = "") -> NoOrbit:
    """The error of a search that finds no orbit; `refused` is what it says of those that it had to refuse."""
    text = "a search from launch speed {low:.3g} to {high:.4g}{stopped} finds none{refused}"
    stopped = f", stopped after {cells.launches} launches," if cells.stopped else ""
    low, high = (Quantity(speed, LIFTOFF_SPEED) for speed in cells.searched)
    return NoOrbit(Message(text, low=low, high=high, stopped=stopped, refused=refused))


def with_search(error: NoOrbit, none: NoOrbit) -> NoOrbit:
    """The error of a family of which the guess led to no orbit, and of which a search found none either."""
    if in_units(none, None) in in_units(error, None):
        return error
    return type(error)(Message("{error}; {none}", error=error, none=none))


def _orbit_in_cell(machine: Machine, lateness: Lateness, cell: np.ndarray, about: float) -> Orbit | None:
    """The orbit of a lateness's family in a cell (2,) of launch speeds, about a speed in it; None where it has none.

    Raises `NoOrbit` where the orbit cannot be certified, and where Newton's method does not come to one.
    """
    equations, p = equations_of(machine.model, lateness.method, tuple(machine.values)), vector(machine.values)
    for alpha in (about, None):
        began = time.perf_counter()
        try:
            (start,) = lateness.start(np.array([lateness.enclosed(cell) if alpha is None else alpha]))
            orbit = certified_orbit(machine, lateness.method, *equations.newton(start, p), began=began)
        except NoOrbit:
            if alpha is None:
                raise
            continue
        if orbit.family == lateness.family and cell[0] <= orbit.alpha <= cell[1]:
            return orbit
    return None


def solve_family(machine: Machine, family: int, method: str | None, progress: Progress = None) -> tuple[str, Root]:
    """The method, and the solution that it finds for a family, as in `find`; not certified to be of that family."""
    family, model, p = _family_number(family), machine.model, dict(machine.values)
    method, equations, correct = _opening(machine, method)
    if method == "closed form" and model.reduction and model.reduction.exact:
        unknowns, error = model.reduction.exact(family, p)
        u = vector(unknowns)
        return method, Root(u, equations.evaluate_all(u[None], vector(p)[None]), error)
    return method, Root(*solve_by_homotopy(model, equations, correct, family, p, progress))


def solve_near(machine: Machine, start: Orbit | Mapping[str, float], method: str | None) -> tuple[str, Root]:
    """The method, and the solution that it finds from a start, as in `find`."""
    method, equations, correct = _opening(machine, method, closed_form="relative")
    stated = _stated_unknowns(machine.model, dimensionless_start(start, machine))
    names = equations.statement.unknowns
    if missing := [name for name in names if name not in stated]:
        raise InputError(f"start has no '{missing[0]}'; the unknowns are {', '.join(names)}")
    try:
        return method, Root(*correct(np.array([stated[name] for name in names]), vector(machine.values)))
    except FlowError as error:
        raise NoOrbit(Message("the start cannot be followed: {error}", error=error)) from None


def _opening(machine: Machine, method: str | None, closed_form: str = "closed form") -> tuple[str, Shooting, Callable]:
    """The method to take, with another name for the closed form, its equations, and what solves them."""
    method = _possible_method(machine.model, method)
    method = closed_form if method == "closed form" else method
    equations = equations_of(machine.model, method, tuple(machine.values))
    return method, equations, equations.multiple_shooting if method == "shooting" else equations.newton


def certified_orbit(
    machine: Machine, method: str, u: np.ndarray, evaluation: Evaluation, error: float | None = None, *, began: float
) -> Orbit:
    """The certified orbit of a solution `u` (n,) of a method's equations, whose evaluation there has one point.

    An `error` of alpha that is not known is measured; the search `began` at that `time.perf_counter`. Raises `NoOrbit`
    when the orbit cannot be certified.
    """
    model, p = machine.model, machine.values
    equations = equations_of(model, method, tuple(p))
    us, ps, errors = np.reshape(u, (1, -1)), vector(p)[None], np.array([error])
    if error is None:
        errors, refused = error_bounds(equations, us, ps, evaluation)
        if refused:
            raise refused[0]
    cycles = interpret(model, method, equations, us, ps, evaluation, errors)
    (certificate,) = certify(model, cycles)
    if noise := [name for name in p if name.startswith(NOISE)]:
        certificate = replace(certificate, alpha_noise=noise_of_alpha(equations, us[0], ps[0], evaluation, noise))
    reversor = contact_reversor(model.reversor, model.embed) if model.reversor else None
    knees = tuple(model.knees(p)) if model.knees else ()
    return Orbit(
        machine=machine.describe(),
        alpha=float(cycles.u["alpha"][0]),
        liftoff_extension=float(model.liftoff_extension(cycles.u, cycles.p)[0]),
        flight_time=float(cycles.flight_times[0]),
        contact_time=or_none(cycles.contact_times)[0],
        flight=cycles.flight[0],
        contact=cycles.contacts[0] if cycles.contacts else None,
        shape=Shape(model.reversor, reversor, model.embed, model.heights(p), model.springs, knees),
        certificate=certificate,
        method=method,
        skipped=_skipped(model, p, method, any(flow.compiled for flow in equations.flows)),
        seconds=time.perf_counter() - began,
        source=machine,
    )


def another_family(wanted: int, found: int) -> str:
    """The message about a solve for one family that ends on another."""
    return f"the solve for family {wanted} ended on an orbit of family {found}; try another method"


def _same(a: Orbit, b: Orbit) -> bool:
    x, y = ([orbit.alpha, orbit.flight_time, *orbit.flight(0.0)] for orbit in (a, b))
    return np.allclose(x, y, rtol=SAME_ORBIT, atol=SAME_ORBIT * max(map(abs, x)))


def _stated_unknowns(model: Model, start: Orbit | Mapping[str, float]) -> dict[str, float]:
    """The unknowns that a start states, by name; raises `InputError` for a start that is none."""
    if isinstance(start, Orbit):
        if start.flight.names[: len(model.flight.states)] != model.flight.states:
            raise InputError(f"start is an orbit of another machine, with the states {', '.join(start.flight.names)}")
        unknowns = model.launch_at(start.flight.coefficients[0, :, 0].tolist()) | {"alpha": start.alpha}
        unknowns["duration"] = start.flight_time / (2 if start.shape.reversor else 1)
        unknowns["unfolding"] = start.certificate.unfolding or 0.0
        return unknowns | ({} if start.contact_time is None else {"contact_duration": start.contact_time / 2})
    if not isinstance(start, Mapping):
        raise InputError(f"start = {start!r}; it is an orbit, or a mapping of unknowns to numbers")
    # Two unknowns may be stated although not every statement asks for them.
    if unknown := [name for name in start if name not in {*model.half_unknowns, "contact_duration", "unfolding"}]:
        raise InputError(f"start has '{unknown[0]}'; the unknowns are {', '.join(model.half_unknowns)}")
    stated = {"unfolding": 0.0, **{name: finite_number(f"start '{name}'", value) for name, value in start.items()}}
    for name in ("duration", "contact_duration"):
        if not 0 < stated.get(name, 1.0) < LONGEST_START:
            text, times = "start '{name}' = {time:g}; it lies between 0 and {most:g}", (stated[name], LONGEST_START)
            time, most = (Quantity(number, TIME) for number in times)
            raise InputError(Message(text, name=name, time=time, most=most))
    return stated


def dimensionless_start(start: Any, machine: Machine) -> Any:
    """A start in the units of the engine: those of a machine in SI are in SI."""
    if isinstance(start, Orbit):
        return start.dimensionless()
    if machine.units is None or not isinstance(start, Mapping):
        return start
    return machine.units.without("start", start)


def _family_number(family: int) -> int:
    if isinstance(family, bool) or not isinstance(family, int | np.integer) or not 1 <= family <= LARGEST_FAMILY:
        raise InputError(f"family = {family!r}; a family is a whole number from 1 to {LARGEST_FAMILY}")
    return int(family)


def _possible_method(model: Model, method: str | None) -> str:
    """The method asked for, or the simplest that the model allows; raises `InputError` for one that it does not."""
    reduction = model.reduction
    needs = {
        "closed form": ("a straight-line spring and constant gravity", reduction and reduction.exact),
        "relative": ("two masses and constant gravity", reduction),
        "half orbit": ("a reversor", model.reversor),
        "shooting": ("", True),
    }
    if method is None:
        return next(name for name in METHODS if needs[name][1])
    if method not in METHODS:
        raise InputError(f"unknown method '{method}'; known: {', '.join(METHODS)}")
    if not needs[method][1]:
        raise InputError(f"method '{method}' needs {needs[method][0]}; leave it out for the simplest way")
    return method


def _skipped(model: Model, p: Mapping, method: str, compiled: bool) -> tuple[str, ...]:
    """What the method did without, in words."""
    few, share = method in ("relative", "half orbit"), "only its first half" if model.reversor else "once"
    integrated = f"{share}, for its duration and the checks, not for the search"
    skipped = {
        "flight: closed form, nothing integrated": method == "closed form",
        "search: one scalar equation, no solver": method == "closed form",
        "flight: the extension alone is integrated, 2 states of 4": method == "relative",
        "flight: half of it, by time reversal": few or (method == "shooting" and bool(model.reversor)),
        "search: Newton on a few unknowns from a measured guess, no Ipopt": few,
        f"contact: {'closed form' if model.contact.closed_form else integrated}": True,
        "separation of the masses: no rest length given": model.separation(p) is None,
        "compilation: nothing that repays it": not compiled,
    }
    return tuple(words for words, applies in skipped.items() if applies)
