"""Hops of many launches at once, with the statuses of launches that rounding decides.

After many bounces rounding may decide how a hop ends: neighbouring launches show where it does.
"""

import numpy as np

from .arcs import Flown, Rules
from .flyer import ROUNDING, Flyer
from .hop_inputs import Course
from .hysteresis import Branches
from .impacts import FASTEST_LAUNCH, Impacts
from .points_of_contact import LIFTS_OFF


def hops_of_speeds(rules: Rules, alpha: np.ndarray, cap: int) -> Flown:
    """Hops from launches with speeds (m,), up to sustained contact, of a spring with hysteresis through it."""
    impacts, too_fast, followed = rules.first(), alpha > FASTEST_LAUNCH, np.minimum(alpha, FASTEST_LAUNCH)
    nearly, many = np.minimum(alpha * (1 + ROUNDING.neighbour), FASTEST_LAUNCH), impacts.restitution
    neighbours = impacts.launch(nearly) if many >= ROUNDING.many_bounces else None
    available = 0.5 * impacts.launch_inertia * followed**2 if impacts.model.conservative else np.inf
    return decided_hops(rules, impacts.launch(followed), cap, neighbours, available, too_fast)


def hops_of_states(impacts: Impacts, states: np.ndarray, cap: int) -> Flown:
    """Hops from flight states (m, n) at lift-off, of launches of several numbers, up to sustained contact."""
    speeds = [name.endswith("'") for name in impacts.flight.phase.states]
    many = impacts.restitution >= ROUNDING.many_bounces
    return decided_hops(impacts, states, cap, states * np.where(speeds, 1 + ROUNDING.neighbour, 1.0) if many else None)


def decided_hops(
    rules: Rules, states: np.ndarray, cap: int, neighbours: np.ndarray | None = None,
    available: np.ndarray | float = np.inf, too_fast: np.ndarray | None = None,
) -> Flown:  # fmt: skip
    """Hops from flight states (m, n) at lift-off up to sustained contact, of a spring with hysteresis through it.

    neighbours : states (m, n) that differ by some roundings; None where bounces are few
    available : losses (m,) of energy beyond which the machine rests in any case
    too_fast : whether (m,) the launch is too fast to be followed, with the status "lost"

    The status is "undecided" where the neighbour leads to another motion after many bounces. It is not "undecided"
    where the remaining energy is too little for any launch.
    """
    m, branches = len(states), isinstance(rules, Branches)
    hops = Flown.begun(rules, states if neighbours is None else np.concatenate([states, neighbours]))
    if too_fast is not None and too_fast.any():
        hops.status[np.resize(too_fast, len(hops.status))] = "lost"
    parted, undecided = np.zeros((2, m), bool)

    def compare(states: np.ndarray, loss: np.ndarray) -> None:
        far = np.abs(states[:m] - states[m:]).max(1) > ROUNDING.parted * np.abs(states[:m]).max(1)
        undecided[far & ~parted & ~(loss[:m] > available)] = True
        parted[far] = True

    flyer = Flyer(rules, hops, cap, None if neighbours is None or branches else compare)
    if branches:
        flyer.fly()
    else:
        flyer.to_contact()
    if neighbours is None:
        return hops
    own, other = hops.of(slice(m)), hops.of(slice(m, None))
    if branches:  # reversals part the events of neighbours, and their launches alone are compared
        speeds = np.nan_to_num([own.speeds, other.speeds])
        undecided = (own.status == LIFTS_OFF) & (np.abs(speeds[0] - speeds[1]) > ROUNDING.parted * speeds[0])
        undecided |= own.status != other.status
    undecided &= own.status != "cap"
    own.status[undecided | (own.status != other.status)] = "undecided"
    return own


def undecided(course: Course, rules: Rules, cap: int) -> bool:
    """Whether rounding decides how the hop of a simulation ends that has just landed, by the test of the map."""
    impacts = rules.first()
    if impacts.restitution < ROUNDING.many_bounces or course.launch is None:
        return False
    if not impacts.model.one_speed:
        if course.driven or rules is not impacts:
            return False  # such hops have no map
        return bool(hops_of_states(impacts, course.launch[None], cap).status[0] == "undecided")
    alpha = np.array([course.speed])
    launched = alpha[0] > 0 and np.array_equal(impacts.launch(alpha)[0], course.launch)
    return bool(launched and hops_of_speeds(rules, alpha, cap).status[0] == "undecided")


def stand(impacts: Impacts, hops: Flown) -> None:
    """Follow the sustained contacts of hops with the status "lifts_off" to their ends."""
    Flyer(impacts, hops).fly()
