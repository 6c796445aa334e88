"""All hops of a chain with linear springs and short phases, from its vibration modes alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .laws import number


@dataclass(frozen=True, kw_only=True)
class ModalSearch:
    """Settings of `linear_orbits`.

    batch : quasi-random pairs of phase times from which Newton's method starts together
    idle : batches without a new root after which the search ends
    newton : steps of Newton's method
    same : roots closer than this, as a share of the times, are one
    shortest : phase time, as a share of the longest; shorter hops have shrunk to nothing, a root for many contacts
    residual : largest one of a root, as a share of 1 + the weight of the chain
    """

    batch: int = 1024
    idle: int = 4
    newton: int = 60
    same: float = 1e-7
    shortest: float = 1e-3
    residual: float = 1e-9


MODAL_SEARCH = ModalSearch()


def linear_orbits(
    masses: Sequence[float], stiffnesses: Sequence[float], half_contact: float, half_flight: float, seed: int = 0
) -> list[tuple[float, float, np.ndarray]]:
    """Half the time of contact, of flight, and the flight state (2 N,) at lift-off, of the roots for linear springs.

    masses, stiffnesses : (N,), (N - 1,), from the top
    half_contact, half_flight : the longest that are looked for
    seed : of the quasi-random pairs of times from which Newton's method starts, until they find nothing new; for long
        chains another seed may find some more

    From rest each vibration mode is a cosine, so that the speeds at lift-off are a linear function of the positions
    there, both by the contact before lift-off and by the flight after it. The lowest spring carries the lowest mass,
    which gives one position; that the two speeds of each mass agree for all masses above it gives the others. Two
    equations in the two times are left: the two speeds of that mass agree, and the lowest mass has none (Pankov 2021,
    section 1).
    """
    from scipy.stats import qmc

    modes = _ChainModes(np.array(masses, dtype=float), np.array(stiffnesses, dtype=float))
    longest = np.array([number("half_contact", half_contact, 0, 1e4), number("half_flight", half_flight, 0, 1e4)])
    pairs, roots, idle = qmc.Sobol(2, seed=seed), np.zeros((0, 2)), 0
    while idle < MODAL_SEARCH.idle:
        times = modes.roots(pairs.random(MODAL_SEARCH.batch) * longest, longest)
        times = times[(times > MODAL_SEARCH.shortest * longest).all(1) & (times <= longest).all(1)]
        before = len(roots)
        for pair in times:
            if not len(roots) or np.abs(roots - pair).max(1).min() > MODAL_SEARCH.same * pair.max():
                roots = np.vstack([roots, pair])
        idle = idle + 1 if len(roots) == before else 0
    if not len(roots):
        return []
    roots = roots[np.lexsort(roots.T[::-1])]
    states = np.stack(modes.liftoffs(roots)[:2], axis=2).reshape(len(roots), -1)
    # The mass above the lowest one rises at lift-off, or else the lowest would be pushed into the ground.
    return [(*times.tolist(), state) for times, state in zip(roots, states, strict=True) if state[-3] > 0]


class _ChainModes:
    """The vibration modes of a linear chain of N masses in flight and in contact."""

    def __init__(self, masses: np.ndarray, stiffnesses: np.ndarray):
        self.masses, self.liftoff = masses, masses[-1] / stiffnesses[-1]
        tension = np.diff(np.eye(len(masses)), axis=0)
        stiffness = tension.T @ (stiffnesses[:, None] * tension)
        square, modes = np.linalg.eigh(stiffness / np.sqrt(np.outer(masses, masses)))
        self.flight_frequencies, self.flight_modes = np.sqrt(np.maximum(square, 0.0)), modes / np.sqrt(masses)[:, None]
        self.flight_frequencies[0] = 0.0  # the mode in which all masses fall together
        upper = masses[:-1]
        square, modes = np.linalg.eigh(stiffness[:-1, :-1] / np.sqrt(np.outer(upper, upper)))
        self.contact_frequencies, self.contact_modes = np.sqrt(square), modes / np.sqrt(upper)[:, None]
        self.equilibrium = -np.linalg.solve(stiffness[:-1, :-1], upper)

    def liftoffs(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions (m, N) at lift-off for half times (m, 2) of contact and flight, the speeds (m, N) there by the
        flight after it, and the speeds (m, N - 1) by the contact before it."""
        masses, n = self.masses, len(self.masses) - 1
        last = n - 1  # the mass above the lowest, whose position at lift-off is known
        contact, flight = times[:, :1], times[:, 1:]
        # Speeds by the contact: before @ x + before_rest. Speeds by the flight: after @ x + after_rest.
        rates = -self.contact_frequencies * np.tan(self.contact_frequencies * contact)
        before = np.zeros((len(times), n, n + 1), dtype=times.dtype)
        before[:, :, :n] = (self.contact_modes * rates[:, None]) @ self.contact_modes.T * masses[:n]
        before_rest = -before[:, :, :n] @ self.equilibrium
        rates = self.flight_frequencies * np.tan(self.flight_frequencies * flight)
        after = (self.flight_modes * rates[:, None]) @ self.flight_modes.T * masses
        after_rest = self.flight_modes[:, 0] * (self.flight_modes[:, 0] @ masses) * flight
        x = np.zeros((len(times), n + 1), dtype=times.dtype)
        x[:, last] = self.liftoff
        difference = before[:, :last] - after[:, :last]
        right = after_rest[:, :last] - before_rest[:, :last] - difference[:, :, last] * x[:, [last]]
        square = difference[:, :, :last]
        regular = np.isfinite(square).all((1, 2)) & (np.linalg.det(square) != 0)
        square = np.where(regular[:, None, None], square, np.eye(last))
        x[:, :last] = np.where(regular[:, None], np.linalg.solve(square, right[..., None])[..., 0], np.nan)
        return x, (after @ x[..., None])[..., 0] + after_rest, (before @ x[..., None])[..., 0] + before_rest

    def residual(self, times: np.ndarray) -> np.ndarray:
        """Residuals (m, 2) at lift-off: the difference of the speeds of the mass above the lowest, and the speed of
        the lowest."""
        _, after, before = self.liftoffs(times)
        return np.stack([after[:, -2] - before[:, -1], after[:, -1]], axis=1)

    def roots(self, times: np.ndarray, longest: np.ndarray) -> np.ndarray:
        """The roots (r, 2) to which Newton's method converges from half times (m, 2), with complex-step derivatives."""
        farthest = 0.5 / self.flight_frequencies.max()  # less than a period, with which the equations repeat
        with np.errstate(all="ignore"):  # times that come to a pole of the tangents are dropped
            for _ in range(MODAL_SEARCH.newton):
                (a, c), (b, d) = (self.residual(times + 1e-30j * unit).imag.T * 1e30 for unit in np.eye(2))
                f, g = self.residual(times).T
                change = np.stack([b * g - d * f, c * f - a * g], axis=1) / (a * d - b * c)[:, None]
                times = times + np.clip(change, -farthest, farthest)
                times = times[np.isfinite(times).all(1) & (np.abs(times) < 2 * longest).all(1)]
            residual = self.residual(times)
        return times[(np.abs(residual) < MODAL_SEARCH.residual * (1 + self.masses.sum())).all(1)]
