"""The starts of a search everywhere between the bounds, against dense grids of the same designs."""

from functools import cache

import numpy as np
import pytest

from orbits import InputError, NoOrbit, optimize, sweep
from problems import Hopper

# Body and foot may be exchanged in the loss coefficient, which so has edges at both ends of the mass ratio, and the
# machine's own lies on the side of the worse one.
MACHINE = Hopper("r + beta*r**3", mass_ratio=1.5, rest_length=10.0, parameters={"beta": 0.3})
OVER = {"mass_ratio": (0.3, 2.0), "beta": (0.1, 1.0)}
ASKED = {"minimise": "loss_coefficient", "over": OVER}


@cache
def found_everywhere():
    return optimize(MACHINE, **ASKED, starts="global")


@pytest.mark.slow
def test_a_global_search_finds_the_better_of_two_edges():
    alone, everywhere = optimize(MACHINE, **ASKED, starts=1), found_everywhere()
    grid = sweep(MACHINE, OVER, (18, 10), sampling="grid", quantities=["loss_coefficient"], progress=False)
    best = int(np.nanargmin(grid["loss_coefficient"]))
    assert alone.parameters["mass_ratio"] == pytest.approx(2.0)
    assert everywhere.objective < 0.9 * alone.objective
    assert everywhere.objective == pytest.approx(grid["loss_coefficient"][best], rel=1e-9)
    assert everywhere.parameters == pytest.approx({name: grid[name][best] for name in OVER})
    assert alone.share is None
    assert "lead here" in str(everywhere)


def test_the_share_is_that_of_the_sample_on_this_side():
    """The coefficient falls away from the mass ratio 1 to either side, so that the designs below 1 lead to the lower
    edge: 0.7 of 1.7, up to what a sample of 256 and its neighbours blur."""
    assert found_everywhere().share == pytest.approx(0.7 / 1.7, abs=0.1)


def test_equal_optima_are_not_the_same():
    """Between 1/2 and 2 both edges are as good, and about half of the designs lead to each."""
    over = {"mass_ratio": (0.5, 2.0)}
    found = optimize(MACHINE, minimise="loss_coefficient", over=over, starts="global")
    assert min(abs(found.parameters["mass_ratio"] - edge) for edge in (0.5, 2.0)) < 1e-6
    assert 0.2 < found.share < 0.8


def test_a_constraint_is_met_that_only_one_corner_meets():
    found = optimize(MACHINE, **ASKED, subject_to=["stroke <= 5"], starts="global")
    grid = sweep(MACHINE, OVER, (18, 19), sampling="grid", quantities=["loss_coefficient", "stroke"], progress=False)
    allowed = grid["stroke"] <= 5 + 1e-9
    assert found.quantities["stroke"] <= 5 + 1e-6
    assert found.objective <= np.min(grid["loss_coefficient"][allowed])


def test_what_cannot_be_meant():
    with pytest.raises(InputError, match="starts = 'everywhere'; it is a number, or 'global'"):
        optimize(MACHINE, **ASKED, starts="everywhere")
    short = Hopper("r + beta*r**3", rest_length=1.0, parameters={"beta": 0.3})
    with pytest.raises(NoOrbit, match="none of 256 designs within the bounds has an orbit that is a motion"):
        optimize(short, minimise="alpha", over={"beta": (0.1, 0.2)}, starts="global")
