"""Formulas along a family, against the quantities of whole orbits there and against closed forms."""

import numpy as np
import pytest

from orbits import InputError, NoOrbit, find, follow, orbit_at, quantities
from orbits.continuation import formula_columns
from problems import Hopper, hopper_in_si, rimless_wheel

CUBIC = Hopper("cubic", rest_length=30.0)


@pytest.fixture(scope="module")
def family():
    return follow(CUBIC, "beta", 0.1, start=0.0, longest=0.2)


@pytest.mark.parametrize(
    "name", ["largest_spring_force", "landing_sensitivity", "stroke", "frequency", "2*stroke/period"]
)
def test_what_designs_compute_is_a_column_too(family, name):
    for i in (0, len(family) - 1):
        orbit = orbit_at(CUBIC, family[i], "beta")
        expected = quantities(CUBIC.with_values(beta=family[i].value), orbit, name)[name]
        assert family.column(name)[i] == pytest.approx(expected, rel=1e-11)


def test_formulas_of_parameters_and_quantities(family):
    """The flight lasts twice alpha under constant gravity, whatever the spring."""
    assert family.column("flight_time - 2*alpha") == pytest.approx(0.0, abs=1e-13)
    assert family.column("beta*mass_ratio + rest_length") == pytest.approx(family.column("beta") + 30.0, rel=1e-15)
    assert family.column("rest_length").tolist() == [30.0] * len(family)
    axes = family.plot("frequency*period")
    assert axes.get_ylabel() == "frequency·period"
    assert np.concatenate([line.get_ydata() for line in axes.lines if len(line.get_xdata()) > 2]) == pytest.approx(1.0)


def test_in_si_it_is_in_the_units_of_the_machine():
    leg = hopper_in_si(60.0, 3.0, force="k*r", parameters={"k": 8000.0}, rest_length=0.8)
    softer = follow(leg, "k", 7900.0, longest=1.0)
    own = find(leg)
    assert softer.column("frequency")[0] == pytest.approx(1 / own.period, rel=1e-14)
    assert softer.column("largest_spring_force")[0] == pytest.approx(
        quantities(leg, own, "largest_spring_force")["largest_spring_force"], rel=1e-12
    )


def test_what_is_left_of_friction_along_a_family():
    wheel = rimless_wheel(angle=0.3, spring="r + b*r**3", parameters={"b": 1.0}, friction=0.6)
    walks = follow(wheel, "b", 1.01, longest=1.0)
    assert walks.column("friction_left") == pytest.approx(0.6 - walks.column("friction_needed"), rel=1e-14)


def test_a_point_without_a_whole_orbit_has_no_value(family, monkeypatch):
    whole, last = formula_columns.orbit_from, family[-1].u

    def some(machine, method, u, error):
        if u == last:
            raise NoOrbit("no whole orbit")
        return whole(machine, method, u, error)

    expected = family.column("landing_sensitivity")
    monkeypatch.setattr(formula_columns, "orbit_from", some)
    found = family.column("3*landing_sensitivity")
    assert np.isnan(found[-1])
    assert found[:-1] == pytest.approx(3 * expected[:-1], rel=1e-14)


def test_a_wrong_name_is_refused_with_the_reason(family):
    wrong = {
        "step": "'step' here: a hopper does not move on along the ground",
        "friction_needed": "'friction_needed' here: a hopper states no places",
        "loss_error": "'loss_error' here: it",
        "strok": "unknown quantity 'strok'; did you mean 'stroke'",
    }
    for name, words in wrong.items():
        with pytest.raises(InputError, match=words):
            family.column(name)
