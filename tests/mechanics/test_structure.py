"""A mechanism without its numbers has one model."""

from mechanisms import VALUES, leg

from orbits.mechanics import Spring


def test_numbers_share_a_model():
    machine = leg(Spring("body - foot", "k*r"))
    assert machine.with_values(k=4.0).model is machine.model
    assert leg(Spring("body - foot", "k*r"), parameters={**VALUES, "m1": 1.0}).model is machine.model
