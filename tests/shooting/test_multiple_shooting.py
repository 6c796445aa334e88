"""Multiple shooting: its nodes at breakpoints, and the step that other solvers differentiate."""

import numpy as np
import pytest
from conftest import REFERENCES, machine_of

from orbits import find
from orbits.flow import flow_of
from orbits.model import Arc, Phase, Pieces, Statement
from orbits.shooting import Shooting, equations_of
from orbits.shooting.multiple_shooting import MultipleShooting


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
    lower = MultipleShooting(equations, np.array([2.3]), np.array([4.0])).lower
    assert lower[0] == pytest.approx(2.3e-3)
    assert set(lower[1:].tolist()) == {0.0, -np.inf}


@pytest.mark.parametrize("reference", [each for each in REFERENCES if each["spring"] != "r"])
def test_a_step_that_other_solvers_differentiate(reference):
    """On a mesh it leads from node to node up to a few roundings, although its order is lower than the motion's."""
    machine = machine_of(reference)
    orbit, p = find(machine, reference["family"]), machine.values
    statement = equations_of(machine.model, orbit.method, tuple(p)).statement
    known = {"liftoff": orbit.liftoff_extension, "alpha": orbit.alpha, "duration": orbit.flight_time / 2}
    (arc,), data = statement.arcs, np.array(list(p.values()))
    flow = flow_of(arc.phase, tuple(p))
    path, _ = flow.run(arc.start(known, [], p), data, known["duration"])
    shares = np.linspace(0, len(path.steps), int(1.2 * len(path.steps)) + 2)
    times = np.interp(shares, np.arange(len(path.times)), path.times)
    nodes, lengths = path(times)[:, : flow.size], np.diff(times)
    for before, after, h in zip(nodes[:-1], nodes[1:], lengths, strict=True):
        end = flow.vector_field.step(before, h, data).full().ravel()
        assert np.abs(end - after).max() <= 40 * np.finfo(float).eps * np.abs(nodes).max()
