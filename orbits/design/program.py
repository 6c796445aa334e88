"""An orbit and its parameters as one nonlinear program, and their derivatives by the implicit function theorem.

Unknowns: the parameters theta, those of the design statement, the states at the nodes of its mesh, and what the
constraints are exceeded by, which is held at zero except when it is what is minimised. The mesh is of the motion's own
Taylor steps, as shares of the arcs' durations: with the states at its nodes as unknowns the derivatives stay sparse,
and small changes do not grow along the motion.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from ..errors import NoOrbit
from ..model.model import Model, Units
from ..numerics.linear import solve
from ..periodic.multiple_shooting import MeshTrajectory, ShootingMesh, trajectory_on_mesh
from ..periodic.orbit import Orbit
from ..symbolic.ipopt import Minimiser, Minimum
from .problem import Outputs
from .quantities import (
    VARIED,
    Place,
    design_statement,
    expressions,
    extremes,
    locate,
    missing,
    parts_of,
    unit_of,
)

# What the demands on a motion stay away from zero by, in the machine's units, and the landing jerk as a share of its
# first value: a motion that just touches is none.
DEMAND_MARGIN = 1e-9
JERK_LEFT = 1e-6
# Nodes stay this near to the first motion's, in its sizes: where there is no orbit the states would run off.
NODE_RANGE = 4.0
# Of Ipopt's: the guess is an orbit already, and so small a program can be solved to rounding.
DESIGN_OPTIONS = {
    "calc_lam_p": False,  # which is not in use, and would be complained of where a formula has no value
    "ipopt.tol": 1e-13,
    "ipopt.compl_inf_tol": 1e-13,
    "ipopt.max_iter": 80,
    "ipopt.mu_init": 1e-3,
    "ipopt.bound_push": 1e-4,
    "ipopt.bound_frac": 1e-4,
}


class DesignProgram:
    """The program of what is asked, built once for all values."""

    def __init__(self, model: Model, names: tuple[str, ...], asked: Outputs, places: tuple[Place, ...], counts):
        self.asked, self.names = asked, names
        words = asked.words(model, dict.fromkeys(names, 1.0))
        statement = design_statement(model, any(name in VARIED for name in words), places)
        self.unknowns, self.size = statement.unknowns, len(statement.unknowns)
        k, m = len(asked.over), len(asked.formulas) - 1
        theta, u, fixed = ca.MX.sym("theta", k), ca.MX.sym("u", self.size), ca.MX.sym("fixed", len(names))
        p = ca.vertcat(*[theta[asked.over.index(n)] if n in asked.over else fixed[i] for i, n in enumerate(names)])
        mesh = ShootingMesh(statement, names, counts, u, p)
        units = ca.MX.sym("units", 3)
        values = _values(model, statement, names, asked, words, places).call([u, p, units, *mesh.ends], True)
        formulas, demands, reports, ties = values
        self.scales = ca.MX.sym("scales", 1 + m + 1 + len(asked.demands))
        self.weights = ca.MX.sym("weights", 2)
        over, under = ca.MX.sym("over", m), ca.MX.sym("under", m)
        scaled = ca.vertcat(formulas, demands) / self.scales
        held = scaled[1 : 1 + m] - over + under
        self.equations = mesh.equations.numel() + ties.numel()
        parameters = ca.vertcat(fixed, units, mesh.data, self.weights, self.scales)
        unknowns = ca.vertcat(theta, u, mesh.nodes, over, under)
        cost = self.weights[0] * scaled[0] + self.weights[1] * (ca.sum1(over) + ca.sum1(under))
        pair = [cost, ca.vertcat(mesh.equations, ties, held, scaled[1 + m :])]
        z, scale = ca.MX.sym("z", unknowns.numel()), ca.MX.sym("scale", unknowns.numel())
        pair = ca.Function("program", [unknowns, parameters], pair).call([z * scale, parameters], True)
        self.program = Minimiser(z, ca.vertcat(parameters, scale), *pair, DESIGN_OPTIONS)
        state = ca.vertcat(theta, u, mesh.nodes)
        zeros, results = mesh.equations, ca.vertcat(formulas, demands, reports, ties)
        self.ties = ties.numel()
        # Built when they are asked for: most programs are solved more often than differentiated.
        self._derivatives = lambda: ca.Function(
            "derivatives", [state, parameters], [zeros, results, ca.jacobian(zeros, state), ca.jacobian(results, state)]
        )
        self._built: ca.Function | None = None

    def derivatives(self, state, parameters) -> list[np.ndarray]:
        """Equations, values, and the Jacobians of both by (theta, u, nodes)."""
        self._built = self._built or self._derivatives()
        return [value.full() for value in self._built(state, parameters)]


def _values(model: Model, statement, names, asked: Outputs, words, places) -> ca.Function:
    """(u, p, units, end of each arc ...) -> the formulas, the demands in the machine's units, the quantities in use,
    and what vanishes where an extreme is taken at several places at once."""
    u, p, units = ca.SX.sym("u", len(statement.unknowns)), ca.SX.sym("p", len(names)), ca.SX.sym("units", 3)
    ends = [ca.SX.sym("x", len(arc.phase.states)) for arc in statement.arcs]
    named = dict(zip(statement.unknowns, ca.vertsplit(u), strict=True))
    values = dict(zip(names, ca.vertsplit(p), strict=True))
    split = [ca.vertsplit(end) for end in ends]
    found = expressions(model, [*words, "landing_jerk"], places, named, split, values)
    unit = Units(*ca.vertsplit(units))
    stated = {name: found[name] * unit_of(name, unit) for name in words} | values
    if "rest_length" in values:
        stated["rest_length"] = values["rest_length"] * unit.length
    formulas = [formula(**{name: stated[name] for name in formula.names}) for formula in asked.formulas]
    demands = [-found["landing_jerk"], *(found[name] for name in asked.demands)]
    reports = [stated[name] for name in words]
    ties = [first - other for first, *rest in extremes(model, places, named, split, values).values() for other in rest]
    results = [ca.densify(ca.vertcat(*part)) if part else ca.SX(0, 1) for part in (formulas, demands, reports, ties)]
    return ca.Function("values", [u, p, units, *ends], results)


@lru_cache(maxsize=64)
def design_program(
    model: Model, names: tuple[str, ...], asked: Outputs, places: tuple[Place, ...], counts
) -> DesignProgram:
    """The graph, kept for the next call with the same question."""
    return DesignProgram(model, names, asked, places, counts)


@dataclass(frozen=True, eq=False)
class DesignPoint:
    """A question at an orbit: the graph with everything that it needs to be solved from there.

    places : where its extremes are taken
    p, u : the parameters by name, the unknowns of the design statement
    motion : of that statement
    units : what the formulas' numbers are in
    demands : those of the question that the orbit knows
    words : the quantities in use
    """

    program: DesignProgram
    places: tuple[Place, ...]
    p: dict[str, float]
    u: np.ndarray
    motion: MeshTrajectory
    units: Units
    demands: tuple[str, ...]
    words: tuple[str, ...]

    @property
    def theta(self) -> np.ndarray:
        return np.array([self.p[name] for name in self.program.asked.over])

    def parameters(self, weights, scales) -> np.ndarray:
        fixed, units = list(self.p.values()), [self.units.length, self.units.time, self.units.force]
        return np.concatenate([fixed, units, self.motion.data, weights, scales])

    @cached_property
    def _derivatives(self) -> list[np.ndarray]:
        nodes = self.motion.node_values
        state = np.concatenate([self.theta, self.u, nodes])
        return self.program.derivatives(state, self.parameters([1.0, 0.0], np.ones(self.program.scales.numel())))

    @property
    def values(self) -> np.ndarray:
        """Values (rows,) of the formulas, the landing jerk times -1, the demands, the words and the ties."""
        return self._derivatives[1].ravel()

    @cached_property
    def slopes(self) -> np.ndarray:
        """Derivatives (rows, k) of the values by the parameters, the orbit going with them."""
        _, _, zeros_by, values_by = self._derivatives
        k = len(self.program.asked.over)
        moved = -solve(zeros_by[:, k:], zeros_by[:, :k])
        return values_by[:, :k] + values_by[:, k:] @ moved

    def minimise(self, bounds, units, reach: float, limits, scales, weights) -> Minimum:
        """The program solved from here.

        bounds : of the parameters, (low, high) within reach
        units : of the parameters
        reach : by this share may the unknowns grow
        limits : (low, high) of the constraints, in scaled units
        scales : of the formulas and the demands
        weights : of the objective, and of what the constraints are exceeded by; 0 where they may not be
        """
        g, m, k = self.program, len(self.program.asked.formulas) - 1, len(self.program.asked.over)
        nodes, unit = self.motion.node_values, self.motion.node_sizes
        guess = np.concatenate([self.theta, self.u, nodes, np.zeros(2 * m)])
        size = np.maximum(np.abs(self.u), 0.1 * np.abs(self.u).max())
        scale = np.concatenate([units, size, unit, np.ones(2 * m)])
        lower, upper = np.full(len(guess), -np.inf), np.full(len(guess), np.inf)
        lower[:k], upper[:k] = bounds
        # A mesh serves motions up to so many times as long; all but the lift-off extension are times and a speed.
        factor = 1 + min(reach, 1.0)
        lower[k + 1 : k + g.size], upper[k + 1 : k + g.size] = self.u[1:] / factor, self.u[1:] * factor
        nodes = slice(k + g.size, len(guess) - 2 * m)
        lower[nodes], upper[nodes] = guess[nodes] - NODE_RANGE * unit, guess[nodes] + NODE_RANGE * unit
        lower[len(guess) - 2 * m :], upper[len(guess) - 2 * m :] = 0.0, np.inf if weights[1] else 0.0
        demanded = np.array([JERK_LEFT, *(DEMAND_MARGIN for _ in self.demands)])
        least = np.concatenate([np.zeros(g.equations), limits[0], demanded])
        most = np.concatenate([np.zeros(g.equations), limits[1], np.full(len(demanded), np.inf)])
        p = np.concatenate([self.parameters(weights, scales), scale])
        found = g.program(guess / scale, p, (lower / scale, upper / scale), (least, most))
        if found.kind == "undefined":
            raise NoOrbit(
                f"{' or '.join(repr(f.text) for f in g.asked.formulas)} has no finite value or slope on the way: keep "
                "the parameters, by their bounds, where it has; else state the machine in units nearer to 1"
            )
        return replace(found, x=found.x * scale)


def design_point(
    machine, orbit: Orbit, asked: Outputs, units: Units, both: Mapping[str, tuple] | None = None
) -> DesignPoint:
    """A question at an orbit of a machine.

    both : extremes, by name, that are to be taken at several places, which are then equal
    Raises `NoOrbit` for a contact that does not end, or an extreme that the orbit does not have.
    """
    model, p = machine.model, dict(machine.values)
    if orbit.contact_time is None:
        raise NoOrbit("; ".join(orbit.violations))
    demands = tuple(d for d in asked.demands if locate(model, orbit, p, parts_of(d)[0]))
    asked = Outputs(asked.formulas, asked.over, demands)
    words = asked.words(model, p)
    places, times = [], []
    for part in dict.fromkeys(part for word in words for part in parts_of(word)):
        found = locate(model, orbit, p, part)
        if found is None:
            raise missing(model, part)
        known = {found[0]: found[1]} | dict((both or {}).get(part, ()))
        places += known.keys()
        times += known.values()
    statement = design_statement(model, any(name in VARIED for name in words), tuple(places))
    given = {"liftoff": orbit.liftoff_extension, "alpha": orbit.alpha, "duration": orbit.flight_time / 2}
    given |= {"contact": orbit.contact_time / 2} | {f"at {i}": time for i, time in enumerate(times)}
    u = np.array([given[name] for name in statement.unknowns])
    motion = trajectory_on_mesh(statement, dict(zip(statement.unknowns, u.tolist(), strict=True)), p)
    built = design_program(model, tuple(p), asked, tuple(places), motion.counts)
    return DesignPoint(built, tuple(places), p, u, motion, units, demands, tuple(words))
