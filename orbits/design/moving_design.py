"""A design problem with one number that moves: a bound of a constraint or of a parameter, or a further parameter.

The unknowns x are the changes of the designed parameters from those at the start, as shares of their ranges or, where
these span decades, of their logarithms; and s is the share of the way that the number has gone. First derivatives are
exact by the implicit function theorem, and second derivatives are differences of these. Newton's method then converges
to the same points, though not quadratically: each step is a hundred thousand times shorter than the one before.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..errors import InputError, NoOrbit, OrbitsError
from ..model.machine import Machine, free_parameters
from ..numerics.kkt_conditions import FirstDerivatives, SecondDerivatives
from ..numerics.kkt_curve import CurveEnd
from ..numerics.kkt_limits import CriticalPoint
from ..numerics.roots import Array
from ..periodic.orbit import Orbit
from ..running import interrupts
from ..symbolic.formula import suggest
from .active_set import ACTIVE, ActiveRow, multipliers_of
from .design_point import DEMAND_MARGIN, Case, DesignPoint, design_points
from .design_quantities import extremes_of
from .extremes import Place, peaks_of
from .problem import Constraint, DesignProblem, Outputs
from .tuned_machine import motions_near, tuned_numbers, unknowns_of

# The ends of curves in words.
ENDS_OF_DESIGNS = {
    "fold": "the optimum meets a saddle, and there is none near it beyond",
    "bifurcation": "the optimum becomes a saddle",
    "infeasible": "the constraints exclude each other beyond",
    "degenerate": "the active constraints depend on each other, or the optimum is not a strict one",
    "stuck": "no optimum is found near the last one",
    "stopped": "the curve has very many points",
}
# The unit of a further parameter is the way that it goes, or this share of its size if that is more: second derivatives
# are differences over small shares of it.
LEAST_WAY = 0.1
# Derivatives within this distance of a design that was evaluated follow from its own: they differ by its square, and by
# the error of second derivatives times it. So many designs are remembered.
NEXT_TO, REMEMBERED = 3e-8, 128
# Designs that were tried and not reached within this distance of the end of a curve show why it ends.
BESIDE_AN_END = 1e-2
AT_TWO_PLACES = "an extreme at two places"
# Places of the motion whose values differ by no more than the first share of these may be the same beside a point, and
# are the same at it by the second. Where the derivatives of both agree to the third, they are images of each other.
BESIDE_ANOTHER, SAME_EXTREME, IMAGE_OF_PLACE = 1e-2, 1e-7, 1e-7
LONGEST_WAY = 1e100  # of a bound, in ranges of its parameter: the square of the way is a number
SAME_TIME_OF_PLACE = 1e-6  # times of one place of a motion differ by no more, where they are found in two ways
ON_BOUND_OF_CURVE = 1e-11  # a parameter nearer to its bound than this share of its unit is put on it, as it is active


@dataclass(frozen=True)
class Moving:
    """The number that moves.

    text : the constraint or the bound as stated, or the name of the parameter
    begin, end : its first and last values
    constraint : the index of the constraint, and `sides` whether its lower and its upper bound move; None for no
        constraint
    parameter : the index of the parameter whose bound moves, its lower one for `sides` (True, False); None for none
    """

    text: str
    begin: float
    end: float
    constraint: int | None = None
    parameter: int | None = None
    sides: tuple[bool, bool] = (False, False)

    @property
    def label(self) -> str:
        """What stands before the number: "stroke <=" or the name of the parameter."""
        return self.text if self.of_machine else self.text.rsplit(" ", 1)[0]

    @property
    def of_machine(self) -> bool:
        """Whether it is a parameter of the machine."""
        return self.constraint is None and self.parameter is None

    def value(self, s: float) -> float:
        """The number at a share of its way."""
        return (self.end if s else self.begin) if s in (0.0, 1.0) else self.begin + s * (self.end - self.begin)

    def at(self, problem: DesignProblem, value: float) -> DesignProblem:
        """The problem with this value of the number, without that of a parameter of the machine."""
        if self.of_machine or value == self.begin:
            return problem
        if self.constraint is not None:
            old = problem.constraints[self.constraint]
            moved = zip(self.sides, (old.low, old.high), strict=True)
            low, high = (value if moves else bound for moves, bound in moved)
            new = Constraint(_bounded_text(old.formula.text, low, high), old.formula, low, high)
            i = self.constraint
            return replace(problem, constraints=(*problem.constraints[:i], new, *problem.constraints[i + 1 :]))
        bounds = [[*problem.low], [*problem.high]]
        bounds[self.sides.index(True)][self.parameter or 0] = value
        return replace(problem, low=tuple(bounds[0]), high=tuple(bounds[1]))


def _bounded_text(text: str, low: float, high: float) -> str:
    """A constraint in words."""
    if low == high:
        return f"{text} == {low:.9g}"
    below, above = f"{low:.9g} <= " if np.isfinite(low) else "", f" <= {high:.9g}" if np.isfinite(high) else ""
    return f"{text} >= {low:.9g}" if not above else f"{below}{text}{above}"


def moving_number(problem: DesignProblem, machine: Machine, what: str, end: float) -> Moving:
    """The number that a text names: a constraint of a problem, "k <= 5000" for the bound of a designed parameter, or a
    further parameter of the machine; raises `InputError` where it names none.
    """
    plain = lambda text: "".join(str(text).split())  # noqa: E731
    for i, each in enumerate(problem.constraints):
        if plain(what) == plain(each.text):
            finite = np.isfinite([each.low, each.high])
            if each.low < each.high and finite.all():
                raise InputError(f"'{what}' has two bounds: state it as two constraints, one for each, and follow one")
            sides = (bool(finite[0]), bool(finite[1]))
            return Moving(each.text, each.low if finite[0] else each.high, end, constraint=i, sides=sides)
    for i, (name, low, high) in enumerate(zip(problem.names, problem.low, problem.high, strict=True)):
        for bound, relation, sides in ((low, ">=", (True, False)), (high, "<=", (False, True))):
            if plain(what) == f"{name}{relation}{bound:g}":
                if not (end < high if sides[0] else end > low):
                    raise InputError(f"'{what}' to {end:g} leaves no room between the bounds {low:g} and {high:g}")
                if abs(end - bound) > LONGEST_WAY * (high - low):
                    raise InputError(f"to = {end:g}; a bound is followed by at most {LONGEST_WAY:g} times its range")
                return Moving(f"{name} {relation} {bound:g}", bound, end, parameter=i, sides=sides)
        if what == name:
            both = f"'{name} >= {low:g}' or '{name} <= {high:g}'"
            raise InputError(f"'{name}' is designed itself: follow one of its bounds, {both}, or another parameter")
    if what in tuned_numbers(machine):
        raise InputError(f"'{what}' is tuned: follow a prescribed quantity, or another parameter")
    if what in (names := free_parameters(machine)):
        machine.with_values(**{what: end})  # raises the machine's own error
        return Moving(what, machine.values[what], end)
    if isinstance(what, str) and what.isidentifier() and machine.units is not None:
        machine.with_values(**{what: end})  # raises the machine's own error
    known = suggest(what, [*(each.text for each in problem.constraints), *names])
    raise InputError(f"the design has no constraint, bound or parameter '{what}'{known}")


class Corner(NamedTuple):
    """An extreme that two places of the motion have: the values at the second one are constrained to be no more than
    those at the first, which stand for the extreme. It has the unit `size`."""

    extreme: str
    first: Place
    second: Place
    size: float

    def swapped(self) -> "Corner":
        """The same with the second place for the extreme."""
        return self._replace(first=self.second, second=self.first)


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

    Its constraints are those of the problem as shares of their sizes, the demands of a motion, the differences between
    two places of an extreme, and the bound of a parameter that moves; in each the number is subtracted that moves, so
    that all limits stay. At the corner where an extreme is at two places, the largest of both is least where the
    multipliers of both, y at the second and the rest of the extreme's own at the first, are not negative.

    problem : with the number at its first value
    flat : whether each parameter (k,) has no effect; its value stays
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
        self.problem, self.moving, self.flat, self.sizes = problem, moving, flat, sizes
        self.machine, self.begin, self.size = first.machine, problem.theta(first.machine), abs(first.values[0]) or 1.0
        self.free, self.frame, over, self.reason = np.flatnonzero(~flat), problem, problem.names, ""
        self.missed: list[Array] | None = None
        self.corners = tuple(corners)
        if moving.of_machine:
            least, most = sorted((moving.begin, moving.end))
            room = max(0.5 * (LEAST_WAY * max(abs(least), abs(most)) - (most - least)), 0.0)
            over = (*over, moving.text)
            low, high = (*problem.low, least - room), (*problem.high, most + room)
            self.frame = replace(problem, names=over, low=low, high=high)
        formulas = problem.formula, *(constraint.formula for constraint in problem.constraints)
        self.outputs = Outputs(formulas, over, tuple(demands))
        self.family = first.orbit.family if first.machine.model.one_speed else None
        self.first_design, z = first, np.append(self.unknowns(first.machine), 0.0)
        self.known = self._known(near.z, near.design) if near else self._known(z, first)

    @property
    def limits(self) -> tuple[Array, Array]:
        """The lower and the upper limits of the unknowns (n,) and of the constraints (m,)."""
        problem, moving = self.problem, self.moving
        bounds = np.array([problem.change(self.begin, np.array(each)) for each in (problem.low, problem.high)])
        limits = np.array([(each.low, each.high) for each in problem.constraints]).reshape(-1, 2).T / self.sizes
        demanded, own = np.tile([[DEMAND_MARGIN], [np.inf]], len(self.outputs.demands)), np.empty((2, 0))
        tied = np.tile([[-np.inf], [0.0]], len(self.corners))
        if moving.constraint is not None:
            limits[np.array(moving.sides), moving.constraint] = 0.0
        if moving.parameter is not None:
            bounds[np.array(moving.sides), moving.parameter] = np.array([-np.inf, np.inf])[np.array(moving.sides)]
            own = np.where(np.array(moving.sides), 0.0, [-np.inf, np.inf])[:, None]
        low, high = np.hstack([bounds[:, self.free], limits, demanded, tied, own])
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
        if index - n == self.moving.constraint:
            return self.moving.label
        names += [f"{name} > 0" for name in self.outputs.demands]
        names += [AT_TWO_PLACES for _ in self.corners]
        return [*names, self.moving.label][index - n]

    def in_words(self, end: CurveEnd, last: CriticalPoint) -> str:
        """The end of a curve whose last point is known."""
        where = f"{self.moving.label} {self.value(last.value):.6g}"
        if jumps := self._jumping(last):
            return f"beyond {where} the {jumps} is at another place of the motion, and no design near these is best"
        if self.reason and end.kind == "stuck":
            return f"beyond {where}: {self.reason}"
        if end.kind in ("fold", "infeasible") and len(np.flatnonzero(last.sides)) >= len(self.free):
            return self.excluded(last.value)
        return f"at {where}: {ENDS_OF_DESIGNS[end.kind]}"

    def off_corner(self, point: CriticalPoint, number: int) -> str:
        """In words that the designs at both sides of a corner are better than that at it."""
        where, name = f"{self.moving.label} {self.value(point.value):.6g}", self._quantity(self.corners[number].extreme)
        return f"at {where} the {name} is at two places of the motion, and designs at both sides are better: a jump"

    def excluded(self, s: float) -> str:
        """In words that the active constraints cannot be met beyond a share of the way."""
        where = f"{self.moving.label} {self.value(s):.6g}"
        return f"beyond {where} the constraints exclude each other: no design near these meets all of them"

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
        moved = near.models(self.frame.change(near.theta, self.frame.theta(machine)))
        return near.moved(moved[len(moved) - len(unknowns_of(machine, near.orbit)) :])

    def problem_at(self, s: float) -> DesignProblem:
        """The problem at a share of the way."""
        return self.moving.at(self.problem, self.value(s))

    def scales(self, point: DesignPoint) -> Array:
        """Scales of the objective, with its sign, the constraints, the landing jerk and the demands at a design."""
        ones = np.ones(len(point.demands))
        return np.array([self.problem.sign * self.size, *self.sizes, abs(point.values[1 + len(self.sizes)]), *ones])

    def with_more(
        self, near: ProgramPoint, demands: Sequence[str] = (), corners: Sequence[Corner] | None = None
    ) -> "MovingDesign":
        """The program with further demands, or with other corners, with a point of this one known."""
        own = self.corners_at(near.design) if corners is None else corners
        demands = (*self.outputs.demands, *demands)
        first = self.first_design
        return MovingDesign(self.problem, self.moving, first, self.flat, self.sizes, demands, own, near)

    @property
    def rows_of_corners(self) -> slice:
        """The places of the differences between two places of an extreme among the constraints."""
        count = len(self.sizes) + len(self.outputs.demands)
        return slice(count, count + len(self.corners))

    def corner_beside(
        self, at: ProgramPoint, before: ProgramPoint | None = None, share: float = BESIDE_ANOTHER
    ) -> Corner | None:
        """The extreme whose value at another place is nearest to the largest one, at a point, within a share of it, and
        that is no corner already; None where there is none. Its first place is that at a point `before`, if stated."""
        design, found = at.design, list[tuple[float, Corner]]()
        extremes = design.outputs.extremes(design.machine.model, design.machine.values)
        for extreme in (name for name in extremes if name not in [corner.extreme for corner in self.corners]):
            (largest, first), *others = peaks_of(design.machine, design.orbit, extreme)
            size = abs(largest) or 1.0
            for value, place in others:
                corner = Corner(extreme, first, place, size)
                if largest - value <= share * size and self._is_corner(design, corner):
                    found.append(((largest - value) / size, corner))
                    break
        if not found:
            return None
        _, corner = min(found, key=lambda each: each[0])
        known = [place for place in (before or at).design.places if place.kind.extreme == corner.extreme][:1]
        far = [[(p.kind != c.kind, abs(p.time - c.time)) for p in known] for c in (corner.first, corner.second)]
        return corner.swapped() if far[1] < far[0] else corner

    def corner_between(self, before: ProgramPoint, after: ProgramPoint, point: CriticalPoint) -> Corner | None:
        """An extreme with a weight at a point that is at another place there than at the one before, while both places
        are on both motions; None where there is none."""
        old = {place.kind.extreme: place for place in before.design.places}
        own, known = after.design, {corner.extreme for corner in self.corners}
        changed = [p for p in own.places if p.kind.extreme not in known and p.kind != old[p.kind.extreme].kind]
        rows = point.multipliers[len(self.free) :]
        stated = [each.formula for each, y in zip(self.problem.constraints, rows, strict=False) if y]
        used = set[str]().union(*(formula.names for formula in [self.problem.formula, *stated]))
        used |= {name for name, y in zip(self.outputs.demands, rows[len(self.sizes) :], strict=False) if y}
        weighty = {extreme for name in used for extreme in extremes_of(name)}
        for second in (place for place in changed if place.kind.extreme in weighty):
            extreme, first = second.kind.extreme, old[second.kind.extreme]
            at, now = (peaks_of(each.machine, each.orbit, extreme) for each in (before.design, own))
            corner = Corner(extreme, first, second, abs(now[0][0]) or 1.0)
            both = second.kind in [p.kind for _, p in at] and first.kind in [p.kind for _, p in now]
            if both and self._is_corner(own, corner):
                return corner
        return None

    def _is_corner(self, design: DesignPoint, corner: Corner) -> bool:
        """Whether the derivatives at two places of an extreme differ, so that these are no images of each other."""
        (point,) = design_points([self.case((design.machine, design.orbit), [corner])])
        if isinstance(point, OrbitsError):
            return False
        slopes = point.slopes[point.tied] * self.frame.units(point.theta)
        return bool((np.abs(slopes) > IMAGE_OF_PLACE * corner.size).any())

    def active_corners(self, point: CriticalPoint) -> list[int]:
        """The numbers of the corners at which a point lies."""
        first = len(self.free) + self.rows_of_corners.start
        return [i for i in range(len(self.corners)) if point.sides[first + i]]

    def swapped_at(self, at: CriticalPoint, number: int) -> "tuple[MovingDesign, Array]":
        """The program in which the second place of a corner of this number stands for the extreme, and the multipliers
        at a point that lies there: that of the corner is now what the extreme has at its first place."""
        near, row, n = self.nearest(at.x, at.value), self.rows_of_corners.start + number, len(self.free)
        corners = [c.swapped() if i == number else c for i, c in enumerate(self.corners_at(near.design))]
        other, multipliers = self.with_more(near, corners=corners), at.multipliers.copy()
        multipliers[n + row] = 0.0
        point = other._at(at.x, at.value)
        slope, gradient = _first_of(point, multipliers[n:]).gradient + multipliers[:n], point.slopes[1 + row, :n]
        multipliers[n + row] = -float(slope @ gradient) / (float(gradient @ gradient) or 1.0)
        return other, multipliers

    def place_beyond(self, near: ProgramPoint) -> str:
        """The quantity whose extreme is neither at the first nor at the second place of a corner, at a point; "" for
        none."""
        design = near.design
        for corner in self.corners_at(design):
            found = peaks_of(design.machine, design.orbit, corner.extreme)
            both = corner.first, corner.second
            own = [value for value, place in found if any(_same_place(place, known) for known in both)]
            if not own or found[0][0] > max(own) + SAME_EXTREME * corner.size:
                return self._quantity(corner.extreme)
        return ""

    def _quantity(self, extreme: str) -> str:
        """The quantity that is made of an extreme, in words."""
        names = self.outputs.quantities(self.machine.model, self.machine.values)
        return next(name.replace("_", " ") for name in names if extreme in extremes_of(name))

    def corners_at(self, design: DesignPoint) -> tuple[Corner, ...]:
        """The corners with their places at a design of this program."""
        both = [[place for place in design.places if place.kind.extreme == corner.extreme] for corner in self.corners]
        pairs = zip(self.corners, both, strict=True)
        return tuple(corner._replace(first=own[0], second=own[1]) if own[1:] else corner for corner, own in pairs)

    def corners_near(self, point: CriticalPoint) -> list[Corner]:
        """The corners at which a point lies, or which it has just reached or left; the place that comes first does so
        whichever stands for the extreme, so that the multipliers along a curve are of one difference."""
        near = self.nearest(point.x, point.value)
        held = zip(self.corners_at(near.design), near.values[1:][self.rows_of_corners], strict=True)
        return [min(each, each.swapped()) for each, difference in held if difference >= -ACTIVE]

    def case(self, motion: tuple[Machine, Orbit], corners: Sequence[Corner]) -> Case:
        """The outputs at a machine with its orbit, where extremes have corners."""
        ties, firsts = {each.extreme: each.second for each in corners}, {each.extreme: each.first for each in corners}
        return Case(*motion, self.outputs, ties, firsts)

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
        if self.moving.of_machine and s not in (0.0, 1.0):
            return float(self.frame.changed(self._with(self.moving.begin), s * self._way)[-1])
        return self.moving.value(s)

    def rate(self, s: float) -> float:
        """The derivative of the number by the share."""
        if self.moving.of_machine:
            return float(self._way[-1] * self.frame.units(self._with(self.value(s)))[-1])
        return self.moving.end - self.moving.begin

    def unknowns(self, machine: Machine) -> Array:
        """The unknowns (n,) at a machine."""
        return self.problem.change(self.begin, self.problem.theta(machine))[self.free]

    def machine_at(self, x: Array, s: float) -> Machine:
        """The machine at unknowns (n,), on the bounds of the problem there where it is next to them."""
        change, value = np.zeros(len(self.begin)), self.value(s)
        change[self.free] = x
        problem = self.moving.at(self.problem, value)
        theta, near = self.problem.changed(self.begin, change), ON_BOUND_OF_CURVE * self.problem.units(self.begin)
        for bound in (np.array(problem.low), np.array(problem.high)):
            theta = np.where(np.abs(theta - bound) <= near, bound, theta)
        own = {self.moving.text: value} if self.moving.of_machine else {}
        return self.machine.with_values(**dict(zip(problem.names, theta.tolist(), strict=True)), **own)

    def _jumping(self, last: CriticalPoint) -> str:
        """The first quantity whose extreme is at another place right beyond a point of a curve; "" for none."""
        z = np.append(last.x, last.value)
        beside = [each.design for each in self.known if np.abs(each.z - z).max() <= BESIDE_AN_END]
        own = self.nearest(last.x, last.value).design
        kinds = {place.kind.extreme: place.kind for place in own.places}
        changed = {p.kind.extreme for each in beside for p in each.places if p.kind != kinds.get(p.kind.extreme)}
        names = own.outputs.quantities(own.machine.model, own.machine.values)
        return next((name.replace("_", " ") for name in names if changed.intersection(extremes_of(name))), "")

    def _known(self, z: Array, design: DesignPoint) -> list[ProgramPoint]:
        """The program at a design that is known."""
        (found,) = self._points([z], [(design.machine, design.orbit)], [None])
        if isinstance(found, OrbitsError):
            raise found
        return [found]

    def _with(self, value: float) -> Array:
        """The parameters at the start, and the number."""
        return np.append(self.begin, value)

    @property
    def _way(self) -> Array:
        """The change of the parameters at the start, and of the number, over the whole way."""
        return self.frame.change(self._with(self.moving.begin), self._with(self.moving.end))

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
        lost = NoOrbit("no orbit of the family is found near that of the design before")
        return [found.get(i, lost) for i in range(len(zs))]

    def _points(
        self, zs: Sequence[Array], motions: Sequence[tuple[Machine, Orbit]], nearest: Sequence[DesignPoint | None]
    ) -> list[ProgramPoint | OrbitsError]:
        """The program at machines with their orbits, and the designs nearest to them where corners are known."""
        corners = [self.corners_at(near) if near else self.corners for near in nearest]
        cases = [self.case(motion, own) for motion, own in zip(motions, corners, strict=True)]
        found = list[ProgramPoint | OrbitsError]()
        for z, point in zip(zs, design_points(cases, self.frame, closely=True), strict=True):
            if isinstance(point, OrbitsError):
                found.append(point)
            elif np.isfinite(point.values).all() and np.isfinite(point.slopes).all():
                found.append(ProgramPoint(z, *self._rows(point, z), point))
            else:
                found.append(NoOrbit(f"'{self.problem.text}' or a constraint has no finite value or slope"))
        return found

    def _rows(self, point: DesignPoint, z: Array) -> tuple[Array, Array, Array]:
        """The values, slopes and bends of the program at a design."""
        problem, moving, n = self.problem, self.moving, len(self.free)
        sizes = np.concatenate([[self.size * problem.sign], self.sizes])
        # A demand that the orbit does not have is met.
        known = [*range(len(sizes)), *(1 + len(sizes) + point.demands.index(name) for name in point.demands)]
        rows = [*range(len(sizes)), *(len(sizes) + self.outputs.demands.index(name) for name in point.demands)]
        tied, first = [*range(len(point.values))][point.tied], 1 + self.rows_of_corners.start
        known, rows = [*known, *tied], [*rows, *range(first, first + len(tied))]
        count = first + len(self.corners) + (moving.parameter is not None)
        values, slopes, bends = np.ones(count), np.zeros((count, n + 1)), np.zeros((count, n + 1, n + 1))
        columns = [*self.free, len(self.flat)] if moving.of_machine else [*self.free]
        places, way = range(len(columns)), np.append(np.ones(n), self._way[-1:] if moving.of_machine else [])
        scales = np.append(sizes, np.ones(len(known) - len(sizes) - len(tied)))
        scales = np.append(scales, [-corner.size for corner in self.corners])  # the first one less the second
        models, here = point.models, np.ix_(rows, places)
        assert models is not None
        values[rows] = point.values[known] / scales
        slopes[here] = models.slopes[np.ix_(known, columns)] * way / scales[:, None]
        bends[np.ix_(rows, places, places)] = (
            models.bends[np.ix_(known, columns, columns)] * np.outer(way, way) / scales[:, None, None]
        )
        value, moved = self.value(z[-1]), moving.end - moving.begin
        if moving.constraint is not None:
            values[1 + moving.constraint] -= value / self.sizes[moving.constraint]
            slopes[1 + moving.constraint, n] -= moved / self.sizes[moving.constraint]
        if moving.parameter is not None:
            at = self.begin.copy()
            at[moving.parameter] = value
            rate = moved / problem.units(at)[moving.parameter]
            change = problem.change(at, problem.theta(point.machine))
            values[-1] = change[moving.parameter]
            slopes[-1, :n], slopes[-1, n] = self.free == moving.parameter, -rate
            bends[-1, n, n] = rate**2 * problem.wide[moving.parameter]
        return values, slopes, bends


def _same_place(one: Place, other: Place) -> bool:
    """Whether two places of one motion are the same."""
    return one.kind == other.kind and abs(one.time - other.time) <= SAME_TIME_OF_PLACE * (1 + one.time)


def _first_of(found: ProgramPoint, y: Array) -> FirstDerivatives:
    """The first derivatives of the cost with constraints and their multipliers (m,) at a point."""
    slopes = found.slopes[0] + y @ found.slopes[1:]
    return FirstDerivatives(float(found.values[0]), slopes[:-1], found.values[1:], float(slopes[-1]))
