"""A function that computes for minutes says so once a minute, through the logger "orbits"."""

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

SILENCE = 60.0  # seconds between two messages
SOON_SAID = 10.0  # seconds after which a function that can say how far it is does so
LOGGER = logging.getLogger("orbits")
_running = threading.local()  # the `name` of the outermost function of a thread, when it `began` and when it `spoke`


@contextmanager
def running(name: str) -> Iterator[None]:
    """The block is the work of a function of this name; a block within another one is part of that."""
    if getattr(_running, "name", None):
        yield
        return
    _running.name, _running.began = name, time.monotonic()
    _running.spoke = _running.began
    try:
        yield
    finally:
        _running.name = None


def beat() -> None:
    """Say that the function still computes, where it has been silent for long."""
    if getattr(_running, "name", None) and (now := time.monotonic()) - _running.spoke > SILENCE:
        _running.spoke = now
        LOGGER.warning("%s has been computing for %.0f s", _running.name, now - _running.began)


def remark(how_far: str) -> None:
    """Say how far the function is, where it has been silent for some seconds."""
    if getattr(_running, "name", None) and (now := time.monotonic()) - _running.spoke > SOON_SAID:
        _running.spoke = now
        LOGGER.warning("%s: %s", _running.name, how_far)
