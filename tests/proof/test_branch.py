"""Families that are proved as one continuous curve: what other methods find lies in the pieces, and what is no curve is
not proved."""

import json
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from steps import stepping

from orbits import find, follow
from problems import Hopper

REFERENCE = json.loads((Path(__file__).parents[1] / "data" / "proved.json").read_text())["cubic"]


@pytest.fixture(scope="module")
def machine():
    return Hopper("cubic", rest_length=30.0)


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


@pytest.mark.slow
def test_a_short_curve(machine):
    family = follow(machine, "beta", stop=0.51, start=0.49, longest=0.5)
    proof = family.prove(machine, continuous=True)
    assert proof.proved, proof.reasons
    assert proof.kind == "branch"
    assert proof.family == 1
    (alpha,) = alphas_at(proof, Fraction("0.5"))
    assert (
        alpha[0] < Fraction(REFERENCE["0.5"]["alpha"]["low"]) <= Fraction(REFERENCE["0.5"]["alpha"]["high"]) < alpha[1]
    )
    assert alpha[1] - alpha[0] < 1e-6
    for said in ("from beta = 0.49 ", "to beta = 0.51 ", "no fold", "r + beta*r**3", "motions all along the curve"):
        assert said in proof.statement
    assert "beta = 0.49," not in proof.statement.partition("rest_length = 30")[0]  # it is what varies
    assert set(proof.conditions.values()) == {"proved"}


@pytest.mark.slow
def test_both_sheets_in_the_document(folded_curve):
    family, proof = folded_curve
    document = json.loads(json.dumps(proof.document()))
    assert document["kind"] == "branch"
    assert document["machine"]["parameters"]["beta"] is None
    speeds = [piece["unknowns"]["alpha"] for piece in document["parts"]]
    for point in family:
        assert any(Decimal(low) <= Decimal(point.alpha) <= Decimal(high) for low, high in speeds)


@pytest.mark.slow
def test_a_curve_of_wheels():
    wheel = stepping("wheel", 1.0, 0.5, 0.3)
    proof = follow(wheel, "kappa", 0.55).prove(wheel, continuous=True)
    assert proof.proved, proof.reasons
    assert "each point that stands in contact pushes throughout the open contact" in proof.statement


def test_another_machine(machine):
    family = follow(machine, "beta", stop=0.52, start=0.5, longest=0.5)
    assert not family.prove(
        Hopper("1.001*r + beta*r**3", rest_length=30.0, parameters={"beta": 0.0}), continuous=True
    ).proved


@pytest.mark.slow
@pytest.mark.parametrize(
    ("other", "along", "start", "stop"),
    [
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


def test_a_speed_that_is_the_same_to_the_last_bit():
    """Under constant gravity the launch does not depend on the masses: the curve has no extent in its speed."""
    machine = Hopper("cubic", rest_length=9.0, parameters={"beta": 0.3})
    family = follow(machine, "mass_ratio", start=1.0, stop=1.1, longest=0.5)
    first, count = family.points[0], len(family.points)
    points = family.points.replaced(u=np.tile(first.u, (count, 1)), alpha=np.full(count, first.alpha))
    assert replace(family, points=points).prove(machine, continuous=True, motion=False).proved
