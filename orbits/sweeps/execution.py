"""The chunks of a sweep, solved here or by an executor's workers; some workers may die.

A chunk is a pure function of data that can be pickled, so that any executor can solve it, in any order, and again.
"""

import ctypes
import os
import pickle
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakSet

import numpy as np

from ..errors import InputError, whole_number
from ..io import MEGABYTE
from ..running import CHECK_INTERVAL, interrupts
from ..symbolic import Compiled, compiled_here, receive
from .members import failed_table, solve_chunk
from .question import CHUNK, Question, Table

if TYPE_CHECKING:
    from concurrent.futures import Future, ProcessPoolExecutor
    from multiprocessing.connection import Connection


class ExecutionOptions(NamedTuple):
    """How the chunks of a sweep are spread over workers."""

    crashes: int = 3  # workers that a member may kill before it counts as failed
    queued: int = 2  # chunks that wait at every worker, so that none is idle
    workers: int = 16  # that are assumed for an executor that does not state their number


EXECUTION = ExecutionOptions()
# Options of the C library's `mallopt` with their thresholds in bytes; see `_retain_freed_memory`.
MALLOC_THRESHOLDS = {-1: 16 * MEGABYTE, -3: 4 * MEGABYTE}  # M_TRIM_THRESHOLD, M_MMAP_THRESHOLD


class Chunk(NamedTuple):
    """Members (k,) that are solved together, and how many workers have died over a single one."""

    members: np.ndarray
    crashes: int = 0


def chunks_of(question: Question, done: np.ndarray) -> list[Chunk]:
    """The chunks with members that are not done (m,)."""
    starts = range(0, len(question), CHUNK)
    whole = (np.arange(start, min(start + CHUNK, len(question))) for start in starts)
    return [Chunk(members) for members in whole if not done[members].all()]


def check_executor(executor: object, workers: int | None) -> None:
    """Raise `InputError` for an invalid executor, or an invalid number of its workers."""
    if workers is not None and whole_number("workers", workers, most=1000) > 1 and executor is None:
        raise InputError(f"workers = {workers}: pass executor='processes' to use worker processes")
    known = executor is None or (isinstance(executor, str) and executor == "processes")
    if not (known or hasattr(executor, "submit")):
        raise InputError(f"executor = {executor!r}; it must be None, 'processes' or an executor of concurrent.futures")


def solved_chunks(
    question: Question, chunks: list[Chunk], executor: object, workers: int | None, report: Callable[[int], None]
) -> Iterator[Table]:
    """The results of the chunks, each as soon as it is solved.

    executor : None for this process, "processes" for `workers` processes of this machine (None: one for each core), or
        an executor of `concurrent.futures`, such as Dask's `Client.get_executor()`
    report : called with the number of members of the next chunk that are done, in this process
    """
    if executor is None:
        for chunk in chunks:
            interrupts.heed()
            yield solve_chunk(question, chunk.members, question.values_of(chunk.members), report)
        return
    # Every call sends the parameters of its own members only: a sweep may have a million members.
    members = replace(question.members, values=question.members.values[:0], axes=())
    payload = _pickled(replace(question, members=members), executor)
    with _Processes(workers) if executor == "processes" else _UserExecutor(executor, workers) as pool:
        yield from _solved_by(pool, payload, question, chunks)


def _pickled(question: Question, executor: object) -> bytes:
    """The question for workers; raises `InputError` where it cannot be sent."""
    try:
        if type(executor).__module__.partition(".")[0] == "distributed":
            import cloudpickle  # Dask needs it itself

            return cloudpickle.dumps(question)
        return pickle.dumps(question)
    except Exception as error:
        way = "use formulas, or functions of an importable module; or use a Dask cluster, which sends it by cloudpickle"
        raise InputError(f"this machine cannot be sent to other processes ({error}): {way}") from None


def solve_pickled(payload: bytes, members: np.ndarray, values: np.ndarray) -> Table:
    """`solve_chunk` in a worker."""
    return solve_chunk(_unpickled(payload), members, values)


_last: tuple[bytes, Question] | None = None


def _unpickled(payload: bytes) -> Question:
    """The question of a payload, cached for the next chunk, since all chunks have the same question."""
    global _last
    if _last is None or _last[0] != payload:
        _retain_freed_memory()
        _last = payload, pickle.loads(payload)
    return _last[1]


def _retain_freed_memory() -> None:
    """Let the C library retain some freed memory for the next arrays. Dask configures it in its workers to return all
    memory to the system immediately, and to allocate it again took a quarter of their time."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return  # another C library
    for option, size in MALLOC_THRESHOLDS.items():
        mallopt(option, size)


def _begin_worker(alive: "Connection", compiled: Compiled) -> None:
    """Initialise a process of the pool: it uses the machine code of the sweeping process, leaves interrupts to it, and
    ends as soon as that process closes its end of the pipe `alive`, also by its death, after which the worker would
    otherwise wait forever."""

    def watch() -> None:
        alive.poll(None)
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    receive(compiled)
    threading.Thread(target=watch, daemon=True).start()


class _Processes:
    """A pool of processes that is replaced when one of them has died, since all calls then fail."""

    all_calls_fail = True

    def __init__(self, workers: int | None):
        # A server that imports the toolkit once gives processes faster than new interpreters, and, unlike a fork of
        # this process, without its threads and locks.
        from multiprocessing import get_all_start_methods, get_context

        way = "forkserver" if "forkserver" in get_all_start_methods() else "spawn"
        self.context, self.workers = get_context(way), workers
        if way == "forkserver":
            self.context.set_forkserver_preload([__name__])
        self.pool, self.alive = self._started()

    def __enter__(self) -> "_Processes":
        return self

    def __exit__(self, kind: type | None, *error: object) -> None:
        if kind is not None:
            self._end()  # nobody waits for what the workers still compute
        self.pool.shutdown(wait=True, cancel_futures=True)
        self.alive.close()

    def _started(self) -> "tuple[ProcessPoolExecutor, Connection]":
        """A pool that computes, and the end of the pipe whose closing ends its processes."""
        from concurrent.futures import BrokenExecutor, ProcessPoolExecutor

        for _ in range(EXECUTION.crashes):  # a worker may be killed as it starts, too
            theirs, alive = self.context.Pipe(duplex=False)
            pool = ProcessPoolExecutor(self.size, self.context, _begin_worker, (theirs, compiled_here()))
            try:
                with interrupts.not_for_children():
                    first = pool.submit(int)
                first.result()
            except BrokenExecutor:
                pool.shutdown(wait=True)
            else:
                return pool, alive
        raise InputError("worker processes cannot start: in a script, call sweep under  if __name__ == '__main__':")

    @property
    def size(self) -> int:
        """The number of workers."""
        return self.workers or os.cpu_count() or 1

    def submit(self, *call: Any) -> "Future[Table]":
        """A call in one of the processes."""
        return self.pool.submit(*call)

    def end_if_stuck(self) -> None:
        """End the pool if a process has died and the pool does not report it: it waits forever for the rest of a result
        when the process has died in the middle of sending it."""
        if not all(process.is_alive() for process in self._workers()):
            self._end()

    def _workers(self) -> list[Any]:
        return list((self.pool._processes or {}).values())

    def _end(self) -> None:
        """Kill the processes, and close the pool's own end of the pipe of results, so that it detects their end.

        These attributes of the pool are private. Before Python 3.14 it has no public way to kill its workers, and none
        to abandon a result that has been received in part.
        """
        for process in self._workers():
            process.kill()
        results: Any = self.pool._result_queue
        results._writer.close()

    def renew(self) -> None:
        """Replace the pool, in which a process has died."""
        self.pool.shutdown(wait=True, cancel_futures=True)
        self.pool, self.alive = self._started()


class _UserExecutor:
    """An executor supplied by the user, whose dead workers are not replaced here."""

    all_calls_fail = False

    def __init__(self, executor: Any, workers: int | None):
        self.executor, self.size = executor, workers or int(getattr(executor, "_max_workers", 0)) or EXECUTION.workers
        self.futures = WeakSet["Future[Table]"]()

    def __enter__(self) -> "_UserExecutor":
        return self

    def __exit__(self, *error: object) -> None:
        for future in self.futures:
            future.cancel()  # after an interrupt nobody waits for it

    def submit(self, *call: object) -> "Future[Table]":
        """A call by one of the workers."""
        future = self.executor.submit(*call)
        self.futures.add(future)
        return future

    def end_if_stuck(self) -> None:
        """Do nothing: the executor supervises its own workers."""

    def renew(self) -> None:
        """Do nothing if the executor still accepts calls; raise `InputError` if it is broken."""
        try:
            self.executor.submit(int).result()
        except RuntimeError as error:
            raise InputError(
                f"the executor is broken: {error}; stored members are safe, continue with another executor"
            ) from None


def _solved_by(
    pool: "_Processes | _UserExecutor", payload: bytes, question: Question, chunks: list[Chunk]
) -> Iterator[Table]:
    """The results of the chunks, solved by a pool's workers.

    When a worker dies, the chunks that were being solved are suspects, which are retried alone once all others are
    done. A chunk that kills its worker then is solved member by member, and a member that kills three has failed.
    """
    from concurrent.futures import FIRST_COMPLETED, wait

    waiting, suspects, running = deque(chunks), deque[Chunk](), dict["Future[Table]", Chunk]()
    alone = False
    while waiting or running or suspects:
        interrupts.heed()
        if not running:  # a chunk that is retried alone stays alone, however long it takes
            alone = not waiting
        source, most = (suspects, 1) if alone else (waiting, EXECUTION.queued * pool.size)
        crashed = False
        while source and len(running) < most and not crashed:
            try:
                members = source[0].members
                running[pool.submit(solve_pickled, payload, members, question.values_of(members))] = source[0]
                source.popleft()
            except RuntimeError as error:  # a worker has died, and the futures have not reported it yet
                if not _died(error):
                    raise
                crashed = True
        finished, _ = wait(running, timeout=CHECK_INTERVAL, return_when=FIRST_COMPLETED)
        if not finished:
            pool.end_if_stuck()
        crashed = crashed or any(_died(future.exception()) for future in finished)
        if crashed and pool.all_calls_fail:
            finished, _ = wait(running)
        for future in finished:
            chunk = running.pop(future)
            reason = future.exception()
            if reason is None:
                yield future.result()
            elif not _died(reason):
                raise reason
            else:
                suspects.extend(retries := _retries(chunk, alone))
                if not retries:
                    yield failed_table(question, chunk.members, f"it crashed its worker {EXECUTION.crashes} times")
        if crashed:
            pool.renew()


def _retries(chunk: Chunk, alone: bool) -> list[Chunk]:
    """The chunks to retry after a worker has died over a chunk; none for a member that has killed too many workers."""
    if not alone:
        return [chunk]
    if len(chunk.members) > 1:
        return [Chunk(member) for member in np.split(chunk.members, len(chunk.members))]
    return [Chunk(chunk.members, chunk.crashes + 1)] if chunk.crashes + 1 < EXECUTION.crashes else []


def _died(error: BaseException | None) -> bool:
    """Whether an error reports that a worker has died: that of a pool of processes, or Dask's after some attempts."""
    from concurrent.futures import BrokenExecutor

    return isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker"
