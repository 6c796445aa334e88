"""Hops impact by impact: the unknowns of their statement."""

from dataclasses import dataclass

import numpy as np

from ..hops import Flown, Flyer, Impacts

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


def flown_hops(
    impacts: Impacts, alphas: np.ndarray, most: int = MOST_IMPACTS, starts: np.ndarray | None = None
) -> FlownHops:
    """The hops from launch speeds (m,), or from flight states (m, n) at lift-off, without a restitution, with a bounded
    number of impacts."""
    alphas = np.asarray(alphas, dtype=float)
    hops = Flown.begun(impacts, impacts.launch(alphas) if starts is None else starts, record=True)
    Flyer(impacts, hops, most).fly()
    m, flights = len(alphas), hops.flights
    times, landings = np.full((m, len(flights)), np.nan), np.full((m, len(flights), hops.starts.shape[1]), np.nan)
    for i, arc in enumerate(flights):
        times[arc.lanes, i], landings[arc.lanes, i] = arc.durations, arc.ends
    counts = np.where(np.isfinite(hops.contacts), hops.impacts, 0)
    return FlownHops(alphas, hops.starts, counts, times, landings, hops.contacts, hops.ends)
