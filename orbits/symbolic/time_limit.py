"""How long a computation may take: what it would find later is not waited for."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from ..errors import InputError, NoOrbit

# Seconds that a search or a proof may take unless more are allowed.
LIMIT = 30.0


class TimeOver(Exception):
    """The time is over. It passes through all that takes `NoOrbit` for an answer, and ends in `time_limit`."""


# When the computation that is going on has to end, and how many seconds it may take.
_until, _seconds = float("inf"), float("inf")


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """The block may take so many seconds in all, or as long as a block around it may; then `check_time` ends it.

    Raises `InputError` for a limit that is none, and `NoOrbit` where the time is over.
    """
    global _until, _seconds
    if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not seconds > 0:
        raise InputError(f"limit = {seconds!r}; it is a number of seconds above 0")
    before, until = (_until, _seconds), time.monotonic() + seconds
    if until < _until:
        _until, _seconds = until, seconds
    try:
        yield
    except TimeOver as over:
        if before[0] <= until:  # the block around this one has to end too
            raise
        raise NoOrbit(str(over)) from None
    finally:
        _until, _seconds = before


def check_time() -> None:
    """Raise `TimeOver` where the time is over; a computation that may be long comes here often."""
    if time.monotonic() > _until:
        raise TimeOver(f"it takes more than {_seconds:g} s: allow it more by its limit")
