"""Feedback that holds a run, against SciPy's regulator and simulations."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from orbits import find, find_all, multipliers, simulate
from orbits.control import hold
from orbits.control.holding import _regulator, _Stage
from orbits.errors import InputError, NoOrbit
from orbits.hops import Impacts, LaunchSection
from problems import Chain, Hopper, runner, springs


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


def test_the_regulator_against_that_of_the_whole_cycle():
    """The cost of a cycle whose forces are decided one after the other is that of all of them decided at once."""
    rng = np.random.default_rng(0)
    shapes = ((4, 3), (4, 4), (2, 4), (3, 2))
    stages = [_Stage(rng.standard_normal(shape), None) for shape in shapes]
    stages[1] = stages[1]._replace(effect=rng.standard_normal(4))
    stages[3] = stages[3]._replace(effect=rng.standard_normal(3))
    gap = rng.standard_normal(4)
    stages[2] = stages[2]._replace(gap=gap)
    _, matrix = _regulator(stages, 0.3, 2.0)
    first, second, third, last = (stage.carry for stage in stages)
    a = last @ third @ second @ first
    b = np.column_stack([last @ third @ stages[1].effect, stages[3].effect])
    z, w = gap @ second @ first, np.array([gap @ stages[1].effect, 0.0])
    q, r, s = np.eye(3) + 2 * np.outer(z, z), 0.3 * np.eye(2) + 2 * np.outer(w, w), 2 * np.outer(z, w)
    # The cost counts the launch after each cycle, whose sum differs by a constant.
    cost = solve_discrete_are(a, b, q, r, s=s)
    gain = np.linalg.solve(r + b.T @ cost @ b, b.T @ cost @ a + s.T)
    assert np.abs(matrix - (a - b @ gain)).max() < 1e-9 * np.abs(matrix).max()
    with pytest.raises(NoOrbit, match="does not reach all that grows"):
        _regulator([_Stage(np.diag([2.0, 0.5]), np.array([0.0, 1.0]))], 1.0, 0.0)


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
    held = hold(hop, "y1 - y3")
    assert np.abs(held.multipliers) == pytest.approx(np.abs(multipliers(chain, hop).values), rel=1e-8)
    assert np.abs(held.held_multipliers).max() < 0.3
    assert simulated_multipliers(hop, held) == pytest.approx(np.abs(held.held_multipliers), rel=1e-3)


@pytest.mark.slow
def test_what_is_not_held(run, held):
    with pytest.raises(
        InputError,
        match="hold takes a machine that stands on one foot, and whose launch is more than a speed, not a hopper",
    ):
        hold(find(Hopper()), "body - foot")
    with pytest.raises(InputError, match="effort = 0, landing = 20; weights lie above 0"):
        hold(run, "phi - theta", effort=0.0)
    with pytest.raises(InputError, match="a schedule and a feedback exclude each other"):
        simulate(held.machine, run, hops=1, feedback=held, schedule=([0.0, 1.0], {"hold": [0.0]}))
    with pytest.raises(InputError, match="feedback: a launch that is a speed has none"):
        simulate(Hopper(), 4.6, hops=1, feedback=held)
    lossy = Chain((1.0, 1.0, 1.0), [springs.lossy("r", loss_factor=0.1), "r"])
    with pytest.raises(InputError, match=r"feedback for a chain.*hysteresis"):
        simulate(lossy, state=np.ones(6), hops=1, feedback=held)
