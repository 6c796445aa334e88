"""Swings of a machine from hold to hold, found and followed: half a swing as equations, as a problem of curves.

The equations of half a swing are n conditions in the numbers of the release and the time. A search integrates the
motions from a grid of releases. From the beginning of each step of a motion a Newton step predicts a swing; where it
leads no farther than neighbouring releases and steps, the swing is solved for.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ..curves import BRANCH, FOLD, End, Event, Points, Problem, Run, Steps, Test, started
from ..errors import InputError, NoOrbit, finite_number
from ..flow import Trajectory
from ..mechanics import HALF_SWING, Grip, value_of
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
from ..running import TimeOver, interrupts
from ..shooting import Shooting, error_bounds, shooting_equations
from ..symbolic import suggest
from ..units import ANGLE, FORCE, LENGTH, SPEED, TIME, Dimension
from .energy_changes import work_along
from .extrema_and_zeros import Sought, extremes, turns_and_zeros
from .oscillator import OSCILLATOR
from .swing import GRAZES, Swing, SwingEvent, SwingFamily

# The columns of what is certified: the bound on the error of half the time, the change of energy, the residual, the
# least clearance at a minimum, `NONE` without one, the least separation, and the least and the largest force by which
# the grip holds up, `NONE` where these are not stated.
ERROR, DRIFT, RESIDUAL, CLEARANCE, APART, LEAST, LARGEST = range(7)


class SwingOptions(NamedTuple):
    """How swings are searched for."""

    releases: tuple[int, ...] = (400, 48, 12)  # along each number of a release, where there are one, two or more
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
    """The swings of a machine along one of its parameters: X has the numbers of the release, half the time, and the
    value of the parameter. What it certifies are the columns `ERROR` to `LARGEST`."""

    def __init__(self, machine: Any, along: str | None = None, unit: float = 1.0):
        """Along a parameter that is measured in a unit, by default along the first one."""
        values = dict(machine.values) or {"unused": 0.0}  # a curve has a parameter
        self.machine, self.along, self.grip, self.names = machine, along or next(iter(values)), machine.grip, (*values,)
        self.equations: Shooting = shooting_equations(half_swing(machine.model, self.grip), self.names)
        self.p, self.place = np.array([*values.values()]), self.names.index(self.along)
        self.unit = unit
        self.tests = [FOLD, BRANCH, Test("grazing", lambda problem, points: points.own[:, CLEARANCE])]
        self.tests.append(Test("parts touch", lambda problem, points: points.own[:, APART]))

    def parameters_at(self, xs: Array) -> Array:
        """The parameters (m, np) at points (m, n + 1)."""
        ps = np.tile(self.p, (len(xs), 1))
        ps[:, self.place] = xs[:, -1]
        return ps

    def named_at(self, xs: Array) -> dict[str, Array]:
        """The parameters (m,) by name."""
        return dict(zip(self.names, self.parameters_at(xs).T, strict=True))

    def evaluate(self, lanes: Array, xs: Array, known: Any = None, moved: Any = None) -> tuple[Array, Any]:
        return self.equations.evaluate_lanes(xs[:, :-1], self.parameters_at(xs), (self.along,))

    def size(self, lanes: Array, xs: Array) -> Array:
        m, n = xs.shape
        return np.column_stack([np.ones((m, n - 2)), np.abs(xs[:, -2]), np.full(m, self.unit)])

    def certify(self, points: Points) -> tuple[Points, Mapping[int, Exception]]:
        evaluation, model = points.evaluation[points.places], self.machine.model
        errors, refused = self.errors(points, HALF_SWING, quickly=True)
        motions, named = evaluation.trajectories[0], self.named_at(points.xs)
        states = motions.only(model.flight.states)
        drifts = work_along(model.flight, model.flight_gradient, states, named)[0]
        residual = np.abs(evaluation.residual).max(1)
        clearances, apart = self._clearances(states, named), np.full(len(points), NONE)
        forces = apart, apart
        if separation := model.separation(named):
            apart = extremes(states, separation)[0]
        if model.planar:
            forces = extremes(motions, Affine(tuple(float(name == NORMAL_FORCE) for name in motions.names)))
        return points.having(own=np.column_stack([errors, drifts, residual, clearances, apart, *forces])), refused

    def errors(self, points: Points, unknown: str, quickly: bool) -> tuple[Array, dict[int, NoOrbit]]:
        """The bounds (m,) on the errors of an unknown, and why some are not known; across the curve at a fold."""
        sizes, evaluation = self.size(points.lanes, points.xs), points.evaluation[points.places]
        folds = np.abs(points.tangents[:, -1]) < OSCILLATOR.at_a_fold * sizes[:, -1]
        closing = np.where(folds[:, None], points.tangents / sizes**2, np.eye(self.equations.size + 1)[-1])
        ps = self.parameters_at(points.xs)
        return error_bounds(self.equations, points.xs[:, :-1], ps, evaluation, closing, quickly, unknown)

    def _clearances(self, states: Any, named: Mapping[str, Array]) -> Array:
        """The least clearances (m,) at minima within swings, among them those in the middle of a swing."""
        clearance = StateFormula(self.grip.clearance, states.names, named)
        # At a release the distance and its rate are 0.
        found = turns_and_zeros({"clearance": Sought(states, clearance, order=1)})["clearance"]
        return found.lowest(middles=np.flatnonzero(found.at_ends(2) > 0))[0]

    def numbers(self, points: Points) -> dict[str, Array]:
        """The quantities (m,) of swings by name."""
        u, p = dict(zip(self.grip.unknowns, points.xs.T, strict=False)), self.named_at(points.xs)
        steps = np.broadcast_to(np.asarray(value_of(self.grip.step, u, p), float), len(points))
        known = np.where(points.own == NONE, np.nan, points.own)
        return {
            self.along: points.values, **{name: u[name] for name in self.grip.unknowns},
            "step": steps, "mean_speed": steps / (2 * u[HALF_SWING]), "clearance": known[:, CLEARANCE],
            "smallest_separation": known[:, APART],
            "smallest_grip_force": known[:, LEAST], "largest_grip_force": known[:, LARGEST],
            "error": known[:, ERROR], "energy_drift": known[:, DRIFT], "residual": known[:, RESIDUAL],
        }  # fmt: skip

    def of_one(self, point: Points) -> dict[str, float | None]:
        """The quantities of a swing (1) by name, None for one that there is not."""
        numbers = {name: float(each[0]) for name, each in self.numbers(point).items()}
        return {name: None if np.isnan(each) else each for name, each in numbers.items()}

    def swing(self, point: Points) -> Swing:
        """The swing at a point (1)."""
        errors = {name: float(self.errors(point, name, False)[0][0]) for name in self.grip.unknowns}
        path = point.evaluation[point.places].trajectories[0].only(self.machine.model.flight.states)[0]
        own: dict[str, Any] = {**self.of_one(point)}
        release, machine = {name: own.pop(name) for name in self.grip.release}, self.machine
        reversal = machine.model.reversal
        for name in (self.along, "error"):
            own.pop(name)
        return Swing(
            machine_in_words(machine), release, errors=errors, rates=path.end[1::2],
            motion=Trajectory(path.times, path.coefficients, path.names),
            reversor=np.array([reversal.signs, reversal.shifts(machine.values)], float), units=units_of(machine),
            source=machine, violations=self.violations(own), **own,
        )  # fmt: skip

    def violations(self, numbers: Mapping[str, float | None]) -> tuple[str, ...]:
        """Why a swing is not a motion, in words, from its quantities."""
        words = {"clearance": GRAZES, "smallest_separation": self.machine.model.violations["separation"]}
        return tuple(text for name, text in words.items() if (numbers[name] or 0.0) < 0)

    def lost(self, lane: int, passed: Any, error: object) -> End:
        return End("stuck", str(error), lane=lane)


def units_of(machine: Any) -> dict[str, str]:
    """The units of the quantities of swings by name; none for a dimensionless machine."""
    if (units := machine.units) is None:
        return {}
    own: dict[str, Dimension | str] = {name: name for name in machine.model.flight.states}
    own |= {name: name if name in own else ANGLE for name in machine.grip.release}
    own |= {"step": LENGTH, "mean_speed": SPEED, "clearance": LENGTH, "smallest_separation": LENGTH}
    own |= dict.fromkeys(("time", "error", HALF_SWING), TIME)
    own |= dict.fromkeys(("smallest_grip_force", "largest_grip_force"), FORCE)
    return {**machine.units_of_parameters(), **{name: units.text(each) for name, each in own.items()}}


def find_swings(machine: Any, start: Mapping[str, float] | Swing | None = None) -> tuple[Swing, ...]:
    """All swings within the ranges that the machine's grip states, or the one near a start, admissible ones first and
    then by falling mean speed; raises `NoOrbit` where there is none."""
    curve = SwingCurve(machine)
    with interrupts.deferred():
        points = started(curve, _near(curve, start) if start is not None else _predicted(curve))
        if not len(points):
            raise NoOrbit(_none_found(machine, start))
        swings = [curve.swing(points[i : i + 1]) for i in _different(points, curve if start is None else None)]
    if not swings:
        raise NoOrbit(_none_found(machine, start))
    return tuple(sorted(swings, key=lambda swing: (not swing.admissible, -swing.mean_speed)))


def _none_found(machine: Any, start: object) -> str:
    if start is not None:
        return f"start leads to no swing of this {machine.model.name}; state one nearer to it, or leave it out"
    ranges = ", ".join(f"{name} from {low:.4g} to {high:.4g}" for name, (low, high) in _ranges(machine).items())
    return f"this {machine.model.name} has no swing with {ranges}; other parameters may have one: use follow"


def _ranges(machine: Any) -> dict[str, tuple[float, float]]:
    """The ranges of the unknowns that are searched, by name."""
    p, grip = machine.values, machine.grip
    found = {name: tuple(float(value_of(end, {}, p)) for end in ends) for name, ends in grip.release.items()}
    return {**found, HALF_SWING: (0.0, float(value_of(grip.longest, {}, p)))}  # type: ignore[dict-item]


def _near(curve: SwingCurve, start: Mapping[str, float] | Swing) -> Array:
    """The unknowns of a start, with the parameter (1, n + 1)."""
    stated, names = dict(start.start if isinstance(start, Swing) else start), curve.grip.unknowns
    if wrong := [name for name in stated if name not in names]:
        raise InputError(f"start has no '{wrong[0]}'{suggest(str(wrong[0]), names)}")
    if missing := [name for name in names if name not in stated]:
        raise InputError(f"start needs '{missing[0]}': a swing has the unknowns {', '.join(names)}")
    u = [finite_number(f"start '{name}'", stated[name]) for name in names]
    return np.array([[*u, curve.p[curve.place]]])


def _predicted(curve: SwingCurve) -> Array:
    """Places (m, n + 1) near which swings are predicted."""
    ranges = np.array([*_ranges(curve.machine).values()])
    releases, longest = ranges[:-1], ranges[-1, 1]
    k = len(releases)
    count = SWINGS.releases[min(max(k, 1), len(SWINGS.releases)) - 1]
    spacing = np.ptp(releases, axis=1) / count
    axes = [low + spacing[i] * (np.arange(count) + 0.5) for i, low in enumerate(releases[:, 0])]
    grid = np.array([*product(*axes)]).reshape(count**k, k)
    at, steps, units = (np.concatenate(each) for each in zip(*_steps_along(curve, grid, longest), strict=True))
    units = np.column_stack([np.tile(SWINGS.reach * spacing, (len(at), 1)), SWINGS.steps * units])
    at = at + steps
    near = (np.abs(steps) < units).all(1) & (at[:, -1] > 0) & (at[:, -1] < 1.1 * longest)
    order = np.flatnonzero(near)[np.argsort(np.abs(steps / units)[near].max(1))]
    _, firsts = np.unique(np.round(at[order] / np.append(spacing, SWINGS.apart * longest)), axis=0, return_index=True)
    at = at[order[np.sort(firsts)]]
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


def _different(points: Points, within: SwingCurve | None) -> list[int]:
    """The indices of points that are different swings: none is another one that swings back and forth before it takes
    hold, and of a search `within` ranges, all lie there."""
    found, xs = list[int](), points.xs[:, :-1]
    for i in np.argsort(xs[:, -1]):
        if within is not None:
            low, high = np.array([*_ranges(within.machine).values()]).T
            if (xs[i] <= low + SWINGS.same).any() or (xs[i] > high).any():
                continue
        if not any(_repeats(xs[i], xs[j]) for j in found):
            found.append(int(i))
    return found


def _repeats(x: Array, other: Array) -> bool:
    """Whether a swing is another one, or passes the middle of that one an odd number of times."""
    ratio = x[-1] / other[-1]
    nearest = 2 * np.floor(ratio / 2) + 1
    size = np.maximum(np.abs(other), 1.0)
    return bool((np.abs(x - [*other[:-1], nearest * other[-1]]) < SWINGS.same * nearest * size).all())


def follow_swings(
    machine: Any, along: str, stop: float | tuple[float, float], start: Any,
    at: Sequence[float], steps: Steps, progress: Progress,
) -> SwingFamily:  # fmt: skip
    """The family of swings that leads from the fastest one, or from a start, along a parameter to its last value, or
    from the first of a range to the last one; `start` may also be the first value of the parameter."""
    check_machine(machine, "with_values", lands=False)
    refuse_others(machine, (along,), "to follow", free_parameters(machine))
    begin, last = stop if isinstance(stop, tuple | list) else (machine.values[along], stop)
    if isinstance(start, int | float):
        begin, start = start, None
    begin, last = finite_number("start", begin), finite_number("stop", last)
    if begin == last:
        raise InputError(f"{along} goes from {begin:g} to {last:g}: choose another stop")
    machine = machine.with_values(**{along: begin})
    unit = max(abs(begin), abs(last - begin))
    curve, points, events = SwingCurve(machine, along, unit), list[Points](), list[SwingEvent]()
    x = _near(curve, find_swings(machine, start)[0])
    with interrupts.deferred():
        first = started(curve, x, steps, np.sign(last - begin))
        try:
            for item in Run(curve, first, last, at=at, options=steps):
                if isinstance(item, End):
                    end = item
                elif isinstance(item, Event):
                    events.append(SwingEvent(item.kind, item.after, curve.of_one(item.point)))
                else:
                    points.append(item)
                    if progress:
                        progress(min(max(float(item.values[-1] - begin) / (last - begin), 0.0), 1.0))
        except TimeOver as over:
            end = End("interrupted", str(over))
    parts = [curve.numbers(each) for each in points]
    columns = {name: np.concatenate([each[name] for each in parts]) for name in parts[0]}
    words = machine_in_words(machine)
    return SwingFamily(words, along, columns, curve.grip.unknowns, tuple(events), end, units_of(machine))
