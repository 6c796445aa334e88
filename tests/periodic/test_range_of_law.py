"""The range that an orbit needs of a measured law: that of the orbit of the same law measured farther."""

import re

import numpy as np
import pytest

from orbits import NoOrbit, find
from problems import Hopper, hopper_in_si, springs

WHOLE = find(hopper_in_si(60.0, 3.0, stiffness=8000.0, rest_length=0.8))
EXTENSIONS = WHOLE(np.linspace(0, WHOLE.period, 2001)) @ np.array([1.0, 0.0, -1.0, 0.0])


def straight(low: float, high: float, **options):
    """The hopper with a table of rows of its straight spring."""
    r = np.linspace(low, high, 41)
    return hopper_in_si(60.0, 3.0, force=springs.table((r, 8000.0 * r), in_si=True, noise=0), rest_length=0.8)


def needed(reason: str) -> list[float]:
    found = re.search(r"an orbit needs about \[(.*) m, (.*) m\]$", reason)
    assert found, reason
    return [float(each) for each in found.groups()]


def test_a_contact_that_leaves_the_table_states_the_range_of_the_orbit():
    orbit = find(straight(-0.02, 0.02))
    (violation,) = orbit.violations
    assert "leaves the law's range, [-0.02 m, 0.02 m]" in violation
    assert needed(violation) == pytest.approx([EXTENSIONS.min(), EXTENSIONS.max()], rel=5e-3)  # three digits
    assert orbit.contact_time is None


def test_rows_in_compression_alone_say_which_side_is_missing():
    with pytest.raises(
        NoOrbit, match="in compression alone, but the spring lifts the foot in tension: measure"
    ) as raised:
        find(straight(-0.3, 0.0))
    assert needed(str(raised.value)) == pytest.approx([EXTENSIONS.min(), EXTENSIONS.max()], rel=5e-3)


def test_a_law_without_an_orbit_needs_no_range():
    r = np.linspace(-5.0, 5.0, 101)  # the force is constant at both ends
    with pytest.raises(NoOrbit) as raised:
        find(Hopper(springs.table((r, np.clip(r, -0.9, 0.9)), noise=0)))
    assert "an orbit needs" not in str(raised.value)
