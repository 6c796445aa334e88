"""What the engine asks of a machine, in one place."""

from collections.abc import Mapping
from dataclasses import fields
from math import isfinite
from numbers import Real
from types import MappingProxyType
from typing import Any, Protocol, Self, cast, runtime_checkable

from ..errors import InputError
from .consistency.verdict import check_consistency
from .laws import NOISE
from .model import Model
from .units import Units


@runtime_checkable
class Machine(Protocol):
    """A machine of some kind with the values of its parameters, for example a `problems.Hopper`.

    A machine does not change after its construction. `find` and `find_all` need its model, values, units and
    description; functions that vary parameters (`follow`, `existence`, `sensitivities`, `optimize`, `pareto`) need
    `with_values` too; and `ReturnMap`, `simulate` and `multiplier` its restitution. `steer` takes phases instead of a
    machine. `check` checks all of these attributes.
    """

    @property
    def model(self) -> Model:
        """The kind of machine: one object for all machines that differ only in numbers, which share its functions."""

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of the model by name, in a fixed order."""

    @property
    def units(self) -> Units | None:
        """The units of the engine's dimensionless numbers, for a machine that is stated in SI; else None.

        The parameters of a machine with units are in SI, its model has `units`, and its results are converted to SI.
        Its method `dimensionless` returns the same machine without units, and its `scheduled` are the units of the
        parameters that `simulate` may vary in time, by name.
        """

    def with_values(self, **values: float) -> Self:
        """The same machine with other values of some parameters; raises `InputError` for unknown names and invalid
        values."""

    def describe(self) -> dict[str, Any]:
        """The machine in words and numbers for JSON, with the keys of `orbits.periodic.orbit.MACHINE_FIELDS`."""

    @property
    def restitution(self) -> float:
        """The coefficient of restitution of its impacts, from 0 (plastic) to 1."""

    @property
    def rest_length(self) -> float | None:
        """The rest length of the spring; None where heights are counted from an unloaded spring of any length."""


class Stated:
    """A machine that is printed and pickled as it was stated, without the model that is built from that."""

    def __getstate__(self) -> dict[str, Any]:
        """The fields of the machine; its laws are pickled as what they were made from."""
        told = {each.name: getattr(self, each.name) for each in fields(cast(Any, self))}
        return {name: dict(value) if isinstance(value, MappingProxyType) else value for name, value in told.items()}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self._keep(**state)

    def _keep(self, **checked: Any) -> None:
        """Store fields as they were checked, mappings so that nobody can change them."""
        for name, value in checked.items():
            object.__setattr__(self, name, MappingProxyType(dict(value)) if isinstance(value, Mapping) else value)


def check_machine(machine: Any, *also: str) -> None:
    """Raise `InputError` where something is no machine, naming the parts that are missing or malformed; `also` names
    further parts needed. A model that was written by hand is looked at once, as by `check_consistency`."""
    names, model = ("model", "values", "units", "describe", *also), getattr(machine, "model", None)
    if isinstance(model, Model) and model.derived and all(hasattr(machine, name) for name in names):
        return
    if wrong := wrong_parts(machine, *names):
        told = "; ".join(f"it has no '{name}'" if text is None else f"{name}: {text}" for name, text in wrong.items())
        raise InputError(f"'{type(machine).__name__}' is no machine such as problems.Hopper(): {told}")
    check_consistency(machine.model, machine.values)


def wrong_parts(machine: Any, *names: str) -> dict[str, str | None]:
    """What is wrong with the parts of a machine, in words by name; None where one is missing."""
    found: dict[str, str | None] = {name: None for name in names if not hasattr(machine, name)}
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


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and isfinite(value)


def check_parameters(machine: Machine, *names: str) -> None:
    """Raise `InputError` where something is no machine whose parameters can be changed, or lacks one of these names."""
    check_machine(machine, "with_values")
    free = free_parameters(machine)
    for name in names:
        if name not in free:
            raise InputError(f"the machine has no parameter '{name}' to follow; it has {', '.join(free)}")


def machine_in_words(machine: Machine) -> dict[str, Any]:
    """What describes a machine, with the units of those results that have others because a coordinate is an angle."""
    words = machine.describe()
    unusual = machine.units.unusual_texts() if machine.units else {}
    return words | {"units": {**words.get("units", {}), **unusual}} if unusual else words


def dimensionless(machine: Any) -> Any:
    """The machine without its units; itself where it has none."""
    return machine if machine.units is None else machine.dimensionless()


def free_parameters(machine: Machine) -> list[str]:
    """The names of the parameters that may be varied."""
    fixed = (machine.model.homotopy, machine.model.gauge)
    return [name for name in machine.values if name not in fixed and not name.startswith(NOISE)]
