"""Launch speeds between which the turning points of an extension move over no feature of a spring's law.

Under constant gravity the extension r moves alone, r'' = -rate g(r), and its energy says where it turns: a launch at
the speed alpha from lift-off turns where the integral W of g from there is alpha^2/(2 rate), above and below. The times
of its turns vary with alpha as g varies about both turning points, so that a grid of launch speeds resolves them where
the turning points of neighbours enclose no more than a small change of g and of its slope. A constant grid does not:
the turning points move by alpha/(rate g) per speed, far where the force is nearly flat. Where g vanishes outside the
motion, at a barrier, the times grow without bound as a logarithm: speeds accumulate on both sides.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..numerics import GAUSS_PLACES, GAUSS_WEIGHTS

# Places outward from lift-off at which a law is sampled first, in units of length.
OUTWARD = np.geomspace(1e-2, 1e10, 241)


class SplitOptions(NamedTuple):
    """Which cells between samples of a law are split, and where."""

    change_of_force: float = 0.3  # share of itself by which the force changes in a cell, at most
    change_of_slope: float = 3e-2  # share of the force over the length of the cell by which the slope changes, at most
    shortest: float = 1e-4  # share of the distance from lift-off and of the unit of length: no shorter cells are split
    splits: int = 60
    place: float = 0.5 * (3 - 5**0.5)  # share of a cell: at their middles a wave may look as at their ends


SPLITS = SplitOptions()
# Relative distances of launch speeds from one that leads to a barrier, whose own error is smaller.
BESIDE_BARRIERS = 10.0 ** np.arange(-8, 0)


def turning_speeds(
    force: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], liftoff: float, ends: tuple[float, float],
    unit: float, fastest: float, most: int,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """Launch speeds (k,), ascending, that resolve the turning points of the extension, and the speed up to which they
    do: the fastest one, or a slower one where that takes too many.

    force : extensions (m,) -> g (m,) and its slope (m,), 1 at lift-off; launch speeds are those at rate 1
    ends : of the range of the law
    unit : of length, over which a spring of the slope at rest comes to the foot's weight
    most : the largest number of places on a side
    """
    found = list[np.ndarray]()
    for side, end in zip((1.0, -1.0), ends[::-1], strict=True):
        places = np.append(0.0, unit * OUTWARD)
        places = liftoff + side * np.append(places[places < side * (end - liftoff)], min(side * (end - liftoff), 1e300))
        speeds, fastest = _speeds_of_side(force, places[np.isfinite(places)], unit, fastest, most)
        found.append(speeds)
    speeds = np.unique(np.concatenate(found))
    return speeds[speeds < fastest], fastest


def _speeds_of_side(
    force: Callable, places: np.ndarray, unit: float, fastest: float, most: int
) -> tuple[np.ndarray, float]:
    """The launch speeds with a turning point at one of the places (n,) outward from lift-off, or between them where
    the force is not resolved, and the speed up to which they resolve it."""
    values, slopes = force(places)
    for _ in range(SPLITS.splits):
        with np.errstate(invalid="ignore", over="ignore"):
            known = int(np.append(np.isfinite(values) & np.isfinite(slopes), False).argmin())
            places, values, slopes = places[:known], values[:known], slopes[:known]
            lengths = np.diff(places)
            works = lengths / 2 * (values[1:] + values[:-1]) - lengths**2 / 12 * np.diff(slopes)
            energies = np.append(0.0, np.cumsum(works))
            beyond = int(np.append(energies > fastest**2 / 2, True).argmax()) + 1
            if beyond > most:
                beyond, fastest = most, float(np.sqrt(2 * energies[:most].max()))
            places, values, slopes, energies = (each[:beyond] for each in (places, values, slopes, energies))
            lengths, highest = np.diff(places), np.maximum.accumulate(energies)
            turns = (energies[1:] >= highest[:-1]) | (energies[:-1] == highest[:-1])
            size = np.maximum(np.abs(values[1:]), np.abs(values[:-1]))
            steepest = np.maximum(np.abs(slopes[1:]), np.abs(slopes[:-1]))
            change = np.maximum(np.abs(np.diff(values)), steepest * np.abs(lengths) / 2)
            coarse = change > SPLITS.change_of_force * size
            coarse |= np.abs(np.diff(slopes) * lengths) > SPLITS.change_of_slope * size
            long = np.abs(lengths) > SPLITS.shortest * (np.abs(places[1:] - places[0]) + unit)
        cells = np.flatnonzero(turns & long)
        new = places[cells] + SPLITS.place * lengths[cells]
        found = force(new)
        with np.errstate(invalid="ignore"):  # waves may have equal slopes at both ends
            line = slopes[cells] + SPLITS.place * (slopes[cells + 1] - slopes[cells])
            bent = np.abs((found[1] - line) * lengths[cells])
            chosen = coarse[cells] | ~(bent <= SPLITS.change_of_slope * size[cells])
            # Where a force fades away, its work changes no launch speed.
            work = np.maximum(size[cells], np.abs(found[0])) * np.abs(lengths[cells])
            chosen &= ~(work <= np.finfo(float).eps * highest[cells])
        if not chosen.any():
            break
        cells, new = cells[chosen], new[chosen]
        places = np.insert(places, cells + 1, new)
        values, slopes = (
            np.insert(old, cells + 1, each[chosen]) for old, each in zip((values, slopes), found, strict=True)
        )
    return _speeds_at(force, places, values, slopes, fastest), fastest


def _speeds_at(
    force: Callable, places: np.ndarray, values: np.ndarray, slopes: np.ndarray, fastest: float
) -> np.ndarray:
    """The launch speeds with a turning point at one of the places (n,), and those near barriers between them."""
    lengths = np.diff(places)
    inside = places[:-1, None] + lengths[:, None] * GAUSS_PLACES
    with np.errstate(over="ignore"):
        works = force(inside.ravel())[0].reshape(inside.shape) @ GAUSS_WEIGHTS * lengths
    energies = np.append(0.0, np.cumsum(works))
    highest = np.maximum.accumulate(energies)
    records = np.flatnonzero(energies == highest)
    tops = records[:-1][np.diff(records) > 1]  # the last place before a barrier, unless the motion starts there
    tops = tops[tops > 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        barriers = energies[tops] - values[tops] ** 2 / (2 * slopes[tops])
    near = np.sqrt(2 * barriers[np.isfinite(barriers) & (barriers > 0)])
    beside = np.concatenate([(near[:, None] * (1 + side * BESIDE_BARRIERS)).ravel() for side in (-1.0, 1.0)])
    speeds = np.concatenate([np.sqrt(2 * energies[records]), beside])
    return speeds[(speeds > 0) & (speeds < fastest)]
