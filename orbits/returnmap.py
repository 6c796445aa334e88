"""The one-step return map: from the launch speed at one lift-off after sustained contact to that at the next.

In between lie a flight, impacts that leave at once where the contact would have to pull, and the contact. What a hop
loses is summed from its impacts, not differenced from launch speeds: near a lossless orbit it vanishes like the power
4/3 of the distance, and a difference would be rounding.
"""

from dataclasses import dataclass

import numpy as np

from .errors import InputError, NoOrbit
from .impacts import Impacts
from .model import Affine
from .roots import bracketed_root
from .search import find

# Launch speeds that are computed together: few enough to stay in a processor's cache.
TOGETHER = 1000
# A flight longer than so many of its ballistic times has been carried off.
LONGEST = 1e6
# Families that are looked through for lossless fixed points.
FAMILIES = 1000


@dataclass(frozen=True)
class Hops:
    """What becomes of launches, each array of the launch speeds' shape.

    alpha : launch speeds
    next : launch speed at the next lift-off, NaN where there is none
    loss : alpha**2 - next**2, or what the impacts take off alpha**2 where there is no next one
    impacts : number of impacts in between
    status : "lifts_off"; "rests" where the contact never ends; "collapses" where the spring does in it; "carried_off"
        where the flight does not end; "cap" after too many impacts
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
    inject : added to the launch speed at every lift-off
    cap : impacts of one hop after which it is given up, with the status "cap"

    Called with launch speeds (...), all above 0, it gives `Hops`.
    """

    def __init__(self, machine, inject: float = 0.0, cap: int = 10_000):
        if not np.isfinite(inject):
            raise InputError(f"inject = {inject!r} is not a finite number")
        if isinstance(cap, bool) or not isinstance(cap, int | np.integer) or cap < 1:
            raise InputError(f"cap = {cap!r}; it is a number of impacts, from 1")
        self.machine, self.inject, self.cap = machine, float(inject), int(cap)
        self.impacts = Impacts(machine)

    def __call__(self, alpha) -> Hops:
        """The next launch speeds after launch speeds (...)."""
        alpha = np.asarray(alpha, dtype=float)
        if not (np.isfinite(alpha) & (alpha > 0)).all():
            worst = alpha[~(np.isfinite(alpha) & (alpha > 0))].flat[0]
            raise InputError(f"alpha = {worst:g}; launch speeds are above 0")
        parts = [self._hop(part) for part in np.array_split(alpha.ravel(), max(1, -(-alpha.size // TOGETHER)))]
        columns = (np.concatenate(column).reshape(alpha.shape) for column in zip(*parts, strict=True))
        return Hops(alpha, *columns)

    def _hop(self, alpha):
        """Next launch speeds, losses, impacts and statuses of launch speeds (m,)."""
        rules, m = self.impacts, len(alpha)
        loss, impacts, status = np.zeros(m), np.zeros(m, int), np.full(m, "cap", dtype="<U11")
        state, standing = rules.launch(alpha), np.zeros((m, rules.contact.size))
        flying, skip = np.arange(m), np.full(m, 3)
        limit = LONGEST * (1 + alpha.max(initial=0.0))
        for _ in range(self.cap):
            times, rows = rules.flight.first_zeros(state[flying], rules.p, rules.gap, limit, skip[flying])
            gone = np.isnan(times)
            status[flying[gone]] = "carried_off"
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
            skip[flying] = 1 if rules.restitution > 0 else 2
            if not len(flying):
                break
        return self._released(alpha, loss, impacts, status, standing)

    def _released(self, alpha, loss, impacts, status, standing):
        """The end of hops whose contact begins at the contact states `standing` (m, ...)."""
        rules, contact = self.impacts, self.impacts.contact
        left, ends = alpha**2 - loss, np.full(len(alpha), np.nan)
        if rules.model.conservative:
            status[(status == "lifts_off") & (left < 0)] = "rests"
        lifting = np.flatnonzero(status == "lifts_off")
        if not contact.phase.closed_form and len(lifting):
            # Where its speed turns down before the force ends it, the contact never ends.
            speed = rules.model.contact_speed
            falling = Affine(tuple(-weight for weight in speed.weights), -speed.offset)
            tops, _ = contact.first_zeros(standing[lifting], rules.p, falling, LONGEST, rising=True)
            force = Affine((0.0,) * contact.size + (1.0,))
            times, rows = contact.first_zeros(
                standing[lifting], rules.p, force, np.where(np.isnan(tops), LONGEST, tops)
            )
            lifts = ~np.isnan(times)
            status[lifting[~lifts]] = np.where(np.isnan(tops), "collapses", "rests")[~lifts]
            lifting = lifting[lifts]
            if not rules.model.conservative:
                left[lifting] = speed(rows[lifts, : contact.size]) ** 2
                loss[lifting] = alpha[lifting] ** 2 - left[lifting]
        ends[lifting] = np.sqrt(left[lifting]) + self.inject
        return ends, loss, impacts, status

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
