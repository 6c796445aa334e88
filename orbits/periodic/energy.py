"""How far the energy of solved orbits drifts, from its gradient alone: no potential is needed in closed form."""

from collections.abc import Callable, Mapping
from functools import lru_cache

import casadi as ca
import numpy as np

from ..flow.flow import flow_of
from ..flow.trajectory import Trajectories
from ..model.model import Model
from ..model.phase import Phase
from ..numerics.quadrature import GAUSS, GAUSS_PLACES, GAUSS_WEIGHTS
from ..symbolic.calls import ElementwiseFunction
from .error_bound import EPS
from .solution import Cycles, columns


@lru_cache(maxsize=64)
def gradients(phase: Phase, gradient: Callable, parameters: tuple[str, ...]) -> ElementwiseFunction:
    """An energy gradient of a model at several points, (x, parameters with the data of a piece)."""
    flow = flow_of(phase, parameters)
    x = ca.SX.sym("x", flow.size)
    p = ca.SX.sym("p", len(parameters) + (phase.pieces.size if phase.pieces else 0))
    return ElementwiseFunction(ca.Function("gradient", [x, p], [ca.vertcat(*gradient(*flow.symbols(x, p)))]))


def energy_changes(model: Model, cycles: Cycles) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The largest changes of energy on each half of a flight and on its contact, (m, halves + 1); how much of them the
    rounding of the states explains, of the same shape; and the energy's gradients (m, n) at launch."""
    changes, floors = np.zeros((2, len(cycles), cycles.halves_per_flight + 1))
    *flown, starts = _work(model.flight, model.flight_gradient, cycles.halves, cycles.p_of_halves)
    changes[:, :-1], floors[:, :-1] = (values.reshape(len(cycles), -1) for values in flown)
    if cycles.contacts:
        stood = _work(model.contact, model.contact_gradient, cycles.contacts, cycles.p_of_contacts)
        changes[cycles.with_contact, -1], floors[cycles.with_contact, -1], _ = stood
    return changes, floors, starts[:: cycles.halves_per_flight]


def _work(
    phase: Phase, gradient: Callable, motions: Trajectories, p: Mapping
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The largest change of energy (m,) of each motion, that of rounding (m,), and the gradient at its start (m, n).

    The change is the work of the gradient on the straight lines between the ends of the steps.
    """
    flow = flow_of(phase, tuple(p))
    n = flow.size
    states = motions.coefficients[:, :n, 0]
    after = np.roll(states, -1, axis=0)
    after[motions.last] = motions.finals[:, :n]
    moves = after - states
    data = flow.data_of(motions, columns(p.values()))
    points = states[:, None] + GAUSS_PLACES[:, None] * moves[:, None]
    call = gradients(phase, gradient, tuple(p))
    rates = call(points.reshape(-1, n), np.repeat(data, GAUSS, axis=0))[0].reshape(-1, GAUSS, n)
    changes = np.cumsum(((GAUSS_WEIGHTS @ rates) * moves).sum(1))
    before = np.where(motions.first > 0, changes[motions.first - 1], 0.0)
    largest = motions.largest(changes - np.repeat(before, motions.counts))
    floors = EPS * motions.largest(states) * motions.largest(rates)
    (starts,) = call(states[motions.first], data[motions.first])
    return largest, floors, starts
