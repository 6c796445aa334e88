"""Driven machines under a disturbance, against the equations written out for another integrator, the return map, and
linearised growth."""

import numpy as np
import pytest
from conftest import slow_after
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from orbits import InputError, ReturnMap, find
from problems import Disturbed, Hopper, steering

C = 0.01


@pytest.mark.slow
def test_without_a_disturbance_nothing_is_missed(driven_hopper, started_hopper):
    """Five hops with repeated inputs, and the hops after a start; as far from the aim as `missed` tells."""
    off = driven_hopper.simulate(5)
    assert isinstance(off, Disturbed)
    assert np.array_equal(off.launch_errors, np.zeros(6))
    assert np.array_equal(off.delays, np.zeros(6))
    assert off.run.launches == pytest.approx(driven_hopper.launch, abs=1e-12)
    t = np.linspace(0, 0.999 * driven_hopper.end, 40)
    assert off.run(t + 3 * driven_hopper.end) == pytest.approx(driven_hopper(t), abs=1e-11)
    after = started_hopper.simulate(3).run
    assert after.launches == pytest.approx(started_hopper.parameters["aim"], abs=1e-8)
    assert np.array_equal(after.launches, steering.rerun(started_hopper.source, started_hopper, hops=2).launches)
    assert steering.missed(started_hopper.source, started_hopper) <= 1e-8


def by_hand(times, rates, hops, c, alpha=None, push=None):
    """The speeds of so many lift-offs of the linear hopper of equal masses, by another integrator, from a launch at
    alpha or from rest in contact; with a push (time, of y1')."""

    def field(t, x, w, flies):
        pull = (x[0] - x[2] - x[4] + c * (x[1] - x[3])) / 2
        return [x[1], -pull - 0.5, x[3], pull - 0.5, w] if flies else [x[1], -pull - 0.5, 0, 0, w]

    def meets(t, x, w, flies):
        return x[2] if flies else 0.5 - (x[0] - x[4] + c * x[1]) / 2

    meets.terminal, meets.direction = True, -1
    x = [-1.0, 0.0, 0.0, 0.0, 0.0] if alpha is None else [1 - c * alpha, alpha, 0.0, 0.0, 0.0]
    now, flies, launches = 0.0, alpha is not None, []
    cuts = np.unique([*times, *([push[0]] if push else [])])
    while True:
        until = cuts[cuts > now + 1e-12][0]
        w = rates[np.searchsorted(times, now + 1e-12, side="right") - 1]
        run = solve_ivp(
            field, (now, until), x, "DOP853", events=meets, args=(w, flies), rtol=1e-12, atol=1e-13, max_step=0.2
        )
        now, x = run.t[-1], run.y[:, -1].copy()
        if run.status == 1 and flies:
            x[2:4] = 0.0  # the foot is stopped, and leaves at once if the spring pulls
            flies = x[0] - x[4] + c * x[1] > 1
        elif run.status == 1:
            flies = True
            launches.append(x[1])
        if len(launches) == hops:
            return np.array(launches)
        if push and now == push[0]:
            x[1] += push[1]


@pytest.mark.parametrize(
    "disturbance",
    slow_after(
        3,
        [
            {"launch_error": 0.02},
            {"launch_error": -0.02},
            {"damping": 1.1 * C},
            {"damping": 0.9 * C, "launch_error": 0.05},
            {"push": (3.0, {"y1'": 0.05})},
            {"push": (12.0, {"y1'": -0.05})},
        ],
    ),
    ids=str,
)
def test_a_disturbed_motion_by_another_integrator(driven_hopper, disturbance):
    off = driven_hopper.simulate(3, **disturbance)
    times, inputs = driven_hopper.schedule_of(4)
    damping, error = disturbance.get("damping", C), disturbance.get("launch_error", 0.0)
    push = (disturbance["push"][0], disturbance["push"][1]["y1'"]) if "push" in disturbance else None
    found = by_hand(times, inputs["w"], 3, damping, driven_hopper.launch + error, push)
    assert off.run.launches[1:] == pytest.approx(found, abs=1e-7)
    assert off.launch_errors[1:] == pytest.approx(found - driven_hopper.launch, abs=1e-7)
    assert np.abs(off.launch_errors[1:]).max() > 1e-3


def test_without_inputs_it_is_the_return_map():
    """The lossless hop needs no actuator: disturbed, it goes from launch to launch as the map says."""
    machine, d = Hopper(), 0.05
    driven, step = steering.keep_hopping(machine), ReturnMap(machine)
    off = driven.simulate(3, launch_error=-d)
    alpha = find(machine).alpha
    for before, after in zip(off.run.launches[:-1], off.run.launches[1:], strict=True):
        assert after == pytest.approx(step(before).next, abs=1e-9)
    assert off.run.launches[0] == pytest.approx(alpha - d, abs=1e-9)


@pytest.mark.slow
def test_a_small_disturbance_grows_as_linearised():
    """Two hops that land at a speed: the flow's matrix exponentials and the saltation at landing and lift-off."""
    c = 0.05
    driven = steering.keep_hopping(Hopper(damping=c), lossless=False)
    air = np.array([[0, 1, 0, 0], [-1, -c, 1, c], [0, 0, 0, 1], [1, c, -1, -c]]) / np.array([[1], [2], [1], [2]])
    ground = np.array([[0, 1], [-0.5, -c / 2]])
    flight, contact = driven.legs
    y1, v1, _, v2, u = flight.path(flight.duration)[:5]
    landing, after = np.array([v1, -(y1 - u + c * (v1 - v2)) / 2 - 0.5]), -(y1 - u + c * v1) / 2 - 0.5
    rates = driven.schedule("w")[1]["w"]
    z1, s1, end = contact.path(contact.duration)[:3]
    rising = np.array([s1, -(z1 - end + c * s1) / 2 - 0.5])
    force = np.array([1.0, c])
    for sign in (1, -1):  # lifting off late it meets the first rate of the next hop, lifting off early the last one
        delta, slopes = np.array([-c, 1.0, 0.0, 0.0]), []
        for _ in range(2):
            delta = expm(air * flight.duration) @ delta
            late = -delta[2] / v2
            delta = expm(ground * contact.duration) @ (delta[:2] + (landing - [v1, after]) * late)
            late = -(force @ delta) / (s1 + c * rising[1] - rates[-1])
            if sign * late > 0:
                late *= (s1 + c * rising[1] - rates[-1]) / (s1 + c * rising[1] - rates[0])
            slopes.append(delta[1] + rising[1] * late)
            delta = np.array([*delta, 0.0, 0.0])
        for size, tolerance in ((1e-3, 0.1), (1e-5, 1e-3), (1e-7, 1e-5)):
            found = driven.simulate(2, launch_error=sign * size).launch_errors[1:]
            assert found / (sign * size) == pytest.approx(slopes, rel=tolerance)


@pytest.mark.parametrize(
    ("disturbance", "words"),
    [
        ({"hops": 0}, "hops = 0"),
        ({"launch_error": np.nan}, "launch_error = nan"),
        ({"launch_error": -5.0}, "a launch speed must be above 0"),
        ({"launch_error": 0.1, "state": [1.0, 4.0, 0.0, 0.0, 0.0]}, "by either launch_error or state"),
        ({"state": [1.0]}, "it must be 5 numbers"),
        ({"dumping": 0.1}, "'dumping'"),
        ({"damping": -0.1}, "below 0"),
        ({"push": 3.0}, "push = 3.0; it must be a time"),
        ({"push": (1.0, {"y3'": 0.1})}, "no flight state 'y3''"),
        ({"push": (1e3, {"y1'": 0.1})}, "the motion ends at"),
        ({"push": (-1.0, {"y1'": 0.1})}, "push: time = -1"),
        ({"push": (0.0, {"y1'": 0.1})}, "push: time = 0; it must lie after the start; state="),
        ({"push": (1.0, {"y1'": np.inf})}, "not a finite number"),
        ({"push": (12.0, {"y2'": -0.1})}, "must be open"),
    ],
)
def test_what_is_no_disturbance(driven_hopper, disturbance, words):
    with pytest.raises(InputError, match=words):
        driven_hopper.simulate(**{"hops": 1, **disturbance})


@pytest.mark.slow
def test_a_motion_that_begins_in_contact_has_no_launch(started_hopper):
    with pytest.raises(InputError, match="begins in contact"):
        started_hopper.simulate(1, launch_error=0.1)


def test_an_end_before_its_time_is_told(driven_hopper):
    off = driven_hopper.simulate(5, launch_error=-0.05)
    assert off.run.status == "rests"
    assert off.compared == len(off.launch_errors) == len(off.delays) < 6
    assert str(off).endswith("rests")
    assert str(off).splitlines()[2].split()[0] == "0"
    assert repr(off).startswith("Disturbed(launch_errors=[")
