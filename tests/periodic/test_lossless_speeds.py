"""All lossless hops of a machine in a range of launch speeds, those of families that fold too."""

import numpy as np
import pytest

from orbits import NoOrbit, ReturnMap, find
from problems import Hopper, Juggler


@pytest.mark.parametrize(
    ("machine", "low", "high"),
    [
        (Hopper("cubic", mass_ratio=10.0, parameters={"beta": -0.0104}), 4.0, 7.0),
        (Hopper("r + 0.1*r**3"), 1.0, 9.0),
        pytest.param(Juggler("tanh(0.15*r)/0.15"), 1.0, 9.0, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_every_lossless_hop_under_constant_gravity(machine, low, high):
    """Beside those of `find` the upper ones of a family that folds; a hop from each comes back."""
    step = ReturnMap(machine)
    found = np.array([point.alpha for point in step.fixed_points(low, high)])
    np.testing.assert_allclose(step(found).next, found, rtol=1e-13)
    lowest = []
    for family in range(1, 8):
        try:
            orbit = find(machine, family)
        except NoOrbit:
            continue
        if low <= orbit.alpha <= high and orbit.admissible:
            lowest.append(orbit.alpha)
    for alpha in lowest:
        assert np.abs(found - alpha).min() < 1e-13 * alpha
    if machine.mass_ratio == 10:
        assert found[1] == pytest.approx(6.254359638621062, rel=1e-13)


def test_under_varying_gravity_the_orbits_of_find():
    machine = Hopper("r", "1/(1 + z/R)**2", rest_length=12.0, parameters={"R": 200.0})
    found = ReturnMap(machine).fixed_points(1.0, 9.0)
    assert [point.alpha for point in found] == pytest.approx([find(machine, n).alpha for n in (1, 2)], rel=1e-14)
