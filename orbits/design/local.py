"""From one orbit to a local optimum of a design, by nonlinear programs on the meshes of certified orbits.

Each round solves the nonlinear program on the mesh of the current orbit, within a trust region of the parameters. The
orbit is then corrected at the new parameters by its own equations, and certified. Conditions that the certificate finds
nearly violated become demands from then on, and an extreme that has moved to another place is evaluated there. The
search ends where a round no longer changes the design and the optimality conditions hold.
"""

import time
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import NoOrbit
from ..model.machine import Machine
from ..periodic.certified import certified_orbit, solve_from
from ..periodic.orbit import Orbit
from ..running import interrupts
from ..shooting.formulations import iterative, method_of
from ..symbolic.ipopt import Minimum
from ..units import without_units
from .design_statement import base_statement, without_contact
from .nlp import DEMAND_MARGIN, DesignPoint, Ties, Weights, design_point
from .optimality import Design, optimum_at
from .problem import DesignProblem, Outputs

# The cost of a nonlinear program is the objective, with the constraints held; or the violations and a little of the
# objective, until the constraints are met; or the violations alone, to determine whether they can be met at all.
OBJECTIVE, PENALISED, FEASIBILITY = Weights(1.0, 0.0), Weights(1e-3, 1.0), Weights(0.0, 1.0)
MOST_ROUNDS = 25  # nonlinear programs solved from one start, at most
LEAST_REACH = 1e-4  # smallest trust region, as a share of the parameters' range
MOST_COLLAPSES = 6  # rounds that lead to a contact without end, before the objective counts as unbounded
# An orbit this many times as fast or long as the first escapes, if the parameters change by no more than the share REST
# of their values and of their distances to the bounds. Where the search cannot continue, a smaller ratio is enough.
ESCAPE_RATIO, LOSS_RATIO, REST = 10.0, 2.0, 1e-2
# The mesh is fine enough if the correction changes the unknowns by less than the share AGREEMENT plus SWING times the
# share by which a parameter was rounded or put on its bound. A correction by a larger share leads to another orbit.
AGREEMENT, SWING, LARGEST_CORRECTION = 1e-11, 10.0, 1e-3
ON_BOUND = 1e-8  # a parameter nearer to its bound than this share of its unit is put on it, since Ipopt stays inside
LARGEST_SLOPE = 1e-6  # largest slope of the Lagrangian, as a share of the objective over a parameter's range
MET = 1e-8  # the constraints are met if the sum of their violations, as shares of their sizes, is no larger
STILL = 1e-3  # largest change of the parameters, as a share of their units, where a penalised search has come to rest


class Unbounded(NoOrbit):
    """The objective gets better without bound."""


class Infeasible(NoOrbit):
    """The constraints cannot be met; `size` is the sum of their violations, scaled."""

    size = 0.0


@dataclass(frozen=True, eq=False)
class LocalSearch:
    """The state of a search from one start."""

    problem: DesignProblem
    first: Orbit  # the orbit at the start
    sizes: np.ndarray  # the unit of each constraint, see `_constraint_sizes`
    flat: np.ndarray  # whether each parameter (k,) had no effect at the start
    machine: Machine  # the current machine; the next two fields are current too
    orbit: Orbit
    point: DesignPoint  # the objective and the constraints at the current orbit
    demands: tuple[str, ...]  # quantities that are constrained to be positive
    ties: Ties = field(default_factory=dict)  # extremes that are held equal at several places
    visited: tuple[tuple, ...] = ()  # the places of the extremes at earlier orbits
    reach: float = 1.0  # the trust region, as a share of the parameters' range
    weights: Weights = OBJECTIVE  # of the cost in the next round
    collapses: int = 0  # number of rounds that led into a contact without end
    reason: str = ""  # why the last rejected round was rejected

    def at(self, machine: Machine, orbit: Orbit, ties: Ties) -> "LocalSearch":
        """The search at another orbit, with the demands that this orbit adds."""
        demands = _demands(orbit, self.demands)
        point = _point_at(machine, orbit, self.problem, demands, ties)
        return replace(self, machine=machine, orbit=orbit, demands=demands, point=point, ties=ties)

    def scales(self) -> np.ndarray:
        """Scales of the objective (with its sign), the constraints, the landing jerk and the demands."""
        values, m = self.point.scaled_values, len(self.sizes)
        _check_values(self.problem, self.machine, values)
        objective = self.problem.sign * (abs(values[0]) or 1.0)
        return np.array([objective, *self.sizes, abs(values[1 + m]), *np.ones(len(values) - m - 2)])

    def solve(self) -> Minimum:
        """The nonlinear program solved on the mesh of the current orbit."""
        problem, theta = self.problem, self.point.theta
        low, high = (np.array([getattr(c, side) for c in problem.constraints]) / self.sizes for side in ("low", "high"))
        bounds, units = problem.within(theta, self.reach), problem.units(theta)
        return self.point.minimise(bounds, units, self.reach, (low, high), self.scales(), self.weights)

    def violations(self) -> np.ndarray:
        """The violation of each constraint, as a share of its size."""
        stated = zip(self.problem.constraints, self.point.values[1:], self.sizes, strict=False)
        return np.array([constraint.violation(float(value)) / size for constraint, value, size in stated])


def local_optimum(machine: Machine, orbit: Orbit, problem: DesignProblem) -> Design:
    """The local optimum found from an orbit; raises `NoOrbit` with the reason when none is found."""
    search = _initial_search(machine, orbit, problem)
    for _ in range(MOST_ROUNDS):
        interrupts.heed()
        result = _next(search)
        if isinstance(result, Design):
            return result
        search = result
    reason = search.reason and f": {search.reason}"
    raise NoOrbit(f"no optimum within {MOST_ROUNDS} nonlinear programs, at {problem.where(search.machine)}{reason}")


def _initial_search(machine: Machine, orbit: Orbit, problem: DesignProblem) -> LocalSearch:
    """The search at its start; the constraints are penalised first where they are not met there."""
    demands = _demands(orbit, ())
    point = _point_at(machine, orbit, problem, demands, {})
    stated = 1 + len(problem.constraints)
    _check_values(problem, machine, point.values[:stated])
    sizes, flat = _constraint_sizes(machine, problem, point), np.logical_not(point.slopes[:stated].any(axis=0))
    search = LocalSearch(problem, orbit, sizes, flat, machine, orbit, point, demands)
    return search if search.violations().sum() <= MET else replace(search, weights=PENALISED)


def _next(search: LocalSearch) -> LocalSearch | Design:
    """The search after one more round, or the optimum."""
    minimum = search.solve()
    if minimum.reason and not search.weights.violation:
        search = replace(search, weights=PENALISED)
        minimum = search.solve()
    try:
        machine, orbit, agrees = _correct(search, minimum.x)
    except NoOrbit as error:
        collapsed = str(error) == search.machine.model.violations["end"]
        return _rejected(replace(search, collapses=search.collapses + collapsed), str(error))
    stopped = _at_trust_region(search, minimum.x)
    if stopped and _resting(search.problem, search.machine, machine):
        _check_escape(search, machine, orbit, ESCAPE_RATIO)
    return _accepted(search, search.at(machine, orbit, search.ties), minimum, stopped, agrees and not stopped)


def _accepted(search: LocalSearch, moved: LocalSearch, minimum: Minimum, stopped: bool, converged: bool):
    """The search after a round that led to another orbit, or the optimum if the round did not change the design."""
    same = (moved.point.places, moved.point.demands) == (search.point.places, search.point.demands)
    settled = converged and same and moved.orbit.admissible
    if search.weights.violation:
        moved = _toward_feasibility(moved, settled, search.point)
    elif settled and not minimum.reason:
        optimum = optimum_at(moved.machine, moved.orbit, moved.problem, moved.point, search.scales(), search.flat)
        if optimum.kkt <= LARGEST_SLOPE:
            return optimum
        return _rejected(moved, f"the optimality conditions are off by {optimum.kkt:.1e}")
    if not same:
        moved = _with_ties(search, moved, converged)
    # A nonlinear program is not valid once extremes move to other places, so the trust region then shrinks.
    return replace(moved, reach=search.reach / 2 if stopped and not same else min(1.0, 2 * search.reach))


def _rejected(search: LocalSearch, reason: str) -> LocalSearch:
    """The search with a smaller trust region; raises the reason when it has become too small."""
    search = replace(search, reach=search.reach / 4, reason=reason)
    if search.reach >= LEAST_REACH and search.collapses <= MOST_COLLAPSES:
        return search
    where, collapse = search.problem.where(search.machine), search.machine.model.violations["end"]
    if search.collapses:
        raise Unbounded(f"the design runs into a collapse just beyond {where}: {collapse}") from None
    _check_escape(search, search.machine, search.orbit, LOSS_RATIO)
    raise NoOrbit(f"the design cannot be carried on from {where}: {reason}") from None


def _correct(search: LocalSearch, x: np.ndarray) -> tuple[Machine, Orbit, bool]:
    """The certified orbit near the solution of a nonlinear program, and whether it agrees with that solution.

    Raises `NoOrbit` where there is none of the same family.
    """
    problem, low, high = search.problem, np.array(search.problem.low), np.array(search.problem.high)
    k, theta = len(problem.names), np.clip(x[: len(low)], low, high)
    units = problem.units(theta)
    near = np.minimum(theta - low, high - theta) < ON_BOUND * units
    theta = np.where(near, np.where(theta - low < 0.5 * (high - low), low, high), theta)
    machine = search.machine.with_values(**dict(zip(problem.names, theta.tolist(), strict=True)))
    guess = x[k : k + len(base_statement(machine.model).unknowns)]
    with without_units(machine.units):
        orbit, u = corrected_orbit(machine, guess)
    change = np.max(np.abs(u - guess) / np.maximum(np.abs(u), 1e-3))
    if change > LARGEST_CORRECTION or orbit.family != search.first.family:
        raise NoOrbit("the nonlinear program leads to another orbit")
    if orbit.contact_time is None:
        raise without_contact(machine, orbit)
    return machine, orbit, bool(change < AGREEMENT + SWING * np.max(np.abs(theta - x[:k]) / units))


def corrected_orbit(machine: Machine, u: np.ndarray) -> tuple[Orbit, np.ndarray]:
    """The certified orbit of a machine near unknowns `u` of its simplest statement, and the corrected unknowns."""
    began = time.perf_counter()
    solved = solve_from(machine, iterative(method_of(machine.model)), u)
    return certified_orbit(machine, solved, began=began), solved.us[0]


def _toward_feasibility(moved: LocalSearch, settled: bool, before: DesignPoint) -> LocalSearch:
    """The search with the weights of its next round, as long as violations are penalised."""
    violations = moved.violations()
    if violations.sum() <= MET:
        return replace(moved, weights=OBJECTIVE)
    if settled and not moved.weights.objective:
        raise _infeasible(moved, violations)
    change = np.abs(moved.point.theta - before.theta) / moved.problem.units(before.theta)
    return replace(moved, weights=FEASIBILITY) if settled and change.max() <= STILL else moved


def _with_ties(search: LocalSearch, moved: LocalSearch, converged: bool) -> LocalSearch:
    """The search with the places of its extremes; an extreme that alternates between two places is held at both."""
    places, ties = moved.point.places, dict(search.ties)
    if converged and places in search.visited and moved.point.demands == search.point.demands:
        left = {place: time for place, time in search.point.place_times.items() if place not in places}
        ties |= {place.extreme: ((place, time),) for place, time in left.items()}
        moved = moved.at(moved.machine, moved.orbit, ties)
    return replace(moved, visited=(*search.visited, search.point.places))


def _point_at(machine, orbit, problem: DesignProblem, demands: tuple[str, ...], ties: Ties) -> DesignPoint:
    """The objective, the constraints and the demands at an orbit."""
    formulas = problem.formula, *(constraint.formula for constraint in problem.constraints)
    return design_point(machine, orbit, Outputs(formulas, problem.names, demands), ties)


def _demands(orbit: Orbit, demands: tuple[str, ...]) -> tuple[str, ...]:
    """The demands, and the quantities of the orbit that are too small, or nearly so, for a motion."""
    names = ("clearance", "smallest_separation", "smallest_contact_force")
    margins = {name: getattr(orbit.certificate, name) for name in names if name not in demands}
    return (*demands, *(name for name, x in margins.items() if x is not None and x < 2 * DEMAND_MARGIN))


def _constraint_sizes(machine: Machine, problem: DesignProblem, point: DesignPoint) -> np.ndarray:
    """The unit of each constraint: the largest of its bounds and of the terms that it compares; where that is zero, its
    value, or its change by the parameters. The units stay fixed: with shrinking units it would never count as met."""
    known, theta, sizes = machine.values | point.quantities, point.theta, []
    ranges = np.where(theta, np.abs(theta), np.subtract(problem.high, problem.low))
    for constraint, value, slope in zip(problem.constraints, point.values[1:], point.slopes[1:], strict=False):
        terms = constraint.formula.terms
        magnitudes = [abs(bound) for bound in (constraint.low, constraint.high) if np.isfinite(bound)]
        if len(terms) > 1:
            magnitudes += [abs(float(term(**{name: known[name] for name in term.names}))) for term in terms]
        sizes.append(max(magnitudes) or max(abs(value), (np.abs(slope) * ranges).max()) or 1.0)
    return np.array(sizes)


def _check_values(problem: DesignProblem, machine: Machine, values: np.ndarray) -> None:
    """Raise `NoOrbit` where the objective or a constraint is not a finite number."""
    if not np.isfinite(values).all():
        raise NoOrbit(f"'{problem.text}' or a constraint has no value at {problem.where(machine)}")


def _check_escape(search: LocalSearch, machine: Machine, orbit: Orbit, ratio: float) -> None:
    """Raise `Unbounded` where an orbit has become `ratio` times as fast or long as the first, or as slow or short."""
    problem = search.problem
    for name in ("alpha", "contact_time"):
        value = getattr(orbit, name)
        change = value / getattr(search.first, name)
        if not 1 / ratio < change < ratio:
            end, relation = ("escapes", "<=") if change > 1 else ("shrinks to nothing", ">=")
            raise Unbounded(
                f"the objective has no {'least' if problem.sign > 0 else 'largest'} value: '{problem.text}' gets "
                f"better as the orbit {end}, {name} = {value:.4g} at {problem.where(machine)} and still going; bound "
                f"it, as subject_to=['{name} {relation} ...']"
            ) from None


def _resting(problem: DesignProblem, before: Machine, after: Machine) -> bool:
    """Whether the parameters hardly change any more while they lie inside their bounds."""
    old, new = problem.theta(before), problem.theta(after)
    ahead = np.where(new < old, new - problem.low, problem.high - new)
    return bool((np.abs(new - old) <= REST * np.minimum(np.abs(new), ahead)).all())


def _at_trust_region(search: LocalSearch, x: np.ndarray) -> bool:
    """Whether the solution of a nonlinear program lies on the trust region of the parameters or unknowns."""
    problem, point, reach = search.problem, search.point, search.reach
    k, n = len(problem.names), len(point.u)
    theta, (low, high) = x[:k], problem.within(point.theta, reach)
    # A bound of the problem itself does not count.
    below, above = np.where(low > problem.low, theta - low, np.inf), np.where(high < problem.high, high - theta, np.inf)
    changes = np.abs(np.log(x[k + 1 : k + n] / point.u[1:]))
    near = np.minimum(below, above) < 1e-3 * reach * problem.units(point.theta)
    return bool(near.any() or (changes > 0.999 * np.log1p(min(reach, 1.0))).any())


def _infeasible(search: LocalSearch, violations: np.ndarray) -> Infeasible:
    """The error that names the violated constraints."""
    problem = search.problem
    stated = zip(problem.constraints, search.point.values[1:].tolist(), violations, strict=False)
    far = [(constraint, value) for constraint, value, violation in stated if violation > MET]
    missed = [f"'{c.text}' is missed by {c.violation(value):.4g}, at {value:.6g}" for c, value in far]
    ranges = zip(problem.low, problem.names, problem.high, strict=True)
    bounds = ", ".join(f"{low:g} <= {name} <= {high:g}" for low, name, high in ranges)
    error = Infeasible(
        f"no motion was found with {bounds} that meets the constraints: at best {' and '.join(missed)}, with "
        f"{problem.where(search.machine)}; relax it, or widen the bounds"
    )
    error.size = float(violations.sum())
    return error
