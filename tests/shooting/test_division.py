"""Motions divided at nodes: against a closed form where small changes grow beyond all digits, and whole motions."""

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipkm1

from orbits import NoOrbit, find
from orbits.model import Arc, Phase, Statement
from orbits.shooting import Shooting, division_at, division_of, equations_of, growths_along, with_nodes
from orbits.shooting.node_places import GrowthAlong, even
from problems import Chain, Hopper

CHAIN = Chain([1.0, 1.0, 1.0], "r + b*r**3", parameters={"b": -0.001})
START = {"liftoff": 1.0, "alpha": 4.99896, "y1": 1.929151, "y1'": 8.466078, "duration": 4.488346,
         "contact_duration": 3.104718}  # fmt: skip


def swing():
    """A pendulum from its lowest place, -pi, to rest near its highest one, 0, in a stated time."""
    phase = Phase("swing", ("x", "w"), lambda x, p, q: [x[1], ca.sin(x[0])])
    arc = Arc(
        phase,
        start=lambda u, before, p: [-np.pi, u["speed"]],
        duration=lambda u, p: p["t"],
        conditions=lambda u, x, p: [x[1]],
    )
    return Shooting(Statement("swing", ("speed",), (arc,)), ("t",))


@pytest.mark.slow
def test_a_pendulum_near_the_separatrix():
    """A quarter of its period is K(m), with 1 - m = sin(x/2)**2 at the angle x from the top where it turns. After 60
    units of time a change has grown 3e25-fold."""
    equations = swing()
    u, evaluation = equations.newton([1.999], np.array([8.0]))
    division = division_of(equations, (even(16),))
    x = division.lifted(u, evaluation[0].trajectories)
    for t in np.arange(10.0, 61.0, 2.0):
        x, _ = division.equations.newton(x, np.array([t]))
    found = division.equations.evaluate_all(x[None], np.array([[60.0]]))
    complement = np.exp(brentq(lambda log: ellipkm1(np.exp(log)) - 60.0, -150.0, -1.0, xtol=1e-14))
    whole = division.whole(found)
    assert -whole.trajectories[0].finals[0, 0] == pytest.approx(2 * np.arcsin(np.sqrt(complement)), rel=1e-12)
    assert x[0] == pytest.approx(2 * np.sqrt(1 - complement), rel=1e-15)
    # The change of the end's speed by that of the launch is the growth of a change, and no arc amplifies so much.
    assert division.growths(found)[0, 0] == pytest.approx(whole.jacobian[0, 0, 0], rel=1e-12)
    assert whole.jacobian[0, 0, 0] > 1e25
    assert whole.amplification < 100


@pytest.mark.parametrize(("parts", "chain"), [((4,), False), ((3, 2), True), ((1, 5), True)])
def test_divided_motions_are_whole_ones(parts, chain):
    """All derivatives of motions that amplify little are those without nodes."""
    machine = CHAIN if chain else Hopper("cubic", parameters={"beta": -0.005})
    equations = equations_of(machine.model, "half orbit", names := tuple(machine.values))
    orbit, p = find(machine, start=START if chain else None), np.array([*machine.values.values()])
    known = {"liftoff": orbit.liftoff_extension, "alpha": orbit.alpha, "duration": orbit.flight_time / 2}
    known |= {"contact_duration": orbit.contact_time / 2, "y1": orbit(0.0)[0], "y1'": orbit(0.0)[1]}
    u = np.array([known[name] for name in equations.statement.unknowns])
    vary = (names[-1],)
    plain = equations.evaluate_all(u[None], p[None], vary)
    division = division_of(equations, tuple(map(even, parts)))
    x = division.lifted(u, plain[0].trajectories)
    nodes = division.equations.evaluate_all(x[None], p[None], vary)
    found = division.whole(nodes)
    assert np.abs(nodes.residual).max() < 1e-12
    assert division.bare(x) == pytest.approx(u, abs=0)
    assert found.jacobian == pytest.approx(plain.jacobian, rel=1e-9, abs=1e-9)
    by_nodes, by_steps = growths_along(nodes, parts), growths_along(plain, [1] * len(parts))
    assert [each.growths[-1] for each in by_nodes] == pytest.approx([each.growths[-1] for each in by_steps], rel=1e-10)
    assert division.growths(nodes)[0] == pytest.approx([each.growths.max() for each in by_nodes], rel=1e-12)
    for one, other in zip(found.trajectories, plain.trajectories, strict=True):
        times = np.linspace(0, other.ends[0], 40)
        assert one[0](times) == pytest.approx(other[0](times), abs=1e-11)
    for name in ("transitions", "starts", "residual_by_end"):
        for one, other in zip(getattr(found, name), getattr(plain, name), strict=True):
            assert one == pytest.approx(other, rel=1e-9, abs=1e-9)


def test_known_solutions_with_nodes_are_joined_with_others():
    """Of a quadratic spring, where the flight stays near the barrier at -1/c; without nodes the derivatives at landing
    lose their digits there."""
    machine = Hopper("r + c*r**2", parameters={"c": -0.022})
    equations = equations_of(machine.model, "relative", tuple(machine.values))
    p = np.array([*machine.values.values()])
    alphas = np.array([4.583807109887378, 26.223545859854912])  # two orbits of the family
    liftoff = (np.sqrt(1 + 4 * -0.022) - 1) / (2 * -0.022)
    us, ps = np.column_stack([np.full(2, liftoff), alphas]), np.tile(p, (2, 1))
    plain = equations.evaluate_all(us, ps)
    found = with_nodes(equations, us, ps, plain)
    assert plain.amplification[1] > 1e9
    assert found.amplification.max() < 1e5
    assert found.trajectories[0].ends == pytest.approx(alphas, rel=1e-15)
    assert with_nodes(equations, us[:1], ps[:1], plain[np.array([0])]).parts == ()
    assert found.trajectories[0].finals[1, 1] == pytest.approx(0.0, abs=1e-12)


def test_what_grows_within_a_short_time_is_not_divided():
    u, p, along = np.array([2.0]), np.array([1.0]), GrowthAlong(np.array([0.0, 1.0]), np.array([1.0, 1e305]))
    with pytest.raises(NoOrbit, match="small changes grow 1e\\+305-fold, mostly within a short time"):
        division_at(swing(), [along], u, p, swing().evaluate(u, p).trajectories)
