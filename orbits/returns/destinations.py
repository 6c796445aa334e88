"""What launches of a return map come to, attracting hops or an end, by preimages of the intervals that trap them.

A trap is a set of launch speeds that no launch leaves again, and in which all come to the same: an interval next to an
attracting hop in which the map contracts towards it, or that above a lossless hop, through which launches come down to
it; launches without a next one; and an interval that the map takes into itself around a chaotic motion. The launches
that enter a trap after n hops are the preimages of the launches that enter it after n - 1: intervals on each monotone
branch of the map, which do not overlap. Launches in no interval after a number of hops are undecided.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..hops import LIFTS_OFF, STATUS
from ..result import Progress
from ..running import interrupts
from .hops import Hops
from .itineraries import ITINERARIES, MonotoneBranches
from .map_pieces import Intervals, MapPieces, without_seams
from .periodic_hop import PERIODIC
from .periodic_hops import cycles_of, polished_cycles
from .settling import CHAOTIC, HAS_PERIOD, PERIODS, UNSETTLED, SettlingMap, settled

UNDECIDED, CHAOS, SLOWER, FASTER, ITSELF = "undecided", "chaotic", "slower", "faster", "itself"
WORDS_OF_ENDS = {
    UNDECIDED: UNDECIDED,
    CHAOS: "chaotic motion",
    SLOWER: "launches that are too slow",
    FASTER: "launches that are too fast",
    ITSELF: "their own launch speed",
}
KINDS = ("lossless", "stable", *WORDS_OF_ENDS)  # of destinations, besides the statuses of launches
UNKNOWN_ENDS = ("cap", "lost", "undecided", "unfinished")  # statuses of launches whose next one is not known


class DestinationOptions(NamedTuple):
    """How attracting motions are searched for, and how far preimages go.

    longest, hops, starts : the longest period that is searched for, by this number of hops from this number of launches
        on a grid, and from all extrema and borders of the map
    neutral : an attracting hop has a multiplier that is farther from 1 in size
    samples, widest, shrink : a trap contracts at this number of launches; the first one that is tried is this share of
        the launch speed wide to either side, and each other one by this factor narrower
    tries : traps that are tried, and images of an interval around a chaotic motion
    complete : preimages end when a smaller share of the range is undecided
    at_once, most : intervals that are pulled back together, the longest ones first, and in all
    shortest : shorter intervals, as a share of the launch speed, are undecided
    growths : hops by which a trap grows at most before its preimages are taken
    probes : launches that show how those without a next one end, in each of their intervals
    """

    longest: int = 16
    hops: int = 2048
    starts: int = 256
    neutral: float = 1e-9
    samples: int = 33
    widest: float = 0.1
    shrink: float = 0.7
    tries: int = 60
    complete: float = 1e-5
    at_once: int = 300
    most: int = 60_000
    shortest: float = 1e-13
    growths: int = 100
    probes: int = 16


DESTINATIONS = DestinationOptions()


@dataclass(frozen=True)
class Destination:
    """What launches come to.

    kind : "lossless" or "stable", a hop; "chaotic", or a period longer than the searched ones; "slower" than all
        lossless hops in the range, or than the speeds at which the map is known; "faster" than these, also where hops
        lose nothing and only gain; "itself" where they do neither, so that each launch comes back; "undecided"; or the
        status of launches without a next one, such as "rests"
    intervals : of the launch speeds that come to it, ascending
    launches : the launch speeds of a hop, the smallest first; the lowest and highest one of a chaotic motion
    multiplier : of a stable hop, else None
    """

    kind: str
    intervals: tuple[tuple[float, float], ...]
    launches: tuple[float, ...] = ()
    multiplier: float | None = None

    @property
    def is_hop(self) -> bool:
        """Whether it is a hop that comes back."""
        return self.kind in ("lossless", "stable")

    @property
    def words(self) -> str:
        """What it is, as in a table."""
        if self.kind == "stable" and len(self.launches) > 1:
            return f"stable hops of period {len(self.launches)}"
        return f"{self.kind} hop" if self.is_hop else WORDS_OF_ENDS.get(self.kind, f"end: {self.kind}")

    def scaled(self, unit: float) -> "Destination":
        """This destination in another unit of speed."""
        intervals = tuple((unit * a, unit * b) for a, b in self.intervals)
        return replace(self, intervals=intervals, launches=tuple(unit * each for each in self.launches))


class SettledMap(NamedTuple):
    """A dimensionless map of launch speeds: its pieces with their monotone branches, and itself."""

    branches: MonotoneBranches
    injected: Callable[[np.ndarray], Hops]

    @property
    def pieces(self) -> MapPieces:
        """The pieces without the injection."""
        return self.branches.pieces


def destinations(
    settling: SettledMap, between: tuple[float, float], lossless: Sequence[float], hops: int, progress: Progress = None
) -> tuple[tuple[Destination, ...], int]:
    """What the launches between two speeds come to within a number of hops, in the range of the map's pieces, and the
    largest number of hops after which a launch is in the trap of a hop.

    lossless : the lossless launch speeds of a map without injection, which are its only attracting hops; of another one
        attracting hops are searched for
    """
    branches, pieces = settling.branches, settling.pieces
    traps = lossless_traps(branches, lossless) if lossless else [*hop_traps(settling)]
    traps += [Destination(SLOWER, ((-np.inf, pieces.low),)), Destination(FASTER, ((pieces.high, np.inf),))]
    traps += ends_of_map(settling)
    parts, depths = preimages_of_traps(branches, [[*each.intervals] for each in traps], between, hops, progress)
    needed = max((depth for trap, depth in zip(traps, depths, strict=True) if trap.is_hop), default=0)
    found = [replace(trap, intervals=tuple(own)) for trap, own in zip(traps, parts, strict=True) if own]
    known = without_seams([pair for each in found for pair in each.intervals])
    gaps = pairwise([between[0], *(end for pair in known for end in pair), between[1]])
    rest = tuple((a, b) for i, (a, b) in enumerate(gaps) if not i % 2 and b - a > DESTINATIONS.shortest * b)
    return (*found, *([Destination(UNDECIDED, rest)] if rest else [])), needed


def lossless_traps(branches: MonotoneBranches, lossless: Sequence[float]) -> list[Destination]:
    """The launches above each of the lossless ones, ascending, from which the map comes down to it, up to the first
    that it takes below."""
    order, found = np.argsort(branches.ends[:, 0]), list[Destination]()
    for star, most in pairwise([*lossless, branches.pieces.high]):
        end, least = star, star * (1 - ITINERARIES.least_part)
        for j in order[branches.ends[order, 1] > star].tolist():
            (a, b), (first, last) = branches.ends[j].tolist(), branches.following[j].tolist()
            if a > end * (1 + ITINERARIES.least_part) or first < least:
                break
            if last < star:
                end = float(branches.before(np.array([star]), np.array([j]))[0])
                break
            end = b
        if (end := min(end, most)) > star:
            found.append(Destination("lossless", ((star, end),), (star,)))
    return found


def hop_traps(settling: SettledMap) -> Iterable[Destination]:
    """The attracting hops of a map, each with a trap, and the intervals around its chaotic motions."""
    branches, options, pieces = settling.branches, DESTINATIONS, settling.pieces
    if not len(branches.ends):
        return
    ends = np.array([pieces.low, pieces.high, *(border.alpha for border in pieces.borders), *pieces.extrema()])
    beside = ITINERARIES.least_part * ends
    starts = np.concatenate([ends - beside, ends, ends + beside, np.linspace(pieces.low, pieces.high, options.starts)])
    starts = np.unique(np.clip(starts, pieces.low, pieces.high))
    status, periods, last, _ = settled(
        SettlingMap(_unknown, pieces), starts, np.full(len(starts), branches.inject), options.longest,
        options.hops, PERIODS.escaped * pieces.high,
    )  # fmt: skip
    cycles = [(row, word) for row, word, *_ in cycles_of(branches, settling.injected, 1)[0]]
    for period in np.unique(periods[(status == HAS_PERIOD) & (periods > 1)]).tolist():
        cycles += _cycles_through(settling, last[(status == HAS_PERIOD) & (periods == period)], period)
    traps = list[Destination]()
    for launches, words in cycles:
        multiplier = float(np.prod(branches.slope(launches, words)))
        if abs(multiplier) < 1 - options.neutral and (width := _half_trap(branches, launches, words, multiplier)):
            trap = [np.array([launches[0] - width, launches[0] + width])]
            for word in words[:0:-1].tolist():
                before, _ = _before(branches.only(np.array([word])), trap[-1][None])
                if not len(before):  # too short to be followed, and so are those before
                    break
                trap.append(before[0])
            own = tuple(sorted((a, b) for a, b in map(np.ndarray.tolist, trap)))
            traps.append(Destination("stable", own, tuple(launches.tolist()), multiplier))
    yield from traps
    for start in last[np.isin(status, (CHAOTIC, UNSETTLED))].tolist():
        if any(a <= start <= b for each in traps for a, b in each.intervals if each.kind == CHAOS):
            continue
        if around := _around(branches, start, [each.launches for each in traps]):
            traps.append(Destination(CHAOS, (around,), around))
            yield traps[-1]


def _unknown(x: np.ndarray) -> Hops:
    """The hops from launch speeds (m,) outside of the pieces of a map, which are not followed."""
    nothing = np.full(x.shape, np.nan)
    return Hops(x, nothing, nothing, np.zeros(x.shape, int), np.full(x.shape, "undecided", STATUS))


def _cycles_through(settling: SettledMap, last: np.ndarray, period: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """The different cycles of a period through launches (m,): their launches, the smallest first, and branches."""
    branches, found = settling.branches, list[tuple[np.ndarray, np.ndarray]]()
    order = np.argsort(branches.ends[:, 0])
    path = [np.unique(np.round(last / (PERIODS.approached * last.max()))) * (PERIODS.approached * last.max())]
    for _ in range(period - 1):
        path.append(settling.pieces.hops(path[-1])[0] + branches.inject)
    launches = np.stack(path, axis=1)
    launches = launches[np.isfinite(launches).all(1)]
    words = order[np.maximum(np.searchsorted(branches.ends[order, 0], launches, side="right") - 1, 0)]
    launches, *_ = polished_cycles(branches, settling.injected, launches, words)
    for row, word in zip(launches, words, strict=True):
        at = int(np.argmin(row))
        row, word = np.roll(row, -at), np.roll(word, -at)
        inside = (row >= branches.ends[word, 0]) & (row <= branches.ends[word, 1])
        comes_back = np.abs(branches.cycle(row[:1], word[None])[0][0, -1] - row[0]) <= PERIODIC.same_cycle * row[0]
        new = all(np.abs(row - other).max() > PERIODIC.same_cycle * row[0] for other, _ in found)
        if inside.all() and comes_back and new:
            found.append((row, word))
    return found


def _half_trap(branches: MonotoneBranches, launches: np.ndarray, words: np.ndarray, multiplier: float) -> float:
    """How far from the first launch of an attracting hop all launches come nearer to it with every round; 0 where no
    such distance is found."""
    options, first = DESTINATIONS, launches[0]
    a, b = branches.ends[words[0]].tolist()
    shares = np.linspace(-1.0, 1.0, options.samples)
    shares, itineraries = shares[shares != 0], np.tile(words, (int((shares != 0).sum()), 1))
    width = min(first - a, b - first, options.widest * first)
    for _ in range(options.tries):
        if not width > ITINERARIES.least_part * first:
            break
        path, _ = branches.cycle(first + width * shares, itineraries)
        inside = (path[:, :-1] >= branches.ends[words, 0]) & (path[:, :-1] <= branches.ends[words, 1])
        nearer = np.abs(path[:, -1] - first) <= 0.5 * (1 + abs(multiplier)) * width * np.abs(shares)
        if inside.all() and nearer.all():
            return float(width)
        width *= options.shrink
    return 0.0


def _around(
    branches: MonotoneBranches, start: float, others: Sequence[tuple[float, ...]]
) -> tuple[float, float] | None:
    """An interval around a motion that has not settled, from a launch, which the map takes into itself; None where none
    is found that has no attracting hop inside."""
    x = np.array([start])
    low = high = start
    for _ in range(DESTINATIONS.hops):
        x = branches.pieces.hops(x)[0] + branches.inject
        if not np.isfinite(x[0]):
            return None
        low, high = min(low, float(x[0])), max(high, float(x[0]))
    for _ in range(DESTINATIONS.tries):
        a, b = np.maximum(branches.ends[:, 0], low), np.minimum(branches.ends[:, 1], high)
        which = np.flatnonzero(b > a)
        if not np.sum((b - a)[which]) >= (high - low) * (1 - ITINERARIES.least_part):
            return None  # some launches have no next one
        image = np.concatenate([branches.next(each[which], which) for each in (a, b)])
        if image.min() >= low and image.max() <= high:
            return None if any(low <= each <= high for own in others for each in own) else (low, high)
        low, high = min(low, float(image.min())), max(high, float(image.max()))
    return None


def ends_of_map(settling: SettledMap) -> list[Destination]:
    """The launches without a next one, by the statuses with which their hops end, as far as these are known."""
    pieces, found = settling.pieces, dict[str, Intervals]()
    known = without_seams([*map(tuple, pieces.edges.tolist()), *pieces.unresolved])
    gaps = [*pairwise([pieces.low, *(end for pair in known for end in pair), pieces.high])][::2]
    for a, b in gaps:
        if b - a <= DESTINATIONS.shortest * b:
            continue
        inside = a + (b - a) * (np.arange(DESTINATIONS.probes) + 0.5) / DESTINATIONS.probes
        statuses = sorted({*settling.injected(inside).status.tolist()})
        if not {*UNKNOWN_ENDS, LIFTS_OFF} & {*statuses}:
            found.setdefault(", ".join(statuses), []).append((a, b))
    return [Destination(kind, tuple(own)) for kind, own in found.items()]


def preimages_of_traps(
    branches: MonotoneBranches, traps: Sequence[Intervals], between: tuple[float, float], hops: int,
    progress: Progress = None,
) -> tuple[list[Intervals], list[int]]:  # fmt: skip
    """The intervals of launches between two speeds that enter each of the traps within a number of hops, ascending, and
    the largest number of hops that was needed for each."""
    options, width = DESTINATIONS, between[1] - between[0]
    grown = [_grown(branches, own, hops) for own in traps]
    traps, first = [own for own, _ in grown], np.array([count for _, count in grown])
    pairs = [(a, b, i) for i, own in enumerate(traps) for a, b in own]
    outside = _without(branches, [(a, b) for a, b, _ in pairs])
    # Intervals, the trap of each and the hops to it: all known ones, and the ones that wait to be pulled back.
    of = np.array([pair[2] for pair in pairs])
    new = np.array([pair[:2] for pair in pairs]), of, first[of]
    waiting: tuple[np.ndarray, ...] = new
    known, missing, pulled = list[tuple[np.ndarray, ...]](), width, 0
    while True:
        interrupts.heed()
        inside = np.clip(new[0], *between)
        known.append((inside, *new[1:]))
        missing -= float(np.diff(inside).sum())
        if progress:
            progress(min(max(1 - missing / width, pulled / options.most, 0.0), 1.0))
        goes_on = np.flatnonzero(waiting[2] < hops)
        if missing <= options.complete * width or not len(goes_on) or pulled >= options.most:
            break
        # The longest ones first: what the short ones add is little.
        goes_on = goes_on[np.argsort(-np.diff(waiting[0][goes_on])[:, 0])]
        now, later = goes_on[: options.at_once], goes_on[options.at_once :]
        ends, trap, depth = (each[now] for each in waiting)
        before, which = _before(outside, ends)
        new = _joined(before, trap[which], depth[which] + 1)
        waiting = tuple(np.concatenate([each[later], more]) for each, more in zip(waiting, new, strict=True))
        pulled += len(now)
    ends, trap, depth = (np.concatenate([each[k] for each in known]) for k in range(3))
    inside = ends[:, 1] > ends[:, 0]
    parts = [without_seams(ends[inside & (trap == i)].tolist()) for i in range(len(traps))]
    return parts, [int(depth[inside & (trap == i)].max(initial=0)) for i in range(len(traps))]


def _before(branches: MonotoneBranches, intervals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The launches (k, 2) on all branches whose next ones lie in intervals (m, 2), and the index of each of these."""
    low, high = np.sort(branches.following, axis=1).T
    branch, which = np.nonzero((intervals[:, 0] < high[:, None]) & (intervals[:, 1] > low[:, None]))
    levels = np.clip(intervals[which], low[branch, None], high[branch, None])
    before = np.sort(branches.before(levels.ravel(), np.repeat(branch, 2)).reshape(-1, 2), axis=1)
    wide = before[:, 1] - before[:, 0] > DESTINATIONS.shortest * before[:, 1]
    return before[wide], which[wide]


def _grown(branches: MonotoneBranches, trap: Intervals, hops: int) -> tuple[Intervals, int]:
    """A trap with the launches next to it, in the same interval, that enter it within a number of hops, and this
    number: the immediate basin of a hop."""
    within, most = (branches.pieces.low, branches.pieces.high), min(hops, DESTINATIONS.growths)
    for count in range(most):
        beside, _ = _before(branches, np.array(trap))
        joined = without_seams([*trap, *map(tuple, beside.tolist())])
        grown = [(a, b) for a, b in joined if any(a <= low and high <= b for low, high in trap)]
        before, length = (length_of(np.clip(each, *within).tolist()) for each in (trap, grown))
        if not length - before > ITINERARIES.least_part * length:
            return trap, count
        trap = grown
    return trap, most


def length_of(intervals: Iterable[Sequence[float]]) -> float:
    """The length of intervals together."""
    return sum(b - a for a, b in intervals)


def _without(branches: MonotoneBranches, traps: Sequence[tuple[float, float]]) -> MonotoneBranches:
    """The parts of branches outside of traps."""
    edges = np.unique(np.ravel(traps))
    parts, parent = list[tuple[float, float]](), list[int]()
    for j, (a, b) in enumerate(branches.ends.tolist()):
        for low, high in pairwise([a, *edges[(edges > a) & (edges < b)].tolist(), b]):
            if not any(first <= 0.5 * (low + high) <= last for first, last in traps):
                parts.append((low, high))
                parent.append(j)
    return branches.only(np.array(parent, int), np.array(parts).reshape(-1, 2))


def _joined(ends: np.ndarray, trap: np.ndarray, hops: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Intervals (m, 2) that do not overlap, each with the number of its trap (m,) and the hops to it (m,), with
    touching intervals joined."""
    if not len(ends):
        return ends, trap, hops
    order = np.argsort(ends[:, 0])
    ends, trap, hops = (each[order] for each in (ends, trap, hops))
    apart = (ends[1:, 0] > ends[:-1, 1] * (1 + ITINERARIES.least_part)) | (trap[1:] != trap[:-1])
    first = np.concatenate([[0], np.flatnonzero(apart) + 1])
    last = np.append(first[1:] - 1, len(ends) - 1)
    return np.stack([ends[first, 0], ends[last, 1]], axis=1), trap[first], np.maximum.reduceat(hops, first)
