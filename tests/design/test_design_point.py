"""The outputs of several orbits together: those of each alone, also where some of them cannot be evaluated."""

import numpy as np
import pytest

from orbits import find
from orbits.design import design_point
from orbits.design.design_point import Case, Outputs, design_points
from orbits.errors import FlowError
from orbits.symbolic import parse
from problems import Hopper


def cases(*betas):
    """The rise and the loss of hops, by the stiffening and the mass ratio."""
    formulas = tuple(map(parse, ("centre_of_mass_rise", "loss_coefficient*mass_ratio")))
    machines = [Hopper("r + beta*r**3", parameters={"beta": beta}, rest_length=9.0) for beta in betas]
    return [Case(machine, find(machine), Outputs(formulas, ("beta", "mass_ratio")), {}) for machine in machines]


def test_one_that_cannot_be_evaluated_leaves_the_others(monkeypatch):
    """An error of several together: each is evaluated alone, and the error is that of one."""
    three = cases(0.1, 0.3, 0.7)
    together = design_points(three)
    evaluator = design_point.evaluator

    def failing(*arguments):
        evaluate = evaluator(*arguments)

        def call(points):
            if np.isclose(points.ps, 0.3).any():
                raise FlowError("one breaks down")
            return evaluate(points)

        return call

    monkeypatch.setattr(design_point, "evaluator", failing)
    first, second, third = design_points(three)
    assert isinstance(second, FlowError)
    for one, other in ((first, together[0]), (third, together[2])):
        assert one.values == pytest.approx(other.values, rel=1e-13)
        assert one.slopes == pytest.approx(other.slopes, rel=1e-11)
