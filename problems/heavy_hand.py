"""The juggler's limit of an infinitely heavy hand: its oscillation is the same whatever the ball does (section 9).

Units and states are the juggler's. What is conserved is the hand's energy alone, from lift-off to lift-off and through
every impact, so every launch that ends in sustained contact comes back as it was; the others bounce for ever. For a
linear spring, period-one bouncing is stable for pi < alpha < sqrt(pi^2 + 3) (Schaal and Atkeson 1993, with e = 0).
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from orbits.errors import InputError
from orbits.model.closed_form import Oscillator
from orbits.model.model import Model
from orbits.model.phase import Phase

from .juggler import Juggler, JugglerEquations
from .laws import Key
from .machine import TwoMassMachine, straight_line


@dataclass(frozen=True)
class HeavyHand(TwoMassMachine):
    """Ball on a hand that it cannot slow down; see `TwoMassMachine` for the arguments, of which it takes no mass ratio,
    damping or drag."""

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
        force, weight = spring.expression, JugglerEquations(spring, gravity, False).weight

        def oscillator(p):
            k, zero = straight_line(spring, p)
            return Oscillator(k, zero - 1 / k, {"contact force": (-k, k * zero)})

        contact = Phase(
            "contact",
            finite.contact.states,
            lambda x, p, q: [x[1], -force(x[0], p, q) - weight(x[0], p)],
            {"contact force": lambda x, p, q: -force(x[0], p, q)},
            finite.contact.pieces,
            oscillator if finite.contact.closed_form else None,
        )
        return replace(
            finite,
            name="heavy hand",
            contact=contact,
            flight_gradient=lambda x, p, q: [0.0, 0.0, force(x[2], p, q) + weight(x[2], p), x[3]],
            contact_gradient=lambda x, p, q: [force(x[0], p, q) + weight(x[0], p), x[1]],
            impact_mass=lambda p: 0.0,
            impact=lambda p: np.array([0.0, 1.0, 0.0, 0.0]),
        )
