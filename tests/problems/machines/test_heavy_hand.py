"""The infinitely heavy hand: what stays of the map, and bouncing against Schaal and Atkeson's bound."""

import numpy as np
import pytest
from conftest import slow_after

from orbits import InputError, ReturnMap, find, follow, sensitivities, simulate
from orbits.model import free_parameters
from problems import HeavyHand, Juggler


def test_launches_come_back_or_bounce_for_ever():
    alpha = np.array([2.0, 3.1, 3.2, 3.55, 3.8, 4.4, 4.6, 9.0])
    hops = ReturnMap(HeavyHand(), cap=50)(alpha)
    assert hops.status.tolist() == ["lifts_off"] * 2 + ["cap"] * 2 + ["lifts_off"] * 4
    np.testing.assert_array_equal(hops.next, np.where(hops.status == "cap", np.nan, alpha))


@pytest.mark.parametrize("alpha", slow_after(1, [3.2, 3.4, 3.55, 3.65]))
def test_period_one_bouncing_is_stable_up_to_the_bound(alpha):
    """A deviation is multiplied by 1 + w'' at each bounce, w'' the hand's acceleration when its speed is pi."""
    run = simulate(HeavyHand(), alpha, hops=1, cap=400)
    speeds = np.array([event.after[3] for event in run.events])
    assert run.status == "cap"
    if alpha < np.sqrt(np.pi**2 + 3):
        assert speeds[-1] == pytest.approx(np.pi, abs=1e-6)
        off = np.abs(speeds - np.pi)
        n = np.flatnonzero(off > 1e-7)[-1]
        factor = 1 - np.sqrt(1 + alpha**2 - np.pi**2)
        assert (speeds[n] - np.pi) / (speeds[n - 1] - np.pi) == pytest.approx(factor, rel=1e-3)
    else:
        assert speeds[-1] == pytest.approx(speeds[-3], abs=1e-9)
        assert abs(speeds[-1] - speeds[-2]) > 0.5


def test_is_the_limit_of_heavy_jugglers():
    alpha = np.array([3.1, 3.9, 5.0, 8.0])
    limit = ReturnMap(HeavyHand())(alpha)
    gaps = [np.abs(ReturnMap(Juggler(mass_ratio=M))(alpha).next - limit.next).max() for M in (1e4, 1e5)]
    assert gaps[0] / gaps[1] == pytest.approx(10, rel=1e-2)
    assert find(HeavyHand()).alpha == find(Juggler()).alpha


def test_only_what_may_vary_is_offered():
    """The launch speed does not depend on the masses, and so its slopes are the juggler's."""
    hand, juggler = HeavyHand("cubic", parameters={"beta": 0.3}), Juggler("cubic", parameters={"beta": 0.3})
    assert free_parameters(hand) == ["beta"]
    slopes = sensitivities(hand, quantities="alpha")["alpha"]
    assert slopes == {"beta": pytest.approx(sensitivities(juggler, 1, "beta", "alpha")["alpha"]["beta"], rel=1e-12)}
    for refused in (lambda: follow(hand, "mass_ratio", 2.0), lambda: sensitivities(hand, 1, "mass_ratio")):
        with pytest.raises(InputError, match="no parameter 'mass_ratio' to follow; it has beta"):
            refused()
