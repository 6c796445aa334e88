"""The certificate of an orbit: what makes it a motion, and how far its launch speed can be off.

Nothing here reuses the equations that were solved, except to push a defect through their Jacobian.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache

import casadi as ca
import numpy as np

from .calls import Call
from .errors import FlowError, NoOrbit, OutOfRange
from .flow import Flow, Trajectory, first_zero, flow
from .model import Affine, Model, Phase
from .orbit import Certificate
from .polynomial import derivative, evaluate, lowest, piecewise_roots
from .shooting import Evaluation, Shooting, solve
from .steps import runge_kutta

# Square root of the number of steps from which roundings add by their bias more than at random.
LONG_WALK = 20.0
# Growth of a difference over the flight that the random walk of roundings covers by itself.
SHEAR = 4.0
# Order-8 steps are taken in one call, their number a multiple of this.
SEVERAL = 32
# Gauss points for the work along the straight line between two nodes; the field is analytic on it.
GAUSS = 10
GAUSS_POINTS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(GAUSS)
# An error or an energy drift beyond these shares, and far beyond what rounding explains, shows that the steps have
# leapt over a feature of a law.
WORST_ERROR, WORST_DRIFT, FAR = 1e-11, 1e-8, 1e4
EPS = float(np.finfo(float).eps)


NARROW = (
    ". The motion crosses something narrower than an integration step: smooth the law, or give breakpoints to "
    "springs.function"
)


def error_bound(equations: Shooting, u, p, here: Evaluation, across=None) -> float:
    """Bound on the error of the unknown "alpha".

    The motion is integrated again by another method with smaller steps; what the equations then lack goes through the
    inverse Jacobian. To it comes the rounding that both integrations may share: a random walk of half a unit in the
    last place of the state a step, through the same inverse, and grown by the flow where that grows (in a long flight
    of a nonlinear spring a change of amplitude becomes one of phase).

    across : a row (n + 1,) that closes the equations where a parameter is varied too: the error is then that across
        the curve of solutions, which at a fold is the only one there is
    """
    residual = equations.residual(u, p, here.trajectories, _another_way)
    index = equations.statement.unknowns.index("alpha")
    square = here.jacobian[:, : equations.size] if across is None else np.vstack([here.jacobian, across])
    inverse = solve(square.T, np.eye(len(square))[index])[
        : equations.size
    ]  # the row of the inverse that belongs to alpha
    noise = 0.0
    ways = zip(equations.flows, here.trajectories, here.transitions, here.starts, strict=True)
    for along, path, transition, start in ways:
        size = np.abs(path.coefficients[:, : along.size, 0]).max()
        growth = max(1.0, np.linalg.norm((transition @ start)[:, : equations.size]) / SHEAR)
        walk = np.sqrt(len(path.steps))
        noise += EPS / 2 * size * walk * (1 + walk / LONG_WALK) * growth
    # The check has roundings of its own, of the size of what it measures: as much again.
    alpha, found = u[index], 2 * abs(inverse @ residual)
    floor = np.linalg.norm(inverse) * noise + np.spacing(alpha)
    if found > max(WORST_ERROR * alpha, FAR * floor):
        raise NoOrbit(f"the orbit cannot be certified: launch speed {alpha:.6g} may be off by {found:.1e}{NARROW}")
    return float(found + floor)


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


def follow_contact(
    model: Model, u: Mapping[str, float], p: Mapping[str, float], limit: float
) -> tuple[Trajectory | None, str]:
    """The contact after a lossless landing, up to its middle or, where nothing mirrors it, up to lift-off.

    None with the reason when it has not come there within the time `limit`.
    """
    along = flow(model.contact, tuple(p))
    start = np.array(model.touchdown(u, p), dtype=float)
    # Without a mirror image the force ends the contact, the first watched row; its zero at landing is left out.
    stop = first_zero(model.contact_speed) if model.reversor else first_zero(Affine((0.0,) * along.size + (1.0,)), 1)
    try:
        path, _ = along.run(start, np.array(list(p.values())), limit, stop=stop)
    except OutOfRange as error:
        return None, f"contact: {error}"
    except FlowError:
        return None, model.violations["end"]
    return (path, "") if path.times[-1] < limit else (None, model.violations["end"])


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
    stopped: str,
    gap_slope: float,
    residual: float,
    error: float,
) -> Certificate:
    """Check an orbit. Raises `NoOrbit` where its numbers cannot be trusted.

    parts : the flight from lift-off to its middle, and, where it is not its mirror image, from landing backwards
    contact : as `follow_contact` gives it, None when it does not end, and then `stopped` says why
    gap_slope : derivative with respect to alpha of the gap at the orbit's landing time
    """
    jerk, clearance, violations = _flight(model, p, parts)
    force = peak = None
    if contact is None:
        violations.append(stopped)
    else:
        force, peak, violation = _contact_force(contact, model.violations["pull"], model.reversor is not None)
        violations += violation
    separation, violation = _separation(model, p, parts, contact)
    violations += violation

    ways = [_energy(model.flight, model.flight_gradient, part, p) for part in parts]
    # dE/dalpha at launch, whose expressions are plain arithmetic: a complex step is exact
    power = float(ways[0][2] @ np.imag(model.launch({**u, "alpha": u["alpha"] + 1e-30j}, p)) * 1e30)
    if contact is not None:
        ways.append(_energy(model.contact, model.contact_gradient, contact, p))
    energy = 0.5 * u["alpha"] * power
    drift = max(change for change, _, _ in ways) / energy
    loss = None
    if jerk > 0 and gap_slope != 0:
        loss = model.impact_mass(p) * jerk**2 / 8 * (6 * abs(gap_slope) / jerk) ** (4 / 3) / power
    if not np.isfinite((error, drift, residual, jerk, *(x for x in (loss, separation, force) if x is not None))).all():
        raise NoOrbit("the orbit cannot be certified: its numbers overflow; state the machine in units nearer to 1")
    if any(change > max(WORST_DRIFT * energy, FAR * floor) for change, floor, _ in ways):
        raise NoOrbit(f"the orbit cannot be certified: its energy drifts by {drift:.1e}{NARROW}")
    return Certificate(
        family=count_family(model, parts),
        residual=float(residual),
        error=float(error),
        energy_drift=drift,
        clearance=clearance,
        smallest_separation=separation if contact is not None else None,
        smallest_contact_force=force,
        largest_contact_force=peak,
        landing_jerk=-float(jerk),
        loss_coefficient=loss and float(loss),
        stable_side=loss and ("above" if gap_slope > 0 else "below"),
        violations=tuple(violations),
        unfolding=u.get("unfolding"),
    )


def _flight(model: Model, p: Mapping[str, float], parts: tuple[Trajectory, ...]):
    """Landing jerk (times -1), lowest interior minimum of the gap (None without one), violations in flight."""
    minima, jerks, violations = [], [], []
    for part, backwards in zip(parts, (False, True), strict=False):
        gap = model.gap(p).series(part.coefficients)
        jerks.append(6 * gap[0, 3])
        whole = sum(half.times[-1] for half in parts)
        minima += [(height, whole - t if backwards else t) for height, t in interior_minima(gap, part)]
    jerk, (clearance, when) = min(jerks), min(minima, default=(None, None))
    if jerk <= 0:
        violations.append(f"the gap opens the wrong way at landing (landing jerk {-jerk:.3g}, must be negative)")
    if minima and clearance <= 0:
        violations.append(f"{model.violations['gap']} at t = {when:.6g} of the flight (height {clearance:.3g})")
    return jerk, clearance, violations


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
    if len(parts) == 2 and path is parts[1]:  # told backwards from landing
        when = parts[0].times[-1] + path.times[-1] - when
    return least, [f"{model.violations['separation']} at t = {when:.6g} of the {where} (separation {least:.3g})"]


def _contact_force(contact: Trajectory, pulls: str, half: bool) -> tuple[float | None, float, list[str]]:
    """Lowest interior minimum of the force over the (half) contact, None without one, its peak, and a violation where
    it pulls. It starts from a simple zero, which is divided out exactly; a whole contact ends on another."""
    force = contact.row("contact force")
    slope, end, h = derivative(force), contact.times[-1], contact.steps[-1]
    turns = [(i, t) for i, t in piecewise_roots(slope, contact.steps, rising=True)]
    minima = [float(evaluate(force[i], t)) for i, t in turns if contact.times[i] + t < end * (1 - 1e-7)]
    if half and evaluate(derivative(slope[-1]), h) > 0:  # mid-contact itself
        minima.append(float(evaluate(force[-1], h)))
    largest = -lowest(-force, contact.steps)[0]
    for i, t in piecewise_roots(force, contact.steps, start=1)[:1]:
        when = contact.times[i] + t
        if half or when < end * (1 - 1e-7):
            return min(minima, default=None), largest, [f"{pulls} in contact at t = {when:.6g}"]
    begins = [f"{pulls} as soon as the contact begins"] if force[0, 1] <= 0 else []
    return min(minima, default=None), largest, begins


@lru_cache(maxsize=256)
def _gradients(phase: Phase, gradient: Callable, parameters: tuple[str, ...], count: int) -> Call:
    """An energy gradient of a model at so many points, a call ((n, count), (np + nq, count)) -> (n, count)."""
    along = flow(phase, parameters)
    x = ca.SX.sym("x", along.size)
    p = ca.SX.sym("p", len(parameters) + (phase.pieces.size if phase.pieces else 0))
    one = ca.Function("gradient", [x, p], [ca.densify(ca.vertcat(*gradient(*along.symbols(x, p))))])
    return Call(one.map(count))


def _energy(phase: Phase, gradient: Callable, path: Trajectory, p: Mapping[str, float]):
    """Largest change of energy along a motion, what rounding of the states makes of it, the gradient (n,) at its start.

    The change is the work of the gradient on the straight lines between the nodes.
    """
    along = flow(phase, tuple(p))
    n, count = along.size, len(path.steps)
    nodes = np.vstack([path.coefficients[:, :n, 0], path.end[:n]])
    moves = np.diff(nodes, axis=0)
    points = (nodes[:-1, None] + 0.5 * (GAUSS_POINTS + 1)[:, None] * moves[:, None]).reshape(-1, n)
    data = np.repeat(along.mesh_data(path, np.array(list(p.values()))), GAUSS, axis=1)
    gradients = _gradients(phase, gradient, tuple(p), 1 + count * GAUSS)
    rates = gradients(np.vstack([nodes[0], points]).T, np.hstack([data[:, :1], data]))[0].T
    changes = np.einsum("kgn,kn,g->k", rates[1:].reshape(count, GAUSS, n), moves, 0.5 * GAUSS_WEIGHTS)
    rounding = EPS * np.abs(nodes).max() * np.abs(rates).max()
    return float(np.abs(np.cumsum(changes)).max()), float(rounding), rates[0]
