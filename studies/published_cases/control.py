"""Optimal control: Bryson and Denham's problem, double integrators, the brachistochrone, and impacts at free times."""

from math import cos, pi, sin, sqrt

import casadi as ca
import numpy as np
from scipy.optimize import brentq

from orbits import steer
from orbits.control import Guess, Input, Stage
from orbits.model import Phase

from .case import Case
from .sources import BERNOULLI, BIFURCATION_KIT, BRYSON, DYMOS, OPTIMAL_CONTROL, ROCKIT

CART = Phase("cart", ("x", "v"), lambda x, p, q: [x[1], p["f"]])
FREE = Phase("ball", ("z", "v"), lambda x, p, q: [x[1], -9.81])
THROWN = Phase("thrown ball", ("x", "z", "u", "v"), lambda x, p, q: [x[2], x[3], 0.0, -9.81])
EFFORT = {"running": lambda x, p, q: p["f"] ** 2 / 2}
GRAVITY, RESTITUTION, DISTANCE = 9.80665, 0.9, 10.0


def goes_on(x, before, p) -> list:
    """The start of a stage where the one before ends."""
    return [x[i] - before[i] for i in range(2)]


def bryson_denham() -> list[float]:
    """The least integrals of f^2/2 that turn a cart round in the unit of time before the walls 1/9, 1/5 and 1/3."""
    found = []
    for wall, intervals in ((1 / 9, 9), (1 / 5, 8), (1 / 3, 4)):
        stage = Stage(
            CART, intervals, (1.0, 1.0), {"f": Input(degree=1)}, path={"room": lambda x, p, q, wall=wall: wall - x[0]},
            start=lambda x, before, p: [x[0], x[1] - 1], end=lambda x, p: [x[0], x[1] + 1], **EFFORT,
        )  # fmt: skip
        found.append(steer([stage], guess=[Guess(1.0, lambda t: [0.0, 1 - 2 * t])]).cost)
    return found


def rest_to_rest() -> list[float]:
    """The least integral of f^2/2 over a distance of 1 in a time of 1, and the least time with a force of at most 1."""
    ends = {"start": lambda x, before, p: x, "end": lambda x, p: [x[0] - 1, x[1]]}
    effort = Stage(CART, 4, (1.0, 1.0), {"f": Input(degree=1)}, **ends, **EFFORT)
    pushes = [
        Stage(CART, 1, (0.1, 5.0), {"f": Input(-1, 1)}, start=ends["start"], running=lambda x, p, q: 1.0),
        Stage(CART, 1, (0.1, 5.0), {"f": Input(-1, 1)}, start=goes_on, end=ends["end"], running=lambda x, p, q: 1.0),
    ]
    guess = [
        Guess(0.8, lambda t: [t * t / 2, t], {"f": 0.9}),
        Guess(0.8, lambda t: [0.5 + t / 2, 0.8 - t], {"f": -0.9}),
    ]
    return [steer([effort], guess=[Guess(1.0, lambda t: [t, 1.0])]).cost, steer(pushes, guess=guess).cost]


def turnpike() -> list[float]:
    """The least integral of x^2 over a time of 2 from x = 1 to 1/2, with a rate of at most 1."""
    rate = Phase("turnpike", ("x",), lambda x, p, q: [p["f"]])
    square = {"running": lambda x, p, q: x[0] ** 2}
    stages = [
        Stage(rate, 1, (0.01, 2.0), {"f": Input(-1, 1)}, start=lambda x, before, p: [x[0] - 1], **square),
        Stage(rate, 1, (0.01, 2.0), {"f": Input(-1, 1)}, start=lambda x, before, p: [x[0] - before[0]], **square),
        Stage(rate, 1, (0.01, 2.0), {"f": Input(-1, 1)}, start=lambda x, before, p: [x[0] - before[0]],
              end=lambda x, p: [x[0] - 0.5, p["elapsed time"] - 2], **square),
    ]  # fmt: skip
    guess = [Guess(0.9, lambda t: [1 - t], {"f": -0.9}), Guess(0.5, lambda t: [0.0], {"f": 0.0}),
             Guess(0.6, lambda t: [t], {"f": 0.9})]  # fmt: skip
    return [steer(stages, guess=guess).cost]


def brachistochrone() -> list[float]:
    """The least time (s) of a bead on a wire from (0, 10) to (10, 5), steered by the angle of the wire."""
    bead = Phase(
        "bead", ("x", "y", "v"),
        lambda x, p, q: [x[2] * ca.sin(p["angle"]), -x[2] * ca.cos(p["angle"]), GRAVITY * ca.cos(p["angle"])],
    )  # fmt: skip
    stage = Stage(
        bead, 4, (0.5, 5.0), {"angle": Input(0.0, pi, degree=1)}, start=lambda x, before, p: [x[0], x[1] - 10, x[2]],
        end=lambda x, p: [x[0] - 10, x[1] - 5], running=lambda x, p, q: 1.0,
    )  # fmt: skip
    guess = Guess(1.9, lambda t: [10 * t / 1.9, 10 - 5 * t / 1.9, 9.9 * t / 1.9], {"angle": lambda t: 0.2 + 0.7 * t})
    return [steer([stage], guess=[guess]).cost]


def cycloid(across: float, down: float) -> float:
    """The time on a cycloid that begins with a cusp and ends so far across and down."""
    angle = brentq(lambda a: (a - sin(a)) * down - (1 - cos(a)) * across, 0.1, 2 * pi - 0.1, xtol=1e-15)
    return angle * sqrt(down / (1 - cos(angle)) / GRAVITY)


def bounces_to_a_height() -> list[float]:
    """The speed (m/s) with which a ball is shot up to reach 0.5 m after two bounces, and the time (s) of all stages."""
    flight = {"phase": FREE, "intervals": 1, "duration": (0.05, 3.0)}
    rebound = lambda x, before, p: [x[0], x[1] + RESTITUTION * before[1]]  # noqa: E731
    stages = [
        Stage(**flight, start=lambda x, before, p: [x[0]], end=lambda x, p: [x[0]]),
        Stage(**flight, start=rebound, end=lambda x, p: [x[0]]),
        Stage(**flight, start=rebound, end=lambda x, p: [x[0] - 0.5, x[1]], final=lambda x, p: p["elapsed time"]),
    ]
    guess = [Guess(0.8, lambda t: [0.0, 3.5 - 9.81 * t])] * 2 + [Guess(0.3, lambda t: [0.2, 3.0 - 9.81 * t])]
    found = steer(stages, guess=guess)
    return [float(found.legs[0].path(0.0)[1]), found.cost]


def slowest_throw() -> list[float]:
    """The least speed (m/s) and the angle (degrees) of a throw that lands 10 m away after two bounces."""
    flight = {"phase": THROWN, "intervals": 1, "duration": (0.05, 5.0), "end": lambda x, p: [x[1]]}
    rebound = lambda x, before, p: [  # noqa: E731
        x[0] - before[0], x[1], x[2] - before[2], x[3] + RESTITUTION * before[3]
    ]  # fmt: skip
    thrown = {"start": lambda x, before, p: [x[0], x[1], p["u"] - x[2], p["v"] - x[3]]}
    landed = {**flight, "end": lambda x, p: [x[1], x[0] - DISTANCE], "final": lambda x, p: p["u"] ** 2 + p["v"] ** 2}
    stages = [Stage(**flight, **thrown), Stage(**flight, start=rebound), Stage(**landed, start=rebound)]
    guess = [Guess(0.8, lambda t, x=x: [x + 4 * t, 0.1, 4.0, 4 - 9.81 * t]) for x in (0.0, 3.2, 6.4)]
    found = steer(stages, guess=guess, free={"u": (0.5, 20.0), "v": (0.5, 20.0)})
    u, v = found.parameters["u"], found.parameters["v"]
    return [float(np.hypot(u, v)), float(np.degrees(np.arctan2(v, u)))]


SPEED = sqrt(2 * 9.81 * 0.5) / RESTITUTION**2
CASES = (
    Case(
        "Bryson and Denham",
        "least integral of f^2/2; wall at 1/9, 1/5, 1/3",
        BRYSON,
        "section 3.11: 4/(9 l) for l <= 1/6, 2 + 6 (1 - 4 l)^2 for 1/6 <= l <= 1/4, 2 beyond",
        [4.0, 2.24, 2.0],
        bryson_denham,
        within=1e-9,
    ),
    Case(
        "Cart from rest to rest",
        "least integral of f^2/2 in the time 1; least time with f of at most 1; distance 1",
        BIFURCATION_KIT,
        "issue 274, use case 1 for the time; closed form: 6 and 2 sqrt(distance)",
        [6.0, 2.0],
        rest_to_rest,
        within=1e-9,
    ),
    Case(
        "Scalar turnpike",
        "least integral of x^2 over the time 2, from 1 to 1/2 with a rate of at most 1",
        OPTIMAL_CONTROL,
        "3/8, bang, singular, bang",
        [0.375],
        turnpike,
        within=1e-9,
    ),
    Case(
        "Brachistochrone",
        "least time (s) from (0, 10) to (10, 5) m; g = 9.80665",
        DYMOS,
        "asserted there",
        ["1.8016"],
        brachistochrone,
    ),
    Case(
        "Brachistochrone",
        "least time (s) from (0, 10) to (10, 5) m; g = 9.80665, to all digits",
        BERNOULLI,
        "closed form: a cycloid",
        [cycloid(10.0, 5.0)],
        brachistochrone,
        within=1e-9,
    ),
    Case(
        "Ball shot up to 0.5 m after two bounces",
        "its first speed (m/s) and the time of all flights (s)",
        ROCKIT,
        "restitution 0.9; closed form: sqrt(2 g h)/e^2 and (2 (1 + e) + e^2) times that speed over g",
        [SPEED, (2 * (1 + RESTITUTION) + RESTITUTION**2) * SPEED / 9.81],
        bounces_to_a_height,
        within=1e-9,
    ),
    Case(
        "Ball thrown to 10 m in two bounces",
        "least speed (m/s) and its angle (degrees); e = 0.9",
        ROCKIT,
        "variation of its problem; closed form, derived here: sqrt(g d/(1 + e + e^2)) and 45",
        [sqrt(9.81 * DISTANCE / (1 + RESTITUTION + RESTITUTION**2)), 45.0],
        slowest_throw,
        within=1e-7,
    ),
)
