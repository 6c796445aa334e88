"""The one-step return map: from the launch speed at one lift-off after sustained contact to that at the next.

In between lie a flight, impacts that leave at once where the contact would have to pull, and the contact. What a hop
loses is summed from its impacts, not differenced from launch speeds: near a lossless orbit it vanishes like the power
4/3 of the distance, and a difference would be rounding.
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from .errors import InputError
from .flow import Flow, flow
from .model import Affine
from .statements import vector

# Launch speeds that are computed together: few enough to stay in a processor's cache.
TOGETHER = 1000
# A flight longer than so many of its ballistic times has been carried off.
LONGEST = 1e6
# Bounces with restitution that last no longer in all are summed as a geometric series; in that time the pressing force
# is constant to rounding.
ZENO = 1e-8
STATUSES = ("lifts off", "rests", "collapses", "carried off", "cap")


@dataclass(frozen=True)
class Hops:
    """What becomes of launches, each array of the launch speeds' shape.

    alpha : launch speeds
    next : launch speed at the next lift-off, NaN where there is none
    loss : alpha**2 - next**2, or what the impacts take off alpha**2 where there is no next one
    impacts : number of impacts in between
    status : one of `STATUSES`
    """

    alpha: np.ndarray
    next: np.ndarray
    loss: np.ndarray
    impacts: np.ndarray
    status: np.ndarray


class ReturnMap:
    """The return map of a machine, with its restitution and damping.

    machine : as in `find`
    inject : added to the launch speed at every lift-off
    cap : impacts of one hop after which it is given up, with the status "cap"

    Called with launch speeds (...), all above 0, it gives `Hops`. A hop "rests" when the contact that it comes to never
    ends, "collapses" when the spring does in that, and is "carried off" when the flight does not end.
    """

    def __init__(self, machine, inject: float = 0.0, cap: int = 10_000):
        if not all(hasattr(machine, name) for name in ("model", "values", "restitution")):
            raise InputError(
                f"a return map is that of a machine such as problems.Hopper(), not {type(machine).__name__}"
            )
        if not np.isfinite(inject):
            raise InputError(f"inject = {inject!r} is not a finite number")
        if isinstance(cap, bool) or not isinstance(cap, int | np.integer) or cap < 1:
            raise InputError(f"cap = {cap!r}; it is a number of impacts, from 1")
        self.machine, self.inject, self.cap = machine, float(inject), int(cap)
        self.model, self.values, self.restitution = machine.model, machine.values, float(machine.restitution)
        self.p = vector(self.values)

    def __call__(self, alpha) -> Hops:
        """The next launch speeds after launch speeds (...)."""
        alpha = np.asarray(alpha, dtype=float)
        if not (np.isfinite(alpha) & (alpha > 0)).all():
            worst = alpha[~(np.isfinite(alpha) & (alpha > 0))].flat[0]
            raise InputError(f"alpha = {worst:g}; launch speeds are above 0")
        parts = [self._hop(part) for part in np.array_split(alpha.ravel(), max(1, -(-alpha.size // TOGETHER)))]
        columns = (np.concatenate(column).reshape(alpha.shape) for column in zip(*parts, strict=True))
        return Hops(alpha, *columns)

    def _hop(self, alpha):
        """Next launch speeds, losses, impacts and statuses of launch speeds (m,)."""
        model, e, m = self.model, self.restitution, len(alpha)
        loss, impacts, status = np.zeros(m), np.zeros(m, int), np.full(m, "cap", dtype="<U11")
        state = self.launch(alpha)
        skip = np.full(m, 3)
        flying, standing = np.arange(m), np.zeros((m, len(model.contact.states)))
        limit = LONGEST * (1 + alpha.max(initial=0.0))
        per_speed = model.impact_mass(self.values) / self.power
        for _ in range(self.cap):
            times, rows = self.flight.first_zeros(state[flying], self.p, self.gap, skip[flying], limit)
            gone = np.isnan(times)
            status[flying[gone]] = "carried off"
            flying, x = flying[~gone], rows[~gone, : self.flight.size]
            if not len(flying):
                break
            impacts[flying] += 1
            speed = x @ self.gap_speed
            stuck = x - speed[:, None] * self.direction
            force, rate = self.pressing(stuck)
            held = force >= 0
            if e > 0:  # what is still to come of bounces at a constant pressing force
                with np.errstate(divide="ignore"):
                    rest = 2 * e * np.abs(speed) / ((1 - e) * rate) if e < 1 else np.full(len(x), np.inf)
                held &= (rate > 0) & (rest < ZENO)
            loss[flying] += per_speed * speed**2 * np.where(held, 1.0, 1 - e**2)
            standing[flying[held]] = stuck[held] @ self.onto_contact.T
            status[flying[held]] = "lifts off"
            flying = flying[~held]
            state[flying] = (stuck - e * speed[:, None] * self.direction)[~held]
            skip[flying] = 1 if e > 0 else 2
            if not len(flying):
                break
        return self._released(alpha, loss, impacts, status, standing)

    def _released(self, alpha, loss, impacts, status, standing):
        """The end of hops whose contact begins at the contact states `standing` (m, ...)."""
        left = alpha**2 - loss
        ends = np.full(len(alpha), np.nan)
        status[(status == "lifts off") & (left < 0)] = "rests"
        lifting = np.flatnonzero(status == "lifts off")
        if len(lifting) and not self.contact.phase.closed_form:
            force = Affine((0.0,) * self.contact.size + (1.0,))
            times, _ = self.contact.first_zeros(standing[lifting], self.p, force, np.zeros(len(lifting), int), LONGEST)
            status[lifting[np.isnan(times)]] = "collapses"
            lifting = lifting[~np.isnan(times)]
        ends[lifting] = np.sqrt(left[lifting]) + self.inject
        return ends, loss, impacts, status

    def launch(self, alpha) -> np.ndarray:
        """Flight states (m, n) at lift-off with launch speeds (m,)."""
        liftoff = self.model.release(self.values)
        rows = self.model.launch({"liftoff": liftoff, "alpha": alpha}, self.values)
        return np.stack(np.broadcast_arrays(*rows, alpha)[:-1], axis=1).astype(float)

    @cached_property
    def flight(self) -> Flow:
        return flow(self.model.flight, tuple(self.values))

    @cached_property
    def contact(self) -> Flow:
        return flow(self.model.contact, tuple(self.values))

    @cached_property
    def gap(self) -> Affine:
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
