"""Swings of a machine from hold to hold, found and followed: half a swing as equations, as a problem of curves.

The equations of half a swing are n conditions in the numbers of the release and the time. A search integrates the
motions from a grid of releases. From the beginning of each step of a motion a Newton step predicts a swing; where it
leads no farther than neighbouring releases and steps, the swing is solved for.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache, partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ..curves import BRANCH, FOLD, Event, Points, Problem, Run, Steps, Test, started
from ..errors import InputError, NoOrbit, finite_number
from ..flow import Trajectory
from ..mechanics import HALF_SWING, Grip, names_in, value_of
from ..model import (
    NORMAL_FORCE,
    Affine,
    Arc,
    Model,
    StateFormula,
    Statement,
    check_machine,
    free_parameters,
    machine_in_words,
    refuse_others,
)
from ..numerics import Array
from ..records import NONE
from ..result import Progress
from ..running import interrupts
from ..shooting import Shooting, error_bounds, shooting_equations
from ..units import FORCE, TIME, Dimension
from .along_energy import collected
from .energy_changes import work_along
from .extrema_and_zeros import Sought, extremes, turns_and_zeros
from .oscillator import OSCILLATOR
from .swing import GRAZES, Swing, SwingFamily

# What is certified, in columns: the bound on the error of half the time, and quantities of a `Swing`.
OWN = (
    "error", "energy_drift", "residual", "clearance", "smallest_separation", "smallest_grip_force",
    "largest_grip_force",
)  # fmt: skip


class SwingOptions(NamedTuple):
    """How swings are searched for."""

    releases: tuple[int, ...] = (400, 32, 12)  # along each number of a release, where there are one, two or more
    reach: float = 3.0  # of a predicted swing, in distances of the grid
    steps: float = 2.0  # of a predicted time, in steps of the motion
    windows: int = 8  # of the longest time, at whose ends a motion has a step too
    apart: float = 0.02  # share of the longest time; of predictions that are nearer, one is solved for
    same: float = 1e-7  # relative distance of solutions that are one swing


SWINGS = SwingOptions()


def grip_of(machine: Any) -> Grip | None:
    """The second grip of a machine, None for one that does not swing from hold to hold."""
    return getattr(machine, "grip", None)


@lru_cache(maxsize=64)
def half_swing(model: Model, grip: Grip) -> Statement:
    """The statement of half a swing: from a release to a state that the reversor leaves as it is."""
    coordinates = tuple(name for name in model.flight.states if not name.endswith("'"))
    arc = Arc(
        model.flight,
        start=lambda u, before, p: grip.start(coordinates, u, p),
        duration=lambda u, p: u[HALF_SWING],
        conditions=lambda u, x, p: model.reversal.fixed(x, p),
    )
    return Statement("half swing", grip.unknowns, (arc,), (HALF_SWING,))


class SwingCurve(Problem):
    """The swings of a machine along one of its parameters, by default the first: X has the unknowns, and the value of
    the parameter, which is measured in a unit. What it certifies are the columns `OWN`."""

    def __init__(self, machine: Any, along: str | None = None, unit: float = 1.0):
        values = dict(machine.values) or {"unused": 0.0}  # a curve has a parameter
        self.machine, self.grip, self.along, self.unit = machine, machine.grip, along or next(iter(values)), unit
        self.names, self.p = (*values,), np.array([*values.values()])
        self.equations: Shooting = shooting_equations(half_swing(machine.model, self.grip), self.names)
        self.place, self.unknowns = self.names.index(self.along), self.grip.unknowns
        own = {"grazing": OWN.index("clearance"), "parts touch": OWN.index("smallest_separation")}
        self.tests = [FOLD, BRANCH, *(Test(kind, partial(_column, i)) for kind, i in own.items())]

    def parameters_at(self, xs: Array) -> Array:
        """The parameters (m, np) at points (m, n + 1)."""
        ps = np.tile(self.p, (len(xs), 1))
        ps[:, self.place] = xs[:, -1]
        return ps

    def evaluate(self, lanes: Array, xs: Array, known: Any = None, moved: Any = None) -> tuple[Array, Any]:
        return self.equations.evaluate_lanes(xs[:, :-1], self.parameters_at(xs), (self.along,))

    def size(self, lanes: Array, xs: Array) -> Array:
        m, n = xs.shape
        return np.column_stack([np.ones((m, n - 2)), np.abs(xs[:, -2]), np.full(m, self.unit)])

    def certify(self, points: Points) -> tuple[Points, Mapping[int, Exception]]:
        evaluation, model, none = points.evaluation[points.places], self.machine.model, np.full(len(points), NONE)
        motions, named = evaluation.trajectories[0], dict(zip(self.names, self.parameters_at(points.xs).T, strict=True))
        states, (errors, refused) = motions.only(model.flight.states), self.errors(points, HALF_SWING, quickly=True)
        drifts = work_along(model.flight, model.flight_gradient, states, named)[0]
        # At a release the distance and its rate are 0. The middle of a swing may be a minimum.
        clearance = Sought(states, StateFormula(self.grip.clearance, states.names, named), order=1)
        found = turns_and_zeros({"clearance": clearance})["clearance"]
        lowest = found.lowest(middles=np.flatnonzero(found.at_ends(2) > 0))[0]
        separation = model.separation(named)
        apart = extremes(states, separation)[0] if separation else none
        upward = Affine(tuple(float(name == NORMAL_FORCE) for name in motions.names))
        forces = extremes(motions, upward) if model.planar else (none, none)
        residual = np.abs(evaluation.residual).max(1)
        return points.having(own=np.column_stack([errors, drifts, residual, lowest, apart, *forces])), refused

    def errors(self, points: Points, unknown: str, quickly: bool) -> tuple[Array, dict[int, NoOrbit]]:
        """The bounds (m,) on the errors of an unknown, and why some are not known; across the curve at a fold."""
        sizes, evaluation = self.size(points.lanes, points.xs), points.evaluation[points.places]
        folds = np.abs(points.tangents[:, -1]) < OSCILLATOR.at_a_fold * sizes[:, -1]
        closing = np.where(folds[:, None], points.tangents / sizes**2, np.eye(self.equations.size + 1)[-1])
        ps = self.parameters_at(points.xs)
        return error_bounds(self.equations, points.xs[:, :-1], ps, evaluation, closing, quickly, unknown)

    def numbers(self, points: Points) -> dict[str, Array]:
        """The parameter, the unknowns and the quantities (m,) of swings by name, NaN for one that there is not."""
        u = dict(zip(self.unknowns, points.xs.T, strict=False))
        steps = value_of(self.grip.step, u, dict(zip(self.names, self.parameters_at(points.xs).T, strict=True)))
        found = {self.along: points.values, **u, "step": steps + np.zeros(len(points))}
        known = dict(zip(OWN, np.where(points.own == NONE, np.nan, points.own).T, strict=True))
        return {**found, "mean_speed": found["step"] / (2 * u[HALF_SWING]), **known}

    def of_one(self, point: Points) -> dict[str, float | None]:
        """The `numbers` of a swing (1) by name, None for one that there is not."""
        return {name: None if np.isnan(each[0]) else float(each[0]) for name, each in self.numbers(point).items()}

    def swing(self, point: Points) -> Swing:
        """The swing at a point (1)."""
        machine, numbers, reversal = self.machine, self.of_one(point), self.machine.model.reversal
        path = point.evaluation[point.places].trajectories[0].only(machine.model.flight.states)[0]
        words = {"clearance": GRAZES, "smallest_separation": machine.model.violations["separation"]}
        return Swing(
            machine_in_words(machine), dict(zip(self.unknowns, point.xs[0].tolist(), strict=False)),
            {name: float(self.errors(point, name, False)[0][0]) for name in self.unknowns}, path.end[1::2],
            {name: value for name, value in numbers.items() if name not in (self.along, *self.unknowns, "error")},
            tuple(text for name, text in words.items() if (numbers[name] or 0.0) < 0),
            Trajectory(path.times, path.coefficients, path.names),
            np.array([reversal.signs, reversal.shifts(machine.values)], float), units_of(machine), machine,
        )  # fmt: skip


def _column(i: int, _: Any, points: Points) -> Array:
    return points.own[:, i]


def units_of(machine: Any) -> dict[str, str]:
    """The units of the quantities of swings by name; none for a dimensionless machine."""
    if (units := machine.units) is None:
        return {}
    own: dict[str, Dimension | str] = {name: name for name in machine.model.flight.states}
    own |= {number: name for name, place in machine.grip.places.items() for number in names_in(place)}
    own |= dict.fromkeys(("time", "error", HALF_SWING), TIME)
    own |= dict.fromkeys(("smallest_grip_force", "largest_grip_force"), FORCE)
    return {**units.texts(), **machine.units_of_parameters(), **{name: units.text(each) for name, each in own.items()}}


def find_swings(machine: Any, start: Mapping[str, float] | Swing | None = None) -> tuple[Swing, ...]:
    """All swings within the ranges that the machine's grip states, or the one near a start, admissible ones first and
    then by falling mean speed; raises `NoOrbit` where there is none."""
    curve, p = SwingCurve(machine), machine.values
    ends = [*machine.grip.release.values(), (0.0, machine.grip.longest)]
    ranges = np.array([[float(value_of(end, {}, p)) for end in pair] for pair in ends])
    with interrupts.deferred():
        points = started(curve, _predicted(curve, ranges) if start is None else _near(curve, start))
        which = _different(points, ranges if start is None else None) if len(points) else []
        swings = [curve.swing(points[i : i + 1]) for i in which]
    if not swings:
        named = zip(curve.unknowns, ranges.tolist(), strict=True)
        text = ", ".join(f"{name} from {low:.4g} to {high:.4g}" for name, (low, high) in named)
        own = f"this {machine.model.name} has no swing with {text}; other parameters may have one: use follow"
        raise NoOrbit(own if start is None else "start leads to no swing; state one nearer to it, or leave it out")
    return tuple(sorted(swings, key=lambda swing: (not swing.admissible, -swing.mean_speed)))


def _near(curve: SwingCurve, start: Mapping[str, float] | Swing) -> Array:
    """The unknowns of a start, with the parameter (1, n + 1)."""
    stated = dict(start.start if isinstance(start, Swing) else start)
    if stated.keys() != {*curve.unknowns}:
        raise InputError(f"start has {', '.join(stated)}; a swing has the unknowns {', '.join(curve.unknowns)}")
    u = [finite_number(f"start '{name}'", stated[name]) for name in curve.unknowns]
    return np.array([[*u, curve.p[curve.place]]])


def _predicted(curve: SwingCurve, ranges: Array) -> Array:
    """Places (m, n + 1) near which swings are predicted, in ranges (n, 2) of the unknowns."""
    k, longest, found = len(ranges) - 1, ranges[-1, 1], list[tuple]()
    count = SWINGS.releases[min(max(k, 1), len(SWINGS.releases)) - 1]
    spacing = np.ptp(ranges[:-1], axis=1) / count
    axes = (low + each * (np.arange(count) + 0.5) for low, each in zip(ranges[:-1, 0], spacing, strict=True))
    found = [*_steps_along(curve, np.array([*product(*axes)]).reshape(count**k, k), longest)]
    if not found:
        return np.zeros((0, k + 2))
    at, steps, times = (np.concatenate(each) for each in zip(*found, strict=True))
    units = np.column_stack([np.tile(SWINGS.reach * spacing, (len(at), 1)), SWINGS.steps * times])
    at, sizes = at + steps, np.abs(steps / units).max(1)
    near = np.flatnonzero((sizes < 1) & (at[:, -1] > 0) & (at[:, -1] < 1.1 * longest))
    at = at[near[np.argsort(sizes[near])]]
    cells = np.round(at / np.append(spacing, SWINGS.apart * longest))
    at = at[np.sort(np.unique(cells, axis=0, return_index=True)[1])]
    return np.column_stack([at, np.full(len(at), curve.p[curve.place])])


def _steps_along(curve: SwingCurve, grid: Array, longest: float) -> Iterator[tuple[Array, Array, Array]]:
    """Of motions from releases (m, n - 1), at the beginnings of their steps: unknowns (k, n), the Newton step from
    there to half a swing (k, n), and the length (k,) of the step of the motion."""
    flow, begin, (count, k), windows = curve.equations.flows[0], curve.equations.ends[0][0], grid.shape, SWINGS.windows
    begins, slopes = zip(*(begin(np.append(u, longest), np.zeros(0), curve.p) for u in grid), strict=True)
    x, seeds = np.array(begins)[:, :-1, 0], np.zeros((count, flow.size, k + 1))
    seeds[:, :, :k] = np.array(slopes)[:, :-1, :k]
    # The last column, along a parameter, has a motion in closed form integrated in steps.
    ps, varied = np.tile(curve.p, (count, 1)), np.zeros((count, len(curve.p), k + 1))
    varied[:, curve.place, k] = 1.0
    reversal = curve.machine.model.reversal
    turned = np.array(reversal.signs) < 0
    shifts = np.array(reversal.shifts(curve.machine.values), float)[turned] / 2
    for begun in np.arange(windows) * longest / windows:
        which, motions, seeds = flow.run_lanes(x, ps, np.full(len(x), longest / windows), seeds, varied)
        if motions is None:
            return
        grid, ps, varied, x = grid[which], ps[which], varied[which], motions.finals[:, : flow.size]
        left = motions.coefficients[:, : flow.size, 0][:, turned] - shifts
        rates = motions.coefficients[:, : flow.size, 1, None][:, turned]
        assert motions.variations is not None
        slopes = np.concatenate([motions.variations[:, turned, :k], rates], axis=2)
        steps = -np.einsum("mij,mj->mi", np.linalg.pinv(slopes), left)
        yield np.column_stack([grid[motions.owner], begun + motions.starts]), steps, motions.steps


def _different(points: Points, ranges: Array | None) -> list[int]:
    """The indices of points that are different swings, in the ranges (n, 2) of a search: none passes the middle of
    another one an odd number of times before it takes hold."""
    found, xs = list[int](), points.xs[:, :-1]
    for i in np.argsort(xs[:, -1]).tolist():
        x, known = xs[i], xs[found]
        inside = ranges is None or ((x > ranges[:, 0] + SWINGS.same).all() and (x <= ranges[:, 1]).all())
        odd = 2 * np.floor(x[-1] / known[:, -1:] / 2) + 1
        other = np.hstack([known[:, :-1], odd * known[:, -1:]])
        if inside and not (np.abs(x - other) < SWINGS.same * odd * np.maximum(np.abs(other), 1.0)).all(1).any():
            found.append(i)
    return found


def follow_swings(
    machine: Any, along: str, stop: float | tuple[float, float], start: Any, at: Sequence[float], steps: Steps,
    progress: Progress,
) -> SwingFamily:  # fmt: skip
    """The family of swings that leads from the fastest one, or from a start, along a parameter to its last value, or
    from the first of a range to the last one; `start` may also be the first value of the parameter."""
    check_machine(machine, "with_values", lands=False)
    refuse_others(machine, (along,), "to follow", free_parameters(machine))
    begin, last = stop if isinstance(stop, tuple | list) else (machine.values[along], stop)
    begin, start = (start, None) if isinstance(start, int | float) else (begin, start)
    begin, last = finite_number("start", begin), finite_number("stop", last)
    if begin == last:
        raise InputError(f"{along} goes from {begin:g} to {last:g}: choose another stop")
    machine.with_values(**{along: last})  # refuses a value that no machine has
    machine = machine.with_values(**{along: begin})
    curve = SwingCurve(machine, along, max(abs(begin), abs(last - begin)))
    x = _near(curve, find_swings(machine, start)[0])
    with interrupts.deferred():
        run = Run(curve, started(curve, x, steps, np.sign(last - begin)), last, at=at, options=steps)
        points, events, end = collected(run, begin, last, progress)
    parts, words = [curve.numbers(each) for each in points], machine_in_words(machine)
    columns = {name: np.concatenate([each[name] for each in parts]) for name in parts[0]}
    located = tuple(Event(each.kind, each.after, curve.of_one(each.point)) for each in events)
    return SwingFamily(words, along, columns, curve.unknowns, located, end, units_of(machine))
