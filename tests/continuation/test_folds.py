"""Curves of folds against a stored value, each other, and the folds of single families."""

import pytest
from conftest import PROVED, middle

from orbits import InputError, follow, follow_fold
from orbits.periodic import fold_statement
from problems import Hopper


def fold_of(machine, stop=-0.02):
    """The fold of a family along beta, which lies among its first 40 points."""
    family = follow(machine, "beta", stop, start=-0.009, most=40)
    return next(event.point for event in family.events if event.kind == "fold")


@pytest.fixture(scope="module")
def quintic():
    machine = Hopper("r + beta*r**3 + delta*r**5", parameters={"beta": 0.0, "delta": 0.0})
    return machine, fold_of(machine)


@pytest.mark.slow
def test_the_curve_is_made_of_the_folds_of_single_families(quintic):
    machine, fold = quintic
    curve = follow_fold(machine, fold, "beta", "delta", 3e-5, at=[2e-5])
    (point,) = curve.at(2e-5)
    single = fold_of(machine.with_values(delta=2e-5))
    assert point.also["beta"] == pytest.approx(single.value, abs=1e-12)
    assert point.alpha == pytest.approx(single.alpha, abs=1e-7)
    assert curve.column("beta")[0] == pytest.approx(middle(PROVED["fold"]["beta"]), abs=1e-13)
    assert curve.column("delta")[-1] == 3e-5


def test_bad_questions_are_refused():
    machine = Hopper("r + beta*r**3 + delta*r**5", parameters={"beta": 0.0, "delta": 0.0})
    fold = follow(machine, "beta", -1e-4)[-1]  # no question comes so far that it is looked at
    with pytest.raises(InputError, match="no parameter 'gamma'"):
        follow_fold(machine, fold, "beta", "gamma", 1.0)
    with pytest.raises(InputError, match="along another parameter"):
        follow_fold(machine, fold, "beta", "beta", 1.0)
    with pytest.raises(InputError, match="choose another stop"):
        follow_fold(machine, fold, "beta", "delta", 0.0)
    with pytest.raises(InputError, match="another method"):
        follow_fold(machine, fold, "beta", "delta", 1.0, method="half orbit")
    with pytest.raises(InputError, match="move with ratio"):
        fold_statement(Hopper("bilinear").model.reduction.statement, "ratio")
