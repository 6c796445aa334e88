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
moderate degree is the map up to rounding, on cells that are halved until it is. Borders that the grid does not show are
found where no polynomial fits. Cells that are too short to be halved, as where borders accumulate, stay unresolved, and
so does what is left when the search has followed very many impacts.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..numerics.roots import enclosed_ends
from ..result import Progress
from ..running import heartbeat, interrupts
from ..simulation.feet import LIFTS_OFF
from ..simulation.impacts import STATUSES
from .hops import Hops
from .resolved_map import JUMP

# Degrees of the polynomials, and the shares of the values up to which their last coefficients are rounding. A hop that
# is integrated rounds by more, up to ROUNDED_CELL: there the coefficients have come to rest at one size, up to
# RESTING. A cell that cannot be halved any more is accepted with the last share, if no border lies in it.
DEGREES_OF_CELLS, FITTED_CELL, NEARLY_FITTED = (16, 32), (3e-15, 1e-13), 1e-9
ROUNDED_CELL, RESTING = 3e-12, 10.0
# The search ends after this effort: the impacts of all launches, and so many for each impact of launches together.
MOST_EFFORT, EFFORT_TOGETHER, EFFORT_OF_BORDERS = 2e6, 100, 0.25
SHORTEST_CELL = 1e-7  # cells shorter than this share of the range are not halved
LAST_OF_CELL, BEFORE_LAST = 3, 10
OF_LOSSLESS = 3  # the power beside lossless launches
LAUNCHES_BESIDE = np.array([10, 15, 6, 1]) / 32  # u^3 in Chebyshev polynomials of 2 u - 1
SPEEDS_OF_PIECES = ("low", "high", "origin", "reach", "edges", "coefficients", "errors")
CONTINUOUS = ("lossless", "graze", "bounce")  # the kinds of borders at which the map does not jump
SAME_EDGE = 1e-15  # the edge of a cell and a border that differ by a smaller share are the same
CROWDED = 0.125  # borders between neighbouring launches of a row, as a share of these, that are very many
BORDERS_IN_A_ROW = 12  # between two neighbouring launches, before their cell is fitted and halved
SAME_EXTREMUM = 1e-9  # roots of a polynomial are real, and inside of its cell, up to this
AT_BORDER = 1e-3  # roots closer to a lossless launch belong to the variable, whose power 3 has a slope of 0 there
ROUNDED_LOSS = 1e-11  # what the loss beside a lossless launch makes of its speed may be rounding up to this share
ROUNDED_NEXT = 1e-14  # a smaller change of the next launch speed shows no power
PROBED = 1e-3  # the power at a border is seen within this share of the piece beside it
ROOT_LIKE = 0.35  # the ratio of changes over lengths 1:4 is 1/4 for a smooth function, and 1/2 for a square root


class MapBorder(NamedTuple):
    """An end of pieces: its launch speed, its kind, the powers of the distance below and above in which the map is
    analytic as 1/power, and the next launch speeds there without injection, NaN where there is none."""

    alpha: float
    kind: str
    powers: tuple[int, int]
    next: tuple[float, float]


@dataclass(frozen=True, eq=False)
class MapPieces:
    """A map without injection as polynomials; see `map_pieces`.

    low, high : the range of launch speeds
    borders : between its pieces, ascending
    origin, reach, power : (m,), of the cells: the launch speed is origin + reach u^power for u in [0, 1]
    edges : (m, 2), their lowest and highest launch speeds, ascending
    coefficients : (m, n), of the map in Chebyshev polynomials of 2 u - 1; in cells beside a lossless launch, with power
        3, of the fall of the launch speed, which vanishes there with all its digits
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
        """The same with launch speeds in another unit."""
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

    def _beside(self, border: MapBorder) -> list[np.ndarray]:
        """The cells (1,) that end at a border below it and above it, (0,) where there is none."""
        return [
            np.flatnonzero(np.abs(self.edges[:, side] - border.alpha) <= SAME_EDGE * border.alpha)[:1]
            for side in (1, 0)
        ]

    def slopes_at(self, border: MapBorder) -> tuple[float, float]:
        """The slopes of the map below and above a border, NaN where there is none."""
        at = np.array([border.alpha])
        below, above = (float(self.slope(at, cell)[0]) if len(cell) else np.nan for cell in self._beside(border))
        return below, above

    def impacts_at(self, border: MapBorder) -> int:
        """The larger number of impacts in the hops on both sides of a border."""
        return max(int(self.impacts[cell[0]]) for cell in self._beside(border) if len(cell))

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
            row = np.polynomial.chebyshev.chebtrim(row, FITTED_CELL[-1] * scale)
            roots = np.polynomial.chebyshev.chebroots(row) if len(row) > 1 else np.zeros(0)
            inside = roots[(np.abs(roots.imag) < SAME_EXTREMUM) & (np.abs(roots.real) < 1.0 + SAME_EXTREMUM)].real
            u = np.clip(0.5 * (1.0 + inside), 0.0, 1.0)
            u = u[u > AT_BORDER] if self.power[cell] == OF_LOSSLESS else u
            found += (self.origin[cell] + self.reach[cell] * u ** self.power[cell]).tolist()
        return sorted(found)


def polynomials(u: np.ndarray, count: int) -> np.ndarray:
    """The first Chebyshev polynomials (k, count) of 2 u - 1 at places (k,); u has all its digits near 0."""
    angle = np.pi - 2.0 * np.arcsin(np.sqrt(u))
    return np.cos(angle[:, None] * np.arange(count))


class _Cell(NamedTuple):
    """A cell that is to be fitted."""

    origin: float
    reach: float
    power: int

    @property
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest launch speed."""
        return min(self.origin, self.origin + self.reach), max(self.origin, self.origin + self.reach)

    def halves(self) -> list["_Cell"]:
        """The two cells whose variables meet in the middle of this one's."""
        inner = self.reach * 0.5**self.power
        return [_Cell(self.origin, inner, self.power), _Cell(self.origin + inner, self.reach - inner, 1)]


class _FittedCell(NamedTuple):
    """A fitted cell: coefficients, error and impacts."""

    cell: _Cell
    coefficients: np.ndarray
    error: float
    impacts: int


class _EffortSpent(Exception):
    """The search has followed as many impacts as it may."""


class _Resolving:
    """The search for the pieces of a map without injection.

    powers : of the distance from borders by (launch speed, side), -1 below and 1 above; elsewhere they are 1
    """

    def __init__(self, hops_from: Callable[[np.ndarray], Hops], lossless: list[float], low: float, high: float):
        self._hops_from, self.low, self.high = hops_from, low, high
        self.effort, self.most_effort = 0.0, EFFORT_OF_BORDERS * MOST_EFFORT
        self.shortest = SHORTEST_CELL * (high - low)
        self.lossless = {each for each in lossless if low <= each <= high}
        self.cuts = set(self.lossless) - {low, high}
        self.powers = {(each, side): OF_LOSSLESS for each in self.lossless for side in (-1, 1)}
        self.fitted, self.unresolved = list[_FittedCell](), list[tuple[float, float]]()

    def hops_from(self, x: np.ndarray) -> Hops:
        """The hops from launch speeds; raises `_EffortSpent`."""
        if self.effort > self.most_effort:
            raise _EffortSpent
        hops = self._hops_from(x)
        self.effort += float(EFFORT_TOGETHER * hops.impacts.max(initial=0) + hops.impacts.sum())
        return hops

    def labels(self, x: np.ndarray) -> np.ndarray:
        """The number of impacts of the hops from launch speeds, or minus a number for each status without a next."""
        hops = self.hops_from(x)
        names = {name: -1 - i for i, name in enumerate(STATUSES)}
        pairs = zip(hops.impacts, hops.status.tolist(), strict=True)
        return np.array([count if status == LIFTS_OFF else names[status] for count, status in pairs])

    def borders(self, rows: Sequence[np.ndarray]) -> None:
        """Add the borders between neighbouring launch speeds, ascending in each of the rows, from the first to the last
        label. In rows with very many only those beyond which there is no next launch: after many bounces a polynomial
        may fit through the others, which change the map by less than it rounds."""
        x, sizes = np.concatenate(rows), [len(row) for row in rows]
        labels, inside = self.labels(x), np.ones(len(x), bool)
        inside[np.cumsum(sizes) - 1] = False  # the last of each row has no neighbour above
        inside = inside[:-1]
        row = np.repeat(np.arange(len(rows)), sizes)[:-1][inside]
        changes = np.bincount(row, (labels[1:] != labels[:-1])[inside], len(rows))
        crowded = (changes > CROWDED * np.array(sizes))[row]
        a, b, left, right = (each[inside] for each in (x[:-1], x[1:], labels[:-1], labels[1:]))
        known = np.array(sorted(self.lossless) or [np.inf])
        # Beside lossless launches rounding decides on the number of impacts.
        least = np.abs(known[:, None] - 0.5 * (a + b)).min(0)
        which = np.flatnonzero(least > np.maximum(0.5 * (b - a), self.shortest))
        left, right = _coarse(left, crowded), _coarse(right, crowded)
        a, b, left, right, crowded = (each[which] for each in (a, b, left, right, crowded))
        for _ in range(BORDERS_IN_A_ROW):
            which = np.flatnonzero((left != right) & ((left > 0) | (right > 0)) & (b > a))
            a, b, left, right, crowded = (each[which] for each in (a, b, left, right, crowded))
            if not len(a):
                return
            same = lambda at, i, left=left, crowded=crowded: _coarse(self.labels(at), crowded[i]) == left[i]  # noqa: E731
            _, a = enclosed_ends(same, a, b)
            self.cuts |= set(a.tolist())
            left = _coarse(self.labels(a), crowded)

    def cells(self, rows: Sequence[Sequence[float]]) -> list[_Cell]:
        """Two cells for each interval between neighbouring ends in rows, which meet in its middle."""
        pairs = [(a, b) for ends in rows for a, b in pairwise(ends) if b > a]
        sides = [(end, side, b - a) for a, b in pairs for end, side in ((a, 1), (b, -1))]
        self._probe([each for each in sides if each[0] in self.cuts])
        power = lambda at, side: self.powers.get((at, side), 1)  # noqa: E731
        return [cell for a, b in pairs for cell in (
            _Cell(a, 0.5 * (b - a), power(a, 1)), _Cell(b, -0.5 * (b - a), power(b, -1)))]  # fmt: skip

    def _probe(self, sides: list[tuple[float, int, float]]) -> None:
        """Find the powers at borders, each with a side, and the length of the piece there."""
        sides = [each for each in sides if each[:2] not in self.powers]
        if not sides:
            return
        at, side, length = np.array(sides).T
        steps = PROBED * length[:, None] / [16, 4, 1] * side[:, None]
        first, second, third = self.hops_from((at[:, None] + steps).ravel()).next.reshape(-1, 3).T
        with np.errstate(divide="ignore", invalid="ignore"):
            rooted = (second - first) / (third - second) > ROOT_LIKE
        rooted &= np.abs(second - first) > ROUNDED_NEXT * np.abs(first)
        self.powers |= {each[:2]: 2 if root else 1 for each, root in zip(sides, rooted.tolist(), strict=True)}

    def resolve(self, samples: int, progress: Progress = None) -> None:
        """Find the borders between the launches of a grid, and fit the cells between them; `progress` is called with
        the share of the range that is resolved, or not to be."""
        grid = np.linspace(self.low, self.high, samples)
        stars = sorted(self.lossless)  # there rounding decides on the number of impacts
        for star in stars:
            grid = np.append(grid[np.abs(grid - star) > self.shortest], [star - self.shortest, star + self.shortest])
        grid = np.unique(grid[(grid >= self.low) & (grid <= self.high)])
        with suppress(_EffortSpent):
            self.borders([grid])
        self.most_effort = MOST_EFFORT
        pending = [_Cell(self.low, self.high - self.low, 1)]
        try:
            pending = self.cells([sorted({self.low, self.high, *self.cuts})])
            while pending:
                interrupts.heed()
                done, refused = self.fits(pending)
                self.fitted += done
                pending = [cell for cell, _ in refused]
                pending = self.parts(refused)
                self.report(pending, progress)
        except _EffortSpent:
            self.unresolved += _without_seams([cell.ends for cell in pending])

    def report(self, waiting: Sequence[_Cell], progress: Progress) -> None:
        """Report how much of the range is resolved, while cells wait."""
        share = 1.0 - sum(abs(cell.reach) for cell in waiting) / (self.high - self.low)
        given_up = sum(b - a for a, b in self.unresolved) / (self.high - self.low)
        if progress:
            progress(min(max(share, self.effort / MOST_EFFORT, 0.0), 1.0))
        resolved = (
            f"{100 * (share - given_up):.4g} % of the launch speeds from {self.low:g} to {self.high:g} are resolved"
        )
        heartbeat.remark(f"{resolved}: a narrower range takes less time")

    def parts(self, refused: Sequence[tuple[_Cell, np.ndarray | None]]) -> list[_Cell]:
        """Parts of cells that no polynomial fits, cut at borders between their launches or in the middle; none of those
        that are too short."""
        known, found, cut = set(self.cuts), list[_Cell](), list[list[float]]()
        self.unresolved += [cell.ends for cell, _ in refused if np.diff(cell.ends) <= self.shortest]
        refused = [each for each in refused if np.diff(each[0].ends) > self.shortest]
        if rows := [launches for _, launches in refused if launches is not None]:
            self.borders(rows)
        added = np.array(sorted(self.cuts - known))
        for cell, _ in refused:
            a, b = cell.ends
            new = added[(a < added) & (added < b)].tolist()
            if new and cell.origin in (a, b):
                self.powers[cell.origin, 1 if cell.origin == a else -1] = cell.power
            cut += [[a, *new, b]] if new else []
            found += [] if new else cell.halves()
        return [*self.cells(cut), *found]

    def fits(self, cells: list[_Cell]) -> tuple[list[_FittedCell], list[tuple[_Cell, np.ndarray | None]]]:
        """The cells that polynomials fit, and those that none does, with their launches if these are of several kinds.
        Cells in which no hop has a next launch are left out."""
        done, refused = list[_FittedCell](), list[tuple[_Cell, np.ndarray | None]]()
        for degree, fitted in zip(DEGREES_OF_CELLS, FITTED_CELL, strict=True):
            t, table = _cell_nodes(degree)
            u = 0.5 * (1 + t)
            x = np.array([cell.origin + cell.reach * u**cell.power for cell in cells])
            hops = self.hops_from(x.ravel())
            beside = np.array([cell.power == OF_LOSSLESS for cell in cells])[:, None]
            following, loss, impacts = (each.reshape(x.shape) for each in (hops.next, hops.loss, hops.impacts))
            values = np.where(beside, loss / (x + following), following)  # the loss is of the speed's square
            waiting = list[_Cell]()
            rounded = beside & (np.abs(x - [[cell.origin] for cell in cells]) <= self.shortest)
            impacts = np.where(rounded, impacts[:, :1], impacts)
            for cell, at, row, counts in zip(cells, x, values, impacts, strict=True):
                known = np.isfinite(row)
                if not known.any():
                    continue
                same = bool(known.all() and (counts == counts[0]).all())
                short = abs(cell.reach) <= self.shortest
                coefficients, scale = table @ np.where(known, row, 0.0), np.abs(row[known]).max()
                error = float(np.abs(coefficients[-LAST_OF_CELL:]).max())
                rests = float(np.abs(coefficients[-BEFORE_LAST:]).max()) <= RESTING * error
                enough = NEARLY_FITTED if short and same else ROUNDED_CELL if rests else fitted
                rounding = ROUNDED_LOSS * cell.origin if short and cell.power == OF_LOSSLESS else 0.0
                if known.all() and error <= max(enough * scale, rounding):
                    full = np.zeros(DEGREES_OF_CELLS[-1] + 1)
                    full[: degree + 1] = coefficients
                    done.append(_FittedCell(cell, full, error, int(np.median(counts))))
                elif same and degree < DEGREES_OF_CELLS[-1]:
                    waiting.append(cell)
                else:
                    refused.append((cell, None if same else np.sort(at)))
            if not (cells := waiting):
                break
        return done, refused

    def result(self) -> MapPieces:
        """The pieces, from the fitted cells in order."""
        fitted = sorted(self.fitted, key=lambda fit: fit.cell.ends)
        edges = np.array([fit.cell.ends for fit in fitted]).reshape(-1, 2)
        cuts = np.array(sorted(self.cuts))
        own = lambda name: np.array([getattr(fit.cell, name) for fit in fitted], float)  # noqa: E731
        apart = [a[1] < b[0] - 1e-15 * b[0] or bool(np.isin(b[0], cuts)) for a, b in pairwise(edges)]
        pieces = np.cumsum([0, *apart])[: len(fitted)]
        found = MapPieces(
            self.low, self.high, (), own("origin"), own("reach"), own("power"), edges,
            np.array([fit.coefficients for fit in fitted]).reshape(-1, DEGREES_OF_CELLS[-1] + 1),
            np.array([fit.error for fit in fitted]), np.array([fit.impacts for fit in fitted], int), pieces,
            tuple(sorted(self.unresolved)),
        )  # fmt: skip
        return replace(found, borders=self.borders_of(found, cuts))

    def borders_of(self, pieces: MapPieces, cuts: np.ndarray) -> tuple[MapBorder, ...]:
        """The borders at launch speeds with their kinds."""
        beside = [pieces._beside(MapBorder(alpha, "", (1, 1), (np.nan, np.nan))) for alpha in cuts.tolist()]
        open_to = np.array([0 if len(a) and len(b) else -1 if not len(a) else 1 for a, b in beside], int)
        ends = self._hops_from(cuts[open_to != 0] + 0.1 * self.shortest * open_to[open_to != 0]).status.tolist()
        statuses, found = iter(ends), list[MapBorder]()
        for alpha, pair, side in zip(cuts.tolist(), beside, open_to.tolist(), strict=True):
            at = (pieces.next(np.array([alpha]), cell) for cell in pair)
            left, right = (float(each[0]) if len(each) else np.nan for each in at)
            powers = self.powers.get((alpha, -1), 1), self.powers.get((alpha, 1), 1)
            status = next(statuses) if side else LIFTS_OFF
            if alpha in self.lossless:
                kind = "lossless"
            elif side:
                kind = "unresolved" if status == LIFTS_OFF else status
            elif abs(right - left) > JUMP * alpha:
                kind = "jump"
            else:
                kind = "graze" if max(powers) > 1 else "bounce"
            found.append(MapBorder(alpha, kind, powers, (left, right)))
        return tuple(found)


def _coarse(labels: np.ndarray, crowded: np.ndarray) -> np.ndarray:
    """The labels (m,), where impacts are `crowded` (m,) without their number."""
    return np.minimum(labels, np.where(crowded, 1, labels))


def _without_seams(intervals: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Intervals, of which those that touch are one."""
    found = list[tuple[float, float]]()
    for a, b in sorted(intervals):
        if found and a <= found[-1][1] * (1 + SAME_EDGE):
            found[-1] = found[-1][0], max(b, found[-1][1])
        else:
            found.append((a, b))
    return found


@cache
def _cell_nodes(degree: int) -> tuple[np.ndarray, np.ndarray]:
    """The places (n,) of Chebyshev's polynomial of degree n = degree + 1, and the matrix (n, n) from values there to
    the coefficients of the interpolant."""
    n = degree + 1
    angles = np.pi * (np.arange(n) + 0.5) / n
    table = 2.0 / n * np.cos(np.arange(n)[:, None] * angles)
    table[0] *= 0.5
    return np.cos(angles), table


def map_pieces(
    hops_from: Callable[[np.ndarray], Hops], lossless: list[float], low: float, high: float, samples: int,
    progress: Progress = None,
) -> MapPieces:  # fmt: skip
    """The pieces of a map without injection between two launch speeds; lossless ones are known, other borders are
    searched for between the launches of a grid."""
    found = _Resolving(hops_from, lossless, low, high)
    found.resolve(samples, progress)
    return found.result()
