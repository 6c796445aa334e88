"""Processes that compute for a page: each computes the newest task, and can be stopped at any moment.

A page is drawn by a server that never computes, so that ten of them do not disturb each other. A task requested while
a worker computes replaces the one before, so that the moves of a slider never queue; a computation that takes long is
ended by killing its process, since compiled code responds to nothing else.
"""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING, Any

from orbits import time_limit
from orbits.errors import OrbitsError

from .processes import process_context
from .results import COMPUTATIONS

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

LOST = (
    "the process that computed this has ended: there may be too little memory, or a script has called explore without"
    "  if __name__ == '__main__':"
)
# A computation that has taken this long (s) is ended when a newer task is requested.
IMPATIENT = 3.0
# Nothing takes longer (s): a visitor can stop what he waits for, and a slow computer draws its map in the end.
LONGEST_TASK = 300.0


@dataclass(frozen=True)
class Task:
    """What a worker computes: a name of `results.COMPUTATIONS` and its arguments; no two tasks have the same number."""

    name: str
    arguments: tuple[Any, ...]
    number: int = field(default_factory=count().__next__)


@dataclass(frozen=True)
class Failure:
    """Why there is no result, in words."""

    reason: str


@dataclass(frozen=True)
class Done:
    """The end of the results of a task."""


class Worker:
    """A process that computes tasks.

    deliver : called with a task and each of its results, the last of them `Done` or a `Failure`, in a thread of its
        own; a task that a newer one has replaced may have no results
    calm : whether it runs at low priority, for computations in the background
    python_machine : the machine of the page, where no statement makes it
    """

    def __init__(self, deliver: Callable[[Task, object], None], python_machine: object = None, calm: bool = False):
        self._deliver, self._machine, self._calm = deliver, python_machine, calm
        self._lock = threading.Lock()
        self._process: BaseProcess | None = None
        self._pipe: Any = None
        self._current: Task | None = None  # the newest, until its last result has come
        self._since = 0.0

    @property
    def busy(self) -> float:
        """The seconds for which it has been computing; 0.0 while it waits."""
        return time.monotonic() - self._since if self._current is not None else 0.0

    def ask(self, task: Task) -> None:
        """Request the results of a task, in place of the task before."""
        with self._lock:
            if self._current is not None and self.busy > IMPATIENT:
                self._end()
            if self._process is None or not self._process.is_alive():
                self._begin()
            if self._current is None:
                self._since = time.monotonic()
            self._current = task
            with suppress(OSError):  # of a process that has just died, which its reader reports
                self._pipe.send(task)

    def stop(self) -> None:
        """End the computation immediately; the next task begins a new process."""
        with self._lock:
            self._end()

    def _begin(self) -> None:
        context = process_context()
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=compute_tasks, args=(theirs, self._machine, self._calm), daemon=True)
        self._process.start()
        theirs.close()
        threading.Thread(target=self._read, args=(self._process, self._pipe), daemon=True).start()

    def _end(self) -> None:
        """Kill the process; called with the lock."""
        process, self._process, self._current = self._process, None, None
        if process is not None:
            process.kill()
            process.join()

    def _read(self, process: "BaseProcess", pipe: "Connection") -> None:
        """Deliver the results that the process sends, until it ends."""
        while True:
            try:
                task, result = pipe.recv()
            except (EOFError, OSError):
                break
            if self._is_awaited(process, task, result):
                self._deliver(task, result)
        pipe.close()
        with self._lock:
            lost = self._current if process is self._process else None
            if lost is not None:
                self._current = self._process = None
        if lost is not None:
            self._deliver(lost, Failure(LOST))

    def _is_awaited(self, process: "BaseProcess", task: Task, result: object) -> bool:
        """Whether a result is to be delivered; the last one completes its task."""
        last = isinstance(result, Done | Failure)
        with self._lock:
            if process is not self._process:
                return False
            if self._current is None or task.number != self._current.number:
                self._since = time.monotonic()
                return not last  # an older hop is shown too, so that a dragged slider shows the hops that it passes
            if last:
                self._current = None
            return True


class _Newest:
    """The newest task of a pipe. Its thread reads on while another computes, and ends the process as soon as the other
    end of the pipe is closed, also by the death of the server."""

    def __init__(self, pipe: "Connection"):
        self._pipe, self._came = pipe, threading.Event()
        self._task: Any = None  # the newest
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        try:
            while True:
                self._task = self._pipe.recv()
                self._came.set()
        except (EOFError, OSError):
            os._exit(0)

    def wait(self) -> Task:
        """The newest task, as soon as there is one that was not returned before."""
        self._came.wait()
        self._came.clear()
        return self._task

    @property
    def waiting(self) -> bool:
        """Whether there is a newer task."""
        return self._came.is_set()


def compute_tasks(pipe: "Connection", python_machine: object, calm: bool) -> None:
    """Compute the newest task, result by result, until there is a newer one; the work of a process."""
    if calm and hasattr(os, "nice"):
        os.nice(10)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server handles it, and ends this process
    newest = _Newest(pipe)
    while True:
        task = newest.wait()
        for result in _results_of(task, python_machine):
            pipe.send((task, result))
            if newest.waiting and not isinstance(result, Done | Failure):
                break


def _results_of(task: Task, python_machine: object) -> Iterator[object]:
    """The results of a task; an error is a `Failure` with its message."""
    try:
        with time_limit(LONGEST_TASK):
            yield from COMPUTATIONS[task.name](python_machine, *task.arguments)
    except OrbitsError as error:
        yield Failure(str(error))
    except MemoryError:
        yield Failure("there is not enough memory for this")
    except Exception as error:
        yield Failure(f"internal error, please report it: {type(error).__name__}: {error}")
    else:
        yield Done()
