"""Shared by the tests of proofs: closed forms against balls, functions of expressions, and small systems."""

from fractions import Fraction
from functools import partial
from types import SimpleNamespace

import mpmath as mp
from flint import arb

from orbits.balls import Equations, IntervalParameters, equations
from orbits.exact import ExactArc, ExactStatement, exact_bounds, parameter_of
from orbits.symbolic import SMOOTH_FUNCTIONS, call, expression, symbol
from orbits.symbolic.tree import power as power_of

# Functions of expressions by name.
fn = SimpleNamespace(**{name: partial(call, name) for name in SMOOTH_FUNCTIONS})


def power(x, exponent):
    """A power of an expression or a number, whose exponent is one too."""
    return power_of(expression(x), expression(exponent))


def holds(ball, value, error=1e-30):
    """Whether a ball meets a number of mpmath, which is known to an error."""
    return ball.overlaps(arb(mp.nstr(value, 60), error))


def system_of(size, rates):
    """The system whose rates are a function of the list of states."""
    states = [symbol(f"x{i}") for i in range(size)]
    return equations.system_of(states, [expression(rate) for rate in rates(states)])


def equations_of(unknowns, states, rates, start, duration, conditions, **parameters):
    """The equations of one arc of these states, from functions of states, unknowns and parameters by name."""
    bounds = {name: exact_bounds(name, value) for name, value in parameters.items()}
    p = {name: parameter_of(name, *ends) for name, ends in bounds.items()}
    u, x = {name: symbol(f"unknown {name}") for name in unknowns}, [symbol(name) for name in states]

    def all_of(values):
        return [expression(each) for each in values]

    arc = ExactArc(
        x,
        [all_of(rates(x, p))],
        all_of(start(u, p)),
        expression(duration(u, p)),
        [[]],
        all_of(conditions(u, x, p)),
        [[]],
    )
    return Equations(ExactStatement(u, (arc,)), IntervalParameters(bounds))


def clock_of(unknowns, start, duration, conditions, **parameters):
    """The equations of a motion whose one state is the time."""
    return equations_of(unknowns, ("t",), lambda x, p: [1], start, duration, conditions, **parameters)


def oscillator(conditions):
    """An oscillator that begins at 0 with an unknown speed, for an unknown duration."""
    return equations_of(
        ("speed", "duration"), ("x", "v"), lambda x, p: [x[1], -x[0]], lambda u, p: [0, u["speed"]],
        lambda u, p: u["duration"], conditions,
    )  # fmt: skip


def algebraic(condition, **parameters):
    """One equation for one unknown w, as a function of w and the parameters, on a motion that does not matter."""
    return clock_of(("w",), lambda u, p: [0], lambda u, p: 1, lambda u, x, p: [condition(u["w"], p)], **parameters)


THREE_HALVES = Fraction(3, 2)
