"""The value that a parameter tends to as the orbits along it go to infinity, or shrink to nothing."""

from collections.abc import Sequence

import numpy as np

# A limit is extrapolated from the last points, over the first of these factors of alpha that holds enough of them.
WIDTHS = (2.0, 4.0, 16.0)
# A limit is clear where its error is less than this share of the parameter's distance to it.
CLEAR = 0.1
# A limit is clear too where the parameter has come this close to it, as a share of the range of its values.
ARRIVED = 1e-6
# Powers of the scale in the series of a parameter: some curves have a first power of 1/alpha and some have none.
POWERS = ([0, 1, 2, 3, 4, 5], [0, 2, 3, 4, 5, 6])
# The error is taken as this many times the change by the last term, since the terms left out may be larger.
CAUTION = 3


def limit(
    history: Sequence[tuple[float, float]], bounds: tuple[float, float], power: int
) -> tuple[float, float] | None:
    """The value that the parameter tends to as alpha grows (power -1) or vanishes (1), and its error; None where
    that is not clear or lies behind or beyond a bound.

    history : (alpha, value) of the points of a curve, in order

    The value is extrapolated by powers of alpha from well spaced points. No number says whether the curve has a first
    power, so the series whose last term matters less is taken.
    """
    alpha, value = np.array(history).T
    scale = (alpha / alpha[-1]) ** power
    for widest in WIDTHS:
        found = [pair for powers in POWERS if (pair := _extrapolated(scale, value, powers, widest))]
        if len(found) < len(POWERS):
            continue
        error, end = min(found)
        ahead = end - value[-1]
        behind = value[-1] - value[int(np.abs(np.log(scale / widest)).argmin())]
        clear = error < CLEAR * abs(ahead) or abs(ahead) + error < ARRIVED * np.ptp(value)
        inside = bounds[0] - error <= end <= bounds[1] + error
        return (end, error) if clear and inside and ahead * behind >= 0 else None
    return None


def _extrapolated(scale, value, powers: list[int], widest: float) -> tuple[float, float] | None:
    """The error and the limit of `value` as `scale` vanishes, the error from what the last of the powers changes; None
    where too few points lie between the last and the one at scale `widest`."""
    limits = []
    for count in (len(powers), len(powers) - 1):
        chosen = [int(np.abs(np.log(scale / ratio)).argmin()) for ratio in np.geomspace(1.0, widest, count)]
        if len(set(chosen)) < count:
            return None
        terms = scale[chosen][:, None] ** np.array(powers[:count])
        limits.append(float(np.linalg.solve(terms, value[chosen])[0]))
    return CAUTION * abs(limits[0] - limits[1]), limits[0]
