"""How finely a law varies, looked at before anything is integrated.

A Taylor series at one extension does not see a bump at another, so that an integration step may leap over it; and where
a law bends often, a family may have several orbits. Both show in the slopes of the law on a grid.
"""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from orbits.symbolic.calls import ElementwiseFunction

from .laws import Key, from_key

# So many slopes are looked at, up to this distance from rest in units of length, and up to twice the height. A hop of
# the linear spring's third family stays within it.
LAW_SAMPLES, FARTHEST = 4096, 20.0
SAMPLED_SHARES = np.linspace(0.0, 1.0, LAW_SAMPLES)
# Slopes below this, or above its inverse, set no unit of length.
SOFTEST = 1e-12
# Functions that vanish, or come to a limit, as fast as an exponential: a series far from where they vary shows nothing.
HIDING = {getattr(ca, f"OP_{name}") for name in ("EXP", "EXPM1", "TANH", "COSH", "SINH", "ERF")}
# Quotients and powers hide bumps, where a law bends there and back; where it only steepens, there is a pole ahead.
HIDING_BUMPS = {getattr(ca, f"OP_{name}") for name in ("DIV", "INV", "POW", "CONSTPOW")}
# A step goes at most so many times the length over which the law varies, which is 0.3 widths of a Gaussian bump: a
# series sees one from nine widths away, and from six its force is below rounding. No bound is set for lengths above
# this share of the unit: the steps are as short by themselves.
STEP_LENGTHS, NARROW_SHARE = 10.0, 0.2
# Differences of slopes below this multiple of their rounding are rounding. Where a slope is so many times their order,
# the law has a singularity, and beyond it another branch.
SLOPE_ROUNDING, SINGULAR_SLOPE = 1e3 * float(np.finfo(float).eps), 1e6


class Features(NamedTuple):
    """The length over which a law varies, infinite where its fifth derivative vanishes; and how often it bends the
    other way."""

    length: float
    bends: int


NO_FEATURES = Features(math.inf, 0)


def features(key: Key, unit: float, p: Mapping[str, float]) -> Features:
    """The features of a spring, or of the gravity that varies around a spring, with this `unit_of_length`, as far as a
    hop may lead.

    None are looked for in a law in pieces, whose breakpoints end the steps.
    """
    if key.pieces is not None or key.degree() < 2:
        return NO_FEATURES
    low, high = (-FARTHEST, FARTHEST) if key.variable == "r" else (0.0, p.get("rest_length", 0.0) / unit + 2 * FARTHEST)
    values = tuple(p[name] for name in key.names)
    return _features(key._replace(reach=math.inf), values, low * unit, high * unit, unit)


def with_reach(key: Key, spring: Key, p: Mapping[str, float]) -> Key:
    """The key of a law with how far an integration step may go along its variable.

    That is infinite for one that hides nothing. Else it is rounded to a power of two, so that machines share models.
    """
    hides, hides_bumps = (not functions.isdisjoint(_operations(key)) for functions in (HIDING, HIDING_BUMPS))
    if not (hides or hides_bumps):
        return key
    unit = unit_of_length(spring, p)
    length, bends = features(key, unit, p)
    narrow = length < NARROW_SHARE * unit and (hides or bends > 1)
    return key._replace(reach=STEP_LENGTHS * 2.0 ** math.floor(math.log2(length))) if narrow else key


def unit_of_length(spring: Key, p: Mapping[str, float]) -> float:
    """The length over which a spring of constant slope, that at rest, comes to the foot's weight; 1 without a slope."""
    law = from_key(spring, p)
    slope = float(law.with_slope(law.rest())[1])
    return 1 / slope if SOFTEST < slope < 1 / SOFTEST else 1.0


@lru_cache(maxsize=256)
def _operations(key: Key) -> frozenset[int]:
    """What the slope of a law is computed by; nothing for laws in which no features are looked for."""
    if key.pieces is not None or key.degree() < 2:
        return frozenset()
    slope = _slopes(key).function
    return frozenset(slope.instruction_id(i) for i in range(slope.n_instructions()))


@lru_cache(maxsize=256)
def _slopes(key: Key) -> ElementwiseFunction:
    """The function (x, p) -> slope of a law."""
    x, p = ca.SX.sym(key.variable), {name: ca.SX.sym(name) for name in key.names}
    slope = ca.jacobian(ca.SX(key.expression(x, p, [])), x)
    return ElementwiseFunction(ca.Function("slopes", [x, ca.vertcat(*p.values())], [slope]))


@lru_cache(maxsize=256)
def _features(key: Key, values: tuple[float, ...], low: float, high: float, unit: float) -> Features:
    places = low + (high - low) * SAMPLED_SHARES
    slopes = _slopes(key)(places[:, None], np.array([values]))[0].ravel()
    rest = int(np.abs(places).argmin())
    with np.errstate(invalid="ignore"):
        ends = (~(np.abs(slopes) < SINGULAR_SLOPE / unit)).nonzero()[0]
    after = int(np.searchsorted(ends, rest))
    first, last = np.append(-1, ends)[after] + 1, np.append(ends, LAW_SAMPLES)[after]
    slopes = slopes[first:last]
    if len(slopes) < 5:
        return NO_FEATURES
    floor = SLOPE_ROUNDING * np.maximum(np.abs(slopes), 1 / unit)
    change = slopes[1:] - slopes[:-1]
    rises = change[np.abs(change) > floor[1:]] > 0
    bend = change[1:] - change[:-1]
    second, third = np.abs(bend[1:-1]), bend[1:] - bend[:-1]
    fourth = np.abs(third[1:] - third[:-1])
    # Where the second difference is larger than its neighbours, in a circle, it does not vanish by chance.
    around = np.concatenate([second[-1:], second, second[:1]])
    peak = (second >= around[:-2]) & (second >= around[2:]) & (fourth > floor[2:-2])
    ratio = float(np.max(fourth[peak] / second[peak], initial=0.0))
    length = float(places[1] - places[0]) / math.sqrt(ratio) if ratio else math.inf
    return Features(length, int(np.count_nonzero(rises[1:] != rises[:-1])))
