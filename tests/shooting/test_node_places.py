"""Where nodes lie: on growths in closed form, and on the motion of a pendulum that passes its upright place."""

import casadi as ca
import numpy as np
import pytest

from orbits.model import Arc, Phase, Statement
from orbits.shooting import Shooting, growths_along
from orbits.shooting.node_places import GrowthAlong, largest_growths, lengths_of_parts


def test_nodes_lie_at_the_middles_of_passages():
    """Changes grow by the factor 9e6 up to 2, the middle of the first passage, and once more up to 4; they shrink until
    6, and do both again up to 10."""
    times = np.linspace(0.0, 10.0, 201)
    growths = np.exp(8.0 * np.interp(times, [0, 2, 4, 6, 8, 10], [0, 2, 4, 2, 4, 2]))
    ends = np.cumsum(lengths_of_parts(GrowthAlong(times, growths))) * 10.0
    assert ends[-1] == pytest.approx(10.0)
    assert ends[-3:-1] == pytest.approx([2.0, 6.0])
    before = np.diff(ends[ends <= 2.0 + 1e-9], prepend=0.0)
    assert (np.exp(8.0 * before) < 200.0).all()


def test_growths_of_a_pendulum_over_its_upright_place():
    """It falls to the lowest place once more: the derivatives along the motion are ratios of its rates."""
    phase = Phase("swing", ("x", "w"), lambda x, p, q: [x[1], ca.sin(x[0])])
    arc = Arc(
        phase, start=lambda u, before, p: [-np.pi, u["speed"]], duration=lambda u, p: p["t"],
        conditions=lambda u, x, p: [x[1]],
    )  # fmt: skip
    evaluation = Shooting(Statement("swing", ("speed",), (arc,)), ("t",)).evaluate_all(
        np.array([[2.0 + 1e-6]]), np.array([[20.0]])
    )
    (along,) = growths_along(evaluation, [1])
    (path,) = evaluation.trajectories[0]
    known = np.abs(path.variations[:, :, :2]).max((1, 2))
    assert along.growths[:-1] == pytest.approx(known, rel=1e-12)
    assert along.times == pytest.approx(path.times, rel=1e-14)
    assert largest_growths(evaluation, [1])[0, 0] == along.growths.max() > 1e4
