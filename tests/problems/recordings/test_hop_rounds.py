"""The rounds of a fit: spikes, noise, and a machine that lacks something."""

import numpy as np

import tests.recorded_hops as bench
from problems import recordings
from problems.recordings.hop_rounds import usual
from tests.recorded_hops import NAMES, START, three_hops


def test_a_single_spike_is_not_usual():
    rng, t = np.random.default_rng(0), np.linspace(0, 6, 200)
    values = np.sin(t) + rng.normal(0, 0.01, 200)
    values[[50, 51, 120]] += (0.5, -0.4, 1.0)
    assert np.flatnonzero(~usual(values)).tolist() == [50, 51, 120]
    assert usual(np.where(t < 3, 0.0, 1.0)).all()  # a step is none
    assert usual(values[:5]).all()


def test_a_machine_that_lacks_something_is_told():
    """The leg has a damper, and the machine none."""
    record = bench.record(*three_hops(), ("body height", "foot height"), 0.002)
    found = recordings.fit(START.with_values(damping=0.0), record, ("foot_mass", "k", "b"))
    assert found.lack.startswith("the machine, or a filter of the sensor, does not fit: neighbouring residuals")
    assert "the machine, or a filter of the sensor, does not fit" in str(found)


def test_stated_noise_is_compared_with_the_residuals():
    record = bench.record(*three_hops(), ("body height", "foot height"), 0.01)
    noise = {"body height": 1e-5, "foot height": 4e-4}
    found = recordings.fit(START, record, NAMES, noise=noise)
    assert "times the stated noise" in found.lack
    assert found.noise == noise
