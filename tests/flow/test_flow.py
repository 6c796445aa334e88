"""Flow maps against closed forms, against each other, and against scipy; their derivatives against differences."""

import casadi as ca
import numpy as np
import pytest
from oscillators import BILINEAR, START, TIME, bilinear, duffing, duffing_by_cases, oscillator

from orbits.errors import FlowError
from orbits.flow import Flow, first_zero
from orbits.flow.vector_field import VectorField
from orbits.model import Affine, Phase, linear_modes


def test_harmonic_motion():
    for force, more in (
        (lambda r, p, q: r, {}),
        (None, {"closed_form": lambda p: linear_modes([[1.0]], [[1.0]], [0.0])}),
    ):
        flow = oscillator(force or (lambda r, p, q: r), **more)
        path, slopes = flow.run([1.0, 2.0], [0.0], 40.0, np.eye(2))
        t = np.linspace(0, 40, 4001)
        exact = np.stack([np.cos(t) + 2 * np.sin(t), 2 * np.cos(t) - np.sin(t)], axis=1)
        assert path(t)[:, :2] == pytest.approx(exact, abs=2e-14)
        rotation = [[np.cos(40.0), np.sin(40.0)], [-np.sin(40.0), np.cos(40.0)]]
        assert slopes == pytest.approx(np.array(rotation), abs=5e-14)


@pytest.mark.parametrize(
    ("force", "more"),
    [(duffing, {}), (duffing_by_cases, {}), (bilinear, BILINEAR)],
    ids=["Taylor", "order 8", "pieces"],
)
def test_derivatives_are_those_of_the_flow(force, more):
    flow, step = oscillator(force, **more), 1e-5
    seeds = np.hstack([np.eye(2), np.zeros((2, 1))])
    _, slopes = flow.run(START, [0.3], TIME, seeds, np.array([[0.0, 0.0, 1.0]]))
    for j, direction in enumerate(([1, 0, 0], [0, 1, 0], [0, 0, 1])):
        ends = [
            flow.run(START + sign * step * np.array(direction[:2]), [0.3 + sign * step * direction[2]], TIME)[0].end
            for sign in (1, -1)
        ]
        assert slopes[:, j] == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-7, abs=1e-7)


def test_a_flat_law_does_not_let_a_step_run_past_its_return():
    """Where tanh equals 1 to the last digit its series is a constant; the motion comes back all the same."""
    flow = oscillator(lambda r, p, q: ca.tanh(p["b"] * r) / p["b"])
    path, _ = flow.run([1.1, 30.0], [0.5], 200.0, stop=first_zero(Affine((0.0, 1.0))))
    # r' falls by 2 a unit of time once saturated; the approach adds a little
    assert path.times[-1] == pytest.approx(15.0, abs=0.1)


@pytest.mark.parametrize(
    ("force", "word"), [(lambda r, p, q: -r * r, "runs away"), (lambda r, p, q: ca.log(r - 3), "breaks down")]
)
def test_blow_up_and_nan_are_named(force, word, monkeypatch):
    with pytest.raises(FlowError, match=word):
        oscillator(force).run(START, [0.0], 100.0)
    with pytest.raises(FlowError, match=r"breaks down at time 3\.87679, at r = [0-9.]*e-1"):
        oscillator(lambda r, p, q: ca.sqrt(r)).run(START, [0.0], 100.0)
    monkeypatch.setattr(VectorField, "reaches", [])  # so that a step leads beyond the singularity
    with pytest.raises(FlowError, match="where a law or the motion is not finite"):
        oscillator(lambda r, p, q: ca.sqrt(r)).run(START, [0.0], 100.0)


def test_a_step_that_is_no_number_does_not_end_a_motion():
    """Of many at once, too: the coefficients of the one are too large for floating point numbers."""
    flow = oscillator(lambda r, p, q: 1e300 * r**3)
    starts, nothing = np.array([[1e-160, 0.0], [1e3, 0.0]]), np.zeros((1, 2))
    motions, _ = flow.run_all(starts[:1], np.zeros((1, 1)), np.ones(1), np.eye(2), nothing)
    assert motions.ends == [1.0]
    with pytest.raises(FlowError, match="breaks down"):
        flow.run_all(starts, np.zeros((2, 1)), np.ones(2), np.eye(2), nothing)


def test_a_flow_cannot_start_from_nowhere():
    for start, duration in (([np.nan, 0.0], 1.0), ([0.0, 1.0], -1.0), ([0.0, 1.0], np.nan)):
        with pytest.raises(FlowError):
            oscillator(duffing).run(start, [0.3], duration)


def test_a_parameter_derivative_sees_poles_that_the_state_does_not():
    """r' = v, v' = -b (r - r^3)/(1 + r^2) at b = 0: free motion r = t, whose derivative by b is a double integral."""
    field = lambda x, p, q: [x[1], -p["b"] * (x[0] - x[0] ** 3) / (1 + x[0] ** 2)]  # noqa: E731
    flow = Flow(Phase("drift", ("r", "v"), field), ("b",))
    _, slopes = flow.run([0.0, 1.0], [0.0], 10.0, seeds=np.zeros((2, 1)), parameter_seeds=np.ones((1, 1)))
    t, w = np.polynomial.legendre.leggauss(60)
    t, w = 5 * (t + 1), 5 * w
    assert slopes[0, 0] == pytest.approx(np.sum(w * (10 - t) * -(t - t**3) / (1 + t**2)), rel=1e-12)


def test_long_motions_stay_together(monkeypatch):
    """Motions of a thousand steps, with the energy of their starts and the derivatives of one motion alone."""
    flow, p, time = oscillator(duffing), np.array([0.3]), 900.0
    starts, seeds = np.array([[1.0, 2.0], [0.5, -1.0]]), (np.eye(2), np.zeros((1, 2)))
    _, slopes = flow.run(starts[0], p, time, *seeds)
    monkeypatch.setattr(Flow, "run", None)
    motions, found = flow.run_all(starts, np.tile(p, (2, 1)), np.full(2, time), *seeds)
    assert motions.counts.min() > 512
    assert found[0] == pytest.approx(slopes, rel=1e-9)
    energies = [
        [v**2 / 2 + r**2 / 2 + 0.3 * r**4 / 4 for r, v in pair] for pair in (starts, [m.end[:2] for m in motions])
    ]
    assert energies[1] == pytest.approx(energies[0], rel=1e-12)
