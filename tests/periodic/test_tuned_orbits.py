"""Orbits with tuned parameters against closed forms, and against the orbits of machines with these parameters."""

import json
from math import atan, pi, sqrt

import numpy as np
import pytest
from conftest import slow_after
from hanging import excess_over_barrier
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from orbits import InputError, NoOrbit, Orbit, find, find_branch_points, follow, quantities, starts
from orbits.periodic import tuned_extremes, tuned_orbits
from orbits.running import TimeOver
from problems import Chain, Hopper, hopper_in_si, runner

B = 4.493409457909064  # B = tan(B), eq. (12) of the paper
RUN = ("inertia", "hip_stiffness")
LINEAR = Hopper("k*r", mass_ratio=0.7, parameters={"k": 1.0})
CUBIC = Hopper("cubic", rest_length=8.0, parameters={"beta": 0.3})
LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 2e6}, rest_length=0.8)


def contact_time(k: float, mass_ratio: float) -> float:
    """That of a linear hopper: half a swing about rest from the lift-off extension 1/k with the launch speed."""
    pace, alpha = sqrt(mass_ratio * k / (1 + mass_ratio)), B / sqrt(k)
    return 2 / pace * (pi - atan(alpha * k * mass_ratio / ((1 + mass_ratio) * pace)))


@pytest.mark.slow
def test_a_number_that_no_equation_has_is_named():
    with pytest.raises(
        NoOrbit, match=r"on friction: tune another number \(no equation of half an orbit contains friction"
    ):
        find(runner(friction=0.9), tune=("friction", "inertia"), at={"speed": 0.4})


@pytest.mark.parametrize(("slow", "name"), [("solved_near", "period"), ("quantity_of", "body_rise")])
def test_where_the_time_is_over_the_place_is_named(monkeypatch, slow, name):
    """The values of the orbit where the search begins, since the first step from there ends after the time."""
    home = tuned_orbits if slow == "solved_near" else tuned_extremes
    known, calls, part = find(CUBIC), [], getattr(home, slow)

    def late(*arguments):
        calls.append(arguments)
        if len(calls) == (1 if slow == "solved_near" else 2):
            raise TimeOver("it takes more than 30 s")
        return part(*arguments)

    monkeypatch.setattr(home, slow, late)
    value = known.period if name == "period" else known.rises["body"]
    text = f"more than 30 s; on the way to {name} = 4 it reached {name} = {value:.6g}, with beta = 0.3"
    with pytest.raises(NoOrbit, match=text):
        find(CUBIC, tune="beta", at={name: 4.0})


def test_two_numbers_for_two_quantities_are_known_in_closed_form():
    period = 2 * B / sqrt(1.7) + contact_time(1.7, 1.3)
    orbit = find(LINEAR, tune=("k", "mass_ratio"), at={"frequency": 1 / period, "flight_time": 2 * B / sqrt(1.7)})
    assert orbit.source.values == pytest.approx({"k": 1.7, "mass_ratio": 1.3}, rel=1e-13)


@pytest.mark.parametrize("name", ["alpha", "flight_time", "contact_time", "period", "liftoff_extension"])
def test_tuning_inverts_find(name):
    beta = float(np.random.default_rng(7).uniform(0.1, 0.6))
    known = find(CUBIC.with_values(beta=beta))
    found = find(CUBIC, tune="beta", at={name: getattr(known, name)})
    assert found.source.values["beta"] == pytest.approx(beta, rel=1e-12)
    assert found.alpha == pytest.approx(known.alpha, rel=1e-12)


@pytest.mark.parametrize(("name", "family"), [("centre of mass", 1), ("body", 1), ("foot", 2)])
def test_rises_are_prescribed_too(name, family):
    known = find(CUBIC.with_values(beta=0.41), family)
    found = find(CUBIC, family, tune="beta", at={f"{name.replace(' ', '_')}_rise": known.rises[name]})
    assert found.source.values["beta"] == pytest.approx(0.41, rel=1e-11)
    assert abs(found.source.values["beta"] - 0.41) <= 100 * found.tuned_errors["beta"]


@pytest.mark.parametrize(
    "name", slow_after(2, ["clearance", "peak_force_in_weights", "stroke", "largest_contact_force", "landing_jerk"])
)
def test_extremes_and_equations_are_prescribed_together(name):
    machine = CUBIC.with_values(beta=0.35, mass_ratio=1.2)
    known = find(machine, 2)
    at = {"period": known.period, **quantities(machine, known, name)}
    found = find(CUBIC, 2, tune=("beta", "mass_ratio"), at=at)
    assert found.source.values["beta"] == pytest.approx(0.35, rel=1e-9)
    assert found.source.values["mass_ratio"] == pytest.approx(1.2, rel=1e-9)


def test_quantities_of_a_machine_in_si_are_in_si():
    orbit = find(LEG, tune=("k", "b"), at={"frequency": 2.5, "centre_of_mass_rise": 0.045})
    assert 1 / orbit.period == pytest.approx(2.5, rel=1e-13)
    assert orbit.rises["centre of mass"] == pytest.approx(0.045, rel=1e-12)
    assert find(orbit.source).alpha == pytest.approx(orbit.alpha, rel=1e-11)


def test_a_chain_is_tuned():
    chain = Chain([1.0, 2.0, 0.7], ["k*r", "r"], parameters={"k": 1.0})
    start = starts(chain)[0]
    known = find(chain.with_values(k=1.02), start=start)
    found = find(chain, start=start, tune="k", at={"period": known.period})
    assert found.source.values["k"] == pytest.approx(1.02, rel=1e-11)


def test_tuned_numbers_are_in_the_table_and_in_files(tmp_path):
    orbit = find(LEG, tune="k", at={"frequency": 2.5})
    assert "tuned k" in str(orbit)
    assert orbit.tuned == {"k": orbit.source.values["k"]}
    assert orbit.document()["tuned"] == orbit.tuned
    assert orbit.document()["tuned_errors"] == orbit.tuned_errors
    loaded = Orbit.load(orbit.save(tmp_path / "hop.json"))
    assert loaded == orbit
    assert (loaded.tuned, loaded.tuned_errors) == (orbit.tuned, orbit.tuned_errors)
    assert loaded.prescribed == orbit.prescribed == {"frequency": 2.5}
    assert "tuned" not in json.loads(json.dumps(find(CUBIC).document()))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"tune": "q", "at": {"alpha": 5.0}}, "no parameter 'q'"),
        ({"tune": "k", "at": {"alfa": 5.0}}, "did you mean 'alpha'"),
        ({"tune": "k", "at": {"mass_ratio": 5.0}}, "'mass_ratio': it is a parameter of the machine"),
        (
            {"tune": "k", "at": {"alpha": 5.0, "period": 9.0}},
            r"names 1 .*, and 2 are needed: one for each quantity of at = \['alpha', 'period'\]; choose among",
        ),
        ({"tune": "k"}, r"names 1 .*, and 0 are needed: one for each quantity of at = \[\]; leave 1 out, or prescribe"),
        (
            {"at": {"alpha": 5.0}},
            r"tune = \[\] names 0 of the parameters of the hopper, and 1 is needed: .*; choose among",
        ),
        ({"tune": ("k", "k"), "at": {"alpha": 5.0}}, "each parameter once"),
        ({"tune": 3, "at": {"alpha": 5.0}}, "tune = 3; it must list names"),
        ({"tune": {"k": 2.0}, "at": {"alpha": 5.0}}, "search begins at their values in the machine"),
        ({"tune": "k", "at": {"alpha": float("nan")}}, "at 'alpha' = nan"),
        ({"tune": "k", "at": ["alpha"]}, "a mapping of quantities to values"),
        ({"tune": "k", "at": {"frequency": -2.0}}, "'frequency' = -2: prescribe a value above 0, as every orbit"),
        ({"tune": "k", "at": {"contact_time": 0.0}}, "'contact_time' = 0: prescribe a value above 0, as every orbit"),
        ({"tune": "k", "at": {"alpha": -1.0}}, "'alpha' = -1: prescribe a value above 0, as every orbit"),
        ({"tune": "k", "at": {"stroke": -1.0}}, "'stroke' = -1: prescribe a value at least 0, as every orbit"),
        ({"tune": "k", "at": {"alpha": 5.0}, "method": "shooting"}, "tunes no parameters"),
    ],
)
def test_bad_arguments_are_refused(arguments, text):
    with pytest.raises(InputError, match=text):
        find(LINEAR, **arguments)


def test_a_machine_with_a_damper_is_not_tuned():
    with pytest.raises(InputError, match="no reversor"):
        find(Hopper("k*r", damping=0.1, parameters={"k": 1.0}), tune="k", at={"alpha": 3.0})


@pytest.mark.slow
def test_a_tuned_number_may_go_far():
    """Over four decades, to where the clearance of another integrator's flight is the prescribed one."""
    law = "r + be*r**3 + de*r**5"
    machine = Hopper(law, rest_length=15, mass_ratio=0.6, parameters={"be": 0.2, "de": 0.01})
    orbit = find(machine, 2, tune="be", at={"clearance": 0.2})
    be = orbit.machine["parameters"]["be"]
    assert be == pytest.approx(5455.8393, abs=1e-3)
    force = lambda r: r + be * r**3 + 0.01 * r**5  # noqa: E731
    liftoff = brentq(lambda r: force(r) - 1, 0.0, 1.0, xtol=1e-15)
    rates = lambda t, x: [x[1], -force(x[0]), x[3], (force(x[0]) - 1) / 1.6]  # noqa: E731
    lowest = lambda t, x: x[3]  # noqa: E731
    lowest.direction = 1.0
    begun, accurate = [liftoff, orbit.alpha, 0.0, 0.0], {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    flight = solve_ivp(rates, (0, 2 * orbit.alpha), begun, events=lowest, **accurate)
    assert flight.y[2:, -1] == pytest.approx([0.0, 0.0], abs=1e-10)
    (between,) = [y for t, (*_, y, _) in zip(flight.t_events[0], flight.y_events[0], strict=True) if y > 0.01]
    assert between == pytest.approx(0.2, abs=1e-10)


@pytest.mark.parametrize(
    ("machine", "arguments", "text"),
    [
        (LINEAR, {"tune": "mass_ratio", "at": {"alpha": 5.0}}, "alpha does not depend on mass_ratio: tune another"),
        (
            LINEAR,
            {"tune": "k", "at": {"liftoff_extension": -1.0}},
            r"no orbit with liftoff_extension = -1 .* k = .* and rising",
        ),
        (LINEAR, {"tune": "k", "at": {"clearance": 1.0}}, "has no clearance: in family 1"),
        (CUBIC, {"tune": "mass_ratio", "at": {"contact_time": 0.5}}, "no orbit with contact_time = 0.5"),
    ],
)
def test_where_nothing_is_reached_the_reason_names_the_tuned_number(machine, arguments, text):
    with pytest.raises(NoOrbit, match=text):
        find(machine, **arguments)


@pytest.mark.slow
def test_a_fast_run_is_on_the_sheet_that_begins_at_the_vertical_hop():
    """The family turns back at the speed 3.6124; the first sheet is that of the family followed from a slow run."""
    machine = runner(foot_mass=0.1, rest_length=3.7, inertia=5.7, hip_stiffness=5.4)
    slow = find(machine, tune=RUN, at={"speed": 0.4})
    assert slow.source.values["inertia"] == pytest.approx(5.654048422247934, rel=1e-12)
    assert slow.source.values["hip_stiffness"] == pytest.approx(5.367600480798711, rel=1e-12)
    family = follow(slow.source, "speed", 1.0, start=slow, tune=RUN, longest=0.3)
    fast = find(machine, tune=RUN, at={"speed": 1.0})
    assert fast.source.values["inertia"] == pytest.approx(family[-1].also["inertia"], rel=1e-11)
    needs = find(machine, tune=RUN, at={"friction_needed": 0.3})
    assert needs.certificate.friction_needed == pytest.approx(0.3, rel=1e-11)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({}, r"tune = \[\] names 0 .*, and 1 is needed: .* 10 equations for 9 unknowns; choose among stiffness, "),
        (
            {"tune": "inertia", "at": {"speed": 0.4}},
            r"names 1 .*, and 2 are needed: .* 9 unknowns, and one more for each quantity of at = \['speed'\]",
        ),
    ],
)
def test_a_runner_needs_one_tuned_number_more(arguments, text):
    with pytest.raises(InputError, match=text):
        find(runner(foot_mass=0.1, rest_length=3.7, inertia=5.7, hip_stiffness=5.4), **arguments)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("family", "speed", "text"),
    [
        (1, 0.0, "the orbit does not determine inertia .* prescribe a speed farther from 0"),
        (2, 0.4, "in the vertical hop of family 2 parts pass through each other"),
    ],
)
def test_where_no_run_is_found_the_reason_is_said(family, speed, text):
    machine = runner(foot_mass=0.1, rest_length=3.7, inertia=5.7, hip_stiffness=5.4)
    with pytest.raises(NoOrbit, match=text):
        find(machine, family, tune=RUN, at={"speed": speed})


@pytest.mark.slow
def test_a_run_without_speed_differs_from_a_slow_one():
    """Numbers of slow runs go to those of the branch point; from a run, rounding remains of its lateral motion."""
    machine = runner(foot_mass=0.1, rest_length=3.7, inertia=5.7, hip_stiffness=5.4)
    (point,) = find_branch_points(machine, {"inertia": (7.0, 7.5), "hip_stiffness": (5.4, 5.6)}, designs=4)
    slow = find(machine, tune=RUN, at={"speed": 1e-20})
    assert {name: slow.source.values[name] for name in RUN} == pytest.approx(point.values, rel=1e-11)
    run = find(machine, tune=RUN, at={"speed": 0.1})
    for at in ({"speed": 0.0}, {"mean_speed": 0.0}, {"step": 0.0}, {"speed": 1e-40}):
        with pytest.raises(NoOrbit, match=r"does not determine inertia .* hip_stiffness .* a speed farther from 0"):
            find(machine, tune=RUN, at=at, start=run)


def test_a_contact_that_hangs():
    """Its launch is that of the collapse, where the body comes to rest at the barrier, but for 1e-24 of its energy."""
    machine = Hopper("cubic", rest_length=30.0, parameters={"beta": -0.005})
    orbit = find(machine, tune="beta", at={"contact_time": 60.0})
    beta = orbit.source.values["beta"]
    assert excess_over_barrier(orbit.alpha, orbit.liftoff_extension, beta) == pytest.approx(0.0, abs=1e-11)
    assert orbit.contact_time == pytest.approx(60.0, rel=1e-15)
    assert orbit.certificate.energy_drift < 1e-13
    assert max(orbit.error, orbit.tuned_errors["beta"]) < 1e-13


@pytest.mark.slow
def test_a_contact_that_no_launch_determines():
    with pytest.raises(NoOrbit, match="of its launch do not determine it"):
        find(Hopper("cubic", parameters={"beta": -0.005}), tune="beta", at={"contact_time": 100.0})
