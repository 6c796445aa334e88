"""The motion of a case through its modes and events, and the start of an orbit, to sixty digits."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from flint import arb, arb_mat, arb_poly, arb_series

from studies.exact_orbits.series import CaseError, Formulas, Names, Options, State
from studies.exact_orbits.zeros import first_crossing, middle, sign, without_zero_at_start

DIRECTIONS = {"falling": -1, "rising": 1}
PLACES = re.compile(r"(?:(?P<place>start|end)|event(?P<number>\d+)_(?P<side>before|after))_(?P<name>\w+)")
TIMES = re.compile(r"event(?P<number>\d+)_time")


@dataclass(frozen=True)
class Piece:
    """From `start` for `length` the states are polynomials of the time since `start`."""

    mode: str
    start: arb
    length: arb
    states: dict[str, arb_poly]

    def at(self, t: arb) -> State:
        """The states at a time."""
        return {name: middle(p(middle(t - self.start))) for name, p in self.states.items()}


@dataclass(frozen=True)
class Event:
    """An event: its name, its time, the modes and the states before and after it."""

    name: str
    time: arb
    mode_before: str
    mode: str
    before: State
    after: State


@dataclass
class Motion:
    """The pieces and the events of a motion, with the time, the mode and the states where it has come to."""

    time: arb
    mode: str
    state: State
    pieces: list[Piece] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)

    def at(self, t: arb) -> tuple[str, State]:
        """The mode and the states at a time; just after an event where there is one."""
        piece = next((p for p in reversed(self.pieces) if p.start <= t), self.pieces[0])
        return piece.mode, piece.at(t)


class Problem(Formulas):
    """A case as a problem to be solved: its orbit, its motion, its numbers."""

    def __init__(self, document: Mapping[str, Any], options: Options | None = None) -> None:
        super().__init__(document, options or Options())

    def start(self) -> Motion:
        """The motion at its start, for the unknowns as they are."""
        start = self.document["start"]
        state = {name: self.value(text) for name, text in start["state"].items()}
        return Motion(self.value(start["time"]), start["mode"], state)

    def advance(self, motion: Motion, mode: str, until: arb) -> Names:
        """Add a piece of a motion up to a time or the end of one step; returns its series."""
        stated = self.document["modes"][mode]
        states, guards = [*stated["derivatives"]], [each["guard"] for each in stated["events"]]
        series = self.series(mode, motion.time, motion.state)
        length = self.step(series, [*states, *guards, *stated.get("kinks", ())])
        left = middle(until - motion.time)
        length = left if length >= abs(float(left)) else middle(arb(length) * sign(left))
        polynomials = {name: arb_poly(series[name].coeffs()) for name in states}
        self._end_with(motion, Piece(mode, motion.time, length, polynomials), length)
        return series

    def _end_with(self, motion: Motion, piece: Piece, length: arb) -> None:
        """Let a piece be the motion's last one, and end after some length."""
        end = middle(piece.start + length)
        motion.pieces.append(Piece(piece.mode, piece.start, length, piece.states))
        motion.time, motion.state = end, motion.state | piece.at(end)

    def motion(self, until: arb | None = None, last: tuple[str, int] | None = None) -> Motion:
        """The motion from the start to a time, by default to the end of the case, or to the `last` of events: to the
        n-th of that name."""
        self.set_digits()
        motion, new = self.start(), True
        until = self.value(self.document["end"]) if until is None else until
        while motion.time < until:
            event = self._next(motion, until, new)
            new = event is not None
            if event is not None:
                self._happen(motion, event)
                if last and [each.name for each in motion.events].count(last[0]) == last[1]:
                    return motion
        if last:
            raise CaseError(f"there is no event {last[0]!r} number {last[1]} before the end")
        return motion

    def _next(self, motion: Motion, until: arb, new: bool) -> Mapping[str, Any] | None:
        """Carry a motion on to the end of a step, to a kink, or to an event, which is returned.

        new : the mode begins here: an event whose guard is past its zero takes place at once
        """
        mode, begin = self.document["modes"][motion.mode], motion.state
        series = self.advance(motion, motion.mode, until)
        piece = motion.pieces.pop()
        watched = [(self._guard(each["guard"], series), DIRECTIONS[each["direction"]], each) for each in mode["events"]]
        if new:
            for guard, direction, event in watched:
                if guard.coeffs() and sign(middle(guard.coeffs()[0])) == direction:
                    motion.time, motion.state = piece.start, begin
                    return event
        watched += [(self._guard(text, series), 0, None) for text in mode.get("kinks", ())]
        first, found = piece.length, None
        for guard, direction, event in watched:
            place = first_crossing(guard, first, direction, self.options.cluster)
            if place is not None:
                first, found = place, event
        motion.state = begin
        self._end_with(motion, piece, first)
        return found

    def _guard(self, text: str, series: Names) -> arb_poly:
        """A guard as a polynomial of the time since the start of a piece, without a zero there."""
        p = arb_poly(arb_series(self.parsed(text)(series)).coeffs())
        return without_zero_at_start(p, self.options.negligible)

    def _happen(self, motion: Motion, event: Mapping[str, Any]) -> None:
        """Let an event happen."""
        if len(motion.events) >= self.options.most_events:
            raise CaseError(f"more than {self.options.most_events} events until {float(motion.time):g}")
        names = self.names({"t": motion.time, **motion.state})
        reset = {name: self.value(text, names) for name, text in event.get("reset", {}).items()}
        before, known = motion.state, motion.state | reset
        motion.state = {name: known[name] for name in self.document["modes"][event["next"]]["states"]}
        motion.events.append(Event(event["event"], motion.time, motion.mode, event["next"], before, motion.state))
        motion.mode = event["next"]

    def residuals(self) -> list[arb]:
        """What the conditions of the orbit leave, for the unknowns as they are."""
        found = []
        for leg in self.document["orbit"]["legs"]:
            if "event" in leg:
                motion = self.motion(last=(leg["event"], int(leg.get("number", 1))))
            elif "mode" not in leg:
                motion = self.motion(middle(self.start().time + self.value(leg["time"])))
            else:
                motion, until = self.start(), self.value(leg["time"])
                states = self.document["modes"][leg["mode"]]["states"]
                motion.state = {name: motion.state[name] for name in states}
                until = middle(motion.time + until)
                while motion.time != until:
                    self.advance(motion, leg["mode"], until)
            names = self.names({"t": motion.time, **motion.state})
            found += [self.value(text, names) for text in leg["conditions"]]
        return found

    def solve(self, most_steps: int = 30) -> None:
        """Improve the unknowns of the orbit to all digits, by Newton's method with slopes taken once."""
        if not self.unknowns:
            return
        self.set_digits()
        names, digits = [*self.unknowns], self.options.digits
        start, small = dict(self.unknowns), arb(10) ** (-digits // 2)
        value, columns = self.residuals(), []
        for name in names:
            self.unknowns = start | {name: start[name] + small}
            columns.append([middle((a - b) / small) for a, b in zip(self.residuals(), value, strict=True)])
        self.unknowns, slopes = start, arb_mat([[*row] for row in zip(*columns, strict=True)])
        for _ in range(most_steps):
            change = slopes.solve(arb_mat([[each] for each in value])).table()
            self.unknowns = {
                name: middle(self.unknowns[name] - step[0]) for name, step in zip(names, change, strict=True)
            }
            if all(abs(float(step[0])) < 10.0 ** (8 - digits) for step in change):
                return
            value = self.residuals()
        raise CaseError(f"the conditions of the orbit are not met from {start}")

    def numbers(self, motion: Motion) -> dict[str, arb]:
        """The numbers that the case names, from its motion."""

        def quoted(name: str) -> arb:
            if found := TIMES.fullmatch(name):
                return motion.events[int(found["number"]) - 1].time
            if not (found := PLACES.fullmatch(name)):
                raise CaseError(f"nothing is called {name!r}")
            if found["place"]:
                place = self.start() if found["place"] == "start" else motion
                return self.value(found["name"], self.names({"t": place.time, **place.state}))
            event = motion.events[int(found["number"]) - 1]
            state = event.before if found["side"] == "before" else event.after
            return self.value(found["name"], self.names({"t": event.time, **state}))

        listed = self.document.get("numbers", {}).items()
        return {name: self.value(each["formula"], self.names({}, quoted)) for name, each in listed}


def conserved(problem: Problem, motion: Motion) -> Iterator[tuple[str, arb]]:
    """How far each conserved quantity varies between the events at which it may change, in all pieces of a motion."""
    for name, stated in problem.document.get("conserved", {}).items():
        values, changes = [], iter([each.time for each in motion.events if each.name in stated.get("changes_at", ())])
        change, largest = next(changes, None), arb(0)
        for piece in motion.pieces:
            while change is not None and piece.start >= change:
                values, change = [], next(changes, None)
            text = stated["text"] if isinstance(stated["text"], str) else stated["text"].get(piece.mode)
            for t in (piece.start, piece.start + piece.length) if text else ():
                values.append(problem.value(text, problem.names({"t": t, **piece.at(middle(t))})))
            largest = max(largest, max(values) - min(values)) if values else largest
        yield name, middle(largest)
