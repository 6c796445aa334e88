"""How finely a law varies, determined before anything is integrated.

A Taylor series at one extension does not see a bump at another, so an integration step may leap over it. Where a law
bends often, a family may have several orbits. Both show in the slopes of the law on a grid.
"""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..errors import NoOrbit
from ..symbolic import ElementwiseFunction, Kernel, cached, kinks_of, reaches_of
from .law import Algebraic, Key, Law, Parameters, evaluated, from_key, symbols_of, values_and_slopes


class FeatureOptions(NamedTuple):
    """How laws are sampled for what is finer than an integration step."""

    samples: int = 4096  # of the slope of a law, some 100 for each unit of length
    farthest: float = 20.0  # from rest, in units of length; a hop of the linear spring's third family stays within it
    block: int = 16  # laws whose slopes are sampled together, so that these stay in the processor's cache
    softest: float = 1e-12  # slopes below this, or above its inverse, set no unit of length
    # Smaller differences of slopes, relative to these, are rounding.
    slope_rounding: float = 1e3 * float(np.finfo(float).eps)
    # Where a slope times the unit of length is this large, the law has a singularity, and beyond it another branch.
    singular_slope: float = 1e6
    # Share of the distance that a series sees at which a force is sampled: an eighth of a bump's width.
    sampled_scale: float = 0.125
    secants_to_kink: int = 3  # where a kink is that of straight lines, the first one finds it
    halvings: int = 60  # of the distance between samples, at most: enough for a bump of the width 1e-12
    most_samples: int = 100_000  # of a law: one that varies faster is refused


FEATURES = FeatureOptions()
SAMPLED_SHARES = np.linspace(0.0, 1.0, FEATURES.samples)


class Features(NamedTuple):
    """The length over which a law varies, infinite where its fifth derivative vanishes; and how often it bends the
    other way."""

    length: float
    bends: int


NO_FEATURES = Features(math.inf, 0)


def features(key: Key, unit: float, p: Mapping[str, float]) -> Features:
    """The features of a spring, or of the gravity that varies around a spring, with this `unit_of_length`, as far as a
    hop may lead.

    A law in pieces is not searched for them, as its breakpoints end the steps.
    """
    if key.pieces is not None or key.degree() < 2:
        return NO_FEATURES
    low, high = ends_of_features(key, p, unit)
    values = tuple(p[name] for name in key.names)
    return _features(key, values, low, high, unit)


def ends_of_features(key: Key, p: Parameters, unit: Algebraic) -> tuple[Algebraic, Algebraic]:
    """How far features are searched for on either side, of one law or of many (m,)."""
    if key.variable == "r":
        return -FEATURES.farthest * unit, FEATURES.farthest * unit
    return 0.0 * unit, p.get("rest_length", 0.0) + 2 * FEATURES.farthest * unit


def units_of_length(spring: Key, p: Mapping[str, np.ndarray]) -> np.ndarray:
    """`unit_of_length` of laws with parameters (m,) by name, at rest at 0."""
    _, slopes = values_and_slopes(spring, p, np.zeros((len(next(iter(p.values()))), 1)))
    slope = slopes[:, 0]
    with np.errstate(all="ignore"):
        return np.where((slope > FEATURES.softest) & (slope < 1 / FEATURES.softest), 1 / slope, 1.0)


def unit_of_length(spring: Key, p: Mapping[str, float]) -> float:
    """The length over which a spring of constant slope, that at rest, comes to the foot's weight; 1 without a slope."""
    law = from_key(spring, p)
    slope = float(law.with_slope(law.rest())[1])
    return 1 / slope if FEATURES.softest < slope < 1 / FEATURES.softest else 1.0


@lru_cache(maxsize=256)
def _slopes(key: Key) -> ElementwiseFunction:
    """The function (x, p) -> slope of a law."""
    x, p = ca.SX.sym(key.variable), {name: ca.SX.sym(name) for name in key.names}
    slope = ca.jacobian(ca.SX(key.expression(x, p, [])), x)
    return ElementwiseFunction(ca.Function("slopes", [x, ca.vertcat(*p.values())], [slope]))


@lru_cache(maxsize=256)
def _features(key: Key, values: tuple[float, ...], low: float, high: float, unit: float) -> Features:
    places, slopes = _sampled_slopes(key, np.array([values]), np.array([low]), np.array([high]))
    return _features_of_branch(places[0], slopes[0], unit)


def _features_of_branch(places: np.ndarray, slopes: np.ndarray, unit: float) -> Features:
    """The features of a law with slopes (n,) at places (n,), between the singularities nearest to rest."""
    rest = int(np.abs(places).argmin())
    with np.errstate(invalid="ignore"):
        ends = (~(np.abs(slopes) < FEATURES.singular_slope / unit)).nonzero()[0]
    after = int(np.searchsorted(ends, rest))
    first, last = np.append(-1, ends)[after] + 1, np.append(ends, FEATURES.samples)[after]
    if last - first < 5:
        return NO_FEATURES
    lengths, bends = _lengths_and_bends(slopes[None, first:last], np.array([unit]), places[None, 1] - places[None, 0])
    return Features(float(lengths[0]), int(bends[0]))


def features_of_many(key: Key, spring: Key, p: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """`features` of laws with parameters (m,) by name: lengths (m,) and numbers of bends (m,). Where nothing depends on
    a length, since a law bends but once, it is infinite."""
    units = units_of_length(spring, p)
    lengths, bends = np.full((2, len(units)), np.nan)
    if key.pieces is not None or key.degree() < 2:
        lengths[:], bends[:] = NO_FEATURES
        return lengths, bends
    values = np.column_stack([p[name] for name in key.names]) if key.names else np.zeros((len(units), 0))
    low, high = ends_of_features(key, p, units)
    start = np.array([[0.0, 0.0, 0.0, 0.0, 1.0]])
    *_, turns, plain = _turns(key)(start, np.column_stack([low, high, FEATURES.singular_slope / units, values])).z.T
    steady = (plain == 1) & (turns <= 1)  # a law that bends at most once needs no more of its samples
    lengths[steady], bends[steady] = math.inf, turns[steady]
    others = (~steady).nonzero()[0]
    for first in range(0, len(others), FEATURES.block):
        block = others[first : first + FEATURES.block]
        places, slopes = _sampled_slopes(key, values[block], low[block], high[block])
        with np.errstate(invalid="ignore"):
            whole = (np.abs(slopes) < FEATURES.singular_slope / units[block, None]).all(axis=1)
        if whole.any():
            spacing = (places[:, 1] - places[:, 0])[whole]
            found = _lengths_and_bends(slopes[whole], units[block[whole]], spacing)
            lengths[block[whole]], bends[block[whole]] = found
        for i in np.flatnonzero(~whole).tolist():
            lengths[block[i]], bends[block[i]] = _features_of_branch(places[i], slopes[i], units[block[i]])
    return lengths, bends


@lru_cache(maxsize=256)
def _turns(key: Key) -> Kernel:
    """The samples of a law's slopes, one after the other: (z, (low, high, singular slope, parameters)) -> z, which is
    the number of samples, the last slope, whether it fell, how often a fall began or ended, and whether no slope is
    singular. A law that bends more than once, or has a singularity, is not sampled to its end."""
    z, data = ca.SX.sym("z", 5), ca.SX.sym("data", 3 + len(key.names))
    (count, before, fell, turns, plain), (low, high, singular) = ca.vertsplit(z), ca.vertsplit(data[:3])
    slope = _slopes(key).function(low + (high - low) * (count * SAMPLED_SHARES[1]), data[3:])
    falls = slope < before
    turned = ca.logic_and(count >= 2, falls != fell)
    turns, plain = turns + turned, ca.logic_and(plain, ca.fabs(slope) < singular)
    goes = ca.logic_and(ca.logic_and(plain, turns <= 1), count + 1 < FEATURES.samples)
    return Kernel(ca.Function("turns", [z, data], [ca.vertcat(count + 1, slope, falls, turns, plain), 0, goes]))


def _sampled_slopes(key: Key, values: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (m, n) between bounds (m,), and the slopes (m, n) there of laws with parameters (m, k)."""
    places = low[:, None] + (high - low)[:, None] * SAMPLED_SHARES
    p = np.repeat(values, FEATURES.samples, axis=0) if len(values) > 1 else values
    return places, _slopes(key)(places.reshape(-1, 1), p)[0].reshape(places.shape)


def _lengths_and_bends(slopes: np.ndarray, units: np.ndarray, spacing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The features (m,) of laws with slopes (m, n) at places with these distances (m,), in units of length (m,)."""
    floor = FEATURES.slope_rounding * np.maximum(np.abs(slopes), 1 / units[:, None])
    change = slopes[:, 1:] - slopes[:, :-1]
    rises = [row[beyond] > 0 for row, beyond in zip(change, np.abs(change) > floor[:, 1:], strict=True)]
    bends = np.array([np.count_nonzero(row[1:] != row[:-1]) for row in rises])
    bend = change[:, 1:] - change[:, :-1]
    second, third = np.abs(bend[:, 1:-1]), bend[:, 1:] - bend[:, :-1]
    fourth = np.abs(third[:, 1:] - third[:, :-1])
    # Where the second difference is larger than its neighbours, in a circle, it does not vanish by chance.
    around = np.concatenate([second[:, -1:], second, second[:, :1]], axis=1)
    peak = (second >= around[:, :-2]) & (second >= around[:, 2:]) & (fourth > floor[:, 2:-2])
    ratio = np.divide(fourth, second, out=np.zeros(second.shape), where=peak).max(axis=1, initial=0.0)
    return np.divide(spacing, np.sqrt(ratio), out=np.full(len(ratio), np.inf), where=ratio > 0), bends


def sampled_closely(law: Law, places: np.ndarray) -> np.ndarray:
    """Places (n,), ascending or descending, with further ones between them where the law may vary unseen, and at its
    kinks.

    Raises `NoOrbit` for a law that would take more than `FEATURES.most_samples`.
    """
    if _scale_of_law(law.key) is None:
        return places
    p = {name: np.array([value]) for name, value in law.parameters.items()}
    for turn in range(FEATURES.halvings):
        distances, *kinks = (each[0] for each in evaluated(_scale_of_law, law.key, p, places[None]))  # type: ignore[arg-type]
        low, high = places[:-1], places[1:]
        with np.errstate(all="ignore"):
            unseen = np.abs(high - low) > FEATURES.sampled_scale * np.fmax(distances[:-1], distances[1:])
            new = [0.5 * (low + high)[unseen]]
            for kink in kinks if turn < FEATURES.secants_to_kink else ():
                crossed = (kink[:-1] * kink[1:] < 0).nonzero()[0]
                share = kink[crossed] / (kink[crossed] - kink[crossed + 1])
                new.append(places[crossed] + share * (places[crossed + 1] - places[crossed]))
        found = np.unique(np.concatenate([places, *new]))
        if len(found) == len(places):
            break
        if len(found) > FEATURES.most_samples:
            fine = np.abs(np.diff(found)).min()
            raise NoOrbit(f"'{law.text[:60]}' varies within {fine:.1g} of {law.variable} over a long range: smooth it")
        places = found if places[-1] > places[0] else found[::-1]
    return places


@cached
def _scale_of_law(key: Key) -> ElementwiseFunction | None:
    """The function (x, p, q) -> how far from a place a law does not change by more than a series shows, and what
    vanishes at its kinks; None where there is neither."""
    x, p = symbols_of(key.variable, key.names)
    q = ca.SX.sym("q", key.pieces.size if key.pieces else 0)
    own = ca.vertcat(*p.values(), q)
    law = ca.Function("law", [x, own], [ca.SX(key.expression(x, p, ca.vertsplit(q)))])
    reaches, kinks = reaches_of(law, x, own, waves=True), kinks_of(law, x, own)
    if not (reaches or kinks.numel()):
        return None
    distance = ca.SX(np.inf)
    for weights, change in reaches:
        distance = ca.fmin(distance, change.least / ca.fabs(weights))
    results = [distance, *ca.vertsplit(kinks)]
    return ElementwiseFunction(ca.Function("scales", [x, ca.vertcat(*p.values()), q], results))
