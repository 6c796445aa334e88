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

from orbits import Mechanism
from orbits.errors import InputError
from orbits.laws.law import Algebraic, Key, Parameters, Scalars
from orbits.mechanics import Damper, Mass, Spring
from orbits.model.model import Model, as_derived
from orbits.model.modes import Modes, single_mode
from orbits.model.relative import straight_line

from .two_masses import END, RATE, TwoMassMachine


@dataclass(frozen=True, repr=False)
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
    def mechanism(spring: Key, gravity: Key | None, has_length: bool, damped: bool, moved: bool = False) -> Mechanism:
        """The mechanism of the keys of the laws, see `TwoMassMachine.mechanism`."""
        ball, hand = ("rest_length + w1", "rest_length + w2") if has_length else ("w1", "w2")
        masses = [Mass(ball, "1/mass_ratio"), Mass(hand, 1.0)]
        dampers = [Damper("w2", "damping"), Damper("w1", "drag"), Damper("w2", "drag")]
        return Mechanism(
            name="juggler",
            coordinates=("w1", "w2"),
            elements=[*masses, Spring(f"w2 - {END}" if moved else "w2", spring), *(dampers if damped else [])],
            gap="w1 - w2",
            gravity=gravity or "1",
            energy_unit="1/mass_ratio",
            counts="w2",
            heights={"ball": ball, "hand": hand},
            separation="rest_length + w2" if has_length else None,
            actuators={END: RATE} if moved else {},
            words={
                "liftoff": "zero force",
                "gap": "ball below the hand",
                "pull": "the hand would have to pull the ball",
                "separation": "the hand passes through the ground",
                "end": "contact: the spring collapses, the ball is never thrown again",
            },
        )


@dataclass(frozen=True, repr=False)
class HeavyHand(TwoMassMachine):
    """Ball on a hand of infinite mass, which the ball cannot slow down; see `TwoMassMachine` for the arguments, except
    mass ratio, damping and drag, which it does not take.

    The energy of the hand alone is conserved, from lift-off to lift-off and through every impact. So every launch that
    ends in sustained contact is followed by a launch at the same speed; the others bounce for ever. For a linear
    spring, bouncing with one impact in each cycle is stable for pi < alpha < sqrt(pi^2 + 3) (Schaal and Atkeson 1993,
    with e = 0).

    >>> from orbits import ReturnMap
    >>> from problems import HeavyHand
    >>> hop = ReturnMap(HeavyHand())(4.6)
    >>> str(hop.status), int(hop.impacts)
    ('lifts_off', 1)
    """

    kind = "heavy hand"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mass_ratio != 1 or self.damped:
            raise InputError("an infinitely heavy hand has no mass ratio, damping or drag")

    def describe(self) -> dict[str, Any]:
        """The machine as JSON-ready data, without a mass ratio, which is infinite."""
        return {**super().describe(), "mass_ratio": None}

    def stated(self) -> Mechanism:
        """Raises `InputError`: the limit of an infinite mass is no mechanism."""
        raise InputError("an infinitely heavy hand is the limit of mechanisms: state a Juggler with a large mass_ratio")

    @classmethod
    def build(cls, spring: Key, gravity: Key | None, has_length: bool, damped: bool) -> Model:
        """The juggler's model with the hand's energy alone."""
        return _heavy_hand(spring, gravity, has_length)


@lru_cache(maxsize=64)
def _heavy_hand(spring: Key, gravity: Key | None, has_length: bool) -> Model:
    """The limit of the juggler's model for a ball without mass, its force divided by its mass."""
    finite = Juggler.mechanism(spring, gravity, has_length, False).model
    force = spring.expression

    def in_flight(x: Scalars) -> list[Algebraic]:
        """A contact state as one of the flight."""
        return [*x, *x]

    def oscillator(p: Parameters) -> Modes:
        k, zero = straight_line(spring, p)
        return single_mode(k, k * zero - 1, {"contact force": ((-k, 0.0), k * zero)})

    contact = replace(
        finite.contact,
        field=lambda x, p, q: finite.flight.field(in_flight(x), p, q)[2:],
        watch={"contact force": lambda x, p, q: -force(x[0], p, q)},
        closed_form=oscillator if finite.contact.closed_form else None,
    )
    hand = lambda x, p, q: [-finite.flight.field(x, p, q)[3], x[3]]  # noqa: E731
    heavy = replace(
        finite,
        name="heavy hand",
        contact=contact,
        flight_gradient=lambda x, p, q: [0.0, 0.0, *hand(x, p, q)],
        impact_mass=lambda x, p: 0.0,
        impact=lambda x, p: [0.0, 1.0, 0.0, 0.0],
    )
    return as_derived(heavy)
