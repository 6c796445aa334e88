"""Formulas of saved proofs: values, slopes and identities."""

from decimal import Decimal
from fractions import Fraction

import pytest
from flint import arb, arb_series

from orbits.check_formulas import DEFINED, SLOPES, is_zero, number, parse, quintic, slope, tree
from orbits.check_proof import Values
from orbits.check_statement import Unverified


@pytest.mark.parametrize("share", ["0", "0.3", "1"])
def test_a_polynomial_between_rows(share):
    """The quintic r**5 - 3 r**3 + r - 2 is the one with its own values at two rows."""
    value = lambda r: (r**5 - 3 * r**3 + r - 2, 5 * r**4 - 9 * r**2 + 1, 20 * r**3 - 18 * r)  # noqa: E731
    ends = [Fraction(-3, 2), Fraction(11, 10)]
    rows = [[str(Decimal(each.numerator) / each.denominator) for each in (r, *value(r))] for r in ends]
    r = ends[0] + Fraction(share) * (ends[1] - ends[0])
    assert quintic(*rows, number(r)).value == value(r)[0]


def test_formulas_that_are_zero():
    """By identities of polynomials and of functions that are odd, even or inverse at opposite arguments."""
    names = {name: tree("name", value=name) for name in "ab"}
    zero = lambda text: is_zero(parse(text, names, []))  # noqa: E731
    odd = ("sin", "tan", "sinh", "tanh", "atan", "asinh", "asin", "atanh")
    for name in odd:
        assert zero(f"{name}(a - b) + {name}(b - a)")
        assert not zero(f"{name}(a - b) + {name}(b - a + 1e-30)")
        assert not zero(f"{name}(a - b) - {name}(b - a)")
    for name in ("cos", "cosh"):
        assert zero(f"{name}(a - b) - {name}(b - a)")
        assert not zero(f"{name}(a - b) + {name}(b - a)")
    for text in (
        "(a + b)**2 - a**2 - 2*a*b - b**2",
        "a/b*b - a",
        "exp(a)*exp(-a) - 1",
        "sqrt(1 + (-a)**2) - sqrt(1 + a*a)",
    ):
        assert zero(text)
    for text in ("a", "exp(a) + exp(-a)", "log(a) + log(-a)", "sqrt(a) - sqrt(-a)", "sin(a) - sin(b)"):
        assert not zero(text)


@pytest.mark.parametrize(
    ("text", "value"),
    [("-2**2", -4), ("2**-1", "1/2"), ("2**3**2", 512), ("1 - 2 - 3", -4), ("8/2/2", 2), ("-(1 + .5e1)*2", -12),
     ("1e16 + 3 - 1e16", 3), ("+1 - -1", 2), ("lambda*is", 6),
     ("007*3/7", 3), ("00.5 + 1e+01", "10.5"), ("\t1\n+ 01", 2)],
)  # fmt: skip
def test_formulas_have_the_precedence_of_arithmetic(text, value):
    assert parse(text, {"lambda": number(2), "is": number(3)}, []).value == Fraction(value)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "1 2",
        "r;r",
        "r.x",
        "f(r, 2)",
        "f(r)",
        "(r",
        "r)",
        "[r]",
        "r**",
        "1/0",
        "0x10",
        "1_0",
        "1j",
        "q",
        "r//r",
        "1e-20000000",
        "9" * 5000,
        "(2**65536)**65536",
        "r**65537",
        "0/0",
        "1if r",
    ],
)
def test_what_is_no_formula_is_refused(text):
    with pytest.raises(Unverified):
        parse(text, {"r": tree("name", value="r")}, [])


@pytest.mark.parametrize("name", [*SLOPES, *DEFINED])
def test_functions_and_their_slopes(name):
    """Values against Arb's own, slopes against differences, and Taylor series against both."""
    x = tree("name", value="r")
    of = parse(f"{name}(r)", {"r": x}, [])
    at = arb(1.375 if name == "acosh" else 0.375)
    value, by_x = Values({x: at})[of], Values({x: at})[slope(of, "r")]
    assert value.overlaps(getattr(at, name)())
    step = arb(2) ** -20
    difference = (getattr(at + step, name)() - getattr(at - step, name)()) / (2 * step)
    assert abs(difference - by_x) < 1e-9
    series = Values({x: arb_series([at, 1], 3)})[of]
    assert series[0].overlaps(value)
    assert series[1].overlaps(by_x)


def test_terms_that_cancel_are_left_out():
    """Equal formulas are one tree: numbers are gathered before a product, and a difference of equal ones is 0."""
    names = {name: tree("name", value=name) for name in "ab"}
    read = lambda text: parse(text, names, [])  # noqa: E731
    assert read("a*b - a*b") is read("0")
    assert read("-(-(2*a))*3") is read("6*a")
    assert read("sin(0*a) + cos(0)") is read("1")
    assert is_zero(read("2*sin(a - a)*cos(b)"))
