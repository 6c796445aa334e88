"""A machine whose spring has hysteresis, as ordinary machines between the reversals of the spring.

While the extension grows it is the machine with the law of one branch, while it shrinks that with the other's. Where
the rate of the extension vanishes, the other branch holds if it moves the extension on; if neither does, the spring
sticks, and has the force between its branches that keeps its extension.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import InputError
from ..flow.first_events import first_events, first_zero
from ..flow.flow import Flow
from ..flow.taylor import Watch
from ..laws.law import from_key
from ..laws.law_statement import from_formula
from ..mechanics.elements import Spring
from ..mechanics.mechanism import Mechanism
from ..model.model import refuse_steps
from ..model.phase import Affine
from .flyer import ROUNDING
from .impacts import FASTEST_LAUNCH, LIFTOFF_ORDER, STATUS, TURNS, Impacts, status_of_failure

TURNING_RATE = 1e-13  # a rate of the extension below this, relative to the state, is that of a reversal
# Branches that cross feed energy to the motion. Measured ones may cross by noise, by this share of the loop's largest
# width, and all by this share of the accelerations, which is rounding.
NOISE, ROUNDING_OF_WIDTH, SAMPLES_OF_WIDTH = 0.05, 1e-9, 513


class Branches:
    """The impacts and contacts of a machine with hysteresis on each of its branches, by the sign of the rate.

    model, restitution : of the machine itself, which is not conservative
    of : the `Impacts` while the extension grows (1) and while it shrinks (-1)
    rate, rate_in_contact : of the extension, as functions of the flight and the contact state
    mean : the `Impacts` of the mean law, by which the energy is counted
    """

    never_lose = False  # as of `Impacts`

    def __init__(self, machine: Any):
        self.machine, self.model, self.restitution = machine, machine.model, float(machine.restitution)
        refuse_steps(self.model, "a spring with hysteresis")
        if not hasattr(machine, "stated"):
            raise InputError(f"the {self.model.name} has a spring with hysteresis: state it as a Mechanism")
        stated: Mechanism = replace(machine.stated(), restitution=machine.restitution)
        springs = [each.force for each in stated.elements if isinstance(each, Spring)]
        (self._key,) = (key for key in springs if key.branches)
        self._springs, self._stated, p = springs, stated, stated.parameters
        self.of = dict(zip((1, -1), (self._with(from_key(key, p)) for key in self._key.branches), strict=True))
        weights = self.model.hysteretic
        self.rate = Affine(tuple(weights))
        self.rate_in_contact = Affine(tuple((np.array(weights) @ self.model.embed).tolist()))

    def _with(self, law: Any) -> Impacts:
        """The impacts of the machine with another law of its spring."""
        return Impacts(self._stated.with_springs([law if key.branches else key for key in self._springs]))

    @cached_property
    def mean(self) -> Impacts:
        """The impacts with the mean law, by which the energy is counted."""
        return self._with(from_key(self._key._replace(branches=None), self._stated.parameters))

    @cached_property
    def _pulls(self) -> tuple[Impacts, Impacts]:
        """The machine without a force of its spring, and with the force 1."""
        return self._with(from_formula("0*r", "r")), self._with(from_formula("1", "r"))

    def branch(self, x: np.ndarray, contact: bool = False) -> tuple[int, int]:
        """The branch that holds from a flight or a contact state on, 0 where the spring sticks; and the order of the
        rate's zero there."""
        (side,), (order,) = self.branches(x[None], contact)
        return int(side), int(order)

    def branches(self, x: np.ndarray, contact: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """`branch` at several states (m, n): branches (m,) and orders (m,)."""
        rate = (self.rate_in_contact if contact else self.rate)(x)
        still = np.abs(rate) <= TURNING_RATE * (1 + np.abs(x).max(1))
        side = np.where(rate > 0, 1, -1)
        if still.any():
            growing, shrinking = (self._turns(self.of[sign], x[still], contact) for sign in (1, -1))
            self.check_width(x[still], contact)
            side[still] = np.where(growing > 0, 1, np.where(shrinking < 0, -1, 0))
        return side, still.astype(int)

    def _turns(self, impacts: Impacts, x: np.ndarray, contact: bool) -> np.ndarray:
        """The second derivatives (m,) of the extension on a branch at states (m, n)."""
        flow, rate = (impacts.contact, self.rate_in_contact) if contact else (impacts.flight, self.rate)
        return flow.field(x, impacts.p)[0] @ np.array(rate.weights)

    def check_width(self, x: np.ndarray, contact: bool = False) -> None:
        """Raise `InputError` where the branches are crossed at flight or contact states (m, n)."""
        growing, shrinking = (self._turns(self.of[sign], x, contact) for sign in (1, -1))
        free, pulled = (self._turns(each, x, contact) for each in self._pulls)
        gain = (growing - shrinking) / (free - pulled) if self._noise else growing - shrinking
        if (gain > self._noise + ROUNDING_OF_WIDTH * (np.abs(growing) + np.abs(shrinking))).any():
            raise InputError(
                "the branches of the spring with hysteresis cross: the motion comes to extensions where the force is "
                "larger while the spring shrinks, and which would feed it energy; exchange the branches, state them "
                "to where they end, or take the law's `.mean`"
            )

    @cached_property
    def _noise(self) -> float:
        """The largest force by which measured branches may cross; 0 for branches that are not bounded."""
        laws = [from_key(key, self._stated.parameters) for key in self._key.branches]
        low, high = max(law.range()[0] for law in laws), min(law.range()[1] for law in laws)
        if not np.isfinite(high - low):
            return 0.0
        places = np.linspace(low, high, SAMPLES_OF_WIDTH)
        return NOISE * float(np.abs(laws[0](places) - laws[1](places)).max())

    def on(self, side: int, x: np.ndarray, contact: bool = False) -> Impacts:
        """The impacts on a branch, as `branch` has it from a flight or a contact state on."""
        return self.of[side] if side else self.stuck(x, contact)

    def stuck(self, x: np.ndarray, contact: bool = False) -> Impacts:
        """The machine while its spring sticks, with the force that keeps the extension of a flight or contact state."""
        free, pulled = (float(self._turns(each, x[None], contact)[0]) for each in self._pulls)
        return self._with(from_formula("stuck_force", "r", {"stuck_force": free / (free - pulled)}))

    def first(self, state: np.ndarray | None = None) -> Impacts:
        """The branch on which a motion from a flight state begins, by default the one on which launches are."""
        if state is not None:
            return self.of[self.branch(state)[0] or 1]
        forward = not self.model.one_speed or self.rate(self.of[1].launch(np.ones(1))[0]) >= 0
        return self.of[1 if forward else -1]

    def landed(self, x: np.ndarray) -> np.ndarray:
        """The branches (m,) that hold after plastic impacts at flight states (m, n)."""
        stuck = x - (x @ self.of[1].gap_speed)[:, None] * self.of[1].direction(x)
        return np.where(self.rate(stuck) >= 0, 1, -1)

    @cached_property
    def _contact_forces(self) -> dict[int, Affine]:
        """The contact force of each branch as a function of the rows of the contact's motion; of one in closed form,
        whose force is linear, as a function of the state."""
        found = {}
        for side, impacts in self.of.items():
            found[side], size = impacts.contact_force, impacts.contact.size
            if impacts.contact.phase.closed_form:
                at = impacts.contact.field(np.vstack([np.zeros(size), np.eye(size)]), impacts.p)[1]
                force = at[:, impacts.force_index]
                found[side] = Affine(tuple((force[1:] - force[0]).tolist()), float(force[0]))
        return found

    def hops(self, alpha: np.ndarray, cap: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """One hop from each of the launch speeds (m,): the next launch speeds (m,), the numbers (m,) of impacts, the
        statuses (m,), "" for a hop that is to be simulated alone, as where the spring sticks in flight, and the
        energies (m,) lost in impacts. One is "undecided" where a launch that is faster by some roundings ends in
        another way, see `decided_hops`."""
        if self.restitution < ROUNDING.many_bounces:
            return self._hops(alpha, cap)
        m = len(alpha)
        speeds, counts, status, lost = self._hops(np.concatenate([alpha, alpha * (1 + ROUNDING.neighbour)]), cap)
        apart = np.abs(np.nan_to_num(speeds[:m] - speeds[m:])) > ROUNDING.parted * np.nan_to_num(speeds[:m])
        other = (status[:m] != status[m:]) | (apart & (status[:m] == "lifts_off"))
        undecided = other & (status[:m] != "cap") & (status[:m] != "") & (status[m:] != "")
        status = np.where(undecided, "undecided", status[:m])
        return np.where(undecided, np.nan, speeds[:m]), counts[:m], status, lost[:m]

    def _hops(self, alpha: np.ndarray, cap: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        m, first = len(alpha), self.first()
        x = first.launch(np.minimum(alpha, FASTEST_LAUNCH))
        speeds, lost, counts, turns = np.full(m, np.nan), np.zeros(m), np.zeros(m, int), np.zeros(m, int)
        status = np.where(alpha > FASTEST_LAUNCH, "lost", np.where(first.opens(x), "", "no_launch")).astype(STATUS)
        side, turning = self.branches(x)
        order, left, standing = np.full(m, LIFTOFF_ORDER), first.longest_flight(x), np.zeros(m, bool)
        alone, remaining = np.zeros(m, bool), np.flatnonzero(status == "")
        for _ in range(cap):
            alone[remaining] |= (side[remaining] == 0) & ~standing[remaining]
            for sign in (1, -1):
                fly = remaining[(side[remaining] == sign) & ~standing[remaining] & ~alone[remaining]]
                if len(fly):
                    self._fly(sign, fly, x, order, turning, side, left, standing, counts, lost, status)
                stand = remaining[(side[remaining] == sign) & standing[remaining] & (status[remaining] == "")]
                stand = np.setdiff1d(stand, fly)
                if len(stand):
                    self._stand(sign, stand, x, turning, side, turns, speeds, status, alone)
            at_rest = standing & ((side == 0) | (turns == TURNS)) & (status == "")
            status[at_rest] = "rests"
            remaining = np.flatnonzero((status == "") & ~alone)
            if not len(remaining):
                break
        return speeds, counts, status, lost

    def _fly(self, sign: int, i, x, order, turning, side, left, standing, counts, lost, status) -> None:
        """Fly on one branch to the next event of the motions `i`, and update their states."""
        impacts = self.of[sign]
        until, rows, broken = self._first(impacts.flight, impacts.p, x[i], self.rate, left[i], turning[i])
        limit = np.where(np.isfinite(until), until, left[i])
        times, closed, errors = self._first(impacts.flight, impacts.p, x[i], impacts.gap, limit, order[i])
        lands, turned = np.isfinite(times), ~np.isfinite(times) & np.isfinite(until)
        status[i[~lands & ~turned]] = "carried_off"
        for k, error in {**broken, **errors}.items():
            if not lands[k] and not turned[k]:
                status[i[k]] = status_of_failure(error, "flight")
        if turned.any():
            j, order[i[turned]] = i[turned], 0
            x[j], left[j] = rows[turned, : x.shape[1]], left[j] - until[turned]
            side[j], turning[j] = self.branches(x[j])
        if lands.any():
            j, states = i[lands], closed[lands, : x.shape[1]]
            counts[j] += 1
            after_on = self.landed(states)
            for on in (1, -1):
                if len(own := np.flatnonzero(after_on == on)):
                    held, after, losses, _ = self.of[on].landing(states[own])
                    x[j[own]], standing[j[own]] = after, held
                    lost[j[own]] += losses
            order[j], left[j] = impacts.bounce_order, impacts.longest_flight(x[j])
            side[j], turning[j] = self.branches(x[j])
            if (down := j[standing[j]]).size:
                side[down], turning[down] = self.branches(x[down] @ impacts.onto_contact.T, contact=True)

    def _stand(self, sign: int, i, x, turning, side, turns, speeds, status, alone) -> None:
        """Stand on one branch to the next event of the contacts `i`, and update their states."""
        impacts = self.of[sign]
        y = x[i] @ impacts.onto_contact.T
        leaps = (turns[i] > 0) & (impacts.pressing(x[i]) < 0)  # the force jumps at a reversal
        limit = impacts.options.batch_contact * (1 + np.abs(y).max(1))
        until, rows, _ = self._first(impacts.contact, impacts.p, y, self.rate_in_contact, limit, turning[i])
        limit = np.where(np.isfinite(until), until, limit)
        times, lifted, _ = self._first(impacts.contact, impacts.p, y, self._contact_forces[sign], limit, 0)
        lifts = np.isfinite(times) & ~leaps
        turned = ~lifts & np.isfinite(until) & ~leaps
        status[i[leaps]] = "leaves_elsewhere"
        alone[i[~lifts & ~turned & ~leaps]] = True
        if lifts.any():
            speed, launches = impacts.liftoff(lifted[lifts, : y.shape[1]])
            status[i[lifts]] = np.where(launches, "lifts_off", "leaves_elsewhere")
            speeds[i[lifts]] = np.where(launches, speed, np.nan)
        if turned.any():
            j, ends = i[turned], rows[turned, : y.shape[1]]
            x[j], turns[j] = ends @ self.model.embed.T, turns[j] + 1
            side[j], turning[j] = self.branches(ends, contact=True)

    @staticmethod
    def _first(flow: Flow, p, starts, quantity: Affine, limit, skip) -> tuple[np.ndarray, np.ndarray, dict]:
        """The first zeros of a quantity, infinite times as NaN; none of a quantity that vanishes throughout."""
        if not any(quantity.weights):
            return np.full(len(starts), np.nan), np.zeros((len(starts), flow.size)), {}
        times, _, rows, errors = first_events(
            flow, starts, p, Watch(flow, [quantity]), limit, np.reshape(skip, (-1, 1))
        )
        return np.where(np.isinf(times), np.nan, times), rows, errors


def first_reversal(rate: Affine, order: int | None) -> Callable:
    """A test for the first zero of the rate, which has a zero of this order at the start; None for a rate that vanishes
    throughout, in which none is searched."""
    if order is None or not any(rate.weights):
        return lambda coefficients, steps: None
    return first_zero(rate, order)
