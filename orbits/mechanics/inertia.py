"""The inverse of an inertia, without subtracting masses from one another.

Masses m_k that move along functions with the gradients J_k (n,) have the inertia M = sum of m_k J_k J_k^T. By the
formula of Cauchy and Binet its determinant is the sum, over all n of them, of the product of their masses and the
square of the determinant of their gradients; and its adjugate that, over all n - 1 of them, of the product of their
masses and a a^T, with the vector a of the minors of their gradients. So no masses are subtracted, and the inverse has
all digits however far apart they are; elimination loses those of a light mass beside a heavy one.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import combinations, pairwise
from math import comb

import casadi as ca

# Sums of more products than these, with gradients in more directions, are long: then elimination takes their place.
MOST_PRODUCTS = 70
# Systems up to this size are solved by minors.
SMALL_SYSTEM = 3


class Inertia:
    """The inertia of masses that move along gradients.

    parts : pairs of a mass and its gradient (n,); a mass may be negative, the inertia is not
    exactly : an expression -> the same one as a number where it is one, 0 included
    """

    def __init__(self, size: int, parts: Sequence[tuple[ca.SX, ca.SX]], exactly: Callable[[ca.SX], ca.SX]):
        self.size, self._exactly, self._minors = size, exactly, dict[tuple, ca.SX]()
        moving = [(mass, ca.sparsify(ca.densify(gradient))) for mass, gradient in parts]
        moving = [(mass, gradient) for mass, gradient in moving if gradient.nnz()]
        together = list[tuple[ca.SX, ca.SX]]()
        for mass, gradient in moving:  # masses that move along one function are one
            same = [i for i, (_, other) in enumerate(together) if ca.is_equal(gradient, other, 2)]
            if same:
                together[same[0]] = (together[same[0]][0] + mass, gradient)
            else:
                together.append((mass, gradient))
        self.masses, self.gradients = [mass for mass, _ in together], [gradient for _, gradient in together]

    @cached_property
    def matrix(self) -> ca.SX:
        """M (n, n)."""
        total = ca.SX(self.size, self.size)
        for mass, gradient in zip(self.masses, self.gradients, strict=True):
            total += mass * (gradient @ gradient.T)
        return ca.sparsify(total)

    def solve(self, forces: ca.SX) -> ca.SX:
        """M^-1 times forces (n, k)."""
        if len(self.masses) == self.size:
            return self._alone(forces)
        count = len(self.masses)
        if max(comb(count, self.size), comb(count, self.size - 1)) > MOST_PRODUCTS:
            return inverse(self.matrix) @ forces
        return self._inverse @ forces

    def _alone(self, forces: ca.SX) -> ca.SX:
        """As many masses as coordinates: each is accelerated alone, and the multiple of its own gradient in the forces
        cancels."""
        columns = ca.horzcat(*self.gradients)
        alone = solved_by_blocks(columns, ca.sparsify(forces)) / ca.repmat(ca.vertcat(*self.masses), 1, forces.shape[1])
        return ca.sparsify(solved_by_blocks(columns.T, alone))

    @cached_property
    def _inverse(self) -> ca.SX:
        n, which = self.size, range(len(self.masses))
        determinant, adjugate = ca.SX(0), ca.SX(n, n)
        for chosen in combinations(which, n):
            determinant += self._product(chosen) * self._minor(tuple(range(n)), chosen) ** 2
        for chosen in combinations(which, n - 1):
            signs = [(-1) ** i for i in range(n)]
            minors = [self._minor(tuple(j for j in range(n) if j != i), chosen) for i in range(n)]
            a = ca.sparsify(ca.vertcat(*(sign * minor for sign, minor in zip(signs, minors, strict=True))))
            adjugate += self._product(chosen) * (a @ a.T)
        return ca.sparsify(adjugate / determinant)

    def _product(self, chosen: Sequence[int]) -> ca.SX:
        product = ca.SX(1)
        for k in chosen:
            product *= self.masses[k]
        return product

    def _minor(self, rows: tuple[int, ...], chosen: tuple[int, ...]) -> ca.SX:
        """The determinant of these rows of these gradients."""
        if not rows:
            return ca.SX(1)
        if (rows, chosen) not in self._minors:
            total = ca.SX(0)
            for j, k in enumerate(chosen):
                entry = self.gradients[k][rows[-1]]
                if not entry.is_zero():
                    sign = (-1) ** (len(rows) - 1 + j)
                    total += sign * entry * self._minor(rows[:-1], (*chosen[:j], *chosen[j + 1 :]))
            self._minors[rows, chosen] = self._exactly(total)
        return self._minors[rows, chosen]


def solved_by_blocks(matrix: ca.SX, sides: ca.SX) -> ca.SX:
    """The solutions (n, k) of a system with these right sides, block by block where it decouples: CasADi takes the QR
    factors of all of it, with roots, unless it is triangular or small."""
    matrix = ca.sparsify(matrix)
    _, rows, columns, begins, *_ = matrix.sparsity().btf()
    blocks = list(pairwise(begins))
    if matrix.shape[0] <= SMALL_SYSTEM or all(end - begin == 1 for begin, end in blocks):
        return ca.solve(matrix, sides)
    lower, sides, found = matrix[rows, columns], sides[rows, :], ca.SX(*sides.shape)
    for begin, end in blocks:
        block, before = slice(begin, end), slice(0, begin)
        found[block, :] = ca.solve(lower[block, block], sides[block, :] - lower[block, before] @ found[before, :])
    order = sorted(range(len(columns)), key=columns.__getitem__)
    return ca.sparsify(found[order, :])


def squares_of(matrix: ca.SX, vanishes: Callable[[ca.SX], bool]) -> list[tuple[ca.SX, ca.SX]]:
    """A symmetric matrix as a sum of masses times squares of gradients, pairs of both."""
    rest, parts, size = ca.SX(matrix), list[tuple[ca.SX, ca.SX]](), matrix.shape[0]
    while (i := next((i for i in range(size) if not vanishes(rest[i, i])), None)) is not None:
        column = rest[:, i] / rest[i, i]
        column[i] = 1
        parts.append((rest[i, i], column))
        rest = rest - rest[i, i] * (column @ column.T)
        rest[:, i] = rest[i, :] = 0
    for i, j in combinations(range(size), 2):
        if not vanishes(rest[i, j]):  # 2 a b = (a + b)^2 / 2 - (a - b)^2 / 2
            unit = ca.SX.eye(size)
            parts += [(sign * rest[i, j] / 2, unit[:, i] + sign * unit[:, j]) for sign in (1, -1)]
    return parts


def inverse(matrix: ca.SX) -> ca.SX:
    """The inverse of a symmetric positive definite matrix by elimination, sparse where it decouples."""
    factors = ca.ldl(matrix, False)
    return ca.sparsify(ca.ldl_solve(ca.SX.eye(matrix.shape[0]), *factors))
