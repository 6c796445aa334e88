"""Motions on the pieces of a law: they enter and leave them at breakpoints, and end where no piece is left."""

import numpy as np
import pytest
from oscillators import BILINEAR, START, bilinear, oscillator

from orbits.errors import OutOfRange
from orbits.flow import Flow, Watch, first_events
from orbits.model import Affine, Phase, Pieces


def test_steps_end_on_breakpoints():
    """A bilinear spring has harmonic arcs of frequency 1 below the breakpoint and 2 above it, joined here by hand."""
    path, _ = oscillator(bilinear, **BILINEAR).run([1.0, 2.0], [4.0], 6.0)
    # above r = 1: r = 3/4 + A cos(2t - phase)
    amplitude, phase = np.hypot(0.25, 1.0), np.arctan2(1.0, 0.25)
    back = phase  # symmetric about the top at 2t = phase
    t = np.linspace(0, back, 200)
    assert path(t)[:, 0] == pytest.approx(0.75 + amplitude * np.cos(2 * t - phase), abs=1e-13)
    assert np.abs(path.times - back).min() < 1e-14
    below = np.linspace(0, 3.0, 200)
    assert path(back + below)[:, 0] == pytest.approx(np.cos(below) - 2 * np.sin(below), abs=1e-13)


def test_outside_the_pieces_is_an_error_with_the_range():
    limited = Pieces((1.0, 0.0), 1, lambda p: ([-2.0, 1.0, 1.5], [[1.0], [1.0]]), "extension")
    with pytest.raises(OutOfRange, match=r"extension leaves the law's range, \[-2, 1.5\], at 1.5"):
        oscillator(bilinear, pieces=limited).run(START, [0.0], 10.0)


def jumping(r, p, q):
    return q[1] + q[0] * r


JUMPING = Flow(
    Phase(
        "flight",
        ("r", "v"),
        lambda x, p, q: [x[1], -jumping(x[0], p, q)],
        pieces=Pieces(
            (1.0, 0.0), 2, lambda p: ([-np.inf, p["g"], np.inf], [[1.0, 0.0], [p["b"], 0.7]]), "r", lambda p: p["u"]
        ),
    ),
    ("b", "g", "u"),
)


def test_sensitivities_across_a_jump():
    """By the state at the start, and by parameters that move the jump; of one motion, and of several together."""
    p, x = np.array([2.0, 0.6, 1.3]), np.array([0.1, 1.5])
    seeds = np.eye(2, 5), np.hstack([np.zeros((3, 2)), np.eye(3)])
    _, found = JUMPING.run(x, p, 5.0, *seeds)
    point, h = np.append(x, p), 1e-5
    for j, shift in enumerate(h * np.eye(5)):
        ends = [JUMPING.run((point + side * shift)[:2], (point + side * shift)[2:], 5.0)[0].end[:2] for side in (1, -1)]
        assert found[:, j] == pytest.approx((ends[0] - ends[1]) / (2 * h), abs=1e-7)
    _, several = JUMPING.run_all(np.tile(x, (3, 1)), np.tile(p, (3, 1)), np.full(3, 5.0), *seeds)
    assert several == pytest.approx(np.tile(found, (3, 1, 1)), abs=1e-13)


@pytest.mark.parametrize("beyond", [0.0, 1e-16, -1e-16, 1e-14, -1e-12, 1e-12, 1e-9, -1e-6, 1e-4])
def test_a_breakpoint_that_is_hardly_reached(beyond):
    """Beyond r = 1 the motion is harmonic with the frequency 2, before with 1; the energy is known everywhere."""
    flow, p, height = oscillator(bilinear, **BILINEAR), np.array([4.0]), 1.0 + beyond
    for phase in (0.7, 1.9, 2.8):
        path, _ = flow.run([height * np.cos(phase), height * np.sin(phase)], p, 6.0)
        r, v = path.end[:2]
        energy = v**2 / 2 + (r**2 / 2 if r < 1 else 0.5 + (r - 1) + 2 * (r - 1) ** 2)
        assert energy == pytest.approx(height**2 / 2, rel=1e-14)
        assert len(path.steps) < 150
    at_rest = [flow.run([start, 0.0], p, 5.0)[0].end for start in (1.0, np.nextafter(1, 2), np.nextafter(1, 0))]
    assert at_rest == pytest.approx(np.tile([np.cos(5.0), -np.sin(5.0)], (3, 1)), abs=1e-13)


def test_each_motion_has_pieces_of_its_own():
    """Several motions with their own parameters, one of which leaves the range, against one motion at a time."""
    flow, starts = JUMPING, np.array([[0.1, 1.5], [-0.4, 2.0], [0.9, 0.2]])
    ps, durations = np.array([[2.0, 0.6, 1.3], [3.0, 0.1, 1.0], [1.5, 0.9, 0.7]]), np.array([5.0, 3.0, 4.0])
    paths, _ = flow.run_all(starts, ps, durations, np.zeros((2, 0)), np.zeros((3, 0)))
    for path, start, p, duration in zip(paths, starts, ps, durations, strict=True):
        one, _ = flow.run(start, p, duration)
        assert path.end == pytest.approx(one.end, abs=1e-13)
    limited = Pieces((1.0, 0.0), 1, lambda p: ([-2.0, 1.0, 1.5], [[1.0], [1.0]]), "extension")
    flow = oscillator(bilinear, pieces=limited)
    watch = Watch(flow, [Affine((1.0, 0.0))])
    times, *_, failed = first_events(flow, [[0.1, 0.3], [1.0, 2.0]], np.zeros(1), watch, 9.0)
    assert np.isfinite(times).tolist() == [True, False]
    assert isinstance(failed[1], OutOfRange)
