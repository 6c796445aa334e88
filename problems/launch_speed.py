"""The first estimate of an orbit under constant gravity: the lowest launch speed of a family."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from orbits.errors import FlowError, NoOrbit, OutOfRange
from orbits.flow.flow import flow_of
from orbits.model.phase import Phase
from orbits.numerics.bernstein import Crossings
from orbits.numerics.roots import bracketed_root

# Bounds of the search, in multiples of the machine's own scale of speed. Beyond the fastest, per family, a hop is 5e7
# lengths high and more, which is no machine; from the slowest the search starts again when its first speed is too fast.
FASTEST, SLOWEST = 1e4, 1e-3
# Accuracy of the estimate, as a share of half an oscillation; Newton's method does the rest.
ACCURACY = 1e-3
# And as a share of how far the equation goes beyond zero, for another root may be close above.
DEPTH = 0.01
# Shortest step of the search, as a share of the speed.
SHORTEST_STEP = 0.02
# Time followed in search of two turns, per 1 + launch speed; a spring that takes longer does not return.
LONGEST_FLIGHT = 1e3


class _Sample(NamedTuple):
    """The equation at a launch speed: the time by which the family's turn comes after mid-flight (infinite when it
    never comes, with the reason), and half the period of the extension."""

    alpha: float
    lateness: float
    half_period: float = np.inf
    reason: str = ""


def lowest_launch_speed(
    phase: Phase, p: dict[str, float], liftoff: float, family: int, scale: float, what: str
) -> float:
    """The lowest launch speed whose half flight ends on the family's turn: alpha = first turn + family half periods.

    The time of that turn depends on alpha alone, so this is one scalar equation for any spring, and the family is right
    by construction.

    phase : the relative motion r'' = -F(r)
    scale : the speed in whose multiples the search goes
    what : the spring, in words

    Raises `NoOrbit` when there is no such speed.
    """

    sample = partial(_sample, phase, p, liftoff, family)
    fastest, slowest = FASTEST * family * scale, SLOWEST * scale
    samples = [_Sample(0.0, 1.0)]
    no_return = np.inf  # the lowest speed from which the extension does not come back
    alpha, reason = 2 * family * scale, ""  # rather low for most springs; where it is too fast, from the slowest
    while alpha < fastest and samples[-1].alpha < (1 - 1e-4) * no_return:
        new = sample(alpha)
        reason = new.reason or reason
        if len(samples) == 1 and alpha > slowest and not 0 < new.lateness < np.inf:
            alpha, reason = slowest, ""
            continue
        if new.lateness <= 0:
            return _estimated_root(sample, samples[-1], new)
        if np.isfinite(new.lateness):
            samples.append(new)
        elif alpha > slowest:
            no_return = alpha
        else:
            break
        # Near a fold, a pair of roots lies between samples; the start at speed 0 does not count.
        if len(samples) > 3 and samples[-3].lateness > samples[-2].lateness <= samples[-1].lateness:
            lowest = _golden_section(sample, samples[-3].alpha, samples[-1].alpha)
            if lowest.lateness <= 0:
                return _estimated_root(sample, samples[-3], lowest)
        alpha = _next_speed(samples, scale, no_return)
    reason = reason or f"none up to launch speed {fastest:g}"
    raise NoOrbit(f"{what} has no lossless orbit of family {family} under constant gravity: {reason}")


def half_oscillations(phase: Phase, p: dict[str, float], liftoff: float, alpha: float) -> tuple[float, float]:
    """Time from lift-off to the first turn of the extension, and half its period.

    Both are infinite when it does not return within `LONGEST_FLIGHT`. Raises `FlowError` when the motion ends before.
    """
    turns, clock, crossings = [], [0.0], Crossings()

    def second_turn(coefficients, steps):
        for i, t in crossings(coefficients[:, 1], steps):
            turns.append(clock[0] + steps[:i].sum() + t)
            if len(turns) == 2:
                return i, t
        clock[0] += steps.sum()
        return None

    longest = LONGEST_FLIGHT * (1 + alpha)
    flow_of(phase, tuple(p)).run([liftoff, alpha], list(p.values()), longest, stop=second_turn)
    return (turns[0], turns[1] - turns[0]) if len(turns) == 2 else (np.inf, np.inf)


def _sample(phase: Phase, p: dict[str, float], liftoff: float, family: int, alpha: float) -> _Sample:
    try:
        first, half_period = half_oscillations(phase, p, liftoff, alpha)
    except OutOfRange as error:
        return _Sample(alpha, np.inf, reason=f"beyond launch speed {alpha:.4g} {error}")
    except FlowError as error:
        return _Sample(alpha, np.inf, reason=f"at launch speed {alpha:.4g} the extension does not come back: {error}")
    if np.isfinite(first):
        return _Sample(alpha, first + family * half_period - alpha, half_period)
    return _Sample(alpha, np.inf, reason=f"at launch speed {alpha:.4g} the extension does not come back")


def _estimated_root(sample: Callable, early: _Sample, late: _Sample) -> float:
    """The root between a sample where the turn comes too late and a faster one where it comes too early."""
    enough = min(ACCURACY * late.half_period, DEPTH * abs(late.lateness))
    return bracketed_root(
        lambda alpha: sample(alpha).lateness, early.alpha, late.alpha, early.lateness, late.lateness, enough
    )


def _next_speed(samples: list[_Sample], scale: float, no_return: float) -> float:
    """The next speed of the search: just past where the last two samples point, so that it brackets the root."""
    before, last = samples[-2:]
    slope = (last.lateness - before.lateness) / (last.alpha - before.alpha) if len(samples) > 2 else 0.0
    ahead = 1.2 * last.lateness / max(-slope, 0.3) if slope < 0 else last.lateness / 1.5
    alpha = last.alpha + max(ahead, SHORTEST_STEP * (scale + last.alpha))
    return alpha if alpha < no_return else 0.5 * (last.alpha + no_return)


def _golden_section(sample: Callable, a: float, b: float) -> _Sample:
    """A minimum between speeds a and b, to half the digits (no more are determined), or a sample not above zero."""
    ratio = (np.sqrt(5) - 1) / 2
    left, right = sample(b - ratio * (b - a)), sample(a + ratio * (b - a))
    while abs(b - a) > 1e-8 * (abs(a) + abs(b)) and min(left.lateness, right.lateness) > 0:
        if left.lateness < right.lateness:
            b, right = right.alpha, left
            left = sample(b - ratio * (b - a))
        else:
            a, left = left.alpha, right
            right = sample(a + ratio * (b - a))
    return left if left.lateness < right.lateness else right
