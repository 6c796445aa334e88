"""Hops impact by impact, and the slopes of the map at many launch speeds together.

The slope of a hop is its multiplier: the derivative of the next launch speed by the launch speed, which follows from
the equations of `cycle_statement` with their exact derivatives.
"""

from dataclasses import dataclass

import numpy as np

from ..flow.first_events import first_events
from ..numerics.roots import solve
from ..shooting.formulations import vector
from ..shooting.single_shooting import shooting_equations
from ..simulation.hand_over import landed
from ..simulation.impacts import LIFTOFF_ORDER, Impacts
from ..simulation.multiplier import TANGENTIAL
from .cycle_statement import INJECT, cycle_statement

MOST_IMPACTS = 100  # of a hop that is followed impact by impact


@dataclass(frozen=True, eq=False)
class FlownHops:
    """Hops from launch speeds (m,), impact by impact, of a machine whose launch is a speed.

    alphas : launch speeds (m,)
    starts : flight states (m, n) at the launches
    counts : numbers of impacts (m,), 0 where the hop is not followed to its end
    times, landings : times (m, k) of the flights and states (m, k, n) at the impacts, NaN behind the last one
    contacts : times (m,) of the contacts, NaN where there is no lift-off
    """

    alphas: np.ndarray
    starts: np.ndarray
    counts: np.ndarray
    times: np.ndarray
    landings: np.ndarray
    contacts: np.ndarray

    def unknowns(self, impacts: Impacts, which: np.ndarray) -> np.ndarray:
        """The unknowns (k, 3 + impacts) of the statement of one hop, of those hops `which` (k,) with one number of
        impacts."""
        liftoff = impacts.model.release(self.alphas[which], impacts.values)
        count = int(self.counts[which[0]])
        columns = np.broadcast_to(liftoff, len(which)), self.alphas[which], self.times[which, :count].T
        return np.vstack([*columns, self.contacts[which]]).T

    def slowest(self, impacts: Impacts) -> np.ndarray:
        """The least speeds (m,) of the gap at an impact, as a share of the launch speed."""
        return np.nanmin(np.abs(self.landings @ impacts.gap_speed), axis=1, initial=np.inf) / self.alphas


def flown_hops(impacts: Impacts, alphas: np.ndarray, most: int = MOST_IMPACTS) -> FlownHops:
    """The hops from launch speeds (m,) without a restitution, with a bounded number of impacts."""
    alphas, m, p = np.asarray(alphas, dtype=float), len(alphas), impacts.p
    starts = impacts.launch(alphas)
    times, landings, standing = list[np.ndarray](), list[np.ndarray](), np.full((m, impacts.contact.size), np.nan)
    state, order, counts = starts.copy(), np.full(m, LIFTOFF_ORDER), np.zeros(m, int)
    flying = np.flatnonzero(impacts.opens(starts))
    while len(flying) and len(times) < most:
        passed, feet, rows, _ = impacts.touchings(state[flying], order[flying], np.zeros(len(flying), int))
        down = np.isfinite(passed) & (feet < len(impacts.feet))
        flying, passed, rows = flying[down], passed[down], rows[down, : impacts.flight.size]
        times.append(np.full(m, np.nan))
        landings.append(np.full(starts.shape, np.nan))
        times[-1][flying], landings[-1][flying] = passed, rows
        found = landed(impacts, rows, np.zeros(len(flying), int))
        state[flying], order[flying] = found.state, found.order
        held = flying[found.held]
        standing[held], counts[held] = found.state[found.held] @ impacts.onto_contact.T, len(times)
        flying = flying[~found.held]
    contacts, stands = np.full(m, np.nan), np.flatnonzero(counts)
    if len(stands):
        ys = standing[stands]
        limit = impacts.options.batch_contact * (1 + np.abs(ys).max(1))
        grazes = impacts.grazes(ys)[0]
        contacts[stands] = first_events(impacts.contact, ys, p, impacts.contact_watch, limit, grazes).times
    contacts[~np.isfinite(contacts)] = np.nan
    return FlownHops(
        alphas, starts, np.where(np.isfinite(contacts), counts, 0), np.reshape(times, (-1, m)).T,
        np.reshape(landings, (-1, m, starts.shape[1])).swapaxes(0, 1), contacts,
    )  # fmt: skip


def slopes_of_hops(impacts: Impacts, alphas: np.ndarray) -> np.ndarray:
    """The slopes (m,) of the map at launch speeds (m,), as `multiplier` has them one by one; NaN where there is none:
    the machine does not lift off again, or lands tangentially.

    impacts : of a machine without a restitution whose launch is a speed, and whose spring has no hysteresis
    """
    slopes = np.full(np.shape(alphas), np.nan)
    if not len(slopes):
        return slopes
    hops = flown_hops(impacts, alphas)
    speeds, p = hops.slowest(impacts), {**impacts.values, INJECT: 0.0}
    for count in np.unique(hops.counts[hops.counts > 0]).tolist():
        which = np.flatnonzero((hops.counts == count) & (speeds > TANGENTIAL))
        equations = shooting_equations(cycle_statement(impacts.model, (count,)), tuple(p))
        if len(which):
            us = hops.unknowns(impacts, which)
            done, evaluation = equations.evaluate_lanes(us, np.tile(vector(p), (len(us), 1)), fewest=True)
            if evaluation is not None:
                slopes[which[done]] = slopes_of_jacobians(evaluation.jacobian)
    return slopes


def slopes_of_jacobians(jacobians: np.ndarray) -> np.ndarray:
    """The slopes (k,) from the derivatives (k, n, n) of the equations of one hop, or of a cycle. All but the last
    equation determine the other unknowns from the launch speed, the second unknown; the last is that of the next speed
    less this one."""
    others = np.delete(np.arange(jacobians.shape[1]), 1)
    rows, last = jacobians[:, :-1], jacobians[:, -1]
    moved = solve(rows[:, :, others], -rows[:, :, [1]])[:, :, 0]
    return np.einsum("ki,ki->k", last[:, others], moved) + last[:, 1] + 1.0
