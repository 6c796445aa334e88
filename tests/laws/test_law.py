"""Laws: what a law tells of itself, and that it comes back."""

import pickle

import numpy as np
import pytest

from orbits import InputError
from problems.laws import springs

ROWS = ([-20.0, -10.0, -1.0, 0.0, 1.0, 10.0, 20.0], [-30.0, -14.0, -1.0, 0.0, 1.0, 14.0, 30.0])


def test_a_law_tells_what_it_is_and_comes_back():
    law = springs.cubic(beta=0.3)
    assert repr(law) == "Law('r + beta*r**3', beta=0.3)"
    again = pickle.loads(pickle.dumps(law))
    assert again == law
    assert again.key == law.key
    assert again != springs.cubic(beta=0.4)
    assert springs.formula("r + r**3").key != springs.formula("r - r**3").key
    assert springs.table(ROWS) == springs.table(ROWS)
    assert springs.table(ROWS) != springs.table((ROWS[0], [2 * force for force in ROWS[1]]))


def test_corners_are_where_value_or_slope_jump():
    rows = np.linspace(-20.0, 20.0, 201)
    assert springs.table((rows, 10 * np.sin(0.1 * rows)), noise=0).corners() == []
    turning = springs.table(([-3, -2, -1, 0, 1, 2, 3], [-3, -2, -1, 0, 1, 0.8, 2.0]), noise=0)
    assert turning.corners() == []
    assert springs.end_stops(gap=2.0).corners() == [-2.0, 2.0]
    assert springs.function(lambda r: r + np.where(r > 1, 0.1, 0.0), (1.0,)).corners() == [1.0]
    assert springs.cubic().corners() == []


def test_tables_scaled_and_shifted():
    rows = np.linspace(-4.0, 4.0, 33)
    law = springs.table((rows, np.sinh(rows)), noise=0, scale="s", shift="d").with_parameters(s=1.5, d=0.25)
    plain, r = springs.table((rows, np.sinh(rows)), noise=0), np.linspace(-3.0, 3.0, 50)
    assert law(r) == pytest.approx(1.5 * plain(r - 0.25), rel=1e-14)
    assert law.range() == (-3.75, 4.25)
    for names, words in (
        ({"scale": "r"}, "scale = 'r'"),
        ({"shift": "a b"}, "shift = 'a b'"),
        ({"scale": ""}, "scale"),
    ):
        with pytest.raises(InputError, match=words):
            springs.table((rows, rows), noise=0, **names)
    with pytest.raises(InputError, match="two names"):
        springs.table((rows, rows), noise=0, scale="s", shift="s")
