"""Impacts and the contacts that may follow: many together against each alone, and closed forms."""

import numpy as np
import pytest
from conftest import grazing_flights
from many_at_once import MACHINES

from orbits import ReturnMap, simulate
from orbits.flow import first_events
from orbits.hops import Impacts
from orbits.hops.impacts import ImpactOptions
from problems import Hopper, Juggler


def test_a_lift_off_on_a_break_is_not_lost():
    """The force vanishes where the law breaks: rounding on either side must not hide the sign's change."""
    rules = Impacts(MACHINES["bilinear where it lifts off"])
    hops = ReturnMap(rules.machine)(np.linspace(0.05, 3, 400))
    assert set(hops.status) <= {"lifts_off", "rests"}
    for alpha, how in list(zip(hops.alpha, hops.status, strict=True))[::40]:
        run = simulate(rules.machine, alpha, hops=2)
        assert (len(run.launches) > 1) == (how == "lifts_off")


class TestRestitution:
    @pytest.mark.parametrize("e", [0.9, 0.99, 0.999])
    def test_a_ball_on_a_rigid_hand(self, e):
        """A hand beyond measure heavy that stands still under the ball: flights of 2 v e^k, summed in time."""
        machine = Juggler(mass_ratio=1e11, restitution=e)
        run = simulate(machine, state=[-0.9, 0.0, -1.0, 0.0], time=2000.0)
        speed = np.sqrt(0.2)
        landing = next(event for event in run.events if event.kind == "landing")
        assert landing.time == pytest.approx(speed + 2 * speed * e / (1 - e), rel=1e-8)
        assert sum(event.loss for event in run.events) == pytest.approx(0.1, rel=1e-8)

    def test_without_loss_nothing_is_ever_summed(self):
        run = simulate(Hopper(restitution=1.0), 4.6, hops=1, cap=300)
        assert run.status == "cap"
        assert ReturnMap(Hopper(restitution=1.0), cap=300)(4.6).status == "cap"
        energies = [event.energy for event in run.events]
        assert np.ptp(energies) < 1e-11 * energies[0]

    @pytest.mark.parametrize("e", [0.5, 0.9])
    def test_the_sum_is_that_of_ever_smaller_bounces(self, e, monkeypatch):
        """Summed a thousand times later, the next launch is the same."""
        machine, alpha = Hopper(restitution=e), np.array([4.6, 5.3, 7.7])
        step = ReturnMap(machine)
        early = step(alpha)
        monkeypatch.setattr(step, "impacts", Impacts(machine, options=ImpactOptions(summed_change=1e-11)))
        late = step(alpha)
        assert (late.impacts > early.impacts).all()
        assert late.next == pytest.approx(early.next, rel=1e-12, nan_ok=True)


def test_no_grazing_pair_is_missed_and_none_is_invented():
    states, lowest, below = (part[:10_000] for part in grazing_flights(12_000, seed=11))
    assert len(states) == 10_000
    impacts = Impacts(Hopper())
    times, _, rows, _ = first_events(impacts.flight, states, impacts.p, impacts.flight_watch, 1e3)
    assert np.isfinite(times).all()
    assert ((times < lowest) == below).all()
    assert np.abs(rows[:, 2]).max() < 1e-13


@pytest.mark.parametrize(("mass_ratio", "alpha"), [(0.05, 2 * np.pi), (1e-3, 4 * np.pi)])
def test_a_force_that_vanishes_by_rounding_at_a_landing(mass_ratio, alpha):
    """The launch lies on a border of the map, which is continuous there."""
    step = ReturnMap(Hopper(mass_ratio=mass_ratio))
    below, here, above = step(alpha * np.array([1 - 1e-9, 1.0, 1 + 1e-9])).next
    assert [here, here] == pytest.approx([below, above], rel=1e-8)
    run = simulate(Hopper(mass_ratio=mass_ratio), alpha, hops=1)
    assert run.launches[1] == pytest.approx(here, rel=1e-12)
