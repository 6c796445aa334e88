"""Designs whose problem has a number that moves: closed forms of the linear hop, searches, events, and ends."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import slow_after
from designs import LEG, OVER
from legibility import faults
from scipy.optimize import brentq

from orbits import Design, DesignCurve, Front, InputError, NoOrbit, find, optimize, quantities
from orbits.design.design_problem import design_problem
from orbits.design.moving_number import moving_number
from orbits.design.traced_designs import program_about
from problems import Hopper, hopper_in_si

LINEAR = hopper_in_si(60.0, 3.0, force="k*r", parameters={"k": 8000.0}, rest_length=0.8)
OF_LINEAR = {"k": (2000.0, 20000.0), "body_mass": (20.0, 100.0)}
ALPHA, GRAVITY, FOOT = 4.493409457909064, 9.80665, 3.0
COST = "(k/8000)**2 + (10/body_mass)**2"


def cost_of(k: float, body: float) -> float:
    return (k / 8000) ** 2 + (10 / body) ** 2


def stiffness(rise: float, body: float) -> float:
    """That of a linear leg that rises so high: its speeds and times are multiples of those without units."""
    return ALPHA**2 * FOOT * GRAVITY * body / (2 * rise * (body + FOOT))


def best_body(rise: float, stiffest: float = np.inf) -> float:
    """The mass of the body with which the cost is least, of the legs that rise so high."""
    slope = lambda body: cost_of(stiffness(rise, body + 1e-20j), body + 1e-20j).imag / 1e-20  # noqa: E731
    free = brentq(slope, 1.0, 100.0, xtol=1e-13)
    return free if stiffness(rise, free) < stiffest else brentq(lambda m: stiffness(rise, m) - stiffest, 1e-3, free)


def best_cost(rise: float) -> float:
    """The least cost, with a stiffness of at most 8800."""
    return cost_of(stiffness(rise, best_body(rise, 8800.0)), best_body(rise, 8800.0))


@pytest.fixture(scope="module")
def linear():
    over = {"k": (2000.0, 8800.0), "body_mass": (1.0, 100.0)}
    return optimize(LINEAR, minimise=COST, over=over, subject_to=["centre_of_mass_rise <= 0.04"])


@pytest.mark.parametrize(
    ("what", "to"),
    slow_after(
        2, [("stroke <= 0.25", 0.1), ("centre_of_mass_rise == 0.2", 0.1), ("body_mass", 70.0), ("b <= 1e+07", 5e6)]
    ),
)
def test_derivatives_are_those_by_differences(what, to):
    """Slopes are exact, and bends nearly so, whatever moves."""
    limits = ["stroke <= 0.25", "centre_of_mass_rise == 0.2"]
    problem = design_problem(LEG, "loss_coefficient", None, OVER, limits)
    moving = moving_number(problem, LEG, what, to)
    program = program_about(LEG, find(LEG).dimensionless(), problem, moving, (), ())
    n, h = len(program.free), 1e-5
    x, y = np.array([0.001, 0.002, 0.3][:n]), np.array([0.3, -0.7, 0.2][: len(program.sizes)])
    here, second = program.first(x, 0.3, y), program.second(x, 0.3, y)
    for i, way in enumerate(np.eye(n + 1) * h):
        ahead, behind = (program.first(x + s * way[:n], 0.3 + s * way[n], y) for s in (1, -1))
        rates = (ahead.values - behind.values) / (2 * h), (ahead.gradient - behind.gradient) / (2 * h)
        wanted = second.values_slope, second.gradient_slope
        wanted = (second.jacobian[:, i], second.hessian[:, i]) if i < n else wanted
        assert rates[0] == pytest.approx(wanted[0], rel=1e-6, abs=1e-9)
        assert rates[1] == pytest.approx(wanted[1], rel=1e-5, abs=1e-6)
        of_cost = (ahead.cost - behind.cost) / (2 * h) + y @ rates[0]
        assert of_cost == pytest.approx(here.gradient[i] if i < n else here.slope, rel=1e-5, abs=1e-9)


@pytest.mark.slow
def test_a_bound_is_followed_with_its_price(linear):
    """Along closed forms: the design, the slope of its cost, and where the stiffest spring is reached."""
    curve = linear.follow("centre_of_mass_rise <= 0.04", 0.03, points=6)
    assert curve.parameter == "centre_of_mass_rise <="
    assert curve.values[:: len(curve.values) - 1] == (0.04, 0.03)
    for rise, design, slope in zip(curve.values, curve.designs, curve.slopes, strict=True):
        body = best_body(rise, 8800.0)
        assert design.parameters["body_mass"] == pytest.approx(body, rel=1e-8)
        assert design.parameters["k"] == pytest.approx(stiffness(rise, body), rel=1e-9)
        assert design.kkt < 1e-9
        assert design.orbit.admissible
        assert slope == pytest.approx((best_cost(rise + 1e-8) - best_cost(rise - 1e-8)) / 2e-8, rel=1e-5)
    (event,) = curve.events
    assert (event.kind, event.text) == ("enters", "k <= 8800")
    reached = brentq(lambda rise: stiffness(rise, best_body(rise)) - 8800.0, 0.03, 0.04, xtol=1e-14)
    assert event.value == pytest.approx(reached, rel=1e-9)
    assert curve.multipliers()["k <= 8800"][0] == 0.0
    assert "k <= 8800 enters" in str(curve)


@pytest.mark.parametrize(
    ("what", "to", "over"),
    slow_after(
        1,
        [
            ("foot_mass", 4.0, {}),
            ("body_mass <= 100", 12.0, {"body_mass": (1.0, 12.0)}),
            ("k <= 8800", 6500.0, {"k": (2000.0, 6500.0)}),
        ],
    ),
)
def test_points_of_a_curve_are_those_that_a_search_finds(linear, what, to, over):
    curve = linear.follow(what, to, points=3)
    machine = LINEAR.with_values(**({what: to} if what == "foot_mass" else {}))
    same = optimize(machine, minimise=COST, over={**linear.over, **over}, subject_to=linear.subject_to)
    assert curve.values[-1] == to
    assert curve.designs[-1].parameters == pytest.approx(same.parameters, rel=1e-8)
    assert curve.designs[-1].objective == pytest.approx(same.objective, rel=1e-10)
    multipliers = {each.text: each.multiplier for each in curve.designs[-1].active}
    assert multipliers == pytest.approx({each.text: each.multiplier for each in same.active}, rel=1e-6)


@pytest.mark.slow
def test_an_inactive_constraint_enters_and_the_curve_ends_where_constraints_exclude_each_other():
    """The lightest leg that is allowed has the shortest stroke for its rise."""
    best = optimize(LINEAR, maximise="k", over=OF_LINEAR, subject_to=["centre_of_mass_rise == 0.04", "stroke <= 0.4"])
    both = ["stroke", "centre_of_mass_rise"]
    legs = [LINEAR.with_values(body_mass=body) for body in (100.0, 20.0)]
    strokes = [0.04 * np.divide(*quantities(leg, find(leg), both).values()) for leg in legs]
    curve = best.follow("stroke <= 0.4", 0.1, points=4)
    assert best.parameters["body_mass"] == 100.0
    assert curve.slopes[0] == 0.0
    assert curve.events[0].value == pytest.approx(strokes[0], rel=1e-9)
    assert (curve.events[0].kind, curve.events[0].text) == ("enters", "stroke <=")
    assert [*curve.document()["events"][0]] == ["value", "kind", "text"]  # as files have had them
    assert curve.values[-1] == pytest.approx(strokes[1], rel=1e-9)
    assert curve.designs[-1].parameters["body_mass"] == pytest.approx(20.0, rel=1e-9)
    assert "the constraints exclude each other" in curve.end


def test_a_curve_comes_back(linear, tmp_path):
    for what, to in (("centre_of_mass_rise <= 0.04", 0.038), ("foot_mass", 3.1)):
        curve = linear.follow(what, to, points=2)
        path = curve.save(tmp_path / "curve.json")
        again = DesignCurve.load(path, LINEAR)
        assert str(again) == str(curve)
        assert again.save(tmp_path / "again.json").read_bytes() == path.read_bytes()
        assert again.designs[1].source == curve.designs[1].source
    axes = curve.plot()
    assert axes.get_xlabel() == "foot mass (kg)"
    assert not faults(axes.figure)
    best = Design.load(linear.save(tmp_path / "best.json"), LINEAR)
    assert best.follow("foot_mass", 3.1, points=2).designs[1].parameters == curve.designs[1].parameters
    with pytest.raises(InputError, match="is not a saved curve of designs"):
        DesignCurve.load(linear.save(tmp_path / "design.json"), LINEAR)


def test_wrong_events_in_files_are_refused(linear):
    front = {"points": [linear.saved() | {"pair": [1.0, 2.0]}], "objectives": ["alpha", "k"], "refused": []}
    row = {"parameter": "foot_mass", "designs": [linear.saved() | {"value": 3.0, "slope": 0.0}], "end": ""}
    wrong = {
        "value = 'abc'": {"value": "abc", "kind": "enters"},
        "value is missing": {"kind": "enters"},
        "value = nan": {"value": float("nan"), "kind": "enters"},
        "value = None": {"value": None, "kind": "enters"},
        "kind is missing": {"value": 1.0},
        "cost = 'abc'": {"value": 1.0, "kind": "enters", "cost": "abc"},
        "what is unknown": {"value": 1.0, "kind": "enters", "what": ""},
    }
    for reason, event in wrong.items():
        for kind, document in ((DesignCurve, row), (Front, front)):
            with pytest.raises(InputError, match=rf"events\[0\]\.{reason}"):
                kind.of_saved(document | {"seconds": 1.0, "events": [event]}, LINEAR)


@pytest.mark.slow
def test_what_cannot_be_followed(linear):
    for what, words in {
        "stroke <= 1": "no constraint, bound or parameter 'stroke <= 1'; known: centre_of_mass_rise <= 0.04, body_mass",
        "k": "'k' is a design parameter: follow one of its bounds, 'k >= 2000' or 'k <= 8800'",
        "mass_ratio": "in SI it follows from the masses",
        "foot_mas": "did you mean 'foot_mass'",
    }.items():
        with pytest.raises(InputError, match=words):
            linear.follow(what, 0.05)
    with pytest.raises(InputError, match="leaves no room between the bounds"):
        linear.follow("k <= 8800", 1000.0)
    with pytest.raises(InputError, match=r"at most 1e\+100 times its range"):
        linear.follow("k <= 8800", 1e308)
    with pytest.raises(InputError, match=r"constraint can be moved by at most 1e\+100"):
        linear.follow("centre_of_mass_rise <= 0.04", 1e308)
    with pytest.raises(InputError, match="a search without derivatives: its optimality conditions cannot be followed"):
        replace(linear, kkt=None).follow("foot_mass", 4.0)
    with pytest.raises(InputError, match="'foot_mass' has this value already"):
        linear.follow("foot_mass", linear.source.values["foot_mass"])
    with pytest.raises(InputError, match="points = 1"):
        linear.follow("foot_mass", 4.0, points=1)
    both = optimize(LINEAR, minimise="k", over={"k": (2e3, 2e4)}, subject_to=["0.02 <= centre_of_mass_rise <= 0.04"])
    with pytest.raises(InputError, match="has two bounds: state it as two constraints"):
        both.follow("0.02 <= centre_of_mass_rise <= 0.04", 0.05)
    spring = Hopper("r + b*r**3 + d*r**5", parameters={"b": 0.1, "d": 0.001})
    over = {"b": (0.0, 0.2), "d": (0.0, 0.005)}
    flat = optimize(spring, minimise="alpha", over=over, subject_to=["alpha >= 3.2"])  # all along a curve
    with pytest.raises(NoOrbit, match="no minimum to follow"):
        flat.follow("alpha >= 3.2", 3.25)
