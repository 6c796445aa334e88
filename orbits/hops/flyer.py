"""Hops flown in lanes: from lift-off through all impacts to sustained contact, and through it to the next lift-off.

After many bounces rounding may decide how a hop ends: neighbouring launches show where it does.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..flow.first_events import first_events
from .feet import LIFTS_OFF, STEPS_BACK
from .footing import FALLS
from .hand_over import landed
from .impacts import CAP, FASTEST_LAUNCH, LIFTOFF_ORDER, STATUS, Impacts, status_of_failure


@dataclass(frozen=True, kw_only=True)
class Rounding:
    """Where rounding decides how a hop ends.

    many_bounces : from this restitution on, the end is compared with that of a neighbouring launch
    neighbour : whose speeds are larger by this share, beyond the roundings of a flight
    parted : states that differ by a larger share belong to other motions
    first_repetition, repetition : from this number of impacts on, a motion that comes back to an earlier state, up to
        this share, repeats itself
    """

    many_bounces: float = 0.5
    neighbour: float = 1e-14
    parted: float = 1e-4
    first_repetition: int = 32
    repetition: float = 1e-13


ROUNDING = Rounding()


@dataclass(eq=False)
class Flown:
    """Hops that are flown from m flight states at lift-off.

    starts : flight states (m, n)
    status : (m,), "lifts_off", or how else they end
    loss, impacts : energies (m,) lost in impacts, and their numbers (m,)
    standing, ends : contact states (m, k) where sustained contact begins, and where it ends
    contacts : times (m,) of the contacts that end with a launch's lift-off, NaN for others
    flights : where they are recorded, of each impact in turn the lanes (k,), the times (k,) since the impact before and
        the flight states (k, n)
    """

    starts: np.ndarray
    status: np.ndarray
    loss: np.ndarray
    impacts: np.ndarray
    standing: np.ndarray
    ends: np.ndarray
    contacts: np.ndarray
    flights: list[tuple[np.ndarray, np.ndarray, np.ndarray]] | None = None

    @classmethod
    def begun(cls, impacts: Impacts, starts: np.ndarray, record: bool = False) -> "Flown":
        """Hops that are about to be flown; a spring that no flight has is refused."""
        if impacts.flight.phase.closed_form:
            impacts.flight.closed_form(impacts.p)
        m, (standing, ends) = len(starts), np.full((2, len(starts), impacts.contact.size), np.nan)
        status = np.where(impacts.opens(starts), "", "no_launch").astype(STATUS)
        loss, counts, contacts = np.zeros(m), np.zeros(m, int), np.full(m, np.nan)
        return cls(starts, status, loss, counts, standing, ends, contacts, [] if record else None)


def fly(impacts: Impacts, hops: Flown, cap: int = CAP, after_impact: Callable | None = None) -> None:
    """Fly hops with the status "" up to sustained contact, "lifts_off", or to another end; each is abandoned after
    `cap` impacts. `after_impact` is called with states (m, n), which are constant in contact, and losses (m,)."""
    state, lanes = hops.starts.copy(), np.flatnonzero(hops.status == "")
    order, foot = np.full(len(state), LIFTOFF_ORDER), np.zeros(len(state), int)
    earlier, compared = np.full_like(state, np.nan), ROUNDING.first_repetition
    for impact in range(cap):
        if not len(lanes):
            break
        x = state[lanes]
        limit = impacts.longest_flight(x)
        orders = order[lanes, None] * (np.arange(len(impacts.feet)) == foot[lanes, None])
        found = first_events(impacts.flight, x, impacts.p, impacts.flight_watch, limit, orders)
        touches, times, rows = found.which, found.times, found.rows[:, : impacts.flight.size]
        lands = (touches >= 0) & (touches < len(impacts.feet))
        if not lands.all():
            hops.status[lanes[~lands]] = np.where(touches[~lands] < 0, "carried_off", FALLS)
            for i, error in found.failed.items():
                hops.status[lanes[i]] = status_of_failure(error, "flight")
            lanes, touches, times, rows = lanes[lands], touches[lands], times[lands], rows[lands]
            if not len(lanes):
                break
        if hops.flights is not None:
            hops.flights.append((lanes, times, rows))
        after = landed(impacts, rows, touches)
        hops.impacts[lanes] += 1
        hops.loss[lanes] += after.loss
        state[lanes], order[lanes], foot[lanes] = after.state, after.order, after.foot
        hops.status[lanes] = np.where(after.held, LIFTS_OFF, after.ended)
        down = lanes[after.held]
        hops.standing[down] = after.state[after.held] @ impacts.onto_contact.T
        if after_impact:
            after_impact(state, hops.loss)
        lanes = lanes[~after.held & (after.ended == "")]
        if impact >= ROUNDING.first_repetition:
            # Motions that repeat themselves, as on a heavy hand, have impacts without end.
            here, there = state[lanes], earlier[lanes]
            repeats = np.abs(here - there).max(1) <= ROUNDING.repetition * np.abs(here).max(1)
            hops.impacts[lanes[repeats]], lanes = cap, lanes[~repeats]
            if impact == compared:  # as in Brent's method for cycles
                earlier, compared = state.copy(), 2 * compared
    hops.status[hops.status == ""] = "cap"


def stand(impacts: Impacts, hops: Flown) -> None:
    """Follow the sustained contacts of hops with the status "lifts_off" to their ends."""
    lanes = np.flatnonzero(hops.status == LIFTS_OFF)
    if not len(lanes):
        return
    contact, ys = impacts.contact, hops.standing[lanes]
    limit = np.inf if contact.phase.closed_form else impacts.options.batch_contact * (1 + np.abs(ys).max(1))
    found = first_events(contact, ys, impacts.p, impacts.contact_watch, limit, impacts.grazes(ys).T)
    names = np.array([*(each.outcome for each in impacts.exits), FALLS, ""], STATUS)
    status = np.where(np.isinf(found.times), impacts.most_turns[1], names[found.which])
    hops.contacts[lanes] = np.where(found.which == 0, found.times, np.nan)
    hops.ends[lanes] = found.rows[:, : contact.size]
    for i in np.flatnonzero(status == "").tolist():
        path, status[i], _ = impacts.sustained_contact(ys[i])
        if path is not None:
            hops.ends[lanes[i]] = path.end[: contact.size]
    if (back := status == STEPS_BACK).any():  # a launch in other labels, where the same point opens
        way, own = impacts.exits[1], lanes[back]
        status[back] = "leaves_elsewhere" if way.foot else LIFTS_OFF
        hops.ends[own] = way.opened(hops.ends[own] @ impacts.model.embed.T, impacts.values) @ impacts.onto_contact.T
    hops.status[lanes] = status


def hops_of_speeds(impacts: Impacts, alpha: np.ndarray, cap: int) -> Flown:
    """Hops from launches with speeds (m,) up to sustained contact."""
    too_fast, followed = alpha > FASTEST_LAUNCH, np.minimum(alpha, FASTEST_LAUNCH)
    nearly, many = np.minimum(alpha * (1 + ROUNDING.neighbour), FASTEST_LAUNCH), impacts.restitution
    neighbours = impacts.launch(nearly) if many >= ROUNDING.many_bounces else None
    available = 0.5 * impacts.launch_inertia * followed**2 if impacts.model.conservative else np.inf
    return decided_hops(impacts, impacts.launch(followed), cap, neighbours, available, too_fast)


def hops_of_states(impacts: Impacts, states: np.ndarray, cap: int) -> Flown:
    """Hops from flight states (m, n) at lift-off, of launches of several numbers, up to sustained contact."""
    speeds = [name.endswith("'") for name in impacts.flight.phase.states]
    many = impacts.restitution >= ROUNDING.many_bounces
    return decided_hops(impacts, states, cap, states * np.where(speeds, 1 + ROUNDING.neighbour, 1.0) if many else None)


def decided_hops(
    impacts: Impacts, states: np.ndarray, cap: int, neighbours: np.ndarray | None = None,
    available: np.ndarray | float = np.inf, too_fast: np.ndarray | None = None,
) -> Flown:  # fmt: skip
    """Hops from flight states (m, n) at lift-off up to sustained contact.

    neighbours : states (m, n) that differ by some roundings; None where bounces are few
    available : losses (m,) of energy beyond which the machine rests in any case
    too_fast : whether (m,) the launch is too fast to be followed, with the status "lost"

    The status is "undecided" where the neighbour leads to another motion after many bounces. It is not "undecided"
    where the remaining energy is too little for any launch.
    """
    m = len(states)
    hops = Flown.begun(impacts, states if neighbours is None else np.concatenate([states, neighbours]))
    if too_fast is not None and too_fast.any():
        hops.status[np.resize(too_fast, len(hops.status))] = "lost"
    if neighbours is None:
        fly(impacts, hops, cap)
        return hops
    parted, undecided = np.zeros((2, m), bool)

    def compare(states: np.ndarray, loss: np.ndarray) -> None:
        far = np.abs(states[:m] - states[m:]).max(1) > ROUNDING.parted * np.abs(states[:m]).max(1)
        undecided[far & ~parted & ~(loss[:m] > available)] = True
        parted[far] = True

    fly(impacts, hops, cap, compare)
    own = replace(hops, **{name: each[:m] for name, each in vars(hops).items() if each is not None})
    undecided &= own.status != "cap"
    own.status[undecided | (own.status != hops.status[m:])] = "undecided"
    return own
