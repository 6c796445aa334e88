"""Designs with tuned parameters, against closed forms of linear hoppers, differences and `find` on grids."""

import casadi as ca
import numpy as np
import pytest
from conftest import slow_after
from scipy.optimize import brentq

from orbits import Design, DesignCurve, InputError, NoOrbit, find, optimize, orbit_function, pareto, sensitivities
from orbits.design import Outputs
from orbits.design.design_point import Case, design_points
from orbits.design.tuned_machine import TunedMachine, first_of_tuned, names_of_designs, unknowns_of
from orbits.symbolic import parse
from problems import Hopper, hopper_in_si, runner

LINEAR = Hopper("k*r", parameters={"k": 1.0})
WITH_FREQUENCY = {"tune": "k", "at": {"frequency": 0.1}}
RUNNER = runner(foot_mass=0.1, rest_length=3.7, inertia=5.7, hip_stiffness=5.4)
AT_SPEED = {"tune": ("inertia", "hip_stiffness"), "at": {"speed": 0.4}}
RANGE = {"mass_ratio": (0.5, 3.0)}
COST = "(k - 2)**2 + mass_ratio"


def stiffness(mass_ratio: float, frequency: float = 0.1) -> float:
    """That with a frequency; the period is that of stiffness 1 over the root of the stiffness."""
    return (frequency * find(LINEAR.with_values(mass_ratio=mass_ratio)).period) ** 2


def test_the_best_design_is_that_of_the_closed_form():
    best = optimize(LINEAR, minimise="(k - 2)**2 + 1", over=RANGE, **WITH_FREQUENCY)
    assert best.parameters["mass_ratio"] == pytest.approx(brentq(lambda m: stiffness(m) - 2, 1.0, 1.2), rel=1e-7)
    assert best.parameters["k"] == pytest.approx(stiffness(best.parameters["mass_ratio"]), rel=1e-11)
    assert 1 / best.orbit.period == pytest.approx(0.1, rel=1e-12)
    assert best.orbit.prescribed == {"frequency": 0.1}
    assert (best.tune, best.at) == (("k",), {"frequency": 0.1})
    assert best.kkt < 1e-6
    assert not best.active


def test_bounds_and_constraints_hold_with_their_multipliers():
    bound = optimize(LINEAR, minimise="k", over=RANGE, **WITH_FREQUENCY)
    assert [each.text for each in bound.active] == ["mass_ratio <= 3"]
    slope = (stiffness(3.0 + 1e-5) - stiffness(3.0 - 1e-5)) / 2e-5
    assert bound.active[0].multiplier == pytest.approx(-slope, rel=1e-8)
    held = optimize(LINEAR, minimise="k", over=RANGE, subject_to=["alpha == 3.2"], **WITH_FREQUENCY)
    assert [each.text for each in held.active] == ["alpha == 3.2"]
    assert held.orbit.alpha == pytest.approx(3.2, rel=1e-12)
    with pytest.raises(NoOrbit, match="'alpha <= 1' is missed by"):
        optimize(LINEAR, minimise="k", over=RANGE, subject_to=["alpha <= 1"], starts=1, **WITH_FREQUENCY)


@pytest.mark.slow
def test_derivatives_go_through_the_tuned_numbers():
    """Of all quantities of a run by two parameters and the prescribed speed, against differences."""
    machine, orbit = first_of_tuned(TunedMachine(RUNNER, AT_SPEED["tune"], AT_SPEED["at"]), None, 1)
    absent = ("clearance", "smallest_contact_force")  # the middle has no lowest point
    names = [name for name in names_of_designs(machine) if name not in (*absent, "body_mass")]
    outputs = Outputs(tuple(map(parse, names)), ("rest_length", "foot_mass", "speed"))
    (point,) = design_points([Case(machine, orbit, outputs, {})])
    assert point.quantities["friction_needed"] == pytest.approx(find(RUNNER, **AT_SPEED).certificate.friction_needed)
    for j, name in enumerate(outputs.over):
        steps = []
        for step in (1e-4, 5e-5):
            near = [machine.with_values(**{name: machine.values[name] + way * step}) for way in (1, -1)]
            cases = [Case(*each.near(unknowns_of(machine, orbit), None), outputs, {}) for each in near]
            above, below = (each.values[: len(names)] for each in design_points(cases))
            steps.append((above - below) / (2 * step))
        expected = (4 * steps[1] - steps[0]) / 3
        assert point.slopes[: len(names), j] == pytest.approx(expected, rel=2e-8, abs=2e-8)


def test_the_best_of_several_starts_and_a_saved_design(tmp_path):
    best = optimize(LINEAR, maximise="k", over={"mass_ratio": (0.01, 10.0)}, starts=2, **WITH_FREQUENCY)
    assert len(best.starts) == 2
    assert best.objective == max(start.objective for start in best.starts if start.objective)
    assert best.objective == pytest.approx(stiffness(best.parameters["mass_ratio"]), rel=1e-11)
    best.save(tmp_path / "best.json")
    again = Design.load(tmp_path / "best.json", machine=LINEAR)
    assert (again.parameters, again.tune, again.at) == (best.parameters, best.tune, best.at)


def test_the_best_of_a_sample_is_that_of_the_closed_form():
    """Of an objective with several minima in the tuned stiffness."""
    best = optimize(LINEAR, minimise="sin(8*k) + 0.3*k", over=RANGE, starts="global", **WITH_FREQUENCY)
    k = np.linspace(stiffness(3.0), stiffness(0.5), 100_001)
    values = np.sin(8 * k) + 0.3 * k
    assert best.objective == pytest.approx(values.min(), abs=1e-7)
    assert best.parameters["k"] == pytest.approx(k[values.argmin()], abs=2e-5)
    assert best.parameters["k"] == pytest.approx(stiffness(best.parameters["mass_ratio"]), rel=1e-11)
    assert len(best.starts) > 1
    assert 0.5 < best.share < 1


def test_sensitivities_of_tuned_orbits():
    """The stiffness is the square of the frequency times that of the period of stiffness 1."""
    machine = LINEAR.with_values(mass_ratio=2.0)
    slopes = sensitivities(machine, 1, quantities=["k", "alpha"], **WITH_FREQUENCY)
    assert set(slopes["k"]) == {"mass_ratio", "frequency"}
    assert slopes["k"]["frequency"] == pytest.approx(2 * stiffness(2.0) / 0.1, rel=1e-11)
    by_ratio = sensitivities(LINEAR.with_values(mass_ratio=2.0), 1, ["mass_ratio"], ["period"])["period"]["mass_ratio"]
    period = find(LINEAR.with_values(mass_ratio=2.0)).period
    assert slopes["k"]["mass_ratio"] == pytest.approx(2 * 0.1**2 * period * by_ratio, rel=1e-9)
    second = sensitivities(machine, start=find(machine, 2), quantities="k", **WITH_FREQUENCY)
    assert second.at["k"] == pytest.approx((0.1 * find(machine, 2).period) ** 2, rel=1e-11)


def test_an_orbit_of_casadi_is_tuned():
    """Its results are those of `find`, and its derivatives those of differences between such orbits."""
    spring, times = Hopper("k*r + 0.2*r**3", parameters={"k": 1.0}, rest_length=20.0), np.array([0.3, 2.0])
    over, theta = ["mass_ratio", "frequency"], np.array([1.2, 0.11])
    function = orbit_function(spring, over, times=2, tune="k", at={"frequency": 0.12})

    def found(place: np.ndarray) -> np.ndarray:
        orbit = find(spring.with_values(mass_ratio=place[0]), tune="k", at={"frequency": place[1]})
        return np.array(
            [orbit.alpha, orbit.flight_time, orbit.contact_time, orbit.source.values["k"], *orbit(times).ravel()]
        )

    x = ca.MX.sym("x", 2)
    launch, durations, tuned, states = function(x, times)
    results = ca.vertcat(launch[1], durations, tuned, ca.vec(states))
    values, slopes = (np.array(each) for each in ca.Function("all", [x], [results, ca.jacobian(results, x)])(theta))
    assert values[:, 0] == pytest.approx(found(theta), rel=1e-11)
    ways = np.diag(1e-4 * theta)
    differences = np.column_stack([(found(theta + way) - found(theta - way)) / (2 * way.sum()) for way in ways])
    assert slopes == pytest.approx(differences, rel=1e-6, abs=1e-6)
    leg = hopper_in_si(40, 10, force="k*r + b*r**3", parameters={"k": 2e4, "b": 4e4}, rest_length=1.0)
    frequency = 1 / find(leg).period
    function = orbit_function(leg, ["body_mass", "frequency"], tune="k", at={"frequency": frequency})
    for mass, ratio in ((40, 1.0), (42, 1.02), (60, 1.1)):
        _, durations, tuned = function([mass, ratio * frequency])
        orbit = find(leg.with_values(body_mass=mass), tune="k", at={"frequency": ratio * frequency})
        known = [orbit.flight_time, orbit.contact_time, orbit.tuned["k"]]
        assert np.array(ca.vertcat(durations, tuned))[:, 0] == pytest.approx(known, rel=1e-11)
    with pytest.raises(InputError, match="'k' is tuned and follows from the others"):
        orbit_function(spring, "k", tune="k", at={"frequency": 0.12})
    with pytest.raises(InputError, match="a runner moves along the ground, which"):
        orbit_function(RUNNER, "rest_length", **AT_SPEED)


@pytest.mark.parametrize(("what", "to"), slow_after(1, [("mass_ratio <= 0.6", 0.5), ("frequency", 0.12)]))
def test_designs_are_followed(what, to, tmp_path):
    """Along a prescribed quantity and along a bound, against searches; the slope is that of differences."""
    over = {"mass_ratio": (0.4, 3.0 if what == "frequency" else 0.6)}
    best = optimize(LINEAR, minimise=COST, over=over, **WITH_FREQUENCY)
    curve = best.follow(what, to, points=4)
    assert not curve.end
    for value, design in zip(curve.values, curve.designs, strict=True):
        if any(value == event.value for event in curve.events):  # the bound is active there, with a multiplier 0
            continue
        moved = {"over": {"mass_ratio": (0.4, value)}} if what != "frequency" else {"over": over}
        at = {"frequency": value} if what == "frequency" else WITH_FREQUENCY["at"]
        alone = optimize(LINEAR, minimise=COST, tune="k", at=at, **moved)
        assert design.parameters == pytest.approx(alone.parameters, rel=1e-9)
        assert design.objective == pytest.approx(alone.objective, rel=1e-11)
        assert design.orbit.prescribed == at
    again = DesignCurve.load(curve.save(tmp_path / "curve.json"), LINEAR)
    assert str(again) == str(curve)
    if what == "frequency":
        last = again.designs[1].follow(what, to, points=2).objectives[-1]
        assert last == pytest.approx(curve.objectives[-1], rel=1e-12)
    with pytest.raises(InputError, match="'k' is tuned: follow a prescribed quantity"):
        best.follow("k", 1.0)


def test_bad_arguments_are_named():
    wrong = [
        ({"over": {"k": (1.0, 2.0)}}, "'k' is varied"),
        ({"at": {"clearance": 1.0}}, "at 'clearance': it depends on the whole motion"),
    ]
    for change, words in wrong:
        with pytest.raises(InputError, match=words):
            optimize(LINEAR, **{"minimise": "k", "over": RANGE, **WITH_FREQUENCY, **change})
    with pytest.raises(InputError, match="'k' is tuned and follows from the others"):
        sensitivities(LINEAR, 1, ["k"], **WITH_FREQUENCY)
    with pytest.raises(InputError, match="a runner has no orbits near this one unless a parameter is tuned"):
        sensitivities(RUNNER)
    for function, objective in ((optimize, "friction_needed"), (pareto, ("alpha", "stroke"))):
        with pytest.raises(InputError, match="half an orbit has 10 equations for 9 unknowns"):
            function(RUNNER, minimise=objective, over={"rest_length": (3.6, 3.9)})
