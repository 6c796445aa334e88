"""Quadratic models of functions, and the minimum of the first of them within limits of the others, by Ipopt."""

from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy import ndarray

from .caches import cached
from .ipopt import Minimiser, Minimum

# The barrier starts small, since such models hold nearby only; and so small a program can be solved to rounding.
OF_MODELS = {
    "ipopt.tol": 1e-13,
    "ipopt.compl_inf_tol": 1e-13,
    "ipopt.max_iter": 80,
    "ipopt.mu_init": 1e-5,
    "ipopt.mu_superlinear_decrease_power": 1.9,
    "ipopt.barrier_tol_factor": 1e3,
    "ipopt.bound_push": 1e-4,
    "ipopt.bound_frac": 1e-4,
}


class Weights(NamedTuple):
    """Weights in the cost of a step.

    objective : weight of the first function
    violation : weight of the sum of the violations; if 0, `minimum` holds the constraints of the models exactly
    spared : size up to which a violation costs nothing once a step is taken, as a step along the models of curved
        constraints violates the constraints themselves; `minimum`, which is about the models, has no use for it
    """

    objective: float
    violation: float
    spared: float = 0.0


class QuadraticModels(NamedTuple):
    """Functions of n numbers about a point: values (rows,), slopes (rows, n), bends (rows, n, n)."""

    values: ndarray
    slopes: ndarray
    bends: ndarray

    def __call__(self, change: ndarray) -> ndarray:
        """The functions (rows,) after a change (n,)."""
        return self.values + self.slopes @ change + 0.5 * self.bends @ change @ change

    def over(self, scales: ndarray) -> "QuadraticModels":
        """The functions as shares of scales (rows,)."""
        return QuadraticModels(*((part.T / scales).T for part in self))

    def minimum(self, constraints: int, bounds: ndarray, limits: ndarray, weights: Weights) -> Minimum:
        """The least first function; the unknowns are the change (n,), then the violations of the constraints.

        constraints : number of functions after the first that may be violated; the others are held within their limits
        bounds, limits : least and largest values (2, n) of the change, and (2, rows - 1) of all functions but the first
        """
        (rows, size), largest = self.slopes.shape, np.inf if weights.violation else 0.0
        violations = np.tile([[0.0], [largest]], 2 * constraints)
        data = np.concatenate([*(part.reshape(rows, -1).ravel("F") for part in self), weights[:2]])
        (low, high), (least, most) = np.hstack([bounds, violations]), limits
        return _minimiser(rows, size, constraints)(np.zeros(len(low)), data, (low, high), (least, most))


@cached
def _minimiser(rows: int, size: int, constraints: int) -> Minimiser:
    """The nonlinear program of models of these sizes."""
    change, excess, shortfall = (ca.SX.sym("z", count) for count in (size, constraints, constraints))
    values, slopes, bends = (ca.SX.sym("m", rows, size**order) for order in range(3))
    weights = ca.SX.sym("weights", 2)
    models = values + slopes @ change + 0.5 * bends @ ca.vec(change @ change.T)
    cost = weights[0] * models[0] + weights[1] * (ca.sum1(excess) + ca.sum1(shortfall))
    spared = ca.vertcat(excess - shortfall, ca.SX(rows - 1 - constraints, 1))
    z, p = ca.vertcat(change, excess, shortfall), ca.vertcat(*map(ca.vec, (values, slopes, bends)), weights)
    return Minimiser(z, p, cost, ca.densify(models[1:] - spared), OF_MODELS)
