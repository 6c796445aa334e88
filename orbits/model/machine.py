"""The protocol of a machine: what the engine requires of it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol, Self, cast, runtime_checkable

from ..errors import InputError, refuse_machine
from ..running import exclusive
from ..symbolic import suggest
from ..units import DIMENSIONS, Units
from .model import Model

if TYPE_CHECKING:
    from .casadi_machine import CasadiMachine

# Numbers of machines that lossless orbits do not depend on, and what refuses them as parameters of these.
LOSSES = ("restitution", "damping", "drag")
LOSSLESS = "lossless orbits do not depend on it; simulations, return maps and control do"
# The keys that describe a machine in a document.
MACHINE_FIELDS = ("machine", "spring", "gravity", "mass_ratio", "rest_length", "restitution", "parameters", "laws_in")


@runtime_checkable
class Machine(Protocol):
    """A machine of some kind with the values of its parameters, for example a `problems.Hopper`.

    A machine does not change after its construction. `find` and `find_all` need its model, values, units and
    description. Functions that vary parameters (`follow`, `existence`, `sensitivities`, `optimize`, `pareto`) need
    `with_values` too; and `ReturnMap`, `simulate` and `multiplier` its restitution. `steer` takes phases instead of a
    machine.
    """

    @property
    def model(self) -> Model:
        """The model: one object for all machines that differ only in numbers, which share its functions."""

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of the model by name, in a fixed order."""

    @property
    def units(self) -> Units | None:
        """The units of the engine's dimensionless numbers, for a machine stated in SI; else None.

        The parameters of a machine with units are in SI, its model has `units`, and its results are converted to SI.
        Its method `dimensionless` returns the same machine without units, and `scheduled` has the units of the
        parameters that `simulate` may vary in time, by name.
        """

    def with_values(self, **values: float) -> Self:
        """This machine with other values of some parameters; raises `InputError` for unknown names and invalid
        values."""

    def describe(self) -> dict[str, Any]:
        """The machine in words and numbers for JSON, with the keys `MACHINE_FIELDS`."""

    @property
    def restitution(self) -> float:
        """The coefficient of restitution of its impacts, from 0 (plastic) to 1."""

    @property
    def rest_length(self) -> float | None:
        """The rest length of the spring; None where heights are counted from an unloaded spring of any length."""


class Stated:
    """A machine that is printed and pickled as it was stated, without the model that is built from that."""

    @exclusive
    def casadi(self) -> "CasadiMachine":
        """The machine as CasADi functions: vector fields, guards, resets, energy, forces and heights; see
        `orbits.model.CasadiMachine`.

        Raises `InputError` for a spring with hysteresis, which has no vector field, and for a machine without a gap.

        >>> from problems import Hopper
        >>> hopper = Hopper("r + 0.3*r**3").casadi()
        >>> hopper.flight
        Function(flight:(x[4],p)->(rates[4]) SXFunction)
        >>> hopper.flight([1.0, 0.5, 0.0, 0.0], hopper.values)
        DM([0.5, -1.15, 0, 0.15])
        """
        from .casadi_machine import casadi_machine  # most machines are never asked for it

        check_machine(cast(Machine, self))
        return casadi_machine(self)

    def __getstate__(self) -> dict[str, Any]:
        """The fields of the machine; its laws are pickled as the statements that they were made from."""
        stated = {each.name: getattr(self, each.name) for each in fields(cast(Any, self))}
        return {name: dict(value) if isinstance(value, MappingProxyType) else value for name, value in stated.items()}

    def __setstate__(self, state: Mapping[str, object]) -> None:
        self._store(**state)

    def _store(self, **checked: object) -> None:
        """Store fields as they were checked, mappings so that nobody can change them."""
        for name, value in checked.items():
            object.__setattr__(self, name, MappingProxyType(dict(value)) if isinstance(value, Mapping) else value)


def machine_in_words(machine: Machine) -> dict[str, Any]:
    """The description of a machine, with the units of those results whose units differ as a coordinate is an angle."""
    words = machine.describe()
    unusual = machine.units.unusual_texts() if machine.units else {}
    return words | {"units": {**words.get("units", {}), **unusual}} if unusual else words


def title_of_machine(words: Mapping[str, Any]) -> str:
    """A machine in words as a title: its name and its laws, but not constant gravity."""
    spring = f", spring {words['spring']}" if words["spring"] else ""
    gravity = "" if words["gravity"] == "1" else f", gravity {words['gravity']}"
    return f"{words['machine']}{spring}{gravity}"


def dimensionless(machine: Any) -> Any:
    """The machine without its units; itself where it has none."""
    return machine if machine.units is None else machine.dimensionless()


def free_parameters(machine: Machine) -> list[str]:
    """The names of the parameters that may be varied."""
    fixed = (machine.model.homotopy, machine.model.gauge, *machine.model.fixed)
    return [name for name in machine.values if name not in fixed]


def check_machine(machine: Machine, *also: str, lands: bool = True) -> None:
    """Raise `InputError` where something is not a machine, naming the parts that are missing; `also` names further
    parts needed, and where it `lands` it needs a gap."""
    wrong = {name: "" for name in ("model", "values", "units", "describe", *also) if not hasattr(machine, name)}
    if "model" not in wrong and not isinstance(machine.model, Model):
        wrong["model"] = f"it is a {type(machine.model).__name__}, not a Model"
    refuse_machine(machine, wrong)
    if lands and not machine.model.lands:
        own = "find(machine, at={'energy': 1.0}) and follow(machine, 'energy', (0.1, 1.0))"
        if getattr(machine, "grip", None):
            own = f"{own}; it swings from hold to hold: find(machine) and follow(machine, NAME, STOP)"
        raise InputError(f"a {machine.model.name} has no gap (gap=None), so it never lands; it oscillates: {own}")


def check_parameters(machine: Machine, *names: str) -> None:
    """Raise `InputError` where something is not a machine whose parameters can be changed, or lacks one of these
    names."""
    check_machine(machine, "with_values")
    refuse_others(machine, names, "to follow", free_parameters(machine))


def refuse_others(machine: Machine, names: Iterable[str], act: str, known: Sequence[str]) -> None:
    """Raise `InputError` where a name is not one of the `known` parameters of a machine: that of a quantity of its
    orbits, of a number that follows from others, of a loss, or of nothing."""
    following = dict.fromkeys(LOSSES, LOSSLESS) | dict(getattr(machine, "following", {}))
    for name in names:
        if name in known:
            continue
        wrong = f"the machine has no parameter '{name}' {act}"
        if name in following:
            raise InputError(f"{wrong}: {following[name]}")
        if name in DIMENSIONS or str(name).endswith("_rise"):
            at = f"find(machine, tune=..., at={{'{name}': ...}})"
            raise InputError(f"{wrong}: it is a quantity of orbits; {at} prescribes it and tunes a parameter")
        near = suggest(name, known)
        named = f"{near} It" if near.endswith("?") else "; it"
        raise InputError(f"{wrong}{named} has {', '.join(known)}")
