"""What a kind of machine is to the engine: its phases, and what makes a motion of them a lossless orbit.

Nothing here knows a hopper.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from .phase import Affine, Phase, Statement


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
