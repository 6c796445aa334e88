"""Hops of the linear hopper in closed form (eqs. 7 and 8 of the paper), without the engine."""

import numpy as np

SHARES_OF_FLIGHT = np.linspace(1e-3, 1.0, 400)


def next_launches(alpha: np.ndarray, mass_ratio: float, inject: float) -> np.ndarray:
    """The launches (m,) after a hop of the linear hopper with plastic landings, 0 where it rests.

    In flight the extension r oscillates, r'' = -r, and y1 + M y2 falls with the acceleration 1. The foot strikes at the
    first zero of its height that a mesh of times encloses, loses its speed, and leaves again at once where the spring
    pulls by more than its weight. In contact the energy decides on the launch.
    """
    M, r, v = mass_ratio, np.ones_like(alpha), alpha.copy()
    going, found = np.arange(len(alpha)), np.zeros_like(alpha)
    while len(going):

        def height(t, r=r, v=v):
            """(1 + M) y2."""
            return r + v * t - t * t / 2 - r * np.cos(t) - v * np.sin(t)

        longest = v + np.sqrt(v * v + 4 + 4 * np.hypot(r, v))  # the height is below 0 there
        t = SHARES_OF_FLIGHT * longest[:, None]
        below = height(t, r[:, None], v[:, None]) < 0
        i, rows = np.argmax(below & np.maximum.accumulate(~below, axis=1), axis=1), np.arange(len(r))
        a, b = t[rows, np.maximum(i - 1, 0)], t[rows, i]
        for _ in range(50):
            middle = 0.5 * (a + b)
            above = height(middle) >= 0
            a, b = np.where(above, middle, a), np.where(above, b, middle)
        y, rate = r * np.cos(a) + v * np.sin(a), v * np.cos(a) - r * np.sin(a)
        speed = (v - a + M * rate) / (1 + M)
        square = speed**2 + (M * y * y + 2 * y - M - 2) / (1 + M)
        stays = y <= 1
        found[going[stays]] = np.where(square > 0, np.sqrt(np.maximum(square, 0)) + inject, 0.0)[stays]
        going, r, v = going[~stays], y[~stays], speed[~stays]
    return found
