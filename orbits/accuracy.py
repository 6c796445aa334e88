"""How far the launch speed of a solved orbit can be off.

Nothing here reuses the equations that were solved, except to push a defect through their Jacobian.
"""

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from .calls import Call
from .errors import NoOrbit
from .flow import Flow
from .motions import Motions, Trajectory
from .polynomial import powers
from .shooting import Evaluation, Shooting, solve
from .steps import runge_kutta

# Square root of the number of steps from which roundings add by their bias more than at random.
LONG_WALK = 20.0
# Growth of a difference over the flight that the random walk of roundings covers by itself.
SHEAR = 4.0
# Order-8 steps are taken in one call, their number a multiple of this.
SEVERAL = 32
# Gauss points on [0, 1] for the work along a step; the field is analytic on it.
GAUSS = 10
GAUSS_PLACES, GAUSS_WEIGHTS = (0.5 * values for values in np.polynomial.legendre.leggauss(GAUSS))
GAUSS_PLACES += 0.5
# An error beyond this share, and far beyond what rounding explains, shows that the steps have leapt over a feature of a
# law.
WORST_ERROR, FAR = 1e-11, 1e4
EPS = float(np.finfo(float).eps)
NARROW = (
    ". Either it hangs at an unstable equilibrium, where rounding decides, or it crosses something narrower than an "
    "integration step: smooth the law, or give breakpoints to "
    "springs.function"
)


def error_bound(equations: Shooting, u, p, here: Evaluation) -> float:
    """Bound on the error of the unknown "alpha".

    The motion is integrated again by another method with smaller steps; what the equations then lack goes through the
    inverse Jacobian. To it comes the rounding that both integrations may share: a random walk of half a unit in the
    last place of the state a step, through the same inverse, and grown by the flow where that grows (in a long flight
    of a nonlinear spring a change of amplitude becomes one of phase).
    """
    (bound,) = _bounds(equations, [(u, p, here, None)], [_measured(equations, u, p, here)])
    if isinstance(bound, NoOrbit):
        raise bound
    return bound


def error_bounds(equations: Shooting, points: Sequence[tuple]) -> list[float | NoOrbit]:
    """`error_bound` of many points (u, p, here, across), by a quicker check where their flow allows it.

    The field is integrated along each step's polynomial by Gauss's rule; what the step's end lacks is carried on to the
    arc's end.

    across : a row (n + 1,) that closes the equations where a parameter is varied too: the error is then that across
        the curve of solutions, which at a fold is the only one there is; None for that at the parameter's value
    """
    (along,) = equations.flows if len(equations.flows) == 1 else (None,)
    quick = along is not None and along.method == "Taylor" and along.phase.pieces is None
    residuals = _defects(along, points) if quick else [np.array([np.nan])] * len(points)
    residuals = [
        residual if np.isfinite(residual).all() else _measured(equations, *point[:3])
        for residual, point in zip(residuals, points, strict=True)
    ]
    return _bounds(equations, points, residuals)


def _measured(equations: Shooting, u, p, here: Evaluation) -> np.ndarray:
    """The residual (n,) with the motion integrated in another way."""
    return equations.residual(u, p, here.trajectories, _another_way)


def _bounds(equations: Shooting, points: Sequence[tuple], residuals) -> list[float | NoOrbit]:
    """What residuals (n,) measured in another way mean for "alpha", with their floors; as in `error_bounds`."""
    n, index = equations.size, equations.statement.unknowns.index("alpha")
    heres = [here for _, _, here, _ in points]
    square = np.array([here.jacobian for here in heres])
    if square.shape[2] > n:
        closing = [np.eye(n + 1)[n] if across is None else across for *_, across in points]
        square = np.concatenate([square, np.array(closing)[:, None]], axis=1)
    inverse = solve(square.swapaxes(1, 2), np.eye(square.shape[1])[:, [index]])[:, :n, 0]  # the inverse's row of alpha
    noise = np.zeros(len(points))
    for i, along in enumerate(equations.flows):
        motions = Motions([here.trajectories[i] for here in heres])
        size = motions.largest(motions.coefficients[:, : along.size, 0])
        moved = np.array([here.transitions[i] for here in heres]) @ np.array([here.starts[i] for here in heres])
        growth = np.maximum(1.0, np.linalg.norm(moved[:, :, :n], axis=(1, 2)) / SHEAR)
        walk = np.sqrt(motions.counts)
        noise += EPS / 2 * size * walk * (1 + walk / LONG_WALK) * growth
    # The check has roundings of its own, of the size of what it measures: as much again.
    alpha = np.array([u[index] for u, *_ in points])
    found = 2 * np.abs(np.einsum("mi,mi->m", inverse, np.array(residuals)))
    floor = np.linalg.norm(inverse, axis=1) * noise + np.spacing(alpha)
    doubtful = found > np.maximum(WORST_ERROR * alpha, FAR * floor)
    return [
        NoOrbit(f"the orbit cannot be certified: launch speed {a:.6g} may be off by {f:.1e}{NARROW}") if bad else bound
        for bad, a, f, bound in zip(doubtful, alpha, found, (found + floor).tolist(), strict=True)
    ]


def _defects(along: Flow, points: Sequence[tuple]) -> list[np.ndarray]:
    """Of each point the residual that its equations have when the defects of the steps are made good."""
    n, paths = along.size, [here.trajectories[0] for _, _, here, _ in points]
    motions = Motions(paths)
    c, h, last = motions.coefficients[:, :n], motions.steps, motions.last
    scaled = c * powers(h, c.shape[2])[:, None]
    states = (scaled @ powers(GAUSS_PLACES, c.shape[2]).T).swapaxes(1, 2)
    data = np.repeat(np.array([p for _, p, _, _ in points]), motions.counts * GAUSS, axis=0)
    rates = along.fields(states.reshape(-1, n), data)[0].reshape(-1, GAUSS, n)
    ends = motions.finals[:, :n]
    transitions = np.stack([here.transitions[0][:, :n] for _, _, here, _ in points])
    after, carried = np.roll(c[:, :, 0], -1, axis=0), np.concatenate([path.variations[:, :, :n, 0] for path in paths])
    after[last], carried = ends, np.roll(carried, -1, axis=0)
    carried[last] = transitions
    defects = after - c[:, :, 0] - h[:, None] * (GAUSS_WEIGHTS @ rates)
    at_start = np.add.reduceat(solve(carried, defects[..., None])[..., 0], motions.first)
    wrong = np.einsum("pij,pj->pi", transitions, at_start)
    return [here.residual - here.holds[0] @ end for (_, _, here, _), end in zip(points, wrong, strict=True)]


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
def _order_eight(along: Flow, count: int) -> Call:
    """`count` Runge-Kutta steps as a call (start, lengths, parameters with data) -> states (n, count)."""
    h = ca.SX.sym("h")
    step = ca.Function("step", [along.graph.x, h, along.graph.p], [runge_kutta(along.graph, along.graph.x, h)])
    return Call(step.mapaccum(count))
