"""Driven machines: the motion with its machine, after its file, drawn, and simulated under a disturbance, against the
equations written out for another integrator, the return map, and linearised growth."""

import json
from dataclasses import fields

import numpy as np
import pytest
from legibility import faults
from scipy.integrate import solve_ivp, trapezoid
from scipy.linalg import expm

from orbits import Control, InputError, ReturnMap, find, simulate
from orbits.simulation.simulated import Simulation
from problems import Actuated, Disturbed, Driven, Hopper, Juggler, hopper_in_si, steering
from problems.laws import springs
from problems.steering.driven import WithMovedEnd

C = 0.01
LEG = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 1e5}, rest_length=0.8, damping=5.0)


@pytest.fixture(scope="module")
def kept() -> Driven:
    """The damped hopper kept hopping, whose inputs repeat."""
    return steering.keep_hopping(Hopper(damping=C))


@pytest.fixture(scope="module")
def started() -> Driven:
    """A start from rest, after which the machine hops on by itself."""
    return steering.start_up(Hopper(), 2, stroke=2.0)


@pytest.fixture(scope="module")
def leg() -> Driven:
    """A leg in SI, kept hopping."""
    return steering.keep_hopping(LEG, intervals=20)


def test_a_driven_motion_is_a_control_with_its_machine(kept, started):
    assert isinstance(kept, Control)
    assert kept.source == Hopper(damping=C)
    assert kept.states == ("y1", "y1'", "y2", "y2'", "u")
    assert kept.periodic
    assert not started.periodic
    assert kept.launch == pytest.approx(kept(0.0)[1])
    assert started.launch is None
    t = np.linspace(0, kept.end, 50)
    assert kept(t).shape == (50, 5)
    flight, contact = kept.legs
    assert np.array_equal(kept(3.0), flight.path(3.0)[:5])
    standing = contact.path(2.0)
    assert np.array_equal(kept(flight.duration + 2.0), [standing[0], standing[1], 0, 0, standing[2]])
    assert kept.motion.in_contact([1.0, 10.0]).tolist() == [False, True]
    with pytest.raises(InputError, match="times lie between 0 and"):
        kept(kept.end + 1)


def test_the_table_tells_the_work(kept, started):
    """The integral of the power is the actuator's work, and the running cost of the effort ends at it."""
    for one in (kept, started):
        machine, t = one.source, np.linspace(0, one.end, 40001)
        table = one.table(t)
        assert trapezoid(table["power"], t) == pytest.approx(steering.work(machine, one)[0], rel=1e-3)
        assert table["running cost"][-1] == pytest.approx(one.cost, rel=1e-12)
        assert trapezoid(table["w"] ** 2, t) == pytest.approx(one.cost, rel=1e-3)
    assert list(kept.table()) == ["time", "stage", "y1", "y1'", "y2", "y2'", "u", "w", "running cost", "power"]


def test_si(leg, tmp_path):
    bare, units = leg.dimensionless(), LEG.units
    assert bare.source == LEG.dimensionless()
    speed = units.length / units.time
    assert leg.launch == pytest.approx(bare.launch * speed, rel=1e-13)
    size = [units.length, speed, units.length, speed, units.length]
    t = np.linspace(0, bare.end, 30)
    assert leg(np.minimum(t * units.time, leg.end)) == pytest.approx(bare(t) * size, abs=1e-12)
    assert leg.power(t[3] * units.time) == pytest.approx(bare.power(t[3]) * units.energy / units.time, rel=1e-9)
    for wrong in ("a", None, -0.1, leg.end + 0.1):
        with pytest.raises(InputError, match=r"times lie between 0 and .* s$"):
            leg.power(wrong)
    head = leg.save(tmp_path / "leg.csv").read_text().splitlines()[0]
    assert head == ("time (s),stage,y1 (m),y1' (m/s),y2 (m),y2' (m/s),u (m),w (m/s),running cost (m^2/s),power (W)")
    off, bare_off = leg.simulate(2, damping=5.5), bare.simulate(2, damping=5.5 / 5.0 * bare.source.damping)
    assert off.launch_errors == pytest.approx(bare_off.launch_errors * speed, abs=1e-9)
    assert off.delays == pytest.approx(bare_off.delays * units.time, abs=1e-9)
    assert "launch speed (m/s)" in str(off)


@pytest.mark.parametrize("name", ["kept", "started", "leg"])
def test_files(name, tmp_path, request):
    """Motion and machine come back to the last bit, and can be used."""
    driven = request.getfixturevalue(name)
    again = Driven.load(driven.save(tmp_path / "driven.json"))
    assert again.save(tmp_path / "again.json").read_bytes() == (tmp_path / "driven.json").read_bytes()
    assert again.source == driven.source
    t = np.linspace(0, driven.end, 33)
    assert np.array_equal(again(t), driven(t))
    assert np.array_equal(again.dimensionless().inputs_at(0.1), driven.dimensionless().inputs_at(0.1))
    one, other = (each.simulate(1) for each in (again, driven))
    assert np.array_equal(one.run.launches, other.run.launches)
    assert np.array_equal(Control.load(tmp_path / "driven.json").legs[0].path(0.1), driven.legs[0].path(0.1))


def test_a_machine_that_no_file_states_is_given(tmp_path):
    machine = Hopper(springs.function(lambda r, b: r + b * r**3, b=0.01))
    driven = steering.recover(machine, 0.05, intervals=14)
    path = driven.save(tmp_path / "driven.json")
    with pytest.raises(InputError, match=r"does not hold its machine.*load\(path, machine\)"):
        Driven.load(path)
    again = Driven.load(path, machine)
    assert np.array_equal(again(1.0), driven(1.0))
    with pytest.raises(InputError, match="it is of another machine"):
        Driven.load(path, Hopper())


@pytest.mark.usefixtures("any_digest")
@pytest.mark.parametrize(
    ("damage", "words"),
    [
        ({"statement": {"spring": "table:/etc/passwd"}}, "in another file, which is not read"),
        ({"statement": {"spring": "__import__('os')"}}, "the machine"),
        ({"statement": {"spring": "r + r**3"}}, "it is of another machine"),
        ({"statement": {"sprung": "r"}}, "unknown key 'sprung'"),
        ({"statement": {"parameters": 3}}, "parameters"),
        ({"statement": 3}, "statement = 3; it is a table"),
        ({"machine": {}}, "it is of another machine"),
    ],
)
def test_a_damaged_file_is_refused(kept, tmp_path, damage, words):
    document = json.loads(kept.save(tmp_path / "driven.json").read_text())
    (tmp_path / "driven.json").write_text(json.dumps(document | damage))
    with pytest.raises(InputError, match=words) as error:
        Driven.load(tmp_path / "driven.json")
    assert "is not a saved motion of a driven machine" in str(error.value)


@pytest.mark.usefixtures("any_digest")
def test_stages_of_another_machine_are_refused(kept, leg, tmp_path):
    document = json.loads(kept.save(tmp_path / "driven.json").read_text())
    other = json.loads(leg.save(tmp_path / "leg.json").read_text())
    named = json.loads((tmp_path / "driven.json").read_text().replace('"flight"', '"fall"'))
    for mixed, words in (
        ({**document, "machine": other["machine"], "statement": other["statement"]}, "units do not fit its machine"),
        (named, "its stage 'fall' is none of its machine's"),
    ):
        (tmp_path / "mixed.json").write_text(json.dumps(mixed))
        with pytest.raises(InputError, match=words):
            Driven.load(tmp_path / "mixed.json")


def test_without_a_disturbance_nothing_is_missed(kept, started):
    """Five hops with repeated inputs, and the hops after a start; as far from the aim as `missed` tells."""
    off = kept.simulate(5)
    assert isinstance(off, Disturbed)
    assert np.array_equal(off.launch_errors, np.zeros(6))
    assert np.array_equal(off.delays, np.zeros(6))
    assert off.run.launches == pytest.approx(kept.launch, abs=1e-12)
    t = np.linspace(0, 0.999 * kept.end, 40)
    assert off.run(t + 3 * kept.end) == pytest.approx(kept(t), abs=1e-11)
    after = started.simulate(3).run
    assert after.launches == pytest.approx(started.parameters["aim"], abs=1e-8)
    assert np.array_equal(after.launches, steering.rerun(started.source, started, hops=2).launches)
    assert steering.missed(started.source, started) <= 1e-8


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
    [
        {"launch_error": 0.02},
        {"launch_error": -0.02},
        {"damping": 1.1 * C},
        {"damping": 0.9 * C, "launch_error": 0.05},
        {"push": (3.0, {"y1'": 0.05})},
        {"push": (12.0, {"y1'": -0.05})},
    ],
    ids=str,
)
def test_a_disturbed_motion_by_another_integrator(kept, disturbance):
    off = kept.simulate(3, **disturbance)
    times, inputs = kept.schedule_of(4)
    damping, error = disturbance.get("damping", C), disturbance.get("launch_error", 0.0)
    push = (disturbance["push"][0], disturbance["push"][1]["y1'"]) if "push" in disturbance else None
    found = by_hand(times, inputs["w"], 3, damping, kept.launch + error, push)
    assert off.run.launches[1:] == pytest.approx(found, abs=1e-7)
    assert off.launch_errors[1:] == pytest.approx(found - kept.launch, abs=1e-7)
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


def test_a_start_under_a_disturbance(started):
    """A damper that the start does not know of, by another integrator; and a state of its own."""
    times, inputs = started.schedule("w")
    off = started.simulate(1, damping=1e-3)
    times, rates = np.append(times, times[-1] + 1), np.append(inputs["w"], 0.0)
    assert off.run.launches == pytest.approx(by_hand(times, rates, 1, 1e-3), abs=1e-8)
    assert off.launch_errors[0] < -1e-3
    state = np.add(started(0.0), [0.01, 0, 0, 0, 0])
    run = simulate(started.actuated, state=state, hops=2, schedule=started.schedule("w"))
    assert np.array_equal(started.simulate(2, state=state).run.launches, run.launches)


def test_a_push_of_nothing_changes_nothing(kept):
    """Wherever the motion is cut for it: in flight, in contact, and where no inputs are left."""
    for driven, times in ((kept, (2.0, 11.0, 20.0)), (steering.recover(Hopper(), 0.05), (3.0, 12.0, 18.0))):
        whole = driven.simulate(2).run
        for time in times:
            off = driven.simulate(2, push=(time, {"y1'": 0.0}))
            assert off.launch_errors == pytest.approx(0, abs=1e-8)
            t = np.linspace(0, 0.99 * whole.end, 60)
            assert off.run(t) == pytest.approx(whole(t), abs=1e-7)
            assert [event.kind for event in off.run.events][:2] == [event.kind for event in whole.events][:2]


def test_a_push_at_a_landing_or_lift_off_comes_after_it():
    for driven in (steering.keep_hopping(Hopper(damping=C), lossless=False), steering.recover(Hopper(), 0.05)):
        whole = driven.simulate(2).run
        for event in whole.events[:-1]:
            for time in event.time * np.array([1 - 1e-14, 1, 1 + 1e-14]):
                off = driven.simulate(2, push=(time, {"y1'": 0.0}))
                assert [each.kind for each in off.run.events] == [each.kind for each in whole.events]
                assert off.launch_errors == pytest.approx(0, abs=1e-8)
        with pytest.raises(InputError, match=r"push at .*: the motion ends at"):
            driven.simulate(2, push=(whole.end, {"y1'": 0.0}))


@pytest.mark.parametrize(
    ("disturbance", "words"),
    [
        ({"hops": 0}, "hops = 0"),
        ({"launch_error": np.nan}, "launch_error = nan"),
        ({"launch_error": -5.0}, "a launch speed is above 0"),
        ({"launch_error": 0.1, "state": [1.0, 4.0, 0.0, 0.0, 0.0]}, "give one of them"),
        ({"state": [1.0]}, "it is 5 numbers"),
        ({"dumping": 0.1}, "'dumping'"),
        ({"damping": -0.1}, "below 0"),
        ({"push": 3.0}, "push = 3.0; it is a time"),
        ({"push": (1.0, {"y3'": 0.1})}, "no flight state 'y3''"),
        ({"push": (1e3, {"y1'": 0.1})}, "the motion ends at"),
        ({"push": (-1.0, {"y1'": 0.1})}, "push: time = -1"),
        ({"push": (0.0, {"y1'": 0.1})}, "push: time = 0; it comes after the start.*state="),
        ({"push": (1.0, {"y1'": np.inf})}, "not a finite number"),
        ({"push": (12.0, {"y2'": 0.1})}, "must be open"),
    ],
)
def test_what_is_no_disturbance(kept, disturbance, words):
    with pytest.raises(InputError, match=words):
        kept.simulate(**{"hops": 1, **disturbance})


def test_a_motion_that_begins_in_contact_has_no_launch(started):
    with pytest.raises(InputError, match="begins in contact"):
        started.simulate(1, launch_error=0.1)


def test_an_end_before_its_time_is_told(kept):
    off = kept.simulate(5, launch_error=-0.05)
    assert off.run.status == "rests"
    assert off.compared == len(off.launch_errors) == len(off.delays) < 6
    assert str(off).endswith("rests")
    assert str(off).splitlines()[2].split()[0] == "0"
    assert repr(off).startswith("Disturbed(launch_errors=[")


def test_figures(kept, leg):
    axes = kept.plot()
    _, end, rate = axes.figure.axes
    assert {text.get_text() for text in rate.get_legend().get_texts()} == {"body", "foot", "centre of mass", "contact"}
    t = np.linspace(0, kept.end, 2001)
    assert end.lines[0].get_xydata()[:, 1] == pytest.approx(kept(t)[:, 4])
    assert rate.patches[0].get_data().values == pytest.approx(kept.schedule("w")[1]["w"])
    shown = leg.plot()
    labels = [one.get_ylabel().replace("\n", " ") for one in shown.figure.axes]
    assert labels == ["height (m)", "spring's end (m)", "its rate (m/s)"]
    assert shown.figure.axes[-1].get_xlabel() == "time (s)"
    off = leg.simulate(2, damping=5.5)
    axes = off.plot()
    assert axes.figure.axes[1].lines[0].get_xydata()[:, 1] == pytest.approx(off.launch_errors)
    assert axes.figure.axes[1].get_ylabel() == "launch speed\noff by (m/s)"
    assert "undisturbed" in [text.get_text() for text in axes.figure.axes[1].get_legend().get_texts()]
    for one in (kept.plot(), shown, axes, kept.simulate(4, launch_error=-0.1).plot()):
        assert not faults(one.figure)


def test_a_juggler(tmp_path):
    driven = steering.start_up(Juggler(), 2)
    assert isinstance(driven.motion, Simulation)
    assert driven.simulate(2).run.launches == pytest.approx(driven.parameters["aim"], abs=1e-7)
    again = Driven.load(driven.save(tmp_path / "juggler.json"))
    assert again.source == Juggler()
    assert isinstance(again.actuated, Actuated)


@pytest.mark.parametrize("machine", [Hopper(rest_length=9.0), Juggler(rest_length=20.0)], ids=repr)
def test_an_animation_shows_the_end_that_moves(machine):
    """The spring is drawn from there, as long as its force says."""
    driven = steering.recover(machine, 0.1, intervals=14)
    motion = driven.motion
    shown = WithMovedEnd(**{each.name: getattr(motion, each.name) for each in fields(motion)})
    ((end, above),) = shown.springs
    states = driven(np.linspace(0, driven.end, 20))
    drawn = shown.heights[above](states) - shown.heights[end](states)
    extension = driven.actuated.model.extension(states) - states[:, -1]
    assert drawn == pytest.approx(machine.rest_length + extension, abs=1e-12)
    assert np.abs(states[:, -1]).max() > 1e-3


def test_an_animation(leg, tmp_path):
    from PIL import Image

    with Image.open(leg.animate(tmp_path / "leg.gif", frames=4)) as picture:
        assert picture.n_frames == 4
