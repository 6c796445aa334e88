"""Oscillations of a machine: its periodic motions of one arc, along their energy, as a problem of curves.

The arc is a motion with a closed gap, as the body of a standing machine moves, the motion of a machine without a gap,
or the flight of a machine with elastic impacts from one to the next: a bounce. From a stable equilibrium a family leads
along each normal mode whose frequency has no multiple among the others (Lyapunov's centre theorem), and one of bounces;
other families begin at a motion nearby. All energies are those above the energy at the equilibrium, and all numbers are
without dimensions here.
"""

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..errors import NoOrbit
from ..flow import flow_of
from ..model import Machine, Phase, check_machine, dimensionless, refuse_hysteresis, refuse_steps
from ..numerics import Array
from ..shooting import Shooting, moving_phase, parameters_of_cycle, shooting_equations, whole_cycle
from ..units import Message, described
from .energy_changes import gradients

DURATION = "duration"


class OscillatorOptions(NamedTuple):
    """How families of oscillations begin and end."""

    same_period: float = 1e-2  # share by which the period of the first motion may differ from that of its normal mode
    smaller: float = 1e-2  # ratio of an energy to the one before, at which the period differs more
    attempts: int = 12  # energies that are tried
    other_energy: float = 0.1  # share by which the energies of a normal mode and of a first motion may differ
    resonance: float = 1e-6  # distance of a ratio of frequencies from a whole number that is rounding
    periods: tuple[int, ...] = (2, 3, 5, 7)  # a stated duration may be as many periods, and multiples of these
    closed: float = 1e-6  # a motion that returns nearer to its beginning, in units, does so exactly
    newton: int = 50  # steps to an equilibrium
    at_rest: float = 1e-13  # the last one, as a share of the places
    turns: float = 1e-9  # a period that changes less along the curve, in units, has no longest or shortest value
    known: float = 1e-7  # largest error of a period, as a share of it, with which a motion is certified
    on_circle: float = 1e-6  # a multiplier whose modulus exceeds 1 by less is on the unit circle, as far as is known
    at_a_fold: float = 1e-3  # share of the energy in the tangent, in units, below which a point lies at a fold
    hangs: float = 1e-2  # ratio of the relative changes of energy and period below which a lost motion hangs


OSCILLATOR = OscillatorOptions()


def refuse_oscillator(machine: Machine) -> None:
    """Raise `InputError` or `NoOrbit` for a machine whose phase has no oscillations."""
    check_machine(machine, lands=False)
    model = machine.model
    refuse_hysteresis(model)
    if not model.conservative:
        raise NoOrbit(f"this {model.name} is damped or driven: no motion of it keeps its energy; set the damping to 0")
    if is_elastic(machine):
        refuse_steps(model, "a family of bounces")
    if not model.contact.states:
        raise NoOrbit(f"nothing of a {model.name} moves while it stands: it has no oscillations")


def is_elastic(machine: Machine) -> bool:
    """Whether a machine bounces without loss."""
    return machine.model.lands and getattr(machine, "restitution", 0.0) == 1.0


class Modes(NamedTuple):
    """The normal modes at an equilibrium: frequencies (n,), angular and ascending, NaN of one that does not oscillate,
    shapes (n, n) in columns, and the inertia (n, n)."""

    frequencies: Array
    shapes: Array
    inertia: Array


class Moving:
    """A phase of a machine at its parameters, with the gradient of its energy.

    names, values : of the parameters
    """

    def __init__(self, phase: Phase, gradient: Callable, names: tuple[str, ...], values: Array):
        self.phase, self.gradient, self.names, self.values = phase, gradient, names, values
        self.flow = flow_of(phase, names)

    def _arguments(self, x: Array) -> Array:
        """The parameters with the data of the piece at a state."""
        return np.concatenate([self.values, self.flow.data_of_pieces(x[None], self.values[None])[0]])

    def rates(self, x: Array) -> Array:
        """The field (2n,) at a state."""
        return self.flow.rates(x, self._arguments(x))

    def slopes(self, x: Array) -> tuple[Array, Array]:
        """The gradient (2n,) of the energy at a state and its derivatives (2n, 2n)."""
        gradient, hessian = self._slopes(x, self._arguments(x))
        return gradient.toarray().ravel(), hessian.toarray()

    @cached_property
    def _slopes(self) -> ca.Function:
        own = gradients(self.phase, self.gradient, self.names).function
        x, p = own.sx_in()
        value = own(x, p)
        return ca.Function("slopes", [x, p], [ca.densify(value), ca.densify(ca.jacobian(value, x))])


class Oscillator:
    """A machine without dimensions, with the equations of its oscillations, or of its bounces.

    bounces : whether its impacts are elastic, so that it bounces
    states : names (2n,), places and speeds by turns
    rest : the places (n,) of the equilibrium
    standing, moving : the contact, and the phase of its cycles
    """

    def __init__(self, machine: Machine, near: Mapping[str, float] | None = None, below: bool = False):
        """The equilibrium is one near some places, or the minimum of the potential energy `below` these."""
        self.machine, self.bounces = dimensionless(machine), is_elastic(machine)
        model, names = self.machine.model, tuple(self.machine.values)
        values = np.array([*self.machine.values.values()])
        self.standing = Moving(*moving_phase(model, False), names, values)
        self.moving = Moving(*moving_phase(model, True), names, values) if self.bounces else self.standing
        self.states = self.moving.phase.states
        self.n, names = len(self.states) // 2, (*names, *parameters_of_cycle(self.states))
        self.equations: Shooting = shooting_equations(whole_cycle(model, self.bounces), names)
        at_rest = self._equilibrium(near or {}, below)
        self.rest = (model.embed @ at_rest if self.bounces else at_rest)[::2]

    def _equilibrium(self, near: Mapping[str, float], below: bool) -> Array:
        """The contact state at an equilibrium, by Newton's method from the stated places, and where the machine rests
        with its springs unloaded otherwise; downhill only, for the minimum `below`. Raises `NoOrbit` where it leads to
        none."""
        model, names = self.machine.model, self.standing.phase.states
        x = np.zeros(len(names))
        if model.rest:
            x = model.embed.T @ np.array(model.rest(self.machine.values), dtype=float)
        x[::2] = [near.get(name, place) for name, place in zip(names[::2], x[::2], strict=True)]
        for _ in range(OSCILLATOR.newton):
            gradient, hessian = self.standing.slopes(x)
            curvatures, shapes = np.linalg.eigh(hessian[::2, ::2])
            with np.errstate(divide="ignore", invalid="ignore"):
                step = -shapes @ (shapes.T @ gradient[::2] / (np.abs(curvatures) if below else curvatures))
            if not np.isfinite(step).all():
                break
            before = x[::2].copy()
            x[::2] += step
            # Halved while it rises at its end by more than rounding: a minimum lies before that.
            while below and self.standing.slopes(x)[0][::2] @ step > 0.5 * abs(gradient[::2] @ step):
                step = step / 2
                x[::2] = before + step
            if np.abs(step).max() <= OSCILLATOR.at_rest * max(np.abs(x).max(), 1e-3):
                return x
        place = described(names[::2], [near.get(name, 0.0) for name in names[::2]])
        text = "no equilibrium is found near {place}: state places near one, start={{'{name}': ...}}"
        raise NoOrbit(Message(text, place=place, name=names[0]))

    @property
    def _at_rest(self) -> Array:
        """The state (2n,) at the equilibrium."""
        return np.column_stack([self.rest, np.zeros(self.n)]).ravel()

    @cached_property
    def modes(self) -> Modes:
        """The normal modes at the equilibrium; where it bounces, those of the phase with its gap open."""
        hessian = self.moving.slopes(self._at_rest)[1]
        inertia, stiffness = hessian[1::2, 1::2], hessian[::2, ::2]
        inverse = np.linalg.inv(np.linalg.cholesky(inertia))
        squares, shapes = np.linalg.eigh(inverse @ stiffness @ inverse.T)
        shapes = inverse.T @ shapes
        shapes *= np.sign(shapes[np.abs(shapes).argmax(0), np.arange(self.n)])
        with np.errstate(invalid="ignore"):
            return Modes(np.where(squares > 0, np.sqrt(squares), np.nan), shapes, inertia)

    def with_weights(self, weights: Array, energy: float) -> Array:
        """The parameters with the weights (n,) of the speeds in the section, and an energy."""
        return np.concatenate([self.moving.values, self.rest, weights, [energy]])

    def mode(self, number: int) -> Callable[[float], tuple[Array, Array, float]]:
        """Energy -> the state at the beginning, the weights of the section and the duration, of a normal mode."""
        frequency, shape = self._frequency(number), self.modes.shapes[:, number - 1]
        along = np.column_stack([shape, np.zeros(self.n)]).ravel() / frequency
        weights = self.modes.inertia @ shape
        return lambda energy: (self._at_rest + np.sqrt(2 * energy) * along, weights, 2 * np.pi / frequency)

    def bounce(self, energy: float) -> tuple[Array, Array, float]:
        """The state at the beginning, no weights and the duration, of a bounce so small that all else is at rest."""
        model, p, x = self.machine.model, self.machine.values, self._at_rest
        speed = np.sqrt(2 * energy / float(model.impact_mass(x.tolist(), p)))
        falls = -float(np.array(model.gap(p).weights[::2]) @ self.moving.rates(x)[1::2])
        start = x + speed * np.array(model.impact(x.tolist(), p), dtype=float)
        return start, np.zeros(self.n), 2 * speed / falls

    def _frequency(self, number: int) -> float:
        """The angular frequency of a normal mode from which a family leads; raises `NoOrbit` for another."""
        frequencies, place = self.modes.frequencies, self.states[0]
        frequency = float(frequencies[number - 1])
        if np.isnan(frequency):
            text = (
                "the equilibrium {at} is not stable along normal mode {number}, which does not oscillate: state places "
                "near another equilibrium, start={{'{place}': ...}}, or another mode, family="
            )
            raise NoOrbit(Message(text, at=described(self.states[::2], self.rest), number=str(number), place=place))
        ratios = np.delete(frequencies, number - 1) / frequency
        ratios = ratios[np.isfinite(ratios)]
        whole = np.round(ratios)
        if len(found := ratios[(whole > 0) & (np.abs(ratios - whole) < OSCILLATOR.resonance * np.maximum(whole, 1))]):
            raise NoOrbit(
                f"normal mode {number} is resonant: the frequency of another one is {found[0]:.6g} times its own, so "
                f"that its family is not determined; state a motion, start={{'{place}': ..., 'duration': ...}}"
            )
        return frequency

    def sizes(self, xs: Array) -> Array:
        """The units (m, 2n + 3) of a state with its duration, unfolding and energy: those of a normal mode with this
        energy and duration."""
        n, duration, energy = self.n, np.abs(xs[:, -3]), np.abs(xs[:, -1])
        inertia = np.diag(self.modes.inertia)
        found = np.empty(xs.shape)
        found[:, 1 : 2 * n : 2] = np.sqrt(2 * energy[:, None] / inertia)
        found[:, : 2 * n : 2] = found[:, 1 : 2 * n : 2] * duration[:, None] / (2 * np.pi)
        found[:, -3], found[:, -2], found[:, -1] = duration, 1 / (duration * inertia.max()), energy
        return found
