"""Quantities of an orbit, and their exact derivatives by the parameters of its machine."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

from ..consistency.accepted import check_parameters
from ..errors import InputError, OrbitsError, list_of_names
from ..model.machine import Machine, free_parameters, machine_in_words
from ..periodic.find import find
from ..periodic.orbit import OTHER_EQUATIONS, Orbit, is_orbit_of, orbit_of
from ..periodic.stated_start import StartLike, check_start
from ..running import interrupts
from ..running.exclusive import exclusive
from .design_point import Case, DesignPoint, design_points, has_loss, no_motion
from .design_quantities import extremes_of, quantity_names
from .extremes import places_of
from .problem import Outputs, known_formula
from .slopes import Sensitivities
from .tuned_machine import (
    TunedMachine,
    first_of_tuned,
    names_of_designs,
    tuned_numbers,
    tuning_of_designs,
    untuned,
)

# Requested names, one or a list; None for all.
Names: TypeAlias = str | Sequence[str] | None


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
    names = _requested(machine, orbit, names)
    if not names:
        return {}
    return dict(zip(names, _formulas_at(machine, orbit, names, ()).values.tolist(), strict=False))


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
    quantities : of the orbit, or formulas of these, one or a list; None for all that it has
    start : as in `find`, of the orbit, in place of the number of its family
    tune, at : as in `optimize`. The derivatives are then by the parameters that are not tuned and by the prescribed
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
        tuning = tuning_of_designs(machine, tune, at, ())
        machine = TunedMachine(machine, tuning.names, tuning.at)
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
    """Raise `InputError` where derivatives cannot be by parameters of these names: unknown ones, tuned ones, and those
    that follow from others."""
    if held := [name for name in names if name in tuned_numbers(machine)]:
        raise InputError(f"'{held[0]}' is tuned and follows from the others: it is one of the quantities")
    # The machine itself determines which of its parameters follow from others.
    machine.with_values(**{name: machine.values[name] for name in names if name in machine.values})
    own = untuned(machine)
    check_parameters(own, *(name for name in names if name in own.values or name not in machine.values))


def known_motion(machine: Machine, orbit: Orbit | int, start: StartLike | None) -> tuple[Machine, Orbit]:
    """A machine, with tuned values if any, and its orbit, which is stated itself, by the number of its family, or by a
    start; raises `InputError` for two."""
    known = orbit if isinstance(orbit, Orbit) else start
    if isinstance(orbit, Orbit) and start is not None:
        raise InputError("an orbit, or the one near start=, is needed: leave one of the two out")
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
    formulas = tuple(known_formula(text, known, "the quantity") for text in texts)
    (point,) = design_points([Case(machine, orbit.dimensionless(), Outputs(formulas, tuple(over)), {})])
    if isinstance(point, OrbitsError):
        raise point
    return point


def _requested(machine: Machine, orbit: Orbit, names: Names) -> Sequence[str]:
    """The requested names, or all quantities that the orbit has; raises `InputError` for another machine's orbit."""
    if not isinstance(orbit, Orbit):
        raise InputError(f"orbit = {orbit!r}; it is an orbit of the machine, as find(machine) returns")
    if dict(orbit.machine) != machine_in_words(machine):
        raise InputError(f"the orbit is another machine's: {dict(orbit.machine)}")
    if not is_orbit_of(orbit, untuned(machine)):
        raise InputError(f"the orbit is another machine's: {OTHER_EQUATIONS}")
    if names is not None:
        return list_of_names("names", names)
    known, bare = quantity_names(machine.model, machine.values), orbit.dimensionless()
    if bare.contact is None:
        raise no_motion(machine, bare)
    (places,) = places_of([machine], [bare], {extreme for name in known for extreme in extremes_of(name)})
    known = [name for name in known if name != "loss_coefficient" or has_loss(machine, bare)]
    known = [name for name in known if all(places[extreme] for extreme in extremes_of(name))]
    return [*known, *tuned_numbers(machine)]
