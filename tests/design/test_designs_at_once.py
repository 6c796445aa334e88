"""Many designs together: their quantities, and none that is left to be solved alone."""

import numpy as np
import pytest

from orbits import find, quantities, sweep
from tests.sweeps.swept import CASES


@pytest.mark.parametrize("case", ["cubic", "linear", "juggler", "varying gravity", "SI"])
def test_members_are_solved_together(case, monkeypatch):
    """None of these is left to be asked for alone."""
    machine, over, family = CASES[case]
    monkeypatch.setattr("orbits.design.designs_at_once.find", lambda *arguments: pytest.fail("asked for alone"))
    assert np.isfinite(sweep(machine, over, 40, family=family)["alpha"]).all()


def test_quantities_are_those_of_quantities():
    names = ["stroke", "largest_spring_force", "centre_of_mass_rise", "landing_sensitivity", "period", "beta*stroke**2"]
    found = sweep(CASES["cubic"][0], CASES["cubic"][1], 6, quantities=names)
    for i in range(6):
        machine = CASES["cubic"][0].with_values(**{name: float(found[name][i]) for name in CASES["cubic"][1]})
        expected = quantities(machine, find(machine), names)
        for name in names:
            assert found[name][i] == pytest.approx(expected[name], rel=1e-9), name
