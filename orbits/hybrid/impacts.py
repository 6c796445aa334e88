"""Impacts of a machine in flight, and what follows: it leaves at once, bounces, or stays in contact until that ends.

An impact of restitution e turns the gap's speed s into -e s. With e = 0 the machine stays in contact where that
presses, and leaves at once where the contact would have to pull. A contact ends where its force vanishes. For most
springs that is the launch set; a spring whose force does not rise all the way lets go elsewhere too, or at a launch's
extension on the way down.

What becomes of a machine has the same names in the return map and in the simulation: `STATUSES`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ..errors import BreaksDown, FlowError, OutOfRange, RunsAway
from ..flow.flow import Flow, flow_of
from ..flow.trajectory import Trajectory
from ..model.machine import check_machine
from ..model.phase import Affine
from ..numerics.bernstein import Crossings
from ..numerics.quadrature import GAUSS_PLACES, GAUSS_WEIGHTS
from ..periodic.energy import gradients
from ..periodic.solution import vector
from ..symbolic.calls import ElementwiseFunction

# Straight pieces of the way to a state on which its energy is integrated.
PANELS = 32
# What becomes of a hop, beside "lifts_off" (of a map) and "done" (of a simulation).
STATUSES = {
    "rests": "the contact never ends, or the launch speed with the injection is not above 0",
    "leaves_elsewhere": "the contact ends where no launch does: a simulation flies on from there, a map has no next",
    "no_launch": "the contact would not open: so a strong damper takes a slow launch back",
    "collapses": "the spring does, in contact or in flight",
    "carried_off": "the flight does not end",
    "out_of_range": "a law is needed where it is not defined, as outside a measured table",
    "lost": "the motion could not be followed, as when it takes too many steps",
    "cap": "too many impacts in one hop",
}
# Of arrays of their names.
STATUS = f"<U{max(map(len, STATUSES))}"
# Impacts in one hop after which it is given up.
CAP = 10_000
# What lasts longer than this, beside the size of the state it starts from, does not end: a flight so many of its
# ballistic times, a contact as long as the square root of the mass ratio makes it.
LONGEST_LEG = {"flight": 1e4, "contact": 1e6}
# A map's contacts are followed together for so long, beside the state's size, and what still stands then one by one.
BRIEF = 1e3
# Bounces are summed as a geometric series as soon as the pressing acceleration changes by less than this share in all
# the time they take: what they do to the motion beside contact is of third order in that time.
ZENO = 1e-8
# ... or are this slow beside the state: then they are rounding, and where nothing presses they would never end.
FAINT = 1e-15
# Order of the gap's zero at a lift-off.
LIFTOFF_ORDER = 3
# Turns of a contact's speed after which it never ends, see `ContactEnd`.
TURNS = 3
# Rates below which a contact is at rest for good.
STILL = 1e-12
# A contact that ends this near to a launch state, as a share, ends there: the launch is then taken from the launch set,
# so that hops without loss stay so to the last bit. Two ends that near would be one fold of the spring's force.
NEAR = 1e-7


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
        check_machine(machine, "restitution")
        self.machine = machine
        self.model, self.restitution = machine.model, float(machine.restitution)
        self.values = dict(values or machine.values)
        self.p = vector(self.values)

    @property
    def bounce_order(self) -> int:
        """Order of the gap's zero where the machine leaves at once after an impact."""
        return 1 if self.restitution > 0 else 2

    def landing(self, x) -> Landing:
        """What the impacts at flight states (m, n) with closed gap do."""
        e, speed = self.restitution, x @ self.gap_speed
        stuck = x - speed[:, None] * self.direction
        force, rate = self.pressing(stuck)
        held, wait = force >= 0, np.zeros(len(x))
        if e > 0:  # what is still to come of bounces at a constant pressing force
            jerk, snap = self.gap_rates(stuck - (e * speed)[:, None] * self.direction)
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                wait = 2 * e * np.abs(speed) / (1 - e) / rate if e < 1 else np.full(len(x), np.inf)
                summed = (rate > 0) & (wait * (np.abs(jerk) + 0.5 * wait * np.abs(snap)) <= ZENO * rate)
            held &= summed | (np.abs(speed) <= FAINT * np.abs(x).max(1))
            wait = np.where(held & summed, wait, 0.0)
        loss = 0.5 * self.model.impact_mass(self.values) * speed**2 * np.where(held, 1.0, 1 - e**2)
        state = stuck - np.where(held, 0.0, e * speed)[:, None] * self.direction
        return Landing(speed, held, state, loss, wait)

    def launch(self, alpha) -> np.ndarray:
        """Flight states (m, n) at lift-off with launch speeds (m,)."""
        liftoff = self.model.release(alpha, self.values)
        rows = self.model.launch({"liftoff": liftoff, "alpha": alpha}, self.values)
        return np.stack(np.broadcast_arrays(*rows, alpha)[:-1], axis=1).astype(float)

    def opens(self, x) -> np.ndarray:
        """Whether the gap opens at launch states (m, n), where it and its first two derivatives vanish."""
        jerk, snap = self.gap_rates(x)
        return (jerk > 0) | ((jerk == 0) & (snap > 0))

    @staticmethod
    def patience(phase: str, x) -> np.ndarray:
        """How long (...) a flight or contact from states (..., n) is followed before it is said not to end."""
        return LONGEST_LEG[phase] * (1 + np.abs(x).max(-1))

    def stand(self, y, left: float = np.inf) -> tuple[Trajectory | None, str | None, str]:
        """The contact from a state (k,), at most for the time `left`: its motion, how it ends, and the reason.

        How it ends is "lifts_off", a status, or None when the time is up; it has to be endless for "rests" to be known.
        """
        endless = left == np.inf
        limit = float(self.patience("contact", y)) if endless else left
        end = ContactEnd(self.contact.size, self.model.contact_speed if endless and self.model.one_speed else None)
        try:
            path, _ = self.contact.run(y, self.p, limit, stop=end)
        except FlowError as error:
            return None, failed(error, "contact"), str(error)
        if end.how or not endless:
            return path, end.how, ""
        return path, "collapses" if np.abs(path.end).max() > limit else "rests", ""

    def stand_all(self, ys) -> tuple[np.ndarray, np.ndarray]:
        """How contacts from states (m, k) end, "lifts_off" or a status (m,), and where (m, k)."""
        contact, speed = self.contact, self.model.contact_speed
        status, ends = np.full(len(ys), "", dtype=STATUS), np.full(ys.shape, np.nan)
        if speed and contact.method == "Taylor":
            limit = BRIEF * (1 + np.abs(ys).max(1))
            known = contact_force(contact.size), limit
            times, rows, _ = contact.first_zeros(ys, self.p, *known, over=(speed, TURNS))
            lifts = np.isfinite(times)
            status[lifts], ends[lifts] = "lifts_off", rows[lifts, : contact.size]
            status[np.isinf(times)] = "rests"
        for i in np.flatnonzero(status == ""):
            path, status[i], _ = self.stand(ys[i])
            if status[i] == "lifts_off":
                ends[i] = path.end[: contact.size]
        return status, ends

    def liftoff(self, ys) -> tuple[np.ndarray, np.ndarray]:
        """The speeds (m,) of contact states (m, k) at which the force vanishes, and whether each is that of the launch
        that it tells."""
        speed, x = self.model.contact_speed(ys), ys @ self.model.embed.T
        if not self.model.one_speed:
            return speed, np.zeros(len(ys), bool)
        forward = speed > 0
        apart = np.abs(x - self.launch(np.where(forward, speed, 1.0))).max(1)
        return speed, forward & (apart <= NEAR * (1 + np.abs(x).max(1)))

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
        (rates,) = call(points, self.flight.data(points, self.p))
        return float((widths[:, None] * GAUSS_WEIGHTS).ravel() @ (rates @ x))

    @cached_property
    def flight(self) -> Flow:
        """The flow of the flight."""
        return flow_of(self.model.flight, tuple(self.values))

    @cached_property
    def contact(self) -> Flow:
        """The flow of the contact."""
        return flow_of(self.model.contact, tuple(self.values))

    @cached_property
    def gap(self) -> Affine:
        """The gap as a function of the flight state."""
        return self.model.gap(self.values)

    @cached_property
    def gap_speed(self) -> np.ndarray:
        """Weights (n,) of the gap's speed, of flight states; positions change by speeds that are states themselves."""
        graph = self.flight.vector_field
        speed = ca.DM(self.gap.weights).T @ graph.field(graph.x, graph.p)[0]
        weights = ca.evalf(ca.jacobian(speed, graph.x))
        return np.array(weights).ravel()

    def pressing(self, x) -> tuple[np.ndarray, np.ndarray]:
        """The contact force (m,) at flight states with closed gap and no gap speed, and the acceleration at which the
        gap would close without it (m,)."""
        rates, _ = self.flight.field(x, self.p)
        _, watched = self.contact.field(x @ self.onto_contact.T, self.p)
        return watched[:, 0], -(rates @ self.gap_speed)

    def gap_rates(self, x) -> np.ndarray:
        """Third and fourth derivative (2, m) of the gap in time at flight states (m, n)."""
        return self._gap_rates(x, self.flight.data(x, self.p))[0].T

    @cached_property
    def _gap_rates(self) -> ElementwiseFunction:
        graph = self.flight.vector_field
        field = graph.field(graph.x, graph.p)[0]
        rates = [ca.DM(self.gap_speed).T @ field]
        for _ in range(2):
            rates.append(ca.jtimes(rates[-1], graph.x, field))
        return ElementwiseFunction(ca.Function("gap_rates", [graph.x, graph.p], [ca.vertcat(*rates[1:])]))

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
        launch = np.array(self.model.launch({"liftoff": 0.0, "alpha": 1.0 + 1e-30j}, self.values), dtype=complex)
        direction, moved = launch.imag * 1e30, launch.imag != 0  # speeds alone, in which the energy knows no law
        q = [0.0] * (self.model.flight.pieces.size if self.model.flight.pieces else 0)
        gradient = np.array([float(g) for g in self.model.flight_gradient(launch.real.tolist(), self.values, q)])
        return float(gradient[moved] @ direction[moved])


class ContactEnd:
    """A `stop` of the contact: where its force vanishes ("lifts_off") or, given the speed, where it is known that it
    never will ("rests"); `how` says which, None before either.

    Phase curves of one coordinate do not cross. So once the speed has turned three times, each extension has been
    passed upward and downward, and what has not ended the contact by then, damped or not, lies outside what follows.
    """

    def __init__(self, size: int, speed: Affine | None):
        self.size, self.force, self.speed = size, contact_force(size), speed
        self.zeros, self.turns = Crossings(), Crossings()
        self.turns_left, self.how = TURNS, None

    def __call__(self, c, steps):
        force = self.zeros(self.force.series(c), steps)[:1]
        over = self._over(c, steps) if self.speed else []
        first = min([*force, *over], default=None)
        self.how = None if first is None else "lifts_off" if force and first == force[0] else "rests"
        return first

    def _over(self, c, steps) -> list[tuple[int, float]]:
        """Where it is known that the force never ends it: the last turn, or where an overdamped contact is still."""
        turns = self.turns(self.speed.series(c[:, : len(self.speed.weights)]), steps)
        last, self.turns_left = turns[self.turns_left - 1 : self.turns_left], self.turns_left - len(turns)
        still = np.flatnonzero(np.abs(c[:, : self.size, 1]).max(1) < STILL)[:1]
        return [*last, *((int(i), float(steps[i])) for i in still)]


def contact_force(size: int) -> Affine:
    """The contact force as a function of the rows of the contact, `size` states before it."""
    return Affine((0.0,) * size + (1.0,))


def failed(error: FlowError, phase: str) -> str:
    """The status of a machine whose flight or contact cannot be carried on."""
    if isinstance(error, OutOfRange):
        return "out_of_range"
    if isinstance(error, RunsAway) and phase == "flight":
        return "carried_off"
    return "collapses" if isinstance(error, RunsAway | BreaksDown) else "lost"
