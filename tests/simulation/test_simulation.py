"""Simulations: events that graze, energy, rest, accumulating bounces, and what cannot be asked."""

import numpy as np
import pytest
from conftest import grazing_flights

from orbits import InputError, find, simulate
from orbits.flow.zero_crossing import first_zeros
from orbits.simulation.impacts import Impacts
from problems import Hopper, Juggler


def test_no_grazing_pair_is_missed_and_none_is_invented():
    states, lowest, below = (part[:10_000] for part in grazing_flights(12_000, seed=11))
    assert len(states) == 10_000
    impacts = Impacts(Hopper())
    times, rows, _ = first_zeros(impacts.flight, states, impacts.p, impacts.gap, 1e3)
    assert np.isfinite(times).all()
    assert ((times < lowest) == below).all()
    assert np.abs(rows[:, 2]).max() < 1e-13


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


def test_damping_loses_energy_all_the_time():
    machine = Hopper(damping=0.1, drag=0.05)
    run, impacts = simulate(machine, 7.0, time=40.0), Impacts(machine)
    energies = [impacts.energy(x) for x in run(np.linspace(0, run.end, 300))]
    assert (np.diff(energies) < 1e-12).all()


def test_a_lossless_orbit_goes_on():
    orbit = find(Hopper())
    run = simulate(Hopper(), orbit.alpha, hops=30)
    assert run.status == "done"
    assert run.launches == pytest.approx(orbit.alpha, abs=1e-13)
    assert run.end == pytest.approx(30 * orbit.period, rel=1e-5)
    states = run(orbit.period * 0.3)
    assert states == pytest.approx(orbit(orbit.period * 0.3), abs=1e-4)


def test_rest_is_a_result():
    run = simulate(Hopper(), 2.0, hops=5)
    assert run.status == "rests"
    assert [event.kind for event in run.events] == ["landing"]
    longer = simulate(Hopper(), 2.0, time=50.0)
    assert longer.status == "done"
    assert longer.end == 50.0
    assert (longer(np.linspace(20, 50, 50))[:, 2] == 0).all()


def test_it_starts_in_contact_too():
    """At rest it stays; pulled at, it leaves at once; at lift-off it goes as a launch does, and at a landing stays."""
    still = simulate(Hopper(), state=[-1.0, 0.0, 0.0, 0.0], time=5.0)
    assert still.events == ()
    assert still(5.0) == pytest.approx([-1, 0, 0, 0], abs=1e-14)
    pulled = simulate(Hopper(), state=[3.0, 0.0, 0.0, 0.0], time=0.1)
    assert not pulled.in_contact(0.1)
    assert pulled(0.1)[2] > 0
    orbit = find(Hopper())
    one, other = simulate(Hopper(), state=orbit(0.0), hops=1), simulate(Hopper(), orbit.alpha, hops=1)
    assert one.launches[-1] == pytest.approx(other.launches[-1], abs=1e-14)
    landed = simulate(Hopper(), state=[1.0, -orbit.alpha, 0.0, 0.0], hops=1)
    assert landed.end == pytest.approx(orbit.contact_time, rel=1e-12)


def test_a_ball_on_a_rigid_hand_bounces_for_the_geometric_sum():
    """A hand a million times as heavy that stands still under the ball: flights of 2 v e^k."""
    e, height = 0.5, 1.0
    machine = Juggler(mass_ratio=1e6, restitution=e)
    at_rest = -1.0
    run = simulate(machine, state=[at_rest + height, 0.0, at_rest, 0.0], time=20.0)
    speed = np.sqrt(2 * height)
    landing = next(event for event in run.events if event.kind == "landing")
    assert landing.time == pytest.approx(speed + 2 * speed * e / (1 - e), rel=1e-4)


def test_injection_keeps_a_damped_hopper_going():
    assert simulate(Hopper(damping=1e-4), 4.5, hops=50).status == "rests"
    run = simulate(Hopper(damping=1e-4), 4.5, hops=50, inject=0.02)
    assert run.status == "done"
    assert np.ptp(run.launches[-10:]) < 1e-3


def test_a_cap_ends_with_a_status():
    assert simulate(Hopper(mass_ratio=1e3), 3.4, hops=1, cap=10).status == "cap"
    assert simulate(Hopper("r", "1/(1 + z/R)**2", rest_length=5.0, parameters={"R": 5.0}), 9.0, hops=1).status == (
        "carried_off"
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"alpha": 2.0}, "needs hops or a time"),
        ({"alpha": -2.0, "hops": 1}, "above 0"),
        ({"hops": 1}, "give one of them"),
        ({"alpha": 2.0, "state": [1, 2, 3, 4], "hops": 1}, "give one of them"),
        ({"state": [1, 2, 3], "hops": 1}, "is 4 numbers, y1, y1', y2, y2'"),
        ({"state": [1, 2, -3, 4], "hops": 1}, "must be open"),
        ({"alpha": 2.0, "hops": 0}, "hops = 0; it is a number of lift-offs, from 1"),
        ({"alpha": 2.0, "time": -1.0}, "time = -1.0; it is a number above 0"),
    ],
)
def test_what_cannot_be_meant(arguments, words):
    with pytest.raises(InputError, match=words):
        simulate(Hopper(), **arguments)


def test_times_outside_are_refused():
    with pytest.raises(InputError, match="times lie between 0 and"):
        simulate(Hopper(), 4.0, hops=1)(1e3)


def test_a_contact_goes_on_where_its_inputs_change():
    """At rest until the spring becomes four times as stiff, then an oscillation about a quarter of the extension, with
    the frequency of the upper one of two equal masses; and after that with the first stiffness again."""
    machine = Hopper("k*r", parameters={"k": 1.0})
    run = simulate(machine, state=[-1.0, 0.0, 0.0, 0.0], time=2.5, schedule=([1.0, 2.0], {"k": [4.0]}))
    assert run.status == "done"
    assert [leg.phase for leg in run.legs] == ["contact"] * 3
    assert run(0.9) == pytest.approx([-1.0, 0.0, 0.0, 0.0], abs=1e-14)
    stiff, t = np.sqrt(2.0), np.array([0.3, 1.0])
    expected = -0.25 - 0.75 * np.cos(stiff * t)
    assert run(1.0 + t)[:, 0] == pytest.approx(expected, abs=1e-13)
    speed, soft = 0.75 * stiff * np.sin(stiff), np.sqrt(0.5)
    after = -1.0 + (expected[-1] + 1.0) * np.cos(0.4 * soft) + speed / soft * np.sin(0.4 * soft)
    assert run(2.4)[0] == pytest.approx(after, abs=1e-13)


def test_a_contact_ends_where_new_inputs_would_have_it_pull():
    """At the top of its oscillation the spring carries 0.8 of the foot, and four times as much once it is stiffer."""
    top = np.pi / np.sqrt(0.5)
    options = {"time": top + 1.0, "schedule": ([top, top + 2.0], {"k": [4.0]})}
    run = simulate(Hopper("k*r", parameters={"k": 1.0}), state=[-2.8, 0.0, 0.0, 0.0], **options)
    assert [(event.kind, event.time) for event in run.events] == [("lift-off", pytest.approx(top, rel=1e-12))]
    assert run.events[0].after[:2] == pytest.approx([0.8, 0.0], abs=1e-12)
    assert [leg.phase for leg in run.legs] == ["contact", "flight"]
    # The extension goes on about the foot's and the body's common fall, four times as stiff.
    t = np.linspace(0.0, 0.5, 6)
    states = run(top + t)
    assert states[:, 0] - states[:, 2] == pytest.approx(0.8 * np.cos(2.0 * t), abs=1e-12)
    assert states[:, 0] + states[:, 2] == pytest.approx(0.8 - 0.5 * t**2, abs=1e-12)
    assert (states[1:, 2] > 0).all()
