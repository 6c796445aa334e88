"""What a motion shows on the channels of a record."""

import numpy as np
import pytest

import tests.recorded_hops as bench
from orbits import simulate
from orbits.units import ACCELERATION, FORCE, LENGTH, SPEED
from problems import Hopper
from problems.recordings import channels_of, observed


def test_a_simulation_shows_what_another_integrator_does():
    times, expected = bench.three_hops()
    run = simulate(bench.START.with_values(**bench.TRUTH), 1.5, hops=3)
    times, channels = times[times < run.end], {name: channels_of(bench.START)[name] for name in expected}
    for name, values in zip(channels, observed(run, channels, times), strict=True):
        size = np.ptp(expected[name])
        np.testing.assert_allclose(values, expected[name][: len(times)], rtol=0, atol=1e-7 * size, err_msg=name)


def test_channels_have_dimensions():
    channels = channels_of(Hopper())
    names = ("foot height", "foot speed", "foot acceleration", "ground force", "spring length")
    assert [channels[name].dimension for name in names] == [LENGTH, SPEED, ACCELERATION, FORCE, LENGTH]
    assert [channels[name].jumps for name in names] == [False, True, True, True, False]


def test_without_a_length_the_spring_shows_its_extension():
    run, t = simulate(Hopper(), 4.5, hops=1), np.array([0.5, 1.0])
    (length,) = observed(run, {"spring length": channels_of(Hopper())["spring length"]}, t)
    states = run(t)
    assert length == pytest.approx(states[:, 0] - states[:, 2])
