"""Orbits and flows by other software: scipy, CasADi's Opti and, where they are installed, rockit and heyoka.

Each is told what a user of it would tell it: the flight's equations, the launch, rest in mid-flight, and a guess.
"""

import contextlib
import io
import operator
from collections.abc import Callable

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from orbits.symbolic import single_assignment

# That scipy is asked with.
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
# Ipopt's answers are taken to its tolerance; it prints nothing.
IPOPT = {
    "print_time": False,
    "show_eval_warnings": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-12,
}


def flight_of(machine) -> tuple[ca.Function, list[float]]:
    """The flight's rates, (states (4,), parameters) -> (4,), and the parameters."""
    own = machine.casadi()
    return own.flight, own.values.tolist()


def rates_of(force: Callable, weight: Callable | None = None, length: float = 0.0) -> Callable:
    """(t, x) -> the rates of the hopper's flight with equal masses, in plain Python, which scipy is quickest with.

    weight : of the height above ground, which is that of the foot or `length` and that of the body
    """

    def rates(t, x):
        tension = force(x[0] - x[2])
        body, foot = (weight(length + x[0]), weight(x[2])) if weight else (1.0, 1.0)
        return [x[1], -0.5 * (tension + body), x[3], 0.5 * (tension - foot)]

    return rates


def liftoff(machine) -> float:
    """The extension at lift-off."""
    return float(machine.model.release(np.array([1.0]), machine.values)[0])


def by_scipy(rates: Callable, extension: float, tolerance: float) -> Callable:
    """(alpha, half time) -> launch speed, by DOP853 and the hybrid method, without derivatives."""

    def rest(u):
        run = solve_ivp(rates, (0, u[1]), [extension, u[0], 0.0, 0.0], "DOP853", rtol=tolerance, atol=tolerance)
        return run.y[1::2, -1]

    return lambda *start: float(root(rest, start, tol=tolerance).x[0])


def guess_on(machine, start, half: float, steps: int) -> np.ndarray:
    """The flight (4, steps + 1) from a guess, to a few digits."""
    field, p = flight_of(machine)
    rates = lambda t, x: field(x, p).full().ravel()  # noqa: E731
    return solve_ivp(rates, (0, half), start, rtol=1e-6, t_eval=np.linspace(0, half, steps + 1)).y


def by_opti(machine, extension: float, steps: int) -> Callable:
    """(alpha, half time) -> launch speed, by multiple shooting with so many RK4 steps, written with CasADi's Opti."""
    field, p = flight_of(machine)
    problem = ca.Opti()
    x, alpha, duration = problem.variable(4, steps + 1), problem.variable(), problem.variable()
    a, b = ca.MX.sym("a", 4), ca.MX.sym("b")
    k1 = field(a, p)
    k2 = field(a + b / 2 * k1, p)
    k3 = field(a + b / 2 * k2, p)
    k4 = field(a + b * k3, p)
    step = ca.Function("rk4", [a, b], [a + b / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
    problem.subject_to(x[:, 1:] == step.map(steps)(x[:, :-1], ca.repmat(duration / steps, 1, steps)))
    problem.subject_to(x[:, 0] == ca.vertcat(extension, alpha, 0, 0))
    problem.subject_to(x[1::2, -1] == 0)
    problem.solver("ipopt", IPOPT)

    def solve(speed, half):
        problem.set_initial(x, guess_on(machine, [extension, speed, 0, 0], half, steps))
        problem.set_initial(alpha, speed)
        problem.set_initial(duration, half)
        return float(problem.solve().value(alpha))

    return solve


def by_rockit(machine, extension: float, steps: int) -> Callable:
    """(alpha, half time) -> launch speed, by rockit's multiple shooting with so many RK4 steps; raises `ImportError`
    without rockit."""
    from rockit import FreeTime, MultipleShooting, Ocp

    field, p = flight_of(machine)

    def solve(speed, half):
        problem = Ocp(T=FreeTime(half))
        x = problem.state(4)
        problem.set_der(x, field(x, p))
        problem.subject_to(problem.at_t0(x)[[0, 2, 3]] == ca.DM([extension, 0, 0]))
        problem.subject_to(problem.at_tf(x)[[1, 3]] == 0)
        problem.set_initial(x, guess_on(machine, [extension, speed, 0, 0], half, steps))
        problem.solver("ipopt", IPOPT)
        problem.method(MultipleShooting(N=steps, M=1, intg="rk"))
        with contextlib.redirect_stdout(io.StringIO()):
            solution = problem.solve()
        return float(solution.value(problem.at_t0(x))[1])

    return solve


def _heyoka_system(machine):
    """The variational equations of a flight for heyoka; raises `ImportError` without it."""
    import heyoka as hy

    unary = {ca.OP_NEG: operator.neg, ca.OP_SQ: lambda a: a * a, ca.OP_TWICE: lambda a: 2.0 * a}
    unary |= {ca.OP_INV: lambda a: 1.0 / a, ca.OP_SQRT: hy.sqrt, ca.OP_EXP: hy.exp, ca.OP_TANH: hy.tanh}
    unary |= {ca.OP_SIN: hy.sin, ca.OP_COS: hy.cos, ca.OP_SINH: hy.sinh, ca.OP_COSH: hy.cosh}
    binary = {ca.OP_ADD: operator.add, ca.OP_SUB: operator.sub, ca.OP_MUL: operator.mul, ca.OP_DIV: operator.truediv}
    binary |= {ca.OP_POW: operator.pow, ca.OP_CONSTPOW: operator.pow}
    states, (field, p) = hy.make_vars(*"abcd"), flight_of(machine)
    values: list = []
    rates: dict = {}
    for op, places, constant in single_assignment(field):
        if op == ca.OP_OUTPUT:
            rates[places[2]] = values[places[0]]
        elif op == ca.OP_INPUT:
            value = states[places[1]] if places[0] == 0 else hy.expression(float(p[places[1]]))
        elif op == ca.OP_CONST:
            value = hy.expression(float(constant))
        else:
            value = (unary if len(places) == 1 else binary)[op](*(values[place] for place in places))
        values.append(value)
    return hy.var_ode_sys([(state, rates[i]) for i, state in enumerate(states)], hy.var_args.vars, order=1)


def flow_by_heyoka(machine) -> Callable:
    """(start (4,), time) -> the state and its transition matrix there, (4,) and (4, 4), by heyoka's Taylor method on
    the variational equations, compiled, at its tightest tolerance; raises `ImportError` without heyoka."""
    import heyoka as hy

    integrator = hy.taylor_adaptive(_heyoka_system(machine), [0.0] * 4, compact_mode=False)

    def run(start, duration):
        integrator.time = 0.0
        integrator.state[:] = np.concatenate([start, np.eye(4).ravel()])
        integrator.propagate_until(duration)
        return integrator.state[:4].copy(), integrator.state[4:].reshape(4, 4).copy()

    return run


def flows_by_heyoka(machine, record: bool = False, **options: bool) -> Callable:
    """(starts (m, 4), times (m,)) -> the states and transition matrices there, (m, 4) and (m, 4, 4), as
    `flow_by_heyoka`, in its batch mode of the width that it recommends, with further options of its integrator, and
    with all its steps if `record`; raises `ImportError` without heyoka."""
    import heyoka as hy

    width = 8 if options.get("force_avx512") else hy.recommended_simd_size()
    system, zeros = _heyoka_system(machine), np.zeros((4, width))
    integrator = hy.taylor_adaptive_batch(system, zeros, compact_mode=False, **options)
    slopes = np.tile(np.eye(4).ravel()[:, None], width)

    def run(starts, times):
        ends = np.empty((len(starts), 20))
        for first in range(0, len(starts), width):
            chosen = np.minimum(np.arange(first, first + width), len(starts) - 1)
            integrator.set_time([0.0] * width)
            integrator.state[:4], integrator.state[4:] = starts[chosen].T, slopes
            integrator.propagate_until(times[chosen].tolist(), c_output=record)
            ends[chosen] = integrator.state.T
        return ends[:, :4], ends[:, 4:].reshape(-1, 4, 4)

    return run


def by_heyoka(machine, extension: float, _=None) -> Callable:
    """(alpha, half time) -> launch speed, by Newton's method on heyoka's flow; raises `ImportError` without heyoka."""
    flow, (field, p) = flow_by_heyoka(machine), flight_of(machine)

    def solve(*start):
        u = np.array(start)
        for _ in range(20):
            x, transition = flow([extension, u[0], 0, 0], u[1])
            slopes = np.column_stack([transition[1::2, 1], field(x, p).full().ravel()[1::2]])
            change = np.linalg.solve(slopes, -x[1::2])
            u = u + change
            if np.abs(change).max() < 1e-13 * np.abs(u).max():
                break
        return float(u[0])

    return solve


# What an orbit is found by, and with which settings: tolerances, numbers of steps, or none. Building is not counted
# where the solver is built before it is asked.
ORBITS = {
    "scipy DOP853 + root": (by_scipy, TOLERANCES),
    "Opti, RK4": (by_opti, (50, 200, 800)),
    "rockit, RK4": (by_rockit, (50, 200)),
    "heyoka + Newton": (by_heyoka, (None,)),
}
