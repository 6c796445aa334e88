"""Formulas from SymPy's expressions: they have the values that SymPy computes in 30 digits."""

import random

import pytest

from orbits import InputError
from orbits.symbolic import FUNCTIONS, formula_of, name_of_parameter, parse

sympy = pytest.importorskip("sympy")
pytestmark = pytest.mark.extra("sympy")

a, b, x = sympy.symbols("a b x", real=True)
VALUES = {"a": 0.37, "b": 0.91, "u": 0.23}


def drawn(choose, depth):
    """A random expression of a, b, x and numbers."""
    if depth == 0 or choose.random() < 0.15:
        return choose.choice([a, b, x, sympy.Integer(-2), sympy.Rational(-1, 3), sympy.Float(-0.1), sympy.pi, sympy.E])
    one, other = (drawn(choose, depth - 1) for _ in range(2))
    kinds = [one + other, one - other, one * other, one / (other**2 + 2), -one, (one**2 + 1) ** sympy.Rational(-3, 2)]
    return choose.choice([*kinds, sympy.sqrt(1 + other**2), sympy.tanh(one), sympy.exp(-(other**2)), abs(one) ** 3])


def test_random_expressions():
    choose = random.Random(3)
    for _ in range(25):
        expression = drawn(choose, 3)
        formula = parse(formula_of(expression, {x: "u"}, "V"))
        expected = sympy.N(expression.subs({a: VALUES["a"], b: VALUES["b"], x: VALUES["u"]}), 30)
        assert formula(**{name: VALUES[name] for name in formula.names}) == pytest.approx(float(expected), rel=1e-12)


def test_all_functions_of_formulas():
    for name in FUNCTIONS.keys() - {"expm1", "log1p"}:
        function = getattr(sympy, "Abs" if name == "abs" else name)
        assert formula_of(function(a), {}, "V") == f"{name}(a)"


def test_numbers_and_names():
    assert formula_of(-a / 3 + sympy.Float(0.1) * b, {}, "V") in ("-(a/3) + 0.1*b", "0.1*b - a/3")
    assert formula_of(1 / (a * sympy.sqrt(b)), {}, "V") == "1/(a*sqrt(b))"
    for name in ("k_{1}", "pi", "sin", "2k"):
        with pytest.raises(InputError, match=name.replace("{", r"\{")):
            name_of_parameter(sympy.Symbol(name))
    for wrong in (sympy.oo, sympy.atan2(a, b), a < b, sympy.Matrix([a]), sympy.log(a).diff(a, evaluate=False)):
        with pytest.raises(InputError, match=r"formula|scalar"):
            formula_of(wrong, {}, "V")
    deep = a
    for _ in range(80):
        deep = sympy.sin(deep)
    with pytest.raises(InputError, match="nested deeper than 60 levels"):
        formula_of(deep, {}, "V")
