"""Many designs of a machine together: the orbit of each, its quantities, and the reasons why some have none."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, OrbitsError, shortened
from ..model.machine import Machine
from ..model.model import Model
from ..periodic.certified import Certified
from ..periodic.find import find
from ..periodic.orbits_at_once import lowest_orbits
from ..periodic.quantities import OF_MANY, numbers_of
from ..running import interrupts
from ..symbolic.formula import Formula
from ..units import Units, in_units
from .sensitivities import quantities

# The statuses of a design.
DESIGN_STATUSES = ("certified", "inadmissible", "no orbit", "failed")


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
    machine: Machine, names: Sequence[str], values: np.ndarray, family: int, formulas: Mapping[str, Formula]
) -> Designs:
    """The orbits of a family for designs (m, k), with formulas of their quantities and parameters by name.

    Designs are solved together where possible, else one by one by `find`, and none depends on the others.
    """
    count, columns = len(values), ("alpha", "flight_time", "error", "family", *formulas)
    numbers = {name: np.full(count, np.nan) for name in columns}
    designs = Designs(tuple(names), values, numbers, *np.full((2, count), "", dtype=object))
    for i in _solved_in_lanes(machine, designs, family, formulas).tolist():
        interrupts.heed()
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
        known = {*OF_MANY, *base.model.rises(base.values), *base.values}
        if base.model in tried or not {*designs.names, *used} <= known:
            continue
        tried.add(base.model)
        places = [list(base.values).index(name) for name in designs.names]
        ps = np.tile(list(base.values.values()), (len(left), 1))
        ps[:, places] = designs.values[left]
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


def _fill_in(
    designs: Designs, which: np.ndarray, model: Model, orbits: Certified, formulas: Mapping[str, Formula]
) -> None:
    """Write orbits that were found together to their designs."""
    p, places = orbits.cycles.p, orbits.places
    columns = [name for name in designs.numbers if name not in formulas]
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
    for text, formula in formulas.items():
        own = varied.values
        try:
            known = quantities(varied, orbit, [name for name in formula.names if name not in own])
            numbers[text][i] = _finite(formula(**{name: {**own, **known}[name] for name in formula.names}))
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
