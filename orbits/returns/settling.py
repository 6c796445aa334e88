"""What launches of a return map settle to after many hops: a period, chaos, or an end without a next launch."""

from typing import Any, NamedTuple

import numpy as np

from ..hops import LIFTS_OFF
from ..running import interrupts
from .map_pieces import MapPieces

# What launches settle to besides the statuses of a hop that has no next launch.
HAS_PERIOD, OUT_OF_RANGE, CHAOTIC, UNSETTLED, ESCAPES = "periodic", "outside", "chaotic", "longer", "leaves"


class PeriodOptions(NamedTuple):
    """To what launches settle after many hops."""

    first_hops: int = 128  # after which launches are examined, and again after each doubling of their number
    same: float = 1e-8  # launches that differ by a smaller share come back
    approached: float = 1e-5  # launches that differ by a smaller share may be approaching each other
    chaotic: float = 1e-3  # the mean logarithm of the slopes of a chaotic motion is larger
    starts: int = 3  # in the range of launch speeds
    escaped: float = 10.0  # a launch this many times as fast as the range leaves it


PERIODS = PeriodOptions()


class SettlingMap:
    """The map of one machine without injection, a `ReturnMap`, as polynomials on its pieces and elsewhere itself."""

    def __init__(self, plain: Any, pieces: MapPieces):
        self.plain, self.pieces = plain, pieces

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict[int, str]]:
        """The next launch speeds (m,), the slopes (m,), NaN where the map itself is taken, and by index the statuses of
        launches without a next one."""
        following, slopes, _ = self.pieces.hops(x)
        others, statuses = np.flatnonzero(np.isnan(following)), dict[int, str]()
        if len(others):
            hops = self.plain(x[others])
            following[others] = hops.next
            statuses = {int(i): s for i, s in zip(others, hops.status.tolist(), strict=True) if s != LIFTS_OFF}
        return following, slopes, statuses


def settled(
    step: SettlingMap, starts: np.ndarray, inject: np.ndarray, longest: int, hops: int, fastest: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What launches (m,) settle to with injections (m,): the statuses (m,), periods (m,), 0 where there is none, the
    launch speeds (m,) last visited, the largest of a cycle, and the mean logarithms (m,) of the slopes."""
    m, window = len(starts), 2 * longest
    status, periods = np.full(m, UNSETTLED, dtype=object), np.zeros(m, int)
    last, exponents = np.full(m, np.nan), np.full(m, np.nan)
    x, going, done, until = starts.copy(), np.arange(m), 0, min(PERIODS.first_hops, hops)
    recent, logs = np.full((window + 1, m), np.nan), np.zeros((2, m))
    while len(going):
        interrupts.heed()
        following, slopes, over = step(x[going])
        following += inject[going]
        seen = np.isfinite(slopes) & (slopes != 0) & (2 * done >= hops)
        logs[:, going[seen]] += np.log(np.abs(slopes[seen])), np.ones(int(seen.sum()))
        recent[done % (window + 1), going] = x[going]
        done += 1
        for i, name in over.items():
            status[going[i]] = name
        stops = (following <= 0) & np.isfinite(following)
        status[going[stops]] = "rests"
        away = following > fastest
        status[going[away]] = ESCAPES
        alive = np.isfinite(following) & ~stops & ~away
        x[going[alive]] = following[alive]
        going = going[alive]
        if done < until or not len(going):
            continue
        order = np.arange(done, done + window + 1) % (window + 1)  # the oldest first
        path = recent[order][:, going]
        period = _periods(path, longest, done >= hops)
        found = going[period > 0]
        status[found], periods[found], last[found] = HAS_PERIOD, period[period > 0], path[-longest:, period > 0].max(0)
        going = going[period == 0]
        if done >= hops:
            with np.errstate(divide="ignore", invalid="ignore"):
                exponents[going] = logs[0, going] / logs[1, going]
            status[going[exponents[going] > PERIODS.chaotic]] = CHAOTIC
            last[going] = x[going]
            break
        until = min(2 * until, hops)
    return status, periods, last, exponents


def _periods(path: np.ndarray, longest: int, final: bool) -> np.ndarray:
    """The periods (m,) of launch speeds (n, m), the smallest up to the longest after which all come back; else 0. While
    launches that alternate approach a shorter period, the longer one shows first: unless this is the `final` test, it
    is 0 where a shorter one is not excluded."""
    apart = np.array([
        (np.abs(path[period:] - path[:-period]) / path[period:]).max(0) for period in range(1, longest + 1)
    ])  # fmt: skip
    found = np.where((apart <= PERIODS.same).any(0), 1 + np.argmax(apart <= PERIODS.same, axis=0), 0)
    for i in np.flatnonzero(found > 1).tolist():
        period = int(found[i])
        near = [part for part in range(1, period) if period % part == 0 and apart[part - 1, i] <= PERIODS.approached]
        if near:
            found[i] = near[0] if final else 0
    return found
