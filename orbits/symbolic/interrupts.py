"""What long computations look after now and then: keyboard interrupts, and that they are not silent for too long.

An interrupt is noted while CasADi and Ipopt compute, which would swallow it, and raised where it is safe.
"""

import logging
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

_noted = threading.Event()
pending = _noted.is_set  # whether an interrupt has been noted
# After so many seconds, and again after as many, a function that still computes says so.
SILENCE = 60.0
_log = logging.getLogger("orbits")
_running = threading.local()  # the `name` of the outermost function, when it `began` and when it `spoke` last


@contextmanager
def deferred() -> Iterator[None]:
    """Note interrupts until `check` or the end of the block; nothing changes where another handler is installed or
    outside the main thread."""
    inside = threading.current_thread() is threading.main_thread()
    if not inside or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    _noted.clear()
    signal.signal(signal.SIGINT, lambda *_: _noted.set())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        check()


def check() -> None:
    """Raise the interrupt that was noted, if any; and say, once a minute, that the function still computes."""
    if _noted.is_set():
        _noted.clear()
        raise KeyboardInterrupt
    if getattr(_running, "name", None) and (now := time.monotonic()) - _running.spoke > SILENCE:
        _running.spoke = now
        _log.warning("%s has been computing for %.0f s; Ctrl+C ends it", _running.name, now - _running.began)


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
