"""A curve in both directions from its start: the way to the first bound in reverse, and then the way to the second
bound."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

from ..curves import End, Event
from ..records import Records
from ..result import Progress
from .family import BEGINNING, UNFINISHED, Family
from .family_run import FamilyRun
from .point import Point, stated

# (bounds, family to resume) -> the run from its last point, or from the start, to the second bound.
Begin: TypeAlias = Callable[[tuple[float, float], Family | None], FamilyRun]
# (run, family to resume, file of its points, progress) -> the curve that the run finds.
Collect: TypeAlias = Callable[[FamilyRun, Family | None, str | Path | None, Progress], Family]
# Of ends from which a family that is resumed goes on.
OPEN = ("stopped", "interrupted")


def both_ways(
    begin: Begin, bounds: tuple[float, float], collect: Collect, resume: Family | None = None,
    output: str | Path | None = None, progress: Progress = None,
) -> Family:  # fmt: skip
    """The curve from the first bound to the second one through its start, or from the start where that is a bound.

    resume : a curve that continues at those of its ends where it was only stopped or interrupted

    A curve that closes, or that a time limit interrupts on its way ahead, does not go back. The `output` has the points
    of the way ahead until the whole curve is written to it.
    """
    ahead, halves = resume, [progress and (lambda share, of=of: progress((of + share) / 2)) for of in (0, 1)]
    if not isinstance(resume, Family) or resume.end.kind in OPEN:  # what is no family is refused by `begin`
        run = begin(bounds, resume)
        if resume.beginning is None if resume else run.behind == run.start:
            return collect(run, resume, output, progress)
        ahead = collect(run, resume, output, halves[0])
    assert ahead is not None
    whole = ahead
    if ahead.end.kind not in ("closed", "interrupted"):
        if resume is None:
            whole = _joined(collect(begin(bounds[::-1], None), None, None, halves[1]), ahead)
        elif ahead.beginning and ahead.beginning.kind in OPEN:
            back = turned(ahead)
            back = collect(begin(bounds[::-1], back), back, None, halves[1])
            whole = _beginning(replace(turned(back), settings=ahead.settings), back.end)
    elif ahead.end.kind == "interrupted" and resume is None:
        whole = _beginning(ahead, End("interrupted", UNFINISHED))
    if output is not None:
        whole.save(output)
    return whole


def turned(family: Family) -> Family:
    """A family from its last point to its first."""
    last, points = len(family) - 1, family.points[::-1]
    if isinstance(points, Records):
        points = points.replaced(tangent=-points.columns["tangent"])
    else:
        points = tuple(replace(each, tangent=tuple(-part for part in each.tangent)) for each in points)
    events = tuple(_turned(each, last) for each in reversed(family.events))
    whole = replace(family, points=points, events=events, end=family.beginning or End("interrupted", UNFINISHED))
    return _beginning(whole, family.end)


def _turned(event: Event, last: int) -> Event:
    """An event of a curve whose last point has this index, on the curve turned round."""
    point = replace(event.point, tangent=tuple(-part for part in event.point.tangent))
    return replace(event, after=last - event.after - (event.kind != "value"), point=point)


def _joined(behind: Family, ahead: Family) -> Family:
    """One curve of two that begin at the same point: the first one turned round, and then the second one."""
    before, last = turned(behind), len(behind) - 1
    events = [each for each in before.events if each.after < last]  # one at the start is among those of the second
    events += [replace(each, after=each.after + last) for each in ahead.events]
    some, others = before.points[:-1], ahead.points
    points: Sequence[Point] = (*some, *others)
    if isinstance(some, Records) and isinstance(others, Records):
        points = Records.joined([some, others])
    return _beginning(replace(ahead, points=points, events=tuple(events)), behind.end)


def _beginning(family: Family, end: End) -> Family:
    """A family that ends so at its first point."""
    return replace(family, settings={**family.settings, BEGINNING: stated(end)})
