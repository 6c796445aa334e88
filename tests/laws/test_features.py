"""How finely a law varies: the lengths of laws, and narrow features that the steps see or that are noticed."""

import numpy as np
import pytest

from orbits import NoOrbit, find
from orbits.laws import Law, features, features_of_many, sampled_closely, unit_of_length
from orbits.laws.law_expressions import formula_expression
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


@pytest.mark.parametrize(
    ("law", "places", "most"),
    [
        ("r + exp(-((r - 0.3)/1e-7)**2)", [0.3], 1000),
        ("r + abs(r - 0.3) - abs(r - 0.3 - 1e-9)", [0.3, 0.3 + 1e-9], 8),
        ("r + r**3", [], 3),
        ("tanh(r)", [], 3),
    ],
)
def test_samples_of_a_law_come_to_where_it_varies(law, places, most):
    whole = Law(law, "r", formula_expression(law, "r"), {})  # not in pieces, which would end at its kinks
    found = sampled_closely(whole, np.array([0.0, 0.5, 1.0]))
    assert len(found) <= most
    for place in places:
        assert np.abs(found - place).min() < 2e-8
    assert (np.diff(found) > 0).all()


def test_a_law_that_varies_finely_all_the_way_is_refused():
    with pytest.raises(NoOrbit, match=r"varies within .* of r over a long range"):
        find(Hopper("1e-3*r + 0.01*exp(sin(1e9*r))"))


@pytest.mark.parametrize(
    ("law", "low", "high"),
    [
        ("r + b*r**3", -0.01, 0.3),
        ("r + b*r**3 - b**2*r**5", 0.001, 0.3),
        ("tanh(b*r)/b", 0.05, 2.0),
        ("r + 0.1*exp(-((r - 2)/b)**2)", 0.02, 1.0),
        ("r/(1 - b*r**2)", 0.01, 2.0),
    ],
)
def test_features_of_many_laws_are_those_of_each(law, low, high):
    """Bends are as many, and lengths to the last digit, but where a law bends once at most and none is determined."""
    key, values = Hopper(law, parameters={"b": 0.1}).model.relative.law, np.linspace(low, high, 40)
    p = {name: values if name == "b" else np.ones(40) for name in key.names}
    lengths, bends = features_of_many(key, key, p)
    for i in range(40):
        own = {name: float(column[i]) for name, column in p.items()}
        alone = features(key, unit_of_length(key, own), own)
        assert bends[i] == alone.bends
        assert lengths[i] == alone.length or (lengths[i] == np.inf and bends[i] <= 1)
