"""Periodic launches as a curve in the launch speed and a parameter of the return map, a problem of `orbits.curves`.

It is for maps whose hops have no statement. Its points are measured in shares of the two ranges. Its equation is that
of `excess_of`, with the derivatives of the pieces of the map where it is resolved, else with differences.
"""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np

from ..curves import Border, Points, Problem, Steps, Test, solved_at
from ..errors import NoOrbit, OrbitsError
from .launch_cycles import INJECT, MapsAlong, excess_of
from .periodic_launch import MULTIPLIER_AT, PeriodicLaunch

# Beside lossless hops the curvature has no bound, so that the first steps there are as short as the distance to them.
STEPS_OF_BRANCHES = Steps(
    first=1e-2, shortest=1e-9, corrected=1.0, turned=0.6, aim=0.1, lengthen=4.0, beside=2, batch=16, rejections=100,
    most=20_000, last=1e-10,
)  # fmt: skip
# Hops of longer periods have as many sheets, which lie close to each other: a correction may not lead to another one.
STEPS_OF_SHEETS = replace(STEPS_OF_BRANCHES, corrected=0.2, aim=2e-2, turned=0.3, batch=4)
ROW_OF_SPEED = np.array([1.0, 0.0])


class LaunchCurveOptions(NamedTuple):
    """The slopes of maps along curves of launches, and their corners."""

    # Launches are on another sheet where their change differs from that of the rates by this share.
    other_sheet: float = 0.25
    around: float = 1e-6  # radius of the circle round a corner of the map, as a share of the ranges
    # Share of the launch speed, for slopes across: as small as rounding allows, since near lossless hops slopes
    # change with the cube root of the distance.
    step_across: float = 1e-9
    jump_of_slopes: float = 1e5  # a jump is between two launches where the slopes on both sides differ by more
    # Share of the ranges within which the slope along the parameter, which needs other machines, is not computed anew:
    # it decides how fast Newton's method converges, not to which point.
    same_rate: float = 1e-4
    inexact: float = 100.0  # how many times as large as roundings residuals may be where slopes are differences


LAUNCH_CURVE = LaunchCurveOptions()


class MapEquations(NamedTuple):
    """The equation at points of the curve: residual (m, 1), Jacobian (m, 1, 2), the hops' launch speeds and numbers of
    impacts (m, period), and their multipliers (m,) where these are known together with the slopes."""

    residual: np.ndarray
    jacobian: np.ndarray
    launches: np.ndarray
    impacts: np.ndarray
    multipliers: np.ndarray | None = None
    changes: np.ndarray | None = None

    @property
    def amplification(self) -> np.ndarray:
        """The factor (m,) by which the last Newton step is to be smaller, where the slopes are not exact."""
        return np.full(len(self.residual), LAUNCH_CURVE.inexact if self.multipliers is None else 1.0)


def _above(level: float, problem: Problem, points: Points) -> np.ndarray:
    """The multipliers (m,) of points above a level, NaN where there are none, and at points exactly at the level, which
    are not events between points."""
    excess = np.array([each.multiplier for each in points.own]) - level
    return np.where(excess == 0, np.nan, excess)


class LaunchCurve(Problem):
    """The curve of periodic launches; its points X are (launch speed, parameter).

    maps : the maps along the parameter
    between : range of launch speeds
    apart : largest distance of points, as a share of the ranges
    """

    steps: Steps

    def __init__(self, maps: MapsAlong, between: tuple[float, float], period: int, apart: float = 0.02):
        self.maps, self.between, self.period = maps, between, period
        self.steps = replace(STEPS_OF_BRANCHES if period <= 2 else STEPS_OF_SHEETS, apart=apart)
        self.along, self.span = maps.name, maps.high - maps.low
        self.scale = np.array([between[1] - between[0], self.span])
        self.tests = tuple(Test(kind, partial(_above, level)) for kind, level in MULTIPLIER_AT.items())
        self._rates = np.empty((0, 2)), np.empty(0)  # the points of the latest slopes along the parameter, and these

    def accepts(self, before: Points, points: Points) -> np.ndarray:
        if points.own is None:
            return np.ones(len(points), bool)
        return np.array([not self._changes_sheet(*ends) for ends in zip(before.own, points.own, strict=True)])

    def _changes_sheet(self, a: PeriodicLaunch, b: PeriodicLaunch) -> bool:
        """Whether the curve between two points, or a launch along it, changes otherwise than the tangents say, as on
        another sheet of the curve, where each launch is another one of the same hops, or on another curve."""
        length = float(np.linalg.norm(b.place - a.place))
        if length <= LAUNCH_CURVE.around and self.maps.pieces is None:  # differences reach as far
            return False
        away = b.place - a.place - 0.5 * length * (a.tangent + b.tangent)
        if float(np.linalg.norm(away)) > LAUNCH_CURVE.other_sheet * length:
            return True
        # A fixed point along the injection never turns round in the launch speed, as along other parameters.
        if (len(a.alphas) == 1 and self.along != INJECT) or a.rates is None or b.rates is None:
            return False
        change, expected = np.subtract(b.alphas, a.alphas), 0.5 * length * (a.rates + b.rates)
        return bool((np.abs(change - expected) > LAUNCH_CURVE.other_sheet * (np.abs(change) + np.abs(expected))).any())

    def point(self, x: np.ndarray, tangent: np.ndarray, launch: PeriodicLaunch) -> Points:
        """The point (1) of a launch at X (n + 1,) with a tangent (n + 1,)."""
        zero, own = np.zeros(1, int), np.empty(1, object)
        own[0] = launch
        return Points(zero, x[None], tangent[None], np.ones(1), None, zero, np.zeros(1), own)

    def size(self, lanes: np.ndarray, xs: np.ndarray) -> np.ndarray:
        return np.broadcast_to(self.scale, xs.shape)

    def possible(self, values: Any) -> Any:
        """Values of the parameter inside of its range, beyond which there may be no machine; any injection is one."""
        return values if self.along == INJECT else np.clip(values, self.maps.low, self.maps.high)

    def evaluate(
        self, lanes: np.ndarray, xs: np.ndarray, known: object = None, moved: np.ndarray | None = None
    ) -> tuple[np.ndarray, MapEquations | None]:
        """The equation at points (m, 2)."""
        try:
            return np.arange(len(xs)), self.equation(xs)
        except OrbitsError:  # there is no such machine
            return np.empty(0, int), None

    def equation(self, xs: np.ndarray) -> MapEquations:
        """The equation at points (m, 2)."""
        alpha, values = xs[:, 0], self.possible(xs[:, 1])
        if smooth := self.maps.smooth_cycles(alpha, values, self.period):
            excess, slopes = smooth.excess
            numbers = smooth.launches[:, :-1], smooth.impacts, smooth.slopes.prod(axis=1), smooth.changes[:, :-1]
            return MapEquations(excess[:, None], slopes[:, None], *numbers)
        step, m = LAUNCH_CURVE.step_across * np.abs(alpha), len(alpha)
        alphas = np.concatenate([alpha, alpha - step, alpha + step])
        launches, impacts = self.maps.cycles(alphas, np.tile(values, 3), self.period)
        residual, low, high = excess_of(launches).reshape(3, -1)
        jumps = np.abs(low + high - 2 * residual) > LAUNCH_CURVE.jump_of_slopes * step
        across = np.where(jumps, np.nan, (high - low) / (2 * step))
        along, new = self._known_rates(xs)
        if new.any():
            along[new] = self.maps.slopes_along(alpha[new], values[new], self.period, residual[new])
            self._rates = xs.copy(), along
        jacobian = np.stack([across, along], axis=-1)[:, None]
        return MapEquations(residual[:, None], jacobian, launches[:m, :-1], impacts[:m])

    def _known_rates(self, xs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The latest slopes along the parameter near points (m, 2), and where there are none (m,)."""
        places, rates = self._rates
        apart = np.abs((xs[:, None] - places) / self.scale).max(2, initial=0.0)
        nearest = apart.argmin(1) if len(places) else np.zeros(len(xs), int)
        along = np.append(rates, np.nan)[nearest]
        return along, ~(np.isfinite(along) & (apart.min(1, initial=np.inf) <= LAUNCH_CURVE.same_rate))

    def certify(self, points: Points) -> tuple[Points, dict[int, Exception]]:
        """The points with their `PeriodicLaunch`es, from hops without errors."""
        found, own = points.evaluation, np.empty(len(points), object)
        places, ways = points.xs / self.scale, points.tangents / self.scale
        for i, k in enumerate(points.places.tolist()):
            launches, impacts = (tuple(each[k].tolist()) for each in (found.launches, found.impacts))
            if found.multipliers is None:
                slope = self.maps.multiplier(launches, float(self.possible(points.values[i])))
            else:
                slope = float(found.multipliers[k])
            rates = None if found.changes is None else found.changes[k] @ points.tangents[i]
            own[i] = PeriodicLaunch(float(points.values[i]), launches, slope, impacts, places[i], ways[i], rates=rates)
        return points.having(own=own), {}

    def at(self, x: np.ndarray, before: np.ndarray) -> PeriodicLaunch:
        """The launch at a place (2,) on the curve, with the tangent pointing onward from `before` (2,)."""
        evaluation = self.equation(x[None])
        across, along = evaluation.jacobian[0, 0]
        tangent = np.array([-along, across])
        size = float(np.linalg.norm(tangent / self.scale))
        tangent = tangent / size if size > 0 and np.isfinite(size) else before / np.linalg.norm(before / self.scale)
        tangent *= 1.0 if (tangent / self.scale**2) @ before >= 0 else -1.0
        zero = np.zeros(1, int)
        points = Points(zero, x[None], tangent[None], np.ones(1), evaluation, zero)
        return cast(PeriodicLaunch, self.certify(points)[0].own[0])

    def near(self, x: np.ndarray, onward: np.ndarray, row: np.ndarray = ROW_OF_SPEED) -> PeriodicLaunch:
        """The launch of the curve at the level of a row (2,) through a place (2,) near it, by default at its launch
        speed, with a tangent that points `onward` (2,); raises `NoOrbit`."""
        border = Border(row[None], row[None] @ x)
        points = solved_at(self, np.zeros(1, int), x[None], border, onward[None], self.steps)
        if not len(points):
            raise NoOrbit(f"the map is not smooth near {self.along} = {x[-1]:g}")
        return cast(PeriodicLaunch, points.own[0])

    def of_launch(self, launch: PeriodicLaunch, side: int = 1) -> Points:
        """The point (1) of a launch on the curve, with its tangent, or for a `side` -1 the other way."""
        rates = None if launch.rates is None else side * launch.rates
        launch = replace(launch, tangent=side * launch.tangent, rates=rates)
        return self.point(np.array([launch.alpha, launch.value]), launch.tangent * self.scale, launch)


def place_in_words(maps: MapsAlong, point: PeriodicLaunch) -> str:
    """Where a point of a branch is, in words."""
    return f"{maps.in_words(maps.name, point.value, 9)}, {maps.in_words('alpha', point.alpha, 9)}"
