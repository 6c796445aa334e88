"""What an orbit says, and a proof has to hold: numbers of which nothing is believed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..errors import InputError
from ..model.machine import Machine
from ..periodic.orbit import MACHINE_FIELDS, Orbit

# The unknowns that are half the times of the two phases.
FLIGHT_DURATION, CONTACT_DURATION = "duration", "contact_duration"
# What describes a machine in words and numbers and tells apart its lossless orbits: restitution does not.
DESCRIBED = [name for name in MACHINE_FIELDS if name not in ("restitution", "parameters")]


@dataclass(frozen=True)
class Claim:
    """What is said of an orbit of a machine, in the machine's units.

    alpha, error : the launch speed, and a bound on its error
    family : the number of the family
    violations : what is said to make it no motion
    unknowns : of the equations of half an orbit, by name; without "contact_duration" where the contact does not end
    places : the coordinates in mid-flight, by name; empty where nothing is said of them
    liftoff_extension : at lift-off, None where nothing is said of it
    contradictions : in words, what is said otherwise of the machine
    """

    machine: Machine
    alpha: float
    error: float
    family: int
    violations: tuple[str, ...]
    unknowns: Mapping[str, float]
    places: Mapping[str, float] = field(default_factory=dict)
    liftoff_extension: float | None = None
    contradictions: tuple[str, ...] = ()

    @property
    def flight_time(self) -> float:
        """The time of the whole flight."""
        return 2 * self.unknowns[FLIGHT_DURATION]

    @property
    def contact_time(self) -> float | None:
        """The time of the whole contact, if it ends."""
        half = self.unknowns.get(CONTACT_DURATION)
        return None if half is None else 2 * half


def claim_of(orbit: Orbit, machine: Machine | None, varied: Sequence[str] = ()) -> Claim:
    """What an orbit says of a machine, None for the one that it was found for, with other values of some parameters;
    raises `InputError` where the machine is not known, and for an orbit of another kind of machine."""
    machine = machine or orbit.source
    if machine is None:
        raise InputError("this orbit does not know its machine: give prove(orbit, machine=...)")
    states = machine.model.flight.states
    if orbit.flight.names[: len(states)] != states:
        raise InputError(f"this is an orbit of another machine, with the states {', '.join(orbit.flight.names)}")
    unknowns = machine.model.launch_at(orbit.flight(0.0)[: len(states)].tolist())
    unknowns |= {"alpha": orbit.alpha, FLIGHT_DURATION: orbit.flight_time / 2}
    if orbit.contact_time is not None:
        unknowns[CONTACT_DURATION] = orbit.contact_time / 2
    places = dict(zip(states, orbit.state_mid_flight.tolist(), strict=False))
    return Claim(
        machine, orbit.alpha, orbit.error, orbit.family, orbit.violations, unknowns,
        {name: place for name, place in places.items() if not name.endswith("'")}, orbit.liftoff_extension,
        tuple(_contradictions(orbit.machine, machine.describe(), varied)),
    )  # fmt: skip


def _contradictions(said: Mapping[str, Any], described: Mapping[str, Any], varied: Sequence[str]) -> list[str]:
    """What an orbit says otherwise of its machine, in words."""
    pairs = [(name, said.get(name), described.get(name)) for name in DESCRIBED if name not in varied]
    ours, theirs = (dict(each.get("parameters") or {}) for each in (said, described))
    pairs += [(name, ours.get(name), theirs.get(name)) for name in sorted({*ours, *theirs}) if name not in varied]
    return [f"{name}: the orbit says {own!r}, and the machine {true!r}" for name, own, true in pairs if own != true]
