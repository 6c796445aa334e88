"""The regulator of a cycle, against SciPy's of all inputs decided at once."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from orbits.control.regulator import Piece, cycle_with, landing_softly, regulator
from orbits.errors import NoOrbit


def test_the_regulator_against_that_of_the_whole_cycle():
    """The cost of a cycle whose forces are decided one after the other is that of all of them decided at once."""
    rng = np.random.default_rng(0)
    shapes = ((4, 3), (4, 4), (2, 4), (3, 2))
    stages = [Piece(rng.standard_normal(shape)) for shape in shapes]
    stages[1] = stages[1]._replace(effect=rng.standard_normal(4), acts=0, decides=(0,))
    stages[3] = stages[3]._replace(effect=rng.standard_normal(3), acts=1, decides=(1,))
    gap = rng.standard_normal(4)
    stages[2] = stages[2]._replace(gap=gap[None])
    _, matrix = regulator(stages, 2, 0.3, 2.0)
    first, second, third, last = (stage.carry for stage in stages)
    a = last @ third @ second @ first
    b = np.column_stack([last @ third @ stages[1].effect, stages[3].effect])
    z, w = gap @ second @ first, np.array([gap @ stages[1].effect, 0.0])
    q, r, s = np.eye(3) + 2 * np.outer(z, z), 0.3 * np.eye(2) + 2 * np.outer(w, w), 2 * np.outer(z, w)
    # The cost counts the launch after each cycle, whose sum differs by a constant.
    cost = solve_discrete_are(a, b, q, r, s=s)
    gain = np.linalg.solve(r + b.T @ cost @ b, b.T @ cost @ a + s.T)
    assert np.abs(matrix - (a - b @ gain)).max() < 1e-9 * np.abs(matrix).max()
    with pytest.raises(NoOrbit, match="does not affect every growing change"):
        regulator([Piece(np.diag([2.0, 0.5]), np.array([0.0, 1.0]), 0, (0,))], 1, 1.0, 0.0)
    # Decided together at the start, or before they act: the second input is a function of the same state.
    at_once = [stages[0]._replace(decides=(0, 1)), *(each._replace(decides=()) for each in stages[1:])]
    _, same = regulator(at_once, 2, 0.3, 2.0)
    assert np.abs(same - matrix).max() < 1e-9 * np.abs(matrix).max()


def test_inputs_that_land_softly():
    """What should vanish at the landing does, for every state, and the inputs change the least."""
    rng = np.random.default_rng(1)
    gains, slopes, inputs = rng.standard_normal((5, 4 + 5)), rng.standard_normal((2, 4)), rng.standard_normal((2, 3))
    gains[:, 4:] = np.tril(gains[:, 4:], -1)
    found = landing_softly(gains, slopes, inputs)

    def decided(rows, state):
        u = np.zeros(5)
        for i in range(5):
            u[i] = -rows[i, :4] @ state - rows[i, 4:] @ u
        return u

    for state in rng.standard_normal((3, 4)):
        own, soft = decided(gains, state)[:3], decided(found, state)[:3]
        assert np.abs(slopes @ state + inputs @ soft).max() < 1e-12
        assert np.abs(np.linalg.svd(inputs)[2][2] @ (soft - own)) < 1e-12  # not along what changes no landing


def test_the_cycle_with_gains():
    """A scalar x becomes a x + b u, with u = -k x."""
    pieces = [Piece(np.array([[2.0]]), np.array([0.5]), 0, (0,))]
    assert cycle_with(pieces, np.array([[3.0, 0.0]])) == pytest.approx(np.array([[0.5]]))
