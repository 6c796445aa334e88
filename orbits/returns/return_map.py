"""The one-step return map: from the launch speed at one lift-off after sustained contact to that at the next.

A hop is a flight, impacts after which the machine leaves immediately, and a sustained contact. The loss of a hop is the
sum of the losses of its impacts. It is not the difference of launch speeds: near a lossless orbit the loss vanishes
like the power 4/3 of the distance, and the difference would be rounding.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, cached_property, partial
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, NoOrbit, OrbitsError, finite_number, whole_number
from ..hops import (
    CAP,
    FASTEST_LAUNCH,
    STATUS,
    Branches,
    Impacts,
    LaunchSection,
    hops_of_speeds,
    impacts_of,
    injected,
    stand,
)
from ..io import fields_in_line
from ..model import Machine, check_machine, dimensionless, machine_in_words
from ..numerics import enclosed_ends
from ..periodic import find, lossless_speeds
from ..result import Axes, Progress, cell, shown
from ..running import TimeOver, exclusive, in_threads, time_limit
from ..tables import number_text
from ..units import ENERGY, LIFTOFF_SPEED, Message, Quantity, in_own_units, without_units
from .basins import Basins, LaunchIntervals
from .destinations import FASTER, ITSELF, SLOWER, Destination, SettledMap, destinations
from .hops import Hops, Upkeep
from .itineraries import MonotoneBranches
from .launch_hops import LaunchHops, hops_of_launches
from .limited_hops import NEAR_LEVELS, PlainMap
from .map_pieces import PIECES, Intervals, MapPieces
from .periodic_hop import different_hops, periodic_hop
from .periodic_hops import PeriodicHops, all_periodic_hops, lossless_hops, separation_at
from .preimages import Passages
from .resolution import Resolving, map_pieces
from .returning_hops import FixedPoints, ReturningHops


class ReturnMapOptions(NamedTuple):
    """The batches of launches, and the range of a map in its pictures."""

    slowest_lossless: float = 1e-3  # below this, in the units of the machine, no lossless launch is searched for
    batch: int = 8192  # launch speeds: enough to pay for the calls, few enough for the processor's cache
    shown: int = 1000  # launches in the picture of a map
    slowest_share: float = 1e-3  # launches below this share of the slowest one of a range are not followed
    tops: int = 41  # numbers above a range of launches that are tried as a bound that none passes
    below_top: int = 65  # launches below that are mapped
    few: int = 64  # impacts in a hop from these
    highest: float = 9.0  # launch that is shown where there is no lossless one, in the units of the machine


RETURN_MAP = ReturnMapOptions()
DIMENSIONS_OF_UPKEEP = {**dict.fromkeys(("alpha", "inject"), LIFTOFF_SPEED), "energy": ENERGY}


def in_speeds(found: Any, step: "ReturnMap") -> Any:
    """Intervals of launch speeds in the units of the map's machine."""
    assert step.units is not None
    return found.in_units(step.units.of(LIFTOFF_SPEED), step._words)


class ReturnMap:
    """The return map of a machine, with its restitution and damping.

    machine : as in `find`, with its restitution
    inject : added to the launch speed "alpha" at every lift-off, an impulse on the launched coordinate. With a damper
        the extension at lift-off depends on the speed, and the injection moves the machine to the extension of the new
        speed
    cap : number of impacts in one hop after which its computation ends, with the status "cap"

    Called with launch speeds (...) in the machine's units, it returns `Hops`. In an array, a speed that is not a number
    above 0 gets the status "invalid"; a single such speed raises `InputError`. `smallest_separation` shows whether the
    masses pass through each other.

    A launch of a machine of N coordinates has d = 2 N - 3 numbers, with the names `names`: all states of the contact
    but one, which follows from the others since the contact force vanishes. For d > 1, call the map with launches (...,
    d), with a mapping of arrays (...) by name, or with an orbit; it returns `LaunchHops`. Find its fixed points by
    `periodic_hop` and `fixed_points(starts=)`. Methods about intervals of launch speeds, such as basins, raise
    `InputError` for d > 1.

    >>> from orbits import ReturnMap
    >>> from problems import Hopper
    >>> hops = ReturnMap(Hopper())([2.0, 4.0, 4.5])
    >>> hops.status.tolist(), hops.next.round(4).tolist()
    (['rests', 'lifts_off', 'lifts_off'], [nan, 2.0736, 4.4952])
    >>> low, high = ReturnMap(Hopper(), inject=0.03).fixed_points(4, 5)
    >>> round(low.multiplier, 3), round(high.multiplier, 3)
    (7.274, -0.598)
    """

    @exclusive
    def __init__(self, machine: Machine, inject: float = 0.0, cap: int = CAP):
        self.machine, self.units = machine, getattr(machine, "units", None)
        self._speed: float = self.units.of(LIFTOFF_SPEED) if self.units else 1.0
        self.inject, self.cap = injected(inject, self._speed), whole_number("cap", cap, "impacts")
        self._own = ReturnMap(dimensionless(machine), self.inject / self._speed, self.cap) if self.units else None
        self._resolved = dict[tuple[float, float, int, float | None], MapPieces]()
        self.impacts: Any = self._own.impacts if self._own else _impacts_of(machine)

    @cached_property
    def section(self) -> LaunchSection:
        """The launches as points of the section on which the contact force vanishes."""
        if self.impacts.model.hysteretic:
            raise InputError("for a spring with hysteresis, call the map with launch speeds, or use fixed_points")
        return LaunchSection(self.impacts, self.units)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the numbers of a launch."""
        return ("alpha",) if self.impacts.model.one_speed else self.section.names

    def _check_one_speed(self, what: str) -> None:
        """Raise `InputError` where a launch is more than a speed, as `what` is about intervals of speeds."""
        if not self.impacts.model.one_speed:
            raise InputError(
                f"{what}: intervals of launch speeds have no meaning where a launch has {len(self.names)} numbers, "
                f"{', '.join(self.names)}; call the map with launches, or use periodic_hop(start)"
            )

    def dimensionless(self) -> "ReturnMap":
        """The map of the dimensionless machine; the map itself if the machine has no units."""
        return self._own or self

    @cached_property
    def _words(self) -> dict[str, object]:
        return machine_in_words(self.machine)

    def __repr__(self) -> str:
        return fields_in_line(self, "machine", "inject", "cap")

    def _repr_html_(self) -> str:
        speed = self.units.text(LIFTOFF_SPEED) if self.units else ""
        if not self.impacts.model.one_speed:
            rows = [("numbers of a launch", ", ".join(self.names)), ("injection", number_text(self.inject, ""))]
            return cell(f"return map of {self.machine!r}", rows)
        rows = [("injection", number_text(self.inject, speed)), ("impacts of a hop", f"{self.cap} at most")]
        return cell(f"return map of {self.machine!r}", rows, self._draw)

    def _draw(self, axes: Axes | None) -> Axes:
        """Draw the map up to twice the lowest lossless launch speed, or up to a high one."""
        try:
            highest = 2.0 * find(self.machine).alpha
        except OrbitsError:
            highest = RETURN_MAP.highest * self._speed
        return self.plot(highest / RETURN_MAP.shown, highest, axes, samples=RETURN_MAP.shown)

    def __reduce__(self) -> tuple[type, tuple[Machine, float, int]]:
        return type(self), (self.machine, self.inject, self.cap)

    @overload
    def __call__(self, alpha: Sequence[Sequence[float]]) -> LaunchHops: ...

    @overload
    def __call__(self, alpha: float | Sequence[float] | np.ndarray) -> Hops: ...

    @exclusive
    def __call__(self, alpha: Any) -> Any:
        """The `Hops` from launch speeds (...), or the `LaunchHops` from launches (..., d) where d > 1."""
        if not self.impacts.model.one_speed:
            return hops_of_launches(self.machine, self.section, alpha, self.inject / self._speed, self.cap)
        try:
            alpha = np.array(alpha, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise InputError(f"alpha = {alpha!r}; launch speeds must be numbers") from None
        launches = np.isfinite(alpha) & (alpha > 0)
        if not (alpha.ndim or launches):
            raise InputError(f"alpha = {alpha:g}; launch speeds must be above 0")
        return replace(self._hops(alpha, launches), alpha=alpha, machine=self._words)

    @in_own_units(lambda hops, step: hops.in_units(step.units), alpha=LIFTOFF_SPEED)
    def _hops(self, alpha: np.ndarray, launches: np.ndarray) -> Hops:
        """The hops from the launch speeds (...) where `launches` (...) is true."""
        nothing = np.full(alpha.shape, np.nan)
        hops = Hops(alpha, nothing, nothing.copy(), np.zeros(alpha.shape, int), np.full(alpha.shape, "invalid", STATUS))
        places = np.flatnonzero(launches)
        batches = np.array_split(places, -(-len(places) // RETURN_MAP.batch)) if len(places) else []
        hops_from = _hysteretic_hops if isinstance(self.impacts, Branches) else _hops_from
        each = lambda batch: hops_from(self.impacts, alpha.flat[batch], self.inject, self.cap)  # noqa: E731
        for batch, found in zip(batches, in_threads(each, batches), strict=True):
            for name in ("next", "loss", "impacts", "status"):
                getattr(hops, name).reshape(-1)[batch] = getattr(found, name)
        return hops

    @exclusive
    def fixed_points(
        self, low: float | None = None, high: float | None = None, samples: int = 2000, *,
        starts: Sequence[Any] | None = None, progress: Progress = None,
    ) -> FixedPoints:  # fmt: skip
        """The fixed points of the map between two launch speeds, ascending. Or, from `starts`, launches of d numbers,
        the different fixed points that Newton's method finds (see `periodic_hop`), in the order of the starts; near a
        lossless start it also finds the one with less energy.

        Without injection or damping they are the lossless orbits that are motions, from a search like that of
        `find_all`, or of `find` for machines that step. Otherwise they are the crossings of the map with the identity
        line. The search covers the smooth pieces that may touch the line between the launches of a grid of `samples`,
        see `orbits.returns.resolution`; it may miss a fixed point if the map reaches the line and leaves it again
        between two of these. `unresolved` of the result has the intervals of launch speeds in which others may exist,
        since borders accumulate there or hops have very many impacts. `progress` is called with the completed share.

        Raises `NoOrbit` where the search takes more than 30 s, unless `time_limit` allows more.
        """
        if starts is not None:
            return FixedPoints(different_hops(partial(hops_near, self), starts, progress))
        self._check_one_speed("fixed_points(low, high)")
        if low is None or high is None:
            raise InputError(
                "give either two launch speeds, low and high, between which to search fixed points, or starts"
            )
        low, high, samples = _checked_grid(low, high, samples)
        with time_limit(None):
            try:
                found = self._all_periodic(1, low, high, samples, progress)
                return FixedPoints(found.cycles, found.unresolved)
            except TimeOver as over:
                remedy = f"the map follows hops up to {self.cap} impacts; give it a smaller cap to end hops earlier"
                raise over.reached(remedy) from None

    @exclusive
    def periodic_hop(self, start: Any, period: int = 1) -> ReturningHops:
        """The hops that come back to their first launch after `period` hops, by Newton's method from a launch.

        start : a nearby launch, as for the map: its numbers, or an orbit. From a lossless orbit the search begins with
            a launch of more energy, which loses what the injection adds, by the law of the power 4/3

        Raises `NoOrbit` if the method finds none, or hops of a shorter period. Without injection or damping, the hops
        that come back are the lossless hops of `find` and `find_all`, whose orbit may be the start.
        """
        return hops_near(self, start, whole_number("period", period, "hops"))

    @exclusive
    def periodic_hops(
        self, period: int, low: float, high: float, samples: int = 400, *, progress: Progress = None
    ) -> PeriodicHops:
        """All hops that come back after `period` hops, and not before, with all launch speeds between two bounds.

        samples : number of launches of a grid on which the borders of the map's smooth pieces are searched; further
            borders are found where no polynomial fits the map
        progress : called with the completed share

        The search covers all itineraries of monotone branches, see `orbits.returns.itineraries`. The result states its
        assumptions and the launches at which the map is not resolved. Without injection or damping, only the lossless
        hops of period one come back, since landings only lose energy.

        >>> from orbits import ReturnMap
        >>> from problems import Hopper
        >>> hops = ReturnMap(Hopper(), inject=0.135).periodic_hops(3, 4.3, 5.3)
        >>> [(round(each.alpha, 6), round(each.multiplier, 3)) for each in hops]
        [(4.475439, -2.448), (4.476508, 3.702)]
        """
        self._check_one_speed("periodic_hops")
        low, high, samples = _checked_grid(low, high, samples)
        return self._all_periodic(whole_number("period", period, "hops"), low, high, samples, progress)

    @in_own_units(lambda found, step: found.in_units(step.units, step._words), low=LIFTOFF_SPEED, high=LIFTOFF_SPEED)
    def _all_periodic(self, period: int, low: float, high: float, samples: int, progress: Progress) -> PeriodicHops:
        """The `periodic_hops` of a period."""
        if self.inject == 0 and self.impacts.model.conservative and not self.impacts.descends:
            lossless = lossless_speeds(self.machine, low, high) if period == 1 else []
            return lossless_hops(self, period, low, high, lossless)
        if self.only_gains:
            return PeriodicHops(self._words, period, low, high, self.inject, ())
        half = progress and (lambda share: progress(0.5 * share))  # the other half are the hops
        pieces = pieces_between(self, low, high, samples, half, self.inject if period == 1 else None)
        return all_periodic_hops(self, pieces, period, progress and (lambda share: progress(0.5 + 0.5 * share)))

    def _plain(self, lossless: Sequence[float]) -> PlainMap:
        """The map without injection."""
        maps = cache(lambda cap: ReturnMap(self.machine, cap=cap))
        return PlainMap(lambda x, cap: maps(cap)(x), lossless, self.cap, self._first.descends)

    def _passages(self, low: float, high: float, samples: int, lossless: Sequence[float]) -> Passages:
        """Where the map passes levels, between two launch speeds."""
        return Passages(self, Resolving(self._plain(lossless), low, high, samples, None, NEAR_LEVELS), self.inject)

    @property
    def only_gains(self) -> bool:
        """Whether hops lose nothing, so that the injection makes every next launch faster and none comes back."""
        return bool(self.impacts.never_lose and self.impacts.one_liftoff)

    @exclusive
    def smallest_separation(self, alpha: ArrayLike) -> np.ndarray | None:
        """The smallest separations (...) of the masses during the hops from launch speeds (...), None without a rest
        length. If one is not above 0 the masses pass through each other, which the map ignores. Each hop is simulated,
        which takes some milliseconds; a speed that is not above 0 gives NaN."""
        self._check_one_speed("smallest_separation")
        speeds = np.array(alpha, dtype=float)
        found = [separation_at(self, each) if 0 < each < np.inf else np.nan for each in speeds.ravel().tolist()]
        return None if None in found else np.array(found, dtype=float).reshape(speeds.shape)

    @exclusive
    @in_own_units((), hops=())
    def jumps(self, hops: Hops) -> np.ndarray:
        """Indices of the launches of hops (m,), ascending, after which the map jumps: the number of impacts changes,
        and the next launch speed is discontinuous."""
        self._check_one_speed("jumps")
        change = np.abs(np.diff(np.nan_to_num(hops.next)))
        beside = np.maximum(np.append(0.0, change[:-1]), np.append(change[1:], 0.0))
        # A jump smaller than the changes next to it would not be visible in a plot.
        i = np.flatnonzero((np.diff(hops.impacts) != 0) & (change > beside))
        same = lambda alpha, which: self(alpha).impacts == hops.impacts[i[which]]  # noqa: E731
        a, b = enclosed_ends(same, hops.alpha[i], hops.alpha[i + 1])
        return i[np.abs(np.nan_to_num(self(a).next) - np.nan_to_num(self(b).next)) > PIECES.jump * a]

    @exclusive
    @in_own_units(in_speeds, edges=LIFTOFF_SPEED, low=LIFTOFF_SPEED, high=LIFTOFF_SPEED)
    def preimages(self, edges: Intervals, low: float, high: float, samples: int = 2000) -> LaunchIntervals:
        """The intervals of launch speeds between `low` and `high`, ascending, whose next launch speed lies in one of
        the intervals `edges`. An interval ends where the map passes an edge, or jumps. `samples` is as in
        `fixed_points`; the map is resolved near the edges, see `orbits.returns.preimages`."""
        self._check_one_speed("preimages")
        low, high, samples = _checked_grid(low, high, samples)
        try:
            pairs = [(a, b) for a, b in edges]
        except (TypeError, ValueError):
            raise InputError(f"edges = {edges!r}; they must be pairs (low, high) of launch speeds") from None
        edges = [(finite_number("edges", a), finite_number("edges", b)) for a, b in pairs]
        for low_edge, high_edge in edges:
            if not 0 < low_edge <= high_edge:
                ends = {name: Quantity(x, LIFTOFF_SPEED) for name, x in (("low", low_edge), ("high", high_edge))}
                text = "edges = ({low:.17g}, {high:.17g}); the launch speeds of an interval must be above 0 and ascend"
                raise InputError(Message(text, **ends))
        found = self._passages(low, high, samples, lossless_speeds(self.machine, low, high)).preimages(edges)
        return LaunchIntervals(self._words, low, high, tuple(found))

    @exclusive
    def upkeep(self, alpha: float) -> "Upkeep":
        """What keeps the machine hopping with a launch speed: the injection for which this speed is a fixed point, and
        the energy that it adds in every hop. The map's own `inject` does not matter. Raises `NoOrbit` if the hop has no
        next launch.

        >>> from orbits import ReturnMap
        >>> from problems import Hopper, springs
        >>> machine = Hopper(springs.lossy("r", loss_factor=0.01))
        >>> upkeep = ReturnMap(machine).upkeep(4.6)
        >>> round(upkeep.inject, 6), round(float(ReturnMap(machine, upkeep.inject)(4.6).next), 9)
        (0.389609, 4.6)
        """
        self._check_one_speed("upkeep")
        if not finite_number("alpha", alpha) > 0:
            raise InputError(f"alpha = {alpha:g}; launch speeds must be above 0")
        return replace(self._upkeep(float(alpha)), alpha=float(alpha))

    @in_own_units(lambda upkeep, step: step.units.convert(upkeep, **DIMENSIONS_OF_UPKEEP), alpha=LIFTOFF_SPEED)
    def _upkeep(self, alpha: float) -> "Upkeep":
        hop = ReturnMap(self.machine, cap=self.cap)(alpha)
        if hop.status != "lifts_off":
            text = "the hop from alpha = {alpha:g} ends with '{status}': there is no next launch to keep up"
            raise NoOrbit(Message(text, alpha=Quantity(alpha, LIFTOFF_SPEED), status=str(hop.status)))
        before, after = self._first.launch(np.array([float(hop.next), alpha]))
        return Upkeep(alpha, alpha - float(hop.next), self._first.energy(after) - self._first.energy(before))

    @property
    def _first(self) -> Impacts:
        """The impacts, with hysteresis those on one branch."""
        return self.impacts.first() if isinstance(self.impacts, Branches) else self.impacts

    def plot(
        self, low: float, high: float, axes: Axes | None = None, start: float | None = None, hops: int = 60,
        samples: int = 4000, fixed_points: bool = True,
    ) -> Axes:  # fmt: skip
        """Plot the map between two launch speeds, with its fixed points, and with a cobweb of `hops` hops from the
        launch `start`; returns the axes. See `orbits.show.map_figures.plot_map`."""
        self._check_one_speed("plot")
        low, high, samples = _checked_grid(low, high, samples)
        hops = whole_number("hops", hops, "hops", 0)
        return shown("map_figures").plot_map(self, low, high, axes, samples, start, hops, fixed_points)

    def plot_basin(
        self, low: float, high: float, axes: Axes | None = None, hops: int = 1000, samples: int = 2000
    ) -> Axes:
        """Plot the `basins` between two launch speeds: which launches come to which hop, with their share of the range;
        returns the axes."""
        self._check_one_speed("plot_basin")
        return shown("map_figures").plot_basin(self, low, high, axes, hops, samples)

    @exclusive
    @in_own_units(in_speeds, low=LIFTOFF_SPEED, high=LIFTOFF_SPEED)
    def basins(
        self, low: float, high: float, hops: int = 1000, samples: int = 2000, progress: Progress = None
    ) -> Basins:
        """The intervals of launches between two speeds, by what they come to: a lossless hop or, with injection or
        damping, an attracting hop or cycle of hops; rest; chaotic motions; and undecided launches.

        A launch comes to a hop if one of its next launches, within at most `hops` hops, lies in the immediate basin of
        the hop, an interval around it from which all launches come to it. With injection, attracting hops of up to 16
        launches are searched from all extrema and borders of the map, also outside the range. Their basins are the
        preimages of these intervals on the map's pieces, see `orbits.returns.destinations`. `samples` is as in
        `fixed_points`; `progress` is called with the decided share of the range.

        >>> from orbits import ReturnMap
        >>> from problems import Hopper
        >>> basins = ReturnMap(Hopper(), inject=0.03).basins(4.4, 5.0)
        >>> [(round(alpha, 5), round(basins.share_of(alpha), 2)) for alpha in basins]
        [(0.55092, 0.2), (4.51883, 0.11)]
        """
        self._check_one_speed("basins")
        low, high, samples = _checked_grid(low, high, samples)
        hops, words = whole_number("hops", hops, "hops", 0), self._words
        lossless = self.inject == 0 and self.impacts.model.conservative and not self.impacts.descends
        stars = lossless_speeds(self.machine, RETURN_MAP.slowest_lossless, high) if lossless else []
        stars = [star for star in stars if star < high]
        if self.only_gains or (lossless and not stars):
            kind = SLOWER if self.inject < 0 or not self.only_gains else FASTER if self.inject else ITSELF
            return Basins(words, low, high, self.inject, (Destination(kind, ((low, high),)),), 0)
        bottom = stars[0] if lossless else self.inject if self.inject > 0 else RETURN_MAP.slowest_share * low
        top = high if lossless else self._top(high)
        pieces = pieces_between(
            self, min(bottom, low), top, samples, progress and (lambda share: progress(0.5 * share))
        )
        settling = SettledMap(MonotoneBranches.of(pieces, self.inject), self)
        half = progress and (lambda share: progress(0.5 + 0.5 * share))
        return Basins(words, low, high, self.inject, *destinations(settling, (low, high), stars, hops, half))

    def _top(self, high: float) -> float:
        """A launch speed, from `high` on, that slower launches do not pass, as far as some launches below it show."""
        least, step = (
            max(self.inject, RETURN_MAP.slowest_share * high),
            ReturnMap(self.machine, self.inject, RETURN_MAP.few),
        )
        for top in high + least * np.arange(1.0, RETURN_MAP.tops):
            below = top - least * np.linspace(0.0, 1.0, RETURN_MAP.below_top)
            if not (step(below).next > top).any():
                break
        return float(top)

    @exclusive
    @in_own_units(in_speeds, low=LIFTOFF_SPEED, high=LIFTOFF_SPEED)
    def basin(
        self, low: float, high: float, hops: int = 1000, samples: int = 2000,
        progress: Progress = None,
    ) -> LaunchIntervals:  # fmt: skip
        """The intervals of launch speeds between `low` and `high`, ascending, that come to any attracting hop: the
        union of the `basins`, which have the details."""
        found = self.basins(low, high, hops, samples, progress)
        return LaunchIntervals(found.machine, found.low, found.high, tuple(found.union))


def pieces_between(
    step: ReturnMap, low: float, high: float, samples: int, progress: Progress = None, inject: float | None = None
) -> MapPieces:
    """The pieces between two launch speeds of a dimensionless map without injection: all of them, or those near the
    identity line for an injection."""
    known = (step._resolved.get((low, high, samples, each)) for each in (None, inject))
    if (found := next((each for each in known if each), None)) is None:
        plain = step._plain(lossless_speeds(step.machine, low, high))
        found = step._resolved[low, high, samples, inject] = map_pieces(plain, low, high, samples, inject, progress)
    return found


def hops_near(step: ReturnMap, start: Any, period: int = 1, below: bool = False) -> ReturningHops:
    """The hops of a map that come back after `period` of them, near a start; `below` a lossless orbit if stated."""
    with without_units(step.units):
        return periodic_hop(step.machine, step.section, start, period, step.inject / step._speed, step.cap, below)


def _checked_grid(low: float, high: float, samples: int) -> tuple[float, float, int]:
    """Two launch speeds and the number of launches of a grid between them, checked."""
    low, high = finite_number("low", low), finite_number("high", high)
    if not 0 < low < high:
        speeds = {name: Quantity(speed, LIFTOFF_SPEED) for name, speed in (("low", low), ("high", high))}
        raise InputError(Message("low = {low:g}, high = {high:g}: 0 < low < high must hold", **speeds))
    if high > FASTEST_LAUNCH:
        speeds = {name: Quantity(speed, LIFTOFF_SPEED) for name, speed in (("high", high), ("most", FASTEST_LAUNCH))}
        raise InputError(Message("high = {high:g}; a launch speed must be at most {most:g}", **speeds))
    return low, high, whole_number("samples", samples, "launches", 2)


def _hops_from(impacts: Impacts, alpha, inject: float, cap: int) -> Hops:
    """One hop from each of the launch speeds (m,), ended after `cap` impacts, with `inject` added to the next."""
    hops = hops_of_speeds(impacts, alpha, cap)
    loss, status = hops.loss / (0.5 * impacts.launch_inertia), hops.status
    alpha, requested = np.minimum(alpha, FASTEST_LAUNCH), alpha
    remaining = alpha**2 - loss
    if impacts.contact.phase.closed_form and impacts.ends_by_energy:  # of a linear force
        status[(status == "lifts_off") & (remaining < 0)] = "rests"
    else:
        stand(impacts, hops)
        lifting = np.flatnonzero(status == "lifts_off")
        speed, launches = impacts.liftoff(hops.ends[lifting])
        status[lifting[~launches]] = "leaves_elsewhere"
        if not impacts.one_liftoff:
            lifting, speed = lifting[launches], speed[launches]
            remaining[lifting] = speed**2
            loss[lifting] = alpha[lifting] ** 2 - remaining[lifting]
    following = np.where(status == "lifts_off", np.sqrt(np.maximum(remaining, 0.0)), np.nan)
    return Hops(requested, following, loss, hops.impacts, status).injected(inject)


def _impacts_of(machine: Machine) -> "Impacts | Branches":
    """The impacts of a machine, on both branches of a spring with hysteresis."""
    check_machine(machine, "restitution")
    if machine.model.sticks:
        raise InputError(
            f"{machine.model.sticks[0]} of a {machine.model.name} sticks in contact, so it has no map: use "
            "`simulate`, and `multipliers` for the stability of an orbit"
        )
    if not machine.model.hysteretic:
        return impacts_of(machine)
    if not machine.model.one_speed:
        name = machine.model.name
        raise InputError(
            f"a launch of a {name} has several numbers, and its spring has hysteresis: use `simulate` instead of a map"
        )
    return Branches(machine)


def _hysteretic_hops(branches: Branches, alpha, inject: float, cap: int) -> Hops:
    """`_hops_from` of a machine whose spring has hysteresis."""
    hops = hops_of_speeds(branches, alpha, cap)
    following, status = np.where(hops.status == "lifts_off", hops.speeds, np.nan), hops.status
    in_impacts = hops.loss / (0.5 * branches.first().launch_inertia)
    loss = np.where(np.isfinite(following), alpha**2 - following**2, in_impacts)
    return Hops(alpha, following, loss, hops.impacts, status).injected(inject)
