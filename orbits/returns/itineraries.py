"""All periodic launches of a period of a return map, by itineraries through its monotone branches.

A branch is an interval of launch speeds on which the map is smooth and monotone: it ends at borders and at extrema. An
itinerary w_1 .. w_n of branches belongs to an interval J(w), possibly empty, of launches whose hops pass through these
branches in turn: the launches of the branch w_1 whose next one lies in J(w_2 .. w_n). There f^n is smooth and monotone.
These intervals cover all launches whose n hops stay in the range, so that each periodic launch lies in one of them.

Where f^n falls, f^n(x) - x has one zero or none, as the signs at the ends say. Where it rises there may be more: the
interval is halved until the slope of f^n - x, by the chain rule, has one sign in each part, or the part has no zero by
its values and slopes.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..numerics import enclosed_sign_changes
from ..running import interrupts
from .map_pieces import MapPieces


class ItineraryOptions(NamedTuple):
    """How many itineraries are followed, and how rises are divided into parts with at most one zero each."""

    most: int = 100_000  # itineraries
    samples: int = 33  # of a rising interval, denser toward its ends, where the slope may be infinite
    halvings: int = 40  # of the part between two samples, at most
    least_part: float = 1e-13  # relative to its launch speed: a shorter part is not halved
    # Largest ratio of the slopes at both ends of a part, of the same sign, between which it has no extremum.
    alike_slopes: float = 4.0
    # Largest difference of the mean slope of a part without an extremum from that of its ends, as a share
    # of the smaller one.
    near_mean: float = 0.25
    # A part has no zero where the values at its ends exceed its length times the larger slope by this factor.
    beyond_slopes: float = 2.0


ITINERARIES = ItineraryOptions()


@dataclass(frozen=True, eq=False)
class MonotoneBranches:
    """The monotone branches of a map with an injection.

    ends, following : (b, 2), the launch speeds at both ends, ascending, and the next ones there
    cells : (b, 2), the first and the last cell
    rising : (b,), whether the map rises
    """

    pieces: MapPieces
    inject: float
    ends: np.ndarray
    following: np.ndarray
    cells: np.ndarray
    rising: np.ndarray

    @classmethod
    def of(cls, pieces: MapPieces, inject: float) -> "MonotoneBranches":
        """The branches of the pieces of a map."""
        extrema, ends, cells = np.array(pieces.extrema()), list[tuple[float, float]](), list[tuple[int, int]]()
        for piece in range(int(pieces.pieces[-1]) + 1 if len(pieces.pieces) else 0):
            own = np.flatnonzero(pieces.pieces == piece)
            low, high = float(pieces.edges[own[0], 0]), float(pieces.edges[own[-1], 1])
            tolerance = ITINERARIES.least_part * high
            inside = extrema[(extrema > low + tolerance) & (extrema < high - tolerance)]
            inside = inside[np.append(True, np.diff(inside) > 1e-8 * high)] if len(inside) else inside
            cuts = [low, *inside.tolist(), high]
            for a, b in pairwise(cuts):
                both = np.clip(np.searchsorted(pieces.edges[:, 0], [a, b], side="right") - 1, own[0], own[-1])
                ends.append((a, b))
                cells.append((int(both[0]), int(both[1])))
        bounds, table = np.array(ends).reshape(-1, 2), np.array(cells, int).reshape(-1, 2)
        flat = np.repeat(table, 2, axis=0)
        x = bounds.ravel()
        following = pieces.next(x, pieces.cell(x, *flat.T)).reshape(-1, 2) + inject
        return cls(pieces, inject, bounds, following, table, following[:, 1] > following[:, 0])

    def only(self, which: np.ndarray, ends: np.ndarray | None = None) -> "MonotoneBranches":
        """Some of the branches, in order, between other ends (k, 2) where these are given."""
        cells, rising = self.cells[which], self.rising[which]
        if ends is None:
            return replace(self, ends=self.ends[which], following=self.following[which], cells=cells, rising=rising)
        following = self.next(ends.ravel(), np.repeat(which, 2)).reshape(-1, 2)
        return replace(self, ends=ends, following=following, cells=cells, rising=rising)

    def next(self, x: np.ndarray, branch: np.ndarray) -> np.ndarray:
        """The next launch speeds (k,) of launch speeds in branches (k,)."""
        return self.pieces.next(x, self.pieces.cell(x, *self.cells[branch].T)) + self.inject

    def slope(self, x: np.ndarray, branch: np.ndarray) -> np.ndarray:
        """The slopes (k,) of the map at launch speeds in branches (k,)."""
        return self.pieces.slope(x, self.pieces.cell(x, *self.cells[branch].T))

    def before(self, y: np.ndarray, branch: np.ndarray) -> np.ndarray:
        """The launch speeds (k,) in branches (k,) whose next ones are y (k,), which the branches reach."""
        at_end = self.following[branch] == y[:, None]
        found, inside = np.where(at_end[:, 0], *self.ends[branch].T), np.flatnonzero(~at_end.any(1))
        own, level = branch[inside], y[inside]
        x1, x2, f1, f2 = enclosed_sign_changes(
            lambda x, i: self.next(x, own[i]) - level[i], *self.ends[own].T, *(self.following[own] - level[:, None]).T
        )
        found[inside] = np.where(np.abs(f1) <= np.abs(f2), x1, x2)
        return found

    def cycle(self, x: np.ndarray, words: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The launch speeds (k, n + 1) from x (k,) through the branches of itineraries (k, n), each confined to its
        branch, and the slope (k,) of the last one by the first."""
        launches, slope = [x], np.ones(len(x))
        for branch in words.T:
            interrupts.heed()
            here = np.clip(launches[-1], *self.ends[branch].T)
            with np.errstate(invalid="ignore", over="ignore"):
                slope = slope * self.slope(here, branch)
            launches.append(self.next(here, branch))
        return np.stack(launches, axis=1), slope


class ItineraryIntervals(NamedTuple):
    """Itineraries (k, n) with their intervals: the ends (k, 2), and f^n there (k, 2)."""

    words: np.ndarray
    ends: np.ndarray
    last: np.ndarray


def intervals_of(branches: MonotoneBranches, period: int) -> ItineraryIntervals:
    """The intervals of all itineraries of a length that belong to launches."""
    count = len(branches.ends)
    found = ItineraryIntervals(np.arange(count)[:, None], branches.ends, branches.following)
    for _ in range(period - 1):
        found = _pulled_back(branches, found)
    return found


def _pulled_back(branches: MonotoneBranches, after: ItineraryIntervals) -> ItineraryIntervals:
    """The intervals of the itineraries with one more branch before."""
    low, high = np.sort(branches.following, axis=1).T
    meets = (after.ends[None, :, 0] < high[:, None]) & (after.ends[None, :, 1] > low[:, None])
    first, rest = np.nonzero(meets)
    if len(first) > ITINERARIES.most:
        raise InputError(
            f"more than {ITINERARIES.most} itineraries: shorten the range of launch speeds, or take a shorter period"
        )
    words = np.hstack([first[:, None], after.words[rest]])
    # A target is an end of the interval behind, or where that is not reached, the image of an end of the branch.
    targets = np.clip(after.ends[rest], low[first, None], high[first, None])
    reached, last = targets == after.ends[rest], after.last[rest].copy()
    for side in (0, 1):
        short = np.flatnonzero(~reached[:, side])
        launches, _ = branches.cycle(targets[short, side], after.words[rest[short]])
        last[short, side] = launches[:, -1]
    ends = branches.before(targets.ravel(), np.repeat(first, 2)).reshape(-1, 2)
    falls = ~branches.rising[first]
    ends[falls], last[falls] = ends[falls, ::-1], last[falls, ::-1]
    wide = ends[:, 1] > ends[:, 0]
    return ItineraryIntervals(words[wide], ends[wide], last[wide])


def periodic_launches(branches: MonotoneBranches, found: ItineraryIntervals) -> tuple[np.ndarray, np.ndarray]:
    """The launch speeds (k,) that come back after all hops of their itineraries (k, n); each lies in its interval."""
    excess = found.last - found.ends
    falls = np.prod(np.where(branches.rising[found.words], 1, -1), axis=1) < 0
    crossing = falls & (excess[:, 0] >= 0) & (excess[:, 1] <= 0)
    parts = [(found.words[crossing], found.ends[crossing], excess[crossing])]
    parts.append(_monotone_parts(branches, ItineraryIntervals(*(each[~falls] for each in found))))
    words, ends, values = (np.concatenate(each) for each in zip(*parts, strict=True))
    a, b, fa, fb = enclosed_sign_changes(
        lambda x, i: branches.cycle(x, words[i])[0][:, -1] - x, *ends.T, *values.T
    )  # fmt: skip
    return np.where(np.abs(fa) <= np.abs(fb), a, b), words


def _monotone_parts(branches: MonotoneBranches, found: ItineraryIntervals) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The parts of intervals on which f^n rises that hold one zero of f^n - x each: their itineraries, their ends
    (k, 2), and f^n - x there (k, 2)."""
    words, count = found.words, len(found.words)
    v = np.linspace(0.0, 1.0, ITINERARIES.samples)
    shares = v * v * (3.0 - 2.0 * v)
    x = found.ends[:, :1] + np.diff(found.ends) * shares
    x[:, -1] = found.ends[:, 1]
    which = np.repeat(np.arange(count), ITINERARIES.samples)
    launches, slopes = branches.cycle(x.ravel(), words[which])
    value, slope = (launches[:, -1] - x.ravel()).reshape(x.shape), slopes.reshape(x.shape) - 1.0
    value[:, [0, -1]] = found.last - found.ends
    pool = [np.stack([each[:, :-1].ravel(), each[:, 1:].ravel()], axis=1) for each in (x, value, slope)]
    which, done = np.repeat(np.arange(count), ITINERARIES.samples - 1), list[tuple[np.ndarray, ...]]()
    for _ in range(ITINERARIES.halvings):
        ends, values, slopes = pool
        length = np.diff(ends)[:, 0]
        steepest, flattest = np.abs(slopes).max(1), np.abs(slopes).min(1)
        with np.errstate(invalid="ignore", divide="ignore"):
            one_way = (slopes[:, 0] * slopes[:, 1] > 0) & (steepest <= ITINERARIES.alike_slopes * flattest)
            one_way &= np.abs(np.diff(values)[:, 0] / length - slopes.mean(1)) <= ITINERARIES.near_mean * flattest
            beyond = np.abs(values).min(1) > ITINERARIES.beyond_slopes * length * steepest
            far = (values[:, 0] * values[:, 1] > 0) & beyond
        settled = one_way | far | (length <= ITINERARIES.least_part * ends[:, 1])
        done.append((which[settled], ends[settled], values[settled]))
        which, pool = which[~settled], [each[~settled] for each in pool]
        if not len(which):
            break
        middle = pool[0].mean(1)
        launches, slope = branches.cycle(middle, words[which])
        new = middle, launches[:, -1] - middle, slope - 1.0
        pool = [
            np.concatenate([np.stack([old[:, 0], mid], axis=1), np.stack([mid, old[:, 1]], axis=1)])
            for old, mid in zip(pool, new, strict=True)
        ]
        which = np.tile(which, 2)
    else:
        done.append((which, pool[0], pool[1]))
    which, ends, values = (np.concatenate(each) for each in zip(*done, strict=True))
    holds = (values[:, 0] >= 0) != (values[:, 1] >= 0)
    return words[which[holds]], ends[holds], values[holds]
