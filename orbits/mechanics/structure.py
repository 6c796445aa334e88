"""A mechanism without its numbers."""

from collections.abc import Sequence
from typing import NamedTuple

from ..laws import Key
from .elements import Element, Scalar

# The words of a model where the mechanism has no words of its own.
USUAL_WORDS = {
    "liftoff": "the force at which the contact opens",
    "gap": "the gap closes in flight",
    "pull": "the contact would have to pull",
    "separation": "parts of the machine pass through each other",
    "end": "contact: it never opens again",
    "landing gap": "",
    "standing gap": "",
    "landed pull": "",
    "stance": "",
    "none": "",
}


def words_of_gaps(names: Sequence[str]) -> dict[str, str]:
    """The words of a machine that steps; the point that opens and the one that lands may have names."""
    opens, lands = (f"the {name}" for name in (*names, *("point that opens", "point that lands")[len(names) :]))
    own = {"gap": f"{opens} touches in flight", "pull": f"{opens} would have to pull"} if names else {}
    landing = {"landing gap": f"{lands} touches in flight", "standing gap": f"{lands} touches in contact"}
    return {**own, **landing, "landed pull": f"{lands} would have to pull", "stance": "the standing foot lifts"}


class Structure(NamedTuple):
    """A mechanism without the values of its parameters, see `Mechanism`; equal ones share a model."""

    name: str
    coordinates: tuple[str, ...]
    elements: tuple[Element, ...]
    gap: Scalar | None
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
    reversor: tuple[tuple[str, Scalar], ...] | None = ()
    symmetry: tuple[tuple[str, Scalar], ...] = ()
    gaps: tuple[tuple[str, Scalar], ...] = ()
    friction: Scalar | None = None
    sticks: tuple[tuple[str, Scalar], ...] = ()
    anywhere: tuple[str, ...] = ()
    grazes: bool = False
    segments: tuple[tuple[str, Scalar], ...] = ()
    hangs: bool = False  # by a grip, whose forces are watched
