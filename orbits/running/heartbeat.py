"""A function that computes for a long time logs this to the logger "orbits", so that it is never silent for ten
seconds."""

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

SILENCE = 8.0  # seconds until the first message and between two, less than ten by what is computed between two calls
LOGGER = logging.getLogger("orbits")
# The `name` of the outermost function of a thread, when it `began` and when it `spoke`, and how `far` it is.
_running = threading.local()


@contextmanager
def running(name: str) -> Iterator[bool]:
    """The block is the work of a function of this name, or part of that of the block that it is in: whether it is the
    outermost one."""
    if getattr(_running, "name", None):
        yield False
        return
    try:  # where an interrupt comes already here, the name is removed too
        _running.name, _running.began = name, time.monotonic()
        _running.spoke, _running.far = _running.began, ""
        yield True
    finally:
        _running.name = None


def beat() -> None:
    """Say that the function still computes, where it has been silent for long."""
    if getattr(_running, "name", None) and (now := time.monotonic()) - _running.spoke > SILENCE:
        _running.spoke = now
        LOGGER.warning("%s has been computing for %.0f s%s", _running.name, now - _running.began, _running.far)


def now_at(how_far: str) -> None:
    """State how far the function is, for its next message."""
    if getattr(_running, "name", None):
        _running.far = f": {how_far}"


def remark(how_far: str) -> None:
    """Say how far the function is, where it has been silent for some seconds."""
    if getattr(_running, "name", None) and (now := time.monotonic()) - _running.spoke > SILENCE:
        _running.spoke = now
        LOGGER.warning("%s: %s", _running.name, how_far)
