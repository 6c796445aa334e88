"""Families of optimal motions: a motion of locally least cost, followed in a parameter by its optimality conditions.

The nonlinear program is that of the motion, on the same intervals. Each point satisfies the conditions of first order
to rounding and those of second order, by the signs of pivots. On the way the Taylor steps are compared with steps of
half the length, and path expressions are evaluated within the intervals. Where either is not good enough, the program
is refined as in `steer`, and followed from there. When a motion of the family is requested, the accurate flow
integrates it again, as in `steer`.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypedDict

import casadi as ca
import numpy as np

from ..continuation import bounds_of, checked_options
from ..curves import ENDS_OF_MINIMA, STEPS_OF_MINIMA, CriticalPoint, End, Event, MinimumCurve, Steps
from ..errors import InputError, NoOrbit, finite_number
from ..io import Document, conform
from ..model import Machine
from ..numerics import Array
from ..result import Axes, Result, Row, shown, stored
from ..running import exclusive, interrupts
from ..symbolic import BufferedFunction, cached
from .control import Control, WarmStart
from .parametric import ExchangePoint, ParametricTranscription
from .rollout import roll_out
from .stage import Stage
from .steer import steered_on_intervals
from .transcription import Transcription, advance, transcription

# How a curve ends where a touch becomes flat.
LOST_TOUCHES = ("fold", "bifurcation", "degenerate", "stuck")
# (parameter of the family) -> the fixed parameters of its program, and their derivatives.
FixedParameters = Callable[[float], tuple[Array, Array]]


# The names that pickled families have for the classes of their events and ends.
OptimalEvent, FamilyEnd = Event, End


class _EventRow(TypedDict):
    """An event in a document."""

    kind: str
    value: float
    cost: float
    what: str


class Refinement(NamedTuple):
    """When and how the program of a family is refined."""

    watched: tuple[float, ...] = (0.0, 0.25, 0.5, 0.75, 1.0)  # shares of an interval: path expressions are taken there
    most: int = 200  # exchanges of points of path conditions, and halvings of steps
    touches: float = 1e-6  # a path expression below this touches zero
    at_end: float = 1e-4  # share of an interval from its end within which an expression touches zero at the end
    beyond_flat: float = 1e-3  # step beyond a touch that becomes flat, as a share of the range of the parameter
    change: float = 1e-3  # on this step the cost may change by this share, and by twice what its slope predicts


REFINEMENT = Refinement()


@dataclass(frozen=True, repr=False)
class OptimalFamily(
    Result, what="family of optimal motions", document_is_whole=True, dimension="point",
    in_line=("name", "unknowns", "end.kind"),
):  # fmt: skip
    """Motions of locally least cost along a parameter; called by `at` with a value, it gives the motion there.

    name : of the parameter
    values, costs, slopes : (k,), of the parameter, the least cost, and the derivative of the least cost by it
    active : for each point the active bounds, in words
    events : in order, each with the `value` of the parameter, the least `cost` there, and its `text`: "enters" or
        "leaves", for a bound that is active from there on, or up to there; "fold" or "bifurcation", where the minimum
        is lost; or "mesh", where the program is refined
    end : "reached", "fold", "bifurcation", "infeasible", "degenerate", "stuck" or "stopped", with the reason in words
    unknowns : number of unknowns of the program
    seconds : time taken in all
    units : of the cost and the parameter, by name; empty where the numbers are not in SI
    """

    name: str
    values: np.ndarray
    costs: np.ndarray
    slopes: np.ndarray
    active: tuple[tuple[str, ...], ...]
    events: tuple[Event, ...]
    end: End
    unknowns: int
    seconds: float
    units: Mapping[str, str] = field(default_factory=dict)
    trail: "Trail | None" = field(default=None, repr=False)

    machine = property(lambda self: {})  # motions are of stages

    def __getstate__(self) -> dict[str, Any]:
        """The pickled state: all but the nonlinear programs."""
        return vars(self) | {"trail": None}

    def __len__(self) -> int:
        return len(self.values)

    def at(self, value: float) -> Control:
        """The motion at a value of the parameter, integrated again by the accurate flow.

        Raises `InputError` for a value outside the family, and for a family from a file.
        """
        if self.trail is None:
            raise InputError("a family from a file has no programs to solve: follow it again to get its motions")
        low, high = min(self.values), max(self.values)
        if not low <= finite_number(self.name, value) <= high:
            raise InputError(f"{self.name} = {value:g}; the family goes from {low:.6g} to {high:.6g}")
        return self.trail.control(float(value))

    def table(self) -> dict[str, Any]:
        """The points as columns: the parameter, "cost", "slope" (of the least cost), and "active", the bounds."""
        active = np.array(["; ".join(names) for names in self.active])
        return {self.name: self.values, "cost": self.costs, "slope": self.slopes, "active": active}

    def document(self) -> Document:
        events = [
            {"kind": each.kind, "value": each.value, "cost": each.cost, "what": each.text} for each in self.events
        ]
        own = {"events": events, "end": {"kind": self.end.kind, "reason": self.end.reason}}
        return {"format": self.form(), **stored(replace(self, trail=None, events=())), **own}

    @classmethod
    def _fields_in(cls, data: Mapping[str, Any], machine: Machine | None = None) -> dict[str, Any]:
        rows = conform(data["events"], list[_EventRow], "events")
        events = [{"text" if name == "what" else name: each for name, each in row.items()} for row in rows]
        return super()._fields_in({**data, "events": events}, machine)

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the least cost against the parameter, with the events; returns the axes."""
        return shown("control_figures").plot_optimal_family(self, axes)

    def title(self) -> str:
        return f"motions of locally least cost along {self.name}"

    def _rows(self) -> Iterator[Row]:
        cost = f" {self.units['cost']}" if self.units else ""
        places: list[tuple[Any, Any, str]] = [(self.values[0], self.costs[0], "first")]
        places += [(each.value, each.cost, f"{each.kind}: {each.text}") for each in self.events]
        last = " ".join(filter(None, (self.end.kind, self.end.reason)))
        places.append((self.values[-1], self.costs[-1], last))
        for value, least, what in places:
            yield Row(float(value), {"cost": float(least), "what": what}, (f"cost {{:<14.10g}}{cost} {{}}",))

    def _notes(self) -> list[str]:
        return [f"{len(self)} points with {self.unknowns} unknowns in {self.seconds:.2f} s"]


@dataclass(frozen=True, eq=False)
class Trail:
    """The points of a family with their programs, from which its motions are solved again."""

    points: tuple[tuple[MinimumCurve, WarmStart, CriticalPoint], ...]

    def control(self, value: float) -> Control:
        """The motion at a value of the parameter."""
        values = np.array([point.value for *_, point in self.points])
        way = np.sign(values[-1] - values[0]) or 1.0
        behind = int(np.searchsorted(way * values, way * value, side="right")) - 1
        curve, start, near = self.points[max(behind, 0)]
        point = near if value == near.value else curve.at(value, near)
        program = curve.program
        assert isinstance(program, ParametricTranscription)
        return _integrated_again(start, program, point)


@exclusive
def follow_optimum(
    control: Control, name: str, to: float, *, at: Sequence[float] = (), most: int = 1000, longest: float = 0.1,
    parameters: FixedParameters | None = None, start: float | None = None,
) -> OptimalFamily:  # fmt: skip
    """Follow a motion of locally least cost in a parameter, by the optimality conditions of its nonlinear program.

    control : a result of `steer`, of this process
    name, to : of the parameter, one of the control's that has a value, and its last value
    at : values that are among the points
    most : number of points
    longest : largest distance of two points, as a share of the parameter's range and of the unknowns' size
    parameters : value -> the fixed parameters of the control's program, and their derivatives, where several of them
        vary together; `start` is then the first value

    The family ends before its last value where its motions cease to be minima, at a fold or a bifurcation, and where
    bounds exclude each other. Raises `InputError` for invalid arguments, and `NoOrbit` where the conditions of second
    order do not hold at the first motion.
    """
    began = time.perf_counter()
    known = known_program(control)
    fixed = np.array([control.parameters[each] for each in known.problem.fixed])
    if parameters is None:
        if name not in known.problem.fixed:
            choice = ", ".join(known.problem.fixed) or "none"
            raise InputError(f"'{name}' is not a parameter with a value; choose one of {choice}")
        place = known.problem.fixed.index(name)
        parameters, start = _one_of(fixed, place), float(fixed[place])
    first, last = finite_number("start", start), finite_number("to", to)
    if first == last:
        raise InputError(f"to = {last:g}: the motion has this value of {name} already")
    checked = checked_options(at, longest=longest, most=most)
    bounds_of(name, first, last, checked.at)
    longest = checked.longest
    steps = replace(STEPS_OF_MINIMA, first=min(STEPS_OF_MINIMA.first, longest), longest=longest, most=checked.most)
    run = _RunAlongFamily(parameters, last, checked.at, steps)
    with interrupts.deferred():
        end = run.trace(known, first)
    values, costs, slopes = np.array([(p.value, p.cost, p.slope) for *_, p in run.points]).T
    active, events, trail = tuple(map(tuple, run.active)), tuple(run.events), Trail(tuple(run.points))
    seconds = time.perf_counter() - began
    return OptimalFamily(name, values, costs, slopes, active, events, end, len(known.x), seconds, trail=trail)


def known_program(control: Control) -> WarmStart:
    """The program of a motion with its solution; raises `InputError` where it has none."""
    if control.warm_start is None or control.warm_start.multipliers is None:
        raise InputError("a motion from a file or another process has no program to follow: find it again, with guess=")
    return control.warm_start


def _one_of(fixed: Array, place: int) -> FixedParameters:
    """The fixed parameters where one of them varies."""
    rates = np.zeros(len(fixed))
    rates[place] = 1.0

    def values(value: float) -> tuple[Array, Array]:
        found = fixed.copy()
        found[place] = value
        return found, rates

    return values


class _RunAlongFamily:
    """A run along a family, which collects its points, the bounds active at each, and the events."""

    def __init__(
        self, parameters: FixedParameters, last: float, at: Sequence[float], steps: Steps,
        options: Refinement = REFINEMENT,
    ):  # fmt: skip
        self.parameters, self.last, self.at, self.steps, self.options = parameters, last, at, steps, options
        self.points = list[tuple[MinimumCurve, WarmStart, CriticalPoint]]()
        self.active, self.events = list[list[str]](), list[Event]()

    def trace(self, start: WarmStart, value: float) -> End:
        """Follow to the end."""
        curve = self._curve_of(start, value)
        for _ in range(self.options.most):
            onward = self._along(curve, start)
            if isinstance(onward, End):
                return onward
            curve, start = onward
        return End("stopped", f"the program was refined {self.options.most} times: take more intervals")

    def _curve(
        self, start: WarmStart, problem: Transcription, points: Sequence[ExchangePoint], held: Array, value: float,
        totals: Sequence[float] = (),
    ) -> MinimumCurve:  # fmt: skip
        """The curve of a program with these exchange points from a solution, whose first multipliers of constraints are
        `held`, and those at the points `totals`, or 0."""
        assert start.multipliers is not None
        program = ParametricTranscription(problem, points, self.parameters, start.free)
        still, rows = np.zeros(program.moving), np.append(held, np.zeros(len(problem.labels) - len(held)))
        if totals:
            rows[program.touches] = totals
        x = np.append(start.x, [each.share for each in points if each.moving])
        multipliers = start.unit * np.concatenate([start.multipliers[0], still, rows, still])
        return MinimumCurve(program, x, multipliers, value, self.last, self.steps)

    def _curve_of(self, start: WarmStart, value: float) -> MinimumCurve:
        """The curve from a solution, with one exchange point at each place at which a path expression is least."""
        assert start.multipliers is not None
        fixed, problem, held = self.parameters(value)[0], start.problem, start.multipliers[1]
        points, totals, held = _touches(start, fixed, self.options) if problem.exchange_points else ([], [], held)
        places = tuple((each.stage, each.interval) for each in points)
        problem = transcription(problem.stages, problem.fixed, problem.free, problem.substeps, places)
        return self._curve(start, problem, points, held, value, totals)

    def _along(self, curve: MinimumCurve, start: WarmStart) -> End | tuple[MinimumCurve, WarmStart]:
        """Follow a program; the end, or where its exchange points or its steps have to change, the next curve."""
        program = curve.program
        assert isinstance(program, ParametricTranscription)
        labels, value = program.limit_labels, curve.start
        for item in curve.run([each for each in self.at if (each - value) * (self.last - value) > 0]):
            interrupts.heed()
            if isinstance(item, End):
                lost = program.moving and item.kind in LOST_TOUCHES
                return (self._past_flat_touch(program, start) if lost else None) or item
            point = item if isinstance(item, CriticalPoint) else item.point
            if isinstance(item, Event):
                is_end = item.kind in ENDS_OF_MINIMA
                own = not is_end and program.is_share(item.which)
                if not own:
                    text = "the second-order condition is lost" if is_end else labels[item.which]
                    self.events.append(Event(item.kind, value=point.value, cost=point.cost, text=text))
                self._record(curve, start, point, labels)
                if own or (item.kind == "leaves" and item.which in program.touching_limits):
                    return self._curve_of(_warm_start(start, program, point), point.value), start
                continue
            dips = self._dips(program, point, start.tolerance)
            if dips is None and not self._is_accurate(program, point, start):
                return self._refined(program, point, start)
            if dips:
                return self._with_touches(dips, start) or self._refined(program, point, start)
            self._record(curve, start, point, labels)
        return End("reached")

    def _record(self, curve: MinimumCurve, start: WarmStart, point: CriticalPoint, labels: Sequence[str]) -> None:
        """Add a point, in place of the last one where the parameter is the same."""
        if self.points and self.points[-1][2].value == point.value:
            self.points.pop()
            self.active.pop()
        self.points.append((curve, start, point))
        self.active.append([*dict.fromkeys(labels[i] for i in point.active)])

    def _dips(
        self, program: ParametricTranscription, point: CriticalPoint, tolerance: float
    ) -> list[ExchangePoint] | None:
        """The places within intervals at which a path expression is below zero, where there is no exchange point; None
        where the steps are not fine enough, by steps of half the length."""
        problem, dips = program.problem, list[ExchangePoint]()
        free = point.x[program.count - len(problem.free) : program.count]
        values = np.append(self.parameters(point.value)[0], free)
        pairs = zip(problem.stages, problem.substeps, program.problem.unpack(point.x[: program.count]), strict=True)
        for i, (stage, substeps, (duration, nodes, coefficients)) in enumerate(pairs):
            check = interval_check(stage, problem.names, substeps, self.options.watched)
            ends, paths = check(nodes[:, :-1], duration, coefficients, values, ())
            distance = np.abs(ends) / (1.0 + np.abs(nodes[:, :-1]).max(1)[:, None])
            if not distance.max() <= tolerance:
                return None
            paths = paths.reshape(len(self.options.watched), len(stage.path), stage.intervals)
            for j, interval in np.argwhere(paths.min(axis=0) < -tolerance).tolist():
                if not any((i, interval, j) == each[:3] for each in program.points):
                    share = self.options.watched[int(np.argmin(paths[:, j, interval]))]
                    dips.append(ExchangePoint(i, interval, j, share, 0.0 < share < 1.0))
        return dips

    def _past_flat_touch(
        self, program: ParametricTranscription, start: WarmStart
    ) -> tuple[MinimumCurve, WarmStart] | None:
        """The curve from a solution a little beyond the last point, where a touch may have become flat, which makes the
        conditions singular, and has moved to the ends of its interval; None where there is no solution nearby."""
        point, options = self.points[-1][2], self.options
        value = point.value + options.beyond_flat * (self.last - self.points[0][2].value)
        if (self.last - value) * (self.last - point.value) <= 0:
            return None
        warm, old = _warm_start(start, program, point), program.problem
        bare = transcription(old.stages, old.fixed, old.free, old.substeps, ())
        bound, held = warm.multipliers or (np.zeros(0), np.zeros(0))
        warm = replace(warm, problem=bare, shares=np.zeros(0), multipliers=(bound, held[: len(bare.labels)]))
        fixed = dict(zip(program.problem.fixed, self.parameters(value)[0].tolist(), strict=True))
        try:
            found = steered_on_intervals(program.problem.stages, fixed, warm.free, warm, warm.tolerance)
            change = options.change * abs(point.cost) + 2 * abs(point.slope * (value - point.value))
            near = abs(found.cost - point.cost) <= change
            known = found.warm_start
            curve = self._curve_of(known, value) if near and known is not None else None
        except NoOrbit:
            return None
        if curve is None or known is None:
            return None
        if self.events and self.events[-1].kind in LOST_TOUCHES:
            self.events.pop()
        text = "a touch has become flat, so that its points are exchanged"
        self.events.append(Event("mesh", value=value, cost=found.cost, text=text))
        return curve, known

    def _is_accurate(self, program: ParametricTranscription, point: CriticalPoint, start: WarmStart) -> bool:
        """Whether the accurate flow leads to the same states."""
        motion = roll_out(_warm_start(start, program, point), point.cost, self.parameters(point.value)[0])
        return max(motion.error, motion.violation) <= start.tolerance

    def _with_touches(self, dips: list[ExchangePoint], start: WarmStart) -> tuple[MinimumCurve, WarmStart] | None:
        """The curve from the last point with further exchange points, which do not touch there; None where path
        expressions are not least near them at that point."""
        if not self.points:
            return None
        curve, _, point = self.points[-1]
        program = curve.program
        assert isinstance(program, ParametricTranscription)
        warm = _warm_start(start, program, point)
        assert warm.multipliers is not None
        old, shares = program.problem, program.shares(point.x)
        places = (*old.exchange_points, *((each.stage, each.interval) for each in dips))
        problem = transcription(old.stages, old.fixed, old.free, old.substeps, places)
        points = [each._replace(share=float(share)) for each, share in zip(program.points, shares, strict=True)]
        try:
            return self._curve(warm, problem, [*points, *dips], warm.multipliers[1], point.value), start
        except NoOrbit:
            return None

    def _refined(
        self, program: ParametricTranscription, point: CriticalPoint, start: WarmStart
    ) -> tuple[MinimumCurve, WarmStart]:
        """The curve from a point with the program refined as `steer` does it."""
        warm, before = _warm_start(start, program, point), program.problem
        fixed = dict(zip(before.fixed, self.parameters(point.value)[0].tolist(), strict=True))
        found = steered_on_intervals(before.stages, fixed, warm.free, warm, warm.tolerance).warm_start
        assert found is not None
        if found.problem is before:
            raise NoOrbit(
                f"the program cannot be refined at {point.value:g}: take more intervals or a larger tolerance"
            )
        text = "points of path conditions are exchanged"
        if found.problem.substeps != before.substeps:
            text = f"the intervals of the stages have {', '.join(map(str, found.problem.substeps))} steps"
        self.events.append(Event("mesh", value=point.value, cost=point.cost, text=text))
        return self._curve_of(found, point.value), found


def _touches(start: WarmStart, fixed: Array, options: Refinement) -> tuple[list[ExchangePoint], list[float], Array]:
    """One exchange point for each path expression of an interval that touches zero within it, with its multiplier; and
    the multipliers of the other constraints, with those of touches at the ends of intervals."""
    assert start.multipliers is not None
    problem, motion = start.problem, roll_out(start, 0.0, fixed)
    held = start.multipliers[1].copy()
    counts = [len(problem.stages[i].path) for i, _ in problem.exchange_points]
    first = len(held) - sum(counts)
    sums: dict[tuple[int, int, int], float] = {}
    row = first
    for (i, interval), count in zip(problem.exchange_points, counts, strict=True):
        for j in range(count):
            sums[i, interval, j] = sums.get((i, interval, j), 0.0) + held[row]
            row += 1
    points, totals = list[ExchangePoint](), list[float]()
    for (i, interval, j), total in sums.items():
        stage = problem.stages[i]
        values, shares = motion.stages[i].minima[[*stage.path][j]]
        share = float(shares[interval])
        if values[interval] > options.touches:
            continue
        path, length = motion.stages[i].path, motion.stages[i].unknowns.duration / stage.intervals
        ends = path(length * np.array([interval, interval + 1.0]))[:, path.names.index([*stage.path][j])]
        # Where it touches at both ends too, it is 0 all along, and least nowhere.
        if options.at_end < share < 1 - options.at_end:
            points.append(ExchangePoint(i, interval, j, share, bool(ends.max() > options.touches)))
            totals.append(total)
            continue
        node = interval + round(share)
        if 0 < node < stage.intervals:
            held[problem.inner_row(i, j, node)] += total
        else:
            points.append(ExchangePoint(i, interval, j, float(round(share)), False))
            totals.append(total)
    return points, totals, held[:first]


@cached
def interval_check(stage: Stage, names: tuple[str, ...], substeps: int, watched: tuple[float, ...]) -> BufferedFunction:
    """(states (n, N) at the starts of a stage's intervals, duration, coefficients (m, N), parameters, nothing) -> the
    changes (n, N) of their ends where steps are halved, and the path expressions (k, N) at the watched shares."""
    sizes = len(stage.phase.states), 1, len(stage.coefficient_names), len(names), 0
    x, duration, w, p, _ = symbols = [ca.SX.sym("x", size) for size in sizes]
    data = ca.vertcat(p, duration / stage.intervals, w)
    step, finer = advance(stage, names, substeps), advance(stage, names, 2 * substeps)
    change = finer(x, 1.0, data)[0] - step(x, 1.0, data)[0]
    paths = ca.vertcat(*[step(x, share, data)[2] for share in watched])
    # The series is the same at all shares.
    function = ca.Function("check", symbols, [ca.densify(change), ca.densify(paths)], {"cse": substeps == 1})
    return BufferedFunction(function.map("checks", "serial", stage.intervals, [1, 3, 4], []))


def _warm_start(start: WarmStart, program: ParametricTranscription, point: CriticalPoint) -> WarmStart:
    """The start of a solve at a point of a family."""
    unit = abs(point.cost) if point.cost else 1.0
    bound, rows = point.multipliers[: program.count] / unit, point.multipliers[len(point.x) :] / unit
    return replace(
        start, problem=program.problem, x=point.x[: program.count], shares=program.shares(point.x), unit=unit,
        multipliers=(bound, rows[: len(program.problem.labels)]),
    )  # fmt: skip


def _integrated_again(start: WarmStart, program: ParametricTranscription, point: CriticalPoint) -> Control:
    """The motion at a point of a family, integrated again; where that does not agree, the program is refined."""
    began, warm, problem = time.perf_counter(), _warm_start(start, program, point), program.problem
    fixed = program.values(point.value)[0]
    motion = roll_out(warm, point.cost, fixed)
    if max(motion.error, motion.violation) > warm.tolerance:
        named = dict(zip(problem.fixed, fixed.tolist(), strict=True))
        found = steered_on_intervals(problem.stages, named, warm.free, warm, warm.tolerance)
        return replace(found, seconds=time.perf_counter() - began)
    return motion.control(warm, 0, 1, time.perf_counter() - began)
