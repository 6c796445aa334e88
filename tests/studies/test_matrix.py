"""Machines and verbs: a cell stands where its figures agree, or where it is refused for a reason of mathematics."""

from itertools import product

import pytest

from studies.matrix import (
    MACHINES,
    REASONS,
    SPRINGS,
    TABLE,
    VERBS,
    Case,
    Cell,
    Held,
    cell_of,
    diagonal,
    page,
    reason_of,
)


def is_said_to_work(machine, law, verb):
    """Whether the page says so."""
    rows = [line.strip("|\n ").split(" | ") for line in TABLE.read_text(encoding="utf-8").splitlines()]
    said = next(row for row in rows if row[0] == f"`{verb}`")[1 + [*MACHINES].index(machine)]
    return said == "all" or law in said.split(", ")


def test_figures_that_differ_and_refusals_without_a_reason_do_not_stand():
    right, wrong = Held("alpha", 4.0, 4.0 + 1e-9), Held("alpha", 4.0, 4.001)
    cell = Cell("hopper", "linear", "find", (right,))
    assert cell.stands
    assert not cell._replace(held=(right, wrong)).stands
    assert not cell._replace(held=()).stands
    assert not cell._replace(held=(), refused="it cannot be").stands
    assert all(reason_of(f"spring 'r': {reason}; round it") == reason for reason in REASONS)


def test_a_cell_is_tried():
    assert cell_of(Case("hopper", "linear"), "ReturnMap").stands
    refused = cell_of(Case("heavy hand", "potential"), "start_up")
    assert refused.refused
    assert refused.stands


def test_the_page_has_all_machines_springs_and_verbs():
    works = (Held("", 0.0, 0.0),)
    keys = product(MACHINES, SPRINGS, VERBS)
    assert TABLE.read_text(encoding="utf-8") == page([Cell(*key, works * is_said_to_work(*key)) for key in keys])


@pytest.mark.slow
def test_cells_say_what_the_page_says():
    tried = list(diagonal())
    assert [{getattr(cell, of) for cell in tried} for of in ("machine", "spring", "verb")] == [
        {*MACHINES}, {*SPRINGS}, {*VERBS}
    ]  # fmt: skip
    for cell in tried:
        assert cell.stands, cell
        assert not (cell.refused and is_said_to_work(*cell[:3])), cell
