"""First guesses: where a machine rests in contact, and swings that grow from there."""

import numpy as np
import pytest

from orbits import NoOrbit, find
from problems import Actuated, Actuator, Chain, Hopper, springs
from problems.steering.first_guesses import contact_time_of, growing_swings, lossless_guess, rest_in_contact


def test_rest_is_where_the_springs_carry_the_weights():
    hopper = Hopper("r + 0.1*r**3", mass_ratio=0.5)
    found = rest_in_contact(Actuated(hopper), find(hopper))
    assert found["y1"] + 0.1 * found["y1"] ** 3 == pytest.approx(-2.0, abs=1e-12)  # the body weighs twice as much
    chain = Chain((1.0, 1.0, 1.0))
    hop = find(chain, start=chain.start([-17.3, -11.0], half_contact=3.1, half_flight=4.49))
    found = rest_in_contact(Actuated(chain, Actuator("y2 - y3")), hop)
    assert found == {"y1": pytest.approx(-3.0, abs=1e-12), "y2": pytest.approx(-2.0, abs=1e-12)}


def test_swings_begin_at_rest_and_reach_the_lowest_place():
    driven, orbit = Actuated(Hopper()), find(Hopper())
    flight, contact = lossless_guess(driven, orbit)
    assert flight.states(0.0) == pytest.approx([1, orbit.alpha, 0, 0, 0], abs=1e-12)
    lowest = contact.states(contact_time_of(orbit) / 2)[0]
    swings = growing_swings(driven, orbit, {"y1": -1.0}, 2)
    ends = [swing.states(swing.duration)[0] for swing in swings]
    assert swings[0].states(0.0) == pytest.approx([-1.0, 0, 0], abs=1e-12)
    assert ends == pytest.approx(-1 + np.array([-1, 2, -3, 4]) / 3 * (-1 - lowest), abs=1e-9)


def test_a_contact_that_does_not_end_is_refused_with_the_reason():
    rows = springs.table(([-5.5, -2.0, 0.0, 2.0, 6.0], [-5.5, -2.0, 0.0, 2.0, 6.0]), noise=0)
    with pytest.raises(
        NoOrbit, match=r"contact does not end: .* leaves the law's range, \[-5.5, 6\].*; change the machine"
    ):
        contact_time_of(find(Hopper(rows)))
