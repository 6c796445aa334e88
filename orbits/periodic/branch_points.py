"""Branch points: the designs of a machine at which runs branch off its vertical hop, and walks off rest."""

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, product
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..errors import FlowError, InputError, NoOrbit, finite_number, range_of, whole_number
from ..model import STEP_LENGTH, Machine, check_machine, check_parameters, dimensionless
from ..numerics import near_common_zeros, solve
from ..running import check_time, exclusive, interrupts, time_limit
from ..shooting import Shooting, error_bounds, shooting_equations, vector
from ..symbolic import MappedFunction
from .branch_statement import BesideVerticalHop, branch_statement, whole_hop_statement
from .family_orbits import family_number
from .find import find
from .orbit import Orbit
from .orbit_found import unknowns_of_hop, vertical_hop
from .orbits_at_once import lowest_orbits
from .quantities import step_of


class BranchPointOptions(NamedTuple):
    """How designs are searched for branch points, and when two are the same."""

    wide_range: float = 2.0  # from this ratio on a range of positive values is divided evenly in their logarithm
    same: float = 1e-7  # branch points that agree to this share are the same
    rank: float = 1e-7  # singular values below this share of the largest are 0
    steps: int = 15  # of Newton's method from a predicted place
    designs: int = 2000  # at most


BRANCH_POINTS = BranchPointOptions()


@dataclass(frozen=True)
class BranchPoint:
    """A design at which runs branch off the vertical hop, to both sides, or walks off the machine at rest.

    machine : with the values of the branch point
    values, errors : of the two searched parameters by name, and bounds on their errors, or estimates where walks begin
    hop : the vertical hop, certified as an orbit of `machine.upright()`; None of a machine that walks
    direction : the lateral unknowns of a launch, by name, per unit of the speed of the centre of mass in flight; of a
        walk, all of them per unit of what sticks, at landing
    step : the step per unit of the same
    nullity : the number of independent directions; 1 at a simple branch point
    conditioning : the least singular value other than 0 over the largest, of the lateral conditions with columns and
        then rows scaled to size 1; near 0, a second direction almost exists
    times : "duration" and "contact_duration", half the times of flight and contact, of a walk; empty for a run
    """

    machine: Machine
    values: Mapping[str, float]
    errors: Mapping[str, float]
    hop: Orbit | None
    direction: Mapping[str, float]
    step: float
    nullity: int
    conditioning: float
    times: Mapping[str, float] = field(default_factory=dict)

    def start(self, speed: float) -> dict[str, float]:
        """The unknowns by name of half a run near the branch point, as a start of `find`, for a small speed; or of half
        a walk, for a small place at landing of what sticks. Their error, and the change of the parameters along the
        branch, grow like its square. Raises `InputError` for the speed 0, at which every design hops or rests."""
        speed, own = finite_number("speed", speed), dict(self.times) if self.hop is None else unknowns_of_hop(self.hop)
        if speed == 0:
            same = "at speed 0 every design hops, so no run" if self.hop else "at 0 every design is at rest, so no walk"
            raise InputError(f"speed = 0: {same} is found; start at 0.01 or -0.01")
        lateral = {name: speed * value for name, value in self.direction.items()}
        return {**own, **lateral, **({} if self.hop is None else {STEP_LENGTH: speed * self.step})}


@exclusive
def find_branch_points(
    machine: Machine,
    over: Mapping[str, tuple[float, float]],
    *,
    family: int = 1,
    designs: int = 100,
    limit: float | None = None,
) -> tuple[BranchPoint, ...]:
    """Find all designs in a range of two parameters at which runs branch off the vertical hop of a machine, or walks
    off the machine at rest.

    machine : a `problems.runner` or `problems.walker`, or another `Mechanism` with one coordinate that sticks
    over : the range of each of two parameters, by name
    family : of the hop
    designs : the number of values of each parameter at which the search begins
    limit : time limit in seconds, as in `find`; None for the limit of a `time_limit` around it, if there is one

    A design is a branch point where the matrix of the lateral conditions, see `branch_statement`, loses its rank, so
    that all its largest minors vanish. These are computed on a grid of designs. Its cells are halved until one minor
    has no zero there, or all are nearly linear. Newton's method then solves for the branch points to rounding. Between
    the samples of a cell the curvature of a minor is assumed to be at most four times what their second differences
    show. This is not a proof. The search may miss branch points that are closer together than a cell halved five times.
    It misses those in cells where a design has no hop of the family, or one in which parts pass through each other.
    Wide ranges above 0 are divided evenly in their logarithm. Walks are searched from fewer designs, see `small_steps`,
    up to a longest time, and some may be missed.

    Returns the branch points by the first parameter. A run near one is found from its `start`. Raises `NoOrbit` where
    there is none, or no hop, and `InputError` for a machine without a vertical hop and for invalid ranges.

    >>> from orbits import find_branch_points
    >>> from problems import runner
    >>> points = find_branch_points(runner(), {"inertia": (4.0, 9.0), "hip_stiffness": (5.0, 6.0)}, designs=10)
    >>> [round(value, 6) for value in points[0].values.values()]
    [7.213473, 5.520007]
    """
    check_machine(machine)
    ranges = _checked_ranges(machine, over)
    whole_number("designs", designs, least=4, most=BRANCH_POINTS.designs)
    with interrupts.deferred(), time_limit(limit) if limit is not None else nullcontext():
        if not machine.model.runs:
            return _where_walks_begin(machine, ranges)
        search, found = _DesignSearch(machine, ranges, family_number(family)), list[BranchPoint]()
        places, missed = near_common_zeros(search.minors, designs)
        for place in places:
            check_time()
            point = search.point(place)
            if point and not any(_same_point(point, other) for other in found):
                found.append(point)
    if not found:
        box = " and ".join(f"{name} from {low:g} to {high:g}" for name, (low, high) in ranges.items())
        without = f"; {missed} of the designs have no such hop" if missed else ""
        raise NoOrbit(f"no run branches off the vertical hop of family {family} with {box}{without}")
    return tuple(sorted(found, key=lambda point: tuple(point.values.values())))


def _where_walks_begin(machine: Machine, ranges: Mapping[str, tuple[float, float]]) -> tuple[BranchPoint, ...]:
    """The designs in ranges at which walks begin, from small steps near values in them."""
    from .small_steps import SMALL_STEPS, small_steps_near  # SciPy takes long to import

    model, bare, found = machine.model, dimensionless(machine), list[BranchPoint]()
    grids = [
        np.linspace(*ends, count + 1)[1:] for ends, count in zip(ranges.values(), SMALL_STEPS.designs, strict=True)
    ]
    for design in product(*grids):
        check_time()
        p = {**bare.values, **dict(zip(ranges, design, strict=True))}
        for step in small_steps_near(model, p, tuple(ranges)):
            inside = all(low <= step.tuned[name] <= high for name, (low, high) in ranges.items())
            if not inside or any(
                np.allclose(step.flight, each.times["duration"], rtol=SMALL_STEPS.same) for each in found
            ):
                continue
            direction = {name: float(step.launch[place]) for name, place in model.launch_places.items()}
            times = {"duration": float(step.flight), "contact_duration": float(step.contact)}
            own = machine.with_values(**step.tuned)
            small = {name: SMALL_STEPS.tiny * value for name, value in direction.items()}
            each = float(step_of(model, {**small, **times}, own.values)) / SMALL_STEPS.tiny
            nullity = sum(size < BRANCH_POINTS.rank * step.sizes[0] for size in step.sizes)
            share = step.sizes[-1 - nullity] / step.sizes[0]
            found.append(BranchPoint(own, step.tuned, step.errors, None, direction, each, nullity, share, times))
    if not found:
        box = " and ".join(f"{name} from {low:g} to {high:g}" for name, (low, high) in ranges.items())
        tried = int(np.prod(SMALL_STEPS.designs))
        raise NoOrbit(f"no walk of a {model.name} that begins with {box} is found from {tried} designs")
    return tuple(sorted(found, key=lambda point: tuple(point.values.values())))


def _same_point(one: BranchPoint, other: BranchPoint) -> bool:
    return np.allclose([*one.values.values()], [*other.values.values()], rtol=BRANCH_POINTS.same, atol=0.0)


def _checked_ranges(machine: Machine, over: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    sticks, found = len(machine.model.sticks), dict[str, tuple[float, float]]()
    if sticks != 1 or machine.model.reversor is None:
        raise InputError(
            f"a {machine.model.name} has {sticks or 'no'} coordinates that stick, but runs branch off the vertical hop "
            'of a machine with a reversor and one such coordinate; state sticks=("x",) for its place along the ground'
        )
    if not isinstance(over, Mapping):
        raise InputError(f"over = {over!r}; it must be a mapping of names to ranges, as over={{'inertia': (4.0, 9.0)}}")
    check_parameters(machine, *over)
    if len(over) != 2:
        raise InputError(f"over = {dict(over)!r}: a branch point has two parameters; state the ranges of two")
    for name, ends in over.items():
        low, high = range_of(f"over '{name}'", ends)
        for end in (low, high):
            try:
                # A range may tend to a value 0 that no machine has.
                machine.with_values(**({name: end} if end else {}))
            except InputError as error:
                stated = f"over '{name}' = ({low:g}, {high:g})"
                raise InputError(f"{stated}: state a range of values that the machine can have ({error})") from None
        found[name] = low, high
    return found


class Lateral:
    """The lateral conditions near the vertical hops of one family, at designs that differ in the parameters `names`.

    A launch has 2 k lateral unknowns; the s forces along the ground that vanish leave 2 k - s columns. The 2 k rows are
    the lateral places in mid-flight and in mid-contact.
    """

    def __init__(self, machine: Any, names: tuple[str, ...], family: int):
        self.machine, self.names, self.family = dimensionless(machine), names, family
        self.upright = self.machine.upright()
        self.model, self.hop = self.machine.model, self.upright.model
        self.parameters, self.own = tuple(self.machine.values), vector(self.machine.values)
        self.places = [self.parameters.index(name) for name in names]
        self.beside = BesideVerticalHop(self.model, self.hop)
        self.statement = branch_statement(self.model, self.hop, ())
        self.equations = shooting_equations(self.statement, self.parameters)
        self.unknowns = whole_hop_statement(self.hop).unknowns
        self.rows = [
            [i for i, name in enumerate(arc.phase.states) if name not in hop.states and name[-1] != "'"]
            for arc, hop in zip(self.statement.arcs, (self.hop.flight, self.hop.contact), strict=True)
        ]
        self.rows[0] = [i for i in self.rows[0] if self.statement.arcs[0].phase.states[i] not in self.model.sticks]

    @property
    def branch(self) -> Shooting:
        """The equations of a branch point."""
        return shooting_equations(branch_statement(self.model, self.hop, self.names), self.parameters)

    def at(self, designs: np.ndarray) -> np.ndarray:
        """The parameters (m, np) at designs (m, names)."""
        ps = np.tile(self.own, (len(designs), 1))
        ps[:, self.places] = designs
        return ps

    def hops(self, ps: np.ndarray) -> np.ndarray:
        """The unknowns (m, n) of the vertical hops with parameters (m, np), NaN where there is none."""
        names = tuple(self.upright.values)
        own, of_each = np.unique(ps[:, [self.parameters.index(n) for n in names]], axis=0, return_inverse=True)
        found, left = np.full((len(own), len(self.unknowns)), np.nan), {*range(len(own))}
        parts, absent = lowest_orbits(self.hop, names, own, self.family) if len(own) > 1 else ([], {})
        for part in parts:
            u, certificates = part.cycles.u, part.certificates
            times = {"contact_duration": part.cycles.contact_times / 2}
            columns = [np.broadcast_to({**u, **times}[name], len(part.cycles))[part.places] for name in self.unknowns]
            apart = np.array(certificates.column("smallest_separation"))[part.places]
            found[part.which] = np.where(apart[:, None] > 0, np.column_stack(columns), np.nan)
            left -= {*part.which.tolist()}
        for i in sorted(left - {*absent}):
            check_time()
            try:
                hop = self._hop(dict(zip(names, own[i].tolist(), strict=True)))
                found[i] = [hop[name] for name in self.unknowns]
            except (NoOrbit, FlowError, InputError):
                if len(own) == 1:
                    raise
        return found[of_each.ravel()]

    def _hop(self, values: Mapping[str, float]) -> dict[str, float]:
        """The unknowns of one vertical hop; raises `NoOrbit` for a hop that is not a motion."""
        return unknowns_of_hop(vertical_hop(self.upright.with_values(**values), self.family))

    @cached_property
    def at_launch(self) -> MappedFunction:
        """(unknowns of a hop, parameters) -> the forces along the ground at launch (s, 2 k), and the speed (1, 2 k)
        along it in flight, per lateral unknown."""
        u, d = ca.SX.sym("u", len(self.unknowns)), ca.SX.sym("d", len(self.beside.unknowns))
        p = ca.SX.sym("p", len(self.parameters))
        known = dict(zip(self.parameters, ca.vertsplit(p), strict=True))
        symbols = *ca.vertsplit(u), *ca.vertsplit(d)
        named = dict(zip((*self.unknowns, *self.beside.unknowns), symbols, strict=True))
        parts = ca.vertcat(*self.beside.forces(named, known)), self.beside.speed(named, known)
        slopes = [ca.densify(ca.jacobian(part, d)) for part in parts]
        return MappedFunction(ca.Function("at_launch", [u, p], slopes))

    def launches(self, us: np.ndarray, ps: np.ndarray) -> np.ndarray:
        """Launches (m, 2 k, 2 k - s) without a force along the ground, near hops (m, n)."""
        forces, count, pivots = self.at_launch(us, ps)[0], len(self.beside.unknowns), list[int]()
        # Those unknowns are eliminated on which the forces depend most, the same ones for all designs.
        for row in np.abs(forces).max(0):
            row[pivots] = -1.0
            pivots.append(int(row.argmax()))
        free, found = [i for i in range(count) if i not in pivots], np.zeros((len(us), count, count - len(pivots)))
        found[:, free, range(len(free))] = 1.0
        found[:, pivots] = -solve(forces[:, :, pivots], forces[:, :, free])
        return found

    def conditions(self, us: np.ndarray, ps: np.ndarray, launches: np.ndarray) -> np.ndarray:
        """The lateral places (m, 2 k, columns) in mid-flight and mid-contact after lateral launches (m, 2 k, columns)
        near hops (m, n); NaN where they cannot be followed."""
        (m, _, columns), times = launches.shape, len(self.equations.durations)
        us, ps = np.repeat(us, columns, axis=0), np.repeat(ps, columns, axis=0)
        us = np.hstack([us[:, :-times], launches.swapaxes(1, 2).reshape(m * columns, -1), us[:, -times:]])
        parts, before = list[np.ndarray](), np.zeros((1, 0))
        for flow, begin, rows in zip(self.equations.flows, self.equations.beginnings, self.rows, strict=True):
            starts, ends = begin(us, before, ps)[0][:, :, 0], np.full((len(us), len(rows)), np.nan)
            before = np.zeros((1, flow.size))  # no arc begins where the one before it ends
            nothing = np.zeros((flow.size, 0)), np.zeros((ps.shape[1], 0))
            done, motions, _ = flow.run_lanes(starts[:, :-1], ps, starts[:, -1], *nothing)
            if motions is not None:
                ends[done] = motions.finals[:, rows]
            parts.append(ends.reshape(m, columns, -1).swapaxes(1, 2))
        return np.concatenate(parts, axis=1)

    def matrices(self, designs: np.ndarray) -> np.ndarray:
        """The conditions (m, 2 k, 2 k - s) of launches without a force along the ground at designs (m, names), NaN
        where there is no hop."""
        count, sticks, ps = len(self.beside.unknowns), len(self.model.sticks), self.at(designs)
        us, found = self.hops(ps), np.full((len(ps), count, count - sticks), np.nan)
        if len(able := np.flatnonzero(np.isfinite(us).all(1))):
            us, ps = us[able], ps[able]
            found[able] = self.conditions(us, ps, self.launches(us, ps))
        return found


class _DesignSearch:
    """The search for branch points in a box of two parameters, whose places (2,) go from 0 to 1 along each range."""

    def __init__(self, machine: Machine, ranges: Mapping[str, tuple[float, float]], family: int):
        self.machine, self.ranges, self.names = machine, [*ranges.values()], tuple(ranges)
        self.lateral = Lateral(machine, self.names, family)

    def designs(self, places: np.ndarray) -> np.ndarray:
        """The values (m, 2) of the parameters at places (m, 2)."""
        each = list[np.ndarray]()
        for (low, high), share in zip(self.ranges, places.T, strict=True):
            wide = low > 0 and high > BRANCH_POINTS.wide_range * low
            each.append(low * (high / low) ** share if wide else low + (high - low) * share)
        return np.stack(each, axis=1)

    def minors(self, places: np.ndarray) -> np.ndarray:
        """The largest minors (..., count) of the conditions, with columns of the size 1, at places (..., 2)."""
        conditions = self.lateral.matrices(self.designs(places.reshape(-1, 2)))
        conditions = conditions / np.linalg.norm(conditions, axis=1, keepdims=True)
        rows = combinations(range(conditions.shape[1]), conditions.shape[2])
        with np.errstate(invalid="ignore"):  # NaN where there is no hop
            minors = np.stack([np.linalg.det(conditions[:, each]) for each in rows], axis=1)
        return minors.reshape(*places.shape[:-1], -1)

    def point(self, place: np.ndarray) -> BranchPoint | None:
        """The branch point to which Newton's method leads from a place; None where it leads to none in the box."""
        lateral, design = self.lateral, self.designs(place[None])
        equations, ps = lateral.branch, lateral.at(design)
        unknowns = equations.statement.unknowns
        try:
            us = lateral.hops(ps)
            launches = lateral.launches(us, ps)
            direction = launches[0] @ np.linalg.svd(lateral.conditions(us, ps, launches)[0])[2][-1]
            values = np.hstack([direction / np.linalg.norm(direction), design[0], us[0]])
            names = *lateral.beside.unknowns, *self.names, *lateral.unknowns
            first = dict(zip(names, values.tolist(), strict=True))
            u, _ = equations.newton([first[name] for name in unknowns], ps[0], BRANCH_POINTS.steps)
        except (NoOrbit, FlowError, InputError, np.linalg.LinAlgError):
            return None
        ends = zip(u[equations.own :], self.ranges, strict=True)
        inside = all(low <= value <= high for value, (low, high) in ends)
        return branch_point(self.machine, lateral, equations, u, ps[0]) if inside else None


def branch_point(machine: Any, lateral: Lateral, equations: Shooting, u: np.ndarray, p: np.ndarray) -> BranchPoint:
    """The branch point with unknowns (n,) and parameters (np,) of a machine with other values of these."""
    us, ps, names = u[None], equations.with_tuned(u[None], p[None]), equations.statement.unknowns
    found, evaluation, errors = dict(zip(names, u.tolist(), strict=True)), equations.evaluate_all(us, ps), {}
    for name in lateral.names:
        bounds, refused = error_bounds(equations, us, ps, evaluation, unknown=name)
        errors[name] = np.inf if refused else float(bounds[0])
    hop = us[:, [names.index(name) for name in lateral.unknowns]]
    scaled = lateral.conditions(hop, ps, lateral.launches(hop, ps))[0]
    scaled = scaled / np.linalg.norm(scaled, axis=0)
    sizes = np.linalg.svd(scaled / np.linalg.norm(scaled, axis=1, keepdims=True))[1]
    nullity = int((sizes < BRANCH_POINTS.rank * sizes[0]).sum())
    launch = {name: found[name] for name in lateral.beside.unknowns}
    speed = float(lateral.at_launch(hop, ps)[1][0, 0] @ [*launch.values()])
    middle = dict(zip(equations.flows[0].names, evaluation.trajectories[0].finals[0].tolist(), strict=False))
    values = dict(zip(lateral.parameters, ps[0].tolist(), strict=True))
    machine = machine.with_values(**{name: values[name] for name in values if values[name] != machine.values[name]})
    return BranchPoint(
        machine=machine,
        values={name: found[name] for name in lateral.names},
        errors=errors,
        hop=find(machine.upright(), start={name: found[name] for name in lateral.unknowns}),
        direction={name: value / speed for name, value in launch.items()},
        step=2 * middle[lateral.model.sticks[0]] / speed,
        nullity=nullity,
        conditioning=float(sizes[-1 - nullity] / sizes[0]) if nullity < len(sizes) else 0.0,
    )
