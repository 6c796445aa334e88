"""The time that a computation may take.

A limit that the user states is wall time, which the user waits. The default limit counts the processor time of the
computing thread, so that other work of the computer does not decide what a search finds.
"""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from ..errors import InputError, NoOrbit

# Seconds of processor time that a search or a proof may take unless another limit is stated.
LIMIT = 30.0
# Longer than any computation takes.
FOREVER = 1e15


class TimeOver(Exception):
    """The time is over. It passes through all that takes `NoOrbit` for a result, and ends in `time_limit`."""

    def reached(self, place: str) -> "TimeOver":
        """This end with the place that a computation had reached, in words, in place of that of a part of it."""
        return TimeOver(self.args[0], place)

    def __str__(self) -> str:
        return "; ".join(self.args)


class _Deadline(NamedTuple):
    """When a computation has to end, by the clock of this name in `time`, and the limit in words."""

    until: float
    clock: str
    text: str

    def left(self) -> float:
        """The seconds until then."""
        return self.until - _now(self.clock)


class _Limits(threading.local):
    """The deadlines of a thread's computation, those of outer blocks first, and the `earliest` time of the clock
    `monotonic` at which one may pass. To read a clock of processor time takes ten times as long."""

    deadlines: tuple[_Deadline, ...] = ()
    earliest: float = float("-inf")

    def become(self, deadlines: tuple[_Deadline, ...]) -> None:
        self.deadlines, self.earliest = deadlines, float("-inf")


_limits = _Limits()


def _now(clock: str) -> float:
    """The time of a clock of `time`."""
    return getattr(time, clock)()


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Limit the time of all computations in the block to `seconds`, or to the limit of a block around it.

    seconds : time limit; None for 30 s of processor time, or for the limit of a block around it

    When the limit is reached, `follow` returns its family so far; other functions raise `NoOrbit`. Raises `InputError`
    for an invalid number of seconds.

    >>> from orbits import follow, time_limit
    >>> from problems import Hopper
    >>> with time_limit(60.0):
    ...     family = follow(Hopper("cubic", rest_length=9.0), "beta", 0.3, start=0.2)
    """
    if seconds is None:
        with default_limit(LIMIT):
            yield
        return
    if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not seconds > 0:
        raise InputError(f"limit = {seconds!r}; it must be a number of seconds above 0")
    seconds = min(seconds, FOREVER)
    with _until(seconds, "monotonic", f"{seconds:g} s"):
        yield


@contextmanager
def default_limit(seconds: float) -> Iterator[None]:
    """Limit the processor time of all computations in the block, where no block around it has a limit."""
    if _limits.deadlines:
        yield
    else:
        with _until(seconds, "thread_time", f"{seconds:g} s of processor time"):
            yield


@contextmanager
def _until(seconds: float, clock: str, text: str) -> Iterator[None]:
    """A block that ends after some seconds of a clock, or with the block around it."""
    before = _limits.deadlines
    _limits.become((*before, _Deadline(_now(clock) + seconds, clock, text)))
    try:
        yield
    except TimeOver as over:
        if _first_over(before):  # the block around this one has to end too
            raise
        raise NoOrbit(str(over)) from None
    finally:
        _limits.become(before)


@contextmanager
def part_limit(seconds: float) -> Iterator[None]:
    """Limit the processor time of one part of a search, which raises `NoOrbit` then."""
    with _until(seconds, "thread_time", f"{seconds:g} s of processor time"):
        yield


@contextmanager
def time_to_finish() -> Iterator[None]:
    """No limit for what has to be done after a limit is reached, to hand back what was found; it is short."""
    before = _limits.deadlines
    _limits.become(())
    try:
        yield
    finally:
        _limits.become(before)


def time_left() -> float:
    """The seconds until the time is over, infinite without a limit."""
    return min((deadline.left() for deadline in _limits.deadlines), default=float("inf"))


def check_time() -> None:
    """Raise `TimeOver` where the time is over; a computation that may be long comes here often."""
    now = _now("monotonic")
    if now < _limits.earliest:
        return
    if over := _first_over(_limits.deadlines):
        more = "with time_limit(...), --limit in the command, or limit=... where a function has it"
        raise TimeOver(f"it takes more than {over.text}: raise the limit ({more})")
    _limits.earliest = now + time_left()  # no clock of processor time is faster


def _first_over(deadlines: tuple[_Deadline, ...]) -> _Deadline | None:
    """The first of some deadlines that has passed, if any."""
    return next((deadline for deadline in deadlines if deadline.left() < 0), None)
