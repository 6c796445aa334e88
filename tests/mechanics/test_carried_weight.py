"""The weight that a contact carries: by momentum the mean contact force of a motion, under constant gravity."""

import numpy as np
import pytest

from orbits import Mechanism, find, find_all, starts
from orbits.mechanics import Mass, Potential, Spring
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
    rimless_wheel,
    runner,
)

G = 9.80665  # m/s^2


def mean_force(orbit) -> float:
    """The mean contact force over a period, by Gauss's rule of 20 nodes on 400 parts of the contact."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    edges = np.linspace(orbit.flight_time, orbit.period, 401)
    half = np.diff(edges)[:, None] / 2
    times = (edges[:-1] + edges[1:])[:, None] / 2 + half * nodes
    return float((half * weights * orbit.contact_force(times)).sum()) / orbit.period


def first(machine, found):
    """The first of some orbits whose contact ends."""
    return next(orbit for orbit in find_all(machine, found) if orbit.contact_time)


# Machines with the weight of all that rises with the contact.
MACHINES = {
    "hopper": (Hopper("cubic", mass_ratio=0.4, rest_length=20, parameters={"beta": 0.3}), 1 + 1 / 0.4),
    "juggler": (Juggler("r + 0.2*r**3", mass_ratio=0.4, rest_length=20), 1 / 0.4),
    "heavy hand": (HeavyHand(), 1.0),
    "leg": (hopper_in_si(60.0, 3.0, force="8000*r + 2e6*r**3", rest_length=0.8), 63.0 * G),
    "knee": (knee_hopper(), 63.0 * G),
    "inerter": (inerter_hopper(), 2.0),
    "chain": (Chain(masses=(1.0, 2.0, 1.5)), 4.5),
    "plate": (plate_hopper(), 2.0),  # without the plate
    "chain hand": (chain_hand(), 1.0),  # of the ball
}
HOPS = {
    "chain": lambda machine: first(machine, machine.starts(5, 5)),
    "plate": lambda machine: first(machine, starts(machine, 3, 3)),
    "chain hand": lambda machine: first(machine, starts(machine, 3, 3)),
}


@pytest.mark.parametrize("name", MACHINES)
def test_it_is_the_mean_contact_force(name):
    machine, weight = MACHINES[name]
    orbit = HOPS.get(name, find)(machine)
    assert mean_force(orbit) == pytest.approx(weight, rel=1e-12)
    peak = orbit.certificate.largest_contact_force
    assert orbit.peak_force_in_weights == pytest.approx(peak / weight, rel=1e-14)


@pytest.mark.slow
def test_a_run():
    """With a foot that sticks the force is that along the vertical."""
    run = find(runner(foot_mass=0.1, rest_length=3.7), tune=("inertia", "hip_stiffness"), at={"speed": 0.4})
    assert mean_force(run) == pytest.approx(1.1, rel=1e-12)
    assert run.peak_force_in_weights == pytest.approx(run.certificate.largest_contact_force / 1.1, rel=1e-14)


def test_gravity_that_varies_counts_as_at_the_ground():
    rover = hopper_in_si(2.5, 0.5, stiffness=0.05, rest_length=0.6, surface_gravity=1e-4, body_radius=250.0)
    orbit = find(rover, 51)
    assert orbit.peak_force_in_weights == pytest.approx(orbit.certificate.largest_contact_force / 3e-4, rel=1e-14)
    assert mean_force(orbit) < 0.95 * 3e-4  # it hops 10 m high


def test_where_it_is_not_known():
    """Two points take turns; a potential holds the foot to a place."""
    masses = [Mass("body", "m"), Mass("foot", "m")]
    numbers = {"m": 1.0, "k": 1.0}
    held = Mechanism(
        ("body", "foot"),
        [*masses, Spring("body - foot", "k*r"), Potential("0.01*foot**2")],
        gap="foot",
        parameters=numbers,
    )
    for machine in (rimless_wheel(), held):
        assert machine.model.weight(machine.values) is None, machine
    # On a lever the body rises by half of the foot's rise.
    lever = Mechanism(("body", "foot"), [*masses, Spring("body - foot/2", "k*r")], gap="foot", parameters=numbers)
    assert lever.model.weight(lever.values) == 1.5
