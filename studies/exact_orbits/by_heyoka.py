"""The cases by heyoka: Taylor series with terminal events and dense output, its tolerance swept."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import heyoka as hy
import numpy as np

from studies.exact_orbits.automaton import OPERATIONS, Automaton, Found, simulated
from studies.exact_orbits.reader import Case

VERSION = f"heyoka {hy.__version__}"
WAYS = {"Taylor": (1e-4, 1e-8, 1e-12, 2.2e-16)}  # relative tolerances
BEYOND = 1e-9  # of time, after which a state is on the other side of a kink
FALLS, CROSSES = hy.event_direction.negative, hy.event_direction.any


def _of_any(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda a: function(hy.expression(0.0) + a)


def _power(a: Any, b: Any) -> Any:
    """A power; a whole one is a product, whose series exists at 0 too."""
    return math.prod([a] * b) if isinstance(b, int) and b > 0 else a**b


def _larger(a: Any, b: Any) -> Any:
    return hy.select(hy.gt(a - b + hy.expression(0.0), 0.0), a, b)


EXPRESSIONS = {
    **OPERATIONS,
    **{name: _of_any(getattr(hy, name)) for name in ("sin", "cos", "tan", "exp", "log", "sqrt")},
    "Pow": _power,
    "max": _larger, "min": lambda a, b: -_larger(-a, -b), "abs": lambda a: _larger(a, -a),
}  # fmt: skip


@dataclass
class Arc:
    """The part of a motion in one mode."""

    time: float
    state: list[float]
    event: int | None
    pieces: list

    def __call__(self, t: float) -> np.ndarray:
        return next((along for end, along in self.pieces if t <= end), self.pieces[-1][1])(t)


def prepared(case: Case, way: str) -> Callable[[float], Callable[[], Found]]:
    """A function of the tolerance that returns the simulation of a case, for which it compiles machine code."""
    hy.set_logger_level_error()  # its search for roots warns of multiple ones
    symbols = Automaton(case, EXPRESSIONS)

    def compiled(tolerance: float) -> dict[str, Any]:
        found = {}
        for name, mode in case["modes"].items():
            states = hy.make_vars(*mode["states"]) if len(mode["states"]) > 1 else [hy.make_vars(*mode["states"])]
            names = dict(zip(mode["states"], states, strict=True)) | {"t": hy.time}
            slopes = [
                hy.expression(0.0) + symbols.function(mode["derivatives"][each])(names) for each in mode["states"]
            ]
            events = [hy.t_event(symbols.guard(each)(names), direction=FALLS) for each in mode["events"]]
            kinks = [symbols.function(text)(names) for text in mode.get("kinks", ())]
            events += [hy.t_event(each, direction=CROSSES) for each in kinks]
            system = list(zip(states, slopes, strict=True))
            start = [0.5] * len(states)
            found[name] = hy.taylor_adaptive(system, start, tol=tolerance, t_events=events), len(mode["events"])
        return found

    numbers = Automaton(case)

    def run(systems: dict[str, Any]) -> Found:
        def fly(mode: str, time: float, state: list[float], end: float) -> Arc:
            system, own = systems[mode]
            system.time, system.state[:] = time, state
            if system.with_events:
                system.reset_cooldowns()
            pieces = []
            while True:
                outcome, *_, along, _ = system.propagate_until(end, c_output=True)
                code = int(outcome)
                pieces.append((system.time, along if along is not None else lambda t: system.state))
                if outcome == hy.taylor_outcome.time_limit:
                    return Arc(system.time, system.state.tolist(), None, pieces)
                if not -100 < code < 0:
                    raise ArithmeticError(f"heyoka ends with {outcome}")
                if -code - 1 < own:
                    return Arc(system.time, system.state.tolist(), -code - 1, pieces)
                system.step(max_delta_t=BEYOND)

        return simulated(case, numbers, fly)

    return lambda tolerance: partial(run, compiled(tolerance))
