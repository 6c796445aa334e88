"""Forces of the ground and speeds after a step, against differences of positions and closed formulas."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plane import linear, rocker, wheel
from scipy.integrate import solve_ivp
from steps import stepping

from orbits import InputError, Mechanism
from orbits.mechanics import Mass, Spring
from orbits.model import NORMAL_FORCE, TANGENTIAL_FORCE


@pytest.mark.parametrize("machine", [wheel(0.7, 0.5, 0.3, 0.8), rocker(1.0, 0.5, 0.3, 0.7)], ids=["wheel", "rocker"])
def test_forces_are_those_that_accelerate_the_centre_of_mass(machine):
    """N = m (g + Z'') and T = m X'' by second differences of a motion of another integrator."""
    model, p = machine.model, machine.values
    mass = next(each for each in machine.elements if isinstance(each, Mass))
    m = p["m"] if "m" in p else p["share"] / p["mu"]
    g = p["kappa"] / m

    def at(text, theta):
        names = {"cos": np.cos, "sin": np.sin, "theta": theta, **p}
        return eval(text, names)

    t, h = 0.7, 2e-3
    rates = lambda _, x: np.array(model.flight.field(list(x), p, []), dtype=float)  # noqa: E731
    motion = solve_ivp(rates, (0, 1), [0.2, 0.4, 0.1, 0.3], "DOP853", rtol=1e-13, atol=1e-14, dense_output=True).sol
    places = motion(t + h * np.arange(-2, 3))
    second = np.array([-1, 16, -30, 16, -1]) / (12 * h * h)
    normal, along = (m * (second @ at(text, places[2])) for text in (mass.height, mass.across))
    watch = model.flight.watch
    assert float(watch[NORMAL_FORCE](list(places[:, 2]), p, [])) == pytest.approx(m * g + normal, abs=1e-8)
    assert float(watch[TANGENTIAL_FORCE](list(places[:, 2]), p, [])) == pytest.approx(along, abs=1e-8)
    standing = [float(each([0.1, 0.2], p, [])) for name, each in model.contact.watch.items() if name in watch]
    assert standing == pytest.approx([m * g, 0.0], abs=1e-15)


def test_a_solid_block_loses_speed_as_housner_says():
    """The rates after the landing over those before are 1 - 3/2 sin(A)^2 (Housner 1963)."""
    a = 0.3
    share = 0.75 * math.cos(a) ** 2  # M h^2 of A = 4/3 M (h^2 + b^2)
    block = rocker(share=share)
    landed = block.model.planar.handed_over([0.1, 0.2, 0.0, -0.4], block.values)
    assert landed == pytest.approx([-0.1, -0.2, 0.0, 0.4 * (1 - 1.5 * math.sin(a) ** 2)], abs=1e-15)


@pytest.mark.parametrize("share", [1.0, 0.8])
def test_a_wheel_loses_speed_as_its_angular_momentum_about_the_next_foot_says(share):
    """(I + M l^2 cos 2a) / A, forward and back."""
    machine, a = wheel(2.0, 0.5, 0.3, share), 0.3
    ratio = 1 - share + share * math.cos(2 * a)
    over, back = (machine.model.planar.handed_over, machine.model.planar.handed_back)
    assert over([0.1, 0.2, 2 * a, 0.4], machine.values) == pytest.approx([0.1 - 2 * a, 0.2, 0.0, 0.4 * ratio])
    assert back([0.1, 0.2, 0.0, -0.4], machine.values) == pytest.approx([0.1 + 2 * a, 0.2, 2 * a, -0.4 * ratio])


def test_linearised_machines_lose_nothing_and_their_forces_are_in_closed_form():
    for kind, rate, after in (("wheel", 0.4, 0.4), ("rocker", -0.4, 0.4)):
        machine = linear(kind, 1.0, 0.5, share=0.7)
        gap = 2.0 if kind == "wheel" else 0.0
        landed = machine.model.planar.handed_over([0.1, 0.2, gap, rate], machine.values)
        assert landed[2:] == pytest.approx([0.0, after], abs=1e-15)
        model, x = machine.model, np.array([0.13, 0.2, 0.35, 0.4])
        for phase, state in ((model.flight, x), (model.contact, x[:2])):
            watched = phase.closed_form(machine.values).watch
            assert [*watched] == [*phase.watch]
            for name, (weights, value) in watched.items():
                force = float(phase.watch[name](list(state), machine.values, []))
                assert weights @ state + value == pytest.approx(force, abs=1e-15)


def test_nothing_stands_in_the_flight_of_a_hopper():
    masses = [Mass("body", 1.0, across="hip"), Mass("foot", 2.0, across="hip")]
    hopper = Mechanism(("hip", "body", "foot"), [*masses, Spring("body - foot")], gap="foot")
    assert not hopper.model.planar.stands
    assert not hopper.model.flight.watch
    assert hopper.model.planar.handed_over is None
    force, normal, along = (each([0.1, 0.2, 0.3, 0.4], {}, []) for each in hopper.model.contact.watch.values())
    assert (normal, along) == (pytest.approx(force), 0.0)


def test_what_is_no_ground_is_refused():
    with pytest.raises(InputError, match="the horizontal places of the masses"):
        replace(stepping("wheel", 1.0, 0.5), friction=0.6)
    with pytest.raises(InputError, match=r"the friction of 'wheel' must be a finite number from 0"):
        wheel(friction=-0.1)
    askew = Mass("cos(theta - a)", "share/mu", across="sin(theta - a) + theta**2")
    with pytest.raises(InputError, match="the ground's forces differ between the halves of a motion"):
        _ = replace(wheel(), elements=[Spring("phi - theta"), askew]).model
    lean = Mass("cos(theta - a)", "share/mu", across="cos(theta - a)")  # is mirrored nowhere, but its inertia is
    leaning = replace(wheel(), elements=[Spring("phi - theta"), lean, Mass("0", 1.0, across="sin(theta - a)")])
    with pytest.raises(InputError, match="the ground's forces differ between the halves of a motion"):
        _ = leaning.model
