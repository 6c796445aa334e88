"""The forces of a machine's springs along its motions, in its own units."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..model import Model
from ..running import exclusive
from ..symbolic import ElementwiseFunction, cached
from ..units import FORCE
from .flow import flow_of


@exclusive
def spring_forces(
    machine: Any, states: ArrayLike, changes: Mapping[str, np.ndarray] = MappingProxyType({})
) -> dict[str, np.ndarray]:
    """The force (...) of each spring of a machine by name, tension positive, in flight states (..., n).

    changes : values (...) of parameters that differ from those of the machine, by name, in the machine's units
    """
    model, units, x = machine.model, machine.units, np.asarray(states, dtype=float)
    names, flat = tuple(machine.values), x.reshape(-1, x.shape[-1])
    if not (springs := _springs(model)) or not len(flat):
        return dict.fromkeys(springs, np.zeros(x.shape[:-1]))
    bare = flat / (1.0 if units is None else units.of_states(model.flight.states))
    ps = np.tile([*machine.values.values()], (len(flat) if changes else 1, 1))
    for name, values in changes.items():
        ps[:, names.index(name)] = np.ravel(values) / (1.0 if units is None else machine.scheduled[name])
    data = flow_of(model.flight, names).data_of_pieces(bare, ps)
    known = np.broadcast_to(ps, (len(data), ps.shape[1])) if data.shape[1] else ps
    (forces,) = _spring_functions(model, names)(bare, np.hstack([known, data]) if data.shape[1] else known)
    sizes = [1.0 if units is None else units.of(model.spring_dimensions.get(name, FORCE)) for name in springs]
    return {name: each.reshape(x.shape[:-1]) for name, each in zip(springs, (forces * sizes).T, strict=True)}


def units_of_springs(machine: Any) -> dict[str, str]:
    """The SI units of the springs' forces by name; empty for a dimensionless machine."""
    if machine.units is None:
        return {}
    known = machine.model.spring_dimensions
    return {name: machine.units.text(known.get(name, FORCE)) for name in _springs(machine.model)}


def _springs(model: Model) -> dict[str, Any]:
    """The forces by name, (x, p, q) -> force; of a model that states its tension alone, this."""
    return {**model.spring_forces} or ({"spring force": model.tension} if model.tension else {})


@cached
def _spring_functions(model: Model, names: tuple[str, ...]) -> ElementwiseFunction:
    """States, and parameters with the data of a piece -> the forces of all springs."""
    flow = flow_of(model.flight, names)
    x, p = flow.vector_field.x, flow.vector_field.p
    arguments = flow.symbols(x, p)
    forces = ca.vertcat(*(force(*arguments) for force in _springs(model).values()))
    return ElementwiseFunction(ca.Function("forces", [x, p], [forces]))
