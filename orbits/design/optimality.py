"""The best design of a machine, and the curve of best designs along a number of its problem, as results."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypedDict

import numpy as np

from ..curves import Event
from ..curves.kkt_limits import CriticalPoint
from ..errors import InputError, OrbitsError, finite_number, whole_number
from ..io import Document, conform
from ..model.machine import Machine
from ..periodic.find import find
from ..periodic.orbit import Orbit, orbit_of
from ..result import Axes, Progress, Result, Row, is_of, shown
from ..running import interrupts
from ..running.exclusive import exclusive
from ..symbolic.formula import suggest
from .active_set import Active, active_at
from .design_point import Case, DesignPoint, design_points, no_motion
from .moving_design import MovingDesign
from .moving_number import Moving, moving_number
from .problem import DesignProblem, design_problem
from .traced_designs import program_about, traced_designs
from .tuned_machine import TunedMachine, motions_near, names_of_designs, tuned_machine_of, tuned_numbers, untuned


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
    active : active constraints, bounds and conditions of a motion
    idle : parameters on which neither objective nor constraints depend; they have the values of the start
    kkt : largest violation of the optimality conditions: the gradient of the Lagrangian as a share of the objective
        over each parameter's range, by the implicit function theorem, and the constraints' violations; None in files
        of searches without derivatives
    starts : all that were tried
    seconds : wall time
    pair : both objectives, for a design on a Pareto front; None otherwise
    share : of the designs of a global search that led to this optimum; None for any other search
    over, subject_to : the bounds of the parameters by name, and the constraints
    tune, at : the names of the parameters that are tuned for each design, and the values of the quantities that are
        prescribed; empty where none are

    The objective, the quantities and the optimality conditions are those at the end of the search. The orbit is found
    once more from there and differs by rounding.
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

    @exclusive
    def follow(self, what: str, to: float, *, points: int = 20, progress: Progress = None) -> "DesignCurve":
        """The best designs as one number of the problem moves, from its value here to another one.

        what : a constraint, as stated in `subject_to`; a bound of a designed parameter, as "k <= 5000"; or the name of
            another parameter of the machine, or of a prescribed quantity
        to : the last value of the number
        points : number of designs, at values that are evenly spaced, or by their logarithm for a parameter over
            decades; at the events between them there are further ones
        progress : called with the completed share of the way

        The curve solves the optimality conditions by Newton's method, from one value to the next. It is one of local
        optima, and ends where they do. Raises `InputError` for a number that cannot move, and `NoOrbit` where the
        design is no strict minimum that can be followed.

        >>> from orbits import optimize
        >>> from problems import hopper_in_si
        >>> leg = hopper_in_si(60.0, 3.0, force="k*r", parameters={"k": 8000.0}, rest_length=0.8)
        >>> lowest = ["centre_of_mass_rise <= 0.04"]
        >>> best = optimize(leg, minimise="k", over={"k": (2000.0, 20000.0)}, subject_to=lowest)
        >>> curve = best.follow("centre_of_mass_rise <= 0.04", 0.05, points=3)
        >>> curve.column("k").round(2).tolist(), round(curve.slopes[0])
        ([7071.55, 6285.82, 5657.24], -176789)
        """
        points, began = whole_number("points", points, "designs", 2), time.perf_counter()
        if self.kkt is None or not self.over:
            found = "a search without derivatives" if self.kkt is None else "a file that does not state its problem"
            raise InputError(f"the design is from {found}: its optimality conditions cannot be followed")
        with interrupts.deferred():
            least, most = (self.text, None) if self.verb == "minimise" else (None, self.text)
            machine, _ = self.motion
            problem = design_problem(machine, least, most, self.over, self.subject_to, names_of_designs(machine))
            moving = moving_number(problem, machine, what, finite_number("to", to))
            if moving.begin == moving.end:
                raise InputError(f"to = {moving.end:g}: '{what}' has this value already")
            curve = designs_along(self, problem, moving, np.linspace(0.0, 1.0, points).tolist(), progress)
        return replace(curve, seconds=time.perf_counter() - began)

    @property
    def tuned(self) -> bool:
        """Whether numbers of its machine are tuned."""
        return bool(self.tune or self.at)

    @property
    def motion(self) -> tuple[Any, Orbit]:
        """The machine as it is designed, with its numbers that are tuned, if any; and its orbit without dimensions."""
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
        """The design from what `saved` returned, of a machine with any values of the parameters that were free; raises
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
    named = problem.formula.names.union(*(constraint.formula.names for constraint in problem.constraints))
    idle = tuple(name for name, still in zip(problem.names, flat, strict=True) if still and name not in named)
    if len(idle) == len(problem.names):
        raise InputError(f"'{problem.text}' and the constraints do not depend on {', '.join(idle)}: nothing to design")
    return idle


class EventRow(TypedDict):
    """What an event of designs has in a document, among others."""

    value: float
    kind: str


class SeveralDesigns(Result, what="designs", dimension="design"):
    """What curves and fronts of designs have in common.

    designs : certified, in order
    events : of the curves between them
    """

    designs: tuple[Design, ...]
    events: tuple[Event, ...]

    machine = property(lambda self: self.designs[0].machine)  # the others differ in numbers that move

    def column(self, name: str) -> np.ndarray:
        """The values (m,) of a designed parameter, or of a quantity of the problem; raises `InputError` for others."""
        first = self.designs[0]
        own = "parameters" if name in first.parameters else "quantities"
        if name not in (known := getattr(first, own)):
            raise InputError(f"the designs have no '{name}'{suggest(name, [*first.parameters, *known])}")
        return np.array([getattr(design, own)[name] for design in self.designs])

    def document(self) -> Document:
        return self._documented([design.document() for design in self.designs])

    def saved(self) -> Document:
        return self._documented([design.saved() for design in self.designs])

    def _documented(self, designs: list[Document]) -> Document:
        """The whole of documents of its designs."""
        raise NotImplementedError

    def _rows_of_events(self) -> list[dict[str, Any]]:
        """The events in its document."""
        return [{"value": each.value, "kind": each.kind, "text": each.text} for each in self.events]

    @classmethod
    def _fields_in(cls, data: Mapping[str, Any], machine: Machine | None = None) -> dict[str, Any]:
        events = conform(data.get("events", []), list[EventRow], "events")
        return super()._fields_in({**data, "events": events}, machine)


@dataclass(frozen=True, eq=False, repr=False)
class DesignCurve(SeveralDesigns, what="curve of designs"):
    """The best designs as one number of their problem moves, as `Design.follow` returns it.

    parameter : what moves: "stroke <=" for the bound of a constraint, "k <=" for that of a parameter, or a parameter
    values : of the number, (m,)
    designs : certified, (m,)
    slopes : the derivative of the objective by the number, (m,), from the multipliers: what one unit more of it gains
        or costs
    events : in order along the curve, each with the `value` of the number and its `text`: a constraint, bound or
        condition of a motion "enters" or "leaves" the active ones; or there is a "fold" or a "bifurcation"
    end : why the curve ends before the last value; "" where it does not
    seconds : wall time
    """

    parameter: str
    values: tuple[float, ...]
    designs: tuple[Design, ...]
    slopes: tuple[float, ...]
    events: tuple[Event, ...] = ()
    end: str = ""
    seconds: float = 0.0

    @property
    def objectives(self) -> np.ndarray:
        """The values (m,) of the objective."""
        return np.array([design.objective for design in self.designs])

    def multipliers(self) -> dict[str, np.ndarray]:
        """The multipliers (m,) of all constraints, bounds and conditions that are active somewhere, 0 where they are
        not, by their texts; that of the number that moves is in `slopes`."""
        rows = [{each.text: each.multiplier or 0.0 for each in design.active} for design in self.designs]
        texts = {text for row in rows for text in row if not text.startswith(f"{self.parameter} ")}
        return {text: np.array([row.get(text, 0.0) for row in rows]) for text in sorted(texts)}

    @property
    def units(self) -> Mapping[str, str]:
        first = self.designs[0]
        name = self.parameter.rsplit(" ", 1)[0]
        return {**first.units, first.text: first.unit_of(first.text), self.parameter: first.unit_of(name)}

    def _line(self) -> dict[str, object]:
        return {"parameter": self.parameter, "designs": len(self.designs), "events": len(self.events)}

    def title(self) -> str:
        first, last = self.values[0], self.values[-1]
        verb, text = self.designs[0].verb, self.designs[0].text
        return f"{verb} {text} as {self.parameter} goes from {first:.6g} to {last:.6g}: {len(self.designs)} designs"

    def table(self) -> dict[str, list[float]]:
        """The number that moves, the objective, its slope, the parameters and quantities, and the multipliers."""
        first = self.designs[0]
        columns: dict[str, Any] = {self.parameter: self.values, first.text: self.objectives}
        columns[f"slope of {first.text}"] = self.slopes
        columns |= {name: self.column(name) for name in (*first.parameters, *first.quantities) if name not in columns}
        columns |= {f"multiplier of {text}": numbers for text, numbers in self.multipliers().items()}
        return {name: np.asarray(column, dtype=float).tolist() for name, column in columns.items()}

    def _notes(self) -> list[str]:
        happened = [f"at {each.value:.9g}: {f'{each.text} ' if each.text else ''}{each.kind}" for each in self.events]
        return [*happened, *([f"ends: {self.end}"] if self.end else []), f"found in {self.seconds:.2f} s"]

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the objective against the number that moves, with the events; returns the axes."""
        return shown("plot").plot_design_curve(self, axes)

    def _documented(self, designs: list[Document]) -> Document:
        rows = zip(self.values, self.slopes, designs, strict=True)
        return {
            "parameter": self.parameter,
            "designs": [{"value": value, "slope": slope, **design} for value, slope, design in rows],
            "events": self._rows_of_events(),
            "end": self.end,
            "seconds": self.seconds,
        }

    @classmethod
    def of_saved(cls, document: Any, machine: Machine | None = None) -> "DesignCurve":
        """The curve from what `saved` returned, of a machine with any values of the parameters that were free; raises
        `ValueError` where its parts contradict each other."""
        rows, name = document["designs"], document["parameter"]
        if not rows:
            raise ValueError("it has no designs")
        own = cls._fields_in({key: document[key] for key in ("parameter", "events", "end", "seconds")})
        values, slopes = (conform([row[key] for row in rows], tuple[float, ...], key) for key in ("value", "slope"))
        moves = machine is not None and name in machine.values
        machines = [machine.with_values(**{name: value}) if machine and moves else machine for value in values]
        return cls(designs=tuple(map(Design.of_saved, rows, machines)), values=values, slopes=slopes, **own)


def designs_along(
    design: Design, problem: DesignProblem, moving: Moving, shares: Sequence[float], progress: Progress = None
) -> DesignCurve:
    """The best designs from one on, which is the best in a problem: at shares of the way of the number that moves, in
    ascending order, and at the events between them."""
    program = program_about(*design.motion, problem, moving, [each.text for each in design.active], design.idle)
    points, events, last = traced_designs(program, shares, progress)
    designs, end = _certified_at(points), last.reason
    for i, design in enumerate(designs):
        if not design.orbit.admissible:
            points, designs, end = points[:i], designs[:i], str(no_motion(design.source, design.orbit.dimensionless()))
            break
    values = tuple(program.value(point.value) for _, point in points)
    scale = program.problem.sign * program.size
    slopes = tuple(scale * point.slope / program.rate(point.value) for _, point in points)
    return DesignCurve(program.moving.label, values, tuple(designs), slopes, tuple(events), end)


def _certified_at(points: Sequence[tuple[MovingDesign, CriticalPoint]]) -> list[Design]:
    """The designs at points of curves, with their orbits found again and certified."""
    cases, us = list[Case](), list[np.ndarray]()
    for program, point in points:
        near = program.nearest(point.x, point.value).design
        machine = program.machine_at(point.x, point.value)
        outputs = replace(program.outputs, over=program.problem.names)
        case = program.corners.case((machine, near.orbit), program.corners_near(point))
        cases.append(case._replace(outputs=outputs))
        us.append(program.predicted(machine, near))
    found = motions_near([case.machine for case in cases], us, [program.family for program, _ in points])
    motions = [
        motion or (case.machine, find(case.machine, start=case.orbit).dimensionless())
        for case, motion in zip(cases, found, strict=True)
    ]
    evaluated = design_points(
        [case._replace(machine=own, orbit=orbit) for case, (own, orbit) in zip(cases, motions, strict=True)]
    )
    designs = list[Design]()
    for (program, point), each in zip(points, evaluated, strict=True):
        if isinstance(each, OrbitsError):
            raise each
        best = optimum_at(program.problem_at(point.value), each, program.scales(each), program.flat)
        tuned = isinstance(each.machine, TunedMachine)
        designs.append(best.certified() if tuned else replace(best, orbit=orbit_of(best.source, best.orbit)))
    return designs
