"""Hops that repeat themselves as a curve in all of their unknowns and a parameter.

The equations are those of each hop in turn, as of `cycle_statement`, of which the last one is that of the next launch
speed. In these unknowns the curve bends little, and a step of Newton's method integrates each hop once. The curve ends
where a hop has other impacts: from there on that of the launches alone leads past the border of the map.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..curves import Border, End, Points, Start, Steps, solved_at
from ..errors import NoOrbit
from ..numerics.roots import Array, solve
from ..shooting.single_shooting import Evaluation, shooting_equations
from .cycle_statement import INJECT, cycle_statement
from .cycles_along import SolvedHops
from .flown_hops import slopes_of_jacobians
from .launch_curve import STEPS_OF_BRANCHES, CurveOfHops, LaunchCurve, PeriodicLaunch

# The length of the curve is that in the first launch speed and the parameter: the other unknowns are measured in this
# many times the range of launch speeds.
UNIT_OF_OTHERS = 30.0
# What cannot be followed by steps of the least length, as beside lossless hops, is followed in the launch speed, and so
# is what follows a point that is refused. A rough end of a step has an error of its square.
STEPS_OF_CYCLES = Steps(
    first=1e-2, shortest=1e-4, corrected=0.2, turned=0.6, aim=1e-4, lengthen=4.0, beside=3, least=1, rough=1e-6,
    batch=64, rejections=0, most=STEPS_OF_BRANCHES.most, last=STEPS_OF_BRANCHES.last,
)  # fmt: skip
# Hops that were solved within this share of the ranges are near enough to begin with.
NEAR_SOLVED = 1e-2


class CycleEquations(NamedTuple):
    """The equations at points (m, n + 1) of the curve: residual (m, n), Jacobian (m, n, n + 1), and for each number of
    impacts the unknowns, the parameters and the equations of the hops with it, which are those of the first point, then
    those of the second one, and so on."""

    residual: Array
    jacobian: Array
    hops: dict[int, tuple[Array, Array, Evaluation]]

    @property
    def amplification(self) -> Array:
        """As motions, hops are short and amplify nothing."""
        return np.ones(len(self.residual))


class CycleCurve(CurveOfHops):
    """The curve of hops with these numbers of impacts (period,), of a `LaunchCurve`.

    Its points X are the unknowns of the hops, launch speeds in the machine's units, and the value of the parameter.
    """

    def __init__(self, launches: LaunchCurve, impacts: tuple[int, ...]):
        steps = replace(STEPS_OF_CYCLES, apart=launches.steps.apart)
        super().__init__(launches.maps, launches.between, len(impacts), steps)
        assert launches.maps.along is not None
        self.launches, self.impacts = launches, impacts
        self.hops = launches.maps.along
        ends = np.cumsum([count + 3 for count in impacts])
        self.places = [np.arange(end - count - 3, end) for end, count in zip(ends, impacts, strict=True)]
        self.speeds, self.last = np.array([each[1] for each in self.places]), ends - 1
        self.sizes = np.full(ends[-1] + 1, UNIT_OF_OTHERS * self.scale[0])
        self.speed = int(self.speeds[0])
        self.shared = np.array([self.speed, ends[-1]])
        self.sizes[self.shared] = self.scale

    def size(self, lanes: Array, xs: Array) -> Array:
        return np.broadcast_to(self.sizes, xs.shape)

    def begin(self, launch: PeriodicLaunch) -> Points | None:
        """The point (1) of a launch on this curve, None where no hops near it were solved."""
        if (solved := self.hops.nearest(launch)) is None:
            return None
        onward = launch.tangent * self.scale
        away = np.array([launch.alpha - solved.alpha, launch.value - solved.value])
        if not (np.abs(away / self.scale) <= NEAR_SOLVED).all():
            return None
        (unit,), (growing,) = self.hops.units(np.array([launch.value]))
        changes, speeds = np.concatenate(solved.changes), self.speeds
        us = np.concatenate(solved.unknowns) + changes @ away
        x, tangent = np.append(us, launch.value), np.append(changes @ onward, onward[1])
        tangent[speeds] = unit * tangent[speeds] + growing * us[speeds] * onward[1]
        x[speeds] *= unit
        x[self.speed], tangent[self.speed] = launch.alpha, onward[0]
        tangent /= np.linalg.norm(tangent / self.sizes)
        if not away.any():
            return self.point(x, tangent, launch)
        row, zero = np.zeros(len(x)), np.zeros(1, int)
        row[self.shared] = tangent[self.shared] / self.scale**2
        points = solved_at(self, zero, x[None], Border(row[None], row[None] @ x), tangent[None], self.steps)
        return points if len(points) else None

    def lost(self, lane: int, passed: Sequence[Points], error: object) -> Start | End:
        """From there on the launches alone are followed."""
        last = passed[-1][-1:]
        if last.evaluation:
            self._store(last)
        launches = self.launches.begun_at(last.own[0])
        return Start.at(launches, launches.of_launch(last.own[0]))

    def _store(self, point: Points) -> None:
        """Store the hops of a certified point (1), from which others are guessed outside of this curve."""
        (x,), jacobian, first = point.xs, point.evaluation.jacobian[point.places[0]], self.speed
        n = len(x) - 1
        (unit,), (growing,) = self.hops.units(x[-1:])
        others, us, speeds = np.delete(np.arange(n), first), x[:-1].copy(), self.speeds
        # All equations but the last determine the others from the first launch speed and the parameter.
        changes = np.zeros((n, 2))
        changes[others] = solve(jacobian[:-1, others], -jacobian[:-1, [first, n]])
        changes[first, 0] = 1.0
        us[speeds] /= unit
        changes[speeds] /= unit
        changes[speeds, 1] -= us[speeds] * growing / unit
        unknowns, by_both = (tuple(each[places] for places in self.places) for each in (us, changes))
        alpha, value = x[self.shared].tolist()
        self.hops.store(SolvedHops(alpha, value, self.impacts, unknowns, by_both, point.tangents[0, self.shared]))

    def _multipliers(self, evaluation: CycleEquations) -> tuple[Array, Array]:
        """The multipliers (m,) of points, and whether their hops have the impacts of the curve, and are not too near to
        others, (m,)."""
        multipliers, smooth = np.ones(m := len(evaluation.residual)), np.ones(m, bool)
        for count, (us, ps, of_hops) in evaluation.hops.items():
            multipliers *= slopes_of_jacobians(of_hops.jacobian[:, :, :-1]).reshape(m, -1).prod(1)
            smooth &= self.hops.are_smooth(count, us, ps, of_hops, between=True).reshape(m, -1).all(1)
        return multipliers, smooth

    def evaluate(
        self, lanes: Array, xs: Array, known: object = None, moved: Array | None = None
    ) -> tuple[Array, CycleEquations | None]:
        """The equations at points (m, n + 1), without those at which a hop cannot be followed."""
        m, values, speeds, following = len(xs), xs[:, -1], self.speeds, np.roll(self.speeds, -1)
        ps, (unit, growing) = self.hops.parameters_at(values), self.hops.units(values)
        us, n = xs[:, :-1].copy(), len(self.sizes) - 1
        us[:, speeds] /= unit[:, None]
        residual, jacobian = np.zeros((m, n)), np.zeros((m, n, n + 1))
        found = dict[int, tuple[Array, Array, Evaluation]]()
        for count in {*self.impacts}:
            hops = [hop for hop, each in enumerate(self.impacts) if each == count]
            equations = shooting_equations(cycle_statement(self.hops.model, (count,)), self.hops.names)
            own = us[:, [self.places[hop] for hop in hops]].reshape(-1, count + 3)
            of_hops = np.repeat(ps, len(hops), axis=0)
            done, evaluation = equations.evaluate_lanes(own, of_hops, (self.along,), fewest=True)
            if evaluation is None or len(done) < len(own):
                able = np.setdiff1d(np.arange(m), np.setdiff1d(np.arange(len(own)), done) // len(hops))
                which, others = self.evaluate(lanes[able], xs[able]) if len(able) else (able, None)
                return able[which], others
            found[count] = own, of_hops, evaluation
            for i, hop in enumerate(hops):
                places, each = self.places[hop], slice(i, None, len(hops))
                residual[:, places] = evaluation.residual[each]
                jacobian[:, places[:, None], [*places, n]] = evaluation.jacobian[each]
        # The last equation of a hop is that of its next launch speed less its own one, without an injection.
        residual[:, self.last] += us[:, speeds] - us[:, following]
        jacobian[:, self.last, speeds] += 1.0
        jacobian[:, self.last, following] -= 1.0
        injected = values if self.along == INJECT else self.hops.inject
        residual[:, self.last] += (injected / unit)[:, None]
        jacobian[:, self.last, n] -= (injected * growing / unit**2)[:, None]
        # The unknowns are speeds in the machine's units.
        jacobian[:, :, n] -= np.einsum("mij,mj->mi", jacobian[:, :, speeds], us[:, speeds] * (growing / unit)[:, None])
        jacobian[:, :, speeds] /= unit[:, None, None]
        if self.period % 2 == 0:
            self._leave_out_half(xs, residual, jacobian)
        return np.arange(m), CycleEquations(residual, jacobian, found)

    def _leave_out_half(self, xs: Array, residual: Array, jacobian: Array) -> None:
        """Divide what the last equation is more than that of the middle of the cycle by the difference of the launches,
        so that hops of half the period are no solutions, as in `excess_of`."""
        half = self.period // 2
        first, middle, (before, last) = self.speeds[0], self.speeds[half], self.last[[half - 1, -1]]
        apart = xs[:, middle] - xs[:, first]
        with np.errstate(divide="ignore", invalid="ignore"):
            residual[:, last] = (residual[:, last] - residual[:, before]) / apart
            jacobian[:, last] = (jacobian[:, last] - jacobian[:, before]) / apart[:, None]
            jacobian[:, last, middle] -= residual[:, last] / apart
            jacobian[:, last, first] += residual[:, last] / apart

    def certify(self, points: Points) -> tuple[Points, dict[int, Exception]]:
        """The points with their `PeriodicLaunch`es, without those whose hops have other impacts, or are too near to
        these."""
        multipliers, smooth = self._multipliers(points.evaluation)
        own, errors = np.empty(len(points), object), dict[int, Exception]()
        for i, k in enumerate(points.places.tolist()):
            x, tangent = points.xs[i], points.tangents[i]
            if not (smooth[k] and (x[self.speeds] > 0).all()):
                errors[i] = NoOrbit(f"the hops have other impacts near {self.along} = {x[-1]:g}")
            place, onward = x[self.shared] / self.scale, tangent[self.shared] / self.scale
            rate, alphas = 1.0 / np.linalg.norm(onward), tuple(x[self.speeds].tolist())
            ways = rate * onward, rate * tangent[self.speeds]
            own[i] = PeriodicLaunch(float(x[-1]), alphas, float(multipliers[k]), self.impacts, place, *ways)
        equations = points.evaluation._replace(hops={})  # without the motions, which are long
        return points.having(own=own, evaluation=equations), errors
