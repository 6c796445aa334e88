"""The best design of a machine: parameters and lossless orbit solved together, certified, with what bounds the optimum.

From a certified orbit the program is solved on the mesh of that orbit; where it leads, the orbit is found again by its
own equations and certified. What the certificate objects to is demanded from then on; an extreme that has moved to
another place is taken there; and the program is solved again, until it leads nowhere else.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from . import interrupts
from .brief import Brief, brief_of, formula_of, units_of, words_of
from .errors import InputError, NoOrbit, OrbitsError
from .model import Model
from .nlp import Optimum
from .orbit import Orbit, to_json
from .program import MARGIN, Asked, Scene, scene_of
from .quantities import DIMENSIONS, base_statement, parts_of, quantity_names
from .search import find
from .statements import as_orbit, equations_of, interpret, vector

# An orbit so many times as fast or slow as the first, still going, is on its way to infinity or to nothing.
ESCAPED = 30.0
# Programs solved from one start, at most, and the smallest share of the parameters' range that they are kept to.
MOST_ROUNDS, LEAST_REACH = 40, 1e-4
# The program and the orbit's own equations agree to this share of the unknowns when its mesh is fine enough.
AGREE = 1e-11
# A bound or a constraint counts as active within this share of its size.
ACTIVE = 1e-7
# What an orbit found anew may move, as a share, before it is another orbit.
ANOTHER = 1e-3
# Slopes, as a share of the objective over a parameter's range, at which the optimality conditions count as met.
STATIONARY = 1e-6
# The constraints together are broken by no more than this share when they count as met.
MET = 1e-8


@dataclass(frozen=True)
class Active:
    """Something that keeps the optimum from being better.

    text : the constraint, bound or demand
    multiplier : by how much the objective would get better per unit that it is relaxed, to first order
    """

    text: str
    multiplier: float


@dataclass(frozen=True)
class Start:
    """One of the starts: the parameters it began with, the objective that it led to or the reason why to none."""

    parameters: Mapping[str, float]
    objective: float | None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Design:
    """The best design found; numbers in the machine's units, in SI for a machine stated so.

    machine : with the best parameters
    orbit : its certified lossless orbit
    parameters : their values
    verb, text, objective : "minimise" or "maximise", what, and its value
    quantities : the values of all that the question names
    active : constraints, bounds and demands that hold the optimum where it is
    kkt : largest violation of the optimality conditions: the slope of the Lagrangian as a share of the objective over
        each parameter's range, by the implicit function theorem at the certified orbit, and of the constraints
    starts : all that were tried
    seconds : wall time
    """

    machine: object
    orbit: Orbit
    parameters: Mapping[str, float]
    verb: str
    text: str
    objective: float
    quantities: Mapping[str, float]
    active: tuple[Active, ...]
    kkt: float
    starts: tuple[Start, ...]
    seconds: float

    def document(self) -> dict:
        """The design as the JSON document of the command line."""
        return {
            "verb": self.verb,
            "objective": {"formula": self.text, "value": self.objective},
            "parameters": dict(self.parameters),
            "quantities": dict(self.quantities),
            "active": [{"text": active.text, "multiplier": active.multiplier} for active in self.active],
            "kkt": self.kkt,
            "starts": [
                {"parameters": dict(s.parameters), "objective": s.objective, "reason": s.reason} for s in self.starts
            ],
            "units": "SI" if self.orbit.units else "units of the machine",
            "seconds": self.seconds,
            "orbit": self.orbit.document(),
        }

    def __str__(self) -> str:
        lines = [f"{self.verb} {self.text}: {self.objective:.12g}" + (" (SI)" if self.orbit.units else "")]
        lines += [f"  {name:<24}{value:.12g}" for name, value in self.parameters.items()]
        lines += [f"  {name:<24}{value:.12g}" for name, value in self.quantities.items() if name not in self.parameters]
        lines += [f"  {'held by':<24}{a.text}   (gains {a.multiplier:.4g} per unit)" for a in self.active]
        good = sum(start.objective is not None for start in self.starts)
        lines.append(f"  {'optimality':<24}{self.kkt:.1e}")
        lines.append(f"  {'starts':<24}{good} of {len(self.starts)} led to an optimum, {self.seconds:.2f} s")
        return "\n".join([*lines, "", str(self.orbit)])

    def save(self, path):
        """Write the document to a JSON file."""
        path.write_text(to_json(self.document()) + "\n", encoding="utf-8")


def optimize(
    machine,
    *,
    minimise: str | None = None,
    maximise: str | None = None,
    over: Mapping[str, tuple[float, float]],
    subject_to: Sequence[str] = (),
    family: int = 1,
    starts: int = 4,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Design:
    """The parameters of a machine whose lossless orbit is best.

    machine : as in `find`; its own parameters are the first start, where they lie within the bounds
    minimise, maximise : one of them, a formula of the orbit's quantities (`quantity_names`) and the machine's parameters
    over : bounds of the parameters to choose
    subject_to : constraints, as "stroke <= 0.25", "loss_coefficient <= 2*alpha", "0.1 <= centre_of_mass_rise <= 0.2"
    starts, seed : how many starts, those after the first from Sobol's sequence
    progress : called with the share of the way done

    All numbers are in the machine's units, or in SI where the machine was stated in SI; there the parameters of a
    formula in SI are designed in SI. The orbit is always held to be a motion. The optimum is local: the best of those
    that the starts lead to.
    Raises `InputError` for a question that cannot be meant, and `NoOrbit` with the reason when no start leads to an
    optimum: constraints that cannot be met, with what is lacking; an orbit that escapes; a contact that collapses.
    """
    with interrupts.deferred():
        brief = brief_of(machine, minimise, maximise, over, subject_to)
        return _optimize(machine, brief, family, _starts(machine, brief, starts, seed), progress)


def _optimize(machine, brief: Brief, family: int, points: Sequence[Mapping], progress=None) -> Design:
    """The best that starts lead to; a start is parameters by name, with an "orbit" if one is known."""
    began = time.perf_counter()
    ends: list[_End | OrbitsError] = []
    tried = []
    for i, point in enumerate(points):
        interrupts.check()
        values = {name: point[name] for name in brief.names}
        try:
            there = machine.with_values(**values)
            end = _descend(there, point.get("orbit") or find(there, family), brief)
            tried.append(Start(values, end.objective * brief.sign))
        except InputError:
            raise
        except OrbitsError as error:
            end = error
            tried.append(Start(values, None, str(error)))
        ends.append(end)
        if progress:
            progress((i + 1) / len(points))
    found = [end for end in ends if isinstance(end, _End)]
    # An objective without bound is what the whole question amounts to, whatever other starts lead to.
    unbounded = [end for end in ends if isinstance(end, _Unbounded)]
    if unbounded or not found:
        raise NoOrbit(_reason([end for end in ends if isinstance(end, OrbitsError)]))
    best = min(found, key=lambda end: end.objective)
    return Design(
        machine=best.machine,
        orbit=best.orbit,
        parameters={name: best.machine.values[name] for name in brief.names},
        verb=brief.verb,
        text=brief.text,
        objective=best.objective * brief.sign,
        quantities=best.quantities,
        active=best.active,
        kkt=best.kkt,
        starts=tuple(tried),
        seconds=time.perf_counter() - began,
    )


def _starts(machine, brief: Brief, count, seed) -> list[dict]:
    """The machine's own parameters, if they lie within the bounds, and further ones spread between these."""
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
        raise InputError(f"starts = {count!r}; it is a whole number from 1")
    low, high = np.array(brief.low), np.array(brief.high)
    own = np.array([machine.values[name] for name in brief.names])
    points = [own if ((low <= own) & (own <= high)).all() else 0.5 * (low + high)]
    if count > 1:
        from scipy.stats import qmc  # it takes longer to import than most designs to solve

        drawn = qmc.Sobol(len(low), seed=seed).random(1 << (int(count) - 2).bit_length() if count > 2 else 1)
        # Bounds that span decades are spread by their logarithm.
        wide = (low > 0) & (high >= 100 * low)
        spread = low + drawn * (high - low)
        safe = np.where(low > 0, low, 1.0)
        points += list(np.where(wide, safe * (np.where(wide, high / safe, 1.0)) ** drawn, spread)[: count - 1])
    return [dict(zip(brief.names, point.tolist(), strict=True)) for point in points]


def _reason(errors: Sequence[OrbitsError]) -> str:
    """What to say when no start leads to an optimum: the worst kind first, and of constraints the least broken."""
    for kind in (_Unbounded, _Infeasible):
        if some := [error for error in errors if isinstance(error, kind)]:
            return str(min(some, key=lambda error: error.size))
    return f"no design within the bounds has an orbit to begin with: {errors[0]}"


class _Unbounded(NoOrbit):
    """The objective gets better for ever."""

    size = 0.0


class _Infeasible(NoOrbit):
    """Constraints cannot be met; `size` is by how much, scaled."""

    def __init__(self, message: str, size: float):
        super().__init__(message)
        self.size = size


@dataclass(frozen=True, eq=False)
class _End:
    """Where a start led to; `objective` is the least of what is minimised."""

    machine: object
    orbit: Orbit
    objective: float
    quantities: Mapping[str, float]
    active: tuple[Active, ...]
    kkt: float


class _Descent:
    """What a start is led by: the question, the demands so far, and how far the parameters may move at once."""

    def __init__(self, machine, orbit: Orbit, brief: Brief):
        self.machine, self.orbit, self.brief, self.first = machine, orbit, brief, orbit
        self.model: Model = machine.model
        self.units = units_of(machine)
        self.demands: list[str] = []
        self.reach = 1.0
        self.both: dict[str, tuple] = {}
        self.seen: list[tuple] = []
        self.span = np.subtract(brief.high, brief.low)
        self.demand()

    def demand(self):
        """Demand from now on what the orbit lacks to be a motion."""
        c = self.orbit.certificate
        for name in ("clearance", "smallest_separation", "smallest_contact_force"):
            value = getattr(c, name)
            if value is not None and value < 2 * MARGIN and name not in self.demands:
                self.demands.append(name)

    def scene(self) -> Scene:
        brief = self.brief
        objective = brief.formula
        asked = Asked((objective, *(c.formula for c in brief.constraints)), brief.names, tuple(self.demands))
        scene = scene_of(self.machine, self.orbit, asked, self.units, self.both)
        return scene

    def scales(self, values: np.ndarray) -> np.ndarray:
        """Of the objective (with its sign), the constraints, the landing jerk and the demands, at values of them."""
        m = len(self.brief.constraints)
        if not np.isfinite(values).all():
            raise NoOrbit(f"'{self.brief.text}' or a constraint has no value at {_said(self.machine, self.brief)}")
        bounds = [max([abs(b) for b in (c.low, c.high) if np.isfinite(b)]) for c in self.brief.constraints]
        sizes = [b or abs(v) or 1.0 for b, v in zip(bounds, values[1 : 1 + m], strict=True)]
        return np.array([
            self.brief.sign * (abs(values[0]) or 1.0), *sizes, abs(values[1 + m]), *np.ones(len(values) - m - 2)
        ])  # fmt: skip

    def solve(self, scene: Scene, elastic: bool) -> tuple[Optimum, np.ndarray]:
        values, _ = scene.evaluated()
        scales = self.scales(values)
        sizes = scales[1 : 1 + len(self.brief.constraints)]
        limits = [np.array([getattr(c, side) for c in self.brief.constraints]) / sizes for side in ("low", "high")]
        return scene.minimise((self.brief.low, self.brief.high), self.reach, limits, scales, elastic), scales

    def move(self, scene: Scene, x: np.ndarray) -> bool:
        """Go to the orbit that a program led to; whether that is where it said."""
        k = len(self.brief.names)
        theta = np.clip(x[:k], self.brief.low, self.brief.high)
        near = np.minimum(theta - self.brief.low, np.array(self.brief.high) - theta) < 1e-9 * self.span
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
        return off < AGREE + 1e-12 * k

    def escaped(self):
        """Raises `_Unbounded` when the orbit is on its way to infinity or to nothing."""
        now, first = self.orbit, self.first
        for name in ("alpha", "contact_time"):
            ratio = getattr(now, name) / getattr(first, name)
            if not 1 / ESCAPED < ratio < ESCAPED:
                how = "escapes" if ratio > 1 else "shrinks to nothing"
                raise _Unbounded(
                    f"the objective has no {'least' if self.brief.sign > 0 else 'largest'} value: '{self.brief.text}' "
                    f"gets better as the orbit {how}, {name} = {getattr(now, name):.4g} at "
                    f"{_said(self.machine, self.brief)} and still going; bound it, as subject_to=['{name} "
                    f"{'<=' if ratio > 1 else '>='} ...']"
                )

    def places(self, scene: Scene) -> bool:
        """Whether the extremes are where the program has them; where two take turns, they are tied from now on."""
        fresh = self.scene()
        if fresh.places == scene.places and fresh.demands == scene.demands:
            return True
        if fresh.places in self.seen and fresh.demands == scene.demands:
            at = dict(zip(scene.places, _times(scene), strict=True))
            for place, when in at.items():
                if place not in fresh.places:
                    self.both[place.extreme] = ((place, when),)
        self.seen.append(scene.places)
        return False


def _times(scene: Scene) -> list[float]:
    """The times of the places of a scene, 0 for those that are not inside."""
    names = design_names(scene)
    return [float(scene.u[names.index(f"at {i}")]) if f"at {i}" in names else 0.0 for i in range(len(scene.places))]


def design_names(scene: Scene) -> tuple[str, ...]:
    return scene.graph.unknowns


def _descend(machine, orbit: Orbit, brief: Brief) -> _End:
    """The local optimum that an orbit leads to; raises `NoOrbit` when it leads to none."""
    way = _Descent(machine, orbit, brief)
    elastic, reason = False, ""
    for _ in range(MOST_ROUNDS):
        interrupts.check()
        scene = way.scene()
        answer, scales = way.solve(scene, elastic)
        if answer.reason and not elastic:
            answer, scales = way.solve(scene, True)
            elastic = True
        before, moved = way.machine, 0.0
        try:
            exact = way.move(scene, answer.x)
            moved = _moved(before, way.machine, brief)
        except NoOrbit as error:
            reason, way.reach = str(error), way.reach / 4
            if way.reach < LEAST_REACH:
                raise _lost(way, reason) from None
            continue
        way.escaped()
        way.demand()
        settled = exact and not _at_reach(scene, answer, way.reach, brief) and way.places(scene)
        if elastic:
            lacking = _lacking(way, scales)
            if lacking.sum() <= MET:
                elastic = False
            elif settled and way.orbit.admissible and moved <= 1e-6:
                raise _infeasible(way, lacking)
            continue
        if settled and way.orbit.admissible and not answer.reason:
            return _ended(way, scales)
        way.reach = min(1.0, 2 * way.reach)
    raise NoOrbit(f"no optimum within {MOST_ROUNDS} programs, at {_said(way.machine, brief)}" + (reason and f": {reason}"))


def _moved(before, after, brief: Brief) -> float:
    span = np.subtract(brief.high, brief.low)
    return float(max(abs(after.values[n] - before.values[n]) / s for n, s in zip(brief.names, span, strict=True)))


def _at_reach(scene: Scene, answer: Optimum, reach: float, brief: Brief) -> bool:
    """Whether the program was stopped by how far its mesh serves."""
    k, n = len(brief.names), scene.graph.size
    span = np.subtract(brief.high, brief.low)
    moved = np.abs(answer.x[:k] - scene.theta) / span
    ratio = np.abs(np.log(answer.x[k + 1 : k + n] / scene.u[1:]))
    return bool((reach < 1 and (moved > 0.999 * reach).any()) or (ratio > 0.999 * np.log1p(min(reach, 1.0))).any())


def _lost(way: _Descent, reason: str) -> NoOrbit:
    """Nowhere to go on to: the family ends, or a phase collapses, just beyond."""
    where = _said(way.machine, way.brief)
    if reason == way.model.violations["end"]:
        return _Unbounded(f"the design runs into a collapse just beyond {where}: {reason}")
    return NoOrbit(f"the design cannot be carried on from {where}: {reason}")


def _lacking(way: _Descent, scales) -> np.ndarray:
    """What each constraint is broken by, as a share of its size."""
    values = way.scene().evaluated()[0][1 : 1 + len(way.brief.constraints)]
    broken = [c.excess(float(v)) for c, v in zip(way.brief.constraints, values, strict=True)]
    return np.array(broken) / scales[1 : 1 + len(broken)]


def _infeasible(way: _Descent, lacking: np.ndarray) -> _Infeasible:
    values = way.scene().evaluated()[0][1:]
    what = [
        f"'{c.text}' is missed by {c.excess(float(v)):.4g}, at {float(v):.6g}"
        for c, v, lack in zip(way.brief.constraints, values, lacking, strict=False)
        if lack > MET
    ]
    bounds = ", ".join(f"{low:g} <= {n} <= {high:g}" for n, low, high in
                       zip(way.brief.names, way.brief.low, way.brief.high, strict=True))  # fmt: skip
    return _Infeasible(
        f"no motion with {bounds} meets the constraints: at best {' and '.join(what)}, with "
        f"{_said(way.machine, way.brief)}; relax it, or widen the bounds",
        float(lacking.sum()),
    )


def _said(machine, brief: Brief) -> str:
    return ", ".join(f"{name} = {machine.values[name]:.6g}" for name in brief.names)


def certified(machine, u) -> tuple[Orbit, np.ndarray]:
    """The certified orbit of a machine near unknowns `u` of its simplest statement, and the unknowns."""
    began, model, p = time.perf_counter(), machine.model, dict(machine.values)
    method = "relative" if model.reduction else "half orbit"
    equations = equations_of(model, method, tuple(p))
    u, here = equations.newton(u, vector(p))
    return as_orbit(machine, method, interpret(model, method, equations, u, here, p), began), u


def _ended(way: _Descent, scales) -> _End:
    """The optimum with its conditions, all recomputed at the certified orbit."""
    brief, scene = way.brief, way.scene()
    values, slopes = scene.evaluated()
    m, k = len(brief.constraints), len(brief.names)
    theta = scene.theta
    slope = brief.sign * slopes[0] * way.span / abs(scales[0])
    rows, names, free, units = [], [], [], []
    for i, (name, span) in enumerate(zip(brief.names, way.span, strict=True)):
        for side, bound, relation in ((-1.0, brief.low[i], ">="), (1.0, brief.high[i], "<=")):
            if abs(theta[i] - bound) <= ACTIVE * span:
                rows.append(side * np.eye(k)[i])
                names.append(f"{name} {relation} {bound:g}")
                free.append(False)
                units.append(span)
    violation = 0.0
    stated = [(c.text, c.low, c.high) for c in brief.constraints]
    stated += [(f"{name} > 0", 0.0, np.inf) for name in ("-landing_jerk", *scene.demands)]
    for (text, low, high), value, row, scale in zip(stated, values[1:], slopes[1:], scales[1:], strict=True):
        violation = max(violation, max(low - value, value - high, 0.0) / scale)
        sides = [(s, b) for s, b in ((-1.0, low), (1.0, high)) if abs(value - b) <= ACTIVE * scale]
        for side, _ in sides[:1]:
            rows.append(side * row * way.span / scale)
            names.append(text)
            free.append(low == high)
            units.append(scale)
    multipliers, left = _multipliers(slope, rows, free)
    return _End(
        way.machine,
        way.orbit,
        float(brief.sign * values[0]),
        _asked_quantities(way.machine, way.orbit, brief),
        tuple(Active(n, float(x * abs(scales[0]) / u)) for n, x, u in zip(names, multipliers, units, strict=True) if x),
        max(float(np.abs(left).max()), violation),
    )


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


def _asked_quantities(machine, orbit: Orbit, brief: Brief) -> dict[str, float]:
    """The values of all quantities that the question names."""
    p, model = machine.values, machine.model
    used = brief.formula.names.union(*(c.formula.names for c in brief.constraints)) - p.keys()
    names = [name for name in quantity_names(model, p) if name in used]
    return values_of(machine, orbit, names)


def values_of(machine, orbit: Orbit, names: Sequence[str]) -> dict[str, float]:
    """The values of formulas of an orbit's quantities."""
    words = words_of(machine)
    asked = Asked(tuple(formula_of(name, words, "the quantity") for name in names), ())
    if not names:
        return {}
    return dict(zip(names, scene_of(machine, orbit, asked, units_of(machine)).evaluated()[0].tolist(), strict=False))
