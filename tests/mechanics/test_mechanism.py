"""Machines stated by their mechanics, against closed forms and other statements of the same machine."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from conftest import slow_after
from mechanisms import VALUES, leg, same

from orbits import InputError, Mechanism, Orbit, ReturnMap, check, find, find_all, simulate, sweep
from orbits.mechanics import Damper, Inerter, Mass, Spring
from problems import hopper_in_si


class TestTheSameMachine:
    @pytest.mark.parametrize("force", slow_after(1, ["k*r", "k*r + c*r**3", "k*sinh(r)"]))
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
        assert check(plain).largest < 1


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


class TestWhatItIs:
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

    @pytest.mark.parametrize(
        ("change", "telling"),
        [
            ({"gap": "foot*foot"}, "gap 'foot\\*foot' is not a sum of coordinates"),
            ({"gap": "foot - 0.1"}, "is not a sum of coordinates"),
            ({"parameters": {"m1": 1.0, "m2": 1.0}}, "'k' has no value"),
            ({"parameters": {**VALUES, "q": 1.0}}, "no element has a parameter 'q'"),
            ({"parameters": {**VALUES, "k": float("nan")}}, "k = nan is not a finite number"),
            ({"parameters": {**VALUES, "body": 1.0}}, "'body' is a coordinate"),
            ({"launch": "foot"}, "launch 'foot' is not a coordinate of the contact"),
            ({"counts": "body**2"}, "counts = 'body\\*\\*2' is not a sum of coordinates"),
            ({"restitution": 2.0}, "restitution = 2 is out of bounds"),
            ({"inertia": {"hip": 1.0}}, "inertia of 'hip'"),
        ],
    )
    def test_what_is_no_mechanism_is_refused(self, change, telling):
        with pytest.raises(InputError, match=telling):
            find(leg(Spring("body - foot", "k*r"), **change))


def test_a_machine_without_a_gap_never_lands():
    """It moves as one that stands on a gap of its own, beside which a weight lies."""
    from orbits import ReturnMap, check, follow, simulate, starts

    free = Mechanism(("u", "v"), [Spring("u", "r + r**3"), Spring("v - u")], gap=None, inertia={"u": 1.0, "v": 2.0})
    elements = [*free.elements, Mass("weight", 1.0)]
    inertia = {"u": 1.0, "v": 2.0}
    held = Mechanism(("u", "v", "weight"), elements, gap="weight", inertia=inertia)
    x = [0.3, -0.2, 0.7, 0.1]
    for model in (free.model, held.model):
        assert model.contact.states == ("u", "u'", "v", "v'")
        rates = model.contact.field(x, {}, [])
        assert np.abs(np.array(rates, dtype=float) - [-0.2, 0.4 - 0.3 - 0.027, 0.1, -0.2]).max() < 1e-15
        assert np.abs(np.array(model.contact_gradient(x, {}, []), dtype=float) - [-0.073, -0.2, 0.4, 0.2]).max() < 1e-15
    assert free.model.flight.field(x, {}, []) == free.model.contact.field(x, {}, [])
    assert not free.model.lands
    others = lambda m: simulate(m, 1.0), lambda m: follow(m, "b", 1.0), lambda m: m.casadi()
    for verb in (find, ReturnMap, check, starts, *others):
        with pytest.raises(InputError, match=r"has no gap \(gap=None\), so it never lands"):
            verb(free)
    with pytest.raises(InputError, match="a machine without a gap has no restitution"):
        replace(free, restitution=0.5)
    with pytest.raises(InputError, match="needs at least two"):
        Mechanism(("u",), [Spring("u")], gap="u", inertia={"u": 1.0})
