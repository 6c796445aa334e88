"""What a theorem is about: the machine's text, its names and its numbers, and what no formula says."""

from decimal import Decimal
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import slow_after
from steps import stepping

from orbits import InputError, Mechanism, find, prove, prove_fold
from orbits.exact import Unproved, stated_machine
from orbits.mechanics import Mass, Spring
from orbits.proof.wording import equations_words
from problems import Hopper, rimless_wheel, runner, springs

MASSES = [Mass("body", "1"), Mass("foot", "1")]


def two_masses(spring="r + 0.3*r**3", coordinates=("body", "foot"), elements=None, **options):
    upper, lower = coordinates
    masses = [Mass(upper, "1"), Mass(lower, "1")]
    return Mechanism(coordinates, elements or [*masses, Spring(f"{upper} - {lower}", spring)], lower, **options)


@pytest.fixture(scope="module")
def hop():
    return find(two_masses())


def test_what_counts_the_family_is_stated():
    words = [stated_machine(two_masses(counts=counts), {}).words() for counts in ("body - foot", "body")]
    assert words[0] != words[1]
    assert "body - foot is stationary between lift-off and mid-flight" in words[0]


@pytest.mark.parametrize(
    ("machine", "name"),
    [
        (two_masses(coordinates=("r", "foot")), "r"),
        (two_masses(coordinates=("flight_time", "foot")), "flight_time"),
        (two_masses("r + alpha*r**3", parameters={"alpha": 0.3}), "alpha"),
        (
            two_masses(
                elements=[MASSES[0], Mass("foot", "z"), Spring("body - foot")], parameters={"z": 1}, gravity="1 + z/90"
            ),
            "z",
        ),
    ],
    ids=["r", "flight_time", "alpha", "z"],
)  # fmt: skip
def test_a_name_that_would_stand_for_two_things(machine, name):
    proof = prove(find(machine))
    assert not proof.proved
    assert f"the name '{name}' stands for" in proof.reasons[0]


@pytest.mark.parametrize("name", ["R", "S", "x", "f"])
def test_letters_of_machines_that_step_and_of_tables(name):
    """The letters of maps and of a table's force are refused, and that of a state gives way."""
    if name == "f":
        table = Spring("body - foot", springs.table(([-8, -1, 0, 1, 8], [-8, -1, 0, 1, 8]), noise=0))
        machine = two_masses(elements=[Mass("body", name), MASSES[1], table], parameters={name: 1.5})
    else:
        machine = stepping("wheel", 0.5, 2.0, 0.3, f"r + {name}*r**3", **{name: 0.3})
    if name == "x":
        assert "launched in a state q and lands in R q" in stated_machine(machine, {}).words()
    else:
        with pytest.raises(Unproved, match=f"the name '{name}' stands for"):
            stated_machine(machine, {})


@pytest.mark.slow
def test_a_parameter_whose_name_is_a_number_in_the_law_of_the_losses():
    hop = find(two_masses("r + d*r**3", parameters={"d": 0.3}))
    assert prove(hop).proved
    for how in ("loss", "attraction"):
        assert "the name 'd' stands for" in prove(hop, **{how: True}).reasons[0]


def test_a_name_that_stands_for_one_thing_may_be_z():
    machine = two_masses(elements=[*MASSES, Spring("body - foot", "r + z*r**3")], parameters={"z": 0.3})
    assert prove(find(machine), motion=False).proved


@pytest.mark.parametrize("number", [Decimal("0.30000000000000000001"), 2**53 + 1, Fraction(1, 3)])
def test_a_machine_has_no_number_that_it_would_round(number):
    for make in (
        lambda: Hopper("r + beta*r**3", parameters={"beta": number}),
        lambda: two_masses("r + b*r**3", parameters={"b": number}),
    ):
        with pytest.raises(InputError, match="more digits"):
            make()


def test_exact_numbers_are_stated_exactly(cubic_hop):
    machine = two_masses(
        elements=[Mass("body", np.int64(2**53 + 1)), Mass("foot", Fraction(1, 3)), Spring("body - foot")]
    )
    assert stated_machine(machine, {}).masses == (("body", "9007199254740993"), ("foot", "1/3"))
    for value in (Decimal("0.3"), Fraction(3, 10)):
        machine = Hopper("r + beta*r**3", parameters={"beta": value})
        assert stated_machine(machine, {}).parameters["beta"] == (Fraction(3, 10),) * 2
    with pytest.raises(InputError, match="not a decimal"):
        prove(cubic_hop, parameters={"beta": Fraction(1, 3)})


def test_a_function_that_computes_something_else_of_numbers():
    """No formula says what it is."""
    spring = lambda r: 2 * r if type(r).__name__ == "Text" else r  # noqa: E731
    proof = prove(find(two_masses(spring)))
    assert not proof.proved
    assert "is a function, not a formula" in proof.reasons[0]
    assert prove(find(two_masses(lambda r: r + 0.3 * r**3)), motion=False).proved


@pytest.mark.parametrize("gravity", slow_after(1, ["1 + (z - z)/(z - 1)", "1 + 0*sqrt(2 - z)"]))
def test_a_law_of_gravity_without_values_in_flight(hop, gravity):
    """It cancels to a constant, under which the extension moves alone; but there are heights without a value."""
    proof = prove(hop, machine=two_masses(gravity=gravity), motion=False)
    assert not proof.proved
    assert proof.alpha is None
    assert "has no value" in proof.reasons[-1]


def test_a_proof_of_the_flight_says_so(hop):
    assert "equations of the flight of a lossless orbit" in prove(hop, motion=False).statement
    assert "flight" not in equations_words(dict.fromkeys(("alpha", "contact_time")))


def test_a_direction_at_a_fold_has_a_name_of_its_own():
    machine = Hopper("r + dliftoff*r**3", parameters={"dliftoff": -0.01})
    point = SimpleNamespace(u=(1.0, 5.8), tangent=(0.1, 0.9, 0.0), value=-0.0107)
    proof = prove_fold(machine, point, "dliftoff")
    assert not proof.proved
    assert "'dliftoff' stands for a direction" in proof.reasons[0]


def test_a_parameter_of_no_formula_is_left_out():
    """The hinges of a wheel hold it with any friction, which the theorem does not judge."""
    wheel = rimless_wheel(inertia_ratio=1.0, gravity_ratio=0.5, angle=0.3, friction=0.9)
    assert "friction" in wheel.values
    stated = stated_machine(wheel, {})
    assert "friction" not in stated.parameters
    assert "friction" not in stated.words()
    for parameters, along in (({"friction": "0.05"}, None), ({}, "friction")):
        with pytest.raises(InputError, match="no formula of the theorem contains the parameter 'friction'"):
            stated_machine(wheel, parameters, along)
    assert "friction" in stated_machine(runner(foot_mass=0.1, rest_length=3.7, friction=0.5), {}).parameters


def test_the_restitution_of_landings_is_stated():
    stated = stated_machine(Hopper(restitution=0.1), {})
    assert stated.document()["restitution"] == "0.1"
    assert "which lands with the restitution 0.1: its rate v becomes -0.1*v" in stated.words()
    assert "restitution" not in stated_machine(Hopper(), {}).document()


def test_prescribed_quantities_are_defined():
    at = {"mean_speed": "0.4", "liftoff_extension": "0.1", "alpha": "1.5"}
    words = stated_machine(runner(foot_mass=0.1, rest_length=3.7), {}).with_tuned(("inertia",), at).words()
    mean = "mean speed is step over the sum of the flight time and the contact time"
    assert words.endswith(f"; {mean}; liftoff extension is l - rest_length at lift-off.")
