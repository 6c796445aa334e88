"""The bound on the error of an unknown of a solved orbit, by default its launch speed. It reuses only the inverse
Jacobian of the orbit's equations."""

from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy import ndarray

from ..errors import NoOrbit
from ..flow import Flow, Trajectories, Trajectory, runge_kutta_step, symbolic_powers
from ..numerics import GAUSS_PLACES, GAUSS_WEIGHTS, powers, solve
from ..symbolic import ElementwiseFunction, Kernel, cached, repeated
from ..units import UNKNOWNS, Message, Quantity
from .single_shooting import Evaluation, Shooting, relative


class ErrorOptions(NamedTuple):
    """How errors of alpha are bounded."""

    # Rounding errors of n steps add up at random, like the square root of n, and by their bias, like n. The two are
    # equal at a number of steps whose square root is this.
    random_steps: float = 20.0
    worst: float = 1e-11  # share of alpha: with a larger error the steps may have leapt over a feature
    doubtful_ratio: float = 1e4  # of an error to what rounding explains, beyond which a large one is that of a leap
    # Order-8 steps are so short that the ninth Taylor term, their error, is below this share of rounding.
    ninth_term: float = 0.01
    # Factor of errors that defects of the integration steps bound: in long flights through hard bends of a law alpha
    # was off by up to 2.7 times the bound in 1 of some hundred orbits, against quadrature in 34 digits.
    defects_safety: float = 3.0


ERRORS = ErrorOptions()
EPS = float(np.finfo(float).eps)
Rows = ndarray | None
NARROW = (
    ". Either it stays at an unstable equilibrium, where rounding decides, or it crosses a feature narrower than an "
    "integration step: smooth the law, or give breakpoints to springs.function"
)


def error_bounds(
    equations: Shooting, us: ndarray, ps: ndarray, evaluation: Evaluation, closing: Rows = None, quickly: bool = False,
    unknown: str = "alpha", by_nodes: bool = False,
) -> tuple[ndarray, dict[int, NoOrbit]]:  # fmt: skip
    """Bounds (m,) on the errors of an unknown in solutions (m, n), and by index why some cannot be certified.

    ps : parameters (m, np)
    evaluation : the equations at the solutions
    closing : rows (m, n + 1) that close the equations where a parameter is varied too, the last unit vector for errors
        at the parameter's value
    quickly : where the flow allows it, integrate the field along each step's polynomial by Gauss's rule, and carry the
        steps' defects to the end of the arc; else, integrate the motion again by another method with smaller steps
    unknown : the name of the unknown: the launch speed, another one of the statement, or a tuned parameter
    by_nodes : whether arcs are parts between nodes, so that rounding errors on each move its own end alone

    These residuals are multiplied by the inverse Jacobian. The rounding that both integrations may share is added: half
    a unit in the last place of each state per step, accumulated at random, through the same inverse, and amplified
    where the flow amplifies differences (in a long flight a nonlinear spring turns a change of amplitude into one of
    phase); or a whole unit carried from each step by the flow, where that is more. Of a law in pieces both have the
    same rounded coefficients, see `_rounded_pieces`.
    """
    ps = equations.with_tuned(us, ps)
    n, index, jacobian = equations.size, equations.statement.unknowns.index(unknown), evaluation.jacobian
    square = jacobian if closing is None else np.concatenate([jacobian, closing[:, None]], axis=1)
    # Its row in the inverse; with the leading axis older NumPy takes the right side as one matrix for all.
    inverse = solve(square.swapaxes(1, 2), np.eye(square.shape[1])[None, :, [index]])[:, :n, 0]
    weights = _weights_of_steps(equations, evaluation, inverse)
    # Near an unstable equilibrium a change grows and shrinks again, and derivatives lose their rank to rounding.
    lost = (EPS * evaluation.growths_on_the_way.max(1) ** 2 > 1.0).nonzero()[0].tolist()
    moves, refused = np.full(len(us), np.nan), {i: NoOrbit(f"the orbit cannot be certified{NARROW}") for i in lost}
    if quickly and all(flow.in_lanes for flow in equations.flows):
        moves = np.einsum("mi,mi->m", inverse, evaluation.residual)
        for flow, motions, back in zip(equations.flows, evaluation.trajectories, weights, strict=True):
            moves = moves - (np.nan if back is None else _moves_by_defects(flow, motions, ps, back))
    for i in (~np.isfinite(moves)).nonzero()[0].tolist():
        try:
            paths = tuple(motions[i] for motions in evaluation.trajectories)
            moves[i] = inverse[i] @ equations.residual(us[i], ps[i], paths, _end_by_another_method)
        except NoOrbit as error:
            refused[i] = error
    # The residuals have rounding errors of their own, as large as the errors they measure: the factor 2 covers these.
    found, values = 2 * np.abs(moves), us[:, index]
    shared = np.maximum(
        _grown_rounding(equations, us, evaluation, inverse, by_nodes), _carried_rounding(evaluation, weights)
    )
    floor = shared + np.spacing(np.abs(values)) + _rounded_pieces(equations, ps, evaluation, weights)
    name, dimension = "launch speed" if unknown == "alpha" else unknown, UNKNOWNS.get(unknown, ())
    for i in (found > np.maximum(ERRORS.worst * np.abs(values), ERRORS.doubtful_ratio * floor)).nonzero()[0].tolist():
        text = "the orbit cannot be certified: {name} {value:.6g} may be off by {error:.1e}{narrow}"
        numbers = {"value": Quantity(values[i], dimension), "error": Quantity(found[i], dimension)}
        refused.setdefault(i, NoOrbit(Message(text, name=name, **numbers, narrow=NARROW)))
    return (found + floor) * (ERRORS.defects_safety if quickly else 1.0), refused


def _grown_rounding(
    equations: Shooting, us: ndarray, evaluation: Evaluation, inverse: ndarray, by_nodes: bool
) -> ndarray:
    """Errors (m,) of the unknown by the random rounding of all steps, amplified as differences of the unknowns are, and
    by that of the conditions on the launch. Each state and unknown is rounded relative to its own size."""
    shares, roundings, row, at_launch = list[ndarray](), list[ndarray](), 0, np.zeros(len(us))
    for flow, motions, transition, start, by_end in zip(
        equations.flows, evaluation.trajectories, evaluation.transitions, evaluation.starts,
        evaluation.residual_by_end, strict=True,
    ):  # fmt: skip
        sizes, change = motions.sizes[:, : flow.size], (transition @ start)[:, :, : equations.own]
        growth = np.sqrt((relative(change, sizes, np.abs(us[:, : equations.own])) ** 2).sum((1, 2)))
        at_random = np.sqrt(motions.counts)
        rows = slice(row, row := row + by_end.shape[1])
        own, at_start = inverse[:, rows], np.abs(inverse[:, rows]) * ~by_end.any(2)
        by_unknowns = np.abs(evaluation.jacobian[:, rows, : equations.size])
        at_launch += np.einsum("mi,mij,mj->m", at_start, by_unknowns, np.abs(us))
        shares.append(np.sqrt(((np.einsum("mi,mij->mj", own, by_end) * sizes) ** 2).sum(1)))
        roundings.append(at_random * (1 + at_random / ERRORS.random_steps) * np.maximum(1.0, growth))
    if not by_nodes:
        # The conditions of all arcs are those of one motion, on which roundings of places become those of rates: on
        # 1,419 pairs of methods for hoppers, and 282 for chains, knees, plates, inerters and tables, alpha differed by
        # up to 0.23 of the sum of both bounds.
        shares = [np.linalg.norm(shares, axis=0)] * len(shares)
    return EPS / 2 * (at_launch + np.sum(np.multiply(shares, roundings), axis=0))


def by_pieces(equations: Shooting, u: ndarray, p: ndarray, evaluation: Evaluation) -> Rows:
    """The derivatives (k, size) of alpha at a solution (1, n) by the data of the pieces of the law in its fields, with
    parameters (1, np) and the equations there; None where they are not known."""
    at_alpha = np.eye(equations.size)[None, equations.statement.unknowns.index("alpha"), :, None]
    inverse = solve(evaluation.jacobian[:, :, : equations.size].swapaxes(1, 2), at_alpha)[:, :, 0]
    weights, row, total = _weights_of_steps(equations, evaluation, inverse), 0, None
    parts = zip(
        equations.flows, equations.ends, evaluation.trajectories, evaluation.transitions, evaluation.residual_by_end,
        weights, strict=True,
    )  # fmt: skip
    for flow, (_, arrival), motions, transition, by_end, at_ends in parts:
        own, row = inverse[:, row : row + by_end.shape[1]], row + by_end.shape[1]
        pieces = flow.phase.pieces
        if pieces is None or flow.method == "closed form":
            continue
        if at_ends is None:
            return None
        total = np.zeros(flow.piece_table(p[0])[1].shape) if total is None else total
        # Within a step the derivative of alpha by the state is a cubic with the right values and slopes at both ends.
        at_starts = np.concatenate([own @ by_end[0] @ transition[0, :, : flow.size], at_ends[:-1]])
        c, lengths = motions.coefficients[:, : flow.size], motions.steps[:, None]
        data = flow.mesh_data(motions, p)
        (found,) = _by_data(flow)(c.reshape(len(c), -1), lengths, at_starts, at_ends, data)
        np.add.at(total, flow.mesh_pieces(motions[0], p[0]), -found)
        # The condition at lift-off has the data of the first piece.
        start, (q,) = c[:1, :, 0], flow.data_of_pieces(c[:1, :, 0], p)
        at_start = arrival(u[0], start, motions.finals[:, : flow.size], p, q)[1][:, -len(q) :]
        total[flow.pieces_of(start, p)] -= own @ at_start
    return total


@cached
def _by_data(flow: Flow) -> ElementwiseFunction:
    """The derivatives of a number by the data of the pieces over steps, by Gauss's rule, (coefficients of the states,
    one state after the other, length, derivatives by the state at the start and at the end, parameters with data)."""
    order, h, p = flow.vector_field.order, ca.SX.sym("h"), flow.vector_field.p
    c = ca.SX.sym("c", order + 1, flow.size)
    ends, count = (ca.SX.sym("start", flow.size), ca.SX.sym("end", flow.size)), len(flow.parameters)
    x, terms = flow.vector_field.x, ca.diag(symbolic_powers(h, order)) @ c
    rates = flow.vector_field.field(x, p)[0]
    slopes = ca.Function("slopes", [x, p], [ca.jacobian(rates, x), ca.jacobian(rates, p)[:, count:]])
    places = ca.vertsplit(ca.DM(powers(np.array([0.0, 1.0, *GAUSS_PLACES]), order + 1)) @ terms)
    falls = [-h * end.T @ slopes(place.T, p)[0] for end, place in zip(ends, places[:2], strict=True)]
    total = ca.SX(1, flow.phase.pieces.size if flow.phase.pieces else 0)
    for t, weight, place in zip(GAUSS_PLACES.tolist(), GAUSS_WEIGHTS.tolist(), places[2:], strict=True):
        basis = (1 + 2 * t) * (1 - t) ** 2, t**2 * (3 - 2 * t), t * (1 - t) ** 2, t**2 * (t - 1)
        back = sum(share * value for share, value in zip(basis, (*(end.T for end in ends), *falls), strict=True))
        total += weight * h * back @ slopes(place.T, p)[1]
    return ElementwiseFunction(ca.Function("by_data", [ca.vec(c), h, *ends, p], [total.T]))


def _weights_of_steps(equations: Shooting, evaluation: Evaluation, inverse: ndarray) -> list[Rows]:
    """The derivatives (N, states) of the unknown by the state at the end of each step, carried to the end of its arc by
    the flow from there, or None, for each arc: where a motion is carried past a hard turn, they are large."""
    weights, row = list[Rows](), 0
    for flow, motions, transition, by_end in zip(
        equations.flows, evaluation.trajectories, evaluation.transitions, evaluation.residual_by_end, strict=True
    ):
        at_end = np.einsum("mi,mij->mj", inverse[:, row : row + by_end.shape[1]], by_end)
        row, n = row + by_end.shape[1], flow.size
        if motions.variations is None:
            weights.append(None)
            continue
        # Derivatives of the state at the end of every step by that at the start of its motion.
        sensitivities = motions.until_next(motions.variations[:, :n, :n], transition[:, :, :n])
        carried = np.einsum("mj,mjk->mk", at_end, transition[:, :, :n])[motions.owner, :, None]
        weights.append(solve(sensitivities.swapaxes(1, 2), carried)[..., 0])
    return weights


def rounding_of_unknowns(equations: Shooting, evaluation: Evaluation, inverse: ndarray) -> ndarray:
    """Errors (m, k) of unknowns by the rounding of the state in all steps, from their rows (m, k, n) in the inverse
    Jacobian."""
    each = (_weights_of_steps(equations, evaluation, row) for row in inverse.swapaxes(0, 1))
    return np.stack([_carried_rounding(evaluation, weights) for weights in each], axis=1)


def _carried_rounding(evaluation: Evaluation, weights: list[Rows]) -> ndarray:
    """Errors (m,) of the unknown by one unit in the last place of the state per step."""
    squares, counts = np.zeros(len(evaluation.residual)), np.ones(len(evaluation.residual))
    for motions, back in zip(evaluation.trajectories, weights, strict=True):
        if back is not None:
            moves = back * motions.step_ends[:, : back.shape[1]]
            errors = np.add.reduceat(np.einsum("Ni,Ni->N", moves, moves), motions.first)
            squares, counts = squares + errors, np.maximum(counts, motions.counts)
    return EPS * np.sqrt(squares) * (1 + np.sqrt(counts) / ERRORS.random_steps)


def _rounded_pieces(equations: Shooting, ps: ndarray, evaluation: Evaluation, weights: list[Rows]) -> ndarray:
    """Errors (m,) of the unknown by one unit in the last place of every coefficient of the pieces of a law, at worst.

    Where a table is uneven the terms of a polynomial are some ten times its value, and so are their roundings, which an
    integration cannot see. Against quadrature in long double of the exact polynomials, 6 of 199 tables of 10 to 28
    rows, without noise and as close as 0.02, had errors beyond a bound without this one, the largest 3.9 times that
    bound; with it the largest is 0.47 of the bound.
    """
    errors = np.zeros(len(evaluation.residual))
    for flow, motions, back in zip(equations.flows, evaluation.trajectories, weights, strict=True):
        if back is not None and flow.phase.pieces and not flow.phase.pieces.exact and flow.in_lanes:
            c, lengths = motions.coefficients[:, : flow.size], motions.steps[:, None]
            (sizes,) = _size_of_pieces(flow)(c.reshape(len(c), -1), lengths, flow.mesh_data(motions, ps))
            errors += np.add.reduceat((np.abs(back) * lengths * sizes).sum(1), motions.first)
    return EPS * errors


@cached
def _size_of_pieces(flow: Flow) -> ElementwiseFunction:
    """The mean over steps of the terms of the rates by the data of a piece, each by its size; arguments as of
    `_mean_of`."""
    field, data = flow.vector_field, flow.vector_field.p[len(flow.parameters) :]
    slopes = ca.jacobian(field.field(field.x, field.p)[0], data)
    return _mean_of(flow, ca.sum2(ca.fabs(slopes @ ca.diag(data))))


def _moves_by_defects(flow: Flow, motions: Trajectories, ps: ndarray, back: ndarray) -> ndarray:
    """The changes (m,) of the unknown by the defects of the steps."""
    c, lengths = motions.coefficients[:, : flow.size], motions.steps[:, None]
    (rates,) = _mean_rates(flow)(c.reshape(len(c), -1), lengths, flow.mesh_data(motions, ps))
    defects = motions.step_ends[:, : flow.size] - c[:, :, 0] - lengths * rates
    return np.add.reduceat(np.einsum("Ni,Ni->N", back, defects), motions.first)


@cached
def _mean_rates(flow: Flow) -> ElementwiseFunction:
    """The mean of a field over steps; arguments as of `_mean_of`."""
    return _mean_of(flow, flow.vector_field.field(flow.vector_field.x, flow.vector_field.p)[0])


def _mean_of(flow: Flow, expression: ca.SX) -> ElementwiseFunction:
    """The mean over steps, by Gauss's rule, of an expression (k,) of the state and the parameters with data,
    (coefficients of the states, one state after the other, length, parameters with the data of the piece)."""
    field, size = flow.vector_field, flow.vector_field.order + 1
    before, place, h = (ca.SX.sym(name, count) for name, count in zip("bth", (expression.numel(), 2, 1), strict=True))
    c, states = ca.SX.sym("c", size, flow.size), ca.SX(1, flow.size)
    for k in reversed(range(size)):
        states = states * (place[0] * h) + c[k, :]
    after = before + place[1] * ca.Function("at", [field.x, field.p], [expression])(states.T, field.p)
    step = ca.Function("mean", [before, place, ca.vec(c), h, field.p], [ca.densify(after)])
    return repeated(step, [0.0] * expression.numel(), np.column_stack([GAUSS_PLACES, GAUSS_WEIGHTS]))


def _end_by_another_method(flow: Flow, start: ndarray, p: ndarray, path: Trajectory) -> ndarray:
    """The end of a motion by order-8 Runge-Kutta steps where Taylor steps found it, else by scipy's DOP853."""
    data = flow.mesh_data(Trajectories.of([path]), p[None])
    if flow.method != "Runge-Kutta":
        # The number k of steps is such that their error, k**-8 times the ninth Taylor term, is below rounding; at
        # least 8, since a feature of the law between fewer samples could be missed.
        c = np.abs(path.coefficients[:, : flow.size])
        ninth = c[:, :, 9].max(1) * path.steps**9 / np.maximum(c[:, :, 0].max(1), 1e-300)
        counts = np.clip(np.ceil((ninth / (ERRORS.ninth_term * EPS)) ** (1 / 8)), 8, 2000).astype(int)
        steps = np.concatenate([(path.steps / counts)[:, None], data], axis=1).repeat(counts, axis=0)
        z, table, goes_on = np.array([[*start, 0, len(steps)]]), steps.reshape(1, -1), True
        while goes_on:  # a call takes many steps, but not all of the longest motions
            z, _, _, (goes_on,) = _order_eight(flow)(z, table)
        return z[0, : flow.size]
    from scipy.integrate import solve_ivp  # slow to import, and only laws without a Taylor series need it

    x = start
    for i, h in enumerate(path.steps):
        rates = lambda t, y, d=data[i]: flow.rates(y, d)  # noqa: E731
        x = solve_ivp(rates, (0, h), x, method="DOP853", rtol=1e-13, atol=1e-15 * (1 + np.abs(x).max())).y[:, -1]
    return x


@cached
def _order_eight(flow: Flow) -> Kernel:
    """Runge-Kutta steps, ((state, number of the step, number of steps), (length, parameters with data) of the step) ->
    the same after all steps."""
    field, h, taken, count = flow.vector_field, *(ca.SX.sym(name) for name in ("h", "taken", "count"))
    after = ca.vertcat(runge_kutta_step(field, field.x, h), taken + 1, count)
    z, step = ca.vertcat(field.x, taken, count), ca.vertcat(h, field.p)
    return Kernel(ca.Function("order_eight", [z, step], [after, 0, taken + 1 < count]), flow.size)
