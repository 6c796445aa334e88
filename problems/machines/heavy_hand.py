"""The juggler's limit of an infinitely heavy hand, whose oscillation is the same whatever the ball does (section 9)."""

from dataclasses import replace
from functools import lru_cache
from typing import Any

from orbits import Mechanism
from orbits.errors import InputError
from orbits.laws import Algebraic, Key, Parameters, Scalars
from orbits.model import Model, Modes, single_mode, straight_line

from .juggler import Juggler
from .two_masses import TwoMassMachine


class HeavyHand(TwoMassMachine):
    """Ball on a hand of infinite mass, which the ball cannot slow down. The arguments are those of `TwoMassMachine`
    without mass ratio, damping and drag.

    The energy of the hand alone is conserved, from lift-off to lift-off and through every impact. So every launch that
    ends in sustained contact is followed by a launch at the same speed; the others bounce forever. For a linear
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
        """Raises `InputError`: the limit of an infinite mass is not a mechanism."""
        raise InputError(
            "an infinitely heavy hand is only a limit of mechanisms: state a Juggler with a large mass_ratio"
        )

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
    return replace(
        finite,
        name="heavy hand",
        contact=contact,
        flight_gradient=lambda x, p, q: [0.0, 0.0, *hand(x, p, q)],
        impact_mass=lambda x, p: 0.0,
        impact=lambda x, p: [0.0, 1.0, 0.0, 0.0],
        fixed=("mass_ratio",),
        weight=lambda p: 1.0,
    )
