"""Families that are proved as one continuous curve: what other methods find lies in the pieces, and what is no curve is
not proved."""

import dataclasses
import json
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import pytest

from orbits import InputError, find, follow
from problems import Hopper

REFERENCE = json.loads((Path(__file__).parents[1] / "data" / "proved.json").read_text())["cubic"]
# The fold of family 1 of the cubic spring, by continuation in another program.
FOLD = (Decimal("-0.0106952149164040"), Decimal("5.83222367210583"))


@pytest.fixture(scope="module")
def machine():
    return Hopper("cubic", rest_length=30.0)


def between(family, first, last):
    """The points of a family between two indices."""
    points = family.points[first : last + 1]
    return dataclasses.replace(family, points=points, events=())


def bounds_of(piece, coordinate, value, name):
    """The bounds of an unknown in a piece, at an exact value of the coordinate that runs; None outside of it."""
    start, stop = Fraction(piece.start), Fraction(piece.stop)
    if piece.coordinate != coordinate or not min(start, stop) <= value <= max(start, stop):
        return None
    s = (2 * value - start - stop) / (stop - start)
    middle = sum(Fraction(each) * s**k for k, each in enumerate(piece.polynomials[name]))
    radius = Fraction(piece.within[name])
    return middle - radius, middle + radius


def alphas_at(proof, value):
    """The bounds of alpha at a value of beta in the pieces along beta that have it."""
    found = (bounds_of(piece, "beta", value, "alpha") for piece in proof.parts)
    return [each for each in found if each]


def test_a_short_curve(machine):
    family = follow(machine, "beta", stop=0.52, start=0.45, longest=0.5)
    proof = family.prove(machine, continuous=True)
    assert proof.proved, proof.reasons
    assert proof.kind == "branch"
    assert proof.family == 1
    (alpha,) = alphas_at(proof, Fraction("0.5"))
    assert (
        alpha[0] < Fraction(REFERENCE["0.5"]["alpha"]["low"]) <= Fraction(REFERENCE["0.5"]["alpha"]["high"]) < alpha[1]
    )
    assert alpha[1] - alpha[0] < 1e-6
    for said in ("from beta = 0.45 ", "to beta = 0.52 ", "no fold", "r + beta*r**3", "motions all along the curve"):
        assert said in proof.statement
    assert "beta = 0.45," not in proof.statement.partition("rest_length = 30")[0]  # it is what varies
    assert set(proof.conditions.values()) == {"proved"}


@pytest.fixture(scope="module")
def folded(machine):
    """The points about the fold, and the proof that they are on one curve."""
    family = follow(machine, "beta", stop=-0.02, start=0.0)
    first = next(i for i, point in enumerate(family) if point.alpha > 5.69)
    last = next(i for i, point in enumerate(family) if point.alpha > 5.98)
    whole = between(family, first, last)
    return whole, whole.prove(machine, continuous=True, motion=False)


@pytest.mark.slow
def test_a_fold_on_the_way(folded):
    _, proof = folded
    assert proof.proved, proof.reasons
    for name, value in zip(("fold_beta", "fold_alpha"), FOLD, strict=True):
        enclosure = proof.enclosures[name]
        places = -value.as_tuple().exponent
        assert round(Decimal(enclosure.low), places) == round(Decimal(enclosure.high), places) == value
    assert "exactly one fold in beta, nondegenerate" in proof.statement
    assert "where beta is least" in proof.statement


@pytest.mark.slow
def test_pieces_follow_one_another(folded):
    """The end of a piece along the launch speed lies in the tube of the next one, by the saved numbers alone."""
    _, proof = folded
    for piece, after in zip(proof.parts, proof.parts[1:], strict=False):
        if piece.coordinate == after.coordinate:
            assert piece.stop == after.start
            for name, coefficients in piece.polynomials.items():
                end = sum(map(Fraction, coefficients))
                begin = sum(Fraction(each) * (-1) ** k for k, each in enumerate(after.polynomials[name]))
                assert abs(end - begin) + Fraction(piece.within[name]) < Fraction(after.alone_within[name])


@pytest.mark.slow
def test_both_sheets_in_the_document(folded):
    family, proof = folded
    document = json.loads(json.dumps(proof.document()))
    assert document["kind"] == "branch"
    assert document["machine"]["parameters"]["beta"] is None
    speeds = [piece["unknowns"]["alpha"] for piece in document["parts"]]
    for point in family:
        assert any(Decimal(low) <= Decimal(point.alpha) <= Decimal(high) for low, high in speeds)


def test_points_of_two_families_are_no_curve(machine):
    first, second = (follow(machine, "beta", stop=0.52, start=0.5, family=number, longest=0.1) for number in (1, 2))
    count = len(first) // 2
    glued = dataclasses.replace(first, points=first.points[:count] + second.points[count:], events=())
    proof = glued.prove(machine, continuous=True, motion=False)
    assert not proof.proved
    assert "not proved to be on one curve" in proof.reasons[0] or "there is no curve" in proof.reasons[0]
    assert not proof.parts


@pytest.mark.slow
def test_a_skipped_fold_is_not_bridged(machine, folded):
    """Two orbits at about the same beta on the two sheets, with nothing in between."""
    family, _ = folded
    ends = dataclasses.replace(family, points=(family.points[0], family.points[-1]), events=())
    proof = ends.prove(machine, continuous=True, motion=False)
    if proof.proved:  # the numerical curve between them was found, with the fold
        assert "exactly one fold" in proof.statement


def test_another_machine(machine):
    family = follow(machine, "beta", stop=0.52, start=0.5, longest=0.5)
    assert not family.prove(
        Hopper("1.001*r + beta*r**3", rest_length=30.0, parameters={"beta": 0.0}), continuous=True
    ).proved


def test_what_cannot_be_a_curve(machine):
    family = follow(machine, "beta", stop=0.55, start=0.5)
    with pytest.raises(InputError, match="two points"):
        between(family, 0, 0).prove(machine, continuous=True)
    with pytest.raises(InputError, match="no parameter"):
        family.prove(Hopper(), continuous=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("other", "along", "start", "stop"),
    [
        (Hopper("tanh", parameters={"b": 0.1}, rest_length=30.0), "b", 0.1, 0.12),
        (Hopper("sinh(b*r)/b", parameters={"b": 0.2}, rest_length=30.0), "b", 0.2, 0.22),
        (Hopper("r", "1/(1 + z/R)**2", rest_length=20.0, parameters={"R": 150.0}), "R", 150.0, 155.0),
        (Hopper("cubic", rest_length=9.0, parameters={"beta": 0.3}), "mass_ratio", 1.0, 1.2),
    ],
)
def test_other_laws_and_parameters(other, along, start, stop):
    family = follow(other, along, stop=stop, start=start, longest=0.5)
    proof = family.prove(other, continuous=True, motion=False)
    assert proof.proved, proof.reasons
    middle = find(other.with_values(**{along: (start + stop) / 2}))
    assert any(middle.alpha in part.unknowns["alpha"] for part in proof.parts)
