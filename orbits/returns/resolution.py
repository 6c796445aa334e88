"""The search for the pieces of a return map: its borders by bisection, and cells that are halved until polynomials fit.

The launches of a grid show borders, and others are found where no polynomial fits. Cells that are too short to be
halved, as where borders accumulate, stay unresolved. So do cells that are left when the search has followed very many
impacts, and those whose hops have more impacts than the effort allows.

A search for fixed points leaves out what is clearly away from the identity line: launches whose next one, with the
injection, is faster for all of them or slower for all of them, by more than it changes from one of them to the next.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..hops import LIFTS_OFF
from ..numerics import enclosed_ends
from ..result import Progress
from ..running import heartbeat, interrupts
from .hops import Hops
from .limited_hops import RESOLUTION, UNFINISHED, EffortSpent, LimitedHops, PlainMap, Resolution, changes
from .map_pieces import OF_LOSSLESS, PIECES, MapBorder, MapPieces, within, without_seams


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


class _Refused(NamedTuple):
    """A cell that no polynomial fits, with its launches, ascending, their labels, and the excess of the next ones."""

    cell: _Cell
    launches: np.ndarray
    labels: np.ndarray
    excess: np.ndarray

    @property
    def is_of_a_kind(self) -> bool:
        """Whether all hops have the same label."""
        return bool((self.labels == self.labels[0]).all())

    @property
    def has_all_numbers(self) -> bool:
        """Whether the launches are all numbers between the ends, so that nothing of them is left to resolve."""
        a, b = self.cell.ends
        spacing = np.spacing(a)
        if b - a > len(self.launches) * spacing:
            return False
        return bool(np.isin(a + spacing * np.arange(1, round((b - a) / spacing)), self.launches).all())


class Resolving(LimitedHops):
    """The search for the pieces of a map without injection; with an injection for those near the identity line, or near
    levels of the next launch speed.

    powers : of the distance from borders by (launch speed, side), -1 below and 1 above; elsewhere they are 1
    """

    def __init__(
        self, plain: PlainMap, low: float, high: float, samples: int, inject: float | None, options: Resolution
    ):
        super().__init__(plain, inject, options)
        self.low, self.high, self.samples = low, high, samples
        self.shortest, self.width = options.shortest * (high - low), (high - low) / samples
        self.lossless = {each for each in plain.lossless if low <= each <= high}
        self.cuts = set(self.lossless) - {low, high}
        self.powers = {(each, side): OF_LOSSLESS for each in self.lossless for side in (-1, 1)}
        self.short: list[_Refused] | None = None  # cells in which borders are located last
        self.fitted, self.unresolved = list[_FittedCell](), list[tuple[float, float]]()

    def borders(self, rows: Sequence[np.ndarray], labels: np.ndarray) -> None:
        """Add the borders between neighbouring launch speeds, ascending in each of the rows, from the first to the last
        of their labels. In rows with very many only those beyond which there is no next launch: after many bounces a
        polynomial may fit through the others, which change the map by less than it rounds."""
        x, sizes = np.concatenate(rows), [len(row) for row in rows]
        inside = np.ones(len(x), bool)
        inside[np.cumsum(sizes) - 1] = False  # the last of each row has no neighbour above
        inside = inside[:-1]
        row = np.repeat(np.arange(len(rows)), sizes)[:-1][inside]
        changes = np.bincount(row, (labels[1:] != labels[:-1])[inside], len(rows))
        crowded = (changes > self.options.crowded * np.array(sizes))[row]
        a, b, left, right = (each[inside] for each in (x[:-1], x[1:], labels[:-1], labels[1:]))
        known = np.array(sorted(self.lossless) or [np.inf])
        # Beside lossless launches rounding decides on the number of impacts.
        least = np.abs(known[:, None] - 0.5 * (a + b)).min(0)
        finished = (left != UNFINISHED) & (right != UNFINISHED)
        which = np.flatnonzero((least > np.maximum(0.5 * (b - a), self.shortest)) & finished)
        left, right = _coarse(left, crowded), _coarse(right, crowded)
        a, b, left, right, crowded = (each[which] for each in (a, b, left, right, crowded))
        for _ in range(self.options.borders_in_a_row):
            which = np.flatnonzero((left != right) & ((left > 0) | (right > 0)) & (b > a))
            a, b, left, right, crowded = (each[which] for each in (a, b, left, right, crowded))
            if not len(a):
                return

            def same(at: np.ndarray, i: np.ndarray, left: np.ndarray = left, crowded: np.ndarray = crowded):
                return _coarse(self.labels(self.hops_from(at)), crowded[i]) == left[i]

            _, a = enclosed_ends(same, a, b)
            self.cuts |= set(a.tolist())
            left = _coarse(self.labels(self.hops_from(a)), crowded)

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
        steps = self.options.probed * length[:, None] / [16, 4, 1] * side[:, None]
        first, second, third = self.hops_from((at[:, None] + steps).ravel()).next.reshape(-1, 3).T
        with np.errstate(divide="ignore", invalid="ignore"):
            rooted = (second - first) / (third - second) > self.options.root_like
        rooted &= np.abs(second - first) > self.options.unchanged * np.abs(first)
        self.powers |= {each[:2]: 2 if root else 1 for each, root in zip(sides, rooted.tolist(), strict=True)}

    @cached_property
    def grid(self) -> np.ndarray:
        """The launch speeds of the grid."""
        grid = np.linspace(self.low, self.high, self.samples)
        for star in sorted(self.lossless):  # there rounding decides on the number of impacts
            beside = [star - self.shortest, star, star + self.shortest]
            grid = np.append(grid[np.abs(grid - star) > self.shortest], beside)
        return np.unique(grid[(grid >= self.low) & (grid <= self.high)])

    @cached_property
    def hops_of_grid(self) -> Hops:
        """Their hops."""
        return self.hops_from(self.grid)

    def doubtful(self) -> list[tuple[float, float]]:
        """The parts of the grid that are not away from the levels: first those in which all hops have a next launch, or
        none, and then the others, as a finer grid shows them."""
        spans = self._spans([self.grid], self.hops_of_grid)
        mixed = [span for span, kinds in spans if kinds > 1]
        fine = [np.unique(np.linspace(span[:-1], span[1:], self.options.more + 1)) for span in mixed]
        spans = [each for each in spans if each[1] == 1]
        spans += self._spans(fine, self.hops_from(np.concatenate(fine))) if fine else []
        return [(float(span[0]), float(span[-1])) for span, _ in sorted(spans, key=lambda each: each[1])]

    def _spans(self, rows: Sequence[np.ndarray], hops: Hops) -> list[tuple[np.ndarray, int]]:
        """The parts of rows, ascending launch speeds, that are not away from the levels, each with the number of kinds
        of hops in it."""
        found = list[tuple[np.ndarray, int]]()
        labels, ends = self.labels(hops), np.cumsum([len(row) for row in rows])[:-1]
        kinds = np.where((labels > 0) | (labels == UNFINISHED), 1, labels)
        for row, excess, own in zip(rows, *(np.split(each, ends) for each in (self.excess(hops), kinds)), strict=True):
            parts = self.near(excess)
            found += [(row[part], 1 + int(np.count_nonzero(np.diff(own[part])))) for part in parts]
        return found

    def resolve(self, progress: Progress = None) -> None:
        """Find the borders between the launches of a grid, and fit the cells between them; `progress` is called with
        the share of the range that is resolved, or not to be."""
        spans = [(self.low, self.high)]
        known = np.array(sorted([*(each.cell.ends for each in self.fitted), *self.unresolved])).reshape(-1, 2)
        try:
            if self.levels is None:
                with suppress(EffortSpent):
                    self.borders([self.grid], self.labels(self.hops_of_grid))
            else:
                spans, self.short = self.doubtful(), []
            self.most_effort, cuts = self.options.effort, np.unique([*self.cuts, *known.ravel()])
            rows = [pair for a, b in spans for pair in pairwise([a, *cuts[(a < cuts) & (cuts < b)].tolist(), b])]
            pending = self.cells([pair for pair in rows if not within(np.mean(pair, keepdims=True), known)[0]])
        except EffortSpent:
            self.unresolved += spans
            return
        self.fit(pending, progress)

    def fit(self, waiting: list[_Cell], progress: Progress) -> None:
        """Fit cells, and then parts of cells that no polynomial fits, until none is left or the effort is spent."""
        refused = list[_Refused]()
        try:
            while waiting or refused or self.short:
                interrupts.heed()
                if waiting:
                    done, others = self.fits(waiting[: self.options.cells])
                    waiting = waiting[self.options.cells :]
                    self.fitted += done
                    refused += others
                    self.report([*waiting, *(each.cell for each in refused)], progress)
                elif refused:
                    waiting, refused = self.parts(refused), []
                else:
                    refused, self.short = self.short or [], None
                    waiting, refused = self.cut(refused), []
        except EffortSpent:
            self.unresolved += [cell.ends for cell in waiting]
            self.unresolved += [each.cell.ends for each in (*refused, *(self.short or ()))]

    def report(self, waiting: Sequence[_Cell], progress: Progress) -> None:
        """Report how much of the range is resolved, while cells wait."""
        share = 1.0 - sum(abs(cell.reach) for cell in waiting) / (self.high - self.low)
        given_up = sum(b - a for a, b in self.unresolved) / (self.high - self.low)
        if progress:
            progress(min(max(share, self.effort / self.options.effort, 0.0), 1.0))
        resolved = (
            f"{100 * (share - given_up):.4g} % of the launch speeds from {self.low:g} to {self.high:g} are resolved"
        )
        heartbeat.remark(f"{resolved}: a narrower range takes less time")

    def parts(self, refused: Sequence[_Refused]) -> list[_Cell]:
        """Parts of cells that no polynomial fits; none of cells that are too short, or shorter than the grid shows
        where hops have more impacts than are followed. Near levels the shortest ones wait."""
        found, wide = list[list[float]](), list[_Refused]()
        for each in refused:
            (a, b), unfinished = each.cell.ends, each.labels == UNFINISHED
            least = np.inf if unfinished.all() else self.width if unfinished.any() else self.shortest
            if b - a > least:
                ends = self._narrowed(each)
                found += ends or []
                wide += [each] if ends is None else []
            elif self.short is None or unfinished.any() or each.is_of_a_kind:
                self.unresolved += [] if each.has_all_numbers else [(a, b)]
            else:
                self.short.append(each)
        return [*self.cells(found), *self.cut(wide)]

    def cut(self, refused: Sequence[_Refused]) -> list[_Cell]:
        """Parts of cells, cut at borders between their launches or else in the middle."""
        known, found, ends = set(self.cuts), list[_Cell](), list[list[float]]()
        if mixed := [each for each in refused if not each.is_of_a_kind]:
            self.borders([each.launches for each in mixed], np.concatenate([each.labels for each in mixed]))
        added = np.array(sorted(self.cuts - known))
        for cell, *_ in refused:
            a, b = cell.ends
            new = added[(a < added) & (added < b)].tolist()
            if new and cell.origin in (a, b):
                self.powers[cell.origin, 1 if cell.origin == a else -1] = cell.power
            ends += [[a, *new, b]] if new else []
            found += [] if new else cell.halves()
        return [*self.cells(ends), *found]

    def _narrowed(self, refused: _Refused) -> list[list[float]] | None:
        """The ends of the parts of a cell with hops of several kinds that are not away from the identity line; None
        where they are not much shorter than the cell."""
        (a, b), launches, excess = refused.cell.ends, refused.launches, refused.excess
        if self.levels is None or refused.is_of_a_kind:
            return None
        x = np.array([a, *launches, b])
        parts = self.near(excess[[0, *range(len(excess)), -1]])
        ends = [[float(x[part][0]), float(x[part][-1])] for part in parts]
        return ends if sum(b - a for a, b in ends) < 0.5 * (b - a) else None

    def fits(self, cells: list[_Cell]) -> tuple[list[_FittedCell], list[_Refused]]:
        """The cells that polynomials fit, and the others. Cells without a next launch of any hop, or all are away from
        the identity line, are left out."""
        done, refused, options = list[_FittedCell](), list[_Refused](), self.options
        for degree, fitted in zip(options.degrees, options.fitted, strict=True):
            t, table = _cell_nodes(degree)
            u = 0.5 * (1 + t)
            x = np.array([cell.origin + cell.reach * u**cell.power for cell in cells])
            hops = self.hops_from(x.ravel())
            beside = np.array([cell.power == OF_LOSSLESS for cell in cells])[:, None]
            following, loss, labels = (each.reshape(x.shape) for each in (hops.next, hops.loss, self.labels(hops)))
            values = np.where(beside, loss / (x + following), following)  # the loss is of the speed's square
            excess = self.excess(hops).reshape(x.shape)
            if self.inject is not None:
                excess = np.where(beside & np.isfinite(values), self.inject - values, excess)
            waiting, away = list[_Cell](), self.is_away(excess, changes(excess))
            rounded = beside & (np.abs(x - [[cell.origin] for cell in cells]) <= self.shortest)
            labels = np.where(rounded, labels[:, :1], labels)
            for cell, at, row, own, over, is_away in zip(cells, x, values, labels, excess, away.tolist(), strict=True):
                known, last = np.isfinite(row), degree == options.degrees[-1]
                if is_away or not (known.any() or (own == UNFINISHED).any()):
                    continue
                same = bool(known.all() and (own == own[0]).all())
                short = abs(cell.reach) <= self.shortest
                coefficients, scale = table @ np.where(known, row, 0.0), np.abs(row[known]).max(initial=0.0)
                error = float(np.abs(coefficients[-options.last :]).max())
                rests = float(np.abs(coefficients[-options.before_last :]).max()) <= options.resting * error
                enough = options.nearly if short and same else options.rounded if rests else fitted
                rounding = options.rounded_loss * cell.origin if short and cell.power == OF_LOSSLESS else 0.0
                if known.all() and error <= max(enough * scale, rounding):
                    full = np.zeros(options.degrees[-1] + 1)
                    full[: degree + 1] = coefficients
                    done.append(_FittedCell(cell, full, error, int(np.median(own))))
                elif same and not last:
                    waiting.append(cell)
                else:
                    order = np.argsort(at)
                    refused.append(_Refused(cell, at[order], own[order], over[order]))
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
            np.array([fit.coefficients for fit in fitted]).reshape(-1, self.options.degrees[-1] + 1),
            np.array([fit.error for fit in fitted]), np.array([fit.impacts for fit in fitted], int), pieces,
            tuple(without_seams(self.unresolved)),
        )  # fmt: skip
        return replace(found, borders=self.borders_of(found, cuts))

    def borders_of(self, pieces: MapPieces, cuts: np.ndarray) -> tuple[MapBorder, ...]:
        """The borders at launch speeds with their kinds."""
        beside = [pieces.beside(MapBorder(alpha, "", (1, 1), (np.nan, np.nan))) for alpha in cuts.tolist()]
        open_to = np.array([0 if len(a) and len(b) else -1 if not len(a) else 1 for a, b in beside], int)
        beyond = cuts[open_to != 0] + 0.1 * self.shortest * open_to[open_to != 0]
        ends = self.plain.hops(beyond, min(self.options.first_impacts, self.plain.cap)).status.tolist()
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
            elif abs(right - left) > PIECES.jump * alpha:
                kind = "jump"
            else:
                kind = "graze" if max(powers) > 1 else "bounce"
            found.append(MapBorder(alpha, kind, powers, (left, right)))
        return tuple(found)


def _coarse(labels: np.ndarray, crowded: np.ndarray) -> np.ndarray:
    """The labels (m,), where impacts are `crowded` (m,) without their number."""
    return np.minimum(labels, np.where(crowded, 1, labels))


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
    plain: PlainMap, low: float, high: float, samples: int, inject: float | None = None, progress: Progress = None,
    options: Resolution = RESOLUTION,
) -> MapPieces:  # fmt: skip
    """The pieces of a map without injection between two launch speeds; lossless ones are known, other borders are
    searched for between the launches of a grid. With an injection, the pieces that may touch the identity line."""
    found = Resolving(plain, low, high, samples, inject, options)
    found.resolve(progress)
    return found.result()
