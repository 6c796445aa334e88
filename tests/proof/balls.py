"""Shared by the tests of proofs: closed forms against balls, and small systems and statements."""

import casadi as ca
import mpmath as mp
from flint import arb

from orbits import Arc, Phase, Statement
from orbits.proof.exact import Equations, Numbers
from orbits.proof.programs import BallProgram
from orbits.proof.step import System


def holds(ball, value, error=1e-30):
    """Whether a ball meets a number of mpmath, which is known to an error."""
    return ball.overlaps(arb(mp.nstr(value, 60), error))


def system_of(size, rates):
    """The system whose rates are a function of the list of states."""
    states = [ca.SX.sym(f"x{i}") for i in range(size)]
    values = [ca.SX(rate) for rate in rates(states)]
    jacobian = ca.jacobian(ca.vertcat(*values), ca.vertcat(*states))
    places = zip(jacobian.sparsity().row(), jacobian.sparsity().get_col(), strict=True)
    slopes = [jacobian.nz[i] for i in range(jacobian.nnz())]
    return System(size, BallProgram(states, values), BallProgram(states, slopes), tuple(places))


def equations_of(unknowns, phase, start, duration, conditions, **parameters):
    """The equations of one arc, whose start, duration and conditions are functions as in `Arc`."""
    arc = Arc(phase, start, duration, conditions)
    return Equations(Statement("test", unknowns, (arc,)), Numbers({}, parameters))


OSCILLATOR = Phase("oscillator", ("x", "v"), lambda x, p, q: [x[1], -x[0]])
CLOCK = Phase("clock", ("t",), lambda x, p, q: [1])


def oscillator(conditions):
    """An oscillator that begins at 0 with an unknown speed, for an unknown duration."""
    return equations_of(
        ("speed", "duration"), OSCILLATOR, lambda u, before, p: [0, u["speed"]], lambda u, p: u["duration"], conditions
    )


def algebraic(condition, **parameters):
    """One equation for one unknown w, given as a function of w and the parameters, on a motion that does not matter."""
    return equations_of(
        ("w",), CLOCK, lambda u, before, p: [0], lambda u, p: 1, lambda u, x, p: [condition(u["w"], p)], **parameters
    )
