"""Rigid rods on pins in the plane, in Cartesian coordinates: an integration that shares nothing with the engine.

A rod has the coordinates (x, z, theta) of its centre of mass and its angle, and points at distances r from that centre
along (sin(theta), cos(theta)). A pin holds a point of one rod at a point of another, or at a place on the ground. The
forces of the pins are multipliers: with the masses and inertias M, the springs and the weight f, and the velocities
G v = 0 of the pins,

    M a - G' force = f        G a = theta'^2 r (sin(theta), cos(theta)), of the first point less the second.

The matrix of both is regular even if a rod has no inertia, as long as the pins carry its motion. Pins that hold at the
start hold up to the error of the integration, which `drift` measures.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

ACCURATE = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14}


@dataclass(frozen=True)
class Rods:
    """Rods with gravity 1.

    masses, inertias : (n,), about the centres of mass
    pins : (i, r, j, s): the point r of rod i is at the point s of rod j, or rests if j is None
    springs : (i, j, k): the torque -k(theta_i - theta_j) on rod i, and the opposite one on rod j
    """

    masses: np.ndarray
    inertias: np.ndarray
    pins: tuple[tuple[int, float, int | None, float], ...]
    springs: tuple[tuple[int, int, float], ...] = ()

    def balance(self, q, v):
        """The accelerations (n, 3) and the forces (pins, 2) on the first rod of each pin, at q and v (n, 3)."""
        n = len(self.masses)
        matrix, turning = self.system(q, v)
        right = np.concatenate([np.zeros(3 * n), turning])
        right[1 : 3 * n : 3] = -self.masses
        for i, j, k in self.springs:
            right[[3 * i + 2, 3 * j + 2]] += np.array([-k, k]) * (q[i, 2] - q[j, 2])
        found = np.linalg.solve(matrix, right)
        return found[: 3 * n].reshape(n, 3), found[3 * n :].reshape(-1, 2)

    def system(self, q, v):
        """The matrix of accelerations and forces at q and v (n, 3), and the accelerations (2 pins,) from the turning
        of the rods."""
        n, p = len(self.masses), len(self.pins)
        sin, cos = np.sin(q[:, 2]), np.cos(q[:, 2])
        matrix, turning = np.zeros((3 * n + 2 * p,) * 2), np.zeros(2 * p)
        matrix[range(3 * n), range(3 * n)] = np.column_stack([self.masses, self.masses, self.inertias]).ravel()
        for row, (i, r, j, s) in zip(range(0, 2 * p, 2), self.pins, strict=True):
            for body, arm, sign in ((i, r, 1), (j, s, -1)):
                if body is not None:
                    x, at = 3 * body, 3 * n + row
                    block = sign * np.array([[1, 0, arm * cos[body]], [0, 1, -arm * sin[body]]])
                    matrix[at : at + 2, x : x + 3], matrix[x : x + 3, at : at + 2] = block, -block.T
                    turning[row : row + 2] += sign * arm * v[body, 2] ** 2 * np.array([sin[body], cos[body]])
        return matrix, turning

    def struck(self, state):
        """The state after an impact that brings the pins to hold, and the impulses (pins, 2) on the first rods."""
        (q, v), n = state, len(self.masses)
        momentum = np.column_stack([self.masses, self.masses, self.inertias]) * v
        matrix, turning = self.system(q, v)
        found = np.linalg.solve(matrix, np.concatenate([momentum.ravel(), 0 * turning]))
        return np.stack([q, found[: 3 * n].reshape(n, 3)]), found[3 * n :].reshape(-1, 2)

    def move(self, state, times):
        """The states (times, 2, n, 3) of places and velocities from `state` (2, n, 3) at the first of the times."""

        def rates(_, y):
            q, v = y.reshape(2, -1, 3)
            return np.concatenate([v.ravel(), self.balance(q, v)[0].ravel()])

        ends = (times[0], times[-1])
        return solve_ivp(rates, ends, state.ravel(), t_eval=times, **ACCURATE).y.T.reshape(len(times), 2, -1, 3)

    def forces(self, path):
        """The forces (times, pins, 2) along a path."""
        return np.array([self.balance(*state)[1] for state in path])

    def energy(self, path):
        """The energies (times,) along a path."""
        (q, v), m = np.moveaxis(path, 1, 0), np.column_stack([self.masses, self.masses, self.inertias])
        springs = sum(k * (q[:, i, 2] - q[:, j, 2]) ** 2 for i, j, k in self.springs)
        return (m * v**2).sum((1, 2)) / 2 + q[:, :, 1] @ self.masses + springs / 2

    def drift(self, path):
        """The largest change of place of a point of a pin, relative to the other rod or to the start."""
        apart = [point(path, i, r) - (0.0 if j is None else point(path, j, s)) for i, r, j, s in self.pins]
        return max(float(np.abs(x[:, 0] - x[0, 0]).max()) for x in apart)

    def hung(self, angles, rates):
        """The state (2, n, 3) at angles and rates (n,) in which the pins hold and the one to the ground is at (0, 0).

        Each pin but that one places its second rod.
        """
        state = np.zeros((2, len(self.masses), 3))
        state[:, :, 2] = angles, rates
        for i, r, j, s in self.pins:
            moved, arm, held = (i, r, 0.0) if j is None else (j, s, point(state, i, r))
            state[:, moved, :2] += held - point(state, moved, arm)
        return state


def point(states, rod, r):
    """The place and the velocity (.., 2, 2) of the point r of a rod in states (.., 2, n, 3)."""
    theta, rate = states[..., 0, rod, 2], states[..., 1, rod, 2]
    sin, cos = r * np.sin(theta), r * np.cos(theta)
    return states[..., rod, :2] + np.stack([np.stack([sin, cos], -1), np.stack([rate * cos, -rate * sin], -1)], -2)


def on_two_legs(leg, body, ends, hip_stiffness=0.0, leg_spring=0.0):
    """Two equal rods that a third joins at the hip, or at the shoulder, with the ends of rods 0 or 1 that rest.

    leg : (mass, centre, inertia), with the distance of the centre of mass from the hip; the length is 1
    body : (mass, centre, inertia), with the height of the centre of mass above the hip. The inertia of a body whose
        centre is at the hip may be 1 where none matters
    ends : the rods whose ends rest, as (0,) or (0, 1)
    """
    (m, d, jl), (mass, c, inertia) = leg, body
    return Rods(
        np.array([m, m, mass]), np.array([jl, jl, inertia]),
        (*((end, d - 1, None, 0.0) for end in ends), (0, d, 1, d), (0, d, 2, -c)),
        ((2, 0, hip_stiffness), (2, 1, hip_stiffness), (0, 1, leg_spring)),
    )  # fmt: skip
