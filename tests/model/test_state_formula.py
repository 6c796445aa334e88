"""Formulas of the state and their series along a motion."""

import mpmath as mp
import numpy as np
import pytest

from orbits import InputError
from orbits.model import Affine, StateFormula, height_of


def test_formulas_of_the_state():
    """Series against those of mpmath in 30 digits, and what is refused."""
    length = StateFormula("sqrt(a**2 + x**2)*sin(y)", ("x", "x'", "y"), {"a": np.array([1.0, 2.0])})
    rows = np.zeros((2, 3, 12))
    rows[:, 0, :3], rows[:, 2, :2] = [0.5, 1.0, -0.4], [0.3, 2.0]  # x = 0.5 + t - 0.4 t^2, y = 0.3 + 2 t
    found = length.of(np.array([0, 1])).series(rows)
    for i, a in enumerate((1, 2)):
        with mp.workdps(30):
            path = lambda t: mp.sqrt(a**2 + (0.5 + t - 0.4 * t**2) ** 2) * mp.sin(0.3 + 2 * t)  # noqa: B023, E731
            known = [float(c) for c in mp.taylor(path, 0, 11)]
        assert found[i] == pytest.approx(known, rel=1e-13, abs=1e-13)
    assert length.of(np.array([1]))(np.array([[0.5, 0.0, 0.3]])) == pytest.approx(
        np.hypot(2, 0.5) * np.sin(0.3), rel=1e-15
    )
    with pytest.raises(InputError, match="'b'"):
        StateFormula("x + b", ("x",))
    with pytest.raises(InputError, match="abs"):
        StateFormula("abs(x)", ("x",))


def test_a_formula_in_other_units():
    """One old unit is so many new ones: of the states, and of the value; once, and once more."""
    height = StateFormula("x + 2*l*sin(y/2)", ("x", "x'", "y"), {"l": 3.0})
    once = height.in_units((10.0, 7.0, 4.0), 100.0)
    twice = once.in_units((0.5, 1.0, 0.25), 0.1)
    state = np.array([[0.3, 5.0, 0.7], [1.0, -2.0, 0.1]])
    expected = state[:, 0] + 6 * np.sin(state[:, 2] / 2)
    for formula, sizes, unit in ((height, (1, 1, 1), 1), (once, (10, 7, 4), 100), (twice, (5, 7, 1), 10)):
        assert formula(state * sizes) == pytest.approx(unit * expected, rel=1e-14)
        assert formula.at(list(state[0] * sizes)) == pytest.approx(unit * expected[0], rel=1e-14)
        rows = np.zeros((1, 3, 6))
        rows[0, :, 0], rows[0, 2, 1] = state[0] * sizes, 0.5 * sizes[2]
        angles = 0.5 * state[0, 2] + 0.5 * np.pi * np.arange(6)
        series = 6 * np.sin(angles) * 0.25 ** np.arange(6) / np.array([1, 1, 2, 6, 24, 120])
        series[0] += state[0, 0]
        assert formula.series(rows)[0] == pytest.approx(unit * series, rel=1e-13)
    affine = Affine((2.0, 0.0, -1.0), 0.5)
    assert affine.in_units((10.0, 7.0, 4.0), 100.0)(state * [10, 7, 4]) == pytest.approx(100 * affine(state), rel=1e-14)


def test_functions_of_the_state_come_back_from_files():
    height = StateFormula("x + a*y**2", ("x", "x'", "y"), {"a": 3.0, "unused": 1.0})
    assert height.coordinates == ("x", "y")
    assert height_of(height.saved(), height.states) == height
    affine = Affine((2.0, 0.0, -1.0), 0.5)
    assert height_of(tuple(affine.saved()), height.states) == affine
