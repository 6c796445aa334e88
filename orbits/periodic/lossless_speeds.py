"""The launch speeds of all lossless orbits of a machine in a range: all that a search of launch speeds shows, and of
machines that step those of `find`."""

import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import count
from typing import NamedTuple

import numpy as np

from ..errors import FlowError, NoOrbit
from ..flow import flow_of
from ..model import Machine
from ..numerics import enclosed_sign_changes, piecewise_roots, resolved
from ..running import interrupts
from ..shooting import vector
from .certification import certified_orbit, solve_from
from .find import find, find_all
from .orbit import Orbit


class SpeedSearch(NamedTuple):
    """How far lossless orbits are searched for.

    families : at most, of machines that step: their launch speeds converge
    further : the search ends after this many families in a row without one in the range
    per_turn, samples : launches in the grid, for each half oscillation, and at most
    """

    families: int = 12
    further: int = 3
    per_turn: int = 8
    samples: int = 2000


SEARCH = SpeedSearch()


def lossless_speeds(machine: Machine, low: float, high: float) -> list[float]:
    """Launch speeds from `low` to `high` of the lossless orbits that are motions, ascending."""
    model = machine.model
    if not model.conservative or (model.symmetry is not None and model.reversor is None):
        return []  # damped, or on a slope
    with interrupts.deferred():
        if model.reduction and not model.reduction.exact:
            orbits: Iterator[Orbit] = _all_orbits(machine, low, high)
        elif model.plain and model.search is not None:
            orbits = _searched_orbits(machine, high)
        else:
            orbits = _orbits_of_families(machine, low, high)
        return sorted({orbit.alpha for orbit in orbits if low <= orbit.alpha <= high and orbit.admissible})


def _searched_orbits(machine: Machine, high: float) -> Iterator[Orbit]:
    """All orbits of each family up to `high`, until several families in a row have none there."""
    beyond, family = 0, 0
    while beyond <= SEARCH.further:
        interrupts.heed()
        beyond, family = beyond + 1, family + 1
        with suppress(NoOrbit):
            yield from find_all(machine, family=family, fastest=high)
            beyond = 0


def _orbits_of_families(machine: Machine, low: float, high: float) -> Iterator[Orbit]:
    """The orbit that `find` returns for each family, until several in a row lie beyond `high` or do not exist. Of a
    machine that steps the launch speeds may fall with the family, and they converge: there until several lie beyond
    `low` or `high`, of this number of families at most."""
    beyond, steps, last = 0, not machine.model.plain, low
    for family in range(1, SEARCH.families + 1) if steps else count(1):
        interrupts.heed()
        try:
            orbit = find(machine, family)
        except NoOrbit:
            orbit = None
        falls = steps and orbit is not None and low > orbit.alpha < last
        beyond = 0 if orbit and orbit.alpha <= high and not falls else beyond + 1
        last = orbit.alpha if orbit else last
        if beyond > SEARCH.further:
            return
        if orbit and not beyond:
            yield orbit


def _all_orbits(machine: Machine, low: float, high: float) -> Iterator[Orbit]:
    """All orbits under constant gravity: half a flight lasts a known time, until the reduced motion turns."""
    model, values = machine.model, dict(machine.values)
    assert model.reduction is not None
    p, arc = vector(values), model.reduction.statement.arcs[0]
    flow, (liftoff,) = flow_of(arc.phase, tuple(values)), model.release(np.array([low]), values)

    def half_flight(alpha):
        u = {"liftoff": liftoff, "alpha": alpha}
        try:
            return flow.run(arc.start(u, [], values), p, float(arc.duration(u, values)))[0]
        except FlowError:
            return None

    def end_speed(alphas, which=None):
        return np.array([0.0 if (path := half_flight(alpha)) is None else path.end[1] for alpha in alphas])

    half_oscillations = [
        np.diff([path.times[i] + t for i, t in piecewise_roots(path.coefficients[:, 1], path.steps)])
        for alpha in np.geomspace(low, high, 5)
        if (path := half_flight(alpha)) is not None
    ]
    shortest = max(np.concatenate([[high - low], *half_oscillations]).min(), (high - low) / SEARCH.samples)
    grid, speeds = resolved(end_speed, np.linspace(low, high, 2 + int(SEARCH.per_turn * (high - low) / shortest)), True)
    i = np.flatnonzero((speeds[1:] >= 0) != (speeds[:-1] >= 0))
    for alpha in enclosed_sign_changes(end_speed, grid[i], grid[i + 1], speeds[i], speeds[i + 1])[0]:
        began = time.perf_counter()
        try:
            solved = solve_from(machine, "relative", np.array([liftoff, alpha]))
            yield certified_orbit(machine, solved, began=began)
        except NoOrbit:
            continue
