"""The juggler: a ball on a hand, the hand on a spring to the ground, the ball caught plastically (sections 5 and 6).

Units: force in the hand's weight m2 g, length in m2 g/k, time in sqrt(m2/k), M = m2/m1 the mass of the hand over that
of the ball. Flight state (w1, w1', w2, w2') of ball and hand; phi is the force of the hand's spring at extension w2:

    w1'' = -gamma(rest_length + w1)        w2'' = -phi(w2) - gamma(rest_length + w2)

and in contact both move as one, (1 + M) w'' = -M phi(w) - (1 + M) gamma(rest_length + w), until phi(w) = 0.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from orbits.model.closed_form import Oscillator
from orbits.model.model import Model
from orbits.model.phase import Affine

from .laws import Key, Parameters, Scalars, from_key
from .liftoff import Liftoff
from .machine import TwoMassEquations, TwoMassMachine, straight_line, thrown, two_mass_model

HAND_LIFTOFF = Liftoff(1.0, "zero force")


@dataclass(frozen=True)
class Juggler(TwoMassMachine):
    """Ball on a sprung hand; see `TwoMassMachine` for the arguments. `mass_ratio` is hand over ball.

    The force is that of the hand's own spring, zero at lift-off. A hopper with spring force phi and lift-off extension
    rho moves as the juggler with force phi(r + rho) - 1 under constant gravity (eq. 6, with one clock).
    """

    kind = "juggler"

    @staticmethod
    @lru_cache(maxsize=64)
    def build(spring: Key, gravity: Key | None, has_length: bool, damped: bool) -> Model:
        """The model of the keys of the laws, see `TwoMassMachine.build`."""
        equations = JugglerEquations(spring, gravity, damped)
        return two_mass_model(
            equations,
            HAND_LIFTOFF,
            ("w1", "w1'", "w2", "w2'", "w", "w'"),
            Affine((0.0, 0.0, 1.0, 0.0)),
            name="juggler",
            launch=lambda u, p: [u["liftoff"], u["alpha"], u["liftoff"], u["alpha"]],
            landing=lambda u, x, p: [x[0] - x[2], x[1] - x[3], x[2] - u["liftoff"]],
            embed=np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 1.0]]),
            gap=lambda p: Affine((1.0, 0.0, -1.0, 0.0)),
            impact_mass=lambda p: p["mass_ratio"] / (1 + p["mass_ratio"]),
            impact=lambda p: np.array([0.0, p["mass_ratio"], 0.0, -1.0]) / (1 + p["mass_ratio"]),
            violations={
                "gap": "ball below the hand",
                "pull": "the hand would have to pull the ball",
                "separation": "the hand passes through the ground",
                "end": "contact: the spring collapses, the ball is never thrown again",
            },
            springs=((None, "hand"),),
            tension=lambda x, p, q: equations.force(x[2], p, q),
        )


class JugglerEquations(TwoMassEquations):
    """The functions of a juggler's model, see `Model` for their arguments."""

    def weight(self, w: Any, p: Parameters) -> Any:
        """Gravity ratio where a mass of coordinate w is."""
        return self.pull(p.get("rest_length", 0.0) + w, p)

    def flight(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        M, (c, d) = p["mass_ratio"], self.dampers(p)
        held = self.force(x[2], p, q) + (c + d) * x[3]
        return [x[1], -M * d * x[1] - self.weight(x[0], p), x[3], -held - self.weight(x[2], p)]

    def contact(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        M, (c, d) = p["mass_ratio"], self.dampers(p)
        return [x[1], -M / (1 + M) * (self.force(x[0], p, q) + (c + 2 * d) * x[1]) - self.weight(x[0], p)]

    def contact_force(self, x: Scalars, p: Parameters, q: Scalars) -> Any:
        return -(self.force(x[0], p, q) + self.liftoff_damping(p) * x[1]) / (1 + p["mass_ratio"])

    def liftoff_damping(self, p: Parameters) -> Any:
        """Of the force between ball and hand per speed: of the hand's dampers less the ball's."""
        (c, d), M = self.dampers(p), p["mass_ratio"]
        return c + (1 - M) * d

    def flight_gradient(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        M = p["mass_ratio"]
        return [self.weight(x[0], p), x[1], M * (self.force(x[2], p, q) + self.weight(x[2], p)), M * x[3]]

    def contact_gradient(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        M = p["mass_ratio"]
        return [M * self.force(x[0], p, q) + (1 + M) * self.weight(x[0], p), (1 + M) * x[1]]

    def contact_oscillator(self, p: Parameters) -> Oscillator:
        M = p["mass_ratio"]
        k, zero = straight_line(self.spring, p)
        force = {"contact force": (-k / (1 + M), k * zero / (1 + M))}
        return Oscillator(M * k / (1 + M), zero - (1 + M) / (M * k), force)

    def liftoff(self, u: Parameters, p: Parameters, q: Scalars) -> Any:
        return self.force(u["liftoff"], p, q) + self.liftoff_damping(p) * u["alpha"]

    def release(self, alpha: ArrayLike, p: Parameters) -> np.ndarray:
        return HAND_LIFTOFF.extensions_at(from_key(self.spring, p), self.liftoff_damping(p), alpha)

    @staticmethod
    def mix(p: Parameters) -> np.ndarray:
        """w1, w1', w2, w2' from w2, w2', w1, w1' (the hand swings, the ball is thrown); its own inverse."""
        return np.eye(4)[[2, 3, 0, 1]]

    apart = mix

    @staticmethod
    def complete(times: np.ndarray, coefficients: np.ndarray, u: Parameters, p: Parameters) -> np.ndarray:
        return np.concatenate([thrown(times, coefficients.shape[2], u), coefficients[:, :2]], axis=1)

    @staticmethod
    def gap_slope(times: np.ndarray, dz: np.ndarray, p: Parameters) -> np.ndarray:
        return times - dz[0]

    @staticmethod
    def heights(p: Parameters) -> dict[str, Affine]:
        length = p.get("rest_length", 0.0)
        return {"ball": Affine((1.0, 0.0, 0.0, 0.0), length), "hand": Affine((0.0, 0.0, 1.0, 0.0), length)}
