"""What the members of a sweep answer: a chunk of them solved together, and by `find` those that ask for more."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from ..design.problem import formula_names, known_formula
from ..design.sensitivities import quantities
from ..errors import InputError, OrbitsError
from ..hybrid.return_map import ReturnMap
from ..model.machine import ImpactingMachine, Machine
from ..model.model import Model
from ..model.units import in_units
from ..periodic.find import find
from ..periodic.many import NUMBERS_OF_MANY, Orbits, numbers_of, orbits_of_many
from ..symbolic import interrupts
from ..symbolic.formula import Formula
from .question import LAUNCH_SPEED, Question, Table, empty_table


def solve_chunk(question: Question, members: np.ndarray) -> Table:
    """The answers of some members (k,) of a question."""
    table = _unanswered(question, members)
    {"find": _found, "map": _launched, "fixed_points": _fixed}[question.outcome](question, table)
    return table


def failed_table(question: Question, members: np.ndarray, reason: str) -> Table:
    """The answers of members over which the worker has died."""
    table = _unanswered(question, members)
    table.columns["status"][:], table.columns["reason"][:] = "failed", reason
    return table


def _unanswered(question: Question, members: np.ndarray) -> Table:
    """A table of some members with nothing but their parameters."""
    table = empty_table(len(members), question.columns())
    table.members[:] = members
    values = question.members.values[members // len(question.families)]
    for name, column in zip(question.members.names, values.T, strict=True):
        table.columns[name][:] = column
    return table


def _found(question: Question, table: Table) -> None:
    """The orbits: all that can be are solved together, then the others one by one."""
    families = np.array(question.families)[table.members % len(question.families)]
    for family in question.families:
        rows = np.flatnonzero(families == family)
        left = _found_together(question, table, rows, family)
        for row in left.tolist():
            interrupts.check()
            _found_alone(question, table, row, family)


def _found_together(question: Question, table: Table, rows: np.ndarray, family: int) -> np.ndarray:
    """Fill in the rows whose orbits are found together, and return the others.

    Machines that differ in numbers alone share a model, or few models where their laws vary so finely that integration
    steps are bounded.
    """
    formulas, tried, left = _formulas(question), set[Model](), rows
    for row in rows.tolist():
        if row not in left:
            continue
        base = _machine_at(question, table, row)
        names = set().union(*(formula.names for formula in formulas.values())) - base.values.keys()
        if base.model in tried or not names <= {*NUMBERS_OF_MANY, *base.model.rises(base.values)}:
            continue
        tried.add(base.model)
        ps = np.tile(list(base.values.values()), (len(left), 1))
        for name in question.members.names:
            ps[:, list(base.values).index(name)] = table.columns[name][left]
        if orbits := orbits_of_many(base.model, tuple(base.values), ps, family):
            _fill_in(table, left[orbits.which], base.model, orbits, family, formulas)
            left = np.delete(left, orbits.which)
    return left


def _fill_in(
    table: Table, rows: np.ndarray, model: Model, orbits: Orbits, family: int, formulas: Mapping[str, Formula]
) -> None:
    """Write orbits that were found together into their rows."""
    columns, p = table.columns, orbits.cycles.p
    wanted = {"error"}.union(*(formula.names for formula in formulas.values()))
    numbers = numbers_of(model, orbits, model.units and model.units(p), wanted)
    for name in ("alpha", "flight_time", "error"):
        columns[name][rows] = numbers[name]
    columns["family"][rows] = family
    for text, formula in formulas.items():
        with np.errstate(all="ignore"):
            columns[text][rows] = _finite(formula(**{name: {**p, **numbers}[name] for name in formula.names}))
    for i, (row, certificate) in enumerate(zip(rows.tolist(), orbits.certificates, strict=True)):
        own = model.units and model.units({name: float(values[i]) for name, values in p.items()})
        _judge(table, row, tuple(in_units(text, own) for text in certificate.violations))


def _found_alone(question: Question, table: Table, row: int, family: int) -> None:
    """Fill in one row by `find`."""
    columns = table.columns
    try:
        machine = _machine_at(question, table, row)
        orbit = find(machine, family)
    except OrbitsError as error:
        columns["status"][row], columns["reason"][row] = "no orbit", str(error)
        return
    except Exception as error:  # a defect that one member meets, which is not to cost the others their answers
        columns["status"][row], columns["reason"][row] = "failed", f"{type(error).__name__}: {error}"
        return
    columns["alpha"][row], columns["flight_time"][row] = orbit.alpha, orbit.flight_time
    columns["error"][row], columns["family"][row] = orbit.error, orbit.family
    _judge(table, row, orbit.violations)
    for text in question.quantities:
        try:
            columns[text][row] = _finite(quantities(machine, orbit, [text])[text])
        except InputError:
            raise
        except OrbitsError:
            pass  # the orbit does not have it


def _judge(table: Table, row: int, violations: Sequence[str]) -> None:
    """Write whether an orbit is a motion, and why not."""
    table.columns["status"][row] = "inadmissible" if violations else "certified"
    table.columns["reason"][row] = "; ".join(violations)


def _finite(values: Any) -> Any:
    """The values, NaN for those that are not finite."""
    return np.where(np.isfinite(values), values, np.nan)


def _formulas(question: Question) -> dict[str, Formula]:
    """The quantities that are asked for, by their text."""
    known = formula_names(question.machine) if question.quantities else ()
    return {text: known_formula(text, known, "the quantity") for text in question.quantities}


def _machine_at(question: Question, table: Table, row: int) -> Machine:
    """The machine of a row."""
    names = (name for name in question.members.names if name != LAUNCH_SPEED)
    return question.machine.with_values(**{name: float(table.columns[name][row]) for name in names})


def _return_map(question: Question, table: Table, row: int) -> ReturnMap:
    """The return map of the machine of a row."""
    return ReturnMap(cast(ImpactingMachine, _machine_at(question, table, row)))


def _launched(question: Question, table: Table) -> None:
    """The next launch: launches of the same machine are mapped together."""
    own = [name for name in question.members.names if name != LAUNCH_SPEED]
    values = np.column_stack([table.columns[name] for name in own]) if own else np.zeros((len(table.members), 0))
    _, first, group = np.unique(values, axis=0, return_index=True, return_inverse=True)
    for k in range(len(first)):
        interrupts.check()
        rows = np.flatnonzero(group.ravel() == k)
        try:
            hops = _return_map(question, table, int(first[k]))(table.columns[LAUNCH_SPEED][rows])
        except OrbitsError as error:
            table.columns["status"][rows], table.columns["reason"][rows] = "no orbit", str(error)
            continue
        for name in ("next", "loss", "impacts", "status"):
            table.columns[name][rows] = getattr(hops, name)


def _fixed(question: Question, table: Table) -> None:
    """The fixed points of the return map: their number, and the lowest stable one, or else the lowest."""
    assert question.between is not None
    for row in range(len(table.members)):
        interrupts.check()
        try:
            found = _return_map(question, table, row).fixed_points(*question.between)
        except OrbitsError as error:
            table.columns["status"][row], table.columns["reason"][row] = "no orbit", str(error)
            continue
        table.columns["count"][row] = len(found)
        table.columns["status"][row] = "certified" if found else "no orbit"
        table.columns["reason"][row] = "" if found else "the return map has no fixed point between these launch speeds"
        if found:
            best = min(found, key=lambda point: (point.multiplier is None or abs(point.multiplier) >= 1, point.alpha))
            table.columns["alpha"][row] = best.alpha
            table.columns["multiplier"][row] = np.nan if best.multiplier is None else best.multiplier
