"""Sobol's indices against closed forms: a linear hopper's launch speed goes as g/sqrt(k)."""

import numpy as np
import pytest

from orbits import InputError, sweep
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


def test_sobols_indices_are_the_same_again():
    swept = sweep(Hopper("cubic"), {"beta": (0.0, 1.0), "mass_ratio": (0.5, 2.0)}, 16, quantities=["loss_coefficient"])
    first, second = (swept.sensitivity(["loss_coefficient"], 64, seed=3) for _ in range(2))
    assert first == second


def test_one_parameter_alone_has_all_of_the_variance():
    found = sweep(LEG, {"stiffness": (1000.0, 9000.0)}, 4).sensitivity(samples=8)["alpha"]["stiffness"]
    assert found["first"] == found["total"] == 1.0
