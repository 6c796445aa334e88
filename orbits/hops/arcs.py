"""Motions in lanes while they are flown, and the record of their arcs of flight and contact, each up to an event."""

from copy import copy
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..flow.flow import Flow
from .hand_over import Landed
from .hysteresis import Branches
from .impacts import LIFTOFF_ORDER, STATUS, Impacts

Rules: TypeAlias = Impacts | Branches  # of the impacts and contacts of a machine


class Phase(NamedTuple):
    """A phase of motions: flight or contact, by these rules, on this branch of a spring with hysteresis."""

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
    impacts : the rules of the events, which may be others than those of the phase
    landed : what landings lead to
    foot, step : (k,) or of all, the numbers of the feet that touch or open, and of steps forward
    speed : of the launch; NaN where there is none
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
    launches, NaN where there are none.
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
