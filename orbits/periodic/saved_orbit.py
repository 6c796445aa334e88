"""The file of an orbit: its fields, what each of them may be, and that they agree with each other."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NotRequired, TypedDict

from ..flow import Trajectory
from ..io import conform
from ..model import MACHINE_FIELDS
from ..units import UNIT_TEXTS, SavedUnits
from .certificate import Certificate
from .cycle_shape import SavedShape, shape_of
from .quantities import CERTIFIED, OF_RUNS

# Two statements of a number in a file agree if their relative difference is at most this.
SAME_NUMBER = 1e-9
LOOP_ENERGY = "loop_energy"  # which an orbit does not have without its machine
# The fields of an orbit that older files, or those of other machines, do not have.
OPTIONAL = ("known_in_family", "peak_force_in_weights", "step", "speed")
# The fields of an orbit's document after those of the machine.
DOCUMENT_FIELDS = (
    *("family", "known_in_family", "alpha", "flight_time", "contact_time", "admissible", "violations", "rises"),
    *(name for name in CERTIFIED if name != "family"),
    *("stable_side", "bounce_side", "unfolding", "liftoff_extension", "state_mid_flight", "method", "skipped"),
    *("period", "frequency", "duty_factor", "stroke", "apexes", "peak_force_in_weights", LOOP_ENERGY),
    "seconds",
)
# Further fields of the orbit of a machine that steps.
FIELDS_OF_STEPS = (
    *("bounce_factor", "friction_needed", "friction_error", "friction_time"),
    *("smallest_stance_force", "stance_judged"),
)
# And of one that moves on along the ground.
FIELDS_OF_RUNS = (*OF_RUNS, "cost_of_transport")
# And of one that has limbs.
FIELDS_OF_LIMBS = "half_stance", "half_double_stance", "rates"
# The fields of an orbit's file besides those of the machine.
OTHER_FIELDS = {
    *(*DOCUMENT_FIELDS, *FIELDS_OF_STEPS, *FIELDS_OF_RUNS, *FIELDS_OF_LIMBS),
    *("format", "motion", "units", "si", "bare", "tuned", "tuned_errors", "prescribed"),
}


class SavedMotion(TypedDict):
    """The data of a saved orbit besides its document."""

    shape: SavedShape
    flight: Trajectory
    contact: Trajectory | None
    units: SavedUnits | None


# The laws of a machine in a file, which have these names.
SavedLaws = TypedDict("SavedLaws", {"spring": str, "gravity": str})  # noqa: UP013 -- the engine names no such thing


class SavedOrbit(SavedLaws):
    """The fields that are read from a saved orbit, besides the fields of `Certificate`."""

    format: str
    machine: str
    restitution: float | None
    parameters: Mapping[str, float]
    laws_in: str
    alpha: float
    liftoff_extension: float
    flight_time: float
    contact_time: float | None
    method: str
    skipped: tuple[str, ...]
    seconds: float
    known_in_family: NotRequired[int | None]
    peak_force_in_weights: NotRequired[float | None]
    step: NotRequired[float]
    speed: NotRequired[float]
    tuned: NotRequired[Mapping[str, float]]
    tuned_errors: NotRequired[Mapping[str, float]]
    prescribed: NotRequired[Mapping[str, float]]
    units: NotRequired[Mapping[str, str]]
    bare: NotRequired[Mapping[str, Any]]
    motion: SavedMotion


def stated_fields(data: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of the orbit whose numbers a document states, without units."""
    motion, checked = data["motion"], [name for name in Certificate.__dataclass_fields__ if name in data]
    flight, contact = motion["flight"], motion["contact"]
    if (data["contact_time"] is None) != (contact is None) or not data["flight_time"] >= flight.times[-1]:
        raise ValueError("its times do not fit its motion")
    return dict(
        machine=machine_in_document(data),
        **{name: data[name] for name in ("alpha", "liftoff_extension", "flight_time", "contact_time", "method")},
        flight=flight,
        contact=contact,
        shape=shape_of(motion["shape"], flight, contact),
        certificate=conform({name: data[name] for name in checked}, Certificate),
        skipped=data["skipped"],
        seconds=data["seconds"],
        **{name: data.get(name) for name in OPTIONAL},
        tuned_errors=saved_tuned_errors(data),
        prescribed=data.get("prescribed", {}),
    )


def saved_tuned_errors(data: Mapping[str, Any]) -> Mapping[str, float]:
    """The errors of the tuned parameters in an orbit's document; until version 0.2.0 they were called "tuned"."""
    return data.get("tuned_errors", data.get("tuned", {}))


def machine_in_document(data: Mapping[str, Any]) -> dict[str, object]:
    """The machine in words and numbers, with the units of its parameters if there are any, from an orbit's document."""
    machine = {name: data[name] for name in MACHINE_FIELDS}
    machine |= {name: value for name, value in data.items() if name not in OTHER_FIELDS}
    if "units" not in data:
        return machine
    usual = {"rises": "m", "apexes": "m", "state_mid_flight": data["units"].get("state_mid_flight"), **UNIT_TEXTS}
    units = {name: unit for name, unit in data["units"].items() if unit != usual.get(name)}
    numbers = {name: conform(machine[name], float | None, name) for name in units if name in machine}
    return machine | numbers | {"units": units}


def with_note(certificate: Certificate) -> Certificate:
    """The certificate in a file of version 0.1.0 of a machine in SI, whose violations state numbers without units."""
    return replace(certificate, violations=tuple(f"{each} (without units)" for each in certificate.violations))


def check_consistent(document: Mapping[str, object], data: Mapping[str, Any]) -> None:
    """Raise `ValueError` where the data of a file contradict the document of the orbit that was read from it."""
    if data["motion"]["units"] and "units" not in data:
        return  # a file of version 0.1.0, whose numbers have no units
    sides = () if "bounce_side" in data else ("stable_side",)  # of version 0.1.0, the side without a bounce
    for name in DOCUMENT_FIELDS:
        if (
            name in data
            and name not in (*sides, "seconds", LOOP_ENERGY)
            and not _same_numbers(data[name], document[name])
        ):
            raise ValueError(f"it states {name} = {data[name]!r}, but its motion has {document[name]!r}")


def _same_numbers(one: object, other: object) -> bool:
    """Whether two parts of documents are equal, numbers up to rounding."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_same_numbers(one[name], other[name]) for name in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(_same_numbers, one, other))
    if isinstance(one, int | float) and isinstance(other, int | float):
        return abs(one - other) <= SAME_NUMBER * max(abs(one), abs(other))
    return bool(one == other)
