"""What a machine does from any state on: flights, impacts, contacts, one after the other, with every event found.

Events are zeros of the Taylor polynomials of the motion, found by Bernstein exclusion: a pair that hardly touches zero
is not skipped. Each leg is kept as its polynomials, so the whole motion can be asked for at any time.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import interrupts
from .errors import FlowError, InputError
from .flow import Flow, Trajectory, first_zero
from .impacts import ContactEnd, Impacts

# A leg longer than this, beside the launch speed, does not end.
LONGEST = 1e6
# What happens this near to a change of the schedule, beside the time, happens at it: events are known no better.
TOGETHER = 1e-9
# A state this near to the contact, in its own units, is in contact.
TOUCHING = 1e-9


@dataclass(frozen=True)
class Event:
    """One end of a leg.

    kind : "impact", after which the machine flies on; "landing", after which it stays in contact; "lift-off"
    time : since the start
    before, after : flight states (n,)
    energy : before, relative to the machine at rest in contact with its spring unloaded
    loss : of energy in it
    """

    kind: str
    time: float
    before: np.ndarray
    after: np.ndarray
    energy: float
    loss: float


@dataclass(frozen=True)
class Leg:
    """A flight or a contact: its phase's name, when it starts, and its motion from there."""

    phase: str
    start: float
    path: Trajectory


@dataclass(frozen=True)
class Simulation:
    """A motion from a state on; called with times (...), it gives flight states (..., n).

    legs, events : in order
    status : "done", or why it ended early: "rests" in contact for good, "collapses", is "carried_off", or "cap" impacts
    launches : (hops,), launch speeds at the lift-offs, the first that of the start if it was one
    end : time
    machine : that moved
    """

    legs: tuple[Leg, ...]
    events: tuple[Event, ...]
    status: str
    launches: np.ndarray
    end: float
    machine: object

    def document(self) -> dict:
        """The simulation as the JSON document of the command line."""
        events = [
            {
                "kind": event.kind, "time": event.time, "before": event.before.tolist(), "after": event.after.tolist(),
                "energy": event.energy, "loss": event.loss,
            }
            for event in self.events
        ]  # fmt: skip
        return {"launches": self.launches.tolist(), "status": self.status, "end": self.end, "events": events}

    def __str__(self) -> str:
        lines = [f"{'time':>14}  {'event':<10}{'energy':>16}{'loss':>14}"]
        for event in self.events:
            lines.append(f"{event.time:14.9g}  {event.kind:<10}{event.energy:16.9g}{event.loss:14.6g}")
        speeds = ", ".join(f"{speed:.10g}" for speed in self.launches)
        return "\n".join([*lines, f"  launch speeds {speeds}", f"  {self.status} at time {self.end:.9g}"])

    def plot(self, axes=None):
        """Plot heights against time; returns the axes. See `orbits.plot.plot_simulation`."""
        from .plot import plot_simulation

        return plot_simulation(self, axes)

    def animate(self, path, frames: int = 200) -> Path:
        """Write an animation of the whole motion (GIF); returns its path."""
        from .plot import animate_simulation

        return animate_simulation(self, path, frames)

    def in_contact(self, t) -> np.ndarray:
        """Whether the machine is in contact at times (...)."""
        return np.array([leg.phase == "contact" for leg in self.legs])[self._leg(np.asarray(t, dtype=float))]

    def _leg(self, t) -> np.ndarray:
        """The index of the leg at times (...)."""
        return np.clip(np.searchsorted([leg.start for leg in self.legs], t, side="right") - 1, 0, None)

    def __call__(self, t) -> np.ndarray:
        t = np.asarray(t, dtype=float)
        if not ((t >= 0) & (t <= self.end * (1 + 1e-12))).all():
            raise InputError(f"times lie between 0 and {self.end:.6g}")
        embed = self.machine.model.embed
        states, index = np.empty((*t.shape, len(embed))), self._leg(t)
        for i in np.unique(index):
            leg, here = self.legs[i], index == i
            rows = leg.path(np.minimum(t[here] - leg.start, leg.path.times[-1]))
            flying = leg.phase == "flight"
            states[here] = rows[..., : len(embed)] if flying else rows[..., : embed.shape[1]] @ embed.T
        return states


def simulate(
    machine, alpha: float | None = None, *, state=None, hops: int | None = None, time: float = np.inf,
    inject: float = 0.0, cap: int = 10_000, schedule: tuple | None = None,
) -> Simulation:  # fmt: skip
    """Follow a machine's motion from a launch or from a state.

    machine : as in `find`, with its restitution
    alpha : launch speed at a lift-off after sustained contact, or
    state : (n,), a flight state with open gap; or with a closed one that stays closed, where the machine stands if the
        contact presses and lifts off if it does not
    hops, time : end after so many lift-offs, or after this time, whichever is first; one of them is needed
    inject : added to the launch speed at every lift-off
    cap : impacts in one hop after which it is given up
    schedule : (times (k + 1,), values (k,) of parameters by name), which they have from one time to the next, and the
        machine's own before and after: an actuator's inputs. Legs are cut at these times

    Raises `InputError` for what cannot be meant.
    """
    rules, inputs = Impacts(machine), Schedule(machine.values, schedule)
    x, skip = _start(rules, inputs(0.0)[0], alpha, state)
    if hops is None and not np.isfinite(time):
        raise InputError("a simulation needs hops or a time at which to end")
    if not time > 0 or (hops is not None and (isinstance(hops, bool) or int(hops) != hops or hops < 1)):
        raise InputError(f"hops = {hops}, time = {time}; both are above 0, hops whole")
    with interrupts.deferred():
        return _Run(rules, float(inject), hops, float(time), cap, inputs).go(x, skip, alpha)


class Schedule:
    """Parameters that have other values from time to time; see `simulate`."""

    def __init__(self, values: Mapping[str, float], schedule):
        times, changes = ((), {}) if schedule is None else schedule
        self.times = np.asarray(times, dtype=float)
        unknown = [name for name in changes if name not in values]
        if unknown:
            raise InputError(f"schedule: the machine has no parameter '{unknown[0]}'; it has {', '.join(values)}")
        if schedule is not None and not (np.isfinite(self.times).all() and (np.diff(self.times) > 0).all()):
            raise InputError("schedule: its times are finite and rise")
        rows = []
        for name, own in values.items():
            given = np.asarray(changes.get(name, np.full(max(len(self.times) - 1, 0), own)), dtype=float)
            if given.shape != (max(len(self.times) - 1, 0),) or not np.isfinite(given).all():
                raise InputError(f"schedule: '{name}' has {given.size} values between {len(self.times)} times")
            rows.append([own, *given, own] if len(self.times) else [own])
        self.columns = np.array(rows, dtype=float).T  # (k + 2, np)

    def __call__(self, now: float) -> tuple[np.ndarray, float]:
        """The parameters (np,) from a time on, and until when they hold."""
        index = int(np.searchsorted(self.times, now + TOGETHER * (1.0 + now), side="right"))
        return self.columns[index], float(self.times[index]) if index < len(self.times) else np.inf


def _start(rules: Impacts, p, alpha, state) -> tuple[np.ndarray, int | None]:
    """The first flight state and the order of the zero of the gap there, None where it stands; `p` are the parameters
    that it starts with."""
    if (alpha is None) == (state is None):
        raise InputError("a simulation starts from a launch speed alpha or from a state: give one of them")
    if alpha is not None:
        if not (np.isscalar(alpha) and np.isfinite(alpha) and alpha > 0):
            raise InputError(f"alpha = {alpha!r}; a launch speed is above 0")
        return rules.launch(np.array([float(alpha)]))[0], 3
    x = np.array(state, dtype=float)
    if x.shape != (rules.flight.size,) or not np.isfinite(x).all():
        raise InputError(
            f"state = {state!r}; it is {rules.flight.size} numbers, {', '.join(rules.model.flight.states)}"
        )
    gap, speed, room = rules.gap(x), float(x @ rules.gap_speed), TOUCHING * (1 + np.abs(x).max())
    if abs(gap) <= room and abs(speed) <= room:
        path, _ = rules.contact.run(rules.onto_contact @ x, p, room)
        force, rise = path.coefficients[0, rules.contact.size, :2]
        if abs(force) <= room and rise < 0:
            return x, 3  # just lifting off
        return x, None if force >= 0 else 2
    if not gap > 0:
        raise InputError(f"state = {state!r}: its gap is {gap:.6g} and must be open")
    return x, 0


class _Run:
    """A simulation as it goes."""

    def __init__(self, rules: Impacts, inject: float, hops: int | None, time: float, cap: int, inputs: Schedule):
        self.rules, self.inject, self.hops, self.time, self.cap = rules, inject, hops, time, cap
        self.inputs = inputs
        self.legs: list[Leg] = []
        self.events: list[Event] = []
        self.launches: list[float] = []
        self.now, self.lifted = 0.0, 0

    def go(self, x, skip: int | None, alpha: float | None) -> Simulation:
        if alpha is not None:
            self.launches.append(float(alpha))
        status, impacts = None, 0
        if skip is None:
            status, x = self.stand(x)
            skip = 3
        while status is None and (status := self.fly(x, skip)) is None:
            impacts += 1
            before = self.legs[-1].path.end[: len(x)]
            landing = self.rules.landing(before[None])
            x, skip, held = landing.state[0], 1 if self.rules.restitution > 0 else 2, landing.held[0]
            self.happened("landing" if held else "impact", before, x, float(landing.loss[0]))
            if impacts >= self.cap:
                status = "cap"
            elif held:
                status, x = self.stand(x)
                skip, impacts = 3, 0
        launches, machine = np.array(self.launches), self.rules.machine
        return Simulation(tuple(self.legs), tuple(self.events), status, launches, self.now, machine)

    def fly(self, x, skip: int) -> str | None:
        """Fly until the gap closes; why the simulation ends instead, if it does."""
        longest = LONGEST * (1 + np.abs(x).max())
        try:
            ahead = first_zero(self.rules.gap, skip)
            closed = self.move("flight", self.rules.flight, x, longest, ahead, lambda x: self.rules.gap(x) <= 0)
        except FlowError:
            return "carried_off"
        if closed:
            return None
        return "done" if self.now >= self.time else "carried_off"

    def stand(self, x) -> tuple[str | None, np.ndarray]:
        """Stay in contact until the force ends it, and leave; why the simulation ends instead, if it does."""
        contact, y = self.rules.contact, self.rules.onto_contact @ x
        forever = self.time == np.inf and not len(self.inputs.times)
        ended = ContactEnd(contact.size, self.rules.model.contact_speed if forever else None)
        embed = self.rules.model.embed
        slack = lambda y: bool(self.rules.pressing((embed @ y)[None])[0][0] <= 0)  # noqa: E731
        try:
            left = self.move("contact", contact, y, LONGEST, ended, slack)
        except FlowError:
            return "collapses", x
        path = self.legs[-1].path
        if not left or (forever and not ended.lifts):
            return ("done" if self.now >= self.time else "rests"), x
        speed = float(self.rules.model.contact_speed(path.end[: contact.size]))
        if speed + self.inject <= 0:
            return "rests", x
        before = embed @ path.end[: contact.size]
        # What is driven lifts off where it is, not from the set of the machine's own launches.
        driven = len(self.inputs.times) and not self.inject
        launched = before if driven else self.rules.launch(np.array([speed + self.inject]))[0]
        gained = self.rules.energy(launched) - self.rules.energy(before) if self.inject else 0.0
        self.happened("lift-off", before, launched, -gained)
        self.launches.append(speed + self.inject)
        self.lifted += 1
        return ("done" if self.hops is not None and self.lifted >= self.hops else None), launched

    def move(self, phase: str, along: Flow, x, longest: float, stop: Callable, beyond: Callable) -> bool:
        """Travel until `stop` says so, in legs cut by the schedule; whether it did before the time was out.

        beyond : whether a state where a leg is cut has what `stop` looks for behind it, by rounding
        """
        end, stopped = min(self.time, self.now + longest), False

        def noted(c, steps):
            nonlocal stopped
            halt = stop(c, steps)
            stopped = halt is not None
            return halt

        while True:
            p, until = self.inputs(self.now)
            if (p != self.rules.p).any():
                self.rules = Impacts(self.rules.machine, dict(zip(self.rules.values, p.tolist(), strict=True)))
            path, _ = along.run(x, p, min(until, end) - self.now, stop=noted)
            self.add(phase, path)
            x = path.end[: along.size]
            if stopped or (until < end and beyond(x)):
                return True
            if until >= end:
                return False
            self.now = until

    def add(self, phase: str, path: Trajectory):
        self.legs.append(Leg(phase, self.now, path))
        self.now += float(path.times[-1])

    def happened(self, kind: str, before, after, loss: float):
        self.events.append(Event(kind, self.now, before, after, self.rules.energy(before), loss))
