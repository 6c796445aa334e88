"""Recorded hops of a leg whose motion does not come from the project: DOP853 with the equations written by hand."""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from problems import hopper_in_si
from problems.recordings import SAMPLE, HopFit, fit

GRAVITY = 9.80665
BODY, FOOT, STIFFNESS, CUBIC, LENGTH, DAMPING = 12.0, 2.0, 15000.0, 2e6, 0.6, 30.0
TRUTH = {"foot_mass": FOOT, "k": STIFFNESS, "b": CUBIC, "damping": DAMPING}
NAMES = tuple(TRUTH)
START = hopper_in_si(
    BODY, 2.5, force="k*r + b*r**3", parameters={"k": 12500.0, "b": 2.4e6}, rest_length=LENGTH, damping=22.0
)
UNITS = {"height": "m", "length": "m", "speed": "m/s", "acceleration": "m/s^2", "force": "N"}


def tension(x: Sequence[float]) -> float:
    """The force of spring and damper at the state (body, its speed, foot, its speed), heights in m."""
    r, rate = x[0] - x[2] - LENGTH, x[1] - x[3]
    return STIFFNESS * r + CUBIC * r**3 + DAMPING * rate


def in_flight(t: float, x: Sequence[float]) -> list[float]:
    return [x[1], -tension(x) / BODY - GRAVITY, x[3], tension(x) / FOOT - GRAVITY]


def in_contact(t: float, x: Sequence[float]) -> list[float]:
    return [x[1], -tension(x) / BODY - GRAVITY, 0.0, 0.0]


def lands(t: float, x: Sequence[float]) -> float:
    return x[2]


def lifts(t: float, x: Sequence[float]) -> float:
    return FOOT * GRAVITY - tension(x)


lands.terminal, lands.direction = True, -1
lifts.terminal, lifts.direction = True, -1


def hops(speed: float, count: int, rate: float) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times and channels of hops from a launch with this speed of the body, sampled at this rate.

    Where the spring pulls harder than the foot weighs after an impact, the foot leaves again at once.
    """
    rise = np.roots([CUBIC, 0, STIFFNESS, DAMPING * speed - FOOT * GRAVITY])
    x = np.array([LENGTH + rise[np.isreal(rise)].real[0], speed, 0.0, 0.0])
    grid, rows, t, contact, left = np.arange(0, 30, 1 / rate), [], 0.0, False, count
    while left:
        # Just after a lift-off the foot is on the ground.
        start = [in_flight, lands] if not contact else [in_contact, lifts]
        options = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12, "dense_output": True}
        begin = t
        if not contact:
            ahead = solve_ivp(in_flight, (t, t + 1e-4), x, **options)
            begin, first = t + 1e-4, ahead.y[:, -1]
        found = solve_ivp(start[0], (begin, begin + 5), first if not contact else x, events=start[1], **options)
        end = found.t[-1]
        for time in grid[(grid >= t) & (grid < end)]:
            rows.append((time, contact, (found if time >= begin else ahead).sol(time)))
        t, x = end, found.y[:, -1]
        if contact:
            contact, left = False, left - 1
        else:
            x[2:] = 0.0
            contact = tension(x) < FOOT * GRAVITY
    return _channels(rows)


def _channels(rows: list) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    times, states = np.array([row[0] for row in rows]), np.array([row[2] for row in rows])
    rates = np.array([(in_contact if contact else in_flight)(0.0, x) for _, contact, x in rows])
    force = [FOOT * GRAVITY - tension(x) if contact else 0.0 for _, contact, x in rows]
    return times, {
        "body height": states[:, 0], "foot height": states[:, 2], "spring length": states[:, 0] - states[:, 2],
        "body speed": states[:, 1], "foot speed": states[:, 3], "body acceleration": rates[:, 1],
        "foot acceleration": rates[:, 3], "ground force": np.array(force),
    }  # fmt: skip


def record(
    times: np.ndarray, channels: Mapping[str, np.ndarray], names: Sequence[str], noise: float, seed: int = 0
) -> dict[str, np.ndarray]:
    """A record of some channels, with noise relative to half of their range."""
    rng = np.random.default_rng(seed)
    found = {"time [s]": times + 7.0}
    for name in names:
        values = channels[name]
        deviation = 0.5 * noise * np.ptp(values)
        found[f"{name} [{UNITS[name.split()[-1]]}]"] = values + deviation * rng.standard_normal(len(values))
    return found


@cache
def three_hops() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    return hops(1.5, 3, 250.0)


@cache
def fit_of_heights() -> HopFit:
    """A fit of masses, spring and damper to heights alone."""
    return fit(START, record(*three_hops(), ("body height", "foot height"), 0.01), ("body_mass", *NAMES))


def short_fit() -> HopFit:
    """A fit of few unknowns to a single hop."""
    return fit(START, record(*hops(1.5, 1, 250.0), ("body height", "foot height"), 0.01), ("foot_mass", "k"))


def deviations_from_truth(found: HopFit, truth: Mapping[str, float] = TRUTH) -> dict[str, float]:
    """By how many stated deviations each value is off."""
    return {name: (found.values[name] - truth[name]) / found.deviations[name] for name in found.values}


def sample() -> dict[str, Any]:
    """The arguments of a fit of the sample record."""
    return {"machine": START, "source": SAMPLE, "unknown": ("foot_mass", "k")}
