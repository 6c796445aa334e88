"""Motions as piecewise polynomials: what is watched along them, and their parts."""

import numpy as np
import pytest
from oscillators import START, TIME, duffing, oscillator


def test_watched_quantities_have_their_series():
    flow = oscillator(duffing, watch={"tension": lambda x, p, q: duffing(x[0], p, q)})
    path, _ = flow.run(START, [0.3], TIME)
    states = path(np.linspace(0, TIME, 301))
    assert states[:, 2] == pytest.approx(states[:, 0] + 0.3 * states[:, 0] ** 3, abs=1e-13)


def test_a_split_motion_is_the_same_motion():
    path, _ = oscillator(duffing).run(START, [0.3], TIME)
    first, rest = path.split(1.3)
    t = np.linspace(0, 1.3, 50)
    assert first(t) == pytest.approx(path(t), abs=1e-14)
    back = np.linspace(0, TIME - 1.3, 50)
    assert rest(back) == pytest.approx(path(TIME - back), abs=1e-13)
