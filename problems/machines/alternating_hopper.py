"""A body on two vertical sprung feet, which hops in place on one foot and the other by turns.

The body's mass m1 has the height y, each foot the mass m2 and the height z1 or z2, and the legs push with T(r) along
their extensions r = y - z, which vanish where a leg has its length at rest:

    m1 y'' = -T(y - z1) - T(y - z2) - m1 g        m2 zi'' = T(y - zi) - m2 g

in flight. In contact z1 = 0, and the other foot is in the air. The foot lifts off where its leg carries its weight,
T(y) = m2 g, and a landing costs nothing where the other foot has neither a speed nor an acceleration. Time reversal
exchanges the feet. So the coordinates are the mean of their heights and half the difference, which vanishes in
mid-flight, where the feet pass each other; it changes its sign with each landing, so that the left foot is always the
one that opens next. In mid-contact all is at rest.

With straight springs, in units of m1, of the stiffness and of gravity, and m = m2/m1, the squared frequencies are
2 + 1/m of the body against the feet and 1/m of the feet against each other in flight, and the roots x of
x^2 - (2 + 1/m) x + 1/m in contact. Lift-off, mid-flight and mid-contact leave two equations for the two half times:
hops are isolated, and no number is tuned. The family of least launch speeds begins at m = 3/2, where one frequency of
the flight is twice the other, with a launch speed without bound. After Pankov, arXiv 2402.16010.
"""

from collections.abc import Mapping
from math import inf

from orbits import Mechanism
from orbits.errors import true_or_false
from orbits.laws import LawLike
from orbits.mechanics import Drawing, Mass, Outline, Spring

from .parameters import numbers_and_laws
from .steps import MIRRORED_BY_STEPS

WITHOUT_UNITS = {"body_mass": 1.0, "foot_mass": 4.0, "stiffness": 1.0}
UNITS = {"body_mass": "kg", "foot_mass": "kg", "stiffness": "N/m"}
LEFT, RIGHT, EXCHANGED = "mean + half", "mean - half", {"half": "-half"}
# The place across and the height of each foot, which keeps its name where a landing exchanges those of a stance.
SIDES = {
    "left": ("-rest_length/5", f"mean + half{MIRRORED_BY_STEPS}"),
    "right": ("rest_length/5", f"mean - half{MIRRORED_BY_STEPS}"),
}


def alternating_hopper(
    foot_mass: float | None = None, rest_length: float | None = None, *, body_mass: float | None = None,
    stiffness: float | None = None, surface_gravity: float | None = None, spring: LawLike = "stiffness*r",
    in_si: bool = False, parameters: Mapping[str, float] | None = None,
) -> Mechanism:  # fmt: skip
    """A body on two vertical sprung feet, which hops in place on one foot and the other by turns.

    foot_mass : of each foot
    rest_length : of each leg; None if the body is assumed never to meet a foot. An orbit has no drawing in the plane
        then
    body_mass, stiffness : of the body and of each leg, if their law has it. Without units the defaults of foot_mass and
        these are 4, 1 and 1; in SI each must be stated, in kg and N/m
    surface_gravity : 1, or in SI 9.80665 m/s^2, where it is None
    spring : the force of each leg, a law of its extension r: one of `problems.springs`, or a formula whose names other
        than the stiffness are `parameters`
    in_si : whether all numbers are in SI; otherwise they are in any consistent units
    parameters : values of the spring's names

    The launch speed is that of the body at lift-off; an orbit is one hop, after which the feet have exchanged their
    places. With straight springs `find` needs no start. Raises `InputError` for numbers that no such machine has, and
    for missing numbers in SI.

    >>> from orbits import find
    >>> from problems import alternating_hopper
    >>> hop = find(alternating_hopper(foot_mass=4.0))
    >>> round(hop.alpha, 9), hop.admissible
    (42.380943053, True)
    """
    in_si = true_or_false("in_si", in_si)
    stated = {
        "body_mass": body_mass, "foot_mass": foot_mass, "stiffness": stiffness, "surface_gravity": surface_gravity,
    }  # fmt: skip
    stated |= {} if rest_length is None else {"rest_length": rest_length}
    used, (leg,) = numbers_and_laws("a hopper on two feet", stated, WITHOUT_UNITS, UNITS, (spring,), parameters, in_si)
    long = rest_length is not None
    body = "body + rest_length" if long else "body"
    return Mechanism(
        name="hopper on two feet",
        coordinates=("body", "mean", "half"),
        elements=[
            *(Mass(body, "body_mass"), Mass(LEFT, "foot_mass"), Mass(RIGHT, "foot_mass")),
            *(Spring(f"body - ({foot})", leg) for foot in (LEFT, RIGHT)),
        ],
        gaps={"left foot": LEFT, "right foot": RIGHT},
        reversor=EXCHANGED,
        symmetry=EXCHANGED,
        surface_gravity="surface_gravity",
        parameters=used,
        launch="body",
        heights={"body": body, "left foot": LEFT, "right foot": RIGHT},
        separation=f"{body} - ({RIGHT})" if long else None,
        bounds={name: (0.0, inf) for name in ("stiffness", "rest_length") if name in used},
        in_si=in_si,
        words={"liftoff": "the foot's weight"},
        drawing=_drawn() if long else None,
    )


def _drawn() -> Drawing:
    """A body on two legs next to each other."""
    hips = [(f"{across}{MIRRORED_BY_STEPS}", "body + rest_length") for across, _ in SIDES.values()]
    feet = [(across, foot) for (across, _), (_, foot) in zip(hips, SIDES.values(), strict=True)]
    legs = [Outline(f"{side} leg", [foot, hip], ends=True) for side, foot, hip in zip(SIDES, feet, hips, strict=True)]
    top = [(f"{end}*rest_length{MIRRORED_BY_STEPS}", "body + 1.1*rest_length") for end in (0.1, -0.1)]
    return Drawing([Outline("body", [*hips, *top], closed=True), *legs], onward={"x": "-x"})
