"""Runge-Kutta steps of order 8 with sensitivities, for vector fields that have no Taylor series."""

import casadi as ca
import numpy as np

from ..numerics.roots import Array
from ..symbolic.calls import BufferedFunction
from .vector_field import FLOW_CONTROL, Steps, VectorField, runge_kutta

# The first step that is tried. Later ones try four times the step before, so that the length can also grow.
FIRST_STEP, GROWTH = 0.1, 4.0
# Largest error of a step of double length, relative to the state. That of the step taken is 2^9 times smaller.
DOUBLE_STEP_ERROR = 2e-14
# States smaller than this are measured against it, since the error of a state near 0 cannot be relative.
SMALLEST_SCALE = 1e-3


class RungeKuttaStepper:
    """Steps of order 8 whose length step doubling controls; ten points of each are interpolated by a polynomial."""

    # Chebyshev points of (0, 1]. The start of the step is met exactly, since it is divided out.
    NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, 11) / 10)

    def __init__(self, graph: VectorField, columns: int, varied: tuple[int, ...] = ()):
        field, x, p = graph.field, graph.x, graph.p
        self.n, self.columns, self.varied = graph.size, columns, list(varied)
        h = ca.SX.sym("h")
        dx, dp = ca.SX.sym("dx", self.n, columns), ca.SX.sym("dp", len(varied), columns)
        end = runge_kutta(graph, x, h)
        moving = ca.vertcat(x, *[p[i] for i in varied])
        slope = ca.jtimes(end, moving, ca.vertcat(dx, dp)) if columns else ca.SX(self.n, 0)
        step = ca.Function("step", [x, h, p, dx, dp], [end, ca.densify(slope)])
        self.step = BufferedFunction(step)
        node = ca.Function("node", [x, h, p], [end, ca.densify(field(end, p)[1])])
        self.nodes = BufferedFunction(node.map("nodes", "serial", len(self.NODES), [0, 2], []))
        self.powers = np.vander(self.NODES, increasing=True)
        self.watched = BufferedFunction(ca.Function("watched", [x, p], [ca.densify(field(x, p)[1])]))

    def advance(self, x: Array, p: Array, dx: Array, dp: Array, count: int, left: float, hint: float | None) -> Steps:
        """One step, whatever `count` and `left` are; the caller cuts it where it leads too far.

        Returns its length (1,), at most `GROWTH` times the `hint`, or NaN where no step is accepted; coefficients
        (1, rows, K + 1); and the sensitivities (1, n, columns) at its beginning.
        """
        h = self._length(x, p, dx, dp[self.varied], GROWTH * hint if hint else FIRST_STEP)
        ends, watched = self.nodes(x, h * self.NODES, p)
        start = np.concatenate([x, self.watched(x, p)[0].ravel()])
        c = self._polynomial(start, np.vstack([ends, watched]), h)
        return np.array([h]), c[None], dx[None]

    def sensitivities_after(self, x: Array, p: Array, dx: Array, dp: Array, h: float) -> Array:
        """The sensitivities (n, columns) at the end of a step of length h, not longer than the accepted one."""
        return self.step(x, h, p, dx, dp[self.varied])[1]

    def _polynomial(self, start, values, h: float) -> np.ndarray:
        """Coefficients (rows, K + 1) through `start` (rows,) and the values (rows, nodes)."""
        rising = np.linalg.solve(self.powers, (values.T - start) / self.NODES[:, None])
        return np.column_stack([start, (rising / h ** np.arange(1, len(self.NODES) + 1)[:, None]).T])

    def _length(self, x, p, dx, dp, h: float) -> float:
        """The longest step up to `h` whose error is below rounding, by step doubling."""
        while h > FLOW_CONTROL.shortest_step:
            whole, half = (self.step(x, length, p, dx, dp)[0] for length in (2 * h, h))
            error = np.abs(whole - self.step(half, h, p, dx, dp)[0]).max()
            bound = DOUBLE_STEP_ERROR * max(SMALLEST_SCALE, np.abs(x).max())
            if error <= bound:
                return h
            h *= min(0.5, max(0.1, 0.9 * (bound / error) ** (1 / 9))) if np.isfinite(error) else 0.1
        return np.nan
