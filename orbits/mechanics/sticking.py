"""Coordinates that stick in contact: nothing may depend on the place of one that sticks at 0, which is decided exactly.

Then a motion that is moved along the ground is a motion too, the coordinate is 0 in contact in the labels of each
stance, and an orbit is one up to such a move.
"""

from collections.abc import Iterator
from typing import Any

from ..errors import InputError
from ..symbolic import Column, derivative_by, vanishes
from .coordinates import Coordinates, all_vanish
from .elements import Damper, Force, Inerter, Mass, Potential, Spring, Weight
from .lagrange import Mechanics, stated_inertia
from .structure import Structure


def refuse_places(c: Coordinates, s: Structure, m: Mechanics) -> None:
    """Raise `InputError` where something of a structure depends on the place of a coordinate that sticks at 0, and
    where nothing depends on that of one that sticks anywhere."""
    for name, _ in s.sticks:
        place = c.y[c.names.index(name)]
        if name in s.anywhere:
            if all(all_vanish(derivative_by(each, place) for each in found) for _, found in _free_of_places(c, s, m)):
                raise InputError(
                    f"'{name}' sticks, which determines its reversor and its symmetry, since nothing depends on its "
                    "place; leave them out"
                )
            continue
        for what, expressions in _free_of_places(c, s, m):
            if not all_vanish(derivative_by(each, place) for each in expressions):
                raise InputError(
                    f"{what} depends on the place of '{name}', which sticks: state it by places counted from "
                    f"'{name}', so that nothing changes where all is moved along the ground"
                )
        for each in s.elements:
            across = each.across if isinstance(each, Mass) else None
            if across is not None and not vanishes(derivative_by(c.scalar(across), place) - 1):
                raise InputError(f"'{across}' is a place along the ground that does not move on with '{name}'")


def _free_of_places(c: Coordinates, s: Structure, m: Mechanics) -> Iterator[tuple[str, Column]]:
    """What may not depend on a place, in words with its expressions."""
    assert s.gap is not None  # what sticks belongs to a gap
    yield f"gap '{s.gap}'", [c.scalar(s.gap)]
    yield f"counts = '{s.counts}'", [c.scalar(s.counts)]
    yield from ((f"the height '{height}'", [c.scalar(height)]) for _, height in s.heights)
    if s.separation is not None:
        yield f"separation = '{s.separation}'", [c.scalar(s.separation)]
    for each in s.elements:
        match each:
            case Spring(extension=extension) | Inerter(extension=extension):
                yield f"the extension '{extension}'", [c.scalar(extension)]
            case Mass(height=height) | Weight(height=height):
                yield f"the height '{height}'", [c.scalar(height)]
            case Potential(energy=energy):
                yield f"the potential '{energy}'", [c.scalar(energy)]
            case Damper(extension=extension):
                yield f"the damper along '{extension}'", c.gradient(extension)
            case Force(along=along):
                rates: Any = next(term.by_rates for term in m.in_flight.terms if term.element is each)
                yield f"the force along '{along}'", [*c.gradient(along), rates]
    yield "the inertia", [each for row in stated_inertia(c, s.inertia) or [] for each in row]
