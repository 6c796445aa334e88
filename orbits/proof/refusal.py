"""What is said where a proof does not succeed, or takes too long; it is no error but a result."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


class Unproved(Exception):
    """Something could not be proved; the message says what and why. It never leaves the package."""


class TooLong(Unproved):
    """The time that a proof may take is over."""


# When the proof that is going on has to end, and how many seconds it may take.
_until, _seconds = float("inf"), float("inf")


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Proofs in this block may take so many seconds in all; after that `check_time` raises `TooLong`."""
    global _until, _seconds
    before = _until, _seconds
    _until, _seconds = time.monotonic() + seconds, seconds
    try:
        yield
    finally:
        _until, _seconds = before


def check_time() -> None:
    """Raise `TooLong` where the time is over."""
    if time.monotonic() > _until:
        raise TooLong(f"it takes more than {_seconds:g} s: allow it more by limit=")
