"""Corners of designs: an extreme occurs at two places of the motion, and either one may become the larger."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import OrbitsError
from ..model import Machine
from ..periodic import Orbit
from .design_point import Case, DesignPoint, design_points
from .design_problem import DesignProblem, Outputs
from .design_quantities import extremes_of
from .extremes import Place, peaks_of

# Places of the motion whose values differ by no more than this share of these may be the same near a point.
BESIDE_ANOTHER = 1e-2
SAME_EXTREME = 1e-7  # share by which the values of two places differ at most where they are the same
IMAGE_OF_PLACE = 1e-7  # share to which the derivatives at two places agree that are images of each other
SAME_TIME_OF_PLACE = 1e-6  # times of one place of a motion differ by no more, where they are found in two ways


class Corner(NamedTuple):
    """An extreme that two places of the motion have: the values at the second one are constrained to be no more than
    those at the first, which stand for the extreme. It has the unit `size`."""

    extreme: str
    first: Place
    second: Place
    size: float

    def swapped(self) -> "Corner":
        """The corner at which the second place stands for the extreme."""
        return self._replace(first=self.second, second=self.first)


@dataclass(frozen=True)
class Corners:
    """The corners of a program of designs.

    outputs : what is evaluated at each design
    frame : the problem with the units of the parameters
    known : the corners
    """

    outputs: Outputs
    frame: DesignProblem
    known: tuple[Corner, ...]

    def at(self, design: DesignPoint) -> tuple[Corner, ...]:
        """The corners with their places at a design of this program."""
        both = [[place for place in design.places if place.kind.extreme == corner.extreme] for corner in self.known]
        pairs = zip(self.known, both, strict=True)
        return tuple(corner._replace(first=own[0], second=own[1]) if own[1:] else corner for corner, own in pairs)

    def case(self, motion: tuple[Machine, Orbit], corners: Sequence[Corner]) -> Case:
        """The outputs at a machine with its orbit, where extremes have corners."""
        ties, firsts = {each.extreme: each.second for each in corners}, {each.extreme: each.first for each in corners}
        return Case(*motion, self.outputs, ties, firsts)

    def beside(
        self, design: DesignPoint, before: DesignPoint | None = None, share: float = BESIDE_ANOTHER
    ) -> Corner | None:
        """The extreme whose value at another place is nearest to the largest one, at a design, within a share of it,
        and that is not a corner already; None where there is none. Its first place is that at the design `before`, if
        stated."""
        found = list[tuple[float, Corner]]()
        extremes = design.outputs.extremes(design.machine.model, design.machine.values)
        for extreme in (name for name in extremes if name not in [corner.extreme for corner in self.known]):
            (largest, first), *others = peaks_of(design.machine, design.orbit, extreme)
            size = abs(largest) or 1.0
            for value, place in others:
                corner = Corner(extreme, first, place, size)
                if largest - value <= share * size and self._is_corner(design, corner):
                    found.append(((largest - value) / size, corner))
                    break
        if not found:
            return None
        _, corner = min(found, key=lambda each: each[0])
        known = [place for place in (before or design).places if place.kind.extreme == corner.extreme][:1]
        far = [[(p.kind != c.kind, abs(p.time - c.time)) for p in known] for c in (corner.first, corner.second)]
        return corner.swapped() if far[1] < far[0] else corner

    def between(self, before: DesignPoint, after: DesignPoint, weighty: Collection[str]) -> Corner | None:
        """The corner of one of the `weighty` extremes that is at another place of a design than of the one before,
        while both places are on both motions; None where there is none."""
        old = {place.kind.extreme: place for place in before.places}
        known = {corner.extreme for corner in self.known}
        changed = [p for p in after.places if p.kind.extreme not in known and p.kind != old[p.kind.extreme].kind]
        for second in (place for place in changed if place.kind.extreme in weighty):
            extreme, first = second.kind.extreme, old[second.kind.extreme]
            at, now = (peaks_of(each.machine, each.orbit, extreme) for each in (before, after))
            corner = Corner(extreme, first, second, abs(now[0][0]) or 1.0)
            both = second.kind in [p.kind for _, p in at] and first.kind in [p.kind for _, p in now]
            if both and self._is_corner(after, corner):
                return corner
        return None

    def beyond(self, design: DesignPoint) -> str:
        """The quantity whose extreme is neither at the first nor at the second place of a corner, at a design; "" for
        none."""
        for corner in self.at(design):
            found = peaks_of(design.machine, design.orbit, corner.extreme)
            both = corner.first, corner.second
            own = [value for value, place in found if any(_same_place(place, known) for known in both)]
            if not own or found[0][0] > max(own) + SAME_EXTREME * corner.size:
                return quantity_with(design, [corner.extreme])
        return ""

    def _is_corner(self, design: DesignPoint, corner: Corner) -> bool:
        """Whether the derivatives at two places of an extreme differ, so that these are not images of each other."""
        (point,) = design_points([self.case((design.machine, design.orbit), [corner])])
        if isinstance(point, OrbitsError):
            return False
        slopes = point.slopes[point.tied] * self.frame.units(point.theta)
        return bool((np.abs(slopes) > IMAGE_OF_PLACE * corner.size).any())


def quantity_with(design: DesignPoint, extremes: Collection[str]) -> str:
    """The first quantity of a design that is made of one of some extremes, in words; "" for none."""
    names = design.outputs.quantities(design.machine.model, design.machine.values)
    return next((name.replace("_", " ") for name in names if set(extremes) & {*extremes_of(name)}), "")


def jumping(design: DesignPoint, beside: Sequence[DesignPoint]) -> str:
    """The first quantity whose extreme is at another place in designs right next to one; "" for none."""
    kinds = {place.kind.extreme: place.kind for place in design.places}
    changed = {p.kind.extreme for each in beside for p in each.places if p.kind != kinds.get(p.kind.extreme)}
    return quantity_with(design, changed)


def _same_place(one: Place, other: Place) -> bool:
    """Whether two places of one motion are the same."""
    return one.kind == other.kind and abs(one.time - other.time) <= SAME_TIME_OF_PLACE * (1 + one.time)
