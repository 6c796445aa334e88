"""Flow maps against closed forms, against each other, and against scipy; their derivatives against differences."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from orbits.errors import FlowError, OutOfRange
from orbits.flow.flow import Flow
from orbits.flow.vector_field import VectorField, runge_kutta
from orbits.flow.zero_crossing import first_zero
from orbits.model import Affine, Phase, Pieces, linear_modes

START, TIME = np.array([0.83, 2.93]), 2.9


def oscillator(force, **more) -> Flow:
    return Flow(Phase("flight", ("r", "v"), lambda x, p, q: [x[1], -force(x[0], p, q)], **more), ("b",))


def duffing(r, p, q):
    return r + p["b"] * r**3


def duffing_by_cases(r, p, q):
    """The same force by operations that have no Taylor series."""
    return r + p["b"] * r * r * ca.fabs(r) * ca.sign(r)


def bilinear_pieces(p):
    return [-np.inf, 1.0, np.inf], [[1.0], [p["b"]]]


def bilinear(r, p, q):
    return 1.0 + q[0] * (r - 1.0)


BILINEAR = {"pieces": Pieces((1.0, 0.0), 1, bilinear_pieces, "extension")}


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


def test_order_eight():
    x, p, h = ca.SX.sym("x", 2), ca.SX.sym("p", 0), ca.SX.sym("h")
    field = ca.Function("field", [x, p], [ca.vertcat(x[1], -ca.sin(x[0])), ca.SX(0, 1)])
    step = ca.Function("step", [x, h], [runge_kutta(VectorField(field, x, p), x, h)])
    exact = solve_ivp(lambda t, x: [x[1], -np.sin(x[0])], (0, 2), [1.0, 1.5], "DOP853", rtol=3e-14, atol=1e-15).y[:, -1]
    errors = []
    for count in (8, 16, 32):
        state = ca.DM([1.0, 1.5])
        for _ in range(count):
            state = step(state, 2 / count)
        errors.append(np.abs(np.array(state).ravel() - exact).max())
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(8, abs=0.7)


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


def test_a_flat_law_does_not_let_a_step_run_past_its_return():
    """Where tanh equals 1 to the last digit its series is a constant; the motion comes back all the same."""
    flow = oscillator(lambda r, p, q: ca.tanh(p["b"] * r) / p["b"])
    path, _ = flow.run([1.1, 30.0], [0.5], 200.0, stop=first_zero(Affine((0.0, 1.0))))
    # r' falls by 2 a unit of time once saturated; the approach adds a little
    assert path.times[-1] == pytest.approx(15.0, abs=0.1)


def test_first_zero_divides_out_the_start():
    flow = oscillator(lambda r, p, q: r)
    speed = Affine((0.0, 1.0))
    path, _ = flow.run([1.0, 0.0], [0.0], 10.0, stop=first_zero(speed, skip_start=1))
    assert path.times[-1] == pytest.approx(np.pi, abs=1e-14)


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


@pytest.mark.parametrize(
    ("force", "word"), [(lambda r, p, q: -r * r, "runs away"), (lambda r, p, q: ca.log(r - 3), "breaks down")]
)
def test_blow_up_and_nan_are_named(force, word):
    with pytest.raises(FlowError, match=word):
        oscillator(force).run(START, [0.0], 100.0)


def test_a_step_that_is_no_number_does_not_end_a_motion():
    """Of many at once, too: the coefficients of the one are too large for floating point numbers."""
    flow = oscillator(lambda r, p, q: 1e300 * r**3)
    starts, nothing = np.array([[1e-160, 0.0], [1e3, 0.0]]), np.zeros((1, 2))
    motions, _ = flow.run_all(starts[:1], np.zeros((1, 1)), np.ones(1), np.eye(2), nothing)
    assert motions.ends == [1.0]
    with pytest.raises(FlowError, match="breaks down"):
        flow.run_all(starts, np.zeros((2, 1)), np.ones(2), np.eye(2), nothing)


def test_outside_the_pieces_is_an_error_with_the_range():
    limited = Pieces((1.0, 0.0), 1, lambda p: ([-2.0, 1.0, 1.5], [[1.0], [1.0]]), "extension")
    with pytest.raises(OutOfRange, match=r"extension leaves the law's range, \[-2, 1.5\], at 1.5"):
        oscillator(bilinear, pieces=limited).run(START, [0.0], 10.0)


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


def test_a_closed_form_has_no_step_of_no_length():
    phase = Phase(
        "swing", ("x", "v"), lambda x, p, q: [x[1], -x[0]], closed_form=lambda p: linear_modes([[1.0]], [[9.81]], [0.0])
    )
    flow = Flow(phase, ())
    for n in range(1, 200):
        path, _ = flow.run([1.0, 0.0], [], n / np.sqrt(9.81))
        assert (path.steps > 0).all()
