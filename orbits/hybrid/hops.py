"""Hops as a batch: from launch speeds at lift-off after sustained contact to those at the next such lift-off.

A hop is a flight, impacts after which the machine leaves at once, and a sustained contact. The loss of a hop is the sum
of the losses of its impacts. It is not the difference of launch speeds: near a lossless orbit the loss vanishes like
the power 4/3 of the distance, and the difference would be rounding.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .impacts import LIFTOFF_ORDER, STATUS, Impacts, status_of_failure


@dataclass(frozen=True)
class Hops:
    """The outcome of launches, each array of the launch speeds' shape.

    alpha : launch speeds
    next : launch speed at the next lift-off, with the injection, NaN where there is none
    loss : loss of alpha**2 in the hop before the injection, or in its impacts where there is no next launch
    impacts : number of impacts in between
    status : "lifts_off", or why there is no next launch: a name of `orbits.hybrid.impacts.STATUSES`
    """

    alpha: np.ndarray
    next: np.ndarray
    loss: np.ndarray
    impacts: np.ndarray
    status: np.ndarray

    def document(self) -> dict[str, Any]:
        """The hops as the JSON document of the command line."""
        columns = {
            name: np.ravel(getattr(self, name)).tolist() for name in ("alpha", "next", "loss", "impacts", "status")
        }
        return {**columns, "next": [None if np.isnan(value) else value for value in columns["next"]]}


def hops_from(impacts: Impacts, alpha: np.ndarray, inject: float, cap: int) -> Hops:
    """One hop from each of the launch speeds (m,), given up after `cap` impacts, with `inject` added to the next."""
    loss, counts, status, standing = _flights_and_impacts(impacts, alpha, cap)
    next_speed, loss, status = _next_launches(impacts, alpha, loss, status, standing)
    next_speed += inject
    stopped = next_speed <= 0
    status[stopped], next_speed[stopped] = "rests", np.nan
    return Hops(alpha, next_speed, loss, counts, status)


def _flights_and_impacts(impacts: Impacts, alpha, cap: int):
    """Losses, numbers of impacts, statuses (m,) and contact states (m, k) up to sustained contact ("lifts_off")."""
    m = len(alpha)
    loss, counts, status = np.zeros(m), np.zeros(m, int), np.full(m, "no_launch", dtype=STATUS)
    state, standing = impacts.launch(alpha), np.zeros((m, impacts.contact.size))
    flying, order = np.flatnonzero(impacts.opens(state)), LIFTOFF_ORDER
    status[flying] = "cap"
    for _ in range(cap):
        start = state[flying]
        times, rows, errors = impacts.flight.first_zeros(
            start, impacts.p, impacts.gap, impacts.longest_flight(start), order
        )
        gone, order = np.isnan(times), impacts.bounce_order
        status[flying[gone]] = "carried_off"
        for i, error in errors.items():
            status[flying[i]] = status_of_failure(error, "flight")
        flying = flying[~gone]
        if not len(flying):
            break
        landing = impacts.landing(rows[~gone, : impacts.flight.size])
        counts[flying] += 1
        loss[flying] += 2 * landing.loss / impacts.launch_inertia
        held = flying[landing.held]
        standing[held], status[held] = landing.state[landing.held] @ impacts.onto_contact.T, "lifts_off"
        state[flying] = landing.state
        flying = flying[~landing.held]
        if not len(flying):
            break
    return loss, counts, status, standing


def _next_launches(impacts: Impacts, alpha, loss, status, standing):
    """Next launch speeds without injection, losses and statuses (m,) of hops that stand in contact (m, k)."""
    next_speed, loss, status = np.full(len(alpha), np.nan), loss.copy(), status.copy()
    left, lifting = alpha**2 - loss, np.flatnonzero(status == "lifts_off")
    if impacts.contact.phase.closed_form:  # The force is linear: the energy alone decides whether it vanishes.
        status[lifting[left[lifting] < 0]] = "rests"
    elif len(lifting):
        status[lifting], ends = impacts.sustained_contacts(standing[lifting])
        ended = status[lifting] == "lifts_off"
        lifting = lifting[ended]
        speed, launches = impacts.liftoff(ends[ended])
        status[lifting[~launches]] = "leaves_elsewhere"
        if not impacts.model.conservative:
            lifting, speed = lifting[launches], speed[launches]
            left[lifting] = speed**2
            loss[lifting] = alpha[lifting] ** 2 - left[lifting]
    lifting = np.flatnonzero(status == "lifts_off")
    next_speed[lifting] = np.sqrt(np.maximum(left[lifting], 0.0))
    return next_speed, loss, status
