"""The first crossing of zero of a polynomial, also where it is a triple zero, with all digits."""

from collections.abc import Iterator
from math import comb

from flint import arb, arb_poly, ctx

MOST_STEPS = 500  # of Newton's method and bisection; 300 bits of bisection alone are fewer


def middle(x: arb) -> arb:
    """A number without its radius."""
    return arb(x).mid()


def sign(x: arb) -> int:
    """Of a number without a radius: 1, 0 or -1."""
    return int(x > 0) - int(x < 0)


def without_zero_at_start(p: arb_poly, negligible: float) -> arb_poly:
    """A polynomial divided by powers of x, so that its first coefficient is at least `negligible`."""
    c = p.coeffs()
    return arb_poly(c[next((k for k, each in enumerate(c) if abs(float(each)) > negligible), len(c)) :])


def first_crossing(p: arb_poly, length: arb, direction: int, cluster: float) -> arb | None:
    """The first place in (0, length] where a polynomial crosses zero upward (1), downward (-1) or either way (0).

    Zeros closer together than `cluster` times the length are one multiple zero, which counts as a crossing if the sign
    changes. Its place is that of the simple zero that a derivative has there.
    """
    scaled = arb_poly([middle(c * length**k) for k, c in enumerate(p.coeffs())])
    for place, rises in _crossings(scaled, arb(0), arb(1), cluster):
        if direction in (0, rises):
            return middle(place * length)
    return None


def _crossings(p: arb_poly, a: arb, b: arb, cluster: float) -> Iterator[tuple[arb, int]]:
    """Crossings in (a, b] in their order, each with 1 if the polynomial rises there and -1 if it falls."""
    m, r = middle((a + b) / 2), float(b - a) / 2
    c = [float(x) for x in p(arb_poly([m, 1])).coeffs()]
    order = _derivative_without_zero(c, r)
    if order == 0 or not c:
        return
    if order == 1:
        before, after = sign(middle(p(a))), sign(middle(p(b)))
        if before != after:
            yield _simple_zero(p, a, b), after or -before
    elif r > cluster:
        yield from _crossings(p, a, m, cluster)
        yield from _crossings(p, m, b, cluster)
    elif order is not None and order % 2:
        for _ in range(order - 1):
            p = p.derivative()
        yield _simple_zero(p, m, m), 1 if c[order] > 0 else -1


def _derivative_without_zero(c: list[float], r: float) -> int | None:
    """The first derivative of the polynomial with coefficients c that has no zero within r of 0; None if unclear."""
    for k in range(min(6, len(c))):
        if abs(c[k]) > sum(comb(j, k) * abs(c[j]) * r ** (j - k) for j in range(k + 1, len(c))):
            return k
    return None


def _simple_zero(p: arb_poly, a: arb, b: arb) -> arb:
    """The simple zero between a and b, or near a where both are the same."""
    slope, bracketed, x = p.derivative(), bool(a < b), middle((a + b) / 2)
    above = sign(middle(p(b)))
    for _ in range(MOST_STEPS):
        value = middle(p(x))
        step = middle(value / slope(x))
        if abs(float(step)) < 2.0 ** (20 - ctx.prec):
            return middle(x - step)
        if bracketed:
            a, b = (a, x) if sign(value) == above else (x, b)
        x = middle(x - step)
        if bracketed and not (a < x < b):
            x = middle((a + b) / 2)
    raise ArithmeticError(f"no zero of a guard is found near {x}")
