"""A leg with a knee: a body on two massless links, bent by a torsional spring, that hops vertically.

Coordinates are the foot's height h and the knee's angle theta, from 0 (folded) to pi (straight). Two links of length l
join the foot to the hip, which stays above it, at the height h + L with the leg's length L(theta) = 2 l sin(theta/2);
the knee's spring has the torque tau(theta - theta0), theta0 the angle of rest. The hip has the mass m1, the foot m2. As
the links have none, the leg pulls hip and foot together with the force F = tau/L', where L' = l cos(theta/2), so that

    m1 (h + L)'' = -F - m1 g        m2 h'' = F - m2 g

in flight; in contact h = 0 and the ground carries m2 g - F, which vanishes at lift-off. Hence body and foot are a
hopper whose spring is the leg: F over the length L, which stiffens beyond all bounds towards the straight knee and
softens as it folds. The launch speed alpha is theta' at lift-off, in rad/s; the body is thrown with L' alpha. A
straight knee has L' = 0, no lever, and the angle's equation of motion ends there.
"""

from collections.abc import Mapping
from math import pi

from orbits import Mechanism
from orbits.errors import InputError
from orbits.laws import LawLike, number
from orbits.mechanics import Mass, Spring, names_in
from orbits.units import STANDARD_GRAVITY

from .parameters import with_parameters

LEG = "2*link*sin(knee/2)"
WORDS_OF_KNEES = {
    "liftoff": "the foot's weight",
    "gap": "foot below ground",
    "pull": "the ground would have to pull",
    "separation": "the knee folds through",
    "end": "contact: the knee folds, the body never lifts off again",
    "none": "a knee carries its body where its torque, folded, is above body_mass * surface_gravity * link",
}


def knee_hopper(
    torque: LawLike = "stiffness*r", *, body_mass: float = 60.0, foot_mass: float = 3.0, link: float = 0.45,
    stiffness: float | None = None, rest_angle: float = 2.6, surface_gravity: float = STANDARD_GRAVITY,
    restitution: float = 0.0, parameters: Mapping[str, float] | None = None,
) -> Mechanism:  # fmt: skip
    """A hopper on a knee, in SI.

    torque : of the knee's spring, in N m: a law of `problems.springs`, or a formula of r = theta - rest_angle in rad,
        whose names other than the stiffness are `parameters`
    body_mass, foot_mass : in kg
    link : length of each link in m
    stiffness : of the knee in N m/rad, 600 by default if the torque has it
    rest_angle : of the knee where its spring is unloaded, in rad, between 0 and pi
    surface_gravity : in m/s^2
    restitution : of the foot's impacts, 0 <= e <= 1
    parameters : values of the torque's names

    The launch speed is that of the knee, in rad/s. The knee can carry the body if the torque of the folded knee is
    above body_mass * surface_gravity * link; for these numbers this needs a stiffness of 102 N m/rad or more.

    >>> from orbits import find
    >>> from problems import knee_hopper
    >>> round(find(knee_hopper()).alpha, 6)  # of the knee, rad/s
    3.19269
    """
    if not 0 < number("rest_angle", rest_angle) < pi:
        raise InputError(f"rest_angle = {rest_angle:g} rad: a knee rests between folded (0) and straight (pi)")
    own = {
        "body_mass": body_mass, "foot_mass": foot_mass, "link": link, "rest_angle": rest_angle,
        "surface_gravity": surface_gravity,
    }  # fmt: skip
    if stiffness is not None or "stiffness" in names_in(torque):
        own["stiffness"] = 600.0 if stiffness is None else stiffness
    return Mechanism(
        name="knee hopper",
        coordinates=("foot", "knee"),
        elements=[
            *(Mass(f"foot + {LEG}", "body_mass"), Mass("foot", "foot_mass")),
            Spring("knee - rest_angle", torque),
        ],
        gap="foot",
        surface_gravity="surface_gravity",
        parameters=with_parameters(own, parameters),
        counts="knee",
        heights={"body": f"foot + {LEG}", "foot": "foot"},
        separation=LEG,
        restitution=restitution,
        in_si=True,
        rest={"knee": "rest_angle"},
        angles=("knee",),
        knees=[("foot", "body", "link")],
        words=WORDS_OF_KNEES,
    )
