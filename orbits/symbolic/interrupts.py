"""Keyboard interrupts, noted while CasADi and Ipopt compute, which would swallow them, and raised where it is safe."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from . import heartbeat

_noted = threading.Event()
pending = _noted.is_set  # whether an interrupt has been noted


@contextmanager
def deferred() -> Iterator[None]:
    """Note interrupts until `heed` or the end of the block; nothing changes where another handler is installed or
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
        heed()


def heed() -> None:
    """Raise the interrupt that was noted, if any. Long computations come here often, and say here that they go on."""
    if _noted.is_set():
        _noted.clear()
        raise KeyboardInterrupt
    heartbeat.beat()
