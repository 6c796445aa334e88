"""Runners against the digits of an integration with 34, and against a whole cycle of another integrator."""

from dataclasses import replace

import numpy as np
import pytest
from runners import FAST, NAMES, energy_by_hand, fast_runner, rates_by_hand
from scipy.integrate import solve_ivp

from orbits import InputError, NoOrbit, ReturnMap, check, find
from orbits.mechanics import Spring
from orbits.show.plane import landings_of, plane_paths
from problems import runner
from problems.machines import build, read

TUNE, SPEED = ("inertia", "hip_stiffness"), {"speed": 0.4}


@pytest.fixture(scope="module")
def fast():
    return find(runner(foot_mass=0.1, rest_length=3.7, inertia=5.7, hip_stiffness=5.4), tune=TUNE, at=SPEED)


@pytest.mark.slow
def test_the_numbers_of_a_run(fast):
    assert fast.admissible
    assert fast.source.values["inertia"] == pytest.approx(FAST["inertia"], rel=1e-12)
    assert fast.source.values["hip_stiffness"] == pytest.approx(FAST["hip_stiffness"], rel=1e-12)
    assert fast.flight_time / 2 == pytest.approx(FAST["half flight"], rel=1e-13)
    assert fast.contact_time / 2 == pytest.approx(FAST["half contact"], rel=1e-13)
    middle = dict(zip(fast.source.model.flight.states, fast.state_mid_flight, strict=True))
    found = [middle[name] for name in ("l", "theta'", "phi'", "x")]
    known = [FAST["leg"], FAST["leg rate"], FAST["pitch rate"], FAST["step"] / 2]
    assert found == pytest.approx(known, abs=1e-12)
    assert [fast.speed, fast.step, fast.mean_speed] == pytest.approx([0.4, FAST["step"], FAST["mean speed"]], rel=1e-12)
    certificate = fast.certificate
    assert certificate.friction_needed == pytest.approx(FAST["friction"], rel=1e-12)
    assert certificate.smallest_separation == pytest.approx(FAST["least leg"], rel=1e-12)
    assert fast.rises["foot"] == pytest.approx(FAST["foot rise"], rel=1e-12)
    assert fast.cost_of_transport == 0.0


def test_a_slow_run_of_another_leg():
    slow = find(runner(rest_length=3.707978, inertia=6.5), tune=TUNE, at={"speed": 0.2})
    tuned = [slow.source.values[name] for name in TUNE]
    assert tuned == pytest.approx([6.487065436805927, 5.465212126014383], rel=1e-11)


def test_a_whole_cycle_of_another_integrator_comes_back(fast):
    p, accurate = fast.source.values, {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}
    begun = fast(0.0)
    flight = solve_ivp(lambda t, x: rates_by_hand(x, p, False)[0], (0, fast.flight_time), begun, **accurate).y[:, -1]
    assert flight[[1, 2, 3]] == pytest.approx([0.0, 0.0, 0.0], abs=1e-11)
    assert flight[0] == pytest.approx(fast.step, rel=1e-11)
    assert rates_by_hand(flight, p, False)[1] == pytest.approx([0.0, 0.0], abs=1e-11)
    contact = solve_ivp(lambda t, x: rates_by_hand(x, p, True)[0], (0, fast.contact_time), flight[4:], **accurate)
    assert contact.y[:, -1] == pytest.approx(begun[4:], abs=1e-10)
    assert energy_by_hand(flight, p) == pytest.approx(energy_by_hand(begun, p), rel=1e-12)


def test_the_leg_carries_the_foot_at_lift_off(fast):
    """No force of the ground is left: the leg pulls with the part of the foot's weight along it, so that it is longer
    than unloaded."""
    p, theta = fast.source.values, fast(0.0)[6]
    tension = p["foot_mass"] * p["surface_gravity"] * np.cos(theta)
    assert p["stiffness"] * fast.liftoff_extension == pytest.approx(tension, rel=1e-12)


def test_the_runner_goes_by(fast):
    t = np.array([0.0, fast.flight_time + 0.1, fast.period, 2 * fast.period + fast.flight_time / 2])
    assert fast.unrolled(t)[:, 0] == pytest.approx(np.array([0.0, 1.0, 1.0, 2.5]) * FAST["step"], abs=1e-12)
    assert fast(t)[1:3, :4] == pytest.approx(0.0, abs=1e-12)
    for path in plane_paths(fast.source, fast(t), landings_of(fast, t)):
        if path.outline.name == "leg":
            assert path.points[:, 0, 0] == pytest.approx(fast.unrolled(t)[:, 0], abs=1e-12)


def test_friction_at_landing_is_the_ratio_of_the_rates(fast):
    p, x = fast.source.values, fast(fast.flight_time)[4:]
    rates = np.array(rates_by_hand(x, p, True)[0])
    ahead, behind = (np.array(rates_by_hand(x + h * rates, p, True)[1]) for h in (1e-4, -1e-4))
    normal, along = (ahead - behind) / 2e-4
    assert abs(along / normal) == pytest.approx(FAST["friction at landing"], rel=1e-7)
    # Of a run whose friction is least at both ends, the limit there counts.
    t = fast.flight_time + fast.contact_time * np.linspace(1e-3, 0.5, 200)
    shares = [abs(f[1]) / f[0] for f in (rates_by_hand(each[4:], p, True)[1] for each in fast(t))]
    assert max(shares) == pytest.approx(FAST["friction"], rel=1e-3)
    assert fast.flight_time < fast.certificate.friction_time < fast.flight_time + fast.contact_time / 2


def losses_beside(run, d):
    """The energies that the landings of a hop lose whose launch speed alone is changed by d, up to the one that holds;
    the foot flies on where the ground would have to pull."""
    p, model, lost = run.source.values, run.source.model, list[float]()
    lands = lambda t, x: x[2]  # noqa: E731
    lands.terminal, lands.direction = True, -1
    x, pressed = run(0.0), -1.0
    x[model.flight.states.index("l'")] += d
    while pressed < 0:
        rates = lambda t, x: rates_by_hand(x, p, False)[0]  # noqa: E731
        end = solve_ivp(rates, (0, 9.0), x, "DOP853", rtol=1e-13, atol=1e-16, events=lands, first_step=1e-4).y[:, -1]
        lost.append(float(model.lost_at(end.tolist(), p)))
        x = np.array([float(value) for value in model.landed(end.tolist(), p)])
        x[2], pressed = 1e-300, rates_by_hand(x[4:], p, True)[1][0]
    return lost


def test_hops_beside_lose_what_the_loss_coefficient_says(fast):
    """On the side without a bounce C, on the other one 10 C, but for a rest that falls as d^(1/3)."""
    gradient = fast.source.model.flight_gradient(fast(0.0).tolist(), fast.source.values, [])
    power = float(gradient[fast.source.model.flight.states.index("l'")])
    unit = lambda d: fast.certificate.loss_coefficient * power * abs(d) ** (4 / 3)  # noqa: E731
    (far,), (near,) = (losses_beside(fast, d) for d in (1e-4, 1e-6))
    assert [far / unit(1e-4), near / unit(1e-6)] == pytest.approx([1.0, 1.0], abs=0.04)
    assert abs(near / unit(1e-6) - 1) < abs(far / unit(1e-4) - 1) / 3
    bounces = losses_beside(fast, -1e-6)
    assert len(bounces) == 2
    assert sum(bounces) / unit(1e-6) == pytest.approx(10.0, rel=0.02)
    assert fast.certificate.bounce_side == "below"


def test_the_step_is_no_number_of_the_machine():
    with pytest.raises(InputError, match="'step' is a number of each run"):
        runner(parameters={"step": 2.0})
    with pytest.raises(InputError, match="'step' is a quantity of orbits"):
        replace(runner(), elements=[Spring("l", "step*r")])


def test_relations_hold_along_a_run(fast):
    assert check(fast.source, start=fast).largest < 1


def test_files_state_runners(tmp_path):
    (tmp_path / "runner.toml").write_text('machine = "runner"\n[parameters]\nfoot_mass = 0.2\nrest_length = 3.0\n')
    machine = build(read(tmp_path / "runner.toml"))
    assert {name: machine.values[name] for name in NAMES} == {name: runner(0.2, 3.0).values[name] for name in NAMES}
    own = {"foot_mass": 6.0, "body_mass": 60.0, "rest_length": 1.0, "inertia": 20.0}
    si = build({"machine": "runner", "si": {**own, "stiffness": 2e4, "hip_stiffness": 900.0}})
    assert si.in_si
    assert si.values["surface_gravity"] == 9.80665
    with pytest.raises(InputError, match=r"in SI needs stiffness \(N/m\), hip_stiffness \(N m/rad\): only a runner"):
        build({"machine": "runner", "si": own})
    with pytest.raises(InputError, match="'mass_ratio' belongs to machines that hop: a runner has foot_mass"):
        build({"machine": "runner", "mass_ratio": 2.0})


def test_the_rest_length_is_stated_as_of_other_machines():
    assert build({"machine": "runner", "rest_length": 3.0}).values["rest_length"] == 3.0
    with pytest.raises(InputError, match="'rest_length' is stated twice"):
        build({"machine": "runner", "rest_length": 3.0, "parameters": {"rest_length": 3.1}})


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"foot_mass": 0.0}, "foot_mass = 0; for a runner it must lie above 0"),
        ({"inertia": -1.0}, "inertia = -1; for a runner"),
        ({"parameters": {"beta": 1.0}}, "no element has a parameter 'beta'"),
        ({"parameters": {"inertia": 1.0}}, "'inertia' is an argument of its own"),
        ({"hip_spring": "hip_stiffness*r + r**2"}, "not reversed by the reversor"),
    ],
)
def test_no_runner(stated, message):
    with pytest.raises(InputError, match=message):
        runner(**stated).model  # noqa: B018


def test_a_runner_has_no_map_and_without_tuned_numbers_no_run():
    with pytest.raises(InputError, match="x of a runner sticks in contact"):
        ReturnMap(fast_runner())
    with pytest.raises((InputError, NoOrbit)):
        find(fast_runner())
