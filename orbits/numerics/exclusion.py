"""Bernstein exclusion of many polynomials at once: one whose Bernstein coefficients have one sign has no zero."""

from itertools import accumulate, pairwise
from math import comb

import casadi as ca

from ..symbolic.caches import cached
from ..symbolic.kernels import ElementwiseFunction

# The highest order of a zero at the start that is divided out; where it is higher, fewer polynomials are excluded.
HIGHEST_ORDER = 3


def bernstein_coefficients(series: ca.SX, of_h: ca.SX) -> list[ca.SX]:
    """Bernstein coefficients on [0, h] of a polynomial, from its coefficients and the powers of h, by differences."""
    rise, values = series * of_h * ca.DM([1 / comb(series.numel() - 1, k) for k in range(series.numel())]), []
    while rise.numel():
        values.append(rise[0])
        rise = rise[:-1] + rise[1:]
    return values


def without_first_zero(series: ca.SX, order: ca.SX) -> ca.SX:
    """Coefficients of a polynomial divided by t to the power of an order."""
    for skipped in range(1, HIGHEST_ORDER + 1):
        series = ca.if_else(order >= skipped, ca.vertcat(series[1:], 0), series)
    return series


@cached
def sign_changes(size: int) -> ElementwiseFunction:
    """(coefficients (size,), h, order of the zero at 0, whether the rate is meant) -> of a polynomial or its rate,
    without that zero: the value at 0, the one at h, and the sign changes of the Bernstein coefficients on [0, h], 0
    counting as positive."""
    c, h, order, by_rate = (ca.SX.sym(name, count) for name, count in zip("chor", (size, 1, 1, 1), strict=True))
    rate = ca.vertcat(*[k * c[k] for k in range(1, size)], 0)
    powers = ca.vertcat(1, *accumulate([h] * (size - 1), lambda power, h: power * h))
    values = bernstein_coefficients(without_first_zero(ca.if_else(by_rate, rate, c), order), powers)
    positive = [value >= 0 for value in values]
    changes = sum((before != after for before, after in pairwise(positive)), ca.SX(0))
    results = [values[0], values[-1], changes]
    return ElementwiseFunction(ca.Function("sign_changes", [c, h, order, by_rate], results))
