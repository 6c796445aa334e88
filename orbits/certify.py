"""The certificate of an orbit: what makes it a motion, and how far its launch speed can be off.

Nothing here reuses the equations that were solved, except to push a defect through their Jacobian.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby

import casadi as ca
import numpy as np

from .calls import Call
from .errors import FlowError, NoOrbit, OutOfRange
from .flow import Flow, Trajectory, first_zero, flow
from .model import Affine, Model, Phase
from .orbit import Certificate
from .polynomial import Pile, derivative, evaluate
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
GAUSS_PLACES, GAUSS_WEIGHTS = (0.5 * values for values in np.polynomial.legendre.leggauss(GAUSS))
GAUSS_PLACES += 0.5
# Points whose gradients are asked for in one call.
BLOCK = 128
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
    return _bound(equations, u, here, across, equations.residual(u, p, here.trajectories, _another_way))


def _bound(equations: Shooting, u, here: Evaluation, across, residual) -> float:
    """What a residual (n,) measured in another way means for "alpha", with its floor; as in `error_bound`."""
    index = equations.statement.unknowns.index("alpha")
    square = here.jacobian[:, : equations.size] if across is None else np.vstack([here.jacobian, across])
    inverse = solve(square.T, np.eye(len(square))[index])[: equations.size]  # the inverse's row of alpha
    noise = 0.0
    ways = zip(equations.flows, here.trajectories, here.transitions, here.starts, strict=True)
    for along, path, transition, start in ways:
        size = np.abs(path.coefficients[:, : along.size, 0]).max()
        growth = max(1.0, np.linalg.norm((transition @ start)[:, : equations.size]) / SHEAR)
        walk = math.sqrt(len(path.times) - 1)
        noise += EPS / 2 * size * walk * (1 + walk / LONG_WALK) * growth
    # The check has roundings of its own, of the size of what it measures: as much again.
    alpha, found = u[index], 2 * abs(inverse @ residual)
    floor = math.sqrt(inverse @ inverse) * noise + np.spacing(alpha)
    if found > max(WORST_ERROR * alpha, FAR * floor):
        raise NoOrbit(f"the orbit cannot be certified: launch speed {alpha:.6g} may be off by {found:.1e}{NARROW}")
    return float(found + floor)


def error_bounds(equations: Shooting, points: Sequence[tuple]) -> list[float | NoOrbit]:
    """`error_bound` of many points (u, p, here, across), by a quicker check where their flow allows it.

    The field is integrated along each step's polynomial by Gauss's rule; what the step's end lacks is carried on to the
    arc's end.
    """
    (along,) = equations.flows if len(equations.flows) == 1 else (None,)
    answers: list[float | NoOrbit] = []
    quick = along is not None and along.method == "Taylor" and along.phase.pieces is None
    residuals = _defects(along, points) if quick else [None] * len(points)
    for (u, p, here, across), residual in zip(points, residuals, strict=True):
        try:
            if residual is None or not np.isfinite(residual).all():
                answers.append(error_bound(equations, u, p, here, across))
            else:
                answers.append(_bound(equations, u, here, across, residual))
        except NoOrbit as error:
            answers.append(error)
    return answers


def _defects(along: Flow, points: Sequence[tuple]) -> list[np.ndarray]:
    """Of each point the residual that its equations have when the defects of the steps are made good."""
    n, paths = along.size, [here.trajectories[0] for _, _, here, _ in points]
    counts = np.array([len(path.times) - 1 for path in paths])
    last = np.cumsum(counts) - 1
    first = last - counts + 1
    c = np.concatenate([path.coefficients[:, :n] for path in paths])
    h = np.concatenate([np.diff(path.times) for path in paths])
    powers = (h[:, None] * GAUSS_PLACES)[..., None] ** np.arange(c.shape[2])
    states = np.einsum("mik,mgk->mgi", c, powers)
    data = np.repeat(np.array([p for _, p, _, _ in points]).T, counts * GAUSS, axis=1)
    rates = _in_blocks(_field(along), states.reshape(-1, n).T, data).T.reshape(-1, GAUSS, n)
    ends = evaluate(c[last], h[last, None])
    transitions = np.stack([here.transitions[0][:, :n] for _, _, here, _ in points])
    after, carried = np.roll(c[:, :, 0], -1, axis=0), np.concatenate([path.variations[:, :, :n, 0] for path in paths])
    after[last], carried = ends, np.roll(carried, -1, axis=0)
    carried[last] = transitions
    defects = after - c[:, :, 0] - h[:, None] * np.einsum("mgi,g->mi", rates, GAUSS_WEIGHTS)
    at_start = np.add.reduceat(solve(carried, defects[..., None])[..., 0], first)
    wrong = np.einsum("pij,pj->pi", transitions, at_start)
    return [here.residual - here.holds[0] @ end for (_, _, here, _), end in zip(points, wrong, strict=True)]


@lru_cache(maxsize=64)
def _field(along: Flow) -> Call:
    """A flow's field at a block of points, a call ((n, BLOCK), (np, BLOCK)) -> (n, BLOCK)."""
    graph = along.graph
    one = ca.Function("field", [graph.x, graph.p], [ca.densify(graph.field(graph.x, graph.p)[0])])
    return Call(one.map(BLOCK))


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


@dataclass(frozen=True, eq=False)
class Case:
    """A solved orbit to be checked.

    u, p : unknowns and parameters by name
    parts : the flight from lift-off to its middle, and, where it is not its mirror image, from landing backwards
    contact : as `follow_contact` gives it, None when it does not end, and then `stopped` says why
    gap_slope : derivative with respect to alpha of the gap at the orbit's landing time
    residual, error : of the equations, and of alpha
    """

    u: Mapping[str, float]
    p: Mapping[str, float]
    parts: tuple[Trajectory, ...]
    contact: Trajectory | None
    stopped: str
    gap_slope: float
    residual: float
    error: float

    @property
    def flight_time(self) -> float:
        """Time of the whole flight; a single part is half of it."""
        return float(sum(part.times[-1] for part in self.parts)) * (2 if len(self.parts) == 1 else 1)

    @property
    def contact_time(self) -> float | None:
        """Time of the whole contact, None when it does not end."""
        return None if self.contact is None else float(self.contact.times[-1]) * (2 if len(self.parts) == 1 else 1)


def certify(model: Model, cases: Sequence[Case]) -> list[Certificate | NoOrbit]:
    """Check orbits of one model: the certificate of each, or the error that tells why there is none."""
    if not cases:
        return []
    measured = zip(
        cases,
        count_families(model, [case.parts for case in cases]),
        _flights(model, cases),
        _contact_forces(model, cases),
        _separations(model, cases),
        _energies(model, cases),
        strict=True,
    )
    return [_certificate(model, *figures) for figures in measured]


def _certificate(model: Model, case: Case, family: int, flight, contact, separation, energy) -> Certificate | NoOrbit:
    """The certificate of a case from its figures, each with the violations that it makes."""
    (jerk, clearance, in_flight), (force, peak, in_contact), (least, touching) = flight, contact, separation
    power, changes = energy
    start = 0.5 * case.u["alpha"] * power
    drift = max(change for change, _ in changes) / start
    loss = None
    if jerk > 0 and case.gap_slope != 0:
        loss = model.impact_mass(case.p) * jerk**2 / 8 * (6 * abs(case.gap_slope) / jerk) ** (4 / 3) / power
    figures = (case.error, drift, case.residual, jerk, *(x for x in (loss, least, force) if x is not None))
    if not all(map(math.isfinite, figures)):
        return NoOrbit("the orbit cannot be certified: its numbers overflow; state the machine in units nearer to 1")
    if any(change > max(WORST_DRIFT * start, FAR * floor) for change, floor in changes):
        return NoOrbit(f"the orbit cannot be certified: its energy drifts by {drift:.1e}{NARROW}")
    return Certificate(
        family=family,
        residual=float(case.residual),
        error=float(case.error),
        energy_drift=float(drift),
        clearance=clearance,
        smallest_separation=least,
        smallest_contact_force=force,
        largest_contact_force=peak,
        landing_jerk=-float(jerk),
        loss_coefficient=loss and float(loss),
        stable_side=loss and ("above" if case.gap_slope > 0 else "below"),
        violations=(*in_flight, *in_contact, *touching),
        unfolding=case.u.get("unfolding"),
    )


def count_families(model: Model, flights: Sequence[tuple[Trajectory, ...]]) -> list[int]:
    """Stationary points of the extension after lift-off up to and with mid-flight, less one; flights as in `Case`."""
    every = [part for parts in flights for part in parts]
    speeds = [derivative(model.extension.series(part.coefficients)) for part in every]
    found = iter(Pile(speeds, [part.steps for part in every]).roots())
    # The root left out is mid-flight itself.
    inside = [
        sum(part.times[i] + t < part.times[-1] * (1 - 1e-7) for part in parts for i, t in next(found))
        for parts in flights
    ]
    return [int(turns // len(parts)) for turns, parts in zip(inside, flights, strict=True)]


def _flights(model: Model, cases: Sequence[Case]) -> list[tuple]:
    """Of each case the landing jerk (times -1), the lowest interior minimum of the gap (None without one), and the
    violations in flight. Each part starts from a zero of order three of the gap, which is divided out exactly."""
    parts = [part for case in cases for part in case.parts]
    gaps = [model.gap(case.p).series(part.coefficients) for case in cases for part in case.parts]
    turns = iter(Pile([derivative(gap) for gap in gaps], [part.steps for part in parts]).roots(start=2, rising=True))
    gaps, answers = iter(gaps), []
    for case in cases:
        minima, jerks = [], []
        for backwards, part in enumerate(case.parts):
            gap = next(gaps)
            jerks.append(6 * gap[0, 3])
            for height, t in _interior_minima(gap, part, next(turns)):
                minima.append((height, case.flight_time - t if backwards else t))
        jerk, (clearance, when), violations = min(jerks), min(minima, default=(None, None)), []
        if jerk <= 0:
            violations.append(f"the gap opens the wrong way at landing (landing jerk {-jerk:.3g}, must be negative)")
        if minima and clearance <= 0:
            violations.append(f"{model.violations['gap']} at t = {when:.6g} of the flight (height {clearance:.3g})")
        answers.append((jerk, clearance, violations))
    return answers


def _interior_minima(gap, part: Trajectory, turns) -> list[tuple[float, float]]:
    """(height, time) of the gap's local minima inside a part of the flight: at its turns, and at its very end."""
    end, last, h = part.times[-1], gap[-1], part.times[-1] - part.times[-2]
    found = [(float(evaluate(gap[i], t)), float(part.times[i] + t)) for i, t in turns]
    found = [(height, t) for height, t in found if t < end * (1 - 1e-7)]
    middle, rate, bend = (evaluate(c, h) for c in (last, derivative(last), derivative(derivative(last))))
    if bend > 0 and abs(rate) * end < 1e-6 * np.abs(gap[:, 0]).max():
        found.append((float(middle), float(end)))
    return found


def _separations(model: Model, cases: Sequence[Case]) -> list[tuple]:
    """Of each case the least separation over the cycle, None where no length is stated or the contact does not end,
    and the violation where it is not positive."""
    series, paths, owners = [], [], []
    for index, case in enumerate(cases):
        distance = model.separation(case.p)
        if distance is None:
            continue
        for part in case.parts:
            series.append(distance.series(part.coefficients))
            paths.append(part)
            owners.append((index, "flight"))
        if case.contact is not None:
            standing = Affine(tuple(np.array(distance.weights) @ model.embed), distance.offset)
            series.append(standing.series(case.contact.coefficients[:, : len(model.contact.states)]))
            paths.append(case.contact)
            owners.append((index, "contact"))
    answers: list[tuple] = [(None, [])] * len(cases)
    found = zip(Pile(series, [path.steps for path in paths]).lowest(), paths, owners, strict=True) if series else ()
    for index, group in groupby(found, key=lambda entry: entry[2][0]):
        case = cases[index]
        (least, piece, t), path, (_, where) = min(group, key=lambda entry: entry[0])
        when = path.times[piece] + t
        if len(case.parts) == 2 and path is case.parts[1]:  # told backwards from landing
            when = case.flight_time - when
        words = f"{model.violations['separation']} at t = {when:.6g} of the {where} (separation {least:.3g})"
        answers[index] = (least if case.contact is not None else None, [] if least > 0 else [words])
    return answers


def _contact_forces(model: Model, cases: Sequence[Case]) -> list[tuple]:
    """Of each case the lowest interior minimum of the force over the (half) contact, None without one, its peak, and a
    violation where it pulls or the contact does not end. The force starts from a simple zero, which is divided out
    exactly; a whole contact ends on another."""
    standing = [case.contact for case in cases if case.contact is not None]
    if not standing:
        return [(None, None, [case.stopped]) for case in cases]
    forces, steps = [contact.row("contact force") for contact in standing], [contact.steps for contact in standing]
    half, pulls = model.reversor is not None, model.violations["pull"]
    turns = iter(Pile([derivative(force) for force in forces], steps).roots(rising=True))
    zeros = iter(Pile(forces, steps).roots(start=1))
    peaks = iter(Pile([-force for force in forces], steps).lowest())
    forces, answers = iter(forces), []
    for case in cases:
        if case.contact is None:
            answers.append((None, None, [case.stopped]))
            continue
        force, times = next(forces), case.contact.times
        before = times[-1] * (1 - 1e-7)
        minima = [float(evaluate(force[i], t)) for i, t in next(turns) if times[i] + t < before]
        h = times[-1] - times[-2]
        if half and evaluate(derivative(derivative(force[-1])), h) > 0:  # mid-contact itself
            minima.append(float(evaluate(force[-1], h)))
        crossings = [times[i] + t for i, t in next(zeros) if half or times[i] + t < before]
        violations = [f"{pulls} in contact at t = {when:.6g}" for when in crossings[:1]]
        if not violations and force[0, 1] <= 0:
            violations = [f"{pulls} as soon as the contact begins"]
        answers.append((min(minima, default=None), -next(peaks)[0], violations))
    return answers


@lru_cache(maxsize=64)
def _gradients(phase: Phase, gradient: Callable, parameters: tuple[str, ...]) -> Call:
    """An energy gradient of a model at a block of points, a call ((n, BLOCK), (np + nq, BLOCK)) -> (n, BLOCK)."""
    along = flow(phase, parameters)
    x = ca.SX.sym("x", along.size)
    p = ca.SX.sym("p", len(parameters) + (phase.pieces.size if phase.pieces else 0))
    one = ca.Function("gradient", [x, p], [ca.densify(ca.vertcat(*gradient(*along.symbols(x, p))))])
    return Call(one.map(BLOCK))


def _energies(model: Model, cases: Sequence[Case]) -> list[tuple[float, list[tuple[float, float]]]]:
    """Of each case dE/dalpha at launch, and for each of its motions the largest change of energy, with what rounding of
    the states makes of it."""
    flying = [(part, case.p) for case in cases for part in case.parts]
    standing = [(case.contact, case.p) for case in cases if case.contact is not None]
    flights = iter(_work(model.flight, model.flight_gradient, flying))
    contacts = iter(_work(model.contact, model.contact_gradient, standing)) if standing else None
    answers = []
    for case in cases:
        drifts = [next(flights) for _ in case.parts]
        # Launch expressions are plain arithmetic: a complex step is exact.
        direction = np.imag(model.launch({**case.u, "alpha": case.u["alpha"] + 1e-30j}, case.p)) * 1e30
        power = float(drifts[0][2] @ direction)
        if case.contact is not None:
            drifts.append(next(contacts))
        answers.append((power, [(change, floor) for change, floor, _ in drifts]))
    return answers


def _work(phase: Phase, gradient: Callable, motions: list) -> list[tuple[float, float, np.ndarray]]:
    """Of each motion (path, p) the largest change of energy, that of rounding, and the gradient (n,) at its start.

    The change is the work of the gradient on the straight lines between the nodes.
    """
    names = tuple(motions[0][1])
    along = flow(phase, names)
    n, paths = along.size, [path for path, _ in motions]
    counts = np.array([len(path.times) - 1 for path in paths])
    last = np.cumsum(counts) - 1
    first = last - counts + 1
    nodes = np.concatenate([path.coefficients[:, :n, 0] for path in paths])
    after = np.roll(nodes, -1, axis=0)
    h = np.array([path.times[-1] - path.times[-2] for path in paths])
    after[last] = evaluate(np.stack([path.coefficients[-1, :n] for path in paths]), h[:, None])
    moves = after - nodes
    data = np.concatenate([along.mesh_data(path, np.array(list(p.values()))) for path, p in motions], axis=1)
    points = nodes[:, None] + GAUSS_PLACES[:, None] * moves[:, None]
    rates = _in_blocks(_gradients(phase, gradient, names), points.reshape(-1, n).T, np.repeat(data, GAUSS, axis=1))
    rates = rates.T.reshape(-1, GAUSS, n)
    changes = np.cumsum(np.einsum("kgn,kn,g->k", rates, moves, GAUSS_WEIGHTS))
    before = np.where(first > 0, changes[first - 1], 0.0)
    largest = np.maximum.reduceat(np.abs(changes - np.repeat(before, counts)), first)
    size = np.maximum.reduceat(np.abs(nodes).max(1), first)
    steep = np.maximum.reduceat(np.abs(rates).max((1, 2)), first)
    starts = _in_blocks(_gradients(phase, gradient, names), nodes[first].T, data[:, first]).T
    return list(zip(largest.tolist(), (EPS * size * steep).tolist(), starts, strict=True))


def _in_blocks(call: Call, x, p) -> np.ndarray:
    """A call's results (n, m) at points x (n, m) with parameters p (np, m), a block at a time."""
    count = x.shape[1]
    room = -count % BLOCK
    x, p = (np.hstack([values, np.repeat(values[:, -1:], room, axis=1)]) for values in (x, p))
    blocks = [call(x[:, i : i + BLOCK], p[:, i : i + BLOCK])[0] for i in range(0, count, BLOCK)]
    return np.hstack(blocks)[:, :count]
