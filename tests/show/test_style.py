"""The style of figures: labels from names, and titles with values."""

import pytest

from orbits.show import label_of
from orbits.show.style import machine_title, value_of
from problems import Hopper, hopper_in_si

LEG = hopper_in_si(60.0, 3.0, stiffness=8000.0, rest_length=0.8)


@pytest.mark.parametrize(
    ("name", "unit", "label"),
    [
        ("beta", "", "β"),
        ("alpha", "m/s", "launch speed α (m/s)"),
        ("b", "N/m^3", "b (N/m³)"),
        ("loss_coefficient", "s^(1/3)/m^(1/3)", "loss coefficient (s$^{1/3}$/m$^{1/3}$)"),
        ("alpha_noise", "m/s", "α noise (m/s)"),
        ("theta_1", "rad", "θ₁ (rad)"),
        ("m2", "kg", "m₂ (kg)"),
        ("r + beta*r**3", "", "r + β·r³"),
        ("k*r**1.5 + zeta*exp(-z/H)", "", "k·r^1.5 + ζ·exp(-z/H)"),
        ("largest_contact_force/body_mass", "N/kg", "largest contact force/body mass (N/kg)"),
        ("cost_in_$", "", r"cost in \$"),
    ],
)
def test_labels(name, unit, label):
    assert label_of(name, unit) == label


def test_titles_state_the_machine_and_its_numbers():
    machine = Hopper("cubic", rest_length=8.0, parameters={"beta": 0.25}).describe()
    assert machine_title(machine) == "hopper, spring r + β·r³, mass ratio = 1, rest length = 8, β = 0.25"
    along = machine_title(machine, ", family 2", ("beta",))
    assert along == "hopper, family 2\nspring r + β·r³, mass ratio = 1, rest length = 8"
    numbers = (
        "body mass = 60 kg, foot mass = 3 kg, surface gravity = 9.80665 m/s², rest length = 0.8 m, stiffness = 8000 N/m"
    )
    assert machine_title(LEG.describe()) == f"hopper, spring stiffness·r, {numbers}"
    table = {"machine": "hopper", "spring": "table:a_leg.csv (mm and N)", "gravity": "1", "parameters": {}}
    assert machine_title(table) == "hopper, spring table:a_leg.csv (mm and N)"
    assert value_of("alpha", 4.4934094579, "m/s") == "α = 4.49341 m/s"
