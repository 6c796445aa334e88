"""Balls that bounce: on the ground, on a vibrating table, on a mass with a spring, and a toy that jumps."""

from math import asin, cos, pi, sin, sqrt

import numpy as np
from scipy.optimize import brentq

from orbits import Mechanism, ReturnMap, Simulation, simulate
from orbits.mechanics import Mass, Spring
from problems import HeavyHand, Hopper

from .case import Case
from .numerics import least, slopes
from .sources import CHATTERJEE, HOLMES, IRODOV, MODELING_TOOLKIT, TUFILLARO

RESTITUTIONS, CYCLES, LEVELS = (0.2, 0.5, 0.8), (1, 2, 3), (1.01, 1.5, 2.0, 5.0)
DROPS = ((10.0, 15.0, 0.8), (1.0, 0.0, 0.8), (1.0, 0.0, 0.7))  # height, speed, restitution


def time_to_rest(height: float, speed: float, restitution: float) -> float:
    """When a ball has come to rest on the ground. A mass on a spring stands by, since a machine has two coordinates."""
    masses = [Mass("other", 1.0), Spring("other"), Mass("ball", 1.0)]
    ball = Mechanism(("other", "ball"), masses, gap="ball", restitution=restitution, gravity=9.81, name="bouncing ball")
    return simulate(ball, state=[0.0, 0.0, height, speed], time=30.0).events[-1].time


def sum_of_bounces(height: float, speed: float, restitution: float) -> float:
    """When a ball has come to rest, in closed form."""
    strikes = sqrt(speed**2 + 2 * 9.81 * height)
    return (speed + strikes) / 9.81 + 2 * restitution * strikes / (9.81 * (1 - restitution))


def on_table(level: float, restitution: float = 0.0, **options) -> Simulation:
    """A ball that rides on a vibrating table, which passes its centre upwards with this speed, the largest
    acceleration of the table over that of gravity."""
    return simulate(HeavyHand(restitution=restitution), state=[-1.0, level, -1.0, level], **options)


def bounce(machine: HeavyHand, level: float, phase: float, speed: float) -> tuple[np.ndarray, float]:
    """From the phase of the table and the speed of the ball after an impact to those after the next, and the time."""
    place = -1 + level * sin(phase)
    run = simulate(machine, state=[place, speed, place, level * cos(phase)], hops=1, cap=1)
    _, speed, height, rate = run.events[0].after
    return np.array([np.arctan2(height + 1, rate), speed]), run.events[0].time


def cycle(restitution: float, n: int, phase: float) -> tuple[float, float, np.ndarray]:
    """Of the bouncing with one impact in n periods that strikes at a phase: the level, how far the simulated impact is
    from the one before, and the derivative (2, 2) of the map of impacts."""
    machine, level = HeavyHand(restitution=restitution), pi * n * (1 - restitution) / (1 + restitution) / cos(phase)
    start = np.array([phase, pi * n])
    following, time = bounce(machine, level, *start)
    derivative = slopes(lambda impact: bounce(machine, level, *impact)[0], start)
    return level, max(np.abs(following - start).max(), abs(time - 2 * pi * n)), derivative


def edge(restitution: float, n: int, multiplier: int) -> float:
    """The level at which the bouncing with one impact in n periods has this multiplier; NaN if it does not repeat."""

    def off(phase: float) -> float:
        return float(np.linalg.det(cycle(restitution, n, phase)[2] - multiplier * np.eye(2)))

    lowest = 0.05 if multiplier == -1 else -0.2
    phase = brentq(off, lowest, lowest + 0.35 if multiplier == 1 else _last_phase(off), xtol=1e-10)
    level, miss, _ = cycle(restitution, n, phase)
    return level if miss < 1e-9 else np.nan


def _last_phase(off) -> float:
    """A phase beyond the one at which a multiplier is -1."""
    return next(phase for phase in np.arange(0.2, 1.5, 0.2) if off(phase) < 0)


def throws_that_bounce() -> list[float]:
    """The slowest throws, near n pi, after which a ball bounces on a heavy hand forever."""
    step = ReturnMap(HeavyHand(), cap=40)
    bounces = lambda speed: bool(step(speed).status == "cap")  # noqa: E731
    return [least(bounces, n * pi - 0.1, n * pi + 0.1, 1e-9) for n in CYCLES]


def on_flexible_ground(restitution: float) -> Simulation:
    """A ball that comes at 1 m/s from 1 m, without gravity."""
    masses = Mechanism(
        ("ball", "ground"), [Spring("ground", "k*r")], inertia={"ball": 5.0, "ground": 1.0}, gap="ball - ground",
        parameters={"k": 10.0}, restitution=restitution, name="ball on flexible ground",
    )  # fmt: skip
    return simulate(masses, state=[1.0, -1.0, 0.0, 0.0], time=4.5)


def plastic_impact() -> list[float]:
    """The time in contact, the speed after it, and the energy lost."""
    landing, lift_off = on_flexible_ground(0.0).events
    return [lift_off.time - landing.time, lift_off.after[1], landing.loss]


def elastic_impacts() -> list[float]:
    """The time between the first two impacts, and the change of energy over all."""
    events = on_flexible_ground(1.0).events
    return [events[1].time - events[0].time, events[-1].energy - events[0].energy]


def compressed(compression: float) -> Simulation:
    """Two equal masses, the lower one on the ground, the spring compressed, in units of the weight over stiffness."""
    return simulate(Hopper(), state=[-compression, 0.0, 0.0, 0.0], hops=1, time=10.0)


def jumping_cubes() -> list[float]:
    """The compression from which the lower cube leaves the ground."""
    return [least(lambda compression: bool(compressed(compression).events), 2.0, 4.0, 1e-10)]


def risen_cubes() -> list[float]:
    """How far the centre of gravity rises from a compression of 7."""
    run = simulate(Hopper(), state=[-7.0, 0.0, 0.0, 0.0], time=compressed(7.0).end + 6.0)

    def centre(time: float) -> np.ndarray:
        y1, v1, y2, v2 = run(time)
        return 0.5 * np.array([y1 + y2, v1 + v2])

    top = brentq(lambda time: centre(time)[1], run.events[0].time, run.end, xtol=1e-13)
    return [centre(top)[0] - centre(0.0)[0]]


OMEGA = sqrt(10.0)
CASES = (
    Case(
        "Bouncing ball",
        "time (s) until it rests; height 10, 1, 1 m, speed 15, 0, 0 m/s, restitution 0.8, 0.8, 0.7",
        TUFILLARO,
        "Equilibrium Solutions: the sum of a geometric series, for the examples of Simulink (Simulation of a Bouncing "
        "Ball), OpenModelica (BouncingBall.mo) and the Modelica Association (Reference FMUs)",
        [sum_of_bounces(*drop) for drop in DROPS],
        lambda: [time_to_rest(*drop) for drop in DROPS],
        within=1e-12,
    ),
    Case(
        "Ball on a vibrating table",
        "phase at which it comes off, arcsin(1/Gamma); Gamma = 1.01, 1.5, 2, 5",
        TUFILLARO,
        "Sticking Solutions: it comes off where the table falls with the acceleration of gravity",
        [asin(1 / level) for level in LEVELS],
        lambda: [on_table(level, hops=1).end for level in LEVELS],
        within=1e-12,
    ),
    Case(
        "Ball on a vibrating table",
        "its speed there, sqrt(Gamma^2 - 1); Gamma = 1.01, 1.5, 2, 5",
        TUFILLARO,
        "Sticking Solutions, closed form",
        [sqrt(level**2 - 1) for level in LEVELS],
        lambda: [on_table(level, hops=1).launches[-1] for level in LEVELS],
        within=1e-12,
    ),
    Case(
        "Ball on a vibrating table",
        "speed at the second launch, after it has stuck again; e = 0.3, Gamma = 2",
        TUFILLARO,
        "Sticking Solutions: it repeats the pattern",
        [sqrt(3.0)],
        lambda: on_table(2.0, 0.3, hops=2).launches[-1:],
        within=1e-12,
    ),
    Case(
        "Ball on a vibrating table",
        "Gamma at which bouncing with one impact in n periods begins; e = 0.2, 0.5, 0.8, n = 1, 2, 3",
        HOLMES,
        "gamma_n = 2 n pi (1 - e), with gamma = 2 (1 + e) Gamma",
        [n * pi * (1 - e) / (1 + e) for e in RESTITUTIONS for n in CYCLES],
        lambda: [edge(e, n, 1) for e in RESTITUTIONS for n in CYCLES],
        within=1e-8,
        slow=True,
    ),
    Case(
        "Ball on a vibrating table",
        "Gamma at which it loses stability; e = 0.2, 0.5, 0.8, n = 1, 2, 3",
        HOLMES,
        "closed form for exact flights, derived here, as the source neglects how far the table moves: "
        "Gamma^2 = (n pi (1 - e)/(1 + e))^2 + (2 (1 + e^2)/(1 + e)^2)^2",
        [
            np.hypot(n * pi * (1 - e) / (1 + e), 2 * (1 + e**2) / (1 + e) ** 2).item()
            for e in RESTITUTIONS
            for n in CYCLES
        ],
        lambda: [edge(e, n, -1) for e in RESTITUTIONS for n in CYCLES],
        within=1e-8,
        slow=True,
    ),
    Case(
        "Ball on a heavy hand",
        "slowest throw after which it bounces forever, n pi; n = 1, 2, 3",
        CHATTERJEE,
        "section 9, the limit of a heavy hand; closed form: a throw at n pi comes back after n periods",
        [n * pi for n in CYCLES],
        throws_that_bounce,
        within=1e-8,
        slow=True,
    ),
    Case(
        "Ball on flexible ground",
        "time in contact, speed after it, energy lost; plastic, 1 m/s",
        MODELING_TOOLKIT,
        "5 kg on 1 kg and 10 N/m; closed form: both swing half a period at the rate sqrt(10/6)",
        [pi * sqrt(0.6), 5 / 6, 5 / 12],
        plastic_impact,
        within=1e-12,
    ),
    Case(
        "Ball on flexible ground",
        "time between two impacts, change of energy over all impacts; elastic, 1 m/s",
        MODELING_TOOLKIT,
        "5 kg on 1 kg and 10 N/m; closed form: 2 t/5 = sin(w t)/w, w = sqrt(10), and a constant energy",
        [brentq(lambda t: 0.4 * t - sin(OMEGA * t) / OMEGA, 0.1, 0.9, xtol=1e-15), 0.0],
        elastic_impacts,
        within=1e-12,
    ),
    Case(
        "Two cubes joined by a spring",
        "compression from which the lower one leaves the ground (m g/k)",
        IRODOV,
        "problem 1.153 (a), answer",
        ["3"],
        jumping_cubes,
        within=1e-9,
    ),
    Case(
        "Two cubes joined by a spring",
        "rise of the centre of gravity from a compression of 7 (m g/k)",
        IRODOV,
        "problem 1.153 (b), answer",
        ["8"],
        risen_cubes,
        within=1e-12,
    ),
)
