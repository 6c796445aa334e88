"""Equations of exact expressions against Lagrange's equations in 120 digits, and what they refuse."""

import math
from dataclasses import replace
from fractions import Fraction
from itertools import product

import mpmath
import pytest
from flint import arb, ctx

from orbits import Mechanism
from orbits.balls import BallProgram
from orbits.exact import ExactMechanics, Scale, Unproved, stated_machine
from orbits.exact.exact_mechanics import inner_product, polynomial_between
from orbits.exact.stated import StatedSpring
from orbits.mechanics import Inerter, Mass, Potential, Spring, Weight
from orbits.symbolic import derivative_by, substitute, symbol, vanishes
from tests.mechanics.lagrange import Machine, equations

KINDS = {(True, True): Mass, (True, False): Inerter, (False, True): Weight}
P = {"m": 2.0, "k": 3.0, "a": 0.75, "c": 0.25}
# Sums of coordinates, the first with a lever; a mass on a bent path under gravity that varies; and a stated inertia.
MACHINES = {
    "sums": Machine(
        ("body", "foot"), [("body", "m", True, True), ("foot", "1/2", True, True), ("body - 2*foot", "c", True, False)],
        [("2*body - foot + 0.5", "k*r + r**3"), ("foot/4 - body/2 - a", "r - a*r**2")], "2*foot - body/2", P,
        surface="a",
    ),
    "a bent path": Machine(
        ("foot", "body", "arm"),
        [("foot", "1/2", True, True), ("foot + body", "m", True, True), ("body + sin(arm)", "1 + c", True, True),
         ("arm", "c*0.3", True, False), ("body", "a", False, True)],
        [("body - arm**2", "k*sin(r)"), ("foot + body", "exp(r) - 1")], "foot + body/2", P,
        potentials=["a*cos(arm)*body"], gravity="1/(1 + z/8)**2", surface="1.5",
    ),
    "a stated inertia": Machine(
        ("body", "foot"), [("body", "m", True, True)], [("body - foot", "k*r")], "foot", P,
        potentials=["a*foot*body**2"], inertia=[["2 + sin(foot)", "c*body"], ["c*body", "3 + body**2"]],
    ),
}  # fmt: skip
SCALES = [Scale(), Scale(Fraction(4), Fraction(1, 2))]


def stated_of(machine, **parameters):
    """The machine as a theorem states it."""
    elements = [*(KINDS[moves, weighs](height, mass) for height, mass, moves, weighs in machine.masses)]
    elements += [Spring(extension, force) for extension, force in machine.springs]
    elements += [Potential(energy) for energy in machine.potentials]
    return stated_machine(
        Mechanism(
            machine.coordinates, elements, machine.gap, machine.parameters, gravity=machine.gravity,
            surface_gravity=machine.surface, inertia=machine.inertia, counts="body", separation="body - foot",
        ),
        parameters,
    )  # fmt: skip


def values_of(expressions, inputs, places):
    """Expressions at exact places, in 120 digits."""
    with ctx.workprec(400), mpmath.workdps(100):
        at = [arb(each.numerator) / each.denominator for each in places]
        balls = BallProgram(list(inputs), list(expressions))(at)
        return [mpmath.mpf(str(each.mid().str(100, radius=False))) for each in balls]


def exactly(values, factor=1):
    """Fractions as numbers of mpmath."""
    return [mpmath.mpf((factor * each).numerator) / (factor * each).denominator for each in values]


@pytest.mark.parametrize("scale", SCALES, ids=["in its own units", "scaled"])
@pytest.mark.parametrize("name", MACHINES)
def test_the_equations_of_flight_and_contact_are_those_of_lagrange(name, scale):
    """Also in other units of length L and time T: accelerations in L/T^2, and forces times L T^2."""
    machine = MACHINES[name]
    found = ExactMechanics(stated_of(machine), scale)
    place, rates = [Fraction(3, 8), Fraction(-5, 16), Fraction(7, 8)], [Fraction(1, 4), Fraction(2), Fraction(-1)]
    place, rates = place[: found.size], rates[: found.size]
    s, w = [place[i] for i in found.independent], [rates[i] for i in found.independent]
    closed = [[sum(a * b for a, b in zip(row, each, strict=True)) for row in found.embed] for each in (s, w)]
    assert sum(a * b for a, b in zip(found.gap, closed[0], strict=True)) == 0
    flight = values_of(found.accelerations[0], [*found.y, *found.v], [*place, *rates])
    contact = values_of([*found.contact_accelerations[0], found.contact_force[0]], [*found.s, *found.w], [*s, *w])
    with mpmath.workdps(60):
        unit, (work,) = exactly([scale.time**2 / scale.length])[0], exactly([scale.length * scale.time**2])
        free, _ = equations(machine, exactly(place, scale.length), exactly(rates, scale.speed)).flight()
        held = equations(machine, exactly(closed[0], scale.length), exactly(closed[1], scale.speed))
        inside, _, force, _ = held.contact()
        assert [a / max(held.gap) for a in held.gap] == exactly(found.gap)
        assert far(flight, [unit * each for each in free]) < 1e-40
        assert far(contact, [*(unit * inside[i] for i in found.independent), work * force]) < 1e-40


def far(found, expected):
    """The largest difference of some numbers."""
    return max(abs(a - b) for a, b in zip(found, expected, strict=True))


MASSES = [Mass("body", "2"), Mass("foot", "0.5")]
LEG = Spring("body - foot", "3*r")


def mechanics_of(*elements, coordinates=("body", "foot"), gap="foot", scale=SCALES[0], **options):
    """The equations of a mechanism of these elements beside the masses of a body and a foot."""
    return ExactMechanics(stated_machine(Mechanism(coordinates, [*MASSES, *elements], gap, **options), {}), scale)


ALONE = {
    "one spring": ((LEG,), {}),
    "two springs along one extension": ((LEG, Spring("0.25 + foot/2 - body/2", "r + r**3")), {}),
    "a lever and an inerter": ((Spring("3*body - foot", "r"), Inerter("body + foot", "1/4")), {"surface_gravity": 3}),
    "from below": ((Spring("foot - body + 0.125", "exp(r) - 1"), Weight("foot + body/2", "0.75")), {}),
}


@pytest.mark.parametrize("scale", SCALES, ids=["in its own units", "scaled"])
@pytest.mark.parametrize("name", ALONE)
def test_an_extension_that_moves_alone(name, scale):
    elements, options = ALONE[name]
    check_lone(mechanics_of(*elements, scale=scale, **options))


@pytest.mark.parametrize("scale", SCALES, ids=["in its own units", "scaled"])
def test_an_extension_in_pieces(scale):
    """Its laws meet at the breakpoints, at 2 body - foot = 1 and 1.5 in the machine's units, beside another spring."""
    stated = stated_machine(Mechanism(("body", "foot"), [*MASSES, LEG], "foot"), {})
    broken = StatedSpring("2*body - foot - 0.5", ("r", "3*r - 1", "r/2 + 1.5"), ("0.5", "1"))
    found = ExactMechanics(replace(stated, springs=(broken, StatedSpring("foot/2 - body", ("r**3",)))), scale)
    check_lone(found)
    assert found.pieces.weights == (2 * scale.length, -scale.length)
    assert [each.value for each in found.pieces.breaks] == [1, Fraction(3, 2)]
    for step, (k, at) in product((-1, 0, 1), enumerate(found.pieces.breaks)):
        place = [(at.value + step) / found.pieces.weights[0], 0]
        below, above = (values_of(found.accelerations[piece], found.y, place) for piece in (k, k + 1))
        assert (below == above) == (step == 0)


def test_a_quintic_has_the_values_of_both_rows():
    """The polynomials of value, slope and curvature, which determine it."""
    rows, r = (("-0.5", "1.25", "3e-1", "-2"), ("0.7", "-0.1", "0.0", "7.5")), symbol("r")
    found = polynomial_between(rows, r)
    for row in rows:
        at, *values = map(Fraction, row)
        derivatives = [found, derivative_by(found, r), derivative_by(derivative_by(found, r), r)]
        assert [each.value for each in substitute(derivatives, {r: at})] == values
    for _ in range(6):
        found = derivative_by(found, r)
    assert vanishes(found)


def check_lone(found):
    """The acceleration of an extension that moves alone is that of all coordinates, and what is thrown falls with
    theirs."""
    lone, place = found.lone_extension(), [Fraction(3, 8), Fraction(-5, 16)]
    at = sum(weight.value * each for weight, each in zip(lone.weights, place, strict=True))
    for alone, whole in zip(lone.accelerations, found.accelerations, strict=True):
        expected = [inner_product(lone.weights, whole), inner_product(lone.thrown, whole)]
        assert values_of([alone, lone.fall], [lone.place], [at]) == values_of(expected, found.y, place)


@pytest.mark.parametrize(
    ("elements", "options"),
    [
        ((LEG,), {"gravity": "1 + z/90"}),
        ((LEG, Potential("foot**2")), {}),
        ((LEG, Spring("body", "r")), {}),
        ((LEG, Spring("body - foot + foot**3", "r")), {}),
        ((LEG,), {"inertia": [["body**2", "0"], ["0", "0"]]}),
        ((LEG, Mass("arm", "1"), Spring("body - arm")), {"coordinates": ("body", "arm", "foot")}),
    ],
    ids=["gravity", "a potential", "another extension", "a bent extension", "inertia", "a third coordinate"],
)
def test_an_extension_that_does_not_move_alone(elements, options):
    assert mechanics_of(*elements, **options).lone_extension() is None


BROKEN = StatedSpring("body - foot", ("r", "2*r - 1"), ("1",))
TABLE = StatedSpring("body - foot", ("2",), rows=(("-1", "-1", "1", "0"), ("0", "0", "1", "0"), ("1", "2", "1", "0")))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"gap": "foot + body**3"}, "is not a sum of coordinates"),
        ({"gap": "foot*body"}, "no formula that vanishes with one of them alone"),
        ({"gap": "foot - 1/8"}, "is not a sum of coordinates"),
        ({"gap": "-foot"}, "has no coordinate with a weight above 0 that could close it"),
        ({"masses": (("body", "2"), ("foot", "body"))}, "mass 'body' depends on coordinates"),
        ({"inertia": (("1", "body - foot"), ("foot - body", "1"))}, "not shown to be symmetric"),
        ({"springs": (replace(BROKEN, extension="body - foot**3"),)}, "in pieces must act along a sum"),
        ({"springs": (BROKEN, replace(BROKEN, extension="body"))}, "more than one spring"),
        ({"springs": (TABLE, replace(TABLE, extension="body"))}, "more than one spring"),
        ({"springs": (replace(BROKEN, breaks=("0.75",)),)}, "not shown to be continuous"),
        ({"launch": "foot"}, "'foot' is not a coordinate of the contact"),
    ],
)
def test_what_no_equations_are_derived_of(changes, reason):
    stated = stated_machine(Mechanism(("body", "foot"), [*MASSES, LEG], "foot"), {})
    assert ExactMechanics(replace(stated, springs=(BROKEN,)), Scale()).pieces.breaks[0].value == 1
    with pytest.raises(Unproved, match=reason):
        ExactMechanics(replace(stated, **changes), Scale())


def test_units_are_powers_of_two_near_the_motion():
    """A third of the launch speed and of the time of a swing, so that 3 is an even number of both."""
    assert Scale.of(3 * 2.0**5, 3 * 2.0**-3) == Scale(Fraction(4), Fraction(1, 8))
    assert Scale.of(3 * 2.0**5, 3 * 2.0**-3, 4) == Scale(Fraction(1), Fraction(1, 32))
    assert Scale.of(0.0, math.inf) == Scale.of(math.nan, -1.0) == Scale()
    assert Scale(Fraction(6), Fraction(3)).speed == 2
