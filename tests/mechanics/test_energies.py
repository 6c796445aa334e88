"""Machines from their energies in SymPy's expressions, against the same machines stated by their elements."""

import numpy
import pytest
from conftest import slow_after

from orbits import InputError, Mechanism, find, find_all, prove, simulate, starts
from orbits.check_proof import check
from orbits.mechanics import Damper, Ground, Mass, Potential, Spring
from problems import Hopper, hopper_in_si, knee_hopper

sympy = pytest.importorskip("sympy")
from sympy.physics.mechanics import dynamicsymbols  # noqa: E402

pytestmark = pytest.mark.extra("sympy")

y1, y2 = dynamicsymbols("y1 y2")
m1, m2, m3, k, c, g, length = sympy.symbols("m1 m2 m3 k c g length")
MASSES = {m1: 1.0, m2: 1.0}


def kinetic(*pairs):
    """The kinetic energy of masses with coordinates."""
    return sum(m * y.diff(dynamicsymbols._t) ** 2 for m, y in pairs) / 2


TWO = kinetic((m1, y1), (m2, y2))
LINEAR = (y1 - y2) ** 2 / 2 + m1 * y1 + m2 * y2
LEG = find(hopper_in_si(60.0, 3.0, force="8000*r + 2e6*r**3", rest_length=0.8, surface_gravity=9.81))
CUBIC = k * (y1 - y2) ** 2 / 2 + c * (y1 - y2) ** 4 / 4 + g * (m1 * (y1 + length) + m2 * y2)


@pytest.mark.parametrize(
    "V", slow_after(1, [CUBIC, CUBIC.expand(), CUBIC.subs(y1, y1 - length)]), ids=["sums", "products", "length"]
)
def test_a_leg_in_si(V):
    """However its energy is written, it is that of one spring and two weights."""
    numbers = {m1: 60.0, m2: 3.0, k: 8000.0, c: 2e6, g: 9.81, length: 0.8}
    rest = {y1: length} if V.has(y1 - y2 - length) else {}
    leg = Mechanism.from_lagrangian(TWO, V, (y1, y2), y2, numbers, in_si=True, rest=rest)
    assert [type(each).__name__ for each in leg.elements] == ["Spring", "Weight", "Weight"]
    assert find(leg).alpha == pytest.approx(LEG.alpha, rel=1e-13)
    assert leg.units_of_parameters()["k"] == "N/m"


def test_a_hopper_and_its_proof():
    """alpha = tan(alpha), and a theorem that the second program verifies."""
    hopper = Mechanism.from_lagrangian(TWO, LINEAR, (y1, y2), y2, MASSES)
    own = find(Hopper())
    orbit = find(hopper)
    assert orbit.alpha == pytest.approx(own.alpha * 2**0.5, rel=1e-13)  # time in units of 1/sqrt(2)
    proof = prove(orbit)
    assert proof.proved
    assert "the inertia [m1, 0.0; 0.0, m2]" in proof.statement
    assert check(proof.saved()) == []


def test_a_spring_with_a_length_and_its_proof():
    """Coordinates from the ground: the extension is the spring's own, and alpha that of one without a length."""
    energy = k * (y1 - y2 - length) ** 2 / 2 + m1 * y1 + m2 * y2
    numbers = {**MASSES, k: 1.0, length: 10.0}
    orbit = find(Mechanism.from_lagrangian(TWO, energy, (y1, y2), y2, numbers, rest={y1: length}))
    assert orbit.alpha == pytest.approx(find(Hopper()).alpha * 2**0.5, rel=1e-13)
    assert orbit.liftoff_extension == 1.0
    assert prove(orbit).proved


@pytest.mark.slow
def test_an_inertia_that_varies():
    """The knee, whose masses depend on its angle."""
    foot, knee = dynamicsymbols("foot knee")
    link, straight = sympy.symbols("link straight")
    hip = foot + 2 * link * sympy.sin(knee / 2)
    numbers = {m1: 60.0, m2: 3.0, k: 600.0, link: 0.45, straight: 2.6, g: 9.80665}
    machine = Mechanism.from_lagrangian(
        kinetic((m1, hip), (m2, foot)), k * (knee - straight) ** 2 / 2 + g * (m1 * hip + m2 * foot), (foot, knee), foot,
        numbers, rest={knee: straight}, angles=[knee], launch=knee, separation=hip - foot, in_si=True,
    )  # fmt: skip
    orbit, expected = find(machine), find(knee_hopper())
    assert orbit.alpha == pytest.approx(expected.alpha, rel=1e-13)
    assert orbit.certificate.smallest_separation == pytest.approx(expected.certificate.smallest_separation, rel=1e-12)


def test_a_constant_force_is_a_weight():
    """A body that a force pulls down too hops as one with so much more weight, and no more inertia."""
    pull = sympy.Symbol("pull")
    numbers = {m1: 1.0, m2: 1.0, g: 1.0, pull: 0.5}
    V = (y1 - y2) ** 2 / 2 + g * (m1 * y1 + m2 * y2) + pull * y1
    forced = Mechanism.from_lagrangian(TWO, V, (y1, y2), y2, numbers)
    whole = (y1 - y2) ** 2 / 2 + sympy.Rational(3, 2) * g * y1 + g * m2 * y2
    heavy = Mechanism.from_lagrangian(TWO, whole, (y1, y2), y2, {m1: 1.0, m2: 1.0, g: 1.0})
    assert [each.mass for each in forced.elements[1:]] == ["m1", "m2", "pull/g"]
    orbits = [find_all(each, starts(each, 4, 4))[0].alpha for each in (forced, heavy)]
    assert orbits[0] == pytest.approx(orbits[1], rel=1e-13)
    in_si = Mechanism.from_lagrangian(TWO, LINEAR + pull * y1, (y1, y2), y2, {m1: 1, m2: 1, pull: 1}, in_si=True)
    assert [each.energy for each in in_si.elements if isinstance(each, Potential)] == ["m1*y1 + pull*y1 + m2*y2"]


def test_a_force_with_signs():
    """Parameters are real, and forces have no cases."""
    V = c * abs(y1 - y2 - length) ** 3 + m1 * y1 + m2 * y2
    machine = Mechanism.from_lagrangian(TWO, V, (y1, y2), y2, MASSES | {c: 0.5, length: 2.0}, rest={y1: length})
    spring = machine.elements[0]
    assert spring.extension == "y1 - y2 - length"
    assert "abs" in spring.force.text
    two = [Mass("y1", 1.0), Mass("y2", 1.0), Spring("y1 - y2 - 2", "1.5*r*abs(r)")]
    by_elements = Mechanism(("y1", "y2"), two, "y2", rest={"y1": 2.0})
    runs = [[event.time for event in simulate(each, 3.0, hops=1).events] for each in (machine, by_elements)]
    assert runs[0] == pytest.approx(runs[1], rel=1e-12)


def test_energies_of_matrices():
    speeds, masses = sympy.Matrix([v1, v2]), sympy.diag(m1, m2)
    for T, V in ((speeds.T * masses * speeds / 2, sympy.Matrix([LINEAR])), (TWO, sympy.ImmutableMatrix([[LINEAR]]))):
        machine = Mechanism.from_lagrangian(T, V, (y1, y2), y2, MASSES)
        assert machine.inertia == (("m1", 0.0), (0.0, "m2"))
    with pytest.raises(InputError, match=r"T = Matrix.* is not a scalar expression"):
        Mechanism.from_lagrangian(masses, LINEAR, (y1, y2), y2, MASSES)


def test_ground_that_yields():
    """A stated inertia has none of the ground's."""
    ground = Ground(mass=50.0, spring=k * sympy.Symbol("r"))
    machine = Mechanism.from_lagrangian(TWO, LINEAR, (y1, y2), y2, MASSES | {k: 1e4}, ground=ground)
    two = [Mass("y1", "m1"), Mass("y2", "m2"), Spring("y1 - y2")]
    by_elements = Mechanism(("y1", "y2"), two, "y2", {"m1": 1.0, "m2": 1.0, "k": 1e4}, ground=Ground(50.0, "k*r"))
    state = [2.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    runs = [[each.time for each in simulate(m, state=state, time=3.0).events] for m in (machine, by_elements)]
    assert runs[0]
    assert runs[0] == pytest.approx(runs[1], rel=1e-12)


def test_what_is_no_spring_is_a_potential():
    bent = sympy.sin(y1 * y2) / 10
    machine = Mechanism.from_lagrangian(TWO, LINEAR + bent, (y1, y2), y2, MASSES, elements=[Damper("y1", 0.1)])
    assert [each.energy for each in machine.elements if isinstance(each, Potential)] == ["sin(y1*y2)/10"]
    assert [each.extension for each in machine.elements if isinstance(each, Damper | Spring)] == ["y1 - y2", "y1"]
    with pytest.raises(InputError, match=r"sticks = .* does not say; state the machine by its elements"):
        Mechanism.from_lagrangian(TWO, LINEAR, (y1, y2), y2, MASSES, sticks=[y1])


@pytest.mark.parametrize("gravity", [9.81, None, "1/(1 + z)**2", g**2, y1])
def test_gravity_is_a_name(gravity):
    with pytest.raises(InputError, match=r"gravity = .*; it must be the symbol of the acceleration in V, or its name"):
        Mechanism.from_lagrangian(TWO, LINEAR, (y1, y2), y2, MASSES, gravity=gravity)
    for name in ("G", sympy.Symbol("y1"), m3):
        with pytest.raises(InputError, match=f"V has no gravity '{name}'"):
            Mechanism.from_lagrangian(TWO, CUBIC, (y1, y2), y2, MASSES | {k: 1, c: 1, g: 1, length: 1}, gravity=name)


v1, v2, t = y1.diff(), y2.diff(), dynamicsymbols._t
OTHER = dynamicsymbols("other")


@pytest.mark.parametrize(
    ("T", "V", "gap", "parameters", "message"),
    [
        (TWO + v1, LINEAR, y2, MASSES, "T must be quadratic in the speeds"),
        (TWO + m1, LINEAR, y2, MASSES, "T must be quadratic in the speeds, but it has 'm1'"),
        (TWO + v1**3, LINEAR, y2, MASSES, "T is not quadratic in the speeds"),
        (TWO * t, LINEAR, y2, MASSES, "T depends on time t itself"),
        (TWO + v1.diff() ** 2, LINEAR, y2, MASSES, "T has Derivative"),
        (m1 * (v1 + v2) ** 2 / 2, LINEAR, y2, MASSES, "least eigenvalue of their matrix is 0 where y1 = 0, y2 = 0"),
        (TWO, LINEAR, y2, {m1: 1.0, m2: -1.0}, "eigenvalue of their matrix is -1 .* give y2 a mass above 0"),
        (TWO / y1**2, LINEAR, y2, MASSES, "T has no finite value where y1 = 0"),
        (TWO, LINEAR + y1 * v1, y2, MASSES, "V depends on the speed of y1"),
        (TWO, LINEAR + OTHER**2, y2, MASSES, "V has other\\(t\\), which is not a coordinate"),
        (TWO, LINEAR + sympy.besselj(0, y1), y2, MASSES, "no function 'besselj'"),
        (TWO, LINEAR + sympy.Max(y1, 0), y2, MASSES, "no function 'Heaviside'"),
        (TWO, LINEAR + sympy.I * y1**2, y2, MASSES, "'I' .ImaginaryUnit. cannot stand in a formula"),
        (TWO, LINEAR + sympy.nan, y2, MASSES, "V = nan is not finite"),
        (TWO, LINEAR + g**2 * y1, y2, MASSES | {g: 1.0}, "V is not linear in gravity 'g'"),
        (TWO, LINEAR, y2 - v2, MASSES, "gap depends on the speed of y2"),
        (TWO, LINEAR, y2, {m1: 1.0}, "'m2' has no value: give parameters={m2: ...}"),
        (TWO, LINEAR + sympy.Symbol("y1"), y2, MASSES, "a symbol and a coordinate that are both called y1"),
        (TWO, LINEAR + sympy.Symbol("m1", positive=True) * y1, y2, MASSES, "two symbols 'm1' with different assump"),
        (TWO, LINEAR + sympy.Symbol("r") * y1**2, y2, MASSES | {"r": 1.0}, "'r' is the extension in a spring's law"),
        (TWO, LINEAR, y2, {m1: 1.0, m2: k}, "m2 = 'k' is not a number"),
        (TWO, LINEAR, y2, MASSES | {"m1": 2.0}, "parameters have 'm1' twice"),
        (TWO, LINEAR, y2, [1.0, 1.0], "parameters = .* it must be a mapping"),
        (TWO, LINEAR, y2, numpy.zeros(0), "parameters = .* it must be a mapping"),
        ("__import__('os')", LINEAR, y2, MASSES, "is not an expression of SymPy"),
        (int, LINEAR, y2, MASSES, "is not an expression of SymPy"),
    ],
)  # fmt: skip
def test_what_is_refused(T, V, gap, parameters, message):
    with pytest.raises(InputError, match=message):
        Mechanism.from_lagrangian(T, V, (y1, y2), gap, parameters)


def test_a_place_of_rest_without_a_value_is_refused():
    with pytest.raises(InputError, match="rest: 'alpha' has no value"):
        Mechanism.from_lagrangian(TWO, LINEAR, (y1, y2), y2, MASSES, rest={y1: "alpha"})


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("m3", "rest: 'm3' has no value: give it one in parameters="),
        (length, "'length' has no value"),
        (None, "None is neither a formula nor a number"),
        (10**400, "rest: 'y1' must be a finite number"),
        ([1.0], "is neither"),
        ("y2", "rest: 'y2' has no value"),
    ],
)
def test_places_of_rest_have_values(place, message):
    with pytest.raises(InputError, match=message):
        Mechanism.from_lagrangian(TWO, LINEAR, (y1, y2), y2, MASSES, rest={"y1": place})


@pytest.mark.parametrize("coordinates", [[y1, m1], [y1, v2], y1, [y1, sympy.Function("y2")(m1)]])
def test_coordinates_are_functions_of_time(coordinates):
    with pytest.raises(InputError, match=r"coordinates|other|no coordinate"):
        Mechanism.from_lagrangian(TWO, LINEAR, coordinates, y2, MASSES)
