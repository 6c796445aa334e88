"""Hops impact by impact, and the slopes of the map at many launch speeds together.

The slope of a hop is its multiplier: the derivative of the next launch speed by the launch speed, which follows from
the equations of `hop_statement` with their exact derivatives.
"""

from dataclasses import dataclass

import numpy as np

from ..hops.flyer import Flown, fly, stand
from ..hops.impacts import Impacts
from ..hops.multiplier import TANGENTIAL
from .hop_statement import hop_equations

MOST_IMPACTS = 100  # of a hop that is followed impact by impact


@dataclass(frozen=True, eq=False)
class FlownHops:
    """Hops from launch speeds (m,), impact by impact, of a machine whose launch is a speed.

    alphas : launch speeds (m,)
    starts : flight states (m, n) at the launches
    counts : numbers of impacts (m,), 0 where the hop is not followed to its end
    times, landings : times (m, k) of the flights and states (m, k, n) at the impacts, NaN behind the last one
    contacts, ends : times (m,) of the contacts and states (m, j) at their ends, NaN where there is no lift-off
    """

    alphas: np.ndarray
    starts: np.ndarray
    counts: np.ndarray
    times: np.ndarray
    landings: np.ndarray
    contacts: np.ndarray
    ends: np.ndarray

    def unknowns(self, impacts: Impacts, which: np.ndarray) -> np.ndarray:
        """The unknowns (k, n) of the statement of one hop, of those hops `which` (k,) with one number of impacts."""
        count, places = int(self.counts[which[0]]), [*impacts.model.launch_places.values()]
        launches = (self.starts[which] @ impacts.onto_contact.T)[:, places]
        return np.column_stack([launches, self.times[which, :count], self.contacts[which]])

    def slowest(self, impacts: Impacts) -> np.ndarray:
        """The least speeds (m,) of the gap at an impact, as a share of the launch speed."""
        return np.nanmin(np.abs(self.landings @ impacts.gap_speed), axis=1, initial=np.inf) / self.alphas


def flown_hops(
    impacts: Impacts, alphas: np.ndarray, most: int = MOST_IMPACTS, starts: np.ndarray | None = None
) -> FlownHops:
    """The hops from launch speeds (m,), or from flight states (m, n) at lift-off, without a restitution, with a bounded
    number of impacts."""
    alphas = np.asarray(alphas, dtype=float)
    hops = Flown.begun(impacts, impacts.launch(alphas) if starts is None else starts, record=True)
    fly(impacts, hops, most)
    stand(impacts, hops)
    m, flights = len(alphas), hops.flights or []
    times, landings = np.full((m, len(flights)), np.nan), np.full((m, len(flights), hops.starts.shape[1]), np.nan)
    for i, (lanes, lasted, states) in enumerate(flights):
        times[lanes, i], landings[lanes, i] = lasted, states
    counts = np.where(np.isfinite(hops.contacts), hops.impacts, 0)
    return FlownHops(alphas, hops.starts, counts, times, landings, hops.contacts, hops.ends)


def slopes_of_hops(impacts: Impacts, alphas: np.ndarray) -> np.ndarray:
    """The slopes (m,) of the map at launch speeds (m,), as `multiplier` has them one by one; NaN where there is none:
    the machine does not lift off again, or lands tangentially.

    impacts : of a machine without a restitution whose launch is a speed, and whose spring has no hysteresis
    """
    slopes = np.full(np.shape(alphas), np.nan)
    if not len(slopes):
        return slopes
    hops = flown_hops(impacts, alphas)
    speeds = hops.slowest(impacts)
    for count in np.unique(hops.counts[hops.counts > 0]).tolist():
        which = np.flatnonzero((hops.counts == count) & (speeds > TANGENTIAL))
        if len(which):
            us, hop = hops.unknowns(impacts, which), hop_equations(impacts.model, count, tuple(impacts.values))
            done, found = hop.equations.evaluate_lanes(us, np.tile(impacts.p, (len(us), 1)), fewest=True)
            if found is not None:
                slopes[which[done]] = hop.derivatives(found.jacobian)[:, 0, 0]
    return slopes
