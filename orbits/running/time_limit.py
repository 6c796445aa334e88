"""The time that a computation may take; results that would come later are not waited for."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from ..errors import InputError, NoOrbit

# Seconds that a search or a proof may take unless more are allowed.
LIMIT = 30.0
# More seconds than any computation takes: no limit.
FOREVER = 1e15


class TimeOver(Exception):
    """The time is over. It passes through all that takes `NoOrbit` for a result, and ends in `time_limit`."""

    def reached(self, place: str) -> "TimeOver":
        """The same with the place that a computation had reached, in words, in place of that of a part of it."""
        return TimeOver(self.args[0], place)

    def __str__(self) -> str:
        return "; ".join(self.args)


class _Limit(threading.local):
    """When the computation of a thread has to end, and how many seconds it may take."""

    until = seconds = float("inf")


_limit = _Limit()


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Limit the time of all computations in the block to `seconds`, or to the limit of a block around it.

    seconds : time limit; None for 30, or in another such block for the limit of that one

    Raises `NoOrbit` when the limit is reached, except that `follow` returns its family as far as it was followed;
    raises `InputError` for an invalid number of seconds.

    >>> from orbits import follow, time_limit
    >>> from problems import Hopper
    >>> with time_limit(60.0):
    ...     family = follow(Hopper("cubic", rest_length=9.0), "beta", 0.3, start=0.2)
    """
    before = _limit.until, _limit.seconds
    if seconds is None:
        seconds = LIMIT if before[0] == float("inf") else float("inf")
    if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not seconds > 0:
        raise InputError(f"limit = {seconds!r}; it is a number of seconds above 0")
    until = time.monotonic() + (seconds if seconds < FOREVER else float("inf"))
    if until < before[0]:
        _limit.until, _limit.seconds = until, seconds
    try:
        yield
    except TimeOver as over:
        if before[0] <= until:  # the block around this one has to end too
            raise
        raise NoOrbit(str(over)) from None
    finally:
        _limit.until, _limit.seconds = before


@contextmanager
def time_to_finish() -> Iterator[None]:
    """No limit for what has to be done after a limit is reached, to hand back what was found; it is short."""
    before, _limit.until = _limit.until, float("inf")
    try:
        yield
    finally:
        _limit.until = before


def time_left() -> float:
    """The seconds until the time is over, infinite without a limit."""
    return _limit.until - time.monotonic()


def check_time() -> None:
    """Raise `TimeOver` where the time is over; a computation that may be long comes here often."""
    if time.monotonic() > _limit.until:
        more = "limit=..., with time_limit(...), or --limit in the command"
        raise TimeOver(f"it takes more than {_limit.seconds:g} s: allow it more by its limit ({more})")
