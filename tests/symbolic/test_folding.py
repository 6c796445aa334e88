"""Numerals of formulas, worked out in rational numbers: against Python's fractions and formulas without them."""

from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from orbits import InputError
from orbits.symbolic import parse, symbolic_numerals


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("1e16 + 3 - 1e16", 3.0),
        ("1 + 1e-17", 1.0),
        ("1/3 + 1/3 + 1/3 - 1", 0.0),
        ("0.1*3 - 0.3", 0.0),
        ("1/49*49 - 1", 0.0),
        ("-(2 - 5)", 3.0),
        ("1e300*1e300/1e300", 1e300),
        ("(1e-200)**2*1e200", 1e-200),
        ("2**-2", 0.25),
        ("3**2**2", 81.0),
        ("0.1**3", float(Fraction(1, 1000))),
    ],
)
def test_numbers_are_exact_before_they_are_rounded(text, number):
    assert float(parse(text)()) == number
    x = ca.SX.sym("x")
    assert float(ca.evalf(parse(f"x*0 + ({text})")(x=x))) == number


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("(1e16 + 3 - 1e16)*x", "3*x"),
        ("1e16 + x - 1e16", "x"),
        ("1e16*x + 3*x - 1e16*x", "3*x"),
        ("1e16*x*y + x - 1e16*x*y", "x"),
        ("x - 1e17*(x - y) + 1e17*x", "x + 1e17*y"),
        ("x - x + y", "0 + y"),
        ("exp(x) + 1e16 - 1e16", "exp(x)"),
        ("x**(1 + 1)", "x**2"),
    ],
)
def test_sums_from_which_numbers_cancel(text, plain):
    for x, y in ((0.3, 0.7), (np.array([0.1, 2.0]), np.array([3.0, 1e-20]))):
        wanted, found = ({"x": x, "y": y} for _ in range(2))
        ours, theirs = parse(text), parse(plain)
        assert np.array_equal(
            ours(**{name: found[name] for name in ours.names}), theirs(**{name: wanted[name] for name in theirs.names})
        )


@pytest.mark.parametrize("text", ["r + 0.5*r", "2*r + 0.5*(r + 1) + r**3", "sin(r)/(1 + r**2)", "1 + r + 2", "x/3 - r"])
def test_other_formulas_are_left_as_they_are_written(text):
    formula = parse(text)
    assert formula.folded == formula.tree


@pytest.mark.parametrize(
    "text",
    ["log(x) - log(x)", "1/x - 1/x", "0*log(x)", "x**0.5 - x**0.5", "x*log(x) - x*log(x)", "log(x)*x - log(x)*x"],
)
def test_what_may_have_no_value_stays(text):
    assert np.isnan(parse(text)(x=np.array(-1.0))) or text.startswith("1/x")
    assert np.isnan(parse("1/x - 1/x")(x=0.0))


def test_numbers_beyond_doubles():
    assert parse("1e300*1e300")() == np.inf
    assert parse("9**9**9**9")() == np.inf
    assert parse("1e-999999999999*x")(x=2.0) == 0.0
    assert np.isnan(parse("1/0 - 1/0")())
    with pytest.raises(InputError, match="too large"):
        parse("1e400")


def test_symbols_in_place_of_numerals():
    """The numerals are worked out before."""
    x = ca.SX.sym("x")
    symbols: dict[str, ca.SX] = {}
    with symbolic_numerals(symbols):
        parse("(1e16 + 3 - 1e16)*x")(x=x)
    assert symbols.keys() == {"3"}
