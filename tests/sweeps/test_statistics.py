"""Sobol's indices and uncertainties against closed forms: a linear hopper's launch speed goes as g/sqrt(k)."""

import numpy as np
import pytest
from scipy.stats import norm

from orbits import InputError, Sweep, find, sweep, uncertainty
from problems import Hopper, hopper_in_si

LEG = hopper_in_si(60.0, 3.0, stiffness=8000.0)


def test_sobols_indices_of_a_product():
    (low, high), (slow, fast) = (1000.0, 9000.0), (4.0, 16.0)
    found = sweep(LEG, {"stiffness": (low, high), "surface_gravity": (slow, fast)}, 16).sensitivity(samples=256)
    # Means of h = k**-1/2 and its square, and of g and its square, over their ranges.
    h, h2 = 2 * (high**0.5 - low**0.5) / (high - low), np.log(high / low) / (high - low)
    g, g2 = (slow + fast) / 2, (fast**3 - slow**3) / 3 / (fast - slow)
    whole = g2 * h2 - (g * h) ** 2
    exact = {"stiffness": (g**2 * (h2 - h**2) / whole, g2 * (h2 - h**2) / whole)}
    exact["surface_gravity"] = (h**2 * (g2 - g**2) / whole, h2 * (g2 - g**2) / whole)
    for name, (first, total) in exact.items():
        index = found["alpha"][name]
        assert index["first"] == pytest.approx(first, abs=0.02)
        assert index["total"] == pytest.approx(total, abs=0.02)
        assert index["first_low"] <= index["first"] <= index["first_high"]


def test_sobols_indices_need_every_member():
    found = sweep(Hopper("cubic", rest_length=30.0), {"beta": (-0.05, 0.05)}, 8)
    with pytest.raises(InputError, match="narrow the ranges"):
        found.sensitivity(["alpha"], samples=16)
    with pytest.raises(InputError, match="power of 2"):
        found.sensitivity(samples=100)


def test_an_uncertain_spring():
    answer = uncertainty(LEG, {"stiffness": norm(8000.0, 240.0)}, ["centre_of_mass_rise"], samples=512)
    alpha = sweep(LEG, {"stiffness": [8000.0]})["alpha"][0]
    # d(alpha)/alpha = -dk/(2k); the height goes as the square, so with -dk/k.
    assert answer.linear["alpha"] == pytest.approx(alpha * 0.015, rel=1e-9)
    assert answer.deviation["alpha"] == pytest.approx(answer.linear["alpha"], rel=0.02)
    rise = answer.mean["centre_of_mass_rise"]
    assert answer.linear["centre_of_mass_rise"] == pytest.approx(0.03 * rise, rel=0.01)
    assert answer.quantiles["alpha"]["50%"] == pytest.approx(alpha, rel=1e-3)
    spread = answer.quantiles["alpha"]["95%"] - answer.quantiles["alpha"]["5%"]
    assert spread == pytest.approx(2 * 1.6449 * answer.deviation["alpha"], rel=0.02)
    assert answer.share == 1.0
    assert "deviation" in str(answer)


def test_uncertainty_of_a_saturating_spring():
    """alpha bends so much over b that the straight line misses its deviation, but not the sample: against Gauss's
    quadrature over the same distribution."""
    machine = Hopper("tanh", parameters={"b": 0.12})
    found = uncertainty(machine, {"b": norm(0.12, 0.02)}, samples=4096)
    nodes, weights = np.polynomial.hermite_e.hermegauss(16)
    alphas = np.array([find(machine.with_values(b=0.12 + 0.02 * node)).alpha for node in nodes])
    mean = weights @ alphas / weights.sum()
    deviation = np.sqrt(weights @ (alphas - mean) ** 2 / weights.sum())
    assert found.mean["alpha"] == pytest.approx(mean, rel=1e-5)
    assert found.deviation["alpha"] == pytest.approx(deviation, rel=2e-3)
    assert found.linear["alpha"] < 0.97 * deviation


def test_members_that_are_no_motions_do_not_count():
    found = uncertainty(Hopper("cubic", rest_length=8.0, parameters={"beta": 0.02}), {"beta": norm(0.02, 0.02)})
    motions = found.sweep["status"] == "certified"
    assert 0 < found.share == motions.mean() < 1
    assert found.mean["alpha"] == pytest.approx(found.sweep["alpha"][motions].mean(), rel=1e-14)


def test_what_uncertainty_refuses():
    machine = Hopper("cubic", parameters={"beta": 0.1})
    for over, options, text in (
        ({"kk": norm(1, 1)}, {}, "no parameter 'kk'"),
        ({"beta": norm(0.1, 0.01)}, {"samples": 1}, "samples = 1"),
    ):
        with pytest.raises(InputError, match=text):
            uncertainty(machine, over, **options)


def test_sobols_indices_are_the_same_again():
    swept = sweep(Hopper("cubic"), {"beta": (0.0, 1.0), "mass_ratio": (0.5, 2.0)}, 16, quantities=["loss_coefficient"])
    first, second = (swept.sensitivity(["loss_coefficient"], 64, seed=3) for _ in range(2))
    assert first == second


def test_one_parameter_alone_has_all_of_the_variance():
    found = sweep(LEG, {"stiffness": (1000.0, 9000.0)}, 4).sensitivity(samples=8)["alpha"]["stiffness"]
    assert found["first"] == found["total"] == 1.0


def test_sobols_indices_of_a_store(tmp_path):
    """Those of the sweep itself, to the last bit, over a range, a list of values and a distribution."""
    over = {"stiffness": (1000.0, 9000.0, "log"), "surface_gravity": [8.0, 9.0], "foot_mass": norm(3.0, 0.1)}
    swept = sweep(LEG, over, 8, sampling="sobol", store=tmp_path / "leg.db")
    again = Sweep.load(tmp_path / "leg.db", machine=LEG)
    assert again.sensitivity(samples=8) == swept.sensitivity(samples=8)
    with pytest.raises(InputError, match=r"Sweep.load\(store, machine=...\)"):
        Sweep.load(tmp_path / "leg.db").sensitivity(samples=8)
