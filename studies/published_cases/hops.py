"""Hops of masses on springs: lossless launch speeds, phase times of chains, the paper's numbers, and falls."""

from math import acos, atan, pi, sqrt

import numpy as np
from scipy.optimize import brentq, fsolve

from orbits import Mechanism, ReturnMap, find, find_all, prove, simulate
from orbits.mechanics import Mass, Spring
from problems import Chain, Hopper, Juggler, hopper_in_si, springs

from .case import Case
from .sources import ABRAMOWITZ, BLICKHAN, CHATTERJEE, LANDAU, PANKOV, REDDY

ROUNDED_TIMES = ((1.07, 4.45), (3.01, 4.45), (3.1, 4.49), (3.22, 2.46), (4.22, 3.26), (4.95, 4.45))


def proved_roots() -> list[float]:
    """The middle of the intervals in which launch speeds are proved to lie."""
    found = []
    for family in (1, 2, 3):
        speed = prove(find(Hopper(), family)).alpha
        assert speed is not None
        found.append((float(speed.low) + float(speed.high)) / 2)
    return found


def phase_times() -> list[float]:
    """Half the contact and half the flight of the lossless hops of three equal masses, for halves of at most 5."""
    chain = Chain((1.0, 1.0, 1.0))
    hops = find_all(chain, chain.starts(half_contact=5, half_flight=5))
    times = sorted((hop.contact_time / 2, hop.flight_time / 2) for hop in hops)
    return [time for pair in times for time in pair]


def phase_times_by_modes() -> list[float]:
    """The times by the modes alone, near rounded ones."""
    return [time for guess in ROUNDED_TIMES for time in fsolve(_mismatch, guess, xtol=1e-13)]


def _mismatch(times: np.ndarray) -> np.ndarray:
    """What two phase times of the chain leave of 7 linear equations for 5 amplitudes, in two numbers.

    Flight is a fall of all masses and two modes from rest in mid-flight, contact two modes from rest; at lift-off the
    lowest mass is at rest at height 0 and not accelerated, and the others go on with their places and speeds."""
    contact, flight = times
    laplacian = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    squares, modes = np.linalg.eigh(laplacian)
    w, u = np.sqrt(squares[1:]), modes[:, 1:]
    squares, v = np.linalg.eigh(laplacian[:2, :2])
    n = np.sqrt(squares)
    rest = np.linalg.solve(laplacian[:2, :2], [-1.0, -1.0])
    # Rows: place, speed and acceleration of the lowest mass, then places and speeds of the others.
    places, speeds = u * np.cos(w * flight), u * w * np.sin(w * flight)
    held, rates = v * np.cos(n * contact), -v * n * np.sin(n * contact)
    none = np.zeros((1, 2))
    rows = np.vstack([
        np.hstack([[[1.0]], places[2:], none]),
        np.hstack([[[0.0]], speeds[2:], none]),
        np.hstack([[[0.0]], -(w**2 * places)[2:], none]),
        np.hstack([np.ones((2, 1)), places[:2], -held]),
        np.hstack([np.zeros((2, 1)), speeds[:2], -rates]),
    ])  # fmt: skip
    right = np.array([flight**2 / 2, -flight, 1.0, *(flight**2 / 2 + rest), -flight, -flight])
    amplitudes = np.linalg.solve(rows[:5], right[:5])
    return rows[5:] @ amplitudes - right[5:]


def amplitudes_on_the_track() -> list[float]:
    """h, h1, h2, A1, A2 and A1/A2 of the juggler."""
    orbit = find(Juggler(mass_ratio=0.909))
    depth = -orbit(orbit.flight_time + orbit.contact_time / 2)[0]
    ball, hand = orbit.rises["ball"], orbit.rises["hand"]
    return [ball, hand, depth, ball + depth, hand + depth, (ball + depth) / (hand + depth)]


def inverted_masses() -> list[float]:
    """The largest difference of the next launches of two hoppers, where both have one impact."""
    launches = np.linspace(0.5, 30.0, 1000)
    heavy, light = (ReturnMap(Hopper(mass_ratio=ratio))(launches) for ratio in (1.5, 1 / 1.5))
    once = (heavy.impacts == 1) & (light.impacts == 1)
    return [np.nanmax(np.abs(heavy.next - light.next)[once])]


def hopping_in_place() -> list[float]:
    """The times in contact of a mass on a spring without mass that comes with speeds 0.5, 2, 10."""
    pushing = springs.function(lambda r, k: k * (r - abs(r)) / 2, breakpoints=(0.0,), k=1.0)
    mass = Mechanism(
        ("other", "mass"), [Spring("other", "0*r"), Spring("mass", pushing), Mass("mass", 1.0)], gap="other",
        inertia={"other": 1.0}, gravity=1.0, name="mass on a massless spring",
    )  # fmt: skip
    found = []
    for speed in (0.5, 2.0, 10.0):
        run = simulate(mass, state=[1.0, 0.0, speed**2 / 2, 0.0], time=speed + 6.3)
        leaves = brentq(lambda time, run=run: run(time)[2], speed + pi, speed + 6.2, xtol=1e-14)
        found.append(leaves - speed)
    return found


def fall_to_a_planet() -> list[float]:
    """The times of falls from rest at the heights 0.1, 3 and 20 over a planet of radius 2."""
    body = Mechanism(
        ("other", "body"), [Spring("other - 2*body", "0*r"), Mass("body", 1.0)], inertia={"other": 1.0}, gap="body",
        gravity="1/(1 + z/R)**2", parameters={"R": 2.0}, name="body over a planet",
    )  # fmt: skip
    return [
        simulate(body, state=[0.0, 0.0, height, 0.0], time=100.0, cap=1).events[0].time for height in (0.1, 3.0, 20.0)
    ]


def time_of_fall(height: float) -> float:
    """The time of such a fall in closed form."""
    share = 2.0 / (2.0 + height)
    return sqrt((2.0 + height) ** 3 / 8.0) * (acos(sqrt(share)) + sqrt(share * (1 - share)))


ROOTS = ("4.49341", "7.72525", "10.90412", "14.06619", "17.22076", "20.37130", "23.51945", "26.66605")
CASES = (
    Case(
        "Hopper with a linear spring",
        "launch speeds of lossless hops, families 1 to 8",
        ABRAMOWITZ,
        "table 4.19, roots of tan x = x",
        ROOTS,
        lambda: [find(Hopper(), family).alpha for family in range(1, 9)],
    ),
    Case(
        "Hopper with a linear spring",
        "launch speeds of families 1 to 3, proved in intervals",
        ABRAMOWITZ,
        "table 4.19, roots of tan x = x",
        ROOTS[:3],
        proved_roots,
        slow=True,
    ),
    Case(
        "Hopper with a linear spring",
        "launch speed (m/s) of 3 kg on 2 kg and 500 N/m; flight time over alpha",
        CHATTERJEE,
        "eqs. (13) and (11): alpha g sqrt(M (m1 + m2)/k) and 2",
        [4.493409457909064 * 9.80665 * sqrt(2 / 3 * 5.0 / 500.0), 2.0],
        lambda: [
            find(hopper_in_si(3.0, 2.0, stiffness=500.0)).alpha,
            find(Hopper()).flight_time / find(Hopper()).alpha,
        ],
        within=1e-12,
    ),
    Case(
        "Juggler on an air track",
        "h, h1, h2, A1, A2 and A1/A2; M = 0.909",
        CHATTERJEE,
        "section 10, eqs. (14)",
        ["10.095", "3.603", "8.942", "19.037", "12.545", "1.517"],
        amplitudes_on_the_track,
    ),
    Case(
        "Hoppers of M and 1/M",
        "largest difference of their return maps, hops of one impact; M = 1.5",
        REDDY,
        "abstract: the map is invariant under inversion of the mass ratio, which holds for hops of one impact",
        [0.0],
        inverted_masses,
        within=1e-12,
    ),
    Case(
        "Chain of three equal masses",
        "half contact and half flight of its 6 lossless hops up to 5",
        PANKOV,
        "the two equations in the two phase times, evaluated here with the modes of flight and contact",
        phase_times_by_modes(),
        phase_times,
        within=1e-11,
        slow=True,
    ),
    Case(
        "Mass on a massless spring",
        "time in contact, hopping in place with speeds 0.5, 2, 10 (omega = g = 1)",
        BLICKHAN,
        "closed form: 2 (pi - arctan(v omega/g))/omega",
        [2 * (pi - atan(speed)) for speed in (0.5, 2.0, 10.0)],
        hopping_in_place,
        within=1e-11,
    ),
    Case(
        "Body over a planet",
        "time of the fall from rest at height 0.1, 3, 20 (R = 2, g = 1)",
        LANDAU,
        "section 15, closed form of the radial motion",
        [time_of_fall(height) for height in (0.1, 3.0, 20.0)],
        fall_to_a_planet,
        within=1e-11,
    ),
)
