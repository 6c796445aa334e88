"""Enclosed hops of the linear hopper against those of the map."""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from orbits import ReturnMap, multiplier
from orbits.balls.programs import ball_of_fraction
from orbits.return_map.linear_hopper import LinearHopper
from problems import Hopper


@pytest.mark.parametrize("mass_ratio", [0.5, 1.0, 3.0])
def test_hops_in_closed_form_are_those_of_the_map(mass_ratio):
    machine, checked = Hopper(mass_ratio=mass_ratio), 0
    step = ReturnMap(machine, inject=0.125)
    with ctx.workprec(80):
        hopper = LinearHopper(*(ball_of_fraction(Fraction(each)) for each in (mass_ratio, 0.125)))
        for alpha in np.random.default_rng(3).uniform(4.2, 5.2, 12).tolist():
            following, slope = hopper.hop(arb(alpha))
            assert float(following.mid()) == pytest.approx(float(step(alpha).next), abs=1e-11)
            assert float(slope.mid()) == pytest.approx(multiplier(machine, alpha), rel=1e-7)
            wide, slopes = hopper.hop(arb(alpha, 1e-6))
            for each in (-1e-6, 0.3e-6, 1e-6):
                checked += wide.overlaps(arb(float(step(alpha + each).next), 1e-12))
            assert slopes.contains(slope)
    assert checked == 36
