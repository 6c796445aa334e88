"""Energy over a thousand simulated lossless hops of every machine."""

import numpy as np
import pytest

from orbits import Orbit, find, find_all, simulate, starts
from problems import (
    Chain,
    HeavyHand,
    Hopper,
    Juggler,
    chain_hand,
    hopper_in_si,
    inerter_hopper,
    knee_hopper,
    plate_hopper,
)

HOPS, MOST_DRIFT = 1000, 1e-10


def settled(machine, half_times=6.0) -> Orbit:
    """A motion of a machine with several coordinates in contact beside which launches stay: it keeps sixty hops. Beside
    others rounding grows from hop to hop, and they leave it."""
    given = (
        machine.starts(half_times, half_times)
        if isinstance(machine, Chain)
        else starts(machine, half_times, half_times)
    )
    for orbit in find_all(machine, given):
        if orbit.admissible:
            run = simulate(machine, state=orbit.flight(0.0), hops=60)
            if run.status == "done" and np.abs(run.events[-1].after - run.events[2].after).max() < 1e-9:
                return orbit
    raise AssertionError("no motion of this machine keeps its hops")


MACHINES = {
    "hopper": Hopper("cubic", mass_ratio=0.5),
    "hopper, linear": Hopper(),
    "hopper in varying gravity": Hopper("cubic", gravity="1/(1 + z/R)**2", rest_length=10, parameters={"R": 60.0}),
    "hopper in SI": hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 2e6}, rest_length=0.8),
    "juggler": Juggler("tanh"),
    "heavy hand": HeavyHand("cubic"),
    "inerter hopper": inerter_hopper(),
    "knee hopper": knee_hopper(),
    "chain": Chain((1, 1, 1), "r + b*r**3", parameters={"b": 0.01}),
    "two springs in series": Chain((1.0, 0.05, 1.0), "r + b*r**3", parameters={"b": 0.01}),
    "plate hopper": plate_hopper((1.0, 1.0, 2.0), parameters={"plate_stiffness": 5.0}),
    "chain hand": chain_hand(),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_energy_over_a_thousand_hops(name):
    machine = MACHINES[name]
    one_speed = machine.model.one_speed
    orbit = find(machine) if one_speed else settled(machine)
    launch = {"alpha": orbit.alpha} if one_speed else {"state": orbit.flight(0.0)}
    run = simulate(machine, **launch, hops=HOPS)
    assert run.status == "done"
    energies = np.array([event.energy for event in run.events])
    assert np.ptp(energies) <= MOST_DRIFT * np.abs(energies).max()
