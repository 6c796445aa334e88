"""The options of a run along curves: one frozen object for all curves."""

from dataclasses import dataclass, field, fields
from numbers import Real
from typing import Any

import numpy as np

from ..errors import InputError, whole_number


def from_to(low: float, high: float, default: float, **metadata: str) -> Any:
    """A field with its default, its bounds and further metadata; a whole number where the default is one."""
    return field(default=default, metadata={"bounds": (low, high), **metadata})


def check_bounds(options: Any, called: str) -> None:
    """Raise `InputError` where a field of options is out of its bounds.

    called : the name of the options in messages
    """
    for each in fields(options):
        (low, high), value, name = each.metadata["bounds"], getattr(options, each.name), f"{called}.{each.name}"
        if isinstance(each.default, int):
            whole_number(name, value, "points or steps", low, high)
        elif isinstance(value, bool) or not isinstance(value, float | Real) or not low <= value <= high:
            raise InputError(f"{name} = {value!r}; it must be a number from {low:g} to {high:g}")


@dataclass(frozen=True, kw_only=True)
class Steps:
    """Steps along curves, the acceptance of points, and the conditions that end a run.

    Lengths are in the problem's units. Raises `InputError`, which names a value that is out of its bounds.

    first, shortest, longest : lengths of steps; a curve is lost where a step of the shortest length is rejected
    apart : largest distance of neighbouring points: longer steps are divided, and their points are solved together;
        infinite for points at the ends of steps alone
    shorter : ratio of a step to the rejected one before it
    shorten, lengthen : bounds of the ratio of a step to the accepted one before it
    safety : factor by which the next step stays below the estimate of the step-size control
    aim : error of a prediction that step-size control aims at, divided by the square root of the point's amplification
    corrected, moved : largest correction of a point, as a share of its step, and in units
    turned : largest angle between neighbouring tangents, in radians
    bent : largest distance of a predicted point from the tangent, as a share of the step
    memory, beside : points behind a step from which its end is predicted; points on either side of a place between
        ends of steps from which it is interpolated
    corrections, least : Newton steps of a correction at most; and at least, at the end of a step
    last : Newton step, in units and times the point's amplification, below which it is the last one: the next one would
        be as small as its square
    settled : Newton steps at least for points from which one with singular equations is interpolated
    reach : a Newton step that is this many times the largest correction ends the correction
    rough : Newton step below which the end of a step that lands on no requested value, or a point between ends, is
        accepted; where the equations are recorded, another step follows
    separation : least distance of a regular point from a requested value, as a share of the distance of points
    batch, growth : largest number of points in a batch; factor by which a batch grows after one without a rejection
    grown : a batch ends with a step to a point that amplifies small changes by more than this
    rejections, recovery : a curve is lost after this many rejected batches; this many accepted points offset one
    most : largest number of points of a curve
    width : share of the chord between two points to which an event is located
    same : distance in units below which a point is the first one of its curve, which is then closed
    """

    first: float = from_to(0.0, np.inf, 5e-3)
    shortest: float = from_to(0.0, np.inf, 1e-5)
    longest: float = from_to(0.0, np.inf, 0.2)
    apart: float = from_to(0.0, np.inf, 0.02)
    shorter: float = from_to(0.01, 0.99, 0.5)
    shorten: float = from_to(0.01, 0.99, 0.3)
    lengthen: float = from_to(1.0, 100.0, 2.0)
    safety: float = from_to(0.01, 1.0, 0.9)
    aim: float = from_to(1e-14, 1.0, 1e-5)
    corrected: float = from_to(0.0, np.inf, 1e-2)
    moved: float = from_to(0.0, np.inf, np.inf)
    turned: float = from_to(1e-3, np.pi, 0.25)
    bent: float = from_to(0.0, np.inf, 0.5)
    memory: int = from_to(1, 8, 4)
    beside: int = from_to(1, 8, 3)
    corrections: int = from_to(1, 100, 8)
    least: int = from_to(1, 100, 2)
    last: float = from_to(1e-15, 1e-3, 1e-8)
    settled: int = from_to(1, 100, 4)
    reach: float = from_to(1.0, np.inf, 2.0)
    rough: float = from_to(0.0, 1.0, 0.0)
    separation: float = from_to(0.0, 0.5, 0.1)
    batch: int = from_to(1, 100_000, 640)
    growth: int = from_to(1, 1000, 4)
    grown: float = from_to(1.0, np.inf, np.inf)
    rejections: int = from_to(0, 100_000, 16)
    recovery: int = from_to(1, 100_000, 20)
    most: int = from_to(1, 10**9, 10_000)
    width: float = from_to(1e-16, 0.5, 1e-13)
    same: float = from_to(0.0, 1.0, 1e-9)

    def __post_init__(self) -> None:
        check_bounds(self, "steps")
        if not 0 < self.shortest < self.longest or not self.apart > 0:
            lengths = f"shortest = {self.shortest:g}, longest = {self.longest:g}, apart = {self.apart:g}"
            raise InputError(f"steps: {lengths}; lengths must be above 0, and the longest step above the shortest")
        if not self.shortest < self.first <= self.longest:
            bounds = f"above the shortest step, {self.shortest:g}, up to the longest one, {self.longest:g}"
            raise InputError(f"steps.first = {self.first:g}; it must be {bounds}")

    def ratios(self, errors: Any, used: Any) -> Any:
        """The ratios (m,) of next steps to accepted ones, whose ends were predicted with these errors (m,), the
        amplification included, from numbers (m,) of points."""
        # The interpolant of k points with tangents has an error of order 2 k in the length.
        ratios = (self.aim / np.maximum(errors, np.finfo(float).tiny)) ** (0.5 / used)
        return np.minimum(np.maximum(self.safety * ratios, self.shorten), self.lengthen)

    @property
    def divided(self) -> bool:
        """Whether there are points between the ends of steps."""
        return self.apart < np.inf
