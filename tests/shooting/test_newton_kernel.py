"""Newton's method in lanes against the same one after the other."""

import numpy as np
import pytest
from conftest import REFERENCES, machine_of
from many_at_once import cubics

from orbits.continuation.corrector import correct_all
from orbits.continuation.curve import Curve
from orbits.errors import FlowError
from orbits.shooting.newton_kernel import NewtonKernel


def test_newton_steps_in_lanes_and_one_after_the_other(monkeypatch):
    """Points that need different numbers of steps, some at values of the parameter; and what lanes cannot solve."""
    curve = Curve(machine_of(REFERENCES[4]), "beta", "half orbit", 1.0)
    _, xs, _, _ = cubics(9)
    xs[4] = xs[2] * (1 + 3e-3)
    rows = np.tile(np.eye(4)[3], (9, 1))
    rows[::2] = [0.1, 1.0, 0.0, 0.5]
    levels = np.einsum("mi,mi->m", rows, xs)
    before = np.tile(np.eye(4)[3], (9, 1))
    solve, found = NewtonKernel.__call__, []
    monkeypatch.setattr(NewtonKernel, "__call__", lambda *arguments: found.append(solve(*arguments)) or found[-1])
    lanes = correct_all(curve, xs, rows, levels, before)
    assert found[0].which.tolist() == list(range(9))
    nothing = found[0]._replace(which=np.zeros(0, int))
    monkeypatch.setattr(NewtonKernel, "__call__", lambda *arguments: nothing)
    steps = correct_all(curve, xs, rows, levels, before)
    for one, other, row, level in zip(lanes, steps, rows, levels, strict=True):
        assert one.x == pytest.approx(other.x, rel=1e-13)
        assert one.tangent == pytest.approx(other.tangent, rel=1e-7)
        assert one.branch_test == pytest.approx(other.branch_test, rel=1e-7)
        assert row @ one.x == pytest.approx(level, rel=1e-14)
    assert [point.value for point in lanes[1::2]] == levels[1::2].tolist()
    here, there = lanes[0].evaluation, steps[0].evaluation
    assert np.abs(here.residual).max() < 1e-13
    assert here.jacobian == pytest.approx(there.jacobian, rel=1e-6, abs=1e-7)
    for some, others in zip(here.trajectories[0], there.trajectories[0], strict=True):
        assert some.times[-1] == pytest.approx(others.times[-1], rel=1e-13)
        assert some(0.5 * some.times[-1])[:4] == pytest.approx(others(0.5 * some.times[-1])[:4], abs=1e-12)
    monkeypatch.setattr(NewtonKernel, "__call__", lambda *arguments: found.append(solve(*arguments)) or found[-1])
    xs[3, 2] = -1.0
    with pytest.raises(FlowError, match="cannot start"):
        correct_all(curve, xs, rows, levels, before)
    assert 3 not in found[1].which
