"""The channels of a recorded hop: what a motion of a machine shows a sensor, and its Taylor series along the motion."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from orbits.flow import flow_of
from orbits.hops import Simulation
from orbits.laws import Parameters, Scalars
from orbits.model import CONTACT_FORCE, Machine, Model, weighted_sum
from orbits.symbolic import cached, taylor_coefficients
from orbits.units import ACCELERATION, FORCE, LENGTH, SPEED, Dimension

GROUND_FORCE, SPRING_LENGTH = "ground force", "spring length"
# What is recorded of a height: itself, and its first and second derivative by time.
KINDS = ("height", "speed", "acceleration")
DIMENSIONS_OF_KINDS = (LENGTH, SPEED, ACCELERATION)


class SeriesOptions(NamedTuple):
    """The Taylor series of an interval, which err by 1e-9 where it is half a unit of time long."""

    order: int = 12


SERIES = SeriesOptions()


class Channel(NamedTuple):
    """What one column of a record measures.

    name : "foot height", "body acceleration", "ground force" or "spring length"
    quantity : name of the height, or of the force or the length
    order : of its derivative by time
    """

    name: str
    quantity: str
    order: int = 0

    @property
    def jumps(self) -> bool:
        """Whether it may jump at an impact."""
        return self.quantity == GROUND_FORCE or self.order > 0

    @property
    def dimension(self) -> Dimension:
        """The dimension of its values."""
        return FORCE if self.quantity == GROUND_FORCE else DIMENSIONS_OF_KINDS[self.order]


def channels_of(machine: Machine) -> dict[str, Channel]:
    """All channels of a machine, by name."""
    heights = machine.model.heights(machine.values)
    of_heights = [Channel(f"{name} {kind}", name, k) for name in heights for k, kind in enumerate(KINDS)]
    others = [Channel(GROUND_FORCE, GROUND_FORCE), Channel(SPRING_LENGTH, SPRING_LENGTH)]
    return {each.name: each for each in (*of_heights, *others)}


class PhaseSeries(NamedTuple):
    """One phase as Taylor series of its states and of the quantities of its channels.

    size : number of its states
    rows : the row of each quantity; in flight there is no ground force
    series : (state, parameters) -> coefficients, order after order, of all rows
    values : (state, parameters) -> the quantities there, in the order of `rows`
    """

    size: int
    rows: dict[str, int]
    series: ca.Function
    values: ca.Function

    @property
    def rows_in_all(self) -> int:
        """The number of rows, those of the states among them."""
        return self.size + len(self.rows)


@cached
def series_of_phases(model: Model, names: tuple[str, ...]) -> tuple[PhaseSeries, PhaseSeries]:
    """The series of flight and contact, with parameters of these names."""
    return _series_of(model, names, contact=False), _series_of(model, names, contact=True)


def _series_of(model: Model, names: tuple[str, ...], contact: bool) -> PhaseSeries:
    phase, rows = model.contact if contact else model.flight, model.embed.tolist()

    def in_flight(x: Scalars) -> list:
        return [weighted_sum(row, x) for row in rows] if contact else list(x)

    def height(name: str) -> Any:
        return lambda x, p, q: model.heights(p)[name].at(in_flight(x))

    def spring_length(x: Scalars, p: Parameters, q: Scalars) -> Any:
        return (model.separation(p) or model.extension_of(p)).at(in_flight(x))

    x, p = ca.SX.sym("x", len(phase.states)), ca.SX.sym("p", len(names))
    named = dict(zip(names, ca.vertsplit(p), strict=True))
    watch = {**{name: height(name) for name in model.heights(named)}, SPRING_LENGTH: spring_length}
    if contact:
        watch[GROUND_FORCE] = phase.watch[CONTACT_FORCE]
    observed = replace(phase, watch=watch, closed_form=None)
    field = flow_of(observed, names).vector_field
    data = ca.vertcat(p, *observed.data(ca.vertsplit(x), named))
    coefficients = ca.Function(
        "s", [field.x, field.p], [taylor_coefficients(field.field, field.x, field.p, SERIES.order)]
    )
    size = len(phase.states)
    return PhaseSeries(
        size=size,
        rows={name: size + i for i, name in enumerate(watch)},
        series=ca.Function("series", [x, p], [ca.densify(ca.vec(coefficients(x, data)))]),
        values=ca.Function("values", [x, p], [ca.densify(field.field(x, data)[1])]),
    )


@cached
def _of_states(model: Model, names: tuple[str, ...], contact: bool) -> ca.Function:
    """(state, parameters) -> the quantities, then their first and their second derivatives by time."""
    phase = series_of_phases(model, names)[contact]
    x, p = ca.SX.sym("x", phase.size), ca.SX.sym("p", len(names))
    found = ca.reshape(phase.series.expand()(x, p), phase.rows_in_all, SERIES.order + 1)[phase.size :, :3]
    return ca.Function("of_states", [x, p], [ca.vec(found @ ca.diag(ca.DM([1.0, 1.0, 2.0])))])


def observed(run: Simulation, channels: Mapping[str, Channel], t: np.ndarray) -> np.ndarray:
    """What channels (c,) of a simulated motion show at times (n,) within it: (c, n), in the machine's units."""
    machine = run.source
    model, names = machine.model, tuple(machine.values)
    states = run(t) / (machine.units.of_states(model.flight.states) if machine.units else 1.0)
    touching, p = run.in_contact(t), ca.DM([*machine.values.values()])
    found = np.zeros((len(channels), len(t)))
    for contact in (False, True):
        own = np.flatnonzero(touching == contact)
        if not len(own):
            continue
        x = states[own] @ np.linalg.pinv(model.embed).T if contact else states[own]
        phase = series_of_phases(model, names)[contact]
        values = np.array(_of_states(model, names, contact).map(len(own))(x.T, ca.repmat(p, 1, len(own))))
        for i, channel in enumerate(channels.values()):
            if channel.quantity in phase.rows:
                row = phase.rows[channel.quantity] - phase.size + channel.order * len(phase.rows)
                found[i, own] = values[row] * (machine.units.of(channel.dimension) if machine.units else 1.0)
    return found
