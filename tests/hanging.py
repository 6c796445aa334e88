"""Shared by the tests of motions near an unstable equilibrium: closed forms of a quadratic spring, and of a barrier."""

import mpmath
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

DIGITS = 40


def quadratic_lateness(c: float, alpha: float) -> mpmath.mpf:
    """How much later than half the flight the extension of r + c r**2 turns for the second time, by elliptic integrals;
    1 where it escapes over the barrier at -1/c."""
    with mpmath.workdps(2 * DIGITS):  # two of the turns nearly coincide, which loses half the digits
        c, alpha = mpmath.mpf(c), mpmath.mpf(alpha)
        liftoff = (mpmath.sqrt(1 + 4 * c) - 1) / (2 * c)
        energy = alpha**2 / 2 + liftoff**2 / 2 + c * liftoff**3 / 3
        cosine = 1 - 12 * c**2 * energy  # of three times the angle in Viete's roots of 2 c x**3/3 + x**2 = 2 energy
        if abs(cosine) > 1:
            return mpmath.mpf(1)
        angles = [(mpmath.acos(cosine) + 2 * mpmath.pi * k) / 3 for k in range(3)]
        low, high, beyond = sorted(-(2 * mpmath.cos(each) + 1) / (2 * c) for each in angles)
        m = (high - low) / (beyond - low)
        angle = mpmath.asin(mpmath.sqrt((high - liftoff) / (m * (beyond - liftoff))))
        pace = 2 / mpmath.sqrt(-2 * c / 3 * (beyond - low))
        return pace * (mpmath.ellipf(angle, m) + mpmath.ellipk(m)) - alpha


def quadratic_c(alpha: float, about: float) -> mpmath.mpf:
    """The law r + c r**2 of the orbit of family 1 that nearly escapes with a launch speed, near a known one."""
    with mpmath.workdps(DIGITS):
        low, high = (mpmath.mpf(about) + side * mpmath.mpf(10) ** -12 for side in (-1, 1))
        signs = [mpmath.sign(quadratic_lateness(c, alpha)) for c in (low, high)]
        assert signs[0] != signs[1]
        for _ in range(70):
            middle = (low + high) / 2
            if mpmath.sign(quadratic_lateness(middle, alpha)) == signs[1]:
                high = middle
            else:
                low = middle
        return low


def quartic_lateness(c: float, b: float, alpha: float, family: int) -> mpmath.mpf:
    """How much later than half the flight the extension of r + c r**2 + b r**3, with a barrier on either side, turns
    for the last time in a family, by elliptic integrals; 1 where it escapes over one of them."""
    with mpmath.workdps(2 * DIGITS):
        c, b, alpha = mpmath.mpf(c), mpmath.mpf(b), mpmath.mpf(alpha)
        liftoff = mpmath.findroot(lambda r: r + c * r**2 + b * r**3 - 1, 1)
        square = alpha**2 + liftoff**2 + 2 * c * liftoff**3 / 3 + b * liftoff**4 / 2
        with mpmath.workdps(4 * DIGITS):  # the turns are the roots of b r**4/2 + 2 c r**3/3 + r**2 = square
            companion = mpmath.matrix([[-4 * c / (3 * b), -2 / b, 0, 2 * square / b], *np.eye(3, 4).tolist()])
            roots = mpmath.eig(companion, left=False, right=False)
        if any(abs(each.imag) > mpmath.mpf(10) ** -DIGITS for each in roots):
            return mpmath.mpf(1)
        a, low, high, d = sorted(each.real for each in roots)
        m = (high - low) * (d - a) / ((d - low) * (high - a))
        angle = mpmath.asin(mpmath.sqrt((d - low) * (high - liftoff) / ((high - low) * (d - liftoff))))
        pace = 2 / mpmath.sqrt(-b / 2 * (d - low) * (high - a))
        return pace * (mpmath.ellipf(angle, m) + family * mpmath.ellipk(m)) - alpha


def quartic_error(c: float, b: float, alpha: float, family: int, within: float) -> float:
    """The error of the launch speed of an orbit of r + c r**2 + b r**3, which is no larger than some number."""
    with mpmath.workdps(DIGITS):
        low, high = (alpha + side * mpmath.mpf(within) for side in (-1, 1))
        signs = [mpmath.sign(quartic_lateness(c, b, each, family)) for each in (low, high)]
        assert signs[0] != signs[1]
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (
                (low, middle) if mpmath.sign(quartic_lateness(c, b, middle, family)) == signs[1] else (middle, high)
            )
        return float(abs(low - alpha))


def excess_over_barrier(alpha: float, liftoff: float, beta: float, delta: float = 0.0) -> float:
    """The energy in contact, of a spring r + beta r**3 + delta r**5 and equal masses, above that of rest where the
    spring can just carry the body."""
    force = np.polynomial.Polynomial([1.0, 1.0, 0.0, beta, 0.0, delta])
    slope, energy = force.deriv(), force.integ()
    turns = [x.real for x in slope.roots() if abs(x.imag) < 1e-12 and x.real < 0]
    top = max(turns)
    rest = brentq(force, 3 * top, top, xtol=1e-15, rtol=1e-15)
    return alpha**2 + energy(liftoff) - energy(rest)


def mid_flight_rate(alpha: float, liftoff: float, beta: float, delta: float = 0.0) -> float:
    """The rate of the extension half way through the flight, by another integrator; it vanishes on an orbit."""
    rates = lambda t, x: [x[1], -x[0] - beta * x[0] ** 3 - delta * x[0] ** 5]  # noqa: E731
    return solve_ivp(rates, (0, alpha), [liftoff, alpha], method="DOP853", rtol=1e-13, atol=1e-13).y[1, -1]
