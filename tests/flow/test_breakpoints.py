"""Motions on the pieces of a law: they enter and leave them at breakpoints, and end where no piece is left."""

import numpy as np
import pytest
from oscillators import BILINEAR, START, bilinear, oscillator

from orbits.errors import OutOfRange
from orbits.model import Pieces


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
