"""Folds that are proved: beside what curves along them find, and only where there are some."""

from decimal import Decimal

import pytest
from steps import stepping

from orbits import InputError, follow, prove_fold
from orbits.running import default_limit
from problems import Hopper

# The fold of family 1 of the cubic spring, by continuation in another program.
FOLD = "-0.01069521491640"


@pytest.fixture(scope="module")
def machine():
    return Hopper("cubic", rest_length=8.0)


@pytest.fixture(scope="module")
def fold(machine):
    family = follow(machine, "beta", stop=-0.02, start=-0.009, most=40)
    return next(event.point for event in family.events if event.kind == "fold")


@pytest.mark.slow
def test_the_fold_of_the_cubic_family(machine, fold):
    proof = prove_fold(machine, fold, "beta")
    assert proof.proved
    place = proof.enclosures["beta"]
    assert round(Decimal(place.low), 14) == round(Decimal(place.high), 14) == Decimal(FOLD)
    assert fold.alpha - 1e-6 < float(proof.alpha.low) <= float(proof.alpha.high) < fold.alpha + 1e-6
    assert "nondegenerate" in proof.statement
    assert "beta = " not in proof.statement  # it is what is enclosed


@pytest.mark.slow
def test_a_fold_of_a_wheel():
    wheel = stepping("wheel", 1.0, 0.5, 0.3, "r - c*r**3", c=3.0)
    family = follow(wheel, "c", 3.56, start=3.54)
    with default_limit(300):  # of processor time
        proof = prove_fold(wheel, next(event.point for event in family.events if event.kind == "fold"), "c")
    assert proof.proved, proof.reasons
    place = proof.enclosures["c"]
    assert round(Decimal(place.low), 14) == round(Decimal(place.high), 14) == Decimal("3.55428452087394")


@pytest.mark.slow
def test_more_digits_of_a_fold(machine, fold):
    place = prove_fold(machine, fold, "beta", digits=30).enclosures["beta"]
    assert Decimal(place.high) - Decimal(place.low) < Decimal("1e-30")


@pytest.mark.slow
def test_a_point_beside_the_fold_is_no_fold(machine):
    """A tangent along which the parameter changes leads to no zero of the fold's equations, or to the fold itself."""
    point = follow(machine, "beta", stop=0.5).points[-1]
    proof = prove_fold(machine, point, "beta")
    assert not proof.proved
    assert proof.reasons
    assert not proof.enclosures


def test_an_unknown_parameter(machine, fold):
    with pytest.raises(InputError, match="no parameter 'gamma'"):
        prove_fold(machine, fold, "gamma")
