"""Mechanisms that are not linear have no linear equations."""

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import leg

from orbits import InputError, Mechanism
from orbits.errors import RunsAway
from orbits.flow import Watch, first_events, flow_of
from orbits.mechanics import Damper, Potential, Spring
from orbits.model import Affine


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
    with pytest.raises(InputError, match=r"is not linear: that takes straight springs.*quadratic potentials"):
        leg(Potential("k*(body - foot)**4/2"), counts="body - foot").linear_equations()


def upside_down() -> Mechanism:
    """A hinged mass that falls over, with a sprung one within."""
    return Mechanism(
        ("inner", "outer"), [Spring("inner - outer", "k*r"), Potential("-outer**2/2 + outer*c")], gap="outer",
        inertia={"inner": 1.0, "outer": 2.0}, parameters={"k": 1.0, "c": 0.5},
    )  # fmt: skip


def test_a_motion_that_is_pushed_away_is_followed_until_it_runs_away():
    machine = upside_down()
    flow, p = flow_of(machine.model.flight, tuple(machine.values)), np.array([*machine.values.values()])
    assert flow.method == "closed form"
    path, _ = flow.run(np.array([0.5, 0.2, 0.0, 0.0]), p, 4.0)
    taylor = flow_of(replace(machine.model.flight, closed_form=None), tuple(machine.values))
    np.testing.assert_allclose(path(4.0), taylor.run(np.array([0.5, 0.2, 0.0, 0.0]), p, 4.0)[0](4.0), rtol=1e-12)
    with pytest.raises(RunsAway):
        flow.run(np.array([0.5, 0.2, 3.0, 1.0]), p, 900.0)
    gap, starts = Affine((0.0, 0.0, 1.0, 0.0)), np.array([[0.5, 0.2, 3.0, 1.0], [0.5, 0.0, 0.1, -1.0]])
    times, _, rows, failed = first_events(flow, starts, p, Watch(flow, [gap]), 1e4)
    assert isinstance(failed[0], RunsAway)
    assert rows[1, 2] == pytest.approx(0.0, abs=1e-14)
    assert times[1] == pytest.approx(first_events(taylor, starts[1:], p, Watch(taylor, [gap]), 1e4).times[0], rel=1e-12)
