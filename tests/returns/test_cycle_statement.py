"""The equations of cycles of hops: solved by the map's own fixed points, with its multiplier in their derivatives."""

import numpy as np
import pytest

from orbits import ReturnMap, multiplier
from orbits.hops.impacts import Impacts
from orbits.returns.cycle_statement import INJECT, Border, bifurcation_statement, cycle_statement
from orbits.returns.flown_hops import flown_hops
from orbits.shooting.single_shooting import shooting_equations
from problems import HeavyHand, Hopper, Juggler

MACHINES = [Hopper(), Hopper("cubic", mass_ratio=2.0), Juggler(damping=0.01), HeavyHand()]


@pytest.mark.parametrize("machine", MACHINES, ids=repr)
def test_the_hops_of_the_map_solve_the_equations(machine):
    """A hop with an injection of what it loses is a cycle of one."""
    alpha, impacts = 4.7, Impacts(machine)
    hop = ReturnMap(machine)(alpha)
    equations = shooting_equations(cycle_statement(machine.model, (int(hop.impacts),)), (*machine.values, INJECT))
    p = np.array([*machine.values.values(), alpha - float(hop.next)])
    u = flown_hops(impacts, np.array([alpha])).unknowns(impacts, np.array([0]))[0]
    assert np.abs(equations.evaluate(u, p).residual).max() < 1e-12


def test_two_hops_in_a_row():
    """Hops of period two: the product of the slopes of the map is in the derivatives of all equations together."""
    eps, machine = 0.1, Hopper()
    (cycle,) = ReturnMap(machine, inject=eps).periodic_hops(2, 4.4, 4.7)
    equations = shooting_equations(cycle_statement(machine.model, cycle.impacts), (*machine.values, INJECT))
    hops = flown_hops(Impacts(machine), cycle.alphas)
    own = [hops.unknowns(Impacts(machine), np.array([i]))[0] for i in (0, 1)]
    u = np.concatenate([*(each[:2] for each in own), *(each[2:] for each in own)])
    evaluation = equations.evaluate(u, np.array([1.0, eps]))
    assert np.abs(evaluation.residual).max() < 1e-12
    # With the image of the first launch left free, its derivative by that launch is the multiplier.
    jacobian, place = evaluation.jacobian, equations.statement.unknowns.index("alpha")
    others = np.delete(np.arange(len(u)), place)
    moved = np.linalg.solve(jacobian[:-1][:, others], -jacobian[:-1, place])
    slope = jacobian[-1, others] @ moved + jacobian[-1, place] + 1.0
    assert slope == pytest.approx(np.prod([multiplier(machine, alpha) for alpha in cycle.alphas]), rel=1e-10)


def test_names_and_numbers_of_equations():
    """There are as many equations as unknowns, one of which is the parameter at a bifurcation."""
    model = Hopper().model
    for event in ("flip", "fold", Border(0, 0), Border(1, 1, "grazes"), Border(0, 0, "lossless")):
        statement = bifurcation_statement(model, (1, 2), event, INJECT)
        assert statement.unknowns[-1] == INJECT
        equations = shooting_equations(statement, ("mass_ratio", INJECT))
        rows = sum(arrival.function.size1_out(0) for _, arrival in equations.ends)
        assert rows == len(statement.unknowns)
    assert "graze" in Border(1, 1, "grazes").in_words()
    assert "lossless" in Border(0, 0, "lossless").in_words()
    assert "contact force vanishes after impact 1 of hop 1" in Border(0, 0).in_words()
