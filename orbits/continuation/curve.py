"""The curve of a machine's orbits along a parameter: its equations, its points, and their certificates.

The curve is F(u, value) = 0, the equations that `find` solves, with their exact derivatives. A point of it is
X = (u, value), measured in units of its own size.
"""

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Any, Self, TypeAlias

import numpy as np

from ..curves import Points
from ..errors import InputError, NoOrbit, OrbitsError
from ..flow import OUT_OF_LAW
from ..hops import LosslessHops
from ..model import Machine, Planar, check_parameters
from ..numerics import solve
from ..periodic import (
    METHOD,
    Certificate,
    Orbit,
    Solved,
    certified,
    counts,
    is_quantity,
    motion_numbers,
    orbit_from,
    orbit_of_solved,
)
from ..records import NONE, Records
from ..shooting import (
    DIVISION,
    Cycles,
    Division,
    Evaluation,
    NewtonKernel,
    are_divided,
    counts_of_parts,
    division_at,
    equations_of,
    growths_along,
    growths_without_nodes,
    iterative,
    method_of,
    newton_kernel,
    rounding_of_unknowns,
    steady_tangents,
)
from ..units import Units
from .point import RESERVED_NAMES, Point, point_in_units

# A point is at a fold where the tangent's component along the parameter is a smaller share than this. The value of the
# parameter does not determine the orbit there, and its error is measured across the curve.
AT_A_FOLD = 1e-3
# All states at nodes together count for the length of a curve as one unknown that is this many times as large: where
# the duration alone changes, they change much, since the nodes move along with it.
NODE_UNIT = 10.0
# Functions of an orbit whose zeros are events, by name.
Watch = Mapping[str, Callable[[Orbit], float]]
# Test functions (m,) at certified points of a curve, which change their sign at the event. They are NONE where they are
# not defined.
TestFunction: TypeAlias = "Callable[[Curve, Points], np.ndarray]"


def _of_orbits(function: Callable[[Records[Point]], np.ndarray]) -> TestFunction:
    """A test function that depends on the certified orbits alone."""
    return lambda curve, points: function(points.own)


TEST_FUNCTIONS: dict[str, TestFunction] = {
    "grazing": _of_orbits(lambda points: _or_one(points.column("clearance"))),
    "masses touch": _of_orbits(lambda points: points.column("smallest_separation")),
    "contact pulls": _of_orbits(
        lambda points: np.where(_lifts(points), _or_one(points.column("smallest_contact_force")), NONE)
    ),
    "landing jerk": _of_orbits(lambda points: -points.column("landing_jerk")),
    "collapse": _of_orbits(lambda points: np.where(_lifts(points) | _leaves_law(points), 1.0, -1.0)),
    "law ends": _of_orbits(lambda points: np.where(_leaves_law(points), -1.0, 1.0)),
    "foot lifts": lambda curve, points: curve.stance_force(points),
    "foot slides": lambda curve, points: curve.friction_left(points),
}


def _or_one(values: np.ndarray) -> np.ndarray:
    return np.where(values == NONE, 1.0, values)


def _lifts(points: Records[Point]) -> np.ndarray:
    """Whether the contacts end."""
    return points.column("contact_time") != NONE


def _leaves_law(points: Records[Point]) -> np.ndarray:
    """Whether contacts have no end because the motion leaves the range of a law, such as a measured table."""
    found, violations = ~_lifts(points), points.column("violations")
    for i in found.nonzero()[0].tolist():
        found[i] = any(OUT_OF_LAW in violation for violation in violations[i])
    return found


def evaluation_at(points: Points) -> Evaluation:
    """The equations at points (m,) alone."""
    whole = np.array_equal(points.places, np.arange(len(points.evaluation.jacobian)))
    return points.evaluation if whole else points.evaluation[points.places]


class Curve:
    """The curve F(u, value) = 0 of a machine's orbits along a parameter, whose whole range `span` is its unit."""

    tuned: tuple[str, ...] = ()  # the names of the parameters that are tuned along it
    division: Division | None = None  # of the motions, where they amplify small changes
    takes_nodes = True  # whether they may be divided so
    takes_nodes_early = True  # and where they could do without: not where that made the errors larger
    own_settings: Mapping[str, object] = {}  # further settings of its family
    tests: Mapping[str, TestFunction] = TEST_FUNCTIONS  # of the events of orbits along it

    def __init__(self, machine: Machine, along: str, method: str, span: float):
        self.machine, self.along, self.method, self.span = machine, along, method, span
        self.names, self.parameters = tuple(machine.values), np.array(list(machine.values.values()))
        self.equations = self.equations_of_orbits = equations_of(machine.model, method, self.names)
        self.place = self.names.index(along)

    def size(self, x: np.ndarray) -> np.ndarray:
        """The unit of each component at points (..., N + 1)."""
        if self.division is None:
            return self.bare_size(x)
        states = np.abs(x[..., self.division.nodes])
        own = np.maximum(states, 0.1 * states.max(-1, keepdims=True)) * (NODE_UNIT * np.sqrt(states.shape[-1]))
        return self.division.inserted(self.bare_size(self.division.bare(x)), own)

    def bare_size(self, x: np.ndarray) -> np.ndarray:
        """The unit of each component at points (..., n + 1) without the states at nodes."""
        size = np.abs(x)
        own = size[..., :-1]
        np.maximum(own, 0.1 * own.max(-1, keepdims=True), out=own)
        size[..., -1] = self.span
        return size

    def units_of_changes(self, sizes: np.ndarray, evaluation: Evaluation) -> np.ndarray:
        """The units (m, N + 1) of small changes at points (m, N + 1) of these sizes: where parameters determine the
        motions more sharply than by their sizes, the values that move them by their own size."""
        units, places = sizes.copy(), self.equations.moving((self.along,))
        units[:, places] = np.minimum(units[:, places], evaluation.parameter_units)
        return units

    def rounding_of_steps(self, evaluation: Evaluation, rows: np.ndarray) -> np.ndarray:
        """The rounding errors (m, N + 1) of Newton steps to levels of rows (m, N + 1). Where a motion leaves an
        unstable equilibrium and comes to another one within an arc, they are larger than its growth lets expect."""
        bordered = np.concatenate([evaluation.jacobian, rows[:, None]], axis=1)
        inverse = solve(bordered, np.broadcast_to(np.eye(bordered.shape[1]), bordered.shape))
        return rounding_of_unknowns(self.equations, evaluation, inverse[:, :, :-1])

    def steady(self, xs: np.ndarray, tangents: np.ndarray) -> np.ndarray:
        """The tangents (c, N + 1) at a chain of points (c, N + 1), from which others are interpolated."""
        if self.division is None or not self.division.is_uneven:
            return tangents
        return steady_tangents(xs, tangents, self.size(xs), self.division.nodes)

    def bare(self, xs: np.ndarray) -> np.ndarray:
        """Points or tangents (..., N + 1) without the states at nodes."""
        return self.division.bare(xs) if self.division else xs

    def whole(self, evaluation: Evaluation) -> Evaluation:
        """The equations at points without nodes, from those with nodes."""
        return self.division.whole(evaluation) if self.division else evaluation

    def growths(self, points: Points) -> np.ndarray:
        """The largest growths (m,) of a small change over an arc of the motions at points."""
        if self.division is None:
            return points.evaluation.amplification[points.places]
        return self.division.growths(evaluation_at(points)).max(1)

    def largest_growths(self, points: Points) -> np.ndarray:
        """The largest growths (m,) of a small change from the start of an arc to any place of the motions at points."""
        return points.evaluation.largest_growth[points.places] if self.division is None else self.growths(points)

    def asks_for_nodes(self, points: Points) -> np.ndarray:
        """Whether the motions at certified points (m,) are divided at nodes, or divided again, from there on."""
        growths = growths_without_nodes(self.division, points.evaluation)[points.places]
        if not (self.takes_nodes and self.takes_nodes_early):
            return growths > DIVISION.arc_growth
        return are_divided(growths, points.own.column("error"), points.own.column("alpha"))

    def divided(
        self, x: np.ndarray, tangent: np.ndarray, evaluation: Evaluation
    ) -> tuple[Self, np.ndarray, np.ndarray]:
        """This curve with motions that are divided at nodes, in the number that they need at a point (n + 1,) with a
        tangent, where the equations are the evaluation (1); and there both (N + 1,), the tangent with no share of the
        nodes. Raises `NoOrbit`."""
        if not self.takes_nodes:
            raise NoOrbit("small changes grow too much, since the motions of this curve have no nodes")
        curve, p = copy(self), self.parameters_at(x[None])[0]
        undivided = self.division.undivided if self.division else self.equations
        along = growths_along(evaluation, counts_of_parts(self.division, undivided))
        evaluation, x, tangent = self.whole(evaluation), self.bare(x), self.bare(tangent)
        paths = [each[0] for each in evaluation.trajectories]
        curve.division, u = division_at(undivided, along, x[:-1], p, paths)
        curve.equations, curve.takes_nodes_early = curve.division.equations, True
        return curve, np.append(u, x[-1]), np.insert(tangent, undivided.own, np.zeros(len(u) + 1 - len(x)))

    def parameters_at(self, xs: np.ndarray) -> np.ndarray:
        """The parameters (m, np) at points (m, n + 1)."""
        values = np.empty((len(xs), len(self.parameters)))
        values[:], values[:, self.place] = self.parameters, xs[:, -1]
        return values

    def varied(self, p: np.ndarray) -> dict[str, float]:
        """The parameters (np,) that vary along the curve, by name."""
        return {self.along: float(p[self.place])}

    @property
    def also(self) -> tuple[str, ...]:
        """The names of what varies along the curve: parameters, and quantities that are prescribed."""
        return tuple(self.varied(self.parameters))

    def evaluate(self, xs: np.ndarray) -> Evaluation:
        """The equations at points (m, n + 1)."""
        return self.equations.evaluate_all(xs[:, :-1], self.parameters_at(xs), (self.along,))

    def evaluate_beside(self, xs: np.ndarray, known: Evaluation) -> Evaluation:
        """The equations at points (m, n + 1) so near to others, where they are `known`, that second derivatives are
        those there."""
        return self.evaluate(xs)

    @cached_property
    def hops(self) -> LosslessHops:
        """The map of launches near the orbits; raises `InputError` where a launch is one speed."""
        return LosslessHops(self.machine)

    @property
    def _ground(self) -> Planar | None:
        """The ground whose forces the certificates have, None where they have none."""
        return self.machine.model.planar if self.machine.model.reversor else None

    def stance_force(self, points: Points) -> np.ndarray:
        """The least force on what stands in flight at certified points (m,), `NONE` where it may be negative."""
        if self._ground is None:
            return np.full(len(points), NONE)
        judged = np.equal(points.own.column("stance_judged"), True)
        return np.where(judged, points.own.column("smallest_stance_force"), NONE)

    def friction_left(self, points: Points) -> np.ndarray:
        """What certified points (m,) leave of the stated friction, `NONE` where none is stated or a foot lifts."""
        planar = self._ground
        if planar is None or planar.friction is None:
            return np.full(len(points), NONE)
        needed = points.own.column("friction_needed")
        stated = planar.friction(dict(zip(self.names, self.parameters_at(points.xs).T, strict=True)))
        return np.where(needed == NONE, NONE, stated - needed)

    def others(self, points: Points) -> np.ndarray:
        """Matrices (m, d - 1, d - 1) whose eigenvalues are the multipliers besides that of the energy, at points."""
        return self._others(points.xs, self.whole(evaluation_at(points)))

    def _others(self, xs: np.ndarray, whole: Evaluation) -> np.ndarray:
        own = self.equations_of_orbits.own
        names = self.equations_of_orbits.statement.unknowns[:own]
        return self.hops.others(names, xs[:, :own], self.parameters_at(xs), whole)

    def evaluate_lanes(self, xs: np.ndarray) -> tuple[np.ndarray, Evaluation | None]:
        """The equations at those points (m, n + 1) whose motions can be followed: their indices (k,), and the equations
        there, None without any."""
        return self.equations.evaluate_lanes(xs[:, :-1], self.parameters_at(xs), (self.along,))

    @property
    def kernel(self) -> NewtonKernel | None:
        """Newton's method for points in one call; None where the motion has several arcs or no Taylor series, and where
        the table of a law's pieces depends on the parameter."""
        return newton_kernel(self.equations, self.along) if self.equations.in_lanes_along(self.along) else None

    def rescued(self, x: np.ndarray) -> np.ndarray:
        """A point (n + 1,) near another, with its value of the parameter, by Ipopt's multiple shooting."""
        return np.append(self.equations.multiple_shooting(x[:-1], self.parameters_at(x[None])[0])[0], x[-1])

    def certified(self, points: Points) -> tuple[Records[Point] | None, dict[int, OrbitsError]]:
        """The certified orbits of points up to the first that cannot be certified, None without any; and the error of
        that one and of all that follow it, by index."""
        solved, closing = self.solutions(points)
        found, refused = certified(solved, closing, quickly=True, refused=self._refused(solved.ps))
        end = min(refused, default=len(points))
        errors = {i: refused.get(i, refused[end]) for i in range(end, len(points))}
        if found is None or end == 0:
            return None, errors
        return self._points(points[:end], found.cycles, found.certificates), errors

    def solutions(self, points: Points) -> tuple[Solved, np.ndarray]:
        """The solutions (m, n) of the machine's own equations at points, and the rows (m, n + 1) that complete these
        equations for the measurement of errors."""
        xs = points.xs
        across, ps = points.tangents / self.size(xs) ** 2, self.parameters_at(xs)
        units = self.units_of_changes(self.size(xs), evaluation_at(points))
        folds = np.abs(points.tangents[:, -1]) < AT_A_FOLD * units[:, -1]
        closing = np.where(folds[:, None], across, np.eye(xs.shape[1])[-1])
        return self._solved(self.division, xs[:, :-1], ps, evaluation_at(points)), closing

    def _solved(self, division: Division | None, us: np.ndarray, ps: np.ndarray, evaluation: Evaluation) -> Solved:
        """The solutions (m, N) of the machine's own equations, with nodes where there is a division of them."""
        model, method, equations = self.machine.model, self.method, self.equations_of_orbits
        if division is None:
            return Solved(model, method, equations, us, ps, evaluation)
        by_nodes = Solved(model, method, division.equations, us, ps, evaluation)
        return Solved(model, method, equations, division.bare(us), ps, division.whole(evaluation), by_nodes=by_nodes)

    def _points(self, points: Points, cycles: Cycles, certificates: Records[Certificate]) -> Records[Point]:
        """The certified orbits of points, which are the first of some."""
        also = {name: cycles.p[name].tolist() for name in self.also if name != self.along}
        others = [dict(zip(also, row, strict=True)) for row in zip(*also.values(), strict=True)] or [{}] * len(points)
        found: dict[str, Any] = {
            **motion_numbers(self.machine.model, cycles),
            "certificate": certificates,
            "also": others,
        }
        own = {"value": points.values, "u": self.bare(points.xs)[:, :-1], "tangent": self.bare(points.tangents)}
        return Records(Point, own | {name: values[: len(points)] for name, values in found.items()})

    def _refused(self, ps: np.ndarray) -> dict[int, OrbitsError]:
        """The errors, by index, of those parameters (m, np) that are inadmissible for the machine."""
        # Parameters between two sets of values that the machine admits are admissible too.
        ends = (each for each in (ps.min(0), ps.max(0)) if not np.array_equal(each, self.parameters))
        if len(ps) > 2 and not any(self._refused(each[None]) for each in ends):
            return {}
        refused = {}
        for i, p in enumerate(ps):
            try:
                self.machine.with_values(**self.varied(p))
            except OrbitsError as error:
                refused[i] = error
        return refused

    def orbit(self, point: Points) -> Orbit:
        """The whole orbit at a certified point (1)."""
        machine, error = self.machine.with_values(**self.varied(self.parameters_at(point.xs)[0])), point.own[0].error
        if self.division is None:
            return orbit_from(machine, self.method, point.xs[0, :-1], error)
        solved, _ = self.solutions(point)
        return orbit_of_solved(machine, replace(solved, errors=np.array([error])))

    def units_at(self, value: Any, also: Mapping[str, Any] | None = None) -> Units | None:
        """The units at a value of the parameter, and at others that vary along the curve; None for a dimensionless
        machine."""
        units = self.machine.model.units
        return units and units({**self.machine.values, **(also or {}), self.along: value})

    def in_units(self, point: Point) -> Point:
        """A dimensionless point in the machine's units: in SI for a machine in SI."""
        return point_in_units(point, self.units_at(point.value, point.also))

    def all_in_units(self, points: Records[Point]) -> Records[Point]:
        """`in_units` of several points."""
        also, certificates = points.column("also"), points.column("certificate")
        units = self.units_at(
            points.column("value"), {name: np.array([each[name] for each in also]) for name in also[0]}
        )
        if units is None:
            return points
        each = enumerate(points.column("violations"))
        violations = [self.in_units(points[i]).violations if own else () for i, own in each]
        return units.convert(points.replaced(certificate=units.convert(certificates).replaced(violations=violations)))

    def dimensionless(self, point: Point) -> Point:
        """A point in the machine's units converted to the dimensionless form of the curve."""
        units = self.units_at(point.value, point.also)
        return point_in_units(point, units and units.inverse())


def check_followed(machine: Machine, *names: str) -> None:
    """Raise `InputError` for a name that is not a parameter of the machine, or that is a column of a table of
    orbits."""
    check_parameters(machine, *names)
    for name in names:
        if name in RESERVED_NAMES:
            raise InputError(f"a parameter called '{name}' has the name of a quantity of orbits; rename it")


def tuned_at(machine: Machine, point: Point, along: str) -> tuple[str, ...]:
    """The tuned parameters of the family along a name that a point belongs to."""
    square = len({*counts(machine.model, tuple(machine.values))}) == 1
    own = () if square and not is_quantity(machine, along) else point.also
    return tuple(name for name in own if name not in machine.model.fixed)


def values_at(machine: Machine, point: Point, along: str) -> dict[str, float]:
    """The values of the machine's parameters that vary along a name, at a point of the family."""
    own = {along: point.value} if along in machine.values else {}
    return {**(point.also if tuned_at(machine, point, along) else {}), **own}


def machine_at(machine: Machine, point: Point, along: str, method: str | None) -> tuple[Machine, str]:
    """The machine at a point of its family along a parameter, and the method: the simplest for None."""
    if not isinstance(point, Point):
        raise InputError("a branch must begin at the `point` of a family's event")
    check_followed(machine, *(() if is_quantity(machine, along) else (along,)))
    machine = machine.with_values(**values_at(machine, point, along))
    if tuned_at(machine, point, along):
        return machine, METHOD
    if along not in machine.values:
        raise InputError(
            f"along = {along!r} is not a parameter of the machine: name the one along which the family goes"
        )
    method = method or iterative(method_of(machine.model))
    if len(point.u) != equations_of(machine.model, method, tuple(machine.values)).size:
        raise InputError("this point was found by another method; pass that method")
    return machine, method
