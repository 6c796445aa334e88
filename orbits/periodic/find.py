"""Find one lossless orbit: the simplest statement that the machine allows, solved, measured and certified."""

import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FlowError, InputError, NoOrbit, finite_number
from ..model import STEP_LENGTH, Machine, check_machine, dimensionless, refuse_hysteresis
from ..result import Progress
from ..running import exclusive, interrupts, time_limit
from ..shooting import equations_of, iterative, method_of
from ..units import Message, in_own_units, without_units
from .certification import Solved, certified_orbit, solve_from
from .family_orbits import another_family, family_number, lowest_of_family, orbits_of_family, same_orbit
from .orbit import Orbit, orbit_of, start_in_file
from .range_of_law import with_needed_range
from .start import StartLike, check_start, stated_unknowns
from .start_of_run import RUN_START, run_along_speeds, run_start
from .tuned_extremes import with_extremes
from .tuned_orbits import (
    OF_STEPS,
    Tuning,
    errors_of_tuned,
    solve_tuned,
    tuned_equations,
    tuned_values,
    tuning_of,
)

# The search for a run begins at these multiples of the slowest start, at the later ones where the others lead nowhere.
FASTER_STARTS = (1.0, 2.0, 3.0, 5.0, 1.5, 2.5, 4.0)


@exclusive
def find(
    machine: Machine,
    family: int | None = None,
    *,
    start: StartLike | None = None,
    method: str | None = None,
    tune: str | Iterable[str] | None = None,
    at: Mapping[str, float] | None = None,
    progress: Progress = None,
    limit: float | None = None,
) -> Orbit:
    """Find the lossless orbit of a family, with its certificate.

    machine : a `problems.Hopper`, a `problems.Juggler`, a `Mechanism`, or another `Machine` with `model`, `values`,
        `describe` and `units`
    family : its number, from 1; None is 1. Family n has n + 1 stationary points of the extension from lift-off to
        mid-flight
    start : the initial guess, instead of the model's own: an orbit nearby, the name of a file of one, or the unknowns
        of a half orbit by name. The orbit that is found may be of any family, unless `family` is stated too. A file is
        only a guess, and may have been edited
    method : "closed form", "relative", "half orbit", or "shooting", which is multiple shooting by Ipopt; None for the
        simplest that the machine allows
    tune : names of parameters that are unknowns too, one for each quantity in `at`; the search begins at their values
        in the machine, whose own orbit leads to the one that is returned
    at : values of quantities of the orbit by name, in the machine's units, such as "period", "frequency", "alpha",
        "clearance" or the rise of a height
    progress : called with the completed share of the homotopy, where there is one
    limit : time limit in seconds; None for 30 s of processor time, or for the limit of a `time_limit` around it

    Where a family has several orbits, the one of least launch speed is returned. To know it, all orbits are searched as
    by `find_all` where the laws of the machine have many or narrow bends, and where none is found otherwise. For other
    machines the orbit is the first one under constant gravity, or the one continued from it to the varying gravity; its
    `known_in_family` is None, since others are not searched for. The orbit may be inadmissible: see its `violations`.
    Raises `NoOrbit` when there is no orbit, when a solution belongs to another family, or when the limit is reached,
    and `InputError` for an invalid family, method or limit. Source: eqs. (9) to (12) of the paper, and its section 9
    for the symmetry.

    >>> from orbits import find
    >>> from problems import Hopper
    >>> orbit = find(Hopper("cubic", rest_length=8.0, parameters={"beta": 0.3}))
    >>> round(orbit.alpha, 9), orbit.admissible
    (2.936459188, True)
    """
    check_machine(machine)
    number = None if family is None else family_number(family)
    if isinstance(start, str | Path):
        start = start_in_file(start)
    tuning = None if tune is None and at is None and not machine.model.sticks else tuning_of(machine, tune, at)
    with interrupts.deferred(), time_limit(limit):
        if tuning:
            return _tuned_from(machine, number, start, method_of(machine.model, method), tuning, progress)
        return _found_from(machine, number, start, method_of(machine.model, method), progress)


@in_own_units(lambda orbit, machine: orbit_of(machine, orbit), start=())
def _found_from(machine: Machine, family: int | None, start: Any, method: str, progress: Progress) -> Orbit:
    """The orbit of a family, or the orbit found from a start."""
    if start is None:
        number = family or 1
        return with_needed_range(machine, number, lambda known: lowest_of_family(known, number, method, progress))
    began = time.perf_counter()
    orbit = certified_orbit(machine, solve_near(machine, start, method), began=began)
    if family not in (None, orbit.family):
        raise NoOrbit(f"the start leads to an orbit of family {orbit.family}, not {family}")
    return orbit


def _tuned_from(
    machine: Machine, family: int | None, start: Any, method: str, tuning: Tuning, progress: Progress
) -> Orbit:
    """The orbit of a family with tuned parameters, or the one found from a start."""
    began = time.perf_counter()
    if method == "shooting":
        raise InputError("method 'shooting' tunes no parameters; leave it out")
    if not machine.model.sticks:
        start = _found_from(machine, family, start, method, progress)
    elif start is None:
        start = _starts_of_run(machine, family or 1, tuning)
    if machine.model.sticks and tuning.extremes:  # other quantities are those of the start at first
        free = [name for name in ("speed", "alpha", "flight_time") if name not in tuning.values]
        values = {**tuning.values, **dict.fromkeys(free[: len(tuning.extremes)])}
        start, _ = _tuned_near(machine, start, Tuning(tuning.names, values, {}), method)
    if tuning.extremes:
        orbit, errors = with_extremes(machine, tuning, start, lambda m, known, few: _tuned_near(m, known, few, method))
    else:
        orbit, errors = _tuned_near(machine, start, tuning, method)
    if family not in (None, orbit.family):
        raise NoOrbit(another_family(family, orbit.family))
    return replace(orbit.with_tuned(errors, tuning.at), seconds=time.perf_counter() - began)


def _tuned_near(machine: Machine, known: Any, tuning: Tuning, method: str) -> tuple[Orbit, dict[str, float]]:
    """The orbit with tuned parameters to which the machine's known one leads, and bounds on the errors of these."""
    sticks, began = machine.model.sticks, time.perf_counter()
    if not (tuning.names or sticks):
        return _found_from(machine, known.family, known, method, None), {}
    with without_units(machine.units):
        solved = _solved_from(machine, tuning, known)
        errors, u = errors_of_tuned(solved), solved.us[0].tolist()
        tuned = machine.with_values(**tuned_values(solved.equations, solved.us[0]))
        if sticks:
            step = float(solved.ps[0, solved.equations.parameters.index(STEP_LENGTH)])
            tuned = tuned.with_values(**{STEP_LENGTH: step})
        if sticks or solved.by_nodes:  # the tuned numbers in 16 digits do not determine a motion with nodes
            bare = dimensionless(tuned)
            orbit = certified_orbit(bare, replace(solved, model=bare.model), began=began)
            return orbit_of(tuned, orbit), errors
    names, units = solved.equations.statement.unknowns[: len(machine.model.half_unknowns)], tuned.units
    near = {name: x * (units.of(name) if units else 1.0) for name, x in zip(names, u, strict=False)}
    return _found_from(tuned, known.family, near, method, None), errors


def _solved_from(machine: Machine, tuning: Tuning, known: Any) -> Solved:
    """The solution with tuned parameters to which an orbit or a start leads, or the first of several starts that does;
    raises the error of the first where none does."""
    first: NoOrbit | FlowError | None = None
    begins = []
    for start in known if isinstance(known, Iterator) else [known]:
        bare = machine.units.dimensionless("start", start) if machine.units else start
        begins.append(stated_unknowns(machine.model, bare))
        try:
            return solve_tuned(machine, tuning, begins[-1])
        except (NoOrbit, FlowError) as error:
            first = first or error
    if isinstance(known, Iterator) and not tuning.values.keys() & OF_STEPS.keys() and any(tuning.values.values()):
        return run_along_speeds(machine, tuning, begins)
    assert first is not None
    raise first


def first_tuned(
    machine: Machine, start: Any, family: int, tuned: tuple[str, ...], values: Mapping[str, float | None]
) -> tuple[int | None, Solved]:
    """The family, where it is known already, and the solution with tuned parameters to which the orbit of a family, or
    one near a start, leads; the prescribed values are as in `Tuning`."""
    known: Any = start_in_file(start) if isinstance(start, str | Path) else start
    if not machine.model.sticks:
        check_start(machine, known)
        known = _found_from(machine, family if known is None else None, known, method_of(machine.model), None)
    tuning = Tuning(tuned, values, {})
    if machine.model.sticks and known is None:
        known = _starts_of_run(machine, family, tuning)
    with without_units(machine.units):
        solved = _solved_from(machine, tuning, known)
    return None if machine.model.sticks else known.family, solved


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
    """All orbits of a family, or the different orbits that `find` reaches from several starts, by launch speed.

    machine, method : as in `find`
    starts : initial guesses as in `find`, instead of a family
    family : as in `find`, where there are no starts
    fastest : the largest launch speed that is searched for a family, in the machine's units. None is 1e4 times the
        number of the family, in multiples of the inverse root of the spring's slope at rest, or 30 times where gravity
        varies and where the spring has many bends. The slowest launch is 1e-3 of these multiples.
    progress : called with the completed share of the launches near an orbit, or of the starts
    limit : time limit in seconds of the search, or of each start, as in `find`

    The orbits of a family are the zeros of one function of the launch speed (see `family_search`). It is sampled so
    that the turning points of the extension move over no feature of the spring's law from one speed to the next, and
    its curvature between them is assumed to be at most four times what its second differences show. This is not a
    proof, but the samples are refined where it matters. A search is stopped after 20,000 launches, or after 1,000 of a
    machine that steps, whose orbits may lie between falls, in narrow ranges of launch speeds. Where a search may have
    missed orbits, their `known_in_family` is None. Where it was stopped, or where an orbit could not be certified, a
    warning is logged too. Starts that lead to no orbit are left out. Raises `NoOrbit` where there is none, with the
    range that was searched or the last reason, and `InputError` for invalid arguments, and for a family of a model that
    has no such search.

    >>> from orbits import find_all
    >>> from problems import Hopper
    >>> hops = find_all(Hopper("cubic", rest_length=30.0, parameters={"beta": -0.005}), family=1)
    >>> [round(hop.alpha, 4) for hop in hops]
    [4.7432, 9.924]
    """
    if starts is None:
        check_machine(machine)
        refuse_hysteresis(machine.model)
        if fastest is not None and not finite_number("fastest", fastest) > 0:
            raise InputError(f"fastest = {fastest:g} is no launch speed; it lies above 0")
        family, method = family_number(1 if family is None else family), method_of(machine.model, method)
        with interrupts.deferred(), time_limit(limit):
            return orbits_of_family(machine, family, method, fastest, progress)
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
            if not any(same_orbit(orbit, other) for other in found):
                found.append(orbit)
        except NoOrbit as error:
            reason = error
    if reason and not found:
        raise NoOrbit(f"none of the starts leads to an orbit; the last: {reason}")
    return tuple(sorted(found, key=lambda orbit: orbit.alpha))


def solve_near(machine: Machine, start: Orbit | Mapping[str, float], method: str) -> Solved:
    """The solution that a method finds from a start, as in `find`."""
    method = iterative(method)
    bare = machine.units.dimensionless("start", start) if machine.units else start
    stated = stated_unknowns(machine.model, bare)
    names = equations_of(machine.model, method, tuple(machine.values)).statement.unknowns
    if missing := [name for name in names if name not in stated]:
        raise InputError(f"start has no '{missing[0]}'; the unknowns are {', '.join(names)}")
    try:
        return solve_from(machine, method, np.array([stated[name] for name in names]))
    except FlowError as error:
        raise NoOrbit(Message("the start cannot be followed: {error}", error=error)) from None


def _starts_of_run(machine: Any, family: int, tuning: Tuning) -> Iterator[dict[str, float]]:
    """The starts of a run, slow ones first: from there the way to a faster run stays on its sheet. A design may be so
    far from where its runs begin that only fast ones are near it."""
    hop = unknowns_of_hop(vertical_hop(dimensionless(machine).upright(), family))
    direct = start_of_run(machine, hop, tuning)
    stated = any(tuning.values.get(name) for name in OF_STEPS)
    for faster in FASTER_STARTS:
        slow = start_of_run(machine, hop, tuning, np.copysign(faster, direct[STEP_LENGTH]))
        if stated and faster == FASTER_STARTS[0]:
            yield from sorted((slow, direct), key=lambda start: abs(start[STEP_LENGTH]))
        else:
            yield slow


def start_of_run(
    machine: Any, hop: Mapping[str, float], tuning: Tuning, faster: float | None = None
) -> dict[str, float]:
    """The unknowns of a half orbit by name, with the step, where the search for a run of a machine begins: beside its
    vertical hop. All is in the machine's units.

    hop : the unknowns of half of it by name, without dimensions
    faster : the multiple of a slow speed at which it begins; None for what the tuning says, or 1
    """
    units, bare = machine.units, dimensionless(machine)
    at = {name: value / (units.of(name) if units else 1.0) for name, value in tuning.values.items() if value}
    equations = tuned_equations(machine, tuning.names, tuple(tuning.values))
    if faster is not None or not at.keys() & OF_STEPS.keys():
        at = {"speed": (faster or 1.0) * RUN_START.slow_share * abs(hop["alpha"])}
    found = run_start(bare, equations, hop, at)
    return {name: value * (units.of(name) if units else 1.0) for name, value in found.items()}


def vertical_hop(upright: Machine, family: int) -> Orbit:
    """The lowest hop of a family of the machine that stays upright; raises `NoOrbit` for one that is no motion, beside
    which no run begins."""
    hop = lowest_of_family(upright, family, method_of(upright.model))
    if (least := hop.certificate.smallest_separation) is not None and not least > 0:
        raise NoOrbit(
            f"in the vertical hop of family {family} parts pass through each other ({least:.3g}): "
            "no run begins there; give a start"
        )
    if hop.contact_time is None:
        raise NoOrbit(f"the contact of the vertical hop of family {family} does not end")
    return hop


def unknowns_of_hop(hop: Orbit) -> dict[str, float]:
    """The unknowns of half a vertical hop by name, without dimensions."""
    assert hop.source is not None
    return {name: value for name, value in stated_unknowns(hop.source.model, hop).items() if name != "unfolding"}
