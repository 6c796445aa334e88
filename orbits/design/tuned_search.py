"""The best design of orbits with tuned parameters, by a search that compares values and takes no derivatives.

What a run needs, such as friction, is the larger of a limit at landing and of extremes in contact, so that the best
design often lies at an edge where two of these are equal. There the method of Nelder and Mead goes on (SciPy), with
smaller simplices about its end until that gains nothing. It finds a local optimum and proves no optimality conditions.
"""

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import FlowError, InputError, NoOrbit
from ..model.machine import Machine
from ..numerics.roots import solve
from ..periodic.certified import Solved, certified
from ..periodic.continued import continued_tuned
from ..periodic.find import Progress, StartLike, find, first_tuned
from ..periodic.orbit import Orbit
from ..periodic.tuned import Tuning, solved_near
from ..running import interrupts
from ..shooting.division import NodedSolution
from .active_set import ACTIVE
from .designs_at_once import Designs, fill_in_tuned, no_designs, start_of_tuned
from .optimality import Active, Design, Start
from .problem import DesignProblem

# The first simplex, in shares of the ranges, and those about the end of a search before; at most so many of these, and
# only while they gain more than this share of the objective.
FIRST_SIMPLEX, NEXT_SIMPLEX, MOST_SIMPLICES, LEAST_GAIN = 0.15, 0.03, 6, 1e-8
# The search ends where the simplex is no larger, in shares of the ranges, and its values differ by no more.
SMALLEST_SIMPLEX, SAME_VALUES, MOST_VALUES = 1e-7, 1e-11, 400
# Constraints are met to this share of their bounds; the merits of designs that violate them, and of those without a
# motion, lie above all others.
CONSTRAINTS_MET, MERIT_OF_VIOLATIONS, MERIT_WITHOUT_MOTION = 1e-9, 1e100, 1e200


def best_tuned(
    machine: Machine, problem: DesignProblem, tuning: Tuning, family: int, start: StartLike | None,
    points: Sequence[Mapping[str, float]], progress: Progress,
) -> Design:  # fmt: skip
    """The best design with tuned parameters from some starts, each the designed parameters by name."""
    began, search = time.perf_counter(), _TunedSearch(machine, problem, tuning, family, start)
    tried, best = list[Start](), (np.inf, np.empty(0))
    for i, point in enumerate(points):
        merit, x = search.from_start(problem.shares(np.array([point[name] for name in problem.names])))
        if progress:
            progress((i + 1) / len(points))
        if merit >= MERIT_OF_VIOLATIONS:
            tried.append(Start(dict(point), None, search.reason(x)))
            continue
        parameters = dict(zip(problem.names, problem.at_shares(x).tolist(), strict=True))
        tried.append(Start(dict(point), float(merit) * problem.sign, optimum=parameters))
        best = min(best, (merit, x), key=lambda each: each[0])
    if best[0] == np.inf:
        raise NoOrbit(f"no start within the bounds leads to a motion that meets the constraints: {tried[0].reason}")
    return replace(search.design(best[1]), starts=tuple(tried), seconds=time.perf_counter() - began)


class _TunedSearch:
    """The search of one problem: the designs whose orbits are known, each continued from the nearest one."""

    def __init__(self, machine: Machine, problem: DesignProblem, tuning: Tuning, family: int, start: StartLike | None):
        self.machine, self.problem, self.tuning = machine, problem, tuning
        self.formulas = {problem.text: problem.formula, **{each.text: each.formula for each in problem.constraints}}
        _, self.first = first_tuned(machine, start, family, tuning.names, tuning.values)
        self.known = [(problem.theta(machine), self.first)]
        self.values: dict[bytes, tuple[float, Designs, Solved | None]] = {}

    def from_start(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """The merit and the shares (k,) of the ranges of the best design found from a start."""
        from scipy.optimize import minimize

        best, size, first = (np.inf, x), FIRST_SIMPLEX, abs(self.merit(x))
        for _ in range(MOST_SIMPLICES):
            inwards = np.where(best[1] < 0.5, size, -size)
            simplex = best[1] + np.vstack([np.zeros(len(x)), np.diag(inwards)])
            options = {"initial_simplex": simplex, "xatol": SMALLEST_SIMPLEX, "maxfev": MOST_VALUES}
            options["fatol"] = SAME_VALUES * (first if 0 < first < MERIT_OF_VIOLATIONS else 1.0)
            found = minimize(self.merit, best[1], method="Nelder-Mead", bounds=[(0, 1)] * len(x), options=options)
            gain, best = best[0] - found.fun, min(best, (found.fun, found.x), key=lambda each: each[0])
            if best[0] >= MERIT_OF_VIOLATIONS or gain <= LEAST_GAIN * (
                first if 0 < first < MERIT_OF_VIOLATIONS else 1.0
            ):
                break
            size = NEXT_SIMPLEX
        return best

    def merit(self, x: np.ndarray) -> float:
        """The objective, with its sign, of the design at shares (k,); more than all others where it is none."""
        theta = self.problem.at_shares(x)
        if theta.tobytes() not in self.values:
            interrupts.heed()
            self.values[theta.tobytes()] = self._measured(theta)
        return self.values[theta.tobytes()][0]

    def _measured(self, theta: np.ndarray) -> tuple[float, Designs, Solved | None]:
        """The merit of a design, its numbers, and the solution with its tuned parameters."""
        problem, solved = self.problem, None
        designs = no_designs(self.machine, problem.names, theta[None], self.tuning, self.formulas)
        try:
            solved = self._solved(theta)
            orbits, refused = certified(solved, quickly=True)
            if orbits is None:
                raise refused[0]
            fill_in_tuned(self.machine, designs, np.array([0]), orbits, self.tuning, self.formulas)
        except (NoOrbit, FlowError, InputError) as error:
            designs.reasons[0] = str(error)
        objective = float(designs.numbers[problem.text][0])
        if designs.statuses[0] != "certified" or not np.isfinite(objective):
            return MERIT_WITHOUT_MOTION, designs, solved
        assert solved is not None
        self.known.append((theta, solved))
        violation = 0.0
        for each in problem.constraints:
            size = max(abs(bound) for bound in (each.low, each.high) if np.isfinite(bound)) or 1.0
            value = float(designs.numbers[each.text][0])
            violation += max(each.violation(value) / size - CONSTRAINTS_MET, 0.0) if np.isfinite(value) else np.inf
        if violation:
            designs.reasons[0] = "it violates the constraints " + "; ".join(each.text for each in problem.constraints)
            return min(MERIT_OF_VIOLATIONS * (1 + violation), MERIT_WITHOUT_MOTION), designs, solved
        return problem.sign * objective, designs, solved

    def _solved(self, theta: np.ndarray) -> Solved:
        """The solution of a design, continued from the nearest that is known; raises `NoOrbit` where it is not
        reached."""
        problem = self.problem
        _, known = min(self.known, key=lambda each: float(np.abs(problem.change(each[0], theta)).sum()))
        machine = self.machine.with_values(**dict(zip(problem.names, theta.tolist(), strict=True)))
        equations, x, own = known.equations, known.us[0], len(self.machine.values)
        p = np.array([*machine.values.values(), *known.ps[0, own:]])
        tuned = {*equations.statement.tuned}
        varied = tuple(name for name, new, old in zip(machine.values, p, known.ps[0], strict=False)
                       if new != old and name not in tuned)  # fmt: skip
        if not varied:
            return known
        with suppress(NoOrbit, FlowError, InputError):
            jacobian = equations.evaluate(x, known.ps[0], varied).jacobian
            moved = [(p - known.ps[0])[equations.parameters.index(name)] for name in varied]
            guess = x - solve(jacobian[:, : len(x)], jacobian[:, len(x) :] @ np.array(moved))
            near = solved_near(machine, NodedSolution(equations, None, x, known.ps[0], known.evaluation), guess, p)
            solved = Solved.of(known.model, known.method, near)
            return replace(solved, ps=equations.with_tuned(solved.us, p[None]))
        found, _ = continued_tuned(known, p[None], varied)
        if 0 in found.stopped:
            raise NoOrbit(found.stopped[0][1])
        us = found.unknowns
        ps = equations.with_tuned(us, p[None])
        return replace(known, us=us, ps=ps, evaluation=equations.evaluate_all(us, ps))

    def reason(self, x: np.ndarray) -> str:
        """Why the design at shares (k,) is none."""
        self.merit(x)
        return str(self.values[self.problem.at_shares(x).tobytes()][1].reasons[0])

    def design(self, x: np.ndarray) -> Design:
        """The design at shares (k,), with its orbit found once more and certified."""
        problem, theta, tuning = self.problem, self.problem.at_shares(x), self.tuning
        self.merit(x)
        _, designs, solved = self.values[theta.tobytes()]
        assert solved is not None
        other = self.machine.with_values(**dict(zip(problem.names, theta.tolist(), strict=True)))
        own, start = start_of_tuned(other, tuning, solved.equations, solved.us[0])
        orbit: Orbit = find(own, start=start, tune=tuning.names, at=tuning.at)
        assert orbit.source is not None
        parameters = {name: float(orbit.source.values[name]) for name in (*problem.names, *tuning.names)}
        return Design(
            orbit.source, orbit, parameters, problem.verb, problem.text, float(designs.numbers[problem.text][0]),
            {text: float(designs.numbers[text][0]) for text in self.formulas if text != problem.text},
            tuple(self._active(x, designs)), (), None,
        )  # fmt: skip

    def _active(self, x: np.ndarray, designs: Designs) -> list[Active]:
        """The bounds and the constraints that are active, without multipliers."""
        problem, found = self.problem, list[str]()
        for name, share, low, high in zip(problem.names, x, problem.low, problem.high, strict=True):
            found += [f"{name} >= {low:g}"] if share <= ACTIVE else []
            found += [f"{name} <= {high:g}"] if share >= 1 - ACTIVE else []
        for each in problem.constraints:
            value = float(designs.numbers[each.text][0])
            ends: list[Any] = [bound for bound in (each.low, each.high) if np.isfinite(bound)]
            found += [each.text] if any(abs(value - bound) <= 1e-6 * (abs(bound) or 1.0) for bound in ends) else []
        return [Active(text, None) for text in found]
