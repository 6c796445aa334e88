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
U = -kappa (theta - 1)^2/2 in units of k. See Gomes and Ruina, Phys. Rev. E 83 (2011) 016610, for a machine that was
built, and Pankov, arXiv 2402.16010.
"""

from collections.abc import Mapping
from math import hypot, inf, pi
from typing import Any

from orbits import Mechanism
from orbits.errors import InputError
from orbits.laws.law import number
from orbits.laws.law_statement import LawLike
from orbits.mechanics import Potential, Spring, Weight
from orbits.mechanics.elements import Element

from ..laws.springs import as_spring
from .parameters import checked_numbers, with_parameters

# The parameters of a machine without units.
RATIOS = ("inertia_ratio", "gravity_ratio", "angle")
WALL_WORDS = {
    "gap": "it touches the wall that it left",
    "landing gap": "it touches the next wall too early",
    "pull": "the wall would have to pull",
}
BLOCK_WORDS = {
    "gap": "the lifted edge touches the ground",
    "pull": "the edge that lifts off next would have to pull",
    "landed pull": "the edge that has landed would have to pull",
}
END = {"liftoff": "the torque of gravity", "end": "contact: it never lifts off again"}
# The height of a hub or an end above its support, and potential energies of balanced machines without units.
HUB = "length*cos(theta - angle)"
BALANCED, BALANCED_NEARLY = "gravity_ratio*cos(theta - angle)", "-gravity_ratio*(theta - 1)**2/2"
UPRIGHT = {"theta": "2*angle - theta", "phi": "2*angle - phi"}
ONWARD = {"theta": "theta - 2*angle", "phi": "phi - 2*angle"}
MIRRORED = {"theta": "-theta", "phi": "-phi"}


def rimless_wheel(
    mass: float | None = None, length: float | None = None, spokes: int | None = None, inertia: float | None = None,
    body_inertia: float | None = None, stiffness: float | None = None, slope: float = 0.0, *,
    spring: LawLike | None = None, inertia_ratio: float | None = None, gravity_ratio: float | None = None,
    angle: float | None = None, surface_gravity: float = 9.81, parameters: Mapping[str, float] | None = None,
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
    angle : a, half the angle between two spokes, in rad, of a wheel without units; None for small angles, in units of a
    surface_gravity : in m/s^2
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
        raise InputError(f"spokes = {spokes!r}; a wheel has a whole number of them, from 3")
    if own := _in_si("rimless wheel", {**stated, "spokes": spokes}, (inertia_ratio, gravity_ratio, angle)):
        _refuse_below(own["inertia"], "the foot", own["mass"] * own["length"] ** 2, "mass * length**2")
        own |= {"angle": pi / own.pop("spokes"), "surface_gravity": surface_gravity}
        tilted = {} if slope == 0 else {"slope": number("slope", slope, -pi / 2, pi / 2)}
        force: Element = Weight("length*cos(theta - angle + slope)" if tilted else HUB, "mass")
        heights: dict[str, str] | None = {"hub": HUB}
    else:
        if slope != 0:
            raise InputError(f"slope = {slope:g} belongs to a wheel in SI, with a mass and a length")
        own, heights, tilted = _ratios(inertia_ratio, gravity_ratio, angle), None, {}
        force = Potential(BALANCED if angle is not None else BALANCED_NEARLY)
    why = "gravity gains 2*mass*surface_gravity*length*sin(angle)*sin(slope) with each step on a slope"
    return _stepping(
        "rimless wheel", [force], own | tilted, spring, parameters, reversor=None if tilted else UPRIGHT,
        symmetry=ONWARD, gaps={"rear foot": "theta", "front foot": "2*angle - theta"}, heights=heights,
        words=END | ({"none": why} if tilted else {}),
    )  # fmt: skip


def rocking_block(
    mass: float | None = None, half_width: float | None = None, half_height: float | None = None,
    inertia: float | None = None, body_inertia: float | None = None, stiffness: float | None = None, *,
    spring: LawLike | None = None, inertia_ratio: float | None = None, gravity_ratio: float | None = None,
    angle: float | None = None, surface_gravity: float = 9.81, parameters: Mapping[str, float] | None = None,
) -> Mechanism:  # fmt: skip
    """A block with a body on a torsion spring inside, which rocks from one edge to the other without loss.

    mass : of the whole, in kg; with it all numbers are in SI
    half_width, half_height : b and h of its centre from the edges, in m
    inertia : A about an edge, without the inner body's own, at least mass * (b**2 + h**2), in kg m^2
    gravity_ratio : mass * surface_gravity * h/stiffness, of a block without units
    angle : a with tan(a) = b/h, in rad, of a block without units; None for small angles, in units of b/h
    body_inertia, stiffness, spring, inertia_ratio, surface_gravity, parameters : as in `rimless_wheel`

    >>> from orbits import find
    >>> from problems import rocking_block
    >>> round(find(rocking_block(inertia_ratio=1.0, gravity_ratio=0.5)).alpha, 12)
    0.884056118603
    """
    stated = {
        "mass": mass, "half_width": half_width, "half_height": half_height, "inertia": inertia,
        "body_inertia": body_inertia, "stiffness": stiffness,
    }  # fmt: skip
    if own := _in_si("rocking block", stated, (inertia_ratio, gravity_ratio, angle)):
        least = own["mass"] * hypot(own["half_width"], own["half_height"]) ** 2
        _refuse_below(own["inertia"], "an edge", least, "mass * (half_width**2 + half_height**2)")
        own["surface_gravity"] = surface_gravity
        height = "half_height*cos(theta) + half_width*sin(theta)"
        force: Element = Weight(height, "mass")
        heights: dict[str, str] | None = {"centre": height, "lifted edge": "2*half_width*sin(theta)"}
    else:
        own, heights = _ratios(inertia_ratio, gravity_ratio, angle), None
        tipped = "gravity_ratio*(cos(theta) + tan(angle)*sin(theta))"
        force = Potential(tipped if "angle" in own else "gravity_ratio*(theta - theta**2/2)")
    return _stepping(
        "rocking block", [force], own, spring, parameters, symmetry=MIRRORED, gap="theta", heights=heights,
        words=END | BLOCK_WORDS,
    )  # fmt: skip


def shuttle(
    inertia: float | None = None, body_inertia: float | None = None, stiffness: float | None = None,
    angle: float | None = None, mass: float = 0.0, length: float = 0.0, *,
    spring: LawLike | None = None, inertia_ratio: float | None = None, gravity_ratio: float | None = None,
    surface_gravity: float = 9.81, parameters: Mapping[str, float] | None = None,
) -> Mechanism:  # fmt: skip
    """A pendulum upside down with a body on a torsion spring, which shuttles between two walls without loss.

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
    if own := _in_si("shuttle", stated, (inertia_ratio, gravity_ratio)):
        own |= {
            "angle": _positive("angle", angle, pi / 2),
            "mass": mass,
            "length": length,
            "surface_gravity": surface_gravity,
        }
        force: Element = Weight(HUB, "mass")
        heights: dict[str, str] | None = {"end": HUB}
    else:
        own, heights = _ratios(inertia_ratio, gravity_ratio, angle, least=0.0), None
        force = Potential(BALANCED if angle is not None else BALANCED_NEARLY)
    return _stepping(
        "shuttle", [force], own, spring, parameters, reversor=UPRIGHT, symmetry=UPRIGHT, heights=heights,
        gaps={"wall": "theta", "other wall": "2*angle - theta"}, words=END | WALL_WORDS,
    )  # fmt: skip


def _in_si(name: str, numbers: Mapping[str, float | None], ratios: tuple[float | None, ...]) -> dict[str, float]:
    """The numbers of a machine in SI, none of one without units; raises `InputError` where some are missing, or ratios
    are stated too."""
    stated = [each for each in numbers if numbers[each] is not None]
    if not stated:
        return {}
    if missing := [each for each in numbers if numbers[each] is None]:
        raise InputError(f"a {name} with {stated[0]} is in SI: state {', '.join(missing)} too")
    if any(each is not None for each in ratios):
        raise InputError(f"a {name} with {stated[0]} is in SI: leave {', '.join(RATIOS[: len(ratios)])} out")
    return {each: _positive(each, value) for each, value in numbers.items()}


def _positive(name: str, value: object, high: float = inf) -> float:
    found = number(name, value)
    if not 0 < found < high:
        raise InputError(f"{name} = {found:g}; it lies above 0" + ("" if high == inf else f" and below {high:.6g}"))
    return found


def _refuse_below(inertia: float, point: str, least: float, words: str) -> None:
    if inertia < least:
        raise InputError(f"inertia = {inertia:g} about {point} is below {least:.6g} = {words}: no body has that")


def _ratios(
    inertia_ratio: float | None, gravity_ratio: float | None, angle: float | None, least: float | None = None
) -> dict[str, float]:
    """The parameters of a machine without units; the gravity ratio may be 0 where that is the `least`."""
    own = {"inertia_ratio": _positive("inertia_ratio", 1.0 if inertia_ratio is None else inertia_ratio)}
    gravity = 0.5 if gravity_ratio is None else gravity_ratio
    own["gravity_ratio"] = gravity if gravity == least else _positive("gravity_ratio", gravity)
    return own if angle is None else own | {"angle": _positive("angle", angle, pi / 2)}


def _stepping(
    name: str, forces: list[Element], own: Mapping[str, float], spring: LawLike | None,
    parameters: Mapping[str, float] | None, **stated: Any,
) -> Mechanism:  # fmt: skip
    """The mechanism of an inner and an outer body; formulas with the angle take 1 for it where it has no value."""
    in_si, values = "inertia" in own, checked_numbers(parameters or {})
    for key in () if "angle" in own or "gaps" not in stated else ("reversor", "symmetry", "gaps"):
        stated[key] = {each: text.replace("angle", "1") for each, text in stated[key].items()}
    law = ("stiffness*r" if in_si else "r") if spring is None else spring
    known = {**own, **values} if in_si else values
    return Mechanism(
        ("phi", "theta"),
        [Spring("phi - theta", as_spring(law, known, shared=True)), *forces],
        inertia={"phi": "body_inertia", "theta": "inertia"} if in_si else {"phi": 1.0, "theta": "1/inertia_ratio"},
        parameters=with_parameters(own, values),
        surface_gravity="surface_gravity" if in_si else 1.0,
        in_si=in_si,
        angles=("phi", "theta"),
        name=name,
        **stated,
    )  # fmt: skip
