"""The certificate of an orbit: what makes it a motion, and how far its launch speed can be off.

Nothing here reuses the equations that were solved, except to push a defect through their Jacobian.
"""

from collections.abc import Mapping
from functools import lru_cache

import casadi as ca
import numpy as np

from .calls import Call
from .errors import FlowError, NoOrbit
from .flow import Flow, Trajectory, first_zero, flow
from .model import Affine, Model, Phase
from .orbit import Certificate
from .polynomial import derivative, evaluate, lowest, piecewise_roots
from .shooting import Evaluation, Shooting, solve
from .steps import runge_kutta

# Square root of the number of steps from which roundings add by their bias more than at random.
LONG_WALK = 20.0
# Growth of a difference over the flight that the random walk of roundings covers by itself.
SHEAR = 8.0
# Order-8 steps taken in one call.
SEVERAL = 8
# Gauss points for the work along the straight line between two nodes; the field is analytic on it.
GAUSS = 16
GAUSS_POINTS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(GAUSS)
EPS = float(np.finfo(float).eps)


def error_bound(equations: Shooting, u, p, here: Evaluation) -> float:
    """Bound on the error of the unknown "alpha".

    The motion is integrated again by another method with smaller steps; what the equations then lack goes through the
    inverse Jacobian. To it comes the rounding that both integrations may share: a random walk of half a unit in the
    last place of the state a step, through the same inverse, and grown by the flow where that grows (in a long flight
    of a nonlinear spring a change of amplitude becomes one of phase).
    """
    residual = equations.residual(u, p, here, _another_way)
    index = equations.statement.unknowns.index("alpha")
    inverse = solve(here.jacobian.T, np.eye(equations.size)[index])  # the row of the inverse that belongs to alpha
    noise = 0.0
    for along, path, transition in zip(equations.flows, here.trajectories, here.transitions, strict=True):
        size = np.abs(path.coefficients[:, : along.size, 0]).max()
        growth = max(1.0, np.linalg.norm(transition) / SHEAR)
        walk = np.sqrt(len(path.steps))
        noise += EPS / 2 * size * walk * (1 + walk / LONG_WALK) * growth
    # The check has roundings of its own, of the size of what it measures: as much again.
    alpha = u[index]
    return float(2 * abs(inverse @ residual) + np.linalg.norm(inverse) * noise + np.spacing(alpha))


def _another_way(along: Flow, start, p, path: Trajectory) -> np.ndarray:
    """The end of a motion by order-8 Runge-Kutta steps where it was found by Taylor's, else by scipy's DOP853."""
    data = along.mesh_data(path, p)
    x = start
    if along.method != "Runge-Kutta":
        several = _several_steps(along)
        for h, d, c in zip(path.steps, data.T, path.coefficients[:, : along.size], strict=True):
            count = _substeps(c, h)
            for _ in range(count // SEVERAL):
                x = several(x, h / count, d)[0].ravel()
        return x
    from scipy.integrate import solve_ivp  # slow to import, and only laws without a Taylor series need it

    for i, h in enumerate(path.steps):
        rates = lambda t, y, d=data[:, i]: along.rates(y, d)  # noqa: E731
        x = solve_ivp(rates, (0, h), x, method="DOP853", rtol=1e-13, atol=1e-15 * (1 + np.abs(x).max())).y[:, -1]
    return x


def _substeps(coefficients, h: float) -> int:
    """Order-8 steps, a multiple of `SEVERAL`, that bring the error over a step of length `h` below rounding.

    It is the ninth Taylor term of one of them, as many times as there are.
    """
    ninth = np.abs(coefficients[:, 9]).max() * h**9 / max(np.abs(coefficients[:, 0]).max(), 1e-300)
    return SEVERAL * int(np.clip(np.ceil((ninth / (0.01 * EPS)) ** (1 / 8) / SEVERAL), 1, 250))


@lru_cache(maxsize=64)
def _several_steps(along: Flow) -> Call:
    h = ca.SX.sym("h")
    end = along.graph.x
    for _ in range(SEVERAL):
        end = runge_kutta(along.graph, end, h)
    return Call(ca.Function("several", [along.graph.x, h, along.graph.p], [end]))


def contact_half(model: Model, u: Mapping[str, float], p: Mapping[str, float], limit: float) -> Trajectory | None:
    """The contact after a lossless landing up to its middle, or None when the body never turns back within `limit`."""
    along = flow(model.contact, tuple(p))
    start = np.array(model.touchdown(u, p), dtype=float)
    try:
        path, _ = along.run(start, np.array(list(p.values())), limit, stop=first_zero(model.contact_speed))
    except FlowError:
        return None
    turned = abs(model.contact_speed(path.end[: along.size])) <= 1e-6 * abs(model.contact_speed(start))
    return path if turned else None


def count_family(model: Model, parts: tuple[Trajectory, ...]) -> int:
    """Stationary points of the extension after lift-off up to and with mid-flight, less one.

    parts : the flight from lift-off to its middle, and, where it is not its mirror image, from landing backwards
    """
    turns = 0
    for part in parts:
        speed = derivative(model.extension.series(part.coefficients))
        found = [part.times[i] + t for i, t in piecewise_roots(speed, part.steps)]
        turns += sum(t < part.times[-1] * (1 - 1e-7) for t in found)  # the one left out is mid-flight itself
    return int(turns // len(parts))


def interior_minima(gap, part: Trajectory) -> list[tuple[float, float]]:
    """(height, time) of the gap's local minima inside one part of the flight, from its coefficients (N, K + 1).

    The part starts from a zero of order three of the gap, which is divided out exactly.
    """
    slope = derivative(gap)
    end = part.times[-1]
    found = [
        (float(evaluate(gap[i], t)), float(part.times[i] + t))
        for i, t in piecewise_roots(slope, part.steps, start=2, rising=True)
    ]
    found = [(height, t) for height, t in found if t < end * (1 - 1e-7)]
    middle, rate = float(evaluate(gap[-1], part.steps[-1])), evaluate(slope[-1], part.steps[-1])
    if abs(rate) * end < 1e-6 * np.abs(gap[:, 0]).max() and evaluate(derivative(slope[-1]), part.steps[-1]) > 0:
        found.append((middle, float(end)))
    return found


def certify(
    model: Model,
    u: Mapping[str, float],
    p: Mapping[str, float],
    parts: tuple[Trajectory, ...],
    contact: Trajectory | None,
    gap_slope: float,
    residual: float,
    error: float,
) -> Certificate:
    """Check an orbit.

    parts : the flight from lift-off to its middle, and, where it is not its mirror image, from landing backwards
    contact : its first half, None when it does not end
    gap_slope : derivative with respect to alpha of the gap at the orbit's landing time
    """
    minima, jerks, violations, words = [], [], [], model.violations
    for part in parts:
        gap = model.gap(p).series(part.coefficients)
        jerks.append(6 * gap[0, 3])
        minima += interior_minima(gap, part)
    jerk, clearance = min(jerks), min(minima, default=(None, None))
    if jerk <= 0:
        violations.append(f"the gap opens the wrong way at landing (landing jerk {-jerk:.3g}, must be negative)")
    if minima and clearance[0] <= 0:
        violations.append(f"{words['gap']} at t = {clearance[1]:.6g} of the flight (height {clearance[0]:.3g})")
    force = peak = None
    if contact is None:
        violations.append(words["end"])
    else:
        force, peak, violation = _contact_force(contact, words["pull"])
        violations += violation
    separation, violation = _separation(model, p, parts, contact)
    violations += violation

    work, slope = _energies(model, tuple(p))
    values = np.array(list(p.values()))
    rise = float(slope(u["liftoff"], u["alpha"], values, _data_at(model.flight, parts[0], p)))
    drift = max(_drift(work[0], model.flight, part, p) for part in parts)
    if contact is not None:
        drift = max(drift, _drift(work[1], model.contact, contact, p))
    loss = None
    if jerk > 0 and gap_slope != 0:
        loss = model.impact_mass(p) * jerk**2 / 8 * (6 * abs(gap_slope) / jerk) ** (4 / 3) / rise
    figures = (residual, error, drift, jerk, rise, *(value for value in (loss, separation, force) if value is not None))
    if not np.isfinite(figures).all():
        raise NoOrbit("the orbit cannot be certified: its numbers overflow; state the machine in units nearer to 1")
    return Certificate(
        family=count_family(model, parts),
        residual=float(residual),
        error=float(error),
        energy_drift=drift / (0.5 * u["alpha"] * rise),
        clearance=clearance[0],
        smallest_separation=separation if contact is not None else None,
        smallest_contact_force=force,
        largest_contact_force=peak,
        landing_jerk=-float(jerk),
        loss_coefficient=loss and float(loss),
        stable_side=loss and ("above" if gap_slope > 0 else "below"),
        violations=tuple(violations),
        unfolding=u.get("unfolding"),
    )


def _separation(model, p, parts, contact) -> tuple[float | None, list[str]]:
    """Least separation over the cycle, None where no length is stated, and a violation where it is not positive."""
    distance = model.separation(p)
    if distance is None:
        return None, []
    found = [(*lowest(distance.series(part.coefficients), part.steps), part, "flight") for part in parts]
    if contact is not None:
        standing = Affine(tuple(np.array(distance.weights) @ model.embed), distance.offset)
        series = standing.series(contact.coefficients[:, : len(model.contact.states)])
        found.append((*lowest(series, contact.steps), contact, "contact"))
    least, piece, t, path, where = min(found, key=lambda entry: entry[0])
    if least > 0:
        return least, []
    when = path.times[piece] + t
    return least, [f"{model.violations['separation']} at t = {when:.6g} of the {where} (separation {least:.3g})"]


def _contact_force(contact: Trajectory, pulls: str) -> tuple[float | None, float, list[str]]:
    """Lowest interior minimum of the force over the half contact (None without one), its peak, and a violation where
    it pulls. It starts from a simple zero, which is divided out exactly."""
    force = contact.row("contact force")
    slope, end, h = derivative(force), contact.times[-1], contact.steps[-1]
    turns = [(i, t) for i, t in piecewise_roots(slope, contact.steps, rising=True)]
    minima = [float(evaluate(force[i], t)) for i, t in turns if contact.times[i] + t < end * (1 - 1e-7)]
    if evaluate(derivative(slope[-1]), h) > 0:  # mid-contact itself
        minima.append(float(evaluate(force[-1], h)))
    largest = -lowest(-force, contact.steps)[0]
    for i, t in piecewise_roots(force, contact.steps, start=1)[:1]:
        return min(minima, default=None), largest, [f"{pulls} in contact at t = {contact.times[i] + t:.6g}"]
    begins = [f"{pulls} as soon as the contact begins"] if force[0, 1] <= 0 else []
    return min(minima, default=None), largest, begins


@lru_cache(maxsize=64)
def _energies(model: Model, parameters: tuple[str, ...]):
    """The energy gradients of flight and contact as functions (x, (p, q)), and dE/dalpha at launch."""
    gradients = []
    for phase, gradient in ((model.flight, model.flight_gradient), (model.contact, model.contact_gradient)):
        along = flow(phase, parameters)
        x = ca.SX.sym("x", along.size)
        p = ca.SX.sym("p", len(parameters) + (phase.pieces.size if phase.pieces else 0))
        gradients.append(ca.Function("gradient", [x, p], [ca.vertcat(*gradient(*along.symbols(x, p)))]))
    liftoff, alpha = ca.SX.sym("liftoff"), ca.SX.sym("alpha")
    p = ca.SX.sym("p", len(parameters))
    q = ca.SX.sym("q", model.flight.pieces.size if model.flight.pieces else 0)
    named = dict(zip(parameters, ca.vertsplit(p), strict=True))
    start = ca.vertcat(*model.launch({"liftoff": liftoff, "alpha": alpha}, named))
    rise = ca.dot(gradients[0](start, ca.vertcat(p, q)), ca.jacobian(start, alpha))
    return gradients, ca.Function("rise", [liftoff, alpha, p, q], [rise])


def _data_at(phase: Phase, path: Trajectory, p: Mapping[str, float]) -> np.ndarray:
    along = flow(phase, tuple(p))
    return along.piece_data(path.coefficients[0, : along.size, 0], np.array(list(p.values())))[0]


def _drift(gradient: ca.Function, phase: Phase, path: Trajectory, p: Mapping[str, float]) -> float:
    """Largest change of energy along a motion: the work of the gradient on the straight lines between the nodes."""
    along = flow(phase, tuple(p))
    n = along.size
    nodes = np.vstack([path.coefficients[:, :n, 0], path.end[:n]])
    s, weights = 0.5 * (GAUSS_POINTS + 1), 0.5 * GAUSS_WEIGHTS
    moves = np.diff(nodes, axis=0)
    points = nodes[:-1, None] + s[None, :, None] * moves[:, None]
    data = np.repeat(along.mesh_data(path, np.array(list(p.values()))), GAUSS, axis=1)
    rates = np.array(gradient(points.reshape(-1, n).T, data)).T.reshape(points.shape)
    changes = np.einsum("kgn,kn,g->k", rates, moves, weights)
    return float(np.abs(np.cumsum(changes)).max())
