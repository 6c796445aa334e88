"""Where the orbits of a family exist in two parameters, and where they are motions."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..errors import InputError, finite_number
from ..model.machine import Machine
from ..symbolic.exclusive import exclusive
from .checkpoint import collect_family
from .curve import Curve, check_followed, machine_at
from .family import Family
from .follow import follow, start_tracer
from .step_control import Options, StepControl, checked_options

Interval = tuple[float, float, bool]


@dataclass(frozen=True)
class Existence:
    """An existence and admissibility diagram: for each value of one parameter the families along the other.

    along, across : names of the two parameters
    values : of `across`, one for each row
    rows : the families of each row, which begin at one orbit and go either way; none where there is no such orbit
    spine : the families along `across` that the rows begin on
    """

    along: str
    across: str
    values: tuple[float, ...]
    rows: tuple[tuple[Family, ...], ...]
    spine: tuple[Family, ...]

    def stretches(self, row: int) -> Iterator[Interval]:
        """Where a row has orbits: (from, to, whether they are motions), to rounding; sheets may overlap."""
        return (interval for family in self.rows[row] for interval in intervals_of(family))

    def heading(self, name: str) -> str:
        """The name of a parameter with its unit, if it has one."""
        return self.spine[0].heading(name) if self.spine else name

    def unknown(self, row: int) -> bool:
        """Whether a row may be incomplete: one of its families was cut short or lost, or the spine did not reach it."""
        return any(family.end.kind in ("stopped", "stuck") for family in self.rows[row] or self.spine)

    def motions(self, row: int) -> list[tuple[float, float]]:
        """The intervals on which a row has an orbit that is a motion, ascending and apart."""
        joined: list[tuple[float, float]] = []
        for low, high in sorted((low, high) for low, high, motion in self.stretches(row) if motion):
            if joined and low <= joined[-1][1]:
                low, high = joined[-1][0], max(high, joined.pop()[1])
            joined.append((low, high))
        return joined

    def plot(self, axes: Any = None) -> Any:
        """Plot the diagram; returns the axes. See `orbits.plot.plot_existence`."""
        from ..plot import plot_existence

        return plot_existence(self, axes)


def intervals_of(family: Family) -> Iterator[Interval]:
    """The stretches of a family's parameter on which it has orbits, each with whether they are motions.

    A stretch ends at a fold, or at an event from which on the orbits become motions or cease to be.
    """
    points = [(point, event and event.kind != "asked") for point, event in family.in_order()]
    start, inside = points[0][0], [points[0][0].admissible]
    for point, cut in [*points[1:], (points[-1][0], True)]:
        if cut:  # an event lies on the edge of a stretch and tells nothing of its inside
            low, high = sorted((start.value, point.value))
            yield low, high, all(inside or (start.admissible, point.admissible))
            start, inside = point, []
        else:
            inside.append(point.admissible)


@exclusive
def existence(
    machine: Machine,
    along: str,
    between: tuple[float, float],
    across: str,
    values: Sequence[float],
    family: int = 1,
    *,
    longest: float = Options.longest,
    most: int = Options.most,
    step_control: StepControl = Options.step_control,
    method: str | None = None,
) -> Existence:
    """Where the orbits of a family exist in two parameters.

    machine : as in `find`; its own values of the parameters are where the diagram begins
    along, between : the parameter of the rows, and the two values that they go on to
    across, values : the parameter that differs from row to row, and its values
    family, longest, most, step_control, method : as in `follow`

    From the machine's own orbit the family is followed in `across`; from where that passes each of `values` it is
    followed in `along` both ways, past folds. A row that the family does not come to in this way has no families.
    """
    check_followed(machine, along, across)
    if along == across:
        raise InputError(f"a diagram in '{along}' needs another parameter besides")
    try:
        low, high = (finite_number("between", value) for value in between)
        values = tuple(sorted({finite_number("values", value) for value in values}))
    except (TypeError, ValueError):
        raise InputError(f"between = {between!r} are two values, values = {values!r} a list of them") from None
    own, first = machine.values[along], machine.values[across]
    if not low < own < high:
        raise InputError(f"between = ({low:g}, {high:g}): the machine's own {along} = {own:g} must lie between")
    options = checked_options(longest=longest, most=most, step_control=step_control)
    sides = [[value for value in values if (value - first) * side >= 0] for side in (-1, 1)]
    if not (ways := [way for way in sides if set(way) - {first}]):
        raise InputError(f"values = {values}: rows differ from the machine's own {across} = {first:g}")
    follow_across = partial(
        follow, machine, across, family=family, longest=longest, most=most, step_control=step_control, method=method
    )
    spine = tuple(follow_across(max(way, key=lambda value: abs(value - first)), at=way) for way in ways)
    rows = tuple(_row(machine, spine, value, across, along, (low, high), options) for value in values)
    return Existence(along, across, values, rows, spine)


def _row(machine, spine, value, across, along, bounds: tuple[float, float], options: Options) -> tuple[Family, ...]:
    """The families along one parameter, both ways from each orbit of the spine at a value of the other."""
    own = machine.values[along]
    found = {point.alpha: (point, part.settings["method"]) for part in spine for point in part.at(value)}
    families: list[Family] = []
    for point, method in found.values():  # a spine that folds passes a row more than once
        if any(other.alpha == point.alpha for family in families for other in family.at(own)):
            continue
        there, method = machine_at(machine, point, across, method)
        for way in (bounds[::-1], bounds):
            curve = Curve(there, along, method, bounds[1] - bounds[0])
            families.append(collect_family(start_tracer(curve, np.array([*point.u, own]), own, *way, options)))
            if families[-1].end.kind == "closed":  # the other way round would give the same
                break
    return tuple(families)
