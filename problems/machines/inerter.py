"""The hopper with an inerter between its masses: a force b r'' against the second derivative of the extension.

Body m1 and foot m2 have the heights y1 and y2, the extension is r = y1 - y2, the spring's force phi(r), the inertance
b; mu = m1 m2/(m1 + m2) is the reduced mass and M = m2/m1. In flight

    m1 y1'' = -phi(r) - b r'' - m1 g        m2 y2'' = phi(r) + b r'' - m2 g,

whose difference, divided by the masses, is (mu + b) r'' = -phi(r): the inerter adds to the mass that swings. In contact
(m1 + b) y1'' = -phi(y1) - m1 g, and the ground carries m2 g - phi - b y1''; that vanishes, and the foot lifts off, at

    phi(rho) = (m2 + b (1 + M)) g.

The centre of mass is thrown at the speed alpha/(1 + M), alpha = y1' at lift-off, so half the flight takes the time
alpha/((1 + M) g). An orbit is a hop whose extension stands still then. For a linear spring phi = k r, with
omega^2 = k/(mu + b), the extension rho cos(omega t) + (alpha/omega) sin(omega t) stands still where
tan(omega t) = alpha/(omega rho). Since omega^2 rho = phi(rho)/(mu + b) = (1 + M) g, the right side is omega times half
the time of flight: with x = omega alpha/((1 + M) g)

    tan x = x,

as for the hopper without inerter, only slower: alpha and the time of flight grow with the root of mu + b, heights and
stretch of the spring in flight with mu + b itself. At an impact (m1 + b) y1' - b y2' is conserved, as the ground pushes
the foot alone; from the foot's speed v the loss is (m2 + b m1/(m1 + b)) v^2/2.
"""

from collections.abc import Mapping

from orbits import Mechanism
from orbits.laws import LawLike
from orbits.mechanics import Inerter, Mass, Spring

from .parameters import with_parameters


def inerter_hopper(
    spring: LawLike = "r", *, body_mass: float = 1.0, foot_mass: float = 1.0, inertance: float = 0.2,
    surface_gravity: float = 1.0, rest_length: float | None = None, restitution: float = 0.0,
    parameters: Mapping[str, float] | None = None, in_si: bool = False,
) -> Mechanism:  # fmt: skip
    """Body and foot joined by a spring and an inerter; the launch speed is that of the body.

    spring : a law of `problems.springs`, or a formula of the extension r, whose other names are `parameters`
    body_mass, foot_mass, inertance : masses of body and foot, and inertance of the flywheel
    surface_gravity : acceleration of gravity, which is constant
    rest_length : of the spring; None if the masses are assumed never to meet
    restitution : of the foot's impacts, 0 <= e <= 1
    parameters : values of the spring's names
    in_si : whether all numbers are in kg, m and s; else they are in any consistent units

    Source: the inerter of Smith 2002.

    >>> from orbits import find
    >>> from problems import inerter_hopper
    >>> round(find(inerter_hopper()).alpha, 6)
    7.518912
    """
    own = {"body_mass": body_mass, "foot_mass": foot_mass, "inertance": inertance, "surface_gravity": surface_gravity}
    length = {} if rest_length is None else {"rest_length": rest_length}
    body = "rest_length + body" if length else "body"
    return Mechanism(
        name="inerter hopper",
        coordinates=("body", "foot"),
        elements=[
            *(Mass(body, "body_mass"), Mass("foot", "foot_mass")),
            *(Spring("body - foot", spring), Inerter("body - foot", "inertance")),
        ],
        gap="foot",
        surface_gravity="surface_gravity",
        parameters=with_parameters(own | length, parameters),
        heights={
            "body": body,
            "foot": "foot",
            "centre of mass": f"(body_mass*({body}) + foot_mass*foot)/(body_mass + foot_mass)",
        },
        separation=f"{body} - foot" if length else None,
        restitution=restitution,
        in_si=in_si,
        words={
            "liftoff": "the weights of foot and inerter",
            "gap": "foot below ground",
            "pull": "the ground would have to pull",
            "separation": "the masses pass through each other",
            "end": "contact: the spring collapses, the body never lifts off again",
        },
    )
