"""Hops from launches of several numbers: one step of a return map of d dimensions."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import InputError
from ..hops import FASTEST_LAUNCH, STATUS, LaunchSection, hops_of_states, stand
from ..io import Document
from ..model import Machine, machine_in_words
from ..result import Axes, Result, Row, known, shown
from ..running import in_threads
from ..units import ENERGY, Units
from .hops import WithStatuses

LAUNCH_BATCH = 2048  # launches in one batch; their states have several times the numbers of a launch speed


@dataclass(frozen=True, repr=False, eq=False)
class LaunchHops(WithStatuses, Result, what="table of hops of launches"):
    """The hops that begin with launches (...) of d numbers each.

    names : of these numbers
    launches : (..., d)
    next : (..., d), the launches at the next lift-off, with the injection; NaN without a next launch
    loss : (...), the loss of energy in the impacts of the hop
    impacts : (...), the number of impacts in the hop
    status : (...), "lifts_off", or why there is no next launch, a name of `orbits.hops.impacts.STATUSES`
    units : of the numbers of a launch and of the loss, by name; empty for a dimensionless machine
    machine : in words and numbers
    """

    names: tuple[str, ...]
    launches: np.ndarray
    next: np.ndarray
    loss: np.ndarray
    impacts: np.ndarray
    status: np.ndarray
    units: Mapping[str, str] = field(default_factory=dict)
    machine: Mapping[str, Any] = field(default_factory=dict)

    def title(self) -> str:
        return f"{self.status.size} launches of {len(self.names)} numbers: what becomes of them"

    def _rows(self) -> Iterator[Row]:
        """How many launches have each status, and the range of their losses."""
        yield from self.rows_of_statuses({"loss": self.loss})

    def table(self) -> dict[str, np.ndarray]:
        """One row for each launch: its numbers, the numbers of the next launch, the loss, the impacts and the
        status."""
        own = {name: self.launches[..., i].ravel() for i, name in enumerate(self.names)}
        following = {f"next {name}": self.next[..., i].ravel() for i, name in enumerate(self.names)}
        return own | following | {name: np.ravel(getattr(self, name)) for name in ("loss", "impacts", "status")}

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the numbers of the next launches against the numbers of the launches; returns the axes."""
        return shown("launch_figures").plot_launch_hops(self, axes)

    def document(self) -> Document:
        rows = {name: known(column) if column.dtype.kind == "f" else column.tolist()
                for name, column in self.table().items()}  # fmt: skip
        return rows | ({"units": self.units} if self.units else {})


def hops_of_launches(machine: Machine, section: LaunchSection, launch: Any, inject: float, cap: int) -> LaunchHops:
    """The hops from launches, as `LaunchSection.parsed` takes them, with an injection without dimension.

    Raises `InputError` for a single launch that is invalid.
    """
    launches, guess = section.parsed(launch)
    shape, d = launches.shape[:-1], launches.shape[-1]
    flat, bound = (launches / section.unit).reshape(-1, d), None
    if guess is not None:
        bound = np.broadcast_to(guess / section.bound_unit, shape).ravel()
    usable = np.isfinite(flat).all(1) & (np.abs(flat) <= FASTEST_LAUNCH).all(1)
    ys = section.states(np.where(usable[:, None], flat, np.nan), bound)
    usable &= np.isfinite(ys).all(1)
    if not shape and not usable[0]:
        raise InputError(
            f"launch = {launches.tolist()} is not a launch: the contact force vanishes at no '{section.dependent}'"
        )
    states = ys @ section.impacts.model.embed.T
    if not shape:
        section.impacts.footing.refuse_fallen(states[0])
    usable &= np.all([foot.gap(states) > 0 for foot in section.impacts.feet[1:]], axis=0)
    following, loss, counts = np.full(ys.shape, np.nan), np.full(len(ys), np.nan), np.zeros(len(ys), int)
    status, places = np.full(len(ys), "invalid", dtype=STATUS), np.flatnonzero(usable)
    batches = np.array_split(places, -(-len(places) // LAUNCH_BATCH)) if len(places) else []
    each = lambda batch: next_launches(section, ys[batch], inject, cap)  # noqa: E731
    for batch, found in zip(batches, in_threads(each, batches), strict=True):
        following[batch], loss[batch], counts[batch], status[batch] = found
    units: Units | None = getattr(machine, "units", None)
    dimensions = {**{name: section.dimension(name) for name in section.names}, "loss": ENERGY}
    loss = loss * units.of(ENERGY) if units and units.energy else loss
    next_ones = (section.free(following) * section.unit).reshape(launches.shape)
    rows = [each.reshape(shape) for each in (loss, counts, status)]
    texts = units.texts(dimensions) if units else {}
    return LaunchHops(section.names, launches, next_ones, rows[0], rows[1], rows[2], texts, machine_in_words(machine))


def next_launches(section: LaunchSection, ys: np.ndarray, inject: float, cap: int) -> tuple[np.ndarray, ...]:
    """The launches (m, k) after launches (m, k), contact states, NaN where there is none; the losses of energy in
    impacts, the numbers of impacts and the statuses (m,)."""
    impacts = section.impacts
    hops = hops_of_states(impacts, ys @ impacts.model.embed.T, cap)
    stand(impacts, hops)
    following, lifting = np.full(ys.shape, np.nan), np.flatnonzero(hops.status == "lifts_off")
    ends = section.injected(hops.ends[lifting], inject)
    launches = np.isfinite(ends).all(1)
    hops.status[lifting[~launches]], following[lifting[launches]] = "rests", ends[launches]
    return following, hops.loss, hops.impacts, hops.status
