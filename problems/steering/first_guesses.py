"""First guesses of steered motions: the lossless orbit, the motion without control, and swings that grow from rest."""

from collections.abc import Mapping
from functools import partial

import numpy as np

from orbits import NoOrbit, Orbit, simulate
from orbits.control import Guess
from orbits.flow import flow_of
from orbits.numerics import bracketed_root
from orbits.units import LIFTOFF_SPEED, Message, Quantity

from .actuated import Actuated
from .actuated_launch import launch_argument

AT_REST = 1e-10  # the largest acceleration of a machine that rests, in units in which gravity is about 1


def contact_time_of(orbit: Orbit) -> float:
    """The time of the orbit's contact, which an admissible one has."""
    if orbit.contact_time is None:
        text = "no hop is near the lossless orbit, whose contact does not end: {why}; change the machine or its family"
        raise NoOrbit(Message(text, why=Message.joined("; ", orbit.violations)))
    return float(orbit.contact_time)


def lossless_guess(driven: Actuated, orbit: Orbit) -> list[Guess]:
    """The lossless orbit, the spring's end at rest."""
    onto = np.linalg.pinv(driven.model.embed)
    flight = Guess(float(orbit.flight_time), lambda t: np.append(orbit(t), 0.0))
    return [flight, Guess(contact_time_of(orbit), lambda t: onto @ np.append(orbit(orbit.flight_time + t), 0.0))]


def undriven_guess(driven: Actuated, launch: Mapping[str, float]) -> list[Guess]:
    """The motion without control: the flight from a launch, and the next contact, which need not join."""
    run = simulate(driven, launch_argument(driven, launch, launch["alpha"]), hops=1)
    contacts = [leg for leg in run.legs if leg.phase == "contact"]
    if run.status != "done" or not contacts:
        text = "from a launch at {launch:.6g} the machine does not hop on without control: {why}"
        speed = Quantity(launch["alpha"], LIFTOFF_SPEED)
        raise NoOrbit(Message(text, launch=speed, why=run.reason or run.status))
    first, last, (n, m) = run.legs[0].path, contacts[0].path, driven.model.embed.shape
    flown = Guess(float(first.times[-1]), lambda t: first(t)[:n])
    return [flown, Guess(float(last.times[-1]), lambda t: last(t)[:m])]


def _lowest_state(orbit: Orbit) -> np.ndarray:
    return orbit(float(orbit.flight_time) + contact_time_of(orbit) / 2)


def rest_in_contact(driven: Actuated, orbit: Orbit) -> dict[str, float]:
    """Where the machine rests in contact: its coordinates there, by name, near their mean over the orbit's contact."""
    model, values = driven.model, driven.values
    contact, p, onto = (
        flow_of(model.contact, tuple(values)),
        np.array(list(values.values())),
        np.linalg.pinv(model.embed),
    )
    names = [name for name in model.contact.states if f"{name}'" in model.contact.states]
    low, high = (onto @ np.append(x, 0.0) for x in (_lowest_state(orbit), orbit(0.0)))
    size = len(model.contact.states)

    def acceleration(y):
        x = np.zeros((1, size))
        x[0, : 2 * len(names) : 2] = y
        return contact.field(x, p)[0][0, 1 : 2 * len(names) : 2]

    if len(names) == 1:
        ends = float(low[0]), float(high[0])
        return {
            names[0]: bracketed_root(
                lambda y: float(acceleration(y)[0]), *ends, *(float(acceleration(y)[0]) for y in ends)
            )
        }
    from scipy.optimize import root  # takes long to import

    found = root(acceleration, (low + high)[: 2 * len(names) : 2] / 2, tol=1e-14)
    # At a tolerance of rounding the method may say that it makes no progress where it has arrived.
    if not np.abs(found.fun).max() <= AT_REST:
        raise NoOrbit("the machine has no state of rest in contact near the hop from which to start it")
    return dict(zip(names, found.x.tolist(), strict=True))


def growing_swings(
    driven: Actuated, orbit: Orbit, rest: Mapping[str, float], pumps: int, to_liftoff: bool = False
) -> list[Guess]:
    """Swings about rest that grow evenly to the orbit's lowest position, and as far upward, or `to_liftoff`."""
    states, onto = driven.model.contact.states, np.linalg.pinv(driven.model.embed)
    lowest, highest = ((onto @ np.append(x, 0.0))[: 2 * len(rest) : 2] for x in (_lowest_state(orbit), orbit(0.0)))
    still = np.array([*rest.values()])
    count, time = 2 * pumps, 0.85 * contact_time_of(orbit)  # a contact is more than one half swing, part of a whole one
    down = still - lowest
    up = (highest - still) * (1 - 1 / count) if to_liftoff else down

    def at(i, t):
        share, side = t / time, 1.0 if i % 2 == 0 else -1.0
        angle = np.pi * share
        grown = (up if side * np.cos(angle) > 0 else down) * (i + share) / (count - 1)
        x = np.zeros(len(states))
        x[: 2 * len(rest) : 2] = still + side * grown * np.cos(angle)
        x[1 : 2 * len(rest) : 2] = -side * grown * np.pi / time * np.sin(angle)
        return x

    return [Guess(time, partial(at, i)) for i in range(count)]
