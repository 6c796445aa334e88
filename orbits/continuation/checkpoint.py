"""A family while it is followed, in memory and on disk: its file has every point as soon as it is found."""

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cache
from io import FileIO
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Any, TypeAlias

from ..curves import Points
from ..errors import InputError
from ..io import check_ending, check_path, refusing, version, writing
from ..model import machine_in_words
from ..records import Records
from ..result import Progress
from ..running import TimeOver, interrupts
from .family import BEGINNING, FAMILY_ENDINGS, UNFINISHED, Family, Sealing
from .family_run import FamilyRun
from .point import End, Event, Point, json_line

_Item: TypeAlias = Points | Event | End


@cache
def versions() -> dict[str, str]:
    """The versions of Python and of the packages that compute the results."""
    return {n: version(n) for n in ("persistent-orbits", "casadi", "numpy")} | {"python": sys.version.split()[0]}


def check_output(output: str | Path | None) -> None:
    """Raise `InputError` where the file of a family cannot be written there; None means no file."""
    if output is not None:
        check_path(output, FAMILY_ENDINGS[:1])


def collect_family(
    run: FamilyRun, resume: Family | None = None, output: str | Path | None = None, progress: Progress = None
) -> Family:
    """The family that a run finds; the other arguments as in `follow`."""
    family = begun(run, resume)
    parts, events, end, before = list[Records[Point]](), [*family.events], family.end, len(family.points)
    with Lines(family, resume, output) as lines, interrupts.deferred():
        for item in _until_time_is_over(_singly(run) if progress else run):
            if isinstance(item, Points):
                parts.append(run.curve.all_in_units(item.own))
                lines.add(parts[-1])
                if progress:
                    progress((float(item.values[0]) - run.start) / (run.stop - run.start))
            elif isinstance(item, Event):
                point = run.curve.in_units(item.point)
                events.append(replace(item, after=item.after + before, point=point))
                lines.add(events[-1:])
            else:
                end = item
                lines.add([end])
    points = (*family.points, *chain.from_iterable(parts)) if before else Records.joined(parts)
    return replace(family, points=points, events=tuple(events), end=end)


def _singly(items: Iterable[_Item]) -> Iterator[_Item]:
    """The items of a run, each point alone."""
    for item in items:
        yield from (item[i : i + 1] for i in range(len(item))) if isinstance(item, Points) else [item]


def _until_time_is_over(items: Iterable[_Item]) -> Iterator[_Item]:
    """The items of a run; with an end "interrupted" when its time limit is reached."""
    try:
        for item in items:
            yield item
            interrupts.heed()
    except TimeOver as over:
        yield End("interrupted", f"{over}; resume it to continue")


def begun(run: FamilyRun, resume: Family | None = None) -> Family:
    """The family before its run: without points, or with those of the family that is resumed."""
    curve, options = run.curve, run.options
    start = resume.settings["start"] if resume else run.start
    settings: dict[str, Any] = {"start": start, "behind": run.behind, "stop": run.stop}
    settings |= {"family": run.point.family, "method": curve.method, "longest": options.longest}
    settings |= {"tune": list(resume.settings["tune"] if resume else curve.tuned)} if curve.tuned else {}
    settings |= {"at": list(options.at), "watch": list(options.watch), "stop_inadmissible": options.stop_inadmissible}
    settings |= {"multipliers": True} if options.multipliers else {}
    settings |= curve.own_settings
    settings |= {BEGINNING: resume.settings[BEGINNING]} if resume and BEGINNING in resume.settings else {}
    machine = machine_in_words(curve.machine) if resume is None else resume.machine
    # The run solves the last point of a resumed family again, and finds the events after it again. An event at a
    # requested value is the last point itself and stays.
    points, earlier = (resume.points[:-1], resume.events) if resume else ((), ())
    events = tuple(event for event in earlier if event.after < len(points) + (event.kind == "value"))
    end = End("interrupted", UNFINISHED)
    return Family(curve.along, machine, points, events, end, settings, dict(versions()), curve.machine)


class Lines:
    """The file of a family that grows, with the points found so far; it has no effect without an `output`.

    Where the output exists and is not the file that is resumed, the lines are written next to it, to NAME.part.jsonl,
    which replaces it once the family has ended: an interrupt or a full disk leaves both.
    """

    def __init__(self, family: Family, resume: Family | None, output: str | Path | None):
        self.file: FileIO | None = None
        if output is None:
            return
        self.whole, self.sealing = check_ending(output, FAMILY_ENDINGS[:1]), Sealing()
        is_other = os.path.isfile(self.whole) and not _is_in(resume, self.whole)
        self.path = self.whole.with_suffix(f".part{self.whole.suffix}") if is_other else self.whole
        *lines, _ = family.records()  # all but the end
        with writing("family", self.path) as target:
            target.write_text("".join(map(self.sealing.line, lines)), encoding="utf-8")
        with refusing("family", self.path):
            self.file = FileIO(self.path, "ab")  # without a buffer, which would be written again as it is closed

    def add(self, items: Iterable[Point | Event | End]) -> None:
        """Write further records; they are in the file when this method returns."""
        if self.file is None:
            return
        for item in items:
            with refusing("family", self.path):
                rest = self.sealing.line(json_line(item)).encode()
                while rest:
                    rest = rest[self.file.write(rest) :]

    def __enter__(self) -> "Lines":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        if self.file is None:
            return
        with refusing("family", self.path):
            self.file.close()
            if kind is None and self.path != self.whole:
                with writing("family", self.whole) as target:
                    os.replace(self.path, target)
        if isinstance(error, KeyboardInterrupt) and self.path != self.whole:
            found = f"what was found is in {self.path}, and {self.whole} is unchanged"
            raise KeyboardInterrupt(f"{found}: continue from there with resume, or --resume in the command") from None


def _is_in(resume: Family | None, path: Path) -> bool:
    """Whether a file has no points besides those of the family that is resumed."""
    with suppress(InputError):
        points = Family.load(path).points if resume else ()
        return resume is not None and points == resume.points[: len(points)]
    return False
