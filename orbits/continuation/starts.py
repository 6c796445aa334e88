"""Starts for `find_all` of machines whose launch is more than a speed: their hops with linear springs, led to the
springs' own laws."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import FlowError, InputError, NoOrbit, finite_number
from ..flow.flow import flow_of
from ..model.elements import Spring
from ..model.laws import Key, Law, from_formula, from_key
from ..model.machine import Machine
from ..model.mechanism import Mechanism
from ..periodic.find import find
from ..periodic.linear_hops import linear_hops
from .follow import follow

# The springs' own laws are brought in along this parameter, from 0 to 1.
LAW_SHARE = "share_of_the_springs_own_law"
# The longest step along it, as a share, and the most points: hops that need more are left out.
LONGEST_LAW_STEP, MOST_LAW_POINTS = 0.1, 200


def starts(machine: Mechanism, half_contact: float, half_flight: float, seed: int = 0) -> list[dict[str, float]]:
    """Starts for `find_all`: the lossless hops of a mechanism with half phase times up to these.

    half_contact, half_flight : the longest half times of contact and of flight
    seed : of the quasi-random pairs of times from which they are searched; another one may find some more

    For linear springs they are those of `linear_hops`. Other springs are brought in step by step, from the linear ones
    with their slopes where they are not extended, and each hop is followed. Hops that end on the way are left out, as
    are hops that no linear one leads to. Raises `InputError` for a mechanism that is not linear with linear springs,
    under constant gravity.
    """
    if not isinstance(machine, Mechanism):
        raise InputError(f"starts are those of a Mechanism, not of a {type(machine).__name__}")
    springs = [element for element in machine.elements if isinstance(element, Spring)]
    slopes = [float(from_key(spring.force, machine.values).with_slope(0.0)[1]) for spring in springs]
    for spring, slope in zip(springs, slopes, strict=True):
        if not finite_number(f"the slope of spring '{spring.force.text}' at rest", slope) > 0:
            raise InputError(
                f"spring '{spring.force.text}' has the slope {slope:g} where it is not extended, not above 0"
            )
    straight = machine.with_springs(
        [from_formula(f"slope_{i}*r", "r", {f"slope_{i}": slope}) for i, slope in enumerate(slopes)]
    )
    hops = linear_hops(*straight.linear_equations(), straight.gap_weights, half_contact, half_flight, seed)
    names = machine.model.flight.states
    found = [start_from(machine, dict(zip(names, hop.liftoff.tolist(), strict=True)), *hop[:2]) for hop in hops]
    if all(spring.force.degree() == 1 for spring in springs):
        return found
    mixed = machine.with_springs(
        [_mixed(each.force, slope, machine.values) for each, slope in zip(springs, slopes, strict=True)]
    )
    return [led for start in found if (led := _led_to_own_laws(mixed, start))]


def start_from_rest(
    machine: Machine, positions: Sequence[float], half_contact: float, half_flight: float
) -> dict[str, float]:
    """What `find` starts from: unknowns by name, from a guess of the rest in mid-contact and of the two half times.

    positions : (n - 1,), of the coordinates of the contact

    Raises `NoOrbit` when the motion from there cannot be followed.
    """
    contact, values, count = machine.model.contact, machine.values, len(machine.model.contact.states) // 2
    if np.shape(positions) != (count,):
        raise InputError(f"positions = {positions!r}; they are {count} numbers, from the top")
    for name, time in (("half_contact", half_contact), ("half_flight", half_flight)):
        if not finite_number(name, time) > 0:
            raise InputError(f"{name} = {time:g} is out of bounds; it lies above 0")
    rest = np.zeros(2 * count)
    rest[::2] = positions
    try:
        path, _ = flow_of(contact, tuple(values)).run(rest, list(values.values()), half_contact)
    except FlowError as error:
        raise NoOrbit(f"the contact cannot be followed from rest at {positions}: {error}") from None
    return start_from(
        machine, dict(zip(contact.states, path.end[: 2 * count].tolist(), strict=True)), half_contact, half_flight
    )


def start_from(
    machine: Machine, liftoff: Mapping[str, float], half_contact: float, half_flight: float
) -> dict[str, float]:
    """The unknowns of half an orbit from the flight state at lift-off by name."""
    own = dict(zip(("liftoff", "alpha"), machine.model.launched, strict=True))
    names = machine.model.launch_unknowns
    return {name: liftoff[own.get(name, name)] for name in names} | {
        "duration": half_flight, "contact_duration": half_contact,
    }  # fmt: skip


def _mixed(key: Key, slope: float, p: Mapping[str, float]) -> Law:
    """A law that goes from a straight line to a spring's own as the parameter `LAW_SHARE` goes from 0 to 1."""

    def expression(x: Any, p: Mapping[str, Any], q: Any) -> Any:
        return p[LAW_SHARE] * key.expression(x, p, q) + (1 - p[LAW_SHARE]) * slope * x

    return Law(key.text, "r", expression, {name: p[name] for name in key.names} | {LAW_SHARE: 0.0})


def _led_to_own_laws(mixed: Mechanism, start: Mapping[str, float]) -> dict[str, float] | None:
    """The start of the hop to which one of the straight springs leads, None where that ends on the way."""
    try:
        orbit = find(mixed, start=start)
        family = follow(mixed, LAW_SHARE, 1.0, orbit=orbit, longest=LONGEST_LAW_STEP, most=MOST_LAW_POINTS)
    except NoOrbit:
        return None
    return dict(zip(mixed.model.half_unknowns, family[-1].u, strict=True)) if family.end.kind == "reached" else None
