"""Hops followed in lanes from their launches through all impacts, up to sustained contact or to another end.

After many bounces rounding may decide how a hop ends: neighbouring launches show where it does.
"""

from collections.abc import Callable

import numpy as np

from .footing import FALLS
from .hand_over import landed
from .impacts import FASTEST_LAUNCH, LIFTOFF_ORDER, STATUS, Impacts, status_of_failure

# From this restitution on, the end of many bounces is compared with that of a neighbouring launch, faster by a relative
# difference beyond the roundings of a flight. States with a relative difference above the last belong to other motions.
MANY_BOUNCES, NEIGHBOUR, PARTED = 0.5, 1e-14, 1e-4
# From this number of impacts on, a motion that comes back to an earlier state, up to rounding, repeats itself.
FIRST_REPETITION, REPETITION = 32, 1e-13


def decided_impacts(impacts: Impacts, alpha: np.ndarray, cap: int) -> tuple[np.ndarray, ...]:
    """`impacts_from` launches with speeds (m,), with losses of the launch speed's square."""
    too_fast, followed = alpha > FASTEST_LAUNCH, np.minimum(alpha, FASTEST_LAUNCH)
    nearly = np.minimum(alpha * (1 + NEIGHBOUR), FASTEST_LAUNCH)
    neighbours, per = impacts.launch(nearly) if impacts.restitution >= MANY_BOUNCES else None, impacts.launch_inertia
    return impacts_from(impacts, impacts.launch(followed), cap, neighbours, 0.5 * per, followed**2, too_fast)


def decided_from(impacts: Impacts, states: np.ndarray, cap: int) -> tuple[np.ndarray, ...]:
    """`impacts_from` flight states (m, n) at lift-off, of launches of several numbers."""
    speeds = [name.endswith("'") for name in impacts.flight.phase.states]
    neighbours = states * np.where(speeds, 1 + NEIGHBOUR, 1.0) if impacts.restitution >= MANY_BOUNCES else None
    return impacts_from(impacts, states, cap, neighbours)


def impacts_from(
    impacts: Impacts, states: np.ndarray, cap: int, neighbours: np.ndarray | None = None, per: float = 1.0,
    available: np.ndarray | float = np.inf, too_fast: np.ndarray | None = None,
) -> tuple[np.ndarray, ...]:  # fmt: skip
    """The impacts of hops from flight states (m, n) at lift-off; each hop is abandoned after `cap` impacts.

    neighbours : states (m, n) that differ by some roundings; None where bounces are few
    per : the unit of energy of the losses
    available : losses (m,) of a conservative machine beyond which it rests in any case
    too_fast : whether (m,) the launch is too fast to be followed, with the status "lost"

    Returns the losses (m,) of energy, the numbers (m,) of impacts, the statuses (m,), and the contact states (m, k)
    where sustained contact begins, with the status "lifts_off". The status is "undecided" where the neighbour leads to
    another motion after many bounces. It is not "undecided" where the remaining energy is too little for any launch.
    """
    m = len(states)
    too_fast = np.zeros(m, bool) if too_fast is None else too_fast
    if neighbours is None:
        return _flights_and_impacts(impacts, states, too_fast, per, cap)
    parted, undecided = np.zeros((2, m), bool)

    def compare(states: np.ndarray, loss: np.ndarray) -> None:
        far = np.abs(states[:m] - states[m:]).max(1) > PARTED * np.abs(states[:m]).max(1)
        spent = impacts.model.conservative & (loss[:m] > available)
        undecided[far & ~parted & ~spent] = True
        parted[far] = True

    both = np.concatenate([states, neighbours])
    loss, counts, status, standing = _flights_and_impacts(impacts, both, np.tile(too_fast, 2), per, cap, compare)
    undecided &= status[:m] != "cap"
    status[:m][undecided | (status[:m] != status[m:])] = "undecided"
    return loss[:m], counts[:m], status[:m], standing[:m]


def _flights_and_impacts(
    impacts: Impacts, state: np.ndarray, too_fast: np.ndarray, per: float, cap: int, watch: Callable | None = None
) -> tuple[np.ndarray, ...]:
    """Losses, numbers of impacts, statuses (m,) and contact states (m, k) up to sustained contact ("lifts_off");
    `watch` is called after every impact with the states (m, n), constant in contact, and the losses so far (m,)."""
    m = len(state)
    loss, counts, status = np.zeros(m), np.zeros(m, int), np.full(m, "no_launch", dtype=STATUS)
    state, standing = state.copy(), np.zeros((m, impacts.contact.size))
    flying = np.flatnonzero(impacts.opens(state) & ~too_fast)
    order, foot = np.full(m, LIFTOFF_ORDER), np.zeros(m, int)
    status[flying], status[too_fast] = "cap", "lost"
    earlier, compared = np.full_like(state, np.nan), FIRST_REPETITION
    for impact in range(cap):
        times, touches, rows, errors = impacts.touchings(state.take(flying, 0), order[flying], foot[flying])
        gone = np.isnan(times)
        status[flying[gone]] = "carried_off"
        for i, error in errors.items():
            status[flying[i]] = status_of_failure(error, "flight")
        falls = touches >= len(impacts.feet)
        status[flying[falls]], gone = FALLS, gone | falls
        flying = flying[~gone]
        if not len(flying):
            break
        found = landed(impacts, rows.compress(~gone, 0)[:, : impacts.flight.size], touches[~gone])
        counts[flying] += 1
        loss[flying] += found.loss / per
        down = flying[found.held]
        standing[down], status[down] = found.state.compress(found.held, 0) @ impacts.onto_contact.T, "lifts_off"
        state[flying], order[flying], foot[flying] = found.state, found.order, found.foot
        if watch:
            watch(state, loss)
        over = found.ended != ""
        status[flying[over]] = found.ended[over]
        flying = flying[~found.held & ~over]
        if impact >= FIRST_REPETITION:
            # Motions that repeat themselves, as on a heavy hand, have impacts without end.
            here, there = state.take(flying, 0), earlier.take(flying, 0)
            repeats = np.abs(here - there).max(1) <= REPETITION * np.abs(here).max(1)
            if repeats.any():
                counts[flying[repeats]], flying = cap, flying[~repeats]
            if impact == compared:  # as in Brent's method for cycles
                earlier, compared = state.copy(), 2 * compared
        if not len(flying):
            break
    return loss, counts, status, standing
