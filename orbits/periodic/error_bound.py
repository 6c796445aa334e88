"""How far the launch speed of a solved orbit can be off.

Nothing here reuses the equations that were solved, except to push a defect through their Jacobian.
"""

from functools import lru_cache

import casadi as ca
import numpy as np

from ..errors import NoOrbit
from ..flow.flow import Flow
from ..flow.taylor import runge_kutta
from ..flow.trajectory import Trajectory
from ..numerics.bernstein import powers
from ..numerics.linear import solve
from ..numerics.quadrature import GAUSS, GAUSS_PLACES, GAUSS_WEIGHTS
from ..symbolic.calls import BufferedFunction
from .evaluation import Evaluation
from .single_shooting import Shooting

# Square root of the number of steps from which roundings add by their bias more than at random.
LONG_WALK = 20.0
# Growth of a difference over the flight that the random walk of roundings covers by itself.
SHEAR = 4.0
# Order-8 steps are taken in one call, their number a multiple of this.
SEVERAL = 32
# An error beyond this share, and far beyond what rounding explains, shows that the steps have leapt over a feature of a
# law.
WORST_ERROR, DOUBTFUL_RATIO = 1e-11, 1e4
EPS = float(np.finfo(float).eps)
NARROW = (
    ". Either it hangs at an unstable equilibrium, where rounding decides, or it crosses something narrower than an "
    "integration step: smooth the law, or give breakpoints to "
    "springs.function"
)


def error_bounds(
    equations: Shooting, us, ps, here: Evaluation, closing=None, quickly: bool = False
) -> tuple[np.ndarray, dict[int, NoOrbit]]:
    """Bounds (m,) on the errors of the unknown "alpha" in solutions (m, n), with parameters (m, np), of the equations
    `stacked` there; and by index why some cannot be believed.

    The motion is integrated again by another method with smaller steps, or `quickly`, where the flow allows it, the
    field is integrated along each step's polynomial by Gauss's rule, and what the step's end lacks is carried on to the
    arc's end. What the equations then lack goes through the inverse Jacobian. To it comes the rounding that both
    integrations may share: a random walk of half a unit in the last place of the state a step, through the same
    inverse, and grown by the flow where that grows (in a long flight of a nonlinear spring a change of amplitude
    becomes one of phase).

    closing : rows (m, n + 1) that close the equations where a parameter is varied too, the last unit vector for errors
        at the parameter's value
    """
    (along,) = equations.flows if len(equations.flows) == 1 else (None,)
    quickly = quickly and along is not None and along.smooth and here.trajectories[0].variations is not None
    residuals, refused = _defects(equations, us, ps, here) if quickly else np.full_like(here.residual, np.nan), {}
    for i in np.flatnonzero(~np.isfinite(residuals).all(1)):
        paths = tuple(motions[i] for motions in here.trajectories)
        try:
            residuals[i] = equations.residual(us[i], ps[i], paths, _another_way)
        except NoOrbit as error:
            refused[int(i)] = error
    bounds, doubtful = _bounds_from_defects(equations, us, here, closing, residuals)
    return bounds, doubtful | refused


def _bounds_from_defects(
    equations: Shooting, us, here: Evaluation, closing, residuals
) -> tuple[np.ndarray, dict[int, NoOrbit]]:
    """What residuals (m, n) measured in another way mean for "alpha", with their floors; as in `error_bounds`."""
    n, index = equations.size, equations.statement.unknowns.index("alpha")
    square = here.jacobian if closing is None else np.concatenate([here.jacobian, closing[:, None]], axis=1)
    inverse = solve(square.swapaxes(1, 2), np.eye(square.shape[1])[:, [index]])[:, :n, 0]  # the inverse's row of alpha
    noise = np.zeros(len(us))
    for along, motions, transition, start in zip(
        equations.flows, here.trajectories, here.transitions, here.starts, strict=True
    ):
        size = motions.largest(motions.coefficients[:, : along.size, 0])
        growth = np.maximum(1.0, np.linalg.norm((transition @ start)[:, :, :n], axis=(1, 2)) / SHEAR)
        walk = np.sqrt(motions.counts)
        noise += EPS / 2 * size * walk * (1 + walk / LONG_WALK) * growth
    # The check has roundings of its own, of the size of what it measures: as much again.
    alpha = us[:, index]
    found = 2 * np.abs(np.einsum("mi,mi->m", inverse, residuals))
    floor = np.linalg.norm(inverse, axis=1) * noise + np.spacing(alpha)
    doubtful = {}
    for i in np.flatnonzero(found > np.maximum(WORST_ERROR * alpha, DOUBTFUL_RATIO * floor)).tolist():
        off = f"launch speed {alpha[i]:.6g} may be off by {found[i]:.1e}"
        doubtful[i] = NoOrbit(f"the orbit cannot be certified: {off}{NARROW}")
    return found + floor, doubtful


def _defects(equations: Shooting, us, ps, here: Evaluation) -> np.ndarray:
    """The residuals (m, n) that the equations have at the motions' ends when the defects of the steps are made good."""
    (along,), (motions,), (transition,), (holds,) = (
        equations.flows,
        here.trajectories,
        here.transitions,
        here.residual_by_end,
    )
    n, h, last = along.size, motions.steps, motions.last
    c = motions.coefficients[:, :n]
    scaled = c * motions.of_steps[:, None]
    states = (scaled @ powers(GAUSS_PLACES, c.shape[2]).T).swapaxes(1, 2)
    data = np.repeat(ps, motions.counts * GAUSS, axis=0)
    rates = along.fields(states.reshape(-1, n), data)[0].reshape(-1, GAUSS, n)
    after, carried = np.roll(c[:, :, 0], -1, axis=0), np.roll(motions.variations[:, :, :n, 0], -1, axis=0)
    after[last], carried[last] = motions.finals[:, :n], transition[:, :, :n]
    defects = after - c[:, :, 0] - h[:, None] * (GAUSS_WEIGHTS @ rates)
    at_start = np.add.reduceat(solve(carried, defects[..., None])[..., 0], motions.first)
    wrong = np.einsum("pij,pj->pi", transition[:, :, :n], at_start)
    (residuals,) = equations.arrivals(us, ps, motions.finals[:, :n])
    return residuals[:, :, 0] - np.einsum("pij,pj->pi", holds, wrong)


def _another_way(along: Flow, start, p, path: Trajectory) -> np.ndarray:
    """The end of a motion by order-8 Runge-Kutta steps where it was found by Taylor's, else by scipy's DOP853."""
    data = along.mesh_data(path, p)
    x = start
    if along.method != "Runge-Kutta":
        counts = _substeps(path.coefficients[:, : along.size], path.steps)
        count = int(np.ceil(counts.sum() / SEVERAL)) * SEVERAL
        idle = count - counts.sum()  # steps of no length
        lengths = np.append(np.repeat(path.steps / counts, counts), np.zeros(idle))
        data = np.repeat(data, np.append(counts[:-1], counts[-1] + idle), axis=1)
        return _order_eight(along, count)(start, lengths, data)[0][:, -1]
    from scipy.integrate import solve_ivp  # slow to import, and only laws without a Taylor series need it

    for i, h in enumerate(path.steps):
        rates = lambda t, y, d=data[:, i]: along.rates(y, d)  # noqa: E731
        x = solve_ivp(rates, (0, h), x, method="DOP853", rtol=1e-13, atol=1e-15 * (1 + np.abs(x).max())).y[:, -1]
    return x


def _substeps(coefficients, steps) -> np.ndarray:
    """Order-8 steps (N,) that bring the error over each step of a motion below rounding; shapes as in `Trajectory`.

    It is the ninth Taylor term of one of them, as many times as there are.
    """
    ninth = np.abs(coefficients[:, :, 9]).max(1) * steps**9 / np.maximum(np.abs(coefficients[:, :, 0]).max(1), 1e-300)
    return 8 * np.clip(np.ceil((ninth / (0.01 * EPS)) ** (1 / 8) / 8), 1, 250).astype(int)  # and no fewer samples


@lru_cache(maxsize=64)
def _order_eight(along: Flow, count: int) -> BufferedFunction:
    """`count` Runge-Kutta steps as a call (start, lengths, parameters with data) -> states (n, count)."""
    h = ca.SX.sym("h")
    step = ca.Function(
        "step",
        [along.vector_field.x, h, along.vector_field.p],
        [runge_kutta(along.vector_field, along.vector_field.x, h)],
    )
    return BufferedFunction(step.mapaccum(count))
