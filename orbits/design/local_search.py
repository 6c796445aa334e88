"""From orbits to local optima of a design, from all starts together, by steps within trust regions.

Each round takes one step from the orbit of every start: quadratic models about it are minimised within a trust region.
The orbits at the new parameters are found and certified together, and a step is accepted if the objective and the
violations fall by enough of what the models predict. Conditions that a certificate finds violated become demands from
then on, and an extreme that alternates between two places is held at both. A search ends where the best step no longer
changes the design and the optimality conditions hold.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, NoOrbit, OrbitsError
from ..model import Machine
from ..periodic import Orbit
from ..running import interrupts
from ..shooting import NEWTON
from ..symbolic import Weights
from .design_point import DEMAND_MARGIN, Case, DesignPoint, Ties, design_points, no_motion
from .design_problem import DesignProblem, Outputs
from .evaluator import by_logarithm
from .optimality import Design, constraint_sizes, demands_of, optimum_at
from .tuned_machine import motions_near, statement_of_orbits, unknowns_of

# The cost of a step is the objective, with the constraints held; or, where they are not nearly met, the objective and
# penalised violations, the next of these where they do not fall, and at last the violations alone, to determine whether
# they can be met at all.
PENALISED = (Weights(1.0, 10.0), Weights(1e-3, 1.0), Weights(0.0, 1.0))


class LocalOptions(NamedTuple):
    """Steps of local searches for designs, and where they end."""

    # The constraints are met, or nearly, if the sum of their violations, as shares of their sizes, is at most this.
    met: float = 1e-8
    nearly_met: float = 1e-3
    rounds: int = 250  # steps from one start, at most
    # After this number of steps with one of the weights in `PENALISED` the next are taken: the objective is measured by
    # its own value at each step, so that steps may lead round and round where it changes by as much as the violations.
    penalised: int = 50
    # The trust region at first and at least: the largest change of a parameter as a share of its range, or nine times
    # less than the relative change of what is measured by its logarithm.
    first: float = 0.5
    least: float = 1e-7
    # An orbit this many times as fast or long as the first escapes, if the parameters change by no more than the share
    # `rest` of their values and of their distances to the bounds while it becomes twice as fast or long. Where the
    # search cannot continue, the ratio `loss` is enough.
    escape: float = 10.0
    loss: float = 2.0
    rest: float = 1e-2
    jerk: float = 1e-6  # lower bound of the landing jerk, as a share of its value before the step
    correction: float = 0.5  # an orbit farther from that of the models, as a share of its unknowns, is another one
    on_bound: float = 1e-8  # a parameter nearer to its bound, in its unit, is put on it, since Ipopt stays inside
    objective: float = 1e-6  # the scale of an objective that vanishes, as a share of its value at the start
    slope: float = 1e-6  # largest slope of the Lagrangian, as a share of the objective over a parameter's range
    # A step that is shorter, in units of the parameters, does not change the design; nor does one that is nearly so
    # short and not half as long as the last one, so that rounding decides.
    unchanged: float = 1e-14
    nearly_unchanged: float = 1e-6
    # Where a step gains no more than this, optimality conditions that hold to this slope hold to rounding.
    small_gain: float = 1e-9
    smallest_slope: float = 1e-13
    still: float = 1e-9  # violations that a step reduces by no more are least
    # A step is accepted if the merit falls by this share of what is predicted, unless that is no more than rounding;
    # and the trust region grows or shrinks where it falls by more than the share `good` or less than `poor`.
    accepted: float = 0.1
    rounded: float = 1e-11
    good: float = 0.7
    poor: float = 0.3
    penalty: float = (
        2.0  # of violations in the merit, in multiples of their largest multiplier or the objective's scale
    )

    @property
    def held(self) -> Weights:
        """The weights of a step with the constraints held."""
        return Weights(1.0, 0.0, self.nearly_met)


SEARCH = LocalOptions()


class Unbounded(NoOrbit):
    """The objective gets better without bound."""


class Infeasible(NoOrbit):
    """The constraints cannot be met; `size` is the sum of their violations, scaled."""

    size = 0.0


class DesignStep(NamedTuple):
    """A step: the machine and the unknowns (n,) of the orbit that it leads to, its length in units of the parameters
    and as a share of the trust region, the weights in its merit, the predicted fall of that, and why the models have no
    minimum with the constraints held, if so."""

    machine: Machine
    u: np.ndarray
    length: float
    share: float
    weights: Weights
    gain: float
    reason: str


@dataclass(frozen=True, eq=False)
class LocalSearch:
    """The state of a search from one start."""

    problem: DesignProblem
    first: Orbit  # the orbit at the start
    least: float  # the least scale of the objective
    sizes: np.ndarray  # the unit of each constraint, see `constraint_sizes`
    flat: np.ndarray  # whether each parameter (k,) had no effect at the start
    point: DesignPoint  # the objective and the constraints at the current orbit
    ties: Ties = field(default_factory=dict)  # further places of extremes, which are held equal to the first
    refused: tuple[tuple, ...] = ()  # the places of the extremes after steps from here that were refused
    reach: float = SEARCH.first  # the trust region
    length: float = np.inf  # of the last step, in units of the parameters
    stage: int = 0  # the number of the weights in `PENALISED`, of the cost where the constraints are not nearly met
    collapsed: bool = False  # whether a step led into a contact without end
    reason: str = ""  # why the last refused step was refused

    def scales(self) -> np.ndarray:
        """Scales of the objective (with its sign), the constraints, the landing jerk, the demands and the ties."""
        values, m = self.point.values, len(self.sizes)
        objective = self.problem.sign * (max(abs(values[0]), self.least) or 1.0)
        ones = np.ones(len(self.point.demands) + len(values[self.point.tied]))
        return np.array([objective, *self.sizes, abs(values[1 + m]), *ones])

    def limits(self) -> np.ndarray:
        """The least and the largest values, (2, ...), of the scaled results after the objective."""
        stated = [(c.low / size, c.high / size) for c, size in zip(self.problem.constraints, self.sizes, strict=True)]
        demanded = [(SEARCH.jerk, np.inf), *[(DEMAND_MARGIN, np.inf)] * len(self.point.demands)]
        return np.array([*stated, *demanded, *[(0.0, 0.0)] * len(self.point.values[self.point.tied])]).T

    def excess(self, values: np.ndarray) -> np.ndarray:
        """The violations of the limits by results, without ties; those of the constraints are the first."""
        last = self.point.scaled.stop
        scaled, (low, high) = values[1:last] / self.scales()[1:last], self.limits()[:, : last - 1]
        return np.maximum(np.maximum(low - scaled, scaled - high), 0.0)

    @property
    def violations(self) -> np.ndarray:
        """The violation of each constraint, as a share of its size."""
        return self.excess(self.point.values)[: len(self.sizes)]

    def merit(self, values: np.ndarray, weights: Weights) -> float:
        """The weighted sum of the objective and the violations."""
        violation = np.maximum(self.excess(values) - weights.spared, 0.0).sum()
        return float(weights.objective * values[0] / self.scales()[0] + weights.violation * violation)

    def results(self, end: DesignPoint) -> np.ndarray:
        """The results of another point without ties; a demand that its orbit does not have is met."""
        count = 2 + len(self.sizes)
        known = dict(zip(end.demands, end.values[count:].tolist(), strict=False))
        return np.append(end.values[:count], [known.get(name, 1.0) for name in self.point.demands])

    def step(self, weights: Weights) -> DesignStep:
        """The step to the minimum of the models within the trust region, with these weights in its cost."""
        problem, models, theta, scales = self.problem, self.point.models, self.point.theta, self.scales()
        assert models is not None
        low, high = np.array(problem.low), np.array(problem.high)
        largest = np.log1p(9 * self.reach)
        radius = np.where(problem.wide, largest, self.reach)
        bounds = np.clip([problem.change(theta, end) for end in (low, high)], -radius, radius) * ~self.flat
        ones = np.ones(len(models.values) - len(scales))
        # Unknowns that may change their sign may change by any amount.
        logarithmic = by_logarithm(statement_of_orbits(self.point.machine))
        within = np.where(logarithmic, largest * ones, np.inf)
        limits = np.hstack([self.limits(), [-within, within]])
        minimum = models.over(np.append(scales, ones)).minimum(len(self.sizes), bounds, limits, weights)
        to = np.clip(problem.changed(theta, minimum.x[: len(theta)]), low, high)
        near = np.minimum(to - low, high - to) < SEARCH.on_bound * problem.units(to)
        to = np.where(self.flat, theta, np.where(near, np.where(to - low < high - to, low, high), to))
        change = problem.change(theta, to)
        expected = models(change)
        moved = expected[len(scales) :]
        multiplier = np.abs(minimum.multipliers[1][: len(scales) - 1]).max()
        weights = weights._replace(violation=weights.violation or SEARCH.penalty * max(1.0, multiplier))
        gain = self.merit(self.point.values, weights) - self.merit(expected, weights)
        machine = self.point.machine.with_values(**dict(zip(problem.names, to.tolist(), strict=True)))
        share = max(np.abs(change / radius).max(), np.abs(moved[logarithmic]).max() / largest)
        length = float(np.abs(change).max())
        return DesignStep(machine, self.point.moved(moved), length, float(share), weights, gain, minimum.reason)


def local_optima(
    motions: Sequence[tuple[Machine, Orbit] | OrbitsError], problem: DesignProblem, report: Callable[[float], None]
) -> list[Design | OrbitsError]:
    """The local optima found from several machines with dimensionless orbits, or the reasons why there are none.

    report : called with the share of the searches that have ended
    """
    found: list[Any] = list(motions)
    began = [i for i, motion in enumerate(motions) if isinstance(motion, tuple)]
    cases = [_case(found[i], problem) for i in began]
    for i, point in zip(began, _of_each(design_points, cases, problem), strict=True):
        found[i] = attempt(_initial_search, point, problem)
    for left in reversed(range(SEARCH.rounds)):
        interrupts.heed()
        going = [i for i, each in enumerate(found) if isinstance(each, LocalSearch)]
        for i in going:
            found[i] = attempt(_proposed, found[i], left)
        stepping = [i for i in going if isinstance(found[i], tuple)]
        for i, end in zip(stepping, _of_each(_ends, [found[i] for i in stepping], problem), strict=True):
            found[i] = attempt(_next, *found[i], end)
        report(1 - len(going) / len(found))
        if not going:
            break
    return found


def attempt(function: Callable, *arguments: Any) -> Any:
    """The result of a function, or the error that it raises; raises `InputError`."""
    try:
        return function(*arguments)
    except InputError:
        raise
    except OrbitsError as error:
        return error


def _of_each(function: Callable[..., list], items: Sequence, problem: DesignProblem) -> list:
    """The results of a function of several items together; where that raises an error, of each alone, or its error."""
    found = attempt(function, items, problem)
    if not isinstance(found, OrbitsError):
        return found
    return [found] if len(items) == 1 else [_of_each(function, [item], problem)[0] for item in items]


def _case(
    motion: tuple[Machine, Orbit], problem: DesignProblem, known: Sequence[str] = (), ties: Ties | None = None
) -> Case:
    """The objective, the constraints and the demands at an orbit: the known demands, and the ones that it adds."""
    machine, orbit = motion
    outputs = Outputs(problem.formulas, problem.names, demands_of(machine, orbit, known))
    return Case(machine, orbit, outputs, ties or {})


def _ends(steps: Sequence[tuple[LocalSearch, DesignStep]], problem: DesignProblem) -> list[DesignPoint | NoOrbit]:
    """The points to which steps lead, or the reasons why there are none."""
    machines, us = [step.machine for _, step in steps], [step.u for _, step in steps]
    # The number of a family may change along orbits of a machine whose launch has several unknowns.
    families = [search.first.family if search.point.machine.model.one_speed else None for search, _ in steps]
    found: list[Any] = motions_near(machines, us, families)
    cases = dict[int, Case]()
    for i, ((search, step), near) in enumerate(zip(steps, found, strict=True)):
        own = len(step.u) - len(statement_of_orbits(step.machine).tuned)
        u, expected = (step.u if near is None else unknowns_of(*near))[:own], step.u[:own]
        least = NEWTON.smallest_unit if step.machine.model.one_speed else 0.1 * np.abs(u).max()
        if near is None or np.max(np.abs(u - expected) / np.maximum(np.abs(u), least)) > SEARCH.correction:
            found[i] = NoOrbit("no orbit of the family is found near the one that the models predict")
        else:
            cases[i] = _case(near, problem, search.point.demands, search.ties)
    for i, point in zip(cases, design_points(list(cases.values()), problem), strict=True):
        found[i] = point
    return found


def _initial_search(point: DesignPoint | OrbitsError, problem: DesignProblem) -> LocalSearch:
    """The search at its start."""
    if isinstance(point, OrbitsError):
        raise point
    stated = 1 + len(problem.constraints)
    if not np.isfinite(point.values[:stated]).all():
        raise NoOrbit(f"'{problem.text}' or a constraint has no value at {problem.where(point.machine)}")
    sizes, flat = constraint_sizes(problem, point), np.logical_not(point.slopes[:stated].any(axis=0))
    return LocalSearch(problem, point.orbit, SEARCH.objective * abs(point.values[0]), sizes, flat, point)


def _proposed(search: LocalSearch, left: int) -> tuple[LocalSearch, DesignStep] | LocalSearch | Design:
    """The next step, where some are `left`, or what the search has come to where no step changes the design."""
    if not left:
        reason = f"at {search.problem.where(search.point.machine)}{search.reason and ': ' + search.reason}"
        raise NoOrbit(f"no optimum within {SEARCH.rounds} steps, {reason}")
    violation = search.violations.sum()
    step = search.step(SEARCH.held) if violation <= SEARCH.nearly_met else None
    penalised = step is None or bool(step.reason)
    if step is None or penalised:
        step = search.step(PENALISED[search.stage])
    settled = step.length <= SEARCH.unchanged or 0.5 * search.length < step.length <= SEARCH.nearly_unchanged
    last, spent = search.stage + 1 == len(PENALISED), SEARCH.rounds - left >= SEARCH.penalised * (search.stage + 1)
    if penalised and violation > SEARCH.met and (settled or step.gain <= SEARCH.still or (spent and not last)):
        if last:
            raise _infeasible(search)
        return replace(search, stage=search.stage + 1)
    if settled or abs(step.gain) <= SEARCH.small_gain:
        optimum = optimum_at(search.problem, search.point, search.scales(), search.flat)
        admissible = search.point.orbit.admissible
        assert optimum.kkt is not None
        if admissible and optimum.kkt <= (SEARCH.slope if settled else SEARCH.smallest_slope):
            return optimum
        if settled:
            off = f"the optimality conditions are off by {optimum.kkt:.1e}"
            return _refused(search, off if admissible else str(no_motion(search.point.machine, search.point.orbit)))
    return replace(search, length=step.length), step


def _next(search: LocalSearch, step: DesignStep, end: DesignPoint | OrbitsError) -> LocalSearch:
    """The search after a step."""
    if isinstance(end, OrbitsError):
        return _refused(search, str(end), step.share, str(end) == step.machine.model.violations["end"])
    if not (np.isfinite(end.values).all() and np.isfinite(end.slopes).all()):
        texts = " or ".join(repr(formula.text) for formula in end.outputs.formulas)
        remedy = "choose bounds within which it has; else choose units that make the machine's numbers nearer to 1"
        return _refused(search, f"{texts} has no finite value or slope on the way: {remedy}", step.share)
    results = search.results(end)
    missed = (results[2 + len(search.sizes) :] < DEMAND_MARGIN).any()
    if search.point.orbit.admissible and not (end.orbit.admissible or missed):
        # The step is refused, and the demands of its orbit hold from here on.
        refused = _refused(search, str(no_motion(end.machine, end.orbit)), step.share)
        again = _again(refused, demands_of(end.machine, end.orbit, search.point.demands), search.ties)
        return replace(again, reach=search.reach) if again.point.demands != search.point.demands else again
    fall = search.merit(search.point.values, step.weights) - search.merit(results, step.weights)
    growth, stopped = 1.0, step.share > 0.999
    if step.gain > SEARCH.rounded:
        if fall < SEARCH.accepted * step.gain:
            return _with_ties(search, end, step)
        growth = 2.0 if stopped and fall > SEARCH.good * step.gain else 0.5 if fall < SEARCH.poor * step.gain else 1.0
    if stopped and _resting(search.problem, search.point, end):
        _check_escape(search, end.machine, end.orbit, SEARCH.escape)
    return replace(search, point=end, refused=(), reach=min(1.0, growth * search.reach))


def _with_ties(search: LocalSearch, end: DesignPoint, step: DesignStep) -> LocalSearch:
    """The search after a step that the merit refuses; an extreme that alternates between two places is held at both."""
    refused = _refused(search, "the models do not hold", step.share)
    known, kinds = [place.kind for place in search.point.places], tuple(place.kind for place in end.places)
    if kinds == tuple(known) or kinds not in search.refused:
        return replace(refused, refused=(*search.refused, kinds))
    ties = {place.kind.extreme: place for place in end.places if place.kind not in known}
    return _again(refused, search.point.demands, {**search.ties, **ties})


def _again(search: LocalSearch, demands: tuple[str, ...], ties: Ties) -> LocalSearch:
    """The search with other demands and ties at the same orbit."""
    case = _case((search.point.machine, search.point.orbit), search.problem, demands, ties)
    (point,) = design_points([case], search.problem)
    return search if isinstance(point, NoOrbit) else replace(search, point=point, ties=ties)


def _refused(search: LocalSearch, reason: str, share: float = 1.0, collapsed: bool = False) -> LocalSearch:
    """The search with a smaller trust region after a step over this share of it; raises the reason where it has become
    too small."""
    reach, collapsed = 0.25 * search.reach * min(share, 1.0), search.collapsed or collapsed
    if reach >= SEARCH.least:
        return replace(search, reach=reach, reason=reason, collapsed=collapsed, length=np.inf)
    machine = search.point.machine
    if collapsed:
        where, collapse = search.problem.where(machine), machine.model.violations["end"]
        raise Unbounded(f"the design ends at a collapse just beyond {where}: {collapse}")
    _check_escape(search, machine, search.point.orbit, SEARCH.loss)
    raise NoOrbit(f"the design cannot be continued from {search.problem.where(machine)}: {reason}")


def _check_escape(search: LocalSearch, machine: Machine, orbit: Orbit, ratio: float) -> None:
    """Raise `Unbounded` where an orbit has become `ratio` times as fast or long as the first, or as slow or short."""
    problem = search.problem
    for name in ("alpha", "contact_time"):
        value = getattr(orbit, name)
        change = value / getattr(search.first, name)
        if not 1 / ratio < change < ratio:
            end, relation = ("escapes", "<=") if change > 1 else ("shrinks to zero", ">=")
            raise Unbounded(
                f"the objective has no {'least' if problem.sign > 0 else 'largest'} value: '{problem.text}' gets "
                f"better as the orbit {end}, {name} = {value:.4g} at {problem.where(machine)} and still changing; "
                f"bound it, for example subject_to=['{name} {relation} ...']"
            )


def _resting(problem: DesignProblem, before: DesignPoint, after: DesignPoint) -> bool:
    """Whether the parameters hardly change any more, compared with the orbit, while they lie inside their bounds."""
    old, new = before.theta, after.theta
    ahead = np.where(new < old, new - problem.low, problem.high - new)
    ratios = [getattr(after.orbit, name) / getattr(before.orbit, name) for name in ("alpha", "contact_time")]
    pace = SEARCH.rest * np.abs(np.log2(ratios)).max()
    return bool((np.abs(new - old) <= pace * np.minimum(np.abs(new), ahead)).all())


def _infeasible(search: LocalSearch) -> Infeasible:
    """The error that names the violated constraints."""
    problem, violations = search.problem, search.violations
    stated = zip(problem.constraints, search.point.values[1:].tolist(), violations, strict=False)
    far = [(constraint, value) for constraint, value, violation in stated if violation > SEARCH.met]
    missed = [f"'{c.text}' is missed by {c.violation(value):.4g}, at {value:.6g}" for c, value in far]
    ranges = zip(problem.low, problem.names, problem.high, strict=True)
    bounds = ", ".join(f"{low:g} <= {name} <= {high:g}" for low, name, high in ranges)
    error = Infeasible(
        f"no motion was found with {bounds} that meets the constraints: at best {' and '.join(missed)}, with "
        f"{problem.where(search.point.machine)}; relax them, or widen the bounds"
    )
    error.size = float(violations.sum())
    return error
