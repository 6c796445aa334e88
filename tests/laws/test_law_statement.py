"""Statements of laws: one law in many forms, and what is refused."""

import casadi as ca
import numpy as np
import pytest

from orbits import InputError, find
from problems import Hopper, Juggler, hopper_in_si
from problems.laws import gravity, springs


@pytest.mark.slow
def test_one_law_five_ways():
    """A formula, a potential, a Python function, a function with a declared breakpoint, and a fine table."""
    r = np.linspace(-6, 3, 200)
    laws = [
        springs.formula("r + beta*r**3", beta=0.3),
        springs.potential("r**2/2 + beta*r**4/4", beta=0.3),
        springs.function(lambda r, beta: r + beta * r**3, beta=0.3),
        springs.function(lambda r, beta: r + beta * r**2 * ca.fabs(r) * ca.sign(r), breakpoints=(0.0,), beta=0.3),
        springs.table((r, r + 0.3 * r**3)),
    ]
    alphas = [find(Hopper(law)).alpha for law in laws]
    assert alphas == pytest.approx([2.936459188494196478] * 5, rel=1e-12)


def test_an_undeclared_kink_is_found_by_the_steps():
    """A bilinear force in one expression, its break unknown to the toolkit, against the declared one."""
    declared = find(Hopper(springs.bilinear(ratio=3.0, gap=0.5)))
    single = springs.function(lambda r: r + 2 * ca.fmax(0, r - 0.5))
    orbit = find(Hopper(single))
    assert orbit.alpha == pytest.approx(declared.alpha, abs=max(orbit.error, 1e-12))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: springs.tanh(b=-1), "b = -1 is out of bounds"),
        (lambda: springs.cubic(beta=float("nan")), "beta = nan"),
        (lambda: springs.formula("r + beta*r**3"), "'beta' without a value"),
        (lambda: springs.formula("r", beta=1.0), "does not use 'beta'"),
        (lambda: springs.function(lambda r: float(r)), "no finite value"),
        (lambda: springs.function(lambda r: r if r > 0 else 2 * r), "without if"),
        (lambda: springs.function(lambda r: {}["rubber"]), "KeyError: 'rubber'"),
        (lambda: springs.formula("r + c*v", c=0.1), "depends on the extension r alone.*damping"),
        (lambda: springs.formula("1/tanh(r/L) - L/r", L=2.0), "0/0 at r = 0; its limit there is about 0,.*table"),
        (lambda: gravity.formula("sin(z)/z"), "0/0 at z = 0; its limit there is about 1,.* without that division$"),
        (
            lambda: springs.function(lambda r, b: 1 / np.tanh(b * r) - 1 / (b * r), b=2.0),
            "0/0 at r = 0; its limit.*table",
        ),
        (lambda: springs.as_spring("r + b*r**3", {"b": 0.1, "c": 1.0}), "no parameter 'c'; known: b"),
        (lambda: springs.as_spring("cubic", {"bta": 0.1}), "no parameter 'bta'; did you mean 'beta'"),
        (lambda: gravity.as_gravity("inverse_square", {"H": 9.0}), "no parameter 'H'; known: R"),
        (lambda: springs.function(lambda r: ca.vertcat(r, r)), "2 values"),
        (lambda: gravity.formula("2 - z"), "must be 1 at z = 0"),
        (lambda: Hopper("cubic", parameters={"bta": 1.0}), "has a parameter 'bta'; did you mean 'beta'"),
        (lambda: Hopper("r", mass_ratio=0), "mass_ratio = 0 is out of bounds"),
        (lambda: Hopper("r", restitution=1.5), "restitution = 1.5"),
        (lambda: Hopper("r", gravity="exp(-z/9)"), "give the rest length"),
        (lambda: Hopper("r*mass_ratio", parameters={"mass_ratio": 2.0}), "machine's own name"),
        (lambda: Hopper(3), "not int"),
    ],
)
def test_bad_laws_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_laws_are_not_mixed_up():
    r = np.linspace(-9, 9, 7)
    for make, message in (
        (lambda: Hopper(gravity.linear(kappa=-1.0)), "is a law of z, not a spring"),
        (lambda: Hopper(gravity=springs.table((r, 1 + 0 * r))), "is a law of r, not gravity"),
        (lambda: Juggler("r", "exp(-z/50)"), "give the rest length"),
        (lambda: hopper_in_si(60, 3, stiffness=8e3).with_values(mass_ratio=0.5), "in SI it follows from the masses"),
        (lambda: springs.table(5), "two sequences"),
        (lambda: springs.table((r, r, r)), "two sequences"),
        (lambda: springs.table(([], [])), "two lists of finite numbers, of the same length and not empty"),
        (lambda: Hopper(parameters=[1]), "mapping of names"),
        (lambda: Hopper(parameters=None), "mapping of names"),
        (lambda: find(object()), "is not a machine"),
    ):
        with pytest.raises(InputError, match=message):
            make()


@pytest.mark.parametrize("text", ["r + log(abs(r))*r/r", "sqrt(r)/r*1e-9"])
def test_what_has_no_limit_at_zero_is_no_removable_division(text):
    """A logarithm, and a pole on one side."""
    law = springs.formula(text)
    assert np.isnan(law(0.0)) or np.isinf(law(0.0))
    with pytest.raises(InputError, match=r"jumps\. At one of its comparisons it has no derivative"):
        springs.formula("1e-3*abs(r)/r")  # a jump, however small


@pytest.mark.parametrize(
    ("law", "parameters", "part"),
    [
        ("0/0", {}, "0/0"),
        ("log(-1)", {}, r"log\(-1\)"),
        ("a/b", {"a": 0.0, "b": 0.0}, "a/b in it has none for a=0.0, b=0.0"),
        ("r + 0/0", {}, "0/0"),
        ("1/0", {}, "1/0"),
        ("r + 1e-6/(r - r)", {}, "1e-6/0"),
        ("r + c*exp(k)", {"c": 1e-9, "k": 710.0}, r"exp\(k\)"),
        ("(r - 1)*sqrt(2*(1 - 3))", {}, r"sqrt\(-4\)"),
    ],
)
def test_a_part_of_a_formula_without_a_value_is_named(law, parameters, part):
    with pytest.raises(InputError, match=f"has no finite value: {part}"):
        Hopper(law, parameters=parameters)
