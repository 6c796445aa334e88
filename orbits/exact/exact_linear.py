"""Linear systems of exact expressions: definite ones by elimination, others where few unknowns are left."""

from collections.abc import Sequence

from .exact_symmetry import Column
from .expressions import ONE, ZERO, ExactExpression, total

ExactRows = list[Column]


def inner_product(a: Sequence[ExactExpression], b: Sequence[ExactExpression]) -> ExactExpression:
    """The sum of products."""
    return total(x * y for x, y in zip(a, b, strict=True))


def solved_by_parts(matrix: ExactRows, right: Sequence[ExactExpression]) -> Column | None:
    """The solution of a linear system, of which entries that are numbers are eliminated first; None where more than
    two unknowns are left."""
    rows, known = [[*row, each] for row, each in zip(matrix, right, strict=True)], list[tuple[int, Column]]()
    columns = list(range(len(rows)))
    while pivot := next(((row, j) for row in rows for j in columns if row[j].is_number and not row[j].is_(0)), None):
        chosen, j = pivot
        rows = [row for row in rows if row is not chosen]
        columns.remove(j)
        known.append((j, [each / chosen[j] for each in chosen]))
        rows = [[a - row[j] * b for a, b in zip(row, known[-1][1], strict=True)] for row in rows]
    if len(columns) > 2:
        return None
    found = [ZERO] * len(right)
    if len(columns) == 1:
        found[columns[0]] = rows[0][-1] / rows[0][columns[0]]
    elif columns:
        (a, b, u), (c, d, w) = ([row[j] for j in (*columns, -1)] for row in rows)
        determinant = a * d - b * c
        found[columns[0]], found[columns[1]] = (u * d - b * w) / determinant, (a * w - u * c) / determinant
    for j, row in reversed(known):
        found[j] = row[-1] - total(row[k] * found[k] for k in range(len(found)) if k != j)
    return found


def _eliminated(matrix: ExactRows) -> tuple[ExactRows, ExactRows]:
    """The factors of a symmetric positive definite matrix M = L D L', L with ones on its diagonal, D in the diagonal of
    the second."""
    n = len(matrix)
    lower, left = [[ONE if i == j else ZERO for j in range(n)] for i in range(n)], [list(row) for row in matrix]
    for k in range(n):
        for i in range(k + 1, n):
            if left[i][k].is_(0):
                continue
            lower[i][k] = left[i][k] / left[k][k]
            left[i] = [a - lower[i][k] * b for a, b in zip(left[i], left[k], strict=True)]
            left[i][k] = ZERO
    return lower, left


def pivots(matrix: ExactRows) -> Column:
    """The pivots, positive exactly where a symmetric matrix is positive definite."""
    _, upper = _eliminated(matrix)
    return [upper[i][i] for i in range(len(matrix))]


def solved(matrix: ExactRows, right: Sequence[ExactExpression]) -> Column:
    """The solution of a linear system with a symmetric positive definite matrix."""
    lower, upper = _eliminated(matrix)
    n, found = len(matrix), list(right)
    for i in range(n):
        found[i] = found[i] - total(lower[i][k] * found[k] for k in range(i))
    for i in reversed(range(n)):
        known = total(upper[i][k] * found[k] for k in range(i + 1, n))
        found[i] = (found[i] - known) / upper[i][i]
    return found
