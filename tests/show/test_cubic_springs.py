"""Laws as sums of cubics, on one side of a place each."""

import numpy as np
import pytest

from orbits.laws import from_formula
from orbits.show.cubic_springs import Cubic, CubicOptions, cubic_sum
from problems import springs


def total(fitted, x):
    return sum((each(x) for each in fitted.cubics), np.zeros(x.shape))


@pytest.mark.parametrize(
    ("text", "cubics"),
    [
        ("1500*r + 2e6*r**3", [Cubic(0.0, (1500.0, 0.0, 2e6))]),
        ("2*(r - 1) + 3*(r - 1)**3", [Cubic(1.0, (2.0, 0.0, 3.0))]),
        ("3 + 0*r", [Cubic(-1.0, (3.0, 0.0, 0.0)), Cubic(0.0, (-3.0, 0.0, 0.0))]),
        ("1 + r**2", [Cubic(-1.0, (1.0, 0.0, 0.0)), Cubic(0.0, (-1.0, 1.0, 0.0))]),
    ],
)
def test_a_cubic_law_is_exact(text, cubics):
    """Everywhere, and about a root where it has one."""
    law, x = from_formula(text, "r"), np.linspace(-5, 5, 101)
    fitted = cubic_sum(law, -0.5, 0.5)
    assert fitted.error == 0
    assert fitted.words == ""
    assert [each.side for each in fitted.cubics] == [0] * len(cubics)
    for found, expected in zip(fitted.cubics, cubics, strict=True):
        assert found.place == pytest.approx(expected.place, abs=1e-15)
        assert found.coefficients == pytest.approx(expected.coefficients, abs=1e-14)
    assert total(fitted, x) == pytest.approx(law(x), rel=1e-13)


@pytest.mark.parametrize("law", [springs.bilinear(), springs.end_stops(), springs.formula("r + 2*abs(r - 0.3)")])
def test_lines_with_corners_are_exact(law):
    """One cubic for each line; the corners are at the places of the law."""
    fitted, x = cubic_sum(law, -4.0, 5.0), np.linspace(-4, 5, 1001)
    assert fitted.error == 0
    assert len(fitted.cubics) == len(law.corners()) + 1
    assert sorted(each.place for each in fitted.cubics if each.side) == pytest.approx(law.corners())
    assert total(fitted, x) == pytest.approx(law(x), abs=1e-13)


@pytest.mark.parametrize(
    "law", [springs.tanh(), springs.air(), springs.toda(), springs.table(springs.SAMPLE, in_si=True)]
)
def test_other_laws_are_near(law):
    """The stated error is that between the samples too."""
    low, high = np.clip([-2.0, 3.0], *law.range())
    fitted = cubic_sum(law, low, high)
    x = np.linspace(fitted.low, fitted.high, 20_001)
    error = abs(total(fitted, x) - law(x)).max() / abs(law(x)).max()
    assert error == pytest.approx(fitted.error, rel=0.05)
    assert 0 < error <= 1.01e-7
    assert f"{len(fitted.cubics)} cubics from " in fitted.words


def test_the_error_falls_with_the_fourth_power_of_the_number(monkeypatch):
    """The pieces have equal widths on the way, of a law whose fourth derivative is nearly constant."""
    law, errors = springs.formula("r + r**4"), []
    for most in (8, 16, 32):
        monkeypatch.setattr("orbits.show.cubic_springs.CUBICS", CubicOptions(most=most, same_force=0.0, beyond=0.0))
        errors.append(cubic_sum(law, -1.0, 1.0).error)
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.01)
    assert errors[1] / errors[2] == pytest.approx(16, rel=0.01)


def test_laws_without_such_a_sum():
    assert cubic_sum(springs.formula("r + sign(r - 1)"), -2.0, 2.0) is None  # it jumps
    assert cubic_sum(springs.formula("sqrt(r)"), -2.0, 2.0) is None  # no value
    assert cubic_sum(springs.formula("0*r"), -2.0, 2.0).cubics == []
