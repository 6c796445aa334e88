"""Inputs that change in time: contacts that go on or end, in closed form, and schedules in SI."""

import numpy as np
import pytest

from orbits import InputError, simulate
from problems import Hopper, hopper_in_si


def test_a_contact_goes_on_where_its_inputs_change():
    """At rest until the spring becomes four times as stiff, then an oscillation about a quarter of the extension, with
    the frequency of the upper one of two equal masses; and after that with the first stiffness again."""
    machine = Hopper("k*r", parameters={"k": 1.0})
    run = simulate(machine, state=[-1.0, 0.0, 0.0, 0.0], time=2.5, schedule=([1.0, 2.0], {"k": [4.0]}))
    assert run.status == "done"
    assert [leg.phase for leg in run.legs] == ["contact"] * 3
    assert run(0.9) == pytest.approx([-1.0, 0.0, 0.0, 0.0], abs=1e-14)
    stiff, t = np.sqrt(2.0), np.array([0.3, 1.0])
    expected = -0.25 - 0.75 * np.cos(stiff * t)
    assert run(1.0 + t)[:, 0] == pytest.approx(expected, abs=1e-13)
    speed, soft = 0.75 * stiff * np.sin(stiff), np.sqrt(0.5)
    after = -1.0 + (expected[-1] + 1.0) * np.cos(0.4 * soft) + speed / soft * np.sin(0.4 * soft)
    assert run(2.4)[0] == pytest.approx(after, abs=1e-13)


def test_a_contact_ends_where_new_inputs_would_have_it_pull():
    """At the top of its oscillation the spring carries 0.8 of the foot, and four times as much once it is stiffer."""
    top = np.pi / np.sqrt(0.5)
    options = {"time": top + 1.0, "schedule": ([top, top + 2.0], {"k": [4.0]})}
    run = simulate(Hopper("k*r", parameters={"k": 1.0}), state=[-2.8, 0.0, 0.0, 0.0], **options)
    assert [(event.kind, event.time) for event in run.events] == [("lift-off", pytest.approx(top, rel=1e-12))]
    assert run.events[0].after[:2] == pytest.approx([0.8, 0.0], abs=1e-12)
    assert [leg.phase for leg in run.legs] == ["contact", "flight"]
    # The extension goes on about the foot's and the body's common fall, four times as stiff.
    t = np.linspace(0.0, 0.5, 6)
    states = run(top + t)
    assert states[:, 0] - states[:, 2] == pytest.approx(0.8 * np.cos(2.0 * t), abs=1e-12)
    assert states[:, 0] + states[:, 2] == pytest.approx(0.8 - 0.5 * t**2, abs=1e-12)
    assert (states[1:, 2] > 0).all()


def test_a_schedule_names_what_may_change_in_time():
    linear = hopper_in_si(60.0, 3.0, stiffness=5000.0, rest_length=0.8)
    with pytest.raises(InputError, match="may change in time"):
        simulate(linear, 1.5, hops=1, schedule=([0.0, 1.0], {"stiffness": [1.0]}))
    for machine in (Hopper(rest_length=20.0), linear):
        with pytest.raises(InputError, match="schedule: the machine has no parameter 'zz'"):
            simulate(machine, 4.0, hops=1, schedule=([0.0, 1.0], {"zz": [1.0]}))


def test_a_schedule_that_changes_as_the_foot_lands():
    """The parameters in force at the impact are the new ones, however the times round."""
    machine = Hopper("k*r + b*r**3", mass_ratio=0.7, restitution=0.3, parameters={"k": 1.0, "b": 0.2})
    lands = next(event.time for event in simulate(machine, 3.2, time=20.0).events if event.kind == "impact")
    times = lands + np.array([-8, -1, 0, 1, 8]) * np.spacing(lands)
    runs = [simulate(machine, 3.2, hops=2, schedule=([t, t + 1, t + 4], {"k": [1.3, 0.8]})) for t in times]
    assert {run.status for run in runs} == {runs[0].status}
    assert [run.launches[-1] for run in runs] == pytest.approx([runs[0].launches[-1]] * 5, rel=1e-9)
