"""A juggler whose hand is a chain: a ball on a hand, and below the hand masses, joined by springs down to the ground.

Units: whatever the masses, the springs' forces and their extensions are stated in, with gravity 1. Places y1, ..., yN
of ball, hand and the masses below are counted from where all springs are unloaded and the ball is on the hand; phi_i
is the force of the spring below mass i at extension r_i = y_i - y_{i+1}, of the lowest r_N = y_N. In flight

    y1'' = -1        m_2 y2'' = -phi_2(r_2) - m_2        m_i y_i'' = phi_{i-1}(r_{i-1}) - phi_i(r_i) - m_i,  i > 2,

and in contact ball and hand move as one, until the hand falls as fast as the ball: phi_2(r_2) = 0. "alpha" is the
speed of the hand at lift-off, half the time of flight.

With one spring it is the juggler. With two linear ones of stiffness k below the hand and K above the ground it tends
to the juggler whose one spring has the sum of their compliances, 1/k + 1/K, as the mass m3 between them vanishes or
the lower spring becomes stiff: then, with alpha_0 that juggler's launch speed and s = k/(k + K),

    alpha/alpha_0 = 1 + s^2 m3/(2 m2) + O(m3^2),

as if the hand had so much of the mass m3 as moves with it (Rayleigh's principle).
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

from orbits import Mechanism
from orbits.errors import InputError
from orbits.laws import LawLike
from orbits.mechanics import Mass, Spring

from ..laws import as_spring
from .chain import MOST_MASSES, mass_parameters
from .parameters import stated_numbers, with_parameters


def chain_hand(
    masses: Sequence[float] = (1.0, 1.0, 1.0),
    springs: LawLike | Sequence[LawLike] = "r",
    parameters: Mapping[str, float] | None = None,
    restitution: float = 0.0,
) -> Mechanism:
    """A juggler whose hand is a chain.

    masses : (N,), of ball, hand, and the masses below, called m1, ..., mN; N from 2 to 12
    springs : one as in `TwoMassMachine`, for all, or (N - 1,) of them, from the hand down, with parameters in common
    parameters : values of the formulas' names
    restitution : of the impacts of the ball, 0 <= e <= 1

    >>> from orbits import find_all, starts
    >>> from problems import chain_hand
    >>> juggler = chain_hand()
    >>> len(find_all(juggler, starts(juggler, 4, 4)))
    1
    """
    values, own = stated_numbers(parameters), mass_parameters(masses, 2, MOST_MASSES)
    names = ["ball", "hand", *(f"y{i}" for i in range(3, len(own) + 1))]
    laws = springs if isinstance(springs, list | tuple) else [springs] * (len(names) - 1)
    if len(laws) != len(names) - 1:
        raise InputError(f"a hand of {len(names) - 1} masses has {len(names) - 1} springs, not {len(laws)}")
    extensions = [*(f"{upper} - {lower}" for upper, lower in pairwise(names[1:])), names[-1]]
    return Mechanism(
        name=f"juggler with a hand of {len(names) - 1} masses",
        coordinates=names,
        elements=[
            *(Mass(name, mass) for name, mass in zip(names, own, strict=True)),
            *(Spring(r, as_spring(law, values, shared=True)) for r, law in zip(extensions, laws, strict=True)),
        ],
        gap="ball - hand",
        launch="hand",
        parameters=with_parameters(own, values, "a mass"),
        restitution=restitution,
        words={
            "liftoff": "zero force",
            "gap": "ball below the hand",
            "pull": "the hand would have to pull the ball",
            "end": "contact: the springs collapse, the ball is never thrown again",
        },
    )
