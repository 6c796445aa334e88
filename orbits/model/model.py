"""What a machine is to the toolkit: phases with their vector fields, and the boundary conditions of a lossless orbit.

Nothing here knows a hopper. Expressions are built by plain functions of CasADi scalars: a field is called as
``field(x, p, q)`` with a list `x` of states, a mapping `p` of named parameters and a list `q` of piece data, and
returns a list of expressions.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Affine:
    """The function weights . x + offset of a state, the weights one per state.

    For several motions at once weights and offset may be arrays (m,), one number for each (`Trajectories.series`).
    """

    weights: tuple[float, ...]
    offset: float = 0.0

    def __call__(self, x):
        """Value at states `x` (..., n)."""
        return x @ np.array(self.weights) + self.offset

    def series(self, coefficients):
        """Taylor coefficients (..., K + 1) along those of the state (..., n, K + 1)."""
        along = np.array(self.weights) @ coefficients
        along[..., 0] += self.offset
        return along


@dataclass(frozen=True)
class Pieces:
    """Where a piecewise vector field is smooth: between `breaks` of one coordinate of the state.

    coordinate : the weights w of the coordinate w . x
    size : number of data values of a piece, the `q` of the field
    table : parameters -> (breaks (m + 1), data (m, size)); the motion may not leave [breaks[0], breaks[-1]]
    label : what to call the coordinate in a message
    """

    coordinate: tuple[float, ...]
    size: int
    table: Callable[[Mapping[str, float]], tuple[np.ndarray, np.ndarray]]
    label: str = "coordinate"


@dataclass(frozen=True)
class Oscillator:
    """Closed form of the phase x' = v, v' = -square (x - centre), square > 0.

    watch : watched quantities, (slope, value at x = 0) of each, which must be straight lines in x
    """

    square: float
    centre: float
    watch: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def state(self, start, t):
        """States (2, ...) at times `t` (...) after `start`."""
        omega = np.sqrt(self.square)
        c, s = np.cos(omega * t), np.sin(omega * t)
        x, v = start[0] - self.centre, start[1]
        return np.array([self.centre + x * c + v / omega * s, v * c - omega * x * s])

    def transition(self, t):
        """Derivative (2, 2) of the state at `t` with respect to the start."""
        omega = np.sqrt(self.square)
        c, s = np.cos(omega * t), np.sin(omega * t)
        return np.array([[c, s / omega], [-omega * s, c]])

    def along(self, weights, states, order: int):
        """Taylor coefficients (N, order + 1) of weights . (x, v, watched ...), the motions through `states` (2, N)."""
        at_x, at_v, *others = (*weights, *[0.0] * (2 + len(self.watch) - len(weights)))
        slopes, values = zip(*self.watch.values(), strict=True) if self.watch else ((), ())
        at_x += sum(a * slope for a, slope in zip(others, slopes, strict=True))
        # x - centre and v exchange roles with every derivative
        x, v = states[0] - self.centre, states[1]
        even, odd = at_x * x + at_v * v, at_x * v - at_v * self.square * x
        k = np.arange(order + 1)
        factors = (-self.square) ** (k // 2) / np.cumprod(np.maximum(k, 1.0))
        c = np.where(k % 2, odd[:, None], even[:, None]) * factors
        c[:, 0] += at_x * self.centre + sum(a * value for a, value in zip(others, values, strict=True))
        return c

    def series(self, states, order: int):
        """Taylor coefficients (N, 2 + watched, order + 1) of the motions through `states` (2, N)."""
        k = np.arange(order + 2)
        factors = (-self.square) ** (k // 2) / np.cumprod(np.maximum(k, 1.0))
        c = np.where(k % 2, states[1][:, None], states[0][:, None] - self.centre) * factors
        v = c[:, 1:] * k[1:]
        x = c[:, :-1]
        x[:, 0] = states[0]
        rows = [x, v]
        for slope, value in self.watch.values():
            rows.append(slope * x)
            rows[-1][:, 0] += value
        return np.stack(rows, axis=1)


@dataclass(frozen=True)
class ThrownOscillator:
    """Closed form of an oscillator (x, v) beside a coordinate w thrown up under unit gravity, w'' = -1, both mixed into
    the states: state = mix @ (x, v, w, w').

    mix : (4, 4)
    apart : its inverse, both stated since inverting would round
    """

    oscillator: Oscillator
    mix: np.ndarray
    apart: np.ndarray
    watch: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    square = property(lambda self: self.oscillator.square)

    def state(self, start, t):
        """States (4, ...) at times `t` (...) after `start` (4, ...)."""
        x, v, w, rate = np.tensordot(self.apart, start, 1)
        swung = self.oscillator.state((x, v), t)
        thrown = np.stack(np.broadcast_arrays(w + t * (rate - 0.5 * t), rate - t))
        return np.tensordot(self.mix, np.concatenate([swung, thrown]), 1)

    def transition(self, t):
        """Derivative (4, 4) of the state at `t` with respect to the start."""
        apart = np.eye(4)
        apart[:2, :2], apart[2, 3] = self.oscillator.transition(t), t
        return self.mix @ apart @ self.apart

    def along(self, weights, states, order: int):
        """Taylor coefficients (N, order + 1) of weights . state on the motions through `states` (4, N)."""
        x, v, w, rate = np.tensordot(self.apart, states, 1)
        at_x, at_v, at_w, at_rate = np.asarray(weights) @ self.mix
        form = self.oscillator
        c = form.along((at_x, at_v), np.array([x, v]), order)
        c[:, 0] += at_w * w + at_rate * rate
        c[:, 1] += at_w * rate - at_rate
        c[:, 2] -= 0.5 * at_w
        return c

    def series(self, states, order: int):
        """Taylor coefficients (N, 4, order + 1) of the motions through `states` (4, N)."""
        apart = np.tensordot(self.apart, states, 1)
        rows = np.zeros((apart.shape[1], 4, order + 1))
        rows[:, :2] = self.oscillator.series(apart[:2], order)[:, :2]
        rows[:, 2, 0], rows[:, 2, 1], rows[:, 2, 2] = apart[2], apart[3], -0.5
        rows[:, 3, 0], rows[:, 3, 1] = apart[3], -1.0
        return self.mix @ rows


@dataclass(frozen=True, eq=False)
class Phase:
    """One smooth (or piecewise smooth) way of moving.

    field : (x, p, q) -> x', see the module
    watch : named quantities to carry along as Taylor series, (x, p, q) -> expression
    pieces : where the field is smooth, None for everywhere
    closed_form : parameters -> exact flow of the phase, used instead of integration

    Phases and statements compare by identity: what is built from them is kept as long as they are.
    """

    name: str
    states: tuple[str, ...]
    field: Callable
    watch: Mapping[str, Callable] = field(default_factory=dict)
    pieces: Pieces | None = None
    closed_form: Callable[[Mapping[str, float]], Oscillator | ThrownOscillator] | None = None


@dataclass(frozen=True, eq=False)
class Arc:
    """A phase travelled once: start (u, x_before, p) -> x, duration (u, p), conditions (u, x_end, p) -> zeros.

    `x_before` is the end of the arc before (empty for the first); `guard` (u, x_start, p, q) -> zeros holds at the
    start. `u` and `p` are mappings of names, x and q lists, as in a phase's field.
    """

    phase: Phase
    start: Callable
    duration: Callable
    conditions: Callable
    guard: Callable = lambda u, x, p, q: []


@dataclass(frozen=True, eq=False)
class Statement:
    """A square boundary value problem on a sequence of phases: what makes a motion an orbit.

    unknowns : names of the unknowns u
    durations : names of the unknowns that are times; they stay positive
    arcs : travelled in this order
    """

    name: str
    unknowns: tuple[str, ...]
    arcs: tuple[Arc, ...]
    durations: tuple[str, ...] = ()


@dataclass(frozen=True)
class Units:
    """What one unit of length (m), time (s) and force (N) of a dimensionless machine stands for."""

    length: float
    time: float
    force: float


@dataclass(frozen=True, eq=False)
class Reduction:
    """A smaller statement of the same orbit, in coordinates in which fewer states need integrating.

    statement : its unknowns are "liftoff" and "alpha", which are its two states at lift-off; its one arc is the flight
        from there to its middle
    reversor : sign of each of its states under time reversal
    complete : (times (N,), coefficients (N, n, K + 1), u, p) -> coefficients of the flight states; u and p of each step
    gap_slope : (times (m,), dz (n, m), p) -> derivatives of the gaps with respect to alpha from those of the reduced
        states
    exact : (family, p) -> (u, error of alpha) where the answer is known in closed form, else None
    """

    statement: Statement
    reversor: tuple[int, ...]
    complete: Callable
    gap_slope: Callable
    exact: Callable | None = None


@dataclass(frozen=True, eq=False)
class Model:
    """A kind of machine whose plastic contact can cost nothing; the numbers are in the mapping `p` of its parameters.

    A lossless cycle is a flight from the launch set to its image under the reversor, then a contact back to it. Energy
    is conserved in each phase; only its gradient is asked for, so no potential is needed in closed form. Unknowns `u`
    are mappings too, with "liftoff", the extension at lift-off, and "alpha", the launch speed; what else a launch needs
    has the names of the flight states. What is asked of many orbits together (launch, touchdown, gap, separation,
    impact_mass) is called with arrays (m,) in `u` and `p`: it is plain arithmetic that does not branch on them.

    flight, contact : the phases
    launch_unknowns : names of the unknowns of a launch
    launch : (u, p) -> flight state at lift-off
    liftoff : (u, p, q) -> zero where sustained contact ends
    landing : (u, x, p) -> three expressions that vanish at a lossless landing
    reversor : sign of each flight state under time reversal, None when the model has none
    release : (alpha (m,), p) -> extension (m,) at lift-off with these launch speeds
    touchdown : (u, p) -> contact state after a lossless landing
    embed : matrix (n, m) that makes flight states from contact states
    flight_gradient, contact_gradient : (x, p, q) -> gradient of the energy in that phase
    extension : flight coordinate whose stationary points count the family
    gap : p -> height of the contact point above what it lands on, a function of the flight state
    separation : p -> smallest distance in the machine that must stay positive, None where it is not stated
    heights : p -> names and functions of the flight state, for plots; the masses first, the upper one before the lower
    violations : what to say when the "gap" closes in flight, the contact has to "pull", the "separation" vanishes or
        the contact does not "end"
    springs : names of the heights, lower and upper, between which springs are drawn, None for the ground
    impact_mass : p -> twice the energy lost in a plastic impact over the square of the gap's speed
    impact : p -> direction (n,) in which an impact moves the flight state, along which the gap's speed changes by 1
    contact_speed : contact coordinate that becomes the launch speed
    guess : (family, p) -> a launch and "duration", of the half flight, in the scene with `homotopy` at 0
    conservative : whether flight and contact keep the energy
    homotopy : the parameter that leads from the scene of the guess (0) to this one (1), None where they are one
    reduction : the short cut that this scene allows, None where there is none
    tension : (x, p, q) -> force of the spring in a flight state, None where it is not stated
    """

    name: str
    flight: Phase
    contact: Phase
    launch: Callable
    liftoff: Callable
    landing: Callable
    reversor: tuple[int, ...] | None
    release: Callable
    touchdown: Callable
    embed: np.ndarray
    flight_gradient: Callable
    contact_gradient: Callable
    extension: Affine
    gap: Callable
    separation: Callable
    heights: Callable
    impact_mass: Callable
    impact: Callable
    contact_speed: Affine
    violations: Mapping[str, str]
    springs: tuple[tuple[str | None, str], ...]
    guess: Callable
    launch_unknowns: tuple[str, ...] = ("liftoff", "alpha")
    homotopy: str | None = None
    conservative: bool = True
    reduction: Reduction | None = None
    tension: Callable | None = None

    @property
    def half_unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns of half an orbit: of the launch, and half the times of the phases that are shot."""
        return (*self.launch_unknowns, "duration", *(() if self.one_speed else ("contact_duration",)))

    @property
    def one_speed(self) -> bool:
        """Whether a launch is told by its speed alone; then that speed first vanishes again in mid-contact."""
        return len(self.launch_unknowns) == 2
