"""Keyboard interrupts: noted while CasADi and Ipopt compute, which would swallow them, and raised where it is safe.

CasADi also calls Python where it converts arrays. It replaces an error raised there by an error of its own, or drops
it: an interrupted conversion may return None. The garbage collector drops errors raised while it runs. So an interrupt
is noted wherever a public function computes, and raised again if it was lost.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from . import heartbeat
from .time_limit import check_time

# The signals that were noted. An event of `threading` has a lock, which an interrupt within the event leaves locked.
_noted: set[int] = set()


def pending() -> bool:
    """Whether an interrupt has been noted."""
    return bool(_noted)


def _note(number: int, frame: FrameType | None) -> None:
    _noted.add(number)


def _note_and_raise(number: int, frame: FrameType | None) -> None:
    _noted.add(number)
    raise KeyboardInterrupt


def _handled_by(*handlers: object) -> bool:
    """Whether this is the main thread, and interrupts are handled by one of these."""
    return threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) in handlers


@contextmanager
def never_lost() -> Iterator[None]:
    """Raise interrupts at once; one that is lost in the block is raised by `heed` or at the end of the block, in place
    of the error that came of it. Nothing changes where another handler is installed or outside the main thread."""
    if not _handled_by(signal.default_int_handler):
        yield
        return
    _noted.clear()
    try:
        signal.signal(signal.SIGINT, _note_and_raise)
        yield
    except Exception:
        _raise_noted()
        raise
    else:
        _raise_noted()
    finally:
        try:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        finally:  # an interrupt just before is raised by that call, which changes nothing then
            signal.signal(signal.SIGINT, signal.default_int_handler)
            _noted.clear()


@contextmanager
def deferred() -> Iterator[None]:
    """Note interrupts until `heed` or the end of the block; nothing changes where another handler is installed or
    outside the main thread."""
    if not _handled_by(signal.default_int_handler, _note_and_raise):
        yield
        return
    before = signal.signal(signal.SIGINT, _note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        _raise_noted()


@contextmanager
def not_for_children() -> Iterator[None]:
    """The processes that this block starts never heed interrupts: the process that starts them does, and ends them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # which lets interrupts through again when it starts
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])  # which new processes inherit
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def heed() -> None:
    """Raise the interrupt that was noted, if any, and `TimeOver` where the time is over. Long computations come here
    often, and say here that they continue."""
    _raise_noted()
    check_time()
    heartbeat.beat()


def _raise_noted() -> None:
    if _noted:
        _noted.clear()
        raise KeyboardInterrupt
