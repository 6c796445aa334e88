"""All lossless hops of a linear mechanism with one plastic gap, from two equations in two times.

In flight M y'' = -K y + f. In contact the gap g = weights . y is held at 0 until the force that holds it vanishes: it
has no acceleration in flight then either. A lossless hop is its own mirror image in time, from rest in mid-contact to
rest in mid-flight. Both phases are sums of modes, so that everything at lift-off, half the time of contact s later, is
linear in the n - 1 amplitudes c of the modes of contact. That the n modes of flight come to rest after half its time T,
and that the gap has no acceleration at lift-off, are n + 1 equations A(s, T) c + r(s, T) = 0. The two of them that no
amplitudes solve are left for s and T (Pankov, arXiv 2402.16010). A and r are made of sines and cosines, and they have
no poles, whatever modes turn at the same time.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, NoOrbit, finite_number
from ..model.modes import SLOWEST_SQUARE, linear_modes
from ..numerics.roots import Array
from ..numerics.sobol import sobol_points

# Newton's method starts together from this many quasi-random pairs of half times, and is repeated until this many
# successive batches for each coordinate bring no new root. After this many steps hardly any start still converges.
BATCH, IDLE_BATCHES, NEWTON_STEPS = 1024, 2, 20
# Each start weights the equations by its own random factors, up to this one and down to its reciprocal: the roots are
# the same, but a root that few starts find with one set of factors is found by many with another.
LARGEST_FACTOR = 1e3
# Shares of the times: a start with a smaller step has converged; roots that are closer are the same.
CONVERGED_STEP, SAME_ROOT = 1e-8, 1e-7
# After these further steps, without factors, a root is known to rounding; its residual is a share of the largest terms.
POLISHING_STEPS, LARGEST_RESIDUAL = 3, 1e-9
# Of half times, as a share of the longest; shorter hops have shrunk to nothing, a root for many contacts.
SHORTEST_PHASE = 1e-3


class LinearHop(NamedTuple):
    """Half the time of contact and of flight of a lossless hop, and the flight state (2n,) at lift-off."""

    half_contact: float
    half_flight: float
    liftoff: np.ndarray


def linear_hops(
    inertia: ArrayLike,
    stiffness: ArrayLike,
    load: ArrayLike,
    gap: ArrayLike,
    half_contact: float,
    half_flight: float,
    seed: int = 0,
) -> list[LinearHop]:
    """The lossless hops of M y'' = -K y + f, by their times. They are roots of the equations: it is not checked whether
    the gap stays open in flight and is pressed together in contact.

    inertia, stiffness, load : M, K (n, n) and f (n,), as for `linear_modes`
    gap : weights (n,) of the gap weights . y
    half_contact, half_flight : the longest half times that are searched
    seed : of the quasi-random pairs of times from which Newton's method starts, until they find nothing new; for many
        coordinates another seed may find some more

    Raises `InputError` for an invalid mechanism, and `NoOrbit` where a motion changes neither spring nor gap.
    """
    longest = np.array([finite_number("half_contact", half_contact), finite_number("half_flight", half_flight)])
    if not (longest > 0).all():
        raise InputError(f"half_contact = {half_contact}, half_flight = {half_flight}: both are above 0")
    equations, roots, idle = _HopEquations(inertia, stiffness, load, gap), np.zeros((0, 2)), 0
    tried, rng = 0, np.random.default_rng(seed)
    while idle < IDLE_BATCHES * equations.size:
        factors = LARGEST_FACTOR ** rng.uniform(-1, 1, (BATCH, equations.size + 1))
        times = equations.roots(sobol_points(BATCH, 2, seed, tried) * longest, factors, longest)
        tried += BATCH
        before, roots = len(roots), _distinct(np.concatenate([roots, times]))
        idle = idle + 1 if len(roots) == before else 0
    roots = roots[np.lexsort(roots.T[::-1])]
    states, opens = equations.liftoffs(roots)
    found = zip(*roots[opens].T.tolist(), states[opens], strict=True)
    return [LinearHop(contact, flight, state) for contact, flight, state in found]


def _distinct(roots: Array) -> Array:
    """Pairs of times (r, 2) without repetitions of an earlier pair up to rounding."""
    near = (np.abs(roots[:, None] - roots) <= SAME_ROOT * roots).all(2)
    return roots[~np.tril(near, -1).any(1)]


class _Solved(NamedTuple):
    """The equations at times (m, 2) with the best amplitudes.

    coordinates, speeds : (m, n) of the modes of flight at lift-off
    left, slopes : (m, 2) and (m, 2, 2), the two equations that are left, and, where they hold, their derivatives by the
        two times
    error : (m,), the largest residual of all equations, as a share of the largest sum of terms
    """

    coordinates: Array
    speeds: Array
    left: Array
    slopes: Array
    error: Array


class _HopEquations:
    """The equations A(s, T) c + r(s, T) = 0 of a linear mechanism.

    The coordinates q (n,) are those of the modes of flight, q'' = loads - squares q, all with inertia 1. In contact
    q = centre + held @ x with modes x'' = -rates^2 x. All of these n - 1 modes swing: one without a spring would be
    thrown in flight too, and nothing would bring it back.
    """

    def __init__(self, inertia: ArrayLike, stiffness: ArrayLike, load: ArrayLike, gap: ArrayLike):
        self.flight = flight = linear_modes(inertia, stiffness, load)
        self.squares, self.loads, self.size = flight.squares, flight.loads, len(flight.squares)
        weights = np.array(gap, dtype=float)
        if weights.shape != (self.size,) or not np.isfinite(weights).all() or not weights.any():
            raise InputError(f"gap = {gap!r}: it is told by one weight for each of the {self.size} coordinates")
        of_gap = weights @ flight.shapes
        closed = np.linalg.qr(of_gap[:, None], mode="complete")[0][:, 1:]
        squares, turned = np.linalg.eigh(closed.T * self.squares @ closed)
        if not (squares > SLOWEST_SQUARE * flight.square).all():
            raise NoOrbit("a motion that leaves gap and springs as they are never comes back: hold it by a spring")
        self.rates, self.held = np.sqrt(squares), closed @ turned
        self.centre = self.held @ (self.loads @ self.held / squares)
        # The gap's acceleration, pull . q + push, in units in which it is as large as a speed.
        unit = np.sqrt(flight.square) * np.linalg.norm(of_gap)
        self.pull, self.push = -of_gap * self.squares / unit, of_gap @ self.loads / unit

    def solved(self, times: Array, factors: Array | float = 1.0) -> _Solved:
        """The equations at times (m, 2), weighted by factors (m, n + 1), with the amplitudes that solve them best."""
        n, k, angles, flown = self.size, self.flight.thrown, times[:, :1] * self.rates, times[:, 1:]
        # The modes of flight have speeds c q' - s squares q + s loads after a time T.
        c, s = np.ones((len(times), n)), np.repeat(flown, n, axis=1)
        c[:, k:], s[:, k:] = np.cos(flown * self.flight.rates), np.sin(flown * self.flight.rates) / self.flight.rates
        pushed = s * self.squares
        # The coordinates and speeds at lift-off are centre + q_by @ amplitudes and v_by @ amplitudes.
        q_by, v_by = self.held * np.cos(angles)[:, None], -self.held * (self.rates * np.sin(angles))[:, None]
        matrix, right, slopes = (np.zeros((len(times), n + 1, columns)) for columns in (n - 1, 1, 2))
        matrix[:, :n], matrix[:, n] = c[..., None] * v_by - pushed[..., None] * q_by, self.pull @ q_by
        right[:, :n, 0], right[:, n] = s * self.loads - pushed * self.centre, self.push + self.pull @ self.centre
        factors = np.broadcast_to(factors, (len(times), n + 1))[..., None]
        matrix, right = factors * matrix, factors * right
        turn, triangle = np.linalg.qr(matrix, mode="complete")
        triangle = triangle[:, : n - 1]
        triangle[(np.diagonal(triangle, axis1=1, axis2=2) == 0).any(1)] = np.nan
        turned = turn.swapaxes(1, 2) @ right
        amplitudes = -np.linalg.solve(triangle, turned[:, : n - 1])
        q, v = self.centre + (q_by @ amplitudes)[..., 0], (v_by @ amplitudes)[..., 0]
        slopes[:, :n, 0] = -c * (q_by * self.rates**2 @ amplitudes)[..., 0] - pushed * v
        slopes[:, n, 0], slopes[:, :n, 1] = v @ self.pull, c * (self.loads - self.squares * q) - pushed * v
        terms = np.abs(matrix) @ np.abs(amplitudes) + np.abs(right)
        error = np.abs(matrix @ amplitudes + right).max((1, 2)) / terms.max((1, 2))
        left = turn[:, :, n - 1 :].swapaxes(1, 2) @ (factors * slopes)
        return _Solved(q, v, turned[:, n - 1 :, 0], left, error)

    def roots(self, times: Array, factors: Array, longest: Array) -> Array:
        """The roots (r, 2) up to the longest times to which Newton's method converges from times (m, 2)."""
        found, farthest = [], 0.5 / np.sqrt(self.flight.square)  # less than a period of the equations
        with np.errstate(all="ignore"):  # starts that reach a singularity of the equations are dropped
            for _ in range(NEWTON_STEPS):
                change = self._newton_step(times, factors)
                times = times + np.clip(change, -farthest, farthest)
                converged = (np.abs(change) < CONVERGED_STEP * np.abs(times)).all(1)
                found.append(times[converged])
                going = ~converged & (np.abs(times) < 2 * longest).all(1)
                times, factors = times[going], factors[going]
            times = _distinct(np.concatenate(found))
            for _ in range(POLISHING_STEPS):
                times = times + self._newton_step(times)
            inside = (times > SHORTEST_PHASE * longest).all(1) & (times <= longest).all(1)
            return times[inside & (self.solved(times).error < LARGEST_RESIDUAL)]

    def _newton_step(self, times: Array, factors: Array | float = 1.0) -> Array:
        """The change (m, 2) of times (m, 2), not finite where the equations are singular."""
        at = self.solved(times, factors)
        (a, b), (c, d) = at.slopes.transpose(1, 2, 0)
        f, g = at.left.T
        return np.stack([b * g - d * f, c * f - a * g], axis=1) / (a * d - b * c)[:, None]

    def liftoffs(self, times: Array) -> tuple[Array, Array]:
        """Flight states (m, 2n) at lift-off of roots (m, 2), and whether (m,) the gap opens there, by its jerk."""
        at, shapes = self.solved(times), self.flight.shapes
        states = np.empty((len(times), 2 * self.size))
        states[:, ::2], states[:, 1::2] = at.coordinates @ shapes.T, at.speeds @ shapes.T
        return states, at.speeds @ self.pull > 0
