"""The best design of a machine: parameters and lossless orbit are solved for together, from one start or from several.

Objectives and constraints are formulas of the quantities in an orbit's JSON document and of the machine's parameters.
"""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..errors import LARGEST_SEED, InputError, NoOrbit, OrbitsError, whole_number
from ..model import Machine, check_parameters
from ..periodic import Orbit, StartLike, continued_orbits, find, start_or_own
from ..result import Progress
from ..running import exclusive, interrupts
from ..symbolic import Formula
from .design_problem import DesignProblem, design_problem
from .designs_at_once import Designs, names_together, solved_designs
from .local_search import Infeasible, Unbounded, attempt, local_optima
from .optimality import Design, Start
from .tuned_machine import (
    TunedMachine,
    continued_from,
    first_of_tuned,
    names_of_designs,
    start_of_tuned,
    unknowns_of,
    with_tuning,
)


class SearchStarts(NamedTuple):
    """The starts of the local searches for the best design.

    Each design of a sample leads to the best of its neighbours that is better than itself, and so on, down to one that
    is better than all of its neighbours: there a local search begins. Source: Torn and Viitanen, "Topographical global
    optimization", in Recent Advances in Global Optimization (1992).
    """

    further: int = 3  # starts that are tried by default when the first one leads to no optimum
    same: float = 1e-3  # parameters of one optimum, from different starts, agree to this share of their units
    designs: int = 256  # of the sample
    neighbours: int = 8  # with which a design is compared
    searches: int = 8  # local ones, at most
    violation_weight: float = 10.0  # of violations, relative to the objective, both in their spread over the sample


SAMPLE = SearchStarts()


class NoOptimum(NoOrbit):
    """No start leads to an optimum."""


@exclusive
def optimize(
    machine: Machine,
    *,
    minimise: str | None = None,
    maximise: str | None = None,
    over: Mapping[str, tuple[float, float]],
    subject_to: Sequence[str] = (),
    family: int = 1,
    start: StartLike | None = None,
    tune: str | Iterable[str] | None = None,
    at: Mapping[str, float] | None = None,
    starts: int | str | None = None,
    seed: int = 0,
    progress: Progress = None,
) -> Design:
    """Find the parameters of a machine that optimise an objective of its lossless orbit.

    machine : as in `find`; its own parameters are the first start, if they lie within the bounds
    minimise, maximise : give one of them, a formula of the orbit's quantities and the machine's parameters
    over : bounds (low, high) of the parameters to be optimised, by name
    subject_to : constraints, such as "stroke <= 0.25", "loss_coefficient <= 2*alpha", "0.1 <= centre_of_mass_rise <=
        0.2"
    family : number of the family, from 1
    start : as in `find`, of the machine's own orbit, instead of the number of a family; the orbits of all other designs
        are continued from it. Machines whose launch has several unknowns need it
    tune, at : as in `find`, for quantities other than extremes of the motion: every design is tuned, and the result's
        `parameters` has the tuned values
    starts : number of local searches. The first starts at the machine's own parameters, the others at points of Sobol's
        sequence. None means one search, and further ones only if it leads to no optimum. With "global", 256 designs of
        the sequence are computed, and searches start at the designs that are better than all their neighbours; the
        result's `share` is the share of the designs with an orbit that lead downhill to its optimum
    seed : of Sobol's sequence, a whole number from 0
    progress : called with the completed share of the work: of the starts or, with "global", of the sample up to 1/2 and
        then of the starts

    Returns the best local optimum found, with its certified orbit. All numbers are in the machine's units, or in SI for
    a machine in SI. The orbit must always be admissible. Raises `InputError` for an ill-posed problem, and `NoOrbit`
    when no start leads to an optimum, with the reason: the amount by which constraints are violated, an orbit that
    escapes, or a contact that collapses.

    >>> from orbits import optimize
    >>> from problems import hopper_in_si
    >>> leg = hopper_in_si(60.0, 3.0, force="k*r", parameters={"k": 8000.0}, rest_length=0.8)
    >>> over, wanted = {"k": (2000.0, 20000.0)}, ["centre_of_mass_rise == 0.04"]
    >>> best = optimize(leg, minimise="largest_contact_force", over=over, subject_to=wanted)
    >>> round(best.parameters["k"], 3), round(best.objective, 3)
    (7071.55, 1483.088)
    """
    check_parameters(machine)
    with interrupts.deferred():
        stated = with_tuning(machine, tune, at, over)
        problem = design_problem(machine, minimise, maximise, over, subject_to, names_of_designs(stated))
        return multistart(Origin.of(stated, family, start), problem, starts, seed, progress)


class Origin(NamedTuple):
    """Where the orbits of designs come from: a family or, where there is one, the orbit of a machine, from which those
    with tuned parameters are always continued."""

    family: int
    machine: Machine
    orbit: Orbit | None

    @classmethod
    def of(cls, machine: Machine, family: int, start: StartLike | None) -> "Origin":
        """The origin from the arguments of `optimize`, of a machine with its tuned numbers, if any; raises `InputError`
        where a machine needs a start."""
        if isinstance(machine, TunedMachine):
            tuned, orbit = first_of_tuned(machine, start, family)
            return cls(family if start is None else orbit.family, tuned, orbit)
        start = start_or_own(machine, start, family)
        return cls(family, machine, None if start is None else find(machine, start=start))

    def motions(self, machines: Sequence[Machine]) -> list[tuple[Machine, Orbit] | OrbitsError]:
        """Machines, with tuned values if any, with their dimensionless orbits, or the reasons why there are none."""
        if isinstance(self.machine, TunedMachine):
            family = self.family if self.machine.model.one_speed else None
            return [attempt(continued_from, self.machine, self.orbit, machine, family) for machine in machines]
        if self.orbit is None:
            orbits = [attempt(self._of_family, machine) for machine in machines]
        else:
            orbits = [*continued_orbits(self.machine, self.orbit, machines)]
        pairs = zip(machines, orbits, strict=True)
        return [orbit if isinstance(orbit, OrbitsError) else (machine, orbit) for machine, orbit in pairs]

    def _of_family(self, machine: Machine) -> Orbit:
        interrupts.heed()
        return find(machine, self.family).dimensionless()


def multistart(
    origin: Origin,
    problem: DesignProblem,
    starts: int | str | None,
    seed: int,
    progress: Progress = None,
) -> Design:
    """The best design from a number of starts; for None from the first, or from further ones where that fails."""
    if isinstance(starts, str):
        if starts != "global":
            raise InputError(f"starts = {starts!r}; it must be a number, or 'global'")
        return _global_best(origin, problem, seed, progress)
    points = starting_points(origin.machine, problem, 1 if starts is None else starts, seed)
    try:
        return best_design(origin, problem, points, progress)
    except NoOrbit as error:
        if starts is not None or isinstance(error, Unbounded):
            raise
        first = error
    further = starting_points(origin.machine, problem, 1 + SAMPLE.further, seed)[1:]
    try:
        best = best_design(origin, problem, further, progress)
    except NoOrbit as error:
        raise _most_informative([first, error]) from None
    return replace(best, starts=(Start(points[0], None, str(first)), *best.starts))


def _global_best(origin: Origin, problem: DesignProblem, seed: int, progress: Progress = None) -> Design:
    """The best design from the lowest ones of a sample."""
    seed, report = whole_number("seed", seed, least=0, most=LARGEST_SEED), progress or (lambda share: None)
    points, shares = _lowest_of_sample(origin, problem, seed, lambda done: report(0.5 * done / SAMPLE.designs))
    best = best_design(origin, problem, points, lambda share: report(0.5 + 0.5 * share))
    pairs = zip(shares, best.starts, strict=True)
    return replace(
        best, share=sum(x for x, start in pairs if start.optimum and _same_design(problem, best, start.optimum))
    )


def _same_design(problem: DesignProblem, best: Design, other: Mapping[str, float]) -> bool:
    """Whether a start led to the best design, apart from the parameters without effect."""
    a, b = (np.array([parameters[name] for name in problem.names]) for parameters in (best.parameters, other))
    idle = np.isin(problem.names, best.idle)
    return bool((idle | (np.abs(a - b) <= SAMPLE.same * problem.units(a))).all())


def best_design(origin: Origin, problem: DesignProblem, points: Sequence[Mapping], progress: Progress = None) -> Design:
    """The best design from some starts, each the parameters by name, with a "motion", a machine and its dimensionless
    orbit, where one is known.

    The optima are certified as by `find` in the order of their objectives, up to the first that can be. An objective
    without bound is concluded from one path of the search, whereas an optimum is certified: so it is only raised when
    no start leads to an optimum.
    """
    began, report = time.perf_counter(), progress or (lambda share: None)
    values = [{name: point[name] for name in problem.names} for point in points]
    known: dict[int, Any] = {i: each["motion"] for i, each in enumerate(points) if "motion" in each}
    unknown = {i: origin.machine.with_values(**values[i]) for i in range(len(points)) if i not in known}
    known |= dict(zip(unknown, origin.motions([*unknown.values()]) if unknown else (), strict=True))
    ends = local_optima([known[i] for i in range(len(points))], problem, report)
    optima = {i: end.objective * problem.sign for i, end in enumerate(ends) if isinstance(end, Design)}
    for i in sorted(optima, key=optima.__getitem__):
        ends[i] = best = attempt(Design.certified, ends[i])
        if isinstance(best, Design):
            break
    else:
        raise _most_informative([end for end in ends if isinstance(end, OrbitsError)])
    tried = tuple(
        Start(each, end.objective, optimum=end.parameters) if isinstance(end, Design) else Start(each, None, str(end))
        for each, end in zip(values, ends, strict=True)
    )
    return replace(best, starts=tried, seconds=time.perf_counter() - began)


def starting_points(machine: Machine, problem: DesignProblem, count: int, seed: int) -> list[dict[str, float]]:
    """The machine's own parameters, or the middle of the bounds where they lie outside, and points of Sobol's sequence.

    Bounds that span decades are sampled by their logarithm.
    """
    count, seed = whole_number("starts", count, "starts"), whole_number("seed", seed, least=0, most=LARGEST_SEED)
    low, high, own = np.array(problem.low), np.array(problem.high), problem.theta(machine)
    points = [own if ((low <= own) & (own <= high)).all() else 0.5 * (low + high)]
    if count > 1:
        points += list(problem.sampled(1 << (count - 2).bit_length() if count > 2 else 1, seed)[1][: count - 1])
    return [dict(zip(problem.names, point.tolist(), strict=True)) for point in points]


def _most_informative(errors: Sequence[OrbitsError]) -> OrbitsError:
    """The error to raise when no start leads to an optimum: an objective without bound, else the least violation."""
    for kind in (Unbounded, Infeasible, NoOptimum):
        if alike := [error for error in errors if isinstance(error, kind)]:
            return min(alike, key=lambda error: getattr(error, "size", 0.0))
    return NoOptimum(f"no start within the bounds leads to an optimum: {errors[0]}")


def _lowest_of_sample(
    origin: Origin, problem: DesignProblem, seed: int, report: Callable[[int], None]
) -> tuple[list[dict[str, float]], list[float]]:
    """The lowest designs of a sample, the most promising first, and the shares of the sample that lead to them; raises
    `NoOrbit` where no sampled design hops."""
    places, values = problem.sampled(SAMPLE.designs, seed)
    formulas = {"objective": problem.formula} | {each.text: each.formula for each in problem.constraints}
    designs = _solved_sample(origin, problem, values, formulas, report)
    found = np.flatnonzero(designs.statuses == "certified")
    found = found[np.isfinite([designs.numbers[text][found] for text in formulas]).all(axis=0)]
    if not len(found):
        reason = next(iter(designs.reasons[designs.reasons != ""]), "its quantities are not finite")
        raise NoOrbit(f"none of {SAMPLE.designs} designs within the bounds has an orbit that is a motion: {reason}")
    merit = _merit(problem, {text: designs.numbers[text][found] for text in formulas})
    starts, counts = np.unique(_roots(places[found], merit), return_counts=True)
    order = np.argsort(merit[starts], kind="stable")[: SAMPLE.searches]
    points = [dict(zip(problem.names, each.tolist(), strict=True)) for each in values[found[starts[order]]]]
    return points, (counts[order] / len(found)).tolist()


def _solved_sample(
    origin: Origin, problem: DesignProblem, values: np.ndarray, formulas: Mapping[str, Formula],
    report: Callable[[int], None],
) -> Designs:  # fmt: skip
    """The sampled designs; those of a machine with tuned numbers are continued from its own orbit."""
    family, machine, orbit = origin.family, origin.machine, origin.orbit
    if not isinstance(machine, TunedMachine):
        return solved_designs(machine, problem.names, values, family, formulas, orbit, report)
    together = names_together(machine.machine)
    if machine.model.sticks and (alone := [text for text, each in formulas.items() if not each.names <= together]):
        raise InputError(
            f"starts = 'global': '{problem.text if alone[0] == 'objective' else alone[0]}' cannot be computed for many "
            f"orbits of a {machine.model.name} together; these can: {', '.join(sorted(together))}. Give a number of "
            "starts instead"
        )
    assert orbit is not None
    own, start = start_of_tuned(machine.machine, machine.tuning, machine.equations, unknowns_of(machine, orbit))
    designs = solved_designs(own, problem.names, values, family, formulas, start, report, machine.tuning)
    if machine.model.one_speed:  # the local searches stay in the family
        other = (designs.statuses == "certified") & (designs.numbers["family"] != family)
        designs.statuses[other], designs.reasons[other] = "no orbit", f"its orbit is not of family {family}"
    return designs


def _merit(problem: DesignProblem, numbers: Mapping[str, np.ndarray]) -> np.ndarray:
    """The merit (k,) of designs, lower is better: the objective and the violations of the constraints, each in its
    spread, the range of the middle half."""
    spreads = {text: float(np.subtract(*np.quantile(x, [0.75, 0.25]))) or 1.0 for text, x in numbers.items()}
    merit = problem.sign * (numbers["objective"] / spreads["objective"])
    for each in problem.constraints:
        missed = np.maximum(np.maximum(each.low - numbers[each.text], numbers[each.text] - each.high), 0.0)
        merit = merit + SAMPLE.violation_weight * missed / spreads[each.text]
    return merit


def _roots(places: np.ndarray, merit: np.ndarray) -> np.ndarray:
    """For each of some places (k, d) in the unit cube, the place (k,) reached by steps to better neighbours."""
    distances = np.linalg.norm(places[:, None] - places[None], axis=2)
    near = np.argsort(distances, axis=1, kind="stable")[:, : SAMPLE.neighbours + 1]  # the place itself is the first
    best = near[np.arange(len(near)), merit[near].argmin(axis=1)]
    while (best[best] != best).any():
        best = best[best]
    return best
