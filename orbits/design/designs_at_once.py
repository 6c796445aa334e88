"""Many designs of a machine together: the orbit of each, its quantities, and the reasons why some have none."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, NoOrbit, OrbitsError, shortened
from ..model.machine import Machine
from ..model.model import Model
from ..periodic.certified import Certified
from ..periodic.continued import AT_FOLD, NOT_REACHED, continued, orbit_from_unknowns
from ..periodic.find import find
from ..periodic.orbit import Orbit, orbit_of
from ..periodic.orbits_at_once import lowest_orbits
from ..periodic.quantities import names_of_many, numbers_of
from ..running import interrupts
from ..symbolic.formula import Formula
from ..units import Units, in_units
from .sensitivities import quantities

# The statuses of a design.
DESIGN_STATUSES = ("certified", "inadmissible", "no orbit", "failed")
# Those of designs whose orbits are continued from a start.
CONTINUED_STATUSES = (*DESIGN_STATUSES, AT_FOLD, NOT_REACHED)


class Designs(NamedTuple):
    """Designs (m,) of a machine: its parameters (m, k) by `names`, and numbers (m,) of their orbits by name, NaN where
    there is none: alpha, flight_time, error, family and the requested quantities; their statuses, and the reasons for
    the statuses other than "certified"."""

    names: tuple[str, ...]
    values: np.ndarray
    numbers: dict[str, np.ndarray]
    statuses: np.ndarray
    reasons: np.ndarray

    def machine(self, machine: Machine, i: int) -> Machine:
        """The machine with the parameters of a design."""
        return machine.with_values(**dict(zip(self.names, self.values[i].tolist(), strict=True)))


def solved_designs(
    machine: Machine,
    names: Sequence[str],
    values: np.ndarray,
    family: int,
    formulas: Mapping[str, Formula],
    start: Orbit | None = None,
    report: Callable[[int], None] = lambda done: None,
) -> Designs:
    """The orbits of a family for designs (m, k), with formulas of their quantities and parameters by name.

    start : the machine's own orbit, from which those of the designs are then continued, of whatever family
    report : called with the number of designs that are done

    Designs are solved together where possible, else one by one by `find`, and none depends on the others.
    """
    count, columns = len(values), ("alpha", "flight_time", "error", "family", *formulas)
    numbers = {name: np.full(count, np.nan) for name in columns}
    designs = Designs(tuple(names), values, numbers, *np.full((2, count), "", dtype=object))
    if start is not None:
        _continue(machine, start, designs, formulas, report)
        return designs
    left = _solved_in_lanes(machine, designs, family, formulas).tolist()
    for done, i in enumerate(left, count - len(left)):
        interrupts.heed()
        report(done)
        _solve_alone(machine, designs, i, family, formulas)
    return designs


def _solved_in_lanes(machine: Machine, designs: Designs, family: int, formulas: Mapping[str, Formula]) -> np.ndarray:
    """Fill in the designs whose orbits are found together, and return the others.

    Machines that differ in numbers alone share a model, or few models where their laws vary so finely that integration
    steps are bounded.
    """
    used, tried = set().union(*(formula.names for formula in formulas.values())), set[Model]()
    left = np.arange(len(designs.values))
    for i in range(len(designs.values)):
        if i not in left:
            continue
        base = designs.machine(machine, i)
        if base.model in tried or not {*designs.names, *used} <= _known_together(base):
            continue
        tried.add(base.model)
        ps = _parameters_of(base, designs, left)
        try:
            parts, absent = lowest_orbits(base.model, tuple(base.values), ps, family)
        except Exception:  # a defect that one design causes: each of them is then solved alone
            continue
        for orbits in parts:
            _fill_in(designs, left[orbits.which], base.model, orbits, formulas)
        for k, error in absent.items():
            own = _units_at(base.model, dict(zip(base.values, ps[k].tolist(), strict=True)))
            designs.statuses[left[k]], designs.reasons[left[k]] = "no orbit", str(shortened(in_units(error, own)))
        left = left[designs.statuses[left] == ""]
    return left


def _known_together(machine: Machine) -> set[str]:
    """The names of what is computed for many orbits together, and of the machine's parameters."""
    return {*names_of_many(machine.model), *machine.model.rises(machine.values), *machine.values}


def _parameters_of(machine: Machine, designs: Designs, which: np.ndarray) -> np.ndarray:
    """The parameters (k, np) of the machine's model for some designs (k,)."""
    ps = np.tile(list(machine.values.values()), (len(which), 1))
    ps[:, [list(machine.values).index(name) for name in designs.names]] = designs.values[which]
    return ps


def _continue(
    machine: Machine, start: Orbit, designs: Designs, formulas: Mapping[str, Formula], report: Callable[[int], None]
) -> None:
    """Fill in designs whose orbits are continued from the machine's own orbit."""
    each, varied = np.arange(len(designs.values)), designs.names
    if {*designs.names} <= machine.values.keys():
        ps = _parameters_of(machine, designs, each)
    else:  # names of which the model's parameters are functions
        varied, ps = (
            (*machine.values,),
            np.array([[*designs.machine(machine, i).values.values()] for i in each.tolist()]),
        )
    found, known = continued(machine, start, ps, varied, report), _known_together(machine)
    together = {text: formula for text, formula in formulas.items() if formula.names <= known}
    alone = {text: formula for text, formula in formulas.items() if text not in together}
    for orbits in found.parts:
        _fill_in(designs, orbits.which, machine.model, orbits, together)
        for i in orbits.which.tolist() if alone else ():
            interrupts.heed()
            own = designs.machine(machine, i)
            with suppress(NoOrbit):  # what is not certified alone has no such numbers
                _fill_in_formulas(designs, i, own, orbit_of(own, orbit_from_unknowns(own, found.unknowns[i])), alone)
    for i, (status, reason) in found.stopped.items():
        designs.statuses[i], designs.reasons[i] = status, reason


def _fill_in(
    designs: Designs, which: np.ndarray, model: Model, orbits: Certified, formulas: Mapping[str, Formula]
) -> None:
    """Write orbits that were found together to their designs."""
    p, places = orbits.cycles.p, orbits.places
    columns = ("alpha", "flight_time", "error", "family")
    wanted = set(columns).union(*(formula.names for formula in formulas.values()))
    units = model.units and model.units(p)
    known = {**p, **numbers_of(model, orbits.cycles, orbits.certificates, units, wanted)}
    for name in columns:
        designs.numbers[name][which] = known[name][places]
    all_violations = orbits.certificates.column("violations")
    for text, formula in formulas.items():
        with np.errstate(all="ignore"):
            designs.numbers[text][which] = _finite(formula(**{name: known[name][places] for name in formula.names}))
    for i, place in zip(which.tolist(), places.tolist(), strict=True):
        violations = all_violations[place]
        own = _units_at(model, {name: float(values[place]) for name, values in p.items()}) if violations else None
        _judge(designs, i, tuple(in_units(text, own) for text in violations))


def _units_at(model: Model, p: Mapping[str, float]) -> Units | None:
    """The units of a machine with these parameters; None for a dimensionless machine."""
    return model.units and model.units(p)


def _solve_alone(machine: Machine, designs: Designs, i: int, family: int, formulas: Mapping[str, Formula]) -> None:
    """Fill in one design by `find`."""
    numbers = designs.numbers
    try:
        varied = designs.machine(machine, i)
        orbit = find(varied, family)
    except InputError as error:
        designs.statuses[i], designs.reasons[i] = "failed", str(error)
        return
    except OrbitsError as error:
        designs.statuses[i], designs.reasons[i] = "no orbit", str(error)
        return
    except Exception as error:  # a defect that one design causes, which must not prevent the results of the others
        designs.statuses[i], designs.reasons[i] = "failed", f"{type(error).__name__}: {error}"
        return
    found = (orbit.alpha, orbit.flight_time, orbit.error, orbit.family)
    numbers["alpha"][i], numbers["flight_time"][i], numbers["error"][i], numbers["family"][i] = found
    _judge(designs, i, orbit.violations)
    _fill_in_formulas(designs, i, varied, orbit, formulas)


def _fill_in_formulas(designs: Designs, i: int, varied: Machine, orbit: Orbit, formulas: Mapping[str, Formula]) -> None:
    """Write the formulas at the orbit of one design."""
    for text, formula in formulas.items():
        own = varied.values
        try:
            known = quantities(varied, orbit, [name for name in formula.names if name not in own])
            designs.numbers[text][i] = _finite(formula(**{name: {**own, **known}[name] for name in formula.names}))
        except InputError:
            raise
        except OrbitsError:
            pass  # the orbit does not have it


def _judge(designs: Designs, i: int, violations: Sequence[str]) -> None:
    """Write whether an orbit is a motion, and why not."""
    designs.statuses[i] = "inadmissible" if violations else "certified"
    designs.reasons[i] = "; ".join(violations)


def _finite(values: Any) -> object:
    """The values, with NaN in place of values that are not finite."""
    return np.where(np.isfinite(values), values, np.nan)
