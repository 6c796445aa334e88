"""Formulas of the state and their series along a motion."""

import mpmath as mp
import numpy as np
import pytest

from orbits import InputError
from orbits.model.state_formula import StateFormula


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
