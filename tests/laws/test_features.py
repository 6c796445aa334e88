"""How finely a law varies: the lengths of laws, and narrow features that the steps see or that are noticed."""

import numpy as np
import pytest

from orbits import NoOrbit, find
from orbits.laws import features, unit_of_length
from problems import Hopper
from studies.search import Case


@pytest.mark.parametrize("width", [0.3, 0.05])
def test_a_narrow_bump_is_crossed_in_steps_that_see_it(width):
    machine = Hopper("r + 0.5*exp(-((r + 3)/w)**2)", rest_length=30, parameters={"w": width})
    orbit = find(machine)
    assert orbit.error < 1e-13
    assert abs(orbit.alpha - 4.493409457909064) > 5e-4  # the straight line's
    assert Case(machine, 1, lambda r: r + 0.5 * np.exp(-(((r + 3) / width) ** 2)), np.ones_like, width).holds(
        orbit.alpha, orbit.flight_time / 2
    )


@pytest.mark.parametrize(
    ("law", "alpha"),
    [
        ("r + 0.75*exp(-((r - 2.263)/1e-4)**2)", 4.493402024233559),
        ("r + 0.5*exp(-((r - 2)/1e-7)**2)", 4.493409453674529),
    ],
)
def test_a_bump_narrower_than_a_step_by_far_is_not_missed(law, alpha):
    """Against integrals of the energy in 40 digits, see `studies/narrow_features.py`."""
    orbit = find(Hopper(law, rest_length=30))
    assert abs(orbit.alpha - alpha) <= orbit.error < 2e-14


@pytest.mark.parametrize(
    ("law", "parameters", "length"),
    [
        ("r + b*sin(k*r)", {"b": 0.1, "k": 4.0}, 1 / 4.0),
        ("(exp(b*r) - 1)/b", {"b": 0.5}, 2.0),
        ("r + b*r**3", {"b": 0.3}, np.inf),
    ],
)
def test_the_length_over_which_a_law_varies(law, parameters, length):
    """That of sin(k r) is 1/k, that of exp(b r) is 1/b."""
    machine = Hopper(law, parameters=parameters)
    unit = unit_of_length(machine.spring.key, machine.values)
    assert features(machine.spring.key, unit, machine.values).length == pytest.approx(length, rel=1e-2)


def test_the_model_does_not_depend_on_the_width_of_a_feature():
    fine = Hopper("r + exp(-((r - c)/w)**2)", parameters={"c": -3.0, "w": 1e-6})
    assert fine.with_values(w=1.0).model is fine.model


@pytest.mark.parametrize(
    ("spring", "gravity"),
    [
        ("r + 0.5*exp(-50*(r + 3)**2)", "1"),
        ("r + 5*exp(-50*(r + 3)**2)", "1"),
        ("r + 20*exp(-200*(r + 6)**2)", "1"),  # passed in contact alone
        pytest.param("r + 0.5*exp(-5000*(r + 3)**2)", "1", marks=pytest.mark.slow),
        pytest.param("r", "1 + 0.5*exp(-200*(z - 5)**2)", marks=pytest.mark.slow),
    ],
)
def test_what_is_narrower_than_a_step_is_not_missed_silently(spring, gravity):
    machine = Hopper(spring, gravity, rest_length=20.0)
    for family in (1, 2):
        refusal = ""
        try:
            drift = find(machine, family).certificate.energy_drift
        except NoOrbit as error:
            refusal = str(error)
        assert "certified" in refusal or "did not converge" in refusal if refusal else drift < 1e-12


def test_a_law_that_varies_finely_all_the_way_is_refused():
    with pytest.raises(NoOrbit, match=r"varies within .* of r over a long way"):
        find(Hopper("1e-3*r + 0.01*exp(sin(1e9*r))"))
