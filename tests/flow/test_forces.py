"""The forces of springs and contacts in the tables of motions, against the force balance: mass times acceleration, by
differences of the trajectory."""

import csv
import math

import numpy as np
import pytest

from orbits import InputError, Mechanism, Orbit, find, find_all, simulate, starts
from orbits.mechanics import Mass, Spring
from problems import Chain, HeavyHand, Hopper, Juggler, hopper_in_si, inerter_hopper, knee_hopper, plate_hopper, springs

CUBIC = Hopper("r + beta*r**3", mass_ratio=0.5, rest_length=10, parameters={"beta": 0.3})
LEG = hopper_in_si(60.0, 3.0, force="8000*r + 2e6*r**3", rest_length=0.8)
STEP = 1e-4  # of the differences, as a share of the flight time


def accelerations(motion, t, step):
    """Second derivatives (k, n / 2) of the coordinates, by differences of order four."""
    places = [motion(t + k * step)[:, ::2] for k in (-2, -1, 0, 1, 2)]
    weights = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / (12 * step**2)
    return sum(weight * place for weight, place in zip(weights, places, strict=True))


def inside(orbit):
    """Times inside the flight and inside the contact, far enough from their ends for differences."""
    ends = np.array([0.02, 0.98])
    flying = np.linspace(*(ends * orbit.flight_time), 23)
    standing = orbit.flight_time + np.linspace(*(ends * orbit.contact_time), 23)
    return np.concatenate([flying, standing])


def column_and_contact(orbit, t):
    columns = orbit.table(t)
    return {name: columns[name] for name in columns if "force" in name}


class TestBalance:
    @pytest.mark.parametrize("machine", [CUBIC, Hopper(), Hopper(springs.bilinear(ratio=2.0, gap=0.5))], ids=repr)
    def test_a_hopper(self, machine):
        """Body: -phi - m1 g; foot: phi - m2 g + the contact force, in the foot's weight and (1 + M)."""
        orbit, m = find(machine), machine.mass_ratio
        t = inside(orbit)
        forces, a = column_and_contact(orbit, t), accelerations(orbit, t, STEP * orbit.flight_time)
        body, foot = (1 + m) / m * a[:, 0] + 1 / m, (1 + m) * a[:, 1] + 1
        if machine.spring.pieces is None:  # elsewhere differences across a corner are none
            assert forces["spring force"] == pytest.approx(-body, abs=2e-5)
            assert forces["contact force"] == pytest.approx(foot - forces["spring force"], abs=2e-5)
        else:
            assert np.median(np.abs(forces["spring force"] + body)) < 1e-5
        assert not forces["contact force"][t < orbit.flight_time].any()
        assert forces["contact force"][t > orbit.flight_time].min() > 0

    def test_a_plate(self):
        """Three masses and two springs: the contact force is between foot and plate."""
        plate = plate_hopper(parameters={"plate_stiffness": 100.0})
        orbit = next(hop for hop in find_all(plate, starts(plate, 2, 2)) if hop.contact_time)
        t = inside(orbit)
        forces, a = column_and_contact(orbit, t), accelerations(orbit, t, STEP * orbit.flight_time)
        leg, spring, contact = (
            forces[name] for name in ("spring force of body - foot", "spring force of plate", "contact force")
        )
        assert leg == pytest.approx(-(a[:, 0] + 1), abs=1e-4)
        assert contact == pytest.approx(a[:, 1] + 1 - leg, abs=1e-4)
        assert contact == pytest.approx(-spring - 1 - a[:, 2], abs=1e-4)

    def test_a_chain(self):
        chain = Chain((1.0, 2.0, 1.0), ["r", "2*r"])
        orbit = next(hop for hop in find_all(chain, chain.starts(5, 5)) if hop.contact_time)
        t = inside(orbit)
        forces, a = column_and_contact(orbit, t), accelerations(orbit, t, STEP * orbit.flight_time)
        upper, lower = forces["spring force of y1 - y2"], forces["spring force of y2 - y3"]
        assert upper == pytest.approx(-(a[:, 0] + 1), abs=1e-4)
        assert lower == pytest.approx(upper - 2 * (a[:, 1] + 1), abs=2e-4)
        assert forces["contact force"] == pytest.approx(a[:, 2] + 1 - lower, abs=1e-4)

    def test_a_knee_has_a_torque(self):
        """Hip and foot are pulled together by the torque over the lever l cos(theta/2)."""
        knee = knee_hopper()
        orbit = find(knee)
        t = inside(orbit)
        forces, step, link = column_and_contact(orbit, t), STEP * orbit.flight_time, 0.45
        theta = orbit(t)[:, 2]
        hip = lambda at: orbit(at)[:, 0] + 2 * link * np.sin(orbit(at)[:, 2] / 2)  # noqa: E731
        weights = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / (12 * step**2)
        a = sum(w * hip(t + k * step) for w, k in zip(weights, (-2, -1, 0, 1, 2), strict=True))
        pull = forces["spring force"] / (link * np.cos(theta / 2))
        assert pull == pytest.approx(-60.0 * (a + 9.80665), abs=0.05)
        assert orbit.heading("spring force") == "spring force (N m)"

    def test_a_simulation_with_losses(self):
        """The damper's force is not the spring's: both act on the masses."""
        machine = Hopper(mass_ratio=0.5, damping=0.05)
        run = simulate(machine, 4.6, hops=1)
        t = np.concatenate([leg.start + np.linspace(0.1, 0.9, 7) * leg.path.times[-1] for leg in run.legs])
        a, x = accelerations(run, t, 1e-4), run(t)
        body = 1.5 / 0.5 * a[:, 0] + 1 / 0.5
        assert run.spring_forces(t)["spring force"] == pytest.approx(-body - 0.05 * (x[:, 1] - x[:, 3]), abs=1e-5)
        standing = run.in_contact(t)
        assert not run.contact_force(t)[~standing].any()
        assert run.contact_force(t)[standing].min() > 0


@pytest.mark.parametrize("machine", [CUBIC, LEG, Juggler(mass_ratio=0.5), HeavyHand(), inerter_hopper()], ids=repr)
def test_the_contact_force_vanishes_at_liftoff(machine):
    orbit = find(machine)
    end, largest = orbit.period * (1 - 1e-9), orbit.certificate.largest_contact_force
    assert abs(orbit.contact_force(end)) < 1e-7 * largest
    run = simulate(machine, orbit.alpha * (1 + 1e-3), hops=1)
    lifted = [event.time for event in run.events if event.kind == "lift-off"]
    assert abs(run.contact_force(lifted[-1] * (1 - 1e-12))) < 1e-6 * largest


def test_a_measured_spring_has_the_force_of_its_formula():
    r = np.linspace(-12, 12, 49)
    table = Hopper(springs.table((r, r + 0.02 * r**3), noise=0))
    columns = find(table).table()
    x = columns["y1"] - columns["y2"]
    assert columns["spring force"] == pytest.approx(x + 0.02 * x**3, abs=1e-12)


def test_several_springs_have_names_of_their_own():
    masses = [Mass("body", 1.0), Mass("foot", 1.0)]
    twice = [Spring("body - foot", "r"), Spring("body - foot", "r**3"), Spring(lambda y, p: y["body"], "0.1*r")]
    machine = Mechanism(("body", "foot"), [*masses, *twice], gap="foot", counts="body - foot")
    assert [*machine.model.spring_forces] == ["spring force of 1", "spring force of 2", "spring force of 3"]


def test_files_have_the_forces_with_their_units(tmp_path):
    orbit = find(LEG)
    with open(orbit.save(tmp_path / "hop.csv"), newline="") as file:
        head, *rows = csv.reader(file)
    assert head == [
        "time (s)",
        "phase",
        "y1 (m)",
        "y1' (m/s)",
        "y2 (m)",
        "y2' (m/s)",
        "spring force (N)",
        "contact force (N)",
    ]
    r = float(rows[40][2]) - float(rows[40][4])
    assert float(rows[40][6]) == pytest.approx(8000 * r + 2e6 * r**3, rel=1e-12)
    again = Orbit.load(orbit.save(tmp_path / "hop.json"), LEG)
    assert math.isclose(again.spring_forces(0.0)["spring force"], 3.0 * LEG.surface_gravity, rel_tol=1e-12)


def test_an_orbit_without_its_machine_says_what_it_needs(tmp_path):
    orbit = Orbit.load(find(CUBIC).save(tmp_path / "hop.json"))
    assert "spring force" not in orbit.table()
    with pytest.raises(InputError, match="pass it"):
        orbit.spring_forces(0.0)


@pytest.mark.parametrize("in_si", [False, True])
def test_a_scheduled_stiffness_is_in_the_force(in_si, tmp_path):
    """A spring that stiffens at a time: before it k, then the scheduled values, and then k again."""
    machine = Hopper("k*r", parameters={"k": 1.0})
    if in_si:
        machine = hopper_in_si(60.0, 3.0, force="k*r", parameters={"k": 8000.0}, rest_length=0.8)
    k, unit = machine.values["k"], 1.0 if machine.units is None else machine.units.time
    schedule = ([0.3 * unit, 0.6 * unit, 1.1 * unit], {"k": [1.2 * k, 0.9 * k]})
    run = simulate(machine, find(machine).alpha, time=2.0 * unit, schedule=schedule)
    t = np.array([0.1, 0.31, 0.59, 0.61, 1.05, 1.2, 1.9]) * unit
    x = run(t)
    r = x[:, 0] - x[:, 2]
    expected = np.array([1, 1.2, 1.2, 0.9, 0.9, 1, 1]) * k * r
    assert run.spring_forces(t)["spring force"] == pytest.approx(expected, rel=1e-12)
    again = type(run).load(run.save(tmp_path / "run.json"), machine)
    assert np.array_equal(again.spring_forces(t)["spring force"], run.spring_forces(t)["spring force"])
