"""What an orbit says, and a proof has to hold: numbers of which nothing is believed."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..errors import InputError
from ..model.machine import Machine
from ..periodic.orbit import Orbit

# The unknown that is half the time of the contact.
CONTACT_DURATION = "contact_duration"


@dataclass(frozen=True)
class Claim:
    """What is said of an orbit of a machine, in the machine's own units without SI.

    alpha, error : the launch speed, and a bound on its error
    family : the number of the family
    violations : what is said to make it no motion
    unknowns : of the equations of half an orbit, by name; without "contact_duration" where the contact does not end
    """

    machine: Machine
    alpha: float
    error: float
    family: int
    violations: tuple[str, ...]
    unknowns: Mapping[str, float]


def claim_of(orbit: Orbit, machine: Machine | None) -> Claim:
    """What an orbit says of a machine, None for the one that it was found for; raises `InputError` where that is not
    known, and for an orbit of another kind of machine."""
    machine = machine or orbit.source
    if machine is None:
        raise InputError("this orbit does not know its machine: give prove(orbit, machine=...)")
    bare, states = orbit.dimensionless(), machine.model.flight.states
    if bare.flight.names[: len(states)] != states:
        raise InputError(f"this is an orbit of another machine, with the states {', '.join(bare.flight.names)}")
    unknowns = machine.model.launch_at(bare.flight(0.0)[: len(states)].tolist())
    unknowns |= {"alpha": bare.alpha, "duration": bare.flight_time / 2}
    if bare.contact_time is not None:
        unknowns[CONTACT_DURATION] = bare.contact_time / 2
    return Claim(machine, bare.alpha, bare.error, bare.family, bare.violations, unknowns)
