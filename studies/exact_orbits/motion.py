"""The motion of a case through its modes and events, and the start of an orbit, to some sixty digits."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from flint import arb, arb_mat, arb_poly, arb_series

from studies.exact_orbits.series import CaseError, Formulas, Names, Options, State
from studies.exact_orbits.zeros import first_crossing, middle, sign, without_zero_at_start

DIRECTIONS = {"falling": -1, "rising": 1}
PLACES = re.compile(r"(?:(?P<place>start|end)|event(?P<number>\d+)_(?P<side>before|after))_(?P<name>\w+)")
TIMES = re.compile(r"event(?P<number>\d+)_time")


@dataclass(frozen=True)
class Piece:
    """From `start` for `length` the states are polynomials of the time since then."""

    mode: str
    start: arb
    length: arb
    states: dict[str, arb_poly]

    def after(self, duration: arb) -> State:
        """The states a while after the start."""
        return {name: middle(p(duration)) for name, p in self.states.items()}


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
        return piece.mode, piece.after(middle(t - piece.start))


class Problem(Formulas):
    """A case as a problem to be solved: its orbit, its motion, its numbers."""

    def __init__(self, document: Mapping[str, Any], options: Options | None = None) -> None:
        super().__init__(document, options or Options())

    def start(self) -> Motion:
        """The motion at its start, for the unknowns as they are."""
        start = self.document["start"]
        state = {name: self.value(text) for name, text in start["state"].items()}
        return Motion(self.value(start["time"]), start["mode"], state)

    def motion(self, until: arb | None = None, last: tuple[str, int] | None = None) -> Motion:
        """The motion from the start to a time, by default to the end of the case, or to the `last` of events: to the
        n-th of that name."""
        self.set_digits()
        motion, new = self.start(), True
        until = self.value(self.document["end"]) if until is None else until
        while motion.time < until:
            mode = self.document["modes"][motion.mode]
            event = self._advance(motion, until, mode["events"], new)
            new = event is not None
            if event is not None:
                self._happen(motion, event)
                if last and [each.name for each in motion.events].count(last[0]) == last[1]:
                    return motion
        if last:
            raise CaseError(f"there is no event {last[0]!r} number {last[1]} before the end")
        return motion

    def in_one_mode(self, mode: str, duration: arb) -> Motion:
        """The motion from the start in one mode, without its events; backward in time for a duration below 0."""
        motion = self.start()
        motion.mode, until = mode, middle(motion.time + duration)
        motion.state = {name: motion.state[name] for name in self.document["modes"][mode]["states"]}
        while motion.time != until:
            self._advance(motion, until)
        return motion

    def _advance(
        self, motion: Motion, until: arb, events: Sequence[Mapping[str, Any]] = (), new: bool = False
    ) -> Mapping[str, Any] | None:
        """Add a piece to a motion: up to a time, the end of one step, a kink, or one of the events, which is returned.

        new : the mode begins here: an event whose guard is past its zero takes place at once
        """
        left = middle(until - motion.time)
        forward, left = sign(left), abs(float(left))
        series, mode = self.series(motion.mode, motion.time, motion.state, forward), self.document["modes"][motion.mode]
        guards = [self._guard(each["guard"], series) for each in events]
        directions = [DIRECTIONS[each["direction"]] for each in events]
        if new:
            for guard, direction, event in zip(guards, directions, events, strict=True):
                if guard.coeffs() and sign(middle(guard.coeffs()[0])) == direction:
                    return event
        kinks, found = mode.get("kinks", ()), None
        length = self.step(series, [*mode["states"], *kinks, *(each["guard"] for each in events)])
        end = until if length >= left else middle(motion.time + forward * arb(length))
        length = middle(abs(end - motion.time))
        watched = [*zip(guards, directions, events, strict=True)]
        watched += [(self._guard(text, series), 0, None) for text in kinks]
        for guard, direction, event in watched:
            place = first_crossing(guard, length, direction, self.options.cluster)
            if place is not None:
                length, found, end = place, event, middle(motion.time + forward * place)
        states = {name: arb_poly(series[name].coeffs()) for name in mode["states"]}
        piece = Piece(motion.mode, motion.time, length, states)
        motion.pieces.append(piece)
        motion.time, motion.state = end, piece.after(length)
        return found

    def _guard(self, text: str, series: Names) -> arb_poly:
        """A guard as a polynomial of the time since the start of a piece, without a zero there."""
        p = arb_poly(arb_series(self.parsed(text)(series)).coeffs())
        return without_zero_at_start(p, self.options.negligible)

    def _happen(self, motion: Motion, event: Mapping[str, Any]) -> None:
        """Let an event happen."""
        earlier = motion.events[-self.options.most_events :]
        if len(earlier) == self.options.most_events and motion.time - earlier[0].time < self.options.cluster:
            raise CaseError(f"the events accumulate at {float(motion.time):g}: end the case before")
        names = self.names({"t": motion.time, **motion.state})
        reset = {name: self.value(text, names) for name, text in event.get("reset", {}).items()}
        before, known = motion.state, motion.state | reset
        motion.state = {name: known[name] for name in self.document["modes"][event["next"]]["states"]}
        motion.events.append(Event(event["event"], motion.time, motion.mode, event["next"], before, motion.state))
        motion.mode = event["next"]

    def residuals(self) -> list[arb]:
        """What the conditions of the orbit leave, for the unknowns as they are."""
        self.set_digits()
        found = []
        for leg in self.document.get("orbit", {}).get("legs", ()):
            if "event" in leg:
                motion = self.motion(last=(leg["event"], int(leg.get("number", 1))))
            elif "mode" not in leg:
                motion = self.motion(middle(self.start().time + self.value(leg["time"])))
            else:
                motion = self.in_one_mode(leg["mode"], self.value(leg["time"]))
            names = self.names({"t": motion.time, **motion.state})
            found += [self.value(text, names) for text in leg["conditions"]]
        return found

    def slopes(self) -> arb_mat:
        """The derivatives of the residuals by the unknowns, to half of the digits."""
        start, value, columns = dict(self.unknowns), self.residuals(), []
        small = arb(10) ** (-self.options.digits // 2)
        for name, x in start.items():
            self.unknowns = start | {name: x + small}
            columns.append([middle((a - b) / small) for a, b in zip(self.residuals(), value, strict=True)])
        self.unknowns = start
        return arb_mat([[*row] for row in zip(*columns, strict=True)])

    def solve(self, most_steps: int = 30) -> None:
        """Improve the unknowns of the orbit to all digits, by Newton's method, whose slopes are those to few digits."""
        if not self.unknowns:
            return
        digits, rough = self.options.digits, self
        if digits > self.options.rough_digits:
            rough = Problem(self.document, replace(self.options, digits=self.options.rough_digits))
            rough.unknowns = self.unknowns
            rough.solve()
            self.unknowns = rough.unknowns
        slopes = rough.slopes()
        for _ in range(most_steps):
            value = arb_mat([[each] for each in self.residuals()])
            change = [row[0].mid() for row in slopes.solve(value).table()]
            self.unknowns = {
                name: middle(x - step) for (name, x), step in zip(self.unknowns.items(), change, strict=True)
            }
            if all(abs(float(step)) < 10.0 ** (self.options.spare_digits - digits) for step in change):
                return
        raise CaseError(f"the conditions of the orbit are not met: the last step is {max(map(abs, change))}")

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
