"""The cases by SciPy: solve_ivp with terminal events and dense output, its tolerance swept."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import scipy
from scipy.integrate import solve_ivp

from studies.exact_orbits.automaton import Automaton, Found, simulated
from studies.exact_orbits.reader import Case

VERSION = f"SciPy {scipy.__version__}"
# Ways with their settings, relative tolerances; the absolute ones are a hundredth of them, as for states of the size 1.
WAYS = dict.fromkeys(("DOP853", "Radau"), (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13))
FIRST_STEP = 1e-5  # events are looked for between the ends of steps: a longer first step misses a short bounce


@dataclass
class Arc:
    """The part of a motion in one mode."""

    time: float
    state: list[float]
    event: int | None
    dense: Any

    def __call__(self, t: float) -> np.ndarray:
        return self.dense(t)


def prepared(case: Case, way: str) -> Callable[[float], Callable[[], Found]]:
    """A function of the tolerance that returns the simulation of a case."""
    numbers, modes = Automaton(case), {}
    for name, mode in case["modes"].items():
        slopes = [numbers.function(mode["derivatives"][each]) for each in mode["states"]]
        field = partial(rates, mode["states"], slopes)
        guards = [terminal(mode["states"], numbers.guard(each)) for each in mode["events"]]
        modes[name] = field, guards

    def run(tolerance: float) -> Found:
        def fly(mode: str, time: float, state: list[float], end: float) -> Arc:
            field, guards = modes[mode]
            done = solve_ivp(
                field, (time, end), state, way, dense_output=True, events=guards,
                rtol=max(tolerance, 2.3e-14), atol=tolerance / 100, first_step=min(FIRST_STEP, end - time),
            )  # fmt: skip
            if not done.success:
                raise ArithmeticError(done.message)
            hit = [i for i, times in enumerate(done.t_events) if len(times)] if done.status == 1 else [None]
            return Arc(float(done.t[-1]), list(done.y[:, -1]), hit[0], done.sol)

        return simulated(case, numbers, fly)

    return lambda tolerance: partial(run, tolerance)


def rates(states: list[str], slopes: list, t: float, x: np.ndarray) -> list[float]:
    """The derivatives of states, by their formulas as functions of names."""
    names = dict(zip(states, map(float, x), strict=True), t=t)
    return [slope(names) for slope in slopes]


def terminal(states: list[str], value: Any, direction: float = -1.0) -> Any:
    """An event of `solve_ivp` that ends the integration where a formula crosses zero; both ways if direction is 0."""

    def event(t: float, x: np.ndarray) -> float:
        return value(dict(zip(states, map(float, x), strict=True), t=t))

    event.terminal, event.direction = True, direction
    return event
