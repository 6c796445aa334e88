"""Linear systems of exact expressions: definite ones by elimination, others where few unknowns are left."""

from collections.abc import Sequence

from .identities import simplified, vanishes
from .tree import ONE, ZERO, ExactExpression, total

Column = list[ExactExpression]
ExactRows = list[Column]


def inner_product(a: Sequence[ExactExpression], b: Sequence[ExactExpression]) -> ExactExpression:
    """The sum of products."""
    return total(x * y for x, y in zip(a, b, strict=True) if not (x is ZERO or y is ZERO))


def rows_of(columns: Sequence[Sequence[ExactExpression]], count: int) -> ExactRows:
    """The rows of a matrix of columns (count,)."""
    return [[column[i] for column in columns] for i in range(count)]


def solved_by_parts(matrix: ExactRows, right: ExactRows) -> ExactRows | None:
    """The solutions (n, k) of a linear system with right sides (n, k), where entries that are numbers are eliminated
    first; None where more than two unknowns are left."""
    rows, known = [[*row, *each] for row, each in zip(matrix, right, strict=True)], list[tuple[int, Column]]()
    columns, n = list(range(len(rows))), len(matrix)
    while pivot := next(((row, j) for row in rows for j in columns if row[j].is_number and not row[j].is_(0)), None):
        chosen, j = pivot
        rows = [row for row in rows if row is not chosen]
        columns.remove(j)
        known.append((j, [each / chosen[j] for each in chosen]))
        rows = [_without(row, row[j], known[-1][1]) for row in rows]
    if len(columns) > 2:
        return None
    found = [[ZERO] * (len(matrix[0]) and len(right[0])) for _ in matrix]
    if len(columns) == 1:
        found[columns[0]] = [simplified(each / rows[0][columns[0]]) for each in rows[0][n:]]
    elif columns:
        (a, b, *left), (c, d, *other) = ([row[j] for j in (*columns, *range(n, len(row)))] for row in rows)
        determinant = simplified(a * d - b * c)
        pairs = list(zip(left, other, strict=True))
        found[columns[0]] = [simplified((u * d - b * w) / determinant) for u, w in pairs]
        found[columns[1]] = [simplified((a * w - u * c) / determinant) for u, w in pairs]
    for j, row in reversed(known):
        before = [(row[k], found[k]) for k in range(n) if k != j and row[k] is not ZERO]
        found[j] = [simplified(each - total(slope * own[i] for slope, own in before)) for i, each in enumerate(row[n:])]
    return found


def _without(row: Column, share: ExactExpression, pivot: Column) -> Column:
    """A row less a share of another one."""
    if share is ZERO:
        return row
    return [a if b is ZERO else nonzero(a - share * b) for a, b in zip(row, pivot, strict=True)]


def nonzero(each: ExactExpression) -> ExactExpression:
    """An expression, as the number 0 where it vanishes everywhere."""
    return ZERO if vanishes(each) else each


class Factors:
    """The factors of a symmetric positive definite matrix M = L D L', L with ones on its diagonal.

    pivots : the diagonal of D, positive exactly where M is positive definite
    """

    def __init__(self, matrix: ExactRows):
        n = len(matrix)
        self._lower = [[ONE if i == j else ZERO for j in range(n)] for i in range(n)]
        left = [list(row) for row in matrix]
        for k in range(n):
            for i in range(k + 1, n):
                if left[i][k].is_(0):
                    continue
                self._lower[i][k] = left[i][k] / left[k][k]
                left[i] = _without(left[i], self._lower[i][k], left[k])
                left[i][k] = ZERO
        self._upper, self.pivots = left, [left[i][i] for i in range(n)]

    def solve(self, right: Sequence[ExactExpression]) -> Column:
        """The solution x (n,) of M x = right."""
        n, found = len(self.pivots), list(right)
        for i in range(n):
            found[i] = nonzero(found[i] - inner_product(self._lower[i][:i], found[:i]))
        for i in reversed(range(n)):
            known = inner_product(self._upper[i][i + 1 :], found[i + 1 :])
            found[i] = nonzero(found[i] - known) / self._upper[i][i]
        return found


def solved(matrix: ExactRows, right: Sequence[ExactExpression]) -> Column:
    """The solution of a linear system with a symmetric positive definite matrix."""
    return Factors(matrix).solve(right)
