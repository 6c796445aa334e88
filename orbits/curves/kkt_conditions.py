"""The optimality conditions of Karush, Kuhn and Tucker of a program with a parameter, linearised at a point.

The program is to minimise f(x, p) under lower <= (x, g(x, p)) <= upper. With the Lagrangian L = f + y . (x, g) and a
set of active limits A, a minimum solves

    dL/dx = 0,  (x, g)_A = limits_A,  y = 0 elsewhere;   y <= 0 at a lower limit and y >= 0 at an upper one.

With H the Hessian of L, and A also the gradients of the active limits, Newton's matrix is K = [[H, A'], [A, 0]].
Beside it stands the shifted matrix

    S = [[-D, A], [A', H]],   d = |a|^2 / (w max|H|) for each gradient a,   w a large weight,

which is factorised symmetrically: first the rows of D, then those of H in an order that keeps the factors sparse. What
the former leave is H + A' D^-1 A, which has at least as many negative eigenvalues as H has on the null space of A. So
the second-order condition holds where the signs of the pivots show none. Where they show some for each weight, as
between nearly parallel gradients, the inertia of K decides: K has |A| negative eigenvalues more than H has on the null
space, where the gradients are independent. Since D is small, the same factors also solve with K, after a few steps of
iterative refinement.
"""

from copy import copy
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from ..numerics import Array
from .kkt_options import POINTS_OF_MINIMA, KktOptions

# The orders of elimination are ours; the matrices have small supernodes.
IN_ORDER = {"permc_spec": "NATURAL", "diag_pivot_thresh": 0.0, "panel_size": 1, "relax": 1}
SYMMETRIC = {"SymmetricMode": True}


class FirstDerivatives(NamedTuple):
    """A program at a point: its cost, the gradient (n,) of f + y . g, the constraints (m,), and d(f + y . g)/dp."""

    cost: float
    gradient: Array
    values: Array
    slope: float


class SecondDerivatives(NamedTuple):
    """The Jacobian (m, n) of the constraints, the Hessian (n, n) of f + y . g, dense or sparse with fixed patterns, and
    the derivatives by p of the gradient (n,) of f + y . g and of the constraints (m,); and the first derivatives there
    where they are at hand."""

    jacobian: Array | sp.csc_matrix
    hessian: Array | sp.csc_matrix
    gradient_slope: Array
    values_slope: Array
    first: FirstDerivatives | None = None


class ParametricProgram(Protocol):
    """A nonlinear program with n unknowns of order one, m constraints and a parameter.

    limits : (n + m,) lower and upper ones, of the unknowns and then of the constraints; these do not depend on p
    first, second : (x, p, multipliers (m,) of the constraints) -> derivatives; raise `NoOrbit` where there are none
    """

    @property
    def limits(self) -> tuple[Array, Array]: ...

    def first(self, x: Array, p: float, y: Array) -> FirstDerivatives: ...

    def second(self, x: Array, p: float, y: Array) -> SecondDerivatives: ...


class SingularConditions(Exception):
    """The linearised conditions do not determine Newton's step."""


@dataclass(frozen=True, eq=False)
class LinearisedConditions:
    """The conditions linearised at a point, for given active limits, in the unknowns (x, active multipliers, p).

    second : the derivatives of the program
    slopes : the derivatives of the conditions by the parameter
    places : the number of each unknown but p in the order of S, in which the matrices are
    matrix, factors : K, and the factors of S; None where it has none
    negative : the number of negative eigenvalues of H on the null space of A
    options : of the refinement of solutions
    """

    second: SecondDerivatives
    slopes: Array
    places: Array
    matrix: sp.csc_matrix
    factors: SuperLU | None
    negative: int
    options: KktOptions

    def solve(self, right: Array, held: int) -> Array:
        """The solutions (n + |A| + 1, k) of the linear conditions with k right sides, whose last entry belongs to the
        equation that one unknown, number `held`, has a value; raises `SingularConditions`."""
        places, last, solution = self.places, len(self.slopes), np.empty(right.shape)
        slopes, ordered = self.slopes[places, None], right[np.append(places, last)]
        found = self._refined(ordered[:-1] - slopes * right[-1], right[-1:]) if held == last else None
        if found is None:
            row = sp.csr_matrix(([1.0], ([0], np.flatnonzero(np.append(places, last) == held))), (1, last + 1))
            try:
                bordered = sp.vstack([sp.hstack([self.matrix, sp.csc_matrix(slopes)]), row], format="csc")
                found = splu(bordered).solve(ordered)
            except RuntimeError:  # exactly singular
                raise SingularConditions from None
        solution[np.append(places, last)] = found
        return solution

    def _refined(self, right: Array, last: Array) -> Array | None:
        """The solutions with K by refinement, above the values of p; None where that does not converge."""
        if self.factors is None:
            return None
        solution, left, before = np.zeros(right.shape), right, np.full(right.shape[1], np.nan)
        for number in range(self.options.refinements):
            step = self.factors.solve(left)
            solution += step
            size = np.abs(step).max(0, initial=0.0)
            small = size == 0
            if number:
                small |= size * size <= self.options.refined * np.abs(solution).max(0) * before
                if not (small | (size < self.options.contracts * before)).all():
                    return None
            if small.all():
                return np.vstack([solution, last])
            left, before = right - self.matrix @ solution, size
        return None


def filled(pattern: sp.csc_matrix, data: Array) -> sp.csc_matrix:
    """A matrix with the pattern of another one, which it shares."""
    matrix = copy(pattern)
    matrix.data = data
    return matrix


def linearised(
    second: SecondDerivatives, active: Array, patterns: "dict[tuple[int, int, bytes], ActivePattern]",
    options: KktOptions = POINTS_OF_MINIMA,
) -> LinearisedConditions:  # fmt: skip
    """The linearised conditions for the active limits with these numbers; `patterns` of a program are remembered."""
    hessian, jacobian = sparse_columns(second.hessian), sparse_columns(second.jacobian)
    key = hessian.nnz, jacobian.nnz, active.tobytes()
    if key not in patterns:
        patterns[key] = ActivePattern.of(hessian, jacobian, active)
    pattern, n = patterns[key], hessian.shape[0]
    data = np.concatenate([hessian.data, jacobian.data, [1.0]])
    sizes = np.bincount(pattern.row, data[pattern.entries_of_rows] ** 2, len(active))
    shifts, best, fewest = -sizes / (np.abs(hessian.data).max(initial=0.0) or 1.0), None, n + 1
    for weight in options.weights:
        factors, negative = _factorised(pattern.shifted(np.append(data, shifts / weight)), len(active))
        if negative < fewest:
            best, fewest = factors, negative
        if negative == 0:
            break
    matrix = pattern.matrix(data)
    if fewest:
        fewest = _negative_of(matrix, len(active))
    by_constraints = np.append(np.zeros(n), second.values_slope)[active]
    slopes = np.append(second.gradient_slope, by_constraints)
    return LinearisedConditions(second, slopes, pattern.places, matrix, best, fewest, options)


def _negative_of(matrix: sp.csc_matrix, active: int) -> int:
    """The number of negative eigenvalues of H on the null space of A, by those of K with rows of order one."""
    dense = matrix.toarray()
    scale = 1 / np.sqrt(np.maximum(np.abs(dense).max(1, initial=0.0), np.finfo(float).tiny))
    return int((np.linalg.eigvalsh(scale[:, None] * dense * scale) < 0).sum()) - active


def _factorised(matrix: sp.csc_matrix, shifted: int) -> tuple[SuperLU | None, int]:
    """The factors of S in its order, None where there are none, and the number of its negative eigenvalues in addition
    to those of the shifted rows."""
    try:
        factors = splu(matrix, options=SYMMETRIC, **IN_ORDER)
        if (factors.perm_r == factors.perm_c).all():
            return factors, int((factors.U.diagonal() < 0).sum()) - shifted
    except RuntimeError:  # a pivot is exactly 0
        pass
    return None, int((np.linalg.eigvalsh(matrix.toarray()) < 0).sum()) - shifted


class _Gathered(NamedTuple):
    """A sparse matrix that is filled with some data: its pattern, and the places of its entries among these."""

    pattern: sp.csc_matrix
    places: Array

    @classmethod
    def of(cls, numbered: sp.csc_matrix) -> "_Gathered":
        """That of a matrix whose entries are one more than their places in the data."""
        numbered.sort_indices()  # else the factorisation would, with the entries that are filled in
        return cls(numbered, numbered.data.astype(int) - 1)

    def __call__(self, data: Array) -> sp.csc_matrix:
        return filled(self.pattern, data[self.places])


class ActivePattern(NamedTuple):
    """The patterns of K and of S, both in the order of S, for a set of active limits: they are filled from (entries of
    H, entries of the Jacobian, 1), and for S the shifts.

    places : the number of each row among (x, active multipliers)
    entries_of_rows, row : where the entries of A are among the data, and the row of each
    """

    matrix: _Gathered
    shifted: _Gathered
    places: Array
    entries_of_rows: Array
    row: Array

    @classmethod
    def of(cls, hessian: sp.csc_matrix, jacobian: sp.csc_matrix, active: Array) -> "ActivePattern":
        """That of matrices with these patterns."""
        n, count, unit = hessian.shape[0], len(active), hessian.nnz + jacobian.nnz + 1
        numbers = np.arange(1.0, unit + 1 + count)
        own, all_rows = (
            sp.csc_matrix((part, of.indices, of.indptr), of.shape, copy=True)
            for of, part in ((hessian, numbers[: hessian.nnz]), (jacobian, numbers[hessian.nnz : unit - 1]))
        )
        rows = sp.vstack([sp.diags(np.full(n, float(unit))), all_rows]).tocsr()[active]
        whole = sp.bmat([[own, rows.T], [rows, None]], format="csc") if count else own
        # The order of elimination depends on the pattern of H + A'A alone.
        filled = abs(own) + abs(rows).T @ abs(rows)
        filled = (filled + n * (1.0 + filled.max()) * sp.identity(n)).tocsc()
        order = splu(filled, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=SYMMETRIC).perm_c
        places = np.concatenate([n + np.arange(count), np.argsort(order)])
        shifts = sp.diags(np.concatenate([np.zeros(n), numbers[unit:]]))
        matrix, shifted = (_Gathered.of(each.tocsr()[places][:, places].tocsc()) for each in (whole, whole + shifts))
        row = np.repeat(np.arange(count), np.diff(rows.indptr))
        return cls(matrix, shifted, places, rows.data.astype(int) - 1, row)


def sparse_columns(matrix: Array | sp.csc_matrix) -> sp.csc_matrix:
    """A matrix in columns; the pattern of a dense one is all of it, whatever is 0."""
    if isinstance(matrix, np.ndarray):
        rows, columns = matrix.shape
        ends = np.arange(columns + 1) * rows
        return sp.csc_matrix((matrix.ravel(order="F"), np.tile(np.arange(rows), columns), ends), matrix.shape)
    return matrix
