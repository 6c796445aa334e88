"""The curve of a machine's orbits along a parameter: its equations, its points, and their certificates.

The curve is F(u, value) = 0, the equations that `find` solves, with their exact derivatives. A point of it is
X = (u, value), measured in units of its own size.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from ..consistency.accepted import check_parameters
from ..errors import InputError, OrbitsError
from ..flow.flow import OUT_OF_LAW
from ..model.machine import Machine
from ..periodic.certificate import Certificate, records
from ..periodic.certified import Solved, certified, orbit_from
from ..periodic.orbit import Orbit
from ..periodic.quantities import motion_numbers
from ..shooting.formulations import Cycles, equations_of, iterative, method_of
from ..shooting.newton_kernel import NewtonKernel, newton_kernel
from ..shooting.single_shooting import Evaluation, joined
from ..units import Units
from .point import RESERVED_NAMES, Point, point_in_units
from .predictor import around

# A point is at a fold where the tangent's component along the parameter is a smaller share than this. The value of the
# parameter does not determine the orbit there, and its error is measured across the curve.
AT_A_FOLD = 1e-3
# Functions of an orbit whose zeros are events, by name.
Watch = Mapping[str, Callable[[Orbit], float]]
# Test functions of a certified orbit, which change their sign at the event. They are None where they are not defined.
TEST_FUNCTIONS: dict[str, Callable[[Point], float | None]] = {
    "grazing": lambda point: 1.0 if (least := point.certificate.clearance) is None else least,
    "masses touch": lambda point: point.certificate.smallest_separation,
    "contact pulls": lambda point: None if point.contact_time is None else _smallest_force(point),
    "landing jerk": lambda point: -point.certificate.landing_jerk,
    "collapse": lambda point: -1.0 if point.contact_time is None and not _leaves_law(point) else 1.0,
    "law ends": lambda point: -1.0 if point.contact_time is None and _leaves_law(point) else 1.0,
}


def _leaves_law(point: Point) -> bool:
    """Whether the contact has no end because the motion leaves the range of a law, such as a measured table."""
    return any(OUT_OF_LAW in violation for violation in point.certificate.violations)


def _smallest_force(point: Point) -> float:
    return 1.0 if (least := point.certificate.smallest_contact_force) is None else least


class CurvePoint(NamedTuple):
    """A solved point of the curve; a certified one is a new object.

    x : (n + 1,), the unknowns and the parameter's value
    tangent : (n + 1,), of length 1 in units of the curve's size
    branch_test : determinant of the Jacobian bordered by the tangent, which changes its sign at a branch point
    evaluation, place : the equations at several solved points, and the index of this point among them
    length : length of the curve from the point before
    parts : number of points that the step ending here is divided into; 0 at a point that does not end a step
    certified : the orbit without its motion, None before it is certified
    """

    x: np.ndarray
    tangent: np.ndarray
    branch_test: float
    evaluation: Evaluation
    place: int
    length: float = 0.0
    parts: int = 0
    certified: Point | None = None

    @property
    def value(self) -> float:
        """The value of the parameter."""
        return float(self.x[-1])

    @property
    def amplification(self) -> float:
        """The largest growth of a small change over the motion."""
        return float(self.evaluation.amplification[self.place])

    @property
    def point(self) -> Point:
        """The certified orbit without its motion."""
        if self.certified is None:
            raise ValueError("this point of the curve is not certified")
        return self.certified


class StepEnd(NamedTuple):
    """The end of a step along the curve, whose motion is not known yet.

    x, tangent, length, parts : as of a `CurvePoint`
    amplification : the largest growth of a small change over the motion
    row : (n + 1,), which measures the length along the curve
    """

    x: np.ndarray
    tangent: np.ndarray
    amplification: float
    row: np.ndarray
    length: float = 0.0
    parts: int = 1

    @property
    def value(self) -> float:
        """The value of the parameter."""
        return float(self.x[-1])


class Curve:
    """The curve F(u, value) = 0 of a machine's orbits along a parameter, whose whole range `span` is its unit."""

    def __init__(self, machine: Machine, along: str, method: str, span: float):
        self.machine, self.along, self.method, self.span = machine, along, method, span
        self.names, self.parameters = tuple(machine.values), np.array(list(machine.values.values()))
        self.equations = self.equations_of_orbits = equations_of(machine.model, method, self.names)
        self.place = self.names.index(along)

    def size(self, x: np.ndarray) -> np.ndarray:
        """The unit of each component at points (..., n + 1)."""
        size = np.abs(x)
        size[..., :-1] = np.maximum(size[..., :-1], 0.1 * size[..., :-1].max(-1, keepdims=True))
        size[..., -1] = self.span
        return size

    def parameters_at(self, xs: np.ndarray) -> np.ndarray:
        """The parameters (m, np) at points (m, n + 1)."""
        values = np.tile(self.parameters, (len(xs), 1))
        values[:, self.place] = xs[:, -1]
        return values

    def varied(self, p: np.ndarray) -> dict[str, float]:
        """The parameters (np,) that vary along the curve, by name."""
        return {self.along: float(p[self.place])}

    def evaluate(self, xs: np.ndarray) -> Evaluation:
        """The equations at points (m, n + 1)."""
        return self.equations.evaluate_all(xs[:, :-1], self.parameters_at(xs), (self.along,))

    @property
    def kernel(self) -> NewtonKernel | None:
        """Newton's method for points in one call; None where the motion has several arcs, or a law bends."""
        return newton_kernel(self.equations, self.along) if self.equations.in_lanes_along(self.along) else None

    def rescued(self, x: np.ndarray) -> np.ndarray:
        """A point (n + 1,) near another, with its value of the parameter, by Ipopt's multiple shooting."""
        return np.append(self.equations.multiple_shooting(x[:-1], self.parameters_at(x[None])[0])[0], x[-1])

    def certify(self, point: CurvePoint) -> CurvePoint:
        """The point, certified; raises the error when it cannot be certified."""
        if point.certified:
            return point
        certified, error = self.certify_all([point])
        if error:
            raise error
        return certified[0]

    def certify_all(self, points: Sequence[CurvePoint]) -> tuple[list[CurvePoint], OrbitsError | None]:
        """The points, certified, up to the first that cannot be certified, and its error."""
        if not points:
            return [], None
        solved, closing = self.solutions(points)
        found, refused = certified(solved, closing, quickly=True, refused=self._refused(solved.ps))
        end = min(refused, default=len(points))
        if found is None or end == 0:
            return [], refused[0]
        orbits = self._points(points[:end], found.cycles, found.certificates)
        return [point._replace(certified=orbit) for point, orbit in zip(points, orbits, strict=False)], refused.get(end)

    def solutions(self, points: Sequence[CurvePoint]) -> tuple[Solved, np.ndarray]:
        """The solutions (m, n) of the machine's own equations at points, and the rows (m, n + 1) that complete these
        equations for the measurement of errors."""
        xs = np.array([point.x for point in points])
        across, ps = np.array([point.tangent for point in points]) / self.size(xs) ** 2, self.parameters_at(xs)
        folds = np.abs(across[:, -1]) * self.span < AT_A_FOLD
        evaluations = []
        for _, group in groupby(points, key=lambda point: id(point.evaluation)):
            solved = list(group)
            indices, evaluation = np.array([point.place for point in solved]), solved[0].evaluation
            whole = np.array_equal(indices, np.arange(len(evaluation.jacobian)))
            evaluations.append(evaluation if whole else evaluation[indices])
        closing = np.where(folds[:, None], across, np.eye(xs.shape[1])[-1])
        return self._solved(xs[:, :-1], ps, joined(evaluations)), closing

    def _solved(self, us: np.ndarray, ps: np.ndarray, evaluation: Evaluation) -> Solved:
        return Solved(self.machine.model, self.method, self.equations_of_orbits, us, ps, evaluation)

    def _points(self, points: Sequence[CurvePoint], cycles: Cycles, certificates: Sequence[Certificate]) -> list[Point]:
        """The certified orbits of the first of some points."""
        xs, tangents = (np.array([getattr(point, name) for point in points]) for name in ("x", "tangent"))
        also = {name: cycles.p[name].tolist() for name in self.varied(self.parameters) if name != self.along}
        others = [dict(zip(also, row, strict=True)) for row in zip(*also.values(), strict=True)] or [{}] * len(points)
        columns = {**motion_numbers(self.machine.model, cycles), "certificate": certificates, "also": others}
        return records(
            Point,
            value=xs[:, -1].tolist(),
            u=map(tuple, xs[:, :-1].tolist()),
            tangent=map(tuple, tangents.tolist()),
            **{name: values[: len(points)] for name, values in columns.items()},
        )

    def _refused(self, ps: np.ndarray) -> dict[int, OrbitsError]:
        """The errors, by index, of those parameters (m, np) that are inadmissible for the machine."""
        # Parameters between two sets of values that the machine admits are admissible too.
        if len(ps) > 2 and not (self._refused(ps.min(0)[None]) or self._refused(ps.max(0)[None])):
            return {}
        refused = {}
        for i, p in enumerate(ps):
            try:
                self.machine.with_values(**self.varied(p))
            except OrbitsError as error:
                refused[i] = error
        return refused

    def orbit(self, point: CurvePoint) -> Orbit:
        """The whole orbit at a certified point."""
        machine = self.machine.with_values(**self.varied(self.parameters_at(point.x[None])[0]))
        return orbit_from(machine, self.method, point.x[:-1], point.point.error)

    def units_at(self, value: float, also: Mapping[str, float] | None = None) -> Units | None:
        """The units at a value of the parameter, and at others that vary along the curve; None for a dimensionless
        machine."""
        units = self.machine.model.units
        return units and units({**self.machine.values, **(also or {}), self.along: value})

    def in_units(self, point: Point) -> Point:
        """A dimensionless point in the machine's units: in SI for a machine in SI."""
        return point_in_units(point, self.units_at(point.value, point.also))

    def dimensionless(self, point: Point) -> Point:
        """A point in the machine's units converted to the dimensionless form of the curve."""
        units = self.units_at(point.value, point.also)
        return point_in_units(point, units and units.inverse())

    def certify_at(self, point: CurvePoint, value: float) -> CurvePoint:
        """A point whose parameter is `value` up to rounding, certified with exactly that value."""
        return self.certify(point._replace(x=np.append(point.x[:-1], value), certified=None))


def interpolated(points: Sequence[CurvePoint | StepEnd], row: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Places (m, n + 1) at levels (m,) of the polynomial through points of a curve with their tangents."""
    xs, tangents, count = np.array([p.x for p in points]), np.array([p.tangent for p in points]), len(points)
    return around(xs, tangents, np.full(len(levels), count), count, 0, np.tile(row, (len(levels), 1)), levels)[0]


def check_followed(machine: Machine, *names: str) -> None:
    """Raise `InputError` for a name that is no parameter of the machine, or that is a column of a table of orbits."""
    check_parameters(machine, *names)
    for name in names:
        if name in RESERVED_NAMES:
            raise InputError(f"a parameter called '{name}' cannot be told from the orbit's own; give it another name")


def machine_at(machine: Machine, point: Point, along: str, method: str | None) -> tuple[Machine, str]:
    """The machine at a point of its family along a parameter, and the method: the simplest for None."""
    check_followed(machine, along)
    if not isinstance(point, Point):
        raise InputError("where to begin is the `point` of a family's event")
    machine = machine.with_values(**{along: point.value})
    method = method or iterative(method_of(machine.model))
    if len(point.u) != equations_of(machine.model, method, tuple(machine.values)).size:
        raise InputError("this point was found by another method; give that method")
    return machine, method
