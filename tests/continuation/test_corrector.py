"""The corrector: many points against each alone, a step along a curve, and what goes on where Newton fails."""

import numpy as np
import pytest
from families import GOLDEN
from many_at_once import cubics

from orbits import NoOrbit, follow
from orbits.continuation.corrector import correct, newton_steps, predict_and_correct
from orbits.continuation.curve import Curve, interpolated
from orbits.shooting.single_shooting import Shooting, joined
from problems import Hopper


def test_ipopt_goes_on_where_newton_fails(monkeypatch):
    """A corrector that fails in a window but for a given value of the parameter."""

    def failing(curve, ends, length, value=None):
        if 0.2 < ends[-1].value < 0.6 and value is None and len(solved) < 1:
            raise NoOrbit("the corrector does not converge")
        return predict_and_correct(curve, ends, length, value)

    solved = []
    solve = Shooting.multiple_shooting
    monkeypatch.setattr("orbits.continuation.step_control.predict_and_correct", failing)
    monkeypatch.setattr(Shooting, "multiple_shooting", lambda *a: solved.append(a) or solve(*a))
    family = follow(Hopper("cubic"), "beta", 1.0, 0.0)
    assert len(solved) == 1
    assert family.end.kind == "reached"
    assert family[-1].alpha == pytest.approx(GOLDEN[1.0], rel=1e-13)


def test_newton_steps_of_many_points():
    """In one call and one by one; both lead to where the equations hold to second order."""
    equations, xs, ps, _ = cubics(9)
    rows = np.random.default_rng(6).normal(size=xs.shape)
    targets = np.einsum("mi,mi->m", rows, xs) + 1e-6
    found = newton_steps(equations.evaluate_all(xs[:, :3], ps, ("beta",)), xs, rows, targets)
    there = joined([equations.evaluate_all(x[None], p[None], ("beta",)) for x, p in zip(xs[:, :3], ps, strict=True)])
    steps, directions = newton_steps(there, xs, rows, targets)
    assert found[0] == pytest.approx(steps, rel=1e-10)
    assert found[1] == pytest.approx(directions, rel=1e-10)
    assert np.einsum("mi,mi->m", rows, xs + steps) == pytest.approx(targets, rel=1e-12)
    betas = ps.copy()
    betas[ps == xs[:, 3:]] = (xs + steps)[:, 3]
    after = equations.evaluate_all((xs + steps)[:, :3], betas)
    for i in range(9):
        assert after.residual[i] == pytest.approx(np.zeros(3), abs=30 * np.max(np.abs(steps[i])) ** 2)


def test_a_step_along_a_curve_at_once():
    """A step in one call, against the interpolant and the corrector that it is made of."""
    curve = Curve(Hopper("cubic"), "beta", "relative", 1.0)
    row = np.array([0.0, 0.0, 1.0])
    ends = [correct(curve, np.array([1.0, 4.49, 0.0]), row, 0.0, row)]
    for beta in (0.01, 0.03, 0.05, 0.08):
        ends.append(correct(curve, ends[-1].x, row, beta, row))
        for value in (None, beta + 0.04):
            end, guess, rests = predict_and_correct(curve, ends[-4:], 0.05, value)
            last = ends[-1]
            measure = last.tangent / curve.size(last.x) ** 2
            level = measure @ last.x + 0.05
            closing, target = (measure, level) if value is None else (row, value)
            assert rests == min(len(ends), 4)
            assert closing @ guess == pytest.approx(target, rel=1e-13)
            if value is None:
                assert guess == pytest.approx(interpolated(ends[-4:], measure, np.array([level]))[0], rel=1e-13)
            one = correct(curve, guess, closing, target, last.tangent)
            assert end.x == pytest.approx(one.x, rel=1e-13)
            # Both tangents, and the growth at this end, are those before the last Newton step.
            assert end.tangent == pytest.approx(one.tangent, rel=1e-8)
            assert end.amplification == pytest.approx(one.amplification, rel=1e-8)
