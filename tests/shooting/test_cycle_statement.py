"""The equations of a whole cycle."""

import numpy as np
from scipy.special import ellipk

from orbits.shooting import parameters_of_cycle, shooting_equations, whole_cycle
from tests.free_machines import duffing


def equations():
    """The equations of the Duffing oscillator, and its parameters at the energy 0.5."""
    machine = duffing()
    names = (*machine.values, *parameters_of_cycle(machine.model.contact.states))
    return shooting_equations(whole_cycle(machine.model), names), np.array([1.0, 0.0, 1.0, 0.5])


def test_a_cycle_of_an_energy_is_a_regular_solution():
    """Amplitude and period from the potential energy and the elliptic integral of the first kind."""
    shooting, p = equations()
    u, evaluation = shooting.newton([0.8, 0.0, 5.0, 0.0], p)
    amplitude = np.sqrt(np.sqrt(3.0) - 1)  # u**2/2 + u**4/4 = 0.5
    period = 4 * ellipk(amplitude**2 / (2 * (1 + amplitude**2))) / np.sqrt(1 + amplitude**2)
    assert np.abs(u - [amplitude, 0, period, 0]).max() < 1e-14
    assert np.linalg.cond(evaluation.jacobian[0]) < 1e3


def test_the_jacobian_is_that_of_the_equations():
    shooting, p = equations()
    u, h = np.array([0.7, 0.1, 4.9, 0.02]), 1e-6
    jacobian = shooting.evaluate(u, p, ("energy",)).jacobian
    for j in range(4):
        ends = [shooting.evaluate(u + s * h * np.eye(4)[j], p).residual for s in (1, -1)]
        assert np.abs((ends[0] - ends[1]) / (2 * h) - jacobian[:, j]).max() < 1e-8
    assert jacobian[:, 4].tolist() == [-1, 0, 0, 0]
