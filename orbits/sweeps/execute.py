"""The chunks of a sweep, solved here or by an executor's workers, some of which may die.

A chunk is a pure function of data that can be pickled, so that any executor can solve it, in any order, and again.
"""

import ctypes
import os
import pickle
import signal
import threading
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple
from weakref import WeakSet

import numpy as np

from ..errors import InputError, whole_number
from ..io import MEGABYTE
from ..running import interrupts
from .members import failed_table, solve_chunk
from .question import CHUNK, Question, Table

# Workers that a member may kill before it counts as failed.
MOST_CRASHES = 3
# Chunks that wait at every worker, so that none is idle.
QUEUED = 2
# The number of an executor's workers where it does not tell it.
MANY_WORKERS = 16
# Seconds between looks for an interrupt while workers compute.
LOOK = 0.5
# Options of the C library's `mallopt` and the bytes that a worker keeps at hand; see `_keep_memory`.
KEPT = {-1: 16 * MEGABYTE, -3: 4 * MEGABYTE}  # M_TRIM_THRESHOLD, M_MMAP_THRESHOLD


class Chunk(NamedTuple):
    """Members (k,) that are solved together, and how many workers have died over a single one."""

    members: np.ndarray
    crashes: int = 0


def chunks_of(question: Question, done: np.ndarray) -> list[Chunk]:
    """The chunks with members that are not done (m,)."""
    starts = range(0, len(question), CHUNK)
    whole = (np.arange(start, min(start + CHUNK, len(question))) for start in starts)
    return [Chunk(members) for members in whole if not done[members].all()]


def check_executor(executor: Any, workers: int | None) -> None:
    """Raise `InputError` for what is no executor, or no number of workers of one."""
    if executor is None and workers not in (None, 1):
        raise InputError(f"workers = {workers}: they are processes, with executor='processes'")
    if executor not in (None, "processes") and not hasattr(executor, "submit"):
        raise InputError(f"executor = {executor!r}; it is None, 'processes' or an executor of concurrent.futures")
    if workers is not None:
        whole_number("workers", workers, most=1000)


def solved_chunks(question: Question, chunks: list[Chunk], executor: Any, workers: int | None) -> Iterator[Table]:
    """The answers of the chunks as they come.

    executor : None for this process, "processes" for `workers` processes of this machine (None: one for each core), or
        an executor of `concurrent.futures`, such as Dask's `Client.get_executor()`
    """
    if executor is None:
        for chunk in chunks:
            interrupts.heed()
            yield solve_chunk(question, chunk.members, question.values_of(chunk.members))
        return
    # Every call has the parameters of its own members; with those of all, a million of them would be sent every time.
    members = replace(question.members, values=question.members.values[:0], axes=())
    payload = _pickled(replace(question, members=members), executor)
    with _Processes(workers) if executor == "processes" else _Given(executor, workers) as pool:
        yield from _solved_by(pool, payload, question, chunks)


def _pickled(question: Question, executor: Any) -> bytes:
    """The question for workers; raises `InputError` where it cannot be sent."""
    try:
        if type(executor).__module__.partition(".")[0] == "distributed":
            import cloudpickle  # Dask needs it itself

            return cloudpickle.dumps(question)
        return pickle.dumps(question)
    except Exception as error:
        way = "use formulas, or functions of a module that can be imported; a Dask cluster takes it, by cloudpickle"
        raise InputError(f"this machine cannot be sent to other processes ({error}): {way}") from None


def solve_pickled(payload: bytes, members: np.ndarray, values: np.ndarray) -> Table:
    """`solve_chunk` in a worker."""
    return solve_chunk(_unpickled(payload), members, values)


_last: tuple[bytes, Question] | None = None


def _unpickled(payload: bytes) -> Question:
    """The question of a payload, kept for the next chunk, since all of them have the same."""
    global _last
    if _last is None or _last[0] != payload:
        _keep_memory()
        _last = payload, pickle.loads(payload)
    return _last[1]


def _keep_memory() -> None:
    """Let the C library keep some freed memory for the next arrays. Dask tells it in its workers to give everything
    back at once, and to ask for it again took a quarter of their time."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return  # another C library
    for option, size in KEPT.items():
        mallopt(option, size)


def _begin_worker(alive: Any) -> None:
    """What a process of the pool does first: leave interrupts to the process that sweeps, and end as soon as that one
    closes its end of the pipe `alive`, also by its death, which would leave the worker waiting for ever."""

    def watch() -> None:
        alive.poll(None)
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=watch, daemon=True).start()


class _Processes:
    """A pool of processes that is made anew where one of them has died, since with one all calls fail."""

    one_fate = True

    def __init__(self, workers: int | None):
        # A server that imports the toolkit once gives processes faster than new interpreters, and, unlike a fork of
        # this process, without its threads and locks.
        from multiprocessing import get_all_start_methods, get_context

        way = "forkserver" if "forkserver" in get_all_start_methods() else "spawn"
        self.context, self.workers = get_context(way), workers
        if way == "forkserver":
            self.context.set_forkserver_preload([__name__])

    def __enter__(self) -> "_Processes":
        self.pool = self._started()
        return self

    def __exit__(self, kind: type | None, *error: object) -> None:
        if kind is not None:
            self._end()  # nobody waits for what the workers still compute
        self.pool.shutdown(wait=True, cancel_futures=True)
        self.alive.close()

    def _started(self) -> Any:
        from concurrent.futures import BrokenExecutor, ProcessPoolExecutor

        for _ in range(MOST_CRASHES):  # a worker may be killed as it starts, too
            theirs, self.alive = self.context.Pipe(duplex=False)
            pool = ProcessPoolExecutor(self.size, self.context, _begin_worker, (theirs,))
            try:
                with interrupts.not_for_children():
                    first = pool.submit(int)
                first.result()
            except BrokenExecutor:
                pool.shutdown(wait=True)
            else:
                return pool
        raise InputError("worker processes cannot start: in a script, call sweep under  if __name__ == '__main__':")

    @property
    def size(self) -> int:
        """The number of workers."""
        return self.workers or os.cpu_count() or 1

    def submit(self, *call: Any) -> Any:
        """A call in one of the processes."""
        return self.pool.submit(*call)

    def look_after(self) -> None:
        """End the pool where a process has died that it does not tell of: it waits for the rest of a result for ever
        when the process has died in the middle of sending it."""
        if not all(process.is_alive() for process in self._workers()):
            self._end()

    def _workers(self) -> list[Any]:
        return list((self.pool._processes or {}).values())

    def _end(self) -> None:
        """Kill the processes, and take the pool's own end of the pipe of results from it, so that it sees their end.

        These members of the pool are private. Before Python 3.14 it has no public way to kill its workers, and none to
        give up a result of which a part has come.
        """
        for process in self._workers():
            process.kill()
        self.pool._result_queue._writer.close()

    def renew(self) -> None:
        """Replace the pool, in which a process has died."""
        self.pool.shutdown(wait=True, cancel_futures=True)
        self.pool = self._started()


class _Given:
    """An executor of the user's, whose workers somebody else replaces."""

    one_fate = False

    def __init__(self, executor: Any, workers: int | None):
        self.executor, self.size = executor, workers or int(getattr(executor, "_max_workers", 0)) or MANY_WORKERS
        self.futures = WeakSet[Any]()

    def __enter__(self) -> "_Given":
        return self

    def __exit__(self, *error: object) -> None:
        for future in self.futures:
            future.cancel()  # after an interrupt nobody waits for it

    def submit(self, *call: Any) -> Any:
        """A call by one of the workers."""
        future = self.executor.submit(*call)
        self.futures.add(future)
        return future

    def look_after(self) -> None:
        """Do nothing: that is the executor's."""

    def renew(self) -> None:
        """Do nothing where the executor still takes calls; raise `InputError` for one that is broken."""
        try:
            self.executor.submit(int).result()
        except RuntimeError as error:
            raise InputError(f"the executor is broken: {error}; what is stored stays, go on with another one") from None


def _solved_by(pool: Any, payload: bytes, question: Question, chunks: list[Chunk]) -> Iterator[Table]:
    """The answers of the chunks by a pool's workers.

    Where a worker dies, the chunks that were being solved are suspects, which are tried again alone once all others are
    done. A chunk that kills its worker then is solved a member at a time, and a member that kills three has failed.
    """
    from concurrent.futures import FIRST_COMPLETED, wait

    waiting, suspects, running = deque(chunks), deque[Chunk](), dict[Any, Chunk]()
    alone = False
    while waiting or running or suspects:
        interrupts.heed()
        if not running:  # a chunk that is tried alone stays so, however long it takes
            alone = not waiting
        source, most = (suspects, 1) if alone else (waiting, QUEUED * pool.size)
        crashed = False
        while source and len(running) < most and not crashed:
            try:
                members = source[0].members
                running[pool.submit(solve_pickled, payload, members, question.values_of(members))] = source[0]
                source.popleft()
            except RuntimeError as error:  # a worker has died that the futures have not told of yet
                if not _died(error):
                    raise
                crashed = True
        finished, _ = wait(running, timeout=LOOK, return_when=FIRST_COMPLETED)
        if not finished:
            pool.look_after()
        crashed = crashed or any(_died(future.exception()) for future in finished)
        if crashed and pool.one_fate:
            finished, _ = wait(running)
        for future in finished:
            chunk = running.pop(future)
            reason = future.exception()
            if reason is None:
                yield future.result()
            elif not _died(reason):
                raise reason
            else:
                suspects.extend(again := _tried_again(chunk, alone))
                if not again:
                    yield failed_table(question, chunk.members, f"it crashed its worker {MOST_CRASHES} times")
        if crashed:
            pool.renew()


def _tried_again(chunk: Chunk, alone: bool) -> list[Chunk]:
    """What is tried after a worker has died over a chunk; nothing for a member that has killed too many."""
    if not alone:
        return [chunk]
    if len(chunk.members) > 1:
        return [Chunk(member) for member in np.split(chunk.members, len(chunk.members))]
    return [Chunk(chunk.members, chunk.crashes + 1)] if chunk.crashes + 1 < MOST_CRASHES else []


def _died(error: BaseException | None) -> bool:
    """Whether an error says that a worker has died: that of a pool of processes, or Dask's after some attempts."""
    from concurrent.futures import BrokenExecutor

    return isinstance(error, BrokenExecutor) or type(error).__name__ == "KilledWorker"
