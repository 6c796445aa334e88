"""Taylor steps: what does not move, motions of many steps, and steps that are halved in vain."""

import numpy as np

from orbits.flow import TAYLOR, flow_of
from orbits.flow.taylor import _may_change_sign
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
