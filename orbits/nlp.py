"""The only module that calls Ipopt: options, and its statuses as errors in the toolkit's words."""

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


class _Watch(ca.Callback):
    """Called after every iteration: 1 stops the solver, once an interrupt was noted."""

    def __init__(self, unknowns: int, equations: int):
        super().__init__()
        self.sizes = {"x": unknowns, "f": 1, "g": equations, "lam_x": unknowns, "lam_g": equations}
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
