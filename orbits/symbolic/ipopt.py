"""The only module that calls Ipopt: options, and its statuses as errors in the toolkit's words."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ..errors import NoOrbit
from . import interrupts

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

# How far a minimum may be from its conditions, recomputed, whatever Ipopt calls it: what is left of its constraints,
# and of the gradient of its Lagrangian beside the multipliers.
FEASIBLE, STATIONARY_GRADIENT = 1e-9, 1e-7
# What is missed by no more does not show that it cannot be met: the iteration may end there for other reasons.
NEARLY = 1e-6
# Ends from which no minimum is looked for where the recomputed conditions hold: it stalls at rounding.
STALLED_STATUSES = ("Search_Direction_Becomes_Too_Small", "Solved_To_Acceptable_Level", "Restoration_Failed")
# What an iteration that ends without a minimum means.
ENDS = {
    "infeasible": "no solution near the starting guess",
    "bottomless": "the cost has no lower bound",
    "undefined": "the equations stop being numbers on the way",
    "overdetermined": "more conditions than unknowns",
    "stuck": "no convergence",
}
# Costs, of order one, below this have no lower bound; and unknowns of this size run away, with or without the cost.
BOTTOMLESS, DIVERGING_ITERATES = -1e8, 1e12
MINIMISING = {
    **OPTIONS,
    "ipopt.tol": 1e-11,
    "ipopt.constr_viol_tol": 1e-11,
    "ipopt.compl_inf_tol": 1e-11,
    "ipopt.dual_inf_tol": 1.0,  # `tol` measures it beside the multipliers, as `STATIONARY_GRADIENT` does
    "ipopt.bound_relax_factor": 0.0,  # a bound is a bound
    "ipopt.honor_original_bounds": "yes",
    "ipopt.max_iter": 1000,
    "ipopt.diverging_iterates_tol": DIVERGING_ITERATES,
}
# Beside a known answer: the barrier starts where it ended.
WARM = {
    "ipopt.warm_start_init_point": "yes",
    "ipopt.mu_init": 1e-7,
    **{f"ipopt.warm_start_{name}_push": 1e-9 for name in ("bound", "mult_bound", "slack_bound")},
    **{f"ipopt.warm_start_{name}_frac": 1e-9 for name in ("bound", "slack_bound")},
}


def solve_equations(unknowns: ca.MX, equations: ca.MX, guess, lower, scale) -> np.ndarray:
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


@dataclass(frozen=True)
class Minimum:
    """Where an iteration for a constrained minimum ended.

    x : (n,)
    cost : there
    multipliers : of the bounds (n,) and of the constraints (m,)
    values : of the constraints, (m,)
    off : by how much each is missed, (m,)
    slope : the largest part of the gradient of the Lagrangian, beside the largest multiplier
    kind : "minimum", "infeasible", "bottomless", "undefined", "overdetermined" or "stuck"
    iterations : taken
    """

    x: np.ndarray
    cost: float
    multipliers: tuple[np.ndarray, np.ndarray]
    values: np.ndarray
    off: np.ndarray
    slope: float
    kind: str
    iterations: int

    @property
    def feasible(self) -> bool:
        """Whether the constraints are as good as met."""
        return bool(self.off.max(initial=0.0) <= NEARLY)

    @property
    def reason(self) -> str:
        """Why it is no minimum, "" for one."""
        if self.kind == "minimum":
            return ""
        slope = f", the cost's slope is {self.slope:.1e}" if self.feasible else ""
        return f"{ENDS[self.kind]} (off by {self.off.max(initial=0.0):.1e}{slope})"


class Minimiser:
    """Ipopt with exact second derivatives for least cost(unknowns, p) under bounds and constraints, all of order one.

    options : of Ipopt's, beside `MINIMISING`
    """

    def __init__(self, unknowns: ca.MX, p: ca.MX, cost: ca.MX, constraints: ca.MX, options: Mapping | None = None):
        self.options = dict(options or {})
        self.problem = {"x": unknowns, "p": p, "f": cost, "g": constraints}
        gradient = ca.gradient(cost, unknowns)
        multipliers = ca.MX.sym("multipliers", constraints.numel())
        gradient += ca.jtimes(constraints, unknowns, multipliers, True)
        self.conditions = ca.Function("conditions", [unknowns, p, multipliers], [cost, gradient, constraints])
        self._watch = _Watch(unknowns.numel(), constraints.numel(), p.numel())
        self._solvers: dict[bool, ca.Function] = {}

    def __call__(self, guess, p, bounds, limits, multipliers=None) -> Minimum:
        """The minimum near `guess` (n,) with unknowns within `bounds` and constraints within `limits`, pairs of arrays.

        multipliers : of a minimum nearby, from where the iteration starts

        What it found is in the answer's `kind`; only a keyboard interrupt is raised.
        """
        solver = self._solver(multipliers is not None)
        known = {} if multipliers is None else dict(zip(("lam_x0", "lam_g0"), multipliers, strict=True))
        (low, high), (least, most) = bounds, limits
        zeros = np.zeros(len(least))
        nothing = Minimum(np.array(guess), np.nan, (np.zeros(len(guess)), zeros), zeros, zeros, 0.0, "", 0)
        if (least == most).sum() > (low < high).sum():
            return replace(nothing, kind="overdetermined")
        try:
            with interrupts.deferred():
                answer = solver(x0=guess, p=p, lbx=low, ubx=high, lbg=least, ubg=most, **known)
        except RuntimeError:
            return replace(nothing, kind="undefined")
        interrupts.check()
        x, lam_x, lam_g = (np.array(answer[name]).ravel() for name in ("x", "lam_x", "lam_g"))
        cost, slope, values = (np.array(value).ravel() for value in self.conditions(x, p, lam_g))
        off = np.maximum(np.maximum(least - values, values - most), 0.0)
        stats = solver.stats()
        tilt = float(np.abs(slope + lam_x).max(initial=0.0) / (1 + np.abs(lam_g).max(initial=0.0)))
        kind = _kind(stats["return_status"], float(cost[0]), off, tilt)
        taken = stats.get("iter_count", 0)  # there is none where the guess has no cost
        return Minimum(x, float(cost[0]), (lam_x, lam_g), values, off, tilt, kind, taken)

    def _solver(self, warm: bool) -> ca.Function:
        if warm not in self._solvers:
            options = {**MINIMISING, **self.options, **(WARM if warm else {}), "iteration_callback": self._watch}
            self._solvers[warm] = ca.nlpsol("minimise", "ipopt", self.problem, options)
        return self._solvers[warm]


def _kind(status: str, cost: float, off, slope: float) -> str:
    """What an end of Ipopt's means, its conditions recomputed: not even a success is believed."""
    if status in ("Solve_Succeeded", *STALLED_STATUSES):
        largest = max(np.abs(off).max(initial=0.0) / FEASIBLE, slope / STATIONARY_GRADIENT)
        if largest <= 1.0:
            return "minimum"
    if cost < BOTTOMLESS:
        return "bottomless"
    if status == "Invalid_Number_Detected" or not np.isfinite(cost):
        return "undefined"
    missed = np.abs(off).max(initial=0.0) > NEARLY
    return "infeasible" if missed and status in ("Infeasible_Problem_Detected", "Restoration_Failed") else "stuck"


class _Watch(ca.Callback):
    """Called after every iteration: 1 stops the solver, once an interrupt was noted."""

    def __init__(self, unknowns: int, equations: int, parameters: int = 0):
        super().__init__()
        self.sizes = {"x": unknowns, "f": 1, "g": equations, "lam_x": unknowns, "lam_g": equations, "lam_p": parameters}
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
