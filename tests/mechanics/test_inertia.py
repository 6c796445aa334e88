"""The inertia of a mechanism: stated as a matrix, in other coordinates, and none."""

import pytest

from orbits import InputError, Mechanism, find
from orbits.mechanics import Mass, Spring


def test_a_mechanism_without_inertia_is_refused():
    with pytest.raises(InputError, match="foot"):
        find(Mechanism(("body", "foot"), [Mass("body", "m1"), Spring("body - foot", "r")], "foot", {"m1": 1.0}))
