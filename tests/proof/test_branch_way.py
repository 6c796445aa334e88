"""The way along a curve: one fold on it, pieces that begin where others end, and gaps that are not bridged."""

import dataclasses
from decimal import Decimal
from fractions import Fraction

import pytest

from orbits import follow
from problems import Hopper

# The fold of family 1 of the cubic spring, by continuation in another program.
FOLD = (Decimal("-0.0106952149164040"), Decimal("5.83222367210583"))


@pytest.fixture(scope="module")
def machine():
    return Hopper("cubic", rest_length=30.0)


@pytest.mark.slow
def test_a_fold_on_the_way(folded_curve):
    _, proof = folded_curve
    assert proof.proved, proof.reasons
    for name, value in zip(("fold_beta", "fold_alpha"), FOLD, strict=True):
        enclosure = proof.enclosures[name]
        places = -value.as_tuple().exponent
        assert round(Decimal(enclosure.low), places) == round(Decimal(enclosure.high), places) == value
    assert "exactly one fold in beta, nondegenerate" in proof.statement
    assert "where beta is least" in proof.statement


@pytest.mark.slow
def test_pieces_follow_one_another(folded_curve):
    """The end of a piece along the launch speed lies in the tube of the next one, by the saved numbers alone."""
    _, proof = folded_curve
    for piece, after in zip(proof.parts, proof.parts[1:], strict=False):
        if piece.coordinate == after.coordinate:
            assert piece.stop == after.start
            for name, coefficients in piece.polynomials.items():
                end = sum(map(Fraction, coefficients))
                begin = sum(Fraction(each) * (-1) ** k for k, each in enumerate(after.polynomials[name]))
                assert abs(end - begin) + Fraction(piece.within[name]) < Fraction(after.alone_within[name])


@pytest.mark.slow
def test_points_of_two_families_are_no_curve(machine):
    first, second = (follow(machine, "beta", stop=0.51, start=0.5, family=number, longest=0.1) for number in (1, 2))
    count = len(first) // 2
    glued = dataclasses.replace(first, points=first.points[:count] + second.points[count:], events=())
    proof = glued.prove(machine, continuous=True, motion=False)
    assert not proof.proved
    assert "not proved to be on one curve" in proof.reasons[0] or "there is no curve" in proof.reasons[0]
    assert not proof.parts


@pytest.mark.slow
@pytest.mark.slow
def test_a_skipped_fold_is_not_bridged(machine, folded_curve):
    """Two orbits at about the same beta on the two sheets, with nothing in between."""
    family, _ = folded_curve
    ends = dataclasses.replace(family, points=(family.points[0], family.points[-1]), events=())
    proof = ends.prove(machine, continuous=True, motion=False)
    if proof.proved:  # the numerical curve between them was found, with the fold
        assert "exactly one fold" in proof.statement
