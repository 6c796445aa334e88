"""A function that computes for long says so through the logger "orbits": soon, and then up to once a minute."""

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

SOON, SILENCE = 8.0, 60.0  # seconds until the first message, and at most between two
LOGGER = logging.getLogger("orbits")
# The `name` of the outermost function of a thread, when it `began` and when it `spoke`, and how `far` it is.
_running = threading.local()


@contextmanager
def running(name: str) -> Iterator[None]:
    """The block is the work of a function of this name; a block within another one is part of that."""
    if getattr(_running, "name", None):
        yield
        return
    _running.name, _running.began = name, time.monotonic()
    _running.spoke, _running.far = _running.began, ""
    try:
        yield
    finally:
        _running.name = None


def beat() -> None:
    """Say that the function still computes, where it has been silent for long."""
    if not getattr(_running, "name", None):
        return
    now, before = time.monotonic(), _running.spoke - _running.began
    if now - _running.spoke > min(max(SOON, before), SILENCE):
        _running.spoke = now
        LOGGER.warning("%s has been computing for %.0f s%s", _running.name, now - _running.began, _running.far)


def now_at(how_far: str) -> None:
    """State how far the function is, for its next message."""
    if getattr(_running, "name", None):
        _running.far = f": {how_far}"


def remark(how_far: str) -> None:
    """Say how far the function is, where it has been silent for some seconds."""
    if getattr(_running, "name", None) and (now := time.monotonic()) - _running.spoke > SOON:
        _running.spoke = now
        LOGGER.warning("%s: %s", _running.name, how_far)
