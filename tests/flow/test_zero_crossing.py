"""The first zero of a gap along many flights, grazing ones among them, against closed forms."""

import numpy as np
import pytest
from conftest import grazing_flights

from orbits import ReturnMap
from orbits.flow.flow import Flow
from orbits.flow.zero_crossing import CLOSED_BLOCK, CLOSED_STEP, first_zeros
from orbits.simulation.impacts import Impacts
from problems import Hopper


@pytest.mark.parametrize("spring", ["r + 1e-30*sin(r)", "bilinear"])
def test_grazing_by_taylor_and_piecewise(spring):
    """The spring's force is that of the straight line, its flow is not in closed form."""
    states, lowest, below = grazing_flights(400 if spring != "bilinear" else 100, seed=12)
    more = {"parameters": {"ratio": 1.0, "gap": 0.5}} if spring == "bilinear" else {}
    rules = Impacts(Hopper(spring, **more))
    assert rules.flight.method == "Taylor"
    times, _, failed = first_zeros(rules.flight, states, rules.p, rules.gap, 1e3)
    assert not failed
    assert ((times < lowest) == below).all()
    assert bool(rules.flight.phase.pieces) == (spring == "bilinear")


@pytest.mark.parametrize("alpha", [2.4e4, 1e5, 1e8])
def test_a_fast_launch_lands_at_the_first_zero_of_the_gap(alpha):
    """The flight's end against its closed form, and no earlier zero while the parabola comes down to the amplitude."""
    impacts = Impacts(Hopper(rest_length=20.0))
    start, form = impacts.launch(np.array([alpha])), impacts.flight.closed_form(impacts.p)
    (time,), _, failed = first_zeros(impacts.flight, start, impacts.p, impacts.gap, np.inf, 3)
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
    times, _, failed = first_zeros(impacts.flight, starts, impacts.p, impacts.gap, np.inf, 3)
    assert not failed
    length = CLOSED_STEP / np.sqrt(form.square)
    block = CLOSED_BLOCK * length
    begins = np.floor(times / block) * block
    assert begins[0] < begins[1]
    assert length == pytest.approx(1 / 3)
    for most, lost in ((begins[1] - 0.5 * block, [1]), (begins[1] + 0.5 * block, [])):
        monkeypatch.setattr("orbits.flow.zero_crossing.MOST_CLOSED_STEPS", most / length)
        found, _, failed = first_zeros(impacts.flight, starts, impacts.p, impacts.gap, np.inf, 3)
        assert list(failed) == lost
        kept = [i for i in range(2) if i not in lost]
        assert found[kept] == pytest.approx(times[kept], rel=1e-15)
    monkeypatch.setattr("orbits.flow.zero_crossing.MOST_CLOSED_STEPS", 0.0)
    _, _, failed = first_zeros(impacts.flight, starts, impacts.p, impacts.gap, np.inf, 3)
    assert "takes too many steps" in str(failed[1])


def test_what_is_watched_is_told_at_the_zero():
    """The force under the standing foot where a contact in closed form turns: the weight less the spring's pull."""
    impacts = Impacts(Hopper("k*r", parameters={"k": 9.0}))
    times, rows, _ = first_zeros(impacts.contact, [[0.0, -4.0]], impacts.p, impacts.model.contact_speed, np.inf)
    assert np.isfinite(times).all()
    assert rows[0, 0] < -1.0
    assert rows[0, 2] == pytest.approx(1.0 - 9.0 * rows[0, 0], rel=1e-14)


def test_a_motion_that_falls_for_ever_is_given_up_without_its_steps(monkeypatch):
    """The spring carries less than the weight, and bends so often that the fall takes thousands of steps."""
    impacts = Impacts(Hopper("tanh(r) + s*sin(r)", parameters={"s": 3.0}))
    monkeypatch.setattr(Flow, "run", lambda *_, **__: pytest.fail("followed by itself"))
    starts = np.array([[0.4, -2.0], [0.4, -9.0]])
    times, _, failed = first_zeros(impacts.contact, starts, impacts.p, impacts.model.contact_speed, 1e7)
    assert np.isfinite(times).tolist() == [True, False]
    assert list(failed) == [1]
