"""What the engine accepts as a machine: its parts are there and well-formed, and its model is consistent."""

from collections.abc import Mapping
from math import isfinite
from numbers import Real

from ..errors import InputError, refuse_machine
from ..model.machine import Machine, free_parameters
from ..model.model import Model
from ..symbolic.formula import suggest
from ..units import Units
from .verdict import check_consistency


def check_machine(machine: Machine, *also: str) -> None:
    """Raise `InputError` where something is no machine, naming the parts that are missing or malformed; `also` names
    further parts needed. A model that was written by hand is checked once, as by `check_consistency`."""
    names, model = ("model", "values", "units", "describe", *also), getattr(machine, "model", None)
    if isinstance(model, Model) and model.derived and all(hasattr(machine, name) for name in names):
        return
    refuse_machine(machine, wrong_parts(machine, *names))
    check_consistency(machine.model, machine.values)


def wrong_parts(machine: Machine, *names: str) -> dict[str, str]:
    """The faults in the parts of a machine, in words by name; the words are empty where a part is missing."""
    found = {name: "" for name in names if not hasattr(machine, name)}
    if "model" not in found and not isinstance(machine.model, Model):
        found["model"] = f"it is a {type(machine.model).__name__}, not a Model"
    if not found:
        values = machine.values
        if not isinstance(values, Mapping):
            found["values"] = f"it is a {type(values).__name__}, not a mapping of numbers by name"
        elif wrong := [name for name, value in values.items() if not _is_number(value)]:
            found["values"] = f"{wrong[0]!r} = {values[wrong[0]]!r} is no finite number"
        if not isinstance(machine.units, Units | None):
            found["units"] = f"it is a {type(machine.units).__name__}, neither Units nor None"
        if "with_values" in names and not callable(machine.with_values):
            found["with_values"] = "it is no method"
        if not callable(machine.describe):
            found["describe"] = "it is no method"
        if "restitution" in names and not (_is_number(machine.restitution) and 0 <= machine.restitution <= 1):
            found["restitution"] = f"{machine.restitution!r} does not lie between 0 and 1"
        if "rest_length" in names and not (machine.rest_length is None or _is_number(machine.rest_length)):
            found["rest_length"] = f"{machine.rest_length!r} is neither a length nor None"
    return found


def _is_number(value: object) -> bool:
    return isinstance(value, Real) and isfinite(value)


def check_parameters(machine: Machine, *names: str) -> None:
    """Raise `InputError` where something is no machine whose parameters can be changed, or lacks one of these names."""
    check_machine(machine, "with_values")
    free = free_parameters(machine)
    for name in names:
        if name not in free:
            near = suggest(name, free)
            named = f"{near} It" if near.endswith("?") else "; it"
            raise InputError(f"the machine has no parameter '{name}' to follow{named} has {', '.join(free)}")
