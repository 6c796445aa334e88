"""Uncertainties of a hop against closed forms and quadrature."""

import numpy as np
import pytest
from mechanisms import linear_hops
from scipy.stats import norm

from orbits import InputError, Uncertainty, find_all, sweep, uncertainty
from problems import Chain, Hopper, hopper_in_si

LEG = hopper_in_si(60.0, 3.0, stiffness=8000.0)


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


def test_an_inadmissible_orbit_of_the_machine_itself_is_in_the_first_line(tmp_path):
    """Its masses pass through each other, while those of half the members do not."""
    machine = Hopper("cubic", rest_length=3.2, parameters={"beta": 0.3})
    found = uncertainty(machine, {"beta": norm(0.3, 0.03)}, samples=32)
    assert 0.3 < found.share < 0.6
    assert "orbit is inadmissible: the masses pass through each other" in found.title()
    found.save(tmp_path / "spread.json")
    assert Uncertainty.load(tmp_path / "spread.json").violations == found.violations
    with pytest.raises(InputError, match=r"fewer than two .* orbit is inadmissible: the masses pass"):
        uncertainty(machine.with_values(rest_length=2.0), {"beta": norm(0.3, 0.03)}, samples=8)
    assert uncertainty(machine.with_values(rest_length=3.4), {"beta": norm(0.3, 0.03)}, samples=8).violations == ()


def test_what_uncertainty_refuses():
    machine = Hopper("cubic", parameters={"beta": 0.1})
    for over, options, text in (
        ({"kk": norm(1, 1)}, {}, "no parameter 'kk'"),
        ({"beta": norm(0.1, 0.01)}, {"samples": 1}, "samples = 1"),
    ):
        with pytest.raises(InputError, match=text):
            uncertainty(machine, over, **options)


def test_a_chain_of_uncertain_masses():
    """Small deviations are those that the exact slopes predict, and the half times those of the closed form."""
    chain = Chain()
    hop = find_all(chain, chain.starts(4, 5))[0]
    spread = uncertainty(chain, {"m1": norm(1, 1e-3), "m2": norm(1, 2e-3)}, "stroke", start=hop, samples=128)
    assert spread.share == 1.0
    for name, deviation in spread.deviation.items():
        assert deviation == pytest.approx(spread.linear[name], rel=0.02), name
    member = chain.with_values(m1=float(spread.sweep["m1"][5]), m2=float(spread.sweep["m2"][5])).stated()
    times = [each.half_flight for each in linear_hops(*member.linear_equations(), member.gap_weights, 4, 5)]
    assert np.abs(np.array(times) - spread.sweep["flight_time"][5] / 2).min() < 1e-9
    with pytest.raises(InputError, match="give an orbit of it"):
        uncertainty(chain, {"m1": norm(1, 1e-3)})
