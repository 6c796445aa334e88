"""Branch points: the designs of a machine at which orbits that lean branch off its upright orbit."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import casadi as ca
import numpy as np

from ..consistency.accepted import check_machine, check_parameters
from ..errors import FlowError, InputError, NoOrbit, finite_number
from ..model.machine import Machine
from ..numerics.roots import solve
from ..running import interrupts
from ..running.exclusive import exclusive
from ..running.time_limit import check_time, time_limit
from ..shooting.error_bound import error_bounds
from ..shooting.formulations import vector
from ..shooting.multiple_shooting import boundary_functions
from ..shooting.single_shooting import Shooting, shooting_equations
from ..symbolic.calls import MappedFunction
from .branch_statement import branch_statement, lateral_forces, lateral_unknowns, lateral_speed, upright_statement
from .certificate import count_families
from .find import find
from .orbit import Orbit
from .upright import UprightMachine, mirrored, upright_model

# Cells of the search: in one a minor has a curvature of at most this multiple of what its second differences show; one
# whose bends are below a share of its slopes has at most one branch point; and each is halved at most so often.
BEND_SAFETY, MOST_HALVINGS = 4.0, 5
# A branch point predicted further outside a cell than this, in half its sides, is not one of it.
OUTSIDE = 1.6
# A range of positive values is divided evenly in their logarithm from this ratio on.
WIDE_RANGE = 2.0
# From the machine's own numbers to those of a design the upright orbit is followed in this number of steps, by so many
# Newton steps each.
STEPS_TO_DESIGN, NEWTON_STEPS = 8, 4
# Residuals of upright orbits, relative to their unknowns; branch points that agree to this share are the same; and
# singular values below this share of the largest are 0.
SOLVED_TO, SAME_POINT, RANK_TO = 1e-10, 1e-7, 1e-7
MOST_DESIGNS = 2000


@dataclass(frozen=True)
class BranchPoint:
    """A design at which orbits that lean to one side branch off an upright orbit, and their mirror images.

    machine : with the values of the branch point
    values, errors : of the numbers of the machine that were searched, by name, and bounds on their errors
    upright : the upright orbit, certified as a motion of its own
    direction : the lateral unknowns of a launch, by name, per unit of the speed of the centre of mass in flight
    step : the place of the next contact per unit of this speed
    nullity : the number of independent directions; 1 at a simple branch point
    conditioning : the second smallest singular value of the lateral conditions, each row and column scaled to the size
        1, over the largest: near 0 two branch points are close to each other
    """

    machine: Machine
    values: Mapping[str, float]
    errors: Mapping[str, float]
    upright: Orbit
    direction: Mapping[str, float]
    step: float
    nullity: int
    conditioning: float

    def start(self, speed: float) -> dict[str, float]:
        """The unknowns of half an orbit near the branch point whose speed along the ground is small; their errors, and
        the changes of the numbers of the machine, grow like its square."""
        return _beside(self.upright, self.direction, finite_number("speed", speed))


def _beside(upright: Orbit, direction: Mapping[str, float], speed: float) -> dict[str, float]:
    """The unknowns of half an orbit whose lateral ones are `speed` times `direction`."""
    assert upright.contact_time is not None and upright.source is not None
    own = upright.source.model.launch_at(upright.flight.coefficients[0, :, 0].tolist()) | {"alpha": upright.alpha}
    times = {"duration": upright.flight_time / 2, "contact_duration": upright.contact_time / 2}
    return {**own, **{name: speed * value for name, value in direction.items()}, **times}


@exclusive
def find_branch_points(
    machine: Machine,
    over: Mapping[str, tuple[float, float]],
    *,
    family: int = 1,
    designs: int = 100,
    limit: float | None = None,
) -> tuple[BranchPoint, ...]:
    """All designs in a range of two numbers at which orbits that lean branch off a machine's upright orbits.

    machine : with a mirror, whose reversor turns some coordinates over, and with one coordinate that sticks
    over : the range of each of two parameters, by name
    family : of the upright orbits, the hops of a runner
    designs : the number of values of each parameter at which the search begins
    limit : time limit in seconds, as in `find`

    A design is a branch point where the matrix of the lateral conditions, see `branch_statement`, loses its rank: where
    all its largest minors vanish. They are computed on a grid of designs, whose cells are halved until one minor has no
    zero there, or all are nearly linear. It is assumed that between the designs of a cell the curvature of a minor is
    at most four times what its second differences show; branch points closer to each other than a cell that is halved
    five times may be missed, and so are those at designs whose upright orbit is not reached from the machine's own.
    Returns the branch points in the order of the first parameter, solved to rounding. Raises `NoOrbit` where there is
    none, or no upright orbit, and `InputError` for a machine without a mirror and for invalid ranges.

    Source: Golubitsky and Schaeffer, Singularities and Groups in Bifurcation Theory I (1985), chapter VI.
    """
    check_machine(machine)
    ranges = _checked_ranges(machine, over)
    if isinstance(designs, bool) or not isinstance(designs, int) or not 4 <= designs <= MOST_DESIGNS:
        raise InputError(f"designs = {designs!r}; it is a whole number from 4 to {MOST_DESIGNS}")
    with interrupts.deferred(), time_limit(limit):
        search = _Search(machine, ranges, family)
        found = list[BranchPoint]()
        for place in search.candidates(designs):
            check_time()
            point = search.point(place)
            if point and not any(_same(point, other) for other in found):
                found.append(point)
    if not found:
        box = " and ".join(f"{name} from {low:g} to {high:g}" for name, (low, high) in ranges.items())
        missed = f"; {search.missed} designs have no upright orbit that is reached" if search.missed else ""
        raise NoOrbit(f"no orbit that leans branches off the upright orbit of family {family} with {box}{missed}")
    return tuple(sorted(found, key=lambda point: tuple(point.values.values())))


def _same(one: BranchPoint, other: BranchPoint) -> bool:
    return np.allclose([*one.values.values()], [*other.values.values()], rtol=SAME_POINT, atol=0.0)


def _checked_ranges(machine: Machine, over: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    check_parameters(machine, *over)
    sticks = machine.model.sticks
    mirrored(machine.model)
    if len(sticks) != 1:
        raise InputError(
            f"a {machine.model.name} has {len(sticks) or 'no'} coordinates that stick: branch points are found of "
            "machines with one, where they are single designs in two numbers; state sticks="
        )
    if len(over) != 2:
        raise InputError(f"over = {dict(over)!r}: branch points are single designs in two numbers, name two")
    found = dict[str, tuple[float, float]]()
    for name, ends in over.items():
        low, high = (finite_number(f"over '{name}'", each) for each in ends)
        if not low < high:
            raise InputError(f"over '{name}' = ({low:g}, {high:g}): the first number is the smaller one")
        found[name] = low, high
    return found


class LateralConditions:
    """The lateral conditions of the upright orbits of one family, at many designs of one machine that differ in the
    parameters `names`.

    A launch has 2 k lateral unknowns, of which the s forces along the ground that vanish leave 2 k - s columns. The
    2 k rows are the lateral places in mid-flight and in mid-contact.
    """

    def __init__(self, machine: Machine, names: tuple[str, ...], family: int):
        self.machine, self.names, self.family, self.model = machine, names, family, machine.model
        self.parameters, self.own = tuple(machine.values), vector(machine.values)
        self.places, self.lateral = list(map(self.parameters.index, names)), lateral_unknowns(self.model)
        self.upright = shooting_equations(upright_statement(self.model), self.parameters)
        self.linear = shooting_equations(branch_statement(self.model, ()), self.parameters)
        m, phases = mirrored(self.model), (self.model.flight, self.model.contact)
        places = [name for name in m.coordinates if name not in self.model.sticks]
        self.rows = [[arc.phase.states.index(name) for name in places] for arc in self.linear.statement.arcs]

    @cached_property
    def orbit(self) -> Orbit:
        """The upright orbit of the machine itself; raises `NoOrbit` for one in which its parts touch."""
        orbit = find(UprightMachine(self.machine), self.family)
        if (least := orbit.certificate.smallest_separation) is not None and not least > 0:
            raise NoOrbit(f"the upright orbit of family {self.family} passes through itself (separation {least:.3g})")
        if orbit.contact_time is None:
            raise NoOrbit(f"the contact of the upright orbit of family {self.family} does not end")
        return orbit

    @cached_property
    def moving(self) -> list[int]:
        """The places of those of the parameters on which the upright orbits depend."""
        p, found = ca.SX.sym("p", len(self.parameters)), list[ca.SX]()
        known = dict(zip(self.parameters, ca.vertsplit(p), strict=True))
        for arc, functions in zip(
            self.upright.statement.arcs, boundary_functions(self.upright.statement, self.parameters), strict=True
        ):
            found += map(ca.SX, arc.phase.field(ca.vertsplit(ca.SX.sym("x", len(arc.phase.states))), known, []))
            for function, place in zip(functions, (2, 3), strict=True):
                arguments = function.sx_in()
                found += map(ca.vec, function.call([*arguments[:place], p, *arguments[place + 1 :]]))
        return [i for i in self.places if ca.depends_on(ca.vertcat(*found), p[i])]

    def at(self, designs: np.ndarray) -> np.ndarray:
        """The parameters (m, np) at designs (m, names)."""
        ps = np.tile(self.own, (len(designs), 1))
        ps[:, self.places] = designs
        return ps

    def uprights(self, ps: np.ndarray) -> np.ndarray:
        """The unknowns (m, n) of the upright orbits with parameters (m, np), NaN where none is reached."""
        beside = _beside(self.orbit, {}, 0.0)
        first = np.array([beside[name] for name in self.upright.statement.unknowns])
        if not self.moving:
            return np.tile(first, (len(ps), 1))
        rows, place = np.unique(ps[:, self.moving], axis=0, return_inverse=True)
        goals, us, alive = np.tile(self.own, (len(rows), 1)), np.tile(first, (len(rows), 1)), np.arange(len(rows))
        goals[:, self.moving] = rows
        for share in np.linspace(0, 1, STEPS_TO_DESIGN + 1)[1:]:
            between = self.own + share * (goals - self.own)
            for _ in range(NEWTON_STEPS):
                which, there = self.upright.evaluate_lanes(us[alive], between[alive])
                if there is None:
                    return np.full((len(ps), len(first)), np.nan)
                alive = alive[which]
                us[alive] -= solve(there.jacobian, there.residual[..., None])[..., 0]
                times = us[alive][:, self.upright.durations]
                alive = alive[np.isfinite(us[alive]).all(1) & (times > 0).all(1)]
        solved = np.full(us.shape, np.nan)
        which, there = self.upright.evaluate_lanes(us[alive], goals[alive])
        if there is not None:
            alive = alive[which]
            good = np.abs(there.residual).max(1) < SOLVED_TO * (1 + np.abs(us[alive]).max(1))
            good &= count_families(upright_model(self.model), there.trajectories[0], 1) == self.family
            solved[alive[good]] = us[alive[good]]
        return solved[place.ravel()]

    @cached_property
    def at_launch(self) -> MappedFunction:
        """(upright unknowns, parameters) -> the forces along the ground at launch (s, 2 k) per lateral unknown, and
        the speed (1, 2 k) along it in flight."""
        unknowns = self.upright.statement.unknowns
        u, d = ca.SX.sym("u", len(unknowns)), ca.SX.sym("d", len(self.lateral))
        p = ca.SX.sym("p", len(self.parameters))
        known = dict(zip(self.parameters, ca.vertsplit(p), strict=True))
        named = dict(zip((*unknowns, *self.lateral), (*ca.vertsplit(u), *ca.vertsplit(d)), strict=True))
        parts = ca.vertcat(*lateral_forces(self.model, named, known)), lateral_speed(self.model, named, known)
        slopes = [ca.densify(ca.jacobian(part, d)) for part in parts]
        return MappedFunction(ca.Function("at_launch", [u, p], slopes))

    def launches(self, us: np.ndarray, ps: np.ndarray) -> np.ndarray:
        """Launches (m, 2 k, 2 k - s) without a force along the ground, about upright orbits (m, n)."""
        forces, count = self.at_launch(us, ps)[0], len(self.lateral)
        # The unknowns on which the forces depend most are eliminated, the same ones for all designs.
        pivots, left = list[int](), np.abs(forces).max(0)
        for row in left:
            pivots.append(max((i for i in range(count) if i not in pivots), key=lambda i, row=row: row[i]))
        free, found = [i for i in range(count) if i not in pivots], np.zeros((len(us), count, count - len(pivots)))
        found[:, free, range(len(free))] = 1.0
        found[:, pivots] = -solve(forces[:, :, pivots], forces[:, :, free])
        return found

    def matrices(self, designs: np.ndarray) -> np.ndarray:
        """The conditions (m, 2 k, 2 k - s) at designs (m, names), NaN where no upright orbit is reached."""
        ps = self.at(designs)
        us = self.uprights(ps)
        able = np.flatnonzero(np.isfinite(us).all(1))
        found = np.full((len(ps), len(self.lateral), len(self.lateral) - len(self.model.sticks)), np.nan)
        if len(able):
            found[able] = self.conditions(us[able], ps[able], self.launches(us[able], ps[able]))
        return found

    def conditions(self, us: np.ndarray, ps: np.ndarray, launches: np.ndarray) -> np.ndarray:
        """The lateral places (m, 2 k, columns) in mid-flight and mid-contact after lateral launches (m, 2 k, columns)
        about upright orbits (m, n); NaN where they cannot be followed."""
        (m, _, columns), times = launches.shape, len(self.linear.durations)
        us, ps = np.repeat(us, columns, axis=0), np.repeat(ps, columns, axis=0)
        us = np.hstack([us[:, :-times], launches.swapaxes(1, 2).reshape(m * columns, -1), us[:, -times:]])
        parts, before = list[np.ndarray](), np.zeros((1, 0))
        for flow, begin, rows in zip(self.linear.flows, self.linear.beginnings, self.rows, strict=True):
            starts, ends = begin(us, before, ps)[0][:, :, 0], np.full((len(us), len(rows)), np.nan)
            before = np.zeros((1, flow.size))  # no arc begins where the one before it ends
            nothing = np.zeros((flow.size, 0)), np.zeros((ps.shape[1], 0))
            done, motions, _ = flow.run_lanes(starts[:, :-1], ps, starts[:, -1], *nothing)
            if motions is not None:
                ends[done] = motions.finals[:, rows]
            parts.append(ends.reshape(m, columns, -1).swapaxes(1, 2))
        return np.concatenate(parts, axis=1)


class _Search:
    """The search of branch points in a box of two parameters, whose places (2,) go from 0 to 1 along each range."""

    def __init__(self, machine: Machine, ranges: Mapping[str, tuple[float, float]], family: int):
        self.machine, self.ranges, self.names = machine, [*ranges.values()], tuple(ranges)
        self.lateral = LateralConditions(machine, self.names, family)
        self.missed = 0

    def designs(self, places: np.ndarray) -> np.ndarray:
        """The values (m, 2) of the parameters at places (m, 2)."""
        each = []
        for (low, high), share in zip(self.ranges, places.T, strict=True):
            wide = low > 0 and high > WIDE_RANGE * low
            each.append(low * (high / low) ** share if wide else low + (high - low) * share)
        return np.stack(each, axis=1)

    def minors(self, places: np.ndarray) -> np.ndarray:
        """The largest minors (m, count) of the conditions with columns of the size 1, at places (m, 2)."""
        a = self.lateral.matrices(self.designs(places))
        a = a / np.linalg.norm(a, axis=1, keepdims=True)
        rows = [list(each) for each in combinations(range(a.shape[1]), a.shape[2])]
        return np.stack([np.linalg.det(a[:, each]) for each in rows], axis=1)

    def candidates(self, count: int) -> np.ndarray:
        """Places (m, 2) near each of which there may be a branch point, from a grid of `count` by `count` designs."""
        half = -(-(count - 1) // 2)
        axis = np.linspace(0.0, 1.0, 2 * half + 1)
        nodes = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
        values = self.minors(nodes.reshape(-1, 2)).reshape(*nodes.shape[:2], -1)
        self.missed = int(np.isnan(values[..., 0]).sum())
        corners = np.stack(np.meshgrid(*[np.arange(0, 2 * half, 2)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
        at = corners[:, None, None] + np.stack(np.meshgrid(*[np.arange(3)] * 2, indexing="ij"), axis=-1)
        cells, middles = values[at[..., 0], at[..., 1]], nodes[at[:, 1, 1, 0], at[:, 1, 1, 1]]
        radius, found = axis[1], list[np.ndarray]()
        for halving in range(MOST_HALVINGS + 1):
            of = _Cells(cells)
            found.append((middles + radius * of.predicted)[of.linear & of.near])
            middles = middles[~of.linear & ~of.excluded]
            if not len(middles) or halving == MOST_HALVINGS:
                break
            radius /= 2
            signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
            middles = (middles[:, None] + radius * signs).reshape(-1, 2)
            offsets = radius * np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 2, indexing="ij"), axis=-1)
            there = (middles[:, None, None] + offsets).reshape(-1, 2)
            cells = self.minors(there).reshape(len(middles), 3, 3, -1)
        return np.concatenate([*found, middles])

    def point(self, place: np.ndarray) -> BranchPoint | None:
        """The branch point to which Newton's method leads from a place, None where it leads to none in the box."""
        lateral, machine = self.lateral, self.machine
        design = self.designs(place[None])
        ps = lateral.at(design)
        us = lateral.uprights(ps)
        if not np.isfinite(us).all():
            return None
        launches = lateral.launches(us, ps)
        conditions = lateral.conditions(us, ps, launches)[0]
        if not np.isfinite(conditions).all():
            return None
        direction = launches[0] @ np.linalg.svd(conditions)[2][-1]
        upright = dict(zip(lateral.upright.statement.unknowns, us[0], strict=True))
        named = {**upright, **dict(zip(lateral.lateral, direction / np.linalg.norm(direction), strict=True))}
        named |= dict(zip(self.names, design[0], strict=True))
        equations = shooting_equations(branch_statement(machine.model, self.names), lateral.parameters)
        try:
            u, there = equations.newton(np.array([named[name] for name in equations.statement.unknowns]), ps[0])
        except (NoOrbit, FlowError):
            return None
        values = dict(zip(self.names, u[equations.own :].tolist(), strict=True))
        ends = zip(values.values(), self.ranges, strict=True)
        if not all(low <= value <= high for value, (low, high) in ends):
            return None
        found = dict(zip(equations.statement.unknowns, u.tolist(), strict=True))
        return _branch_point(lateral, equations, values, found, there)


class _Cells:
    """Values (m, 3, 3, count) of functions at the corners, the middles of the sides and the middles of cells."""

    def __init__(self, values: np.ndarray):
        self.values = values
        along = (np.abs(np.diff(values, 2, axis=axis)).max((1, 2)) for axis in (1, 2))
        self.bends = sum(along)
        self.slopes = np.stack(
            [np.mean(values[:, 2] - values[:, 0], axis=1), np.mean(values[:, :, 2] - values[:, :, 0], axis=1)], axis=-1
        ) / 2
        with np.errstate(all="ignore"):
            fit = np.einsum("mck,mc->mk", self.slopes, values.mean((1, 2)))
            square = np.einsum("mck,mcl->mkl", self.slopes, self.slopes)
            (a, b), c = (square[:, 0, 0], square[:, 1, 1]), square[:, 0, 1]
            det = a * b - c * c
            inside = np.stack([b * fit[:, 0] - c * fit[:, 1], a * fit[:, 1] - c * fit[:, 0]], axis=1)
            self.predicted = -inside / det[:, None]  # of the least values of the functions, in halves of the side
            least = (a + b) / 2 - np.sqrt((a - b) ** 2 / 4 + c * c)
            self.steepness = np.sqrt(np.maximum(least, 0.0))  # the least slope in any direction

    @property
    def linear(self) -> np.ndarray:
        """Whether the functions of each cell have at most one common zero, since they are nearly linear."""
        mixed = np.abs(self.values[:, 0, 0] - self.values[:, 0, 2] - self.values[:, 2, 0] + self.values[:, 2, 2]) / 4
        return BEND_SAFETY * np.linalg.norm(self.bends + mixed, axis=1) < self.steepness

    @property
    def near(self) -> np.ndarray:
        """Whether the zero of linear functions is in each cell or next to it."""
        return np.abs(self.predicted).max(1) < OUTSIDE

    @property
    def excluded(self) -> np.ndarray:
        """Whether one function, or their sum in the direction in which linear ones stay farthest from 0, has no zero in
        each cell; so it is where they are not known."""
        at = np.where(np.isfinite(self.predicted), np.clip(self.predicted, -1, 1), 0.0)
        rest = self.values.mean((1, 2)) + np.einsum("mck,mk->mc", self.slopes, at)
        rest = rest / np.maximum(np.linalg.norm(rest, axis=1, keepdims=True), 1e-300)
        along = np.einsum("mijc,mc->mij", self.values, rest)[..., None]
        every = np.concatenate([self.values, along], axis=-1)
        bends = np.concatenate([self.bends, np.einsum("mc,mc->m", self.bends, np.abs(rest))[:, None]], axis=1)
        one_sign = np.abs(np.sign(every).sum((1, 2))) == 9
        far = np.abs(every).min((1, 2)) > BEND_SAFETY / 8 * bends
        return (one_sign & far).any(1) | ~np.isfinite(self.values).all((1, 2, 3))


def _branch_point(
    lateral: LateralConditions, equations: Shooting, values: dict[str, float], found: dict[str, float], there: Any
) -> BranchPoint | None:
    """The branch point of a solution of its equations; None where they are not of full rank."""
    machine = lateral.machine.with_values(**values)
    us, ps = (np.array([[found[name] for name in equations.statement.unknowns]]), lateral.at(np.array([[*values.values()]])))
    evaluation = equations.evaluate_all(us, ps)
    errors = {}
    for name in values:
        bounds, refused = error_bounds(equations, us, ps, evaluation, unknown=name)
        if refused:
            return None
        errors[name] = float(bounds[0])
    own = {name: found[name] for name in ("liftoff", "alpha", "duration")}
    upright = find(UprightMachine(machine), start=own)
    here = us[:, [equations.statement.unknowns.index(name) for name in lateral.upright.statement.unknowns]]
    conditions = lateral.conditions(here, ps, lateral.launches(here, ps))[0]
    scaled = conditions / np.linalg.norm(conditions, axis=0)
    sizes = np.linalg.svd(scaled / np.linalg.norm(scaled, axis=1, keepdims=True))[1]
    nullity = int((sizes < RANK_TO * sizes[0]).sum())
    direction = np.array([found[name] for name in lateral.lateral])
    speed = float(lateral.at_launch(here, ps)[1][0, 0] @ direction)
    flight = evaluation.trajectories[0].finals[0]
    place = flight[equations.statement.arcs[0].phase.states.index(machine.model.sticks[0])]
    if abs(speed) < RANK_TO:
        raise NoOrbit(f"at {values} orbits branch off that lean and do not move along the ground")
    return BranchPoint(
        machine, values, errors, upright, dict(zip(lateral.lateral, (direction / speed).tolist(), strict=True)),
        2 * float(place) / speed, nullity, float(sizes[-1 - nullity] / sizes[0]) if nullity < len(sizes) else 0.0,
    )  # fmt: skip


def upright_guess(machine: Machine, speed: float, family: int = 1) -> dict[str, float]:
    """The unknowns of half an orbit, by name, of a machine near a branch point, which moves along the ground at a
    speed: the upright orbit, and the lateral launch that meets its conditions best."""
    lateral = LateralConditions(machine, (), family)
    ps = lateral.at(np.zeros((1, 0)))
    us = lateral.uprights(ps)
    launches = lateral.launches(us, ps)
    conditions = lateral.conditions(us, ps, launches)[0]
    direction = launches[0] @ np.linalg.svd(conditions)[2][-1]
    direction *= speed / float(lateral.at_launch(us, ps)[1][0, 0] @ direction)
    return _beside(lateral.orbit, dict(zip(lateral.lateral, direction.tolist(), strict=True)), 1.0)
