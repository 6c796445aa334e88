"""Shared by the tests of launches of several numbers: columns of three masses, and their hops by other means."""

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

from orbits import Mechanism, find
from orbits.mechanics import Damper, Mass, Spring
from problems import chain_hand, plate_hopper

CUBIC, NAMES = "r + 0.02*r**3", ("y1", "y2", "y3")


@cache
def column(spring="r", damping=0.0, **more) -> Mechanism:
    """Three equal masses in a column, with dampers beside its springs."""
    springs = [Spring("y1 - y2", spring), Spring("y2 - y3", spring)]
    dampers = [Damper("y1 - y2", "c"), Damper("y2 - y3", "c")] if damping else []
    elements = [*(Mass(name, 1.0) for name in NAMES), *springs, *dampers]
    return Mechanism(
        NAMES, elements, gap="y3", gravity=1.0, name="column", parameters={"c": damping} if damping else {}, **more
    )


STARTS = {
    "column": {"liftoff": 1.0, "alpha": 6.3479, "y1": -1.2703, "y1'": 1.0312, "duration": 2.4597},
    "cubic column": {"liftoff": 0.9811, "alpha": 6.2939, "y1": -0.9023, "y1'": 0.4999, "duration": 2.2646},
    "plate": {"liftoff": 0.6523, "alpha": 6.4179, "plate": -0.0066, "plate'": 0.0412, "duration": 3.2296},
    "chain_hand": {"liftoff": -1.3598, "alpha": 2.8888, "y3": -1.3598, "y3'": -14.0162, "duration": 2.8888},
}
CONTACTS = {"column": 3.2218, "cubic column": 2.655, "plate": 1.8352, "chain_hand": 1.0659}  # half durations


@cache
def hop_of(kind="column"):
    """A machine and its lossless hop."""
    machine = {
        "column": column, "cubic column": lambda: column(CUBIC), "plate": plate_hopper,
        "chain_hand": lambda: chain_hand((1, 1, 1)),
    }[kind]()  # fmt: skip
    return machine, find(machine, start={**STARTS[kind], "contact_duration": CONTACTS[kind]})


def next_launch(launch, damping=0.0, cubic=0.0):
    """The launch (alpha, y1, y1') of a column after the next hop, and the energy lost, by SciPy's DOP853."""
    force = lambda r, v: r + cubic * r**3 + damping * v  # noqa: E731
    accuracy = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}

    def flight(t, x):
        y1, v1, y2, v2, y3, v3 = x
        upper, lower = force(y1 - y2, v1 - v2), force(y2 - y3, v2 - v3)
        return [v1, -upper - 1, v2, upper - lower - 1, v3, lower - 1]

    def contact(t, x):
        return [*flight(t, [*x, 0.0, 0.0])[:4]]

    alpha, y1, v1 = launch
    y2 = np.roots([cubic, 0, 1, damping * alpha - 1]).real[-1] if cubic else 1 - damping * alpha
    x, lost = np.array([y1, v1, y2, alpha, 0.0, 0.0]), 0.0
    gap = lambda t, x: x[4] if t > 1e-3 else 1.0  # noqa: E731
    gap.terminal, gap.direction = True, -1
    while True:
        x = solve_ivp(flight, (0, 100), x, events=gap, **accuracy).y[:, -1]
        lost += 0.5 * x[5] ** 2
        x[4:] = 0.0
        if flight(0, x)[5] <= 0:
            break
    end = lambda t, x: force(x[2], x[3]) - 1 if t > 1e-9 else -1.0  # noqa: E731
    end.terminal, end.direction = True, 1
    y1, v1, y2, v2 = solve_ivp(contact, (0, 1000), x[:4], events=end, **accuracy).y[:, -1]
    return np.array([v2, y1, v1]), lost
