"""Optimal control: closed forms, intervals that are halved, and how failures are named."""

import casadi as ca
import mpmath as mp
import numpy as np
import pytest
from carts import EFFORT, STRAIGHT, cart

from orbits import InputError, NoOrbit, steer
from orbits.control import ELAPSED, Guess, Input, Stage
from orbits.model import Phase, Pieces


def test_least_effort_from_rest_to_rest():
    found = steer([cart()], guess=STRAIGHT)
    assert found.cost == pytest.approx(12, abs=1e-10)
    t = np.linspace(0, 1, 50)
    assert found.legs[0].inputs(t)[:, 0] == pytest.approx(6 - 12 * t, abs=1e-9)
    assert found.legs[0].path(t)[:, 0] == pytest.approx(t**2 * (3 - 2 * t), abs=1e-11)


def test_brachistochrone():
    """The heading turns evenly on a cycloid: one interval would be enough."""
    slide = Phase(
        "slide", ("x", "y", "v"), lambda x, p, q: [x[2] * ca.sin(p["a"]), x[2] * ca.cos(p["a"]), ca.cos(p["a"])]
    )
    goal = 2 - np.sin(2), 1 - np.cos(2)
    stage = Stage(
        slide, 10, (0.1, 20.0), {"a": Input(degree=1)},
        lambda x, before, p: x, lambda x, p: [x[0] - goal[0], x[1] - goal[1]], running=lambda x, p, q: 1.0,
    )  # fmt: skip
    found = steer([stage], guess=[Guess(3.0, lambda t: [t / 3, t / 2, t / 2], {"a": 0.7})])
    assert found.cost == pytest.approx(2, abs=1e-10)
    t = np.linspace(0, 2, 40)
    assert found.legs[0].path(t)[:, :2] == pytest.approx(np.column_stack([t - np.sin(t), 1 - np.cos(t)]), abs=1e-8)


def bounce(height: float, restitution: float) -> Stage:
    ball = Phase("ball", ("y", "v"), lambda x, p, q: [x[1], p["f"] - 1])
    thrust = {"inputs": {"f": Input(degree=1)}, **EFFORT}
    blow = lambda x, before, p: [x[0], x[1] + p["e"] * before[1]]  # noqa: E731
    up = Stage(ball, 3, (0.1, 9.0), start=blow, end=lambda x, p: [x[0] - height, x[1]], **thrust)
    on = lambda x, before, p: [a - b for a, b in zip(x, before, strict=True)]  # noqa: E731
    down = Stage(ball, 3, (0.1, 9.0), start=on, end=lambda x, p: [x[0]], **thrust)
    guess = [Guess(1.5, lambda t: [t, 1.0 - t]), Guess(1.5, lambda t: [1 - t, -t])]
    return steer([up, down], {"e": restitution}, guess=guess)


def test_a_bouncing_ball_is_kept_at_height():
    """Against the least effort between two states, in closed form, at the best durations and landing speed."""
    height, e = mp.mpf("1.3"), mp.mpf("0.6")

    def effort(rise, gain, time):
        return 4 * (3 * rise**2 - 3 * rise * gain * time + (gain * time) ** 2) / time**3

    def cost(first, second, speed):
        up = effort(height + first**2 / 2 - e * speed * first, first - e * speed, first)
        return up + effort(second**2 / 2 - height, second - speed, second)

    found = bounce(float(height), float(e))
    slope = lambda *u: [mp.diff(cost, u, order) for order in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]  # noqa: E731
    best = mp.findroot(slope, (*found.durations.tolist(), 1.6))
    assert found.cost == pytest.approx(float(cost(*best)), abs=1e-9)
    assert found.durations == pytest.approx([float(best[0]), float(best[1])], abs=1e-8)
    assert found.legs[1].path(found.durations[1])[1] == pytest.approx(-float(best[2]), abs=1e-8)


def test_intervals_are_halved_until_the_cost_stays():
    """Constant inputs cost 12/(1 - 1/N^2)."""
    found = steer([cart(2, degree=0)], guess=STRAIGHT, refine=1e-4)
    n = len(found.legs[0].inputs.steps)
    assert found.cost == pytest.approx(12 / (1 - n**-2), abs=1e-8)
    assert found.coarseness == pytest.approx((1 - n**-2) / (1 - 4 * n**-2) - 1, rel=1e-4)
    assert found.coarseness <= 1e-4 < 4 * found.coarseness
    assert np.isnan(steer([cart(2, degree=0)], guess=STRAIGHT).coarseness)
    with pytest.raises(InputError, match="no input 'zzz'"):
        found.schedule("zzz")


@pytest.mark.parametrize("scale", [1e-14, 1e-7, 1e6])
def test_a_cost_is_least_in_any_unit(scale):
    """Not only where it is of order one: the input of the closed form comes out of each."""
    found = steer([cart(running=lambda x, p, q: scale * p["f"] ** 2)], guess=STRAIGHT)
    assert found.cost == pytest.approx(12 * scale, rel=1e-10)
    assert found.legs[0].inputs(0.2)[0] == pytest.approx(6 - 12 * 0.2, abs=1e-7)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"parameters": {"f": 1.0}}, "both an input and a parameter"),
        ({"parameters": {"k": 1.0}, "free": {"k": (0, 1)}}, "has a value and is also free"),
        ({"free": {"k": (1, 0)}}, "parameter 'k': the lower bound 1 is above the upper bound 0"),
        ({"parameters": {"k": np.nan}}, "not a finite number"),
        ({"parameters": {"k": None}}, "parameter 'k' = None"),
        ({"free": {"k": 1}}, "parameter 'k': the bounds must be a lowest and a highest number, not 1"),
        ({"tolerance": 1e-16}, "tolerance = 1e-16; because of rounding it must be at least 1e-13"),
        ({"tolerance": 0}, "tolerance = 0"),
        ({"refine": 1e-10}, "above the tolerance"),
        ({"guess": None}, "guess = None; it must be a Guess for each stage"),
        ({"guess": [Guess(1.0, lambda t: [t, 1.0], {"g": 1.0})]}, "of the cart has an input 'g'"),
        ({"guess": []}, "the guess has 0 stages"),
        ({"guess": [Guess(1.0, lambda t: [t])]}, "the guess of the cart must have 2 numbers, x, v"),
    ],
)
def test_what_cannot_be_asked(arguments, words):
    with pytest.raises(InputError, match=words):
        steer([cart()], **{"guess": STRAIGHT, **arguments})


@pytest.mark.parametrize(
    ("stage", "words"),
    [
        (lambda: cart(low=-1.0, high=1.0), "no motion meets the conditions.*input 'f' of stage 1 is at its bounds"),
        (lambda: cart(duration=(0.1, 9.0), running=lambda x, p, q: 1.0), r"stage 1 \(cart\) collapses"),
        (lambda: cart(end=lambda x, p: [x[0] - 1, x[0] - 2]), "the condition at the end of stage 1"),
        (lambda: cart(end=lambda x, p: [], running=lambda x, p, q: -x[0]), "no lower bound"),
        (lambda: cart(duration=(0.1, np.inf), running=lambda x, p, q: -1.0), "no lower bound"),
        (lambda: cart(duration=(1.0, np.inf)), r"stage 1 \(cart\) runs away"),
        (lambda: cart(running=lambda x, p, q: ca.sqrt(x[0] - 3)), "become infinite or undefined"),
        (lambda: cart(degree=0, running=lambda x, p, q: ca.fabs(p["f"])), "no convergence.*the conditions hold"),
        (lambda: cart(1, degree=0), "more conditions than inputs can meet"),
        (lambda: cart(path={"half": lambda x, p, q: 0.5 - x[0]}), "'half'|the condition at the end"),
    ],
)
def test_what_has_no_answer(stage, words):
    with pytest.raises(NoOrbit, match=words):
        steer([stage()], guess=STRAIGHT)


def test_a_motion_that_leaves_the_range_of_a_law_is_refused_with_the_remedy():
    pieces = Pieces((1.0,), 1, lambda p: ([0.0, 1.0], [[0.0]]))
    phase = Phase("cart", ("x",), lambda x, p, q: [p["w"] + q[0]], pieces=pieces)
    ends = {"start": lambda x, before, p: x, "end": lambda x, p: [x[0] - 2.0]}
    stage = Stage(phase, 2, (1, 1), {"w": Input()}, **ends, running=lambda x, p, q: p["w"] ** 2)
    with pytest.raises(NoOrbit, match=r"cannot be followed: .* leaves the law's range, \[0, 1\], at 1; begin nearer"):
        steer([stage], guess=[Guess(1.0, lambda t: [t])])


def test_the_time_since_the_start_of_the_first_stage_is_a_number_of_conditions():
    """Two moves in three units of time together: each takes half of it, at the speed that it keeps."""
    cart = Phase("cart", ("x",), lambda x, p, q: [p["v"]])
    inputs, cost = {"v": Input()}, lambda x, p, q: p["v"] ** 2
    first = Stage(cart, 2, (0.1, 10), inputs, start=lambda x, before, p: x, end=lambda x, p: [x[0] - 1], running=cost)
    last = Stage(
        cart, 2, (0.1, 10), inputs, start=lambda x, before, p: [x[0] - before[0]],
        end=lambda x, p: [x[0] - 2, p[ELAPSED] - 3], running=cost,
    )  # fmt: skip
    found = steer([first, last], guess=[Guess(1.0, lambda t: [t]), Guess(1.0, lambda t: [1 + t])])
    assert found.durations == pytest.approx([1.5, 1.5], rel=1e-6)
    assert found.end == pytest.approx(3.0, rel=1e-12)
    assert found.cost == pytest.approx(4 / 3, rel=1e-8)
