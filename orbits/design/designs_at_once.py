"""Many designs of a machine together: the orbit of each, its quantities, and the reasons why some have none."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, NoOrbit, OrbitsError, shortened
from ..model.machine import Machine
from ..model.model import Model
from ..periodic.certified import Certified, certified
from ..periodic.continued import AT_FOLD, NOT_REACHED, continued, continued_tuned, orbit_from_unknowns
from ..periodic.find import find, first_tuned
from ..periodic.orbit import Orbit, orbit_of
from ..periodic.orbits_at_once import certified_near, lowest_orbits, motions_together
from ..periodic.quantities import OF_RUNS, names_of_many, numbers_of
from ..periodic.stated_start import StartLike, in_units_of
from ..periodic.tuned import Tuning, errors_of_tuned, tuning_of
from ..running import interrupts
from ..shooting.formulations import equations_of, iterative, method_of
from ..symbolic.formula import Formula, parse
from ..units import Units, in_units
from .sensitivities import quantities
from .tuned_machine import start_of_tuned

# The statuses of a design.
DESIGN_STATUSES = ("certified", "inadmissible", "no orbit", "failed")
STATUSES_OF_ORBITS = DESIGN_STATUSES[:2]  # of motions, and of those with violations
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
    left = _solved_in_lanes(machine, designs, family, formulas, report).tolist()
    for done, i in enumerate(left, count - len(left)):
        interrupts.heed()
        report(done)
        _solve_alone(machine, designs, i, family, formulas)
    return designs


def settled_designs(
    machine: Machine, names: Sequence[str], values: np.ndarray, family: int, near: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The statuses (m,) of those designs (m, k) that are settled together, "" for the others; the unknowns (m, n) of
    their orbits by the simplest method, and the errors (m,) of the launch speeds as shares of these, NaN for none.

    These are the orbits of least launch speed, or those to which Newton's method converges from unknowns `near`
    (m, n), which need not be the lowest of the family.
    """
    designs = Designs(tuple(names), values, {}, *np.full((2, len(values)), "", dtype=object))
    base = designs.machine(machine, 0)
    own, method = tuple(base.values), iterative(method_of(base.model))
    equations = equations_of(base.model, method, own)
    us, errors = np.full((len(values), equations.size), np.nan), np.full(len(values), np.nan)
    size = motions_together(family)
    if not equations.in_lanes or not {*names} <= {*own}:
        return designs.statuses, us, errors
    for first in range(0, len(values), size):
        interrupts.heed()
        some = np.arange(first, min(first + size, len(values)))
        ps, absent = _parameters_of(base, designs, some), dict[int, NoOrbit]()
        if near is None:
            parts, absent = lowest_orbits(base.model, own, ps, family)
        else:
            found = certified_near(base.model, own, ps, near[some], family)
            parts = [found] if found else []
        for orbits in parts:
            which, places = some[orbits.which], orbits.places
            us[which] = np.column_stack([orbits.cycles.u[name][places] for name in equations.statement.unknowns])
            errors[which] = orbits.certificates.column("error")[places] / orbits.alphas
            violations = orbits.certificates.column("violations")
            designs.statuses[which] = [STATUSES_OF_ORBITS[bool(violations[place])] for place in places.tolist()]
        designs.statuses[some[[*absent]]] = "no orbit"
    return designs.statuses, us, errors


def columns_of_tuned(model: Model, names: Sequence[str]) -> tuple[str, ...]:
    """The numbers of orbits with tuned parameters of these names, besides those of all orbits: the tuned values with
    bounds on their errors, what machines that go forward have, and whether an orbit is admissible, as 1 or 0."""
    runs = (*OF_RUNS, "friction_needed") if model.sticks else ()
    return (*names, *(f"{name}_error" for name in names), *runs, "admissible")


def no_designs(
    machine: Machine, names: Sequence[str], values: np.ndarray, tuning: Tuning, formulas: Mapping[str, Formula]
) -> Designs:
    """Designs (m, k) whose orbits with tuned parameters are not found yet."""
    columns = ("alpha", "flight_time", "error", "family", *columns_of_tuned(machine.model, tuning.names), *formulas)
    numbers = {name: np.full(len(values), np.nan) for name in columns}
    return Designs(tuple(names), values, numbers, *np.full((2, len(values)), "", dtype=object))


def tuned_designs(
    machine: Machine,
    names: Sequence[str],
    values: np.ndarray,
    family: int,
    tuning: Tuning,
    formulas: Mapping[str, Formula],
    start: StartLike | None = None,
    report: Callable[[int], None] = lambda done: None,
) -> Designs:
    """The orbits with tuned parameters of designs (m, k), as `solved_designs`, with the `columns_of_tuned`.

    They are continued from the orbit of the machine itself, which is that of a family or found from a start. Where it
    has none, each is found as by `find`.
    """
    designs = no_designs(machine, names, values, tuning, formulas)
    try:
        _, known = first_tuned(machine, start, family, tuning.names, tuning.values)
    except NoOrbit:
        for i in range(len(values)):
            interrupts.heed()
            report(i)
            _tune_alone(designs, i, machine, start, family, tuning, formulas)
        return designs
    own = _parameters_of_all(machine, designs)
    ps = np.hstack([own, np.tile(known.ps[0, own.shape[1] :], (len(own), 1))])
    found = continued_tuned(known, ps, _varied(machine, designs), report)
    for name in tuning.names:
        designs.numbers[f"{name}_error"][:] = found.errors(name)
    parts, stopped = found.certified()
    for orbits in parts:
        fill_in_tuned(machine, designs, orbits.which, orbits, tuning, formulas)
    for i, (status, reason) in stopped.items():
        designs.statuses[i], designs.reasons[i] = status, reason
    return designs


def tuned_orbit(
    machine: Machine, over: Mapping[str, float], family: int, tune: Sequence[str], at: Mapping[str, float],
    start: StartLike | None,
) -> Orbit:  # fmt: skip
    """The orbit with tuned parameters of the machine with other values of the parameters `over`, as `tuned_designs`
    reaches it."""
    tuning, other = tuning_of(machine, tune, at), machine.with_values(**over)
    try:
        _, known = first_tuned(machine, start, family, tuning.names, tuning.values)
    except NoOrbit:
        return find(other, None if start else family, start=start, tune=tune, at=at)
    ps = np.array([[*other.values.values(), *known.ps[0, len(machine.values) :]]])
    found = continued_tuned(known, ps, tuple(over) if {*over} <= machine.values.keys() else (*machine.values,))
    if 0 in found.stopped:
        raise NoOrbit(found.stopped[0][1])
    own, near = start_of_tuned(other, tuning, known.equations, found.unknowns[0])
    return find(own, start=near, tune=tune, at=at)


def _tune_alone(
    designs: Designs, i: int, machine: Machine, start: StartLike | None, family: int, tuning: Tuning,
    formulas: Mapping[str, Formula],
) -> None:  # fmt: skip
    """Fill in one design as `find` tunes it."""
    try:
        varied = designs.machine(machine, i)
        _, solved = first_tuned(varied, start, family, tuning.names, tuning.values)
        orbits, refused = certified(solved)
        if orbits is None:
            raise refused[0]
        errors = errors_of_tuned(solved)
    except OrbitsError as error:
        designs.statuses[i], designs.reasons[i] = "failed" if isinstance(error, InputError) else "no orbit", str(error)
        return
    for name, bound in errors.items():
        if name in tuning.names:
            designs.numbers[f"{name}_error"][i] = bound
    fill_in_tuned(machine, designs, np.array([i]), orbits, tuning, formulas)


def fill_in_tuned(
    machine: Machine, designs: Designs, which: np.ndarray, orbits: Certified, tuning: Tuning,
    formulas: Mapping[str, Formula],
) -> None:  # fmt: skip
    """Write orbits with tuned parameters to their designs; those with values that the machine cannot have are none."""
    known = names_together(machine)
    together = {text: formula for text, formula in formulas.items() if formula.names <= known}
    runs = {name: parse(name) for name in designs.numbers if name in (*OF_RUNS, "friction_needed")}
    _fill_in(designs, which, machine.model, orbits, {**runs, **together})
    for name in tuning.names:
        designs.numbers[name][which] = np.broadcast_to(orbits.cycles.p[name], len(orbits.cycles))[orbits.places]
    designs.numbers["admissible"][which] = designs.statuses[which] == "certified"
    alone = {text: formula for text, formula in formulas.items() if text not in together}
    for i, place in zip(which.tolist(), orbits.places.tolist(), strict=True):
        tuned = {name: float(designs.numbers[name][i]) for name in tuning.names}
        try:
            own = designs.machine(machine, i).with_values(**tuned)
        except InputError as error:
            designs.statuses[i], designs.reasons[i] = "no orbit", f"the tuned values are none of a machine: {error}"
            for name, column in designs.numbers.items():
                column[i] = column[i] if name in designs.names else np.nan
            continue
        if alone:
            interrupts.heed()
            with suppress(NoOrbit):  # what is not certified alone has no such numbers
                u = {name: float(orbits.cycles.u[name][place]) for name in own.model.half_unknowns}
                _fill_in_formulas(designs, i, own, find(own, start=in_units_of(own, u)), alone)


def _solved_in_lanes(
    machine: Machine, designs: Designs, family: int, formulas: Mapping[str, Formula], report: Callable[[int], None]
) -> np.ndarray:
    """Fill in the designs whose orbits are found together, and return the others; `report` as in `solved_designs`.

    Machines that differ in numbers alone share a model, or few models where their laws vary so finely that integration
    steps are bounded.
    """
    used, tried = set().union(*(formula.names for formula in formulas.values())), set[Model]()
    left = np.arange(len(designs.values))
    for i in range(len(designs.values)):
        if designs.statuses[i] != "":
            continue
        interrupts.heed()
        base = designs.machine(machine, i)
        if base.model in tried or not {*designs.names, *used} <= names_together(base):
            continue
        tried.add(base.model)
        size = motions_together(family)
        for some in (left[first : first + size] for first in range(0, len(left), size)):
            interrupts.heed()
            report(int(np.count_nonzero(designs.statuses != "")))
            ps = _parameters_of(base, designs, some)
            try:
                parts, absent = lowest_orbits(base.model, tuple(base.values), ps, family)
            except Exception:  # a defect that one design causes: each of them is then solved alone
                continue
            for orbits in parts:
                _fill_in(designs, some[orbits.which], base.model, orbits, formulas)
            for k, error in absent.items():
                own = _units_at(base.model, dict(zip(base.values, ps[k].tolist(), strict=True)))
                designs.statuses[some[k]], designs.reasons[some[k]] = "no orbit", str(shortened(in_units(error, own)))
        left = left[designs.statuses[left] == ""]
    return left


def names_together(machine: Machine) -> set[str]:
    """The names of what is computed for many orbits together, and of the machine's parameters."""
    return {*names_of_many(machine.model), *machine.model.rises(machine.values), *machine.values}


def _parameters_of(machine: Machine, designs: Designs, which: np.ndarray) -> np.ndarray:
    """The parameters (k, np) of the machine's model for some designs (k,)."""
    ps = np.tile(list(machine.values.values()), (len(which), 1))
    ps[:, [list(machine.values).index(name) for name in designs.names]] = designs.values[which]
    return ps


def _varied(machine: Machine, designs: Designs) -> tuple[str, ...]:
    """The names of the model's parameters in which designs differ."""
    return designs.names if {*designs.names} <= machine.values.keys() else (*machine.values,)


def _parameters_of_all(machine: Machine, designs: Designs) -> np.ndarray:
    """The parameters (m, np) of the machine's model for all designs (m,)."""
    each = np.arange(len(designs.values))
    if {*designs.names} <= machine.values.keys():
        return _parameters_of(machine, designs, each)
    # Names of which the model's parameters are functions.
    return np.array([[*designs.machine(machine, i).values.values()] for i in each.tolist()])


def _continue(
    machine: Machine, start: Orbit, designs: Designs, formulas: Mapping[str, Formula], report: Callable[[int], None]
) -> None:
    """Fill in designs whose orbits are continued from the machine's own orbit."""
    ps = _parameters_of_all(machine, designs)
    found, known = continued(machine, start, ps, _varied(machine, designs), report), names_together(machine)
    together = {text: formula for text, formula in formulas.items() if formula.names <= known}
    alone = {text: formula for text, formula in formulas.items() if text not in together}
    parts, stopped = found.certified()
    for orbits in parts:
        _fill_in(designs, orbits.which, machine.model, orbits, together)
        for i in orbits.which.tolist() if alone else ():
            interrupts.heed()
            own = designs.machine(machine, i)
            with suppress(NoOrbit):  # what is not certified alone has no such numbers
                _fill_in_formulas(designs, i, own, orbit_of(own, orbit_from_unknowns(own, found.unknowns[i])), alone)
    for i, (status, reason) in stopped.items():
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
    designs.statuses[i] = STATUSES_OF_ORBITS[bool(violations)]
    designs.reasons[i] = "; ".join(violations)


def _finite(values: Any) -> object:
    """The values, with NaN in place of values that are not finite."""
    return np.where(np.isfinite(values), values, np.nan)
