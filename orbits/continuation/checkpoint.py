"""A family as it grows, in memory and on disk: every point is in its file as soon as it is found."""

import os
import platform
import tempfile
from dataclasses import replace
from functools import cache
from importlib.metadata import version

from ..errors import InputError
from ..io import check_ending
from .corrector import CurvePoint
from .family import ENDINGS, Event, Family, json_line
from .tracer import Tracer


@cache
def versions() -> dict[str, str]:
    """Of what computes."""
    found = {name: version(name) for name in ("persistent-orbits", "casadi", "numpy")}
    return {**found, "python": platform.python_version()}


class Checkpoint:
    """The family that a walk finds, added to item by item; used in a `with` block, which closes its file."""

    def __init__(self, walk: Tracer, resume: Family | None, output):
        options = walk.options
        settings = {
            "start": walk.start,
            "behind": walk.behind,
            "stop": walk.stop,
            "family": walk.first.point.family,
            "method": walk.curve.method,
            "longest": options.longest,
            "at": list(options.at),
            "watch": list(options.watch),
            "stop_inadmissible": options.stop_inadmissible,
        }
        machine = walk.curve.machine.describe() if resume is None else resume.machine
        # A resumed family has its last point from the walk, solved again.
        points = resume.points[:-1] if resume else ()
        kept = resume.events if resume else ()  # but what comes after the last point, which is not it itself
        events = tuple(event for event in kept if event.after < len(points) + (event.kind == "asked"))
        self.family = Family(walk.curve.along, machine, points, events, None, settings, dict(versions()))
        self.points, self.events, self.end = list(points), list(events), None
        self.offset = len(points)
        self.file = None
        if output is not None:
            self.path = check_ending(output, ENDINGS[:2])
            self._begin()

    def _begin(self):
        """Write what there is already beside the file and put it in its place: it may be the one that is resumed."""
        try:
            with tempfile.NamedTemporaryFile("w", encoding="utf-8", dir=self.path.parent, delete=False) as file:
                file.writelines(line + "\n" for line in self.family.records())
            os.replace(file.name, self.path)
            self.file = open(self.path, "a", encoding="utf-8")  # noqa: SIM115 - open while the family grows
        except OSError as error:
            raise InputError(f"the family cannot be written to {self.path}: {error}") from None

    def __enter__(self) -> "Checkpoint":
        return self

    def __exit__(self, *_):
        if self.file:
            self.file.close()

    def add(self, item):
        if isinstance(item, CurvePoint):
            self.points.append(item.point)
            kept = item.point
        elif isinstance(item, Event):
            kept = replace(item, after=item.after + self.offset)
            self.events.append(kept)
        else:
            kept = self.end = item
        if self.file:
            try:
                self.file.write(json_line(kept) + "\n")
                self.file.flush()
            except OSError as error:
                raise InputError(f"the family cannot be written to {self.path}: {error}") from None

    def whole(self) -> Family:
        """The family, once the walk has ended."""
        return replace(self.family, points=tuple(self.points), events=tuple(self.events), end=self.end)
