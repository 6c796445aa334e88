"""What a machine does from any state on: flights, impacts, contacts, one after the other, with every event found.

Events are zeros of the Taylor polynomials of the motion, found by Bernstein exclusion: a pair that hardly touches zero
is not skipped. Each leg is kept as its polynomials, so the whole motion can be asked for at any time.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import interrupts
from .errors import FlowError, InputError
from .flow import Trajectory, first_zero
from .impacts import ContactEnd, Impacts

# A leg longer than this, beside the launch speed, does not end.
LONGEST = 1e6


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
    inject: float = 0.0, cap: int = 10_000,
) -> Simulation:  # fmt: skip
    """Follow a machine's motion from a launch or from a state in flight.

    machine : as in `find`, with its restitution
    alpha : launch speed at a lift-off after sustained contact, or
    state : (n,), a flight state with open gap
    hops, time : end after so many lift-offs, or after this time, whichever is first; one of them is needed
    inject : added to the launch speed at every lift-off
    cap : impacts in one hop after which it is given up

    Raises `InputError` for what cannot be meant.
    """
    rules = Impacts(machine)
    x, skip = _start(rules, alpha, state)
    if hops is None and not np.isfinite(time):
        raise InputError("a simulation needs hops or a time at which to end")
    if not time > 0 or (hops is not None and (isinstance(hops, bool) or int(hops) != hops or hops < 1)):
        raise InputError(f"hops = {hops}, time = {time}; both are above 0, hops whole")
    with interrupts.deferred():
        return _Run(rules, float(inject), hops, float(time), cap).go(x, skip, alpha)


def _start(rules: Impacts, alpha, state) -> tuple[np.ndarray, int]:
    """The first flight state and the order of the zero of the gap there."""
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
    if not rules.gap(x) > 0:
        raise InputError(f"state = {state!r}: its gap is {rules.gap(x):.6g} and must be open")
    return x, 0


class _Run:
    """A simulation as it goes."""

    def __init__(self, rules: Impacts, inject: float, hops: int | None, time: float, cap: int):
        self.rules, self.inject, self.hops, self.time, self.cap = rules, inject, hops, time, cap
        self.legs: list[Leg] = []
        self.events: list[Event] = []
        self.launches: list[float] = []
        self.now = 0.0

    def go(self, x, skip: int, alpha: float | None) -> Simulation:
        if alpha is not None:
            self.launches.append(float(alpha))
        impacts = lifted = 0
        while (status := self.fly(x, skip)) is None:
            impacts += 1
            before = self.legs[-1].path.end[: len(x)]
            landing = self.rules.landing(before[None])
            x, skip, held = landing.state[0], 1 if self.rules.restitution > 0 else 2, landing.held[0]
            self.happened("landing" if held else "impact", before, x, float(landing.loss[0]))
            if impacts >= self.cap:
                status = "cap"
                break
            if not held:
                continue
            status, x = self.stand(x)
            if status is not None:
                break
            skip, impacts, lifted = 3, 0, lifted + 1
            if self.hops is not None and lifted >= self.hops:
                status = "done"
                break
        launches, machine = np.array(self.launches), self.rules.machine
        return Simulation(tuple(self.legs), tuple(self.events), status, launches, self.now, machine)

    def fly(self, x, skip: int) -> str | None:
        """Fly until the gap closes; why the simulation ends instead, if it does."""
        limit = min(self.time - self.now, LONGEST * (1 + np.abs(x).max()))
        try:
            path, _ = self.rules.flight.run(x, self.rules.p, limit, stop=first_zero(self.rules.gap, skip))
        except FlowError:
            return "carried_off"
        self.add("flight", path)
        if path.times[-1] < limit:
            return None
        return "done" if self.now >= self.time else "carried_off"

    def stand(self, x) -> tuple[str | None, np.ndarray]:
        """Stay in contact until the force ends it, and leave; why the simulation ends instead, if it does."""
        contact, y = self.rules.contact, self.rules.onto_contact @ x
        limit = min(self.time - self.now, LONGEST)
        ended = ContactEnd(contact.size, self.rules.model.contact_speed if self.time == np.inf else None)
        try:
            path, _ = contact.run(y, self.rules.p, limit, stop=ended)
        except FlowError:
            return "collapses", x
        self.add("contact", path)
        if not ended.lifts:
            return ("done" if self.now >= self.time else "rests"), x
        speed = float(self.rules.model.contact_speed(path.end[: contact.size]))
        if speed + self.inject <= 0:
            return "rests", x
        before = self.rules.model.embed @ path.end[: contact.size]
        launched = self.rules.launch(np.array([speed + self.inject]))[0]
        gained = self.rules.energy(launched) - self.rules.energy(before) if self.inject else 0.0
        self.happened("lift-off", before, launched, -gained)
        self.launches.append(speed + self.inject)
        return None, launched

    def add(self, phase: str, path: Trajectory):
        self.legs.append(Leg(phase, self.now, path))
        self.now += float(path.times[-1])

    def happened(self, kind: str, before, after, loss: float):
        self.events.append(Event(kind, self.now, before, after, self.rules.energy(before), loss))
