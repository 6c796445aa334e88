"""Motions of machines that stick, held against an integration of the runner in Cartesian coordinates by SciPy."""

from dataclasses import replace

import numpy as np
import pytest
from runners import rates_by_hand
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from two_feet import FEET, height_in_contact, slowest_step

from orbits import ReturnMap, find, multipliers, simulate
from orbits.errors import InputError, NoOrbit
from orbits.hops import STATUSES, Impacts, LaunchSection
from problems import runner

# The four multipliers beside that of the energy, by differences of flows by DOP853 or by another program, with errors.
SPEEDS = {
    0.1: ((11.78703, 1.32378, 0.76288, 0.07213), 6e-6),
    0.4: ((14.29529282, 2.23596051, 0.46938431, 0.05572022), 5e-8),
    1.5: ((29.2856057, 3.60657677, 0.32247977, 0.02409012), 5e-8),
}
KW = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-15}


def run_at(speed: float):
    return find(runner(foot_mass=0.1, rest_length=3.7), tune=("inertia", "hip_stiffness"), at={"speed": speed})


@pytest.fixture(scope="module")
def run():
    return run_at(0.4)


def with_friction(run, friction):
    own = {name: run.source.values[name] for name in ("inertia", "hip_stiffness")}
    return runner(foot_mass=0.1, rest_length=3.7, friction=friction, **own)


def disturbed(run, **changes):
    launch = run.source.model.launch_at(run(0.0))
    return {name: value + changes.get(name, 0.0) for name, value in launch.items() if name != "liftoff"}


def cartesian(machine, start, until, damping=0.0):
    """Landings and lift-offs (kind, time, body - foot, its rate, pitch, its rate, foothold) of a body and a foot of
    mass 0.1 from a flight state at lift-off, up to a landing that would bounce."""
    p = machine.values

    def forces(y):
        a, b, leg = y[4] - y[0], y[6] - y[2], np.hypot(y[4] - y[0], y[6] - y[2])
        rate = (a * (y[5] - y[1]) + b * (y[7] - y[3])) / leg
        pull, torque = leg - p["rest_length"] + damping * rate, p["hip_stiffness"] * (y[8] - np.arctan2(a, b))
        return -pull * a / leg + torque * b / leg**2, -pull * b / leg - torque * a / leg**2, torque

    def rates(t, y, contact):
        fx, fz, torque = forces(y)
        foot = (0, 0, 0, 0) if contact else (y[1], -fx / 0.1, y[3], -fz / 0.1 - 1)
        return [*foot, y[5], fx, y[7], fz - 1, y[9], -torque / p["inertia"]]

    def gap(t, y, contact):
        return y[2]

    def press(t, y, contact):
        return forces(y)[1] + 0.1

    for event in (gap, press):
        event.terminal, event.direction = True, -1.0
    x, dx, z, dz, leg, dl, th, dth, ph, dph = start
    s, c = np.sin(th), np.cos(th)
    y = np.array(
        [x, dx, z, dz, x + leg * s, dx + dl * s + leg * c * dth, z + leg * c, dz + dl * c - leg * s * dth, ph, dph]
    )
    t, contact, found = 0.0, False, []
    while t < until:
        if not contact:
            t, y = t + 0.05, solve_ivp(rates, (t, t + 0.05), y, args=(False,), **KW).y[:, -1]
        part = solve_ivp(rates, (t, until), y, args=(contact,), events=press if contact else gap, **KW)
        t, y = part.t[-1], part.y[:, -1].copy()
        if part.status == 1:
            if not contact:
                y[1] = y[2] = y[3] = 0.0
            found.append(("lift-off" if contact else "landing", t, y[4] - y[0], y[6], y[5], y[7], y[8], y[9], y[0]))
            contact = not contact
            if contact and press(t, y, True) < 0:
                break
    return found


def in_cartesian(event, foothold):
    _, _, _, _, leg, dl, th, dth, ph, dph = event.after
    s, c = np.sin(th), np.cos(th)
    return [event.time, leg * s, leg * c, dl * s + leg * c * dth, dl * c - leg * s * dth, ph, dph, foothold]


@pytest.mark.slow
def test_a_run_is_followed_for_some_steps(run):
    motion = simulate(run.source, run, hops=4)
    energies = np.array([event.energy for event in motion.events])
    assert motion.status == "done"
    assert np.abs(energies - energies[0]).max() < 1e-12
    assert sum(event.loss for event in motion.events) < 1e-15
    assert np.abs(motion.footholds - run.step * np.arange(5)).max() < 1e-11
    assert abs(motion.mean_speed - run.mean_speed) < 1e-12
    assert abs(motion.distance - motion.unrolled(motion.end)[0]) < 1e-15
    assert motion.falls is None
    t = np.linspace(0, 2 * run.period, 40)
    assert np.abs(motion.unrolled(t) - run.unrolled(t)).max() < 1e-9
    assert "4 steps, 6.36381" in str(motion)
    assert motion.document()["mean_speed"] == motion.mean_speed


@pytest.mark.parametrize(
    "changes", [{"phi'": 0.02, "alpha": 0.05, "theta": -0.01}, {"theta": 0.01, "alpha": -0.02}, {"alpha": 0.1}]
)
def test_a_disturbed_launch_against_another_integration(run, changes):
    motion = simulate(run.source, disturbed(run, **changes), hops=2)
    truth = cartesian(run.source, motion(0.0), motion.end + 0.01)
    assert len(truth) >= 1
    holds = np.cumsum([e.before[0] for e in motion.events])
    for event, foothold, (_, *numbers) in zip(motion.events, holds, truth, strict=False):
        assert np.abs(np.array(in_cartesian(event, foothold)) - numbers).max() < 1e-10
    landing = motion.events[0]
    assert landing.loss == pytest.approx(0.05 * (landing.before[1] ** 2 + landing.before[3] ** 2), rel=1e-10)


def test_restitution_is_along_the_gap_alone(run):

    bouncy = replace(run.source, restitution=0.2)
    first = simulate(bouncy, disturbed(run, alpha=0.1), hops=1).events[0]
    assert first.kind == "impact"
    assert first.after[3] == pytest.approx(-0.2 * first.before[3], rel=1e-12)
    assert first.after[1] == 0.0
    own = 0.05 * (first.before[1] ** 2 + 0.96 * first.before[3] ** 2)
    assert first.loss == pytest.approx(own, rel=1e-10)


def test_friction(run):
    needed, when = run.certificate.friction_needed, run.certificate.friction_time
    assert simulate(with_friction(run, 1.001 * needed), run, hops=3).status == "done"
    motion = simulate(with_friction(run, 0.9995 * needed), run, hops=3)
    assert motion.status == "slips"
    assert motion.reason == f"the foot slips at t = {motion.end:.6g}: slipping is not simulated"
    assert motion.events[-1].kind == "slips"
    assert 0 < when - motion.end < 0.1
    forces = motion.legs[-1].path(motion.legs[-1].path.times[-1])
    names = motion.legs[-1].path.names
    share = forces[names.index("contact force along the ground")] / forces[names.index("contact force")]
    assert abs(share) == pytest.approx(0.9995 * needed, rel=1e-12)
    fast = simulate(with_friction(run, 0.3), disturbed(run, **{"phi'": -0.3}), hops=1)
    assert fast.status == "slips"
    assert "slips" in STATUSES


def test_states_on_the_ground(run):
    state = run(run.flight_time + 0.3)
    state[0] = 2.0
    motion = simulate(run.source, state=state, hops=1)
    assert motion.unrolled(0.0)[0] == pytest.approx(2.0, abs=1e-15)
    assert motion.end == pytest.approx(run.contact_time - 0.3, abs=1e-10)
    state[1] = 0.1
    with pytest.raises(InputError, match="its foot sticks to the ground, so 'x'' must be 0"):
        simulate(run.source, state=state, hops=1)


def test_a_body_that_falls(run, tmp_path):
    """It ends the simulation, in contact or in flight, where the body is on the ground in that of SciPy."""
    motion = simulate(run.source, disturbed(run, theta=0.05), hops=30)
    name, when = motion.falls
    assert (name, motion.status, motion.end) == ("body", "falls", when)
    assert motion.events[-1].kind == "falls"
    assert motion.document()["reason"] == motion.reason == f"the body falls to the ground at t = {when:.6g}"
    assert motion.distance == motion.unrolled(when)[0]
    assert motion.mean_speed == motion.distance / when
    assert "falls" in STATUSES
    flying = np.array([0.0, 0.0, 0.5, 0.0, 3.5, 0.0, 1.6, 0.0, 1.6, 0.0])
    flown = simulate(run.source, state=flying, hops=3)
    assert flown.status == "falls"
    fell = solve_ivp(
        lambda t, x: rates_by_hand(x, run.source.values, False)[0], (0, 5), flying,
        events=lambda t, x: x[2] + x[4] * np.cos(x[6]), **KW,
    )  # fmt: skip
    assert flown.end == pytest.approx(fell.t_events[0][0], rel=1e-9)
    assert not flown.in_contact(flown.end)
    flying[6] = 1.8
    with pytest.raises(InputError, match=r"its body is at the height -0\.295\d+ at the start, below the ground"):
        simulate(run.source, state=flying, hops=1)
    assert abs(motion(when)[2] + motion(when)[4] * np.cos(motion(when)[6])) < 1e-9
    assert f"falls at time {when:.9g}: the body falls to the ground" in " ".join(str(motion).split())
    assert motion.animate(tmp_path / "fall.gif", frames=2).stat().st_size > 0


def test_the_other_foot_lands_while_one_stands():
    """It ends simulations and hops of maps where it touches in an integration by SciPy, and has no multipliers."""
    orbit = slowest_step()
    touches = brentq(lambda t: height_in_contact(orbit, np.array([0.0, t]))[-1], 0.1, 1.0, xtol=1e-12)
    motion = simulate(FEET, orbit, hops=2)
    assert (motion.status, motion.falls[0]) == ("falls", "right")
    assert motion.end == pytest.approx(orbit.flight_time + touches, abs=2e-5)  # of the landing alone 1e-5
    assert motion.reason == f"the right falls to the ground at t = {motion.end:.6g}, while another point stands"
    launch = [FEET.model.launch_at(orbit(0.0))[name] for name in ReturnMap(FEET).names]
    assert ReturnMap(FEET)([launch, launch]).status.tolist() == ["falls", "falls"]
    with pytest.raises(NoOrbit, match="the other foot touches while one stands"):
        multipliers(FEET, orbit)
    with pytest.raises(InputError, match=r"its right is at the height -24\.0174 at the start, below the ground"):
        simulate(FEET, state=orbit(orbit.flight_time + 4.0), hops=1)


@pytest.mark.parametrize("speed", [0.4, *(pytest.param(v, marks=pytest.mark.slow) for v in (0.1, 1.5))])
def test_multipliers_of_runs(speed, run):
    own = run if speed == 0.4 else run_at(speed)
    found = multipliers(own.source, own)
    one = np.abs(found.values - 1).argmin()
    values, error = SPEEDS[speed]
    assert np.delete(found.values, one) == pytest.approx(values, abs=error)
    assert abs(found.values[one] - 1) < 1e-12
    assert found.stability == "unstable"
    assert "unstable: 2 of 5 multipliers outside the unit circle" in str(found)
    impacts = Impacts(own.source)
    tangent = impacts.model.embed @ LaunchSection(impacts).tangent(impacts.onto_contact @ own(0.0))
    gradient = impacts.energy_gradient(own(0.0)) @ tangent
    assert np.abs(gradient @ found.matrix - gradient).max() < 1e-12 * np.abs(gradient).max()


def test_multipliers_against_differences(run):
    """Of a launch that lands with a speed they are those of a smooth map; of the orbit up to the power 1/3."""
    own = multipliers(run.source, disturbed(run, alpha=0.1, **{"theta'": -0.03}))
    names = own.names

    def after(launch):
        motion = simulate(run.source, dict(zip(names, launch, strict=True)), hops=1)
        found = run.source.model.launch_at(motion(motion.end))
        return np.array([found[name] for name in names])

    for j in range(5):
        step = 1e-5 * np.eye(5)[j]
        slope = (after(own.launch + step) - after(own.launch - step)) / 2e-5
        assert np.abs(slope - own.matrix[:, j]).max() < 1e-7 * np.abs(own.matrix).max()
    of_run, way = multipliers(run.source, run), np.array([0.3, -0.5, 0.4, 0.6, 0.2])
    for size, bar in ((1e-6, 0.03), (1e-8, 0.01)):
        slope = (after(of_run.launch + size * way) - of_run.launch) / size
        assert np.abs(slope - of_run.matrix @ way).max() < bar * np.abs(of_run.matrix @ way).max()
