"""The best design of a machine as a result, and its optimality: active constraints, their multipliers, and demands.

The conditions of optimality are those of Karush, Kuhn and Tucker in the parameters alone; the orbit is a function of
these by the implicit function theorem.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict

import numpy as np

from ..errors import InputError
from ..io import Document, conform
from ..model import Machine
from ..periodic import FRICTION_LEFT, Orbit, find
from ..result import Axes, Progress, Result, Row, is_of
from .design_point import DEMAND_MARGIN, DesignPoint
from .design_problem import DesignProblem
from .tuned_machine import TunedMachine, tuned_machine_of, tuned_numbers, untuned

if TYPE_CHECKING:
    from .design_curve import DesignCurve

ACTIVE = 1e-7  # a bound or a constraint is active within this share of its size; solutions are more exact than that
AT_TWO_PLACES = "an extreme at two places"


@dataclass(frozen=True)
class Active:
    """A constraint, bound or condition of a motion that is active at the optimum.

    text : the constraint, bound or condition
    multiplier : improvement of the objective per unit by which the constraint is relaxed, to first order; for an
        equality constraint, per unit by which its value is raised; None in files of searches without derivatives
    """

    text: str
    multiplier: float | None


class ActiveRow(NamedTuple):
    """An active constraint: its gradient (k,), pointing outwards, in scaled units; the size of its scaled unit; and
    whether it is an equation, so that its multiplier may be negative."""

    text: str
    gradient: np.ndarray
    unit: float
    equation: bool


def constraint_sizes(problem: DesignProblem, point: DesignPoint) -> np.ndarray:
    """The unit of each constraint: the largest of its bounds and of the terms that it compares; where that is zero, its
    value, or its change by the parameters. The units stay fixed: with shrinking units it would never count as met."""
    known, theta, sizes = point.machine.values | point.quantities, point.theta, []
    ranges = np.where(theta, np.abs(theta), np.subtract(problem.high, problem.low))
    for constraint, value, slope in zip(problem.constraints, point.values[1:], point.slopes[1:], strict=False):
        terms = constraint.formula.terms
        magnitudes = [abs(bound) for bound in (constraint.low, constraint.high) if np.isfinite(bound)]
        if len(terms) > 1:
            magnitudes += [abs(float(term(**{name: known[name] for name in term.names}))) for term in terms]
        sizes.append(max(magnitudes) or max(abs(value), (np.abs(slope) * ranges).max()) or 1.0)
    return np.array(sizes)


def demands_of(machine: Machine, orbit: Orbit, known: Sequence[str]) -> tuple[str, ...]:
    """The known demands, and the quantities of an orbit that are too small, or nearly so, for a motion."""
    model, names = machine.model, ["clearance", "smallest_separation", "smallest_contact_force"]
    names += ["smallest_stance_force"] if model.violations.get("stance") else []
    margins = {name: getattr(orbit.certificate, name) for name in names}
    if (needed := orbit.certificate.friction_needed) is not None and model.planar and model.planar.friction:
        margins[FRICTION_LEFT] = model.planar.friction(machine.values) - needed
    small = [name for name, margin in margins.items() if margin is not None and margin < 2 * DEMAND_MARGIN]
    return (*known, *(name for name in small if name not in known))


def active_bounds(problem: DesignProblem, theta: np.ndarray) -> list[ActiveRow]:
    """The active bounds of the parameters."""
    rows, directions = [], np.eye(len(theta))
    for i, (name, unit) in enumerate(zip(problem.names, problem.units(theta), strict=True)):
        for side, bound, relation in ((-1.0, problem.low[i], ">="), (1.0, problem.high[i], "<=")):
            if abs(theta[i] - bound) <= ACTIVE * unit:
                rows.append(ActiveRow(f"{name} {relation} {bound:g}", side * directions[i], unit, False))
    return rows


def active_constraints(problem: DesignProblem, point: DesignPoint, scales: np.ndarray) -> tuple[list[ActiveRow], float]:
    """The active constraints and demands, and the largest violation, scaled."""
    rows, violation, units = list[ActiveRow](), 0.0, problem.units(point.theta)
    stated = [(c.text, c.low, c.high) for c in problem.constraints]
    stated += [(f"{name} > 0", 0.0, np.inf) for name in ("-landing_jerk", *point.demands)]
    sizes = [*(1.0 for _ in problem.constraints), *point.sizes]
    results = zip(stated, point.values[1:], point.slopes[1:], scales[1:], sizes, strict=False)
    for (text, low, high), value, slope, scale, size in results:
        violation = max(violation, max(low - value, value - high, 0.0) / scale)
        for side, bound in ((-1.0, low), (1.0, high)):
            if abs(value - bound) <= ACTIVE * scale:
                rows.append(ActiveRow(text, side * slope * units / scale, scale * size, low == high))
                break
    return rows, violation


def multipliers_of(slope: np.ndarray, rows: Sequence[ActiveRow]) -> tuple[np.ndarray, np.ndarray]:
    """Multipliers, not negative for inequalities, that make slope + sum(multiplier * gradient) least; and that sum."""
    # Inequalities are dropped one after another, the most negative multiplier first.
    multipliers, used = np.zeros(len(rows)), list(range(len(rows)))
    while used:
        found = np.linalg.lstsq(np.array([rows[i].gradient for i in used]).T, -slope, rcond=None)[0]
        worst = min(range(len(used)), key=lambda j: 0.0 if rows[used[j]].equation else found[j])
        if rows[used[worst]].equation or found[worst] >= 0:
            multipliers[used] = found
            break
        del used[worst]
    return multipliers, slope + sum((x * row.gradient for x, row in zip(multipliers, rows, strict=True)), 0.0 * slope)


def active_at(problem: DesignProblem, point: DesignPoint, scales: np.ndarray) -> tuple[tuple[Active, ...], float]:
    """What is active at a design, with the multipliers, and the largest violation of the optimality conditions.

    scales : of the objective, the constraints, the landing jerk, the demands and the ties
    """
    units, size = problem.units(point.theta), abs(scales[0])
    rows, violation = active_constraints(problem, point, scales)
    # Where two places have the same extreme, either one may be the larger.
    tied = point.slopes[point.tied] * units / size
    ties = [ActiveRow(AT_TWO_PLACES, row, size, True) for row in tied]
    rows = [*active_bounds(problem, point.theta), *rows, *ties]
    multipliers, rest = multipliers_of(problem.sign * point.slopes[0] * units / size, rows)
    active = tuple(Active(r.text, float(x * size / r.unit)) for r, x in zip(rows, multipliers, strict=True) if x)
    return active, max(float(np.abs(rest).max()), violation)


@dataclass(frozen=True)
class Start:
    """A start: its parameters, and the objective and the parameters of the optimum found from it, or None and the
    reason why no optimum was found."""

    parameters: Mapping[str, float]
    objective: float | None
    reason: str = ""
    optimum: Mapping[str, float] | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Design(Result, what="design"):
    """The best design found; numbers in the machine's units, in SI for a machine stated so.

    source : the machine with the best parameters
    orbit : its certified lossless orbit
    parameters : their values, and those of tuned parameters
    verb, text, objective : "minimise" or "maximise", the formula of the objective, and its value
    quantities : values of the quantities that the problem names
    active : the active constraints, bounds and conditions of a motion
    idle : parameters that affect neither the objective nor the constraints; they keep their values at the start
    kkt : largest violation of the optimality conditions: the gradient of the Lagrangian as a share of the objective
        over each parameter's range, by the implicit function theorem, and the constraints' violations; None in files
        of searches without derivatives
    starts : all starts that were tried
    seconds : wall time
    pair : both objectives, for a design on a Pareto front; None otherwise
    share : the share of the designs of a global search that led to this optimum; None for any other search
    over, subject_to : the bounds of the parameters by name, and the constraints
    tune, at : the names of the parameters that are tuned for each design, and the values of the prescribed quantities;
        empty if there are none

    The objective, the quantities and the optimality conditions are computed at the end of the search. The orbit is then
    found once more and differs by rounding.
    """

    source: Machine
    orbit: Orbit
    parameters: Mapping[str, float]
    verb: str
    text: str
    objective: float
    quantities: Mapping[str, float]
    active: tuple[Active, ...]
    idle: tuple[str, ...]
    kkt: float | None
    starts: tuple[Start, ...] = ()
    seconds: float = 0.0
    pair: tuple[float, float] | None = None
    share: float | None = None
    over: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    subject_to: tuple[str, ...] = ()
    tune: tuple[str, ...] = ()
    at: Mapping[str, float] = field(default_factory=dict)

    machine = property(lambda self: self.orbit.machine)

    def _line(self) -> dict[str, object]:
        return {**self.parameters, self.verb: self.text, "objective": self.objective, "kkt": self.kkt}

    def document(self) -> Document:
        named = [*self.parameters, *self.quantities]
        return {
            "verb": self.verb,
            "objective": {"formula": self.text, "value": self.objective},
            "parameters": dict(self.parameters),
            "quantities": dict(self.quantities),
            "active": [dict(vars(active)) for active in self.active],
            "idle": list(self.idle),
            "kkt": self.kkt,
            "starts": [{**vars(start), "parameters": dict(start.parameters)} for start in self.starts],
            "units": "SI" if self.orbit.scales else "units of the machine",
            **({"units_by_name": {name: self.unit_of(name) for name in named}} if self.orbit.scales else {}),
            "seconds": self.seconds,
            "orbit": self.orbit.document(),
        }

    def title(self) -> str:
        return f"{self.verb} {self.text}: {self.objective:.12g}" + (" (SI)" if self.units else "")

    def _rows(self) -> Iterator[Row]:
        """Parameters, quantities, active constraints, the work of the search; and then its orbit."""
        for name, value in {**self.parameters, **self.quantities, **self.parameters}.items():
            yield Row.of(name, float(value), self.unit_of(name))._replace(heading=name)
        for each in self.active:
            values = {"held by": each.text, "multiplier": each.multiplier}
            yield Row("held by", values, ("{}" if each.multiplier is None else "{}   (gains {:.4g} per unit)",))
        yield from (Row("without effect", {"without effect": name}) for name in self.idle)
        successes = sum(start.objective is not None for start in self.starts)
        words = "{:.1e}" if self.kkt is not None else "not tested: a search without derivatives"
        yield Row("optimality", {"kkt": self.kkt}, (words,))
        counts = {"successes": successes, "starts": len(self.starts), "seconds": self.seconds}
        if self.starts:
            yield Row("starts", counts, ("{} of {} led to an optimum, {:.2f} s",))
        if self.share is not None:
            yield Row("share of the sample", {"share": self.share}, ("{:.0%} of its designs with an orbit lead here",))
        failed = (start.reason for start in self.starts if start.objective is None)
        yield from (Row("a start led to none", {"a start led to none": reason}) for reason in failed)
        yield Row("its orbit", {"its orbit": self.orbit.title()})
        yield from self.orbit._rows()

    def table(self) -> dict[str, list[float]]:
        """The objective, the parameters and the quantities, each a column with one row."""
        numbers = {self.text: self.objective, **self.quantities, **self.parameters}
        return {name: [float(value)] for name, value in numbers.items()}

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot its orbit; returns the axes."""
        return self.orbit.plot(axes)

    def saved(self) -> Document:
        """The content of a file of the design, with the whole orbit, from which `of_saved` restores it."""
        problem = {"over": {name: list(bounds) for name, bounds in self.over.items()}, "subject_to": [*self.subject_to]}
        problem |= {"tune": [*self.tune], "at": dict(self.at)} if self.tune else {}
        return {**self.document(), "pair": self.pair, "share": self.share, **problem, "orbit": self.orbit.saved()}

    def follow(self, what: str, to: float, *, points: int = 20, progress: Progress = None) -> "DesignCurve":
        """Follow the best design as one number of the problem moves to another value; returns a `DesignCurve`.

        what : a constraint, as stated in `subject_to`; a bound of a designed parameter, such as "k <= 5000"; or the
            name of another parameter of the machine, or of a prescribed quantity
        to : the last value of the number
        points : number of designs, at evenly spaced values, or at evenly spaced logarithms for a parameter over
            decades; events between them add further designs
        progress : called with the completed share of the way

        Newton's method solves the optimality conditions from one value to the next. The curve consists of local optima
        and ends where they end. Raises `InputError` for a number that cannot move, and `NoOrbit` where the design is
        not a strict minimum.

        >>> from orbits import optimize
        >>> from problems import hopper_in_si
        >>> leg = hopper_in_si(60.0, 3.0, force="k*r", parameters={"k": 8000.0}, rest_length=0.8)
        >>> lowest = ["centre_of_mass_rise <= 0.04"]
        >>> best = optimize(leg, minimise="k", over={"k": (2000.0, 20000.0)}, subject_to=lowest)
        >>> curve = best.follow("centre_of_mass_rise <= 0.04", 0.05, points=3)
        >>> curve.column("k").round(2).tolist(), round(curve.slopes[0])
        ([7071.55, 6285.82, 5657.24], -176789)
        """
        curve: DesignCurve = import_module(f"{__package__}.design_curve").followed(self, what, to, points, progress)
        return curve

    @property
    def tuned(self) -> bool:
        """Whether parameters of its machine are tuned."""
        return bool(self.tune or self.at)

    @property
    def motion(self) -> tuple[Any, Orbit]:
        """The designed machine, with the names of its tuned parameters, if any; and its dimensionless orbit."""
        own = tuned_machine_of(self.source, self.tune, self.at, self.orbit) if self.tuned else self.source
        return own, self.orbit.dimensionless()

    def certified(self) -> "Design":
        """The design with its orbit found again and certified, in place of the dimensionless orbit of a search."""
        if not self.tuned:
            return replace(self, orbit=find(self.source, start=self.orbit))
        machine, _ = self.motion
        orbit = machine.certified(self.orbit)
        source = orbit.source or self.source
        tuned = {name: source.values[name] for name in self.tune}
        return replace(self, orbit=orbit, source=source, parameters={**self.parameters, **tuned})

    @classmethod
    def of_saved(cls, document: Any, machine: Machine | None = None) -> "Design":
        """The design from what `saved` returned, for a machine with any values of the designed parameters; raises
        `ValueError` where its parts contradict each other."""
        goal = conform(document["objective"], _SavedObjective, "objective")
        own = cls._fields_in({**document, "text": goal["formula"], "objective": goal["value"]})
        return cls(source=is_of(machine, own["orbit"].machine, own["parameters"]), **own)


class _SavedObjective(TypedDict):
    """The objective of a design in a file."""

    formula: str
    value: float


def optimum_at(problem: DesignProblem, point: DesignPoint, scales: np.ndarray, flat: np.ndarray) -> Design:
    """The design at a point of a search, with the optimality conditions and the dimensionless orbit there, which
    `best_design` replaces by one that is certified as by `find`.

    scales : of the objective, the constraints, the landing jerk, the demands and the ties
    flat : whether each parameter (k,) had no effect on any of them at the start
    """
    active, kkt = active_at(problem, point, scales)
    parameters = dict(zip(problem.names, point.theta.tolist(), strict=True))
    parameters |= {name: point.machine.values[name] for name in tuned_numbers(point.machine)}
    idle = _idle(problem, flat & ~point.slopes[point.scaled].any(0))
    found = float(point.values[0]), point.quantities
    stated = untuned(point.machine), point.orbit, parameters, problem.verb, problem.text
    bounds = dict(zip(problem.names, zip(problem.low, problem.high, strict=True), strict=True))
    texts = tuple(constraint.text for constraint in problem.constraints)
    design, own = Design(*stated, *found, active, idle, kkt, over=bounds, subject_to=texts), point.machine
    return replace(design, tune=own.tuned, at=own.at) if isinstance(own, TunedMachine) else design


def _idle(problem: DesignProblem, flat: np.ndarray) -> tuple[str, ...]:
    """The parameters that no formula names and that have no effect: the derivatives are zero by structure."""
    named = set[str]().union(*(formula.names for formula in problem.formulas))
    idle = tuple(name for name, still in zip(problem.names, flat, strict=True) if still and name not in named)
    if len(idle) == len(problem.names):
        raise InputError(f"'{problem.text}' and the constraints do not depend on {', '.join(idle)}: design others")
    return idle
