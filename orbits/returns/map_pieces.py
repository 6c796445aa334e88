"""The smooth pieces of a return map of launch speeds: where they end, why, and the map on them as polynomials.

The map without injection is smooth between borders:

    lossless : the landing of a lossless hop: a bounce more on one side; the loss is C d^(4/3), and 10 C on that side
    graze : a landing in flight that only touches: on one side the map has the slope infinity, as the square root
    bounce : at a landing the contact force vanishes, and falls: a bounce more or less, which loses d^4: the slope is
        continuous
    jump : at a landing the contact force vanishes, and the machine moves away: it lifts off at once, or bounces. The
        launch speed jumps
    a status, as "rests" : beyond it there is no next launch

Beside a border the map is analytic in a power of the distance: its third root at a lossless hop, its square root at a
graze and where the next launch speed falls to 0, else the distance itself. In that variable a Chebyshev polynomial of
moderate degree is the map up to rounding, on the cells that `resolution` finds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

# (lowest, highest) of each interval, ascending.
Intervals = list[tuple[float, float]]
OF_LOSSLESS = 3  # the power near lossless launches
LAUNCHES_BESIDE = np.array([10, 15, 6, 1]) / 32  # u^3 in Chebyshev polynomials of 2 u - 1
SPEEDS_OF_PIECES = ("low", "high", "origin", "reach", "edges", "coefficients", "errors")
CONTINUOUS = ("lossless", "graze", "bounce")  # the kinds of borders at which the map does not jump


class PieceOptions(NamedTuple):
    """What is one place, and what is rounding, on the pieces of a map."""

    jump: float = 1e-6  # where the map changes by a smaller share between neighbouring numbers, it is continuous
    same_edge: float = 1e-15  # the edge of a cell and a border that differ by a smaller share are the same
    same_extremum: float = 1e-9  # roots of a slope are real, and inside of their cell, up to this
    # Distance from a lossless launch within which roots belong to the variable, whose power 3 has a slope of 0 there.
    at_border: float = 1e-3
    rounded_slope: float = 1e-13  # relative to the largest: smaller coefficients of a slope are rounding


PIECES = PieceOptions()


class MapBorder(NamedTuple):
    """An end of pieces: its launch speed, its kind, the powers of the distance below and above in which the map is
    analytic as 1/power, and the next launch speeds there without injection, NaN where there is none."""

    alpha: float
    kind: str
    powers: tuple[int, int]
    next: tuple[float, float]


@dataclass(frozen=True, eq=False)
class MapPieces:
    """A map without injection as polynomials; see `resolution.map_pieces`.

    low, high : the range of launch speeds
    borders : between its pieces, ascending
    origin, reach, power : (m,), of the cells: the launch speed is origin + reach u^power for u in [0, 1]
    edges : (m, 2), their lowest and highest launch speeds, ascending
    coefficients : (m, n), of the map in Chebyshev polynomials of 2 u - 1; in cells next to a lossless launch, with
        power 3, of the fall of the launch speed, which vanishes there with all its digits
    errors : (m,), how far the polynomials are from the map
    impacts : (m,), in each hop
    pieces : (m,), the number of the piece of each cell, ascending
    unresolved : intervals of launch speeds in which the map is not resolved
    """

    low: float
    high: float
    borders: tuple[MapBorder, ...]
    origin: np.ndarray
    reach: np.ndarray
    power: np.ndarray
    edges: np.ndarray
    coefficients: np.ndarray
    errors: np.ndarray
    impacts: np.ndarray
    pieces: np.ndarray
    unresolved: tuple[tuple[float, float], ...]

    def in_units(self, speed: float) -> "MapPieces":
        """These pieces with launch speeds in another unit."""
        borders = tuple(
            each._replace(alpha=speed * each.alpha, next=(speed * each.next[0], speed * each.next[1]))
            for each in self.borders
        )
        scaled = {name: speed * getattr(self, name) for name in SPEEDS_OF_PIECES}
        unresolved = tuple((speed * a, speed * b) for a, b in self.unresolved)
        return replace(self, borders=borders, unresolved=unresolved, **scaled)

    def cell(self, x: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """The cells (k,), between the first and the last, of launch speeds (k,)."""
        return np.clip(np.searchsorted(self.edges[:, 0], x, side="right") - 1, first, last)

    def place(self, x: np.ndarray, cell: np.ndarray) -> np.ndarray:
        """The variables u (k,) of launch speeds in cells (k,)."""
        share = np.clip((x - self.origin[cell]) / self.reach[cell], 0.0, 1.0)
        return share ** (1.0 / self.power[cell])

    def next(self, x: np.ndarray, cell: np.ndarray) -> np.ndarray:
        """The next launch speeds (k,) without injection, of launch speeds in cells (k,)."""
        return self._next(x, cell, polynomials(self.place(x, cell), self.coefficients.shape[1]))

    def _next(self, x: np.ndarray, cell: np.ndarray, basis: np.ndarray) -> np.ndarray:
        value = (self.coefficients[cell] * basis).sum(1)
        return np.where(self._beside_lossless[cell], x - value, value)

    def slope(self, x: np.ndarray, cell: np.ndarray) -> np.ndarray:
        """The slopes (k,) of the map in cells (k,); 1 at a lossless launch, infinite at a graze."""
        u = self.place(x, cell)
        return self._slope(u, cell, polynomials(u, self.coefficients.shape[1]))

    def _slope(self, u: np.ndarray, cell: np.ndarray, basis: np.ndarray) -> np.ndarray:
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = self.reach[cell] * self.power[cell] * u ** (self.power[cell] - 1.0)
            slope = 2.0 * (self._derivatives[cell] * basis[:, :-1]).sum(1) / rate
        return np.where(self._beside_lossless[cell], np.where(u > 0, 1.0 - slope, 1.0), slope)

    def hops(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The next launch speeds (k,) without injection, the slopes (k,) and the numbers of impacts (k,); NaN and 0
        outside of the cells."""
        if not len(self.edges):
            return np.full(x.shape, np.nan), np.full(x.shape, np.nan), np.zeros(x.shape, int)
        cell = np.maximum(np.searchsorted(self.edges[:, 0], x, side="right") - 1, 0)
        u = self.place(x, cell)
        basis, inside = (
            polynomials(u, self.coefficients.shape[1]),
            (self.edges[cell, 0] <= x) & (x <= self.edges[cell, 1]),
        )
        following, slopes = self._next(x, cell, basis), self._slope(u, cell, basis)
        if not inside.all():
            following, slopes = np.where(inside, following, np.nan), np.where(inside, slopes, np.nan)
        return following, slopes, np.where(inside, self.impacts[cell], 0)

    @cached_property
    def _beside_lossless(self) -> np.ndarray:
        return self.power == OF_LOSSLESS

    def beside(self, border: MapBorder) -> list[np.ndarray]:
        """The cells (1,) that end at a border below it and above it, (0,) where there is none."""
        return [
            np.flatnonzero(np.abs(self.edges[:, side] - border.alpha) <= PIECES.same_edge * border.alpha)[:1]
            for side in (1, 0)
        ]

    def slopes_at(self, border: MapBorder) -> tuple[float, float]:
        """The slopes of the map below and above a border, NaN where there is none."""
        at = np.array([border.alpha])
        below, above = (float(self.slope(at, cell)[0]) if len(cell) else np.nan for cell in self.beside(border))
        return below, above

    def impacts_at(self, border: MapBorder) -> int:
        """The larger number of impacts in the hops on both sides of a border."""
        return max(int(self.impacts[cell[0]]) for cell in self.beside(border) if len(cell))

    @cached_property
    def _derivatives(self) -> np.ndarray:
        return np.polynomial.chebyshev.chebder(self.coefficients, axis=1)

    def extrema(self) -> list[float]:
        """The launch speeds at which the map's slope is 0, ascending."""
        found = list[float]()
        for cell, coefficients in enumerate(self.coefficients):
            if self.power[cell] == OF_LOSSLESS:
                coefficients = np.polynomial.chebyshev.chebsub(LAUNCHES_BESIDE * self.reach[cell], coefficients)
            row, scale = np.polynomial.chebyshev.chebder(coefficients), np.abs(coefficients).max()
            row = np.polynomial.chebyshev.chebtrim(row, PIECES.rounded_slope * scale)
            roots = np.polynomial.chebyshev.chebroots(row) if len(row) > 1 else np.zeros(0)
            near = PIECES.same_extremum
            inside = roots[(np.abs(roots.imag) < near) & (np.abs(roots.real) < 1.0 + near)].real
            u = np.clip(0.5 * (1.0 + inside), 0.0, 1.0)
            u = u[u > PIECES.at_border] if self.power[cell] == OF_LOSSLESS else u
            found += (self.origin[cell] + self.reach[cell] * u ** self.power[cell]).tolist()
        return sorted(found)


def polynomials(u: np.ndarray, count: int) -> np.ndarray:
    """The first Chebyshev polynomials (k, count) of 2 u - 1 at places (k,); u has all its digits near 0."""
    angle = np.pi - 2.0 * np.arcsin(np.sqrt(u))
    return np.cos(angle[:, None] * np.arange(count))


def without_seams(intervals: Sequence[tuple[float, float]]) -> Intervals:
    """Intervals in order, with touching or overlapping ones joined."""
    found = Intervals()
    for a, b in sorted(intervals):
        if found and a <= found[-1][1] * (1 + PIECES.same_edge):
            found[-1] = found[-1][0], max(b, found[-1][1])
        else:
            found.append((a, b))
    return found


def within(values: np.ndarray, edges: ArrayLike) -> np.ndarray:
    """Whether values (m,) lie in one of several ascending, disjoint intervals."""
    pairs = np.reshape(edges, (-1, 2))
    i = np.searchsorted(pairs[:, 0], values, side="right") - 1
    return (i >= 0) & (values <= pairs[i, 1]) if len(pairs) else np.zeros(len(values), bool)
