"""Formulas as text: Python's own arithmetic is the truth, and nothing but a formula or an `InputError` comes out."""

import ast
import builtins
import contextlib
import math
import os
import random

import casadi as ca
import numpy as np
import pytest

from orbits import InputError
from orbits.symbolic import FUNCTIONS, MAX_LENGTH, Formula, parse
from orbits.symbolic.formula import MAX_DEPTH, MAX_NODES

PYTHON = {name: getattr(math, name) for name in FUNCTIONS if hasattr(math, name)}
PYTHON |= {"abs": abs, "sign": lambda x: math.copysign(1, x) if x else 0.0, "pi": math.pi, "__builtins__": {}}

# Values for the names below; r runs through the column, the rest are numbers.
R = np.array([0.05, 0.3, 0.5, 0.75, 0.95])
GIVEN = {"a": 1.7, "b": -0.6, "c": 2.3, "_k2": 8.25}

FORMULAS = (
    "r",
    "pi",
    "-r",
    "--r",
    "r + a",
    "a**r",
    "a - b - c + r",
    "a/b/c/r",
    "a/(b/c)/r",
    "a + b*c - r/a",
    "-r**2",
    "-r**-2",
    "2**-r",
    "2**3**2*r",
    "r**2**0.5",
    "a*-r",
    "a**-c**r",
    "-2**2*r",
    "1e3*r",
    "2.5e+2*r",
    ".5*r",
    "5.e-1*r",
    "007.5*r",
    "4.9406564584124654e-324 + r",
    "1.7976931348623157e308*r",
    "  r+a  ",
    "r\t*\ta",
    "r*_k2",
    "exp(-r)*sin(c*r)/(1 + r**2)",
    "sqrt(abs(sin(r)))",
    "(1 - exp(-a*r))*exp(-a*r)/a",
    "sign(b)*r",
    "sign(r - 0.5)",
    "log(a)*log1p(r) - expm1(r)",
)
EACH_FUNCTION = tuple(
    f"{name}({argument})"
    for name in FUNCTIONS
    for argument in (("1 + r", "1/r") if name == "acosh" else ("r", "r**2") if name in ("log", "sqrt") else ("r", "-r"))
)


def numpy_values(formula: Formula) -> np.ndarray:
    return formula(r=R, **GIVEN)


def float_values(formula: Formula) -> list[float]:
    return [formula(r=float(r), **GIVEN) for r in R]


def casadi_values(formula: Formula, kind: type) -> np.ndarray:
    names = {"r": kind.sym("r")} | {name: kind.sym(name) for name in GIVEN}
    function = ca.Function("f", [*names.values()], [ca.densify(kind(formula(**names)))])
    return function(R.reshape(1, -1), *GIVEN.values()).full().ravel()


EVALUATIONS = {
    "numpy": numpy_values,
    "floats": float_values,
    "SX": lambda formula: casadi_values(formula, ca.SX),
    "MX": lambda formula: casadi_values(formula, ca.MX),
}


@pytest.mark.parametrize("kind", EVALUATIONS)
@pytest.mark.parametrize("text", FORMULAS + EACH_FUNCTION)
def test_values_are_those_of_python(text, kind):
    truth = [eval(text.strip(), PYTHON, {"r": float(r), **GIVEN}) for r in R]
    values = np.broadcast_to(EVALUATIONS[kind](parse(text)), R.shape)
    assert values == pytest.approx(truth, rel=1e-14, abs=1e-16)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-3**2", -9),
        ("(-3)**2", 9),
        ("2**-1", 0.5),
        ("2**3**2", 512),
        ("-2**-2", -0.25),
        ("10-4-3", 3),
        ("24/4/3", 2),
        ("24/4*3", 18),
        ("2+3*4", 14),
        ("(2+3)*4", 20),
        ("2*3**2", 18),
        ("2 - -3", 5),
        ("1.5e2", 150),
        (".5", 0.5),
        ("2 * pi", 2 * math.pi),
        (" \t 1 \n + \r 1 ", 2),
    ],
)
def test_precedence_and_numbers(text, value):
    assert float(parse(text)()) == value


def test_arrays_of_any_shape_are_taken_at_once():
    r = np.linspace(0.1, 2, 24).reshape(2, 3, 4)
    values = parse("r + beta*r**3")(r=r, beta=0.3)
    assert values.shape == r.shape
    assert values == pytest.approx(r + 0.3 * r**3, rel=1e-15)
    assert parse("r*k")(r=np.ones((4, 1)), k=np.ones(3)).shape == (4, 3)


@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("sin(1)*x", 2 * math.sin(1)),
        ("2**3 + x", 10),
        ("-1*x", -2),
        ("1/4 + x", 2.25),
        ("a/b*x", 1),
        ("exp(a)*x", None),
    ],
)
def test_a_constant_part_mixes_with_either_kind_of_symbol(text, value, kind):
    x = kind.sym("x")
    expression = parse(text)(x=x, a=2.0, b=4.0)
    assert isinstance(expression, kind)
    assert float(ca.Function("f", [x], [expression])(2.0)) == pytest.approx(value or 2 * math.exp(2), rel=1e-15)


@pytest.mark.parametrize(
    "name", ["self", "text", "tree", "values", "names", "cls", "lambda", "None", "eval", "__class__"]
)
def test_any_name_may_be_a_parameter(name):
    """A name is a key and nothing more, even where Python means something by it."""
    assert parse(f"2*{name}")(**{name: 3.0}) == 6


MISSING = "a number, a name or '(' is missing"
OPERATOR = "an operator is missing before"
NOT_ALLOWED = "is not allowed"

BAD = [
    ("", MISSING),
    ("()", MISSING),
    ("r +", MISSING),
    ("r**", MISSING),
    ("r // 2", MISSING),
    ("sin()", MISSING),
    ("1..2", f"{OPERATOR} '.2'"),
    ("r.5", f"{OPERATOR} '.5'"),
    ("2r", f"{OPERATOR} 'r'"),
    ("r r", f"{OPERATOR} 'r'"),
    ("2(r)", f"{OPERATOR} '('"),
    ("1e", f"{OPERATOR} 'e'"),
    ("0x10", f"{OPERATOR} 'x10'"),
    ("r if r else 1", f"{OPERATOR} 'if'"),
    ("r^2", "write a power as **"),
    ('__import__("os")', NOT_ALLOWED),
    ("__import__(os)", "unknown function '__import__'"),
    ("r.real", "'.' is not allowed"),
    ("r[0]", "'[' is not allowed"),
    ("atan2(r, 1)", "',' is not allowed"),
    ("'r'", NOT_ALLOWED),
    ("lambda r: r", "':' is not allowed"),
    ("r = 1", "'=' is not allowed"),
    ("r; r", "';' is not allowed"),
    ("r % 2", "'%' is not allowed"),
    ("r # note", "'#' is not allowed"),
    ("\\r", NOT_ALLOWED),
    ("(r", "no closing parenthesis"),
    ("r)", f"{OPERATOR} ')'"),
    (")r(", MISSING),
    ("sinn(r)", "did you mean 'sin'?"),
    ("Sqrt(r)", "did you mean 'sqrt'?"),
    ("gamma(r)", "known: exp, expm1"),
    ("r(2)", "unknown function 'r'"),
    ("sin r", "'sin' needs an argument in parentheses"),
    ("1e999", "1e999 is too large"),
    ("9" * 400, "is too large"),
    ("(" * 100 + "r" + ")" * 100, f"nested deeper than {MAX_DEPTH} levels"),
    ("2**" * 100 + "2", f"nested deeper than {MAX_DEPTH} levels"),
    ("sin(" * 100 + "r" + ")" * 100, f"nested deeper than {MAX_DEPTH} levels"),
    ("r" * (MAX_LENGTH + 1), f"{MAX_LENGTH + 1} characters; at most {MAX_LENGTH}"),
    ("(" * 10**6, "1000000 characters"),
    ("+".join(["r"] * (MAX_NODES // 2 + 1)), f"more than {MAX_NODES} operations"),
    ("\u00b2", NOT_ALLOWED),
    ("\u0663", NOT_ALLOWED),
    ("\u03b2*r", NOT_ALLOWED),
    ("r \u2212 1", "character 3"),
    ("\ufeffr", "character 1"),
    ("r +\u00a01", "character 4"),
    ("r\x00", "character 2"),
    ("r\x1b[31m", "character 2"),
    ("r + 1\x7f", "character 6"),
    ("r\ud800", "character 2"),
    (None, "a formula is text, not NoneType"),
    (3, "a formula is text, not int"),
    (b"r", "a formula is text, not bytes"),
    (parse, "a formula is text, not function"),
]


def shown(value) -> str:
    return getattr(value, "__name__", ascii(value)[:40])  # no addresses: they differ between processes


@pytest.mark.parametrize(("text", "fragment"), BAD, ids=shown)
def test_what_is_no_formula_is_an_input_error(text, fragment):
    with pytest.raises(InputError) as error:
        parse(text)
    message = str(error.value)
    assert fragment in message
    assert all(c.isprintable() or c == "\n" for c in message), "a terminal would obey control characters"


@pytest.mark.parametrize("text", ["r + $", "a*b^c", "(1 + r))", "x" * 100 + " $ " + "y" * 100, "r\t+ $"])
def test_the_place_is_marked(text):
    with pytest.raises(InputError) as error:
        parse(text)
    _, line, mark = str(error.value).split("\n")
    assert line[mark.index("^")] in "$^)"


def test_limits_are_inclusive():
    assert parse("r" * MAX_LENGTH).names == {"r" * MAX_LENGTH}
    assert parse("(" * MAX_DEPTH + "r" + ")" * MAX_DEPTH)(r=2.0) == 2
    assert parse("-" * MAX_DEPTH + "r")(r=2.0) == 2


@pytest.mark.parametrize("count", [50, 250, MAX_NODES // 2])
@pytest.mark.parametrize("operator", ["+", "-", "*", "/"])
def test_a_long_chain_evaluates(operator, count):
    """What is within the limits of length and operations has a value: nesting to the left costs nothing."""
    formula = parse(operator.join(["r"] * count))
    truth = {"+": count, "-": 2 - count, "*": 1, "/": 1}[operator]
    assert formula.names == {"r"}
    assert formula(r=1.0) == truth
    r = ca.SX.sym("r")
    assert float(ca.Function("f", [r], [formula(r=r)])(1.0)) == truth


NO_VALUE = [
    ("a/b", {"a": 1.0, "b": 0.0}, math.inf),
    ("a/b", {"a": 0.0, "b": 0.0}, math.nan),
    ("1/0 + a", {"a": 1.0}, math.inf),
    ("a**b", {"a": 0.0, "b": -1.0}, math.inf),
    ("a**b", {"a": -8.0, "b": 1 / 3}, math.nan),
    ("a**400", {"a": 10.0}, math.inf),
    ("1e300*1e300*a", {"a": 1.0}, math.inf),
    ("exp(a)", {"a": 1000.0}, math.inf),
    ("log(a)", {"a": 0.0}, -math.inf),
    ("log(a)", {"a": -1.0}, math.nan),
    ("sqrt(a)", {"a": -1.0}, math.nan),
    ("atanh(a)", {"a": 1.0}, math.inf),
    ("exp(a) - exp(b)", {"a": 1000.0, "b": 2000.0}, math.nan),
]


@pytest.mark.parametrize(("text", "values", "result"), NO_VALUE, ids=shown)
@pytest.mark.parametrize("kind", [float, np.float64, np.atleast_1d, ca.SX, ca.MX])
def test_arithmetic_without_a_value_gives_inf_or_nan(text, values, result, kind):
    """Neither an exception nor a warning, which is an error here."""
    if kind in (ca.SX, ca.MX):
        names = {name: kind.sym(name) for name in values}
        value = ca.Function("f", [*names.values()], [parse(text)(**names)])(*values.values()).full()
    else:
        value = parse(text)(**{name: kind(number) for name, number in values.items()})
    assert not isinstance(value, complex)
    assert float(np.squeeze(value)) == pytest.approx(result, nan_ok=True)


ALPHABET = (
    "0123456789.eE+-*/()rabpix_ " * 2 + "^,\t\n'\"[]{}:;=%&|~!@#$\\<>?`\u00b2\u0663\u00e4\u03b2\x00\x1b\u00a0\ud800"
)
WORDS = [*FUNCTIONS, "pi", "r", "beta", "(", ")"]
WORDS += ["**", "*", "/", "+", "-", " ", "1", "2.5", "1e3", "1e999", "lambda", "."]


def scrambled(rng: random.Random) -> str:
    """A string of random characters or words, or a formula after a few random edits."""
    way = rng.random()
    if way < 0.3:
        return "".join(rng.choices(ALPHABET, k=rng.randrange(25)))
    if way < 0.5:
        return "".join(rng.choices(WORDS, k=rng.randrange(15)))
    text = rng.choice(FORMULAS)
    for _ in range(rng.randrange(1, 5)):
        i, j = sorted((rng.randrange(len(text) + 1), rng.randrange(len(text) + 1)))
        match rng.randrange(4):
            case 0:
                text = text[:i] + text[j:]
            case 1:
                text = text[:i] + rng.choice(ALPHABET) + text[i:]
            case 2:
                text = text[:j] + text[i:j] * rng.choice((1, 1, 1, 300)) + text[j:]
            case 3:
                text = text[:i] + rng.choice(WORDS) + text[j:]
        text = text[: 2 * MAX_LENGTH]
    return text


@pytest.mark.parametrize(("seed", "count"), [(1, 5_000), pytest.param(2, 25_000, marks=pytest.mark.slow)])
def test_random_text_is_a_formula_or_an_input_error(seed, count):
    rng = random.Random(seed)
    values = np.array([0.5, -2.0])
    parsed, messages = 0, []
    for _ in range(count):
        try:
            formula = parse(scrambled(rng))
        except InputError as error:
            messages.append(str(error))
            continue
        assert isinstance(formula, Formula)
        parsed += 1
        if parsed % 20 == 0:
            assert np.shape(formula(**dict.fromkeys(formula.names, values))) in ((), (2,))
    assert all("formula" in message for message in messages)
    assert min(parsed, len(messages)) > count / 5, "the strings are neither all formulas nor all nonsense"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("exec + eval*compile", 7.0),
        ("__import__ - open", -1.0),
        ("os*system", 2.0),
        ("exp(eval)/exp(exec)", math.e),
        ("eval(1)", None),
        ("exec(r)", None),
        ("__import__('os').system('true')", None),
        ("[c for c in ().__class__.__bases__]", None),
        ("f'{exec}'", None),
        ("(lambda: 0)()", None),
    ],
)
def test_nothing_is_executed(text, value, monkeypatch):
    """Names of built-in functions are names like any other."""
    names = {
        "exec": 1.0,
        "eval": 2.0,
        "compile": 3.0,
        "__import__": 1.0,
        "open": 2.0,
        "os": 1.0,
        "system": 2.0,
        "r": 1.0,
    }
    parse("exp(r)/r + 1")(r=1.0)  # what is imported on first use

    def forbidden(*args, **kwargs):
        raise AssertionError("a formula was executed")

    def tree_only(source, filename, mode, flags=0, *args, compiled=compile, **kwargs):
        assert flags & ast.PyCF_ONLY_AST, "a formula was compiled"
        return compiled(source, filename, mode, flags, *args, **kwargs)

    result = None
    with monkeypatch.context() as patch, contextlib.suppress(InputError):
        patch.setattr(os, "system", forbidden)
        patch.setitem(vars(builtins), "compile", tree_only)
        for name in ("eval", "exec", "open", "__import__"):
            patch.setitem(vars(builtins), name, forbidden)
        result = parse(text)(**names)
    assert result == (value if value is None else pytest.approx(value, rel=1e-15))
