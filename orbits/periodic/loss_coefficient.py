"""The return of hops near a lossless hop: with a loss of C |d|**(4/3), or of 10 C where they land with a bounce.

A plastic landing only loses, so that the next launch speed is never above the last: a lossless hop attracts from above
and repels from below. Which side has the bounce depends on the sign of the gap's derivative by alpha at landing: where
it is positive a launch with more speed still flies at the nominal time and lands once; with less it strikes earlier,
and bounces. Past a fold of a family it is negative, and the bounce is above.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

import casadi as ca
import numpy as np

from ..laws.law import Algebraic

# The imaginary part of a complex step: so small that its square vanishes relative to any number.
COMPLEX_STEP = 1e-30


def loss_coefficient(impact_mass: Algebraic, jerk: Algebraic, gap_slope: Algebraic, power: Algebraic) -> Algebraic:
    """C of the one-step map alpha + d -> alpha + d - C |d|**(4/3) on the side without a bounce, of numbers, arrays or
    CasADi expressions.

    Near a lossless landing the gap varies as gap_slope d - jerk t**3/6. Its remaining speed where it vanishes is lost,
    and `power` is the derivative of the launch energy by alpha.
    """
    return impact_mass * jerk**2 / 8 * (6 * gap_slope / jerk) ** (4 / 3) / power


def launch_power(gradient: Iterable, direction: Iterable) -> Algebraic:
    """Derivative by alpha of the energy at launch, from the energy's gradient and the state's derivative there."""
    return sum(g * d for g, d in zip(gradient, direction, strict=True))


def by_launch_speed(function: Callable[[Mapping], Sequence], u: Mapping, slope: Algebraic = None) -> list:
    """Derivatives by the launch speed of arithmetic expressions of the unknowns, which are symbols, numbers or arrays;
    for numbers a complex step is exact. `slope` is that of the extension at lift-off, None where it stays."""
    if isinstance(u["alpha"], ca.SX):
        values = ca.vertcat(*function(u))
        moved = 0.0 if slope is None else ca.jacobian(values, u["liftoff"]) * slope
        return ca.vertsplit(ca.densify(ca.jacobian(values, u["alpha"]) + moved))
    step = {"alpha": 1.0} | ({} if slope is None else {"liftoff": slope})
    shifted = {**u, **{name: u[name] + 1j * COMPLEX_STEP * change for name, change in step.items()}}
    return [np.imag(x) / COMPLEX_STEP for x in function(shifted)]
