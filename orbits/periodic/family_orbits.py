"""The orbits of a family: the one that its guess leads to, and the orbits that a search finds."""

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import FlowError, InputError, NoOrbit
from ..model import Machine, Model
from ..result import Progress
from ..running import LOGGER, interrupts
from ..shooting import NodedSolution, equations_of, vector
from ..units import LIFTOFF_SPEED, TIME, Message, Quantity, in_own_units, in_units
from .certification import Solved, certified_orbit, corrector, known_solutions, solve_from
from .family_search import Cells, Lateness
from .guess import refuse_jump
from .homotopy import solve_by_homotopy
from .linear_hops import LinearSearch
from .orbit import Orbit, orbit_of

LARGEST_FAMILY = 10_000
# Orbits whose launch speeds, times and states agree to this share are the same.
SAME_ORBIT = 1e-9


def lowest_of_family(machine: Machine, family: int, method: str, progress: Progress = None) -> Orbit:
    """The orbit of a family of least launch speed, as `find` finds it by a method."""
    model, began, orbits, refusal = machine.model, time.perf_counter(), tuple[Orbit, ...](), None
    search = model.search(machine.values) if model.search and model.reversor else None
    if LinearSearch.finds_families(machine):
        hops = _hops_of_family(machine, family, method, None, progress)
        first = next(hops)
        return first if first.admissible else next((hop for hop in hops if hop.admissible), first)
    if search is None or model.is_guessed:
        try:
            orbits = (_solved_for(machine, family, method, progress),)
        except NoOrbit as error:
            if search is None:
                raise
            refusal = error
        if orbits and (search is None or search.single or orbits[0].method == "closed form"):
            return orbits[0]
        progress = None  # the search follows after progress was reported
    complete = False
    try:
        reported = "" if refusal is None else str(in_units(refusal, None))
        others = _all_of_family(machine, family, method, None, progress, reported)
        complete = others[0].known_in_family is not None
        orbits += tuple(other for other in others if not any(same_orbit(orbit, other) for orbit in orbits))
    except NoOrbit as none:
        if not orbits:
            raise (with_search(refusal, none) if refusal else none) from None
    lowest, known = min(orbits, key=lambda one: one.alpha), len(orbits) if complete else None
    return replace(lowest, known_in_family=known, seconds=time.perf_counter() - began)


def _solved_for(machine: Machine, family: int, method: str, progress: Progress = None) -> Orbit:
    """The certified orbit found from a family's guess; raises `NoOrbit` where it is of another family."""
    began = time.perf_counter()
    orbit = certified_orbit(machine, solve_family(machine, family, method, progress), began=began)
    if orbit.family != family:
        raise NoOrbit(another_family(family, orbit.family))
    return orbit


def _all_of_family(
    machine: Machine, family: int, method: str, fastest: float | None = None, progress: Progress = None,
    refusal: str = "",
) -> tuple[Orbit, ...]:  # fmt: skip
    """All orbits of a family, as in `find_all`; a reason that is part of `refusal` already is not repeated."""
    model, p = machine.model, machine.values
    if LinearSearch.finds_families(machine):
        return tuple(_hops_of_family(machine, family, method, fastest, progress))
    if not (model.search and model.reversor):
        remedy = "give find_all starts" if model.one_speed else "find_all(machine, starts(machine)) finds its hops"
        remedy = model.violations.get("none", "give find a start") if model.sticks else remedy
        raise InputError(f"the families of a {model.name} cannot be searched: {remedy}")
    if method == "closed form":
        only = _solved_for(machine, family, method)
        if fastest is not None and only.alpha > fastest:
            text = "the only orbit of family {family} has the launch speed {alpha:.6g}, above {fastest:g}"
            speeds = {"alpha": Quantity(only.alpha, LIFTOFF_SPEED), "fastest": Quantity(fastest, LIFTOFF_SPEED)}
            raise NoOrbit(Message(text, family=family, **speeds))
        return (replace(only, known_in_family=1),)
    refuse_jump(model, p)
    searched_by = "half orbit" if method == "shooting" else method
    lateness = Lateness(model, searched_by, tuple(p), vector(p)[None], family, [model.search(p)])
    found, refused = list[Orbit](), Message("")
    (cells,) = lateness.cells(fastest)
    for i, (cell, about) in enumerate(zip(cells.cells, cells.abouts, strict=True)):
        if progress:
            progress(i / len(cells.cells))
        try:
            orbit = _orbit_in_cell(machine, lateness, cell, about)
            if orbit and not any(same_orbit(orbit, other) for other in found):
                found.append(orbit)
        except NoOrbit as error:
            text = "; the one near {about:.6g} is rejected" + ("" if in_units(error, None) in refusal else ": {error}")
            refused = Message(text, about=Quantity(float(about), LIFTOFF_SPEED), error=error)
    if not found:
        raise none_found(model, cells, refused)
    if cells.stopped or refused:
        why = f"the search was stopped after {cells.launches} launches" if cells.stopped else "one cannot be certified"
        LOGGER.warning("family %d may have more orbits than the %d found: %s", family, len(found), why)
    known = None if refused or incomplete(model, cells) else len(found)
    return tuple(replace(orbit, known_in_family=known) for orbit in found)


def _hops_of_family(
    machine: Any, family: int, method: str, fastest: float | None, progress: Progress
) -> Iterator[Orbit]:
    """The orbits of a family that a search by modes finds, one after the other by launch speed; others may last longer.
    Raises `NoOrbit` in the end where there is none."""
    search, model, found, reason = LinearSearch.of(machine), machine.model, False, Message("")
    for _ in search.batches(*search.longest):
        interrupts.heed()
    names = equations_of(model, method, tuple(machine.values)).statement.unknowns
    hops = [model.launch_at(x.tolist()) | {"contact_duration": s, "duration": t} for s, t, x in search.hops]
    hops = sorted((hop for hop in hops if not hop["alpha"] > (fastest or np.inf)), key=lambda hop: hop["alpha"])
    for i, hop in enumerate(hops):
        if progress:
            progress(i / len(hops))
        began, u = time.perf_counter(), np.array([hop[name] for name in names])
        try:
            orbit = certified_orbit(machine, solve_from(machine, method, u), began=began)
        except (NoOrbit, FlowError) as error:
            reason = Message("; one is rejected: {error}", error=error)
            continue
        if orbit.family == family:
            found = True
            yield orbit
    if not found:
        text = "none of {count} hops with half contacts up to {contact:.4g} and half flights up to {flight:.4g}{slow} "
        slow = Message(" and launch speeds up to {at:.6g}", at=Quantity(fastest, LIFTOFF_SPEED)) if fastest else ""
        contact, flight = (Quantity(longest, TIME) for longest in search.longest)
        known = {"count": len(hops), "contact": contact, "flight": flight, "slow": slow, "family": family}
        raise NoOrbit(Message(text + "is of family {family}{reason}", **known, reason=reason))


# The orbits of a machine that may have units.
orbits_of_family = in_own_units(
    lambda orbits, machine: tuple(orbit_of(machine, orbit) for orbit in orbits), fastest=LIFTOFF_SPEED
)(_all_of_family)


def none_found(model: Model, cells: Cells, refused: str = "") -> NoOrbit:
    """The error of a search that finds no orbit; `refused` is the part of its message on refused orbits."""
    reason = incomplete(model, cells)
    text = "a search from launch speed {low:.3g} to {high:.4g} " + ("has found none so far" if reason else "finds none")
    text += "{refused}" + (f"; {hint}" if (hint := model.violations.get("none")) else "")
    text += "; it is not complete: {reason}" if reason else ""
    low, high = (Quantity(speed, LIFTOFF_SPEED) for speed in cells.searched)
    return NoOrbit(Message(text, low=low, high=high, refused=refused, reason=reason))


def incomplete(model: Model, cells: Cells) -> str | Message:
    """Why a search may have missed orbits; "" for one that is complete."""
    if cells.stopped:
        text = "it was stopped after {launches} launches, up to launch speed {high:.4g}"
        return Message(text, launches=cells.launches, high=Quantity(cells.searched[1], LIFTOFF_SPEED))
    if not model.plain:
        return "orbits of machines that step may lie in narrow ranges between falls"
    return ""


def with_search(error: NoOrbit, none: NoOrbit) -> NoOrbit:
    """The error of a family if neither the guess nor a search leads to an orbit."""
    if in_units(none, None) in in_units(error, None):
        return error
    return type(error)(Message("{error}; {none}", error=error, none=none))


def _orbit_in_cell(machine: Machine, lateness: Lateness, cell: np.ndarray, about: float) -> Orbit | None:
    """The orbit of a lateness's family in a cell (2,) of launch speeds, about a speed in it; None where it has none.

    Raises `NoOrbit` where the orbit cannot be certified, and where Newton's method does not converge to one.
    """
    for alpha in (about, None):
        began = time.perf_counter()
        try:
            (start,) = lateness.start(np.array([lateness.enclosed(cell) if alpha is None else alpha]))
            orbit = certified_orbit(machine, solve_from(machine, lateness.method, start), began=began)
        except NoOrbit:
            if alpha is None:
                raise
            continue
        if orbit.family == lateness.family and cell[0] <= orbit.alpha <= cell[1]:
            return orbit
    return None


def solve_family(machine: Machine, family: int, method: str, progress: Progress = None) -> Solved:
    """The solution that a method finds for a family, as in `find`; not certified to be of that family."""
    family, model, p = family_number(family), machine.model, dict(machine.values)
    if method == "closed form" and model.reduction and model.reduction.exact:
        unknowns, error = model.reduction.exact(family, p)
        return known_solutions(model, method, tuple(p), vector(unknowns)[None], vector(p)[None], np.array([error]))
    equations = equations_of(model, method, tuple(p))
    correct = corrector(method, equations, model.homotopy)
    u, evaluation = solve_by_homotopy(model, equations, correct, family, p, progress)
    return Solved.of(model, method, NodedSolution(equations, None, u, vector(p), evaluation).divided())


def another_family(wanted: int, found: int) -> str:
    """The message about a solve for one family that ends on another."""
    return f"the solve for family {wanted} ended on an orbit of family {found}; try another method"


def same_orbit(a: Orbit, b: Orbit) -> bool:
    """Whether two orbits of a machine are the same except for rounding."""
    x, y = ([orbit.alpha, orbit.flight_time, *orbit.flight(0.0)] for orbit in (a, b))
    return np.allclose(x, y, rtol=SAME_ORBIT, atol=SAME_ORBIT * max(map(abs, x)))


def family_number(family: int) -> int:
    """The number of a family; raises `InputError` for an invalid number."""
    if isinstance(family, bool) or not isinstance(family, int | np.integer) or not 1 <= family <= LARGEST_FAMILY:
        raise InputError(f"family = {family!r}; a family must be a whole number from 1 to {LARGEST_FAMILY}")
    return int(family)
