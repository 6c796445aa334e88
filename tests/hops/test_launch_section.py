"""Launches as points of the section on which the contact force vanishes."""

import numpy as np
import pytest
from columns import CUBIC, column

from orbits import InputError, ReturnMap, simulate
from orbits.hops import Impacts, LaunchSection
from problems import Hopper, plate_hopper


@pytest.mark.parametrize(
    ("machine", "names", "liftoff"),
    [
        (column(), ("alpha", "y1", "y1'"), lambda u: 1.0),
        (column("r", 0.1), ("alpha", "y1", "y1'"), lambda u: 1 - 0.1 * u[0]),
        (plate_hopper(), ("alpha", "plate", "plate'"), lambda u: u[1] - 100 * u[1]),
        (Hopper(damping=0.1), ("alpha",), None),
    ],
)  # fmt: skip
def test_the_unknown_that_follows(machine, names, liftoff):
    """The weight of the lowest mass on its spring; and the plate that falls as fast as the foot: phi/m2 = -psi/m3."""
    section = LaunchSection(Impacts(machine))
    assert section.names == names
    assert section.dependent == "liftoff"
    launches = np.random.default_rng(1).uniform(0.5, 2, (5, len(names)))
    ys = section.states(launches)
    assert section.free(ys) == pytest.approx(launches)
    assert section.impacts.contact.field(ys, section.impacts.p)[1][:, section.impacts.force_index] == pytest.approx(
        0, abs=1e-12
    )
    if liftoff:
        expected = [liftoff(u) for u in launches]
        assert ys[:, section.places["liftoff"]] == pytest.approx(expected, rel=1e-12)


def test_a_simulation_with_injection_is_the_map():

    machine, launch = column(CUBIC, 0.01), {"alpha": 6.2, "y1": -0.9, "y1'": 0.5}
    step, run = ReturnMap(machine, inject=0.3), simulate(machine, launch, hops=2, inject=0.3)
    second = step(step(launch).next)
    assert run.status == "done"
    assert run.launches[-1] == pytest.approx(second.next[0], rel=1e-11)
    assert sum(event.loss for event in run.events if event.kind != "lift-off") == pytest.approx(
        step(launch).loss + second.loss, rel=1e-9
    )


@pytest.mark.parametrize(
    ("machine", "launch", "wrong"),
    [
        (Hopper(), {"alpha": 4.6}, "has the numbers liftoff, alpha, but it needs 'liftoff'"),
        (column(), {"liftoff": 1.0, "alpha": 6.4, "y1": -1.2, "y1'": 1.1, "y9": 0.0}, "it has no 'y9'"),
    ],
)
def test_a_launch_that_lacks_a_number_or_has_another(machine, launch, wrong):
    with pytest.raises(InputError, match=wrong):
        simulate(machine, launch, hops=1)
