"""Mechanisms that are not linear have no linear equations."""

import pytest
from mechanisms import leg

from orbits import InputError
from orbits.mechanics import Damper, Spring


@pytest.mark.parametrize(
    "change",
    [
        lambda: leg(Spring("body - foot", "k*r"), Damper("body - foot", 0.1)),
        lambda: leg(Spring("body - foot", "k*r"), gravity="1 - 0.001*z"),
        lambda: leg(Spring("body - foot", "k*r**3")),
    ],
)
def test_linear_equations_of_what_is_not_linear(change):
    with pytest.raises(InputError, match=r"is not linear: that takes straight springs.*constant gravity"):
        change().linear_equations()
