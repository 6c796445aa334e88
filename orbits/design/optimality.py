"""A design and its optimality conditions: the active constraints, their multipliers, and the residual.

The conditions are those of Karush, Kuhn and Tucker in the parameters alone; the orbit is a function of these by the
implicit function theorem.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, NamedTuple, TypeAlias, TypedDict

import numpy as np

from ..errors import InputError, NoOrbit, OrbitsError, finite_number, whole_number
from ..io import Document, conform
from ..model.machine import Machine
from ..numerics.kkt_curve import (
    ENDS_OF_MINIMA,
    CurveEnd,
    CurveEvent,
    CurveOptions,
    MinimumCurve,
)
from ..numerics.kkt_limits import CriticalPoint
from ..periodic.find import find
from ..periodic.orbit import Orbit, orbit_of
from ..result import Axes, Report, Result, Row, is_of, shown
from ..running import interrupts
from ..running.exclusive import exclusive
from ..symbolic.formula import suggest
from .active_set import ActiveRow, active_bounds, active_constraints, constraint_sizes, demands_of, multipliers_of
from .design_point import Case, DesignPoint, design_points, no_motion
from .moving_design import AT_TWO_PLACES, SAME_EXTREME, Moving, MovingDesign, moving_number
from .problem import DesignProblem, Outputs, design_problem
from .tuned_machine import TunedMachine, motions_near, names_of_designs, tuned_machine_of, tuned_numbers, untuned

# Steps of a curve are long, since each evaluation of a design is costly and its predictions are good.
# A curve ends where its multipliers have grown by this factor, and become infinite within this share of the way.
GROWN, NEAR_POLE = 10.0, 1e-3
OF_DESIGNS = CurveOptions(first_step=0.1, longest_step=1.0, exact=True)


@dataclass(frozen=True)
class Active:
    """A constraint, bound or condition of a motion that is active at the optimum.

    text : the constraint, bound or condition
    multiplier : improvement of the objective per unit by which the constraint is relaxed, to first order; for an
        equality constraint, per unit by which its value is raised; None in files of searches without derivatives
    """

    text: str
    multiplier: float | None


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
    def follow(self, what: str, to: float, *, points: int = 20, progress: Report = None) -> "DesignCurve":
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
            machine = tuned_machine_of(self.source, self.tune, self.at, self.orbit) if self.tuned else self.source
            problem = design_problem(machine, least, most, self.over, self.subject_to, names_of_designs(machine))
            moving = moving_number(problem, machine, what, finite_number("to", to))
            if moving.begin == moving.end:
                raise InputError(f"to = {moving.end:g}: '{what}' has this value already")
            program = moving_design(self, machine, problem, moving)
            curve = designs_along(program, np.linspace(0.0, 1.0, points).tolist(), progress)
        return replace(curve, seconds=time.perf_counter() - began)

    @property
    def tuned(self) -> bool:
        """Whether numbers of its machine are tuned."""
        return bool(self.tune or self.at)

    def certified(self) -> "Design":
        """The design with its orbit found again and certified, in place of the dimensionless orbit of a search."""
        if not self.tuned:
            return replace(self, orbit=find(self.source, start=self.orbit))
        orbit = tuned_machine_of(self.source, self.tune, self.at, self.orbit).certified(self.orbit)
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
    units, size = problem.units(point.theta), abs(scales[0])
    rows, violation = active_constraints(problem, point, scales)
    # Where two places have the same extreme, either one may be the larger.
    tied = point.slopes[point.tied] * units / size
    ties = [ActiveRow(AT_TWO_PLACES, row, size, True) for row in tied]
    rows = [*active_bounds(problem, point.theta), *rows, *ties]
    multipliers, rest = multipliers_of(problem.sign * point.slopes[0] * units / size, rows)
    parameters = dict(zip(problem.names, point.theta.tolist(), strict=True))
    parameters |= {name: point.machine.values[name] for name in tuned_numbers(point.machine)}
    active = tuple(Active(r.text, float(x * size / r.unit)) for r, x in zip(rows, multipliers, strict=True) if x)
    idle = _idle(problem, flat & ~point.slopes[point.scaled].any(0))
    found, kkt = (float(point.values[0]), point.quantities), max(float(np.abs(rest).max()), violation)
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


@dataclass(frozen=True)
class DesignEvent:
    """What happens on a curve of designs: a constraint, bound or condition of a motion "enters" or "leaves" the active
    ones at a value of the number that moves; or the curve has a "fold" or a "bifurcation"."""

    value: float
    kind: str
    text: str = ""


def column_of(designs: Sequence[Design], name: str) -> np.ndarray:
    """The values (m,) of a designed parameter, or a quantity of the problem; raises `InputError` for another name."""
    own = "parameters" if name in designs[0].parameters else "quantities"
    if name not in (known := getattr(designs[0], own)):
        raise InputError(f"the designs have no '{name}'{suggest(name, [*designs[0].parameters, *known])}")
    return np.array([getattr(design, own)[name] for design in designs])


@dataclass(frozen=True, eq=False, repr=False)
class DesignCurve(Result, what="curve of designs", dimension="design"):
    """The best designs as one number of their problem moves, as `Design.follow` returns it.

    parameter : what moves: "stroke <=" for the bound of a constraint, "k <=" for that of a parameter, or a parameter
    values : of the number, (m,)
    designs : certified, (m,)
    slopes : the derivative of the objective by the number, (m,), from the multipliers: what one unit more of it gains
        or costs
    events : in order along the curve
    end : why the curve ends before the last value; "" where it does not
    seconds : wall time
    """

    parameter: str
    values: tuple[float, ...]
    designs: tuple[Design, ...]
    slopes: tuple[float, ...]
    events: tuple[DesignEvent, ...] = ()
    end: str = ""
    seconds: float = 0.0

    machine = property(lambda self: self.designs[0].machine)  # the others differ in numbers that move

    @property
    def objectives(self) -> np.ndarray:
        """The values (m,) of the objective."""
        return np.array([design.objective for design in self.designs])

    def column(self, name: str) -> np.ndarray:
        """The values (m,) of a designed parameter, or of a quantity of the problem."""
        return column_of(self.designs, name)

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

    def document(self) -> Document:
        return self._documented([design.document() for design in self.designs])

    def saved(self) -> Document:
        return self._documented([design.saved() for design in self.designs])

    def _documented(self, designs: list[Document]) -> Document:
        rows = zip(self.values, self.slopes, designs, strict=True)
        return {
            "parameter": self.parameter,
            "designs": [{"value": value, "slope": slope, **design} for value, slope, design in rows],
            "events": [dict(vars(event)) for event in self.events],
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


def moving_design(design: Design, machine: Machine, problem: DesignProblem, moving: Moving) -> MovingDesign:
    """The program of a problem, a number of which moves, about its optimum, of this machine."""
    orbit = design.orbit.dimensionless()
    formulas = problem.formula, *(constraint.formula for constraint in problem.constraints)
    known = [text.removesuffix(" > 0") for text in (each.text for each in design.active) if text.endswith(" > 0")]
    demands = demands_of(machine, orbit, [name for name in known if name != "-landing_jerk"])
    (point,) = design_points([Case(machine, orbit, Outputs(formulas, problem.names, demands), {})])
    if isinstance(point, OrbitsError):
        raise point
    flat = np.isin(problem.names, design.idle)
    program = MovingDesign(problem, moving, point, flat, constraint_sizes(problem, point), demands)
    for _ in range([each.text for each in design.active].count(AT_TWO_PLACES)):
        (near,) = program.known
        if corner := program.corner_beside(near, share=SAME_EXTREME):
            program = program.with_more(near, corners=(*program.corners, corner))
    return program


ONE_POINT = 1e-12  # points whose shares of the way differ by no more are one
ROUNDS_TOGETHER = 4  # rounds in which designs are evaluated together
# Programs that one curve may lead through, with other demands and corners. A corner is left where the values at its two
# places differ by this share, and may become active from where they differ by the next one.
MOST_PROGRAMS, LEFT_CORNER, BESIDE_CORNER = 50, 1e-3, 1e-5


class _Piece(NamedTuple):
    """A smooth piece of a curve: its program, the curve, its points, and the shares of the way in it."""

    program: MovingDesign
    curve: MinimumCurve
    points: list[CriticalPoint]

    def exact(self, shares: Sequence[float]) -> list[CriticalPoint]:
        """The points at shares within the piece: Newton's method begins at interpolated ones, and the designs that it
        needs for all of them are evaluated together."""
        values, last = [each.value for each in self.points], len(self.points) - 1
        near = list[CriticalPoint]()
        for share in shares:
            after = min(max(int(np.searchsorted(values, share)), 1), last)
            near.append(self.curve.between(self.points[max(after - 2, 0) : after + 2], share))
        wanted, found = [np.append(each.x, each.value) for each in near], dict[int, CriticalPoint]()
        for _ in range(ROUNDS_TOGETHER):
            self.program.evaluate(wanted)
            wanted = self.program.missed = []
            for i, each in enumerate(near):
                with suppress(NoOrbit):
                    found[i] = found.get(i) or self.curve.at(each.value, each)
            if not wanted:
                break
        self.program.missed = None
        return [found.get(i) or self.curve.at(each.value, each) for i, each in enumerate(near)]


def designs_along(program: MovingDesign, shares: Sequence[float], progress: Report = None) -> DesignCurve:
    """The designs at shares of the way of a program's number, in ascending order, and at the events between them.

    The curve is traced in steps of its own; the designs at the shares lie between its points.
    """
    pieces, events, ends, end = _traced(program, progress)
    points = list[tuple[MovingDesign, CriticalPoint]]()
    for piece in pieces:
        first, last = piece.points[0].value, piece.points[-1].value
        inside = [share for share in shares if first <= share <= last and not any(share == p.value for _, p in points)]
        points += [(piece.program, point) for point in piece.exact(inside)]
    known = [point.value for _, point in points]
    points += [pair for pair in ends if all(abs(pair[1].value - share) > ONE_POINT for share in known)]
    points.sort(key=lambda pair: pair[1].value)
    designs = _certified_at(points)
    for i, design in enumerate(designs):
        if not design.orbit.admissible:
            points, designs, end = points[:i], designs[:i], str(no_motion(design.source, design.orbit.dimensionless()))
            break
    values = tuple(program.value(point.value) for _, point in points)
    scale = program.problem.sign * program.size
    slopes = tuple(scale * point.slope / program.rate(point.value) for _, point in points)
    return DesignCurve(program.moving.label, values, tuple(designs), slopes, tuple(events), end)


def _traced(
    program: MovingDesign, progress: Report
) -> tuple[list[_Piece], list[DesignEvent], list[tuple[MovingDesign, CriticalPoint]], str]:
    """The smooth pieces of the curve of a program; its events; their points, and the last one where the curve ends
    early; and why it does, "" where it does not."""
    run, x, multipliers, start = _RunAlongDesigns(progress), np.zeros(len(program.free)), program.start(), 0.0
    for _ in range(MOST_PROGRAMS):
        onward = run.along(program, x, multipliers, start)
        if onward is None:
            break
        program, point, multipliers = onward
        x, start = point.x, point.value
    last = next(((piece.program, piece.points[-1]) for piece in reversed(run.pieces) if piece.points), None)
    ends = [*run.ends, last] if run.end and last else run.ends
    return [piece for piece in run.pieces if piece.points], run.events, ends, run.end


# A program from a point on, with the multipliers there.
_Onward: TypeAlias = tuple[MovingDesign, CriticalPoint, np.ndarray]


class _RunAlongDesigns:
    """A run along a curve of designs: its pieces, its events with their points, and why it ends early."""

    def __init__(self, progress: Report):
        self.progress, self.end, self._good = progress, "", (0, 0, 0, 0)
        self.pieces, self.events = list[_Piece](), list[DesignEvent]()
        self.ends = list[tuple[MovingDesign, CriticalPoint]]()

    def along(self, program: MovingDesign, x: np.ndarray, multipliers: np.ndarray, start: float) -> _Onward | None:
        """Follow a program from a point; None at the end, or the program that is to be followed from there."""
        try:
            curve = MinimumCurve(program, x, multipliers, start, 1.0, OF_DESIGNS)
        except NoOrbit:
            if not self.pieces:
                raise
            return None  # for the reason for which the program before this one was left
        self.end, touched = "", False
        self.pieces.append(_Piece(program, curve, []))
        for each in curve.run():
            interrupts.heed()
            passed = self.pieces[-1].points
            if isinstance(each, CurveEnd):
                self.end = "" if each.kind == "reached" else program.in_words(each, passed[-1])
                if not self.end:
                    return None
                last = program.nearest(passed[-1].x, passed[-1].value)
                return self._at_corner(program, partial(program.corner_beside, last))
            if isinstance(each, CurveEvent):
                self._happens(curve, each)
                continue
            onward = self._left(program, each)
            if onward or self.end:
                return onward
            passed.append(each)
            self._good = len(self.pieces), len(passed), len(self.events), len(self.ends)
            if (left := _left_to_pole(passed)) < NEAR_POLE:
                self.end = program.excluded(each.value + left)
                return None
            if self.progress:
                self.progress(each.value)
            touched |= bool(program.active_corners(each))
            rows, near = program.rows_of_corners, program.nearest(each.x, each.value)
            if touched and (near.values[1:][rows] < -LEFT_CORNER).all():
                own = len(x) + np.arange(rows.start, rows.stop)
                return program.with_more(near, corners=()), each, np.delete(each.multipliers, own)
        return None

    def _happens(self, curve: MinimumCurve, event: CurveEvent) -> None:
        """Add an event, in place of the last point, which is that of the event."""
        program, passed, point = self.pieces[-1].program, self.pieces[-1].points, event.point
        text = " and ".join(program.text(i, point) for i in event.limits)
        self.events.append(DesignEvent(program.value(point.value), event.kind, text))
        passed.pop()
        if event.kind in ENDS_OF_MINIMA:
            return
        if passed:  # the same point, with the direction of the curve before the event
            value, x, multipliers = point.value, point.x, point.multipliers
            passed.append(curve.at(value, replace(passed[-1], value=value, x=x, multipliers=multipliers)))
        self.ends.append((program, point))
        self.pieces.append(_Piece(program, curve, [point]))

    def _left(self, program: MovingDesign, point: CriticalPoint) -> _Onward | None:
        """The program that is to be followed from the last point, where this one is of another; the `end` is why."""
        near, passed = program.nearest(point.x, point.value), self.pieces[-1].points
        if not near.design.orbit.admissible:
            demands = program.outputs.demands
            further = demands_of(near.design.machine, near.design.orbit, demands)[len(demands) :]
            if further or not demands:  # at an active demand rounding decides, which the certified design shows
                self.end = str(no_motion(near.design.machine, near.design.orbit))
                last = next((piece.points[-1] for piece in reversed(self.pieces) if piece.points), None)
                if not further or last is None:
                    return None
                place = len(program.free) + program.rows_of_corners.start
                multipliers = np.insert(last.multipliers, place, np.zeros(len(further)))
                return program.with_more(program.nearest(last.x, last.value), further), last, multipliers
        onward = self._at_corner(program, lambda before: program.corner_between(before, near, point))
        if onward:
            return onward
        if beyond := program.place_beyond(near):
            where = f"{program.moving.label} {program.value(point.value):.6g}"
            self.end = f"near {where} the {beyond} comes to a third place of the motion, or leaves one of two"
            return None
        for number in program.active_corners(point):
            row = len(program.free) + program.rows_of_corners.start + number
            if program.swapped_at(point, number)[1][row] < 0:
                self.end = program.off_corner(point, number)
                if passed and passed[-1].sides[row]:
                    other, multipliers = program.swapped_at(passed[-1], number)
                    return other, passed[-1], multipliers
                passed.append(point)
                return None
        return None

    def _at_corner(self, program: MovingDesign, corner_after: Callable) -> _Onward | None:
        """The program with a further corner, from the last point before it, where there is one right after that."""
        pieces, points, events, ends = self._good
        if not pieces:
            return None
        own, row = self.pieces[pieces - 1], program.rows_of_corners.stop
        before = program.nearest(own.points[points - 1].x, own.points[points - 1].value)
        corner = corner_after(before)
        if corner is None:
            return None
        self.pieces[pieces - 1 :] = [own._replace(points=own.points[:points])]
        del self.events[events:], self.ends[ends:]
        for point in reversed(own.points[:points]):  # not so near to the corner that rounding decides where it enters
            near = program.nearest(point.x, point.value)
            other = program.with_more(near, corners=(*program.corners_at(near.design), corner))
            if other.known[0].values[1 + row] < -BESIDE_CORNER:
                break
            if len(self.pieces[-1].points) > 1:
                self.pieces[-1].points.pop()
        self._good = pieces, len(self.pieces[-1].points), events, ends
        return other, point, np.insert(point.multipliers, len(program.free) + row, 0.0)


def _left_to_pole(passed: list[CriticalPoint]) -> float:
    """The share of the way from the last point of a curve to where its multipliers become infinite, as the inverse of
    the root of the distance: there the active constraints exclude each other."""
    last, largest = passed[-1], np.abs(passed[0].multipliers).max(initial=0.0)
    i = int(np.argmax(np.abs(last.multipliers)))
    multiplier, rate = last.multipliers[i], last.rates[1][i]
    grown = abs(multiplier) > GROWN * max(largest, 1.0) and multiplier * rate > 0
    return float(0.5 * multiplier / rate) if grown else np.inf


def _certified_at(points: Sequence[tuple[MovingDesign, CriticalPoint]]) -> list[Design]:
    """The designs at points of curves, with their orbits found again and certified."""
    cases, us = list[Case](), list[np.ndarray]()
    for program, point in points:
        near = program.nearest(point.x, point.value).design
        machine = program.machine_at(point.x, point.value)
        outputs = replace(program.outputs, over=program.problem.names)
        case = program.case((machine, near.orbit), program.corners_near(point))
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
