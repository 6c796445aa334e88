"""The line that shows the progress of a sweep, on a terminal and in notebooks."""

import sys
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from ..errors import true_or_false
from ..running import check_report, heartbeat

# Seconds between two lines.
PAUSE = 0.2


class SweepProgress(NamedTuple):
    """The progress of a sweep.

    done, whole : number of finished members, and of all members
    statuses : number of members of each status
    seconds, left : time in seconds since the sweep began, and an estimate of the remaining time
    before : number of members that were finished before it began
    """

    done: int
    whole: int
    statuses: Mapping[str, int]
    seconds: float
    left: float
    before: int = 0


def on_screen(progress: Callable[[Any], None] | bool | None) -> Callable[[Any], None]:
    """The function to call with the progress of a sweep: the user's, one that prints a line, one that states how far
    the sweep is for the messages of the logger "orbits", or one without effect."""
    if callable(progress):
        check_report("progress", progress)
        return progress
    if progress is not None and not true_or_false("progress", progress):
        return lambda state: None
    if progress is None and not (sys.stderr.isatty() or "ipykernel" in sys.modules):
        return lambda state: heartbeat.now_at(_in_words(state))
    last, width = 0.0, 0

    def show(state: Any) -> None:
        nonlocal last, width
        now, ended = time.monotonic(), state.done == state.whole
        if now - last < PAUSE and not ended:
            return
        line = _in_words(state)
        sys.stderr.write("\r" + line.ljust(width) + ("\n" if ended else ""))
        sys.stderr.flush()
        last, width = now, len(line)

    return show


def _in_words(state: Any) -> str:
    """A progress in one line."""
    rate = (state.done - state.before) / state.seconds if state.seconds else 0.0
    said = ", ".join(f"{number} {status}" for status, number in sorted(state.statuses.items()))
    left = "" if state.done == state.whole else f", {_duration(state.left)} left"
    return f"{state.done} of {state.whole} members in {_duration(state.seconds)} ({rate:.0f}/s){left}: {said}"


def pace(done: int, whole: int, seconds: float) -> str:
    """How many members were done in some seconds, and how long the others would take, in words."""
    if not done:
        return f"none of {whole} members was done"
    left = _duration((whole - done) * seconds / done)
    return f"{done} of {whole} members were done in {_duration(seconds)}; the others would take about {left}"


def _duration(seconds: float) -> str:
    """A time in words: seconds, or minutes, or hours."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
