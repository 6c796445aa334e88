"""Oscillators: periods in closed form, bifurcations along the energy, and impacts of spheres and of forced masses."""

from functools import cache
from math import atan, cos, gamma, pi, radians, sin, sqrt, tan

import numpy as np
from scipy.special import ellipk

from orbits import Mechanism, Oscillation, find, follow, simulate
from orbits.mechanics import Force, Mass, Potential, Spring

from .case import Case
from .numerics import slopes
from .sources import BIFURCATION_KIT, BRACK, JOHNSON, LANDAU, SHAW

AMPLITUDES, ANGLES = (0.5, 1.0, 2.0), (30, 60, 90, 150)
FORCED = ((2.6, 1), (4.7, 2), (2.8, 1))  # frequency, and periods of the force in one cycle
RESTITUTION = 0.8


def free(potential: str, **others) -> Mechanism:
    """A mass of 1 in a potential."""
    return Mechanism(("x",), [Potential(potential)], gap=None, inertia={"x": 1.0}, name="mass in a potential", **others)


def period(machine: Mechanism, energy: float, **start: float) -> float:
    """The period at an energy above the equilibrium."""
    found = find(machine, at={"energy": energy}, **({"start": start} if start else {}))
    assert isinstance(found, Oscillation)
    return found.period


def periods_of_duffing() -> list[float]:
    """The periods at amplitudes 0.5, 1 and 2."""
    machine = Mechanism(("u",), [Spring("u", "r + r**3")], gap=None, inertia={"u": 1.0}, name="Duffing oscillator")
    return [period(machine, a**2 / 2 + a**4 / 4) for a in AMPLITUDES]


def periods_of_a_pendulum() -> list[float]:
    """The periods over those of small swings."""
    bob = Mechanism(("q",), [Mass("-cos(q)", 1.0, across="sin(q)")], gap=None, angles=("q",), name="pendulum")
    return [period(bob, 1 - cos(pi * angle / 180)) / (2 * pi) for angle in ANGLES]


def modes_of_a_double_pendulum() -> list[float]:
    """The squared circular frequencies of small swings."""
    masses = [Mass("-cos(a)", 1.0, across="sin(a)"), Mass("-cos(a) - cos(b)", 1.0, across="sin(a) + sin(b)")]
    machine = Mechanism(("a", "b"), masses, gap=None, angles=("a", "b"), name="double pendulum")
    return [(2 * pi * find(machine, family, at={"energy": 1e-9}).frequency) ** 2 for family in (1, 2)]


def branch_points_of_henon_and_heiles() -> list[float]:
    """Where the orbit along y branches, in shares of the energy of the saddles."""
    energy = "(x**2 + y**2)/2 + x**2*y - y**3/3"
    machine = Mechanism(("x", "y"), [Potential(energy)], gap=None, inertia={"x": 1.0, "y": 1.0}, name="Henon-Heiles")
    family = follow(machine, "energy", (0.14, 0.1649), start={"y": 0.2, "duration": 6.3}, longest=0.5)
    return [6 * event.energy for event in family.events if event.kind == "branch point"]


def half_swing(law: str, height: float) -> tuple[float, float]:
    """The time from rest at a height over a wall at 0, to which a law pulls a mass of 1, and the speed there. The
    period of a law that pulls the same on both sides is four times as long."""
    machine = Mechanism(
        ("other", "mass"), [Spring("other"), Spring("mass", law)], inertia={"other": 1.0, "mass": 1.0}, gap="mass",
        restitution=1.0, name="mass before a wall",
    )  # fmt: skip
    event = simulate(machine, state=[0.0, 0.0, height, 0.0], time=20.0, cap=1).events[0]
    return event.time, abs(event.before[3])


def impact_of_spheres() -> list[float]:
    """The time of an impact over delta/V, and the time, where m = R = E = V = 1."""
    deepest = (15 / 16) ** 0.4
    half, speed = half_swing("4/3*abs(r)**1.5", deepest)
    return [2 * half * speed / deepest, 2 * half]


@cache
def forced(frequency: float) -> Mechanism:
    """A mass on a spring of 1 that a force cos(phase) drives above a stop at its rest; the phase is that of an
    oscillator of this frequency."""
    return Mechanism(
        ("drive", "mass"),
        [Spring("drive", "frequency**2*r"), Spring("mass"), Force("mass", lambda y, v, p: y["drive"])],
        inertia={"drive": 1.0, "mass": 1.0}, gap="mass", restitution=RESTITUTION, name="impact oscillator",
        parameters={"frequency": frequency},
    )  # fmt: skip


def next_impact(frequency: float, phase: float, speed: float) -> tuple[np.ndarray, float, float]:
    """From the phase and the speed after an impact to those after the next; its speed of impact, and the time."""
    state = [cos(phase), -frequency * sin(phase), 0.0, speed]
    event = simulate(forced(frequency), state=state, time=60.0, cap=1).events[0]
    place, rate = event.after[:2]
    return np.array([np.arctan2(-rate / frequency, place), event.after[3]]), abs(event.before[3]), event.time


def one_impact(frequency: float, n: int) -> tuple[float, float]:
    """The phase and the speed of the impact of a cycle of n periods of the force, in closed form.

    x = A cos(t) + A tan(T/2) sin(t) + g cos(w t + phase) vanishes at 0 and at T = 2 pi n/w, with g = 1/(1 - w^2) and
    A = -g cos(phase); that the speed turns round with the restitution e determines the phase."""
    half, share = pi * n / frequency, (1 - RESTITUTION) / (1 + RESTITUTION)
    phase = atan(-share * tan(half) / frequency)
    speed = 2 / (1 + RESTITUTION) * cos(phase) * tan(half) / (frequency**2 - 1)
    return (phase, speed) if speed > 0 else (phase + pi, -speed)


def impacts() -> list[float]:
    """The speed of the next impact and the time to it, from the closed form of each cycle."""
    found = []
    for frequency, n in FORCED:
        phase, speed = one_impact(frequency, n)
        _, strikes, time = next_impact(frequency, phase, RESTITUTION * speed)
        found += [strikes, time]
    return found


def areas() -> list[float]:
    """The determinants of the derivative of the map of impacts."""
    found = []
    for frequency, n in FORCED:
        phase, speed = one_impact(frequency, n)
        image = lambda impact, frequency=frequency: next_impact(frequency, *impact)[0]  # noqa: E731
        found.append(float(np.linalg.det(slopes(image, np.array([phase, RESTITUTION * speed])))))
    return found


def potential_of_power(n: int) -> float:
    """The period in the potential abs(x)**n at the energy 1, of a mass of 1."""
    return 2 * sqrt(2 * pi) / n * gamma(1 / n) / gamma(0.5 + 1 / n)


CASES = (
    Case(
        "Duffing oscillator",
        "period at the amplitudes 0.5, 1, 2",
        BIFURCATION_KIT,
        "issue 232, u'' + u + u^3 = 0; closed form: 4 K(m)/sqrt(1 + A^2), m = A^2/(2 (1 + A^2))",
        [4 * ellipk(a**2 / (2 * (1 + a**2))) / sqrt(1 + a**2) for a in AMPLITUDES],
        periods_of_duffing,
        within=1e-13,
    ),
    Case(
        "Pendulum",
        "period over that of small swings, at 30, 60, 90, 150 degrees",
        LANDAU,
        "section 11, problem 1: 2/pi K(sin(phi_0/2)), modulus sin(phi_0/2)",
        [2 / pi * ellipk(sin(radians(angle) / 2) ** 2) for angle in ANGLES],
        periods_of_a_pendulum,
        within=1e-12,
        slow=True,
    ),
    Case(
        "Potentials x^4 and x^6",
        "period at the energy 1",
        LANDAU,
        "section 11, problem 2 (a)",
        [potential_of_power(4), potential_of_power(6)],
        lambda: [4 * half_swing("4*r**3", 1.0)[0], 4 * half_swing("6*r**5", 1.0)[0]],
        within=1e-12,
    ),
    Case(
        "Potential -U/cosh(a x)^2",
        "period at the energy -0.8; U = 2, a = 0.7",
        LANDAU,
        "section 11, problem 2 (b): pi/a sqrt(2/abs(E))",
        [pi / 0.7 * sqrt(2 / 0.8)],
        lambda: [period(free("-2/cosh(0.7*x)**2"), 1.2)],
        within=1e-12,
        slow=True,
    ),
    Case(
        "Potential U tan(a x)^2",
        "period at the energy 1.2; U = 2, a = 0.7",
        LANDAU,
        "section 11, problem 2 (c): pi/a sqrt(2/(E + U))",
        [pi / 0.7 * sqrt(2 / 3.2)],
        lambda: [period(free("2*tan(0.7*x)**2"), 1.2)],
        within=1e-12,
        slow=True,
    ),
    Case(
        "Radial Kepler motion",
        "period at the energy -0.3, angular momentum 1",
        LANDAU,
        "section 15: pi sqrt(1/(2 abs(E)^3))",
        [pi * sqrt(1 / (2 * 0.3**3))],
        lambda: [period(free("1/(2*x**2) - 1/x"), 0.2, x=1.0)],
        within=1e-12,
        slow=True,
    ),
    Case(
        "Double pendulum",
        "squared circular frequencies of small swings; equal masses and lengths, g = l = 1",
        LANDAU,
        "section 23, problem 2: 2 -+ sqrt(2)",
        [2 - sqrt(2), 2 + sqrt(2)],
        modes_of_a_double_pendulum,
        within=1e-7,
    ),
    Case(
        "Henon-Heiles",
        "energies at which the straight orbit branches, over that of the saddle",
        BRACK,
        "first two pitchforks of the orbit A",
        ["0.969309", "0.986709"],
        branch_points_of_henon_and_heiles,
        slow=True,
    ),
    Case(
        "Elastic impact of a sphere (Hertz)",
        "T over delta/V, and T; m = R = E = V = 1",
        JOHNSON,
        "section 11.4: T = 2.94 delta/V = 2.87 (m^2/(R E^2 V))^(1/5)",
        ["2.94", "2.87"],
        impact_of_spheres,
    ),
    Case(
        "Forced impact oscillator",
        "speed of impact and time between impacts; e = 0.8, three cycles at 2.6, 4.7, 2.8",
        SHAW,
        "limit of a rigid stop; closed form with one impact in n periods, derived here",
        [each for w, n in FORCED for each in (one_impact(w, n)[1], 2 * pi * n / w)],
        impacts,
        within=1e-12,
    ),
    Case(
        "Forced impact oscillator",
        "determinant of the map of impacts, e^2; three cycles at 2.6, 4.7, 2.8",
        SHAW,
        "limit of a rigid stop; closed form: a flight keeps areas, and an impact shrinks them by e twice",
        [RESTITUTION**2] * 3,
        areas,
        within=1e-7,
    ),
)
