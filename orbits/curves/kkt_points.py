"""Newton's iteration to critical points of a program, on its optimality conditions with an unknown that is held."""

import numpy as np

from ..numerics import Array
from .kkt_conditions import (
    ActivePattern,
    LinearisedConditions,
    ParametricProgram,
    SecondDerivatives,
    SingularConditions,
    linearised,
    sparse_columns,
)
from .kkt_limits import FREE, UPPER, CriticalPoint
from .kkt_options import KktOptions


class LostCurve(Exception):
    """Newton's iteration does not converge."""


class PointsOfCurve:
    """The points of a program's curve, in z = (x (n,), multipliers (n + m,), p), found one after another.

    program, limits : and the lower and upper limits (n + m,) of x and of the constraints
    span : the way of the parameter
    most : largest number of Newton steps to a point
    dual_size : the size of multipliers that matter, which grows on the way
    """

    def __init__(
        self, program: ParametricProgram, x: Array, multipliers: Array, p: float, span: float, most: int,
        options: KktOptions,
    ):  # fmt: skip
        self.program, self.limits, self.n, self.span, self.most = program, program.limits, len(x), span, most
        self.options, (self.lower, self.upper) = options, self.limits
        self._patterns = dict[tuple[int, int, bytes], ActivePattern]()
        self.dual_size = self.size_of_duals(multipliers, self.second(x, p, multipliers))

    def second(self, x: Array, p: float, multipliers: Array) -> SecondDerivatives:
        """The second derivatives of the program."""
        return self.program.second(x, p, multipliers[self.n :])

    def size_of_duals(self, multipliers: Array, second: SecondDerivatives) -> float:
        """The size of multipliers that matter compared with these, as far as derivatives show it."""
        return max(float(np.abs(multipliers).max(initial=0.0)), self._needed(second), self.options.least_dual)

    def _needed(self, second: SecondDerivatives) -> float:
        largest = np.abs(sparse_columns(second.hessian).data).max(initial=0.0)
        by_parameter = self.span * float(np.abs(second.gradient_slope).max(initial=0.0))
        return max(by_parameter, self.options.dual * float(largest))

    def weights(self, z: Array) -> Array:
        """What unknowns, multipliers and the parameter are multiplied with to be of order one."""
        n, weights = self.n, np.full(len(z), 1 / self.dual_size)
        weights[:n], weights[-1] = 1 / (1 + np.abs(z[:n])), 1 / self.span
        return weights

    def distance(self, a: CriticalPoint, b: CriticalPoint) -> float:
        """The distance between points, with unknowns and multipliers of order one."""
        return float(np.abs(self.weights(a.z) * (b.z - a.z)).max())

    def corrected(
        self, z: Array, sides: Array, held: int, level: float, along: Array, exact: bool = False
    ) -> tuple[CriticalPoint, float]:
        """The point at a level of the coordinate that is held, with its tangent the way of `along`, and its distance
        from the prediction z; raises `LostCurve` where Newton's iteration does not converge."""
        n, start, before, linear, options = self.n, z, np.inf, None, self.options
        z = z.copy()
        z[held] = level
        active = np.flatnonzero(sides)
        z[n:-1][sides == FREE] = 0.0
        places = np.concatenate([np.arange(n), n + active, [len(z) - 1]])
        own, bounds = int(np.searchsorted(places, held)), np.where(sides == UPPER, self.upper, self.lower)[active]
        weights, unit = self.weights(z), np.eye(1, len(places), len(places) - 1)[0]
        for _ in range(self.most):
            renewed = linear is None
            if linear is None:
                linear = self._linearised(z, active)
            first = (linear.second.first if renewed else None) or self.program.first(z[:n], z[-1], z[2 * n : -1])
            values = np.concatenate([z[:n], first.values])
            missed = values[active] - bounds
            residual = np.concatenate([first.gradient + z[n : 2 * n], missed, [z[held] - level]])
            if not np.isfinite(residual).all():
                raise LostCurve
            if renewed:
                step, direction = self._solved(linear, [residual, unit], own)
            else:
                (step,) = self._solved(linear, [residual], own)
            size = float(np.abs(weights[places] * step).max())
            if not size < 1e3 * (1 + before):
                raise LostCurve
            # Up to the square of the step, the value function is the Lagrangian and its slope that of the Lagrangian.
            cost, slope = first.cost + float(z[n + active] @ missed), first.slope - float(linear.slopes @ step[:-1])
            z[places] -= step
            if size <= options.last or options.small >= size > 0.5 * before:
                break
            if size > options.stale * before:
                linear = None
            before = size
        else:
            raise LostCurve
        z[held] = level
        error = float(np.abs(weights * (z - start)).max())
        moved = size if renewed else error  # from where the matrix is
        if linear is None or moved > (options.last if exact or options.exact else options.near):
            linear = self._linearised(z, active)
            (direction,) = self._solved(linear, [unit], own)
        tangent = np.zeros(len(z))
        tangent[places] = direction
        tangent /= np.abs(weights * tangent).max()
        if tangent @ (weights**2 * along) < 0:
            tangent = -tangent
        if not np.isfinite(tangent).all():
            raise LostCurve
        if exact and tangent[-1]:
            rate = np.abs(tangent[n:-1] / tangent[-1]).max(initial=0.0)
            self.dual_size = max(self.dual_size, self._needed(linear.second), self.span * rate)
        found = z[:n], z[n:-1], sides, values, cost, slope, linear.negative, tangent
        return CriticalPoint(float(z[-1]), *found), error

    def at_parameter(self, z: Array, sides: Array, value: float, along: Array) -> CriticalPoint:
        """The point at a value of the parameter, with its exact tangent."""
        return self.corrected(z, sides, len(z) - 1, value, along, exact=True)[0]

    def _linearised(self, z: Array, active: Array) -> LinearisedConditions:
        return linearised(self.second(z[: self.n], z[-1], z[self.n : -1]), active, self._patterns, self.options)

    @staticmethod
    def _solved(linear: LinearisedConditions, rights: list[Array], held: int) -> Array:
        try:
            return linear.solve(np.array(rights).T, held).T
        except SingularConditions:
            raise LostCurve from None
