"""The points by which a machine stands: which of them touches first in flight, and which opens at the end of a contact.

A machine stands with its gap closed, after a landing in the labels that the model's relabelling S makes. A machine of
one point has the gap alone. Of one that steps, what closes at landing is the gap itself, as of a block that rocks, or
another function, as of a wheel, whose gap may close again too; that is a landing on the point that was left, without
a relabelling. Where another point lands than opens, two of them stand. A contact ends where the force on the first of
them vanishes, or that on the second: a step back, which takes the labels S^-1.

A point that passes the ground in mid-flight, as of legs of one length, has one gap for both landings: it opens in one
direction of a coordinate, and closes from the other one. It lands behind, on the side on which it opened, while it is
there far from the standing point; nearer it passes, and what it then scuffs is ignored. It lands in front where the
coordinate vanishes again. If it is still behind then, it came down without passing, and the machine falls.
"""

from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..flow import Flow, Trajectory
from ..model import CONTACT_FORCE, LANDED_FORCE, NORMAL_FORCE, TANGENTIAL_FORCE, Affine, Model, SignedShift
from ..numerics import Crossings
from ..symbolic import ElementwiseFunction, cached

# A landing slower than this, relative to the state, loses only rounding.
SLOW = 1e-8
LIFTS_OFF, STEPS_BACK = "lifts_off", "steps_back"  # how a contact ends, by the force that vanishes
REVERSES = "reversal"  # how an arc of a spring with hysteresis ends


class Foot:
    """A point that may touch in flight.

    name : "" where it has none
    gap : its height as a function of the flight state
    labels : the relabelling of states in which it lands, None where the machine stands in the labels of its flight
    step : the number of relabellings that is
    """

    def __init__(self, flight: Flow, name: str, gap: Affine, labels: SignedShift | None = None):
        self.flight, self.name, self.gap, self.labels, self.step = flight, name, gap, labels, int(labels is not None)

    @cached_property
    def speed(self) -> np.ndarray:
        """Weights (n,) of the gap's speed as a function of the flight state, whose speeds are states themselves."""
        return np.array(weights_of_speed(self.flight, self.gap.weights))

    def rates(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Third and fourth derivative (2, m) of the gap in time at flight states (m, n)."""
        return gap_rates(self.flight)(x, self.flight.data(x, p), self.speed[None])[0].T

    def opens(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Whether the gap opens (m,) at flight states (m, n), where it and its first two derivatives vanish."""
        jerk, snap = self.rates(x, p)
        return (jerk > 0) | ((jerk == 0) & (snap > 0))


@cached
def weights_of_speed(flight: Flow, weights: tuple[float, ...]) -> list[float]:
    """The weights (n,) of the speed of a gap with these weights as a function of the flight state."""
    graph = flight.vector_field
    speed = ca.DM(weights).T @ graph.field(graph.x, graph.p)[0]
    return ca.evalf(ca.jacobian(speed, graph.x)).full().ravel().tolist()


@cached
def gap_rates(flight: Flow) -> ElementwiseFunction:
    """(flight state, data, weights of the speed of a gap) -> the third and fourth derivative of the gap in time."""
    graph, weights = flight.vector_field, ca.SX.sym("w", flight.size)
    field = graph.field(graph.x, graph.p)[0]
    jerk = ca.jtimes(ca.dot(weights, field), graph.x, field)
    rates = ca.vertcat(jerk, ca.jtimes(jerk, graph.x, field))
    return ElementwiseFunction(ca.Function("gap_rates", [graph.x, graph.p, weights], [rates]))


class Exit(NamedTuple):
    """A way in which a contact ends.

    outcome : its name
    row : the row of the contact's motion that vanishes there, the force on the point that opens
    foot : the number of that point
    labels : the relabelling of the state in which it opens, None for none
    """

    outcome: str
    row: int
    foot: int
    labels: SignedShift | None = None

    def opened(self, states: np.ndarray, p: Any) -> np.ndarray:
        """Flight states (..., n) in which the machine stands, in the labels in which the point opens."""
        return states if self.labels is None else self.labels(states, p)

    @property
    def force(self) -> Affine:
        """The force as a function of the rows of the contact's motion."""
        return Affine((0.0,) * self.row + (1.0,))


def feet_of(model: Model, flight: Flow, p: Any) -> tuple[Foot, ...]:
    """The points of a machine that may touch in flight; the first opens at a launch."""
    labels = model.relabelling if model.symmetry else None
    first, last = model.feet or ("", "")
    if model.grazes:
        gap = model.gap(p)
        behind = Affine(tuple(-weight for weight in gap.weights), -gap.offset)
        return Foot(flight, first, gap), Foot(flight, last, behind, labels)
    if model.landing_gap is None:
        return (Foot(flight, last, model.gap(p), labels),)
    return Foot(flight, first, model.gap(p)), Foot(flight, last, model.landing_gap(p), labels)


def exits_of(model: Model) -> tuple[Exit, ...]:
    """The ways in which a contact of a machine ends; the first is the launch."""
    rows = [*model.contact.states, *model.contact.watch]
    first = Exit(LIFTS_OFF, rows.index(CONTACT_FORCE), 0)
    if not model.changes_contact:
        return (first,)
    foot = int(model.landing_gap is not None or model.grazes)
    return first, Exit(STEPS_BACK, rows.index(LANDED_FORCE), foot, model.relabelling.inverse)


def unheld(model: Model, flown: Trajectory, p: Any) -> list[tuple[float, str]]:
    """When in a flight the foot that stands would first have to pull, and when it first needs more than the stated
    friction, each with the kind of the event; [] where nothing stands, or no masses along the ground are stated."""
    if model.planar is None or not model.planar.stands:
        return []
    normal, along = (flown.names.index(name) for name in (NORMAL_FORCE, TANGENTIAL_FORCE))
    held = [("lifts", {normal: 1.0})]
    if model.planar.friction:
        held += [("slides", {normal: model.planar.friction(p), along: sign}) for sign in (1.0, -1.0)]
    found = dict[str, float]()
    for kind, weights in held:
        margin = Affine(tuple(weights.get(i, 0.0) for i in range(len(flown.names)))).series(flown.coefficients)
        places = [(0, 0.0)] if margin[0, 0] < 0 else Crossings()(margin, flown.steps)[:1]
        for step, time in places:
            found[kind] = min(found.get(kind, np.inf), float(flown.times[step] + time))
    return sorted((time, kind) for kind, time in found.items())
