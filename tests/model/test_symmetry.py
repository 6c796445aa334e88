"""Signed shifts as maps, and the wheel, the rocker and the shuttle, written by hand, against their closed forms."""

import numpy as np
import pytest
from steps import SINES, TABLE, by_hand, closed_form, start_of

from orbits import InputError, find
from orbits.model import Affine, SignedShift

A = SignedShift((-1, 1, 1), lambda p: [2 * p["c"], 0.0, p["d"]])
B = SignedShift((1, -1, -1), lambda p: [1.0, p["c"], 0.0])
P, X = {"c": 0.7, "d": -0.4}, [1.0, 2.0, 3.0]


def test_maps_follow_each_other_and_are_undone():
    assert A.after(B).image(X, P) == pytest.approx(A.image(B.image(X, P), P))
    assert B.inverse.image(B.image(X, P), P) == pytest.approx(X)
    assert A.inverse.image(A.image(X, P), P) == pytest.approx(X)
    assert SignedShift((-1, 1)).inverse.image([1.0, 2.0], P) == [-1.0, 2.0]


def test_fixed_states_functions_and_rows():
    odd = SignedShift((-1, 1), lambda p: [2 * p["c"], 0.0])
    assert odd.fixed([P["c"], 5.0], P) == [0.0]
    assert SignedShift((1, -1)).fixed([3.0, 4.0], P) == [4.0]
    height = Affine((2.0, 1.0, -1.0), 0.5)
    assert A.of(height, P).at(X) == pytest.approx(height.at(A.image(X, P)))
    rows = np.arange(24.0).reshape(2, 4, 3)
    image = A.rows(rows, P)
    assert image[:, :, 0] == pytest.approx(np.array([A.image(list(row), P) for row in rows[:, :3, 0]]))
    assert image[:, 0, 1:] == pytest.approx(-rows[:, 0, 1:])


@pytest.mark.parametrize(("kind", "values"), [(kind, values) for kind in TABLE for values in TABLE[kind]])
def test_straight_lines_have_their_closed_form(kind, values):
    numbers = values[:2]
    orbit = find(by_hand(kind)(*numbers), start=start_of(kind, *values))
    half, speed, contact = TABLE[kind][values]
    assert (orbit.flight_time / 2, orbit.alpha) == pytest.approx((half, speed), rel=0, abs=1e-12)
    assert orbit.contact_time == pytest.approx(contact, rel=0, abs=1e-12)
    assert closed_form(kind, *values) == pytest.approx((half, speed, contact), rel=0, abs=1e-12)


@pytest.mark.parametrize(("kind", "law", "family"), SINES)
def test_sines_and_a_cubic_spring_have_the_values_of_other_integrators(kind, law, family):
    orbit = find(by_hand(kind, law, sine=True)(1.0, 0.5, 0.3), start=start_of(kind, 1.0, 0.5, family, 0.3, law))
    speed, half, contact = SINES[kind, law, family]
    assert orbit.alpha == pytest.approx(speed, rel=0, abs=1e-12)
    assert orbit.contact_time == pytest.approx(contact, rel=0, abs=1e-12)
    assert half is None or orbit.flight_time / 2 == pytest.approx(half, rel=0, abs=1e-12)


def test_a_model_without_a_reversor_has_no_half_orbit():
    import dataclasses

    wheel = by_hand("wheel")(1.0, 0.5, 0.3)
    with pytest.raises(InputError, match="needs a model with a reversor"):
        _ = dataclasses.replace(wheel.model, reversor=None, reversor_shift=None).reversal
