"""The orbit with tuned parameters, near the machine's own orbit or a start."""

import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FlowError, InputError, NoOrbit
from ..model import STEP_LENGTH, Machine, dimensionless
from ..result import Progress
from ..running import TimeOver, part_limit
from ..shooting import method_of
from ..units import without_units
from .certification import Solved, certified, certified_orbit
from .family_orbits import another_family
from .orbit import Orbit, orbit_of, start_in_file
from .orbit_found import found_from, unknowns_of_hop, vertical_hop
from .start import check_start, stated_unknowns
from .start_of_run import RUN_START, run_along_speeds, run_start
from .tuned_extremes import with_extremes
from .tuned_orbits import OF_STEPS, Tuning, errors_of_tuned, solve_tuned, tuned_equations, tuned_values

# The search for a run begins at these multiples of the slowest start, at the later ones where the others lead nowhere.
FASTER_STARTS = (1.0, 2.0, 3.0, 5.0, 1.5, 2.5, 4.0)


def tuned_from(
    machine: Machine, family: int | None, start: Any, method: str, tuning: Tuning, progress: Progress
) -> Orbit:
    """The orbit of a family with tuned parameters, or the one found from a start."""
    began = time.perf_counter()
    if method == "shooting":
        raise InputError("method 'shooting' tunes no parameters; leave it out")
    if not machine.model.sticks:
        start = found_from(machine, family, start, method, progress)
    elif start is None and machine.model.runs:
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
        return found_from(machine, known.family, known, method, None), {}
    with without_units(machine.units):
        solved = _solved_from(machine, tuning, known)
        errors, u = errors_of_tuned(solved), solved.us[0].tolist()
        tuned = machine.with_values(**tuned_values(solved.equations, solved.us[0]))
        if machine.model.runs:
            step = float(solved.ps[0, solved.equations.parameters.index(STEP_LENGTH)])
            tuned = tuned.with_values(**{STEP_LENGTH: step})
        if sticks or solved.by_nodes:  # the tuned numbers in 16 digits do not determine a motion with nodes
            bare = dimensionless(tuned)
            orbit = certified_orbit(bare, replace(solved, model=bare.model), began=began)
            return orbit_of(tuned, orbit), errors
    names, units = solved.equations.statement.unknowns[: len(machine.model.half_unknowns)], tuned.units
    near = {name: x * (units.of(name) if units else 1.0) for name, x in zip(names, u, strict=False)}
    return found_from(tuned, known.family, near, method, None), errors


def _solved_from(machine: Machine, tuning: Tuning, known: Any) -> Solved:
    """The solution with tuned parameters to which an orbit or a start leads, or the first of several starts that does;
    raises the error of the first where none does."""
    first: NoOrbit | FlowError | None = None
    begins = []
    if known is None:
        return _walk_near(machine, tuning)
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


def _walk_near(machine: Machine, tuning: Tuning) -> Solved:
    """The walk to which one of the small steps leads whose tuned numbers are nearest to those of the machine, a motion
    where there is one. Raises `NoOrbit` where there is none."""
    from .small_steps import SMALL_STEPS, change, small_steps  # SciPy takes long to import

    found, ranks, reason = list[Solved](), list[tuple[bool, float]](), None
    for starts in small_steps(machine.model, dimensionless(machine).values, tuning.names):
        for start in starts:
            try:
                with part_limit(SMALL_STEPS.seconds):
                    solved = solve_tuned(machine, tuning, start, SMALL_STEPS.attempts)
                    certificates, _ = certified(solved)
            except TimeOver:
                raise
            except (NoOrbit, FlowError) as error:
                reason = reason or error
                continue
            values = tuned_values(solved.equations, solved.us[0]).items()
            far = max((change(x, machine.values[name]) for name, x in values), default=0.0)
            found.append(solved)
            ranks.append((certificates is None or bool(certificates.certificates[0].violations), far))
            if ranks[-1] <= (False, SMALL_STEPS.certain):
                return solved
        if ranks and min(ranks) <= (False, SMALL_STEPS.near):
            break
    if found:
        return found[min(range(len(ranks)), key=ranks.__getitem__)]
    raise reason or NoOrbit(f"no small steps of a {machine.model.name} are found near these numbers: give a start")


def first_tuned(
    machine: Machine, start: Any, family: int, tuned: tuple[str, ...], values: Mapping[str, float | None]
) -> tuple[int | None, Solved]:
    """The family, where it is known already, and the solution with tuned parameters to which the orbit of a family, or
    one near a start, leads; the prescribed values are as in `Tuning`."""
    known: Any = start_in_file(start) if isinstance(start, str | Path) else start
    if not machine.model.sticks:
        check_start(machine, known)
        known = found_from(machine, family if known is None else None, known, method_of(machine.model), None)
    tuning = Tuning(tuned, values, {})
    if machine.model.runs and known is None:
        known = _starts_of_run(machine, family, tuning)
    with without_units(machine.units):
        solved = _solved_from(machine, tuning, known)
    return None if machine.model.sticks else known.family, solved


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
    """The unknowns of a half orbit by name, with the step, where the search for a run of a machine begins: near its
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
