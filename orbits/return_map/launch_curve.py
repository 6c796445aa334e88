"""Periodic launches as a curve in the launch speed and a parameter of the return map, for the tracer.

Its points are measured in shares of the two ranges. Its equation is that of `excess_of`, with exact derivatives where
the hops are known with theirs, else with differences.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np

from ..continuation.corrector import NEVER_SETTLED
from ..continuation.curve import CurvePoint
from ..errors import NoOrbit
from .cycles import INJECT, MapsAlong, excess_of

# Differences for slopes across: over this share of the launch speed, as small as rounding allows, as beside lossless
# hops slopes change with the cube root of the distance. If those of both sides differ by more, a jump is between.
STEP_ACROSS, JUMP_OF_SLOPES = 1e-9, 1e5
# The slope along the parameter, which needs other machines, is not computed anew within this share of the ranges: it
# decides how fast Newton's method converges, not to which point.
SAME_RATE, INEXACT = 1e-4, 100.0
# Hops with larger errors do not end Newton's method across the curve. Where those without errors do not come back up to
# the last number, they are others.
LARGEST_ERROR_OF_HOPS, OTHER_HOPS = 1e-6, 1e-6


@dataclass(frozen=True, eq=False)
class PeriodicLaunch:
    """A point of a branch: the parameter's value, the launch speeds and the multiplier of the hops, the numbers of
    impacts, the place and tangent (2,) in (launch speed, parameter), as shares of the ranges, and the rates (period,)
    of the launch speeds along the tangent where these are known."""

    value: float
    alphas: tuple[float, ...]
    multiplier: float
    impacts: tuple[int, ...]
    place: np.ndarray
    tangent: np.ndarray
    rates: np.ndarray | None = None

    @property
    def alpha(self) -> float:
        """The first of the launch speeds."""
        return self.alphas[0]

    @property
    def u(self) -> tuple[float]:
        """The unknown of the curve's equation."""
        return (self.alpha,)


class MapEquations(NamedTuple):
    """The equation at points of the curve: residual (m, 1), Jacobian (m, 1, 2), the hops' launch speeds and numbers of
    impacts (m, period), and their multipliers (m,) where these are known together with the slopes, with their errors
    (m,)."""

    residual: np.ndarray
    jacobian: np.ndarray
    launches: np.ndarray
    impacts: np.ndarray
    multipliers: np.ndarray | None = None
    changes: np.ndarray | None = None
    errors: np.ndarray | None = None
    trajectories: tuple[()] = ()

    @property
    def amplification(self) -> np.ndarray:
        """The factors (m,) by which the last Newton step is to be smaller, where the slopes are not exact; no step is
        small enough for the last one where the hops are not known well enough."""
        if self.errors is None:
            return np.full(len(self.residual), INEXACT)
        return np.where(self.errors > LARGEST_ERROR_OF_HOPS, NEVER_SETTLED, 1.0)

    @property
    def largest_growth(self) -> np.ndarray:
        """The growths (m,) of a small change over motions, which hops do not divide."""
        return np.ones(len(self.residual))


# At points that are known already.
NOT_EVALUATED = MapEquations(np.empty((1, 1)), np.empty((1, 1, 2)), np.empty((1, 1)), np.empty((1, 1)))


class LaunchCurve:
    """The curve of periodic launches as the tracer follows it; its points X are (launch speed, parameter).

    maps : the maps along the parameter
    between : range of launch speeds
    """

    kernel = None
    corners = None  # those of the map are borders of its branches
    row_of_speed = np.array([1.0, 0.0])

    def __init__(self, maps: MapsAlong, between: tuple[float, float], period: int):
        self.maps, self.between, self.period = maps, between, period
        self.along, self.span = maps.name, maps.high - maps.low
        self.scale = np.array([between[1] - between[0], self.span])
        self._rates = np.empty((0, 2)), np.empty(0)  # the points of the latest slopes along the parameter, and these

    def size(self, x: np.ndarray) -> np.ndarray:
        """The ranges, for points (..., 2)."""
        return np.broadcast_to(self.scale, np.shape(x))

    def bare(self, xs: np.ndarray) -> np.ndarray:
        """The points (..., 2), which have no states at nodes."""
        return xs

    def steady(self, xs: np.ndarray, tangents: np.ndarray) -> np.ndarray:
        """The tangents (c, 2) at points (c, 2), which are as exact as the points."""
        return tangents

    def units_of_changes(self, sizes: np.ndarray, evaluation: MapEquations) -> np.ndarray:
        """The units (m, 2) of small changes at points of these sizes (m, 2)."""
        return sizes

    def rounding_of_steps(self, evaluation: MapEquations, rows: np.ndarray) -> np.ndarray:
        """None are larger (m, 2) than Newton's method takes them to be."""
        return np.zeros(rows.shape)

    def possible(self, values: Any) -> Any:
        """Values of the parameter inside of its range, beyond which there may be no machine; any injection is one."""
        return values if self.along == INJECT else np.clip(values, self.maps.low, self.maps.high)

    def evaluate(self, xs: np.ndarray, exact: bool = False) -> MapEquations:
        """The equation at points (m, 2); unless it is to be `exact`, the hops may have errors."""
        alpha, values, (before, along) = xs[:, 0], self.possible(xs[:, 1]), self._rates
        if smooth := self.maps.smooth_cycles(alpha, values, self.period, exact):
            excess, slopes = smooth.excess
            numbers = smooth.launches[:, :-1], smooth.impacts, smooth.slopes.prod(axis=1), smooth.changes[:, :-1]
            return MapEquations(excess[:, None], slopes[:, None], *numbers, smooth.errors)
        step, m = STEP_ACROSS * np.abs(alpha), len(alpha)
        alphas = np.concatenate([alpha, alpha - step, alpha + step])
        launches, impacts = self.maps.cycles(alphas, np.tile(values, 3), self.period)
        residual, low, high = excess_of(launches).reshape(3, -1)
        across = np.where(np.abs(low + high - 2 * residual) > JUMP_OF_SLOPES * step, np.nan, (high - low) / (2 * step))
        near = before.shape == xs.shape and np.abs((xs - before) / self.scale).max() <= SAME_RATE
        if not (near and np.isfinite(along).all()):
            along = self.maps.slopes_along(alpha, values, self.period, residual)
            self._rates = xs.copy(), along
        jacobian = np.stack([across, along], axis=-1)[:, None]
        return MapEquations(residual[:, None], jacobian, launches[:m, :-1], impacts[:m])

    def evaluate_beside(self, xs: np.ndarray, known: Any) -> MapEquations:
        """The equation at points (m, 2) near to others."""
        return self.evaluate(xs)

    def evaluate_exactly(self, xs: np.ndarray, known: Any) -> MapEquations:
        """The equation at solved points (m, 2), without errors of the hops."""
        return self.evaluate(xs, exact=True)

    def rescued(self, x: np.ndarray) -> np.ndarray:
        """Raise `NoOrbit`: there is no other method where Newton's fails."""
        raise NoOrbit(f"the map is not smooth near {self.along} = {x[-1]:g}")

    def at(self, x: np.ndarray, before: np.ndarray) -> CurvePoint:
        """The certified point at a position (2,) on the curve, with the tangent pointing onward from `before` (2,)."""
        evaluation = self.evaluate(x[None], exact=True)
        across, along = evaluation.jacobian[0, 0]
        tangent = np.array([-along, across])
        size = float(np.linalg.norm(tangent / self.scale))
        tangent = tangent / size if size > 0 and np.isfinite(size) else before / np.linalg.norm(before / self.scale)
        tangent *= 1.0 if (tangent / self.scale**2) @ before >= 0 else -1.0
        return self.certify(CurvePoint(x, tangent, 0.0, cast(Any, evaluation), 0))

    def of_launch(self, launch: PeriodicLaunch, side: int = 1) -> CurvePoint:
        """The point of a launch on the curve, with its tangent, or for a `side` -1 the other way."""
        rates = None if launch.rates is None else side * launch.rates
        launch = replace(launch, tangent=side * launch.tangent, rates=rates)
        x, tangent = np.array([launch.alpha, launch.value]), launch.tangent * self.scale
        return CurvePoint(x, tangent, 0.0, cast(Any, NOT_EVALUATED), 0, certified=[cast(Any, launch)])

    def certify(self, point: CurvePoint) -> CurvePoint:
        """The point with its `PeriodicLaunch`, from hops without errors; raises `NoOrbit` where these are others."""
        if point.certified is not None:
            return point
        found: Any = point.evaluation
        if found.errors is not None and found.errors[point.place]:
            found = self.evaluate(point.x[None], exact=True)
            if not abs(found.residual[0, 0]) <= OTHER_HOPS:
                raise NoOrbit("the hops have other impacts there")
            point = point._replace(evaluation=found, place=0)
        launches, impacts = (tuple(each[point.place].tolist()) for each in (found.launches, found.impacts))
        if found.multipliers is None:
            slope = self.maps.multiplier(launches, float(self.possible(point.value)))
        else:
            slope = float(found.multipliers[point.place])
        shares = point.x / self.scale, point.tangent / self.scale
        rates = None if found.changes is None else found.changes[point.place] @ point.tangent
        launch = PeriodicLaunch(point.value, launches, slope, impacts, *shares, rates)
        return point._replace(certified=[cast(Any, launch)])

    def certify_all(self, points: Sequence[CurvePoint]) -> tuple[list[CurvePoint], None]:
        """The points with their launches, and no error."""
        return [self.certify(point) for point in points], None

    def certify_at(self, point: CurvePoint, value: float) -> CurvePoint:
        """A point whose parameter is `value` up to rounding, with exactly that value."""
        return self.certify(point._replace(x=np.append(point.x[:-1], value), certified=None))


def place_in_words(maps: MapsAlong, point: Any) -> str:
    """Where a point of a branch is, in words."""
    return f"{maps.in_words(maps.name, point.value, 9)}, {maps.in_words('alpha', point.alpha, 9)}"
