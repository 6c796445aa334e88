"""The vertical hop of a machine that moves along the ground: the same machine with all of its lateral places at 0.

Lateral are the coordinate that sticks and the coordinates that the reversor turns over. A machine that is its own
mirror image stays upright where it begins so, and hops as one of its other coordinates alone.
"""

import re
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

from ..errors import InputError, NoOrbit
from .elements import Damper, Element, Force, Inerter, Mass, Potential, Spring, Weight, names_in


def lateral_coordinates(mechanism: Any) -> tuple[str, ...]:
    """The names of the lateral coordinates."""
    reversor, states = mechanism.model.reversor or (), mechanism.model.flight.states
    turned = {name for name, sign in zip(states, reversor, strict=True) if sign < 0 and not name.endswith("'")}
    return tuple(name for name in mechanism.coordinates if name in turned)


def upright(mechanism: Any) -> Any:
    """The `Mechanism` of the other coordinates, without places along the ground; raises `NoOrbit` where its statement
    has Python functions, and where the machine is not one that hops then."""
    lateral = lateral_coordinates(mechanism)
    left = [name for name in mechanism.coordinates if name not in lateral]
    if mechanism.has_functions:
        raise NoOrbit(
            f"the {mechanism.name} is stated by Python functions, so no vertical hop is known to begin with: give a "
            "start"
        )
    pattern = re.compile(r"\b(" + "|".join(map(re.escape, lateral)) + r")\b")

    def at_zero(value: Any) -> Any:
        return pattern.sub("0", value) if isinstance(value, str) else value

    def of(element: Element) -> Element:
        known = {each.name: at_zero(getattr(element, each.name)) for each in fields(element) if each.name != "force"}
        return replace(element, **known | ({"across": None} if isinstance(element, Mass) else {}))

    elements = [each for each in map(of, mechanism.elements) if _moves(each, left)]
    rows = [i for i, name in enumerate(mechanism.coordinates) if name in left]
    inertia = [[mechanism.inertia[i][j] for j in rows] for i in rows] if mechanism.inertia else ()
    chosen = {
        "coordinates": left,
        "elements": elements,
        "inertia": inertia,
        "heights": {name: at_zero(height) for name, height in (mechanism.heights or {}).items()},
        "separation": at_zero(mechanism.separation),
        "rest": {name: place for name, place in mechanism.rest.items() if name in left},
        "angles": [name for name in mechanism.angles if name in left],
        "sticks": (), "reversor": {}, "symmetry": {}, "friction": None, "drawing": None, "bodies": (), "bounds": {},
    }  # fmt: skip
    try:
        used = replace(mechanism, **chosen, parameters={}).names
        return replace(mechanism, **chosen, parameters={n: v for n, v in mechanism.parameters.items() if n in used})
    except InputError as error:
        raise NoOrbit(f"the {mechanism.name} has no vertical hop to begin with: {error}; give a start") from None


def _moves(element: Element, coordinates: Sequence[str]) -> bool:
    """Whether an element acts on one of these coordinates."""
    match element:
        case Spring(extension=place) | Inerter(extension=place) | Damper(extension=place) | Force(along=place):
            return not names_in(place).isdisjoint(coordinates)
        case Mass(height=place) | Weight(height=place) | Potential(energy=place):
            return not names_in(place).isdisjoint(coordinates)
    return True
