"""Time reversal decided exactly: what turns the equations of wheels, rockers and shuttles, and what does not."""

from dataclasses import replace
from fractions import Fraction

import pytest
from steps import TABLE, stepping

from orbits import Mechanism
from orbits.exact import ExactMechanics, Scale, Unproved, stated_machine
from orbits.exact.stated import StatedSpring
from orbits.mechanics import Potential, Spring
from problems import Hopper
from problems.laws import springs

UNITS = Scale(Fraction(1, 2), Fraction(2))


def stated(kind, **changes):
    return replace(stated_machine(stepping(kind, 1.0, 0.5, 0.3), {}), **changes)


def with_law(kind, law):
    return stated(kind, springs=(StatedSpring("phi - theta", (law,)),))


@pytest.mark.parametrize("kind", TABLE)
def test_odd_springs_turn_back(kind):
    for law in (
        "r + r**3",
        "tanh(r)",
        "r/sqrt(1 + r**2)",
        "exp(r) - exp(-r)",
        "asinh(2*r)",
        "r*cos(r)",
        "r*exp(-r**2)",
    ):
        assert ExactMechanics(with_law(kind, law), UNITS).order == 1


@pytest.mark.parametrize("law", ["r + 1e-30*r**2", "exp(r) - 1", "r*cosh(r) + 1e-30", "tanh(r + 1e-30)"])
@pytest.mark.parametrize("kind", TABLE)
def test_springs_that_are_not_odd_do_not(kind, law):
    with pytest.raises(Unproved, match="does not reverse the forces; a spring may have to be odd"):
        ExactMechanics(with_law(kind, law), UNITS)


def test_pieces_of_a_law_are_taken_to_the_opposite_ones():
    machine = stepping("wheel", 1.0, 0.5, 0.3, springs.end_stops(gap=0.2, stop=2.0))
    found = ExactMechanics(stated_machine(machine, {}), UNITS)
    assert (found.order, found.contact_order) == (-1, -1)
    (spring,) = found.stated.springs
    moved = replace(spring, breaks=(spring.breaks[0], f"{spring.breaks[1]} + 1e-30"))
    with pytest.raises(Unproved, match="not shown to be continuous"):
        ExactMechanics(replace(found.stated, springs=(moved,)), UNITS)
    three = replace(spring, force=("-1", "r", "2"), breaks=("-1", "2"))
    with pytest.raises(Unproved, match="does not map the breakpoints"):
        ExactMechanics(replace(found.stated, springs=(three,)), UNITS)


@pytest.mark.parametrize("kind", TABLE)
def test_the_images_of_states(kind):
    """Of the launch with liftoff 3 and alpha 5: where the contact begins, for the angle 0.3 in units of 1/2 and 1/4."""
    m = ExactMechanics(stated(kind), UNITS)
    signs = {"wheel": ((-1, -1), (-1,)), "rocker": ((1, 1), (-1,)), "shuttle": ((-1, -1), (1,))}[kind]
    assert (m.reversor.signs, m.contact_reversor.signs) == signs
    assert [each.value for each in m.reversor.shifts] == [Fraction(0 if kind == "rocker" else "1.2")] * 2
    assert [each.value for each in m.contact_reversor.shifts] == [0]


BACK = (("theta", "2*angle - theta"), ("phi", "2*angle - phi"))
NEXT = (("theta", "theta - 2*angle"), ("phi", "phi - 2*angle"))


@pytest.mark.parametrize(
    ("changes", "telling"),
    [
        ({"reversor": (BACK[0], ("phi", "2*angle - phi + 1e-30"))}, "the reversor does not reverse the forces"),
        ({"reversor": BACK[:1]}, "the reversor does not reverse the forces"),
        ({"reversor": (("theta", "2*angle - theta + 1e-30"), BACK[1]), "gaps": ()}, "do not map the closed gap"),
        ({"reversor": (("theta", "phi"), BACK[1])}, "'theta' must be mapped to itself or its negative"),
        ({"reversor": (("theta", "theta - theta**2"), BACK[1])}, "'theta' must be mapped to"),
        ({"symmetry": (NEXT[0], ("phi", "phi - 2*angle + 1e-30"))}, "the symmetry after the reversor does not reverse"),
        ({"symmetry": (("theta", "theta - 2*angle + 1e-30"), NEXT[1])}, "do not map the closed gap to itself"),
        ({"symmetry": ()}, "do not map the closed gap to itself"),
        ({"gaps": (("rear", "theta"), ("front", "2*angle - theta + 1e-30"))}, "the gap of the front, .*, is neither"),
        ({"gaps": (("rear", "2*theta"), ("front", "2*angle - theta"))}, "the gap of the rear, 2\\*theta, is neither"),
        ({"gaps": (("rear", "theta"), ("front", "2*angle - theta"), ("third", "theta"))}, "do not map"),
        ({"potentials": ("kappa*cos(theta - angle - 1e-30)",)}, "the reversor does not reverse the forces"),
        ({"inertia": (("1", "1e-30*theta"), ("1e-30*theta", "1/mu"))}, "the reversor does not preserve the inertia"),
    ],
)
def test_maps_that_do_not_turn_a_wheel_back(changes, telling):
    with pytest.raises(Unproved, match=telling):
        ExactMechanics(stated("wheel", **changes), UNITS)


def test_a_map_is_its_own_inverse():
    """A free rotor may be turned on by any amount without a change of the equations; twice does not lead back."""
    maps = [dict(BACK), dict(NEXT)]
    machine = Mechanism(
        ("phi", "theta", "rotor"), [Spring("phi - theta"), Potential("kappa*cos(theta - angle)")],
        inertia={"phi": 1.0, "theta": 1.0, "rotor": 1.0}, parameters={"kappa": 0.5, "angle": 0.3},
        reversor=maps[0], symmetry=maps[1], gaps={"rear": "theta", "front": "2*angle - theta"},
    )  # fmt: skip
    own = stated_machine(machine, {})
    assert ExactMechanics(own, UNITS).reversor.signs == (-1, -1, 1)
    for name, what in (("reversor", "the reversor"), ("symmetry", "the symmetry after the reversor")):
        with pytest.raises(Unproved, match=f"{what} is not its own inverse"):
            ExactMechanics(replace(own, **{name: (*getattr(own, name), ("rotor", "rotor + 1"))}), UNITS)


def test_machines_without_maps_state_none():
    own = stated_machine(Hopper(), {})
    assert not own.steps
    assert not {"reversor", "symmetry", "gaps"} & own.document().keys()
    assert "the gap y2, which lands plastically" in own.words()
    m = ExactMechanics(own, UNITS)
    assert m.reversor.fixed(m.y, m.v) == m.v
    assert m.landed_force is m.contact_force


def test_the_words_of_a_wheel():
    words = stated("wheel").words()
    for each in (
        "the gap theta of the rear foot, which opens",
        "the gap 2*angle - theta of the front foot, which lands plastically",
        "Let R reverse time and take theta to 2*angle - theta, phi to 2*angle - phi",
        "let S take theta to theta - 2*angle, phi to phi - 2*angle",
        "launched in a state x and lands in R x",
        "its contact, whose coordinates are counted anew by S, leads from S R x to x",
    ):
        assert each in words
    rocker = stated("rocker").words()
    assert "the gap theta of the foot, which opens; its image under R, which lands plastically" in rocker
    assert "Let R reverse time and take each coordinate to itself" in rocker
