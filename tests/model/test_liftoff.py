"""Lift-off: where a force opens the contact, of one spring and of many, and springs that cannot lift the foot."""

import numpy as np
import pytest
from conftest import slow_after

from orbits import InputError, NoOrbit, find, find_all
from orbits.laws import from_formula
from orbits.laws.law_statement import from_function
from orbits.model import Liftoff
from problems import Hopper, Juggler, hopper_in_si, springs

WEIGHT = Liftoff(0.0, "the foot's weight")


@pytest.mark.parametrize("spring", slow_after(1, ["r*sqrt(abs(r))", "r*abs(r)**0.5", "sign(r)*abs(r)**1.5"]))
def test_a_spring_without_slope_at_rest(spring):
    """One law in three spellings: homogeneous, so its half period at amplitude A goes with A^-0.25."""
    orbit = find(Hopper(spring))
    assert orbit.alpha == pytest.approx(3.459326351441497, rel=1e-9)
    assert 0 < orbit.error < 1e-12


# Laws with the extensions at which they first reach 1 and 0.25 from rest, the force rising.
REACHED = {
    "r": (1.0, 0.25),
    "r**3 + 3*r": (np.sinh(np.arcsinh(0.5) / 3) * 2, np.sinh(np.arcsinh(0.125) / 3) * 2),
    "tanh(0.5*r)/0.5": (2 * np.arctanh(0.5), 2 * np.arctanh(0.125)),
    "r - 0.3": (1.3, 0.55),
    "2 + r": (-1.0, -1.75),
    "1 + r": (0.0, -0.75),
    "1e-7*r": (1e7, 2.5e6),
    "1e6*r": (1e-6, 2.5e-7),
    "2*sin(r)": (np.arcsin(0.5), np.arcsin(0.125)),
}


@pytest.mark.parametrize("text", REACHED)
def test_the_first_extension_at_the_level(text):
    law = from_formula(text, "r")
    for load, extension in zip((0.0, 0.75), REACHED[text], strict=True):
        found = Liftoff(load, "").extension(law)
        assert found == pytest.approx(extension, rel=1e-15, abs=1e-16)
        assert Liftoff(load, "").extensions(law.key, {"unused": np.zeros(3)}) == pytest.approx([found] * 3, rel=1e-14)
        assert Liftoff(load, "").extensions_at(law, 0.0, [1.0, 2.0]).tolist() == [found] * 2


def test_a_force_that_reaches_the_level_just_before_it_drops():
    law = from_formula("r - 0.005 - 0.005*sign(r - 1.0001)", "r")
    assert WEIGHT.extension(law) == pytest.approx(1.0, rel=1e-15)
    assert np.isnan(WEIGHT.extensions(law.key, {"unused": np.zeros(2)})).all()


SPEEDS = np.linspace(0.5, 20.0, 40)


@pytest.mark.parametrize("damping", [0.1, -0.1, 1e-3])
@pytest.mark.parametrize("load", [0.5, 0.9])
def test_lift_off_of_a_damped_spring_by_speed(damping, load):
    """sin(r) + load + damping * alpha = 1, on the branch of the sine that rises; none beyond its ends."""
    level = 1.0 - load - damping * SPEEDS
    with np.errstate(invalid="ignore"):
        expected = np.arcsin(level)
    found = Liftoff(load, "").extensions_at(from_formula("sin(r)", "r"), damping, SPEEDS)
    inside = np.abs(level) < 1 - 1e-9
    assert found[inside] == pytest.approx(expected[inside], abs=1e-12)
    assert np.isnan(found[np.abs(level) > 1 + 1e-9]).all()


def test_lift_off_of_a_damped_spring_of_a_short_range():
    """Past a breakpoint, and down to where the law has no value any more."""
    law = from_function(lambda r: r, "r", breakpoints=(0.5,))
    found = WEIGHT.extensions_at(law, 0.5, [0.5, 1.0, 4.0])
    assert found == pytest.approx([0.75, 0.5, -1.0], rel=1e-14)
    root = WEIGHT.extensions_at(from_formula("sqrt(r + 4) - 1", "r"), 1.0, [0.5, 1.0, 1.9, 2.5])
    assert root[:3] == pytest.approx([1.5**2 - 4, -3.0, 0.1**2 - 4], rel=1e-12)
    assert np.isnan(root[3])


@pytest.mark.parametrize(
    ("text", "load", "words"),
    [
        ("1 + 5e-15*(r - 1)", 0.0, "only just reaches the weight at extension .*, with slope 1.5e-14: nothing lifts"),
        ("r - 0.5*r**3", 0.0, r"never reaches the weight \(largest tension 1.333\): nothing leaves the ground"),
        ("-1 - r", 0.0, r"never reaches the weight \(largest tension -3.3\)"),
        ("2 - r", 0.0, r"never reaches the weight \(least force 5.7\)"),
    ],
)
def test_springs_that_never_lift(text, load, words):
    """The numbers are those of a scale: 3 times the force less 0.1, and extensions from 0.5 on."""
    liftoff = Liftoff(load, "the weight", lambda p: (3.0, 0.1, 0.5))
    with pytest.raises(NoOrbit, match=words):
        liftoff.extension(from_formula(text, "r"))


def test_what_is_no_spring():
    with pytest.raises(InputError, match="does not depend on the extension"):
        WEIGHT.extension(from_formula("2", "r"))
    with pytest.raises(InputError, match="no force at rest"):
        WEIGHT.extension(from_formula("log(r)", "r"))


JUMP = springs.function(lambda r: r + 0.5 * (r > 0.8), breakpoints=(0.8,))
JUMP_IN_COMPRESSION = springs.function(lambda r: r + 0.5 * (r > -0.1), breakpoints=(-0.1,))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: find(Hopper("tanh(r)")), "lifts off cleanly|leaves the ground"),
        (lambda: find(Hopper("tanh(1.9*r)/1.9")), r"largest tension 0.5263"),
        (lambda: find(Hopper("r - 0.5*r**3")), r"largest tension 0.5443"),
        (lambda: find(hopper_in_si(60.0, 3.0, force="20*tanh(r)", rest_length=0.8)), r"largest tension 20 N"),
        *(
            (
                lambda search=search: search(Hopper(JUMP)),
                "jumps over the foot's weight at extension 0.8, from 0.8 to 1.3",
            )
            for search in (find, find_all)
        ),
        (lambda: find(Juggler(JUMP_IN_COMPRESSION)), "jumps over zero force at extension -0.1, from -0.1 to 0.4"),
    ],
)
def test_springs_that_cannot_lift_the_foot(make, message):
    with pytest.raises(NoOrbit, match=message):
        make()
