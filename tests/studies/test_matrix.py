"""Machines and verbs: a cell stands where its figures agree, or where it is refused for a reason of mathematics."""

from studies.matrix import REASONS, Case, Cell, Held, cell_of, reason_of


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
