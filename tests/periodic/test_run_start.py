"""Where the search for runs begins, against the runs that it leads to."""

import numpy as np
import pytest
from runners import FAST

from orbits import find
from orbits.periodic.find import start_of_run, unknowns_of_hop, vertical_hop
from orbits.periodic.tuned import tuning_of
from problems import runner

TUNE = ("inertia", "hip_stiffness")


def begun(machine, at):
    hop = unknowns_of_hop(vertical_hop(machine.upright(), 1))
    return start_of_run(machine, hop, tuning_of(machine, TUNE, at))


@pytest.mark.slow
def test_a_run_is_begun_near_where_it_is():
    machine = runner(inertia=FAST["inertia"], hip_stiffness=FAST["hip_stiffness"])
    start = begun(machine, {"speed": 0.4})
    assert start["duration"] == pytest.approx(FAST["half flight"], rel=0.01)
    assert start["contact_duration"] == pytest.approx(FAST["half contact"], rel=0.02)
    assert start["step"] == pytest.approx(FAST["step"], rel=0.03)
    launch = machine.model.launch(start, {**machine.values, "step": start["step"]})
    assert machine.model.planar.travel(launch, machine.values) == pytest.approx(0.4, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "value"), [("step", 1.0), pytest.param("mean_speed", 0.1, marks=pytest.mark.slow), ("speed", -0.2)]
)
@pytest.mark.slow
def test_the_start_has_the_prescribed_quantity(name, value):
    start = begun(runner(), {name: value})
    period = 2 * (start["duration"] + start["contact_duration"])
    speed = runner().model.planar.travel(runner().model.launch(start, runner().values), runner().values)
    found = {"step": start["step"], "mean_speed": start["step"] / period, "speed": speed}
    assert found[name] == pytest.approx(value, rel=1e-12)


@pytest.mark.slow
def test_a_run_without_speed_in_its_question_is_begun_slowly():
    start = begun(runner(), {"period": 7.0})
    speed = runner().model.planar.travel(runner().model.launch(start, runner().values), runner().values)
    assert abs(speed) == pytest.approx(0.1 * start["alpha"], rel=1e-12)


def test_runs_forward_and_back_are_mirror_images():
    forward, back = (find(runner(), tune=TUNE, at={"speed": speed}) for speed in (0.3, -0.3))
    assert back.step == pytest.approx(-forward.step, rel=1e-11)
    t = np.linspace(0, forward.period, 7)
    signs = np.where([name[0] in "xtp" for name in forward.source.model.flight.states], -1, 1)
    assert back(t) == pytest.approx(forward(t) * signs, abs=1e-10)
