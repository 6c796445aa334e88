"""All lossless hops of a linear mechanism with one plastic gap, from two times and the amplitudes of contact.

In flight M y'' = -K y + f. In contact the gap g = weights . y is held at 0 until the force that holds it vanishes: it
has no acceleration in flight then either. A lossless hop is its own mirror image in time, from mid-contact to
mid-flight, with speeds and accelerations that are continuous at lift-off. These are sums of modes that swing with
frequencies r in contact and w in flight, and the load, which is constant, is in none of them. A mode that the reversor
leaves as it is rests in the middle; one that it turns over passes its centre there, a quarter of a period later. With
angles b = 0 or pi/2 of the modes, the accelerations at lift-off, half the time of contact s after mid-contact, are
H cos(r s - b) c and the speeds H sin(r s - b)/r c, where the columns of H are the modes of contact in coordinates of
the modes of flight. These come to their middle after half the time of flight T where

    (cos(w T - b) H sin(r s - b)/r + sin(w T - b)/w H cos(r s - b)) c = 0.

For n coordinates these are n equations for the n - 1 amplitudes c, whose size does not matter: they hold at isolated
pairs of times. The size of c is that with which the load holds the gap without an acceleration at lift-off (after
Pankov, arXiv 2402.16010, who leaves two equations for the two times). The equations are made of sines and cosines, and
they have no poles, whatever modes turn at the same time.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, NoOrbit, finite_number
from ..model import MODES, linear_modes
from ..numerics import Array, sobol_points, solve


class LinearOptions(NamedTuple):
    """The starts and the steps of Newton's method for the times of linear hops."""

    # Quasi-random pairs of half times in a batch, each with all the amplitudes that are stationary for the size of the
    # equations there.
    batch: int = 128
    idle_batches: int = 4  # successive batches without a new root, after which the search ends
    steps: int = 20  # after this number hardly any start still converges
    converged_step: float = 1e-8  # as a share of the times: a start with a smaller step has converged
    same_root: float = 1e-7  # as a share of the times: roots that are closer are the same
    polishing_steps: int = 3  # further ones, after which a root is known to rounding
    same_square: float = 1e-9  # as a share of the largest: squared frequencies that are closer are the same
    largest_residual: float = 1e-9  # of a root, as a share of the largest terms
    # Of half times, as a share of the longest; shorter hops have shrunk to nothing, a root for many contacts.
    shortest_phase: float = 1e-3
    # The longest half contact and half flight unless they are stated, in slowest natural periods of the phases. A hop
    # of two masses has half flights of 0.72, 1.23, 1.74, ... of it.
    half_contact: float = 0.5
    half_flight: float = 1.0


LINEAR = LinearOptions()


class LinearHop(NamedTuple):
    """Half the time of contact and of flight of a lossless hop, and the flight state (2n,) at lift-off."""

    half_contact: float
    half_flight: float
    liftoff: np.ndarray


class LinearSearch:
    """The search for the lossless hops of M y'' = -K y + f, by their times. They are roots of the equations: it is not
    checked whether the gap stays open in flight and is pressed together in contact.

    equations : M, K (n, n) and f (n,), as for `linear_modes`
    gap : weights (n,) of the gap weights . y
    signs : (2, n), of the coordinates under the reversors of flight and of contact; all are 1 by default
    periods : the slowest natural periods of contact and of flight, 0 where no mode of the phase swings

    Raises `InputError` for an invalid mechanism, and `NoOrbit` where a motion changes neither spring nor gap.
    """

    def __init__(self, equations: tuple[ArrayLike, ArrayLike, ArrayLike], gap: ArrayLike, signs: ArrayLike = 1):
        self._equations = _HopEquations(*equations, gap, signs)
        self._roots = np.zeros((0, 1 + self._equations.size))
        rates = self._equations.rates, self._equations.flight.rates
        contact, flight = (float(2 * np.pi / each.min(initial=np.inf)) for each in rates)
        self.periods = contact, flight

    @staticmethod
    def finds_families(machine: Any) -> bool:
        """Whether `find` searches the hops of a machine: one that steps, is linear and moves away from no rest, and
        whose launch has several numbers."""
        model = machine.model
        modes = model.flight.closed_form if hasattr(machine, "linear_equations") else None
        if modes is None or model.plain or model.one_speed or model.sticks or model.reversor is None:
            return False
        return not modes(machine.values).pushed

    @classmethod
    def of(cls, machine: Any) -> "LinearSearch":
        """The search for the hops of a linear `Mechanism`, whose gap that lands may be the image of the one that
        opens."""
        back = machine.model.reversal
        maps = back, machine.model.relabelling.after(back)
        return cls(machine.linear_equations(), machine.gap_weights, [each.signs[::2] for each in maps])

    @property
    def longest(self) -> tuple[float, float]:
        """The longest half contact and half flight that are searched unless they are stated."""
        contact, flight = self.periods
        return LINEAR.half_contact * contact, LINEAR.half_flight * flight

    def batches(self, half_contact: float, half_flight: float, seed: int = 0) -> Iterator[float]:
        """Search by Newton's method from one batch of times after the other, until they find nothing new; the share
        that is done after each. The half times are the longest; another seed may find some more hops."""
        longest = np.array([finite_number("half_contact", half_contact), finite_number("half_flight", half_flight)])
        if not (longest > 0).all():
            raise InputError(f"half_contact = {half_contact}, half_flight = {half_flight}: both must be above 0")
        tried, idle, share = 0, 0, 0.0
        while idle < LINEAR.idle_batches:
            new = self._equations.roots(sobol_points(LINEAR.batch, 2, seed, tried) * longest, longest)
            tried += LINEAR.batch
            before, self._roots = len(self._roots), _distinct(np.concatenate([self._roots, new]))
            idle = idle + 1 if len(self._roots) == before else 0
            yield (share := max(share, idle / LINEAR.idle_batches))

    @property
    def hops(self) -> list[LinearHop]:
        """The hops that are found, by their times."""
        roots = self._roots[np.lexsort(self._roots[:, 1::-1].T)]
        states, opens = self._equations.liftoffs(roots)
        found = zip(*roots[opens, :2].T.tolist(), states[opens], strict=True)
        return [LinearHop(contact, flight, state) for contact, flight, state in found]


def _distinct(roots: Array) -> Array:
    """Roots (r, 2 + ...) whose pair of times, which comes first, does not repeat an earlier pair up to rounding."""
    times = roots[:, :2]
    near = (np.abs(times[:, None] - times) <= LINEAR.same_root * times).all(2)
    return roots[~np.tril(near, -1).any(1)]


def _own_images(squares: Array, turned: Array) -> tuple[Array, Array]:
    """Orthonormal combinations (k, k) of modes, each of equal squares (k,) in ascending order, that an involution
    `turned` (k, k) of the modes maps to themselves or to their negatives, and their angles (k,) b: 0, or pi/2."""
    own, later = np.zeros(turned.shape), np.zeros(len(squares))
    ends = np.flatnonzero(np.diff(squares) > LINEAR.same_square * squares[-1]) + 1
    for group in np.split(np.arange(len(squares)), ends):
        among = np.ix_(group, group)
        signs, own[among] = np.linalg.eigh(turned[among])
        later[group] = np.where(signs < 0, np.pi / 2, 0.0)
    return own, later


class _Sums(NamedTuple):
    """The sums of modes at unknowns (m, 1 + n): two times and the amplitudes.

    cosines, sines : (m, n), of the modes of flight after the time T; they have speeds cosines v + sines a then
    matrix : (m, n, n - 1), the equations by the amplitudes
    moved, speeds, accelerations, jerks : (m, n) of the modes of flight at lift-off, as free of the load as they are
    """

    cosines: Array
    sines: Array
    matrix: Array
    moved: Array
    speeds: Array
    accelerations: Array
    jerks: Array


class _HopEquations:
    """The equations of the two times and the amplitudes of a linear mechanism.

    The coordinates q (n,) are those of the modes of flight, q'' = loads - squares q, all with inertia 1. In contact
    q = centre + held @ x with modes x'' = -rates^2 x. All of these n - 1 modes swing: one without a spring would be
    thrown in flight too, and nothing would bring it back. The unknowns (m, 1 + n) are s, T and the amplitudes.
    """

    def __init__(self, inertia: ArrayLike, stiffness: ArrayLike, load: ArrayLike, gap: ArrayLike, signs: ArrayLike):
        flight = linear_modes(inertia, stiffness, load)
        if flight.pushed:
            raise InputError("the stiffness is not positive semidefinite: a motion moves away from rest without bound")
        in_flight, in_contact = np.broadcast_to(signs, (2, len(flight.squares)))
        own, self.later = _own_images(flight.squares, flight.apart * in_flight @ flight.shapes)
        if self.later[: flight.thrown].any():
            raise NoOrbit("no spring holds a motion that the reversor turns over, which is thrown: add one")
        flight = replace(flight, shapes=flight.shapes @ own, apart=own.T @ flight.apart, loads=flight.loads @ own)
        self.flight, self.squares, self.loads, self.size = flight, flight.squares, flight.loads, len(flight.squares)
        weights = np.array(gap, dtype=float)
        if weights.shape != (self.size,) or not np.isfinite(weights).all() or not weights.any():
            raise InputError(f"gap = {gap!r}: it must have one weight for each of the {self.size} coordinates")
        of_gap = weights @ flight.shapes
        closed = np.linalg.qr(of_gap[:, None], mode="complete")[0][:, 1:]
        squares, turned = np.linalg.eigh(closed.T * self.squares @ closed)
        if not (squares > MODES.slowest_square * flight.square).all():
            raise NoOrbit(
                "a motion that changes neither the gap nor a spring never comes back: add a spring that holds it"
            )
        held = closed @ turned
        own, self.later_in_contact = _own_images(squares, held.T @ (flight.apart * in_contact @ flight.shapes) @ held)
        self.rates, self.held = np.sqrt(squares), held @ own
        self.centre = self.held @ (self.loads @ self.held / squares)
        # The gap's acceleration is pull . q + push.
        self.pull, self.push = -of_gap * self.squares, float(of_gap @ self.loads)

    def sums(self, unknowns: Array) -> _Sums:
        """The sums of modes at unknowns (m, 1 + n)."""
        k, flown, amplitudes = self.flight.thrown, unknowns[:, 1:2], unknowns[:, 2:]
        c, s = np.ones((len(unknowns), self.size)), np.repeat(flown, self.size, axis=1)
        angles = flown * self.flight.rates - self.later[k:]
        c[:, k:], s[:, k:] = np.cos(angles), np.sin(angles) / self.flight.rates
        turned = unknowns[:, :1] * self.rates - self.later_in_contact
        cosines, sines = np.cos(turned), np.sin(turned) / self.rates
        matrix = c[..., None] * (self.held * sines[:, None]) + s[..., None] * (self.held * cosines[:, None])
        v, a, rates = amplitudes * sines, amplitudes * cosines, self.rates
        return _Sums(c, s, matrix, *(each @ self.held.T for each in (-a / rates**2, v, a, -v * rates**2)))

    def roots(self, times: Array, longest: Array) -> Array:
        """The roots (r, 1 + n) up to the longest times to which Newton's method converges from times (m, 2)."""
        found, farthest = [], 0.5 / np.sqrt(self.flight.square)  # less than a period of the equations
        few = np.column_stack([times, np.zeros((len(times), self.size - 1))])
        stationary = np.concatenate(np.linalg.svd(self.sums(few).matrix, full_matrices=False)[2])
        unknowns = np.column_stack([np.repeat(times, self.size - 1, axis=0), stationary])
        with np.errstate(all="ignore"):  # starts that reach a singularity of the equations are dropped
            for _ in range(LINEAR.steps):
                change = self._newton_step(unknowns)
                longest_step = np.abs(change[:, :2]).max(axis=1, keepdims=True)
                unknowns = unknowns + change * np.minimum(1.0, farthest / longest_step)
                unknowns[:, 2:] /= np.linalg.norm(unknowns[:, 2:], axis=1, keepdims=True)
                times = unknowns[:, :2]
                converged = (np.abs(change[:, :2]) < LINEAR.converged_step * np.abs(times)).all(1)
                found.append(unknowns[converged])
                unknowns = unknowns[~converged & (times > 0).all(1) & (times < longest + farthest).all(1)]
            unknowns = _distinct(np.concatenate(found))
            for _ in range(LINEAR.polishing_steps):
                unknowns = unknowns + self._newton_step(unknowns)
            inside = (unknowns[:, :2] > LINEAR.shortest_phase * longest).all(1) & (unknowns[:, :2] <= longest).all(1)
            return unknowns[inside & self._holds(unknowns)]

    def _newton_step(self, unknowns: Array) -> Array:
        """The change (m, 1 + n) of unknowns, where the amplitudes keep their size; NaN where the equations are
        singular."""
        c, s, by_amplitudes, _, v, a, j = self.sums(unknowns)
        n, matrix = self.size, np.zeros((len(unknowns), self.size + 1, self.size + 2))
        columns = c * a + s * j, c * a - self.squares * s * v, c * v + s * a
        matrix[:, :n, 0], matrix[:, :n, 1], matrix[:, :n, -1] = columns
        matrix[:, :n, 2:-1], matrix[:, n, 2:-1] = by_amplitudes, unknowns[:, 2:]
        return -solve(matrix[..., :-1], matrix[..., -1:])[..., 0]

    def _holds(self, unknowns: Array) -> Array:
        """Whether (m,) unknowns solve the equations, and their amplitudes give the gap an acceleration."""
        at = self.sums(unknowns)
        terms = at.cosines * at.speeds, at.sines * at.accelerations
        error = np.abs(sum(terms)).max(1) / np.abs(terms).max((0, 2))
        share = np.abs(at.moved @ self.pull) / (np.linalg.norm(at.moved, axis=1) * np.linalg.norm(self.pull))
        return (error < LINEAR.largest_residual) & (share > LINEAR.largest_residual)

    def liftoffs(self, roots: Array) -> tuple[Array, Array]:
        """Flight states (m, 2n) at lift-off of roots (m, 1 + n), and whether (m,) the gap opens there, by its jerk."""
        at, shapes, states = self.sums(roots), self.flight.shapes, np.empty((len(roots), 2 * self.size))
        size = -(self.push + self.pull @ self.centre) / (at.moved @ self.pull)[:, None]
        speeds = size * at.speeds
        states[:, ::2], states[:, 1::2] = (self.centre + size * at.moved) @ shapes.T, speeds @ shapes.T
        return states, speeds @ self.pull > 0
