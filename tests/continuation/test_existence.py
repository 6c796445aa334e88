"""Diagrams in two parameters, against the folds and events of single families."""

import numpy as np
import pytest

from orbits import InputError, existence, follow, follow_fold
from orbits.continuation.existence import intervals_of
from problems import Hopper

MACHINE = Hopper("r + beta*r**3 + delta*r**5", rest_length=30.0, parameters={"beta": 0.0, "delta": 0.0})


@pytest.fixture(scope="module")
def diagram():
    return existence(MACHINE, "beta", (-0.02, 0.01), "delta", [-4e-5, 0.0, 3e-5], longest=0.05)


@pytest.mark.slow
def test_the_edges_are_folds_and_the_collapse(diagram):
    """Without the fifth power: orbits from the fold on, motions from where the contact no longer collapses."""
    family = follow(MACHINE, "beta", -0.02)
    fold, collapse = (next(e.point.value for e in family.events if e.kind == kind) for kind in ("fold", "collapse"))
    found = list(diagram.stretches(1))
    assert min(low for low, _, _ in found) == pytest.approx(fold, abs=1e-12)
    assert min(low for low, _, motion in found if motion) == pytest.approx(collapse, rel=1e-9)
    assert max(high for _, high, _ in found) == 0.01
    assert diagram.motions(1) == [(min(low for low, _, motion in found if motion), 0.01)]


@pytest.mark.slow
def test_the_edge_moves_as_the_fold_does(diagram):
    (fold,) = [event.point for event in follow(MACHINE, "beta", -0.02).events if event.kind == "fold"]
    curve = follow_fold(MACHINE, fold, "beta", "delta", -4e-5)
    assert min(low for low, _, _ in diagram.stretches(0)) == pytest.approx(curve[-1].also["beta"], abs=1e-11)


@pytest.mark.slow
def test_stretches_cover_a_family_once():
    family = follow(MACHINE, "beta", -0.02)
    found = list(intervals_of(family))
    assert [motion for *_, motion in found] == [True, False, False]  # a motion, collapsing, on the second sheet
    (a, b, _), (c, d, _), (e, f, _) = found
    assert b == 0.0
    assert d == a
    assert c == e
    assert f == family[-1].value


def test_plot(diagram):
    axes = diagram.plot()
    assert axes.get_xlabel() == "beta"
    shown = {"fold", "motions", "no motions"}
    shown |= {"not known"} if any(map(diagram.unknown, range(len(diagram.rows)))) else set()
    assert {text.get_text() for text in axes.get_legend().get_texts()} == shown


def test_rows_without_orbits_are_empty():
    """Beyond the limit of the saturating spring there is no orbit to begin a row with."""
    machine = Hopper("tanh(b*r)/b + c*r", parameters={"b": 0.2, "c": 0.0})
    diagram = existence(machine, "c", (-0.01, 0.02), "b", np.array([0.25, 0.4]), longest=0.1)
    assert [len(row) for row in diagram.rows] == [2, 0]
    assert [diagram.unknown(row) for row in (0, 1)] == [False, False]
    diagram.plot()
    short = existence(machine, "c", (-0.01, 0.02), "b", np.array([0.25, 0.4]), longest=0.1, most=6)
    assert [short.unknown(row) for row in (0, 1)] == [True, True]


def test_questions_that_cannot_be_meant():
    with pytest.raises(InputError, match="another parameter"):
        existence(MACHINE, "beta", (-1, 1), "beta", [1.0])
    with pytest.raises(InputError, match="must lie between"):
        existence(MACHINE, "beta", (0.1, 1), "delta", [1.0])
    with pytest.raises(InputError, match="rows differ"):
        existence(MACHINE, "beta", (-1, 1), "delta", [0.0])
    with pytest.raises(InputError, match="no parameter 'gamma'"):
        existence(MACHINE, "beta", (-1, 1), "gamma", [0.0])
