"""Curves of events in two parameters: orbits at which a formula of their quantities has a value or is stationary along
their family, or whose contact is about to collapse.

A point is X = (u, p, q): the unknowns u of the orbit, and of what the formula is made of, the parameter p of the
family, and a second one, q. With the equations F(u, p, q) = 0 and the formula e(u, p, q) the last equation is

    e - level = 0                      where the formula has a value,
    e_X . t = 0, with (F_u, F_p) t = 0   where it is stationary along the family; that of p itself is so at a fold.

All first derivatives are exact. Those of the second form need second derivatives of F and e along t alone, since by the
adjoint w of the equations d(e_X . t) = d/dt (e_X - w . F_X): they are central differences of exact first ones, to about
1e-9 of their size. Points are nevertheless exact to rounding, since the residual is.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..curves import CHANGES, Points, Test
from ..design import EventStatement
from ..errors import FlowError, NoOrbit
from ..hops import CROSSINGS, angles_left
from ..model import Machine, Model
from ..numerics import solve
from ..periodic import Certificate, Solved
from ..records import NONE, Records
from ..shooting import DIVISION, Cycles, Division, Evaluation, division_of, shooting_equations
from .curve import AT_A_FOLD, TEST_FUNCTIONS, Curve, TestFunction
from .curve_ends import Endings
from .point import End, Event, Point
from .tuned_curve import equations_of_family, values_of

# The step of central differences, in units of a point's size; along a family it is shorter where motions amplify small
# changes, since second derivatives belong to changes of their ends.
TANGENT_STEP = 1e-5
# The change of a test function by a step that is shorter than this is left to the next step.
SHORT_STEP = 1e-6
# A number of the certificate is the prescribed one where it differs by less, in units without dimensions.
AT_LIMIT = 1e-8
# The quantities that have to be positive on a motion, or negative, with the words of the violations, which are those of
# the model or the beginning of the text; and the test function that vanishes with each.
LIMITS = {
    "clearance": ("grazing", ("gap", "landing gap", "standing gap")),
    "smallest_separation": ("masses touch", ("separation",)),
    "smallest_contact_force": ("contact pulls", ("pull", "landed pull")),
    "landing_jerk": ("landing jerk", ("the gap opens the wrong way",)),
    "smallest_stance_force": ("foot lifts", ("stance",)),
    "friction_left": ("foot slides", ("it needs the friction",)),
}
COLLAPSE, ELSEWHERE = "collapse", "another place"


@dataclass(frozen=True)
class EventCondition:
    """What holds at the points of a curve of events.

    name : in words, as "fold" or "clearance = 0.1"
    text : of the formula; "" for a collapse
    level : its prescribed value, in the machine's units; None where it is stationary along the family
    crossing : the kind of crossing of the unit circle by multipliers that happens there; "" for none
    place : 1 where the formula is a dimensionless quantity, or one that vanishes, that is least at its place, -1 where
        it is largest, else 0
    """

    name: str
    text: str
    level: float | None = 0.0
    place: int = 0
    crossing: str = ""

    @property
    def stationary(self) -> bool:
        """Whether the formula is stationary along the family."""
        return self.level is None and not self.crossing

    @property
    def at_limit(self) -> bool:
        """Whether the curve is the limit of a condition of motions."""
        return not self.text or (self.text in LIMITS and self.level == 0)

    def tests(self) -> dict[str, TestFunction]:
        """The test functions of events on the curve: those of orbits that do not vanish on all of it, and whether the
        quantity takes its value at the place that is followed, and not at another one."""
        own = LIMITS[self.text][0] if self.text and self.at_limit else ""
        found = {kind: test for kind, test in TEST_FUNCTIONS.items() if kind != own}
        if not self.text:
            return {kind: found[kind] for kind in ("grazing", "landing jerk")}
        if self.place and self.level is not None and self.text in Certificate.__dataclass_fields__:
            found[ELSEWHERE] = lambda _, points: self.place * self.excess(points.own.column(self.text)) + AT_LIMIT
        return found

    def excess(self, numbers: np.ndarray) -> np.ndarray:
        """The differences (m,) of a dimensionless number from the prescribed one, 0 where there is none."""
        return np.where(numbers == NONE, 0.0, np.asarray(numbers) - (self.level or 0.0))

    def without_own(self, model: Model, points: Records[Point]) -> Records[Point]:
        """The points without the violations of the condition whose limit is the curve, which rounding decides."""
        if not self.at_limit:
            return points
        certificates = points.column("certificate")
        violations = [*certificates.column("violations")]
        if self.text:
            measured = self.text in Certificate.__dataclass_fields__
            near = np.abs(self.excess(points.column(self.text) if measured else np.zeros(len(points)))) < AT_LIMIT
            here = "\0"
            own = tuple(str(model.violations.get(word, word)) for word in LIMITS[self.text][1])
        else:  # nothing of the contact is known, which does not end
            near, here, own = np.full(len(points), True), "contact", (str(model.violations["end"]),)
            points = points.replaced(contact_time=np.full(len(points), NONE))
        for i in near.nonzero()[0].tolist():
            violations[i] = tuple(
                each for each in violations[i] if not (str(each).startswith(own) or here in str(each))
            )
        return points.replaced(certificate=certificates.replaced(violations=violations))


class EventCurve(Curve):
    """The curve of orbits at an event in two parameters; its points have the value of the first one too, which may be a
    quantity where parameters are tuned.

    tuned, tuned_sizes : names of tuned parameters, which are unknowns in front of the first parameter; and their sizes
    first : the value of the first parameter where the curve begins
    within : bounds of the first parameter, where the curve ends; None for none
    locates : whether the events of orbits are located along it
    """

    def __init__(
        self, machine: Machine, along: str, second: str, method: str, span: float, stated: EventStatement,
        condition: EventCondition, tuned: tuple[str, ...], tuned_sizes: np.ndarray, first: float,
        within: tuple[float, float] | None = None, locates: bool = True,
    ):  # fmt: skip
        self.machine, self.along, self.method, self.span, self.tuned = machine, second, method, span, tuned
        self.condition, self.within, self.first = condition, within, along
        self.takes_nodes = condition.place == 0  # the place of an extreme on a motion that hangs has few digits
        self.equations_of_orbits = equations_of_family(machine, method, along, tuned)
        self.names = self.equations_of_orbits.parameters
        self.parameters, self.place = values_of(machine, self.names), self.names.index(second)
        self.equations = self.undivided = shooting_equations(stated.statement, self.names)
        self.least_tuned = 0.1 * tuned_sizes  # the units of tuned parameters that pass zero
        # The unit of the first parameter is the distance of its bounds, or its value; of one that passes zero its first
        # value, or 1 when the first value is zero.
        self.least = within[1] - within[0] if within else 0.1 * abs(first) or 1.0
        self.own_settings = {"event": condition.name, "along": along}
        self.tests = condition.tests() if locates else {}

    def parameters_at(self, xs: np.ndarray) -> np.ndarray:
        return self.equations.with_tuned(xs, super().parameters_at(xs))

    def asks_for_nodes(self, points: Points) -> np.ndarray:
        found = super().asks_for_nodes(points)
        # Second derivatives, and their differences, grow as powers of first ones.
        if self.condition.stationary and self.takes_nodes and self.takes_nodes_early:
            found |= points.evaluation.amplification[points.places] > DIVISION.sensitive
        return found

    def begun_near(self, x: np.ndarray) -> tuple["EventCurve", np.ndarray]:
        """The curve and a place (n + 1,) near its first point, with nodes (N + 1,) where small changes grow much."""
        evaluation = super().evaluate(x[None])
        if not self.takes_nodes or evaluation.amplification[0] <= DIVISION.sensitive:
            return self, x
        curve, x, _ = self.divided(x, x, evaluation)
        return curve, x

    @property
    def division_of_orbits(self) -> Division | None:
        """That of the equations of the orbits, whose arcs are the first ones; None where those are not divided."""
        if self.division is None:
            return None
        parts = self.division.parts[: len(self.equations_of_orbits.flows)]
        return division_of(self.equations_of_orbits, parts) if max(map(len, parts)) > 1 else None

    def of_orbits(self, xs: np.ndarray) -> np.ndarray:
        """The unknowns (..., n) of the orbits with the states at their nodes, or their units, at points (..., N + 1),
        or from units."""
        own, division = self.equations_of_orbits.own, self.division_of_orbits
        parts = [xs[..., :own], xs[..., self.equations.own : self.equations.size - 1]]
        if division:
            begin = self.undivided.own
            parts.insert(1, xs[..., begin : begin + division.nodes.stop - division.nodes.start])
        return np.concatenate(parts, axis=-1)

    def at_orbits(self, xs: np.ndarray, vary: tuple[str, ...] = ()) -> Evaluation:
        """The equations of the orbits, with their nodes, at points (m, N + 1)."""
        division = self.division_of_orbits
        equations = division.equations if division else self.equations_of_orbits
        return equations.evaluate_all(self.of_orbits(xs), self.parameters_at(xs), vary)

    def bare_size(self, x: np.ndarray) -> np.ndarray:
        """The unknowns of the orbit as on any curve, the others as if they belonged to them, the tuned parameters, and
        the two parameters."""
        own, rest = self.equations_of_orbits.own, self.undivided.own
        size = super().bare_size(np.concatenate([x[..., :own], x[..., -1:]], axis=-1))
        others = np.maximum(np.abs(x[..., own:rest]), 0.1 * size[..., :own].max(-1, keepdims=True))
        tuned = np.maximum(np.abs(x[..., rest:-2]), self.least_tuned)
        first = np.maximum(np.abs(x[..., -2:-1]) * (self.within is None), self.least)
        return np.concatenate([size[..., :own], others, tuned, first, size[..., -1:]], axis=-1)

    def varied(self, p: np.ndarray) -> dict[str, float]:
        """The parameters of the machine that vary along the curve, by name."""
        return {name: float(p[self.names.index(name)]) for name in self.also if name in self.machine.values}

    @property
    def also(self) -> tuple[str, ...]:
        return self.along, *self.equations.statement.tuned

    @property
    def kernel(self) -> None:
        """None: the equations are solved step by step."""
        return None

    def rescued(self, x: np.ndarray) -> np.ndarray:
        raise NoOrbit("only Newton's method finds the orbits at an event")

    def evaluate(self, xs: np.ndarray) -> Evaluation:
        return self._evaluated(xs, None)

    def evaluate_beside(self, xs: np.ndarray, known: Evaluation) -> Evaluation:
        return self._evaluated(xs, known.jacobian[:, -1])

    def evaluate_lanes(self, xs: np.ndarray) -> tuple[np.ndarray, Evaluation | None]:
        which, _ = super().evaluate_lanes(xs)
        try:
            return which, self.evaluate(xs[which]) if len(which) else None
        except FlowError:  # at a place near a point
            return which[:0], None

    def _evaluated(self, xs: np.ndarray, slopes_of_last: np.ndarray | None) -> Evaluation:
        """The equations at points (m, N + 1), with the derivatives (m, N + 1) of the last one if they are known."""
        found = super().evaluate(xs)
        residual = found.residual.copy()
        if self.condition.crossing:
            jacobian = found.jacobian.copy()
            residual[:, -1] = self._crossing(xs, self.whole(found))
            jacobian[:, -1] = (
                self._slopes_of_crossing(xs, residual[:, :-1], jacobian[:, :-1])
                if slopes_of_last is None
                else slopes_of_last
            )
            return replace(found, residual=residual, jacobian=jacobian)
        if not self.condition.stationary:
            residual[:, -1] -= self.condition.level
            return replace(found, residual=residual)
        # From here on the unknowns and the first parameter are in units of their sizes.
        jacobian, size = found.jacobian.copy(), self.size(xs)[:, :-1]
        family = jacobian[:, :-1, :-1] * size[:, None]
        tangents, slopes = self._tangents(family), jacobian[:, -1, :-1] * size
        residual[:, -1] = np.einsum("mi,mi->m", slopes, tangents)
        if slopes_of_last is not None:
            jacobian[:, -1] = slopes_of_last
            return replace(found, residual=residual, jacobian=jacobian)
        bordered = np.concatenate([family, tangents[:, None]], axis=1)
        adjoint = solve(bordered.swapaxes(1, 2), slopes[:, :, None])[:, :-1, 0]
        lengths = TANGENT_STEP / np.maximum(found.amplification, 1.0)[:, None]
        moves = np.pad(lengths * tangents * size, ((0, 0), (0, 1)))
        beside = super().evaluate(np.concatenate([xs + moves, xs - moves])).jacobian
        ahead, behind = beside.reshape(2, *jacobian.shape)
        change = (ahead - behind) / (2 * lengths[:, :, None])
        jacobian[:, -1] = change[:, -1] - np.einsum("mi,mij->mj", adjoint, change[:, :-1])
        return replace(found, residual=residual, jacobian=jacobian)

    def _crossing(self, xs: np.ndarray, whole: Evaluation) -> np.ndarray:
        """The test function (m,) of the multipliers at points (m, N + 1), from the equations there without nodes."""
        return CROSSINGS[self.condition.crossing](self._others(xs, whole))

    def _slopes_of_crossing(self, xs: np.ndarray, residual: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        """Its derivatives (m, n + 1) in the directions of all that Newton's method may do, by central differences: the
        two in which the other equations, with this residual (m, n - 1) and Jacobian (m, n - 1, n + 1), do not change,
        and the shortest step to where they hold, unless that is so short that the next step makes up for it."""
        size = self.size(xs)[:, None]
        u, s, v = np.linalg.svd(jacobian * size)
        steps = (residual[:, None] @ u / s[:, None]) @ v[:, :-2]
        lengths = np.linalg.norm(steps, axis=2, keepdims=True)
        moved = lengths.max() > SHORT_STEP
        ways = np.concatenate([*([steps / lengths.clip(SHORT_STEP)] if moved else []), v[:, -2:]], axis=1)
        moves = TANGENT_STEP * ways * size
        beside = np.stack([xs[:, None] + moves, xs[:, None] - moves]).reshape(-1, xs.shape[1])
        # Derivatives by a parameter have all motions integrated together, which a closed form finds one by one.
        found, division = self.at_orbits(beside, (self.first,)), self.division_of_orbits
        whole = division.whole(found) if division else found
        ahead, behind = self._crossing(beside, whole).reshape(2, *ways.shape[:2])
        return np.einsum("mc,mcn->mn", (ahead - behind) / (2 * TANGENT_STEP), ways / size)

    @staticmethod
    def _tangents(jacobians: np.ndarray) -> np.ndarray:
        """The null vectors (m, n) of length 1 of Jacobians (m, n - 1, n), on one side of the curve throughout."""
        tangents = np.linalg.svd(jacobians)[2][:, -1]
        sides = np.sign(np.linalg.det(np.concatenate([jacobians, tangents[:, None]], axis=1)))
        return tangents * sides[:, None]

    def solutions(self, points: Points) -> tuple[Solved, np.ndarray]:
        """The solutions of the machine's own equations, with the errors measured along the first parameter, or across
        the family where that does not determine the orbit."""
        us, sizes = self.of_orbits(points.xs), self.size(points.xs)
        sizes = np.concatenate([self.of_orbits(sizes), sizes[:, -2:-1]], axis=1)
        evaluation = self.at_orbits(points.xs, (self.first,))
        closing = np.tile(np.eye(us.shape[1] + 1)[-1], (len(us), 1))
        tangents = self._tangents(evaluation.jacobian * sizes[:, None])
        folds = np.abs(tangents[:, -1]) < AT_A_FOLD
        closing[folds] = (tangents / sizes)[folds]
        return self._solved(self.division_of_orbits, us, self.parameters_at(points.xs), evaluation), closing

    def _points(self, points: Points, cycles: Cycles, certificates: Records[Certificate]) -> Records[Point]:
        return self.condition.without_own(self.machine.model, super()._points(points, cycles, certificates))


class EventEndings(Endings):
    """The tests for the end of a curve of events, which may leave the bounds of the first parameter too, or come to
    where a pair of multipliers becomes real."""

    curve: EventCurve
    kinds = BEYOND_LOW, BEYOND_HIGH, NEUTRAL_SADDLE = "below the first parameter", "above it", "neutral saddle"

    def tests(self) -> list[Test]:
        low, high = self.curve.within or (-np.inf, np.inf)
        tests = [
            Test(self.BEYOND_LOW, lambda _, points: points.xs[:, -2] - low, CHANGES, self._slope_of_first(low)),
            Test(self.BEYOND_HIGH, lambda _, points: high - points.xs[:, -2], CHANGES, self._slope_of_first(high)),
        ]
        tests = tests if self.curve.within else []
        if self.curve.condition.crossing == "Neimark-Sacker":
            angles = lambda problem, points: angles_left(problem.curve.others(points))  # noqa: E731
            tests.append(Test(self.NEUTRAL_SADDLE, angles, CHANGES))
        return tests

    def at(self, event: Event) -> End:
        (x,) = event.point.xs
        if event.kind == self.NEUTRAL_SADDLE:
            return End("degenerate", f"the pair becomes real: a neutral saddle beyond {x[-1]:.10g}")
        assert self.curve.within is not None
        return End("reached", f"{self.curve.first} = {self.curve.within[event.kind == self.BEYOND_HIGH]:g}")

    def asks(self, points: Points) -> np.ndarray:
        return super().asks(points) | self._grown(points.xs).any(1)

    def far(self, last: Points, passed: Sequence[Points]) -> End | None:
        if end := super().far(last, passed):
            return end
        own, names = self.curve.equations_of_orbits.own, self.curve.undivided.statement.unknowns
        for i in self._grown(last.xs)[0].nonzero()[0].tolist():
            return End(
                "escaped", f"the {names[own + i]} grows without bound near {self.curve.along} = {last.values[0]:.6g}"
            )
        return None

    def _grown(self, xs: np.ndarray) -> np.ndarray:
        """Whether the unknowns besides those of the orbit have grown beyond the ratio that counts as an escape."""
        own, ratio = self.curve.equations_of_orbits.own, self.control.escape_ratio
        return np.abs(self.curve.bare(xs)[:, own:-2]) > ratio * np.maximum(np.abs(self.first.u[own:-1]), 1.0)

    @staticmethod
    def _slope_of_first(bound: float) -> Callable[..., tuple[np.ndarray, np.ndarray]]:
        """The distance of the first parameter from a bound at points (m, n + 1), and its derivatives."""
        return lambda problem, xs, evaluation, number: (
            xs[:, -2] - bound,
            np.tile(np.eye(xs.shape[1])[-2], (len(xs), 1)),
        )
