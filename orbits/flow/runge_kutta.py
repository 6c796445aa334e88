"""Runge-Kutta steps of order 8 with sensitivities, for vector fields that have no Taylor series."""

from typing import NamedTuple

import casadi as ca
import numpy as np

from ..numerics import Array
from ..symbolic import BufferedFunction
from .breakpoints import ActivePiece
from .vector_field import FLOW_CONTROL, VectorField, runge_kutta_step


class RungeKuttaOptions(NamedTuple):
    """The lengths of steps, which step doubling controls."""

    first_step: float = 0.1  # that is tried
    growth: float = 4.0  # later steps try this times the step before, so that the length can also grow
    double_step_error: float = 2e-14  # largest one, relative to the state. That of the step taken is 2^9 times smaller
    # A step of this length may lead across a kink of the field: what it then misses is below rounding.
    across_kink: float = 1e-12
    # Smaller states are measured against it, as the error of a state near 0 cannot be relative.
    smallest_scale: float = 1e-3


RUNGE_KUTTA = RungeKuttaOptions()


class Steps(NamedTuple):
    """Steps (m,) of one motion, their coefficients (m, rows, K + 1), and the sensitivities (m, n, columns) at their
    beginnings."""

    steps: Array
    coefficients: Array
    begins: Array


class RungeKuttaStepper:
    """Steps of order 8 whose length step doubling controls; ten points of each are interpolated by a polynomial."""

    # Chebyshev points of (0, 1]. The start of the step is met exactly, since it is divided out.
    NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, 11) / 10)

    def __init__(self, graph: VectorField, columns: int, varied: tuple[int, ...] = ()):
        field, x, p = graph.field, graph.x, graph.p
        self.n, self.columns, self.varied = graph.size, columns, list(varied)
        h = ca.SX.sym("h")
        dx, dp = ca.SX.sym("dx", self.n, columns), ca.SX.sym("dp", len(varied), columns)
        end = runge_kutta_step(graph, x, h)
        moving = ca.vertcat(x, *[p[i] for i in varied])
        slope = ca.jtimes(end, moving, ca.vertcat(dx, dp)) if columns else ca.SX(self.n, 0)
        step = ca.Function("step", [x, h, p, dx, dp], [end, ca.densify(slope)])
        self.step = BufferedFunction(step)
        node = ca.Function("node", [x, h, p], [end, ca.densify(field(end, p)[1])])
        self.nodes = BufferedFunction(node.map("nodes", "serial", len(self.NODES), [0, 2], []))
        self.powers = np.vander(self.NODES, increasing=True)
        self.guarded = BufferedFunction(_guarded(graph))
        self.watched = BufferedFunction(ca.Function("watched", [x, p], [ca.densify(field(x, p)[1])]))

    def step_from(self, x: Array, p: Array, dx: Array, dp: Array, longest: float) -> tuple[float, Array]:
        """The length of the longest step up to `longest` from a state, NaN where none is accepted, and its coefficients
        (rows, K + 1)."""
        h = self._length(x, p, dx, dp[self.varied], longest)
        ends, watched = self.nodes(x, h * self.NODES, p)
        start = np.concatenate([x, self.watched(x, p)[0].ravel()])
        return h, self._polynomial(start, np.vstack([ends, watched]), h)

    def sensitivities_after(self, x: Array, p: Array, dx: Array, dp: Array, h: float) -> Array:
        """The sensitivities (n, columns) at the end of a step of length h, not longer than the accepted one."""
        return self.step(x, h, p, dx, dp[self.varied])[1]

    def _polynomial(self, start, values, h: float) -> np.ndarray:
        """Coefficients (rows, K + 1) through `start` (rows,) and the values (rows, nodes)."""
        rising = np.linalg.solve(self.powers, (values.T - start) / self.NODES[:, None])
        return np.column_stack([start, (rising / h ** np.arange(1, len(self.NODES) + 1)[:, None]).T])

    def _length(self, x, p, dx, dp, h: float) -> float:
        """The longest step up to `h` whose error is below rounding, by step doubling, and which leads across nothing
        that its stages may not see."""
        room, closing, bends, kinks = (each[:, 0] for each in self.guarded(x, p))
        with np.errstate(all="ignore"):
            times = 2 * room / (closing + np.sqrt(closing**2 + 4 * bends * room))
        h = min(h, max(np.nanmin(times, initial=np.inf), RUNGE_KUTTA.across_kink))
        while h > FLOW_CONTROL.shortest_step:
            whole, half = (self.step(x, length, p, dx, dp)[0].ravel() for length in (2 * h, h))
            error = np.abs(whole - self.step(half, h, p, dx, dp)[0].ravel()).max()
            bound = RUNGE_KUTTA.double_step_error * max(RUNGE_KUTTA.smallest_scale, np.abs(x).max())
            if error <= bound:
                if h <= RUNGE_KUTTA.across_kink or (self.guarded(half, p)[3][:, 0] * kinks >= 0).all():
                    return h
                error = bound  # the step before this one comes nearer to the kink
            h *= min(0.5, max(0.1, 0.9 * (bound / error) ** (1 / 9))) if np.isfinite(error) else 0.1
        return np.nan


def _guarded(graph: VectorField) -> ca.Function:
    """(x, p) -> how far each coordinate of `reaches` may go and each argument of a kink is from it, how fast they close
    in, bounds of their accelerations, and the arguments of the kinks, which in a field in pieces are its breakpoints.
    """
    x, p, kinks = graph.x, graph.p, ca.SX(0, 1) if graph.coordinate else graph.kinks
    rates, count = graph.field(x, p)[0], len(graph.reaches)
    places = ca.vertcat(*(weights @ x for weights, _ in graph.reaches), kinks)
    speeds = ca.jtimes(places, x, rates)
    closing = ca.vertcat(ca.fabs(speeds[:count]), -ca.sign(kinks) * speeds[count:])
    room = ca.vertcat(*(change.least for _, change in graph.reaches), ca.fabs(kinks))
    results = room, closing, ca.fabs(ca.jtimes(speeds, x, rates)), kinks
    return ca.Function("guarded", [x, p], [ca.densify(ca.SX(each)) for each in results])


class RungeKuttaMotion:
    """One motion, as a `TaylorMotion`, whose steps are taken one by one and cut where a piece ends."""

    def __init__(self, flow, stepper: RungeKuttaStepper, p: Array, seeds: Array, x: Array, variations: Array):
        self.flow, self.stepper, self.x, self.variations = flow, stepper, x, variations
        self.piece, self.before = ActivePiece(flow, p, x, seeds), RUNGE_KUTTA.first_step / RUNGE_KUTTA.growth
        self.side = 0  # at which the last step found ends its piece

    def advance(self, count: int, left: float) -> Steps:
        """One step, whatever `count` is, which lasts no longer than `left`; its length is NaN where none is accepted.
        Raises `OutOfRange` where no piece is left."""
        h, c = self.stepper.step_from(
            self.x, self.piece.data, self.variations, self.piece.seeds, RUNGE_KUTTA.growth * self.before
        )
        self.before, self.side = h, 0
        if h >= left * (1 - FLOW_CONTROL.rounding):
            h = left
        if self.flow.phase.pieces and h > 0:
            h, self.side = self.piece.cut(c, h)
        return Steps(np.array([h]), c[None], self.variations[None])

    def after(self, found: Steps, count: int, h: float) -> "RungeKuttaMotion":
        """This motion after the step found, or a part of it with the length h."""
        c, before, piece = found.coefficients[0, : self.stepper.n], self.x, self.piece
        self.x = c @ h ** np.arange(c.shape[1])
        if self.variations.size:
            self.variations = self.stepper.sensitivities_after(before, piece.data, self.variations, piece.seeds, h)
        if self.side and h == found.steps[0]:
            self.variations = piece.enter(self.side, self.x, self.variations)
        return self
