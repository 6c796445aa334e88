"""Simulations: lossless hops that go on, damping, rest, accumulating bounces, and what cannot be asked."""

import numpy as np
import pytest
from columns import column, hop_of

from orbits import InputError, find, simulate
from problems import Hopper, hopper_in_si


@pytest.mark.parametrize("kind", ["hopper", "leg", "column"])
def test_it_starts_from_an_orbit(kind, tmp_path):
    machine, orbit = hop_of("column") if kind == "column" else (None, None)
    if machine is None:
        machine = Hopper("cubic", parameters={"beta": 0.3}) if kind == "hopper" else hopper_in_si(60, 3, stiffness=8e3)
        orbit = find(machine)
    orbit.save(tmp_path / "hop.json")
    for start in (orbit, tmp_path / "hop.json"):
        run, t = simulate(machine, start, hops=1), 0.3 * orbit.flight_time
        assert run(t) == pytest.approx(orbit(t), rel=1e-11, abs=1e-11)


def test_it_starts_from_an_orbit_of_another_machine():
    """A damper moves the extension at lift-off, r + c r' = 1, as the launch of the damped machine has it."""
    _, orbit = hop_of("column")
    first = simulate(column("r", 0.02), orbit, hops=1)(0.0)
    assert first == pytest.approx([*orbit(0.0)[:2], 1 - 0.02 * orbit.alpha, orbit.alpha, 0, 0], abs=1e-12)
    with pytest.raises(InputError, match="of another machine, with the states"):
        simulate(Hopper(), orbit, hops=1)


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


def test_a_simulation_goes_on_from_the_state_after_an_impact():
    machine = Hopper(restitution=0.3)
    whole = simulate(machine, 4.6, hops=1)
    first, *later = whole.events
    rest = simulate(machine, state=whole(first.time), hops=1)
    assert [event.kind for event in rest.events] == [event.kind for event in later]
    assert [first.time + event.time for event in rest.events] == pytest.approx([event.time for event in later])
    with pytest.raises(InputError, match="must be open; give the state after the impact"):
        simulate(machine, state=first.before, hops=1)


@pytest.mark.slow
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
        ({"state": [1, 2, 3], "hops": 1}, "4 numbers, y1, y1', y2, y2'"),
        ({"state": [1, 2, -3, 4], "hops": 1}, "must be open"),
        ({"state": find(Hopper()), "hops": 1}, "begins with the orbit's launch"),
        ({"alpha": 2.0, "hops": 0}, "hops = 0; it must be a number of lift-offs, at least 1"),
        ({"alpha": 2.0, "time": -1.0}, "time = -1.0; it must be a number above 0"),
    ],
)
def test_what_cannot_be_meant(arguments, words):
    with pytest.raises(InputError, match=words):
        simulate(Hopper(), **arguments)


@pytest.mark.parametrize(
    ("law", "b", "restitution", "gap"), [("k*r + b*r**3", 0.2, 0.3, 1e-17), ("k*r", 0.0, 0.6, 1e-16)]
)
def test_a_flight_as_short_as_rounding(law, b, restitution, gap):
    """It is a straight line, and the same motion follows as from the ground."""
    machine = Hopper(law, mass_ratio=0.7, restitution=restitution, parameters={"k": 1.0, **({"b": b} if b else {})})
    short, none = (simulate(machine, state=[-2.9, -2.5, start, -0.5], time=3.0) for start in (gap, 1e-13))
    assert short.status == none.status == "done"
    assert short(3.0) == pytest.approx(none(3.0), rel=1e-10, abs=1e-10)
    assert {type(event.time) for event in short.events} == {float}
