"""A simulated motion: the energy of its legs and events, the distance of its masses, and its times."""

import numpy as np
import pytest

from orbits import InputError, simulate
from orbits.hops import Impacts
from problems import Hopper, Juggler


@pytest.mark.parametrize(
    "machine",
    [
        Hopper(), Hopper("r + 0.1*r**3", rest_length=20.0), Juggler("sinh(0.2*r)/0.2"), Hopper("bilinear"),
        Hopper("r", "1/(1 + z/R)**2", rest_length=20.0, parameters={"R": 80.0}), Hopper(restitution=0.5),
    ],
)  # fmt: skip
def test_energy_is_kept_in_every_leg_and_lost_in_every_impact(machine):
    run, impacts = simulate(machine, 7.0, hops=2), Impacts(machine)
    assert len(run.legs) > 3
    for leg in run.legs:
        times = np.linspace(0, leg.path.times[-1], 40)
        rows = leg.path(times)
        states = rows[:, :4] if leg.phase == "flight" else rows[:, :2] @ impacts.model.embed.T
        energies = np.array([impacts.energy(x) for x in states])
        assert np.ptp(energies) < 1e-12 * np.abs(energies).max()
    for event in run.events:
        after = impacts.energy(event.after)
        assert event.energy - after == pytest.approx(event.loss, abs=1e-11)
        assert event.kind == "lift-off" or event.loss > 0


def test_times_outside_are_refused():
    with pytest.raises(InputError, match="times lie between 0 and"):
        simulate(Hopper(), 4.0, hops=1)(1e3)


def test_masses_that_pass_through_each_other_are_told():
    """The extension of the linear hopper swings with amplitude hypot(1, alpha) about 0."""
    run = simulate(Hopper(rest_length=1.0), 8.0, time=6.0)
    assert run.smallest_separation == pytest.approx(1.0 - np.hypot(1.0, 8.0), rel=1e-13)
    assert run.document()["smallest_separation"] == run.smallest_separation
    assert "the masses pass through each other" in str(run)
    enough = simulate(Hopper(rest_length=20.0), 8.0, hops=1)
    assert enough.smallest_separation > 0
    assert "pass through" not in str(enough)
    assert simulate(Hopper(), 8.0, hops=1).smallest_separation is None
