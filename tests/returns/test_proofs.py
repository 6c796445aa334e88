"""What no theorem about a return map is about."""

import pytest

from orbits import InputError, NoOrbit, ReturnMap, prove_fixed_point
from orbits.returns import ReturningHops
from problems import Chain, Hopper


@pytest.mark.parametrize(
    ("machine", "inject", "message"),
    [
        (Hopper(restitution=0.2), "0.03", "restitution = 0.2"),
        (Hopper(damping=0.01), "0.03", "friction"),
        (Chain(), "0.03", "has several numbers"),
        (Hopper(), "0", "above 0"),
        (Hopper(), ("0.03", "0.02"), "low must not be above high"),
        (Hopper("inject*r", parameters={"inject": 1.0}), "0.03", "name"),
    ],
)
def test_what_no_theorem_is_about(machine, inject, message):
    with pytest.raises(InputError, match=message):
        prove_fixed_point(machine, 4.5188, inject)


def test_a_guess_far_from_any_fixed_point():
    with pytest.raises(NoOrbit, match="no fixed point near"):
        prove_fixed_point(Hopper(), 2.0, "0.03")
    for found in (ReturnMap(Hopper()).fixed_points(4, 5), ReturnMap(Hopper()).periodic_hops(1, 4, 5)):
        with pytest.raises(InputError, match="lossless orbit"):
            prove_fixed_point(Hopper(), found[0], "0.03")
    with pytest.raises(NoOrbit, match="does not come back"):
        prove_fixed_point(Hopper(), ReturningHops.of_speeds((1e-9, 4.5), -2.0), "0.03")
