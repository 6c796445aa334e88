"""Compiled steps of root finding: Bernstein exclusion (a polynomial whose Bernstein coefficients have one sign has no
zero), and the refinement of a root in a bracket."""

from itertools import accumulate, pairwise
from math import comb

import casadi as ca

from ..symbolic import ElementwiseFunction, Kernel, cached
from .roots import ROOTS

# The highest order of a zero at the start that is divided out; where it is higher, fewer polynomials are excluded.
HIGHEST_ORDER = 3
# Newton's method ends where its next step, predicted from the last two, changes no digit of the root.
NEGLIGIBLE = 1e-17
# The size assigned to a zero that continues negative values, so that it has their sign; it is far below any rounding.
TINY = 1e-300


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


@cached
def refinement(size: int) -> Kernel:
    """Newton's method for a root in a bracket, or bisection where that leads out of it: (z, (coefficients (size,), 1 or
    for a falling root -1)) -> z, which is the root, the bracket and the size of the last step of Newton's method."""
    z, data = ca.SX.sym("z", 4), ca.SX.sym("data", size + 1)
    t, low, high, last = ca.vertsplit(z)
    value = slope = ca.SX(0)
    for c in reversed(ca.vertsplit(data[:-1])):
        slope = slope * t + value
        value = value * t + c
    above = data[-1] * value >= 0
    low, high = ca.if_else(above, low, t), ca.if_else(above, t, high)
    new = ca.if_else(slope != 0, t - value / slope, low)
    step = ca.fabs(new - t)
    settled = ca.logic_and(last > 0, step * (step / last) ** 2 <= NEGLIGIBLE * high)
    settled = ca.logic_or(settled, ca.fmin(step, high - low) <= ROOTS.closed * high)
    inside = ca.logic_and(low < new, new < high)
    nearer = ca.if_else(inside, new, 0.5 * (low + high))
    found = ca.if_else(settled, ca.fmin(ca.fmax(new, low), high), nearer)
    after = ca.vertcat(found, low, high, inside * step)
    return Kernel(ca.Function("refinement", [z, data], [after, 0, ca.logic_not(settled)]))
