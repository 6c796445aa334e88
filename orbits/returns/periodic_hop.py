"""Periodic hops: launches that come back after some hops, found by Newton's method on the map of launches."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, NoOrbit
from ..hops import EnergyLoss, HopsDerivative, LaunchSection, derivative_of_hops, hops_of_states, simulate
from ..model import Machine
from ..result import Progress, Result
from ..units import LIFTOFF_SPEED, Message, Quantity
from .returning_hops import ReturningHops


class PeriodicOptions(NamedTuple):
    """Newton's method for hops that come back, and which of them are the same."""

    come_back: float = 1e-12  # share of the launch within which it comes back where the method has converged
    steps: int = 40  # after which it is given up
    halvings: int = 12  # of a step, at most
    longest_change: float = 0.05  # share of the launch: farther on there are other impacts
    rounded_return: float = 1e-9  # share of the launch: where no step reduces a smaller distance, rounding decides
    same: float = 1e-7  # launches that differ by a smaller share are the same
    polishes: int = 6  # steps on all launches of a cycle of the map together
    same_cycle: float = 1e-9  # cycles of the map that agree up to this share of the launch speed are one
    rounding: float = 4e-15  # share by which the map rounds a launch speed
    steepest: float = 1e12  # slope that replaces that of a steeper map, as near a graze


PERIODIC = PeriodicOptions()
NOT_LOSSLESS = (
    "without injection or damping only lossless hops come back: find them with `find` or `find_all`, and start from "
    "their orbits"
)


PeriodicHop = ReturningHops  # its earlier name


def periodic_hop(
    machine: Machine, section: LaunchSection, start: Any, period: int, inject: float, cap: int, below: bool = False
) -> ReturningHops:
    """The hops of a period that Newton's method finds from a launch; see `ReturnMap.periodic_hop`. From a lossless
    launch it begins with more energy or, `below`, with less."""
    y, lossless = section.launch(start), inject == 0 and section.impacts.model.conservative
    found = derivative_of_hops(section, y, period, inject)
    if lossless:
        if _distance(found) > PERIODIC.same or not all(hop.tangential for hop in found.hops):
            raise InputError(NOT_LOSSLESS)
    else:
        if loss := found.energy_loss:
            found = derivative_of_hops(section, _beside_lossless(section, y, loss, inject, below), period, inject)
        found = returning_hops(section, found, inject)
    free = section.free(found.launches)
    for shorter in (k for k in range(1, period) if period % k == 0):
        if np.abs(free[shorter] - free[0]).max() <= PERIODIC.same * (1 + np.abs(free[0]).max()):
            raise NoOrbit(f"from this launch Newton's method reaches hops of period {shorter}: start elsewhere")
    own, separation = found.as_result(machine), None
    if machine.model.separation(machine.values) is not None:
        u = {name: x * _unit_of(section, name) for name, x in section.unknowns_of(found.launches[0]).items()}
        launch, added = u["alpha"] if len(u) == 2 else u, inject * _unit_of(section, "alpha")
        separation = simulate(machine, launch, hops=period, inject=added, cap=cap).smallest_separation
    states = found.launches[:-1] @ section.impacts.model.embed.T
    counts = tuple(hops_of_states(section.impacts, states, cap).impacts.tolist())
    about = own, separation, own.units, own.machine, counts
    return ReturningHops(section.names, free[:-1] * section.unit, "lossless" if lossless else "crossing", *about)


def _beside_lossless(section: LaunchSection, y: np.ndarray, loss: EnergyLoss, inject: float, below: bool) -> np.ndarray:
    """The launch (k,) near a lossless one that loses about as much as the injection adds."""
    added = float(loss.powers[section.names.index("alpha")]) * inject
    if not added > 0:
        text = "inject = {inject:g} removes energy here: hops near the lossless one do not come back"
        raise NoOrbit(Message(text, inject=Quantity(inject, LIFTOFF_SPEED)))
    c = loss.coefficients[below]
    launch = section.free(y) + (-1 if below else 1) * (added / c) ** 0.75 * loss.direction
    return section.states(launch[None], y[[section.places[section.dependent]]])[0]


def _unit_of(section: LaunchSection, name: str) -> float:
    """The unit of an unknown of a launch."""
    return section.bound_unit if name == section.dependent else float(section.unit[section.names.index(name)])


def returning_hops(section: LaunchSection, found: HopsDerivative, inject: float) -> HopsDerivative:
    """The hops that come back, by Newton's method from hops that nearly do, with halved steps where a whole one does
    not come nearer; raises `NoOrbit`."""
    period, distance = len(found.hops), _distance(found)
    for _ in range(PERIODIC.steps):
        if distance <= PERIODIC.come_back:
            break
        free = section.free(found.launches)
        matrix = found.matrix - np.eye(len(section.names))
        try:
            step = -np.linalg.solve(matrix, free[-1] - free[0])
        except np.linalg.LinAlgError:
            raise NoOrbit("a multiplier of the hops is 1: Newton's method cannot go on; start elsewhere") from None
        step *= min(1.0, PERIODIC.longest_change * (1 + np.abs(free[0]).max()) / max(float(np.abs(step).max()), 1e-300))
        for _ in range(PERIODIC.halvings):
            nearer = _from(section, free[0] + step, found, period, inject)
            if nearer is not None and _distance(nearer) < distance:
                break
            step = 0.5 * step
        else:
            if distance <= PERIODIC.rounded_return:
                break
            text = "no step from the launch {launch} comes nearer to hops of period {period}, whose first and last "
            text += "launch differ by the share {share:.2g}: start elsewhere"
            launch = section.in_words(found.launches[0])
            raise NoOrbit(Message(text, launch=launch, period=period, share=distance))
        found, distance = nearer, _distance(nearer)
    if distance > PERIODIC.rounded_return:
        raise NoOrbit(f"Newton's method did not converge in {PERIODIC.steps} steps: start nearer to the hops")
    return found


def _from(
    section: LaunchSection, launch: np.ndarray, near: HopsDerivative, period: int, inject: float
) -> HopsDerivative | None:
    """The hops from a launch (d,); None where there are none."""
    (y,) = section.states(launch[None], near.launches[:1, section.places[section.dependent]])
    try:
        return derivative_of_hops(section, y, period, inject) if np.isfinite(y).all() else None
    except NoOrbit:
        return None


def _distance(found: HopsDerivative) -> float:
    """How far the last launch is from the first one, as a share of it."""
    first, last = found.section.free(found.launches[[0, -1]])
    return float(np.abs(last - first).max() / (1 + np.abs(first).max()))


def listed_starts(starts: Any) -> list[Any]:
    """Starts in a list; a single one may be an orbit, its file, a periodic hop or a mapping. Raises `InputError` for an
    empty list, and for anything but a list."""
    single = isinstance(starts, Result | Mapping | str | Path)
    found = [starts] if single else list(starts) if np.iterable(starts) else []
    if not found:
        raise InputError(f"starts = {starts!r}; it must be a list of launches, lossless orbits or periodic hops")
    return found


def different_hops(
    hop_from: Callable[..., ReturningHops], starts: Any, progress: Progress = None
) -> tuple[ReturningHops, ...]:
    """The different hops that are found from starts, in their order; starts from which none is found are left out.
    `progress` is called with the completed share of the starts."""
    starts, found = listed_starts(starts), list[ReturningHops]()
    for i, start in enumerate(starts):
        if progress:
            progress(i / len(starts))
        for below in (False, True):
            try:
                hop = hop_from(start, below=below)
            except NoOrbit:
                continue
            size = np.abs(hop.launches[0]).max()
            if all(np.abs(other.launches[0] - hop.launches[0]).max() > PERIODIC.same * size for other in found):
                found.append(hop)
    return tuple(found)
