"""A mechanism without its numbers."""

from typing import NamedTuple

from ..laws.law import Key
from .elements import Element, Scalar

# The words of a model where the mechanism has no words of its own.
USUAL_WORDS = {
    "liftoff": "the force at which the contact opens",
    "gap": "the gap closes in flight",
    "pull": "the contact would have to pull",
    "separation": "parts of the machine pass through each other",
    "end": "contact: it never opens again",
    "none": "",
}


class Structure(NamedTuple):
    """A mechanism without the values of its parameters, see `Mechanism`; equal ones share a model."""

    name: str
    coordinates: tuple[str, ...]
    elements: tuple[Element, ...]
    gap: Scalar
    inertia: tuple[tuple[Scalar, ...], ...]
    gravity: Key
    surface_gravity: Scalar
    counts: Scalar
    launch: str | None
    heights: tuple[tuple[str, Scalar], ...]
    separation: Scalar | None
    energy_unit: Scalar
    rest: tuple[tuple[str, Scalar], ...]
    knees: tuple[tuple[str | None, str, Scalar], ...]
    actuators: tuple[tuple[str, str], ...]
    words: tuple[tuple[str, str], ...]
    parameters: tuple[str, ...]
