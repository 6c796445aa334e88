"""Newton's method in lanes against the same one after the other."""

import numpy as np
import pytest
from conftest import REFERENCES, machine_of
from many_at_once import cubics

from orbits.continuation import Options
from orbits.continuation.curve import Curve
from orbits.continuation.family_problem import FamilyProblem
from orbits.curves import BRANCH, Border, correct
from orbits.shooting import NewtonKernel, equations_of
from orbits.symbolic.machine_code import MachineCode
from problems import Hopper, springs


def test_newton_steps_in_lanes_and_one_after_the_other(monkeypatch):
    """Points that need different numbers of steps, some at values of the parameter; and what lanes cannot solve."""
    problem = FamilyProblem(Curve(machine_of(REFERENCES[4]), "beta", "half orbit", 1.0), Options())
    _, xs, _, _ = cubics(9)
    xs[4] = xs[2] * (1 + 3e-3)
    rows = np.tile(np.eye(4)[3], (9, 1))
    rows[::2] = [0.1, 1.0, 0.0, 0.5]
    levels = np.einsum("mi,mi->m", rows, xs)
    before = np.tile(np.eye(4)[3], (9, 1))
    solve, found = NewtonKernel.__call__, []
    monkeypatch.setattr(NewtonKernel, "__call__", lambda *arguments: found.append(solve(*arguments)) or found[-1])
    along = np.zeros(9, int)
    _, lanes = correct(problem, along, xs, Border(rows, levels), before, problem.steps)
    assert found[0].which.tolist() == list(range(9))
    nothing = found[0]._replace(which=np.zeros(0, int))
    monkeypatch.setattr(NewtonKernel, "__call__", lambda *arguments: nothing)
    _, steps = correct(problem, along, xs, Border(rows, levels), before, problem.steps)
    assert lanes.xs == pytest.approx(steps.xs, rel=1e-13)
    assert lanes.tangents == pytest.approx(steps.tangents, rel=1e-7, abs=1e-9)
    assert BRANCH.values(problem, lanes) == pytest.approx(BRANCH.values(problem, steps), rel=1e-7)
    assert np.einsum("mi,mi->m", rows, lanes.xs) == pytest.approx(levels, rel=1e-14)
    assert lanes.values[1::2].tolist() == levels[1::2].tolist()
    here, there = lanes.evaluation, steps.evaluation
    assert np.abs(here.residual).max() < 1e-13
    assert here.jacobian == pytest.approx(there.jacobian, rel=1e-6, abs=1e-7)
    for some, others in zip(here.trajectories[0], there.trajectories[0], strict=True):
        assert some.times[-1] == pytest.approx(others.times[-1], rel=1e-13)
        assert some(0.5 * some.times[-1])[:4] == pytest.approx(others(0.5 * some.times[-1])[:4], abs=1e-12)
    monkeypatch.setattr(NewtonKernel, "__call__", lambda *arguments: found.append(solve(*arguments)) or found[-1])
    xs[3, 2] = -1.0
    which, _ = correct(problem, along, xs, Border(rows, levels), before, problem.steps)
    assert 3 not in found[1].which
    assert which.tolist() == [0, 1, 2, 4, 5, 6, 7, 8]


def test_the_code_does_not_grow_with_the_breakpoints():
    """They are counted in a loop over an argument of their own, which a smooth field does not have."""

    def kernel_of(law):
        machine = Hopper(law, rest_length=10)
        return NewtonKernel(equations_of(machine.model, "half orbit", tuple(machine.values)), "mass_ratio").kernel

    places = [np.linspace(-12, 12, rows) for rows in (160, 320)]
    few, many = (kernel_of(springs.table((r, r + 0.3 * r**3), noise=0)) for r in places)
    assert (few.sizes_in[2], many.sizes_in[2]) == (160, 320)
    assert [*few.sizes_in[:2], *few.sizes_in[3:]] == [*many.sizes_in[:2], *many.sizes_in[3:]]
    short, long = (len(MachineCode(each.source, each.row_entry).compiled) for each in (few, many))
    assert long - short < 160  # bytes: no instruction for each of them
    assert len(kernel_of("cubic").sizes_in) == 2
