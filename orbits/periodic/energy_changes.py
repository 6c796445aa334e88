"""Changes of energy along motions: the work of the energy's gradient between the ends of their steps."""

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from ..flow import Trajectories, flow_of
from ..model import Model, Phase
from ..numerics import GAUSS_PLACES, GAUSS_WEIGHTS
from ..shooting import EPS, Cycles, vectors
from ..symbolic import ElementwiseFunction, cached, repeated


@cached
def gradients(phase: Phase, gradient: Callable, parameters: tuple[str, ...]) -> ElementwiseFunction:
    """An energy gradient of a model at several points, (x, parameters with the data of a piece)."""
    flow = flow_of(phase, parameters)
    x = ca.SX.sym("x", flow.size)
    p = ca.SX.sym("p", len(parameters) + (phase.pieces.size if phase.pieces else 0))
    return ElementwiseFunction(ca.Function("gradient", [x, p], [ca.vertcat(*gradient(*flow.symbols(x, p)))]))


def energy_changes(model: Model, cycles: Cycles) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The largest changes of energy on each half of a flight and on its contact, (m, halves + 1); the part of them that
    the errors of the states explain, of the same shape; and the energy's gradients (m, n) at launch."""
    changes, floors = np.zeros((2, len(cycles), cycles.halves_per_flight + 1))
    *flown, starts = work_along(model.flight, model.flight_gradient, cycles.halves, cycles.p_of_halves)
    changes[:, :-1], floors[:, :-1] = (values.reshape(len(cycles), -1) for values in flown)
    if cycles.contacts:
        stood = work_along(model.contact, model.contact_gradient, cycles.contacts, cycles.p_of_contacts)
        changes[cycles.with_contact, -1], floors[cycles.with_contact, -1], _ = stood
    launches = (values[:: cycles.halves_per_flight] for values in starts)
    return changes, floors, gradients(model.flight, model.flight_gradient, tuple(cycles.p))(*launches)[0]


@cached
def _works(phase: Phase, gradient: Callable, parameters: tuple[str, ...]) -> ElementwiseFunction:
    """The work of an energy gradient on straight lines, and the largest values (n,) of its components there, (start,
    end, parameters with the data of a piece)."""
    at = gradients(phase, gradient, parameters).function
    before, place = ca.SX.sym("before", 1 + at.numel_in(0)), ca.SX.sym("place", 2)
    (start, p), end = at.sx_in(), ca.SX.sym("end", at.numel_in(0))
    rates = at(start + place[0] * (end - start), p)
    work = before[0] + place[1] * ca.dot(rates, end - start)
    after = ca.vertcat(work, ca.fmax(before[1:], ca.fabs(rates)))
    step = ca.Function("works", [before, place, start, end, p], [after])
    return repeated(step, [0.0] * before.numel(), np.column_stack([GAUSS_PLACES, GAUSS_WEIGHTS]))


def work_along(phase: Phase, gradient: Callable, motions: Trajectories, p: Mapping) -> tuple[Any, ...]:
    """The largest work (m,) of the gradient along each motion, on the straight lines between the ends of its steps; the
    part of it that rounding and the truncation of series explain (m,); and the arguments of the gradient at its start,
    the state (m, n) and the parameters with the data of the piece."""
    names, first = tuple(p), motions.first
    flow = flow_of(phase, names)
    data, states = flow.mesh_data(motions, vectors(p, len(motions))), motions.coefficients[:, : flow.size, 0]
    ends = motions.step_ends[:, : flow.size]
    (found,) = _works(phase, gradient, names)(states, ends, data)
    works, rates = found[:, :1], found[:, 1:]
    off = EPS * np.maximum(np.abs(states), np.abs(ends))
    if motions.coefficients.shape[2] > (
        order := flow.vector_field.order
    ):  # the last term of a series is as large as those left out
        off += np.abs(motions.coefficients[:, : flow.size, -1]) * (motions.steps**order)[:, None]
    changes = np.cumsum(works)
    before = np.where(first > 0, changes[first - 1], 0.0)
    largest = motions.largest(changes - before.repeat(motions.counts))
    return largest, motions.largest(np.einsum("Ni,Ni->N", rates, off)), (states[first], data[first])
