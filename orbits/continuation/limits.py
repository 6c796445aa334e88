"""The value that a parameter tends to as the orbits along it run off to infinity, or shrink to nothing."""

from collections.abc import Sequence

import numpy as np

# A limit is extrapolated from the last points over the first of these factors of alpha that holds enough of them, and
# is clear where its error is a small share of the way to it.
WIDTHS, CLEAR = (2.0, 4.0, 16.0), 0.1
# Powers of the scale in the series of a parameter.
POWERS = ([0, 1, 2, 3, 4, 5], [0, 2, 3, 4, 5, 6])


def limit(seen: Sequence[tuple[float, float]], bounds: tuple[float, float], power: int) -> tuple[float, float] | None:
    """The value that the parameter tends to as alpha grows (power -1) or vanishes (1), and its error: extrapolated by
    powers from well spaced points of those `seen`, (alpha, value) each; None where that is not clear or leads behind or
    beyond a bound.

    Some curves have a first power of 1/alpha and some have none, which no number says: the series whose last term
    matters less is taken.
    """
    alpha, value = np.array(seen).T
    scale = (alpha / alpha[-1]) ** power
    for widest in WIDTHS:
        found = [_extrapolated(scale, value, powers, widest) for powers in POWERS]
        if None in found:
            continue
        error, end = min(found)
        ahead = end - value[-1]
        behind = value[-1] - value[int(np.abs(np.log(scale / widest)).argmin())]
        clear = error < CLEAR * abs(ahead) or abs(ahead) + error < 1e-6 * np.ptp(value)
        inside = bounds[0] - error <= end <= bounds[1] + error
        return (end, error) if clear and inside and ahead * behind >= 0 else None
    return None


def _extrapolated(scale, value, powers: list[int], widest: float) -> tuple[float, float] | None:
    """What the last of these powers changes in the limit of `value` as `scale` vanishes, and the limit; None where
    there are too few points between the last and where the scale is `widest`."""
    limits = []
    for count in (len(powers), len(powers) - 1):
        chosen = [int(np.abs(np.log(scale / ratio)).argmin()) for ratio in np.geomspace(1.0, widest, count)]
        if len(set(chosen)) < count:
            return None
        terms = scale[chosen][:, None] ** np.array(powers[:count])
        limits.append(float(np.linalg.solve(terms, value[chosen])[0]))
    return 3 * abs(limits[0] - limits[1]), limits[0]
