"""The juggler: a ball on a hand, the hand on a spring to the ground, the ball caught plastically (sections 5 and 6);
and its limit of an infinitely heavy hand, whose oscillation is the same whatever the ball does (section 9).

Units: force in the hand's weight m2 g, length in m2 g/k, time in sqrt(m2/k), M = m2/m1 the mass of the hand over that
of the ball. Flight state (w1, w1', w2, w2') of ball and hand; phi is the force of the hand's spring at extension w2:

    w1'' = -gamma(rest_length + w1)        w2'' = -phi(w2) - gamma(rest_length + w2)

and in contact both move as one, (1 + M) w'' = -M phi(w) - (1 + M) gamma(rest_length + w), until phi(w) = 0.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from orbits.errors import InputError
from orbits.model.closed_form import Oscillator
from orbits.model.model import Model, as_derived
from orbits.model.phase import Affine

from .launch import Liftoff
from .laws import Key, Parameters, Scalars
from .machine import TwoMassEquations, TwoMassMachine, straight_line, thrown, two_mass_model


@dataclass(frozen=True, repr=False)
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
        equations = _JugglerEquations(spring, gravity, damped)
        return two_mass_model(
            equations,
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


class _JugglerEquations(TwoMassEquations):
    """The functions of a juggler's model, see `Model` for their arguments."""

    threshold = Liftoff(1.0, "zero force")

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
        """Of the force between ball and hand: the hand's dampers less the ball's."""
        (c, d), M = self.dampers(p), p["mass_ratio"]
        return c + (1 - M) * d

    def flight_gradient(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        M = p["mass_ratio"]
        return [self.weight(x[0], p), x[1], M * (self.force(x[2], p, q) + self.weight(x[2], p)), M * x[3]]

    def contact_gradient(self, x: Scalars, p: Parameters, q: Scalars) -> list[Any]:
        M = p["mass_ratio"]
        return [M * self.force(x[0], p, q) + (1 + M) * self.weight(x[0], p), (1 + M) * x[1]]

    def contact_oscillator(self, p: Parameters) -> Oscillator:
        M, (k, zero) = p["mass_ratio"], straight_line(self.spring, p)
        force = {"contact force": (-k / (1 + M), k * zero / (1 + M))}
        return Oscillator(M * k / (1 + M), zero - (1 + M) / (M * k), force)

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


@dataclass(frozen=True, repr=False)
class HeavyHand(TwoMassMachine):
    """Ball on a hand that it cannot slow down; see `TwoMassMachine` for the arguments, of which it takes no mass ratio,
    damping or drag.

    What is conserved is the hand's energy alone, from lift-off to lift-off and through every impact, so every launch
    that ends in sustained contact comes back as it was; the others bounce for ever. For a linear spring, period-one
    bouncing is stable for pi < alpha < sqrt(pi^2 + 3) (Schaal and Atkeson 1993, with e = 0).
    """

    kind = "heavy hand"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mass_ratio != 1 or self.damped:
            raise InputError("an infinitely heavy hand has no mass ratio, damping or drag")

    def describe(self) -> dict[str, Any]:
        """The machine as JSON-ready data, without a mass ratio, which is infinite."""
        return {**super().describe(), "mass_ratio": None}

    @staticmethod
    @lru_cache(maxsize=64)
    def build(spring: Key, gravity: Key | None, has_length: bool, damped: bool) -> Model:
        """The juggler's model with the hand's energy alone, see `TwoMassMachine.build`."""
        finite = Juggler.build(spring, gravity, has_length, False)
        force, weight = spring.expression, _JugglerEquations(spring, gravity, False).weight

        def oscillator(p):
            k, zero = straight_line(spring, p)
            return Oscillator(k, zero - 1 / k, {"contact force": (-k, k * zero)})

        contact = replace(
            finite.contact,
            field=lambda x, p, q: [x[1], -force(x[0], p, q) - weight(x[0], p)],
            watch={"contact force": lambda x, p, q: -force(x[0], p, q)},
            closed_form=oscillator if finite.contact.closed_form else None,
        )
        heavy = replace(
            finite,
            name="heavy hand",
            contact=contact,
            flight_gradient=lambda x, p, q: [0.0, 0.0, force(x[2], p, q) + weight(x[2], p), x[3]],
            contact_gradient=lambda x, p, q: [force(x[0], p, q) + weight(x[0], p), x[1]],
            impact_mass=lambda p: 0.0,
            impact=lambda p: np.array([0.0, 1.0, 0.0, 0.0]),
        )
        return as_derived(heavy)
