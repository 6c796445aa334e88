"""A family as it grows, in memory and on disk: every point is in its file as soon as it is found."""

import sys
from contextlib import nullcontext
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from ..io import check_ending, refusing, version, writing
from ..model.machine import machine_in_words
from ..periodic.find import Progress
from ..symbolic import interrupts
from .curve import CurvePoint
from .family import ENDINGS, UNFINISHED, Family, Sealing
from .point import End, Event, Point, json_line
from .tracer import Tracer


@cache
def versions() -> dict[str, str]:
    """The versions of the packages that compute."""
    return {n: version(n) for n in ("persistent-orbits", "casadi", "numpy")} | {"python": sys.version.split()[0]}


def collect_family(
    tracer: Tracer, resume: Family | None = None, output: str | Path | None = None, progress: Progress = None
) -> Family:
    """The family that a run finds; the others as in `follow`."""
    family = _begun(tracer, resume)
    points, events, end, before = [*family.points], [*family.events], family.end, len(family.points)
    file, sealing = _opened(family, output)
    with file, interrupts.deferred():
        for item in tracer:
            line: Point | Event | End
            if isinstance(item, CurvePoint):
                points.append(line := tracer.curve.in_units(item.point))
            elif isinstance(item, Event):
                point = tracer.curve.in_units(item.point)
                events.append(line := replace(item, after=item.after + before, point=point))
            else:
                line = end = item
            if output is not None:
                with refusing("family", output):
                    print(sealing.line(json_line(line)), end="", file=file, flush=True)
            if progress and isinstance(item, CurvePoint):
                progress((item.value - tracer.start) / (tracer.stop - tracer.start))
            interrupts.heed()
    return replace(family, points=tuple(points), events=tuple(events), end=end)


def _begun(tracer: Tracer, resume: Family | None) -> Family:
    """What there is of a family before its run."""
    curve, options = tracer.curve, tracer.options
    settings = {"start": tracer.start, "behind": tracer.behind, "stop": tracer.stop}
    settings |= {"family": tracer.first.point.family, "method": curve.method, "longest": options.longest}
    settings |= {"at": list(options.at), "watch": list(options.watch), "stop_inadmissible": options.stop_inadmissible}
    machine = machine_in_words(curve.machine) if resume is None else resume.machine
    # The run solves the last point of a resumed family again, and finds the events after it again. An event that was
    # asked for is the last point itself and stays.
    points, earlier = (resume.points[:-1], resume.events) if resume else ((), ())
    events = tuple(event for event in earlier if event.after < len(points) + (event.kind == "asked"))
    end = End("interrupted", UNFINISHED)
    return Family(curve.along, machine, points, events, end, settings, dict(versions()), curve.machine)


def _opened(family: Family, output: str | Path | None) -> tuple[Any, Sealing]:
    """A new file with what there is already, in the place of `output`, which may be the file that is resumed; and the
    digests of its lines."""
    sealing = Sealing()
    if output is None:
        return nullcontext(), sealing
    path = check_ending(output, ENDINGS[:2])
    *lines, _ = family.records()  # all but the end
    with writing("family", path) as target:
        target.write_text("".join(map(sealing.line, lines)), encoding="utf-8")
    with refusing("family", path):
        return open(path, "a", encoding="utf-8"), sealing
