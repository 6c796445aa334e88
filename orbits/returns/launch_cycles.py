"""Periodic launches of a machine's return maps along a parameter: the equation for them, and their multiplier.

A launch of period one, a fixed point, comes back after one hop; a launch of period two after two, and not after one.
"""

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np

from ..errors import InputError
from ..hops import LaunchSection
from ..model import Machine, check_machine, free_parameters, machine_in_words
from ..units import LIFTOFF_SPEED
from .hops import Hops
from .hops_along import INJECT, HopsAlong
from .itineraries import MonotoneBranches
from .map_pieces import MapPieces
from .periodic_hops import cycles_of, slope_at
from .return_map import ReturnMap, pieces_between

RESTITUTION = "restitution"
DAMPERS_OF_HOPS = ("damping", "drag")  # a machine may have these at 0 without its model having such a parameter


class MapsOptions(NamedTuple):
    """The maps along a parameter, and where their borders are searched for."""

    samples: int = 400  # launches between which the borders of a map are searched for
    wider: float = 2.0  # how much farther than two launches borders near them are searched for, in their distances
    least_width: float = 1e-4  # distance of two launches that is assumed at least, as a share of the speed
    samples_near: int = 20  # launches between which the borders near two launches are searched for
    cached: int = 8  # the latest maps: a step along a branch returns to its values
    step_along: float = 1e-6  # differences for slopes along the parameter, as a share of its range


MAPS = MapsOptions()


class KnownHops:
    """The hops of a map without injection from launch speeds, which are computed once."""

    def __init__(self, plain: ReturnMap):
        self.plain, self._rows = plain, dict[float, tuple]()

    def __call__(self, alpha: np.ndarray) -> Hops:
        """The hops from launch speeds (...)."""
        flat = alpha.ravel().tolist()
        if new := [*dict.fromkeys(each for each in flat if each not in self._rows)]:
            hops = self.plain(np.array(new))
            rows = zip(*(getattr(hops, name).tolist() for name in ("next", "loss", "impacts", "status")), strict=True)
            self._rows |= dict(zip(new, rows, strict=True))
        columns = zip(*(self._rows[each] for each in flat), strict=True) if flat else [()] * 4
        following, loss, impacts, status = (np.array(column).reshape(alpha.shape) for column in columns)
        return Hops(alpha, following, loss, impacts, status)


class InjectedMap(ReturnMap):
    """A map with injection whose hops are `known` up to that, as those of its own dimensionless map are."""

    def __init__(self, known: KnownHops, own: KnownHops | None, inject: float):
        super().__init__(known.plain.machine, inject, known.plain.cap)
        self._known = known
        if own:
            self._own = InjectedMap(own, None, self.dimensionless().inject)

    def __call__(self, alpha: Any) -> Any:
        return self._known(np.array(alpha, dtype=float)).injected(self.inject)


class MapsAlong:
    """The return maps of a machine along one parameter.

    machine : the machine; its own value of the parameter is ignored
    name : "inject", "restitution", or a parameter of the machine
    low, high : the range of the parameter; maps are requested only inside it
    inject : injection of all maps, unless it is the parameter

    `pieces` are those of the map without injection, in the machine's units, where the injection is the parameter and
    the map was resolved; else None. `units` has those of launch speeds ("alpha") and parameters by name; it is empty
    for a dimensionless machine.
    """

    units: Mapping[str, str] = {}
    pieces: MapPieces | None = None
    one_speed = True  # whether a launch is a speed

    def __init__(self, machine: Machine, name: str, low: float, high: float, inject: float, cap: int):
        self.machine, self.name, self.low, self.high, self.cap = machine, name, low, high, cap
        self.inject, self.one_speed = inject, machine.model.one_speed
        self._cache: OrderedDict[float, ReturnMap] = OrderedDict()
        self._known: tuple[KnownHops, KnownHops | None] | None = None  # of the map without injection, where that varies
        check_machine(machine, "with_values", "restitution")
        if name not in (known := parameters_of_maps(machine)):
            raise InputError(f"the return map has no parameter '{name}'; it has {', '.join(known)}")
        if machine.units:
            speed = machine.units.text(LIFTOFF_SPEED)
            self.units = {**machine_in_words(machine).get("units", {}), "alpha": speed, INJECT: speed}

    def in_words(self, name: str, number: float, digits: int = 6) -> str:
        """A value of the parameter, or a launch speed "alpha", in words: "inject = 0.12 m/s"."""
        return f"{name} = {number:.{digits}g} {self.units.get(name) or ''}".rstrip()

    def machine_at(self, value: float) -> Machine:
        """The machine at a value of the parameter."""
        if self.name == INJECT:
            return self.machine
        if self.name == RESTITUTION:
            return cast(Machine, replace(cast(Any, self.machine), restitution=value))
        return self.machine.with_values(**{self.name: value})

    def at(self, value: float) -> ReturnMap:
        """The map at a value of the parameter."""
        value = float(value)
        if value not in self._cache:
            self._cache[value] = self._made(value)
            if len(self._cache) > MAPS.cached:
                self._cache.popitem(last=False)
        return self._cache[value]

    def _made(self, value: float) -> ReturnMap:
        if self.name != INJECT or value == 0 or not self.machine.model.one_speed:
            return ReturnMap(self.machine_at(value), value if self.name == INJECT else self.inject, self.cap)
        if self._known is None:
            plain = ReturnMap(self.machine, 0.0, self.cap)
            self._known = KnownHops(plain), KnownHops(plain.dimensionless()) if plain.units else None
        return InjectedMap(*self._known, value)

    def resolve(self, low: float, high: float) -> None:
        """Represent the map between two launch speeds by its pieces, which along the injection are the same."""
        if self.name == INJECT and self.pieces is None and not self.at(0.0).only_gains:
            self.pieces = self._pieces(0.0, low, high, MAPS.samples)

    def _pieces(self, value: float, low: float, high: float, samples: int) -> MapPieces:
        """The pieces of the map without injection, at a value of the parameter, between two launch speeds, whose unit
        depends on that value."""
        units, step = self.machine_at(value).units, self.at(value)
        unit = units.of(LIFTOFF_SPEED) if units else 1.0
        return pieces_between(step.dimensionless(), low / unit, high / unit, samples).in_units(unit)

    @cached_property
    def along(self) -> HopsAlong | None:
        """The hops by their equations, None where these do not state them at all values: along a restitution, with one,
        of machines that step or stick, with hysteresis or laws in pieces."""
        if self.name == RESTITUTION or getattr(self.machine, RESTITUTION, 0.0) > 0:
            return None
        machine, *others = (self.machine_at(self.low + share * (self.high - self.low)) for share in (0.5, 0.3, 0.7))
        model, varied = machine.model, {**machine.values, self.name: 0.0}
        same = all(each.model is model and {**each.values, self.name: 0.0} == varied for each in others)
        if not (same and self.name in (*machine.values, INJECT) and model.plain):
            return None
        if model.hysteretic or model.sticks or model.flight.pieces or model.contact.pieces:
            return None
        impacts_at = lambda value: self.at(0.0 if self.name == INJECT else value).impacts  # noqa: E731
        free = ("alpha",) if model.one_speed else LaunchSection(impacts_at(self.low)).names
        return HopsAlong(machine, self.name, self.inject, self.high - self.low, free, impacts_at)

    def all_cycles(self, value: float, between: tuple[float, float], period: int) -> list[np.ndarray]:
        """The launches (period,) of all cycles between two launch speeds at a value of the parameter."""
        pieces = self.pieces or self._pieces(value, *between, MAPS.samples)
        branches = MonotoneBranches.of(pieces, self.added(value))
        return [each[0] for each in cycles_of(branches, self.at(value), period)[0]] if len(branches.ends) else []

    def pieces_at(self, value: float, low: float, high: float) -> MapPieces:
        """The pieces of the map without injection, at a value of the parameter, round two launch speeds."""
        if self.pieces is not None and self.pieces.low <= low and high <= self.pieces.high:
            return self.pieces
        reach = MAPS.wider * max(high - low, MAPS.least_width * high)
        return self._pieces(value, max(low - reach, 0.5 * low), high + reach, MAPS.samples_near)

    def added(self, value: float) -> float:
        """The injection at a value of the parameter."""
        return value if self.name == INJECT else self.inject

    def hops(self, alpha: np.ndarray, value: float | np.ndarray) -> Hops:
        """The hops from launch speeds (m,); along the injection, which may differ from launch to launch (m,), they are
        those of one map, to which it is added."""
        if self.name != INJECT:
            return self.at(float(value))(alpha)
        return self.at(0.0)(alpha).injected(value)

    def next(self, alpha: np.ndarray, value: float | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The next launch speeds (m,) after launch speeds (m,) at a value, or at values (m,), of the parameter, NaN
        where there are none; and the numbers of impacts (m,) until then."""
        if self.name == INJECT or np.ndim(value) == 0:
            hops = self.hops(alpha, value)
            return hops.next, hops.impacts
        following, impacts = np.empty(len(alpha)), np.empty(len(alpha), int)
        for each in np.unique(value):
            hops = self.hops(alpha[value == each], each)
            following[value == each], impacts[value == each] = hops.next, hops.impacts
        return following, impacts

    def cycles(self, alpha: np.ndarray, value: float | np.ndarray, period: int) -> tuple[np.ndarray, np.ndarray]:
        """The launch speeds (m, period + 1) of the hops from launch speeds (m,) at values (m,) of the parameter, NaN
        after a hop without a next launch; and their numbers of impacts (m, period)."""
        launches, impacts = np.full((len(alpha), period + 1), np.nan), np.zeros((len(alpha), period), int)
        launches[:, 0], values = alpha, np.broadcast_to(value, len(alpha))
        for hop in range(period):
            known = np.isfinite(launches[:, hop])
            following = self.next(launches[known, hop], values[known] if np.ndim(value) else value)
            launches[known, hop + 1], impacts[known, hop] = following
        return launches, impacts

    def multiplier(self, launches: tuple[float, ...], value: float) -> float:
        """The multiplier of a cycle, NaN where it has none. It is 1 on lossless hops, which have only one-sided
        derivatives of higher order."""
        step, product = self.at(value), 1.0
        for alpha in launches:
            if (slope := slope_at(step, alpha)) is not None:
                product *= slope
            elif not step.impacts.model.conservative:
                return float("nan")
        return product

    def smooth_cycles(self, alpha: np.ndarray, value: np.ndarray, period: int) -> "SmoothCycles | None":
        """The `cycles` with their derivatives, where the `pieces` of the map have all of their launches; else None."""
        if self.pieces is None and period:
            return None
        launches, impacts = np.empty((len(alpha), period + 1)), np.empty((len(alpha), period), int)
        changes, slopes = np.zeros((len(alpha), period + 1, 2)), np.empty((len(alpha), period))
        launches[:, 0], changes[:, 0, 0] = alpha, 1.0
        for hop in range(period):
            assert self.pieces is not None
            following, slopes[:, hop], impacts[:, hop] = self.pieces.hops(launches[:, hop])
            launches[:, hop + 1] = following + value
            changes[:, hop + 1] = slopes[:, hop, None] * changes[:, hop] + [0.0, 1.0]
        known = np.isfinite(launches).all()
        return SmoothCycles(launches, impacts, slopes, changes) if known else None

    def excess(self, alpha: np.ndarray, value: float | np.ndarray, period: int) -> np.ndarray:
        """The `excess_of` the cycles from launches (m,) at values (m,) of the parameter."""
        return excess_of(self.cycles(alpha, value, period)[0])

    def slopes_along(self, alpha: np.ndarray, value: np.ndarray, period: int, here: np.ndarray) -> np.ndarray:
        """The derivatives (m,) of the excess, which is `here`, with respect to the parameter, by differences within its
        range."""
        if self.name == INJECT and period == 1:
            return np.ones(len(alpha))
        step = MAPS.step_along * (self.high - self.low) * np.where(value > 0.5 * (self.low + self.high), -1, 1)
        return (self.excess(alpha, value + step, period) - here) / step

    def jumps_between(self, alphas: tuple[float, float], value: float, samples: int = 33) -> bool:
        """Whether the map jumps somewhere between two launch speeds, or a hop there has no next launch."""
        hops = self.at(value)(np.linspace(*alphas, samples))
        following = np.isfinite(hops.next)
        return bool(not following.all() or len(self.at(value).jumps(hops)))

    def lossless(self, value: float) -> bool:
        """Whether energy changes by impacts alone: then every fixed point is a lossless hop."""
        step = self.at(value)
        return step.inject == 0 and step.impacts.model.conservative

    def status(self, alpha: float, value: float) -> str:
        """The status of a launch, in the words of `orbits.hops.impacts.STATUSES`."""
        return str(self.at(value)(np.array([alpha])).status[0])


class SmoothCycles(NamedTuple):
    """Cycles from m launches with their derivatives.

    launches, impacts : as of `MapsAlong.cycles`
    slopes : (m, period), of the map at the launches
    changes : (m, period + 1, 2), the derivatives of the launch speeds by the first one and by the parameter
    """

    launches: np.ndarray
    impacts: np.ndarray
    slopes: np.ndarray
    changes: np.ndarray

    @property
    def excess(self) -> tuple[np.ndarray, np.ndarray]:
        """`excess_of` the launches (m,), and its derivatives (m, 2)."""
        half, last = _half(self.launches), self.launches.shape[1] - 1
        first = self.changes[:, half] - self.changes[:, 0]
        if half == last:
            return excess_of(self.launches), first
        a, b = (self.launches[:, k + half] - self.launches[:, k] for k in (0, half))
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = (self.changes[:, last] - self.changes[:, half]) / a[:, None] - (b / a**2)[:, None] * first
        return excess_of(self.launches), slopes


def _half(launches: np.ndarray) -> int:
    """Half the period of cycles with launches (m, period + 1), the period where that is odd."""
    period = launches.shape[1] - 1
    return period // 2 if period % 2 == 0 else period


def excess_of(launches: np.ndarray) -> np.ndarray:
    """The function (m,) that is 0 at periodic launches, from the launch speeds (m, period + 1) of their hops; NaN where
    a hop has no next launch.

    With F the map of all hops, where their number is odd: F(a) - a. Else, with F the map of half of them:
    1 + (F(F(a)) - F(a))/(F(a) - a), which has no zeros at hops of half the period but those with the multiplier -1, so
    that the hops of a period go through the flip at which they begin as a smooth curve.
    """
    half = _half(launches)
    first, second = launches[:, half] - launches[:, 0], launches[:, -1] - launches[:, half]
    with np.errstate(divide="ignore", invalid="ignore"):
        return first if half == launches.shape[1] - 1 else 1.0 + second / first


def _has(machine: Machine, name: str) -> bool:
    """Whether a machine is a dataclass with a field of this name."""
    return is_dataclass(machine) and name in {each.name for each in fields(machine)}


def parameters_of_maps(machine: Machine) -> list[str]:
    """The names of the parameters along which maps can be followed."""
    own = [name for name in (RESTITUTION, *DAMPERS_OF_HOPS) if _has(machine, name)]
    return list(dict.fromkeys([INJECT, *own, *free_parameters(machine)]))
