"""The hopper: a body and a foot joined by a spring, the foot landing plastically (sections 3 and 4 of the paper).

Units: force in the foot's weight m2 g, length in m2 g/k, time in 1/omega with omega**2 = k (1 + M)/m2, M = m2/m1 the
mass of the foot over that of the body; energy in m1 g times a length. Flight state (y1, y1', y2, y2') of body and foot,
extension r = y1 - y2; in contact y2 = 0 until phi(y1) = 1.
"""

from functools import lru_cache

from orbits import Mechanism
from orbits.laws import Key
from orbits.mechanics import Damper, Ground, Mass, Spring

from .two_masses import TwoMassMachine


class Hopper(TwoMassMachine):
    """Body and foot joined by a spring; see `TwoMassMachine` for the arguments. `mass_ratio` is foot over body mass.

    Source: sections 3 and 4 of the paper; its flight is eqs. (2) for a linear spring and constant gravity.

    >>> from orbits import find
    >>> from problems import Hopper
    >>> round(find(Hopper("r + beta*r**3", mass_ratio=0.5, parameters={"beta": 0.3})).alpha, 9)
    2.936459188
    """

    kind = "hopper"

    @staticmethod
    @lru_cache(maxsize=64)
    def mechanism(
        spring: Key, gravity: Key | None, has_length: bool, damped: bool, ground: Key | None = None
    ) -> Mechanism:
        """The mechanism of the keys of the laws, see `TwoMassMachine.mechanism`."""
        body = "rest_length + y1" if has_length else "y1"
        masses = [Mass(body, "(1 + mass_ratio)/mass_ratio"), Mass("y2", "1 + mass_ratio")]
        dampers = [Damper("y1 - y2", "damping"), Damper("y1", "drag"), Damper("y2", "drag")]
        return Mechanism(
            name="hopper",
            coordinates=("y1", "y2"),
            elements=[
                *masses,
                Spring("y1 - y2", spring),
                *(dampers if damped else []),
            ],
            gap="y2",
            ground=ground and Ground("(1 + mass_ratio)*ground_mass", ground),
            gravity=gravity or "1",
            surface_gravity="1/(1 + mass_ratio)",
            energy_unit="1/mass_ratio",
            counts="y1 - y2",
            heights={"body": body, "foot": "y2", "centre of mass": f"({body} + mass_ratio*y2)/(1 + mass_ratio)"},
            separation="rest_length + y1 - y2" if has_length else None,
            words={
                "liftoff": "the foot's weight",
                "gap": "foot below ground",
                **({"liftoff": "the ground falls as fast as the foot"} if ground else {}),
                "pull": "the ground would have to pull",
                "separation": "the masses pass through each other",
                "end": "contact: the spring collapses, the body never lifts off again",
            },
        )
