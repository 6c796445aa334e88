"""An orbit and its parameters as one nonlinear program, and derivatives of quantities by the implicit function theorem.

Unknowns: the parameters theta; those of the design statement; the shooting nodes on its mesh; and the violations of the
constraints, which are held at zero except where they are minimised. With the shooting nodes as unknowns the derivatives
stay sparse, and small changes do not grow along the trajectory.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeAlias

import casadi as ca
import numpy as np

from ..errors import NoOrbit
from ..model.machine import Machine
from ..model.model import Model
from ..numerics.roots import solve
from ..periodic.orbit import Orbit
from ..shooting.multiple_shooting import MeshTrajectory, ShootingMesh, trajectory_on_mesh
from ..symbolic.caches import cached
from ..symbolic.ipopt import Minimiser, Minimum
from ..units import DIMENSIONS, LENGTH, Units
from .design_statement import ABSENT, Place, expressions, extreme_values, extremes_of, locate, without_contact
from .problem import Outputs

# Demands on a motion stay this far above zero, in the machine's units: a motion that just touches is refused.
DEMAND_MARGIN = 1e-9
LEAST_JERK = 1e-6  # lower bound of the landing jerk, as a share of its value at the guess: a lossless landing needs it
NODE_RANGE = 4.0  # bound of the shooting nodes about their guess, in their sizes: far from an orbit states run away
# The guess is already an orbit, so the barrier starts small, and is lowered soon and fast, which saves one iteration in
# seven; and so small a program can be solved to rounding.
DESIGN_OPTIONS = {
    "calc_lam_p": False,  # not used, and CasADi would warn of it where a formula has no value
    "ipopt.tol": 1e-13,
    "ipopt.compl_inf_tol": 1e-13,
    "ipopt.max_iter": 80,
    "ipopt.mu_init": 1e-5,
    "ipopt.mu_superlinear_decrease_power": 1.9,
    "ipopt.barrier_tol_factor": 1e3,
    "ipopt.bound_push": 1e-4,
    "ipopt.bound_frac": 1e-4,
}
# Several places of one extreme with their times, by the name of the extreme.
Ties: TypeAlias = Mapping[str, tuple[tuple[Place, float], ...]]
# Lower and upper bounds.
Range: TypeAlias = tuple[np.ndarray, np.ndarray]


class Weights(NamedTuple):
    """Weights in the cost of a nonlinear program; constraints with a violation of weight 0 are held exactly."""

    objective: float
    violation: float


class DesignProgram:
    """The nonlinear program of some outputs over parameters, built once for all values.

    quantities, unknowns : names of the quantities in use, and of the unknowns of the design statement
    scales : symbol of the scales of the formulas, the landing jerk and the demands
    reported, tied : the places of the quantities, and of the differences between two places of an extreme, in results
    equations : number of equations that vanish on an orbit
    """

    def __init__(
        self, model: Model, names: tuple[str, ...], outputs: Outputs, places: tuple[Place, ...], counts: tuple[int, ...]
    ):
        ones = dict.fromkeys(names, 1.0)
        self.outputs, self.quantities, self.units = outputs, outputs.quantities(model, ones), model.units
        statement = outputs.statement(model, ones, places)
        self.unknowns = statement.unknowns
        over, m = outputs.over, len(outputs.formulas) - 1
        theta, fixed = ca.MX.sym("theta", len(over)), ca.MX.sym("fixed", len(names))
        u = ca.MX.sym("u", len(self.unknowns))
        p = ca.vertcat(*[theta[over.index(name)] if name in over else fixed[i] for i, name in enumerate(names)])
        mesh = ShootingMesh(statement, names, counts, u, p)
        results = _results(model, statement, names, outputs, places).call([u, p, *mesh.ends], True)
        formulas, demands, reports, ties = results
        self.scales = ca.MX.sym("scales", formulas.numel() + demands.numel())
        self.reported = slice(self.scales.numel(), self.scales.numel() + reports.numel())
        self.tied = slice(self.reported.stop, self.reported.stop + ties.numel())
        self.equations = mesh.equations.numel() + ties.numel()
        weights, excess, shortfall = ca.MX.sym("weights", 2), ca.MX.sym("excess", m), ca.MX.sym("shortfall", m)
        parameters = ca.vertcat(fixed, mesh.data, weights, self.scales)
        state = ca.vertcat(theta, u, mesh.nodes)
        scaled = ca.vertcat(formulas, demands) / self.scales
        cost = weights[0] * scaled[0] + weights[1] * (ca.sum1(excess) + ca.sum1(shortfall))
        constraints = scaled[1 : 1 + m] - excess + shortfall
        held = ca.vertcat(mesh.equations, ties, constraints, scaled[1 + m :])
        unknowns = ca.vertcat(state, excess, shortfall)
        program = ca.Function("program", [unknowns, parameters], [cost, held])
        # The solver's unknowns are these unknowns divided by a scale, which is a further parameter.
        z, scale = ca.MX.sym("z", unknowns.numel()), ca.MX.sym("scale", unknowns.numel())
        cost, held = program.call([z * scale, parameters], True)
        self.solver = Minimiser(z, ca.vertcat(parameters, scale), cost, held, DESIGN_OPTIONS)
        self._graph = state, parameters, mesh.equations, ca.vertcat(*results)

    @cached_property
    def derivatives(self) -> ca.Function:
        """(state, parameters) -> equations, results, Jacobians of both by the state (theta, u, shooting nodes).

        Built on first use, since most nonlinear programs are solved more often than differentiated.
        """
        state, parameters, equations, results = self._graph
        jacobians = ca.jacobian(equations, state), ca.jacobian(results, state)
        return ca.Function("derivatives", [state, parameters], [equations, results, *jacobians])


def _results(model, statement, names, outputs, places):
    """(u, p, end of each arc ...) -> the formulas; minus the landing jerk and the demands, without dimensions; the
    quantities in use; and the differences between two places of an extreme. Formulas and quantities are in SI for a
    model in SI, whose units vary with its parameters."""
    u, p = ca.SX.sym("u", len(statement.unknowns)), ca.SX.sym("p", len(names))
    ends = [ca.SX.sym("x", len(arc.phase.states)) for arc in statement.arcs]
    unknowns = dict(zip(statement.unknowns, ca.vertsplit(u), strict=True))
    values = dict(zip(names, ca.vertsplit(p), strict=True))
    states = [ca.vertsplit(end) for end in ends]
    quantities, extremes = outputs.quantities(model, values), extreme_values(model, places, unknowns, states, values)
    found = expressions(model, [*quantities, "landing_jerk"], extremes, unknowns, states, values)
    units = model.units(values) if model.units else Units(1.0, 1.0, 1.0)
    # A rise is a length.
    stated = values | {name: found[name] * units.of(DIMENSIONS.get(name, LENGTH)) for name in quantities}
    results = (
        [formula(**{name: stated[name] for name in formula.names}) for formula in outputs.formulas],
        [-found["landing_jerk"], *(found[name] for name in outputs.demands)],
        [stated[name] for name in quantities],
        [first - other for first, *others in extremes.values() for other in others],
    )
    columns = [ca.densify(ca.vertcat(*part)) if part else ca.SX(0, 1) for part in results]
    return ca.Function("results", [u, p, *ends], columns)


# The nonlinear program, cached for the next call with the same arguments.
design_program = cached(DesignProgram)


@dataclass(frozen=True, eq=False)
class DesignPoint:
    """The outputs at one orbit: the nonlinear program with all data for its solution from there."""

    program: DesignProgram
    places: tuple[Place, ...]  # the places of the extremes
    p: dict[str, float]  # the parameters by name
    u: np.ndarray  # the unknowns of the design statement
    trajectory: MeshTrajectory  # of that statement
    demands: tuple[str, ...]  # the demands of the outputs that the orbit has

    @property
    def theta(self) -> np.ndarray:
        """The parameters to design, (k,)."""
        return np.array([self.p[name] for name in self.program.outputs.over])

    @property
    def place_times(self) -> dict[Place, float]:
        """The places with their times from the start of the phase, 0 for those at its start or middle."""
        unknowns = dict(zip(self.program.unknowns, self.u.tolist(), strict=True))
        return {place: unknowns.get(f"at {i}", 0.0) for i, place in enumerate(self.places)}

    @property
    def sizes(self) -> list[float]:
        """The units of the dimensionless landing jerk and demands; 1 for a dimensionless machine."""
        units = self.program.units(self.p) if self.program.units else Units(1.0, 1.0, 1.0)
        return [units.of(DIMENSIONS[name]) for name in ("landing_jerk", *self.demands)]

    def _parameters(self, weights: Weights, scales: np.ndarray) -> np.ndarray:
        """The parameters of the nonlinear program."""
        return np.concatenate([list(self.p.values()), self.trajectory.data, weights, scales])

    @cached_property
    def _derivatives(self) -> list[np.ndarray]:
        state = np.concatenate([self.theta, self.u, self.trajectory.nodes])
        parameters = self._parameters(Weights(1.0, 0.0), np.ones(self.program.scales.numel()))
        return [value.full() for value in self.program.derivatives(state, parameters)]

    @property
    def values(self) -> np.ndarray:
        """The results (rows,): formulas, minus the landing jerk, demands, quantities in use, ties."""
        return self._derivatives[1].ravel()

    @property
    def scaled_values(self) -> np.ndarray:
        """The results that have a scale: all but the quantities in use and the ties."""
        return self.values[: self.program.reported.start]

    @property
    def quantities(self) -> dict[str, float]:
        """The quantities in use, by name."""
        return dict(zip(self.program.quantities, self.values[self.program.reported].tolist(), strict=True))

    @cached_property
    def slopes(self) -> np.ndarray:
        """Derivatives (rows, k) of the results by the parameters, along which the orbit stays lossless."""
        _, _, equations_by, results_by = self._derivatives
        k = len(self.program.outputs.over)
        by_theta = -solve(equations_by[:, k:], equations_by[:, :k])
        return results_by[:, :k] + results_by[:, k:] @ by_theta

    def minimise(
        self, bounds: Range, units: np.ndarray, reach: float, limits: Range, scales: np.ndarray, weights: Weights
    ) -> Minimum:
        """Solve the nonlinear program from this point.

        bounds, units : (low, high) of the parameters, already within the trust region; the unit of each
        reach : the trust region: the share by which the times and the launch speed may change, at most by a factor of 2
        limits : (low, high) of the constraints, in scaled units
        scales, weights : of the formulas, the landing jerk and the demands; of the cost

        Raises `NoOrbit` where a formula has no value on the way.
        """
        m = len(self.program.outputs.formulas) - 1
        theta, nodes, slacks = self.theta, self.trajectory.nodes, np.zeros(2 * m)
        size, node_size = np.maximum(np.abs(self.u), 0.1 * np.abs(self.u).max()), self.trajectory.sizes
        guess = np.concatenate([theta, self.u, nodes, slacks])
        scale = np.concatenate([units, size, node_size, np.ones(2 * m)])
        # A mesh serves motions that last up to this many times as long. The first unknown is the lift-off extension and
        # may have either sign; all others are times and a speed.
        factor, free, span = 1 + min(reach, 1.0), [np.inf], NODE_RANGE * node_size
        lower = np.concatenate([bounds[0], np.negative(free), self.u[1:] / factor, nodes - span, slacks])
        most_violation = np.full(2 * m, np.inf if weights.violation else 0.0)
        upper = np.concatenate([bounds[1], free, self.u[1:] * factor, nodes + span, most_violation])
        demanded = np.array([LEAST_JERK, *(DEMAND_MARGIN for _ in self.demands)])
        zeros = np.zeros(self.program.equations)
        least = np.concatenate([zeros, limits[0], demanded])
        most = np.concatenate([zeros, limits[1], np.full(len(demanded), np.inf)])
        parameters = np.concatenate([self._parameters(weights, scales), scale])
        minimum = self.program.solver(guess / scale, parameters, (lower / scale, upper / scale), (least, most))
        if minimum.kind == "undefined":
            texts = " or ".join(repr(formula.text) for formula in self.program.outputs.formulas)
            raise NoOrbit(
                f"{texts} has no finite value or slope on the way: keep the parameters, by their bounds, where it has; "
                "else state the machine in units nearer to 1"
            )
        return replace(minimum, x=minimum.x * scale)


def design_point(machine: Machine, orbit: Orbit, outputs: Outputs, ties: Ties | None = None) -> DesignPoint:
    """The outputs at a dimensionless orbit of a machine; the formulas' numbers are in SI for a machine in SI.

    ties : extremes, by name, that are evaluated at further places too, where they are constrained to be equal
    Raises `NoOrbit` for a contact that does not end, or an extreme that the orbit does not have.
    """
    model, p = machine.model, dict(machine.values)
    if orbit.contact_time is None:
        raise without_contact(machine, orbit)
    demands = tuple(name for name in outputs.demands if locate(machine, orbit, extremes_of(name)[0]))
    outputs = replace(outputs, demands=demands)
    names = outputs.quantities(model, p)
    times: dict[Place, float] = {}
    for extreme in dict.fromkeys(extreme for name in names for extreme in extremes_of(name)):
        located = locate(machine, orbit, extreme)
        if located is None:
            raise NoOrbit(f"the orbit has no {ABSENT[extreme]}")
        times |= {located[0]: located[1]} | dict((ties or {}).get(extreme, ()))
    places = tuple(times)
    statement = outputs.statement(model, p, places)
    known = model.launch_at(orbit(0.0)) | {"alpha": orbit.alpha, "duration": orbit.flight_time / 2}
    known |= {"contact": orbit.contact_time / 2} | {f"at {i}": time for i, time in enumerate(times.values())}
    u = {name: known[name] for name in statement.unknowns}
    trajectory = trajectory_on_mesh(statement, u, p)
    program = design_program(model, tuple(p), outputs, places, trajectory.counts)
    return DesignPoint(program, places, p, np.array(list(u.values())), trajectory, demands)
