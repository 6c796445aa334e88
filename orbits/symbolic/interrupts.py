"""Keyboard interrupts that CasADi and Ipopt would swallow: noted while they compute, raised where it is safe.

An exception that a signal raises inside their evaluations counts as a failed evaluation, or is cleared by the language
bindings without a word, and the program goes on.
"""

import signal
import threading
from contextlib import contextmanager

_noted = threading.Event()


@contextmanager
def deferred():
    """Note interrupts instead of raising them, until `check` or the end of the block.

    Outside the main thread, or where somebody else handles the signal, nothing is changed.
    """
    ours = (
        threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )
    if not ours:
        yield
        return
    _noted.clear()
    signal.signal(signal.SIGINT, lambda *_: _noted.set())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        check()


def pending() -> bool:
    """Whether an interrupt has been noted."""
    return _noted.is_set()


def check():
    """Raise the interrupt that was noted, if any."""
    if _noted.is_set():
        _noted.clear()
        raise KeyboardInterrupt
