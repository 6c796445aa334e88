"""The curve of a family of oscillations, as a problem of curves: its equations, what is certified, and its events."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ..curves import BRANCH, FOLD, End, Points, Problem, Start, Test
from ..errors import FlowError, InputError, NoOrbit, OrbitsError
from ..flow import Trajectories
from ..model import CONTACT_FORCE, Affine
from ..numerics import Array
from ..records import NONE
from ..shooting import elastic, error_bounds
from ..units import ENERGY, Message, Quantity
from .energy_changes import work_along
from .extrema_and_zeros import Sought, extremes, turns_and_zeros
from .oscillator import DURATION, OSCILLATOR, Oscillator

# The columns of what is certified: the bound on the error of the period, the change of the energy as a share of it, the
# residual, the least contact force or, of a bounce, the least clearance, and the least separation, `NONE` without; and
# the multipliers.
ERROR, DRIFT, RESIDUAL, MARGIN, APART, MULTIPLIERS = range(6)


class OscillationCurve(Problem):
    """The oscillations of an oscillator along their energy: X has the state (2n,) at the beginning, the duration, the
    unfolding, and the energy. What it certifies are the columns `ERROR` to `APART`, and from `MULTIPLIERS` on the real
    parts of the multipliers besides the two of the time and of the energy, which are 1, and then their imaginary parts.

    p : the parameters
    first : X of a solution
    """

    def __init__(self, oscillator: Oscillator, p: Array, first: Array):
        self.oscillator, self.p, self.first, self.n = oscillator, p, first, oscillator.n
        self.tests = [FOLD, BRANCH, Test("turn of the period", _turning_period, bare=True)]
        if self.n > 1:
            self.tests.append(Test("flip", _flips))
        if self.n > 2:
            self.tests.append(Test("Krein collision", _collisions))
        if oscillator.bounces or CONTACT_FORCE in oscillator.moving.phase.watch:
            kind = "grazing" if oscillator.bounces else "contact pulls"
            self.tests.append(Test(kind, lambda problem, points: points.own[:, MARGIN]))
        if self.separation:
            self.tests.append(Test("masses touch", lambda problem, points: points.own[:, APART]))

    @property
    def separation(self) -> Affine | None:
        """The distance within the machine that must stay positive, if a length of it is stated."""
        return self.oscillator.machine.model.separation(self.oscillator.machine.values)

    def parameters_at(self, xs: Array) -> Array:
        """The parameters (m, np) at points (m, 2n + 3)."""
        ps = np.tile(self.p, (len(xs), 1))
        ps[:, -1] = xs[:, -1]
        return ps

    def evaluate(self, lanes: Array, xs: Array, known: Any = None, moved: Any = None) -> tuple[Array, Any]:
        equations, ps = self.oscillator.equations, self.parameters_at(xs)
        which, found = np.arange(len(xs)), None
        try:
            found = equations.evaluate_all(xs[:, :-1], ps)
        except FlowError:
            if len(xs) > 1:
                which, found = equations.evaluate_lanes(xs[:, :-1], ps)
        if found is None:
            return which[:0], None
        # The energy stands in the first equation alone.
        by_energy = np.zeros((len(which), equations.size, 1))
        by_energy[:, 0] = -1.0
        return which, replace(found, jacobian=np.concatenate([found.jacobian, by_energy], axis=2))

    def size(self, lanes: Array, xs: Array) -> Array:
        return self.oscillator.sizes(xs)

    def certify(self, points: Points) -> tuple[Points, Mapping[int, Exception]]:
        equations, ps = self.oscillator.equations, self.parameters_at(points.xs)
        evaluation, sizes = points.evaluation[points.places], self.size(points.lanes, points.xs)
        # At a fold the period is known across the curve, and not at an energy.
        folds = np.abs(points.tangents[:, -1]) < OSCILLATOR.at_a_fold * sizes[:, -1]
        closing = np.where(folds[:, None], points.tangents / sizes**2, np.eye(equations.size + 1)[-1])
        errors, refused = error_bounds(
            equations, points.xs[:, :-1], ps, evaluation, closing, quickly=True, unknown=DURATION
        )
        for i in np.flatnonzero(errors > OSCILLATOR.known * points.xs[:, -3]).tolist():
            refused.setdefault(i, NoOrbit("its period is lost to rounding, since small changes of the motion grow"))
        motions = evaluation.trajectories[1]
        states = motions.only(self.oscillator.states)
        moving = self.oscillator.moving
        named = dict(zip(moving.names, ps.T, strict=False))
        drifts = work_along(moving.phase, moving.gradient, states, named)[0] / points.values
        multipliers = np.linalg.eigvals(self.others(points)).astype(complex)
        residual = np.abs(evaluation.residual).max(1)
        numbers = np.column_stack([errors, drifts, residual, *self._margins(motions)])
        return points.having(own=np.hstack([numbers, multipliers.real, multipliers.imag])), refused

    def _margins(self, motions: Trajectories) -> tuple[Array, Array]:
        """What may not become negative over motions (m,): the least clearance of a bounce or the least contact force,
        and the least separation (m,); `NONE` without one."""
        machine, bounces = self.oscillator.machine, self.oscillator.bounces
        margins = apart = np.full(len(motions), NONE)
        if bounces:
            gap = machine.model.gap(machine.values)
            margins = turns_and_zeros({"gap": Sought(motions, gap)})["gap"].lowest(middles=np.zeros(0, int))[0]
        elif CONTACT_FORCE in motions.names:
            margins = extremes(motions, Affine(tuple(float(name == CONTACT_FORCE) for name in motions.names)))[0]
        if self.separation:
            embed = None if bounces else machine.model.embed
            apart = extremes(motions.only(self.oscillator.states), self.separation, embed)[0]
        return margins, apart

    def others(self, points: Points) -> Array:
        """Matrices (m, 2n - 2, 2n - 2) whose eigenvalues are the multipliers of cycles at points, without the two of
        the time and of the energy, which are 1."""
        m, n, moving = len(points), 2 * self.n, self.oscillator.moving
        sizes, x = self.size(points.lanes, points.xs)[:, :n], points.xs[:, :n]
        whole = points.evaluation.transitions[1][points.places][:, :n, :n]
        if self.oscillator.bounces:
            ends = points.evaluation.trajectories[1].finals[points.places][:, :n]
            whole = np.array([self._through_impact(*each) for each in zip(ends, x, whole, strict=True)])
        whole = whole * sizes[:, None] / sizes[:, :, None]
        found = np.empty((m, n - 2, n - 2))
        for i in range(m):
            both = np.array([moving.rates(x[i]) / sizes[i], moving.slopes(x[i])[0] * sizes[i]])
            across = np.linalg.svd(both / np.linalg.norm(both, axis=1)[:, None])[2][2:]
            found[i] = across @ whole[i] @ across.T
        return found

    def _through_impact(self, end: Array, start: Array, transition: Array) -> Array:
        """The derivative (2n, 2n) of the state after the elastic impact at the end of a flight, whose time varies."""
        moving, machine = self.oscillator.moving, self.oscillator.machine
        reset, normal = self._reset(end).toarray(), np.array(machine.model.gap(machine.values).weights)
        before = moving.rates(end)
        return (reset + np.outer(moving.rates(start) - reset @ before, normal) / (normal @ before)) @ transition

    @cached_property
    def _reset(self) -> ca.Function:
        """The derivative of the state after an elastic impact by that before it."""
        x, machine = ca.SX.sym("x", 2 * self.n), self.oscillator.machine
        after = ca.vertcat(*elastic(machine.model, ca.vertsplit(x), machine.values))
        return ca.Function("reset", [x], [ca.densify(ca.jacobian(after, x))])

    def closes_after(self, share: float) -> bool:
        """Whether the first motion is at its beginning again after a share of its duration."""
        found = self.oscillator.equations.evaluate_all(self.first[None, :-1], self.parameters_at(self.first[None]))
        path = found.trajectories[1].only(self.oscillator.states)[0]
        moved = (path(share * self.first[-3]) - path(0.0)) / self.oscillator.sizes(self.first[None])[0, : 2 * self.n]
        return bool(np.abs(moved).max() < OSCILLATOR.closed)

    def lost(self, lane: int, passed: Any, error: object) -> Start | End:
        last = passed[-1][-1:]
        duration, _, energy = (last.tangents / self.size(last.lanes, last.xs))[0, -3:]
        if abs(energy) < OSCILLATOR.hangs * duration:
            text = "it stays ever longer near an unstable equilibrium; the last energy found is {energy:.6g}"
            return End("homoclinic", Message(text, energy=Quantity(float(last.values[0]), ENERGY)), lane=lane)
        return End("stuck", error if isinstance(error, str) else Message("{error}", error=error), lane=lane)


def _turning_period(problem: Problem, points: Points) -> Array:
    """The components (m,) of the tangents along the period, NaN where it hardly changes."""
    found = points.tangents[:, -3] / problem.size(points.lanes, points.xs)[:, -3]
    return np.where(np.abs(found) < OSCILLATOR.turns, np.nan, found)


def _flips(problem: Any, points: Points) -> Array:
    """Determinants (m,) that vanish where a multiplier is -1."""
    matrices = problem.others(points)
    return np.linalg.det(matrices + np.eye(matrices.shape[1]))


def _collisions(problem: Any, points: Points) -> Array:
    """The discriminants (m,) of the sums a = multiplier + 1/multiplier: below 0 where two are a complex pair, so that
    four multipliers have left the unit circle or the real line."""
    found, k = np.empty(len(points)), problem.n - 1
    for i, matrix in enumerate(problem.others(points)):
        # All sums occur twice among the eigenvalues of M + 1/M, whose powers give their polynomial by Newton's sums.
        both, power, sums, c = matrix + np.linalg.inv(matrix), np.eye(2 * k), [], [1.0]
        for order in range(1, k + 1):
            power = power @ both
            sums.append(np.trace(power) / 2)
            c.append(-sum(c[order - j] * sums[j - 1] for j in range(1, order + 1)) / order)
        roots = np.roots(c)
        apart = [roots[a] - roots[b] for a in range(k) for b in range(a)]
        found[i] = np.prod(np.square(apart)).real
    return found


def near_rest(oscillator: Oscillator, number: int, energy: float) -> OscillationCurve:
    """The curve of the family of a normal mode, or of bounces, from an energy at most as large as the stated one;
    raises `NoOrbit` where no family begins there, and `InputError` for a number without a family."""
    if oscillator.bounces and number > 1:
        raise InputError(f"family = {number}: one family of bounces begins at the equilibrium")
    if not 1 <= number <= oscillator.n:
        raise InputError(f"family = {number}: the normal modes of this machine are numbered from 1 to {oscillator.n}")
    guess = oscillator.bounce if oscillator.bounces else oscillator.mode(number)
    error: OrbitsError | None = None
    for _ in range(OSCILLATOR.attempts):
        x, weights, duration = guess(energy)
        u = np.array([*x, duration, 0.0])
        try:
            if abs(_energy_of(oscillator, u) / energy - 1) > OSCILLATOR.other_energy:
                raise NoOrbit(f"the normal mode has another energy than {energy:.3g}")
            curve = _solved(oscillator, u, weights, energy)
            if abs(curve.first[-3] / duration - 1) < OSCILLATOR.same_period:
                return curve
        except (NoOrbit, FlowError) as found:
            error = found
        energy *= OSCILLATOR.smaller
    what = "no bounces are" if oscillator.bounces else f"no oscillation of normal mode {number} is"
    raise NoOrbit(f"{what} found near the equilibrium{f': {error}' if error else ''}")


def near_motion(oscillator: Oscillator, start: Mapping[str, float]) -> OscillationCurve:
    """The curve through an oscillation near a motion, stated by its states, 0 where left out, and its duration."""
    x = np.array([start.get(name, 0.0) for name in oscillator.states])
    u = np.array([*x, start[DURATION], 0.0])
    speeds, rates = x[1::2], oscillator.moving.rates(x)[1::2]
    weights = rates - (rates @ speeds) / max(speeds @ speeds, np.finfo(float).tiny) * speeds
    if not (oscillator.bounces or np.linalg.norm(weights) > 1e-3 * np.linalg.norm(rates)):
        raise InputError(
            "start: its speeds do not turn there; state the motion at another instant, such as one at rest"
        )
    weights /= max(np.linalg.norm(weights), np.finfo(float).tiny)
    try:
        curve = _solved(oscillator, u, weights, _energy_of(oscillator, u))
    except (NoOrbit, FlowError) as error:
        raise NoOrbit(f"start leads to no oscillation of its energy; state one nearer to it. {error}") from None
    for count in () if oscillator.bounces else OSCILLATOR.periods:
        if curve.closes_after(1 / count):
            first = dict(zip((*oscillator.states, DURATION), curve.first.tolist(), strict=False))
            return near_motion(oscillator, first | {DURATION: first[DURATION] / count})
    return curve


def _energy_of(oscillator: Oscillator, u: Array) -> float:
    """The energy at the beginning of a motion with these unknowns."""
    p = oscillator.with_weights(np.zeros(oscillator.n), 0.0)
    return float(oscillator.equations.evaluate_all(u[None], p[None]).residual[0, 0])


def _solved(oscillator: Oscillator, u: Array, weights: Array, energy: float) -> OscillationCurve:
    """The curve through the solution near unknowns at an energy; raises `NoOrbit` without convergence."""
    p = oscillator.with_weights(weights, energy)
    least = oscillator.sizes(np.array([[*u, energy]]))[0, :-1]
    solution, _ = oscillator.equations.newton(u, p, least=least)
    return OscillationCurve(oscillator, p, np.append(solution, energy))
