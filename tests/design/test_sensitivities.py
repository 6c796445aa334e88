"""Derivatives of quantities by the parameters of a machine, against differences of neighbouring orbits."""

import numpy as np
import pytest
from designs import CUBIC, VARYING

from orbits import InputError, find, quantities, sensitivities
from problems import Hopper, Juggler, hopper_in_si, springs

ROWS = np.linspace(-14, 14, 97)
MEASURED = springs.table((ROWS, ROWS + 0.02 * ROWS**3), noise=0, scale="b", shift="d")


@pytest.mark.parametrize(
    ("machine", "family"),
    [
        (CUBIC, 1),
        (CUBIC, 2),
        (VARYING, 1),
        (Juggler("r + b*r**3", mass_ratio=0.7, parameters={"b": 0.2}), 1),
        (Hopper(MEASURED, mass_ratio=0.5, rest_length=10, parameters={"b": 1.2, "d": 0.1}), 1),
    ],
)
def test_sensitivities_are_those_of_neighbouring_orbits(machine, family):
    orbit = find(machine, family)
    names = ["b", "mass_ratio"]
    exact = sensitivities(machine, orbit, names)
    for name in names:
        h, rows = 1e-3 * machine.values[name], []
        for s in (-2, -1, 1, 2):
            near = machine.with_values(**{name: machine.values[name] + s * h})
            rows.append(np.array(list(quantities(near, find(near, family)).values())))
        slopes = (rows[0] - 8 * rows[1] + 8 * rows[2] - rows[3]) / (12 * h)
        for quantity, slope in zip(exact, slopes, strict=True):
            assert exact[quantity][name] == pytest.approx(slope, rel=1e-7, abs=1e-8), quantity


def test_breakpoints_that_move():
    """A bilinear spring is a motion in three harmonic arcs; its slopes by gap and ratio are those of neighbours."""
    machine = Hopper("bilinear", mass_ratio=0.5, rest_length=12)
    orbit, names = find(machine), ["gap", "ratio"]
    exact = sensitivities(machine, orbit, names)
    for name in names:
        h = 1e-4
        up, down = (machine.with_values(**{name: machine.values[name] + side * h}) for side in (1, -1))
        above, below = (quantities(each, find(each)) for each in (up, down))
        for quantity, slopes in exact.items():
            assert slopes[name] == pytest.approx((above[quantity] - below[quantity]) / (2 * h), rel=1e-6, abs=1e-6)


def test_a_measured_spring_is_the_formula_that_it_was_made_of():
    """Every quantity and its slope, also along what scales and shifts the rows."""
    values = {"b": 1.2, "d": 0.1}
    formula = Hopper("b*((r - d) + 0.02*(r - d)**3)", mass_ratio=0.5, rest_length=10, parameters=values)
    table = Hopper(MEASURED, mass_ratio=0.5, rest_length=10, parameters=values)
    expected, found = sensitivities(formula), sensitivities(table)
    for quantity, slopes in expected.items():
        for name, slope in slopes.items():
            assert found[quantity][name] == pytest.approx(slope, rel=1e-9, abs=1e-9), (quantity, name)


def test_a_force_that_jumps_has_no_smooth_variation():
    law = springs.function(lambda r, k: r + 0.4 * k * np.where(r > 0.5, 1, 0), breakpoints=(0.5,), k=1.0)
    machine = Hopper(law, mass_ratio=0.5)
    orbit = find(machine)
    assert quantities(machine, orbit, ["alpha"])["alpha"] == pytest.approx(orbit.alpha, rel=1e-12)
    with pytest.raises(InputError, match=r"jumps at the extension 0\.5"):
        quantities(machine, orbit, ["loss_coefficient"])


def test_a_jump_that_moves_with_the_units_of_a_machine_in_si():
    """The unit of length follows from the masses, and with it where the force jumps; against neighbouring orbits."""
    law = springs.function(lambda r: 1000 * r + 30 * np.where(r > 0.02, 1, 0), breakpoints=(0.02,))
    leg, names = hopper_in_si(3.0, 1.5, force=law, rest_length=0.3), ["alpha", "stroke"]
    exact = sensitivities(leg, 1, ["foot_mass"], names)
    h = 1e-4
    up, down = (leg.with_values(foot_mass=1.5 + side * h) for side in (1, -1))
    above, below = (quantities(each, find(each), names) for each in (up, down))
    for name in names:
        assert exact[name]["foot_mass"] == pytest.approx((above[name] - below[name]) / (2 * h), rel=1e-7)
