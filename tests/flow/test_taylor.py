"""Taylor steps: what does not move, motions of many steps, and steps that are halved in vain."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from orbits.flow.flow import flow_of
from orbits.flow.zero_crossing import first_zero, until_zero
from orbits.model.phase import Affine
from orbits.symbolic.calls import BufferedFunction
from problems import Hopper


def test_motions_at_rest_and_of_many_steps():
    """What does not move has steps of any length; a motion of a given time ends then, however many steps it takes."""
    along, p = flow_of(Hopper("cubic").model.reduction.statement.arcs[0].phase, ("beta",)), np.array([1.0])
    nothing = np.zeros((2, 0)), np.zeros((1, 0))
    still = along.stepper(0).advance_all(np.zeros((2, 2)), np.ones((2, 1)), np.full(2, 1e10), *nothing)
    assert (still.left == 0).all()
    assert (still.steps > 1e8).all()
    for time in np.random.default_rng(3).uniform(1, 300, 30):
        path, _ = along.run([3.0, 0.0], p, time)
        assert path.times[-1] == time
        assert path.steps.min() > 1e-3


def test_steps_share_the_time_and_are_halved_in_vain():
    """A saturated spring, flat to the last digit where the motion starts: the series does not know what comes after."""
    along = flow_of(Hopper("tanh", parameters={"b": 1.0}).model.reduction.statement.arcs[0].phase, ("b",))
    start, p, duration, count = np.array([-30.0, 4.0]), np.array([1.0]), 12.0, 60
    end, _, (taken, tried) = BufferedFunction(along.stepper(0).step_function.mapaccum(count))(
        [*start, duration, 1e9], np.ones((count, 1))
    )
    assert taken.sum() == pytest.approx(duration, rel=1e-15)
    assert end[2, -1] == 0.0
    in_vain = np.flatnonzero((taken == 0) & (tried > 0))
    assert len(in_vain) > 0
    assert (tried[in_vain + 1] <= 0.5 * tried[in_vain]).all()
    assert taken[tried > 0][-1] > 0.2 * taken.max()
    path, _ = along.run(start, p, duration)
    assert path.steps == pytest.approx(taken[taken > 0], rel=1e-12)
    true = solve_ivp(lambda t, x: [x[1], -np.tanh(x[0])], (0, duration), start, "DOP853", rtol=1e-13, atol=1e-13)
    assert end[:2, -1] == pytest.approx(true.y[:, -1], abs=1e-9)
    assert path.end[:2] == pytest.approx(end[:2, -1], abs=1e-12)
    starts = np.array([[-30.0, 4.0], [-20.0, 4.0], [-8.0, 4.0]])
    which, motions = until_zero(along, starts, np.ones((3, 1)), Affine((1.0, 0.0)))
    assert which.tolist() == [0, 1, 2]
    for start, path in zip(starts, motions, strict=True):
        one, _ = along.run(start, p, stop=first_zero(Affine((1.0, 0.0))))
        assert path.times[-1] == pytest.approx(one.times[-1], rel=1e-12)
    assert (motions.steps > 0).all()
