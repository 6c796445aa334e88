"""Taylor steps: what does not move, and motions of many steps."""

import numpy as np

from orbits.flow import flow_of
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
