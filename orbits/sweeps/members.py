"""The results of the members of a sweep: a chunk is solved together, and by `find` the members that need more."""

from collections.abc import Callable

import numpy as np

from ..design import known_formula, solved_designs
from ..errors import OrbitsError
from ..periodic import find
from ..returns import ReturnMap
from ..running import exclusive, interrupts
from .question import LAUNCH_SPEED, Question, Table, empty_table, names_of_quantities


@exclusive
def solve_chunk(
    question: Question, members: np.ndarray, values: np.ndarray, report: Callable[[int], None] = lambda done: None
) -> Table:
    """The results of some members (k,) of a question, with their parameters (k, n); the question's own are not used.

    report : called with the number of members that are done
    """
    table = _unanswered(question, members, values)
    {"find": _found, "map": _launched, "fixed_points": _fixed}[question.outcome](question, table, report)
    return table


def failed_table(question: Question, members: np.ndarray, reason: str) -> Table:
    """The table of members whose worker has died."""
    table = _unanswered(question, members, question.values_of(members))
    table.columns["status"][:], table.columns["reason"][:] = "failed", reason
    return table


def _unanswered(question: Question, members: np.ndarray, values: np.ndarray) -> Table:
    """A table of some members with only their parameters."""
    table = empty_table(len(members), question.columns())
    table.members[:] = members
    for name, column in zip(question.members.names, values.T, strict=True):
        table.columns[name][:] = column
    return table


def _found(question: Question, table: Table, report: Callable[[int], None]) -> None:
    """The orbits of each family."""
    families = np.array(question.families)[table.members % len(question.families)]
    tuning, method = question.tuning, question.method
    known = names_of_quantities(question.machine, tuning) if question.quantities else ()
    formulas = {text: known_formula(text, known, "the quantity", question.machine) for text in question.quantities}
    own = question.start is not None and not tuning
    start = find(question.machine, start=question.start) if own else question.start
    before = 0  # the number of members of the families before

    def count(done: int) -> None:
        if before + done:
            report(before + done)

    for family in question.families:
        rows, names = np.flatnonzero(families == family), question.members.names
        values = np.column_stack([table.columns[name][rows] for name in names])
        designs = solved_designs(question.machine, names, values, family, formulas, start, count, tuning, method)
        for name, numbers in designs.numbers.items():
            table.columns[name][rows] = numbers
        table.columns["status"][rows], table.columns["reason"][rows] = designs.statuses, designs.reasons
        before += len(rows)


def _return_map(question: Question, table: Table, row: int) -> ReturnMap:
    """The return map of the machine of a row."""
    names = (name for name in question.members.names if name != LAUNCH_SPEED)
    return ReturnMap(question.machine.with_values(**{name: float(table.columns[name][row]) for name in names}))


def _launched(question: Question, table: Table, report: Callable[[int], None]) -> None:
    """The next launch: launches of the same machine are mapped together."""
    own = [name for name in question.members.names if name != LAUNCH_SPEED]
    values = np.column_stack([table.columns[name] for name in own]) if own else np.zeros((len(table.members), 0))
    _, first, group = np.unique(values, axis=0, return_index=True, return_inverse=True)
    for k in range(len(first)):
        interrupts.heed()
        rows = np.flatnonzero(group.ravel() == k)
        report(int(np.count_nonzero(group < k)))
        try:
            hops = _return_map(question, table, int(first[k]))(table.columns[LAUNCH_SPEED][rows])
        except OrbitsError as error:
            table.columns["status"][rows], table.columns["reason"][rows] = "no orbit", str(error)
            continue
        for name in ("next", "loss", "impacts", "status"):
            table.columns[name][rows] = getattr(hops, name)


def _fixed(question: Question, table: Table, report: Callable[[int], None]) -> None:
    """The fixed points of the return map: their number, and the lowest stable one, or else the lowest."""
    assert question.between is not None
    for row in range(len(table.members)):
        interrupts.heed()
        report(row)
        try:
            found = _return_map(question, table, row).fixed_points(*question.between)
        except OrbitsError as error:
            table.columns["status"][row], table.columns["reason"][row] = "no orbit", str(error)
            continue
        table.columns["count"][row] = len(found)
        table.columns["status"][row] = "certified" if found else "no orbit"
        none = "no resolved fixed point" if found.unresolved else "no fixed point"
        table.columns["reason"][row] = "" if found else f"the return map has {none} between these launch speeds"
        if found:
            best = min(found, key=lambda point: (not point.stable, point.alpha))
            table.columns["alpha"][row] = best.alpha
            table.columns["multiplier"][row] = np.nan if best.multiplier is None else best.multiplier
