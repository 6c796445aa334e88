"""Processes that compute for the pages: each computes the newest task, and can be stopped at any moment.

A page is drawn by a server that never computes, and the tabs share a few processes. A task requested while
a worker computes replaces the one before, so that the moves of a slider never queue; a computation that takes long is
ended by killing its process, since compiled code responds to nothing else.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING, Any, NamedTuple, cast

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


class WorkerOptions(NamedTuple):
    """The processes that compute for a page."""

    for_hops: int = 4  # processes, at most
    calm: int = 2  # processes for what is computed in the background, at most
    memory: int = 160 << 20  # bytes of a process from which on it is replaced: all of them have less than 1 GB
    impatient: float = 3.0  # seconds after which a computation is ended when a newer task is requested
    # Seconds of any computation: a visitor can stop what he waits for, and a slow computer draws its map in the end.
    longest: float = 300.0


WORKERS = WorkerOptions()


@dataclass(frozen=True)
class Task:
    """What a worker computes: a name of `results.COMPUTATIONS` and its arguments; no two tasks have the same number."""

    name: str
    arguments: tuple[Any, ...]
    number: int = field(default_factory=count().__next__)


@dataclass(frozen=True)
class Failure:
    """Why there is no result, in words, and the memory of the process in bytes."""

    reason: str
    memory: int = 0


@dataclass(frozen=True)
class Done:
    """The end of the results of a task, and the memory of the process in bytes."""

    memory: int = 0


class Pool:
    """The processes that compute for the pages of all tabs: a few, however many tabs are open.

    python_machine : the machine of the pages, where no statement makes it
    size : the largest number of processes
    calm : whether they run at low priority, for computations in the background

    A process computes the tasks of one `Worker` at a time, and workers take turns. There are never more processes than
    workers, and none is left once all pages are closed.
    """

    def __init__(self, python_machine: object = None, size: int = WORKERS.for_hops, calm: bool = False):
        self.lock = threading.Lock()
        self._arguments, self._size = (python_machine, calm), size
        self._open, self._waiting = set[Worker](), list[Worker]()
        self._processes = list[_Process]()

    def enter(self, worker: "Worker") -> None:
        """Queue a worker, and begin its task where a process is free; called with the lock."""
        self._open.add(worker)
        if worker not in self._waiting:
            self._waiting.append(worker)
        self._serve()

    def leave(self, worker: "Worker", for_good: bool = False) -> None:
        """End what is computed for a worker; called with the lock."""
        if worker in self._waiting:
            self._waiting.remove(worker)
        if (process := worker.process) is not None:
            worker.process = None
            self._end(process)
        if for_good:
            self._open.discard(worker)
            for idle in [each for each in self._processes if each.worker is None]:
                if len(self._processes) > len(self._open):
                    self._end(idle)
        self._serve()

    def free(self, process: "_Process", memory: int) -> None:
        """Take back a process that has completed its task with so much memory in bytes; called with the lock."""
        process.worker = None
        if memory > WORKERS.memory or len(self._processes) > len(self._open):
            self._end(process)
        self._serve()

    def drop(self, process: "_Process") -> None:
        """Forget a process that has ended; called with the lock."""
        if process in self._processes:
            self._processes.remove(process)
            self._serve()

    def _end(self, process: "_Process") -> None:
        self._processes.remove(process)
        process.end()

    def _serve(self) -> None:
        """Give the free processes to the workers that wait, first come, first served."""
        while self._waiting:
            idle = next((each for each in self._processes if each.worker is None), None)
            if idle is None and len(self._processes) >= min(self._size, len(self._open)):
                return
            if idle is None:
                idle = _Process(self, *self._arguments)
                self._processes.append(idle)
            worker = self._waiting.pop(0)
            idle.worker, worker.process = worker, idle
            worker.begin()


class Pools(NamedTuple):
    """The processes that compute hops, and the processes that compute families and maps in the background."""

    urgent: Pool
    calm: Pool


def pools_of(python_machine: object = None) -> Pools:
    """The pools of pages; `python_machine` is their machine, where no statement makes it."""
    return Pools(Pool(python_machine), Pool(python_machine, WORKERS.calm, calm=True))


class _Process:
    """A process of a pool, with the worker for which it computes; None while it is idle."""

    def __init__(self, pool: Pool, python_machine: object, calm: bool):
        context = process_context()
        self.pool, self.worker = pool, cast("Worker | None", None)
        self.pipe, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(
            target=compute_tasks, args=(theirs, python_machine, calm), daemon=True
        )
        self.process.start()
        theirs.close()
        threading.Thread(target=self._read, daemon=True).start()

    def send(self, task: Task) -> None:
        """Send a task, in place of the one before."""
        with suppress(OSError):  # of a process that has just died, which its reader reports
            self.pipe.send(task)

    def end(self) -> None:
        """Kill the process."""
        self.worker = None
        self.process.kill()
        self.process.join()

    def _read(self) -> None:
        """Deliver the results that the process sends, until it ends."""
        while True:
            try:
                task, result = self.pipe.recv()
            except (EOFError, OSError):
                break
            with self.pool.lock:
                worker = self.worker
                awaited = worker is not None and worker.awaits(task, result)
                if worker is not None and worker.process is None:  # it has its last result
                    self.pool.free(self, result.memory if isinstance(result, Done | Failure) else 0)
            if worker is not None and awaited:
                worker.deliver(task, result)
        self.pipe.close()
        with self.pool.lock:
            worker, lost = self.worker, None
            if worker is not None:
                lost = worker.lose()
            self.pool.drop(self)
        if worker is not None and lost is not None:
            worker.deliver(lost, Failure(LOST))


class Worker:
    """What computes one kind of tasks of one page: the newest of them, by a process of a pool.

    deliver : called with a task and each of its results, the last of them `Done` or a `Failure`, in a thread of its
        own; a task that a newer one has replaced may have no results
    """

    def __init__(self, deliver: Callable[[Task, object], None], pool: Pool):
        self.deliver, self._pool = deliver, pool
        self.process: _Process | None = None  # that which computes now; None while it waits for one
        self._current: Task | None = None  # the newest, until its last result has come
        self._since = 0.0

    @property
    def busy(self) -> float:
        """The seconds for which it has been computing or waiting for a process; 0.0 without a task."""
        return time.monotonic() - self._since if self._current is not None else 0.0

    def ask(self, task: Task) -> None:
        """Request the results of a task, in place of the task before."""
        with self._pool.lock:
            if self.process is not None and self.busy > WORKERS.impatient:
                self._pool.leave(self)
                self._current = None
            if self._current is None:
                self._since = time.monotonic()
            self._current = task
            if self.process is None:
                self._pool.enter(self)
            else:
                self.process.send(task)

    def stop(self) -> None:
        """End the computation immediately."""
        with self._pool.lock:
            self._current = None
            self._pool.leave(self)

    def close(self) -> None:
        """End the computation of a page that is closed; a later task begins anew."""
        with self._pool.lock:
            self._current = None
            self._pool.leave(self, for_good=True)

    def begin(self) -> None:
        """Send the newest task to the process that computes now; called with the pool's lock."""
        assert self.process is not None
        assert self._current is not None
        self._since = time.monotonic()
        self.process.send(self._current)

    def lose(self) -> Task | None:
        """The task that was lost with its process; called with the pool's lock."""
        lost, self._current, self.process = self._current, None, None
        return lost

    def awaits(self, task: Task, result: object) -> bool:
        """Whether a result is to be delivered; the last one completes its task. Called with the pool's lock."""
        last = isinstance(result, Done | Failure)
        if self._current is None or task.number != self._current.number:
            self._since = time.monotonic()
            return not last  # an older hop is shown too, so that a dragged slider shows the hops that it passes
        if last:
            self._current = self.process = None
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
        with time_limit(WORKERS.longest):
            yield from COMPUTATIONS[task.name](python_machine, *task.arguments)
    except OrbitsError as error:
        yield Failure(str(error), _peak_memory())
    except MemoryError:
        yield Failure("there is not enough memory for this", _peak_memory())
    except Exception as error:
        yield Failure(f"internal error, please report it: {type(error).__name__}: {error}", _peak_memory())
    else:
        yield Done(_peak_memory())


def _peak_memory() -> int:
    """The most memory that this process has had, in bytes; 0 where the system does not count it."""
    try:
        import resource
    except ImportError:
        return 0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
