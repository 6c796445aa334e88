"""Simulations of walkers, which stand on one foot and then on both, against motions and impacts of rods on pins."""

from dataclasses import replace

import numpy as np
import pytest

from orbits import InputError, multipliers, simulate
from orbits.hops.impacts import impacts_of
from orbits.hops.launch_section import LaunchSection
from orbits.mechanics import Damper
from problems import walker
from tests.rods import on_two_legs, point

# Two lossless walkers with their launches; the second has a torso above the hip, and friction in double stance.
LIGHT = {"leg_mass": 0.1, "leg_centre": 1.0, "leg_inertia": 0.0, "torso_height": 0.0,
         "torso_inertia": 0.41824193818688386, "hip_stiffness": 0.39402694221511943}  # fmt: skip
TALL = {"leg_mass": 0.05, "leg_centre": 0.5, "leg_inertia": 0.05 / 12, "torso_height": 0.2,
        "torso_inertia": 0.266701219273255, "hip_stiffness": 0.311268251173758}  # fmt: skip
WALKS = [
    (LIGHT, {"liftoff": 0.375, "alpha": 0.82994638728075, "angle": -0.3}, 5.5890886030100),
    (TALL, {"liftoff": 0.21595644030879, "alpha": 0.40755747921172, "angle": -0.2}, 6.1725734037058),
]


@pytest.mark.parametrize(("design", "launch", "period"), WALKS)
def test_a_lossless_walk_goes_on(design, launch, period):
    run = simulate(walker(**design), launch, hops=5)
    assert run.status == "done"
    grown = 1e-13 * 40.0 ** np.arange(6)  # roundings grow by the multiplier
    assert (np.abs(run.launches - launch["alpha"]) < grown).all()
    assert (np.abs(run.footholds + 2 * np.sin(launch["angle"]) * np.arange(6)) < grown).all()
    first = next(event for event in run.events if event.kind == "lift-off")
    assert first.time == pytest.approx(period, abs=1e-9)
    assert max(abs(event.loss) for event in run.events) < 1e-9
    assert run.distance == pytest.approx(-10 * np.sin(launch["angle"]), abs=1e-5)


def test_a_walk_in_si_is_the_same():
    (design, launch, _), mass, length, gravity = WALKS[0], 60.0, 0.9, 9.80665
    size = {"leg_mass": mass, "leg_centre": length, "torso_height": length, "leg_inertia": mass * length**2,
            "torso_inertia": mass * length**2, "hip_stiffness": mass * gravity * length}  # fmt: skip
    own = {name: value * size[name] for name, value in design.items()}
    machine = walker(**own, mass=mass, leg_length=length, surface_gravity=gravity, in_si=True)
    alpha = launch["alpha"] * np.sqrt(gravity / length)
    run = simulate(machine, {**launch, "alpha": alpha}, hops=2)
    np.testing.assert_allclose(run.launches, alpha, rtol=1e-9)
    np.testing.assert_allclose(run.footholds, -2 * length * np.sin(launch["angle"]) * np.arange(3), atol=1e-9)
    assert run.distance == pytest.approx(-4 * length * np.sin(launch["angle"]), abs=1e-8)


def rods_of(design, ends):
    m, inertia = design["leg_mass"], design["torso_inertia"]
    leg, body = (m, design["leg_centre"], design["leg_inertia"]), (1 - 2 * m, design["torso_height"], inertia)
    return on_two_legs(leg, body, ends, design["hip_stiffness"])


def angles_and_rates(state, base):
    """The angles and rates (2, 3) of two legs and the torso in a flight state in which the leg `base` stands."""
    lean, speed, angle, rate, torso, turning = state
    found = np.array([[lean + angle, lean - angle, torso], [speed + rate, speed - rate, turning]])
    return found[:, [base, 1 - base, 2]]


def landed(design, state, base, both):
    """The state after the landing of the leg that does not stand, where both legs are caught or the other one is let
    go, and the legs that stand then: by rods."""
    after, impulses = rods_of(design, (0, 1) if both else (1 - base,)).struck(state)
    if not both:
        assert impulses[0, 1] > 0
        assert point(after, base, design["leg_centre"] - 1)[1, 1] > 0
        return after, (1 - base,)
    force = rods_of(design, (0, 1)).balance(*after)[1][:2, 1]
    return after, (0, 1) if (force >= 0).all() else (int(np.argmax(force)),)


@pytest.mark.parametrize(
    ("more", "caught", "kinds"),
    [
        (-0.001, [True], ["landing", "lift-off"]),
        (0.005, [False, True, True], ["impact", "impact", "landing", "lift-off"]),
    ],
)
def test_a_step_that_loses_energy_is_that_of_rods(more, caught, kinds):
    """Both legs are caught, and one lifts off; or the standing one is let go first, and comes down again. Each state
    and each loss is that of rods."""
    design, launch, _ = WALKS[1]
    run = simulate(walker(**design), {"alpha": launch["alpha"] + more, "angle": launch["angle"]}, hops=1)
    assert [event.kind for event in run.events] == kinds
    ends, now = (0,), 0.0
    state = rods_of(design, ends).hung(*angles_and_rates(run(0.0), 0))
    for event, both in zip(run.events, [*caught, None], strict=True):
        rods = rods_of(design, ends)
        state, now = rods.move(state, np.array([now, event.time]))[-1], event.time
        feet = np.array([point(state, i, design["leg_centre"] - 1)[0] for i in (0, 1)])
        np.testing.assert_allclose(feet[:, 1], 0.0, atol=1e-9)
        if both is None:
            force = rods.balance(*state)[1][:2, 1]
            assert np.abs(force).min() < 1e-8
            ends = (int(np.argmax(force)),)
        else:
            before = state
            state, ends = landed(design, before, ends[0], both)
            lost = rods.energy(np.stack([before, state]))
            assert event.loss == pytest.approx(lost[0] - lost[1], abs=1e-11)
            assert event.loss > 0
        standing = ends[0] if len(ends) == 1 else int(np.argmax(feet[:, 0]))
        np.testing.assert_allclose(state[:, :, 2], angles_and_rates(event.after, standing), rtol=0, atol=1e-9)


def test_casadi_lands_as_simulations_do():
    """The reset of a landing with both feet, the one that lets the old foot go, and the loss."""
    design, launch, _ = WALKS[1]
    machine = walker(**design)
    functions = machine.casadi()
    run = simulate(machine, {"alpha": launch["alpha"] + 0.005, "angle": launch["angle"]}, hops=1)
    resets, (first, *_, last, _) = functions.resets, run.events
    np.testing.assert_allclose(resets["hand-over"](first.before, functions.values).full().T[0], first.after, atol=1e-13)
    np.testing.assert_allclose(resets["landing"](last.before, functions.values, 0).full().T[0], last.after, atol=1e-12)
    assert float(functions.landing_loss(last.before, functions.values)) == pytest.approx(last.loss, abs=1e-14)
    assert float(functions.flight_guards["landing"](run(1.0), functions.values)) > 0


@pytest.mark.slow
def test_a_damped_walk_loses_energy_at_each_event():
    """Without a reversor: the gap closes from the other side all the same."""
    design, launch, _ = WALKS[1]
    free = walker(**design)
    damped = replace(free, elements=[*free.elements, Damper("2*angle", "1e-5")], reversor=None)
    first = free.model.embed @ LaunchSection(impacts_of(free)).launch([launch["alpha"] + 0.004, launch["angle"]])
    run, impacts = simulate(damped, state=first, hops=1), impacts_of(damped)
    assert [event.kind for event in run.events] == ["impact", "impact", "landing", "lift-off"]
    for event in run.events:
        before, after = impacts.energies(np.array([event.before, event.after]))
        assert event.loss == pytest.approx(before - after, abs=1e-13)
    assert (np.diff([event.energy for event in run.events]) < 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("more", [-0.001, 0.005])
def test_multipliers_of_a_step_with_losses(more):
    """Both legs are caught, or one is let go, comes down again, and the other one lifts off at once."""
    design, launch, _ = WALKS[1]
    machine, change = walker(**design), 1e-6
    section = LaunchSection(impacts_of(machine))
    found = multipliers(machine, [launch["alpha"] + more, launch["angle"]])

    def after(moved):
        run = simulate(machine, section.unknowns_of(section.launch(found.launch + moved)), hops=1)
        return np.array([*machine.model.launch_at(run.events[-1].after).values()])[1:]

    columns = [(after(each) - after(-each)) / (2 * change) for each in change * np.eye(2)]
    np.testing.assert_allclose(np.transpose(columns), found.matrix, rtol=1e-6)
    assert found.loses


@pytest.mark.slow
def test_multipliers_are_those_of_simulated_steps():
    """Differences of a tangential landing have errors in the powers 1/3 and 2/3 of the change, which are removed."""
    machine, launch = walker(**LIGHT), WALKS[0][1]
    found, section = multipliers(machine, launch), LaunchSection(impacts_of(machine))
    assert found.names == ("alpha", "angle")

    def after(change):
        start = section.unknowns_of(section.launch(found.launch + change))
        return np.array([*machine.model.launch_at(simulate(machine, start, hops=1).events[-1].after).values()])[1:]

    for i, own in enumerate(np.eye(2)):
        a, b, c = ((after(h * own) - after(-h * own)) / (2 * h) for h in (6.4e-6, 8e-7, 1e-7))
        once = 2 * b - a, 2 * c - b
        np.testing.assert_allclose((4 * once[1] - once[0]) / 3, found.matrix[:, i], rtol=2e-3)
    assert found.values[1] == pytest.approx(1.0, abs=1e-9)
    assert found.values[0] == pytest.approx(-25.93783, abs=1e-5)


@pytest.mark.slow
def test_losses_beside_a_walk_are_those_of_impulses():
    machine, launch = walker(**LIGHT), WALKS[0][1]
    found, impacts = multipliers(machine, launch), impacts_of(machine)
    section, direction = LaunchSection(impacts), found.vectors[:, 1].real
    start = impacts.energy(machine.model.embed @ section.launch(found.launch))
    for size, expected in ((1e-7, found.losses[0]), (-1e-7, found.losses[1])):
        y = section.launch(found.launch + size * direction)
        run, more = simulate(machine, section.unknowns_of(y), hops=1), impacts.energy(machine.model.embed @ y) - start
        expected = found.losses[0] if more > 0 else found.losses[1]
        assert sum(event.loss for event in run.events) == pytest.approx(expected * abs(more) ** (4 / 3), rel=0.01)
        for event in run.events:
            before, after = impacts.energies(np.array([event.before, event.after]))
            assert before - after == pytest.approx(event.loss, abs=1e-14)


STATES = {
    "both feet": ([0, 0, -0.3, 0, -0.1, 0], None, "done"),
    "from mid-stance": ([0, -0.73425313, 0, 0.82764785, 0, -0.52979775], "landing", "done"),
    "comes down behind": ([0.01, -0.1, -0.3, 0, 0.3, 0], "landing", "done"),
    "does not pass": ([0.09, 0.21, -0.3, 0.18, -0.6, -0.34], "falls", "falls"),
}


@pytest.mark.parametrize("name", STATES)
def test_what_becomes_of_states(name):
    state, first, status = STATES[name]
    run = simulate(walker(**LIGHT), state=state, time=4.0)
    assert (run.events[0].kind if run.events else None) == first
    assert run.status == status
    assert ("swinging foot falls" in str(run.reason)) == (status == "falls")


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ([0.01, 0, 0.3, 0, 0, 0], "its gap is -0.00591031 and must be open"),
        ([0, 0.1, 0.3, 0, 0, 0], "give the state after the impact"),
        ([0, 0, 0.3, 0.1, 0, 0], "its foot sticks to the ground, so 'angle'' must be 0"),
    ],
)
def test_states_that_cannot_be_are_refused(state, words):
    with pytest.raises(InputError, match=words):
        simulate(walker(**LIGHT), state=state, time=1.0)


def test_each_foot_has_its_friction():
    design, launch, _ = WALKS[1]
    enough, little = (simulate(walker(**design, friction=share), launch, hops=1) for share in (0.2, 0.06))
    assert enough.status == "done"
    assert little.status == "slips"
    assert "the foot slips at t = " in little.reason
    assert {event.kind for event in little.events} >= {"slides", "slips"}
