"""What a machine does from any state on: flights, impacts, contacts, one after the other, with every event found.

Events are zeros of the Taylor polynomials of the motion, found by Bernstein exclusion: a pair that hardly touches zero
is not skipped. Each leg is kept as its polynomials, so the whole motion can be asked for at any time.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from pathlib import Path

import numpy as np

from ..errors import FlowError, InputError, finite_number, whole_number
from ..flow.trajectory import Trajectory
from ..flow.zero_crossing import first_zero
from ..numerics.bernstein import lowest
from ..symbolic import interrupts
from .impacts import CAP, LIFTOFF_ORDER, Impacts, failed

# What happens this near to a change of the schedule, beside the time, happens at it: events are known no better.
SIMULTANEOUS = 1e-9
# A state this near to the contact, in its own units, is in contact.
TOUCHING = 1e-9


@dataclass(frozen=True)
class ContactEvent:
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
    status : "done", or why it ended early: a name of `orbits.hybrid.impacts.STATUSES`
    launches : launch speeds, first that of the start if it was a launch, then one for each lift-off, so hops + 1 or
        hops of them; NaN at a lift-off where no launch is
    end : time
    machine : that moved
    reason : in words, where the motion could not be carried on
    """

    legs: tuple[Leg, ...]
    events: tuple[ContactEvent, ...]
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
        from ..plot import plot_simulation

        return plot_simulation(self, axes)

    def animate(self, path, frames: int = 200) -> Path:
        """Write an animation of the whole motion (GIF); returns its path."""
        from ..plot import animate_simulation

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
    inject: float = 0.0, cap: int = CAP, schedule: tuple | None = None,
) -> Simulation:  # fmt: skip
    """Follow a machine's motion from a launch or from a state.

    machine : as in `find`, with its restitution
    alpha : launch speed at a lift-off after sustained contact, or the unknowns of a launch that is more than that; or
    state : (n,), a flight state with open gap; or with a closed one that stays closed, where the machine stands if the
        contact presses and lifts off if it does not
    hops, time : end after so many lift-offs, or after this time, whichever is first; one of them is needed
    inject : added to the launch speed at every lift-off that is a launch; with a damper its extension depends on the
        speed, and the injection moves the machine to that of the new speed
    cap : impacts in one hop after which it is given up
    schedule : (times (k + 1,), values (k,) of parameters by name), which they have from one time to the next, and the
        machine's own before and after: an actuator's inputs. Legs are cut at these times

    Raises `InputError` for what cannot be meant, as a launch at which the contact would not open.
    """
    rules, inputs = Impacts(machine), Schedule(machine.values, schedule)
    inject, cap = finite_number("inject", inject), whole_number("cap", cap, "impacts")
    hops = None if hops is None else whole_number("hops", hops, "lift-offs")
    if not (isinstance(time, Real) and time > 0):
        raise InputError(f"time = {time!r}; it is a number above 0")
    if hops is None and time == np.inf:
        raise InputError("a simulation needs hops or a time at which to end")
    if inject != 0 and not rules.model.one_speed:
        raise InputError(
            f"inject = {inject:g}: a launch of a {rules.model.name} is more than the speed that it adds to"
        )
    x, alpha, order = _start(rules, inputs(0.0)[0], alpha, state)
    with interrupts.deferred():
        return _Run(rules, inject, hops, float(time), cap, inputs).go(x, order, alpha)


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
        index = int(np.searchsorted(self.times, now + SIMULTANEOUS * (1.0 + now), side="right"))
        return self.columns[index], float(self.times[index]) if index < len(self.times) else np.inf


def _start(rules: Impacts, p, alpha, state) -> tuple[np.ndarray, float | None, int | None]:
    """The first flight state, the launch speed if it is a launch, and the order of the gap's zero there, None where it
    stands; `p` are the parameters that it starts with."""
    if (alpha is None) == (state is None):
        raise InputError("a simulation starts from a launch speed alpha or from a state: give one of them")
    if alpha is not None:
        x, alpha = _launch(rules, alpha)
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
    gap, speed, room = rules.gap(x), float(x @ rules.gap_speed), TOUCHING * (1 + np.abs(x).max())
    if abs(gap) <= room and abs(speed) <= room:
        path, _ = rules.contact.run(rules.onto_contact @ x, p, room)
        force, rise = path.coefficients[0, rules.contact.size, :2]
        if abs(force) <= room and rise < 0:
            return x, None, LIFTOFF_ORDER  # just lifting off
        return x, None, None if force >= 0 else 2
    if not gap > 0:
        raise InputError(f"state = {state!r}: its gap is {gap:.6g} and must be open")
    return x, None, 0


def _launch(rules: Impacts, launch) -> tuple[np.ndarray, float]:
    """The flight state (1, n) of a launch, told by its speed or by its unknowns, and its speed."""
    names = rules.model.launch_unknowns
    if isinstance(launch, Mapping):
        if unknown := sorted(set(names) ^ launch.keys()):
            raise InputError(f"alpha: a launch of this machine is told by {', '.join(names)}; not so '{unknown[0]}'")
        named = {name: finite_number(name, launch[name]) for name in names}
        return np.array([rules.model.launch(named, rules.values)], dtype=float), named["alpha"]
    if (alpha := finite_number("alpha", launch)) <= 0:
        raise InputError(f"alpha = {alpha:g}; a launch speed is above 0")
    return rules.launch(np.array([alpha])), alpha


class _Run:
    """A simulation as it goes."""

    def __init__(self, rules: Impacts, inject: float, hops: int | None, time: float, cap: int, inputs: Schedule):
        self.rules, self.inject, self.hops, self.time, self.cap = rules, inject, hops, time, cap
        self.inputs = inputs
        self.legs: list[Leg] = []
        self.events: list[ContactEvent] = []
        self.launches: list[float] = []
        self.now, self.impacts, self.lifted, self.reason = 0.0, 0, 0, ""

    def go(self, x, order: int | None, alpha: float | None) -> Simulation:
        if alpha is not None:
            self.launches.append(alpha)
        status = None
        if order is None:
            status, x = self.stand(x)
            order = LIFTOFF_ORDER
        while status is None:
            status, x, held = self.fly(x, order)
            order = self.rules.bounce_order
            if status is None and held:
                status, x = self.stand(x)
                order = LIFTOFF_ORDER
        launches, machine = np.array(self.launches), self.rules.machine
        return Simulation(tuple(self.legs), tuple(self.events), status, launches, self.now, machine, self.reason)

    def until(self) -> float:
        """Take the parameters of the schedule from now on; returns until when they hold."""
        p, until = self.inputs(self.now)
        if (p != self.rules.p).any():
            self.rules = Impacts(self.rules.machine, dict(zip(self.rules.values, p.tolist(), strict=True)))
        return until

    def fly(self, x, order: int) -> tuple[str | None, np.ndarray, bool]:
        """Fly until the gap closes; why the simulation ends, if it does, the state after the impact, whether contact
        follows."""
        until, closed = self.until(), False
        last = self.now + float(self.rules.patience("flight", x))
        if order == LIFTOFF_ORDER and not self.rules.opens(x[None])[0]:
            return "no_launch", x, False
        while not closed:
            left = min(self.time, last, until) - self.now
            try:
                path, _ = self.rules.flight.run(x, self.rules.p, left, stop=first_zero(self.rules.gap, order))
            except FlowError as error:
                self.reason = str(error)
                return failed(error, "flight"), x, False
            closed = path.times[-1] < left
            cut = not closed and until < min(self.time, last)
            if status := self.add("flight", path, None if closed or cut else "carried_off", until if cut else None):
                return status, x, False
            x = path.end[: len(x)]
            closed |= bool(self.rules.gap(x) <= 0)
            until, order = self.until(), 0
        landing = self.rules.landing(x[None])
        (after,), (held,) = landing.state, landing.held
        self.impacts += 1
        self.happened("landing" if held else "impact", x, after, float(landing.loss[0]), float(landing.wait[0]))
        return ("cap" if not held and self.impacts >= self.cap else None), after, bool(held)

    def stand(self, x) -> tuple[str | None, np.ndarray]:
        """Stay in contact until the force ends it, and leave; why the simulation ends, if it does, and the state."""
        y, how = self.rules.onto_contact @ x, None
        while how is None:
            until = self.until()
            path, how, self.reason = self.rules.stand(y, min(self.time, until) - self.now)
            if path is None:
                return how, x
            cut = how is None and until < self.time
            ended = None if cut or how == "lifts_off" else how
            if status := self.add("contact", path, ended, until if cut else None):
                return status, x
            y = path.end[: self.rules.contact.size]
            self.until()
            if cut and self.rules.pressing((self.rules.model.embed @ y)[None])[0][0] <= 0:
                how = "lifts_off"  # by rounding, or because the schedule lets go
        rules = self.rules
        before = after = rules.model.embed @ y
        (speed,), (launches,) = rules.liftoff(y[None])
        if launches and not (len(self.inputs.times) and self.inject == 0):  # what is driven lifts off where it is
            speed = float(speed) + self.inject
            if speed <= 0:
                return "rests", x
            after = rules.launch(np.array([speed]))[0]
        self.happened("lift-off", before, after, rules.energy(before) - rules.energy(after))
        free = launches or len(self.inputs.times) or not rules.model.one_speed
        self.launches.append(float(speed) if free else np.nan)
        self.impacts, self.lifted = 0, self.lifted + 1
        return ("done" if self.lifted == self.hops else None), after

    def add(self, phase: str, path: Trajectory, status: str | None, until: float | None = None) -> str | None:
        """Keep a leg, which ends at the time `until` if that is given; why the simulation ends with it, if it does: the
        time is up, or `status`."""
        self.legs.append(Leg(phase, self.now, path))
        lasted = float(path.times[-1])
        over = until is None and (lasted >= self.time - self.now or self.now + lasted >= self.time)
        self.now = self.time if over else self.now + lasted if until is None else until
        return "done" if over else status

    def happened(self, kind: str, before, after, loss: float, wait: float = 0.0):
        self.events.append(ContactEvent(kind, self.now + wait, before, after, self.rules.energy(before), loss))
