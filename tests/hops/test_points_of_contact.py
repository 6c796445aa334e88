"""Machines that step: lossless steps without end, their labels, and the feet named by events."""

import numpy as np
import pytest
from plane import wheel
from steps import by_hand, start_of, stepping

from orbits import find, simulate

MU, KAPPA, A = 1.0, 0.5, 0.3
KINDS = ("wheel", "rocker", "shuttle")


@pytest.mark.parametrize(
    ("kind", "statement", "steps"),
    [
        *((kind, statement, 8) for kind in KINDS for statement in ("by hand", "nearly straight", "sine")),
        pytest.param("wheel", "sine", 300, marks=pytest.mark.slow),
    ],
)
def test_energy_and_steps_last(kind, statement, steps):
    angle = A if statement == "sine" else None
    machine = by_hand(kind)(MU, KAPPA) if statement == "by hand" else stepping(kind, MU, KAPPA, angle)
    orbit = find(machine, start=start_of(kind, MU, KAPPA, 1, angle or 1.0))
    run = simulate(machine, orbit.alpha, hops=steps)
    energies = np.array([event.energy for event in run.events])
    assert np.ptp(energies) < 1e-10 * abs(energies[0])
    assert run.launches == pytest.approx(orbit.alpha, rel=1e-10)
    assert [event.kind for event in run.events].count("landing") == steps == run.legs[-1].stance


@pytest.mark.slow
def test_events_name_their_feet():
    machine = wheel(MU, KAPPA, A, friction=0.3)
    run = simulate(machine, find(machine).alpha, hops=1)
    assert [(event.kind, event.foot) for event in run.events] == [
        ("slides", "standing foot"), ("landing", "front foot"), ("lift-off", "rear foot"),
    ]  # fmt: skip
    first = run.events[0]
    normal, along = run.legs[0].path(first.time)[4:6]
    assert abs(along) == pytest.approx(0.3 * normal, rel=1e-10)
    run = simulate(wheel(MU, 0.05, A, friction=10.0), 2.0, time=1.0)
    lifts = next(event for event in run.events if event.kind == "lifts")
    assert run.legs[0].path(lifts.time)[4] == pytest.approx(0.0, abs=1e-10)
