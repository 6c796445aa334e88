"""Ways of the parameters on which orbits of other families are near, against closed forms and a search."""

import numpy as np
import pytest
from conftest import slow_after
from hanging import quadratic_lateness

from orbits import find
from orbits.periodic import continued_orbits
from problems import Hopper


def liftoff(c):
    """The extension at which the spring r + c*r**2 has the force of the weight."""
    return (np.sqrt(1 + 4 * c) - 1) / (2 * c)


@pytest.mark.parametrize(("c", "alpha"), slow_after(1, [(-0.022, 26.223545859854912), (-0.06, 9.528841981579683)]))
def test_flights_that_hang_stay_in_their_family(c, alpha):
    """Flights that stay near the barrier of a quadratic spring, on which small changes grow up to 1e12-fold: each
    launch speed is that of elliptic integrals up to its error. Without nodes other families were mistaken for this."""
    machine = Hopper("r + c*r**2", parameters={"c": c})
    start = find(machine, start={"liftoff": liftoff(c), "alpha": alpha, "duration": alpha})
    values = [-0.07, -0.04, -0.024, -0.018]
    for one, orbit in zip(
        values, continued_orbits(machine, start, [machine.with_values(c=v) for v in values]), strict=True
    ):
        assert orbit.family == 1
        assert orbit.error < 1e-12
        early, late = (quadratic_lateness(one, orbit.alpha + side * orbit.error) for side in (-1, 1))
        assert early * late < 0


@pytest.mark.parametrize(
    ("family", "values"), slow_after(2, [(6, (0.02, 0.1425, 0.265)), (20, (0.4723751598189375,)), (70, (0.03,))])
)
def test_long_flights_stay_in_their_family(family, values):
    """From a linear spring to hardening ones, whose families are guessed by quadrature. The second one is such that the
    tangent at the start leads to within 4e-4 of an orbit of family 18, which has another tangent; of the last one the
    motions take more integration steps than those of one call."""
    machine = Hopper("cubic", parameters={"beta": 0.0})
    machines = [machine.with_values(beta=beta) for beta in values]
    for one, orbit in zip(machines, continued_orbits(machine, find(machine, family), machines), strict=True):
        assert orbit.family == family
        assert orbit.alpha == pytest.approx(find(one, family).alpha, rel=1e-12)
