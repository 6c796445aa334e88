"""What a machine does from any state on: flights, impacts, contacts, one after the other, with every event found.

Events are zeros of the Taylor polynomials of the motion, found by Bernstein exclusion: a pair that hardly touches zero
is not skipped. Each leg is kept as its polynomials, so the whole motion can be asked for at any time.
"""

from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from pathlib import Path

import numpy as np

from . import interrupts
from .errors import FlowError, InputError
from .flow import Trajectory, first_zero
from .impacts import CAP, LIFTOFF_ORDER, Impacts, failed
from .polynomial import lowest
from .question import number_of, whole_of


@dataclass(frozen=True)
class Event:
    """One end of a leg.

    kind : "impact", after which the machine flies on; "landing", after which it stays in contact; "lift-off"
    time : since the start; of a landing by bounces without number, when they have ended
    before, after : flight states (n,)
    energy : before, relative to the machine at rest in contact with its spring unloaded
    loss : of energy in it, below 0 where an injection adds to it
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
    status : "done", or why it ended early: a name of `orbits.impacts.STATUSES`
    launches : launch speeds, first that of the start if it was a launch, then one for each lift-off, so hops + 1 or
        hops of them; NaN at a lift-off where no launch is
    end : time
    machine : that moved
    reason : in words, where the motion could not be carried on
    """

    legs: tuple[Leg, ...]
    events: tuple[Event, ...]
    status: str
    launches: np.ndarray
    end: float
    machine: object
    reason: str = ""

    @cached_property
    def smallest_separation(self) -> float | None:
        """The least separation of the masses, None without a rest length; not above 0: they pass through each other,
        which changes nothing in the motion here and could not be."""
        separation = self.machine.model.separation(self.machine.values)
        if separation is None:
            return None
        embed, least = self.machine.model.embed, []
        for leg in self.legs:
            rows = leg.path.coefficients
            states = rows[:, : len(embed)] if leg.phase == "flight" else embed @ rows[:, : embed.shape[1]]
            least.append(lowest(separation.series(states), leg.path.steps)[0])
        return min(least, default=None)

    def document(self) -> dict:
        """The simulation as the JSON document of the command line."""
        events = [
            {
                "kind": event.kind, "time": event.time, "before": event.before.tolist(), "after": event.after.tolist(),
                "energy": event.energy, "loss": event.loss,
            }
            for event in self.events
        ]  # fmt: skip
        return {
            "launches": [None if np.isnan(speed) else float(speed) for speed in self.launches],
            "status": self.status, "reason": self.reason, "end": self.end,
            "smallest_separation": self.smallest_separation, "events": events,
        }  # fmt: skip

    def __str__(self) -> str:
        lines = [f"{'time':>14}  {'event':<10}{'energy':>16}{'loss':>14}"]
        for event in self.events:
            lines.append(f"{event.time:14.9g}  {event.kind:<10}{event.energy:16.9g}{event.loss:14.6g}")
        speeds = ", ".join(f"{speed:.10g}" for speed in self.launches)
        lines += [f"  launch speeds {speeds}", f"  {self.status} at time {self.end:.9g}"]
        if self.reason:
            lines[-1] += f": {self.reason}"
        if self.smallest_separation is not None and self.smallest_separation <= 0:
            lines.append(
                f"  the masses pass through each other: their least separation is {self.smallest_separation:.6g}"
            )
        return "\n".join(lines)

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
    inject: float = 0.0, cap: int = CAP,
) -> Simulation:  # fmt: skip
    """Follow a machine's motion from a launch or from a state in flight.

    machine : as in `find`, with its restitution
    alpha : launch speed at a lift-off after sustained contact, or
    state : (n,), a flight state with open gap
    hops, time : end after so many lift-offs, or after this time, whichever is first; one of them is needed
    inject : added to the launch speed at every lift-off that is a launch; with a damper its extension depends on the
        speed, and the injection moves the machine to that of the new speed
    cap : impacts in one hop after which it is given up

    Raises `InputError` for what cannot be meant, as a launch at which the contact would not open.
    """
    rules = Impacts(machine)
    inject, cap = number_of("inject", inject), whole_of("cap", cap, "impacts")
    hops = None if hops is None else whole_of("hops", hops, "lift-offs")
    if not (isinstance(time, Real) and time > 0):
        raise InputError(f"time = {time!r}; it is a number above 0")
    if hops is None and time == np.inf:
        raise InputError("a simulation needs hops or a time at which to end")
    x, alpha, order = _start(rules, alpha, state)
    with interrupts.deferred():
        return _Run(rules, inject, hops, float(time), cap).go(x, order, alpha)


def _start(rules: Impacts, alpha, state) -> tuple[np.ndarray, float | None, int]:
    """The first flight state, the launch speed if it is a launch, and the order of the zero of the gap there."""
    if (alpha is None) == (state is None):
        raise InputError("a simulation starts from a launch speed alpha or from a state: give one of them")
    if alpha is not None:
        if (alpha := number_of("alpha", alpha)) <= 0:
            raise InputError(f"alpha = {alpha:g}; a launch speed is above 0")
        x = rules.launch(np.array([alpha]))
        if not rules.opens(x)[0]:
            raise InputError(f"alpha = {alpha:g} is no launch: the damper is too strong for the contact to open")
        return x[0], alpha, LIFTOFF_ORDER
    try:
        x = np.array(state, dtype=float)
    except (TypeError, ValueError):
        x = np.zeros(0)
    if x.shape != (rules.flight.size,) or not np.isfinite(x).all():
        raise InputError(
            f"state = {state!r}; it is {rules.flight.size} numbers, {', '.join(rules.model.flight.states)}"
        )
    if not rules.gap(x) > 0:
        raise InputError(f"state = {state!r}: its gap is {rules.gap(x):.6g} and must be open")
    return x, None, 0


class _Run:
    """A simulation as it goes."""

    def __init__(self, rules: Impacts, inject: float, hops: int | None, time: float, cap: int):
        self.rules, self.inject, self.hops, self.time, self.cap = rules, inject, hops, time, cap
        self.legs: list[Leg] = []
        self.events: list[Event] = []
        self.launches: list[float] = []
        self.now, self.impacts, self.lifted, self.reason = 0.0, 0, 0, ""

    def go(self, x, order: int, alpha: float | None) -> Simulation:
        if alpha is not None:
            self.launches.append(alpha)
        status = None
        while status is None:
            status, x, held = self.fly(x, order)
            order = self.rules.bounce_order
            if status is None and held:
                status, x = self.stand(x)
                order = LIFTOFF_ORDER
        launches, machine = np.array(self.launches), self.rules.machine
        return Simulation(tuple(self.legs), tuple(self.events), status, launches, self.now, machine, self.reason)

    def fly(self, x, order: int) -> tuple[str | None, np.ndarray, bool]:
        """Fly until the gap closes; why the simulation ends, if it does, the state after the impact, whether contact
        follows."""
        rules = self.rules
        if order == LIFTOFF_ORDER and not rules.opens(x[None])[0]:
            return "no_launch", x, False
        limit = min(self.time - self.now, float(rules.patience("flight", x)))
        try:
            path, _ = rules.flight.run(x, rules.p, limit, stop=first_zero(rules.gap, order))
        except FlowError as error:
            self.reason = str(error)
            return failed(error, "flight"), x, False
        if status := self.add("flight", path, None if path.times[-1] < limit else "carried_off"):
            return status, x, False
        before = path.end[: len(x)]
        landing = rules.landing(before[None])
        (x,), (held,) = landing.state, landing.held
        self.impacts += 1
        self.happened("landing" if held else "impact", before, x, float(landing.loss[0]), float(landing.wait[0]))
        return ("cap" if not held and self.impacts >= self.cap else None), x, bool(held)

    def stand(self, x) -> tuple[str | None, np.ndarray]:
        """Stay in contact until the force ends it, and leave; why the simulation ends, if it does, and the state."""
        rules = self.rules
        path, how, self.reason = rules.stand(rules.onto_contact @ x, self.time - self.now)
        if path is None:
            return how, x
        if status := self.add("contact", path, None if how == "lifts_off" else how):
            return status, x
        y = path.end[: rules.contact.size]
        before = after = rules.model.embed @ y
        (speed,), (launches,) = rules.liftoff(y[None])
        if launches:
            speed = float(speed) + self.inject
            if speed <= 0:
                return "rests", x
            after = rules.launch(np.array([speed]))[0]
        self.happened("lift-off", before, after, rules.energy(before) - rules.energy(after))
        self.launches.append(speed if launches else np.nan)
        self.impacts, self.lifted = 0, self.lifted + 1
        return ("done" if self.lifted == self.hops else None), after

    def add(self, phase: str, path: Trajectory, status: str | None) -> str | None:
        """Keep a leg; why the simulation ends with it, if it does: the time is up, or `status`."""
        self.legs.append(Leg(phase, self.now, path))
        lasted = float(path.times[-1])
        over = lasted >= self.time - self.now or self.now + lasted >= self.time
        self.now = self.time if over else self.now + lasted
        return "done" if over else status

    def happened(self, kind: str, before, after, loss: float, wait: float = 0.0):
        self.events.append(Event(kind, self.now + wait, before, after, self.rules.energy(before), loss))
