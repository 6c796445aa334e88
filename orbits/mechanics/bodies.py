"""Rigid bodies and their joints, for files that simulators of robots read; no motion depends on them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..errors import InputError
from ..symbolic import suggest
from .dimensions import plain_slope
from .drawing import LANDINGS, REPEATED, Outline
from .elements import Inerter, Mass, Scalar, names_in, value_of
from .refusals import listed, refuse_expressions

# The axes (across, into the plane, up) of joints by their kinds.
AXES = {"across": (1.0, 0.0, 0.0), "up": (0.0, 0.0, 1.0), "down": (0.0, 0.0, -1.0), "turn": (0.0, 1.0, 0.0)}


@dataclass(frozen=True)
class Joint:
    """One freedom of a body.

    name : of the joint
    axis : "across", "up" or "down", along which it slides, or "turn", clockwise where across points to the right; in
        the frame that the earlier joints have moved
    place : a formula of the coordinates, the parameters and the number `steps` of landings so far, and with a
        coordinate that sticks of the `step`
    """

    name: str
    axis: str
    place: Scalar


@dataclass(frozen=True)
class Body:
    """A rigid body in the plane, as `Mechanism(bodies=...)` states it; its numbers are formulas of the parameters.

    name : of the body
    joints : in order from the carrier
    mass, inertia : the inertia about its centre of mass, 0 for a point mass
    centre : its centre of mass, across and up in its own frame
    place : the origin of its frame in the carrier's frame where all joints are at 0, across and up
    carrier : the name of an earlier body; None for the ground
    outlines : the lines that show it, in its own frame
    """

    name: str
    joints: Sequence[Joint]
    mass: Scalar
    inertia: Scalar = 0.0
    centre: tuple[Scalar, Scalar] = (0.0, 0.0)
    place: tuple[Scalar, Scalar] = (0.0, 0.0)
    carrier: str | None = None
    outlines: Sequence[Outline] = ()


def refuse_misbuilt(bodies: Sequence[Any], known: set[str]) -> None:
    """Raise `InputError` for anything but bodies of a machine with these names of coordinates and parameters."""
    earlier = list[str]()
    for body in bodies:
        joints = listed("joints", body.joints) if isinstance(body, Body) else [None]
        if not all(isinstance(joint, Joint) for joint in joints):
            raise InputError(f"bodies = {bodies!r}; they must be a list of Body with lists of Joint")
        if body.carrier is not None and body.carrier not in earlier:
            raise InputError(f"body '{body.name}': its carrier {body.carrier!r} is not in the list before it")
        if odd := [joint.axis for joint in body.joints if not isinstance(joint.axis, str) or joint.axis not in AXES]:
            raise InputError(f"body '{body.name}': a joint has no axis {odd[0]!r}{suggest(odd[0], AXES)}")
        if odd := [each for each in listed("outlines", body.outlines) if not isinstance(each, Outline)]:
            raise InputError(
                f"body '{body.name}': {odd[0]!r} is not an Outline, such as Outline('leg', [('0', '0'), ('0', '1')])"
            )
        earlier.append(body.name)
        pairs = [("centre", body.centre), ("place", body.place)]
        pairs += [
            (f"point of '{each.name}'", point) for each in body.outlines for point in listed("points", each.points)
        ]
        for what, pair in pairs:
            if isinstance(pair, str) or not isinstance(pair, Sequence) or len(pair) != 2:
                raise InputError(f"body '{body.name}': the {what} {pair!r} is not a pair (across, up)")
        places = [(joint.place, {LANDINGS}) for joint in body.joints]
        own = [(value, set[str]()) for value in (body.mass, body.inertia, *body.centre, *body.place)]
        own += [(each.repeat, set[str]()) for each in body.outlines]
        drawn = [(value, {REPEATED}) for each in body.outlines for point in each.points for value in point]
        refuse_expressions(f"body '{body.name}'", (expression for expression, _ in (*places, *own, *drawn)))
        for expression, more in (*places, *own, *drawn):
            if unknown := sorted(names_in(expression) - known - more):
                raise InputError(
                    f"body '{body.name}': '{expression}' has '{unknown[0]}'{suggest(unknown[0], known | more)}"
                )
    for what, names in (("bodies", earlier), ("joints", [joint.name for body in bodies for joint in body.joints])):
        if odd := [name for name in names if not _is_name(name) or names.count(name) > 1]:
            raise InputError(
                f"bodies: {odd[0]!r} cannot name one of the {what}: use letters, digits and _, each name once, and "
                "not 'world'"
            )


def _is_name(name: object) -> bool:
    """Whether it is one that simulators take: `world` is the ground's."""
    return isinstance(name, str) and name.isascii() and name.isidentifier() and name != "world"


def bodies_of(mechanism: Any, p: Mapping[str, float]) -> Sequence[Body]:
    """The bodies that a `Mechanism` states, or those of masses in a column, where each moves up with one coordinate;
    raises `InputError` for another machine."""
    if mechanism.bodies:
        refuse_misbuilt(mechanism.bodies, {*mechanism.coordinates, *p})
        return mechanism.bodies
    masses, found = [each for each in mechanism.elements if isinstance(each, Mass)], list[Body]()
    names = {height: name for name, height in (mechanism.heights or {}).items()}
    for each in masses:
        moved = names_in(each.height) & {*mechanism.coordinates}
        if each.across is not None or len(moved) != 1 or plain_slope(each.height, *moved) != 1.0:
            break
        place, name = value_of(each.height, dict.fromkeys(moved, 0.0), p), names.get(each.height, *moved)
        name = name.replace(" ", "_")
        found.append(Body(name, [Joint(f"{name}_up", "up", *moved)], each.mass, place=(0.0, float(place))))
    moved_once = sorted(body.joints[0].place for body in found) == sorted(mechanism.coordinates)  # type: ignore[type-var]
    others = mechanism.inertia or any(isinstance(each, Inerter) for each in mechanism.elements)
    if others or len(found) != len(masses) or not moved_once:
        why = (
            "states an inertia, which does not say where its masses are"
            if mechanism.inertia
            else "is not a column of masses that move up with one coordinate each"
        )
        raise InputError(
            f"the {mechanism.name} {why}: give its bodies and their joints, bodies=[Body(name, [Joint(name, 'up', "
            "coordinate)], mass), ...]"
        )
    return found
