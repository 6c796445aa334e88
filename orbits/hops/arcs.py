"""Motions in lanes while they are flown, and the record of their arcs of flight and contact, each up to an event."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..errors import FlowError
from ..flow import Flow, Trajectory
from .hand_over import Landed
from .hysteresis import Branches
from .impacts import LIFTOFF_ORDER, STATUS, Impacts

BRIEF = 1e-12  # in such a time the terms of second order are below rounding
Rules: TypeAlias = Impacts | Branches  # of the impacts and contacts of a machine


class Phase(NamedTuple):
    """A phase of motions: flight or contact, by these rules, on this branch of a spring with hysteresis: 1 while it
    grows, -1 while it shrinks, 0 where it sticks; 1 without such a spring."""

    contact: bool
    impacts: Impacts
    side: int

    @property
    def flow(self) -> Flow:
        return self.impacts.contact if self.contact else self.impacts.flight

    def states(self, x: np.ndarray) -> np.ndarray:
        """The states of the phase (..., k) that flight states (..., n) are."""
        return x @ self.impacts.onto_contact.T if self.contact else x


@dataclass(eq=False)
class Arcs:
    """Arcs of k motions in one phase, and the events at their ends.

    lanes : (k,), the numbers of the motions
    begun, durations : (k,), when they begin and how long they last, NaN for an event without an arc before it
    starts, ends, after : flight states (k, n), those after the events
    kind : "landing", "impact", "lift-off", "reversal", "slips" or "falls", of each (k,) or of all; "" without an event
    impacts : the rules at the events, where other parameters may come into force
    landed : what landings lead to
    foot, step : (k,) or of all, the numbers of the feet that touch or open, and of steps forward
    speed : of the launch; NaN where there is none
    path : of a single motion, where it is known
    """

    phase: Phase
    lanes: np.ndarray
    begun: np.ndarray
    durations: np.ndarray
    starts: np.ndarray
    ends: np.ndarray
    kind: np.ndarray | str
    after: np.ndarray
    impacts: Impacts
    landed: Landed | None = None
    foot: Any = 0
    step: Any = 0
    speed: float = np.nan
    path: Trajectory | None = None


@dataclass(eq=False)
class Flown:
    """Hops that are flown from m flight states at lift-off.

    starts : flight states (m, n)
    status : (m,), "lifts_off", or how else they end
    loss, impacts : energies (m,) lost in impacts, and the numbers (m,) of the impacts of the last hop
    ends : contact states (m, k) where sustained contact ends
    contacts : times (m,) of the contacts that end with a launch's lift-off, NaN for others
    record, arcs : whether arcs are recorded, and all of these in turn
    reasons : by motion, why it could not be followed, in words

    While they are flown, the motions are in `states` (m, n), on the ground or not, at the times `now` (m,) where arcs
    are recorded. After the time `left` (m,) a flight counts as endless; it is NaN before its start. At the start of
    an arc the gap of a `foot` (m,) has a zero of an `order` (m,). The rate of a spring with hysteresis has one of the
    order `turning` (m,), it has turned `turns` (m,) times in the phase, and `speeds` (m,) are those of the next
    launches, NaN where there are none. A foot that passes the ground in mid-flight opened with the slope `reach` (m,)
    of its height by the gap, which is 0 once it has passed.
    """

    starts: np.ndarray
    status: np.ndarray
    loss: np.ndarray
    impacts: np.ndarray
    ends: np.ndarray
    contacts: np.ndarray
    record: bool = False
    arcs: list[Arcs] = field(default_factory=list)
    reasons: dict[int, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        m = len(self.starts)
        self.states, self.now, self.on_ground = self.starts.copy(), np.zeros(m), np.zeros(m, bool)
        self.left, self.order, self.foot = np.full(m, np.nan), np.full(m, LIFTOFF_ORDER), np.zeros(m, int)
        self.turning, self.turns, self.speeds = np.zeros(m, int), np.zeros(m, int), np.full(m, np.nan)
        self.reach = np.zeros(m)

    @classmethod
    def begun(cls, rules: Rules, starts: np.ndarray, record: bool = False) -> "Flown":
        """Hops that are about to be flown; a spring that no flight has is refused."""
        impacts, m = rules.first(), len(starts)
        if impacts.flight.phase.closed_form:
            impacts.flight.closed_form(impacts.p)
        ends = np.full((m, impacts.contact.size), np.nan)
        status = np.where(impacts.opens(starts), "", "no_launch").astype(STATUS)
        loss, counts, contacts = np.zeros(m), np.zeros(m, int), np.full(m, np.nan)
        return cls(starts, status, loss, counts, ends, contacts, record)

    def of(self, which: slice) -> "Flown":
        """Some of the motions, whose end is known."""
        found = copy(self)
        vars(found).update({name: each[which] for name, each in vars(self).items() if isinstance(each, np.ndarray)})
        return found

    @property
    def flights(self) -> list[Arcs]:
        """The arcs in flight."""
        return [arc for arc in self.arcs if not arc.phase.contact]


def integrated(arcs: Sequence[Arcs], sensitive: bool = False) -> list[tuple[Trajectory, np.ndarray] | FlowError | None]:
    """The arcs of one motion, integrated between their known ends: their paths and, where these are `sensitive`, the
    derivatives (k, k) of their ends by their starts; or why that cannot be done; None for those without a duration."""
    found = list[tuple[Trajectory, np.ndarray] | FlowError | None]([None] * len(arcs))
    phases = dict[tuple[int, bool], list[int]]()
    for i, arc in enumerate(arcs):
        if arc.path is not None and not sensitive:
            found[i] = arc.path, np.zeros((arc.phase.flow.size, 0))
        elif arc.durations[0] < BRIEF:
            found[i] = _briefly(arc, sensitive)
        elif np.isfinite(arc.durations[0]):
            phases.setdefault((id(arc.phase.impacts), arc.phase.contact), []).append(i)
    for places in phases.values():
        phase = arcs[places[0]].phase
        starts = phase.states(np.concatenate([arcs[i].starts for i in places]))
        durations = np.concatenate([arcs[i].durations for i in places])
        for i, each in zip(places, _together(phase, starts, durations, sensitive), strict=True):
            found[i] = each
    return found


def _together(phase: Phase, starts: np.ndarray, durations: np.ndarray, sensitive: bool):
    """Motions of a phase from states (m, k) for times (m,), as `integrated` has them."""
    flow, p, found = phase.flow, phase.impacts.p, list[tuple[Trajectory, np.ndarray] | FlowError]()
    seeds, fixed = np.eye(flow.size)[:, : flow.size * sensitive], np.zeros((len(p), flow.size * sensitive))
    try:
        paths, ends = flow.run_all(starts, np.tile(p, (len(starts), 1)), durations, seeds, fixed)
        return [*zip(paths, ends, strict=True)]
    except FlowError:
        for start, duration in zip(starts, durations.tolist(), strict=True):
            try:
                found.append(flow.run(start, p, duration, seeds))
            except FlowError as error:
                found.append(error)
    return found


def _briefly(arc: Arcs, sensitive: bool) -> tuple[Trajectory, np.ndarray]:
    """An arc so short that it is a straight line."""
    flow, (x,) = arc.phase.flow, arc.phase.states(arc.starts)
    rates, watched = (each[0] for each in flow.field(x[None], arc.phase.impacts.p))
    c = np.zeros((1, len(x) + len(watched), flow.vector_field.order + 1))
    c[0, :, 0], c[0, : len(x), 1] = [*x, *watched], rates
    return Trajectory(np.array([0.0, *arc.durations]), c, flow.names), np.eye(len(x))[:, : len(x) * sensitive]
