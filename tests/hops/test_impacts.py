"""Impacts and the contacts that may follow: many together against each alone, and closed forms."""

import numpy as np
import pytest
from conftest import grazing_flights
from many_at_once import MACHINES

from orbits import ReturnMap, simulate
from orbits.flow import first_events
from orbits.hops import Flown, Impacts, hops_of_speeds, stand
from orbits.hops.flyer import Rounding
from orbits.hops.impacts import ImpactOptions
from problems import HeavyHand, Hopper, Juggler


@pytest.mark.parametrize("name", MACHINES)
def test_contacts_to_their_ends(name):
    rules = Impacts(MACHINES[name])
    speeds = np.linspace(0.05, 6, 40)
    standing = np.column_stack([np.full(40, rules.launch(speeds)[0, 0] * 0.9), -speeds])
    hops = Flown.begun(rules, rules.launch(speeds))
    hops.states[:], hops.on_ground[:] = standing @ rules.model.embed.T, True
    stand(rules, hops)
    for start, how, end in zip(standing, hops.status, hops.ends, strict=True):
        path, expected, _ = rules.sustained_contact(start)
        assert how == expected
        if how == "lifts_off":
            assert end == pytest.approx(path.end[:2], rel=1e-9, abs=1e-9)


def test_a_lift_off_on_a_break_is_not_lost():
    """The force vanishes where the law breaks: rounding on either side must not hide the sign's change."""
    rules = Impacts(MACHINES["bilinear where it lifts off"])
    hops = ReturnMap(rules.machine)(np.linspace(0.05, 3, 400))
    assert set(hops.status) <= {"lifts_off", "rests"}
    for alpha, how in list(zip(hops.alpha, hops.status, strict=True))[::40]:
        run = simulate(rules.machine, alpha, hops=2)
        assert (len(run.launches) > 1) == (how == "lifts_off")


@pytest.mark.parametrize("mass_ratio", [0.3, 1.0, 7.0])
@pytest.mark.parametrize("restitution", [0.0, 0.4])
def test_the_gap_is_open_while_no_landing_is_searched(mass_ratio, restitution):
    """On a fine grid in closed form, after lift-offs and after bounces; and most flights are known to be open so."""
    impacts = Impacts(Hopper(mass_ratio=mass_ratio, restitution=restitution))
    states, order = impacts.launch(np.linspace(0.2, 15.0, 40)), 3
    form = impacts.flight.closed_form(impacts.p)
    for _ in range(3):
        until = form.positive_until(impacts.gap, states.T, order)
        assert order < 3 or (until > 0).mean() > 0.8
        for start, end in zip(states, until, strict=True):
            assert not end or impacts.gap(form.state(start, np.linspace(0.0, end, 2001)[20:-1]).T).min() > 0
        limit = impacts.longest_flight(states)
        rows = first_events(impacts.flight, states, impacts.p, impacts.flight_watch, limit, order).rows
        held, after, *_ = impacts.landing(rows)
        states, order = after[~held], impacts.bounce_order
        if not len(states):
            break


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


@pytest.mark.parametrize("mass_ratio", [0.3, 1.0, 7.0])
def test_what_is_known_to_be_positive_is(mass_ratio):
    """Of a flight in closed form: the gap on a fine grid between the times that are left out of the search."""
    machine = Hopper(mass_ratio=mass_ratio)
    impacts = Impacts(machine)
    starts = impacts.launch(np.array([4.0, 30.0, 1000.0]))
    form = impacts.flight.closed_form(impacts.p)
    low, high = form.positive_between(impacts.gap, starts.T)
    for start, a, b in zip(starts, low, high, strict=True):
        assert 0 < a < b
        assert impacts.gap(form.state(start, np.linspace(a, b, 20_001)[1:-1]).T).min() > 0


@pytest.mark.slow
def test_impacts_that_repeat_themselves(monkeypatch):
    """They end a hop as soon as the ball comes back to an earlier state, as the most impacts would."""
    speeds = np.linspace(3.55, 3.7, 3)
    found = ReturnMap(HeavyHand())(speeds)
    monkeypatch.setattr("orbits.hops.flyer.ROUNDING", Rounding(repetition=-1.0))
    all_impacts = ReturnMap(HeavyHand(), cap=1000)(speeds)
    assert found.status.tolist() == all_impacts.status.tolist()
    assert (found.impacts == np.where(found.status == "cap", 10_000, all_impacts.impacts)).all()


@pytest.mark.parametrize(("mass_ratio", "alpha"), [(0.05, 2 * np.pi), (1e-3, 4 * np.pi)])
def test_a_force_that_vanishes_by_rounding_at_a_landing(mass_ratio, alpha):
    """The launch lies on a border of the map, which is continuous there."""
    step = ReturnMap(Hopper(mass_ratio=mass_ratio))
    below, here, above = step(alpha * np.array([1 - 1e-9, 1.0, 1 + 1e-9])).next
    assert [here, here] == pytest.approx([below, above], rel=1e-8)
    run = simulate(Hopper(mass_ratio=mass_ratio), alpha, hops=1)
    assert run.launches[1] == pytest.approx(here, rel=1e-12)


def test_the_times_of_long_contacts():
    """Nearly a whole oscillation of the heavy body, of the period 2 pi/sqrt(M), however long that is."""
    rules = Impacts(Hopper("r + 1e-30*r**3", mass_ratio=1e-6))
    hops = hops_of_speeds(rules, np.array([0.5, 3.0]), 1000)
    stand(rules, hops)
    assert hops.contacts == pytest.approx(2 * np.pi * 1e3, rel=2e-3)
