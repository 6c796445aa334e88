"""The juggler: a ball on a hand, the hand on a spring to the ground, the ball caught plastically (sections 5 and 6).

Units: force in the hand's weight m2 g, length in m2 g/k, time in sqrt(m2/k), M = m2/m1 the mass of the hand over that
of the ball. Flight state (w1, w1', w2, w2') of ball and hand; phi is the force of the hand's spring at extension w2:

    w1'' = -gamma(rest_length + w1)        w2'' = -phi(w2) - gamma(rest_length + w2)

and in contact both move as one, (1 + M) w'' = -M phi(w) - (1 + M) gamma(rest_length + w), until phi(w) = 0.
"""

from functools import lru_cache

from orbits import Mechanism
from orbits.laws import Key
from orbits.mechanics import Damper, Mass, Spring

from .two_masses import TwoMassMachine


class Juggler(TwoMassMachine):
    """Ball on a sprung hand; see `TwoMassMachine` for the arguments. `mass_ratio` is hand over ball.

    The force is that of the hand's own spring, zero at lift-off. A hopper with spring force phi and lift-off extension
    rho moves as the juggler with force phi(r + rho) - 1 under constant gravity (eq. 6, with the same unit of time).
    Source: eqs. (4) and (5) of the paper, for a linear spring.

    >>> from orbits import find
    >>> from problems import Juggler
    >>> round(find(Juggler(mass_ratio=0.9)).alpha, 9)  # tan(alpha) = alpha
    4.493409458
    """

    kind = "juggler"

    @staticmethod
    @lru_cache(maxsize=64)
    def mechanism(
        spring: Key, gravity: Key | None, has_length: bool, damped: bool, ground: Key | None = None
    ) -> Mechanism:
        """The mechanism of the keys of the laws, see `TwoMassMachine.mechanism`."""
        ball, hand = ("rest_length + w1", "rest_length + w2") if has_length else ("w1", "w2")
        masses = [Mass(ball, "1/mass_ratio"), Mass(hand, 1.0)]
        dampers = [Damper("w2", "damping"), Damper("w1", "drag"), Damper("w2", "drag")]
        return Mechanism(
            name="juggler",
            coordinates=("w1", "w2"),
            elements=[*masses, Spring("w2", spring), *(dampers if damped else [])],
            gap="w1 - w2",
            gravity=gravity or "1",
            energy_unit="1/mass_ratio",
            counts="w2",
            heights={"ball": ball, "hand": hand},
            separation="rest_length + w2" if has_length else None,
            words={
                "liftoff": "zero force",
                "gap": "ball below the hand",
                "pull": "the hand would have to pull the ball",
                "separation": "the hand passes through the ground",
                "end": "contact: the spring collapses, the ball is never thrown again",
            },
        )
