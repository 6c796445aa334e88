"""The first zeros of a gap, grazing ones among them: against closed forms, and many motions against each alone."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from conftest import grazing_flights
from many_at_once import MACHINES

from orbits import ReturnMap
from orbits.errors import FlowError
from orbits.flow import FirstOf, Flow, Watch, first_events, first_zero, flow_of, until_zero
from orbits.flow.first_events import _Search
from orbits.flow.flow import CLOSED_FORM
from orbits.flow.vector_field import VectorField
from orbits.hops import Impacts
from orbits.model import Affine
from orbits.numerics import piecewise_roots
from problems import Hopper, rimless_wheel


@pytest.mark.parametrize("spring", ["r + 1e-30*sin(r)", "bilinear"])
def test_grazing_by_taylor_and_piecewise(spring):
    """The spring's force is that of the straight line, its flow is not in closed form."""
    states, lowest, below = grazing_flights(400 if spring != "bilinear" else 100, seed=12)
    more = {"parameters": {"ratio": 1.0, "gap": 0.5}} if spring == "bilinear" else {}
    rules = Impacts(Hopper(spring, **more))
    assert rules.flight.method == "Taylor"
    times, *_, failed = first_events(rules.flight, states, rules.p, rules.flight_watch, 1e3)
    assert not failed
    assert ((times < lowest) == below).all()
    assert bool(rules.flight.phase.pieces) == (spring == "bilinear")


@pytest.mark.parametrize("alpha", [2.4e4, 1e5, 1e8])
def test_a_fast_launch_lands_at_the_first_zero_of_the_gap(alpha):
    """The flight's end against its closed form, and no earlier zero while the parabola comes down to the amplitude."""
    impacts = Impacts(Hopper(rest_length=20.0))
    start, form = impacts.launch(np.array([alpha])), impacts.flight.closed_form(impacts.p)
    (time,), *_, failed = first_events(impacts.flight, start, impacts.p, impacts.flight_watch, np.inf, 3)
    assert not failed
    _, (falls,) = form.positive_between(impacts.gap, start.T)
    before = np.linspace(falls, time * (1 - 1e-14), 1000)
    assert impacts.gap(form.state(start[0], before).T).min() > 0
    assert abs(impacts.gap(form.state(start[0], time))) < 1e-14 * alpha**2
    assert ReturnMap(impacts.machine)(alpha).status == "lifts_off"


def test_a_flight_that_takes_too_many_steps_is_given_up(monkeypatch):
    """In closed form the time says how many: lengths of a third, in blocks of four, up to the one that begins last."""
    impacts = Impacts(Hopper("k*r", rest_length=20.0, parameters={"k": 9.0}))
    alphas = np.array([5.0, 40.0])
    starts, form = impacts.launch(alphas), impacts.flight.closed_form(impacts.p)
    times, *_, failed = first_events(impacts.flight, starts, impacts.p, impacts.flight_watch, np.inf, 3)
    assert not failed
    length = CLOSED_FORM.step / np.sqrt(form.square)
    block = CLOSED_FORM.block * length
    begins = np.floor(times / block) * block
    assert begins[0] < begins[1]
    assert length == pytest.approx(1 / 3)
    for most, lost in ((begins[1] - 0.5 * block, [1]), (begins[1] + 0.5 * block, [])):
        monkeypatch.setattr(
            import_module("orbits.flow.first_events"), "CLOSED_FORM", CLOSED_FORM._replace(most_steps=most / length)
        )
        found, *_, failed = first_events(impacts.flight, starts, impacts.p, impacts.flight_watch, np.inf, 3)
        assert list(failed) == lost
        kept = [i for i in range(2) if i not in lost]
        assert found[kept] == pytest.approx(times[kept], rel=1e-15)
    monkeypatch.setattr(import_module("orbits.flow.first_events"), "CLOSED_FORM", CLOSED_FORM._replace(most_steps=0.0))
    _, *_, failed = first_events(impacts.flight, starts, impacts.p, impacts.flight_watch, np.inf, 3)
    assert "takes too many steps" in str(failed[1])


def test_what_is_watched_is_told_at_the_zero():
    """The force under the standing foot where a contact in closed form turns: the weight less the spring's pull."""
    impacts = Impacts(Hopper("k*r", parameters={"k": 9.0}))
    times, _, rows, _ = first_events(
        impacts.contact, [[0.0, -4.0]], impacts.p, Watch(impacts.contact, [impacts.model.contact_speed]), np.inf
    )
    assert np.isfinite(times).all()
    assert rows[0, 0] < -1.0
    assert rows[0, 2] == pytest.approx(1.0 - 9.0 * rows[0, 0], rel=1e-14)


def test_motions_whose_time_ends_before_they_run_away_are_settled_together(monkeypatch):
    """A spring that repels far out: a motion that is followed for a little less time has no turn, and no error."""
    machine = Hopper("tanh(b*r)/b + c*r", parameters={"b": 0.2, "c": -0.1})
    flow, p = flow_of(machine.model.relative.phase, tuple(machine.values)), np.array([*machine.values.values()])
    starts, limits, speed = np.tile([1.0, 30.0], (20, 1)), np.linspace(120.0, 150.0, 20), Affine((0.0, 1.0))
    away = []
    for limit in limits:
        try:
            flow.run(starts[0], p, limit)
        except FlowError as error:
            away.append(str(error))
    monkeypatch.setattr(Flow, "run", lambda *_, **__: pytest.fail("followed alone"))
    times, *_, failed = first_events(flow, starts, p, Watch(flow, [speed]), limits)
    assert np.isnan(times).all()
    assert [str(error) for _, error in sorted(failed.items())] == away
    assert 0 < len(away) < 20


@pytest.mark.parametrize("name", MACHINES)
def test_flights_to_their_landings(name):
    rules, rng = Impacts(MACHINES[name]), np.random.default_rng(7)
    x = rng.normal(0, 2.5, (60, 4))
    x[:, 2] = np.abs(x[:, 2])
    if "table" in name:
        x = x[np.abs(x[:, 0] - x[:, 2]) < 3]
    times, _, rows, failed = first_events(rules.flight, x, rules.p, rules.flight_watch, 40.0)
    without = first_events(rules.flight, x, rules.p, rules.flight_watch, 40.0, reasons=False)
    assert without.failed.keys() == failed.keys()
    for i, start in enumerate(x):
        try:
            path, _ = rules.flight.run(start, rules.p, 40.0, stop=first_zero(rules.gap))
        except FlowError as error:
            reason = error
        else:
            reason = None
        assert type(failed.get(i)) is type(reason)
        if reason:
            continue
        if path.times[-1] < 40.0:
            assert times[i] == pytest.approx(path.times[-1], rel=1e-9, abs=1e-11)
            assert rows[i] == pytest.approx(path.end, rel=1e-8, abs=1e-8)
        else:
            assert np.isnan(times[i])


@pytest.mark.parametrize("name", ["cubic", "sinh in gravity"])
def test_motions_up_to_a_zero(name):
    """Motions of few steps and of many, in their order; those that do not get there are left out."""
    rules, rng = Impacts(MACHINES[name]), np.random.default_rng(8)
    p, starts = np.tile(rules.p, (40, 1)), rng.normal(0, 4, (40, 2))
    starts[7] = np.nan
    back = Affine((1.0, 0.0, 0.0))
    for _ in range(2):  # the second time it is known how many steps it takes
        which, motions = until_zero(rules.contact, starts, p, back)
        assert which.tolist() == [i for i in range(40) if i != 7]
        for i, path in zip(which, motions, strict=True):
            one, _ = rules.contact.run(starts[i], rules.p, 100.0, stop=first_zero(back))
            assert path.times[-1] == pytest.approx(one.times[-1], rel=1e-12)
            assert path.end == pytest.approx(one.end, rel=1e-10, abs=1e-10)
    assert motions.counts.min() <= 6 < motions.counts.max()


@pytest.mark.parametrize(("extension", "speed"), [(0.5, 0.0), (0.5, 1.0), (0.5, -1.0)])
def test_a_start_on_a_break(extension, speed):
    """Of a bilinear spring, at rest too: against a start one rounding beside."""
    rules = Impacts(Hopper("bilinear", rest_length=30, parameters={"gap": 0.5, "ratio": 3.0}))
    x = np.array([[3 + extension, speed, 3.0, 0.0]])
    beside = x + np.array([[1e-13, 0, 0, 0]])
    one, two = (first_events(rules.flight, start, rules.p, rules.flight_watch, 60.0) for start in (x, beside))
    assert one[0] == pytest.approx(two[0], rel=1e-10)
    assert one[1] == pytest.approx(two[1], rel=1e-9)
    path, _ = rules.flight.run(x[0], rules.p, 60.0, stop=first_zero(rules.gap))
    assert path.times[-1] == pytest.approx(one[0][0], rel=1e-12)


@pytest.mark.parametrize("height", [-1e-17, 0.0, 1e-17])
def test_a_zero_before_a_step_in_vain(height, monkeypatch):
    """The foot leaves the ground, but for rounding, where a spring with a sharp kink has no series that serves."""
    rules, foot = Impacts(Hopper("r - log(1 + exp(-20*(r + 2)))/10")), Affine((0.0, 0.0, 1.0, 0.0))
    # Without the bound on how far a step may go, steps are taken in vain.
    monkeypatch.setattr(VectorField, "reaches", [])
    flight = flow_of(replace(rules.flight.phase), rules.flight.parameters)
    starts = np.array([[r + height, v, height, w] for r in (2.0, 4.0, 6.0) for v in (-2.0, 1.0) for w in (0.3, 2.0)])
    ps = np.tile(rules.p, (len(starts), 1))
    stepper = flight.stepper(0)
    states = np.column_stack([starts, np.full((len(starts), 3), (np.inf, 1e9, 0.0))])

    def first_step(code, arguments):
        step = stepper.step.append(code, *arguments, ())
        return [step.after, [step.taken.name], [code.splat(1)], [code.splat(0)]]

    assert (
        stepper.kernel_of(first_step, stepper.sizes, [stepper.places.time, 1, 1, 1])(states, ps).records[0] == 0
    ).any()
    times, *_, failed = first_events(flight, starts, rules.p, Watch(flight, [foot]), 50.0, 1)
    which, motions = until_zero(flight, starts, ps, foot, 1)
    landings = [flight.run(start, rules.p, stop=first_zero(foot, 1))[0].times[-1] for start in starts]
    assert not failed
    assert times == pytest.approx(landings, rel=1e-10)
    assert motions.ends == pytest.approx(np.array(landings)[which], rel=1e-10)


@pytest.mark.parametrize("spring", ["bilinear", "r + 0.1*r**3"])
@pytest.mark.parametrize("rising", [False, True])
def test_after_some_turns_a_motion_has_no_zero(spring, rising):
    """In contact the body goes to and fro through a breakpoint: after this many turns no zero is searched any
    more, and one before them is found. Each motion alone tells how many those are."""
    rules = Impacts(Hopper(spring, parameters={"ratio": 3.0, "gap": 0.5} if spring == "bilinear" else {}))
    rng = np.random.default_rng(9)
    starts = np.column_stack([rng.uniform(-3.0, 0.5, 40), rng.normal(0.0, 2.0, 40)])
    height, speed = Affine((1.0, 0.0), 1.2), Affine((0.0, 1.0))
    times, _, rows, failed = first_events(
        rules.contact, starts, rules.p, Watch(rules.contact, [height], rising=rising), 50.0
    )
    assert not failed
    turns = np.zeros(40, int)
    for i, start in enumerate(starts):
        path, _ = rules.contact.run(start, rules.p, times[i] if np.isfinite(times[i]) else 50.0)
        turns[i] = len(piecewise_roots(path.coefficients[:, 1], path.steps))
    found = np.isfinite(times)
    assert found.sum() > 20
    assert (turns[found] > 0).any()
    assert set(turns[found]) >= {0, 1}
    for most in (1, 2, 3):
        over, _, ends, failed = first_events(
            rules.contact, starts, rules.p, Watch(rules.contact, [height], turns=(speed, most), rising=rising), 50.0
        )
        assert not failed
        before = found & (turns < most)
        assert over[before] == pytest.approx(times[before], rel=1e-12)
        assert ends[before] == pytest.approx(rows[before], rel=1e-11, abs=1e-11)
        assert np.isinf(over[~found]).all()
        late = found & ~before  # within the same step as the turns a zero is found still
        assert most > 1 or np.isinf(over[late]).any()
        assert over[late] == pytest.approx(np.where(np.isinf(over[late]), np.inf, times[late]), rel=1e-12)


@pytest.mark.parametrize("spring", ["r", "r + 0.2*r**3", "r + 0.3*abs(r)*r"])
def test_the_first_of_several_functions_is_that_of_each_alone(spring):
    """In closed form, in Taylor steps and one by one; one of two functions, by motion, has a zero at the start."""
    rules, rng = Impacts(Hopper(spring)), np.random.default_rng(17)
    functions = [Affine((1.0, 0.3), 0.2), Affine((-0.5, 1.0), 0.4), Affine((0.2, -1.0), -1.5)]
    starts, opens = rng.normal(0.0, 2.0, (60, 2)), rng.integers(0, 2, 60)
    for i, start in enumerate(starts):
        own = functions[opens[i]]
        start[0] -= own(start) / own.weights[0]
    found = first_events(
        rules.contact, starts, rules.p, Watch(rules.contact, functions, opening=2), 9.0, np.eye(2)[opens]
    )
    alone = [
        first_events(rules.contact, starts, rules.p, Watch(rules.contact, [each]), 9.0, (opens == i)[:, None]).times
        for i, each in enumerate(functions)
    ]
    soonest = np.nan_to_num(alone, nan=np.inf)
    assert not found.failed
    assert np.bincount(found.which).min() > 5
    assert found.times == pytest.approx(soonest.min(0), rel=1e-14)
    assert (found.which == soonest.argmin(0)).all()
    for i in range(0, 60, 6):
        stop = FirstOf(*(first_zero(each, int(k == opens[i])) for k, each in enumerate(functions)))
        path, _ = rules.contact.run(starts[i], rules.p, 9.0, stop=stop)
        assert path.times[-1] == pytest.approx(found.times[i], rel=1e-12)
        assert path.end == pytest.approx(found.rows[i], abs=1e-11)
        assert stop.which == found.which[i]


@pytest.mark.parametrize("spring", ["r", "r + 0.2*r**3"])
def test_of_two_events_at_one_time_the_first_function_has_it(spring):
    rules, height = Impacts(Hopper(spring)), Affine((1.0, 0.0), 0.8)
    starts = np.random.default_rng(4).normal(0.0, 2.0, (30, 2))
    twice = first_events(rules.contact, starts, rules.p, Watch(rules.contact, [height, height]), 20.0)
    once = first_events(rules.contact, starts, rules.p, Watch(rules.contact, [height]), 20.0)
    assert np.array_equal(twice.times, once.times, equal_nan=True)
    assert (twice.which == once.which).all()
    assert once.which.max() == 0


def test_a_motion_with_an_event_does_not_break_off():
    """On one that runs away, a second function without a zero is searched behind the event of the first."""
    rules = Impacts(rimless_wheel())
    starts = rules.launch(np.linspace(0.3, 3.0, 20))
    found = first_events(rules.flight, starts, rules.p, rules.flight_watch, 500.0, np.array([[3, 0]]))
    assert np.isfinite(found.times).any()
    assert not {*found.failed} & {*np.flatnonzero(np.isfinite(found.times)).tolist()}


def test_turns_are_counted_on_behind_the_lanes():
    """The motion comes back to its start after one turn: not where it has made two of three before."""
    rules, starts = Impacts(Hopper("r + 0.2*r**3")), np.array([[0.4, -2.0], [0.4, -0.5]])
    watch = Watch(rules.contact, [Affine((1.0, 0.0), -0.4)], turns=(Affine((0.0, 1.0)), 3))
    for turned in (0, 1, 2):
        search = _Search(rules.contact, starts, rules.p[None], watch, 50.0, 1)
        search.one_by_one(np.arange(2), starts, np.zeros(2), turned=np.full(2, turned))
        assert np.isinf(search.times).all() == (turned == 2)
        assert np.isfinite(search.times).all() == (turned < 2)
