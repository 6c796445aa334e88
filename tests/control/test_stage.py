"""Stages that cannot be meant are refused."""

from dataclasses import replace

import numpy as np
import pytest
from carts import STRAIGHT, cart

from orbits import InputError, steer
from orbits.control import Input, Stage
from orbits.model import Phase


@pytest.mark.parametrize(
    ("stage", "words"),
    [
        (lambda: cart(duration=(0.0, 1.0)), "is 0; it must be above 0"),
        (lambda: cart(duration=(2.0, 1.0)), "duration: the lower bound 2 is above"),
        (lambda: cart(low=1.0, high=-1.0), "input 'f': the lower bound 1 is above the upper bound -1"),
        (lambda: cart(intervals=0), "at least 1"),
        (lambda: cart(degree=-1), "at least 0"),
        (lambda: cart(running=lambda x, p, q: p["price"]), "'price'"),
        (lambda: cart(intervals="a"), "intervals = 'a'"),
        (
            lambda: Stage(Phase("cart", ("x", "time"), lambda x, p, q: [x[1], 1]), 4, (1.0, 1.0)),
            "'time' is a column of the motion's table already; rename",
        ),
        (lambda: replace(cart(), inputs={"running cost": Input()}), "'running cost' is a column"),
        (lambda: cart(intervals=np.inf), "intervals = inf"),
        (lambda: cart(duration=2.0), "a lowest and a highest number, not 2.0"),
        (
            lambda: Stage(Phase("cart", ("x", "v"), lambda x, p, q: [x[1]]), 4, (1.0, 1.0)),
            "the field of the cart gives 1 rates for 2 states",
        ),
    ],
)
def test_what_cannot_be_meant(stage, words):
    with pytest.raises(InputError, match=words):
        steer([stage()], guess=STRAIGHT)
