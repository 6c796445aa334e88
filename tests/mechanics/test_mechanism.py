"""Machines stated by their mechanics, against closed forms, other statements of the same machine, and DOP853."""

import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from orbits import (
    InputError,
    Mechanism,
    NoOrbit,
    Orbit,
    ReturnMap,
    check,
    find,
    find_all,
    follow,
    simulate,
    starts,
    sweep,
)
from orbits.mechanics import Damper, Force, Inerter, Mass, Potential, Spring, Weight
from problems import Hopper, Juggler, hopper_in_si
from problems.laws import springs

MASSES = [Mass("body", "m1"), Mass("foot", "m2")]
VALUES = {"m1": 2.0, "m2": 0.5, "k": 3.0}


def leg(*elements, **more) -> Mechanism:
    """A body and a foot with these elements beside their masses."""
    given = {"gap": "foot", "parameters": VALUES, **more}
    return Mechanism(coordinates=("body", "foot"), elements=[*MASSES, *elements], **given)


def same(a, b, rel=1e-13):
    """Whether two orbits are the same motion."""
    for name in ("alpha", "flight_time", "contact_time", "liftoff_extension"):
        assert getattr(a, name) == pytest.approx(getattr(b, name), rel=rel), name
    assert a.certificate.loss_coefficient == pytest.approx(b.certificate.loss_coefficient, rel=1e-9)
    assert a.admissible == b.admissible


class TestTheSameMachine:
    @pytest.mark.parametrize("force", ["k*r", "k*r + c*r**3", "k*sinh(r)"])
    def test_in_si_and_by_its_mechanics(self, force):
        own = {"k": 3.0} | ({"c": 0.4} if "c*" in force else {})
        stated = hopper_in_si(2.0, 0.5, force=force, parameters=own, surface_gravity=1.7)
        derived = leg(Spring("body - foot", force), parameters={"m1": 2.0, "m2": 0.5, **own}, gravity=1.7)
        same(find(derived), find(stated))
        same(find(derived, family=3), find(stated, family=3))
        alpha = np.linspace(0.5, 4.0, 9) * find(stated).alpha / 2
        ours, theirs = ReturnMap(derived)(alpha), ReturnMap(stated)(alpha)
        assert ours.status.tolist() == theirs.status.tolist()
        assert ours.next == pytest.approx(theirs.next, rel=1e-11, nan_ok=True)

    @pytest.mark.parametrize(
        "element",
        [
            Spring("body - foot", "k*r"),
            Spring("body - foot", springs.formula("k*r", k=3.0)),
            Spring("body - foot", lambda r, k: k * r),
            Spring("body - foot", "potential:k*r**2/2"),
            Spring("2*(body - foot)", "k/4*r"),  # along a lever
            Spring("body - foot + 0.3", "k*(r - 0.3)"),
            Potential("k*(body - foot)**2/2"),
        ],
        ids=["formula", "law", "function", "potential law", "lever", "offset", "potential"],
    )
    def test_with_its_spring_in_other_words(self, element):
        counts = {"counts": "body - foot"}
        same(find(leg(element, **counts)), find(leg(Spring("body - foot", "k*r"))), rel=1e-12)

    def test_with_two_springs_side_by_side(self):
        two = leg(Spring("body - foot", "k*r"), Spring("body - foot", "c*r**3"), parameters={**VALUES, "c": 0.7})
        one = leg(Spring("body - foot", "k*r + c*r**3"), parameters={**VALUES, "c": 0.7})
        same(find(two), find(one))
        assert find(two).method == find(one).method == "relative"

    def test_with_its_inertia_as_a_matrix(self):
        weights = [Weight("body", "m1"), Weight("foot", "m2"), Spring("body - foot", "k*r")]
        for inertia in ({"body": "m1", "foot": "m2"}, [["m1", 0], [0, "m2"]]):
            stated = Mechanism(("body", "foot"), weights, "foot", parameters=VALUES, inertia=inertia)
            same(find(stated), find(leg(Spring("body - foot", "k*r"))))

    def test_in_other_coordinates(self):
        """The leg's length in place of the body's height: its inertia is then no diagonal matrix."""
        length = Mechanism(
            ("length", "foot"), [Mass("foot + length", "m1"), Mass("foot", "m2"), Spring("length", "k*r")], "foot",
            parameters=VALUES,
        )  # fmt: skip
        same(find(length), find(leg(Spring("body - foot", "k*r"))))

    def test_with_gravity_that_varies(self):
        gravity = "1/(1 + z/R)**2"
        elements = [Mass("L + body", "m1"), Mass("foot", "m2"), Spring("body - foot", "r")]
        values = {"m1": 2.0, "m2": 0.5, "R": 60.0, "L": 9.0}
        far = Mechanism(("body", "foot"), elements, "foot", values, gravity=gravity)
        stated = hopper_in_si(
            2.0, 0.5, stiffness=1.0, rest_length=9.0, surface_gravity=1.0, gravity=gravity, parameters={"R": 60.0}
        )
        assert find(far).alpha == pytest.approx(find(stated).alpha, rel=1e-12)

    def test_with_a_law_in_pieces(self):
        law = springs.end_stops(gap=1.5, stop=20.0)
        derived = leg(Spring("body - foot", law), parameters={"m1": 1.0, "m2": 1.0})
        same(find(derived), find(hopper_in_si(1.0, 1.0, force=law, surface_gravity=1.0)), rel=1e-12)

    def test_with_losses(self):
        damped = leg(Spring("body - foot", "k*r"), Damper("body - foot", "d"), parameters={**VALUES, "d": 0.02})
        forced = leg(
            Spring("body - foot", "k*r"), Force("body - foot", lambda y, v, p: -p["d"] * (v["body"] - v["foot"])),
            parameters={**VALUES, "d": 0.02},
        )  # fmt: skip
        stated = hopper_in_si(2.0, 0.5, stiffness=3.0, surface_gravity=1.0, damping=0.02)
        speeds = [2.0, 3.0, 4.0]
        assert ReturnMap(damped)(speeds).next == pytest.approx(ReturnMap(stated)(speeds).next, rel=1e-10)
        assert ReturnMap(forced)(speeds).next == pytest.approx(ReturnMap(stated)(speeds).next, rel=1e-10)
        with pytest.raises(NoOrbit, match="loses energy"):
            find(damped)


class TestNumbers:
    """What is the same for all parameters becomes a number, and nothing else does."""

    @pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
    def test_masses_as_numbers_and_as_parameters(self, scale):
        m1, m2, k = 1.23456789 * scale, scale / 3, 0.7 * scale
        numbers = Mechanism(
            ("body", "foot"), [Mass("body", m1), Mass("foot", m2), Spring("body - foot", "k*r")], "foot", {"k": k}
        )
        names = leg(Spring("body - foot", "k*r"), parameters={"m1": m1, "m2": m2, "k": k})
        same(find(numbers), find(names), rel=1e-14)
        speeds = np.linspace(0.5, 3.0, 7)
        assert ReturnMap(numbers)(speeds).next == pytest.approx(ReturnMap(names)(speeds).next, rel=1e-11, nan_ok=True)

    def test_functions_that_look_constant_in_places(self):
        """The damper is off for c <= 2, and the mass of the foot is 1 beyond s = 1."""
        hinge = Damper("body - foot", "(abs(c - 2) + c - 2)/2")
        speeds = [2.0, 3.0, 4.0]
        damped = leg(Spring("body - foot", "k*r"), hinge, parameters={**VALUES, "c": 2.1})
        plain = leg(Spring("body - foot", "k*r"), Damper("body - foot", "d"), parameters={**VALUES, "d": 0.1})
        assert ReturnMap(damped)(speeds).next == pytest.approx(ReturnMap(plain)(speeds).next, rel=1e-12, nan_ok=True)
        elements = [Mass("body", "m1"), Mass("foot", "1 + exp(-50*s)"), Spring("body - foot", "k*r")]
        heavy = Mechanism(("body", "foot"), elements, "foot", {"m1": 2.0, "k": 3.0, "s": 0.01})
        foot = leg(Spring("body - foot", "k*r"), parameters={"m1": 2.0, "m2": 1 + np.exp(-0.5), "k": 3.0})
        same(find(heavy), find(foot), rel=1e-12)

    def test_small_factors_of_large_parameters(self):
        machine = leg(Spring("body - foot", "k*r"), Inerter("body - foot", "1e-13*b"), parameters={**VALUES, "b": 2e12})
        other = leg(Spring("body - foot", "k*r"), Inerter("body - foot", "b"), parameters={**VALUES, "b": 0.2})
        same(find(machine), find(other), rel=1e-12)

    def test_masses_do_not_depend_on_coordinates(self):
        with pytest.raises(InputError, match="depends on coordinates"):
            find(leg(Spring("body - foot", "k*r"), Mass("body", lambda y, p: 1 + 0.1 * y["body"])))

    def test_may_be_missing_altogether(self):
        """Two masses of 1 under gravity 1: omega^2 = 2 in flight, tan b = b, and the foot's weight at lift-off."""
        plain = Mechanism(("body", "foot"), [Mass("body", 1.0), Mass("foot", 1.0), Spring("body - foot")], gap="foot")
        named = leg(Spring("body - foot"), parameters={"m1": 1.0, "m2": 1.0})
        orbit = find(plain)
        assert orbit.alpha == pytest.approx(4.493409457909064 * np.sqrt(2.0), rel=1e-14)
        same(orbit, find(named))
        assert [other.alpha for other in find_all(plain)] == [orbit.alpha]
        assert simulate(plain, 6.0, hops=2).launches == pytest.approx(simulate(named, 6.0, hops=2).launches, rel=1e-13)
        assert ReturnMap(plain)(6.0).next == pytest.approx(float(ReturnMap(named)(6.0).next), rel=1e-13)
        assert all(each.holds for each in check(plain).relations)

    def test_may_come_after_the_statement(self):
        stated = leg(Spring("body - foot", "k*r"), parameters={})
        same(find(stated.with_values(**VALUES)), find(leg(Spring("body - foot", "k*r"))))


@pytest.mark.parametrize(
    ("change", "telling"),
    [
        ({"launch": "u"}, "launch 'u' is no coordinate of the contact; those are body"),
        ({"counts": "0"}, "counts = '0' is no sum of coordinates"),
        ({"counts": "u"}, "counts = 'u' is no sum of coordinates"),
    ],
)
def test_a_displacement_is_no_coordinate(change, telling):
    moved = leg(Spring("body - foot - u", "k*r"), actuators={"u": "w"}, **change)
    with pytest.raises(InputError, match=telling):
        moved.model  # noqa: B018


@pytest.mark.parametrize(
    "change",
    [
        lambda: leg(Spring("body - foot", "k*r"), Damper("body - foot", 0.1)),
        lambda: leg(Spring("body - foot", "k*r"), gravity="1 - 0.001*z"),
        lambda: leg(Spring("body - foot", "k*r**3")),
    ],
)
def test_linear_equations_of_what_is_not_linear(change):
    with pytest.raises(InputError, match=r"is not linear: that takes straight springs.*constant gravity"):
        change().linear_equations()


class TestAnInerter:
    @pytest.mark.parametrize("inertance", [0.0, 0.1, 1.0, 30.0])
    @pytest.mark.parametrize("family", [1, 2])
    def test_half_the_flight_obeys_tan_x_equal_to_x(self, inertance, family):
        machine = leg(Spring("body - foot", "k*r"), Inerter("body - foot", "b"), parameters={**VALUES, "b": inertance})
        orbit = find(machine, family=family)
        frequency = np.sqrt(3.0 / (2.0 * 0.5 / 2.5 + inertance))
        x = frequency * orbit.flight_time / 2
        assert x == pytest.approx([4.493409457909064, 7.725251836937707][family - 1], rel=1e-13)
        assert orbit.liftoff_extension == pytest.approx((0.5 + inertance * 2.5 / 2.0) / 3.0, rel=1e-13)
        assert orbit.method == "closed form"
        same(orbit, find(machine, family=family, method="half orbit"), rel=1e-12)

    def test_its_family_along_the_inertance_by_another_integrator(self):
        machine = leg(
            Spring("body - foot", "k*r + c*r**3"), Inerter("body - foot", "b"),
            parameters={**VALUES, "c": 0.5, "b": 0.0},
        )  # fmt: skip
        for point in follow(machine, "b", 1.0, at=[0.3, 1.0]).events:
            b, m1, m2 = point.point.value, 2.0, 0.5
            mass = m1 * m2 / (m1 + m2) + b

            def rates(t, x, mass=mass):
                return [x[1], -(3 * x[0] + 0.5 * x[0] ** 3) / mass]

            level = m2 + b * (m1 + m2) / m1
            roots = np.roots([0.5, 0.0, 3.0, -level])
            start = float(roots[np.abs(roots.imag) < 1e-12].real[0])
            alpha = point.point.alpha
            half = alpha * m1 / (m1 + m2)
            run = solve_ivp(rates, (0, half), [start, alpha], "DOP853", rtol=1e-13, atol=1e-13)
            assert run.y[1, -1] == pytest.approx(0.0, abs=1e-10)


class TestAnotherMachine:
    def test_a_body_that_is_also_held_by_the_ground(self):
        """A second spring, from the body to the ground: no extension moves alone. The hop is a mirror image in time."""
        machine = leg(Spring("body - foot", "k*r"), Spring("body", "h*r"), parameters={**VALUES, "h": 0.2}, gravity=1.0)
        orbit = find(machine)
        assert orbit.method == "half orbit"
        assert find_all(machine, family=1)[0].alpha == pytest.approx(orbit.alpha, rel=1e-12)

        def rates(t, x):
            pull = 3 * (x[0] - x[2])
            return [x[1], (-pull - 0.2 * x[0]) / 2.0 - 1, x[3], pull / 0.5 - 1]

        start = [0.5 / 3, orbit.alpha, 0.0, 0.0]
        run = solve_ivp(rates, (0, orbit.flight_time), start, "DOP853", rtol=1e-13, atol=1e-13)
        assert run.y[:, -1] == pytest.approx([0.5 / 3, -orbit.alpha, 0.0, 0.0], abs=1e-10)

    def test_a_body_that_is_held_up(self):
        """A fifth of the foot's weight lifts the body: where body and foot weigh the same, the centre of mass falls at
        nine tenths of gravity, and the hop has nine tenths of the size."""
        values = {"m1": 1.0, "m2": 1.0}
        plain = leg(Spring("body - foot", "r"), parameters=values)
        held = leg(Spring("body - foot", "r"), Potential("-0.2*m2*body"), parameters=values)
        assert find(held).alpha == pytest.approx(0.9 * find(plain).alpha, rel=1e-12)

    def test_a_knee_with_a_moment_of_inertia(self):
        """What turns with the knee is slowed by the ground's force: lift-off depends on the launch speed."""
        height = "foot + 2*l*sin(knee/2)"
        values = {"m1": 3.0, "m2": 0.4, "j": 0.02, "l": 0.5, "k": 30.0, "rest": 2.2}
        elements = [Mass(height, "m1"), Mass("foot", "m2"), Inerter("knee", "j"), Spring("knee - rest", "k*r")]
        machine = Mechanism(
            ("foot", "knee"), elements, "foot", values, gravity=9.81, rest={"knee": "rest"}, angles=("knee",),
            heights={"body": height, "foot": "foot"},
        )  # fmt: skip
        m1, m2, j, link, k, rest = values.values()

        def rates(t, x):
            """Lagrange's equations with T = m1 (h' + s t')^2/2 + m2 h'^2/2 + j t'^2/2, s = l cos(t/2)."""
            s, bend = link * np.cos(x[2] / 2), -link / 2 * np.sin(x[2] / 2)
            matrix = np.array([[m1 + m2, m1 * s], [m1 * s, m1 * s**2 + j]])
            pull = m1 * (bend * x[3] ** 2 + 9.81)
            up, turn = np.linalg.solve(matrix, [-pull - m2 * 9.81, -pull * s - k * (x[2] - rest)])
            return [x[1], up, x[3], turn]

        orbit = find(machine)
        start = [0.0, 0.0, orbit.liftoff_extension, orbit.alpha]
        assert rates(0, start)[1] == pytest.approx(0.0, abs=1e-9)  # the foot is about to leave
        run = solve_ivp(rates, (0, orbit.flight_time), start, "DOP853", rtol=1e-13, atol=1e-13)
        assert run.y[:, -1] == pytest.approx([0.0, 0.0, start[2], -orbit.alpha], abs=1e-9)
        slow, fast = machine.model.release(np.array([0.1, 4.0]), machine.values)
        assert abs(fast - slow) > 1e-4
        assert find_all(machine, family=1)[0].alpha == pytest.approx(orbit.alpha, rel=1e-11)
        # What is lost beside the orbit is C d**(4/3), up to a share of d**(1/3) more.
        lost = []
        for distance in (1e-4 * orbit.alpha, 1e-5 * orbit.alpha):
            (back,) = ReturnMap(machine)([orbit.alpha + distance]).next
            lost.append((orbit.alpha + distance - back) / distance ** (4 / 3))
        limit = (lost[1] * 10 ** (1 / 3) - lost[0]) / (10 ** (1 / 3) - 1)
        assert orbit.certificate.loss_coefficient == pytest.approx(limit, rel=3e-3)


class TestWhatItIs:
    def test_numbers_share_a_model(self):
        machine = leg(Spring("body - foot", "k*r"))
        assert machine.with_values(k=4.0).model is machine.model
        assert leg(Spring("body - foot", "k*r"), parameters={**VALUES, "m1": 1.0}).model is machine.model

    def test_it_is_pickled_and_swept_in_processes(self):
        machine = leg(Spring("body - foot", "k*r + c*r**3"), parameters={**VALUES, "c": 0.1})
        assert find(pickle.loads(pickle.dumps(machine))).alpha == find(machine).alpha
        alone, together = (
            sweep(machine, {"k": (2.0, 4.0)}, samples=8, executor=executor) for executor in (None, "processes")
        )
        assert alone["alpha"].tolist() == together["alpha"].tolist()
        assert alone["alpha"][0] == pytest.approx(find(machine.with_values(k=alone["k"][0])).alpha, rel=1e-12)

    def test_results_have_units_in_si(self, tmp_path):
        machine = leg(Spring("body - foot", "k*r"), in_si=True, gravity="g", parameters={**VALUES, "g": 9.81})
        assert machine.describe()["units"] == {"m1": "kg", "m2": "kg", "k": "N/m", "g": "m/s^2"}
        orbit = find(machine)
        assert "m/s" in str(orbit)
        orbit.save(tmp_path / "orbit.json")
        assert Orbit.load(tmp_path / "orbit.json").alpha == orbit.alpha
        assert find(machine.dimensionless()).alpha == orbit.alpha

    def test_energy_over_many_hops(self):
        machine = leg(
            Spring("body - foot", "k*r + c*r**3"),
            Inerter("body - foot", "b"),
            parameters={**VALUES, "c": 0.5, "b": 0.2},
        )
        orbit = find(machine)
        run = simulate(machine, orbit.alpha, hops=60)
        energies = [event.energy for event in run.events]
        assert np.ptp(energies) <= 1e-11 * max(energies)

    @pytest.mark.parametrize(
        ("change", "telling"),
        [
            ({"gap": "foot*foot"}, "gap 'foot\\*foot' is no sum of coordinates"),
            ({"gap": "foot - 0.1"}, "is no sum of coordinates"),
            ({"parameters": {"m1": 1.0, "m2": 1.0}}, "'k' has no value"),
            ({"parameters": {**VALUES, "q": 1.0}}, "no element has a parameter 'q'"),
            ({"parameters": {**VALUES, "k": float("nan")}}, "k = nan is not a finite number"),
            ({"parameters": {**VALUES, "body": 1.0}}, "'body' is a coordinate"),
            ({"launch": "foot"}, "launch 'foot' is no coordinate of the contact"),
            ({"counts": "body**2"}, "counts = 'body\\*\\*2' is no sum of coordinates"),
            ({"restitution": 2.0}, "restitution = 2 is out of bounds"),
            ({"inertia": {"hip": 1.0}}, "inertia of 'hip'"),
        ],
    )
    def test_what_is_no_mechanism_is_refused(self, change, telling):
        with pytest.raises(InputError, match=telling):
            find(leg(Spring("body - foot", "k*r"), **change))

    def test_a_mechanism_without_inertia_is_refused(self):
        with pytest.raises(InputError, match="foot"):
            find(Mechanism(("body", "foot"), [Mass("body", "m1"), Spring("body - foot", "r")], "foot", {"m1": 1.0}))


@pytest.mark.parametrize("machine", [Hopper("cubic", mass_ratio=0.4), Juggler("cubic", mass_ratio=0.4)])
def test_the_relative_motion_is_found(machine):
    """The hopper's and the juggler's own units make the rate of their relative motion 1, and no parameter is in it."""
    relative = machine.model.relative
    assert relative.rate is None
    assert relative.liftoff.load == (0.0 if isinstance(machine, Hopper) else 1.0)
    assert relative.law is not None
    assert set(relative.law.names) == {"beta"}


LEVER = {"counts": "body - foot"}
HEIGHT = "foot + 2*l*sin(knee/2)"
KNEE = Mechanism(
    ("foot", "knee"),
    [Mass(HEIGHT, "m1"), Mass("foot", "m2"), Inerter("knee", "j"), Spring("knee - rest", "k*r")], "foot",
    {"m1": 3.0, "m2": 0.4, "j": 0.1, "l": 0.5, "k": 30.0, "rest": 2.2}, gravity=9.81, rest={"knee": "rest"},
    angles=("knee",), heights={"body": HEIGHT, "foot": "foot"},
)  # fmt: skip
CHECKED = {
    "lever": leg(Spring("2*(body - foot)", "k/4*r"), **LEVER),
    "offset": leg(Spring("body - foot + 0.3", "k*(r - 0.3)"), **LEVER),
    "upside down": leg(Spring("foot - body", "k*r")),
    "potential": leg(Potential("k*(body - foot)**2/2"), **LEVER),
    "side by side": leg(
        Spring("body - foot", "k*r"), Spring("2*(foot - body)", "c*r**3"), parameters={**VALUES, "c": 0.7}
    ),
    "inertia": Mechanism(
        ("body", "foot"), [Weight("body", "m1"), Weight("foot", "m2"), Spring("body - foot", "k*r")], "foot",
        parameters=VALUES, inertia={"body": "m1", "foot": "m2"},
    ),
    "length": Mechanism(
        ("length", "foot"), [Mass("foot + length", "m1"), Mass("foot", "m2"), Spring("length", "k*r")], "foot",
        parameters=VALUES,
    ),
    "varying": Mechanism(
        ("body", "foot"), [Mass("L + body", "m1"), Mass("foot", "m2"), Spring("body - foot", "r")], "foot",
        {"m1": 2.0, "m2": 0.5, "R": 60.0, "L": 9.0}, gravity="1/(1 + z/R)**2",
    ),
    "pieces": leg(Spring("body - foot", springs.end_stops(gap=1.5, stop=20.0)), parameters={"m1": 1.0, "m2": 1.0}),
    "damped": leg(Spring("body - foot", "k*r"), Damper("body - foot", "d"), parameters={**VALUES, "d": 0.02}),
    "driven": leg(
        Spring("body - foot", "k*r"), Force("body - foot", lambda y, v, p: p["d"] * (v["body"] - v["foot"])),
        parameters={**VALUES, "d": 0.02},
    ),
    "inerter": leg(Spring("body - foot", "k*r"), Inerter("body - foot", "b"), parameters={**VALUES, "b": 0.4}),
    "on the ground": leg(Spring("body - foot", "k*r"), Spring("body", "h*r"), parameters={**VALUES, "h": 0.2}),
    "held up": leg(Spring("body - foot", "k*r"), Potential("-0.2*m2*body")),
    "knee": KNEE,
    "in SI": leg(Spring("body - foot", "k*r"), in_si=True, gravity="g", parameters={**VALUES, "g": 9.81}),
    "twice the gap": leg(Spring("body - foot", "k*r"), gap="2*foot"),
}  # fmt: skip


@pytest.mark.parametrize("name", CHECKED)
def test_each_of_them_holds(name):
    checked = check(CHECKED[name])
    assert len(checked.relations) >= 24
    assert checked.largest < 0.1


def test_the_return_map_of_a_knee_whose_liftoff_depends_on_the_speed():
    """A map that took the speed from the energy at one lift-off would be 1 % off at 1.05 of the lossless speed."""
    alpha = 1.05 * find(KNEE).alpha
    run = simulate(KNEE, alpha, hops=1)
    assert ReturnMap(KNEE)([alpha]).next == pytest.approx(run.launches[1:2], rel=1e-9)


def test_the_tension_is_that_of_all_springs_along_the_extension():
    """k r and c r**3 along minus twice the extension pull with k e + 16 c e**3; a spring to the ground is another."""
    values, x = {**VALUES, "c": 0.7, "h": 0.2, "n": 2.0}, [0.4, 0.0, -0.1, 0.0]
    for more in ([], [Spring("body", "h*r")]):
        given = {name: value for name, value in values.items() if more or name != "h"}
        machine = leg(
            Spring("body - foot", "k*r"), Spring("n*(foot - body)", "c*r**3"), *more, parameters=given
        )  # fmt: skip
        assert float(machine.model.tension(x, values, [])) == pytest.approx(3.0 * 0.5 + 16 * 0.7 * 0.5**3, rel=1e-14)


def plated(gap: str, **names) -> Mechanism:
    """A hopper on a sprung plate, its foot's coordinate being "foot" or half of it."""
    foot = names.get("foot", "foot")
    elements = [Mass("body", 2.0), Mass(foot, 0.5), Mass("plate", 4.0)]
    elements += [Spring(f"body - {foot}", "k*r"), Spring("plate", "h*r")]
    heights = {"body": "body", "foot": foot, "plate": "plate"}
    return Mechanism(("body", "foot", "plate"), elements, gap, {"k": 3.0, "h": 20.0}, heights=heights)


def test_a_gap_has_no_unit_of_its_own():
    """Twice a gap closes as the gap does: the motion, the contact force and the landing jerk are the same."""
    once, twice = find(leg(Spring("body - foot", "k*r"))), find(leg(Spring("body - foot", "k*r"), gap="2*foot"))
    same(twice, once)
    for name in ("largest_contact_force", "landing_jerk"):
        assert getattr(twice.certificate, name) == pytest.approx(getattr(once.certificate, name), rel=1e-12)


def test_a_gap_along_a_lever_by_substitution():
    """The foot y moves by twice the coordinate z = y/2: the gap "2*z - plate" is y - plate. It is measured along z, so
    that its force, along z, is twice that on the foot, and its jerk half of the foot's."""
    direct, lever = plated("foot - plate"), plated("2*foot - plate", foot="2*foot")
    start = starts(direct, 3.0, 4.0)[0]
    one = find(direct, start=start)
    told = {name: value / 2 if name in ("foot", "foot'") else value for name, value in start.items()}
    two = find(lever, start=told)
    assert two.alpha == pytest.approx(one.alpha, rel=1e-12)
    assert two.period == pytest.approx(one.period, rel=1e-12)
    ratio = two.certificate.largest_contact_force / one.certificate.largest_contact_force
    assert ratio == pytest.approx(2.0, rel=1e-11)
    assert two.certificate.landing_jerk == pytest.approx(one.certificate.landing_jerk / 2, rel=1e-11)
    assert two.certificate.loss_coefficient == pytest.approx(one.certificate.loss_coefficient, rel=1e-9)
    assert check(lever, start=told).largest < 0.1


def test_landing_on_a_plate_is_the_gap_its_speed_and_its_acceleration():
    """The foot's acceleration less the plate's, written by hand."""
    machine, (body, foot, plate) = plated("foot - plate"), (0.7, 0.2, -0.3)
    x, u = [body, 0.4, foot, 0.5, plate, 0.1], dict.fromkeys(machine.model.launch_unknowns, 9.0)
    accelerated = (3.0 * (body - foot) / 0.5 - 1) - (-20.0 * plate / 4.0 - 1)
    assert [float(each) for each in machine.model.landing(u, x, machine.values)] == pytest.approx(
        [foot - plate, 0.4, accelerated], rel=1e-13
    )
