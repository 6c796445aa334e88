"""Contact that holds a coordinate along the ground, against the equations of a runner that are written by hand."""

import numpy as np
import pytest
from runners import NAMES, energy_by_hand, rates_by_hand

from orbits import InputError, Mechanism, check
from orbits.mechanics import Damper, Force, Mass, Potential, Spring
from orbits.model import CONTACT_FORCE
from orbits.model.model import HOLDING_FORCE
from problems import runner


def numbers(function, *arguments):
    return np.array([float(value) for value in function(*arguments)])


@pytest.fixture(scope="module")
def model():
    return runner().model


@pytest.mark.parametrize("foot", [0.1, 1e-9], ids=["heavy", "light"])
def test_fields_forces_energies_and_landings_are_those_written_by_hand(model, foot):
    """With a foot of a thousand millionth of the body's mass too: no digits are lost."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        sizes = np.array([1.0, foot, 5.0, 1.0, 5.0, 3.0, 1.0]) * rng.uniform(0.5, 2.0, len(NAMES))
        p = {**dict(zip(NAMES, sizes.tolist(), strict=True)), "step": 1.0}
        x = rng.uniform(-1.0, 1.0, 10)
        x[4] = rng.uniform(0.5, 4.0)
        rates, _ = rates_by_hand(x, p, standing=False)
        largest = max(1.0, np.abs(rates).max())
        assert numbers(model.flight.field, x.tolist(), p, []) == pytest.approx(rates, abs=1e-14 * largest)
        stood = x[4:].tolist()
        rates, holding = rates_by_hand(stood, p, standing=True)
        largest = max(1.0, np.abs([*rates, *holding]).max())
        assert numbers(model.contact.field, stood, p, []) == pytest.approx(rates, abs=1e-14 * largest)
        forces = [float(model.contact.watch[name](stood, p, [])) for name in (CONTACT_FORCE, HOLDING_FORCE)]
        assert forces == pytest.approx(holding, abs=1e-14 * largest)
        slopes = [energy_by_hand(x + 1e-30j * unit, p).imag / 1e-30 for unit in np.eye(10)]
        gradient = numbers(model.flight_gradient, x.tolist(), p, [])
        assert gradient == pytest.approx(slopes, abs=1e-14 * np.abs(slopes).max())
        after = numbers(model.landed, x.tolist(), p)
        assert after[[1, 3]] == pytest.approx([0.0, 0.0], abs=1e-15)
        # The body goes on as it was: only the foot's motion is lost.
        across = lambda s: s[1] + s[5] * np.sin(s[6]) + s[4] * s[7] * np.cos(s[6])  # noqa: E731
        assert across(after) == pytest.approx(across(x), abs=1e-14)
        lost = foot_energy = 0.5 * p["foot_mass"] * (x[1] ** 2 + x[3] ** 2)
        assert float(model.lost_at(x.tolist(), p)) == pytest.approx(foot_energy, rel=1e-13)
        assert energy_by_hand(x, p) - energy_by_hand(after, p) == pytest.approx(lost, abs=1e-13)


def test_the_relations_of_mechanics_hold():
    assert check(runner()).largest < 1


MACHINE = {
    "coordinates": ("x", "z", "l", "theta"),
    "gap": "z", "sticks": ("x",), "launch": "l", "counts": "l", "angles": ("theta",), "separation": "l",
    "heights": {"body": "z + l*cos(theta)", "foot": "z"}, "reversor": {"theta": "-theta"}, "rest": {"l": "3"},
}  # fmt: skip
ELEMENTS = (
    Mass("z + l*cos(theta)", 1.0, across="x + l*sin(theta)"), Mass("z", 0.1, across="x"), Spring("l - 3", "r"),
)  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "added", "message"),
    [
        ({"sticks": ("y",)}, (), "there is no coordinate 'y'"),
        ({"sticks": ("x", "l")}, (), "the plane has one direction along the ground"),
        ({"sticks": ("z",)}, (), "depends on what sticks .*: a gap must open upward"),
        ({"gap": "z + x"}, (), "depends on what sticks .*: a gap must open upward"),
        ({"heights": {"foot": "z + x**2"}}, (), "the height 'z . x..2' depends on the place of 'x'"),
        ({"separation": "l + x"}, (), "separation = 'l . x' depends on the place of 'x'"),
        ({"counts": "x"}, (), "counts = 'x' depends on the place of 'x'"),
        ({}, [Spring("l - x", "r")], "the extension 'l - x' depends on the place of 'x'"),
        ({}, [Potential("x**2")], "the potential 'x..2' depends on the place of 'x'"),
        ({}, [Damper("x**2", 0.1)], "the damper along 'x..2' depends on the place of 'x'"),
        ({}, [Force("x", lambda y, v, p: -y["x"])], "the force along 'x' depends on the place of 'x'"),
        ({}, [Mass("l", 0.2)], "has no place along the ground"),
        ({}, [Mass("l", 0.2, across="2*x")], "does not move on with 'x'"),
        ({"reversor": {"x": "-x", "theta": "-theta"}}, (), "'x' sticks, which determines its reversor"),
        ({"gap": "", "gaps": {"one": "z", "other": "l"}}, (), "a machine that sticks must have one gap"),
        ({"reversor": {}}, (), "motions in flight are not turned back|the reversor"),
    ],
)  # fmt: skip
def test_what_is_no_machine_that_moves_along_the_ground_is_refused(changes, added, message):
    with pytest.raises(InputError, match=message):
        Mechanism(elements=[*ELEMENTS, *added], **{**MACHINE, **changes}).model  # noqa: B018
