"""Oscillations of a machine: its periodic motions within one phase, along their energy, as a problem of curves.

The phase is that in which a gap is closed, as the body of a standing machine moves, or the whole motion of a machine
without a gap. From a stable equilibrium a family leads along each normal mode whose frequency has no multiple among the
others (Lyapunov's centre theorem); other families begin at a motion nearby. All energies are those above the energy at
the equilibrium, and all numbers are without dimensions here.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..curves import BRANCH, FOLD, End, Points, Problem, Start, Test
from ..errors import FlowError, InputError, NoOrbit, OrbitsError
from ..flow import flow_of
from ..model import CONTACT_FORCE, Affine, Machine, check_machine, dimensionless, refuse_hysteresis
from ..numerics import Array
from ..records import NONE
from ..shooting import Shooting, error_bounds, parameters_of_cycle, shooting_equations, whole_cycle
from ..units import ENERGY, Message, Quantity
from .energy_changes import gradients, work_along
from .extrema_and_zeros import extremes

DURATION = "duration"


class OscillatorOptions(NamedTuple):
    """How families of oscillations begin and end."""

    same_period: float = 1e-2  # share by which the period of the first motion may differ from that of its normal mode
    smaller: float = 1e-2  # ratio of an energy to the one before, at which the period differs more
    attempts: int = 12  # energies that are tried
    resonance: float = 1e-6  # distance of a ratio of frequencies from a whole number that is rounding
    newton: int = 50  # steps to an equilibrium
    at_rest: float = 1e-13  # the last one, as a share of the places
    turns: float = 1e-9  # a period that changes less along the curve, in units, has no longest or shortest value
    known: float = 1e-7  # largest error of a period, as a share of it, with which a motion is certified
    on_circle: float = 1e-6  # a multiplier whose modulus exceeds 1 by less is on the unit circle, as far as is known
    hangs: float = 1e-2  # ratio of the relative changes of energy and period below which a lost motion hangs


OSCILLATOR = OscillatorOptions()


def refuse_oscillator(machine: Machine) -> None:
    """Raise `InputError` or `NoOrbit` for a machine whose phase has no oscillations."""
    check_machine(machine, lands=False)
    model = machine.model
    refuse_hysteresis(model)
    if not model.conservative:
        raise NoOrbit(f"this {model.name} is damped or driven: no motion of it keeps its energy; set the damping to 0")
    if not model.contact.states:
        raise NoOrbit(f"nothing of a {model.name} moves while it stands: it has no oscillations")


class Modes(NamedTuple):
    """The normal modes at an equilibrium: frequencies (n,), angular and ascending, NaN of one that does not oscillate,
    shapes (n, n) in columns, and the inertia (n, n)."""

    frequencies: Array
    shapes: Array
    inertia: Array


class Oscillator:
    """A machine without dimensions, with the equations of its oscillations.

    states : names (2n,), places and speeds by turns
    p : the values (np,) of its parameters, then those of `parameters_of_cycle`
    rest : the places (n,) of the equilibrium
    """

    def __init__(self, machine: Machine, near: Mapping[str, float] | None = None, below: bool = False):
        """The equilibrium is one near some places, or the minimum of the potential energy `below` these."""
        self.machine = dimensionless(machine)
        model = self.machine.model
        self.phase, self.gradient, self.states = model.contact, model.contact_gradient, model.contact.states
        self.names, self.values = tuple(self.machine.values), np.array([*self.machine.values.values()])
        self.n = len(self.states) // 2
        further = parameters_of_cycle(self.states)
        self.equations: Shooting = shooting_equations(whole_cycle(self.phase, self.gradient), (*self.names, *further))
        self.flow = flow_of(self.phase, self.names)
        self.rest = self._equilibrium(near or {}, below)

    def slopes(self, x: Array) -> tuple[Array, Array]:
        """The gradient (2n,) of the energy at a state and its derivatives (2n, 2n)."""
        data = self.flow.data_of_pieces(x[None], self.values[None])[0]
        gradient, hessian = self._slopes(x, np.concatenate([self.values, data]))
        return gradient.toarray().ravel(), hessian.toarray()

    @cached_property
    def _slopes(self) -> ca.Function:
        own = gradients(self.phase, self.gradient, self.names).function
        x, p = own.sx_in()
        value = own(x, p)
        return ca.Function("slopes", [x, p], [ca.densify(value), ca.densify(ca.jacobian(value, x))])

    def _equilibrium(self, near: Mapping[str, float], below: bool) -> Array:
        """The places (n,) of an equilibrium, by Newton's method from the stated places, and where the machine rests
        with its springs unloaded otherwise; downhill only, for the minimum `below`. Raises `NoOrbit` where it leads to
        none."""
        model, x = self.machine.model, np.zeros(2 * self.n)
        if model.rest:
            x = model.embed.T @ np.array(model.rest(self.machine.values), dtype=float)
        x[::2] = [near.get(name, place) for name, place in zip(self.states[::2], x[::2], strict=True)]
        for _ in range(OSCILLATOR.newton):
            gradient, hessian = self.slopes(x)
            curvatures, shapes = np.linalg.eigh(hessian[::2, ::2])
            with np.errstate(divide="ignore", invalid="ignore"):
                step = -shapes @ (shapes.T @ gradient[::2] / (np.abs(curvatures) if below else curvatures))
            if not np.isfinite(step).all():
                break
            before = x[::2].copy()
            x[::2] += step
            # Halved while it rises at its end by more than rounding: a minimum lies before that.
            while below and self.slopes(x)[0][::2] @ step > 0.5 * abs(gradient[::2] @ step):
                step = step / 2
                x[::2] = before + step
            if np.abs(step).max() <= OSCILLATOR.at_rest * max(np.abs(x).max(), 1e-3):
                return x[::2]
        place = ", ".join(f"{name} = {near.get(name, 0.0):g}" for name in self.states[::2])
        raise NoOrbit(f"no equilibrium is found near {place}: state one nearby, start={{'{self.states[0]}': ...}}")

    @cached_property
    def modes(self) -> Modes:
        """The normal modes at the equilibrium."""
        x = np.zeros(2 * self.n)
        x[::2] = self.rest
        hessian = self.slopes(x)[1]
        inertia, stiffness = hessian[1::2, 1::2], hessian[::2, ::2]
        inverse = np.linalg.inv(np.linalg.cholesky(inertia))
        squares, shapes = np.linalg.eigh(inverse @ stiffness @ inverse.T)
        shapes = inverse.T @ shapes
        shapes *= np.sign(shapes[np.abs(shapes).argmax(0), np.arange(self.n)])
        with np.errstate(invalid="ignore"):
            return Modes(np.where(squares > 0, np.sqrt(squares), np.nan), shapes, inertia)

    def with_weights(self, weights: Array, energy: float) -> Array:
        """The parameters with the weights (n,) of the speeds in the section, and an energy."""
        return np.concatenate([self.values, self.rest, weights, [energy]])

    def near_mode(self, number: int, energy: float) -> "OscillationCurve":
        """The curve of the family of a normal mode, from an energy at most as large as the stated one; raises `NoOrbit`
        where no family begins there, and `InputError` for a number without a mode."""
        if not 1 <= number <= self.n:
            raise InputError(f"family = {number}: this machine has {self.n} normal modes, by rising frequency")
        frequency = self._frequency(number)
        shape, weights = self.modes.shapes[:, number - 1], self.modes.inertia @ self.modes.shapes[:, number - 1]
        error: OrbitsError | None = None
        for _ in range(OSCILLATOR.attempts):
            u = np.zeros(2 * self.n + 2)
            u[: 2 * self.n : 2] = self.rest + np.sqrt(2 * energy) / frequency * shape
            u[2 * self.n] = 2 * np.pi / frequency
            try:
                curve = self._curve(u, weights, energy)
                if abs(curve.first[2 * self.n] / u[2 * self.n] - 1) < OSCILLATOR.same_period:
                    return curve
            except (NoOrbit, FlowError) as found:
                error = found
            energy *= OSCILLATOR.smaller
        raise NoOrbit(f"no oscillation is found near normal mode {number}{f': {error}' if error else ''}")

    def _frequency(self, number: int) -> float:
        """The angular frequency of a normal mode from which a family leads; raises `NoOrbit` for another."""
        frequencies, place = self.modes.frequencies, self.states[0]
        frequency = float(frequencies[number - 1])
        if np.isnan(frequency):
            at = ", ".join(f"{name} = {y:.6g}" for name, y in zip(self.states[::2], self.rest, strict=True))
            raise NoOrbit(
                f"the equilibrium {at} is not stable along normal mode {number}, which does not oscillate; state "
                f"another equilibrium by places near it, start={{'{place}': ...}}, or another mode, family="
            )
        ratios = np.delete(frequencies, number - 1) / frequency
        ratios = ratios[np.isfinite(ratios)]
        whole = np.round(ratios)
        if len(found := ratios[(whole > 0) & (np.abs(ratios - whole) < OSCILLATOR.resonance * np.maximum(whole, 1))]):
            raise NoOrbit(
                f"normal mode {number} is resonant: the frequency of another one is {found[0]:.6g} times its own, so "
                f"that its family is not determined; state a motion, start={{'{place}': ..., 'duration': ...}}"
            )
        return frequency

    def near_motion(self, start: Mapping[str, float]) -> "OscillationCurve":
        """The curve through an oscillation near a motion, stated by its states, 0 where left out, and its duration."""
        x = np.array([start.get(name, 0.0) for name in self.states])
        u = np.array([*x, start[DURATION], 0.0])
        data = self.flow.data_of_pieces(x[None], self.values[None])[0]
        speeds, rates = x[1::2], self.flow.rates(x, np.concatenate([self.values, data]))[1::2]
        weights = rates - (rates @ speeds) / max(speeds @ speeds, np.finfo(float).tiny) * speeds
        if not np.linalg.norm(weights) > 1e-3 * np.linalg.norm(rates):
            raise InputError("start: its speeds grow in their own direction there; state the motion at another instant")
        p = self.with_weights(weights / np.linalg.norm(weights), 0.0)
        energy = float(self.equations.evaluate_all(u[None], p[None]).residual[0, 0])
        try:
            return self._curve(u, p[-self.n - 1 : -1], energy)
        except (NoOrbit, FlowError) as error:
            raise NoOrbit(f"start leads to no oscillation of its energy; state one nearer to it. {error}") from None

    def _curve(self, u: Array, weights: Array, energy: float) -> "OscillationCurve":
        p = self.with_weights(weights, energy)
        least = OscillationCurve.sizes(self, np.array([[*u, energy]]))[0, :-1]
        solution, _ = self.equations.newton(u, p, least=least)
        return OscillationCurve(self, p, np.append(solution, energy))


class OscillationCurve(Problem):
    """The oscillations of an oscillator along their energy: X has the state (2n,) at the beginning, the duration, the
    unfolding, and the energy. What it certifies are the columns `ERROR` to `FORCE`, and from `MULTIPLIERS` on the real
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
        if CONTACT_FORCE in oscillator.phase.watch:
            self.tests.append(Test("contact pulls", lambda problem, points: points.own[:, FORCE]))

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
        return self.sizes(self.oscillator, xs)

    @staticmethod
    def sizes(oscillator: Oscillator, xs: Array) -> Array:
        """The units (m, 2n + 3): those of a normal mode with this energy and duration."""
        n, duration, energy = oscillator.n, np.abs(xs[:, -3]), np.abs(xs[:, -1])
        inertia = np.diag(oscillator.modes.inertia)
        found = np.empty(xs.shape)
        found[:, 1 : 2 * n : 2] = np.sqrt(2 * energy[:, None] / inertia)
        found[:, : 2 * n : 2] = found[:, 1 : 2 * n : 2] * duration[:, None] / (2 * np.pi)
        found[:, -3], found[:, -2], found[:, -1] = duration, 1 / (duration * inertia.max()), energy
        return found

    def certify(self, points: Points) -> tuple[Points, Mapping[int, Exception]]:
        equations, ps = self.oscillator.equations, self.parameters_at(points.xs)
        evaluation = points.evaluation[points.places]
        evaluation = replace(evaluation, jacobian=evaluation.jacobian[:, :, :-1])
        errors, refused = error_bounds(equations, points.xs[:, :-1], ps, evaluation, quickly=True, unknown=DURATION)
        for i in np.flatnonzero(errors > OSCILLATOR.known * points.xs[:, -3]).tolist():
            refused.setdefault(i, NoOrbit("its period is lost to rounding, since small changes of the motion grow"))
        motions = evaluation.trajectories[1]
        states = motions.only(self.oscillator.states)
        named = dict(zip(self.oscillator.names, ps.T, strict=False))
        drifts = work_along(self.oscillator.phase, self.oscillator.gradient, states, named)[0] / points.values
        forces = np.full(len(points), NONE)
        if CONTACT_FORCE in motions.names:
            weights = tuple(float(name == CONTACT_FORCE) for name in motions.names)
            forces = extremes(motions, Affine(weights))[0]
        multipliers = np.linalg.eigvals(self.others(points)).astype(complex)
        growth = np.abs(multipliers).max(1, initial=1.0)
        residual = np.abs(evaluation.residual).max(1)
        numbers = np.column_stack([errors, drifts, residual, growth, forces])
        return points.having(own=np.hstack([numbers, multipliers.real, multipliers.imag])), refused

    def others(self, points: Points) -> Array:
        """Matrices (m, 2n - 2, 2n - 2) whose eigenvalues are the multipliers of cycles at points, without the two of
        the time and of the energy, which are 1."""
        m, n = len(points), 2 * self.n
        sizes, x = self.size(points.lanes, points.xs)[:, :n], points.xs[:, :n]
        whole = points.evaluation.transitions[1][points.places][:, :n, :n] * sizes[:, None] / sizes[:, :, None]
        found = np.empty((m, n - 2, n - 2))
        for i in range(m):
            data = self.oscillator.flow.data_of_pieces(x[i : i + 1], self.oscillator.values[None])[0]
            rates = self.oscillator.flow.rates(x[i], np.concatenate([self.oscillator.values, data])) / sizes[i]
            slopes = self.oscillator.slopes(x[i])[0] * sizes[i]
            both = np.array([each / np.linalg.norm(each) for each in (rates, slopes)])
            across = np.linalg.svd(both)[2][2:]
            found[i] = across @ whole[i] @ across.T
        return found

    def lost(self, lane: int, passed: Any, error: object) -> Start | End:
        last = passed[-1][-1:]
        duration, _, energy = (last.tangents / self.size(last.lanes, last.xs))[0, -3:]
        if abs(energy) < OSCILLATOR.hangs * duration:
            text = "it stays ever longer near an unstable equilibrium as its energy tends to {energy:.10g}"
            return End("homoclinic", Message(text, energy=Quantity(float(last.values[0]), ENERGY)), lane=lane)
        return End("stuck", error if isinstance(error, str) else Message("{error}", error=error), lane=lane)


# The columns of what is certified: the bound on the error of the period, the change of the energy as a share of it, the
# residual, the largest modulus of a multiplier, and the least contact force, `NONE` without a contact.
ERROR, DRIFT, RESIDUAL, GROWTH, FORCE, MULTIPLIERS = range(6)


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
