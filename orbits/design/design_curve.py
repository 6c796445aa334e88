"""The curve of best designs along a number of their problem, as a result."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypedDict

import numpy as np

from ..curves import CriticalPoint, Event
from ..errors import InputError, OrbitsError, finite_number, whole_number
from ..io import Document, conform
from ..model import Machine
from ..periodic import find, orbit_of
from ..result import Axes, Progress, Result, shown
from ..running import exclusive, interrupts
from ..symbolic import suggest
from .design_point import Case, design_points, no_motion
from .design_problem import DesignProblem, Outputs, design_problem
from .moving_design import MovingDesign
from .moving_number import Moving, moving_number
from .optimality import Design, optimum_at
from .traced_designs import program_about, traced_designs
from .tuned_machine import TunedMachine, motions_near, names_of_designs


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
    """The best designs as one number of their problem moves, as `Design.follow` returns them.

    parameter : what moves: "stroke <=" for the bound of a constraint, "k <=" for that of a parameter, or a parameter
    values : of the number, (m,)
    designs : certified, (m,)
    slopes : the derivative of the objective by the number, (m,), from the multipliers: what one more unit gains or
        costs
    events : in order along the curve, each with the `value` of the number and its `text`: a constraint, bound or
        condition of a motion "enters" or "leaves" the active ones; or there is a "fold" or a "bifurcation"
    end : why the curve ends before the last value; "" if it reaches it
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
        """The multipliers (m,), by text, of all constraints, bounds and conditions that are active somewhere; 0 where
        they are not. The multiplier of the moving number is in `slopes`."""
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
        """The curve from what `saved` returned, for a machine with any values of the designed parameters; raises
        `ValueError` where its parts contradict each other."""
        rows, name = document["designs"], document["parameter"]
        if not rows:
            raise ValueError("it has no designs")
        own = cls._fields_in({key: document[key] for key in ("parameter", "events", "end", "seconds")})
        values, slopes = (conform([row[key] for row in rows], tuple[float, ...], key) for key in ("value", "slope"))
        moves = machine is not None and name in machine.values
        machines = [machine.with_values(**{name: value}) if machine and moves else machine for value in values]
        return cls(designs=tuple(map(Design.of_saved, rows, machines)), values=values, slopes=slopes, **own)


@exclusive
def followed(design: Design, what: str, to: float, points: int, progress: Progress) -> DesignCurve:
    """The curve of `Design.follow`, see there."""
    points, began = whole_number("points", points, "designs", 2), time.perf_counter()
    if design.kkt is None or not design.over:
        found = "a search without derivatives" if design.kkt is None else "a file that does not state its problem"
        raise InputError(f"the design comes from {found}: its optimality conditions cannot be followed")
    with interrupts.deferred():
        least, most = (design.text, None) if design.verb == "minimise" else (None, design.text)
        machine, _ = design.motion
        problem = design_problem(machine, least, most, design.over, design.subject_to, names_of_designs(machine))
        moving = moving_number(problem, machine, what, finite_number("to", to))
        if moving.begin == moving.end:
            raise InputError(f"to = {moving.end:g}: '{what}' has this value already")
        curve = designs_along(design, problem, moving, np.linspace(0.0, 1.0, points).tolist(), progress)
    return replace(curve, seconds=time.perf_counter() - began)


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
        outputs = Outputs(program.stated.formulas, program.stated.names, program.outputs.demands)
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
