"""A curve between and beyond its known points: polynomials through these that touch the curve there.

A point X of a curve lies at the level s = row . X, for a row that measures the way along the curve.
"""

import numpy as np

# A point whose tangent goes by less of this share along the row than that of the nearest is past a bend.
BEND = 0.3


class Hermite:
    """The polynomials in s through points of a curve with their tangents, several at a time, in Lagrange's form.

    xs, tangents : (g, k, n), points of each, and the curve's directions there
    rows : (g, n)
    known : (g, k), which of the points count, None for all
    """

    def __init__(self, xs, tangents, rows, known=None):
        rows = rows[:, :, None]
        self.base, self.places = xs[:, 0], (xs @ rows)[..., 0]
        self.xs = xs - xs[:, :1]  # then what does not change along the curve stays as it is
        self.known = np.ones(self.places.shape, bool) if known is None else known
        self.slopes = np.divide(tangents, tangents @ rows, out=np.zeros_like(xs), where=self.known[..., None])
        self.others = self.known[:, :, None] & self.known[:, None, :] & ~np.eye(xs.shape[1], dtype=bool)
        gaps = self.places[:, :, None] - self.places[:, None, :]
        self.inverse = np.divide(1.0, gaps, out=np.zeros_like(gaps), where=self.others)
        self.sums = self.inverse.sum(2)

    def __call__(self, which, levels) -> np.ndarray:
        """Points (q, n) at levels (q,) of the polynomials `which` (q,)."""
        ahead = levels[:, None] - self.places[which]
        factors = np.where(self.others[which], ahead[:, None] * self.inverse[which], 1.0)
        weights = np.where(self.known[which], factors.prod(2) ** 2, 0.0)
        values = weights * (1 - 2 * ahead * self.sums[which])
        points = values[:, None] @ self.xs[which] + (weights * ahead)[:, None] @ self.slopes[which]
        return self.base[which] + points[:, 0]


def around(xs, tangents, rows, i, behind: int, ahead: int) -> Hermite:
    """The polynomials through up to `behind` points of a chain (c, n) before its places i (g,) and `ahead` from there
    on: on either side as far as the chain keeps its direction along rows (g, n)."""
    indices = i[:, None] + np.arange(-behind, ahead)
    inside = (indices >= 0) & (indices < len(xs))
    indices = np.clip(indices, 0, len(xs) - 1)
    xs, tangents = xs[indices], tangents[indices]
    levels, rates = (np.einsum("gkn,gn->gk", part, rows) for part in (xs, tangents))
    for side, some, count in ((-1, slice(0, behind), behind), (1, slice(behind, None), ahead)):
        if count > 1:
            part = inside[:, some][:, ::side], levels[:, some][:, ::side], rates[:, some][:, ::side]
            inside[:, some] = _before_a_bend(side, *part)[:, ::side]
    return Hermite(xs, tangents, rows, inside)


def _before_a_bend(side: int, inside, levels, rates) -> np.ndarray:
    """Which (g, k) of the points at levels (g, k), the nearest first, the curve passes without turning round."""
    first = rates[:, :1]
    inside[:, 1:] &= (first * rates > BEND * first**2)[:, 1:] & (side * first * np.diff(levels, axis=1) > 0)
    return np.logical_and.accumulate(inside, axis=1)
