"""A walker with two rigid legs and a torso on hip springs, which stands on one foot and then on both.

With the angles a of the standing leg, b of the other one and phi of the torso from the vertical, the hip is at
(sin(a), cos(a)) legs from the standing foot, each leg's centre of mass below the hip and the torso's above it. The
springs have the torques k(phi - a) and k(phi - b) at the hip and kl(a - b) between the legs. With the lean
s = (a + b)/2 and half the angle between the legs e = (a - b)/2 the other foot is at the height -2 sin(s) sin(e) and at
the place 2 cos(s) sin(e): it passes the ground in mid-stance, as legs of one length do, and lands where s is 0 again.

A landing costs nothing where both legs are at rest then and no force acts on the foot that lands, so that they have no
acceleration either. While both feet stand, only the torso swings,

    C phi'' = M c sin(phi) - k(phi - e) - k(phi + e),    C = M c^2 + J,

until the other foot lifts off as the mirror image of the landing. These are six conditions for five unknowns, so that
one number of the machine has to be tuned, and one more for a prescribed angle; see Gomes and Ruina, Phys. Rev. E 83
(2011) 032901, who showed that such motions exist.
"""

from collections.abc import Mapping
from math import inf

from orbits import Mechanism
from orbits.errors import InputError, true_or_false
from orbits.laws import LawLike, number
from orbits.mechanics import Body, Drawing, Joint, Mass, Outline, Spring

from ..laws import as_spring
from .parameters import gravity_in_si, with_parameters

STAND, SWING = "(lean + angle)", "(lean - angle)"
HIP = (f"leg_length*sin{STAND}", f"leg_length*cos{STAND}")
TORSO = (f"{HIP[0]} + torso_height*sin(torso)", f"{HIP[1]} + torso_height*cos(torso)")
# The angles of the two legs, which stand in turn, and the length that is drawn of the torso.
LEGS = {"first leg": "(lean + angle*cos(pi*steps))", "second leg": "(lean - angle*cos(pi*steps))"}
TORSO_LENGTH = "(torso_height + leg_length/2)"
WITHOUT_UNITS = {
    "mass": 1.0, "leg_length": 1.0, "leg_mass": 0.1, "leg_centre": 1.0, "leg_inertia": 0.0, "torso_height": 0.0,
    "torso_inertia": 0.42, "hip_stiffness": 0.39, "leg_spring": 0.0,
}  # fmt: skip
UNITS_OF_WALKER = {
    "mass": "kg", "leg_length": "m", "leg_mass": "kg", "leg_centre": "m", "leg_inertia": "kg m^2", "torso_height": "m",
    "torso_inertia": "kg m^2", "hip_stiffness": "N m/rad", "leg_spring": "N m/rad",
}  # fmt: skip
WORDS_OF_WALKERS = {
    "liftoff": "the force on the foot that opens",
    "gap": "the swing foot touches the ground in flight",
    "pull": "the foot that lifts off next would have to pull",
    "landed pull": "the foot that has landed would have to pull",
    "stance": "the standing foot lifts",
    "end": "double stance: the old foot never lifts off",
    "none": "a lossless walker has tuned numbers: give find tune= and at=, as tune=('torso_inertia', 'hip_stiffness'), "
    "at={'angle': 0.3}",
}


def _below(leg: str) -> tuple[str, str]:
    """The place across and the height of a leg's centre of mass."""
    return f"{HIP[0]} - leg_centre*sin{leg}", f"{HIP[1]} - leg_centre*cos{leg}"


def walker(
    leg_mass: float | None = None, leg_centre: float | None = None, leg_inertia: float | None = None,
    torso_height: float | None = None, torso_inertia: float | None = None, hip_stiffness: float | None = None,
    leg_spring: float | None = None, *,
    mass: float | None = None, leg_length: float | None = None, surface_gravity: float | None = None,
    spring: LawLike = "hip_stiffness*r", friction: float | None = None, in_si: bool = False,
    parameters: Mapping[str, float] | None = None,
) -> Mechanism:  # fmt: skip
    """Two rigid legs and a torso on hip springs, which walk over level ground without loss.

    leg_mass, leg_centre, leg_inertia : of each leg: its mass, the distance of its centre of mass below the hip, and its
        inertia about that
    torso_height, torso_inertia : the distance of the torso's centre of mass above the hip, and its inertia about that
    hip_stiffness, leg_spring : of the springs between the torso and each leg, and between the legs
    mass, leg_length : of the whole, and of the legs
    surface_gravity : 1, or in SI 9.80665 m/s^2, where it is None
    spring : the torque of each spring at the hip, an odd law of its extension r: one of `problems.springs`, or a
        formula whose names other than the stiffness are `parameters`
    friction : the coefficient of friction; an orbit that needs more violates it. None for any
    in_si : whether all numbers are in SI, where each but `leg_spring` must be stated; otherwise they are in any
        consistent units, by default in legs, in the whole mass and in the time sqrt(leg_length/gravity)
    parameters : values of the names in the spring's law

    The coordinates are the lean, the mean of the angles of the standing and of the other leg; angle, half of their
    difference, the step angle at landing; and torso, the angle of the torso. Raises `InputError` for numbers that no
    walker has, and for missing numbers in SI.

    >>> from problems import walker
    >>> walker(leg_mass=0.1, torso_inertia=0.42).model.launch_unknowns
    ('liftoff', 'alpha', 'angle')
    """
    in_si = true_or_false("in_si", in_si)
    gravity = 1.0 if surface_gravity is None and not in_si else gravity_in_si(surface_gravity)
    stated = {
        "mass": mass, "leg_length": leg_length, "leg_mass": leg_mass, "leg_centre": leg_centre,
        "leg_inertia": leg_inertia, "torso_height": torso_height, "torso_inertia": torso_inertia,
        "hip_stiffness": hip_stiffness, "leg_spring": leg_spring,
    }  # fmt: skip
    if in_si and (missing := [name for name in UNITS_OF_WALKER if name != "leg_spring" and stated[name] is None]):
        needed = ", ".join(f"{name} ({UNITS_OF_WALKER[name]})" for name in missing)
        raise InputError(f"a walker in SI needs {needed}: only a walker without units has default values")
    own = {name: number(name, WITHOUT_UNITS[name] if value is None else value) for name, value in stated.items()}
    if not 0 < own["leg_mass"] < own["mass"] / 2:
        raise InputError(
            f"leg_mass = {own['leg_mass']:g}; it must lie above 0 and below half the mass {own['mass']:g} of the whole"
        )
    if own["leg_centre"] > own["leg_length"]:
        raise InputError(
            f"leg_centre = {own['leg_centre']:g}; it must be at most leg_length = {own['leg_length']:g}, at the foot"
        )
    if not own["torso_inertia"] + own["torso_height"]:
        raise InputError("torso_inertia = 0, torso_height = 0: the torso has no inertia; state one of them above 0")
    own |= {"surface_gravity": gravity} | ({} if friction is None else {"friction": number("friction", friction)})
    known = with_parameters(own, parameters)
    torque = as_spring(spring, known, shared=True)
    known = {name: value for name, value in known.items() if name != "hip_stiffness" or name in torque.key.names}
    return Mechanism(
        name="walker",
        coordinates=("lean", "angle", "torso"),
        elements=[
            Mass(_below(STAND)[1], "leg_mass", across=_below(STAND)[0]),
            Mass(_below(SWING)[1], "leg_mass", across=_below(SWING)[0]),
            Mass(TORSO[1], "mass - 2*leg_mass", across=TORSO[0]),
            Spring("torso - lean - angle", torque),
            Spring("torso - lean + angle", torque),
            Spring("2*angle", "leg_spring*r"),
        ],
        gap="-2*leg_length*sin(lean)*sin(angle)",
        sticks={"angle": "2*leg_length*cos(lean)*sin(angle)"},
        grazes=True,
        reversor={"lean": "-lean", "angle": "-angle", "torso": "-torso"},
        symmetry={"angle": "-angle"},
        inertia={"lean": "2*leg_inertia", "angle": "2*leg_inertia", "torso": "torso_inertia"},
        surface_gravity="surface_gravity",
        parameters=known,
        counts="torso",
        launch="torso",
        heights={"torso": TORSO[1], "hip": HIP[1]},
        angles=("lean", "angle", "torso"),
        segments={"standing leg": "lean + angle", "swing leg": "lean - angle", "torso": "torso"},
        friction=None if friction is None else "friction",
        bounds={name: (0.0, inf) for name in own if name in known},
        in_si=in_si,
        words=WORDS_OF_WALKERS,
        drawing=_walker_drawn(),
        bodies=_walker_bodies(),
    )


def _walker_drawn() -> Drawing:
    """Two legs, each in its colour from step to step, and a torso with its centre of mass."""
    top = (f"{HIP[0]} + {TORSO_LENGTH}*sin(torso)", f"{HIP[1]} + {TORSO_LENGTH}*cos(torso)")
    feet = {
        name: (f"{HIP[0]} - leg_length*sin{angle}", f"{HIP[1]} - leg_length*cos{angle}") for name, angle in LEGS.items()
    }
    return Drawing(
        [
            Outline("torso", [HIP, top]),
            *(Outline(name, [HIP, foot], ends=True) for name, foot in feet.items()),
            Outline("torso", [TORSO], ends=True),
            Outline("path of the hip", [HIP], traced=True),
        ],
        onward={"x": "x + step"},
    )


def _walker_bodies() -> list[Body]:
    """A torso that moves with the hip, and two legs that turn there."""
    joints = [
        Joint("hip_across", "across", f"{HIP[0]} + steps*step"),
        Joint("hip_up", "up", HIP[1]),
        Joint("pitch", "turn", "torso"),
    ]
    line, leg = Outline("torso", [("0", "0"), ("0", TORSO_LENGTH)]), [("0", "0"), ("0", "-leg_length")]
    torso = Body("torso", joints, "mass - 2*leg_mass", "torso_inertia", centre=("0", "torso_height"), outlines=[line])
    return [
        torso,
        *(
            Body(
                name.replace(" ", "_"), [Joint(f"hip_{name[0]}", "turn", f"{angle} - torso")], "leg_mass",
                "leg_inertia", centre=("0", "-leg_centre"), carrier="torso", outlines=[Outline(name, leg)],
            )
            for name, angle in LEGS.items()
        ),
    ]  # fmt: skip
