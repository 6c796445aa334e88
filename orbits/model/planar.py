"""The forces of the ground in a model whose masses also move along the ground."""

from collections.abc import Callable
from dataclasses import dataclass

# The quantities that flight and contact of such a model watch: the forces of the ground on all that stands on it.
NORMAL_FORCE = "contact force across the ground"
TANGENTIAL_FORCE = "contact force along the ground"


@dataclass(frozen=True, eq=False)
class Planar:
    """The ground under a machine whose masses move along it too.

    stands : whether something stands on the ground in flight, when a gap is open; there is no force otherwise
    friction : p -> the largest share of the force across the ground that the force along it may have; None where no
        such number is stated
    handed_over : (x, p) -> the flight state in the labels after a hand-over, a landing in the flight state x with a
        speed in which an impulse acts on the point that lands alone; None where there are no hand-overs
    handed_back : the same of a landing of the point that opened last, which leads a step back
    travel : (x, p) -> the speed of the centre of mass along the ground in the flight state x; None where nothing sticks
    weight : p -> that of the machine on the ground; None where nothing sticks
    across : (x, p) -> the place of the centre of mass along the ground in the flight state x, counted from where the
        machine stands
    momentum : (x, p) -> the momentum across and along the ground in the flight state x; None where nothing sticks on
        whose place the motion depends
    """

    stands: bool
    friction: Callable | None = None
    handed_over: Callable | None = None
    handed_back: Callable | None = None
    travel: Callable | None = None
    weight: Callable | None = None
    across: Callable | None = None
    momentum: Callable | None = None
