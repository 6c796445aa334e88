"""Sets of motions of an oscillator with unknown speed and duration, against cosines and sines."""

import numpy as np
import pytest
from ball_systems import oscillator
from flint import arb, ctx

# Speed and duration.
CENTRE = 1.5, 4.0


@pytest.fixture(autouse=True)
def eighty_bits():
    with ctx.workprec(80):
        yield


def followed(speed, duration, radius):
    equations = oscillator(lambda u, x, p: [x[0], x[1]])
    return equations.evaluate([arb(speed), arb(duration)], [arb(radius)] * 2, 80)


def state(speed, t):
    return [speed * t.sin(), speed * t.cos()]


def slopes(speed, t):
    """The derivatives of the final state and the duration by the speed and the duration."""
    return [[t.sin(), speed * t.cos()], [t.cos(), -speed * t.sin()], [arb(0), arb(1)]]


def assert_slopes_hold(passage, speed, duration):
    with ctx.workprec(300):
        expected = slopes(arb(speed), arb(duration))
    for row, values in zip(passage.slopes.tolist(), expected, strict=True):
        assert all(ball.contains(value) for ball, value in zip(row, values, strict=True))


@pytest.mark.parametrize("radius", [0.0, 1e-12, 1e-4])
def test_the_end_and_its_derivatives_hold_those_of_every_start(radius):
    evaluated, rng = followed(*CENTRE, radius), np.random.default_rng(2)
    (passage,) = evaluated.passages
    with ctx.workprec(300):
        centre = [*state(arb(CENTRE[0]), arb(CENTRE[1])), arb(CENTRE[1])]
    assert all(ball.contains(value) for ball, value in zip(passage.end, centre, strict=True))
    assert all(ball.contains(value) for ball, value in zip(evaluated.values, centre, strict=False))
    assert max(float(ball.rad()) for ball in passage.end) < 1e-18
    for _ in range(20):
        speed, duration = np.array(CENTRE) + radius * rng.uniform(-1, 1, 2)
        assert_slopes_hold(passage, speed, duration)
        with ctx.workprec(300):
            finish = [*state(arb(speed), arb(duration)), arb(duration)]
        assert all(ball.contains(value) for ball, value in zip(passage.finish, finish, strict=True))
    width = max(float(ball.rad()) for row in passage.slopes.tolist() for ball in row)
    assert width < 1e-6 + 20 * radius


def test_the_tubes_hold_the_motions():
    (passage,), rng = followed(*CENTRE, 1e-3).passages, np.random.default_rng(3)
    assert passage.pieces[0].begins == 0
    for piece in passage.pieces:
        for _ in range(10):
            speed, duration = np.array(CENTRE) + 1e-3 * rng.uniform(-1, 1, 2)
            t = (piece.step.h * arb(float(rng.uniform()))).mid()
            with ctx.workprec(300):
                expected = [*state(arb(speed), arb(duration) * (piece.begins + t)), arb(duration)]
            assert all(ball.contains(value) for ball, value in zip(piece.step.at(t), expected, strict=True))
    last = passage.pieces[-1]
    assert (last.begins + last.step.h).contains(arb(1))


def test_the_jacobian_of_the_equations_is_that_of_the_end():
    evaluated = followed(*CENTRE, 1e-6)
    for row, expected in zip(evaluated.slopes.tolist(), evaluated.passages[0].slopes.tolist()[:2], strict=True):
        assert all(ball.overlaps(value) for ball, value in zip(row, expected, strict=True))


def test_twenty_turns_do_not_wrap():
    """Products of enclosures would have grown by the factor sqrt 2 in each eighth of a turn."""
    duration = 40 * np.pi
    (passage,) = followed(1.5, duration, 1e-10).passages
    assert_slopes_hold(passage, 1.5, duration)
    assert max(float(ball.rad()) for row in passage.slopes.tolist() for ball in row) < 1e-5
    assert max(float(ball.rad()) for ball in passage.end) < 1e-15
