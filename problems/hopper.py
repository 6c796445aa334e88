"""The hopper: a body and a foot joined by a spring, the foot landing plastically (sections 3 and 4 of the paper).

Units: force in the foot's weight m2 g, length in m2 g/k, time in 1/omega with omega**2 = k (1 + M)/m2, M = m2/m1 the
mass of the foot over that of the body. Flight state (y1, y1', y2, y2') of body and foot, extension r = y1 - y2:

    (1 + M) y1'' = -M phi(r) - gamma(rest_length + y1)        (1 + M) y2'' = phi(r) - gamma(y2)

and in contact y2 = 0 until phi(y1) = 1.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from orbits.model.model import Model
from orbits.model.phase import Affine

from .launch import Liftoff
from .laws import Key, Parameters, Scalars
from .machine import TwoMassEquations, TwoMassMachine, straight_line, thrown, two_mass_model


@dataclass(frozen=True, repr=False)
class Hopper(TwoMassMachine):
    """Body and foot joined by a spring; see `TwoMassMachine` for the arguments. `mass_ratio` is foot over body."""

    kind = "hopper"

    @staticmethod
    @lru_cache(maxsize=64)
    def build(spring: Key, gravity: Key | None, has_length: bool, damped: bool) -> Model:
        """The model of the keys of the laws, see `TwoMassMachine.build`."""
        equations = _HopperEquations(spring, gravity, damped)
        return two_mass_model(
            equations,
            ("y1", "y1'", "y2", "y2'", "y1", "y1'"),
            Affine((1.0, 0.0, -1.0, 0.0)),
            name="hopper",
            launch=lambda u, p: [u["liftoff"], u["alpha"], 0.0, 0.0],
            landing=lambda u, x, p: [x[2], x[3], x[0] - u["liftoff"]],
            embed=np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [0.0, 0.0]]),
            gap=lambda p: Affine((0.0, 0.0, 1.0, 0.0)),
            impact_mass=lambda p: p["mass_ratio"] * (1 + p["mass_ratio"]),
            impact=lambda p: np.array([0.0, 0.0, 0.0, 1.0]),
            violations={
                "gap": "foot below ground",
                "pull": "the ground would have to pull",
                "separation": "the masses pass through each other",
                "end": "contact: the spring collapses, the body never lifts off again",
            },
            springs=(("foot", "body"),),
            tension=lambda x, p, q: equations.force(x[0] - x[2], p, q),
        )


class _HopperEquations(TwoMassEquations):
    """The functions of a hopper's model, see `Model` for their arguments."""

    threshold = Liftoff(0.0, "the foot's weight")

    def flight(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        M, (c, d) = p["mass_ratio"], self.dampers(p)
        tension = self.force(x[0] - x[2], p, q) + c * (x[1] - x[3])
        body = -(M * (tension + d * x[1]) + self.weight(x[0], p)) / (1 + M)
        return [x[1], body, x[3], (tension - self.pull(x[2], p) - d * x[3]) / (1 + M)]

    def contact(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        M, (c, d) = p["mass_ratio"], self.dampers(p)
        return [x[1], -(M * (self.force(x[0], p, q) + (c + d) * x[1]) + self.weight(x[0], p)) / (1 + M)]

    def contact_force(self, x: Scalars, p: Parameters, q: Scalars) -> Any:
        return 1 - self.force(x[0], p, q) - self.dampers(p)[0] * x[1]

    def flight_gradient(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        M, tension = p["mass_ratio"], self.force(x[0] - x[2], p, q)
        body, foot = M * tension + self.weight(x[0], p), M * (self.pull(x[2], p) - tension)
        return [body, (1 + M) * x[1], foot, (1 + M) * M * x[3]]

    def contact_gradient(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        M = p["mass_ratio"]
        return [M * self.force(x[0], p, q) + self.weight(x[0], p), (1 + M) * x[1]]

    def linear(self, p: Parameters) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        M, (k, zero) = p["mass_ratio"], straight_line(self.spring, p)
        stiffness = M * k * np.array([[1.0, -1.0], [-1.0, 1.0]])
        return (1 + M) * np.diag([1.0, M]), stiffness, M * k * zero * np.array([1.0, -1.0]) - [1.0, M]

    def linear_contact_force(self, p: Parameters) -> tuple[tuple[float, float], float]:
        k, zero = straight_line(self.spring, p)
        return (-k, 0.0), 1 + k * zero

    @staticmethod
    def complete(times: np.ndarray, coefficients: np.ndarray, u: Parameters, p: Parameters) -> np.ndarray:
        M, flown, swung = np.reshape(p["mass_ratio"], (-1, 1, 1)), thrown(times, 3, u), coefficients[:, :2]
        rows = np.empty((len(swung), 4, swung.shape[2]))
        np.multiply(M, swung, out=rows[:, :2])
        np.negative(swung, out=rows[:, 2:])
        rows[:, :2, :3] += flown
        rows[:, 2:, :3] += flown
        rows /= 1 + M
        return rows

    @staticmethod
    def gap_slope(times: np.ndarray, dz: np.ndarray, p: Parameters) -> np.ndarray:
        return (times - dz[0]) / (1 + p["mass_ratio"])

    @staticmethod
    def heights(p: Parameters) -> dict[str, Affine]:
        M, length = p["mass_ratio"], p.get("rest_length", 0.0)
        return {
            "body": Affine((1.0, 0.0, 0.0, 0.0), length),
            "foot": Affine((0.0, 0.0, 1.0, 0.0)),
            "centre of mass": Affine((1 / (1 + M), 0.0, M / (1 + M), 0.0), length / (1 + M)),
        }
