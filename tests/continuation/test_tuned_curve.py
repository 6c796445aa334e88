"""Families along a quantity with tuned parameters against closed forms, single orbits, and themselves resumed."""

from importlib import import_module

import pytest

from orbits import Family, InputError, NoOrbit, find, follow, follow_fold, orbit_at
from problems import Hopper, hopper_in_si, runner

B = 4.493409457909064  # B = tan(B), eq. (12) of the paper
LINEAR = Hopper("k*r", parameters={"k": 1.0})
CUBIC = Hopper("cubic", rest_length=8.0, parameters={"beta": 0.3})


@pytest.fixture(scope="module")
def by_period():
    return follow(CUBIC, "period", 11.0, tune="beta", at=[10.0])


def test_stiffness_along_the_launch_speed_is_known_in_closed_form():
    family = follow(LINEAR, "alpha", 6.0, start=4.0, tune="k")
    assert family.end.kind == "reached"
    assert family.column("k") == pytest.approx((B / family.column("alpha")) ** 2, rel=1e-13)


def test_points_are_the_orbits_of_machines_with_these_parameters(by_period):
    (point,) = by_period.at(10.0)
    orbit = find(CUBIC.with_values(beta=point.also["beta"]))
    assert orbit.period == pytest.approx(10.0, rel=1e-13)
    assert orbit.alpha == pytest.approx(point.alpha, rel=1e-13)
    again, found = orbit_at(CUBIC, point, "period"), find(CUBIC, tune="beta", at={"period": 10.0})
    assert again.alpha == pytest.approx(point.alpha, rel=1e-13)
    assert found.alpha == pytest.approx(point.alpha, rel=1e-13)
    assert again.prescribed == found.prescribed == {"period": 10.0}
    assert again.tuned_errors["beta"] == pytest.approx(found.tuned_errors["beta"], rel=1.0)


def test_a_family_is_resumed_from_its_file(by_period, tmp_path):
    output = tmp_path / "family.jsonl"
    first = follow(CUBIC, "period", 11.0, tune="beta", at=[10.0], most=20, output=output)
    loaded = Family.load(output, CUBIC)
    assert loaded == first
    assert loaded.settings["tune"] == ["beta"]
    whole = follow(CUBIC, "period", 11.0, tune="beta", at=[10.0], resume=loaded, output=output)
    assert whole.end.kind == "reached"
    assert whole[-1].also["beta"] == pytest.approx(by_period[-1].also["beta"], rel=1e-13)
    assert len(Family.load(output, CUBIC)) == len(whole)
    with pytest.raises(InputError, match="the same `tune`"):
        follow(CUBIC, "mass_ratio", 2.0, resume=loaded)


def test_values_of_a_machine_in_si_are_in_si():
    leg = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 2e6}, rest_length=0.8)
    family = follow(leg, "frequency", 2.55, tune="k")
    periods = family.column("flight_time") + family.column("contact_time")
    assert 1 / periods == pytest.approx(family.column("frequency"), rel=1e-12)
    assert find(leg.with_values(k=family[-1].also["k"])).alpha == pytest.approx(family[-1].alpha, rel=1e-11)


def test_a_fold_along_a_quantity_is_located():
    """The law tanh(b r)/b does not depend on the sign of b: no launch is slower than that of a linear spring."""
    family = follow(Hopper("tanh", parameters={"b": 0.1}), "alpha", 3.0, tune="b")
    (fold,) = [event.point for event in family.events if event.kind == "fold"]
    assert fold.value == pytest.approx(B, rel=1e-12)
    assert orbit_at(Hopper("tanh", parameters={"b": 0.1}), fold, "alpha").prescribed == {"alpha": fold.value}
    assert fold.also["b"] == pytest.approx(0.0, abs=1e-6)
    assert family[-1].also["b"] == pytest.approx(-0.1, abs=1e-11)
    assert "on another sheet" in family.end.reason


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"along": "period"}, "name in tune= the parameter that changes with it"),
        ({"along": "clearance", "tune": "k"}, "depends on the whole motion and gives no equation"),
        ({"along": "mass_ratio", "tune": "k"}, r"names 1 .*, and 0 are needed: one for each quantity"),
        ({"along": "k", "tune": "k"}, "'k' is followed, so it cannot be tuned"),
        ({"along": "alpha", "tune": ("k", "mass_ratio")}, "names 2 of the parameters of the hopper, and 1 is needed"),
        ({"along": "alpha", "tune": "k", "method": "shooting"}, "tunes no parameters"),
        ({"along": "alpha", "tune": "q"}, "no parameter 'q'"),
        ({"along": "alfa", "tune": "k"}, "no parameter 'alfa'"),
    ],
)
def test_bad_arguments_are_refused(arguments, text):
    with pytest.raises(InputError, match=text):
        follow(LINEAR, stop=6.0, **arguments)


def test_a_number_that_does_not_matter_is_not_tuned():
    with pytest.raises(NoOrbit, match="alpha does not depend on mass_ratio"):
        follow(LINEAR, "alpha", 6.0, tune="mass_ratio")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("along", "start", "tuned"), [("inertia", None, "hip_stiffness"), ("speed", 0.0, ("inertia", "hip_stiffness"))]
)
def test_numbers_that_the_vertical_hop_does_not_determine_are_not_tuned(along, start, tuned, monkeypatch):
    """Without lateral motion the hip's spring stays unstretched, whatever its stiffness; no step is taken."""
    monkeypatch.setattr(import_module("orbits.continuation.follow"), "FamilyRun", None)
    with pytest.raises(
        NoOrbit, match=r"does not determine .*hip_stiffness = .* tune another number; or prescribe a speed"
    ):
        follow(runner(), along, 6.9, start, tune=tuned)


@pytest.mark.slow
def test_runs_end_where_the_vertical_hop_begins():
    """Towards rest the design tends to that where the lateral motion of the vertical hop allows a run."""
    machine = runner(foot_mass=0.1, rest_length=3.707978, inertia=6.5, hip_stiffness=5.45)
    first = find(machine, tune=("inertia", "hip_stiffness"), at={"speed": 0.2})
    assert first.source.values["inertia"] == pytest.approx(6.48706543680562, rel=1e-12)
    family = follow(first.source, "speed", 0.0, start=first, tune=("inertia", "hip_stiffness"), longest=0.2)
    assert family.end.kind == "reached"
    assert family[-1].also["inertia"] == pytest.approx(7.08244, abs=1e-5)
    assert family[-1].also["hip_stiffness"] == pytest.approx(5.52555, abs=1e-5)


@pytest.mark.slow
def test_points_of_a_family_of_runs_are_orbits_again():
    machine = runner(foot_mass=0.1, rest_length=3.7, inertia=5.7, hip_stiffness=5.4)
    family = follow(machine, "speed", 0.41, 0.4, tune=("inertia", "hip_stiffness"), longest=0.5)
    run = orbit_at(machine, family[-1], "speed")
    assert [run.speed, run.step] == pytest.approx([0.41, family[-1].also["step"]], rel=1e-12)
    assert run.source.values["inertia"] == pytest.approx(family[-1].also["inertia"], rel=1e-12)
    assert {*run.tuned_errors} == {"step", "inertia", "hip_stiffness"}
    assert run.prescribed == {"speed": 0.41}
    with pytest.raises(NoOrbit, match="this point is not a fold"):
        follow_fold(machine, family[-1], "speed", "rest_length", 3.8)
