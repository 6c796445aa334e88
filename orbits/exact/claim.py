"""The claims of an orbit, which a proof has to confirm: numbers that are not trusted."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import ROUND_CEILING, Context
from typing import Any

import numpy as np

from ..errors import InputError, NoOrbit, list_of_names
from ..model import MACHINE_FIELDS, STEP_LENGTH, Machine, check_parameters
from ..periodic import OF_STEPS, PRESCRIBED, Orbit, find
from .decimals import exact_fraction
from .stated import Decimals, ExactNumber, StatedMachine, stated_machine

# The quantities that equations of half an orbit may prescribe; the others are those of its whole motion.
BY_EQUATIONS = (*PRESCRIBED, *OF_STEPS)
# The unknowns that are half the times of the two phases.
FLIGHT_DURATION, CONTACT_DURATION = "duration", "contact_duration"
# The fields of a machine that determine its lossless orbits, without parameters and units, which are compared apart.
NOT_DESCRIBED = ("restitution", "parameters", "units")
DESCRIBED = [name for name in MACHINE_FIELDS if name not in NOT_DESCRIBED]
# Numbers of a certificate that are in no theorem and are measured anew: lengths, forces, and others.
LENGTHS, FORCES = ("clearance", "smallest_separation"), ("smallest_contact_force", "largest_contact_force")
OTHERS = ("landing_jerk", "loss_coefficient", "stable_side", "bounce_side")
# The share of themselves, or of the sizes below, to which they are correct; for motions, of the largest state.
MEASURED_TO, MOTION_TO, COMPARED_TIMES = 1e-6, 1e-6, 17
# The digits of a coefficient of friction that is proved to suffice, and by which share at least it is above what does.
FRICTION_DIGITS, FRICTION_ROOM = 4, 1e-4


@dataclass(frozen=True)
class Claim:
    """The claims about an orbit of a machine, in the machine's units.

    alpha, error : the launch speed, and a bound on its error
    family : the number of the family
    violations : the conditions of a motion that it is claimed to violate
    unknowns : of the equations of half an orbit, by name; without "contact_duration" where the contact does not end
    places : the coordinates in mid-flight, by name; empty where they are not claimed
    liftoff_extension : at lift-off, None where it is not claimed
    contradictions : in words, the claims that contradict the machine
    tuned, prescribed : the machine's parameters that are unknowns, and exact values of quantities of the orbit
    friction : the coefficient of friction that it needs, None where that is not claimed
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
    tuned: tuple[str, ...] = ()
    prescribed: Mapping[str, ExactNumber] = field(default_factory=dict)
    friction: float | None = None

    def stated(self, parameters: Mapping[str, Decimals]) -> StatedMachine:
        """What a theorem about it states of the machine, with exact values of some of its parameters; where the machine
        states no friction, a coefficient a little above what the orbit needs. Raises the errors of `stated_machine`."""
        found = stated_machine(self.machine, parameters).with_tuned(self.tuned, self.prescribed)
        if found.sticks and found.friction is None and self.friction is not None:
            return replace(found, friction=rounded_up(self.friction))
        return found

    @property
    def flight_time(self) -> float:
        """The time of the whole flight."""
        return 2 * self.unknowns[FLIGHT_DURATION]

    @property
    def contact_time(self) -> float | None:
        """The time of the whole contact, if it ends."""
        half = self.unknowns.get(CONTACT_DURATION)
        return None if half is None else 2 * half


def rounded_up(friction: float) -> str:
    """A decimal of few digits that is a little above a coefficient of friction, which so may be proved to be less."""
    above = Context(prec=FRICTION_DIGITS, rounding=ROUND_CEILING).create_decimal(friction * (1 + FRICTION_ROOM))
    return format(above, "f")


def claim_of(
    orbit: Orbit, machine: Machine | None, varied: Sequence[str] = (), tune: Iterable[str] | None = None,
    at: Mapping[str, ExactNumber] | None = None,
) -> Claim:  # fmt: skip
    """The claims of an orbit about a machine, None for the one that it was found for, with other values of some
    parameters; `tune` and `at` are as in `prove`. Raises `InputError` where the machine is not known, and for an orbit
    of another kind of machine."""
    if not isinstance(orbit, Orbit):
        raise InputError(f"a {type(orbit).__name__} cannot be proved: pass an orbit, prove(find(machine))")
    machine = orbit.source if machine is None else machine
    if machine is None:
        raise InputError("this orbit does not know its machine: pass prove(orbit, machine=...)")
    states = machine.model.flight.states
    if orbit.flight.names[: len(states)] != states:
        raise InputError(f"this orbit belongs to another machine, with the states {', '.join(orbit.flight.names)}")
    unknowns = machine.model.launch_at(orbit.flight(0.0)[: len(states)].tolist())
    unknowns |= {"alpha": orbit.alpha, FLIGHT_DURATION: orbit.flight_time / 2}
    if orbit.contact_time is not None:
        unknowns[CONTACT_DURATION] = orbit.contact_time / 2
    places = dict(zip(states, orbit.state_mid_flight.tolist(), strict=False))
    tuned, prescribed = _tuning_of(orbit, machine, varied, tune, at)
    unknowns |= {name: machine.values[name] for name in tuned}
    if machine.model.runs:
        unknowns[STEP_LENGTH] = 2 * places[machine.model.sticks[0]]
    return Claim(
        machine, orbit.alpha, orbit.error, orbit.family, orbit.violations, unknowns,
        {name: place for name, place in places.items() if not name.endswith("'")}, orbit.liftoff_extension,
        (*_contradictions(orbit.machine, machine.describe(), varied),
         *_wrong_measurements(orbit, machine, tuned, prescribed)),
        tuned, prescribed, orbit.certificate.friction_needed,
    )  # fmt: skip


def _tuning_of(
    orbit: Orbit, machine: Machine, varied: Sequence[str], tune: Iterable[str] | None,
    at: Mapping[str, ExactNumber] | None,
) -> tuple[tuple[str, ...], Mapping[str, ExactNumber]]:  # fmt: skip
    """The names of the parameters that are unknowns, and the exact values of quantities: by default those of the orbit,
    except for quantities that no equation of half an orbit prescribes and as many of its last parameters, which have
    their numbers. The step is always unknown where a coordinate sticks."""
    if not isinstance(at, Mapping | None):
        raise InputError(f"at = {at!r}; it must be a mapping of quantities to values, such as at={{'speed': '0.4'}}")
    # Above a foot that stands the mean speed in flight gives no equation of half an orbit at lift-off.
    by_equations = BY_EQUATIONS if machine.model.runs else (*PRESCRIBED, *machine.model.sticks)
    known = {name: value for name, value in orbit.prescribed.items() if name in by_equations}
    own = [name for name in orbit.tuned if name != STEP_LENGTH]
    own = own[: len(own) - (len(orbit.prescribed) - len(known))]
    names = tuple(list_of_names("tune", own if tune is None else tune))
    check_parameters(machine, *names)
    if both := {*names} & {*varied}:
        raise InputError(f"'{min(both)}' is tuned: it has no value of its own")
    return (*names, *([STEP_LENGTH] if machine.model.runs else [])), dict(known if at is None else at)


def _contradictions(claimed: Mapping[str, Any], described: Mapping[str, Any], varied: Sequence[str]) -> list[str]:
    """The claims of an orbit that contradict its machine, in words."""
    # Others, such as masses in SI, are missing in files of version 0.1.0; units follow from varied numbers.
    others = [name for name in described if name in claimed and not (varied and name.startswith("unit"))]
    names = dict.fromkeys((*DESCRIBED, *others))
    pairs = [(name, claimed.get(name), described.get(name)) for name in names if name not in (*NOT_DESCRIBED, *varied)]
    ours, theirs = (dict(each.get("parameters") or {}) for each in (claimed, described))
    pairs += [(name, ours.get(name), theirs.get(name)) for name in sorted({*ours, *theirs}) if name not in varied]
    ours, theirs = (dict(each.get("units") or {}) for each in (claimed, described))
    pairs += [(f"the unit of {name}", ours[name], unit) for name, unit in theirs.items() if name in ours]
    return [f"{name}: the orbit states {own!r}, but the machine {true!r}" for name, own, true in pairs if own != true]


def _wrong_measurements(
    orbit: Orbit, machine: Machine, tuned: Sequence[str], prescribed: Mapping[str, ExactNumber]
) -> list[str]:
    """The claims of an orbit about its motion that contradict the same orbit measured again, in words."""
    sticks = machine.model.sticks  # whose orbits are found with tuned numbers alone
    names = [name for name in tuned if name != STEP_LENGTH] if sticks else None
    at = {name: float(exact_fraction(name, value)) for name, value in prescribed.items()} if sticks else None
    try:
        anew = find(machine, start=orbit, tune=names, at=at)
    except (NoOrbit, InputError) as error:
        return [f"the orbit cannot be measured again: {error}"]
    claimed, true = orbit.certificate, anew.certificate
    length, force = anew.alpha * anew.flight_time, true.largest_contact_force or 0.0
    sizes = {**dict.fromkeys(LENGTHS, length), **dict.fromkeys(FORCES, force), **dict.fromkeys(OTHERS, 0.0)}
    errors = dict.fromkeys(sizes, 0.0) | {"loss_coefficient": 10 * (true.loss_error or 0.0)}
    found = list[str]()
    for name, size in sizes.items():
        own, other = getattr(claimed, name), getattr(true, name)
        if not _agree(own, other, MEASURED_TO * size + errors[name]):
            found.append(f"{name}: the orbit states {own!r}, but measured again it is {other!r}")
    return found + (
        [] if _same_motion(orbit, anew) else ["the motion: the orbit's states do not follow from its launch"]
    )


def _agree(claimed: object, true: object, error: float) -> bool:
    """Whether two numbers agree to an error and `MEASURED_TO`; texts and None have to be equal."""
    if isinstance(claimed, float) and isinstance(true, float):
        return abs(claimed - true) <= error + MEASURED_TO * abs(true)
    return bool(claimed == true)


def _same_motion(orbit: Orbit, anew: Orbit) -> bool:
    """Whether two orbits have the same states at some times."""
    try:
        end = anew.flight_time if anew.contact_time is None else anew.period
        times = np.linspace(0, end, COMPARED_TIMES + 1)[:-1]
        claimed, true = orbit(times), anew(times)
    except InputError:
        return False
    return claimed.shape == true.shape and bool((abs(claimed - true) <= MOTION_TO * abs(true).max(0)).all())
