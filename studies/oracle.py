"""What an orbit is held against: scipy's integrator on the machine's equations, and a map in 45 digits.

Nothing of the toolkit's integrators, searches or certificates is used: of an orbit only what it says.
"""

from collections.abc import Callable
from itertools import pairwise

import mpmath as mp
import numpy as np
from scipy.integrate import solve_ivp

# Of the integrator; and what it may leave, in shares of the motion's size and time, where the field is smooth and where
# it is in pieces. That goes through the sensitivity of the launch speed.
RTOL, LEFT = 1e-12, {False: 3e-11, True: 3e-10}
# A sampled gap, force or separation this far beyond zero, as a share of its size, contradicts the orbit.
BEYOND = 1e-7
# The launch state's own equations hold to this.
AT_LAUNCH = 1e-9


def by_another_integrator(machine, family: int) -> Callable:
    """(orbit) -> what is wrong with it, in words, or None.

    Launch: gap, its speed and its acceleration vanish. Flight: integrated to its middle, where the machine must be at
    rest; what is missing goes through the derivatives by alpha and time, and is to be within the orbit's error and what
    the integrator may leave. The extension turns as often as the family says, the gap is positive or said not to be.
    Contact: it ends when the orbit says.
    """
    flight, contact = _rates(machine, machine.model.flight), _rates(machine, machine.model.contact)
    extension = np.array(machine.model.extension.weights)
    gap = np.array(machine.model.gap(machine.values).weights)

    def check(orbit) -> str | None:
        if orbit.family != family:
            return f"family {orbit.family}, not {family}"
        start, half = orbit(0.0), orbit.flight_time / 2
        rate = flight(0.0, start)
        launch = [machine.model.gap(machine.values).offset + gap @ start, gap @ rate, gap[::2] @ rate[1::2]]
        if not np.abs(launch).max() <= AT_LAUNCH * (1 + np.abs(start).max()):
            return f"no launch: gap, its speed and acceleration are {launch}"
        if not np.abs(start - _launch(machine, orbit, orbit.alpha)).max() <= AT_LAUNCH * (1 + np.abs(start).max()):
            return f"the flight begins at {start}, another launch than it says"
        size = 1 + np.abs(orbit(np.linspace(0, orbit.flight_time, 50))).max()
        turn = lambda t, x: extension @ flight(t, x)  # noqa: E731
        run = _travel(flight, start, half, size, turn)
        if not run.success:
            return f"the other integrator gives up: {run.message}"
        nudge = 1e-6 * orbit.alpha
        moved = _travel(flight, _launch(machine, orbit, orbit.alpha + nudge), half, size).y[1::2, -1]
        slopes = np.column_stack([(moved - run.y[1::2, -1]) / nudge, flight(half, run.y[:, -1])[1::2]])
        inverse = np.linalg.pinv(slopes)[0]
        left = LEFT[machine.model.flight.pieces is not None] * size * (1 + half) * np.abs(inverse).sum()
        off = inverse @ run.y[1::2, -1]
        if not abs(off) <= 2 * orbit.error + left:
            return f"alpha is off by {off:.1e}, and claims {orbit.error:.1e} (the check sees {left:.1e})"
        times = run.t_events[0]
        turns = np.sum((times > 1e-9 * half) & (times < half * (1 - 1e-6)))
        if turns != family:
            return f"{turns} turns before mid-flight, not {family}"
        heights = machine.model.gap(machine.values).offset + gap @ run.y[:, run.t > 0.02 * half]
        below = heights.min(initial=np.inf) < -BEYOND * size
        if below and not any(machine.model.violations["gap"] in words for words in orbit.violations):
            return f"the gap is {heights.min():.1e} in a flight said to be free"
        return _contact(machine, contact, orbit, size)

    return check


def _rates(machine, phase) -> Callable:
    """(t, x) -> the phase's rates, by its own field on numbers."""
    p, pieces = machine.values, phase.pieces
    breaks, data = pieces.table(p) if pieces else ([], [[]])

    def rates(t, x):
        piece = np.clip(np.searchsorted(breaks, pieces.place(x, p)) - 1, 0, len(data) - 1) if pieces else 0
        return np.array([float(rate) for rate in phase.field(list(x), p, list(data[piece]))])

    return rates


def _travel(rates, start, duration: float, size: float, *events):
    with np.errstate(all="ignore"):  # a trial step that overflows is refused by the integrator
        return solve_ivp(
            rates, (0, duration), start, "DOP853", rtol=RTOL, atol=0.1 * RTOL * size, events=events or None
        )


def _launch(machine, orbit, alpha: float) -> np.ndarray:
    """The state (n,) of a launch with speed `alpha` at the orbit's extension."""
    return np.array(machine.model.launch({"liftoff": orbit.liftoff_extension, "alpha": alpha}, machine.values))


def _contact(machine, rates, orbit, size: float) -> str | None:
    """What is wrong with the contact's duration, where the orbit knows it."""
    if orbit.contact_time is None:
        return None if orbit.violations else "a contact without end, and no violation"
    start = machine.model.touchdown({"liftoff": orbit.liftoff_extension, "alpha": orbit.alpha}, machine.values)
    half = orbit.contact_time / 2
    run = _travel(rates, [float(x) for x in start], half, size)
    if not run.success:
        return f"the other integrator gives up in contact: {run.message}"
    late = run.y[1, -1] / max(abs(rates(half, run.y[:, -1])[1]), 1e-300)
    return None if abs(late) <= 1e-6 * (1 + half) * size else f"the contact's middle is off by {late:.1e}"


def landed(alpha: float, mass_ratio: float) -> tuple[float, int]:
    """Loss, of the square of the launch speed, and impacts of the linear hopper in 45 digits: the gap is a parabola
    less a cosine, convex and concave in turn between known times."""
    with mp.workdps(45):
        M, loss, impacts = mp.mpf(mass_ratio), mp.mpf(0), 0
        r, v, w, u = mp.mpf(1), mp.mpf(alpha), mp.mpf(1), mp.mpf(alpha)
        while True:
            size, phase = mp.hypot(r, v), mp.atan2(v, r)
            gap = lambda t: w + u * t - t * t / 2 - size * mp.cos(t - phase)  # noqa: B023, E731
            rate = lambda t: u - t + size * mp.sin(t - phase)  # noqa: B023, E731
            t = _first_zero(gap, rate, size, phase)
            impacts += 1
            height = (w + u * t - t * t / 2 + M * size * mp.cos(t - phase)) / (1 + M)
            speed = (u - t - M * size * mp.sin(t - phase)) / (1 + M)
            loss += M * (rate(t) / (1 + M)) ** 2
            r, v, w, u = height, speed, height, speed
            if height <= 1:
                return float(loss), impacts


def _first_zero(gap, rate, size, phase):
    turn = mp.acos(1 / size) if size > 1 else 0
    bends = sorted(phase + side * turn + 2 * mp.pi * j for side in (-1, 1) for j in range(-2, 40))
    places = [mp.mpf(0), *(t for t in bends if t > mp.mpf(10) ** -25)]
    for low, high in pairwise(places):
        if gap(high) < 0:
            start = low or _halved(lambda t: gap(t) > 0, high)
            return bisected(gap, start, high)
        if low and rate(low) < 0 < rate(high):  # convex, down and up again: it may dip
            bottom = bisected(lambda t: -rate(t), low, high)
            if gap(bottom) < 0:
                return bisected(gap, low, bottom)
    raise AssertionError("no zero")


def _halved(true, t):
    while not true(t):
        t /= 2
    return t


def bisected(positive: Callable, a, b):
    """Where a function of mpmath's numbers turns from positive to negative, between `a` and `b`."""
    for _ in range(150):
        middle = (a + b) / 2
        a, b = (middle, b) if positive(middle) > 0 else (a, middle)
    return (a + b) / 2
