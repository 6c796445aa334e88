"""A case as a hybrid automaton for an integrator: its formulas as functions, and the loop over its modes."""

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from studies.exact_orbits.reader import Case, tree

Names = Mapping[str, Any]
Function = Callable[[Names], Any]
OPERATIONS: dict[str, Callable[..., Any]] = {
    **{"Add": operator.add, "Sub": operator.sub, "Mult": operator.mul, "Div": operator.truediv, "Pow": operator.pow},
    **{"USub": operator.neg, "abs": abs, "max": max, "min": min},
    **{name: getattr(math, name) for name in ("sin", "cos", "tan", "exp", "log", "sqrt")},
}
FALLING = {"falling": 1.0, "rising": -1.0}  # the sign with which a guard falls at its event


@dataclass(frozen=True)
class Options:
    """When an automaton does not go on.

    past_zero : a guard that is further past its zero where a mode begins lets its event happen at once
    below_zero : every guard is lowered by this, so that one which is 0 where a mode begins has to rise first
    most_events : a motion of more is given up
    """

    past_zero: float = 1e-7
    below_zero: float = 1e-300
    most_events: int = 300


OPTIONS = Options()


class Automaton:
    """The formulas of a case as functions of names.

    case : as `reader.Case` reads it
    operations : what operators and functions do; those of Python's numbers by default
    """

    def __init__(self, case: Case, operations: Mapping[str, Callable[..., Any]] = OPERATIONS):
        self.case, self.operations = case, operations
        self.numbers = {**{name: float(case.at(text)) for name, text in case["parameters"].items()}, **case.unknowns}

    def function(self, text: str | float) -> Function:
        """A formula as a function of the states and of t, by name."""
        return self._built(tree(str(text)))

    def guard(self, event: Mapping[str, Any]) -> Function:
        """The guard of an event as a function that falls through 0, and that has to rise first where it is 0."""
        sign, value = FALLING[event["direction"]], self.function(event["guard"])
        return lambda names: sign * value(names) - OPTIONS.below_zero

    def _built(self, node: ast.AST) -> Function:
        if isinstance(node, ast.Constant):
            return lambda names, value=node.value: value
        if isinstance(node, ast.Name):
            if node.id in self.case["formulas"]:
                return self.function(self.case["formulas"][node.id])
            if node.id in self.numbers:
                return lambda names, value=self.numbers[node.id]: value
            return operator.itemgetter(node.id)
        called = isinstance(node, ast.Call)
        parts = node.args if called else [part for part in ast.iter_child_nodes(node) if isinstance(part, ast.expr)]
        operation = self.operations[node.func.id if called else type(node.op).__name__]
        inner = [self._built(part) for part in parts]
        if len(inner) == 1:
            return lambda names, a=inner[0]: operation(a(names))
        if len(inner) == 2:
            return lambda names, a=inner[0], b=inner[1]: operation(a(names), b(names))
        return lambda names: operation(*(each(names) for each in inner))


class Arc(Protocol):
    """The motion in one mode.

    event : the number of the event that ended it, or None
    """

    time: float
    state: list[float]
    event: int | None

    def __call__(self, t: float) -> Sequence[float]: ...


@dataclass
class Found:
    """What a simulator makes of a case.

    states : at the times of the samples, by name
    last : the name of the last event, how many of them there were, and its time; None where it has no events
    """

    states: list[dict[str, float]] = field(default_factory=list)
    last: tuple[str, int, float] | None = None


def simulated(case: Case, numbers: Automaton, fly: Callable[[str, float, list[float], float], Arc]) -> Found:
    """The motion of a case: `fly(mode, time, state, end)` integrates one mode to its first event."""
    mode, time, end = case["start"]["mode"], float(case["start"]["time"]), float(case.at(case["end"]))
    state = {name: float(x) for name, x in case.at(case["start"]["state"]).items()}
    stated = {name: _Mode(numbers, each) for name, each in case["modes"].items()}
    found, counts, samples = Found(), dict[str, int](), [each["time"] for each in case["samples"]]
    for _ in range(OPTIONS.most_events):
        here = stated[mode]
        event = here.past(time, state)
        if event is None:
            arc = fly(mode, time, [state[name] for name in here.states], end)
            while len(found.states) < len(samples) and (samples[len(found.states)] < arc.time or arc.event is None):
                values = arc(samples[len(found.states)])
                found.states.append(state | dict(zip(here.states, map(float, values), strict=True)))
            time, event = float(arc.time), arc.event
            state |= dict(zip(here.states, map(float, arc.state), strict=True))
        if event is None:
            return found
        name, reset, mode = here.events[event]
        counts[name] = counts.get(name, 0) + 1
        found.last = name, counts[name], time
        names = {**state, "t": time}
        state |= {each: float(value(names)) for each, value in reset.items()}
    raise ArithmeticError(f"more than {OPTIONS.most_events} events")


class _Mode:
    """The events of a mode as functions."""

    def __init__(self, numbers: Automaton, mode: Mapping[str, Any]):
        self.states = mode["states"]
        self.events = [
            (
                each["event"],
                {name: numbers.function(text) for name, text in each.get("reset", {}).items()},
                each["next"],
            )
            for each in mode["events"]
        ]
        self.guards = [numbers.guard(each) for each in mode["events"]]

    def past(self, time: float, state: Names) -> int | None:
        """The first event whose guard is past its zero, where the mode begins."""
        names = {**state, "t": time}
        past = [i for i, guard in enumerate(self.guards) if guard(names) < -OPTIONS.past_zero]
        return past[0] if past else None
