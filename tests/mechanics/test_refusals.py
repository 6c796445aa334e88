"""What is refused of a mechanism as it is stated: names, values, and parameters of laws."""

import pickle

import pytest
from mechanisms import LEG, VALUES, machine
from scipy.integrate import solve_ivp

from orbits import InputError, Mechanism, find, simulate
from orbits.mechanics import Damper, Force, Inerter, Mass, Spring, Weight
from problems import knee_hopper
from problems.laws import gravity, springs


def with_springs_of(*laws, **more) -> Mechanism:
    """Springs side by side of unit masses."""
    elements = [Mass("body", 1.0), Mass("foot", 1.0), *(Spring("body - foot", law) for law in laws)]
    return Mechanism(("body", "foot"), elements, "foot", **more)


class TestParametersOfLaws:
    @pytest.mark.parametrize(
        ("laws", "more"),
        [
            ([springs.formula("k*r", k=1.0), springs.formula("k*r", k=3.0)], {}),
            ([springs.formula("k*r", k=3.0)], {"parameters": {"k": 1.0}}),
            ([springs.formula("k*r", k=3.0)], {"gravity": gravity.formula("1/(1 + k*z)", k=1.0)}),
        ],
        ids=["two springs", "a spring and parameters", "a spring and gravity"],
    )
    def test_of_one_name_have_one_value(self, laws, more):
        with pytest.raises(InputError, match=r"parameter 'k' has two values, .*rename one"):
            with_springs_of(*laws, **more)

    def test_are_changed_by_values(self):
        """The launch speed goes as the root of the stiffness' inverse."""
        stated = with_springs_of(springs.formula("k*r", k=3.0))
        other = pickle.loads(pickle.dumps(stated.with_values(k=12.0))).with_values(k=12.0)
        assert other.parameters == {"k": 12.0}
        assert find(other).alpha == pytest.approx(find(stated).alpha / 2, rel=1e-13)

    def test_of_functions_have_values(self):
        with pytest.raises(InputError, match="'k' has no value"):
            with_springs_of(lambda r, k: k * r)


@pytest.mark.parametrize(
    ("name", "telling"),
    [
        ("alpha", "'alpha' is an unknown of every orbit"),
        ("contact_duration", "'contact_duration' is an unknown"),
        ("gravity_share", "'gravity_share' is the share of gravity that varies"),
        ("sin", "'sin' is a function in formulas"),
        ("pi", "'pi' is a constant in formulas"),
        ("foot", "'foot' is the name of two"),
        ("1st", "'1st' cannot name a coordinate"),
        ("größe", "name a coordinate"),
        (3, "3 cannot name a coordinate"),
    ],
)
def test_names_that_coordinates_cannot_have(name, telling):
    with pytest.raises(InputError, match=telling):
        machine(coordinates=(name, "foot"), elements=[Mass(str(name), "m1"), Mass("foot", "m2"), LEG])


@pytest.mark.parametrize(
    ("change", "telling"),
    [
        ({"coordinates": ("foot",)}, "needs at least two"),
        ({"coordinates": "foot"}, "coordinates = 'foot'; it must be a list"),
        ({"elements": Mass("body", "m1")}, "elements = Mass.*; it must be a list"),
        ({"elements": ["spring"]}, "'spring' is not an element; elements are Mass, Weight, Inerter, Spring, Damper"),
        ({"elements": [Mass("body", None)]}, "None in Mass.* must be a formula, a number or a function"),
        ({"elements": [Force("body", "k*r")]}, "'k\\*r' in Force.* is not a Python function"),
        (
            {"gap": "foott"},
            "gap 'foott' has 'foott', which is neither a coordinate nor a parameter; did you mean 'foot'",
        ),
        ({"gap": [1.0]}, r"\[1.0\] in the mechanism"),
        ({"gravity": springs.formula("1 + r")}, "'1 \\+ r' is a law of r, but a law of z is needed here"),
        ({"inertia": [["a"]]}, "2 coordinates need 2 rows of 2 entries"),
        ({"inertia": [[1.0, 0.2], [0.1, 1.0]]}, "not symmetric: 0.1 in row 2 and 0.2 in row 1"),
        ({"inertia": {"bodi": 1.0}}, "inertia of 'bodi'; did you mean 'body'"),
        ({"parameters": [1.0]}, "parameters = \\[1.0\\]; it must be a mapping"),
        ({"rest": {"bdy": 1.0}}, "rest: there is no coordinate 'bdy'; did you mean 'body'"),
        ({"rest": {"body": "foot"}}, "rest 'foot' depends on the coordinate 'foot'"),
        ({"angles": ("fot",)}, "angles: there is no coordinate 'fot'; did you mean 'foot'"),
        ({"words": {"lift-off": "it opens"}}, "words: there is no message 'lift-off'; did you mean 'liftoff'"),
        ({"knees": [("fot", "body", 1.0)]}, "knees: there is no height 'fot'; did you mean 'foot'"),
        ({"knees": [("foot", "body")]}, "knees: \\('foot', 'body'\\) is not a tuple"),
        ({"actuators": {"u": "w"}}, "no extension has the actuator's displacement 'u'"),
        ({"actuators": {"body": "w"}}, "'body' is the name of two coordinates or actuators"),
        ({"surface_gravity": "foot"}, "surface_gravity 'foot' depends on the coordinate 'foot'"),
    ],
)
def test_what_is_misstated(change, telling):
    with pytest.raises(InputError, match=telling):
        machine(**change)


class TestMisspeltCoordinates:
    @pytest.mark.parametrize(
        "change",
        [
            {"elements": [Mass("bdy", "m1"), Mass("foot", "m2"), LEG]},
            {"elements": [Mass("body", "m1"), Mass("foot", "m2"), Spring("bdy - foot", "k*r")]},
            {"heights": {"body": "bdy"}},
            {"separation": "bdy - foot"},
        ],
        ids=["mass", "spring", "height", "separation"],
    )
    def test_are_named(self, change):
        with pytest.raises(InputError, match=r"'bdy' has no value; did you mean the coordinate 'body'\?"):
            find(machine(**change))

    def test_in_parameters_of_laws_are_refused(self):
        with pytest.raises(InputError, match="'foot' is a coordinate; rename the parameter"):
            with_springs_of(springs.formula("foot*r", foot=1.0))


class TestValues:
    @pytest.mark.parametrize(
        ("elements", "change", "telling"),
        [
            ([], {"m1": 0.0}, "m1 = 0: the mass in Mass.*'body'.* must be a finite number above 0"),
            ([], {"m2": -1.0}, "m2 = -1: the mass in Mass.*'foot'.* must be a finite number above 0"),
            ([Mass("body", "m1 - k")], {}, "m1 - k = -1: the mass"),
            ([Mass("body", "1/(k - 3)")], {}, r"1/\(k - 3\) = inf: the mass in Mass.* must be a finite number above 0"),
            ([Weight("body", -2.0)], {}, "-2: the mass in Weight.* must be a finite number from 0"),
            (
                [Inerter("body - foot", "b")],
                {"b": -0.1},
                "b = -0.1: the inertance in Inerter.* a finite number from 0",
            ),
            (
                [Damper("body - foot", "d")],
                {"d": -0.1},
                "d = -0.1: the coefficient in Damper.* a finite number from 0",
            ),
        ],
    )
    def test_that_no_element_has(self, elements, change, telling):
        with pytest.raises(InputError, match=telling):
            machine(*elements, parameters={**VALUES, **change})

    @pytest.mark.parametrize(
        ("gravity_law", "more", "telling"),
        [
            (-9.81, {}, "gravity '-9.81' is -9.81 at z = 0, not above 0: gravity is positive downwards"),
            ("g", {"g": 0.0}, "gravity 'g' is 0 at z = 0"),
            ("1 - z/h", {"h": 1.0, "surface": -1.6}, "'1 - z/h' times 'surface' is -1.6 at z = 0"),
            ("potential:-h*z", {"h": 2.0}, "'potential:-h\\*z' is -2 at z = 0"),
            ("h/z - 1", {"h": 0.0}, "nan at z = 0"),
            (lambda z, h: h / (1 + z) ** 2, {"h": -2.0}, "-2 at z = 0"),
        ],
    )
    def test_of_gravity_are_above_0(self, gravity_law, more, telling):
        surface = {"surface_gravity": "surface"} if "surface" in more else {}
        with pytest.raises(InputError, match=telling):
            machine(gravity=gravity_law, parameters={**VALUES, **more}, **surface)

    def test_of_an_inertia_that_is_stated(self):
        elements = [Weight("body", "m1"), Weight("foot", "m2"), LEG]
        with pytest.raises(InputError, match="b = -1: the inertia of coordinate 'foot' must be a finite number from 0"):
            machine(elements=elements, inertia={"body": "m1", "foot": "b"}, parameters={**VALUES, "b": -1.0})
        with pytest.raises(InputError, match="coordinate 'foot' has no inertia"):
            machine(elements=elements, inertia={"body": "m1", "foot": "b"}, parameters={**VALUES, "b": 0.0})


class TestActuators:
    driven = machine(
        elements=[Mass("body", "m1"), Mass("foot", "m2"), Spring("body - foot - u", "k*r")], actuators={"u": "w"}
    )

    def test_have_rates_that_are_parameters(self):
        assert self.driven.values == {**VALUES, "w": 0.0}
        assert self.driven.with_values(w=0.2).values["w"] == 0.2
        assert "w" in self.driven.scheduled
        assert self.driven.with_values(k=4.0).parameters == {**VALUES, "k": 4.0, "w": 0.0}

    @pytest.mark.parametrize("rate", [0.0, 0.05, -0.1])
    def test_move_the_springs_end(self, rate):
        """The first impact after lift-off, against the equations of motion by another integrator."""
        m1, m2, k = VALUES.values()

        def rates(t, x):
            pull = k * (x[0] - x[2] - rate * t)
            return [x[1], -pull / m1 - 1, x[3], pull / m2 - 1]

        def ground(t, x):
            return x[2] if t > 1 else 1.0  # the foot has left

        ground.terminal = True
        run = solve_ivp(rates, (0, 9), [m2 / k, 3.0, 0, 0], "DOP853", rtol=1e-12, atol=1e-13, events=ground)
        impact = simulate(self.driven.with_values(w=rate), 3.0, hops=1).events[0]
        assert impact.time == pytest.approx(run.t[-1], rel=1e-9)


def test_the_machines_of_problems_refuse_as_well():
    with pytest.raises(InputError, match="body_mass = -1: the mass"):
        knee_hopper(body_mass=-1.0)
    with pytest.raises(InputError, match="parameter 'stiffness' has two values, 600 by parameters and 500 by the law"):
        knee_hopper(springs.formula("stiffness*r", stiffness=500.0), stiffness=600.0)
    assert knee_hopper(springs.formula("stiffness*r", stiffness=500.0)).values["stiffness"] == 500.0
