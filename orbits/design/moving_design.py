"""A design problem with one number that moves, as a nonlinear program whose minima are followed.

The unknowns x are the changes of the designed parameters from those at the start, as shares of their ranges or, where
these span decades, of their logarithms; and s is the share of the way that the number has gone. First derivatives are
exact by the implicit function theorem, and second derivatives are differences of these. Newton's method then converges
to the same points, though not quadratically: each step is a hundred thousand times shorter than the one before.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..curves import CriticalPoint, End, FirstDerivatives, SecondDerivatives
from ..errors import InputError, NoOrbit, OrbitsError
from ..model import Machine
from ..numerics import Array
from ..periodic import Orbit
from ..running import interrupts
from .design_point import DEMAND_MARGIN, DesignPoint, design_points
from .design_problem import DesignProblem, Outputs
from .design_quantities import extremes_of
from .extreme_corners import Corner, Corners, jumping, quantity_with
from .moving_number import Moving
from .optimality import ACTIVE, AT_TWO_PLACES, ActiveRow, multipliers_of
from .tuned_machine import motions_near, unknowns_of

# The ends of curves in words.
ENDS_OF_DESIGNS = {
    "fold": "the optimum meets a saddle, and beyond it there is no optimum nearby",
    "bifurcation": "the optimum becomes a saddle",
    "infeasible": "the constraints exclude each other beyond",
    "degenerate": "the active constraints depend on each other, or the optimum is not a strict one",
    "stuck": "no optimum is found near the last one",
    "stopped": "the curve has very many points",
}
# Derivatives within this distance of a design that was evaluated follow from its own: they differ by its square, and by
# the error of second derivatives times it. So many designs are remembered.
NEXT_TO, REMEMBERED = 3e-8, 128
# Designs that were tried and not reached within this distance of the end of a curve show why it ends.
BESIDE_AN_END = 1e-2
ON_BOUND_OF_CURVE = 1e-11  # a parameter nearer to its bound than this share of its unit is put on it, as it is active


class ProgramPoint(NamedTuple):
    """The program at unknowns and share z (n + 1,): values (1 + m,), slopes (1 + m, n + 1) and bends (1 + m, n + 1,
    n + 1) of the objective and of the m constraints by z; and the design there."""

    z: Array
    values: Array
    slopes: Array
    bends: Array
    design: DesignPoint

    def moved(self, z: Array) -> "ProgramPoint":
        """The program at a place next to it."""
        change = z - self.z
        values = self.values + (self.slopes + 0.5 * self.bends @ change) @ change
        return self._replace(z=z, values=values, slopes=self.slopes + self.bends @ change)


class MovingDesign:
    """The program of a design problem with a moving number, about a design at the first value, for `MinimumCurve`.

    Its constraints are those of the problem as shares of their sizes, the demands of a motion, and the differences
    between two places of an extreme. The number is the bound of one of them, from which it is subtracted, so that all
    limits stay. At the corner where an extreme is at two places, the largest of both is least where the
    multipliers of both, y at the second and the rest of the extreme's own at the first, are not negative.

    stated : the problem with the number at its first value
    problem : that in which the number is the bound of constraint number `limit`, for which that of the parameter number
        `own` gives way
    flat : whether each stated parameter (k,) has no effect; its value stays
    sizes : of the constraints
    demands : quantities that must be positive on a motion
    corners : extremes that two places may have
    reason : why the last design that was tried has no derivatives
    missed : where derivatives were needed, for `evaluate`; None where they are evaluated at once
    """

    def __init__(
        self, problem: DesignProblem, moving: Moving, first: DesignPoint, flat: Array, sizes: Array,
        demands: Sequence[str] = (), corners: Sequence[Corner] = (), near: ProgramPoint | None = None,
    ):  # fmt: skip
        self.stated, self.moving, self.sizes, self.reason = problem, moving, sizes, ""
        self.problem, self.limit, self.own = moving.as_bound(problem)
        self.flat, added = flat, np.zeros(len(self.problem.names) - len(flat), bool)
        self.begin, self.free = self.problem.theta(first.machine), np.flatnonzero(~np.append(flat, added))
        self.machine, self.size = first.machine, abs(first.values[0]) or 1.0
        self.missed: list[Array] | None = None
        decades = moving.of_machine and bool(self.problem.wide[-1])
        self.ratio = float(np.log(moving.end / moving.begin)) if decades else 0.0
        self.outputs = Outputs(self.problem.formulas, self.problem.names, tuple(demands))
        self.corners = Corners(self.outputs, self.problem, tuple(corners))
        self.family = first.orbit.family if first.machine.model.one_speed else None
        self.first_design, z = first, np.append(self.unknowns(first.machine), 0.0)
        self.known = self._known(near.z, near.design) if near else self._known(z, first)

    @property
    def limits(self) -> tuple[Array, Array]:
        """The lower and the upper limits of the unknowns (n,) and of the constraints (m,)."""
        problem, sides = self.problem, np.array(self.moving.sides)
        bounds = np.array([problem.change(self.begin, np.array(each)) for each in (problem.low, problem.high)])
        limits = np.array([(each.low, each.high) for each in problem.constraints]).T / self.sizes
        limits[sides, self.limit] = 0.0
        if self.own is not None:
            bounds[sides, self.own] = np.array([-np.inf, np.inf])[sides]
        demanded = np.tile([[DEMAND_MARGIN], [np.inf]], len(self.outputs.demands))
        tied = np.tile([[-np.inf], [0.0]], len(self.corners.known))
        low, high = np.hstack([bounds[:, self.free], limits, demanded, tied])
        return low, high

    def text(self, index: int, point: CriticalPoint) -> str:
        """A limit, by its index among the unknowns and then the constraints, in words at a point where it is reached.
        The number that moves is left out."""
        n, names = len(self.free), [constraint.text for constraint in self.problem.constraints]
        if index < n:
            i, (low, high) = self.free[index], (each[index] for each in self.limits)
            upper = high - point.x[index] < point.x[index] - low
            bound = self.problem.high[i] if upper else self.problem.low[i]
            return f"{self.problem.names[i]} {'<=' if upper else '>='} {bound:g}"
        if index - n == self.limit:
            return self.moving.label
        names += [f"{name} > 0" for name in self.outputs.demands]
        names += [AT_TWO_PLACES for _ in self.corners.known]
        return names[index - n]

    def in_words(self, end: End, last: CriticalPoint) -> End:
        """The end of a curve whose last point is known, as one of designs."""
        where = f"{self.moving.label} {self.value(last.value):.6g}"
        z, own = np.append(last.x, last.value), self.nearest(last.x, last.value).design
        if jumps := jumping(own, [each.design for each in self.known if np.abs(each.z - z).max() <= BESIDE_AN_END]):
            text = f"beyond {where} the {jumps} moves to another place of the motion, and no nearby design is optimal"
            return End("jump", text)
        if self.reason and end.kind == "stuck":
            return End("stuck", f"beyond {where}: {self.reason}")
        if end.kind in ("fold", "infeasible") and len(np.flatnonzero(last.sides)) >= len(self.free):
            return self.excluded(last.value)
        return End(end.kind, f"at {where}: {ENDS_OF_DESIGNS[end.kind]}")

    def off_corner(self, point: CriticalPoint, number: int) -> End:
        """The end at a corner where the designs at both sides are better than that at it."""
        where, design = f"{self.moving.label} {self.value(point.value):.6g}", self.nearest(point.x, point.value).design
        name = quantity_with(design, [self.corners.known[number].extreme])
        text = f"at {where} the {name} is at two places of the motion, and designs on both sides are better: a jump"
        return End("jump", text)

    def excluded(self, s: float) -> End:
        """The end at a share of the way beyond which the active constraints cannot be met."""
        where = f"{self.moving.label} {self.value(s):.6g}"
        text = f"beyond {where} the constraints exclude each other: no nearby design meets all of them"
        return End("infeasible", text)

    def start(self) -> Array:
        """The multipliers (n + m,) of the limits at the start, by their sides."""
        first, n, (low, high) = self.known[0], len(self.free), self.limits
        values = np.concatenate([first.z[:n], first.values[1:]])
        gradients = np.vstack([np.eye(n), first.slopes[1:, :n]])
        reached = np.flatnonzero(np.minimum(values - low, high - values) <= ACTIVE)
        sides = np.where(high[reached] - values[reached] <= ACTIVE, 1.0, -1.0)
        rows = [
            ActiveRow("", side * gradients[i], 1.0, bool(low[i] == high[i]))
            for i, side in zip(reached.tolist(), sides.tolist(), strict=True)
        ]
        multipliers = np.zeros(len(values))
        multipliers[reached] = sides * multipliers_of(first.slopes[0, :n], rows)[0]
        return multipliers

    def nearest(self, x: Array, s: float) -> ProgramPoint:
        """The point that was evaluated nearest to unknowns and a share."""
        apart = np.abs(np.array([each.z for each in self.known]) - np.append(x, s)).max(axis=1)
        return self.known[int(apart.argmin())]

    def predicted(self, machine: Machine, near: DesignPoint) -> Array:
        """The unknowns of a machine's orbit by the models of a design nearby."""
        assert near.models is not None
        moved = near.models(self.problem.change(near.theta, self.problem.theta(machine)))
        return near.moved(moved[len(moved) - len(unknowns_of(machine, near.orbit)) :])

    def problem_at(self, s: float) -> DesignProblem:
        """The problem at a share of the way."""
        return self.moving.at(self.stated, self.value(s))

    def scales(self, point: DesignPoint) -> Array:
        """Scales of the objective, with its sign, the stated constraints, the landing jerk and the demands."""
        count, ones = len(self.stated.constraints), np.ones(len(point.demands))
        return np.array([self.problem.sign * self.size, *self.sizes[:count], abs(point.values[1 + count]), *ones])

    def with_more(
        self, near: ProgramPoint, demands: Sequence[str] = (), corners: Sequence[Corner] | None = None
    ) -> "MovingDesign":
        """The program with further demands, or with other corners, with a point of this one known."""
        own = self.corners.at(near.design) if corners is None else corners
        demands = (*self.outputs.demands, *demands)
        first = self.first_design
        return MovingDesign(self.stated, self.moving, first, self.flat, self.sizes, demands, own, near)

    @property
    def rows_of_corners(self) -> slice:
        """The places of the differences between two places of an extreme among the constraints."""
        count = len(self.sizes) + len(self.outputs.demands)
        return slice(count, count + len(self.corners.known))

    def weighty_extremes(self, point: CriticalPoint) -> set[str]:
        """The extremes of the quantities in the objective, and in the constraints that have a multiplier at a point."""
        rows = point.multipliers[len(self.free) :]
        stated = [each.formula for each, y in zip(self.problem.constraints, rows, strict=False) if y]
        used = set[str]().union(*(formula.names for formula in [self.stated.formula, *stated]))
        used |= {name for name, y in zip(self.outputs.demands, rows[len(self.sizes) :], strict=False) if y}
        return {extreme for name in used for extreme in extremes_of(name)}

    def active_corners(self, point: CriticalPoint) -> list[int]:
        """The numbers of the corners at which a point lies."""
        first = len(self.free) + self.rows_of_corners.start
        return [i for i in range(len(self.corners.known)) if point.sides[first + i]]

    def swapped_at(self, at: CriticalPoint, number: int) -> "tuple[MovingDesign, Array]":
        """The program in which the second place of a corner of this number stands for the extreme, and the multipliers
        at a point that lies there: that of the corner is now what the extreme has at its first place."""
        near, row, n = self.nearest(at.x, at.value), self.rows_of_corners.start + number, len(self.free)
        corners = [c.swapped() if i == number else c for i, c in enumerate(self.corners.at(near.design))]
        other, multipliers = self.with_more(near, corners=corners), at.multipliers.copy()
        multipliers[n + row] = 0.0
        point = other._at(at.x, at.value)
        slope, gradient = _first_of(point, multipliers[n:]).gradient + multipliers[:n], point.slopes[1 + row, :n]
        multipliers[n + row] = -float(slope @ gradient) / (float(gradient @ gradient) or 1.0)
        return other, multipliers

    def corners_near(self, point: CriticalPoint) -> list[Corner]:
        """The corners at which a point lies, or which it has just reached or left; the place that comes first does so
        whichever stands for the extreme, so that the multipliers along a curve are of one difference."""
        near = self.nearest(point.x, point.value)
        held = zip(self.corners.at(near.design), near.values[1:][self.rows_of_corners], strict=True)
        return [min(each, each.swapped()) for each, difference in held if difference >= -ACTIVE]

    def first(self, x: Array, p: float, y: Array) -> FirstDerivatives:
        """The first derivatives; raises `NoOrbit` where there is no design."""
        return _first_of(self._at(x, p), y)

    def second(self, x: Array, p: float, y: Array) -> SecondDerivatives:
        """The second derivatives, with the first; raises `NoOrbit` where there is no design."""
        found, n = self._at(x, p), len(x)
        bends = found.bends[0] + np.tensordot(y, found.bends[1:], 1)
        own = found.slopes[1:, :n], bends[:n, :n], bends[:n, n], found.slopes[1:, n]
        return SecondDerivatives(*own, _first_of(found, y))

    def evaluate(self, zs: Sequence[Array]) -> None:
        """Evaluate the program at several unknowns and shares (n + 1,) together, to be remembered; those where there is
        no design are left out."""
        self.known += [each for each in self._evaluated(zs) if isinstance(each, ProgramPoint)]

    def value(self, s: float) -> float:
        """The number at a share of its way; where it is a parameter over decades, along its logarithm."""
        if self.ratio and s not in (0.0, 1.0):
            return self.moving.begin * float(np.exp(self.ratio * s))
        return self.moving.value(s)

    def rate(self, s: float) -> float:
        """The derivative of the number by the share."""
        return self.ratio * self.value(s) if self.ratio else self.moving.end - self.moving.begin

    def unknowns(self, machine: Machine) -> Array:
        """The unknowns (n,) at a machine."""
        return self.problem.change(self.begin, self.problem.theta(machine))[self.free]

    def machine_at(self, x: Array, s: float) -> Machine:
        """The machine at unknowns (n,), on the bounds of the problem there where it is next to them."""
        change, value = np.zeros(len(self.begin)), self.value(s)
        change[self.free] = x
        problem, own = self.moving.at(self.stated, value), [value] if self.moving.of_machine else []
        theta, near = self.problem.changed(self.begin, change), ON_BOUND_OF_CURVE * self.problem.units(self.begin)
        for bound in (np.array([*problem.low, *own]), np.array([*problem.high, *own])):
            theta = np.where(np.abs(theta - bound) <= near, bound, theta)
        return self.machine.with_values(**dict(zip(self.problem.names, theta.tolist(), strict=True)))

    def _known(self, z: Array, design: DesignPoint) -> list[ProgramPoint]:
        """The program at a design that is known."""
        (found,) = self._points([z], [(design.machine, design.orbit)], [None])
        if isinstance(found, OrbitsError):
            raise found
        return [found]

    def _at(self, x: Array, s: float) -> ProgramPoint:
        """The program at a point, evaluated or moved from a point next to it; raises `NoOrbit` for none."""
        interrupts.heed()
        z, nearest = np.append(x, s), self.nearest(x, s)
        if np.abs(nearest.z - z).max() <= NEXT_TO:
            return nearest.moved(z)
        if self.missed is not None:
            self.missed.append(z)
            raise NoOrbit("the design is not evaluated yet")
        (found,) = self._evaluated([z])
        if isinstance(found, OrbitsError):
            self.reason = str(found)
            raise found
        self.known = [*self.known[1 - REMEMBERED :], found]
        return found

    def _evaluated(self, zs: Sequence[Array]) -> list[ProgramPoint | OrbitsError]:
        """The program at points, with the orbits that the models of the designs nearest to them lead to."""
        machines, us, found = dict[int, Machine](), list[Array](), dict[int, ProgramPoint | OrbitsError]()
        nearest = [self.nearest(z[:-1], z[-1]).design for z in zs]
        for i, (z, near) in enumerate(zip(zs, nearest, strict=True)):
            try:
                machines[i] = self.machine_at(z[:-1], z[-1])
                us.append(self.predicted(machines[i], near))
            except InputError as error:  # a step led to numbers that the machine cannot have
                found[i] = NoOrbit(str(error))
        motions = motions_near([*machines.values()], us, [self.family] * len(us))
        these = {i: motion for i, motion in zip(machines, motions, strict=True) if motion}
        points = self._points([zs[i] for i in these], [*these.values()], [nearest[i] for i in these])
        found |= zip(these, points, strict=True)
        lost = NoOrbit("no orbit of the family is found near that of the previous design")
        return [found.get(i, lost) for i in range(len(zs))]

    def _points(
        self, zs: Sequence[Array], motions: Sequence[tuple[Machine, Orbit]], nearest: Sequence[DesignPoint | None]
    ) -> list[ProgramPoint | OrbitsError]:
        """The program at machines with their orbits, and the designs nearest to them where corners are known."""
        corners = [self.corners.at(near) if near else self.corners.known for near in nearest]
        cases = [self.corners.case(motion, own) for motion, own in zip(motions, corners, strict=True)]
        found = list[ProgramPoint | OrbitsError]()
        for z, point in zip(zs, design_points(cases, self.problem, closely=True), strict=True):
            if isinstance(point, OrbitsError):
                found.append(point)
            elif np.isfinite(point.values).all() and np.isfinite(point.slopes).all():
                found.append(ProgramPoint(z, *self._rows(point, z), point))
            else:
                found.append(NoOrbit(f"'{self.problem.text}' or a constraint has no finite value or slope"))
        return found

    def _rows(self, point: DesignPoint, z: Array) -> tuple[Array, Array, Array]:
        """The values, slopes and bends of the program at a design."""
        n, sizes = len(self.free), np.concatenate([[self.size * self.problem.sign], self.sizes])
        # A demand that the orbit does not have is met.
        known = [*range(len(sizes)), *(1 + len(sizes) + point.demands.index(name) for name in point.demands)]
        rows = [*range(len(sizes)), *(len(sizes) + self.outputs.demands.index(name) for name in point.demands)]
        tied, first = [*range(len(point.values))][point.tied], 1 + self.rows_of_corners.start
        known, rows = [*known, *tied], [*rows, *range(first, first + len(tied))]
        count = first + len(self.corners.known)
        values, slopes, bends = np.ones(count), np.zeros((count, n + 1)), np.zeros((count, n + 1, n + 1))
        scales = np.append(sizes, np.ones(len(known) - len(sizes) - len(tied)))
        scales = np.append(scales, [-corner.size for corner in self.corners.known])  # the first one less the second
        models = point.models
        assert models is not None
        values[rows] = point.values[known] / scales
        slopes[rows, :n] = models.slopes[np.ix_(known, self.free)] / scales[:, None]
        bends[rows, :n, :n] = models.bends[np.ix_(known, self.free, self.free)] / scales[:, None, None]
        row, size, rate = 1 + self.limit, self.sizes[self.limit], self.rate(z[-1])
        values[row] -= self.value(z[-1]) / size
        slopes[row, n], bends[row, n, n] = -rate / size, -self.ratio * rate / size
        return values, slopes, bends


def _first_of(found: ProgramPoint, y: Array) -> FirstDerivatives:
    """The first derivatives of the cost with constraints and their multipliers (m,) at a point."""
    slopes = found.slopes[0] + y @ found.slopes[1:]
    return FirstDerivatives(float(found.values[0]), slopes[:-1], found.values[1:], float(slopes[-1]))
