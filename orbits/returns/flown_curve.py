"""Launches of several numbers whose hops have no statement, as with a restitution, as a curve along a parameter.

Its points X are the free numbers of the first launch, without units, and the parameter. The equations are that the
launch comes back after all hops, with the derivatives of `derivative_of_hops`, and differences along the parameter.
"""

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..curves import CHANGES, Points, Problem, Test
from ..errors import OrbitsError
from ..hops import derivative_of_hops
from .hop_curve import KINDS_OF_TESTS, STEPS_OF_HOPS, confirmed, inside, of_matrix
from .launch_curve import LAUNCH_CURVE
from .launch_cycles import INJECT, MAPS, MapsAlong
from .periodic_launch import PeriodicLaunch, dominant


class FlownHopsEquations(NamedTuple):
    """The equations at points (m, d + 1): residual (m, d), Jacobian (m, d, d + 1), the derivatives (m, d, d) of the
    last launch by the first one, and the launches (m, period, d)."""

    residual: np.ndarray
    jacobian: np.ndarray
    matrices: np.ndarray
    launches: np.ndarray

    @property
    def amplification(self) -> np.ndarray:
        """The factor (m,) by which the last Newton step is to be smaller, as the slopes are not exact."""
        return np.full(len(self.residual), LAUNCH_CURVE.inexact)


class FlownCurve(Problem):
    """The curve of launches of several numbers that come back after `period` hops.

    maps, between : the maps along the parameter, and the range of launch speeds
    """

    # Each point takes many flights: those at the ends of steps suffice.
    steps = replace(STEPS_OF_HOPS, apart=np.inf, longest=0.05, shortest=1e-6, rejections=16, rough=0.0, last=1e-12)

    def __init__(self, maps: MapsAlong, between: tuple[float, float], period: int):
        self.maps, self.between, self.period, self.along = maps, between, period, maps.name
        self.names = maps.at(maps.low).section.names
        self.speed = self.names.index("alpha")
        self.unit = float(maps.at(maps.low).section.unit[self.speed])
        self.scale = np.array([between[1] - between[0], maps.high - maps.low])
        self.sizes = np.append(np.full(len(self.names), self.scale[0] / self.unit), self.scale[1])
        self.tests = (
            *(Test(kind, partial(of_matrix, i), confirmed=confirmed) for i, kind in enumerate(KINDS_OF_TESTS)),
            Test("left", inside, CHANGES, bare=True),
        )

    def size(self, lanes: np.ndarray, xs: np.ndarray) -> np.ndarray:
        return np.broadcast_to(self.sizes, xs.shape)

    def alphas(self, points: Points) -> np.ndarray:
        """The first launch speeds (m,) of points, in the machine's units."""
        return points.xs[:, self.speed] * self.unit

    def returned(self, x: np.ndarray) -> Any:
        """The hops from X (d + 1,); raises `NoOrbit` where there are none."""
        value = float(x[-1]) if self.along == INJECT else float(np.clip(x[-1], self.maps.low, self.maps.high))
        section = self.maps.at(0.0 if self.along == INJECT else value).section
        (y,) = section.states(x[None, :-1])
        inject = (value if self.along == INJECT else self.maps.inject) / self.unit
        return derivative_of_hops(section, y, self.period, inject)

    def _excess(self, x: np.ndarray) -> np.ndarray:
        hops = self.returned(x)
        first, last = hops.section.free(hops.launches[[0, -1]])
        return last - first

    def evaluate(self, lanes: np.ndarray, xs: np.ndarray, known: Any = None, moved: Any = None) -> Any:
        """The equations at points (m, d + 1), without those from which there are no hops."""
        found, which, step = list[tuple](), list[int](), MAPS.step_along * self.scale[1]
        for i, x in enumerate(xs):
            side = -1.0 if x[-1] > 0.5 * (self.maps.low + self.maps.high) else 1.0
            try:
                hops, beside = self.returned(x), self._excess(x + side * step * np.eye(1, len(x), len(x) - 1)[0])
            except OrbitsError:
                continue
            launches = hops.section.free(hops.launches)
            excess = launches[-1] - launches[0]
            jacobian = np.column_stack([hops.matrix - np.eye(len(excess)), (beside - excess) / (side * step)])
            found.append((excess, jacobian, hops.matrix, launches[:-1]))
            which.append(i)
        columns = (np.array(each) for each in zip(*found, strict=True))
        return np.array(which, int), FlownHopsEquations(*columns) if found else None

    def certify(self, points: Points) -> tuple[Points, dict[int, Exception]]:
        """The points with their `PeriodicLaunch`es."""
        own, found = np.empty(len(points), object), points.evaluation
        ways = np.column_stack([points.tangents[:, self.speed] * self.unit, points.tangents[:, -1]]) / self.scale
        for i, k in enumerate(points.places.tolist()):
            alphas, matrix = found.launches[k][:, self.speed] * self.unit, found.matrices[k]
            place = np.array([alphas[0], points.values[i]]) / self.scale
            about = float(points.values[i]), tuple(alphas.tolist()), dominant(matrix), (0,) * self.period
            known = {"launches": found.launches[k], "matrix": matrix, "x": points.xs[i]}
            own[i] = PeriodicLaunch(*about, place, ways[i], **known, direction=points.tangents[i])
        return points.having(own=own), {}
