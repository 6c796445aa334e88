"""The one-step return map: from the launch speed at one lift-off after sustained contact to that at the next.

A hop is a flight, impacts after which the machine leaves at once, and a sustained contact. The loss of a hop is the sum
of the losses of its impacts. It is not the difference of launch speeds: near a lossless orbit the loss vanishes like
the power 4/3 of the distance, and the difference would be rounding.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, finite_number, whole_number
from ..model.machine import ImpactingMachine
from ..model.units import SPEED, SPEED_SQUARED, Units, without_units
from ..numerics.roots import enclosed_sign_changes
from .fixed_points import JUMP, FixedPoint, Intervals, ResolvedMap, lossless_speeds, or_zero
from .impacts import CAP, LIFTOFF_ORDER, STATUS, Impacts, status_of_failure

# Launch speeds in one batch: few enough to stay in a processor's cache.
BATCH_SIZE = 1000
# Below this, in the units of the machine, no lossless launch is searched.
SLOWEST_LOSSLESS = 1e-3


@dataclass(frozen=True)
class Hops:
    """The outcome of launches, each array of the launch speeds' shape.

    alpha : launch speeds
    next : launch speed at the next lift-off, with the injection, NaN where there is none
    loss : loss of alpha**2 in the hop before the injection, or in its impacts where there is no next launch
    impacts : number of impacts in between
    status : "lifts_off", or why there is no next launch: a name of `orbits.hybrid.impacts.STATUSES`
    """

    alpha: np.ndarray
    next: np.ndarray
    loss: np.ndarray
    impacts: np.ndarray
    status: np.ndarray

    def in_units(self, units: Units) -> "Hops":
        """Dimensionless hops in these units."""
        return units.convert(self, next=SPEED, loss=SPEED_SQUARED)

    def document(self) -> dict[str, Any]:
        """The hops as the JSON document of the command line."""
        columns = {name: np.ravel(values).tolist() for name, values in vars(self).items()}
        return {**columns, "next": [None if np.isnan(value) else value for value in columns["next"]]}


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
        self.inject, self.cap, self.machine = finite_number("inject", inject), whole_number("cap", cap, "impacts"), machine
        self._bare: ReturnMap | None = None  # of the dimensionless machine, where this one has units
        self._speed = 1.0
        if units := getattr(machine, "units", None):
            self._speed = units.of(SPEED)
            self._bare = ReturnMap(machine.dimensionless(), self.inject / self._speed, self.cap)
        self.impacts = self._bare.impacts if self._bare else Impacts(machine)
        if not self.impacts.model.one_speed:
            raise InputError(f"a launch of a {self.impacts.model.name} is more than a speed: it has no map of speeds")

    def __call__(self, alpha: ArrayLike) -> Hops:
        """The next launch speeds after launch speeds (...)."""
        try:
            alpha = np.asarray(alpha, dtype=float)
        except (TypeError, ValueError):
            raise InputError(f"alpha = {alpha!r}; launch speeds are numbers") from None
        if len(wrong := alpha[~(np.isfinite(alpha) & (alpha > 0))]):
            raise InputError(f"alpha = {wrong[0]:g}; launch speeds are above 0")
        if self._bare:
            with without_units():
                return replace(self._bare(alpha / self._speed).in_units(self.machine.units), alpha=alpha)
        if not alpha.size:
            return Hops(alpha, alpha, alpha, alpha.astype(int), alpha.astype(STATUS))
        batches = np.array_split(alpha.ravel(), -(-alpha.size // BATCH_SIZE))
        hops = [vars(_hops_from(self.impacts, batch, self.inject, self.cap)) for batch in batches]
        return Hops(**{name: np.concatenate([part[name] for part in hops]).reshape(alpha.shape) for name in hops[0]})

    def fixed_points(self, low: float, high: float, samples: int = 2000) -> tuple[FixedPoint, ...]:
        """The fixed points of the map between two launch speeds, ascending.

        Without injection or damping they are the lossless orbits that are motions: all of them under constant gravity,
        otherwise those of `find`. Else the map crosses the identity line there: next - alpha changes its sign between
        neighbours of a grid of `samples` launches, refined toward lossless ones and toward extrema.
        """
        low, high = _speed_range(low, high)
        if self._bare:
            found = self._bare.fixed_points(low / self._speed, high / self._speed, samples)
            return tuple(self.machine.units.convert(point) for point in found)
        lossless = lossless_speeds(self.impacts, low, high)
        if self.inject == 0 and self.impacts.model.conservative:
            return tuple(FixedPoint(alpha, "lossless") for alpha in lossless)
        crossings = ResolvedMap(self, lossless, low, high, samples, True).crossings()
        return tuple(FixedPoint(float(alpha), "crossing") for alpha in crossings)

    def jumps(self, hops: Hops) -> np.ndarray:
        """Indices of the launches of hops (m,), ascending, after which the map jumps: the number of impacts changes,
        and the next launch speed is not continuous."""
        if self._bare:
            return self._bare.jumps(hops.in_units(self.machine.units.inverse()))
        change = np.abs(np.diff(or_zero(hops.next)))
        beside = np.maximum(np.append(0.0, change[:-1]), np.append(change[1:], 0.0))
        # A jump that is smaller than the changes beside it would not be seen in a plot.
        i = np.flatnonzero((np.diff(hops.impacts) != 0) & (change > beside))
        same = lambda alpha, which: np.where(self(alpha).impacts == hops.impacts[i[which]], 1.0, -1.0)  # noqa: E731
        a, b, _, _ = enclosed_sign_changes(same, hops.alpha[i], hops.alpha[i + 1], np.ones(len(i)), -np.ones(len(i)))
        return i[np.abs(or_zero(self(a).next) - or_zero(self(b).next)) > JUMP * a]

    def preimages(self, edges: Intervals, low: float, high: float, samples: int = 2000) -> Intervals:
        """The intervals of launch speeds between `low` and `high`, ascending, whose next one lies in one of the
        intervals `edges`. They end where the map passes an edge, or jumps; the grid is as in `fixed_points`."""
        low, high = _speed_range(low, high)
        edges = [(finite_number("edges", a), finite_number("edges", b)) for a, b in edges]
        if wrong := [pair for pair in edges if not 0 < pair[0] <= pair[1]]:
            raise InputError(f"edges = {wrong[0]}; the launch speeds of an interval are above 0 and ascend")
        if self._bare:
            speeds = [(a / self._speed, b / self._speed) for a, b in edges]
            return self._in_units(self._bare.preimages(speeds, low / self._speed, high / self._speed, samples))
        lossless = lossless_speeds(self.impacts, low, high)
        return ResolvedMap(self, lossless, low, high, samples, False).preimages(edges)

    def _in_units(self, intervals: Intervals) -> Intervals:
        return [(a * self._speed, b * self._speed) for a, b in intervals]

    def basin(self, low: float, high: float, hops: int = 1000, samples: int = 2000) -> Intervals:
        """The intervals of launch speeds between `low` and `high` that come to a lossless hop, ascending.

        All launches just above a lossless one come down to it, up to where the map falls below it; all others enter
        one of these intervals before, within at most `hops` hops. Intervals that would add only some 1e-5 of the range
        are left out. Raises `InputError` with injection or damping.
        """
        low, high = _speed_range(low, high)
        if self.inject != 0 or not self.impacts.model.conservative:
            raise InputError("with injection or damping no hop is lossless, and none comes to one")
        hops = whole_number("hops", hops, "hops", 0)
        if self._bare:
            return self._in_units(self._bare.basin(low / self._speed, high / self._speed, hops, samples))
        lossless = lossless_speeds(self.impacts, SLOWEST_LOSSLESS, high)
        if not lossless or lossless[0] >= high:
            return []
        intervals = ResolvedMap(self, lossless, lossless[0], high, samples, False).basin(lossless, hops, high - low)
        return [(max(a, low), min(b, high)) for a, b in intervals if b > low]


def _speed_range(low: float, high: float) -> tuple[float, float]:
    """Two launch speeds, checked."""
    low, high = finite_number("low", low), finite_number("high", high)
    if not 0 < low < high:
        raise InputError(f"low = {low:g}, high = {high:g}: 0 < low < high is needed")
    return low, high


def _flights_and_impacts(impacts: Impacts, alpha, cap: int):
    """Losses, numbers of impacts, statuses (m,) and contact states (m, k) up to sustained contact ("lifts_off")."""
    m = len(alpha)
    loss, counts, status = np.zeros(m), np.zeros(m, int), np.full(m, "no_launch", dtype=STATUS)
    state, standing = impacts.launch(alpha), np.zeros((m, impacts.contact.size))
    flying, order = np.flatnonzero(impacts.opens(state)), LIFTOFF_ORDER
    status[flying] = "cap"
    for _ in range(cap):
        start, limit = state[flying], impacts.longest_flight(state[flying])
        times, rows, errors = impacts.flight.first_zeros(start, impacts.p, impacts.gap, limit, order)
        gone, order = np.isnan(times), impacts.bounce_order
        status[flying[gone]] = "carried_off"
        for i, error in errors.items():
            status[flying[i]] = status_of_failure(error, "flight")
        flying = flying[~gone]
        if not len(flying):
            break
        landing = impacts.landing(rows[~gone, : impacts.flight.size])
        counts[flying] += 1
        loss[flying] += 2 * landing.loss / impacts.launch_inertia
        held = flying[landing.held]
        standing[held], status[held] = landing.state[landing.held] @ impacts.onto_contact.T, "lifts_off"
        state[flying] = landing.state
        flying = flying[~landing.held]
        if not len(flying):
            break
    return loss, counts, status, standing


def _hops_from(impacts: Impacts, alpha, inject: float, cap: int) -> Hops:
    """One hop from each of the launch speeds (m,), given up after `cap` impacts, with `inject` added to the next."""
    loss, counts, status, standing = _flights_and_impacts(impacts, alpha, cap)
    next_speed, left, lifting = np.full(len(alpha), np.nan), alpha**2 - loss, np.flatnonzero(status == "lifts_off")
    if impacts.contact.phase.closed_form:  # The force is linear: the energy alone decides whether it vanishes.
        status[lifting[left[lifting] < 0]] = "rests"
    elif len(lifting):
        status[lifting], ends = impacts.sustained_contacts(standing[lifting])
        ended = status[lifting] == "lifts_off"
        lifting = lifting[ended]
        speed, launches = impacts.liftoff(ends[ended])
        status[lifting[~launches]] = "leaves_elsewhere"
        if not impacts.model.conservative:
            lifting, speed = lifting[launches], speed[launches]
            left[lifting] = speed**2
            loss[lifting] = alpha[lifting] ** 2 - left[lifting]
    lifting = np.flatnonzero(status == "lifts_off")
    next_speed[lifting] = np.sqrt(np.maximum(left[lifting], 0.0)) + inject
    stopped = next_speed <= 0
    status[stopped], next_speed[stopped] = "rests", np.nan
    return Hops(alpha, next_speed, loss, counts, status)
