"""The one-step return map: from the launch speed at one lift-off after sustained contact to that at the next.

In between lie a flight, impacts that leave at once where the contact would have to pull, and the contact. What a hop
loses is summed from its impacts, not differenced from launch speeds: near a lossless orbit it vanishes like the power
4/3 of the distance, and a difference would be rounding.
"""

from dataclasses import dataclass

import numpy as np

from .errors import InputError, NoOrbit
from .impacts import CAP, LIFTOFF_ORDER, STATUS, Impacts, failed
from .question import number_of, whole_of
from .roots import bracketed_root
from .search import find

# Launch speeds that are computed together: few enough to stay in a processor's cache.
TOGETHER = 1000
# Families that are looked through for lossless fixed points.
FAMILIES = 1000


@dataclass(frozen=True)
class Hops:
    """What becomes of launches, each array of the launch speeds' shape.

    alpha : launch speeds
    next : launch speed at the next lift-off, with the injection, NaN where there is none
    loss : what the hop loses of alpha**2 before the injection, or what its impacts do where there is no next launch
    impacts : number of impacts in between
    status : "lifts_off", or why there is no next launch: a name of `orbits.impacts.STATUSES`
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
        self.inject, self.cap = number_of("inject", inject), whole_of("cap", cap, "impacts")
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
        parts = [self._hop(part) for part in np.array_split(alpha.ravel(), max(1, -(-alpha.size // TOGETHER)))]
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

        Lossless ones are those of `find`; the others lie where next - alpha changes its sign between neighbouring
        launches that come to the same number of impacts, `samples` of them, closer beside lossless ones, where an
        injection makes two.
        """
        if not 0 < low < high < np.inf:
            raise InputError(f"low = {low:g}, high = {high:g}: 0 < low < high is needed")
        lossless = self._lossless(low, high)
        if self.inject == 0 and self.impacts.model.conservative:
            return tuple(FixedPoint(alpha, "lossless") for alpha in lossless)
        near = np.geomspace(1e-12, high - low, 200)
        grid = np.unique(
            np.concatenate([np.linspace(low, high, samples), *(a + s * near for a in lossless for s in (-1, 1))])
        )
        grid = grid[(grid >= low) & (grid <= high)]
        hops = self(grid)
        gain = hops.next - grid
        same = (hops.impacts[1:] == hops.impacts[:-1]) & ((gain[1:] >= 0) != (gain[:-1] >= 0))
        found = []
        for i in np.flatnonzero(same & np.isfinite(gain[1:]) & np.isfinite(gain[:-1])):
            ends = grid[i], grid[i + 1], gain[i], gain[i + 1]
            found.append(
                FixedPoint(bracketed_root(lambda alpha: float(self(alpha).next) - alpha, *map(float, ends)), "crossing")
            )
        return tuple(found)

    def _lossless(self, low: float, high: float) -> list[float]:
        """Launch speeds of the lossless orbits that are motions."""
        if not self.impacts.model.conservative:
            return []
        found = []
        for family in range(1, FAMILIES):
            try:
                orbit = find(self.machine, family)
            except NoOrbit:
                break
            if orbit.alpha > high:
                break
            if orbit.alpha >= low and orbit.admissible:
                found.append(orbit.alpha)
        return found

    def preimages(self, edges, low: float, high: float, samples: int = 2000) -> list[tuple[float, float]]:
        """The intervals of launch speeds between `low` and `high` whose next launch speed lies in one of the intervals
        `edges`, ends located by bisection on the map's continuous pieces."""
        grid = np.linspace(low, high, samples)
        inside = _within(self(grid).next, edges)
        ends = []
        for i in np.flatnonzero(inside[1:] != inside[:-1]):
            a, b = grid[i], grid[i + 1]
            for _ in range(60):
                middle = 0.5 * (a + b)
                if bool(_within(self(middle).next, edges)) == inside[i]:
                    a = middle
                else:
                    b = middle
            ends.append(0.5 * (a + b))
        ends = [*([low] if inside[0] else []), *ends, *([high] if inside[-1] else [])]
        return list(zip(ends[::2], ends[1::2], strict=True))


def _within(values, edges) -> np.ndarray:
    """Whether values lie in one of some intervals."""
    return (
        np.any([(values >= low) & (values <= high) for low, high in edges], axis=0) if len(edges) else values != values
    )
