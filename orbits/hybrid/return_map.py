"""The one-step return map: from the launch speed at one lift-off after sustained contact to that at the next."""

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, finite_number, whole_number
from ..model.machine import ImpactingMachine
from ..numerics.roots import enclosed_sign_changes
from .basins import SETTLED, basin_of, preimages
from .fixed_points import JUMP, FixedPoint, crossings, lossless_speeds, or_zero, resolved_map
from .hops import Hops, hops_from
from .impacts import CAP, STATUS, Impacts

# Launch speeds in one batch: few enough to stay in a processor's cache.
BATCH_SIZE = 1000
# Below this, in the units of the machine, no lossless launch is searched.
SLOWEST_LOSSLESS = 1e-3


class ReturnMap:
    """The return map of a machine, with its restitution and damping.

    machine : as in `find`, with its restitution
    inject : added to the launch speed at every lift-off; with a damper the extension there depends on the speed, and
        the injection moves the machine to that of the new speed
    cap : impacts of one hop after which it is given up, with the status "cap"

    Called with launch speeds (...), all above 0, it gives `Hops`. It does not check whether the masses pass through
    each other: see `Simulation.smallest_separation`. Raises `InputError` where a launch is more than a speed.
    """

    def __init__(self, machine: ImpactingMachine, inject: float = 0.0, cap: int = CAP):
        self.inject, self.cap = finite_number("inject", inject), whole_number("cap", cap, "impacts")
        self.machine = machine
        self.impacts = Impacts(machine)
        if not self.impacts.model.one_speed:
            raise InputError(f"a launch of a {self.impacts.model.name} is more than a speed: it has no map of speeds")

    def __call__(self, alpha: ArrayLike) -> Hops:
        """The next launch speeds after launch speeds (...)."""
        try:
            alpha = np.asarray(alpha, dtype=float)
        except (TypeError, ValueError):
            raise InputError(f"alpha = {alpha!r}; launch speeds are numbers") from None
        if not (np.isfinite(alpha) & (alpha > 0)).all():
            worst = alpha[~(np.isfinite(alpha) & (alpha > 0))].flat[0]
            raise InputError(f"alpha = {worst:g}; launch speeds are above 0")
        if not alpha.size:
            return Hops(alpha, alpha, alpha, alpha.astype(int), alpha.astype(STATUS))
        batches = np.array_split(alpha.ravel(), -(-alpha.size // BATCH_SIZE))
        hops = [hops_from(self.impacts, batch, self.inject, self.cap) for batch in batches]
        columns = {
            name: np.concatenate([getattr(part, name) for part in hops]).reshape(alpha.shape)
            for name in ("next", "loss", "impacts", "status")
        }
        return Hops(alpha, **columns)

    def _next(self, alpha: np.ndarray) -> np.ndarray:
        """Next launch speeds, NaN where there are none."""
        return self(alpha).next

    def fixed_points(self, low: float, high: float, samples: int = 2000) -> tuple[FixedPoint, ...]:
        """The fixed points of the map between two launch speeds, ascending.

        Without injection, and without losses other than those of impacts, they are the lossless orbits that are
        motions: all of them under constant gravity, otherwise those of `find`. In all other cases they are where the
        map crosses the identity line. They are found where next - alpha changes its sign between neighbours of a grid
        of `samples` launches, refined toward lossless ones, where an injection makes two, and toward extrema.
        """
        low, high = _speed_range(low, high)
        lossless = lossless_speeds(self.impacts, low, high)
        if self.inject == 0 and self.impacts.model.conservative:
            return tuple(FixedPoint(alpha, "lossless") for alpha in lossless)
        grid, following = resolved_map(self._next, lossless, low, high, samples, True)
        return tuple(FixedPoint(float(alpha), "crossing") for alpha in crossings(self._next, grid, following))

    def jumps(self, hops: Hops) -> np.ndarray:
        """Indices of the launches of hops (m,), ascending, after which the map jumps: the number of impacts changes,
        and the next launch speed is not continuous."""
        change = np.abs(np.diff(or_zero(hops.next)))
        beside = np.maximum(np.append(0.0, change[:-1]), np.append(change[1:], 0.0))
        # A jump that is smaller than the changes beside it would not be seen in a plot.
        i = np.flatnonzero((np.diff(hops.impacts) != 0) & (change > beside))
        same = lambda alpha, which: np.where(self(alpha).impacts == hops.impacts[i[which]], 1.0, -1.0)  # noqa: E731
        ones = np.ones(len(i))
        a, b, _, _ = enclosed_sign_changes(same, hops.alpha[i], hops.alpha[i + 1], ones, -ones)
        return i[np.abs(or_zero(self._next(a)) - or_zero(self._next(b))) > JUMP * a]

    def preimages(
        self, edges: list[tuple[float, float]], low: float, high: float, samples: int = 2000
    ) -> list[tuple[float, float]]:
        """The intervals of launch speeds between `low` and `high` whose next launch speed lies in one of the intervals
        `edges`, ascending.

        They end where the map passes an edge, or jumps. They are found from a grid as in `fixed_points`.
        """
        low, high = _speed_range(low, high)
        edges = [(finite_number("edges", a), finite_number("edges", b)) for a, b in edges]
        if wrong := [pair for pair in edges if not 0 < pair[0] <= pair[1]]:
            raise InputError(f"edges = {wrong[0]}; the launch speeds of an interval are above 0 and ascend")
        lossless = lossless_speeds(self.impacts, low, high)
        return preimages(self._next, edges, *resolved_map(self._next, lossless, low, high, samples, False))

    def basin(self, low: float, high: float, hops: int = 1000, samples: int = 2000) -> list[tuple[float, float]]:
        """The intervals of launch speeds between `low` and `high` that come to a lossless hop, ascending.

        All launches just above a lossless launch speed come down to it, up to where the map falls below it. All others
        that come to a lossless hop enter one of these intervals before, within at most `hops` hops. Intervals that
        would add only some 1e-5 of the range are left out. Raises `InputError` with injection or damping.
        """
        low, high = _speed_range(low, high)
        if self.inject != 0 or not self.impacts.model.conservative:
            raise InputError("with injection or damping no hop is lossless, and none comes to one")
        hops = whole_number("hops", hops, "hops", 0)
        lossless = lossless_speeds(self.impacts, SLOWEST_LOSSLESS, high)
        if not lossless or lossless[0] >= high:
            return []
        grid, following = resolved_map(self._next, lossless, lossless[0], high, samples, False)
        intervals = basin_of(self._next, lossless, grid, following, hops, SETTLED * (high - low))
        return [(max(a, low), min(b, high)) for a, b in intervals if b > low]


def _speed_range(low: float, high: float) -> tuple[float, float]:
    """Two launch speeds, checked."""
    low, high = finite_number("low", low), finite_number("high", high)
    if not 0 < low < high:
        raise InputError(f"low = {low:g}, high = {high:g}: 0 < low < high is needed")
    return low, high
