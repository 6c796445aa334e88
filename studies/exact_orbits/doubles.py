"""A case integrated in doubles by SciPy's DOP853, from its text as `reader.py` reads it, without code of `build.py`."""

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from math import copysign
from typing import Any

from scipy.integrate import solve_ivp

from studies.exact_orbits.automaton import Automaton
from studies.exact_orbits.by_scipy import rates, terminal
from studies.exact_orbits.reader import FUNCTIONS, Case, tree

State = Mapping[str, float]
PLACES = re.compile(r"(?:(?P<place>start|end)|event(?P<number>\d+)_(?P<side>before|after))_(?P<name>\w+)")
TIMES = re.compile(r"event(?P<number>\d+)_time")


@dataclass(frozen=True)
class Options:
    """How motions are integrated.

    relative, absolute : tolerances of DOP853; SciPy takes no smaller relative one
    after_kink : time after a kink in which no kink is looked for
    """

    relative: float = 2.3e-14
    absolute: float = 1e-16
    after_kink: float = 1e-6


OPTIONS = Options()


@dataclass(frozen=True)
class Arc:
    """The motion from an event, or the start, to the next event, or the end.

    begin, event : what the file records where the arc begins and ends; at the end of the motion the event is None
    samples : of the file, each with the states integrated to its time
    steps : times and states of the integration, from the start of the arc to its end
    """

    begin: Mapping[str, Any]
    event: Mapping[str, Any] | None
    samples: list[tuple[Mapping[str, Any], State]]
    steps: list[tuple[float, State]]


def names_in(text: str | float) -> list[str]:
    """The names in a formula, without those of functions."""
    return [node.id for node in ast.walk(tree(str(text))) if isinstance(node, ast.Name) and node.id not in FUNCTIONS]


class Doubles:
    """The motion of a case between its recorded events.

    case : as `reader.Case` reads it
    """

    def __init__(self, case: Case) -> None:
        start = case["start"]
        begin = {"time": start["time"], "mode": start["mode"], "after": case.at(start["state"])}
        self.case, self.begins, self.mode = case, [begin, *case["events"]], cache(self._mode)

    def _mode(self, name: str) -> tuple[Any, list[Any]]:
        """The derivatives of a mode as `solve_ivp` takes them, and the events of its kinks."""
        numbers, mode = Automaton(self.case), self.case["modes"][name]
        slopes = [numbers.function(mode["derivatives"][each]) for each in mode["states"]]
        kinks = [terminal(mode["states"], numbers.function(text), direction=0.0) for text in mode.get("kinks", ())]
        return partial(rates, mode["states"], slopes), kinks

    def flow(self, mode: str, since: float, x: State, time: float) -> Iterator[tuple[float, State]]:
        """The steps from a state to a time, in one mode and without its events; backward to an earlier time."""
        (field, kinks), names = self.mode(mode), self.case["modes"][mode]["states"]
        t, y, ends = since, [x[name] for name in names], [time]
        yield t, x
        while t != time:
            watched = kinks if kinks and len(ends) == 1 else None
            found = solve_ivp(
                field, (t, ends[-1]), y, "DOP853", events=watched, rtol=OPTIONS.relative, atol=OPTIONS.absolute
            )
            if not found.success:
                raise ArithmeticError(f"{self.case['name']} at {found.t[-1]}: {found.message}")
            last, kink = len(found.t), float(found.t[-1])
            if found.status == 1:  # from the step before the kink to it, and then away from it
                last, short = last - 1, min(OPTIONS.after_kink, abs(time - kink))
                ends += [kink + copysign(short, time - kink), kink]
            else:
                ends.pop()
            t, y = float(found.t[last - 1]), found.y[:, last - 1]
            for s, each in zip(found.t[1:last].tolist(), found.y.T[1:last].tolist(), strict=True):
                yield s, dict(zip(names, each, strict=True))

    def at(self, time: float) -> State:
        """The states at a time, integrated from the last recorded event."""
        last = [each for each in self.begins if each["time"] <= time][-1]
        *_, (_, state) = self.flow(last["mode"], last["time"], last["after"], time)
        return state

    def arcs(self) -> Iterator[Arc]:
        """The arcs of the motion, each from the recorded states at its start."""
        end = self.case.at(self.case["end"])
        for begin, event in zip(self.begins, [*self.case["events"], None], strict=True):
            t, x, time = begin["time"], begin["after"], end if event is None else event["time"]
            inside = [
                each for each in self.case["samples"] if t <= each["time"] and (event is None or each["time"] < time)
            ]
            samples, steps = [], []
            for target in [each["time"] for each in inside] + [time]:
                steps += self.flow(begin["mode"], t, x, target)
                t, x = steps[-1]
                samples.append(x)
            yield Arc(begin, event, [*zip(inside, samples, strict=False)], steps)

    def leg(self, leg: Mapping[str, Any]) -> tuple[float, State]:
        """The time and the states where the conditions of a leg of the orbit hold."""
        if "event" in leg:
            event = [each for each in self.case["events"] if each["event"] == leg["event"]][leg.get("number", 1) - 1]
            return event["time"], event["after"]
        since, x = self.begins[0]["time"], self.begins[0]["after"]
        time = since + self.case.at(leg["time"])
        if "mode" not in leg:
            return time, self.at(time)
        *_, reached = self.flow(leg["mode"], since, x, time)
        return reached

    def number(self, text: str, end: tuple[float, State]) -> float:
        """A number that the case names, from recorded times and states at events, and the states at the end."""
        quoted = {}
        for name in names_in(text):
            if found := TIMES.fullmatch(name):
                quoted[name] = self.case["events"][int(found["number"]) - 1]["time"]
            elif found := PLACES.fullmatch(name):
                if found["place"]:
                    time, x = end if found["place"] == "end" else (self.begins[0]["time"], self.begins[0]["after"])
                else:
                    event = self.case["events"][int(found["number"]) - 1]
                    time, x = event["time"], event[found["side"]]
                quoted[name] = self.case.at(found["name"], time, x)
        return self.case.at(text, 0.0, quoted)
