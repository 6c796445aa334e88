"""The one-step return map: from the launch speed at one lift-off after sustained contact to that at the next.

In between lie a flight, impacts that leave at once where the contact would have to pull, and the contact. What a hop
loses is summed from its impacts, not differenced from launch speeds: near a lossless orbit it vanishes like the power
4/3 of the distance, and a difference would be rounding.
"""

import time
from dataclasses import dataclass

import numpy as np

from ..errors import FlowError, InputError, NoOrbit, finite_number, whole_number
from ..flow.flow import flow_of
from ..numerics.bernstein import piecewise_roots
from ..numerics.roots import enclosed_sign_changes, resolved
from ..periodic.find import find
from ..periodic.formulations import equations_of
from ..periodic.interpretation import certified_orbit
from .impacts import CAP, LIFTOFF_ORDER, STATUS, Impacts, failed

# Launch speeds that are computed together: few enough to stay in a processor's cache.
BATCH_SIZE = 1000
# Where the map changes by less between neighbouring numbers, as a share, it crosses a level and does not jump past it.
JUMP = 1e-6
# Lossless orbits are looked for in so many families beyond the last one found,
FURTHER = 3
# ... or with so many launches to half an oscillation, but not more than this.
PER_TURN, MOST_SAMPLES = 8, 2000
# Below this, in the units of the machine, no lossless launch is looked for.
SLOWEST_LOSSLESS = 1e-3
# A basin is known when one hop more adds less to it, as a share of the launches asked for: near mass ratio 1 it has
# ever more and ever shorter intervals without end.
SETTLED = 1e-5


@dataclass(frozen=True)
class Hops:
    """What becomes of launches, each array of the launch speeds' shape.

    alpha : launch speeds
    next : launch speed at the next lift-off, with the injection, NaN where there is none
    loss : what the hop loses of alpha**2 before the injection, or what its impacts do where there is no next launch
    impacts : number of impacts in between
    status : "lifts_off", or why there is no next launch: a name of `orbits.hybrid.impacts.STATUSES`
    """

    alpha: np.ndarray
    next: np.ndarray
    loss: np.ndarray
    impacts: np.ndarray
    status: np.ndarray

    def document(self) -> dict:
        """The hops as the JSON document of the command line."""
        columns = {
            name: np.ravel(getattr(self, name)).tolist() for name in ("alpha", "next", "loss", "impacts", "status")
        }
        return {**columns, "next": [None if np.isnan(value) else value for value in columns["next"]]}


@dataclass(frozen=True)
class FixedPoint:
    """A launch speed that comes back; kind "lossless" or "crossing", where the map crosses the identity line."""

    alpha: float
    kind: str


class ReturnMap:
    """The return map of a machine, with its restitution and damping.

    machine : as in `find`
    inject : added to the launch speed at every lift-off; with a damper the extension there depends on the speed, and
        the injection moves the machine to that of the new speed
    cap : impacts of one hop after which it is given up, with the status "cap"

    Called with launch speeds (...), all above 0, it gives `Hops`. Whether the masses pass through each other on the way
    is not asked: see `Simulation.smallest_separation`.
    """

    def __init__(self, machine, inject: float = 0.0, cap: int = CAP):
        self.inject, self.cap = finite_number("inject", inject), whole_number("cap", cap, "impacts")
        self.machine = machine
        self.impacts = Impacts(machine)
        if not self.impacts.model.one_speed:
            raise InputError(f"a launch of a {self.impacts.model.name} is more than a speed: it has no map of speeds")

    def __call__(self, alpha) -> Hops:
        """The next launch speeds after launch speeds (...)."""
        try:
            alpha = np.asarray(alpha, dtype=float)
        except (TypeError, ValueError):
            raise InputError(f"alpha = {alpha!r}; launch speeds are numbers") from None
        if not (np.isfinite(alpha) & (alpha > 0)).all():
            worst = alpha[~(np.isfinite(alpha) & (alpha > 0))].flat[0]
            raise InputError(f"alpha = {worst:g}; launch speeds are above 0")
        count = -(-alpha.size // BATCH_SIZE)
        parts = [self._hop(part) for part in np.array_split(alpha.ravel(), count)] if count else []
        parts = parts or [(np.zeros(0), np.zeros(0), np.zeros(0, int), np.zeros(0, STATUS))]
        columns = (np.concatenate(column).reshape(alpha.shape) for column in zip(*parts, strict=True))
        return Hops(alpha, *columns)

    def _hop(self, alpha):
        """Next launch speeds, losses, impacts and statuses of launch speeds (m,)."""
        rules, m = self.impacts, len(alpha)
        loss, impacts, status = np.zeros(m), np.zeros(m, int), np.full(m, "no_launch", dtype=STATUS)
        state, standing = rules.launch(alpha), np.zeros((m, rules.contact.size))
        flying = np.flatnonzero(rules.opens(state))
        status[flying] = "cap"
        order = LIFTOFF_ORDER
        for _ in range(self.cap):
            start, limit = state[flying], rules.patience("flight", state[flying])
            times, rows, errors = rules.flight.first_zeros(start, rules.p, rules.gap, limit, order)
            gone, order = np.isnan(times), rules.bounce_order
            status[flying[gone]] = "carried_off"
            for i, error in errors.items():
                status[flying[i]] = failed(error, "flight")
            flying = flying[~gone]
            if not len(flying):
                break
            landing = rules.landing(rows[~gone, : rules.flight.size])
            impacts[flying] += 1
            loss[flying] += 2 * landing.loss / rules.power
            held = flying[landing.held]
            standing[held], status[held] = landing.state[landing.held] @ rules.onto_contact.T, "lifts_off"
            state[flying] = landing.state
            flying = flying[~landing.held]
            if not len(flying):
                break
        return self._released(alpha, loss, impacts, status, standing)

    def _released(self, alpha, loss, impacts, status, standing):
        """The end of hops whose contact begins at the contact states `standing` (m, k)."""
        rules, next_speed = self.impacts, np.full(len(alpha), np.nan)
        left, lifting = alpha**2 - loss, np.flatnonzero(status == "lifts_off")
        if rules.contact.phase.closed_form:  # the energy alone decides: a straight line passes the lift-off level once
            status[lifting[left[lifting] < 0]] = "rests"
        elif len(lifting):
            status[lifting], ends = rules.stand_all(standing[lifting])
            ended = status[lifting] == "lifts_off"
            lifting = lifting[ended]
            speed, launches = rules.liftoff(ends[ended])
            status[lifting[~launches]] = "leaves_elsewhere"
            if not rules.model.conservative:
                lifting, speed = lifting[launches], speed[launches]
                left[lifting] = speed**2
                loss[lifting] = alpha[lifting] ** 2 - left[lifting]
        lifting = np.flatnonzero(status == "lifts_off")
        next_speed[lifting] = np.sqrt(np.maximum(left[lifting], 0.0)) + self.inject
        stays = next_speed <= 0
        status[stays], next_speed[stays] = "rests", np.nan
        return next_speed, loss, impacts, status

    def fixed_points(self, low: float, high: float, samples: int = 2000) -> tuple["FixedPoint", ...]:
        """The fixed points of the map between two launch speeds, ascending.

        Without losses beside those of impacts and without injection they are the lossless orbits that are motions:
        under constant gravity all of them, otherwise those of `find`. Else they lie where the map crosses the identity
        line, found where next - alpha changes its sign between neighbours of a grid of `samples` launches, closer
        beside lossless ones, where an injection makes two, and beside its extrema.
        """
        low, high = _speed_range(low, high)
        if self.inject == 0 and self.impacts.model.conservative:
            return tuple(FixedPoint(alpha, "lossless") for alpha in self._lossless(low, high))
        gain = lambda alpha, which=None: self._next(alpha) - alpha  # noqa: E731
        grid, values = self._resolved(low, high, samples, True)
        values = values - grid
        i = np.flatnonzero((values[1:] >= 0) != (values[:-1] >= 0))
        a, b, fa, fb = enclosed_sign_changes(gain, grid[i], grid[i + 1], values[i], values[i + 1])
        crosses = np.maximum(np.abs(fa), np.abs(fb)) <= JUMP * a
        found = np.where(np.abs(fa) <= np.abs(fb), a, b)[crosses]
        return tuple(FixedPoint(float(alpha), "crossing") for alpha in found)

    def _next(self, alpha) -> np.ndarray:
        """Next launch speeds, 0 where there are none."""
        return np.nan_to_num(self(alpha).next, nan=0.0)

    def _resolved(self, low: float, high: float, samples: int, identity: bool) -> tuple[np.ndarray, np.ndarray]:
        """Launch speeds from `low` to `high` and next ones, 0 where there are none: ever closer beside the lossless
        ones, where the map has no slope, and beside extrema: those that may touch the identity line, or all."""
        near = np.geomspace(1e-12, high - low, 200)
        beside = [star + side * near for star in self._lossless(low, high) for side in (-1, 1)]
        grid = np.concatenate([np.linspace(low, high, whole_number("samples", samples, "launches", 2)), *beside])
        grid = np.unique(grid[(grid >= low) & (grid <= high)])
        tilt = float(identity)
        grid, values = resolved(lambda alpha: self(alpha).next - tilt * alpha, grid, identity)
        return grid, np.nan_to_num(values + tilt * grid, nan=0.0)

    def _lossless(self, low: float, high: float) -> list[float]:
        """Launch speeds of the lossless orbits that are motions, ascending."""
        model = self.impacts.model
        if not model.conservative:
            return []
        orbits = self._orbits_all(low, high) if model.reduction and not model.reduction.exact else self._orbits(high)
        return sorted({orbit.alpha for orbit in orbits if low <= orbit.alpha <= high and orbit.admissible})

    def _orbits(self, high: float):
        """The orbit that `find` gives of each family, until a few in a row lie beyond `high` or are none."""
        beyond, family = 0, 1
        while beyond <= FURTHER:
            try:
                orbit = find(self.machine, family)
            except NoOrbit:
                orbit = None
            if orbit and orbit.alpha <= high:
                beyond = 0
                yield orbit
            else:
                beyond += 1
            family += 1

    def _orbits_all(self, low: float, high: float):
        """All orbits under constant gravity: the reduced motion, half a flight of the time alpha, ends at a turn."""
        model, p = self.impacts.model, self.impacts.p
        along = flow_of(model.reduction.statement.arcs[0].phase, tuple(self.impacts.values))
        (liftoff,) = model.release(np.array([low]), self.impacts.values)

        def half_flight(alpha: float):
            try:
                return along.run([liftoff, alpha], p, alpha)[0]
            except FlowError:
                return None

        def end_speed(alphas, which=None):
            return np.array([0.0 if (path := half_flight(alpha)) is None else path.end[1] for alpha in alphas])

        turns = [
            np.diff([path.times[i] + t for i, t in piecewise_roots(path.coefficients[:, 1], path.steps)])
            for alpha in np.geomspace(low, high, 5)
            if (path := half_flight(alpha)) is not None
        ]
        shortest = max(np.concatenate([[high - low], *turns]).min(), (high - low) / MOST_SAMPLES)
        grid, values = resolved(end_speed, np.linspace(low, high, 2 + int(PER_TURN * (high - low) / shortest)), True)
        i = np.flatnonzero((values[1:] >= 0) != (values[:-1] >= 0))
        equations = equations_of(model, "relative", tuple(self.impacts.values))
        for alpha in enclosed_sign_changes(end_speed, grid[i], grid[i + 1], values[i], values[i + 1])[0]:
            began = time.perf_counter()
            try:
                u, here = equations.newton([liftoff, alpha], p)
                yield certified_orbit(self.machine, "relative", u, here, began=began)
            except NoOrbit:
                continue

    def jumps(self, hops: Hops) -> np.ndarray:
        """After which of the launches of hops (m,), ascending, the map jumps: an impact more or less comes in, and the
        next launch speeds do not run on."""
        change = np.abs(np.diff(np.nan_to_num(hops.next, nan=0.0)))
        beside = np.maximum(np.append(0.0, change[:-1]), np.append(change[1:], 0.0))
        i = np.flatnonzero((np.diff(hops.impacts) != 0) & (change > beside))  # other jumps are none to be seen
        same = lambda alpha, which: np.where(self(alpha).impacts == hops.impacts[i[which]], 1.0, -1.0)  # noqa: E731
        ones = np.ones(len(i))
        a, b, _, _ = enclosed_sign_changes(same, hops.alpha[i], hops.alpha[i + 1], ones, -ones)
        return i[np.abs(self._next(a) - self._next(b)) > JUMP * a]

    def preimages(self, edges, low: float, high: float, samples: int = 2000) -> list[tuple[float, float]]:
        """The intervals of launch speeds between `low` and `high` whose next launch speed lies in one of the intervals
        `edges`, ascending.

        They end where the map passes an edge, or jumps; it is known from a grid as in `fixed_points`.
        """
        low, high = _speed_range(low, high)
        edges = [(finite_number("edges", a), finite_number("edges", b)) for a, b in edges]
        if wrong := [pair for pair in edges if not 0 < pair[0] <= pair[1]]:
            raise InputError(f"edges = {wrong[0]}; the launch speeds of an interval are above 0 and ascend")
        return self._preimages(edges, *self._resolved(low, high, samples, False))

    def _preimages(self, edges, grid, values) -> list[tuple[float, float]]:
        """`preimages` by the map's values on a grid that resolves it."""
        levels = np.unique(edges)
        above = values[:, None] >= levels
        i, k = np.nonzero(above[1:] != above[:-1])
        passes = lambda alpha, which: self._next(alpha) - levels[k[which]]  # noqa: E731
        ends = enclosed_sign_changes(passes, grid[i], grid[i + 1], values[i] - levels[k], values[i + 1] - levels[k])[0]
        ends = np.unique([grid[0], *ends, grid[-1]])
        ends = ends[np.append(True, np.diff(ends) > 1e-15 * ends[1:])]
        inside = _within(self._next(0.5 * (ends[1:] + ends[:-1])), edges)
        turns = np.flatnonzero(np.diff(np.concatenate([[0], inside, [0]])))
        return list(zip(ends[turns[::2]].tolist(), ends[turns[1::2]].tolist(), strict=True))

    def basin(self, low: float, high: float, hops: int = 1000, samples: int = 2000) -> list[tuple[float, float]]:
        """The intervals of launch speeds between `low` and `high` that come to a lossless hop, ascending.

        Above a lossless launch speed all launches come down to it, up to where the map falls below it: what comes to
        one in the end comes to one of these intervals before, within at most so many `hops`. Intervals that would add
        only some 1e-5 of the range are left out. Raises `InputError` with injection or damping.
        """
        low, high = _speed_range(low, high)
        if self.inject != 0 or not self.impacts.model.conservative:
            raise InputError("with injection or damping no hop is lossless, and none comes to one")
        stars = self._lossless(SLOWEST_LOSSLESS, high)
        if not stars or stars[0] >= high:
            return []
        grid, values = self._resolved(stars[0], high, samples, False)
        caught = []
        for star, end in zip(stars, [*stars[1:], high], strict=True):
            here = (grid > star) & (grid < end)
            below = np.flatnonzero(here & (values < star))
            if len(below):
                i = below[:1]
                falls = lambda alpha, which, star=star: self._next(alpha) - star  # noqa: E731
                end = float(
                    enclosed_sign_changes(falls, grid[i - 1], grid[i], values[i - 1] - star, values[i] - star)[0][0]
                )
            caught.append((star, end))
        total = 0.0
        for _ in range(whole_number("hops", hops, "hops", 0)):
            caught = self._preimages(caught, grid, values)
            total, last = float(np.diff(caught).sum()), total
            if total - last <= SETTLED * (high - low):
                break
        return [(max(a, low), min(b, high)) for a, b in caught if b > low]


def _speed_range(low, high) -> tuple[float, float]:
    """Two launch speeds, checked."""
    low, high = finite_number("low", low), finite_number("high", high)
    if not 0 < low < high:
        raise InputError(f"low = {low:g}, high = {high:g}: 0 < low < high is needed")
    return low, high


def _within(values, edges) -> np.ndarray:
    """Whether values (m,) lie in one of some intervals that ascend and do not overlap."""
    edges = np.reshape(edges, (-1, 2))
    i = np.searchsorted(edges[:, 0], values, side="right") - 1
    return (i >= 0) & (values <= edges[i, 1]) if len(edges) else np.zeros(len(values), bool)
