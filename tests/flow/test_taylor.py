"""Taylor steps: what does not move, motions of many steps, and steps that are halved in vain."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from orbits.flow import TAYLOR, first_zero, flow_of, until_zero
from orbits.flow.taylor import _may_change_sign
from orbits.flow.vector_field import VectorField
from orbits.model import Affine
from orbits.symbolic import BufferedFunction
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


def test_steps_share_the_time_and_are_halved_in_vain(monkeypatch):
    """A saturated spring, flat to the last digit where the motion starts: the series does not know what comes after."""
    monkeypatch.setattr(VectorField, "reaches", [])  # the scale of the law is not used
    phase = Hopper("tanh", parameters={"b": 1.0}).model.reduction.statement.arcs[0].phase
    along = flow_of(replace(phase), ("b",))
    start, p, duration, count = np.array([-30.0, 4.0]), np.array([1.0]), 12.0, 60
    end, _, (taken, tried) = BufferedFunction(along.stepper(0).step_function.mapaccum(count))(
        [*start, duration, 1e9, 0.0], np.ones((count, 1))
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


def test_a_step_that_is_excluded_has_no_zero():
    """Random series, most of whose terms soon vanish, after zeros of order 0 to 3: where no sign change is said to be
    possible, there is none in two thousand places; and most of the others have one."""
    rng, size = np.random.default_rng(8), 600
    function = _may_change_sign(1, ((0,),), 1, counts=False).map(size)
    orders = rng.integers(0, 4, size)
    c = rng.normal(size=(size, TAYLOR.order + 1)) * rng.uniform(0.1, 0.6, (size, 1)) ** np.arange(TAYLOR.order + 1)
    c[np.arange(TAYLOR.order + 1) < orders[:, None]] = 0.0
    weights = np.vstack([rng.choice([-1.0, 1.0], size), np.zeros(size), orders])
    may, after, _ = (np.array(each).ravel() for each in function(c.T.reshape(-1, size), 1.0, weights, 1.0, 0.0))
    places = np.linspace(0.0, 1.0, 2001)[1:]
    values = weights[0, :, None] * (c @ places ** np.arange(TAYLOR.order + 1)[:, None])
    changes = (np.sign(values) != np.sign(values[:, :1])).any(1)
    assert not (changes & (may == 0)).any()
    assert ((values[:, -1] >= 0) == (after > 0)).all()
    assert (may == 0).sum() > 200
    assert changes.sum() > 50
