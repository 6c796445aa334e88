"""The curve of hops that repeat themselves in all of their unknowns: against hops of the map one by one, differences of
its equations, and the curve of the launch speed alone."""

import numpy as np
import pytest

from orbits.continuation.point import End
from orbits.curves import Border, solved_at
from orbits.returns.branches import BranchTracer
from orbits.returns.cycle_curve import CycleCurve
from orbits.returns.cycles import MapsAlong
from problems import Hopper, hopper_in_si

SI = hopper_in_si(2.0, 2.0, stiffness=100.0, rest_length=2.0)
UNIT = SI.units.of("alpha")


def curve_at(machine, name, span, value, alpha, inject, period):
    """The maps, the curve and its point at a value of the parameter near a launch speed."""
    maps = MapsAlong(machine, name, *span, inject, 1000)
    launches = BranchTracer(maps, (0.9 * alpha, 1.1 * alpha), period, (), 0.02).curve
    row = np.array([0.0, 1.0])
    launch = launches.near(np.array([alpha, value]), row, row)
    curve = CycleCurve(launches, launch.impacts)
    return maps, curve, curve.begin(launch)


@pytest.mark.parametrize(
    ("machine", "name", "span", "value", "alpha", "inject", "period"),
    [
        (Hopper(), "mass_ratio", (0.9, 1.1), 1.0, 4.5, 0.1, 2),
        (Hopper(), "inject", (0.08, 0.13), 0.1, 4.5, 0.0, 2),
        (Hopper(damping=0.001), "damping", (0.0, 0.007), 0.001, 4.479, 0.1, 1),  # with two impacts
        (SI, next(n for n in SI.values if "stiffness" in n), (90.0, 110.0), 100.0, 4.5 * UNIT, 0.1 * UNIT, 2),
    ],
)
def test_the_equations_and_their_derivatives(machine, name, span, value, alpha, inject, period):
    maps, curve, point = curve_at(machine, name, span, value, alpha, inject, period)
    (x,) = point.xs
    launches, impacts = maps.cycles(x[curve.speeds[:1]], value, period)
    assert x[curve.speeds] == pytest.approx(launches[0, :-1], rel=1e-11)
    assert launches[0, -1] == pytest.approx(launches[0, 0], rel=1e-11)
    assert curve.impacts == (*impacts[0].tolist(),)
    equations = lambda xs: curve.evaluate(np.zeros(len(xs), int), xs)[1]  # noqa: E731
    assert equations(x[None]).residual == pytest.approx(0.0, abs=1e-10)
    x = x + 1e-3 * np.random.default_rng(3).uniform(-1, 1, len(x)) * x
    steps = 1e-6 * np.abs(x)
    low, high = (equations(x + side * np.diag(steps)).residual for side in (-1, 1))
    assert equations(x[None]).jacobian[0] == pytest.approx(((high - low) / (2 * steps[:, None])).T, rel=1e-5, abs=1e-5)


def test_points_of_a_branch_are_those_in_the_launch_speed_alone():
    """Whose first step is too short for the curve in all unknowns."""
    maps, _, point = curve_at(Hopper(), "damping", (0.0, 0.0008), 0.0, 4.5, 0.1, 2)
    tracer = BranchTracer(maps, (4.3, 4.8), 2, (0.0004,), 0.1)
    start = tracer.start(point.own[0].alpha, 0.0)
    *points, end = tracer.trace(start, 1)
    *others, other_end = tracer.trace(start, 1, first_step=5e-5)
    assert isinstance(end, End)
    assert (end.kind, end.reason) == (other_end.kind, other_end.reason)
    (a,), (b,) = ([p for p in some if p.value == 0.0004] for some in (points, others))
    assert (a.alphas, a.multiplier) == (pytest.approx(b.alphas, rel=1e-11), pytest.approx(b.multiplier, rel=1e-8))
    for point in points[::8]:
        assert maps.excess(np.array([point.alpha]), point.value, 2) == pytest.approx(0.0, abs=1e-9)
        assert maps.multiplier(point.alphas, point.value) == pytest.approx(point.multiplier, rel=1e-8)


def test_hops_with_other_impacts_are_refused():
    """Beyond the launch at which the contact force vanishes after the impact, at 4.49622."""
    _, curve, point = curve_at(Hopper(), "damping", (0.0, 0.007), 0.0057, 4.4992, 0.1, 1)
    assert curve.impacts == (1,)
    zero = np.zeros(1, int)
    for alpha, count in ((4.4965, 1), (4.4960, 0)):
        border = Border.of_component(curve.speed, np.array([alpha]), point.xs.shape[1])
        found = solved_at(curve, zero, point.xs, border, point.tangents, curve.steps)
        assert [launch.alpha for launch in found.own[: len(found)]] == [alpha] * count
