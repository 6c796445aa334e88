"""The inertia of a mechanism: stated as a matrix, in other coordinates, and none."""

import pytest
from mechanisms import VALUES, leg, same

from orbits import InputError, Mechanism, find
from orbits.mechanics import Mass, Spring, Weight


class TestTheSameMachine:
    def test_with_its_inertia_as_a_matrix(self):
        weights = [Weight("body", "m1"), Weight("foot", "m2"), Spring("body - foot", "k*r")]
        for inertia in ({"body": "m1", "foot": "m2"}, [["m1", 0], [0, "m2"]]):
            stated = Mechanism(("body", "foot"), weights, "foot", parameters=VALUES, inertia=inertia)
            same(find(stated), find(leg(Spring("body - foot", "k*r"))))

    def test_in_other_coordinates(self):
        """The leg's length in place of the body's height: its inertia is then no diagonal matrix."""
        length = Mechanism(
            ("length", "foot"), [Mass("foot + length", "m1"), Mass("foot", "m2"), Spring("length", "k*r")], "foot",
            parameters=VALUES,
        )  # fmt: skip
        same(find(length), find(leg(Spring("body - foot", "k*r"))))


def test_a_mechanism_without_inertia_is_refused():
    with pytest.raises(InputError, match="foot"):
        find(Mechanism(("body", "foot"), [Mass("body", "m1"), Spring("body - foot", "r")], "foot", {"m1": 1.0}))
