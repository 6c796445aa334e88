"""Impacts of a machine in flight, and what follows: it leaves at once, bounces, or stays in contact.

An impact of restitution e turns the gap's speed s into -e s. With e = 0 the machine stays in contact where that
presses, and leaves at once where the contact would have to pull.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from .accuracy import GAUSS_PLACES, GAUSS_WEIGHTS
from .certify import gradients
from .errors import InputError
from .flow import Flow, flow
from .model import Affine
from .polynomial import piecewise_roots
from .statements import vector

# Straight pieces of the way to a state on which its energy is integrated.
PANELS = 32
# Bounces that last no longer in all are summed as a geometric series; in that time the pressing force is constant to
# rounding.
ZENO = 1e-8


@dataclass(frozen=True)
class Landing:
    """What impacts do to flight states, (m, ...) each.

    speed : of the gap before
    held : whether contact follows, at once or after bounces without number
    state : after it, the first bounce taken where it bounces
    loss : of energy
    wait : time that the bounces without number take, else 0
    """

    speed: np.ndarray
    held: np.ndarray
    state: np.ndarray
    loss: np.ndarray
    wait: np.ndarray


class Impacts:
    """The impacts of a machine with its restitution and its own parameters, or with other values of them."""

    def __init__(self, machine, values: Mapping[str, float] | None = None):
        if not all(hasattr(machine, name) for name in ("model", "values", "restitution")):
            raise InputError(f"'{type(machine).__name__}' is no machine such as problems.Hopper()")
        self.machine = machine
        self.model, self.restitution = machine.model, float(machine.restitution)
        self.values = dict(values or machine.values)
        self.p = vector(self.values)

    def landing(self, x) -> Landing:
        """What the impacts at flight states (m, n) with closed gap do."""
        e, speed = self.restitution, x @ self.gap_speed
        stuck = x - speed[:, None] * self.direction
        force, rate = self.pressing(stuck)
        held, wait = force >= 0, np.zeros(len(x))
        if e > 0:  # what is still to come of bounces at a constant pressing force
            with np.errstate(divide="ignore"):
                wait = 2 * e * np.abs(speed) / (1 - e) / rate if e < 1 else np.full(len(x), np.inf)
            held &= (rate > 0) & (wait < ZENO)
            wait = np.where(held, wait, 0.0)
        loss = 0.5 * self.model.impact_mass(self.values) * speed**2 * np.where(held, 1.0, 1 - e**2)
        state = stuck - np.where(held, 0.0, e * speed)[:, None] * self.direction
        return Landing(speed, held, state, loss, wait)

    def launch(self, alpha) -> np.ndarray:
        """Flight states (m, n) at lift-off with launch speeds (m,)."""
        liftoff = self.model.release(alpha, self.values)
        rows = self.model.launch({"liftoff": liftoff, "alpha": alpha}, self.values)
        return np.stack(np.broadcast_arrays(*rows, alpha)[:-1], axis=1).astype(float)

    def energy(self, x) -> float:
        """The energy of a flight state (n,), relative to rest at its origin: the spring unloaded, the gap closed."""
        x = np.asarray(x, dtype=float)
        edges = np.linspace(0.0, 1.0, PANELS + 1)
        if self.flight.phase.pieces:  # a panel ends where the law does
            reach = float(np.array(self.flight.phase.pieces.coordinate) @ x)
            breaks = self.flight.piece_table(self.p)[0]
            edges = np.unique([*edges, *(b / reach for b in breaks if reach and 0 < b / reach < 1)])
        widths = np.diff(edges)
        points = (edges[:-1, None] + widths[:, None] * GAUSS_PLACES).reshape(-1, 1) * x
        call = gradients(self.model.flight, self.model.flight_gradient, tuple(self.values))
        rates = call(points, self.flight.data(points, self.p))[0][:, :, 0]
        return float((widths[:, None] * GAUSS_WEIGHTS).ravel() @ (rates @ x))

    @cached_property
    def flight(self) -> Flow:
        """The flow of the flight."""
        return flow(self.model.flight, tuple(self.values))

    @cached_property
    def contact(self) -> Flow:
        """The flow of the contact."""
        return flow(self.model.contact, tuple(self.values))

    @cached_property
    def gap(self) -> Affine:
        """The gap as a function of the flight state."""
        return self.model.gap(self.values)

    @cached_property
    def gap_speed(self) -> np.ndarray:
        """Weights (n,) of the gap's speed, of flight states; positions change by speeds that are states themselves."""
        graph = self.flight.graph
        speed = ca.DM(self.gap.weights).T @ graph.field(graph.x, graph.p)[0]
        weights = ca.evalf(ca.jacobian(speed, graph.x))
        return np.array(weights).ravel()

    def pressing(self, x) -> tuple[np.ndarray, np.ndarray]:
        """The contact force (m,) at flight states with closed gap and no gap speed, and the acceleration at which the
        gap would close without it (m,)."""
        rates, _ = self.flight.field(x, self.p)
        _, watched = self.contact.field(x @ self.onto_contact.T, self.p)
        return watched[:, 0], -(rates @ self.gap_speed)

    @cached_property
    def direction(self) -> np.ndarray:
        """Of an impact, (n,): the change of the flight state per change of the gap's speed."""
        return self.model.impact(self.values)

    @cached_property
    def onto_contact(self) -> np.ndarray:
        """Matrix (m, n) of the contact state that a flight state with closed gap is."""
        return np.linalg.pinv(self.model.embed)

    @cached_property
    def power(self) -> float:
        """Twice the energy at launch over the square of the launch speed."""
        x = self.launch(np.array([1.0]))[0].tolist()
        direction = np.imag(self.model.launch({"liftoff": x[0], "alpha": 1.0 + 1e-30j}, self.values)) * 1e30
        q = [0.0] * (self.model.flight.pieces.size if self.model.flight.pieces else 0)
        return float(np.array([float(g) for g in self.model.flight_gradient(x, self.values, q)]) @ direction)


class ContactEnd:
    """A `stop` of the contact: where its force vanishes, or, given the speed, where that turns down without it: then it
    never will."""

    def __init__(self, size: int, speed: Affine | None):
        self.force, self.speed = Affine((0.0,) * size + (1.0,)), speed
        self.lifts = False

    def __call__(self, c, steps):
        force = piecewise_roots(self.force.series(c), steps)
        turns = []
        if self.speed:
            turns = piecewise_roots(-self.speed.series(c[:, : len(self.speed.weights)]), steps, rising=True)
        first = min([*force[:1], *turns[:1]], default=None)
        self.lifts = bool(force) and first == force[0]
        return first
