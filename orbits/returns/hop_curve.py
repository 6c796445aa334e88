"""Hops that return as curves in all of their unknowns and a parameter: a problem of `orbits.curves` for each word.

The unknowns are those of each hop in turn, and the equations those of `hop_statement`; the last ones of a hop state
that the next launch, with the injection, is that of the hop behind it. A lossless hop is a regular point. Where a slack
of the word vanishes, the curve continues as that of another word, or ends: see `hop_borders`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from ..curves import ASKS, CHANGES, Barrier, Border, End, Event, Points, Problem, Start, Steps, Test, correct, solved_at
from ..errors import NoOrbit
from .hop_problem import HopProblem, HopValues
from .hop_statement import FORCE, Slack, Word
from .hops_along import INJECT, HopsAlong
from .periodic_launch import PeriodicLaunch, crossings, dominant

Array = np.ndarray
STEPS_OF_HOPS = Steps(
    first=1e-2, shortest=1e-8, corrected=0.2, turned=0.6, aim=1e-3, lengthen=4.0, beside=3, least=1, rough=1e-6,
    batch=64, rejections=100, most=5_000, last=1e-10,
)  # fmt: skip


class Tolerances(NamedTuple):
    """The tolerances of curves of hops.

    others : the unit of times and extensions, as a multiple of that of launches: the length of a curve is that in the
        launches and the parameter
    begun : the time of a flight after an impact when it begins and when it ends: in shorter ones rounding counts
    same_time : times that differ by a smaller share are the same
    lossless, force : a first landing of a lossless hop is slower, with a smaller force after it
    ahead : a step for differences, in the units of the unknowns
    together : derivatives are differences of at most this number of components together
    steps : of Newton's method to a border, at least
    at_fold : share of the parameter in the tangent at a fold, which is larger at a branch point
    at_bifurcation : multipliers farther from their value at a bifurcation jump there
    short_flight : a border is that of a short flight where it is reached by times up to this many times its own
    without_speed : share of the launch speed: slower landings without a force are those of lossless hops
    beside : a step along a tangent, to the sign of an infinite slope
    """

    others: float = 30.0
    begun: float = 1e-3
    same_time: float = 1e-6
    lossless: float = 1e-9
    force: float = 1e-2
    ahead: float = 1e-7
    together: int = 100
    steps: int = 4
    at_fold: float = 1e-5
    at_bifurcation: float = 1e-4
    short_flight: float = 20.0
    without_speed: float = 1e-5
    beside: float = 1e-4


TOLERANCES = Tolerances()


class HopCurve(HopProblem):
    """The curve of hops with a word that return.

    hops : the machines along the parameter
    word : the numbers of impacts
    between : range of launch speeds, in the machine's units
    border : what follows where a slack vanishes: (curve, point (1), slack) -> `Start`, `End` or None
    family : the curves of all words, to which this one is added
    """

    steps: Steps

    def __init__(
        self, hops: HopsAlong, word: Word, between: tuple[float, float], border: Callable, steps: Steps = STEPS_OF_HOPS,
        family: dict[Word, "HopCurve"] | None = None,
    ):  # fmt: skip
        super().__init__(hops, word, (hops.name,), hops.hop)
        self.between, self.border, self.steps, self.along = between, border, steps, hops.name
        self.family = {} if family is None else family
        self.family[word] = self
        unit = float(hops.units(np.array([float(hops.machine.values.get(self.along, 0.0))]))[0][0])
        self.scale = np.array([between[1] - between[0], hops.span])
        self.sizes = np.full(self.count + 1, TOLERANCES.others * self.scale[0] / unit)
        self.sizes[self.free] = self.scale[0] / unit * np.sqrt(self.period)
        self.sizes[-1] = self.scale[1]
        self.shared = np.array([self.speeds[0], self.count])
        self.tests = (
            *(
                Test(kind, partial(of_matrix, i), gradient=partial(_slope_of_matrix, i), confirmed=confirmed)
                for i, kind in enumerate(KINDS_OF_TESTS)
            ),
            Test("border", lambda _, points: slacks_at(points)[:, : self.exact], CHANGES, slope_of_slack),
            Test("touch", lambda _, points: slacks_at(points)[:, self.exact :], CHANGES),
            Test("left", inside, CHANGES, bare=True),
            Test("short", _is_long, ASKS),
        )

    def of(self, word: Word) -> "HopCurve":
        """The curve of another word."""
        if word not in self.family:
            HopCurve(self.hops, word, self.between, self.border, self.steps, self.family)
        return self.family[word]

    def size(self, lanes: Array, xs: Array) -> Array:
        return np.broadcast_to(self.sizes, xs.shape)

    def alphas(self, points: Points) -> Array:
        """The first launch speeds (m,) of points, in the machine's units."""
        return points.xs[:, self.speeds[0]] * self.hops.units(points.values)[0]

    def parameters(self, xs: Array) -> Array:
        return self.hops.parameters_at(xs[:, -1])

    def injection(self, xs: Array) -> tuple[Array, Array]:
        value, (unit, growing) = self.hops.inject, self.hops.units(xs[:, -1])
        injected = xs[:, -1] if self.along == INJECT else np.full(len(xs), value)
        return injected / unit, (((self.along == INJECT) - injected * growing / unit) / unit)[:, None]

    def close(self, values: HopValues, bends: Array) -> None:
        """For an even period of launches that are speeds, divide what the last equation is more than that of the middle
        of the hops by the difference of the launches, so that hops of half the period are solutions only at a flip,
        through which the curve goes smoothly."""
        if self.period % 2 or self.d > 1:
            return
        half, (xs, residual, jacobian) = self.period // 2, (values.xs, values.residual, values.jacobian)
        first, middle, (before, last) = self.free[0, 0], self.free[half, 0], self.last[[half - 1, -1], 0]
        apart = xs[:, middle] - xs[:, first]
        with np.errstate(divide="ignore", invalid="ignore"):
            residual[:, last] = (residual[:, last] - residual[:, before]) / apart
            jacobian[:, last] = (jacobian[:, last] - jacobian[:, before]) / apart[:, None]
            jacobian[:, last, middle] -= residual[:, last] / apart
            jacobian[:, last, first] += residual[:, last] / apart

    def certify(self, points: Points) -> tuple[Points, dict[int, Exception]]:
        """The points with their `PeriodicLaunch`es."""
        own, errors = np.empty(len(points), object), dict[int, Exception]()
        unit, growing = self.hops.units(points.values)
        found, places = points.evaluation, points.places
        matrices = self.matrices(found, places)
        slacks = np.column_stack([found.slacks[places], self.sampled(points)])
        launches = points.xs[:, self.free]
        alphas = launches[:, :, self.speed] * unit[:, None]
        speeds, ahead = launches[:, 0, self.speed], points.tangents
        rates = ahead[:, self.speeds[0]] * unit + growing * ahead[:, -1] * speeds
        ways = np.column_stack([rates, points.tangents[:, -1]]) / self.scale
        at = np.column_stack([alphas[:, 0], points.values]) / self.scale
        for i in range(len(points)):
            value = float(points.values[i])
            if not (launches[i, :, self.speed] > 0).all():
                errors[i] = NoOrbit(f"the hops have no launch near {self.along} = {value:g}")
            about = tuple(alphas[i].tolist()), dominant(matrices[i]), self.word, at[i], ways[i]
            known = {"launches": launches[i], "matrix": matrices[i], "slacks": slacks[i]}
            own[i] = PeriodicLaunch(value, *about, **known, x=points.xs[i], direction=points.tangents[i])
        return points.having(own=own, evaluation=found._replace(hops={})), errors  # without the motions

    def matrices(self, found: HopValues, places: Array) -> Array:
        """The derivatives (m, d, d) of the last launch by the first one, at places (m,)."""
        matrices = np.eye(self.d)
        for hop in range(self.period):
            slopes = found.slopes[places, hop]
            if self.hops.model.conservative:
                # A lossless hop has one-sided derivatives of higher order alone in the direction of the energy.
                lossless = (np.abs(found.first[places, hop]) <= [TOLERANCES.lossless, TOLERANCES.force]).all(1)
                slopes = np.where(lossless[:, None, None], 1.0 if self.d == 1 else np.nan, slopes)
            matrices = slopes @ matrices
        return matrices

    def barriers(self, lanes: Array, xs: Array, tangents: Array, lengths: Array) -> Mapping[int, Barrier]:
        """Where flights after impacts are about to vanish, without which the equations have no motions."""
        found = dict[int, Barrier]()
        for i, (x, tangent, length) in enumerate(zip(xs, tangents, lengths.tolist(), strict=True)):
            for k, *_ in self.later_flights:
                if tangent[k] < 0 and x[k] > (1.0 + TOLERANCES.same_time) * TOLERANCES.begun:
                    left = float((x[k] - TOLERANCES.begun) / -tangent[k])
                    if left <= length and (i not in found or left < found[i].left):
                        found[i] = ShortFlight(left, k, len(x))
        return found

    def changed(self, event: Event, passed: Sequence[Points]) -> Start | End | None:
        """What follows where a slack vanishes, a launch leaves the range, or a flight is about to vanish."""
        if event.kind == "left":
            return End("left", "")
        if event.kind == "short":
            hop, impact = self.shortest(event.point)
            return self.border(self, event.point, Slack(FORCE, hop, impact))
        return self.border(self, event.point, self.slacks[event.which + (event.kind == "touch") * self.exact])

    def shortest(self, point: Points) -> tuple[int, int]:
        """The hop and the impact before the shortest flight after an impact that becomes shorter at a point (1)."""
        falls = [(point.xs[0, k], hop, i) for k, hop, i in self.later_flights if point.tangents[0, k] < 0]
        _, hop, impact = min(falls)
        return hop, impact

    @cached_property
    def later_flights(self) -> list[tuple[int, int, int]]:
        """The places of the times of flights after impacts, with their hop and the impact before."""
        return [(self.time(hop, i), hop, i - 1) for hop, count in enumerate(self.word) for i in range(1, count)]

    def slopes(self, xs: Array) -> Array:
        """The derivatives (m, period, d, d) of each next launch at points X (m, n + 1); raises `NoOrbit`."""
        which, found = self.evaluate(np.zeros(len(xs), int), xs)
        if found is None or len(which) < len(xs):
            raise NoOrbit(f"the hops cannot be followed near {self.along} = {xs[0, -1]:g}")
        return found.slopes

    def solved(self, x: Array, row: Array, onward: Array) -> Points:
        """The point (1) of the curve near X (n + 1,) at the level of a row (n + 1,) through it; raises `NoOrbit`."""
        border = Border(row[None], (row @ x)[None])
        points = solved_at(self, np.zeros(1, int), x[None], border, onward[None], self.steps)
        if not len(points):
            raise NoOrbit(f"no hops return near {self.along} = {x[-1]:g}")
        return points

    def solved_at_border(self, x: Array, slack: Slack, onward: Array) -> Points:
        """The point (1) of the curve near X (n + 1,) at which a slack with a row vanishes, with the tangent along which
        it grows; raises `NoOrbit`."""
        k = self.slacks.index(slack)

        def bends(which: Array, xs: Array, evaluation: Any) -> tuple[Array, Array]:
            rows = evaluation.steps[:, k]
            return rows, (rows * xs).sum(1) - evaluation.slacks[:, k]

        border, zero = Border(np.zeros((1, len(x))), np.zeros(1), bends), np.zeros(1, int)
        # The first steps need not shrink: a border is guessed from places between samples.
        _, points = correct(self, zero, x[None], border, onward[None], self.steps, least=TOLERANCES.steps)
        points, errors = self.certify(points.having(lengths=np.zeros(len(points)))) if len(points) else (points, {})
        if not len(points) or errors:
            raise NoOrbit(f"no border is found near {self.along} = {x[-1]:g}")
        slope = points.evaluation.steps[points.places[0], k] @ points.tangents[0]
        return points if slope > 0 else turned(points)


KINDS_OF_TESTS = "flip", "branch point", "Neimark-Sacker"


def turned(points: Points) -> Points:
    """A point (1) with its tangent the other way."""
    own = np.empty(1, object)
    own[0] = replace(points.own[0], tangent=-points.own[0].tangent, direction=-points.tangents[0])
    return points.having(tangents=-points.tangents, own=own)


def of_matrix(i: int, problem: Problem, points: Points) -> Array:
    """The `crossings` of one kind at points (m,); NaN where one is exactly 0, which is not an event between points."""
    values = np.array([crossings(each.matrix)[i] for each in points.own])
    return np.where(values == 0, np.nan, values)


def confirmed(problem: Any, point: Points, _: int) -> str | None:
    """The kind of a bifurcation where a test of the multipliers changes its sign; None where there is none, as where
    two real multipliers have the product 1."""
    own = point.own[0]
    flip, fold, pairs = (abs(each) for each in crossings(own.matrix))
    kind = KINDS_OF_TESTS[int(np.argmin([flip, fold, pairs if len(own.matrix) > 1 else np.inf]))]
    if kind == "Neimark-Sacker":
        pair = own.spectrum[(own.spectrum.imag > 0) & (np.abs(np.abs(own.spectrum) - 1) <= TOLERANCES.at_bifurcation)]
        return kind if len(pair) else None
    if kind == "branch point" and abs(own.tangent[1]) <= TOLERANCES.at_fold:
        return "fold"
    level = -1.0 if kind == "flip" else 1.0
    return kind if np.abs(own.spectrum - level).min() <= TOLERANCES.at_bifurcation else "border collision"


def _slope_of_matrix(i: int, problem: Any, xs: Array, evaluation: Any, _: int) -> tuple[Array, Array] | None:
    """The `crossings` of one kind at points X (m, n + 1) and their derivatives, by differences of all components
    together; None where these are too many, or hops cannot be followed."""
    m, n = xs.shape
    if m * n > TOLERANCES.together:
        return None
    steps = TOLERANCES.ahead * problem.sizes
    beside = (xs[:, None] + np.diag(steps)).reshape(-1, n)
    which, found = problem.evaluate(np.zeros(len(beside), int), beside)
    if len(which) < len(beside):
        return None
    here, there = (
        np.array([crossings(each)[i] for each in problem.matrices(own, np.arange(len(own.xs)))])
        for own in (evaluation, found)
    )
    return here, (there.reshape(m, n) - here[:, None]) / steps


def slacks_at(points: Points) -> Array:
    """The slacks (m, k) at points (m,)."""
    return np.array([each.slacks for each in points.own])


def slope_of_slack(problem: Any, xs: Array, evaluation: Any, number: int) -> tuple[Array, Array]:
    return evaluation.slacks[:, number], evaluation.steps[:, number]


def inside(problem: Any, points: Points) -> Array:
    """How far (m, 2) the first launch speeds are inside of the range."""
    low, high = problem.between
    return np.column_stack([(alphas := problem.alphas(points)) - low, high - alphas])


def _is_long(problem: Any, points: Points) -> Array:
    """Negative for points (m,) at which a flight after an impact is about to vanish."""
    places = [k for k, *_ in problem.later_flights]
    short = (points.xs[:, places] <= (1.0 + TOLERANCES.same_time) * TOLERANCES.begun) & (points.tangents[:, places] < 0)
    return np.where(short.any(1), -1.0, 1.0)


class ShortFlight(NamedTuple):
    """The barrier at which a flight after an impact, an unknown of this place among n + 1, is about to vanish, at this
    distance along the tangent."""

    left: float
    place: int
    size: int

    def border(self, x: Array) -> tuple[Array, float]:
        """The row and the level of the time of the flight."""
        return np.eye(1, self.size, self.place)[0], TOLERANCES.begun
