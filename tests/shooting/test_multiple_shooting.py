"""Multiple shooting: its nodes at breakpoints, and the step that other solvers differentiate."""

import casadi as ca
import numpy as np
import pytest

from orbits import find
from orbits.model import Arc, Phase, Pieces, Statement
from orbits.shooting import Shooting
from orbits.shooting.multiple_shooting import on_mesh
from problems import Hopper, springs


def test_breakpoints_are_nodes_of_the_multiple_shooting():
    """A bilinear oscillator from -1 to rest on the other side: known arcs of circles."""
    pieces = Pieces((1.0, 0.0), 1, lambda p: ([-np.inf, 0.0, np.inf], [[1.0], [p["k"]]]), "extension")
    phase = Phase("swing", ("x", "v"), lambda x, p, q: [x[1], -q[0] * x[0]], pieces=pieces)
    arc = Arc(
        phase,
        start=lambda u, before, p: [-1.0, 0.0],
        duration=lambda u, p: u["half"],
        conditions=lambda u, x, p: [x[1]],
    )
    equations = Shooting(Statement("swing", ("half",), (arc,), ("half",)), ("k",))
    for solver in (equations.newton, equations.multiple_shooting):
        assert solver([2.3], np.array([4.0]))[0] == pytest.approx([0.75 * np.pi], rel=1e-13)
    # A duration keeps a thousandth of its guess, so that no arc collapses; the times of legs and the states are free.
    legs, _, lower, *_ = on_mesh(equations, np.array([2.3]), np.array([4.0]))
    assert [len(each) for each in legs] == [2]
    assert lower[0] == pytest.approx(2.3e-3)
    assert set(lower[1:].tolist()) == {0.0, -np.inf}


@pytest.mark.parametrize(("spring", "name"), [("cubic", "beta"), (springs.bilinear(), "gap")])
def test_machines_with_other_values_share_a_program(spring, name, monkeypatch):
    machine = Hopper(spring, rest_length=30.0, parameters={name: 0.5})
    other = machine.with_values(**{name: 0.501})
    find(machine, method="shooting")
    monkeypatch.setattr(ca, "nlpsol", None)
    assert find(other, method="shooting").alpha == pytest.approx(find(other).alpha, rel=1e-13)
