"""The only module that calls Ipopt: options, and its statuses as errors in the toolkit's words."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from . import interrupts
from .errors import NoOrbit

# Ipopt's own words for an end without an answer -> ours, with what to do.
REASONS = {
    "Infeasible_Problem_Detected": "no solution of the equations near the starting guess; start from a nearer machine",
    "Maximum_Iterations_Exceeded": "no convergence; start from a nearer machine",
    "Restoration_Failed": "no convergence from the starting guess; start from a nearer machine",
    "Invalid_Number_Detected": "the equations stop being numbers on the way; a formula has no value where it is needed",
    "Not_Enough_Degrees_Of_Freedom": "more equations than unknowns: the statement is not square",
    "Insufficient_Memory": "the memory ran out; use a smaller family number",
}

OPTIONS = {
    "print_time": False,
    "show_eval_warnings": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-13,
    "ipopt.constr_viol_tol": 1e-13,
    "ipopt.dual_inf_tol": 1.0,  # a square problem has no multipliers to speak of
    "ipopt.acceptable_iter": 0,
    "ipopt.max_iter": 200,
    "ipopt.nlp_scaling_method": "none",  # the caller scales
}


def solve(unknowns: ca.MX, equations: ca.MX, guess, lower, scale) -> np.ndarray:
    """Solve the square system equations(unknowns) = 0 by Ipopt.

    guess, lower, scale : (n,), as the solution; the problem is posed in unknowns / scale, its equations
        being of order one
    Raises `NoOrbit` with a reason; a keyboard interrupt stops the solver and is raised.
    """
    z = ca.MX.sym("z", unknowns.numel())
    scaled = ca.Function("equations", [unknowns], [equations])(z * scale)
    # The objective is constant, so Newton's step needs no second derivatives: they are declared to vanish.
    no_hessian = ca.Function(
        "hessian",
        [z, ca.MX.sym("p", 0), ca.MX.sym("f"), ca.MX.sym("g", equations.numel())],
        [ca.MX(z.numel(), z.numel())],
        ["x", "p", "lam_f", "lam_g"],
        ["triu_hess_gamma_x_x"],
    )
    watch = _Watch(z.numel(), equations.numel())
    options = {**OPTIONS, "hess_lag": no_hessian, "iteration_callback": watch}
    solver = ca.nlpsol("solver", "ipopt", {"x": z, "f": ca.MX(0), "g": scaled}, options)
    try:
        with interrupts.deferred():
            answer = solver(x0=guess / scale, lbx=lower / scale, ubx=np.inf, lbg=0, ubg=0)
    except RuntimeError as error:
        raise NoOrbit("multiple shooting cannot be evaluated; state the machine in units nearer to 1") from error
    interrupts.check()
    status = solver.stats()["return_status"]
    # A step too small to matter is the end of a solve to rounding; the residual decides.
    violation = float(ca.norm_inf(answer["g"]))
    if not violation <= 1e-10:
        raise NoOrbit(f"{REASONS.get(status, 'no convergence')} (equations off by {violation:.1e})")
    return np.array(answer["x"]).ravel() * scale


# Ipopt's own words for an end at which the answer may be as good as rounding allows; what it is worth is measured.
ENDED = ("Solve_Succeeded", "Solved_To_Acceptable_Level", "Search_Direction_Becomes_Too_Small")
SMOOTH = {
    **OPTIONS,
    "ipopt.tol": 1e-13,
    "ipopt.constr_viol_tol": 1e-11,
    "ipopt.dual_inf_tol": 1e-9,
    "ipopt.compl_inf_tol": 1e-13,
    "ipopt.max_iter": 80,
    "ipopt.mu_init": 1e-3,  # a guess is an orbit already
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.bound_push": 1e-4,
    "ipopt.bound_frac": 1e-4,
}
# Violation of the constraints and slope of the Lagrangian, both in scaled units, that a minimum may have.
FEASIBLE, STATIONARY = 1e-9, 1e-6


@dataclass(frozen=True, eq=False)
class Optimum:
    """A minimum as Ipopt left it.

    x : (n,); `objective` there
    multipliers : (m,) of the constraints, positive where the upper bound pushes; `bounds` (n,) those of x's own
    violation, slope : of the constraints, recomputed, and of the Lagrangian as Ipopt has it, in scaled units
    reason : why it is no minimum, "" for one
    """

    x: np.ndarray
    objective: float
    multipliers: np.ndarray
    bounds: np.ndarray
    violation: float
    slope: float
    reason: str


class Program:
    """min f(x, p) where lower <= x <= upper and low <= g(x, p) <= high, built once for all p and bounds.

    The unknowns are scaled by what `minimise` is told; f and g are of order one, and their derivatives exact.
    """

    def __init__(self, unknowns: ca.MX, parameters: ca.MX, objective: ca.MX, constraints: ca.MX):
        z, scale = ca.MX.sym("z", unknowns.numel()), ca.MX.sym("scale", unknowns.numel())
        p = ca.MX.sym("p", parameters.numel())
        pair = ca.Function("program", [unknowns, parameters], [objective, constraints]).call([z * scale, p], True)
        self._pair = ca.Function("scaled", [z, p, scale], list(pair))
        self._watch = _Watch(z.numel(), constraints.numel(), parameters.numel() + z.numel())
        problem = {"x": z, "p": ca.vertcat(p, scale), "f": pair[0], "g": pair[1]}
        self._solver = ca.nlpsol("solver", "ipopt", problem, {**SMOOTH, "iteration_callback": self._watch})

    def minimise(self, guess, scale, lower, upper, low, high, parameters) -> Optimum:
        """The minimum nearest `guess` (n,); where there is none, where Ipopt stopped, with the `reason`.

        A keyboard interrupt stops the solver and is raised; equations that cannot be evaluated raise `NoOrbit`.
        """
        low, high = np.broadcast_arrays(low, high)
        try:
            with interrupts.deferred():
                answer = self._solver(
                    x0=guess / scale, lbx=lower / scale, ubx=upper / scale, lbg=low, ubg=high,
                    p=np.concatenate([parameters, scale]),
                )  # fmt: skip
        except RuntimeError as error:
            raise NoOrbit("the design cannot be evaluated; state the machine in units nearer to 1") from error
        interrupts.check()
        stats = self._solver.stats()
        z, g, multipliers, bounds = (np.array(answer[name]).ravel() for name in ("x", "g", "lam_g", "lam_x"))
        objective, g = (np.array(value).ravel() for value in self._pair(z, parameters, scale))
        violation = float(np.max(np.maximum(low - g, g - high), initial=0.0))
        slope = float((stats.get("iterations") or {}).get("inf_du", [np.inf])[-1])
        status, reason = stats["return_status"], ""
        if not violation <= FEASIBLE:  # nor if it is no number
            reason = REASONS.get(status, "no convergence") + f" (constraints off by {violation:.1e})"
        elif not slope <= STATIONARY or (status not in ENDED and slope > 1e4 * SMOOTH["ipopt.tol"]):
            reason = REASONS.get(status, "no convergence") + f" (slope {slope:.1e})"
        return Optimum(z * scale, float(objective[0]), multipliers, bounds / scale, violation, slope, reason)


class _Watch(ca.Callback):
    """Called after every iteration: 1 stops the solver, once an interrupt was noted."""

    def __init__(self, unknowns: int, equations: int, parameters: int = 0):
        super().__init__()
        self.sizes = {
            "x": unknowns, "f": 1, "g": equations, "lam_x": unknowns, "lam_g": equations, "lam_p": parameters,
        }  # fmt: skip
        self.construct("watch", {})

    def get_n_in(self):
        return ca.nlpsol_n_out()

    def get_n_out(self):
        return 1

    def get_name_in(self, i):
        return ca.nlpsol_out(i)

    def get_name_out(self, i):
        return "ret"

    def get_sparsity_in(self, i):
        return ca.Sparsity.dense(self.sizes.get(ca.nlpsol_out(i), 0), 1)

    def eval(self, arguments):
        return [float(interrupts.pending())]
