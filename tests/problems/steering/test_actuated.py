"""A machine whose spring's end is moved: its energy changes by the actuator's work."""

import numpy as np
import pytest
from scipy.integrate import trapezoid

from orbits import InputError, simulate
from orbits.simulation.impacts import Impacts
from problems import Actuated, Hopper


def test_driven_energy_and_schedules():
    """Energy changes by the actuator's work, whatever the schedule; a schedule is what it is checked to be."""
    machine = Actuated(Hopper())
    times, rates = np.linspace(0, 6, 13), np.random.default_rng(3).uniform(-0.2, 0.2, 12)
    run = simulate(machine, 5.0, time=6.0, schedule=(times, {"w": rates}))
    done = 0.0
    for i, rate in enumerate(rates):
        t = np.linspace(times[i], times[i + 1], 4001)
        states = run(t)
        done -= rate * trapezoid(states[:, 0] - states[:, 2] - states[:, 4], t)
    impacts = Impacts(machine)
    assert impacts.energy(run(6.0)) - impacts.energy(run(0.0)) == pytest.approx(done, abs=1e-6)
    for schedule, words in (
        ((times, {"v": rates}), "no parameter 'v'"),
        ((times[::-1], {"w": rates}), "finite and rise"),
        ((times, {"w": rates[1:]}), "11 values between 13 times"),
    ):
        with pytest.raises(InputError, match=words):
            simulate(machine, 5.0, time=6.0, schedule=schedule)
