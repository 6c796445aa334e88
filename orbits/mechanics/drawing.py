"""How a machine looks in the plane: outlines as formulas of its coordinates, and where its steps take it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from ..errors import InputError
from ..symbolic import suggest
from .elements import Scalar, names_in

# What formulas of outlines may name besides coordinates and parameters: the landings so far, and the number from 0 of
# one of repeated outlines.
LANDINGS, REPEATED = "steps", "i"


@dataclass(frozen=True)
class Outline:
    """A line or, if it is closed, a polygon that moves with a machine.

    name : of the part that it belongs to, for a legend; outlines of one name have one colour
    points : pairs (across, height), each a formula of the coordinates and parameters, of the number `steps` of landings
        so far and of the number `i` of a repeated outline; in the labels of the present stance
    closed : whether it is a filled polygon
    ends : whether its ends are drawn as dots
    repeat : how many there are, a formula of the parameters, which is rounded
    fixed : whether it stays where it is, like a wall
    traced : whether to draw the path of its first point instead
    """

    name: str
    points: Sequence[tuple[Scalar, Scalar]]
    closed: bool = False
    ends: bool = False
    repeat: Scalar = 1.0
    fixed: bool = False
    traced: bool = False


@dataclass(frozen=True)
class Drawing:
    """A drawing of a machine in the plane, for figures, as `Mechanism(drawing=...)` states it; no motion depends on it.

    outlines : in the order in which they are drawn
    onward : how a landing moves the labels: formulas by "x" and "y" that give the place, in the labels before the
        landing, of a point "x", "y" in the new labels. Each is the name itself or its negative, plus an amount of the
        parameters, such as "x + 2*length*sin(angle)", or with a coordinate that sticks of the orbit's step, "x + step";
        a name that is left out stays
    ground : whether to draw ground below the height 0
    tilt : the angle by which the ground falls, a formula of the parameters
    """

    outlines: Sequence[Outline]
    onward: Mapping[str, Scalar] = field(default_factory=dict)
    ground: bool = True
    tilt: Scalar = 0.0

    def expressions(self) -> Iterator[tuple[Scalar, set[str]]]:
        """Each formula, with the names that it may have besides parameters and, of outlines, coordinates."""
        for outline in self.outlines:
            yield from ((value, {LANDINGS, REPEATED}) for point in outline.points for value in point)
            yield outline.repeat, set()
        yield from ((value, {name}) for name, value in self.onward.items())
        yield self.tilt, set()


def refuse_misdrawn(drawing: object, known: set[str]) -> None:
    """Raise `InputError` for anything but a drawing of a machine with these names."""
    if not isinstance(drawing, Drawing) or not all(isinstance(each, Outline) for each in drawing.outlines):
        raise InputError(f"drawing = {drawing!r}; it must be a Drawing of a list of Outlines")
    if other := sorted({*drawing.onward} - {"x", "y"}):
        raise InputError(f"drawing: onward has '{other[0]}'; it may only have 'x' and 'y'")
    for expression, own in drawing.expressions():
        if unknown := sorted(names_in(expression) - known - own):
            raise InputError(f"drawing: '{expression}' has '{unknown[0]}'{suggest(unknown[0], sorted(known | own))}")
