"""Blocks that rock: Housner's block, and the lossless steps of small blocks and wheels in closed form."""

from functools import cache
from math import acosh, atan, cos, pi, sin, sqrt, tan, tanh

from scipy.optimize import brentq

from orbits import Mechanism, Simulation, find, simulate
from orbits.mechanics import Mass, Potential, Spring
from problems import rimless_wheel, rocking_block

from .case import Case
from .numerics import least
from .sources import HOUSNER, PANKOV

SLENDER, TILT = 0.2, 0.15  # the angle of a block, and its first tilt
PULSES = (1.5, 2.0, 4.0)  # accelerations, over the least that lifts a block
STEPS = ((1.0, 0.5, 1), (1.0, 0.5, 2), (0.2, 0.5, 1))  # inertia ratio, gravity ratio and family of lossless steps


@cache
def block(angle: float) -> Mechanism:
    """A solid block with half a height of 1. The inner body swings alone on a spring."""
    return Mechanism(
        ("phi", "theta"),
        [Spring("phi"), Mass("cos(theta) + b*sin(theta)", 1.0, across="sin(theta) - b*cos(theta)")],
        inertia={"phi": 1.0, "theta": "(1 + b**2)/3"}, gravity=1.0, angles=("phi", "theta"), gap="theta",
        symmetry={"theta": "-theta", "phi": "-phi"}, parameters={"b": tan(angle)}, name="solid block",
    )  # fmt: skip


def rocks(angle: float, tilt: float, time: float) -> Simulation:
    """The block released at a tilt."""
    return simulate(block(angle), state=[0.0, 0.0, tilt, 0.0], time=time)


def share_left(angle: float) -> float:
    """The share of the rate that an impact leaves a solid block."""
    return 1 - 1.5 * sin(angle) ** 2


def shares_left() -> list[float]:
    """The share of the energy that an impact leaves."""
    found = []
    for angle in (0.1, 0.2, 0.3):
        event = rocks(angle, 0.5 * angle, 20.0).events[0]
        found.append((event.after[3] / event.before[3]) ** 2)
    return found


def rates_of_impacts() -> list[float]:
    """The rates before impacts."""
    events = rocks(SLENDER, TILT, 150.0).events
    return [abs(event.before[3]) for event in events if event.kind == "impact"][:78]


def rate_of_impact(number: int) -> float:
    """The rate before an impact in closed form, by the energy of the first fall and the shares that impacts leave."""
    fallen = 2 * (cos(TILT - SLENDER) - cos(SLENDER)) / cos(SLENDER) / (4 / 3 * (1 + tan(SLENDER) ** 2))
    return sqrt(fallen) * share_left(SLENDER) ** number


@cache
def slender_block() -> Mechanism:
    """A slender block, in units of its angle and of sqrt(I0/(W R)); the ground pushes it with an acceleration, in units
    of the least that lifts it."""
    return Mechanism(
        ("phi", "theta"), [Spring("phi"), Potential("theta - theta**2/2 - push*theta")], gap="theta",
        inertia={"phi": 1.0, "theta": 1.0}, symmetry={"theta": "-theta", "phi": "-phi"}, parameters={"push": 0.0},
        angles=("phi", "theta"), name="slender block",
    )  # fmt: skip


def falls_after(push: float, duration: float) -> bool:
    """Whether a slender block falls over after a rectangular pulse."""
    pushed = simulate(slender_block().with_values(push=push), state=[0.0, 0.0, 1e-12, 1e-12], time=duration)
    free = simulate(slender_block(), state=pushed(duration), time=60.0, cap=1)
    return not free.events


def overturning_pulses() -> list[float]:
    """The durations from which on pulses overturn a block."""
    return [least(lambda duration, push=push: falls_after(push, duration), 0.0, 4.0, 1e-7) for push in PULSES]


def step_in_closed_form(kind: str, inertia_ratio: float, gravity_ratio: float, family: int) -> list[float]:
    """Half the flight, launch speed and contact of small steps; the squared rates of the flight are p^2 and -q^2."""
    trace, product = inertia_ratio * gravity_ratio - 1 - inertia_ratio, -inertia_ratio * gravity_ratio
    root = sqrt(trace**2 - 4 * product)
    p, q = sqrt((trace + root) / 2), sqrt((root - trace) / 2)
    c = p * p * q * q / (inertia_ratio * (p * p + q * q))
    if kind == "block":
        ends = family * pi / q, (family + 0.5) * pi / q
        half = brentq(lambda s: p * sin(q * s) - q * tanh(p * s) * cos(q * s), *ends, xtol=1e-15)
        speed = c * (p * tanh(p * half) + q * tan(q * half))
    else:
        ends = (family - 0.5) * pi / q, family * pi / q
        half = brentq(lambda s: q * sin(q * s) + p * tanh(p * s) * cos(q * s), *ends, xtol=1e-15)
        speed = c * (p / tanh(p * half) - q / tan(q * half))
    return [half, speed, 2 * atan(gravity_ratio / speed)]


def lossless_steps(kind: str) -> list[float]:
    """Half the flight, the launch speed and the contact of the orbits that are found."""
    machine, found = rocking_block if kind == "block" else rimless_wheel, []
    for inertia_ratio, gravity_ratio, family in STEPS:
        orbit = find(machine(inertia_ratio=inertia_ratio, gravity_ratio=gravity_ratio), family)
        found += [orbit.flight_time / 2, orbit.alpha, orbit.contact_time]
    return found


CASES = (
    Case(
        "Housner's block",
        "share of the energy left at an impact; angle 0.1, 0.2, 0.3",
        HOUSNER,
        "r of a rectangular block: (1 - 3/2 sin(alpha)^2)^2",
        [share_left(angle) ** 2 for angle in (0.1, 0.2, 0.3)],
        shares_left,
        within=1e-12,
    ),
    Case(
        "Housner's block",
        "rates before 78 impacts; angle 0.2, released at 0.15",
        HOUSNER,
        "closed form: r^n of the energy is left after n impacts",
        [rate_of_impact(n) for n in range(78)],
        rates_of_impacts,
        within=1e-10,
    ),
    Case(
        "Housner's block",
        "first impact after the release at 0.1, 0.5, 0.9 of the angle, times 4: the period (1/p)",
        HOUSNER,
        "period of a slender block: 4 arcosh(1/(1 - theta_0/alpha))",
        [4 * acosh(1 / (1 - tilt)) for tilt in (0.1, 0.5, 0.9)],
        lambda: [
            4 * simulate(slender_block(), state=[0.0, 0.0, tilt, 0.0], time=9.0, cap=1).events[0].time
            for tilt in (0.1, 0.5, 0.9)
        ],
        within=1e-12,
    ),
    Case(
        "Housner's block",
        "shortest rectangular pulse that overturns it (1/p); 1.5, 2, 4 times the least acceleration",
        HOUSNER,
        "condition of a slender block: cosh(p t) = 1 + 1/(2 x (x - 1)), x the acceleration over g alpha",
        [acosh(1 + 1 / (2 * x * (x - 1))) for x in PULSES],
        overturning_pulses,
        within=1e-6,
        slow=True,
    ),
    Case(
        "Small rocking block with a sprung body",
        "half flight, launch speed, contact of three lossless orbits",
        PANKOV,
        "closed form of the two phase times of two coordinates, derived here",
        [number for each in STEPS for number in step_in_closed_form("block", *each)],
        lambda: lossless_steps("block"),
        within=1e-12,
    ),
    Case(
        "Small rimless wheel with a sprung body",
        "half flight, launch speed, contact of three lossless orbits",
        PANKOV,
        "closed form of the two phase times of two coordinates, derived here",
        [number for each in STEPS for number in step_in_closed_form("wheel", *each)],
        lambda: lossless_steps("wheel"),
        within=1e-12,
    ),
)
