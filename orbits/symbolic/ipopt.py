"""The only module that calls Ipopt: its options, and the meaning of its return statuses for the user."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import casadi as ca
import numpy as np
from numpy import ndarray

from ..errors import NoOrbit
from ..running import heartbeat, interrupts
from .caches import weigh

Pair = tuple[ndarray, ndarray]
_S = TypeVar("_S", ca.SX, ca.MX)

# The meaning of Ipopt's return statuses where the equations are not solved, and the remedy.
REASONS = {
    "Infeasible_Problem_Detected": "no solution of the equations near the starting guess; start from a similar machine",
    "Maximum_Iterations_Exceeded": "no convergence; start from a similar machine",
    "Restoration_Failed": "no convergence from the starting guess; start from a similar machine",
    "Invalid_Number_Detected": "the equations become infinite or undefined on the way; check the formulas",
    "Not_Enough_Degrees_Of_Freedom": "more equations than unknowns: the statement is not square",
    "Insufficient_Memory": "the memory ran out; use a smaller family number",
}

OPTIONS: dict[str, Any] = {
    **dict.fromkeys(("print_time", "show_eval_warnings", "error_on_fail"), False),
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-13,
    "ipopt.constr_viol_tol": 1e-13,
    "ipopt.dual_inf_tol": 1.0,  # the multipliers of a square problem do not matter; else `tol` limits their conditions
    "ipopt.acceptable_iter": 0,
    "ipopt.max_iter": 200,
    "ipopt.nlp_scaling_method": "none",  # the caller scales
}


class MinimumOptions(NamedTuple):
    """What is accepted as a minimum when its conditions are recomputed, whatever Ipopt's status is."""

    feasible: float = 1e-9  # violation of the constraints
    stationary: float = 1e-7  # gradient of the Lagrangian compared with the multipliers
    # A smaller violation does not show that constraints are infeasible: iterations may end for other reasons.
    nearly: float = 1e-6
    bottomless: float = -1e8  # costs are of order one, so that a smaller one has no lower bound
    diverging: float = 1e12  # unknowns of this size diverge


MINIMA = MinimumOptions()
# With all but the first of these, Ipopt stalls at rounding: a point is a minimum where the recomputed conditions hold.
ENDED = "Solve_Succeeded", "Search_Direction_Becomes_Too_Small", "Solved_To_Acceptable_Level", "Restoration_Failed"
# The meaning of the end of an iteration without a minimum, by the `kind` of a `Minimum`.
ENDS = {
    "infeasible": "no solution near the starting guess",
    "bottomless": "the cost has no lower bound",
    "undefined": "the equations become infinite or undefined on the way",
    "overdetermined": "more conditions than unknowns",
    "stuck": "no convergence",
}
MINIMISING = {
    **OPTIONS,
    **{f"ipopt.{name}": 1e-11 for name in ("tol", "constr_viol_tol", "compl_inf_tol")},
    "ipopt.bound_relax_factor": 0.0,  # no bound is violated, not even by rounding
    "ipopt.honor_original_bounds": "yes",
    "ipopt.max_iter": 1000,
    "ipopt.diverging_iterates_tol": MINIMA.diverging,
}
# From the solution of a similar problem, the barrier parameter starts at its final value there.
WARM = {
    "ipopt.warm_start_init_point": "yes",
    "ipopt.mu_init": 1e-7,
    **{f"ipopt.warm_start_{name}_push": 1e-9 for name in ("bound", "mult_bound", "slack_bound")},
    **{f"ipopt.warm_start_{name}_frac": 1e-9 for name in ("bound", "slack_bound")},
}


class EquationSolver:
    """Ipopt for a square system equations(unknowns, p) = 0 of order one, whose parameters p have other values in each
    call."""

    def __init__(self, unknowns: ca.MX, p: ca.MX, equations: ca.MX):
        n = unknowns.numel()
        z, parameters = ca.MX.sym("z", n), ca.MX.sym("p", n + p.numel())  # the scale of the unknowns, and p
        scaled = ca.Function("equations", [unknowns, p], [equations])(z * parameters[:n], parameters[n:])
        # The objective is constant, so that Newton's method needs no second derivatives: a zero Hessian is declared.
        symbols, zero = [z, parameters, ca.MX.sym("f"), ca.MX.sym("g", equations.numel())], [ca.MX(n, n)]
        no_hessian = ca.Function("hessian", symbols, zero, ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"])
        self._watch = _Watch(n, equations.numel(), parameters.numel())
        options = {**OPTIONS, "hess_lag": no_hessian, "iteration_callback": self._watch}
        problem = {"x": z, "p": parameters, "f": ca.MX(0), "g": scaled}
        self._solver = ca.nlpsol("solver", "ipopt", problem, options)
        weigh(self._solver.get_function(name) for name in self._solver.get_function())

    def __call__(self, guess: ndarray, lower: ndarray, scale: ndarray, p: ndarray) -> ndarray:
        """The solution (n,) near a guess, solved in the variables unknowns / scale.

        guess, lower, scale : (n,), as the solution
        Raises `NoOrbit` with a reason. A keyboard interrupt stops the solver and is raised.
        """
        bounds = {"lbx": lower / scale, "ubx": np.inf, "lbg": 0, "ubg": 0}
        try:
            with interrupts.deferred():
                solution = self._solver(x0=guess / scale, p=np.concatenate([scale, p]), **bounds)
        except RuntimeError as error:
            raise NoOrbit(
                "multiple shooting cannot be evaluated; choose units that make the machine's numbers nearer to 1"
            ) from error
        interrupts.heed()
        # Ipopt may report a failure when its step vanishes at rounding: the recomputed residual decides.
        violation = float(ca.norm_inf(solution["g"]))
        if not violation <= 1e-10:
            reason = REASONS.get(self._solver.stats()["return_status"], "no convergence")
            raise NoOrbit(f"{reason} (equations off by {violation:.1e})")
        return np.array(solution["x"]).ravel() * scale


@dataclass(frozen=True)
class Minimum:
    """The end of an iteration for a constrained minimum, with n unknowns and m constraints."""

    x: ndarray  # (n,)
    cost: float
    multipliers: Pair  # of the bounds (n,) and of the constraints (m,)
    values: ndarray  # of the constraints, (m,)
    off: ndarray  # the violation of each constraint, (m,)
    slope: float  # the largest entry of the gradient of the Lagrangian, compared with the largest multiplier
    kind: str  # "minimum", "infeasible", "bottomless", "undefined", "overdetermined" or "stuck"
    iterations: int  # the number taken

    @property
    def feasible(self) -> bool:
        """Whether the constraints are met up to `MINIMA.nearly`."""
        return bool(self.off.max(initial=0.0) <= MINIMA.nearly)

    @property
    def reason(self) -> str:
        """Why it is not a minimum; "" for one."""
        if self.kind == "minimum":
            return ""
        slope = f", the cost's slope is {self.slope:.1e}" if self.feasible else ""
        return f"{ENDS[self.kind]} (off by {self.off.max(initial=0.0):.1e}{slope})"


class Minimiser:
    """Ipopt with exact second derivatives: minimises cost(unknowns, p) under bounds and constraints of order one.

    The `options` are of Ipopt, in addition to `MINIMISING`.
    """

    def __init__(self, unknowns: _S, p: _S, cost: _S, constraints: _S, options: Mapping | None = None):
        self.options = dict(options or {})
        self.problem: dict[str, Any] = {"x": unknowns, "p": p, "f": cost, "g": constraints}
        multipliers = type(unknowns).sym("multipliers", constraints.numel())
        gradient = ca.gradient(cost, unknowns) + ca.jtimes(constraints, unknowns, multipliers, True)
        self.conditions = ca.Function("conditions", [unknowns, p, multipliers], [cost, gradient, constraints])
        self._watch = _Watch(unknowns.numel(), constraints.numel(), p.numel())
        self._solvers: dict[bool, ca.Function] = {}

    def __call__(
        self, guess: ndarray, p: ndarray, bounds: Pair, limits: Pair, multipliers: Pair | None = None
    ) -> Minimum:
        """The minimum near `guess` (n,), with unknowns within `bounds` and constraints within `limits`.

        The iteration starts from the `multipliers` of a similar problem's minimum, if any; the `kind` of the result
        says how it ended. Only a keyboard interrupt is raised.
        """
        if (warm := multipliers is not None) not in self._solvers:
            options: dict[str, Any] = {**MINIMISING, **self.options, **(WARM if warm else {})}
            options["iteration_callback"] = self._watch
            solver = self._solvers[warm] = ca.nlpsol("minimise", "ipopt", self.problem, options)
            weigh(solver.get_function(name) for name in solver.get_function())
        solver = self._solvers[warm]
        warm_start = dict(zip(("lam_x0", "lam_g0"), multipliers, strict=True)) if multipliers else {}
        (low, high), (least, most) = bounds, limits
        zeros = np.zeros(len(least))
        nowhere = Minimum(np.array(guess), np.nan, (np.zeros(len(guess)), zeros), zeros, zeros, 0.0, "", 0)
        if (least == most).sum() > (low < high).sum():
            return replace(nowhere, kind="overdetermined")
        try:
            with interrupts.deferred():
                solution = solver(x0=guess, p=p, lbx=low, ubx=high, lbg=least, ubg=most, **warm_start)
        except RuntimeError:
            return replace(nowhere, kind="undefined")
        interrupts.heed()
        x, lam_x, lam_g = (np.array(solution[name]).ravel() for name in ("x", "lam_x", "lam_g"))
        cost, gradient, values = (np.array(value).ravel() for value in self.conditions(x, p, lam_g))
        off = np.maximum(np.maximum(least - values, values - most), 0.0)
        slope = float(np.abs(gradient + lam_x).max(initial=0.0) / (1 + np.abs(lam_g).max(initial=0.0)))
        stats = solver.stats()
        kind = _kind(stats["return_status"], float(cost[0]), off, slope)
        iterations = stats.get("iter_count", 0)  # missing where the cost is undefined at the guess
        return Minimum(x, float(cost[0]), (lam_x, lam_g), values, off, slope, kind, iterations)


def _kind(status: str, cost: float, off: ndarray, slope: float) -> str:
    """The kind of end by the recomputed conditions, as Ipopt reports success at points that do not meet them."""
    most = np.abs(off).max(initial=0.0)
    if status in ENDED and most <= MINIMA.feasible and slope <= MINIMA.stationary:
        return "minimum"
    if cost < MINIMA.bottomless:
        return "bottomless"
    if status == "Invalid_Number_Detected" or not np.isfinite(cost):
        return "undefined"
    infeasible = most > MINIMA.nearly and status in ("Infeasible_Problem_Detected", "Restoration_Failed")
    return "infeasible" if infeasible else "stuck"


class _Watch(ca.Callback):
    """Ipopt's callback after every iteration, which stops it by returning 1 once an interrupt is pending."""

    def __init__(self, unknowns: int, equations: int, parameters: int = 0):
        super().__init__()
        self.sizes = {"x": unknowns, "f": 1, "g": equations, "lam_x": unknowns, "lam_g": equations, "lam_p": parameters}
        self.construct("watch", {})

    def get_n_in(self):
        return ca.nlpsol_n_out()

    def get_sparsity_in(self, i):
        return ca.Sparsity.dense(self.sizes.get(ca.nlpsol_out(i), 0), 1)

    def eval(self, arguments):
        heartbeat.beat()
        return [float(interrupts.pending())]
