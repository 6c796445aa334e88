"""Keyboard interrupts, noted while CasADi and Ipopt compute, which would swallow them, and raised where it is safe."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker

from . import heartbeat
from .time_limit import check_time

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
        _raise_noted()


@contextmanager
def not_for_children() -> Iterator[None]:
    """The processes that this block starts never heed interrupts: the process that starts them does, and ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # which lets interrupts through again when it starts
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])  # which new processes inherit
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def heed() -> None:
    """Raise the interrupt that was noted, if any, and `TimeOver` where the time is over. Long computations come here
    often, and say here that they go on."""
    _raise_noted()
    check_time()
    heartbeat.beat()


def _raise_noted() -> None:
    if _noted.is_set():
        _noted.clear()
        raise KeyboardInterrupt
