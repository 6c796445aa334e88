"""Hops that repeat themselves as a curve in all of their unknowns and a parameter, for the tracer.

The equations are those of each hop in turn, as of `cycle_statement`, of which the last one is that of the next launch
speed. In these unknowns the curve bends little, and a step of Newton's method integrates each hop once. The curve ends
where a hop has other impacts: from there on that of the launches alone leads past the border of the map.
"""

from typing import Any, NamedTuple, cast

import numpy as np

from ..continuation.corrector import correct, newton_steps
from ..continuation.curve import CurvePoint
from ..errors import NoOrbit
from ..numerics.roots import Array, solve
from ..shooting.newton_kernel import MOST_NEWTON_STEPS, Solutions
from ..shooting.single_shooting import LAST_STEP, STALLED_RATIO, Evaluation, shooting_equations
from .cycle_statement import INJECT, cycle_statement
from .cycles_along import SolvedHops
from .flown_hops import slopes_of_jacobians
from .launch_curve import LaunchCurve, PeriodicLaunch

# The length of the curve is that in the first launch speed and the parameter: the other unknowns are measured in this
# many times the range of launch speeds.
UNIT_OF_OTHERS = 30.0
# A step of Newton's method below the first number leaves the equations as they are but for rounding. One below the
# second leaves an end of a step, from which points are interpolated that are solved later, with an error of its square.
SAME_EQUATIONS, LAST_STEP_OF_ENDS = 1e-12, 1e-6
# Hops that were solved within this share of the ranges are near enough to begin with.
NEAR_SOLVED = 1e-2


class OtherImpacts(NoOrbit):
    """The hops have other impacts than those of the curve, or are too near to them."""


class CycleEquations(NamedTuple):
    """The equations at points (m, n + 1) of the curve: residual (m, n), Jacobian (m, n, n + 1), and for each number of
    impacts the unknowns, the parameters and the equations of the hops with it, which are those of the first point, then
    those of the second one, and so on."""

    residual: Array
    jacobian: Array
    hops: dict[int, tuple[Array, Array, Evaluation]]


class SolvedCycles(NamedTuple):
    """What is known of solved points: the Jacobian (m, n, n + 1), the multipliers (m,), and whether the hops have the
    impacts of the curve, and are not too near to others, (m,). As motions, hops are short and amplify nothing."""

    jacobian: Array
    multipliers: Array
    smooth: Array
    amplification: Array
    trajectories: tuple[()] = ()

    @property
    def largest_growth(self) -> Array:
        """The growths (m,) of a small change over motions."""
        return self.amplification


class CycleCurve:
    """The curve of hops with these numbers of impacts (period,), of a `LaunchCurve`.

    Its points X are the unknowns of the hops, launch speeds in the machine's units, and the value of the parameter.
    """

    corners = None  # those of the map are borders of its branches

    def __init__(self, launches: LaunchCurve, impacts: tuple[int, ...]):
        assert launches.maps.along is not None
        self.impacts, self.period = impacts, len(impacts)
        self.hops, self.inject = launches.maps.along, launches.maps.inject
        self.maps, self.between = launches.maps, launches.between
        self.along, self.span, self.scale = launches.along, launches.span, launches.scale
        ends = np.cumsum([count + 3 for count in impacts])
        self.places = [np.arange(end - count - 3, end) for end, count in zip(ends, impacts, strict=True)]
        self.speeds, self.last = np.array([each[1] for each in self.places]), ends - 1
        self.sizes = np.full(ends[-1] + 1, UNIT_OF_OTHERS * self.scale[0])
        self.sizes[self.speeds[0]], self.sizes[-1] = self.scale
        self.row_of_speed = np.eye(len(self.sizes))[self.speeds[0]]

    def size(self, x: Array) -> Array:
        """The units of the unknowns and the parameter, for points (..., n + 1)."""
        return np.broadcast_to(self.sizes, np.shape(x))

    def bare(self, xs: Array) -> Array:
        """The first launch speeds and the values of the parameter, (..., 2), of points (..., n + 1)."""
        return xs[..., [self.speeds[0], -1]]

    def steady(self, xs: Array, tangents: Array) -> Array:
        """The tangents (c, n + 1) at points (c, n + 1), which are as exact as the points."""
        return tangents

    def parameters_at(self, xs: Array) -> Array:
        """The parameters (m, np) of the hops at points (m, n + 1)."""
        return self.hops.parameters_at(xs[:, -1])

    def begin(self, point: CurvePoint) -> CurvePoint | None:
        """The point of a `LaunchCurve` as one of this curve, None where no hops near it were solved."""
        launch: Any = point.point
        if (solved := self.hops.nearest(launch)) is None:
            return None
        away = np.array([launch.alpha - solved.alpha, launch.value - solved.value])
        if not (np.abs(away / self.scale) <= NEAR_SOLVED).all():
            return None
        (unit,), (growing,) = self.hops.units(np.array([launch.value]))
        changes, first = np.concatenate(solved.changes), self.speeds[0]
        us, speeds = np.concatenate(solved.unknowns) + changes @ away, self.speeds
        x, tangent = np.append(us, launch.value), np.append(changes @ point.tangent, point.tangent[1])
        tangent[speeds] = unit * tangent[speeds] + growing * us[speeds] * point.tangent[1]
        x[speeds] *= unit
        x[first], tangent[first] = launch.alpha, point.tangent[0]
        tangent /= np.linalg.norm(tangent / self.sizes)
        if away.any():
            row = tangent / self.sizes**2
            row[np.delete(np.arange(len(row) - 1), first)] = 0.0
            try:
                x, tangent = correct(cast(Any, self), x, row, float(row @ x), tangent)[:2]
            except NoOrbit:
                return None
        return point._replace(x=x, tangent=tangent)

    def leave(self, point: CurvePoint) -> None:
        """Store the hops of a certified point, from which others are guessed outside of this curve."""
        jacobian, first, n = (
            cast(SolvedCycles, point.evaluation).jacobian[point.place],
            self.speeds[0],
            len(point.x) - 1,
        )
        (unit,), (growing,) = self.hops.units(point.x[-1:])
        others, us, speeds = np.delete(np.arange(n), first), point.x[:-1].copy(), self.speeds
        # All equations but the last determine the others from the first launch speed and the parameter.
        changes = np.zeros((n, 2))
        changes[others] = solve(jacobian[:-1, others], -jacobian[:-1, [first, n]])
        changes[first, 0] = 1.0
        us[speeds] /= unit
        changes[speeds] /= unit
        changes[speeds, 1] -= us[speeds] * growing / unit
        unknowns, by_both = (tuple(each[places] for places in self.places) for each in (us, changes))
        alpha, value = self.bare(point.x).tolist()
        self.hops.store(SolvedHops(alpha, value, self.impacts, unknowns, by_both, self.bare(point.tangent)))

    def kernel(
        self, guesses: Array, rows: Array, levels: Array, sizes: Array, ps: Array, least: int, with_motions: bool
    ) -> Solutions:
        """The curve at levels (m,) of rows (m, n + 1), by Newton's method from guesses (m, n + 1) with parameters
        (m, np); roughly unless `with_motions`. Raises `NoOrbit` where it does not converge directly."""
        xs, directions, m = guesses.copy(), np.empty_like(guesses), len(guesses)
        n, left, last = len(self.sizes) - 1, np.arange(m), np.full(m, np.inf)
        found = SolvedCycles(np.empty((m, n, n + 1)), np.empty(m), np.empty(m, bool), np.ones(m))
        for _ in range(MOST_NEWTON_STEPS):
            evaluation = self.evaluate(xs[left])
            steps, directions[left] = newton_steps(cast(Any, evaluation), xs[left], rows[left], levels[left])
            xs[left] += steps
            before, moved = last[left], (np.abs(steps) / sizes[left]).max(1)
            done = moved < (SAME_EQUATIONS if with_motions else LAST_STEP_OF_ENDS)
            done |= np.maximum(moved, before) < LAST_STEP  # all that is left is rounding
            if not (done | (moved < STALLED_RATIO * before)).all():
                raise NoOrbit("the corrector does not converge")
            if with_motions and done.any():
                found.jacobian[left[done]] = evaluation.jacobian[done]
                for known, values in zip(found[1:3], self._multipliers(evaluation), strict=True):
                    known[left[done]] = values[done]
            last[left], left = moved, left[~done]
            if not len(left):
                return Solutions(np.arange(m), xs, directions, found.amplification, cast(Any, found))
        raise NoOrbit("the corrector converges too slowly")

    def _multipliers(self, evaluation: CycleEquations) -> tuple[Array, Array]:
        """The multipliers (m,) of points, and whether their hops have the impacts of the curve, and are not too near to
        others, (m,)."""
        multipliers, smooth = np.ones(m := len(evaluation.residual)), np.ones(m, bool)
        for count, (us, ps, of_hops) in evaluation.hops.items():
            multipliers *= slopes_of_jacobians(of_hops.jacobian[:, :, :-1]).reshape(m, -1).prod(1)
            smooth &= self.hops.are_smooth(count, us, ps, of_hops, between=True).reshape(m, -1).all(1)
        return multipliers, smooth

    def evaluate(self, xs: Array) -> CycleEquations:
        """The equations at points (m, n + 1); raises `NoOrbit` where a hop cannot be followed."""
        m, values, speeds, following = len(xs), xs[:, -1], self.speeds, np.roll(self.speeds, -1)
        ps, (unit, growing) = self.parameters_at(xs), self.hops.units(values)
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
                raise NoOrbit("a hop cannot be followed")
            found[count] = own, of_hops, evaluation
            for i, hop in enumerate(hops):
                places, each = self.places[hop], slice(i, None, len(hops))
                residual[:, places] = evaluation.residual[each]
                jacobian[:, places[:, None], [*places, n]] = evaluation.jacobian[each]
        # The last equation of a hop is that of its next launch speed less its own one, without an injection.
        residual[:, self.last] += us[:, speeds] - us[:, following]
        jacobian[:, self.last, speeds] += 1.0
        jacobian[:, self.last, following] -= 1.0
        injected = values if self.along == INJECT else self.inject
        residual[:, self.last] += (injected / unit)[:, None]
        jacobian[:, self.last, n] -= (injected * growing / unit**2)[:, None]
        # The unknowns are speeds in the machine's units.
        jacobian[:, :, n] -= np.einsum("mij,mj->mi", jacobian[:, :, speeds], us[:, speeds] * (growing / unit)[:, None])
        jacobian[:, :, speeds] /= unit[:, None, None]
        if self.period % 2 == 0:
            self._leave_out_half(xs, residual, jacobian)
        return CycleEquations(residual, jacobian, found)

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

    def rescued(self, x: Array) -> Array:
        """Raise `NoOrbit`: there is no other method where Newton's fails."""
        raise NoOrbit(f"the hops are not smooth near {self.along} = {x[-1]:g}")

    def certify(self, point: CurvePoint) -> CurvePoint:
        """The point with its `PeriodicLaunch`; raises `OtherImpacts` where the hops have others."""
        if point.certified is not None:
            return point
        found, alphas, tangent = cast(SolvedCycles, point.evaluation), point.x[self.speeds], point.tangent
        if not (found.smooth[point.place] and (alphas > 0).all()):
            raise OtherImpacts(f"the hops have other impacts near {self.along} = {point.value:g}")
        place, onward = self.bare(point.x) / self.scale, self.bare(tangent) / self.scale
        rate, slope = 1.0 / np.linalg.norm(onward), float(found.multipliers[point.place])
        ways = rate * onward, rate * tangent[self.speeds]
        launch = PeriodicLaunch(point.value, tuple(alphas.tolist()), slope, self.impacts, place, *ways)
        return point._replace(certified=[cast(Any, launch)])

    def certify_at(self, point: CurvePoint, value: float) -> CurvePoint:
        """A point whose parameter is `value` up to rounding, with exactly that value."""
        return self.certify(point._replace(x=np.append(point.x[:-1], value), certified=None))
