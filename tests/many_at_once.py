"""Shared by the tests of computations for many points in one call."""

import numpy as np
from conftest import REFERENCES, machine_of

from orbits import find
from orbits.shooting import Shooting, equations_of
from problems import Hopper
from problems.laws import springs

RANGE = np.linspace(-3, 3, 13)
MACHINES = {
    "cubic": Hopper("cubic", rest_length=30),
    "sinh in gravity": Hopper("sinh", "1/(1 + z/60)**2", rest_length=12),
    "a pole": Hopper("r/(1 - r/4)", rest_length=30),
    "bilinear": Hopper("bilinear", rest_length=30),
    "bilinear where it lifts off": Hopper(springs.bilinear(gap=1.0), rest_length=30),
    "end stops": Hopper("end_stops", rest_length=30),
    "a short table": Hopper(springs.table((RANGE, RANGE + 0.1 * RANGE**3)), rest_length=30),
}


def cubics(count: int) -> tuple[Shooting, np.ndarray, np.ndarray, int]:
    """The equations of cubic springs in varying gravity, `count` points off their orbits, with their parameters, and
    the steps that the first takes."""
    machine = machine_of(REFERENCES[4])
    equations, orbit = equations_of(machine.model, "half orbit", tuple(machine.values)), find(machine)
    xs = np.array([orbit.liftoff_extension, orbit.alpha, orbit.flight_time / 2, machine.values["beta"]])
    xs = xs * (1 + 1e-3 * np.random.default_rng(5).normal(size=(count, 4)))
    ps = np.tile(list(machine.values.values()), (count, 1))
    ps[:, list(machine.values).index("beta")] = xs[:, 3]
    path = equations.evaluate(xs[0, :3], ps[0], ("beta",)).trajectories[0]
    return equations, xs, ps, len(path.steps)
