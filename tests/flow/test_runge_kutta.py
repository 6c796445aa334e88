"""Runge-Kutta steps of a law without a series, against Taylor steps and scipy."""

import numpy as np
import pytest
from oscillators import START, TIME, duffing, duffing_by_cases, oscillator
from scipy.integrate import solve_ivp


def test_taylor_and_runge_kutta_agree_everywhere_with_scipy():
    first, second = oscillator(duffing), oscillator(duffing_by_cases)
    assert (first.method, second.method) == ("Taylor", "Runge-Kutta")
    a, da = first.run(START, [0.3], TIME, np.eye(2))
    b, db = second.run(START, [0.3], TIME, np.eye(2))
    t = np.linspace(0, TIME, 501)
    assert a(t) == pytest.approx(b(t), abs=2e-13)
    assert da == pytest.approx(db, abs=2e-12)
    reference = solve_ivp(
        lambda t, x: [x[1], -x[0] - 0.3 * x[0] ** 3], (0, TIME), START, "DOP853", t, rtol=1e-13, atol=1e-14
    )
    assert a(t)[:, :2] == pytest.approx(reference.y.T, abs=1e-10)
