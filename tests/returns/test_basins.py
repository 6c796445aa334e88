"""Basins as a result: what comes to a lossless hop, in the units of the machine."""

import numpy as np
import pytest
from legibility import faults

from orbits import ReturnMap, find
from orbits.returns.basins import Basins
from problems import Hopper, hopper_in_si

LEG = hopper_in_si(60.0, 3.0, stiffness=8000.0, rest_length=0.8)


@pytest.fixture(scope="module")
def of_leg():
    star = find(LEG).alpha
    return star, ReturnMap(LEG).basins(0.99 * star, 1.02 * star, samples=200)


def test_launches_of_a_basin_come_to_its_hop(of_leg):
    star, basins = of_leg
    (alpha,) = basins
    assert alpha == pytest.approx(star, rel=1e-12)
    step, launches = ReturnMap(LEG), np.array([0.3 * a + 0.7 * b for a, b in basins[alpha]])
    for _ in range(150):
        launches = step(launches).next
    assert launches == pytest.approx(star, rel=1e-3)
    assert (launches >= star * (1 - 1e-12)).all()


def test_the_table_and_the_share(of_leg, tmp_path):
    star, basins = of_leg
    table = basins.table()
    length = np.sum(np.subtract(table["to"], table["from"]))
    assert basins.share == pytest.approx(length / (0.03 * star))
    assert basins.heading("from") == "from (m/s)"
    assert Basins.load(basins.save(tmp_path / "basins.json")) == basins
    axes = basins.plot()
    bars = sum(path.get_extents().width for bar in axes.collections for path in bar.get_paths())
    assert bars == pytest.approx(length)
    assert not faults(axes.figure)


def test_where_nothing_comes_to_a_lossless_hop():
    basins = ReturnMap(Hopper()).basins(1.0, 1.2, samples=50)
    assert (dict(basins), basins.share) == ({}, 0.0)
    assert "0.000% come" in str(basins)
    basins.plot()
