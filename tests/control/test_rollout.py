"""Solutions that are integrated accurately: what is overstepped between intervals, and the error of the steps."""

import sys

import numpy as np
import pytest
from carts import cart

from orbits import InputError, NoOrbit, steer
from orbits.control import Guess

steer_module = sys.modules["orbits.control.steer"]


def test_what_stays_positive_does_so_between_intervals():
    """Bryson and Denham: with x <= 1/9 the least integral of f^2 is 8/(9 * 1/9), reached along the bound."""
    turn = {"start": lambda x, before, p: [x[0], x[1] - 1], "end": lambda x, p: [x[0], x[1] + 1]}
    room = {"room": lambda x, p, q: 1 / 9 - x[0]}
    guess = [Guess(1.0, lambda t: [0.0, 1 - 2 * t])]
    found = steer([cart(9, path=room, **turn)], guess=guess)
    assert found.cost == pytest.approx(8, abs=1e-8)
    assert found.violation <= 1e-9
    coarse = steer([cart(4, path=room, **turn)], guess=guess)  # the touch is inside an interval
    assert coarse.rounds > 1
    assert coarse.violation <= 1e-9
    t = np.linspace(0, 1, 2001)
    assert coarse.legs[0].path(t)[:, 0].max() <= 1 / 9 + 1e-9


def test_the_search_is_bounded_in_solves_and_in_work(monkeypatch):
    turn = {"start": lambda x, before, p: [x[0], x[1] - 1], "end": lambda x, p: [x[0], x[1] + 1]}
    stages, guess = (
        [cart(4, path={"room": lambda x, p, q: 1 / 9 - x[0]}, **turn)],
        [Guess(1.0, lambda t: [0, 1 - 2 * t])],
    )
    with pytest.raises(NoOrbit, match=r"after 1 rounds: room still falls below zero .* take more intervals"):
        steer(stages, guess=guess, rounds=1)
    with pytest.raises(InputError, match="rounds = 0"):
        steer(stages, guess=guess, rounds=0)
    monkeypatch.setattr(steer_module, "STEER_OPTIONS", steer_module.STEER_OPTIONS._replace(work=1))
    with pytest.raises(NoOrbit, match="does not converge"):
        steer(stages, guess=guess)
