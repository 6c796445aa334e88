"""One lock for everything that touches CasADi, whose expression graphs only one thread may use at a time.

CasADi counts the references to the nodes of its graphs without a lock, and lets other Python threads run meanwhile. Two
threads that build, differentiate or release graphs at the same time corrupt the memory, even with no graph in common,
since all share the constants. So every public function that reaches CasADi is `exclusive`, and threads take turns. A
program that uses CasADi itself in several threads does so `with LOCK`.
"""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property, partial, wraps
from types import MethodType
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import casadi as ca

from ..errors import InputError
from . import interrupts
from .arguments import checks_of
from .heartbeat import running

LOCK = threading.RLock()
MOST_THREADS = 256
CHECK_INTERVAL = 0.5  # seconds between checks for an interrupt while other threads compute
_P = ParamSpec("_P")
_R = TypeVar("_R")
_T = TypeVar("_T")
_sharing = threading.local()  # whether a thread is one of `in_threads`, and whether it is `apart`


def threads() -> int:
    """The number of threads that share the points of a call: the environment's ORBITS_THREADS, by default 1; also 1 in
    a thread that has its share already."""
    if getattr(_sharing, "own", False):
        return 1
    text = os.environ.get("ORBITS_THREADS") or "1"
    count = int(text) if text.isascii() and text.isdigit() and len(text) < 9 else 0
    if not 1 <= count <= MOST_THREADS:
        raise InputError(f"ORBITS_THREADS = '{text}': set it to a whole number of threads, from 1 to {MOST_THREADS}")
    return count


def exclusive(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """A function that one thread runs at a time, once the settings of the environment and its arguments were checked;
    see `arguments`."""
    check = checks_of(function)

    @wraps(function)
    def alone(*arguments: _P.args, **options: _P.kwargs) -> _R:
        threads()
        with LOCK, running(function.__qualname__) as outermost:
            if not outermost:
                return function(*arguments, **options)
            with interrupts.never_lost():
                try:
                    check(arguments, options)  # which may build the model of a machine
                    return function(*arguments, **options)
                finally:
                    _DYING.clear()

    return alone


def in_threads(function: Callable[[_T], _R], items: Sequence[_T]) -> list[_R]:
    """The results of a function of each item. The `threads` that share the items take turns with the lock, which this
    thread has, except where they are `apart`."""
    if (workers := min(threads(), len(items))) < 2:
        return [function(item) for item in items]
    from concurrent.futures import ThreadPoolExecutor

    turns, ended = threading.Condition(LOCK), []

    def one(item: _T) -> _R:
        _sharing.own = True
        with turns:
            try:
                return function(item)
            finally:
                ended.append(item)
                turns.notify_all()

    with turns, ThreadPoolExecutor(workers) as pool:
        calls = [pool.submit(one, item) for item in items]
        try:
            while not turns.wait_for(lambda: len(ended) == len(calls), CHECK_INTERVAL):
                interrupts.heed()
            return [call.result() for call in calls]
        finally:
            begun = [call for call in calls if not call.cancel()]
            turns.wait_for(lambda: len(ended) == len(begun))


@contextmanager
def apart() -> Iterator[None]:
    """Let the other threads of `in_threads` have the lock, in a block of arithmetic; graphs are built in it under the
    lock alone. Inside of functions that are `exclusive` once more, this thread keeps the lock."""
    if not getattr(_sharing, "own", False) or getattr(_sharing, "apart", False):
        yield
        return
    _sharing.apart = True
    LOCK.release()
    try:
        yield
    finally:
        LOCK.acquire()
        _sharing.apart = False


if TYPE_CHECKING:
    exclusive_property = property
else:

    class exclusive_property(cached_property):
        """A `cached_property` that one thread computes at a time.

        The lock is taken before that of `cached_property` itself, which Python has before version 3.12, since threads
        that take two locks in different orders block each other.
        """

        def __get__(self, instance: object, owner: Any = None) -> Any:
            with LOCK:
                return super().__get__(instance, owner)


_DYING: deque = deque()  # CasADi objects that nothing refers to any more, which end under the lock
MOST_DYING = 100  # of them, until the next object is made or function is called
_KINDS: tuple[Any, ...] = (ca.SX, ca.MX, ca.DM, ca.Sparsity, ca.Function, ca.FunctionBuffer, ca.Callback)


def _releasing(method: Callable[_P, _R]) -> Callable[_P, _R]:
    """A method that first releases the objects that nothing refers to, if they are many."""

    @wraps(method)
    def call(*arguments: _P.args, **options: _P.kwargs) -> _R:
        if len(_DYING) > MOST_DYING:
            with LOCK:
                _DYING.clear()
        return method(*arguments, **options)

    return call


# The garbage collector ends objects in any thread, and drops an interrupt that is raised meanwhile in Python code. So
# `__del__` is not a method: `property` turns the object into the method that appends it to those waiting for the lock.
for _kind in _KINDS:
    _kind.__del__ = property(partial(MethodType, _DYING.append))
    _kind.__init__ = _releasing(_kind.__init__)
    if _kind.__name__ == "Function":
        _kind.__call__ = _releasing(_kind.__call__)

if hasattr(os, "register_at_fork"):
    # A child process begins with the memory as it is, in which another thread must not be changing a graph.
    os.register_at_fork(before=LOCK.acquire, after_in_parent=LOCK.release, after_in_child=LOCK.release)
