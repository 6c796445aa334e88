"""A family as it grows, in memory and on disk: every point is in its file as soon as it is found."""

import os
import platform
import tempfile
from dataclasses import replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TextIO

from ..errors import InputError
from ..io import check_ending
from .curve import CurvePoint
from .family import ENDINGS, End, Event, Family, Point, json_line
from .tracer import Tracer


@cache
def versions() -> dict[str, str]:
    """Of the packages that compute."""
    found = {name: version(name) for name in ("persistent-orbits", "casadi", "numpy")}
    return {**found, "python": platform.python_version()}


class Checkpoint:
    """The family that a run finds, added to item by item; used in a `with` block, which closes its file."""

    def __init__(self, tracer: Tracer, resume: Family | None, output: str | Path | None):
        options = tracer.options
        settings = {
            "start": tracer.start,
            "behind": tracer.behind,
            "stop": tracer.stop,
            "family": tracer.first.point.family,
            "method": tracer.curve.method,
            "longest": options.longest,
            "at": list(options.at),
            "watch": list(options.watch),
            "stop_inadmissible": options.stop_inadmissible,
        }
        machine = tracer.curve.machine.describe() if resume is None else resume.machine
        # The run solves the last point of a resumed family again, and finds the events after it again. An event that
        # was asked for is the last point itself and stays.
        points, earlier = (resume.points[:-1], resume.events) if resume else ((), ())
        events = tuple(event for event in earlier if event.after < len(points) + (event.kind == "asked"))
        end = End("interrupted", "resume it to go on")
        self.family = Family(tracer.curve.along, machine, points, events, end, settings, dict(versions()))
        self.points, self.events, self.end = list(points), list(events), end
        self.offset = len(points)
        self.file: TextIO | None = None
        if output is not None:
            self.path = check_ending(output, ENDINGS[:2])
            self._begin()

    def _begin(self) -> None:
        """Write what there is already to a new file and put it in the output's place, which may be what is resumed."""
        *lines, _ = self.family.records()  # all but the end
        try:
            with tempfile.NamedTemporaryFile("w", encoding="utf-8", dir=self.path.parent, delete=False) as file:
                file.writelines(line + "\n" for line in lines)
            os.replace(file.name, self.path)
            self.file = open(self.path, "a", encoding="utf-8")  # noqa: SIM115 - open while the family grows
        except OSError as error:
            raise self._not_written(error) from None

    def _not_written(self, error: OSError) -> InputError:
        return InputError(f"the family cannot be written to {self.path}: {error}")

    def __enter__(self) -> "Checkpoint":
        return self

    def __exit__(self, *_: object) -> None:
        if self.file:
            self.file.close()

    def add(self, item: CurvePoint | Event | End) -> None:
        """Add the next item of the run, in memory and in the file."""
        line: Point | Event | End
        if isinstance(item, CurvePoint):
            line = item.point
            self.points.append(line)
        elif isinstance(item, Event):
            line = replace(item, after=item.after + self.offset)
            self.events.append(line)
        else:
            line = self.end = item
        if self.file:
            try:
                self.file.write(json_line(line) + "\n")
                self.file.flush()
            except OSError as error:
                raise self._not_written(error) from None

    def whole(self) -> Family:
        """The family, once the run has ended."""
        return replace(self.family, points=tuple(self.points), events=tuple(self.events), end=self.end)
