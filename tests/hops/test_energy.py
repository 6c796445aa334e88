"""Energy over many simulated lossless hops of every machine, more where the motion has a kind of its own."""

import numpy as np
import pytest

from orbits import Orbit, find, find_all, simulate, starts
from problems import Chain, Hopper, Juggler, alternating_hopper, inerter_hopper, knee_hopper, plate_hopper

HOPS, MANY, MOST_DRIFT = 80, 200, 1e-10
LONG = ("hopper in varying gravity", "knee hopper")


def settled(machine, linear) -> Orbit:
    """The motion of a machine with several coordinates in contact that keeps its hops best, of sixty. Beside
    others rounding grows from hop to hop, until they leave it. The hops start from those with linear springs."""
    given = linear.starts(5.0, 5.0) if isinstance(linear, Chain) else starts(linear, 5.0, 5.0)
    lost = {}
    for orbit in find_all(machine, given):
        if orbit.admissible:
            run = simulate(machine, state=orbit.flight(0.0), hops=60)
            lost[max(event.loss for event in run.events) if run.status == "done" else np.inf] = orbit
    return lost[min(lost)]


def softly(chain: Chain) -> tuple[Chain, Chain]:
    """A chain whose springs harden a little, and the linear one."""
    parameters = {"b": 0.01}
    return Chain(chain.masses, "r + b*r**3", parameters=parameters), chain


MACHINES = {
    "hopper": Hopper("cubic", mass_ratio=0.5),
    "hopper in varying gravity": Hopper("cubic", gravity="1/(1 + z/R)**2", rest_length=10, parameters={"R": 60.0}),
    "juggler": Juggler("tanh"),
    "inerter hopper": inerter_hopper(),
    "knee hopper": knee_hopper(),
}
SEVERAL_SPEEDS = {
    "chain": softly(Chain((1, 1, 1))),
    "hopper on two feet": (
        alternating_hopper(3.0, spring="stiffness*r + b*r**3", parameters={"b": 1e-5}),
        alternating_hopper(3.0),
    ),
    "plate hopper": (
        plate_hopper((1.0, 1.0, 2.0), "r + b*r**3", parameters={"plate_stiffness": 5.0, "b": 0.01}),
        plate_hopper((1.0, 1.0, 2.0), parameters={"plate_stiffness": 5.0}),
    ),
}


def assert_kept(run) -> None:
    assert run.status == "done"
    energies = np.array([event.energy for event in run.events])
    assert np.ptp(energies) <= MOST_DRIFT * np.abs(energies).max()


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_energy_over_many_hops(name):
    machine = MACHINES[name]
    assert_kept(simulate(machine, find(machine).alpha, hops=MANY if name in LONG else HOPS))


@pytest.mark.slow
@pytest.mark.parametrize("name", SEVERAL_SPEEDS)
def test_energy_where_a_launch_has_several_speeds(name):
    machine, linear = SEVERAL_SPEEDS[name]
    assert_kept(simulate(machine, state=settled(machine, linear).flight(0.0), hops=HOPS))
