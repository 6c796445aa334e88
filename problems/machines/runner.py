"""A runner in the plane: a body on a sprung leg with a hip spring, and a massive foot that lands at rest and sticks.

Coordinates are the foot's place x along the ground and its height z, the leg's length l, its angle theta from the
vertical and the body's pitch phi. The hip is the body's centre of mass, at (x + l sin(theta), z + l cos(theta)). With
the masses m1 of the body and m2 of the foot, the body's inertia I, the leg's force T(l - l0) and the hip's torque
tau(phi - theta),

    l'' = l theta'^2 - T/mu        l^2 theta'' = tau/mu - 2 l l' theta'        I phi'' = -tau

in flight, where 1/mu = 1/m1 + 1/m2 and the centre of mass flies along a parabola; in contact, where x and z rest,

    l'' = l theta'^2 - g cos(theta) - T/m1        l^2 theta'' = g l sin(theta) + tau/m1 - 2 l l' theta'

and the ground holds the foot with the forces F_z = m2 g - T cos(theta) - (tau/l) sin(theta) and
F_x = -T sin(theta) + (tau/l) cos(theta). A landing costs nothing where the foot has no speed in x and z, and both
forces vanish there and at lift-off. That is one condition more than half an orbit has unknowns: one number of the
machine has to be tuned, and one more for each prescribed quantity, as the forward speed.
"""

from collections.abc import Mapping
from math import inf

from orbits import Mechanism
from orbits.errors import true_or_false
from orbits.laws import LawLike
from orbits.mechanics import Body, Drawing, Joint, Mass, Outline, Spring

from .parameters import numbers_and_laws, refuse_taken, stated_numbers

HIP = ("x + l*sin(theta)", "z + l*cos(theta)")
# The numbers of a runner without units where they are not stated, and the units of those in SI.
WITHOUT_UNITS = {
    "body_mass": 1.0, "foot_mass": 0.1, "inertia": 5.7, "stiffness": 1.0, "hip_stiffness": 5.4, "rest_length": 3.7,
}  # fmt: skip
UNITS_OF_RUNNER = {
    "body_mass": "kg", "foot_mass": "kg", "inertia": "kg m^2", "stiffness": "N/m", "hip_stiffness": "N m/rad",
    "rest_length": "m",
}  # fmt: skip
WORDS_OF_RUNNERS = {
    "liftoff": "the foot's weight",
    "gap": "the foot touches the ground in flight",
    "pull": "the ground would have to pull",
    "separation": "the leg has no length left",
    "end": "contact: the foot never lifts off again",
    "none": "a lossless runner has tuned numbers: give find tune= and at=, as tune=('inertia', 'hip_stiffness'), "
    "at={'speed': 0.4}",
}


def runner(
    foot_mass: float | None = None, rest_length: float | None = None, inertia: float | None = None,
    hip_stiffness: float | None = None, *,
    body_mass: float | None = None, stiffness: float | None = None, surface_gravity: float | None = None,
    spring: LawLike = "stiffness*r", hip_spring: LawLike = "hip_stiffness*r", friction: float | None = None,
    in_si: bool = False, parameters: Mapping[str, float] | None = None,
) -> Mechanism:  # fmt: skip
    """A body on a sprung leg with a hip spring and a massive foot, which runs in the plane.

    foot_mass, body_mass : in kg if all is in SI; the foot is at the leg's lower end, the body's mass at the hip
    rest_length : of the leg
    inertia : of the body about the hip
    stiffness, hip_stiffness : of the leg's and of the hip's spring, if their laws have them. Without units the defaults
        of these numbers are 0.1 and 1, 3.7, 5.7, 1 and 5.4; in SI each must be stated
    surface_gravity : 1, or in SI 9.80665 m/s^2, where it is None
    spring : the force of the leg, a law of its extension r: one of `problems.springs`, or a formula whose names other
        than the stiffness are `parameters`
    hip_spring : the torque of the hip, an odd law of r = phi - theta
    friction : the coefficient of friction; an orbit that needs more violates it. None for any
    in_si : whether all numbers are in SI; otherwise they are in any consistent units
    parameters : values of the names in both springs' laws

    The launch speed is the rate at which the leg extends at lift-off. An orbit is periodic up to a translation by its
    `step` along the ground. Raises `InputError` for numbers that no runner has, for missing numbers in SI, and for a
    hip whose spring is not odd.

    >>> from problems import runner
    >>> machine = runner(foot_mass=0.1, rest_length=3.7)
    >>> machine.model.sticks
    ('x',)
    """
    in_si = true_or_false("in_si", in_si)
    stated = {
        "body_mass": body_mass, "foot_mass": foot_mass, "inertia": inertia, "stiffness": stiffness,
        "hip_stiffness": hip_stiffness, "rest_length": rest_length, "surface_gravity": surface_gravity,
    }  # fmt: skip
    stated |= {} if friction is None else {"friction": friction}
    refuse_taken(["step"], stated_numbers(parameters), "a number of each run, which is not stated")
    used, (leg, hip) = numbers_and_laws(
        "a runner", stated, WITHOUT_UNITS, UNITS_OF_RUNNER, (spring, hip_spring), parameters, in_si
    )
    return Mechanism(
        name="runner",
        coordinates=("x", "z", "l", "theta", "phi"),
        elements=[
            Mass(HIP[1], "body_mass", across=HIP[0]),
            Mass("z", "foot_mass", across="x"),
            Spring("l - rest_length", leg),
            Spring("phi - theta", hip),
        ],
        gap="z",
        sticks=("x",),
        inertia={"phi": "inertia"},
        surface_gravity="surface_gravity",
        parameters=used,
        counts="l - rest_length",
        launch="l",
        heights={"body": HIP[1], "foot": "z"},
        separation="l",
        rest={"l": "rest_length"},
        angles=("theta", "phi"),
        reversor={"theta": "-theta", "phi": "-phi"},
        friction=None if friction is None else "friction",
        bounds={name: (0.0, inf) for name in ("stiffness", "hip_stiffness", "rest_length") if name in used},
        in_si=in_si,
        words=WORDS_OF_RUNNERS,
        drawing=_runner_drawn(),
        bodies=_runner_bodies(),
    )


def _runner_bodies() -> list[Body]:
    """A trunk at the hip, and a leg that turns there and is as long as its foot slides down along it."""
    trunk = [("0", f"{end}*rest_length") for end in (-0.1, 0.3)]
    return [
        Body(
            "trunk",
            [
                Joint("hip_across", "across", f"{HIP[0]} + steps*step"),
                Joint("hip_up", "up", HIP[1]),
                Joint("pitch", "turn", "phi"),
            ],
            "body_mass",
            "inertia",
            outlines=[Outline("trunk", trunk)],
        ),
        Body(
            "foot",
            [Joint("hip", "turn", "theta - phi"), Joint("leg", "down", "l")],
            "foot_mass",
            carrier="trunk",
            outlines=[Outline("leg", [("0", "0"), ("0", "rest_length")])],
        ),
    ]


def _runner_drawn() -> Drawing:
    """A leg with a foot, and a trunk that shows the pitch."""
    trunk = [
        (f"{HIP[0]} + {end}*rest_length*sin(phi)", f"{HIP[1]} + {end}*rest_length*cos(phi)") for end in (-0.1, 0.3)
    ]
    foot = [(f"x + {a}*rest_length", f"z + {b}*rest_length") for a, b in ((-0.05, 0.0), (0.08, 0.0), (0.0, 0.06))]
    path = Outline("path of the hip", [HIP], traced=True)
    return Drawing(
        [
            Outline("leg", [("x", "z"), HIP]),
            Outline("trunk", trunk, ends=True),
            Outline("foot", foot, closed=True),
            path,
        ],
        onward={"x": "x + step"},
    )
