"""Impacts and the contacts that may follow: many together against each alone, and closed forms."""

import numpy as np
import pytest
from many_at_once import MACHINES

from orbits import ReturnMap, simulate
from orbits.simulation.impacts import Impacts


@pytest.mark.parametrize("name", MACHINES)
def test_contacts_to_their_ends(name):
    rules = Impacts(MACHINES[name])
    speeds = np.linspace(0.05, 6, 40)
    standing = np.column_stack([np.full(40, rules.launch(speeds)[0, 0] * 0.9), -speeds])
    status, ends = rules.sustained_contacts(standing)
    for start, how, end in zip(standing, status, ends, strict=True):
        path, expected, _ = rules.sustained_contact(start)
        assert how == expected
        if how == "lifts_off":
            assert end == pytest.approx(path.end[:2], rel=1e-9, abs=1e-9)


def test_a_lift_off_on_a_break_is_not_lost():
    """The force vanishes where the law breaks: rounding on either side must not hide the sign's change."""
    rules = Impacts(MACHINES["bilinear where it lifts off"])
    hops = ReturnMap(rules.machine)(np.linspace(0.05, 3, 400))
    assert set(hops.status) <= {"lifts_off", "rests"}
    for alpha, how in list(zip(hops.alpha, hops.status, strict=True))[::40]:
        run = simulate(rules.machine, alpha, hops=2)
        assert (len(run.launches) > 1) == (how == "lifts_off")
