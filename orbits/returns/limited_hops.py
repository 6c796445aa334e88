"""Hops of a map while it is resolved, followed with limited effort, and whether they are away from the identity
line."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..hops import CAP, LIFTS_OFF, STATUSES
from .hops import HOP_COLUMNS, Hops

# Labels of hops without a next launch; their impacts are not followed farther where the last one is.
LABELS = {status: -1 - i for i, status in enumerate((*STATUSES, "unfinished"))}
UNFINISHED = LABELS["unfinished"]


class Resolution(NamedTuple):
    """How far a map is resolved; shares of values are relative to the largest value in a cell.

    degrees : of the polynomials in a cell: the second one where the first does not fit
    fitted : shares of the values, for each degree, up to which the last coefficients are rounding
    rounded : share by which a hop that is integrated rounds at most; there the coefficients have come to rest
    resting : factor between coefficients that have come to rest at one size
    nearly : share with which a cell is accepted that cannot be halved any more and holds no border
    rounded_loss : what the loss near a lossless launch makes of its speed may be rounding up to this share
    last, before_last : numbers of coefficients that are compared with these shares, and that rest
    shortest : cells shorter than this share of the range are not halved
    probed, root_like, unchanged : the power at a border is seen within this share of the piece next to it; the ratio of
        changes over lengths 1:4 is 1/4 for a smooth function and 1/2 for a square root; a smaller share of change shows
        no power
    crowded : borders between neighbouring launches of a row, as a share of these, that are very many
    borders_in_a_row : borders that are sought between two neighbouring launches before their cell is fitted and halved
    effort, together : the effort after which the search ends: the impacts of all launches, and a number for each impact
        of launches that are followed together
    part : share of the effort that the borders of the grid may take, and of what is left that hops with more impacts
    first_impacts, more : hops are followed up to this number of impacts first, then to larger ones by this factor
    cells, launches : cells that are fitted, and launches that are followed together
    clear : launches are away from the identity line by this factor of the change from one to the next
    """

    degrees: tuple[int, int] = (16, 32)
    fitted: tuple[float, float] = (3e-15, 1e-13)
    rounded: float = 3e-12
    resting: float = 10.0
    nearly: float = 1e-9
    rounded_loss: float = 1e-11
    last: int = 3
    before_last: int = 10
    shortest: float = 1e-7
    probed: float = 1e-3
    root_like: float = 0.35
    unchanged: float = 1e-14
    crowded: float = 0.125
    borders_in_a_row: int = 12
    effort: float = 5e5
    together: int = 100
    part: float = 0.5
    first_impacts: int = 64
    more: int = 8
    cells: int = 16
    launches: int = 1024
    clear: float = 2.0


RESOLUTION = Resolution()
# Where the pieces near levels are not resolved, launches of the grid show the passages: less effort will do.
NEAR_LEVELS = Resolution(effort=1e5)


class PlainMap(NamedTuple):
    """A map without injection that is to be resolved.

    hops : (launch speeds (m,), largest number of impacts) -> their hops
    lossless : its lossless launch speeds
    cap : the largest number of impacts in a hop
    gains : whether a hop may end with more energy than it has after its impacts
    """

    hops: Callable[[np.ndarray, int], Hops]
    lossless: Sequence[float] = ()
    cap: int = CAP
    gains: bool = False


class EffortSpent(Exception):
    """The search has followed as many impacts as it may."""


class LimitedHops:
    """The hops of a map without injection, until the effort is spent; with an injection also which of them are away
    from the identity line, and otherwise from `levels` of the next launch speed.

    effort, most_effort : what was spent, and where the search ends for now
    levels : of what `excess` is, ascending; None where all launches matter
    """

    def __init__(self, plain: PlainMap, inject: float | None, options: Resolution):
        self.plain, self.inject, self.options = plain, inject, options
        self.effort, self.most_effort = 0.0, options.part * options.effort
        self.levels = None if inject is None else np.zeros(1)

    def hops_from(self, x: np.ndarray) -> Hops:
        """The hops from launch speeds, some "unfinished" where they have more impacts than the effort allows; raises
        `EffortSpent`."""
        parts = [self._followed(part) for part in np.array_split(x, -(-len(x) // self.options.launches) or 1)]
        alpha, *others = (np.concatenate([getattr(each, name) for each in parts]) for name in HOP_COLUMNS)
        following, loss, impacts, status = others
        return Hops(alpha, following, loss, impacts, status)

    def _followed(self, x: np.ndarray) -> Hops:
        """The hops from a number of launch speeds that are followed together."""
        options, cap = self.options, min(self.options.first_impacts, self.plain.cap)
        if self.effort > self.most_effort:
            raise EffortSpent
        hops = self._hops(x, cap)
        while cap < self.plain.cap and (longer := np.flatnonzero(hops.status == "cap")).size:
            cap = min(options.more * cap, self.plain.cap)
            if (options.together + len(longer)) * cap > options.part * (self.most_effort - self.effort):
                hops.status[longer] = "unfinished"
                break
            found = self._hops(x[longer], cap)
            for name in HOP_COLUMNS:
                getattr(hops, name)[longer] = getattr(found, name)
        return hops

    def _hops(self, x: np.ndarray, cap: int) -> Hops:
        hops = self.plain.hops(x, cap)
        self.effort += float(self.options.together * hops.impacts.max(initial=0) + hops.impacts.sum())
        return hops

    def excess(self, hops: Hops) -> np.ndarray:
        """The next launch speeds, with an injection less those of the hops: minus infinity where there is none, and NaN
        where that of an unfinished hop, or of one that rounding decides on, may reach a level."""
        less = 0.0 if self.inject is None else hops.alpha - self.inject
        excess = np.where(hops.status == LIFTS_OFF, hops.next - less, -np.inf)
        most = np.sqrt(np.maximum(hops.alpha**2 - hops.loss, 0.0)) - less
        lowest = -np.inf if self.levels is None else self.levels[0]
        unknown = np.isin(hops.status, ("unfinished", "undecided")) & ((most >= lowest) | self.plain.gains)
        return np.where(unknown, np.nan, excess)

    def is_away(self, excess: np.ndarray, change: np.ndarray) -> np.ndarray:
        """Whether all of the launches (..., n) are away from the levels, from their `changes`."""
        if self.levels is None:
            return np.zeros(excess.shape[:-1], bool)
        ends, place = np.concatenate([[-np.inf], self.levels, [np.inf]]), np.searchsorted(self.levels, excess)
        with np.errstate(invalid="ignore"):
            below = np.where(place > 0, excess - ends[place], np.inf)
        apart = np.minimum(below, ends[place + 1] - excess).min(-1)
        return (place == place[..., :1]).all(-1) & (apart > self.options.clear * change.max(-1))

    def labels(self, hops: Hops) -> np.ndarray:
        """The numbers of impacts of hops, or minus a number for each status without a next launch."""
        pairs = zip(hops.impacts, hops.status.tolist(), strict=True)
        return np.array([count if status == LIFTS_OFF else LABELS[status] for count, status in pairs])

    def near(self, excess: np.ndarray) -> list[slice]:
        """The parts of launches in order (n,) between which the map is not away from the levels."""
        pairs = [np.stack([each[:-1], each[1:]], axis=1) for each in (excess, changes(excess))]
        away = self.is_away(*pairs)
        switches = np.flatnonzero(np.diff(np.concatenate([[0], ~away, [0]])))
        return [slice(i, k + 1) for i, k in switches.reshape(-1, 2).tolist()]


def changes(values: np.ndarray) -> np.ndarray:
    """The larger distance of each of the values (..., n) from its finite neighbours; infinite where it has none, and 0
    where it is not finite itself."""
    with np.errstate(invalid="ignore"):
        apart = np.abs(np.diff(values))
    apart = np.where(np.isfinite(apart), apart, -1.0)
    ends = np.full((*values.shape[:-1], 1), -1.0)
    change = np.maximum(np.concatenate([ends, apart], axis=-1), np.concatenate([apart, ends], axis=-1))
    return np.where(np.isfinite(values), np.where(change < 0, np.inf, change), 0.0)
