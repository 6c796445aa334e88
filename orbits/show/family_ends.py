"""The ends of a family in figures: at which of its points they are, and their names."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..continuation import Family
    from ..curves import End

# The names of the kinds of ends in legends, and by these names their markers.
NAMES_OF_ENDS = {
    "reached": "end of the range",
    "escaped": "goes on without bound",
    "homoclinic": "becomes homoclinic",
    "closed": "closes",
    "degenerate": "degenerates",
    "stopped": "stopped",
    "stuck": "lost",
    "interrupted": "interrupted",
}
_SHAPES = {"reached": "|", "escaped": ">", "homoclinic": "1", "closed": "2", "degenerate": "+", "stopped": "_"}
MARKERS_OF_ENDS = {NAMES_OF_ENDS[kind]: shape for kind, shape in _SHAPES.items()}


def ends_of(family: "Family") -> "dict[int, End]":
    """The ends of a family by their places among its points and events in order: the last one, and before it the first
    one where the family was followed both ways."""
    count = len(family.in_order())
    return ({0: family.beginning} if family.beginning else {}) | ({count - 1: family.end} if count else {})
