"""From one orbit to the local optimum of a design, by programs on the meshes of orbits.

From a certified orbit the program is solved on the mesh of that orbit; where it leads, the orbit is found again by its
own equations and certified. What the certificate objects to is demanded from then on; an extreme that has moved to
another place is taken there; and the program is solved again, until it leads nowhere else.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import InputError, NoOrbit
from ..model.model import Model
from ..periodic.formulations import equations_of
from ..periodic.interpretation import certified_orbit
from ..periodic.orbit import Orbit
from ..periodic.solution import vector
from ..symbolic import interrupts
from ..symbolic.ipopt import Minimum
from .problem import DesignProblem, Outputs, units_of
from .program import DEMAND_MARGIN, DesignPoint, design_point
from .quantities import base_statement

# An orbit so many times as fast or slow as the first, still going while the parameters come to rest inside their bounds
# (by this share of their size and of their way to the bound ahead), is on its way to infinity or to nothing.
ESCAPED, RESTING = 10.0, 1e-2
# An orbit that is lost after it has become so many times as fast or long was running off.
LOST_RATIO = 2.0
# Programs that lead into a contact that never ends, before that is what the design amounts to.
COLLAPSES = 6
# The objective beside what the constraints are exceeded by, while they are not met.
PENALTY = (1e-3, 1.0)
# Programs solved from one start, at most, and the smallest share of the parameters' range that they are kept to.
MOST_ROUNDS, LEAST_REACH = 25, 1e-4
# The program and the orbit's own equations agree to this share of the unknowns when its mesh is fine enough.
AGREE = 1e-11
# A parameter put on its bound, or rounded, takes the orbit along: the unknowns by this many times its share, at most.
SWING = 10.0
# A parameter that Ipopt leaves so little inside its bound, as a share of its unit, is on it.
ONBOUND = 1e-8
# A bound or a constraint counts as active within this share of its size.
ACTIVE = 1e-7
# What an orbit found anew may move, as a share, before it is another orbit.
ANOTHER = 1e-3
# Slopes, as a share of the objective over a parameter's range, at which the optimality conditions count as met.
STATIONARY_SLOPE = 1e-6
# The constraints together are broken by no more than this share when they count as met.
MET = 1e-8


@dataclass(frozen=True)
class Active:
    """Something that keeps the optimum from being better.

    text : the constraint, bound or demand
    multiplier : by how much the objective would get better per unit that it is relaxed, to first order; per unit that
        the value is raised, of an equation
    """

    text: str
    multiplier: float


class Unbounded(NoOrbit):
    """The objective gets better for ever."""

    size = 0.0


class Infeasible(NoOrbit):
    """Constraints cannot be met; `size` is by how much, scaled."""

    def __init__(self, message: str, size: float):
        super().__init__(message)
        self.size = size


@dataclass(frozen=True, eq=False)
class LocalOptimum:
    """Where a start led to; `objective` is the least of what is minimised."""

    machine: object
    orbit: Orbit
    objective: float
    quantities: Mapping[str, float]
    active: tuple[Active, ...]
    idle: tuple[str, ...]
    kkt: float


class LocalSearch:
    """What a start is led by: the question, the demands so far, and how far the parameters may move at once."""

    def __init__(self, machine, orbit: Orbit, brief: DesignProblem):
        self.machine, self.orbit, self.brief, self.first = machine, orbit, brief, orbit
        self.model: Model = machine.model
        self.units = units_of(machine)
        self.demands: list[str] = []
        self.reach = 1.0
        self.both: dict[str, tuple] = {}
        self.seen: list[tuple] = []
        self.span = np.subtract(brief.high, brief.low)
        self.demand()
        scene = self.scene()
        values, slopes = scene.values, scene.slopes
        m = len(brief.constraints)
        if not np.isfinite(values[: 1 + m]).all():
            raise NoOrbit(f"'{brief.text}' or a constraint has no value at {_said(machine, brief)}")
        self.flat = ~slopes[: 1 + m].any(0)
        self.sizes = self._sizes(scene)

    def demand(self):
        """Demand from now on what the orbit lacks to be a motion."""
        c = self.orbit.certificate
        for name in ("clearance", "smallest_separation", "smallest_contact_force"):
            value = getattr(c, name)
            if value is not None and value < 2 * DEMAND_MARGIN and name not in self.demands:
                self.demands.append(name)

    def scene(self) -> DesignPoint:
        """The question at the orbit."""
        brief = self.brief
        asked = Outputs((brief.formula, *(c.formula for c in brief.constraints)), brief.names, tuple(self.demands))
        return design_point(self.machine, self.orbit, asked, self.units, self.both)

    def _sizes(self, scene: DesignPoint) -> np.ndarray:
        """What counts as one unit of each constraint, from the scene at the start: the larger side of one
        between formulas; the bound; or, where that is zero, the value, or what the parameters change it by.

        They stay for all programs from one start: one that went with what is left of a constraint would never see it
        met.
        """
        values, k = scene.values, len(self.brief.names)
        words = dict(zip(scene.words, values[len(values) - scene.program.ties - len(scene.words) :], strict=False))
        known = self.machine.values | words
        theta = np.array([self.machine.values[name] for name in self.brief.names])
        sizes = []
        for constraint, value, slope in zip(self.brief.constraints, values[1:], scene.slopes[1:], strict=False):
            terms = constraint.formula.terms
            bounds = [abs(bound) for bound in (constraint.low, constraint.high) if np.isfinite(bound)]
            if len(terms) > 1:
                bounds += [abs(float(term(**{name: known[name] for name in term.names}))) for term in terms]
            change = np.abs(slope[:k]) * np.where(theta, np.abs(theta), self.span)
            sizes.append(max(bounds) or max(abs(value), change.max()) or 1.0)
        return np.array(sizes)

    def scales(self, values: np.ndarray) -> np.ndarray:
        """Of the objective (with its sign), the constraints, the landing jerk and the demands, at values of them."""
        m = len(self.brief.constraints)
        if not np.isfinite(values).all():
            raise NoOrbit(f"'{self.brief.text}' or a constraint has no value at {_said(self.machine, self.brief)}")
        return np.array([
            self.brief.sign * (abs(values[0]) or 1.0), *self.sizes, abs(values[1 + m]), *np.ones(len(values) - m - 2)
        ])  # fmt: skip

    def solve(self, scene: DesignPoint, weights) -> tuple[Minimum, np.ndarray]:
        scales = self.scales(scene.values[: scene.program.scales.numel()])
        limits = [np.array([getattr(c, side) for c in self.brief.constraints]) / self.sizes for side in ("low", "high")]
        theta = scene.theta
        bounds = self.brief.within(theta, self.reach)
        return scene.minimise(bounds, self.brief.units(theta), self.reach, limits, scales, weights), scales

    def lacking(self, scene: DesignPoint) -> np.ndarray:
        """What each constraint is broken by, as a share of its size."""
        stated = zip(self.brief.constraints, scene.values[1:], self.sizes, strict=False)
        return np.array([c.excess(float(v)) / size for c, v, size in stated])

    def move(self, scene: DesignPoint, x: np.ndarray) -> bool:
        """Go to the orbit that a program led to; whether that is where it said."""
        k = len(self.brief.names)
        theta = np.clip(x[:k], self.brief.low, self.brief.high)
        # A parameter that Ipopt leaves just inside its bound is on it.
        units = self.brief.units(theta)
        near = np.minimum(theta - self.brief.low, np.array(self.brief.high) - theta) < ONBOUND * units
        ends = np.where(theta - self.brief.low < 0.5 * self.span, self.brief.low, self.brief.high)
        theta = np.where(near, ends, theta)
        machine = self.machine.with_values(**dict(zip(self.brief.names, theta.tolist(), strict=True)))
        n = len(base_statement(self.model).unknowns)
        orbit, u = certified(machine, x[k : k + n])
        off = np.max(np.abs(u - x[k : k + n]) / np.maximum(np.abs(u), 1e-3))
        if off > ANOTHER or orbit.family != self.first.family:
            raise NoOrbit("the program leads to another orbit")
        if orbit.contact_time is None:
            raise NoOrbit("; ".join(orbit.violations))
        self.machine, self.orbit = machine, orbit
        return bool(off < AGREE + SWING * np.max(np.abs(theta - x[:k]) / units))

    def escaping(self, far: float) -> str:
        """Where the orbit is on its way to, when it has become `far` times as fast or long, or as slow or short."""
        now, first = self.orbit, self.first
        for name in ("alpha", "contact_time"):
            ratio = getattr(now, name) / getattr(first, name)
            if not 1 / far < ratio < far:
                how = "escapes" if ratio > 1 else "shrinks to nothing"
                return (
                    f"the objective has no {'least' if self.brief.sign > 0 else 'largest'} value: '{self.brief.text}' "
                    f"gets better as the orbit {how}, {name} = {getattr(now, name):.4g} at "
                    f"{_said(self.machine, self.brief)} and still going; bound it, as subject_to=['{name} "
                    f"{'<=' if ratio > 1 else '>='} ...']"
                )
        return ""

    def tie(self, scene: DesignPoint, fresh: DesignPoint):
        """Of the places of an extreme that take turns from scene to scene, hold both from now on."""
        for place, when in zip(scene.places, _place_times(scene), strict=True):
            if place not in fresh.places:
                self.both[place.extreme] = ((place, when),)


def _place_times(scene: DesignPoint) -> list[float]:
    """The times of the places of a scene, 0 for those that are not inside."""
    names = scene.program.unknowns
    return [float(scene.u[names.index(f"at {i}")]) if f"at {i}" in names else 0.0 for i in range(len(scene.places))]


def local_optimum(machine, orbit: Orbit, brief: DesignProblem) -> LocalOptimum:
    """The local optimum that an orbit leads to; raises `NoOrbit` when it leads to none."""
    way = LocalSearch(machine, orbit, brief)
    collapses, weights, reason = 0, None, ""
    for _ in range(MOST_ROUNDS):
        interrupts.check()
        scene = way.scene()
        weights = weights or ((1.0, 0.0) if way.lacking(scene).sum() <= MET else PENALTY)
        answer, scales = way.solve(scene, weights)
        if answer.reason and not weights[1]:
            weights = PENALTY
            answer, scales = way.solve(scene, weights)
        before = way.machine
        try:
            exact = way.move(scene, answer.x)
        except NoOrbit as error:
            reason, way.reach = str(error), way.reach / 4
            collapses += reason == way.model.violations["end"]
            if way.reach < LEAST_REACH or collapses > COLLAPSES:
                raise _lost(way, reason, collapses) from None
            continue
        stopped = _at_reach(scene, answer, way.reach, brief)
        if stopped and _resting(before, way.machine, brief) and (ending := way.escaping(ESCAPED)):
            raise Unbounded(ending)
        way.demand()
        fresh = way.scene()
        same = (fresh.places, fresh.demands) == (scene.places, scene.demands)
        if not same:
            if exact and not stopped and fresh.places in way.seen and fresh.demands == scene.demands:
                way.tie(scene, fresh)
            way.seen.append(scene.places)
        settled = exact and not stopped and same and way.orbit.admissible
        if weights[1]:
            lacking = way.lacking(fresh)
            if lacking.sum() <= MET:
                weights = (1.0, 0.0)
            elif settled and weights[0] and _moved(before, way.machine, brief) <= 1e-3:
                weights = (0.0, 1.0)
            elif settled and not weights[0]:
                raise _infeasible(way, lacking)
        elif settled and not answer.reason:
            end = _ended(way, fresh, scales)
            if end.kkt <= STATIONARY_SLOPE:
                return end
            reason, way.reach = f"the optimality conditions are off by {end.kkt:.1e}", way.reach / 4
            if way.reach < LEAST_REACH:
                raise _lost(way, reason, collapses)
            continue
        # As far as the extremes keep their places; beyond, the program says nothing.
        way.reach = way.reach / 2 if stopped and not same else min(1.0, 2 * way.reach)
    raise NoOrbit(
        f"no optimum within {MOST_ROUNDS} programs, at {_said(way.machine, brief)}" + (reason and f": {reason}")
    )


def _moved(before, after, brief: DesignProblem) -> float:
    was, now = (np.array([machine.values[name] for name in brief.names]) for machine in (before, after))
    return float(np.max(np.abs(now - was) / brief.units(was)))


def _resting(before, after, brief: DesignProblem) -> bool:
    """Whether the parameters hardly move any more, and lie inside their bounds."""
    for name, low, high in zip(brief.names, brief.low, brief.high, strict=True):
        was, now = before.values[name], after.values[name]
        if abs(now - was) > RESTING * min(abs(now), now - low if now < was else high - now):
            return False
    return True


def _at_reach(scene: DesignPoint, answer: Minimum, reach: float, brief: DesignProblem) -> bool:
    """Whether the program was stopped by how far its mesh serves."""
    k, n = len(brief.names), scene.program.size
    theta, units = answer.x[:k], brief.units(scene.theta)
    low, high = brief.within(scene.theta, reach)
    # what is left to the end of the reach, where that is none of the bounds asked for
    left = np.minimum(np.where(low > brief.low, theta - low, np.inf), np.where(high < brief.high, high - theta, np.inf))
    ratio = np.abs(np.log(answer.x[k + 1 : k + n] / scene.u[1:]))
    return bool((left < 1e-3 * reach * units).any() or (ratio > 0.999 * np.log1p(min(reach, 1.0))).any())


def _lost(way: LocalSearch, reason: str, collapses: int) -> NoOrbit:
    """Nowhere to go on to: the family ends, or a phase collapses, just beyond."""
    where = _said(way.machine, way.brief)
    if collapses:
        return Unbounded(f"the design runs into a collapse just beyond {where}: {way.model.violations['end']}")
    if ending := way.escaping(LOST_RATIO):
        return Unbounded(ending)
    return NoOrbit(f"the design cannot be carried on from {where}: {reason}")


def _infeasible(way: LocalSearch, lacking: np.ndarray) -> Infeasible:
    values = way.scene().values[1:]
    what = [
        f"'{c.text}' is missed by {c.excess(float(v)):.4g}, at {float(v):.6g}"
        for c, v, lack in zip(way.brief.constraints, values, lacking, strict=False)
        if lack > MET
    ]
    bounds = ", ".join(f"{low:g} <= {n} <= {high:g}" for n, low, high in
                       zip(way.brief.names, way.brief.low, way.brief.high, strict=True))  # fmt: skip
    return Infeasible(
        f"no motion was found with {bounds} that meets the constraints: at best {' and '.join(what)}, with "
        f"{_said(way.machine, way.brief)}; relax it, or widen the bounds",
        float(lacking.sum()),
    )


def _said(machine, brief: DesignProblem) -> str:
    return ", ".join(f"{name} = {machine.values[name]:.6g}" for name in brief.names)


def certified(machine, u) -> tuple[Orbit, np.ndarray]:
    """The certified orbit of a machine near unknowns `u` of its simplest statement, and the unknowns."""
    began, model, p = time.perf_counter(), machine.model, dict(machine.values)
    method = "relative" if model.reduction else "half orbit"
    equations = equations_of(model, method, tuple(p))
    u, here = equations.newton(u, vector(p))
    return certified_orbit(machine, method, u, here, began=began), u


def _ended(way: LocalSearch, scene: DesignPoint, scales) -> LocalOptimum:
    """The optimum with its conditions, all recomputed at the certified orbit."""
    brief, values, slopes = way.brief, scene.values, scene.slopes
    k = len(brief.names)
    theta = scene.theta
    unit = brief.units(theta)
    slope = brief.sign * slopes[0] * unit / abs(scales[0])
    rows, names, free, units = [], [], [], []
    for i, name in enumerate(brief.names):
        for side, bound, relation in ((-1.0, brief.low[i], ">="), (1.0, brief.high[i], "<=")):
            if abs(theta[i] - bound) <= ACTIVE * unit[i]:
                rows.append(side * np.eye(k)[i])
                names.append(f"{name} {relation} {bound:g}")
                free.append(False)
                units.append(unit[i])
    violation = 0.0
    stated = [(c.text, c.low, c.high) for c in brief.constraints]
    stated += [(f"{name} > 0", 0.0, np.inf) for name in ("-landing_jerk", *scene.demands)]
    rest = values[1:], slopes[1:], scales[1:]
    for (text, low, high), value, row, scale in zip(stated, *rest, strict=False):
        violation = max(violation, max(low - value, value - high, 0.0) / scale)
        sides = [(s, b) for s, b in ((-1.0, low), (1.0, high)) if abs(value - b) <= ACTIVE * scale]
        for side, _ in sides[:1]:
            rows.append(side * row * unit / scale)
            names.append(text)
            free.append(low == high)
            units.append(scale)
    count = len(values) - scene.program.ties
    for row in slopes[count:]:  # where two places have the same extreme it may be sought at either
        rows.append(row * unit / abs(scales[0]))
        names.append("an extreme at two places")
        free.append(True)
        units.append(abs(scales[0]))
    multipliers, left = _multipliers(slope, rows, free)
    return LocalOptimum(
        way.machine,
        way.orbit,
        float(brief.sign * values[0]),
        dict(zip(scene.words, values[count - len(scene.words) : count].tolist(), strict=True)),
        tuple(Active(n, float(x * abs(scales[0]) / u)) for n, x, u in zip(names, multipliers, units, strict=True) if x),
        _idle(way, slopes[: count - len(scene.words)]),
        max(float(np.abs(left).max()), violation),
    )


def _idle(way: LocalSearch, slopes: np.ndarray) -> tuple[str, ...]:
    """The parameters that nothing asked for depends on: in no formula, and with slopes that vanish exactly, by
    structure, where the start was as here."""
    brief = way.brief
    named = brief.formula.names.union(*(constraint.formula.names for constraint in brief.constraints))
    flat = way.flat & ~slopes.any(0)
    idle = tuple(name for name, still in zip(brief.names, flat, strict=True) if still and name not in named)
    if len(idle) == len(brief.names):
        raise InputError(f"'{brief.text}' and the constraints do not depend on {', '.join(idle)}: nothing to design")
    return idle


def _multipliers(slope: np.ndarray, rows: list, free: list) -> tuple[np.ndarray, np.ndarray]:
    """Multipliers of active constraints (rows point outwards) that make slope + rows . multipliers least, not negative
    but where `free`; and what is left."""
    multipliers, used = np.zeros(len(rows)), list(range(len(rows)))
    while used:
        found = np.linalg.lstsq(np.array([rows[i] for i in used]).T, -slope, rcond=None)[0]
        worst = min(range(len(used)), key=lambda j: 0.0 if free[used[j]] else found[j])
        if free[used[worst]] or found[worst] >= 0:
            multipliers[used] = found
            break
        del used[worst]
    return multipliers, slope + sum((x * row for x, row in zip(multipliers, rows, strict=True)), np.zeros(len(slope)))
