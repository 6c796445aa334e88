"""The return of hops near a lossless hop: with a loss of C |d|**(4/3), or of 10 C where they land with a bounce.

A plastic landing only loses, so that the next launch speed is never above the last: a lossless hop attracts from above
and repels from below. Which side has the bounce depends on the sign of the gap's derivative by alpha at landing: where
it is positive a launch with more speed still flies at the nominal time and lands once; with less it strikes earlier,
and bounces. Past a fold of a family it is negative, and the bounce is above.

All of this needs a jerk of the gap that is continuous at the landing. Where a law has a corner at lift-off it is not,
and there is no loss coefficient.
"""

import cmath
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..flow import Flow, flow_of
from ..laws import Algebraic
from ..model import Phase
from ..symbolic import ElementwiseFunction, cached


class LossOptions(NamedTuple):
    """The numbers of the losses near a lossless landing."""

    least_square: float = 1e-20  # of the speed of bounces: the sum of their losses ends there
    # With a larger share of the speed left by a hand-over, or the root of a larger restitution, bounces are too many to
    # be counted: what they lose grows without bounds as the share tends to 1.
    most_left: float = 0.999
    # The jerk of the gap jumps at a landing where it differs by more than this share on both sides: some 1e-4 of a
    # natural time from it, in which a smooth jerk changes far less.
    jerk_jump: float = 2e-3
    sides: float = 4.0  # the distance of these sides from the landing, in multiples of what rounding moves it
    complex_step: float = 1e-30  # so small that its square vanishes relative to any number


LOSSES = LossOptions()


def loss_coefficient(impact_mass: Algebraic, jerk: Algebraic, gap_slope: Algebraic, power: Algebraic) -> Algebraic:
    """C of the one-step map alpha + d -> alpha + d - C |d|**(4/3) on the side without a bounce, of numbers, arrays or
    CasADi expressions.

    Near a lossless landing the gap varies as gap_slope d - jerk t**3/6. Its remaining speed where it vanishes is lost,
    and `power` is the derivative of the launch energy by alpha.
    """
    return impact_mass * jerk**2 / 8 * (6 * gap_slope / jerk) ** (4 / 3) / power


def jerk_jumps(flow: Flow, gap: Sequence, x: np.ndarray, p: np.ndarray, jerk: np.ndarray, off: Any) -> np.ndarray:
    """Whether the jerk (m,) of the gap with these weights jumps (m,) at lossless landings or lift-offs in the flight
    states x (m, n) with the parameters p (m, np), as it does where a law has a corner there.

    The sides are looked at some times as far from the landing as it moves where rounding changes the gap by `off` (m,):
    hardly a launch that differs from alpha in 16 digits lands between them.
    """
    jumps, which = np.zeros(len(x), dtype=bool), np.arange(len(x))
    if flow.is_smooth:
        return jumps
    away = LOSSES.sides * np.cbrt(6 * np.abs(off / jerk))[:, None] * flow.field(x, p)[0]
    if flow.phase.pieces is not None:
        which = (flow.pieces_of(x - away, p) != flow.pieces_of(x + away, p)).nonzero()[0]
    if len(which):
        x, away, p = x[which], away[which], p[which]
        acceleration = _accelerations(flow.phase, tuple(gap), flow.parameters)
        before, here, after = (acceleration(at, flow.data(at, p))[0].ravel() for at in (x - away, x, x + away))
        largest = np.maximum(np.abs(here - before), np.abs(after - here))
        jumps[which] = np.abs(before - 2 * here + after) > LOSSES.jerk_jump * largest
    return jumps


@cached
def _accelerations(phase: Phase, gap: tuple[float, ...], parameters: tuple[str, ...]) -> ElementwiseFunction:
    """The acceleration of a gap at several points, (x, parameters with the data of a piece)."""
    graph = flow_of(phase, parameters).vector_field
    field = graph.field(graph.x, graph.p)[0]
    speed = ca.DM(gap).T @ field
    return ElementwiseFunction(ca.Function("acceleration", [graph.x, graph.p], [ca.jtimes(speed, graph.x, field)]))


def jerks(flow: Flow, gap: Sequence, x: np.ndarray, p: np.ndarray) -> np.ndarray:
    """The third derivatives (m,) in time of the gap with these weights, in flight states x (m, n) with the parameters p
    (m, np), by the equations of motion: a polynomial on a very short step has digits of the gap, and none of these."""
    return _jerks(flow.phase, tuple(gap), flow.parameters)(x, flow.data(x, p))[0].ravel()


@cached
def _jerks(phase: Phase, gap: tuple[float, ...], parameters: tuple[str, ...]) -> ElementwiseFunction:
    """The jerk of a gap at several points, (x, parameters with the data of a piece)."""
    graph = flow_of(phase, parameters).vector_field
    acceleration = _accelerations(phase, gap, parameters).function(graph.x, graph.p)
    jerk = ca.jtimes(acceleration, graph.x, graph.field(graph.x, graph.p)[0])
    return ElementwiseFunction(ca.Function("jerk", [graph.x, graph.p], [jerk]))


@cache
def bounce_factors(e: float) -> tuple[float, float]:
    """What a hop with all its bounces loses where it lands late and early, as multiples of C, with the restitution e,
    at most `LOSSES.most_left`**2; 1 and 10 of a plastic landing.

    The height has the acceleration -tau in a scaled time, from impacts at tau = 1 or -1 on, where a landing that is
    held loses 1/4.
    """
    return _lost_in_bounces(1.0, e), _lost_in_bounces(-1.0, e)


def hand_over_factors(rho: float) -> tuple[float, float]:
    """The factors where a hand-over leaves the share rho of the gap's speed, at most `most_left`: the point that was
    left comes down again at once, since it is pressed down, in another hand-over. To the point that landed this is a
    bounce with the restitution rho^2."""
    return bounce_factors(rho * rho)


def landing_factors(share: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """The `hand_over_factors` where this share of the gap's speed is left, and their derivatives by the share; 1 and
    10, and 0, for shares below 0."""
    if share <= 0:
        return hand_over_factors(0.0), (0.0, 0.0)
    moved = (share + 1j * LOSSES.complex_step) ** 2
    late, early = (_lost_in_bounces(tau, moved).imag / LOSSES.complex_step for tau in (1.0, -1.0))
    return hand_over_factors(share), (late, early)


def _lost_in_bounces(tau: Any, e: Any) -> Any:
    total, speed, root = 0.0, 0.5 * tau * tau, cmath.sqrt if isinstance(e, complex) else math.sqrt
    while abs(speed * speed) > LOSSES.least_square:
        total += (1 - e * e) * speed * speed
        # The height is 0 again where later^2 + later tau - 2 tau^2 = 6 e speed.
        later = 0.5 * (root(9 * tau * tau + 24 * e * speed) - tau)
        speed = 0.5 * (later * later - tau * tau) - e * speed
        tau = later
    return 4 * total


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
    shifted = {**u, **{name: u[name] + 1j * LOSSES.complex_step * change for name, change in step.items()}}
    return [np.imag(x) / LOSSES.complex_step for x in function(shifted)]
