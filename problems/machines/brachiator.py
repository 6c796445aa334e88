"""A brachiator: two arms that swing from hold to hold under a bar, and lose no energy, with or without a body.

The arm that holds makes the angle held with the vertical below its hand, the free arm the angle free with the vertical
below the shoulder, which they share, and a body that hangs from the shoulder the angle body. With the arms' length L,
the free hand is at the distance L (cos(held) + cos(free)) below the bar. Both arms are at rest while both hands hold:
with the angle beta at release, held = -beta and free = beta - pi, and the holds are 2 L sin(beta) apart. The machine
passes the middle of a swing where all angles are 0, and the second half is the mirror image of the first:

    held, free, body -> -(held, free, body)

in reversed time. A swing is lossless where the free hand comes to rest at the bar just as the other arm does. Two arms
alone have one number at release, beta, and with half the time two unknowns for two equations. With a body the speed of
that at release is one more unknown, and its angle in mid-swing one more equation. See Gomes and Ruina, J. Theoretical
Biology 237 (2005) 265-278.
"""

from orbits import Mechanism
from orbits.errors import InputError, true_or_false
from orbits.laws import number
from orbits.mechanics import Drawing, Grip, Mass, Outline

from .parameters import gravity_in_si

# Of each number its value without units where it is not stated, and its unit in SI.
NUMBERS = {
    "mass": (1.0, "kg"), "arm_mass": (0.25, "kg"), "arm_length": (1.0, "m"), "arm_centre": (0.5, "m"),
    "body_inertia": (0.0, "kg m^2"), "body_centre": (0.0, "m"),
}  # fmt: skip
ROD = "arm_mass*arm_length**2/12"
TIME, CENTRE = "sqrt(arm_length/surface_gravity)", "(arm_length - arm_centre)"
SHOULDER = ("arm_length*sin(held)", "-arm_length*cos(held)")


def brachiator(
    arm_mass: float | None = None, arm_centre: float | None = None, arm_inertia: float | None = None, *,
    body_inertia: float | None = None, body_centre: float | None = None, mass: float | None = None,
    arm_length: float | None = None, surface_gravity: float | None = None, in_si: bool = False,
) -> Mechanism:  # fmt: skip
    """Two arms that swing from hold to hold under a bar, with a point mass at the shoulder or a body that hangs there.

    arm_mass : of each arm; mass - 2*arm_mass is at the shoulder, or is the body's
    arm_centre : the distance of an arm's centre of mass from the shoulder
    arm_inertia : of an arm about its centre of mass; where it is None, that of a rod, arm_mass*arm_length**2/12, also
        while these two vary
    body_inertia, body_centre : of a body that turns about the shoulder, about its centre of mass, and the distance of
        this below the shoulder; both are left out where the mass is at the shoulder itself
    mass, arm_length : of the whole machine, and of each arm. Without units the defaults of these two are 1, and of
        arm_mass and arm_centre 0.25 and 0.5; in SI each must be stated, in kg, m and kg m^2
    surface_gravity : 1, or in SI 9.80665 m/s^2, where it is None
    in_si : whether all numbers are in SI; otherwise they are in any consistent units

    `find` returns the fastest `Swing` of it, and `find_all` all of them. Raises `InputError` for numbers that no
    brachiator has, and for missing numbers in SI.

    >>> from orbits import find_all
    >>> from problems import brachiator
    >>> [round(swing.mean_speed, 4) for swing in find_all(brachiator())][:3]
    [0.4872, 0.2017, 0.0508]
    """
    in_si = true_or_false("in_si", in_si)
    stated = {
        "mass": mass, "arm_mass": arm_mass, "arm_length": arm_length, "arm_centre": arm_centre,
        "body_inertia": body_inertia, "body_centre": body_centre,
    }  # fmt: skip
    turns = body_inertia is not None or body_centre is not None
    own, missing = dict[str, float](), list[str]()
    for name, (usual, unit) in NUMBERS.items():
        if turns or not name.startswith("body"):
            own[name] = number(name, usual if (value := stated[name]) is None else value)
            missing += [f"{name} ({unit})"] if in_si and value is None else []
    if missing:
        raise InputError(f"a brachiator in SI needs {', '.join(missing)}: only one without units has default values")
    own["surface_gravity"] = 1.0 if surface_gravity is None and not in_si else gravity_in_si(surface_gravity)
    for name in ("mass", "arm_length", "arm_mass", "surface_gravity"):
        if not own[name] > 0:
            raise InputError(f"{name} = {own[name]:g}; for a brachiator it must lie above 0")
    if not own["arm_mass"] < own["mass"] / 2:
        raise InputError(f"arm_mass = {own['arm_mass']:g}; it must be below half the mass {own['mass']:g} of the whole")
    if not 0 <= own["arm_centre"] <= own["arm_length"]:
        raise InputError(
            f"arm_centre = {own['arm_centre']:g}; it must lie from 0, at the shoulder, to arm_length = "
            f"{own['arm_length']:g}, at the hand"
        )
    own |= {} if arm_inertia is None else {"arm_inertia": number("arm_inertia", arm_inertia)}
    inertia, angles, release = ROD if arm_inertia is None else "arm_inertia", ["held", "free"], {"angle": ("0", "pi")}
    moved, body = dict.fromkeys(angles, inertia), SHOULDER
    if turns:
        angles, moved = [*angles, "body"], moved | {"body": "body_inertia"}
        body = (f"{SHOULDER[0]} + body_centre*sin(body)", f"{SHOULDER[1]} - body_centre*cos(body)")
        release |= {"body'": (f"-3/{TIME}", f"3/{TIME}")}
    return Mechanism(
        name="brachiator",
        coordinates=angles,
        elements=[
            Mass(f"-{CENTRE}*cos(held)", "arm_mass", across=f"{CENTRE}*sin(held)"),
            Mass(f"{SHOULDER[1]} - arm_centre*cos(free)", "arm_mass", across=f"{SHOULDER[0]} + arm_centre*sin(free)"),
            Mass(body[1], "mass - 2*arm_mass", across=body[0]),
        ],
        gap=None,
        inertia=moved,
        surface_gravity="surface_gravity",
        parameters=own,
        counts="held",
        angles=angles,
        reversor={name: f"-{name}" for name in angles},
        grip=Grip(
            places={"held": "-angle", "free": "angle - pi"},
            release=release,
            step="2*arm_length*sin(angle)",
            clearance="arm_length*(cos(held) + cos(free))",
            longest=f"4.5*{TIME}",
        ),
        separation="arm_length*cos(held)",
        words={"separation": "the shoulder rises above the bar"},
        in_si=in_si,
        drawing=_drawn(turns),
    )


def _drawn(turns: bool) -> Drawing:
    """Two arms, a shoulder, and the bar."""
    hand = ("arm_length*(sin(held) + sin(free))", "-arm_length*(cos(held) + cos(free))")
    trunk = ("arm_length*sin(held) + arm_length*sin(body)/2", "-arm_length*cos(held) - arm_length*cos(body)/2")
    bar = [(f"{share}*arm_length*sin(angle)", "0") for share in (-3, 9)]
    return Drawing(
        [
            Outline("bar", bar, fixed=True),
            Outline("holding arm", [("0", "0"), SHOULDER]),
            Outline("free arm", [SHOULDER, hand]),
            Outline(*(("body", [SHOULDER, trunk]) if turns else ("shoulder", [SHOULDER])), ends=True),
            Outline("path of the free hand", [hand], traced=True),
        ],
        onward={"x": "x + 2*arm_length*sin(angle)"},
        ground=False,
    )
