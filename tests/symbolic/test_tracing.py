"""Python functions written as formulas: the formula has the function's values, whatever its signs and brackets."""

import numpy as np
import pytest

from orbits.symbolic import parse, traced, traced_of_places

TRACED = [
    lambda r, b: r + b, lambda r, b: 2 + r - b, lambda r, b: r - (b - 1), lambda r, b: r - (b + 1),
    lambda r, b: 2 - r - b,
    lambda r, b: (r - 1) - (b - r), lambda r, b: r * (b + 1), lambda r, b: (r + 1) * b, lambda r, b: r / (b / r),
    lambda r, b: r / (b * r + 1), lambda r, b: 3 / (r + b), lambda r, b: r / b * 2, lambda r, b: 2 * r / (3 * b),
    lambda r, b: (r * b) ** 2, lambda r, b: r**-2, lambda r, b: (-r) ** 2, lambda r, b: -(r**2),
    lambda r, b: 2 ** (b * r),
    lambda r, b: (r**2) ** 3, lambda r, b: r ** (b + 1), lambda r, b: -r * b, lambda r, b: -(r + b) * 2,
    lambda r, b: +r - -b, lambda r, b: r * -2.5, lambda r, b: -3 - r, lambda r, b: -2 * r**3,
    lambda r, b: 1e-7 * r + 1e300, lambda r, b: abs(r - 2) * b, lambda r, b: np.sin(r) + np.exp(-b * r),
    lambda r, b: np.tanh(r / b) - np.sqrt(r + 1) * 2, lambda r, b: np.add(r, b) * np.negative(r),
    lambda r, b: np.float64(2) * r,
]  # fmt: skip


@pytest.mark.parametrize("function", TRACED, ids=map(str, range(len(TRACED))))
def test_a_function_is_written_as_a_formula(function):
    text = traced(function_of(function), ("r",), ("b",))
    assert text is not None
    for r, b in ((0.7, 1.3), (2.5, 0.4)):
        formula = parse(text)
        known = {"r": np.float64(r), "b": np.float64(b)}
        found = formula(**{name: known[name] for name in formula.names})
        assert found == pytest.approx(function(np.float64(r), np.float64(b)), rel=1e-15)


def function_of(function):
    """The function as laws call it, with parameters by name."""
    return lambda r, **p: function(r, p["b"])


@pytest.mark.parametrize(
    "function",
    [
        lambda r, b: r if r > 0 else b, lambda r, b: r + True, lambda r, b: r + "1", lambda r, b: float(r),
        lambda r, b: np.heaviside(r, 0), lambda r, b: r + 1j, lambda r, b: [r],
        lambda r, b: 2 * r if type(r).__name__ == "Text" else r, lambda r, b: r // b, lambda r, b: None,
    ],
)  # fmt: skip
def test_a_function_that_no_formula_says(function):
    assert traced(function_of(function), ("r",), ("b",)) is None


def test_a_function_of_mappings():
    text = traced_of_places(lambda y, p: y["h"] + 2 * p["l"] * np.sin(y["a"] / 2), ("h", "a"), ("l",))
    assert parse(text)(h=1.0, a=0.5, l=3.0) == pytest.approx(1 + 6 * np.sin(0.25), rel=1e-15)
    assert traced_of_places(lambda y, p: y["nothing"], ("h",), ()) is None
