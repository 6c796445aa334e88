"""Machines that step from one point of contact to another: a rimless wheel, a rocking block, a shuttle between walls.

In each of them a body on a torsion spring turns within one that stands on a point of contact, upside down. theta is the
angle by which the outer one has turned since the contact opened, phi that of the inner one, r = phi - theta the
extension of the spring and tau(r) its torque. With J the inertia of the inner body, A that of all else about the point
on which it stands, and U its potential energy,

    A theta'' = -dU/dtheta + tau(r)        J phi'' = -tau(r)

while one point holds; while two hold, theta rests. A lossless step ends where the next point touches with neither a
speed nor an acceleration.

wheel    U = M g l cos(theta - a): two of n spokes, an angle 2 a = 2 pi/n apart, stand; it walks from one to the next
rocker   U = M g (h cos(theta) + b sin(theta)): a block of half width b and half height h rocks from edge to edge,
         and tan(a) = b/h
shuttle  U = M g l cos(theta - a): a pendulum upside down shuttles between two walls, an angle 2 a apart

In units of the time sqrt(J/k), with the stiffness k at rest, the numbers that are left are the inertia ratio mu = J/A
and the gravity ratio kappa = M g l/k, or M g h/k of the rocker. For small angles, in units of a, or of b/h,
U = -kappa (theta - 1)^2/2 in units of k. See Gomes and Ruina, Phys. Rev. E 83 (2011) 032901, for a machine that was
built, and Pankov, arXiv 2402.16010.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import hypot, inf, pi
from typing import Any

from orbits import Mechanism
from orbits.errors import InputError
from orbits.laws import LawLike, number
from orbits.mechanics import Body, Drawing, Element, Joint, Mass, Outline, Potential, Spring, Weight

from ..laws import as_spring
from .parameters import gravity_in_si, stated_numbers, with_parameters

# Beyond these ratios and angles the numbers of a machine are lost in rounding.
RATIO_BOUNDS = (1e-12, 1e12)
ANGLE_BOUNDS = (1e-9, pi / 2 - 1e-9)
WIDEST_WHEEL = pi / 3 + 1e-15  # angle of a wheel of three spokes, the fewest, up to rounding
# The parameters of a machine without units.
RATIOS = ("inertia_ratio", "gravity_ratio", "angle", "share")
WALL_WORDS = {
    "gap": "it touches the wall that it left",
    "landing gap": "it touches the next wall too early",
    "pull": "the wall would have to pull",
}
BLOCK_WORDS = {
    "gap": "the lifted edge touches the ground",
    "pull": "the edge that lifts off next would have to pull",
    "landed pull": "the edge that has landed would have to pull",
    "separation": "the block falls on its side",
}
END = {"liftoff": "the torque of gravity", "end": "contact: it never lifts off again"}
# The height of a hub or an end above its support and its place across; that of a block's centre; potential energies of
# balanced machines without units.
HUB, HUB_ACROSS = "length*cos(theta - angle)", "length*sin(theta - angle)"
CENTRE_HEIGHT = "half_height*cos(theta) + half_width*sin(theta)"
CENTRE_ACROSS = "half_height*sin(theta) - half_width*cos(theta)"
BALANCED, BALANCED_NEARLY = "gravity_ratio*cos(theta - angle)", "-gravity_ratio*(theta - 1)**2/2"
TIPPED_NEARLY = "gravity_ratio*(theta - theta**2/2)"
# Without units the centre of mass is at the distance 1 from the foot, and its mass has a share of the inertia about
# that, and the weight that the gravity ratio says.
SHARED_MASS, SHARED_GRAVITY, SHARED_INERTIA = (
    "share/inertia_ratio",
    "inertia_ratio*gravity_ratio/share",
    "(1 - share)/inertia_ratio",
)
UPRIGHT = {"theta": "2*angle - theta", "phi": "2*angle - phi"}
ONWARD = {"theta": "theta - 2*angle", "phi": "phi - 2*angle"}
MIRRORED = {"theta": "-theta", "phi": "-phi"}
# The sign of the angles of a machine that is its own mirror image after each landing, as a factor.
MIRRORED_BY_STEPS = "*cos(pi*steps)"


def rimless_wheel(
    mass: float | None = None, length: float | None = None, spokes: int | None = None, inertia: float | None = None,
    body_inertia: float | None = None, stiffness: float | None = None, slope: float = 0.0, *,
    spring: LawLike | None = None, inertia_ratio: float | None = None, gravity_ratio: float | None = None,
    angle: float | None = None, share: float | None = None, friction: float | None = None,
    surface_gravity: float | None = None, parameters: Mapping[str, float] | None = None,
) -> Mechanism:  # fmt: skip
    """A rimless wheel with a body on a torsion spring inside, which walks over level ground without loss.

    mass, length : of the whole in kg, and of its spokes in m; with these all numbers are in SI
    spokes : their number n, from 3; the angle between two of them is 2 a = 2 pi/n
    inertia : A about the foot on which it stands, without the inner body's own, at least mass * length**2, in kg m^2
    body_inertia : J of the inner body about the hub, in kg m^2
    stiffness : of the spring at rest, in N m/rad
    slope : downhill, in rad; on a slope no step is lossless, but simulations take it
    spring : its torque, an odd function of r in rad: a law of `problems.springs`, or a formula whose names other than
        the stiffness are `parameters`; a straight line by default
    inertia_ratio, gravity_ratio : J/A and mass * surface_gravity * length/stiffness, of a wheel without units; by
        default 1 and 0.5
    angle : a, half the angle between two spokes, in rad, of a wheel without units, at most pi/3; None for small angles,
        in units of a
    share : mass * length**2/A, above 0 and at most 1, of a wheel without units. Friction and landings with a speed
        depend on it, lossless steps do not. By default it is 1, all mass at the hub; a standing foot that lifts is then
        not a violation, because the foot does not lift in a wheel of a small share
    friction : the coefficient of friction; an orbit that needs more violates it. None for any. For a wheel without
        units and small angles the needed friction is in units of a
    surface_gravity : of a wheel in SI, in m/s^2; None for 9.80665
    parameters : values of the spring's names

    The launch speed is that of the inner body at lift-off. Raises `InputError` for numbers that no wheel has.

    >>> from orbits import find
    >>> from problems import rimless_wheel
    >>> orbit = find(rimless_wheel(inertia_ratio=1.0, gravity_ratio=0.5, angle=0.3))
    >>> round(orbit.alpha, 9), orbit.admissible
    (0.34914409, True)
    """
    stated = {"mass": mass, "length": length, "inertia": inertia, "body_inertia": body_inertia, "stiffness": stiffness}
    if spokes is not None and not (number("spokes", spokes) >= 3 and spokes == int(spokes)):
        raise InputError(f"spokes = {spokes!r}; it must be a whole number, at least 3")
    slope = number("slope", slope, -pi / 2, pi / 2)
    if own := _in_si(
        "rimless wheel", {**stated, "spokes": spokes}, (inertia_ratio, gravity_ratio, angle, share), surface_gravity
    ):
        _refuse_below(own["inertia"], "the foot", own["mass"] * own["length"] ** 2, "mass * length**2")
        own |= {"angle": pi / own.pop("spokes")}
        own["surface_gravity"] = gravity_in_si(surface_gravity)
        gravity = "surface_gravity"
        tilted = {"slope": slope} if slope else {}
        fall = " + slope" if tilted else ""  # heights and places across are those of gravity
        forces: list[Element] = [
            Mass(f"length*cos(theta - angle{fall})", "mass", across=f"length*sin(theta - angle{fall})")
        ]
        heights: dict[str, str] | None = {"hub": HUB}
        turned = "inertia - mass*length**2"
    else:
        if slope:
            raise InputError(f"slope = {slope:g}: only a wheel in SI has a slope; state its mass and its length")
        own, heights, tilted = _ratios(inertia_ratio, gravity_ratio, angle, share=share), None, {}
        forces, turned, gravity = _shared(own, BALANCED_NEARLY), SHARED_INERTIA, SHARED_GRAVITY
    why = "gravity gains 2*mass*surface_gravity*length*sin(angle)*sin(slope) with each step on a slope"
    return _stepping(
        "rimless wheel", forces, turned, gravity, own | tilted, spring, parameters, friction,
        reversor=None if tilted else UPRIGHT, symmetry=ONWARD, heights=heights,
        gaps={"rear foot": "theta", "front foot": "2*angle - theta"},
        words=END | _unjudged(own, share) | ({"none": why} if tilted else {}),
        drawing=_wheel_drawn(own, "slope" if tilted else 0.0), bodies=_wheel_bodies(own, turned),
    )  # fmt: skip


def rocking_block(
    mass: float | None = None, half_width: float | None = None, half_height: float | None = None,
    inertia: float | None = None, body_inertia: float | None = None, stiffness: float | None = None, *,
    spring: LawLike | None = None, inertia_ratio: float | None = None, gravity_ratio: float | None = None,
    angle: float | None = None, share: float | None = None, friction: float | None = None,
    surface_gravity: float | None = None, parameters: Mapping[str, float] | None = None,
) -> Mechanism:  # fmt: skip
    """A block with a body on a torsion spring inside, which rocks from one edge to the other without loss.

    mass : of the whole, in kg; with it all numbers are in SI
    half_width, half_height : b and h of its centre from the edges, in m
    inertia : A about an edge, without the inner body's own, at least mass * (b**2 + h**2), in kg m^2
    gravity_ratio : mass * surface_gravity * h/stiffness, of a block without units
    angle : a with tan(a) = b/h, in rad, of a block without units; None for small angles, in units of b/h
    share : mass * (b**2 + h**2)/A of a block without units, otherwise as in `rimless_wheel`
    body_inertia, stiffness, spring, inertia_ratio, friction, surface_gravity, parameters : as in `rimless_wheel`

    >>> from orbits import find
    >>> from problems import rocking_block
    >>> round(find(rocking_block(inertia_ratio=1.0, gravity_ratio=0.5)).alpha, 12)
    0.884056118603
    """
    stated = {
        "mass": mass, "half_width": half_width, "half_height": half_height, "inertia": inertia,
        "body_inertia": body_inertia, "stiffness": stiffness,
    }  # fmt: skip
    if own := _in_si("rocking block", stated, (inertia_ratio, gravity_ratio, angle, share), surface_gravity):
        least = own["mass"] * hypot(own["half_width"], own["half_height"]) ** 2
        _refuse_below(own["inertia"], "an edge", least, "mass * (half_width**2 + half_height**2)")
        own["surface_gravity"] = gravity_in_si(surface_gravity)
        gravity = "surface_gravity"
        forces: list[Element] = [Mass(CENTRE_HEIGHT, "mass", across=CENTRE_ACROSS)]
        top: str | None = "2*half_height*cos(theta)"
        heights: dict[str, str] = {"centre": CENTRE_HEIGHT, "lifted edge": "2*half_width*sin(theta)"}
        turned = "inertia - mass*(half_width**2 + half_height**2)"
    else:
        own, heights = _ratios(inertia_ratio, gravity_ratio, angle, share=share), {"phi": "phi", "theta": "theta"}
        forces, turned = _shared(own, TIPPED_NEARLY), SHARED_INERTIA
        gravity = SHARED_GRAVITY + ("/cos(angle)" if "angle" in own else "")  # the gravity ratio is by h = cos(angle)
        top = "2*cos(angle)*cos(theta)" if "angle" in own else None
    # Tilted by a right angle, the block lies on its side: then the corner above the edge on which it stands is down.
    heights |= {} if top is None else {"upper corner": top}
    return _stepping(
        "rocking block", forces, turned, gravity, own, spring, parameters, friction, symmetry=MIRRORED, gap="theta",
        heights=heights, words=END | BLOCK_WORDS | _unjudged(own, share), drawing=_block_drawn(own), separation=top,
        bodies=_block_bodies(own, turned),
    )  # fmt: skip


def shuttle(
    inertia: float | None = None, body_inertia: float | None = None, stiffness: float | None = None,
    angle: float | None = None, mass: float = 0.0, length: float = 0.0, *,
    spring: LawLike | None = None, inertia_ratio: float | None = None, gravity_ratio: float | None = None,
    surface_gravity: float | None = None, parameters: Mapping[str, float] | None = None,
) -> Mechanism:  # fmt: skip
    """An inverted pendulum with a body on a torsion spring, which shuttles between two walls without loss.

    inertia : A about the hinge, without the inner body's own, in kg m^2; with it all numbers are in SI
    angle : a, half the angle between the walls, in rad; without units None is for small angles, in units of a
    mass, length : of the pendulum in kg and m; 0 for one in balance
    gravity_ratio : mass * surface_gravity * length/stiffness, at least 0, of a shuttle without units
    body_inertia, stiffness, spring, inertia_ratio, surface_gravity, parameters : as in `rimless_wheel`

    Without gravity it is a sprung pair of bodies, as on an air track.

    >>> from orbits import find
    >>> from problems import shuttle
    >>> round(find(shuttle(inertia_ratio=1.0, gravity_ratio=0.5)).contact_time, 12)
    3.951525067955
    """
    stated = {"inertia": inertia, "body_inertia": body_inertia, "stiffness": stiffness}
    if own := _in_si("shuttle", stated, (inertia_ratio, gravity_ratio), surface_gravity):
        for name, value in (("mass", mass), ("length", length)):
            if number(name, value) < 0:
                raise InputError(f"{name} = {value:g} is below 0; it must be at least 0, which is a shuttle in balance")
        own |= {"angle": _positive("angle", angle, pi / 2), "mass": mass, "length": length}
        own["surface_gravity"] = gravity_in_si(surface_gravity)
        force: Element = Weight(HUB, "mass")
        heights: dict[str, str] | None = {"end": HUB}
        turned, gravity = "inertia", "surface_gravity"
    else:
        if number("mass", mass) or number("length", length):
            raise InputError(
                "mass and length are for a shuttle in SI: state its inertia too, or state gravity_ratio instead"
            )
        own, heights = _ratios(inertia_ratio, gravity_ratio, angle, least=0.0), None
        turned, gravity = "1/inertia_ratio", "1"
        force = Potential(BALANCED if angle is not None else BALANCED_NEARLY)
    return _stepping(
        "shuttle", [force], turned, gravity, own, spring, parameters, reversor=UPRIGHT, symmetry=UPRIGHT,
        heights=heights, gaps={"wall": "theta", "other wall": "2*angle - theta"}, words=END | WALL_WORDS,
        drawing=_shuttle_drawn(own),
    )  # fmt: skip


def _in_si(
    name: str, numbers: Mapping[str, float | None], ratios: tuple[float | None, ...], surface_gravity: float | None
) -> dict[str, float]:
    """The numbers of a machine in SI, none of one without units; raises `InputError` where some are missing, or ratios
    are stated too."""
    stated = [each for each in numbers if numbers[each] is not None]
    if not stated:
        if surface_gravity is not None:
            raise InputError(
                f"surface_gravity belongs to a {name} in SI, with its {next(iter(numbers))}; state gravity_ratio"
            )
        return {}
    if missing := [each for each in numbers if numbers[each] is None]:
        raise InputError(f"a {name} with {stated[0]} is in SI: state {', '.join(missing)} too")
    if any(each is not None for each in ratios):
        raise InputError(f"a {name} with {stated[0]} is in SI: leave {', '.join(RATIOS[: len(ratios)])} out")
    return {each: _positive(each, value) for each, value in numbers.items()}


def _positive(name: str, value: object, high: float = inf) -> float:
    found = number(name, value)
    if not 0 < found < high:
        raise InputError(f"{name} = {found:g}; it must lie above 0" + ("" if high == inf else f" and below {high:.6g}"))
    return found


def _refuse_below(inertia: float, point: str, least: float, words: str) -> None:
    if inertia < least:
        raise InputError(f"inertia = {inertia:g} about {point} is below {least:.6g} = {words}: no body has that")


def _shared(own: Mapping[str, float], nearly: str) -> list[Element]:
    """The mass in the plane of a machine without units; for small angles together with its potential energy."""
    if "angle" in own:
        return [Mass("cos(theta - angle)", SHARED_MASS, across="sin(theta - angle)")]
    return [Potential(nearly), Mass("0", SHARED_MASS, across="theta")]


def _unjudged(own: Mapping[str, float], share: float | None) -> dict[str, str]:
    """The words of a machine without units of whose mass nothing is stated."""
    return {"stance": ""} if "share" in own and share is None else {}


def _aslant(place: tuple[str, str], angle: str, length: str) -> tuple[str, str]:
    """What is at a length from a place, at an angle clockwise from upright."""
    return f"{place[0]} + {length}*sin({angle})", f"{place[1]} + {length}*cos({angle})"


def _bar(place: tuple[str, str], angle: str, length: str) -> Outline:
    """The inner body, around a place."""
    return Outline("inner body", [_aslant(place, angle, f"(-{length})"), _aslant(place, angle, length)], ends=True)


def _wheel_drawn(own: Mapping[str, float], tilt: str | float) -> Drawing | None:
    """A wheel with all of its spokes; None for small angles."""
    if "angle" not in own:
        return None
    length = "length" if "length" in own else "1"
    hub = _aslant(("0", "0"), "theta - angle", length)
    spoke = [hub, _aslant(hub, "theta - angle + 2*angle*(steps + i)", f"(-{length})")]
    return Drawing(
        [
            Outline("wheel", spoke, repeat="pi/angle"),
            _bar(hub, "phi - angle + 2*angle*steps", f"{length}/2"),
            Outline("path of the hub", [hub], traced=True),
        ],
        onward={"x": f"x + 2*{length}*sin(angle)"},
        tilt=tilt,
    )


def _wheel_bodies(own: Mapping[str, float], inertia: str) -> list[Body]:
    """A wheel with this inertia about its hub, and the body that turns on it; none for small angles."""
    if "angle" not in own:
        return []
    length = "length" if "length" in own else "1"
    joints = [
        Joint("hub_across", "across", f"{length}*sin(theta - angle) + 2*steps*{length}*sin(angle)"),
        Joint("hub_up", "up", f"{length}*cos(theta - angle)"),
        Joint("wheel", "turn", "theta - angle + 2*angle*steps"),
    ]
    spoke = Outline("wheel", [("0", "0"), _aslant(("0", "0"), "2*angle*i", f"(-{length})")], repeat="pi/angle")
    return _turning_within(own, Body("wheel", joints, "", inertia, outlines=[spoke]), "", f"{length}/2")


def _block_bodies(own: Mapping[str, float], inertia: str) -> list[Body]:
    """A block with this inertia about its centre, and the body that turns on it; none for small angles."""
    if not {"half_width", "angle"} & own.keys():
        return []
    wide, high = _sides(own)
    across, up = f"{high}*sin(theta) - {wide}*cos(theta)", f"{high}*cos(theta) + {wide}*sin(theta)"
    joints = [
        Joint("centre_across", "across", f"({across} + {wide}){MIRRORED_BY_STEPS} - {wide}"),
        Joint("centre_up", "up", up),
        Joint("block", "turn", f"theta{MIRRORED_BY_STEPS}"),
    ]
    corners = [(f"{x}*{wide}", f"{z}*{high}") for x, z in (("-1", "-1"), ("1", "-1"), ("1", "1"), ("-1", "1"))]
    block = Body("block", joints, "", inertia, outlines=[Outline("block", corners, closed=True)])
    return _turning_within(own, block, MIRRORED_BY_STEPS, f"{high}/2")


def _turning_within(own: Mapping[str, float], outer: Body, mirrored: str, length: str) -> list[Body]:
    """An outer body without its mass, and the inner one on it, of this half length. Each has half the mass, since that
    of both is at one point and no motion tells them apart."""
    mass = f"({'mass' if 'mass' in own else SHARED_MASS})/2"
    bar = Outline("inner body", [("0", f"-{length}"), ("0", length)])
    about = "body_inertia" if "body_inertia" in own else 1.0
    joint = Joint("inner_body", "turn", f"(phi - theta){mirrored}")
    return [replace(outer, mass=mass), Body("inner_body", [joint], mass, about, carrier=outer.name, outlines=[bar])]


def _sides(own: Mapping[str, float]) -> tuple[str, str]:
    """Half the width and half the height of a block."""
    return ("half_width", "half_height") if "half_width" in own else ("sin(angle)", "cos(angle)")


def _block_drawn(own: Mapping[str, float]) -> Drawing | None:
    """A block, whose edge on the right is at 0 in each stance; None for small angles."""
    wide, high = _sides(own)
    if not {"half_width", "angle"} & own.keys():
        return None
    left = [_aslant(("0", "0"), "theta - pi/2", f"2*{wide}"), ("0", "0")]
    edges = [*left, *(_aslant(place, "theta", f"2*{high}") for place in reversed(left))]
    centre = _aslant(_aslant(("0", "0"), "theta - pi/2", wide), "theta", high)
    return Drawing(
        [
            Outline("block", edges, closed=True),
            _bar(centre, "phi", f"{high}/2"),
            Outline("path of the centre", [centre], traced=True),
        ],
        onward={"x": f"-x - 2*{wide}"},
    )


def _shuttle_drawn(own: Mapping[str, float]) -> Drawing | None:
    """A pendulum between walls that its end touches; None for small angles."""
    if "angle" not in own:
        return None
    length = "length" if own.get("length", 0.0) > 0 else "1"
    end, hinge = _aslant(("0", "0"), "theta - angle", length), ("0", "0")
    path = Outline("path of the end", [end], traced=True)
    walls = [
        Outline("walls", [_aslant(hinge, f"{sign}angle", f"{share}*{length}") for share in (0.85, 1.15)], fixed=True)
        for sign in ("", "-")
    ]
    return Drawing(
        [*walls, Outline("pendulum", [hinge, end]), _bar(end, "phi - angle", f"{length}/4"), path],
        {"x": "-x"},
        ground=False,
    )


def _ratios(
    inertia_ratio: float | None, gravity_ratio: float | None, angle: float | None, least: float | None = None,
    share: float | None = None,
) -> dict[str, float]:  # fmt: skip
    """The parameters of a machine without units; the gravity ratio may be 0 where that is the `least`, and there is no
    share."""
    own = {"inertia_ratio": _positive("inertia_ratio", 1.0 if inertia_ratio is None else inertia_ratio)}
    gravity = number("gravity_ratio", 0.5 if gravity_ratio is None else gravity_ratio)
    own["gravity_ratio"] = gravity if gravity == least else _positive("gravity_ratio", gravity)
    if least is None:
        own["share"] = 1.0 if share is None else _positive("share", share)
        if own["share"] > 1:
            raise InputError(
                f"share = {own['share']:g} is above 1: no body has less inertia about a point than its mass"
            )
    return own if angle is None else own | {"angle": _positive("angle", angle, pi / 2)}


def _bounds_of_steps(name: str, own: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """The bounds of a machine's parameters, which hold where they vary too."""
    least = 0.0 if name == "shuttle" else RATIO_BOUNDS[0]
    widest = WIDEST_WHEEL if name == "rimless wheel" else ANGLE_BOUNDS[1]
    bounds = {
        "inertia_ratio": RATIO_BOUNDS, "gravity_ratio": (least, RATIO_BOUNDS[1]), "share": (RATIO_BOUNDS[0], 1.0),
        "angle": (ANGLE_BOUNDS[0], widest),
    }  # fmt: skip
    return {each: bounds[each] for each in bounds if each in own}


def _stepping(
    name: str, forces: Sequence[Element], inertia: str, gravity: str, own: Mapping[str, float],
    spring: LawLike | None, parameters: Mapping[str, float] | None, friction: float | None = None, **stated: Any,
) -> Mechanism:  # fmt: skip
    """The mechanism of an inner and an outer body; formulas with the angle take 1 for it where it has no value."""
    in_si, values = "inertia" in own, stated_numbers(parameters)
    own = own if friction is None else {**own, "friction": _positive("friction", friction)}
    for key in () if "angle" in own or "gaps" not in stated else ("reversor", "symmetry", "gaps"):
        stated[key] = {each: text.replace("angle", "1") for each, text in stated[key].items()}
    law = ("stiffness*r" if in_si else "r") if spring is None else spring
    known = {**own, **values} if in_si else values
    torque = as_spring(law, known, shared=True)
    if in_si and "stiffness" not in torque.key.names:
        raise InputError(
            f"spring '{torque.text}' of a {name} in SI has no 'stiffness': write it with that, as stiffness*r"
        )
    return Mechanism(
        ("phi", "theta"),
        [Spring("phi - theta", torque), *forces],
        inertia={"phi": "body_inertia" if in_si else 1.0, "theta": inertia},
        parameters=with_parameters(own, values),
        surface_gravity=gravity,
        friction=None if friction is None else "friction",
        in_si=in_si,
        bounds=_bounds_of_steps(name, own),
        angles=("phi", "theta"),
        name=name,
        **stated,
    )  # fmt: skip
