"""The starts of the local searches of a design: a sample of designs over the bounds, and the lowest designs among them.

Each sampled design leads to the best of its neighbours that is better than itself, and so on, down to one that is
better than all of its neighbours: there a local search begins. Source: Torn and Viitanen, "Topographical global
optimization", in Recent Advances in Global Optimization (1992).
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, NoOrbit
from ..model.machine import Machine
from ..periodic.orbit import Orbit
from ..symbolic.formula import Formula
from .designs_at_once import Designs, names_together, solved_designs
from .problem import DesignProblem
from .tuned_machine import TunedMachine, start_of_tuned, unknowns_of

# Number of designs of the sample, of neighbours with which a design is compared, and of local searches at most.
SAMPLED_DESIGNS, NEIGHBOURS, MOST_SEARCHES = 256, 8, 8
# Weight of a violation of the constraints, in their spread over the sample, relative to the objective in its spread.
VIOLATION_WEIGHT = 10.0


class Seed(NamedTuple):
    """A start of a local search: values (k,) of the parameters, and the share of the sample that leads there."""

    values: np.ndarray
    share: float


def seeds_of(
    machine: Machine, problem: DesignProblem, family: int, seed: int, start: Orbit | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> list[Seed]:  # fmt: skip
    """The starts of the local searches, the most promising first, of the family or of the orbits continued from the
    machine's own orbit `start`; raises `NoOrbit` where no sampled design hops."""
    reported = lambda done: report(done / SAMPLED_DESIGNS)  # noqa: E731
    places, values = problem.sampled(SAMPLED_DESIGNS, seed)
    formulas = {"objective": problem.formula} | {each.text: each.formula for each in problem.constraints}
    if isinstance(machine, TunedMachine):
        designs = _tuned(machine, problem, values, family, formulas, start, reported)
    else:
        designs = solved_designs(machine, problem.names, values, family, formulas, start, reported)
    found = np.flatnonzero(designs.statuses == "certified")
    found = found[np.isfinite([designs.numbers[text][found] for text in formulas]).all(axis=0)]
    if not len(found):
        reason = next(iter(designs.reasons[designs.reasons != ""]), "its quantities are no numbers")
        raise NoOrbit(f"none of {SAMPLED_DESIGNS} designs within the bounds has an orbit that is a motion: {reason}")
    roots = _roots(places[found], _merit(problem, designs, found))
    starts, counts = np.unique(roots, return_counts=True)
    merit = _merit(problem, designs, found)[starts]
    order = np.argsort(merit, kind="stable")[:MOST_SEARCHES]
    return [Seed(values[found[starts[i]]], float(counts[i] / len(found))) for i in order.tolist()]


def _tuned(
    machine: TunedMachine, problem: DesignProblem, values: np.ndarray, family: int, formulas: Mapping[str, Formula],
    orbit: Any, report: Callable[[int], None],
) -> Designs:  # fmt: skip
    """The sampled designs of a machine with tuned numbers, continued from its own orbit."""
    together = names_together(machine.machine)
    if machine.model.sticks and (alone := [text for text, each in formulas.items() if not each.names <= together]):
        raise InputError(
            f"starts = 'global': '{problem.text if alone[0] == 'objective' else alone[0]}' is not computed for many "
            f"orbits of a {machine.model.name} together, as {', '.join(sorted(together))} are: give a number of starts"
        )
    own, start = start_of_tuned(machine.machine, machine.tuning, machine.equations, unknowns_of(machine, orbit))
    designs = solved_designs(own, problem.names, values, family, formulas, start, report, machine.tuning)
    if machine.model.one_speed:  # the local searches stay in the family
        other = (designs.statuses == "certified") & (designs.numbers["family"] != family)
        designs.statuses[other], designs.reasons[other] = "no orbit", f"their orbits are not of family {family}"
    return designs


def _merit(problem: DesignProblem, designs: Designs, which: np.ndarray) -> np.ndarray:
    """The merit (k,) of designs, lower is better: the objective, and the violations of the constraints."""
    merit = problem.sign * _in_spread(designs.numbers["objective"][which])
    for constraint in problem.constraints:
        value = designs.numbers[constraint.text][which]
        missed = np.maximum(np.maximum(constraint.low - value, value - constraint.high), 0.0)
        merit = merit + VIOLATION_WEIGHT * missed / (_spread(value) or 1.0)
    return merit


def _spread(values: np.ndarray) -> float:
    """The range of the middle half of some values."""
    return float(np.subtract(*np.quantile(values, [0.75, 0.25])))


def _in_spread(values: np.ndarray) -> np.ndarray:
    return values / (_spread(values) or 1.0)


def _roots(places: np.ndarray, merit: np.ndarray) -> np.ndarray:
    """For each of some places (k, d) in the unit cube, the place (k,) reached by steps to better neighbours."""
    distances = np.linalg.norm(places[:, None] - places[None], axis=2)
    near = np.argsort(distances, axis=1, kind="stable")[:, : NEIGHBOURS + 1]  # the place itself is the first
    best = near[np.arange(len(near)), merit[near].argmin(axis=1)]
    while (best[best] != best).any():
        best = best[best]
    return best
