"""Quantities of an orbit, and their exact derivatives by the parameters of its machine."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ..errors import InputError, NoOrbit, OrbitsError, list_of_names
from ..model import Machine, check_parameters, free_parameters, machine_in_words
from ..periodic import (
    OF_LOSS,
    OTHER_EQUATIONS,
    Orbit,
    StartLike,
    beyond_model,
    check_start,
    find,
    is_orbit_of,
    orbit_of,
    quantity_names,
)
from ..result import Axes, Result, Row, shown
from ..running import exclusive, interrupts
from ..symbolic import parse
from .design_point import Case, DesignPoint, design_points, has_loss, no_motion
from .design_problem import Outputs, known_formula
from .design_quantities import extremes_of
from .extremes import places_of
from .tuned_machine import TunedMachine, first_of_tuned, names_of_designs, tuned_numbers, untuned, with_tuning

# Requested names, one or a list; None for all.
Names: TypeAlias = str | Sequence[str] | None


@dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(Result, Mapping[str, Mapping[str, float]], what="sensitivities", dimension="derivative"):
    """The derivatives of an orbit's quantities by the parameters of its machine; a mapping, [quantity][parameter].

    machine : in words and numbers
    slopes : the derivatives by quantity and parameter, in the machine's units
    at : the values of the quantities, and `parameters` those of the parameters, where the derivatives are taken
    """

    machine: Mapping[str, Any]
    slopes: Mapping[str, Mapping[str, float]]
    at: Mapping[str, float]
    parameters: Mapping[str, float]

    def __getitem__(self, quantity: str) -> Mapping[str, float]:
        return self.slopes[quantity]

    def __iter__(self) -> Iterator[str]:
        return iter(self.slopes)

    def __len__(self) -> int:
        return len(self.slopes)

    def relative(self) -> dict[str, dict[str, float]]:
        """The relative change of each quantity per relative change of each parameter, 1 where they are proportional;
        NaN where a quantity is 0."""

        def share(quantity: str, name: str) -> float:
            value = self.at[quantity]
            return self.slopes[quantity][name] * self.parameters[name] / value if value else np.nan

        return {quantity: {name: share(quantity, name) for name in row} for quantity, row in self.slopes.items()}

    def _line(self) -> dict[str, object]:
        return {f"d {quantity}/d {name}": value for quantity, row in self.items() for name, value in row.items()}

    def title(self) -> str:
        return f"derivatives of {len(self)} quantities of a {self.machine['machine']} by {', '.join(self.parameters)}"

    def heads(self) -> list[str]:
        units = {name: self.unit_of(name) for name in self.parameters}
        return ["quantity", "value", *(f"d/d {name}{unit and f' (per {unit})'}" for name, unit in units.items())]

    def _rows(self) -> Iterator[Row]:
        """The quantities, each with its value and its derivatives."""
        for quantity, row in self.items():
            values = {quantity: self.at[quantity], **{f"d {quantity}/d {name}": row[name] for name in row}}
            yield Row(self.heading(quantity), values, ("{:.9g}", *("{:.7g}",) * len(row)))

    def table(self) -> dict[str, list[Any]]:
        """A row for each quantity and parameter: the value of each, the derivative with its unit, and the `relative`
        derivative."""
        pairs, shares = [(quantity, name) for quantity, row in self.items() for name in row], self.relative()
        units = [(self.unit_of(quantity), self.unit_of(name)) for quantity, name in pairs]
        return {
            "quantity": [quantity for quantity, _ in pairs],
            "parameter": [name for _, name in pairs],
            "value": [self.at[quantity] for quantity, _ in pairs],
            "value of parameter": [self.parameters[name] for _, name in pairs],
            "derivative": [self.slopes[quantity][name] for quantity, name in pairs],
            "unit": [f"{above or '1'} per {below or '1'}" if above or below else "" for above, below in units],
            "relative derivative": [shares[quantity][name] for quantity, name in pairs],
        }

    def plot(self, axes: Axes | None = None) -> Axes:
        """Plot the `relative` derivatives as a matrix of quantities and parameters; returns the axes."""
        return shown("shares").plot_sensitivities(self, axes)


@exclusive
def quantities(machine: Machine, orbit: Orbit, names: Names = None) -> dict[str, float]:
    """Quantities of a machine's orbit, by name.

    machine, orbit : a machine, and an orbit of it
    names : of quantities, or formulas of them, one or a list; None for all quantities that the orbit has

    The values are in the machine's units, or in SI for a machine in SI. Raises `InputError` for an unknown name, and
    for the orbit of another machine.

    >>> from orbits import find, quantities
    >>> from problems import Hopper
    >>> round(quantities(Hopper(), find(Hopper()), ["stroke"])["stroke"], 5)
    12.26528
    """
    names, alone = _requested(machine, orbit, names), beyond_model(machine)
    beyond = {name: alone[name](orbit.alpha) for name in names if name in alone}
    if not (others := [name for name in names if name not in beyond]):
        return beyond
    found = dict(zip(others, _formulas_at(machine, orbit, others, ()).values.tolist(), strict=False)) | beyond
    return {name: found[name] for name in names}


@exclusive
def sensitivities(
    machine: Machine,
    orbit: Orbit | int = 1,
    names: Names = None,
    quantities: Names = None,
    *,
    start: StartLike | None = None,
    tune: str | Iterable[str] | None = None,
    at: Mapping[str, float] | None = None,
) -> Sensitivities:
    """Exact derivatives d(quantity)/d(parameter) for an orbit that stays lossless as the parameter changes.

    machine : as in `find`
    orbit : an orbit of the machine, or the number of its family
    names : of the parameters, as in `optimize`, one or a list; None for all
    quantities : of the orbit, or formulas of these, one or a list; None for all
    start : as in `find`, of the orbit, instead of the number of its family
    tune, at : as in `optimize`. The derivatives are then taken by the other parameters and by the prescribed
        quantities, and the tuned parameters are among the quantities

    Returns the derivatives as a mapping by quantity and parameter, in the machine's units. They follow from the
    implicit function theorem for the equations of the orbit, by automatic differentiation. At a fold of the family in a
    parameter they are infinite. Raises `InputError` for an unknown name, and for the orbit of another machine.

    >>> from orbits import sensitivities
    >>> from problems import Hopper
    >>> round(sensitivities(Hopper("cubic"), 1, ["beta"], ["alpha"])["alpha"]["beta"], 6)
    -1.425744
    """
    check_parameters(machine)
    if tune is not None or at is not None:
        machine = with_tuning(machine, tune, at, ())
    names_of_designs(machine)  # raises for a machine that cannot be designed, before an orbit is searched for
    machine, orbit = known_motion(machine, orbit, start)
    tuned = tuned_numbers(machine)
    varied = [name for name in free_parameters(machine) if name not in tuned]
    names = varied if names is None else list_of_names("names", names)
    check_varied(machine, names)
    quantities = _requested(machine, orbit, quantities)
    words, parameters = machine_in_words(machine), {name: machine.values[name] for name in names}
    if not quantities:
        return Sensitivities(words, {}, {}, parameters)
    with interrupts.deferred():
        point = _formulas_at(machine, orbit, quantities, names)
    slopes = {
        each: dict(zip(names, row, strict=True)) for each, row in zip(quantities, point.slopes.tolist(), strict=False)
    }
    return Sensitivities(words, slopes, dict(zip(quantities, point.values.tolist(), strict=False)), parameters)


def check_varied(machine: Machine, names: Sequence[str]) -> None:
    """Raise `InputError` where derivatives cannot be by parameters of these names: unknown ones, tuned ones, and
    parameters that follow from others."""
    if held := [name for name in names if name in tuned_numbers(machine)]:
        raise InputError(f"'{held[0]}' is tuned and follows from the others: name it among the quantities instead")
    # The machine itself determines which of its parameters follow from others.
    machine.with_values(**{name: machine.values[name] for name in names if name in machine.values})
    own = untuned(machine)
    check_parameters(own, *(name for name in names if name in own.values or name not in machine.values))


def known_motion(machine: Machine, orbit: Orbit | int, start: StartLike | None) -> tuple[Machine, Orbit]:
    """A machine, with tuned values if any, and its orbit, which is stated itself, by the number of its family, or by a
    start; raises `InputError` for two."""
    known = orbit if isinstance(orbit, Orbit) else start
    if isinstance(orbit, Orbit) and start is not None:
        raise InputError("the orbit is given twice, by itself and by start=: leave one of the two out")
    if isinstance(machine, TunedMachine):
        tuned, bare = first_of_tuned(machine, known, 1 if isinstance(orbit, Orbit) else orbit)
        return tuned, orbit_of(untuned(tuned), bare)
    if isinstance(orbit, Orbit):
        return machine, orbit
    check_start(machine, start)
    return machine, find(machine, orbit) if start is None else find(machine, start=start)


def _formulas_at(machine: Machine, orbit: Orbit, texts: Sequence[str], over: Sequence[str]) -> DesignPoint:
    """Formulas at an orbit, over some of the machine's parameters."""
    known = names_of_designs(machine)
    formulas = tuple(known_formula(text, known, "the quantity", machine) for text in texts)
    (point,) = design_points([Case(machine, orbit.dimensionless(), Outputs(formulas, tuple(over)), {})])
    if isinstance(point, OrbitsError):
        raise point
    return point


def values_at_orbits(machines: Sequence[Machine], orbits: Sequence[Orbit], names: Sequence[str]) -> np.ndarray:
    """Quantities (m, k) of these names at orbits of machines (m), NaN where an orbit does not have one."""
    found = np.full((len(orbits), len(names)), np.nan)
    for k, name in enumerate(names):
        if name in beyond_model(machines[0]):
            for i, (machine, orbit) in enumerate(zip(machines, orbits, strict=True)):
                with suppress(NoOrbit):
                    found[i, k] = beyond_model(machine)[name](orbit.alpha)
            continue
        outputs, pairs = Outputs((parse(name),), ()), zip(machines, orbits, strict=True)
        points = design_points([Case(machine, orbit.dimensionless(), outputs, {}) for machine, orbit in pairs])
        found[:, k] = [np.nan if isinstance(point, OrbitsError) else point.values[0] for point in points]
    return found


def _requested(machine: Machine, orbit: Orbit, names: Names) -> Sequence[str]:
    """The requested names, or all quantities that the orbit has; raises `InputError` for another machine's orbit."""
    if not isinstance(orbit, Orbit):
        raise InputError(f"orbit = {orbit!r}; it must be an orbit of the machine, such as find(machine) returns")
    if dict(orbit.machine) != machine_in_words(machine):
        raise InputError(f"the orbit belongs to another machine: {dict(orbit.machine)}")
    if not is_orbit_of(orbit, untuned(machine)):
        raise InputError(f"the orbit belongs to another machine: {OTHER_EQUATIONS}")
    if names is not None:
        return list_of_names("names", names)
    known, bare = quantity_names(machine.model, machine.values), orbit.dimensionless()
    if bare.contact is None:
        raise no_motion(machine, bare)
    (places,) = places_of([machine], [bare], {extreme for name in known for extreme in extremes_of(name)})
    known = [name for name in known if name not in OF_LOSS or has_loss(machine, bare)]
    known = [name for name in known if all(places[extreme] for extreme in extremes_of(name))]
    return [*known, *tuned_numbers(machine)]
