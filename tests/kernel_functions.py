"""Shared by the tests of kernels: functions that they iterate, and whether two results are equal to the last bit."""

import casadi as ca
import numpy as np

from orbits.symbolic import Kernel


def once(arguments: list, results: list) -> ca.Function:
    """A function of one step that is recorded, as a kernel iterates it."""
    z = ca.vertcat(*arguments)
    return ca.Function("once", [z], [z, ca.vertcat(*results), 1, 0])


def both(function: ca.Function, *arguments) -> tuple:
    """What a kernel makes of it in machine code, and interpreted."""
    compiled, interpreted = Kernel(function), Kernel(function)
    assert compiled.compile()
    interpreted.interpretation_budget = np.inf
    found = compiled(*arguments), interpreted(*arguments)
    assert not interpreted.compiled
    return found


def assert_equal(one, other):
    """Both are the same to the last bit, and zeros have the same sign."""
    assert (one.counts == other.counts).all()
    assert (one.going == other.going).all()
    for mine, theirs in zip([one.z, *one.records], [other.z, *other.records], strict=True):
        assert np.array_equal(mine, theirs, equal_nan=True)
        signed = ~np.isnan(mine)
        assert (np.signbit(mine) == np.signbit(theirs))[signed].all()


def countdown() -> ca.Function:
    """Adds up the halves of a number, as often as the second entry says, and records every other sum."""
    z, step = ca.SX.sym("z", 3), ca.SX.sym("step")
    after = ca.vertcat(z[0] + step * z[2], z[1] - 1, z[2] / 2)
    return ca.Function("countdown", [z, step], [after, ca.vertcat(after, z), step, ca.fmod(z[1], 2) == 0, after[1] > 0])


def starts(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([np.zeros(count), rng.integers(1, 90, count), rng.normal(size=count)])
