"""Roots of equations: existence and uniqueness by Krawczyk's operator, then Newton's method in growing precision.

For equations F with derivatives in D on a box U about u, and any matrix Y, Krawczyk's operator is

    K(U) = u - Y F(u) + (1 - Y D) (U - u).

If K(U) lies in the interior of U, then U holds exactly one root, and it lies in K(U) (R. Krawczyk, Computing 4, 1969;
R. E. Moore, SIAM Journal on Numerical Analysis 14, 1977). With interval parameters F(u) holds the values for all of
them, and the statement is true for each.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat, ctx

from ..exact import CONTACT_DURATION, FLIGHT_DURATION, TooLong, Undecided, Unproved
from .enclosure import COARSE, Fineness, fineness_for, unit_matrix
from .equations import Equations, Evaluated, columns_of
from .programs import UNDEFINED

# Bits of the first proof.
FIRST_BITS = 80


class KrawczykOptions(NamedTuple):
    """The boxes on which Krawczyk's operator is tried, and how far they are contracted."""

    # Relative radii of the boxes that are tried, the largest first.
    boxes: tuple[float, ...] = (2.0**-20, 2.0**-27, 2.0**-34, 2.0**-40)
    # Sizes of boxes for interval parameters, relative to the first estimate of how far the root moves.
    room: tuple[float, ...] = (1.5, 2.5, 6.0)
    guard_bits: int = 40  # beyond those requested, since motions amplify roundings
    # A box is contracted while a radius falls below this share of itself. Where a slope in it jumps from 1 to k, as at
    # a breakpoint of a law, a contraction leaves the share (k - 1)/(k + 1).
    shrinking: float = 0.99
    polishes: int = 6  # Newton steps, at most
    polished: float = 1e-6  # size of the last Newton step, relative to the unknowns
    exact: int = 10**9  # bits of a number that is known exactly
    exactly: float = 2.0**-58  # distance of the decimals of an exact number from it, relative to it


KRAWCZYK = KrawczykOptions()
# The unknowns that are positive for an orbit.
POSITIVE_UNKNOWNS = ("alpha", FLIGHT_DURATION, CONTACT_DURATION)


@dataclass(frozen=True)
class ProvedRoot:
    """A proved root of the equations for each value of the interval parameters.

    box : enclosures (unknowns,) of the root
    centre, radii : the box (unknowns,) in which there is no other root
    evaluated : the equations on a box that holds the root, with derivatives of this fineness
    """

    box: list[arb]
    centre: list[arb]
    radii: list[arb]
    evaluated: Evaluated
    fineness: Fineness = COARSE

    def unique_within(self, units: Sequence[arb]) -> arb:
        """A distance from every point of the enclosures within which there is no other root, in any unknown; the
        unknowns are in these units."""
        parts = zip(self.radii, self.box, self.centre, units, strict=True)
        # Decimals that are rounded outward reach a little further than the balls, and those of numbers that are known
        # exactly by a few roundings.
        more = [value.rad() / 10 + abs(value) * KRAWCZYK.exactly for value in self.box]
        free = [
            ((radius - abs(value - c) - rest) * unit).lower()
            for (radius, value, c, unit), rest in zip(parts, more, strict=True)
        ]
        least = free[0]
        for each in free[1:]:
            least = each if each < least else least
        return least


def prove_root(equations: Equations, guess: Sequence[float], bits: int, boxes: Sequence[list[arb]] = ()) -> ProvedRoot:
    """The root near a guess, enclosed to about a number of bits where the parameters have one value.

    boxes : radii (unknowns,) of boxes about the guess that are tried first

    Raises `Unproved` where no root can be proved.
    """
    centre = [arb(value) for value in guess]
    if equations.intervals:
        centre = polished(equations, centre)
        candidates = [*boxes, *_wide_boxes(equations, centre)]
    else:
        candidates = [*boxes, *([arb(share) * (1 + abs(c)).abs_upper() for c in centre] for share in KRAWCZYK.boxes)]
    reason = ""
    for radii in candidates:
        try:
            evaluated = evaluated_on(equations, centre, radii)
            inner = _contracted(equations, evaluated, centre, radii)
        except TooLong:
            raise
        except Unproved as error:
            if not reason:  # where not even the centre's motion is enclosed, that of no smaller box is
                evaluated_on(equations, centre, [arb(0)] * len(centre), wide=False)
            reason = f": {error}"
            continue
        if inner is None:
            continue
        root = narrowed_root(equations, ProvedRoot(inner, centre, radii, evaluated), bits)
        if root.unique_within([arb(1)] * len(centre)) > 0:
            break
        reason = ": rounded outward, its enclosure reaches beyond the set in which it is proved unique"
    else:
        raise Unproved(f"no box around the numerical solution is proved to contain a root{reason}")
    for name, value in zip(equations.unknowns, root.box, strict=True):
        if name in POSITIVE_UNKNOWNS and not value > 0:
            raise Unproved(f"{name} is not proved to be positive")
    return root


def evaluated_on(
    equations: Equations, centre: Sequence[arb], radii: Sequence[arb], wide: bool = True, fineness: Fineness = COARSE
) -> Evaluated:
    """The equations on a box; a division by a ball that holds 0 leaves them without values."""
    try:
        return equations.evaluate(centre, radii, ctx.prec, wide, fineness)
    except (*UNDEFINED, np.linalg.LinAlgError):
        raise Unproved("the motion reaches a place where a law has no value") from None


def _common(value: arb, other: arb) -> arb:
    """The intersection of two enclosures of one number."""
    if not (value.is_finite() and other.is_finite() and value.overlaps(other)):
        raise Unproved("two enclosures of the root contradict each other")
    return value.intersection(other)


def polished(equations: Equations, centre: Sequence[arb]) -> list[arb]:
    """A guess by Newton's method for the middle of the parameters' intervals, from one that may be for other values."""
    centre = list(centre)
    for _ in range(KRAWCZYK.polishes):
        point = evaluated_on(equations, centre, [arb(0)] * len(centre), wide=False)
        step = _rounded_inverse(columns_of(point.slopes, 0, len(centre))) * arb_mat(len(centre), 1, point.values)
        centre = [(value - step[i, 0]).mid() for i, value in enumerate(centre)]
        if all(abs(step[i, 0]) < KRAWCZYK.polished * (1 + abs(value)) for i, value in enumerate(centre)):
            break
    return centre


def _wide_boxes(equations: Equations, centre: list[arb]) -> list[list[arb]]:
    """Boxes for interval parameters: the root's motion with them by its derivatives at the middle, times the options
    of `room`."""
    point = evaluated_on(equations, centre, [arb(0)] * len(centre), wide=False)
    n, radii = len(centre), equations.intervals.radii()
    inverse = _rounded_inverse(columns_of(point.slopes, 0, n))
    by_parameters = inverse * columns_of(point.slopes, n, len(radii))
    moved = [sum((abs(by_parameters[i, j]) * radius for j, radius in enumerate(radii)), arb(0)) for i in range(n)]
    least = arb(2) ** -40
    return [[(arb(room) * move + least).abs_upper() for move in moved] for room in KRAWCZYK.room]


def _rounded_inverse(matrix: arb_mat) -> arb_mat:
    try:
        return matrix.mid().inv().mid()
    except ZeroDivisionError:
        raise Unproved("the equations are singular here, as at a fold of the family") from None


def _contracted(
    equations: Equations, evaluated: Evaluated, centre: Sequence[arb], radii: Sequence[arb]
) -> list[arb] | None:
    """Krawczyk's image of a box, None where it does not lie in its interior."""
    image = _image(equations, evaluated, centre, [arb(0, radius) for radius in radii])
    inside = all(abs(value - c) < radius for value, c, radius in zip(image, centre, radii, strict=True))
    return image if inside else None


def _image(equations: Equations, evaluated: Evaluated, centre: Sequence[arb], deviations: Sequence[arb]) -> list[arb]:
    """Krawczyk's operator about a centre, on the deviations (unknowns,) of a box from it."""
    n, reach = len(centre), equations.intervals.radii()
    slopes = columns_of(evaluated.slopes, 0, n)
    inverse = _rounded_inverse(slopes)
    change = (unit_matrix(n) - inverse * slopes) * arb_mat(n, 1, list(deviations))
    change -= inverse * arb_mat(n, 1, evaluated.values)
    if reach:  # the inverse first: its rows cancel much of a parameter's effect on the equations
        by_parameters = inverse * columns_of(evaluated.slopes, n, len(reach))
        change -= by_parameters * arb_mat(len(reach), 1, [arb(0, radius) for radius in reach])
    return [value + change[i, 0] for i, value in enumerate(centre)]


def narrowed_root(equations: Equations, root: ProvedRoot, bits: int) -> ProvedRoot:
    """The root enclosed more narrowly: by the derivatives on a smaller box, then by values in growing precision. Where
    many bits are requested the derivatives follow, so that each refinement doubles the bits (Newton's method). Raises
    `Undecided` where it is not enclosed to these bits."""
    box, evaluated, fineness = root.box, root.evaluated, COARSE
    if equations.intervals:
        for _ in range(2):
            centre, radii = [value.mid() for value in box], [value.rad() for value in box]
            evaluated = evaluated_on(equations, centre, radii)
            image = _image(equations, evaluated, centre, [arb(0, radius) for radius in radii])
            box = [_common(value, new) for value, new in zip(box, image, strict=True)]
        return replace(root, box=box, evaluated=evaluated)
    # Twice the radius, so that roundings of later centres stay in the box of the derivatives.
    centre, radii = [value.mid() for value in box], [2 * value.rad() for value in box]
    evaluated = evaluated_on(equations, centre, radii)
    box, follows = _by_values(equations, evaluated, evaluated, centre, box), bits > FIRST_BITS
    for _ in range(bits):
        if all(_bits_of(value) >= bits for value in box):
            return replace(root, box=box, evaluated=evaluated, fineness=fineness)
        reached = max(FIRST_BITS, min(_bits_of(value) for value in box))
        with ctx.workprec(min(2 * reached, bits) + KRAWCZYK.guard_bits):
            centre, radii = [value.mid() for value in box], [arb(0)] * len(box)
            if follows:
                fineness, radii = fineness_for(min(reached, bits // 2)), [2 * value.rad() for value in box]
            values = evaluated_on(equations, centre, radii, fineness=fineness)
            evaluated = values if follows else evaluated
            before, box = box, _by_values(equations, evaluated, values, centre, box)
        if not _shrinks(before, box, KRAWCZYK.shrinking if follows else 0.5, bits):
            if follows:
                break
            follows = True  # the first box may hold a breakpoint of a law, where derivatives jump
    raise Undecided(f"the root is not enclosed to {bits} bits")


def _by_values(
    equations: Equations, slopes: Evaluated, values: Evaluated, centre: Sequence[arb], box: list[arb]
) -> list[arb]:
    """The box by Krawczyk's operator with the values at a centre, and derivatives that hold on a box with both."""
    merged = Evaluated(values.values, slopes.slopes, slopes.passages)
    while True:
        image = _image(equations, merged, centre, [value - c for value, c in zip(box, centre, strict=True)])
        before, box = box, [_common(value, narrower) for value, narrower in zip(box, image, strict=True)]
        if not _shrinks(before, box, KRAWCZYK.shrinking, ctx.prec):
            return box


def _shrinks(before: Sequence[arb], box: Sequence[arb], share: float, bits: int) -> bool:
    """Whether a radius of a box is below this share of that before, of a number that was not known to these bits. That
    of a number which is exactly 0 shrinks without end."""
    pairs = zip(before, box, strict=True)
    return any(new.rad() < share * old.rad() and _bits_of(old) < bits for old, new in pairs)


def _bits_of(value: arb) -> int:
    """The number of bits to which a ball determines a number, in units of the number or of 1."""
    size = max(abs(value.mid()), arb(1))
    share = value.rad() / size
    if not share > 0:
        return KRAWCZYK.exact
    _, exponent = share.mid().man_exp()
    return -int(exponent) - int(share.mid().man_exp()[0]).bit_length()
