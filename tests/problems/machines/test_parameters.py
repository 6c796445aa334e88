"""A name has one value: what a machine is told twice, and what two of its laws call by one name, is refused."""

import pytest

from orbits import InputError
from problems import Chain, Hopper, chain_hand, inerter_hopper, knee_hopper, plate_hopper
from problems.laws import gravity, springs


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda p: inerter_hopper(body_mass=60.0, parameters=p), "body_mass"),
        (lambda p: inerter_hopper(parameters=p), "inertance"),
        (lambda p: inerter_hopper(rest_length=5.0, parameters=p), "rest_length"),
        (lambda p: knee_hopper(stiffness=500.0, parameters=p), "stiffness"),
        (lambda p: knee_hopper(parameters=p), "surface_gravity"),
        (lambda p: plate_hopper((1.0, 2.0, 3.0), "r", "50*r", parameters=p), "m3"),
        (lambda p: chain_hand((1.0, 2.0, 3.0), parameters=p), "m1"),
    ],
)
def test_an_argument_is_not_overruled_by_a_parameter(make, name):
    with pytest.raises(InputError, match=rf"'{name}' is (an argument of its own|a mass); call the formula's"):
        make({name: 10.0})


@pytest.mark.parametrize("make", [inerter_hopper, knee_hopper, plate_hopper, chain_hand, Chain, Hopper])
@pytest.mark.parametrize("parameters", [3, ["k"]])
def test_parameters_that_are_no_mapping(make, parameters):
    with pytest.raises(InputError, match="mapping of names to numbers"):
        make(parameters=parameters)


def test_parameters_of_formulas_are_taken():
    assert inerter_hopper("k*r", parameters={"k": 700.0}).values["k"] == 700.0
    assert knee_hopper("stiffness*r + k*r**3", parameters={"k": 700.0}).values["k"] == 700.0
    assert chain_hand(springs="k*r", parameters={"k": 700.0}).values["k"] == 700.0


def test_two_laws_with_one_name():
    first, second = springs.formula("k*r", k=1.0), springs.formula("k*r + r**3", k=2.0)
    both = "parameter 'k' has two values, 1 by the law 'k.r' and 2 by the law"
    with pytest.raises(InputError, match=both):
        Chain(springs=[first, second])
    with pytest.raises(InputError, match=both):
        Hopper(first, gravity.formula("1/(1 + z/k)**2", k=2.0), rest_length=8.0)
    assert Chain(springs=[first, first]).parameters == {"k": 1.0}
