"""Many designs of a machine together: the orbit of each, its quantities, and the reasons why some have none."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, NoOrbit, OrbitsError, shortened
from ..model import Machine, Model
from ..periodic import (
    AT_FOLD,
    NOT_REACHED,
    OF_RUNS,
    Certified,
    Continued,
    Orbit,
    StartLike,
    Tuning,
    absent_quantities,
    certified_near,
    continued,
    continued_tuned,
    errors_of_tuned,
    find,
    first_tuned,
    in_units_of,
    lowest_orbits,
    motions_together,
    names_of_many,
    numbers_of,
    orbit_from_unknowns,
    orbit_of,
    tuning_of,
)
from ..running import interrupts
from ..shooting import equations_of, iterative, method_of
from ..symbolic import Formula, parse
from ..units import Units, in_units
from .sensitivities import quantities
from .tuned_machine import start_of_tuned

# The statuses of a design.
DESIGN_STATUSES = ("certified", "inadmissible", "no orbit", "failed")
STATUSES_OF_ORBITS = DESIGN_STATUSES[:2]  # of motions, and of those with violations
# Those of designs whose orbits are continued from a start.
CONTINUED_STATUSES = (*DESIGN_STATUSES, AT_FOLD, NOT_REACHED)
COLUMNS = ("alpha", "flight_time", "error", "family")  # the numbers of all designs


class Designs(NamedTuple):
    """Designs (m,) of a machine `base`: its parameters (m, k) by `names`, and numbers (m,) of their orbits by name, NaN
    where there is none: alpha, flight_time, error, family, the `columns_of_tuned` and the formulas; their statuses, and
    the reasons for the statuses other than "certified"."""

    base: Machine
    names: tuple[str, ...]
    values: np.ndarray
    formulas: Mapping[str, Formula]
    tuned: tuple[str, ...]
    numbers: dict[str, np.ndarray]
    statuses: np.ndarray
    reasons: np.ndarray

    @classmethod
    def unsolved(
        cls, machine: Machine, names: Sequence[str], values: np.ndarray, formulas: Mapping[str, Formula],
        tuning: Tuning | None = None,
    ) -> "Designs":  # fmt: skip
        """Designs whose orbits are not found yet."""
        further = columns_of_tuned(machine.model, tuning.names) if tuning else ()
        numbers = {name: np.full(len(values), np.nan) for name in (*COLUMNS, *further, *formulas)}
        texts = np.full((2, len(values)), "", dtype=object)
        return cls(machine, tuple(names), values, formulas, tuning.names if tuning else (), numbers, *texts)

    def only(self, i: int) -> "Designs":
        """One design, whose numbers, status and reason are those of this one."""
        part = slice(i, i + 1)
        numbers = {name: column[part] for name, column in self.numbers.items()}
        own = self.values[part], self.formulas, self.tuned, numbers, self.statuses[part], self.reasons[part]
        return Designs(self.base, self.names, *own)

    def machine(self, i: int) -> Machine:
        """The machine of a design, with its tuned values where these are known."""
        values = dict(zip(self.names, self.values[i].tolist(), strict=True))
        values |= {name: x for name in self.tuned if np.isfinite(x := float(self.numbers[name][i]))}
        return self.base.with_values(**values)

    @property
    def varied(self) -> tuple[str, ...]:
        """The names of the model's parameters in which the designs differ."""
        return self.names if {*self.names} <= self.base.values.keys() else (*self.base.values,)

    def parameters(self) -> np.ndarray:
        """The parameters (m, np) of the machine's model."""
        each = np.arange(len(self.values))
        if {*self.names} <= self.base.values.keys():
            return _parameters_of(self.base, self, each)
        # Names on which the model's parameters depend.
        return np.array([[*self.machine(i).values.values()] for i in each.tolist()])

    def refuse(self, i: int, error: Exception) -> None:
        """Write why a design has no orbit; a defect of one design must not affect the others."""
        known = isinstance(error, OrbitsError)
        self.statuses[i] = "no orbit" if known and not isinstance(error, InputError) else "failed"
        self.reasons[i] = str(error) if known else f"{type(error).__name__}: {error}"

    def judge(self, i: int, violations: Sequence[str]) -> None:
        """Write whether an orbit is a motion, and why not."""
        self.statuses[i] = STATUSES_OF_ORBITS[bool(violations)]
        self.reasons[i] = "; ".join(violations)


def solved_designs(
    machine: Machine,
    names: Sequence[str],
    values: np.ndarray,
    family: int,
    formulas: Mapping[str, Formula],
    start: Any = None,
    report: Callable[[int], None] = lambda done: None,
    tuning: Tuning | None = None,
    method: str | None = None,
) -> Designs:
    """The orbits of a family for designs (m, k), with formulas of their quantities and parameters by name.

    start : the machine's own orbit, from which those of the designs are then continued, of whatever family; with tuned
        parameters also a start of `find` for that orbit, from which they are always continued
    report : called with the number of designs that are done
    tuning : the parameters that are tuned for each design; None for none
    method : of `find`, for each design alone

    Designs are solved together without a method where possible, else one by one by `find`, and none depends on the
    others.
    """
    designs = Designs.unsolved(machine, names, values, formulas, tuning)
    if tuning:
        _continue_tuned(designs, start, family, tuning, report)
    elif start is not None:
        _fill_in_continued(designs, continued(machine, start, designs.parameters(), designs.varied, report))
    else:
        left = [*range(len(values))] if method else _solved_in_lanes(designs, family, report).tolist()
        for done, i in enumerate(left, len(values) - len(left)):
            interrupts.heed()
            report(done)
            _solve_alone(designs, i, family, method)
    return designs


def settled_designs(
    machine: Machine, names: Sequence[str], values: np.ndarray, family: int, near: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The statuses (m,) of those designs (m, k) that are settled together, "" for the others; the unknowns (m, n) of
    their orbits by the simplest method, and the errors (m,) of the launch speeds as shares of these, NaN for none.

    These are the orbits of least launch speed, or those to which Newton's method converges from unknowns `near`
    (m, n), which need not be the lowest of the family.
    """
    designs = Designs.unsolved(machine, names, values, {})
    base = designs.machine(0)
    own, method = tuple(base.values), iterative(method_of(base.model))
    equations = equations_of(base.model, method, own)
    us, errors = np.full((len(values), equations.size), np.nan), np.full(len(values), np.nan)
    size = motions_together(base.model, own, family)
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


def _continue_tuned(
    designs: Designs, start: StartLike | None, family: int, tuning: Tuning, report: Callable[[int], None]
) -> None:
    """Fill in designs whose orbits with tuned parameters are continued from that of the machine itself; where it has
    none, each is found on its own."""
    try:
        _, known = first_tuned(designs.base, start, family, tuning.names, tuning.values)
    except NoOrbit:
        for i in range(len(designs.values)):
            interrupts.heed()
            report(i)
            one = designs.only(i)
            try:
                _, own = first_tuned(one.machine(0), start, family, tuning.names, tuning.values)
                errors_of_tuned(own)  # refuses a number that the orbit does not determine
                _fill_in_continued(one, Continued(own.us, {}, [(np.zeros(1, int), own)]))
            except OrbitsError as error:
                one.refuse(0, error)
        return
    own_ps = designs.parameters()
    ps = np.hstack([own_ps, np.tile(known.ps[0, own_ps.shape[1] :], (len(own_ps), 1))])
    _fill_in_continued(designs, continued_tuned(known, ps, designs.varied, report))


def _fill_in_continued(designs: Designs, found: Continued) -> None:
    """Write continued orbits to their designs, and the reasons of the others."""
    for name in designs.tuned:
        designs.numbers[f"{name}_error"][:] = found.errors(name)
    together = names_together(designs.base)
    alone = {text: formula for text, formula in designs.formulas.items() if not formula.names <= together}
    parts, stopped = found.certified()
    for orbits in parts:
        _fill_in(designs, orbits.which, designs.base.model, orbits)
        pairs = zip(orbits.which.tolist(), orbits.places.tolist(), strict=True)
        for i, place in pairs if alone or designs.tuned else ():
            try:
                own = designs.machine(i)
            except InputError as error:
                designs.statuses[i], designs.reasons[i] = "no orbit", f"no machine has the tuned values: {error}"
                for column in designs.numbers.values():
                    column[i] = np.nan
                continue
            if alone:
                interrupts.heed()
                with suppress(NoOrbit):  # what is not certified alone has no such numbers
                    if designs.tuned:
                        u = {name: float(orbits.cycles.u[name][place]) for name in own.model.half_unknowns}
                        orbit = find(own, start=in_units_of(own, u))
                    else:
                        orbit = orbit_of(own, orbit_from_unknowns(own, found.unknowns[i]))
                    _fill_in_formulas(designs, i, orbit, alone)
    for i, (status, reason) in stopped.items():
        designs.statuses[i], designs.reasons[i] = status, reason


def tuned_orbit(
    machine: Machine, over: Mapping[str, float], family: int, tune: Sequence[str], at: Mapping[str, float],
    start: StartLike | None,
) -> Orbit:  # fmt: skip
    """The orbit with tuned parameters of the machine with other values of the parameters `over`, as `solved_designs`
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


def _solved_in_lanes(designs: Designs, family: int, report: Callable[[int], None]) -> np.ndarray:
    """Fill in the designs whose orbits are found together, and return the others; `report` as in `solved_designs`.

    Machines that differ in numbers alone share a model, or few models where their laws vary so finely that integration
    steps are bounded.
    """
    used, tried = set().union(*(formula.names for formula in designs.formulas.values())), set[Model]()
    left = np.arange(len(designs.values))
    for i in range(len(designs.values)):
        if designs.statuses[i] != "":
            continue
        interrupts.heed()
        base = designs.machine(i)
        if base.model in tried or not {*designs.names, *used} <= names_together(base):
            continue
        tried.add(base.model)
        size = motions_together(base.model, tuple(base.values), family)
        for some in (left[first : first + size] for first in range(0, len(left), size)):
            interrupts.heed()
            report(int(np.count_nonzero(designs.statuses != "")))
            ps = _parameters_of(base, designs, some)
            try:
                parts, absent = lowest_orbits(base.model, tuple(base.values), ps, family)
            except Exception:  # a defect that one design causes: each of them is then solved alone
                continue
            for orbits in parts:
                _fill_in(designs, some[orbits.which], base.model, orbits)
            for k, error in absent.items():
                own = _units_at(base.model, dict(zip(base.values, ps[k].tolist(), strict=True)))
                designs.statuses[some[k]], designs.reasons[some[k]] = "no orbit", str(shortened(in_units(error, own)))
        left = left[designs.statuses[left] == ""]
    return left


def names_together(machine: Machine) -> set[str]:
    """The names of what is computed for many orbits together, and of the machine's parameters."""
    model, p = machine.model, machine.values
    return ({*names_of_many(model), *model.of_heights(p)} - absent_quantities(model, p).keys()) | p.keys()


def _parameters_of(machine: Machine, designs: Designs, which: np.ndarray) -> np.ndarray:
    """The parameters (k, np) of the machine's model for some designs (k,)."""
    ps = np.tile(list(machine.values.values()), (len(which), 1))
    ps[:, [list(machine.values).index(name) for name in designs.names]] = designs.values[which]
    return ps


def _fill_in(designs: Designs, which: np.ndarray, model: Model, orbits: Certified) -> None:
    """Write orbits that were found together to their designs, with the formulas of what is known of these."""
    p, places, numbers = orbits.cycles.p, orbits.places, designs.numbers
    of_runs = {name: parse(name) for name in numbers if designs.tuned and name in (*OF_RUNS, "friction_needed")}
    formulas = {**{name: parse(name) for name in COLUMNS}, **of_runs, **designs.formulas}
    wanted = set().union(*(formula.names for formula in formulas.values()))
    units = model.units and model.units(p)
    known = {**p, **numbers_of(model, orbits.cycles, orbits.certificates, units, wanted)}
    for text, formula in formulas.items():
        if formula.names <= known.keys():
            with np.errstate(all="ignore"):
                numbers[text][which] = _finite(formula(**{name: known[name][places] for name in formula.names}))
    for name in designs.tuned:
        numbers[name][which] = np.broadcast_to(p[name], len(orbits.cycles))[places]
    all_violations = orbits.certificates.column("violations")
    for i, place in zip(which.tolist(), places.tolist(), strict=True):
        violations = all_violations[place]
        own = _units_at(model, {name: float(values[place]) for name, values in p.items()}) if violations else None
        designs.judge(i, tuple(in_units(text, own) for text in violations))
    if designs.tuned:
        numbers["admissible"][which] = designs.statuses[which] == "certified"


def _units_at(model: Model, p: Mapping[str, float]) -> Units | None:
    """The units of a machine with these parameters; None for a dimensionless machine."""
    return model.units and model.units(p)


def _solve_alone(designs: Designs, i: int, family: int, method: str | None) -> None:
    """Fill in one design by `find`."""
    try:
        orbit = find(designs.machine(i), family, method=method)
    except Exception as error:
        designs.refuse(i, error)
        return
    for name in COLUMNS:
        designs.numbers[name][i] = getattr(orbit, name)
    designs.judge(i, orbit.violations)
    _fill_in_formulas(designs, i, orbit, designs.formulas)


def _fill_in_formulas(designs: Designs, i: int, orbit: Orbit, formulas: Mapping[str, Formula]) -> None:
    """Write formulas at the orbit of one design."""
    machine = designs.machine(i)
    for text, formula in formulas.items():
        own = machine.values
        try:
            known = quantities(machine, orbit, [name for name in formula.names if name not in own])
            designs.numbers[text][i] = _finite(formula(**{name: {**own, **known}[name] for name in formula.names}))
        except InputError:
            raise
        except OrbitsError:
            pass  # the orbit does not have it


def _finite(values: Any) -> object:
    """The values, with NaN in place of values that are not finite."""
    return np.where(np.isfinite(values), values, np.nan)
