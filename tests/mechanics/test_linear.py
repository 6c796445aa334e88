"""Mechanisms that are not linear have no linear equations."""

import numpy as np
import pytest
from mechanisms import leg

from orbits import InputError
from orbits.flow import flow_of
from orbits.mechanics import Damper, Potential, Spring


@pytest.mark.parametrize(
    "change",
    [
        lambda: leg(Spring("body - foot", "k*r"), Damper("body - foot", 0.1)),
        lambda: leg(Spring("body - foot", "k*r"), gravity="1 - 0.001*z"),
        lambda: leg(Spring("body - foot", "k*r**3")),
    ],
)
def test_linear_equations_of_what_is_not_linear(change):
    with pytest.raises(InputError, match=r"is not linear: a linear machine needs linear springs.*constant gravity"):
        change().linear_equations()


def test_a_quadratic_potential_is_a_spring_and_a_load():
    """Of the same energy, in flight and in contact, beside a spring and without it."""
    energies = ["k*(body - foot)**2/2", "k*(body - foot)**2/2 - 0.1*m2*body"]
    springs = leg(Spring("body - foot", "k*r"), counts="body - foot")
    pushed = leg(Spring("body - foot", "k*r"), Potential("-0.1*m2*body"), counts="body - foot")
    for energy, like in zip(energies, (springs, pushed), strict=True):
        by_energy = leg(Potential(energy), counts="body - foot")
        for own, other in zip(by_energy.linear_equations(), like.linear_equations(), strict=True):
            np.testing.assert_allclose(own, other, atol=1e-15)
        for where, start in (("flight", [1.0, 2.0, 0.1, 0.3]), ("contact", [0.7, -0.2])):
            flows = [flow_of(getattr(each.model, where), tuple(each.values)) for each in (by_energy, like)]
            paths = [
                flow.run(np.array(start), np.array([*each.values.values()]), 3.0)[0]
                for flow, each in zip(flows, (by_energy, like), strict=True)
            ]
            assert flows[0].method == "closed form"
            np.testing.assert_allclose(paths[0](1.7), paths[1](1.7), atol=1e-14)
    with pytest.raises(InputError, match=r"is not linear: a linear machine needs linear springs.*quadratic potentials"):
        leg(Potential("k*(body - foot)**4/2"), counts="body - foot").linear_equations()
