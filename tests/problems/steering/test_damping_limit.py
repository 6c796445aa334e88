"""The damping that a message states works, and a little more does not."""

import re

import pytest
from conftest import slow_after

from orbits import NoOrbit
from problems import Hopper, hopper_in_si, steering


@pytest.mark.parametrize(
    "machine",
    slow_after(1, [Hopper(damping=0.8), hopper_in_si(60.0, 3.0, stiffness=8000.0, damping=150.0)]),
    ids=["plain", "in SI"],
)
def test_too_much_damping_is_refused_with_what_works(machine):
    """The stated damping works, and a twentieth more does not."""
    with pytest.raises(NoOrbit, match=r"collapses: .*: damping = .* is too much; take at most damping = ") as found:
        steering.keep_hopping(machine)
    most = float(re.search(r"at most damping = ([\d.]+)", str(found.value))[1])
    assert ("N s/m" in str(found.value)) == bool(machine.units)
    assert steering.keep_hopping(machine.with_values(damping=most)).status == "optimal"
    with pytest.raises(NoOrbit, match="is too much"):
        steering.keep_hopping(machine.with_values(damping=1.06 * most))
