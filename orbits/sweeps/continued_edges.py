"""Boundaries from continued orbits: up to where they end, or become motions or none.

Where an orbit is known on one side of a boundary, it is continued towards the other side by halving the way that is
left, for all boundaries together. The statuses of the lowest orbits on both sides of what is found confirm it.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from ..running import interrupts
from .sparse_grid import NO_ORBIT

# Points (m, 2), and unknowns (m, n) nearby or None for the lowest orbits -> statuses (m,), "" where they are not
# settled, unknowns (m, n), and errors (m,) as shares of the launch speeds.
Settled: TypeAlias = Callable[[np.ndarray, np.ndarray | None], tuple[np.ndarray, np.ndarray, np.ndarray]]

# Where the errors of orbits have grown to this share, rounding decides where they are lost: they grow without bound.
LOST_BY_ROUNDING = 1e-8


def continued_edges(
    settled: Settled, points_at: Callable[[np.ndarray, np.ndarray], np.ndarray], starts: np.ndarray, ends: np.ndarray,
    statuses: np.ndarray, width: float,
) -> np.ndarray:  # fmt: skip
    """The places (k,) at which orbits at starts (k,) no longer have their status on the way to ends (k,), whose
    statuses are `statuses` (k, 2); to a `width`, NaN where this cannot be confirmed.

    points_at : (which (m,) of the ways, places (m,) on them) -> points (m, 2)

    Where no orbit is found beyond, neither by Newton's method from the last orbit nor in a search of all members
    together, orbits end there; and so they do where rounding decides what is found.
    """
    found, (own, us, errors) = np.full(len(starts), np.nan), settled(points_at(np.arange(len(starts)), starts), None)
    if not len(which := np.flatnonzero(own == statuses[:, 0])):
        return found
    us, errors, near, far = us[which], errors[which], starts[which], ends[which]
    before, us_before = np.full(len(which), np.nan), np.full(us.shape, np.nan)
    while len(wide := np.flatnonzero(np.abs(far - near) > width)):
        interrupts.heed()
        middle = 0.5 * (near + far)[wide]
        points = points_at(which[wide], middle)
        guesses = _unknowns_ahead(us[wide], us_before[wide], near[wide], before[wide], middle, far[wide])
        new, unknowns, shares = settled(points, guesses)
        if len(again := np.flatnonzero((new == "") & (guesses != us[wide]).any(1))):
            new[again], unknowns[again], shares[again] = settled(points[again], us[wide[again]])
        same = new == statuses[which[wide], 0]
        on, off = wide[same], wide[~same]
        us_before[on], before[on] = us[on], near[on]
        us[on], near[on], errors[on], far[off] = unknowns[same], middle[same], shares[same], middle[~same]
    sides, *_ = settled(points_at(np.tile(which, 2), np.concatenate([near, far])), None)
    (inner, outer), (first, last) = np.split(sides, 2), statuses[which].T
    good = (inner == first) & ((outer == last) | ((outer == "") & (last == NO_ORBIT)))
    good |= (errors > LOST_BY_ROUNDING) & ((inner == first) | (inner == "")) & (last == NO_ORBIT)
    found[which[good]] = 0.5 * (near + far)[good]
    return found


def _unknowns_ahead(
    us: np.ndarray, us_before: np.ndarray, near: np.ndarray, before: np.ndarray, new: np.ndarray, far: np.ndarray
) -> np.ndarray:
    """Unknowns (k, n) at places `new` (k,) of ways, from those at `near` and `before`: on powers of the distance from
    `far`, where they may grow without bound; where there is none before, those at `near`."""
    with np.errstate(all="ignore"):
        rounds = np.log((far - new) / (far - near)) / np.log((far - near) / (far - before))
        guesses = us * (us / us_before) ** rounds[:, None]
    return np.where(np.isfinite(guesses).all(1)[:, None], guesses, us)
