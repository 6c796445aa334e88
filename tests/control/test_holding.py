"""Feedback that holds runs, hops and chains, against simulations."""

import numpy as np
import pytest

from orbits import find, find_all, multipliers, simulate
from orbits.control import hold
from orbits.errors import InputError
from orbits.hops import Impacts, LaunchSection
from problems import Chain, Hopper, Juggler, hopper_in_si, rimless_wheel, runner, springs, walker


@pytest.fixture(scope="module")
def run():
    return find(runner(foot_mass=0.1, rest_length=3.7), tune=("inertia", "hip_stiffness"), at={"speed": 0.4})


@pytest.fixture(scope="module")
def held(run):
    return hold(run, "phi - theta")


def disturbed(run, size):
    way = {"alpha": 0.3, "theta": -0.4, "theta'": 0.5, "phi": 0.4, "phi'": -0.6}
    launch = run.source.model.launch_at(run(0.0))
    return {name: launch[name] + size * change for name, change in way.items()}


def distances(run, motion):
    """How far each launch is from that of the run."""
    model, own = run.source.model, run.source.model.launch_at(run(0.0))
    found = [model.launch_at(event.after) for event in motion.events if event.kind == "lift-off"]
    return np.array([max(abs(launch[name] - own[name]) for name in own) for launch in found])


def simulated_multipliers(orbit, held):
    """The moduli of the multipliers of the simulated cycle, by central differences extrapolated to no change.

    A change h of the launch loses h^(4/3) at the landing, so that differences have errors in h^(1/3) and h^(2/3).
    """
    section = LaunchSection(Impacts(held.machine))
    own = section.launch(orbit)
    base, dependent = section.free(own), own[[section.places[section.dependent]]]

    def after(change):
        launch = section.unknowns_of(section.states((base + change)[None], dependent)[0])
        motion = simulate(held.machine, launch, hops=1, feedback=held)
        return section.free(section.impacts.onto_contact @ motion.events[-1].after)

    def slopes(h):
        return np.array([(after(row) - after(-row)) / (2 * h) for row in h * np.eye(len(base))]).T

    coarse, middle, fine = (slopes(h) for h in (1e-6, 1e-6 / 8, 1e-6 / 64))
    extrapolated = (4 * (2 * fine - middle) - (2 * middle - coarse)) / 3
    return np.sort(np.abs(np.linalg.eigvals(extrapolated)))[::-1]


@pytest.mark.slow
def test_the_simulated_run_returns_at_the_rate_that_is_printed(run, held):
    assert simulated_multipliers(run, held)[0] == pytest.approx(abs(held.held_multipliers[0]), rel=1e-3)
    slower = hold(run, "phi - theta", parts=1)
    assert simulated_multipliers(run, slower)[0] == pytest.approx(abs(slower.held_multipliers[0]), rel=1e-3)


@pytest.mark.slow
def test_a_run_is_held(run, held):
    assert held.multipliers == pytest.approx(multipliers(run.source, run).values, rel=1e-8)
    assert np.abs(held.held_multipliers).max() < 0.5
    motion = simulate(held.machine, disturbed(run, 1e-3), hops=10, feedback=held)
    far = distances(run, motion)
    assert motion.status == "done"
    assert far[-1] < 1e-6 < 1e-4 < far[0]  # the force acts before the first landing already
    free = distances(run, simulate(held.machine, disturbed(run, 1e-3), hops=3))
    assert free[-1] > 0.05
    times, inputs = motion.schedule
    assert len(times) == len(inputs["hold"]) + 1
    assert 1e-3 < np.abs(inputs["hold"]).max() < 1.0
    assert np.abs(inputs["hold"][-8:]).max() < 1e-4
    again = simulate(held.machine, disturbed(run, 1e-3), hops=10, schedule=motion.schedule)
    assert np.abs(distances(run, again)[:2] - far[:2]).max() < 1e-9


def test_a_chain_is_held():
    """Its own multipliers are those of `multipliers`, and the feedback acts in flight as in contact."""
    chain = Chain((1, 1, 1))
    hop = find_all(chain, chain.starts(3.2, 4.6))[0]
    held = hold(hop, "y1 - y3", effort=0.02, landing=5.0)
    assert np.abs(held.multipliers) == pytest.approx(np.abs(multipliers(chain, hop).values), rel=1e-8)
    assert np.abs(held.held_multipliers).max() < 0.3
    assert simulated_multipliers(hop, held) == pytest.approx(np.abs(held.held_multipliers), rel=1e-3)


def from_launch(held, orbit, error, hops=8):
    """The motion from the launch of an orbit whose speed is off by a share."""
    section = LaunchSection(Impacts(held.machine))
    own = section.launch(orbit)
    launch = section.free(own).copy()
    launch[section.names.index("alpha")] *= 1 + error
    y = section.states(launch[None], own[[section.places[section.dependent]]])[0]
    return simulate(held.machine, section.unknowns_of(y), hops=hops, feedback=held)


@pytest.mark.parametrize("when", ["continuous", "lift-off", "apex"])
@pytest.mark.parametrize(
    ("machine", "along"),
    [(Hopper(), "y1 - y2"), (Hopper("cubic", mass_ratio=2.0), "y1 - y2"), (Juggler(mass_ratio=0.5), "w2")],
)
def test_hoppers_and_jugglers_are_held(machine, along, when):
    """A launch that is too slow loses ten times what one that is too fast does, and is held; the rate at which it comes
    back is that which is printed."""
    orbit = find(machine)
    held = hold(orbit, along, when=when)
    assert held.multipliers == pytest.approx([1.0], rel=1e-8)
    assert simulated_multipliers(orbit, held) == pytest.approx(np.abs(held.held_multipliers), rel=1e-3)
    for error in (0.01, -0.01):
        off = np.abs(from_launch(held, orbit, error).launches / orbit.alpha - 1)
        assert off[-1] < 1e-6
        assert off[1] < 5e-3
    assert simulate(machine, 0.99 * orbit.alpha, hops=3).launches[-1] < 0.9 * orbit.alpha  # without it


@pytest.mark.parametrize("when", ["continuous", "lift-off"])
@pytest.mark.parametrize("machine", [Hopper(), Hopper("cubic")])
def test_launches_off_by_five_percent_come_back(machine, when):
    orbit = find(machine)
    held = hold(orbit, "y1 - y2", when=when, force=2.0)
    for error in (0.05, -0.05):
        motion = from_launch(held, orbit, error)
        assert np.abs(motion.schedule[1]["hold"]).max() <= 2.0
        assert abs(motion.launches[-1] / orbit.alpha - 1) < 1e-4


@pytest.mark.parametrize("when", ["lift-off", "apex"])
def test_a_flight_that_is_decided_at_once_ends_at_rest(when):
    """All its inputs are those found together: the landing of a launch 2 % too slow loses no energy."""
    orbit = find(Hopper())
    motion = from_launch(hold(orbit, "y1 - y2", when=when, force=2.0), orbit, -0.02)
    assert sum(event.loss for event in motion.events if event.time < orbit.period) < 1e-6


def test_limits_are_respected():
    """On a fine grid of a motion that is far off: the force, the power, and the line of a motor."""
    orbit, v0, f0 = find(Hopper()), 8.0, 0.6
    held = hold(orbit, "y1 - y2", force=0.5, power=0.9, speed_force=(v0, f0))
    motion = from_launch(held, orbit, -0.02)
    assert abs(motion.launches[-1] / orbit.alpha - 1) < 1e-6
    t = np.linspace(0.0, motion.end, 100_001)
    times, inputs = motion.schedule
    force = inputs["hold"][np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)]
    states = motion(t)
    speed = states[:, 1] - states[:, 3]
    drives = force * speed > 0
    assert 0.05 < np.abs(force).max() <= 0.5
    assert np.abs(force * speed).max() <= 0.9
    assert (np.abs(force) <= f0 * (1 - np.abs(speed) / v0))[drives].all()
    free = from_launch(hold(orbit, "y1 - y2"), orbit, -0.02)
    assert np.abs(free.schedule[1]["hold"]).max() > np.abs(force).max()  # they are in force


def test_a_delay_is_bridged_by_the_cycle():
    """To first order what is measured earlier says the same, so that the multipliers are those without delay."""
    orbit = find(Hopper())
    late = hold(orbit, "y1 - y2", delay=0.5)
    assert late.held_multipliers == pytest.approx(hold(orbit, "y1 - y2").held_multipliers, rel=1e-6)
    assert simulated_multipliers(orbit, late) == pytest.approx(np.abs(late.held_multipliers), rel=1e-3)
    assert np.abs(from_launch(late, orbit, -0.01).launches[-1] / orbit.alpha - 1) < 1e-6
    assert "decided as each interval begins, 0.5 after the measurement" in str(late)
    with pytest.raises(
        InputError, match=r"delay = 1; it must be at most 0\.898682, the time from a measurement to its first input"
    ):
        hold(orbit, "y1 - y2", delay=1.0)


@pytest.mark.slow
def test_what_is_not_held(run, held):
    with pytest.raises(InputError, match="on one foot, or whose feet stick, not a rimless wheel"):
        hold(find(rimless_wheel(angle=0.3)), "angle")
    with pytest.raises(InputError, match="there is no coordinate 'body'"):
        hold(find(Hopper()), "body - foot")
    with pytest.raises(InputError, match="a hopper in SI needs its actuator"):
        hold(find(hopper_in_si(10.0, 1.0, stiffness=1e4)), "y1 - y2")
    with pytest.raises(InputError, match="when = 'landing'; it must be one of 'continuous', 'lift-off', 'apex'"):
        hold(run, "phi - theta", when="landing")
    with pytest.raises(InputError, match="power = -1; a bound of the actuator must be above 0"):
        hold(run, "phi - theta", power=-1.0)
    with pytest.raises(InputError, match="effort = 0, landing = 20; effort must be above 0"):
        hold(run, "phi - theta", effort=0.0)
    with pytest.raises(InputError, match="leave out either the schedule or the feedback"):
        simulate(held.machine, run, hops=1, feedback=held, schedule=([0.0, 1.0], {"hold": [0.0]}))
    with pytest.raises(InputError, match="feedback: the machine has no parameter 'hold'"):
        simulate(Hopper(), 4.6, hops=1, feedback=held)
    lossy = Chain((1.0, 1.0, 1.0), [springs.lossy("r", loss_factor=0.1), "r"])
    with pytest.raises(InputError, match="feedback: the machine has no parameter 'hold'"):
        simulate(lossy, state=np.ones(6), hops=1, feedback=held)


@pytest.mark.slow
def test_a_walk_that_is_held_comes_back():
    """The multipliers with the feedback are those of simulated steps, which land on both feet."""
    machine = walker(leg_mass=0.1, torso_inertia=0.41824193818688386, hip_stiffness=0.39402694221511943)
    start = {"liftoff": 0.375, "alpha": 0.82994638728075, "angle": -0.3, "duration": 2.39, "contact_duration": 0.4044}
    walk = find(machine, start=start, tune=("torso_inertia", "hip_stiffness"), at={"angle": 0.3})
    held = hold(walk, "torso - lean - angle")
    assert held.multipliers == pytest.approx([-25.937831, 1.0], abs=1e-6)
    assert held.simulated_multipliers() == pytest.approx(held.held_multipliers, abs=1e-5)
    assert np.abs(held.held_multipliers).max() < 1
    assert held.launches([-1e-4, 1e-4, 1e-3], hops=6).share == 1
