"""Corners of a curve of orbits: where lift-off passes a place at which the slope of a law jumps.

The equations are continuous there. Their derivatives jump with the slope of the force at lift-off, so the curve
continues with another tangent.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ..laws import switches
from ..numerics import Array
from ..shooting import Shooting
from ..symbolic import BufferedFunction, cached

# A curve is followed up to this length before a corner, and again from as far beyond it: rounding does not decide on
# which side these points are, and each differs from the corner by less than a plot or a table shows.
AWAY_FROM_CORNER = 1e-9
# The slopes on the two sides of a corner are extrapolated to it from this length and its double, with an error of
# second order. They differ by more than this share: a smaller corner turns the curve by less than any step does.
SIDE_OF_CORNER, LEAST_CORNER = 1e-6, 1e-6


@dataclass(frozen=True, eq=False)
class CurveCorner:
    """A corner of the curve of orbits.

    corners : those of the curve
    number : of the function that changes its sign there
    left : length along the curve to it, by the tangent
    rate : derivative of that function by this length
    """

    corners: "CurveCorners"
    number: int
    left: float
    rate: float

    def border(self, x: Array, beyond: float = -AWAY_FROM_CORNER) -> tuple[Array, float]:
        """The row (n + 1,) and the level that points have at this length beyond the corner, to first order near x; by
        default just before it."""
        values, rows = self.corners.values(x)
        row = rows[self.number]
        return row, float(row @ x) + beyond * self.rate - float(values[self.number])


@dataclass(frozen=True, eq=False)
class CurveCorners:
    """The corners of a curve of orbits, whose first arc begins at lift-off.

    Each function in `switching` has one sign on one smooth piece of the condition of lift-off, and the other sign on
    the next one.

    equations, along : of the curve, and the name of its parameter
    parameters_at : points (m, n + 1) -> parameters (m, np)
    size : points (n + 1,) -> the units of their components
    """

    equations: Shooting
    along: str
    parameters_at: Callable[[Array], Array]
    size: Callable[[Array], Array]

    @cached_property
    def seeds(self) -> Array:
        """The derivatives (n + np, n + 1) of unknowns and parameters along the curve."""
        return np.vstack(self.equations.seeds((self.along,))[:2])

    @property
    def switching(self) -> BufferedFunction | None:
        """(u, p) -> the functions (k,), and their derivatives by both; None without any."""
        return switching_at_liftoff(self.equations)

    def ahead(self, x: Array, tangent: Array, longest: float) -> CurveCorner | None:
        """The next corner to which the tangent at a point (n + 1,) leads, within a length."""
        values, rows = self.values(x)
        rates = rows @ tangent
        with np.errstate(divide="ignore", invalid="ignore"):
            left = -values / rates
        near = np.flatnonzero((left > 0) & (left <= longest))
        for i in near[np.argsort(left[near])].tolist():
            if self._slope_jumps(x, i):
                return CurveCorner(self, i, float(left[i]), float(rates[i]))
        return None

    def between(self, a: Array, b: Array) -> bool:
        """Whether there is a corner between two points."""
        changes = (self.values(a)[0] > 0) != (self.values(b)[0] > 0)
        return any(self._slope_jumps(a, i) for i in np.flatnonzero(changes).tolist())

    def values(self, x: Array) -> tuple[Array, Array]:
        """The functions (k,) that change their sign at corners, and their derivatives (k, n + 1) along the curve."""
        assert self.switching is not None
        values, slopes = self.switching(x[:-1], self.parameters_at(x[None])[0])
        return values.ravel(), slopes @ self.seeds

    def _slope_jumps(self, x: Array, index: int) -> bool:
        """Whether the slope of the condition of lift-off jumps, and not its value, near x, where one of the functions
        changes its sign."""
        values, rows = self.values(x)
        size = self.size(x)
        across = size**2 * rows[index] / np.linalg.norm(size * rows[index])
        at = x - across * (values[index] / (rows[index] @ across))
        ends = [[self._at_liftoff(at + side * k * SIDE_OF_CORNER * across) for k in (1, 2)] for side in (-1, 1)]
        (low, below), (high, above) = ([2 * near - far for near, far in zip(*each, strict=True)] for each in ends)
        steepest = np.abs([below * size, above * size]).max((0, 2))
        jumps = np.abs(high - low) > LEAST_CORNER * steepest
        return bool(((np.abs((above - below) * size).max(1) > LEAST_CORNER * steepest) & ~jumps).any())

    def _at_liftoff(self, x: Array) -> tuple[Array, Array]:
        """What holds at lift-off, (rows,), and its derivatives (rows, n + 1) along the curve."""
        (departure, arrival), flow = self.equations.ends[0], self.equations.flows[0]
        u, (p,), n = x[:-1], self.parameters_at(x[None]), len(x) - 1
        value, slope = departure(u, np.zeros(0), p)
        start, by_start = value[:-1, 0], slope[:-1] @ self.seeds
        (q,), (q_by_p,) = flow.piece_data(start[None], p[None])
        residual, slope = arrival(u, start, start, p, q)
        by_u, by_x, _, by_p, by_q = np.split(slope, np.cumsum([n, len(start), len(start), len(p)]), axis=1)
        own = self.seeds[n:]
        return residual.ravel(), by_u @ self.seeds[:n] + by_x @ by_start + (by_p + by_q @ q_by_p) @ own


@cached
def switching_at_liftoff(equations: Shooting) -> BufferedFunction | None:
    """The functions (u, p) -> (k,) whose signs tell the smooth pieces of the condition of lift-off, with derivatives by
    both arguments; None without any."""
    flow, (departure, arrival) = equations.flows[0], equations.ends[0]
    u, before, p = departure.function.sx_in()
    start = departure.function(u, before, p)[0][:-1]
    _, _, end, _, q = arrival.function.sx_in()
    found = [
        each
        for each in switches(arrival.function, [u, start, end, p, q])
        if not ca.depends_on(each, ca.vertcat(end, q))
    ]
    if flow.breaks:
        found.append(flow.vector_field.place(start, p) - flow.breakpoints(p)[1:-1])
    values = ca.densify(ca.vertcat(*found))
    if not values.numel():
        return None
    return BufferedFunction(
        ca.Function("switching", [u, p], [values, ca.densify(ca.jacobian(values, ca.vertcat(u, p)))])
    )
