"""Walkers down a slope: the rimless wheel, and the simplest walking model in three pieces.

The swing foot of the simplest walker passes below the ground in mid-step, which its authors ignore and the toolkit does
not. So a step is stated in three pieces: until the foot passes the ground, from there to heel strike, and the heel
strike itself, the landing of a foot that sticks.
"""

from functools import cache
from math import cos, pi, sin, sqrt, tan

import numpy as np
from scipy.optimize import brentq, fsolve

from orbits import Mechanism, Simulation, simulate
from orbits.mechanics import Mass, Spring

from .case import Case
from .numerics import least, slopes
from .sources import BHOUNSULE, GARCIA, PASSIVE_WALKER, TEDRAKE

ALPHA, GRAVITY, SLOPES = pi / 8, 9.8, (0.08, 0.15)
HEAVY = 1e6  # mass of the hip over that of a foot, which is infinite in the simplest model
GUESSES = {"long": (0.2, -0.2, -0.016), "short": (0.194, -0.204, -0.015)}


@cache
def wheel(slope: float) -> Mechanism:
    """Tedrake's wheel of 8 spokes with m = l = 1. The inner body swings alone on a spring."""
    return Mechanism(
        ("phi", "theta"),
        [Spring("phi"), Mass("cos(theta - a + slope)", 1.0, across="sin(theta - a + slope)")],
        inertia={"phi": 1.0}, gravity=GRAVITY, angles=("phi", "theta"), reversor=None,
        gaps={"rear foot": "theta", "front foot": "2*a - theta"}, symmetry={"theta": "theta - 2*a"},
        parameters={"a": ALPHA, "slope": slope}, name="rimless wheel",
    )  # fmt: skip


def rolled(slope: float, rate: float, place: float = 0.0, **options) -> Simulation:
    """The wheel from an angle since the rear foot stood, with a rate."""
    return simulate(wheel(slope), state=[0.0, 0.0, place, rate], **options)


def following(slope: float, rate: float) -> float:
    """The rate after the next step, from that after the last one."""
    return rolled(slope, rate, time=20.0, cap=1).events[0].after[3]


def rolling_speeds() -> list[float]:
    """The rates to which the wheel comes, after a step."""
    return [rolled(slope, 1.2, time=50.0).events[-1].after[3] for slope in SLOPES]


def multipliers_of_rolling() -> list[float]:
    """The derivatives of the rate after a step at the rates that come back."""
    return [
        slopes(lambda rate, slope=slope: np.array([following(slope, rate[0])]), np.array([rate])).item()
        for slope, rate in zip(SLOPES, rolling_speeds(), strict=True)
    ]


def passes(rate: float) -> bool:
    """Whether the wheel comes over a spoke with a rate, uphill where it is below 0."""
    start, foot = (0.0, "front foot") if rate > 0 else (2 * ALPHA, "rear foot")
    return rolled(SLOPES[0], rate, start, time=20.0, cap=1).events[0].foot == foot


def thresholds() -> list[float]:
    """The rates with which the wheel just comes over a spoke, downhill and uphill."""
    return [least(lambda rate, sign=sign: passes(sign * rate), 0.5, 2.5, 1e-9) for sign in (1, -1)]


@cache
def swing(sign: str, hip: float) -> Mechanism:
    """The simplest walker between strikes: d is the angle between the legs, phi of its authors; the gap c is phi - 2
    theta with the sign -, until the swing foot passes the ground, and 2 theta - phi with the sign +, after that."""
    stance, leg = f"((d {sign} c)/2 - slope)", f"(({sign}c - d)/2 - slope)"
    return Mechanism(
        ("d", "c"),
        [
            Mass(f"cos{stance}", "hip", across=f"-sin{stance}"),
            Mass(f"cos{stance} - cos{leg}", 1.0, across=f"sin{leg} - sin{stance}"),
            Spring("d", "0*r"),
        ],
        gap="c", symmetry={"d": "-d"}, reversor=None, angles=("d", "c"), name="swing of the simplest walker",
        parameters={"hip": hip, "slope": 0.0},
    )  # fmt: skip


@cache
def strike(hip: float) -> Mechanism:
    """The simplest walker as its swing foot comes down at (x, y): angles a of its leg and b of the other one."""
    return Mechanism(
        ("x", "a", "b", "y"),
        [
            Mass("y", 1.0, across="x"),
            Mass("y + cos(a)", "hip", across="x - sin(a)"),
            Mass("y + cos(a) - cos(b)", 1.0, across="x - sin(a) + sin(b)"),
            Spring("a - b", "0*r"),
        ],
        gap="y", sticks=("x",), reversor=None, angles=("a", "b"), heights={"hip": "y + cos(a)"},
        parameters={"hip": hip}, name="heel strike",
    )  # fmt: skip


def step(start: np.ndarray, slope: float, hip: float) -> tuple[np.ndarray, float]:
    """theta, theta', phi' after a heel strike to those after the next, and the time."""
    theta, rate, leg_rate = start
    machine = swing("-", hip).with_values(slope=slope)
    run = simulate(machine, state=[2 * theta, leg_rate, 0.0, leg_rate - 2 * rate], time=6.0, cap=1)
    d, d_rate, _, c_rate = run.events[0].before
    time = run.events[0].time
    run = simulate(swing("+", hip).with_values(slope=slope), state=[d, d_rate, 0.0, -c_rate], time=6.0, cap=1)
    d, d_rate, c, c_rate = run.events[0].before
    stance, stance_rate = (d + c) / 2, (d_rate + c_rate) / 2
    leg, leg_rate = stance - d, stance_rate - d_rate
    across = cos(leg) * leg_rate - cos(stance) * stance_rate
    up = sin(leg) * leg_rate - sin(stance) * stance_rate
    barely = 1e-13  # above the ground
    state = [0.0, across, leg, leg_rate, stance, stance_rate, barely, up]
    after = simulate(strike(hip), state=state, time=1e-9, cap=1).events[0].after
    return np.array([after[2], after[3], after[3] - after[5]]), time + run.events[0].time


def gait(start: np.ndarray, slope: float, hip: float) -> np.ndarray:
    """The start that comes back, near one; NaN where none does."""
    found, output, *_ = fsolve(lambda z: step(z, slope, hip)[0] - z, start, xtol=1e-12, full_output=True)
    return found if np.abs(output["fvec"]).max() < 1e-11 else np.full(3, np.nan)


def multipliers(start: np.ndarray, slope: float, hip: float) -> np.ndarray:
    """The eigenvalues of the step at a start."""
    return np.linalg.eigvals(slopes(lambda z: step(z, slope, hip)[0], start))


@cache
def massless(name: str) -> np.ndarray:
    """theta, theta', phi' and the time of the long or the short step on the slope 0.009, for feet without mass, which
    are the limit of two heavy hips."""
    found = []
    for hip in (HEAVY, HEAVY / 2):
        start = gait(np.array(GUESSES[name]), 0.009, hip)
        found.append(np.append(start, step(start, 0.009, hip)[1]))
    return 2 * found[0] - found[1]


def multipliers_of_gaits() -> list[float]:
    """The multipliers of the long step, real and imaginary part, and of the short one."""
    long, short = (multipliers(gait(massless(name)[:3], 0.009, HEAVY), 0.009, HEAVY) for name in GUESSES)
    pair = long[np.argmax(long.imag)]
    return [pair.real, pair.imag, *sorted(np.abs(short), reverse=True)[:2]]


def last_stable_slope() -> list[float]:
    """The slope at which a multiplier of the long step is -1."""
    start = massless("long")[:3]

    def off(slope: float) -> float:
        found = multipliers(gait(start * (slope / 0.009) ** (1 / 3), slope, HEAVY), slope, HEAVY)
        return float(np.prod(1 + found).real)

    return [brentq(off, 0.0145, 0.0155, xtol=1e-7)]


CASES = (
    Case(
        "Rimless wheel",
        "rolling rate after a step (rad/s); slope 0.08, 0.15",
        TEDRAKE,
        "Fixed points: cot(2 alpha) sqrt(4 g/l sin(alpha) sin(gamma)), m = l = 1, g = 9.8, alpha = pi/8",
        [sqrt(4 * GRAVITY * sin(ALPHA) * sin(slope)) / tan(2 * ALPHA) for slope in SLOPES],
        rolling_speeds,
        within=1e-10,
    ),
    Case(
        "Rimless wheel",
        "rate after a step from 1, 1.5, 2.5 rad/s; slope 0.08",
        TEDRAKE,
        "Poincare map: cos(2 alpha) sqrt(rate^2 + 4 g/l sin(alpha) sin(gamma))",
        [cos(2 * ALPHA) * sqrt(rate**2 + 4 * GRAVITY * sin(ALPHA) * sin(0.08)) for rate in (1.0, 1.5, 2.5)],
        lambda: [following(0.08, rate) for rate in (1.0, 1.5, 2.5)],
        within=1e-12,
    ),
    Case(
        "Rimless wheel",
        "least rates to pass a spoke, downhill and uphill (rad/s); slope 0.08",
        TEDRAKE,
        "Stance dynamics, omega_1 and -omega_2: sqrt(2 g/l (1 - cos(alpha -+ gamma)))",
        [sqrt(2 * GRAVITY * (1 - cos(ALPHA - 0.08))), sqrt(2 * GRAVITY * (1 - cos(ALPHA + 0.08)))],
        thresholds,
        within=1e-8,
    ),
    Case(
        "Rimless wheel",
        "multiplier of the rolling; slope 0.08, 0.15",
        TEDRAKE,
        "derivative of the Poincare map at its fixed point: cos(2 alpha)^2",
        [cos(2 * ALPHA) ** 2] * 2,
        multipliers_of_rolling,
        within=1e-8,
    ),
    Case(
        "Simplest walker",
        "theta, theta', phi' after heel strike, feet of mass 1/1000; slope 0.009",
        PASSIVE_WALKER,
        "case 1, hip 1000 and feet 1; it prints 15 digits, and the last three are rounding",
        ["0.200161072169750", "-0.199906060087682", "-0.015805473227965"],
        lambda: gait(np.array(GUESSES["long"]), 0.009, 1000.0),
        within=2e-12,
    ),
    Case(
        "Simplest walker",
        "theta, theta', phi' after heel strike, long step; slope 0.009",
        BHOUNSULE,
        "printed in its program simplestwalker.m (2013); programs differ from the tenth digit on",
        ["0.200310900563820", "-0.199832473025474", "-0.015822999949030"],
        lambda: massless("long")[:3],
        within=1e-9,
        slow=True,
    ),
    Case(
        "Simplest walker",
        "theta, theta', phi' after heel strike, short step; slope 0.009",
        BHOUNSULE,
        "printed in its program simplestwalker.m (2013); programs differ from the tenth digit on",
        ["0.193937369810188", "-0.203866927442012", "-0.015144260853193"],
        lambda: massless("short")[:3],
        within=1e-9,
        slow=True,
    ),
    Case(
        "Simplest walker",
        "time of the long and of the short step; slope 0.009",
        BHOUNSULE,
        "printed in its program simplestwalker.m (2013)",
        ["3.882", "3.096"],
        lambda: [massless("long")[3], massless("short")[3]],
        slow=True,
    ),
    Case(
        "Simplest walker",
        "multipliers: long step (real and imaginary part), short step; slope 0.009",
        GARCIA,
        "printed in a program for it; another integration has -0.19010 and 0.55760, as ours",
        ["-0.19121", "0.55633", "4.000", "0.459"],
        multipliers_of_gaits,
        within=5e-3,
        slow=True,
    ),
    Case(
        "Simplest walker",
        "largest slope at which the long step is stable (rad)",
        GARCIA,
        "abstract: stable for 0 < gamma < 0.015",
        ["0.015"],
        last_stable_slope,
        slow=True,
    ),
)
