"""Kernels: a CasADi function iterated at many points until each is done, interpreted at first, then in machine code."""

import ctypes
import os
import threading
import time
import warnings
from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..errors import InputError
from . import interrupts
from .calls import BufferedFunction
from .exclusive import LOCK
from .kept import weigh
from .machine_code import LONGEST_RUN, MachineCode, compile_seconds, target

# About the seconds that CasADi's virtual machine takes for one instruction (measured on a server core of 2024).
SECONDS_INTERPRETED = 3e-9
# From this many instructions on, optimised code takes longer to make than it repays.
LONG = 15_000
# Interpreted iterations after which it is seen whether the user interrupts.
CHECKED = 256
# So many numbers are recorded at a time, at most.
SCRATCH = 4_000_000
# Records of a point for which there is room at first; points that need more go on where they stopped.
FIRST_CAPACITY = 16

_memory = threading.local()  # the array that records are written to, kept by each thread because new memory is slow


class Iterated(NamedTuple):
    """What a `Kernel` returns. A point that has less than the most records and yet is going has used up its
    `LONGEST_RUN`."""

    z: np.ndarray  # (m, size), the last z
    records: list[np.ndarray]  # (N, size), of one point after the other
    counts: np.ndarray  # (m,), how many of them belong to each point
    going: np.ndarray  # (m,), which points would go on beyond the most records


def threads() -> int:
    """How many threads share the points of a call: the environment's ORBITS_THREADS, 1 where it says nothing."""
    text = os.environ.get("ORBITS_THREADS", "1")
    try:
        count = int(text)
    except ValueError:
        count = 0
    if count < 1:
        raise InputError(f"ORBITS_THREADS = '{text}': it is a whole number of threads, from 1 on")
    return count


class Kernel:
    """A function of vectors iterated at several points, at each until it says that it is done.

    The function takes (z, data, ...) to (z after it, what is to be recorded ..., whether to record it, whether to go
    on), all dense. Its iterations are interpreted until that has taken as long as compiling it, and what is compiled is
    optimised when it has run for as long as that takes: so nothing is compiled for a few points. Each number is the
    same either way, and with any number of threads.
    """

    def __init__(self, function: ca.Function):
        self.function = function.expand()  # without its calls it takes a fifth less time
        self.sizes_in = [function.nnz_in(i) for i in range(function.n_in())]
        self.sizes_out = [function.nnz_out(i) for i in range(function.n_out())]
        length = self.function.n_instructions()
        self.seconds_per_step, self.interpretation_budget = length * SECONDS_INTERPRETED, compile_seconds(length)
        self.optimisation_budget = compile_seconds(length, optimised=True) if length < LONG else np.inf
        self._interpreted: BufferedFunction | None = None
        self._code: MachineCode | None = None
        # Room for so many records of a point, learned from earlier calls, which no number depends on.
        self._capacity = FIRST_CAPACITY

    @property
    def compiled(self) -> bool:
        """Whether machine code is used."""
        return self._code is not None

    def compile(self) -> bool:
        """Make machine code now, where that is possible; return whether there is some."""
        with LOCK:
            if self._code is None and self.interpretation_budget < np.inf:
                self.interpretation_budget = np.inf  # It is tried once.
                self._make_code(optimised=False)
        return self.compiled

    def optimise(self) -> None:
        """Make the machine code that takes the least time."""
        with LOCK:
            if self.optimisation_budget < np.inf:
                self.optimisation_budget = np.inf
                self._make_code(optimised=True)

    def _make_code(self, optimised: bool) -> None:
        if target():
            arguments = self.function.sx_in()
            merged = ca.Function(self.function.name(), arguments, self.function.call(arguments), {"cse": True})
            try:
                self._code = MachineCode(merged, optimised)
                weigh([merged], [np.empty(self._code.size, dtype=np.uint8)])
            except NotImplementedError:
                return
            except RuntimeError as error:
                warnings.warn(f"LLVM fails here, and motions are interpreted ({error})", RuntimeWarning, stacklevel=2)

    def __call__(self, *arguments: np.ndarray, most: int = 2**31) -> Iterated:
        """Iterate from arguments (m, size), m >= 1, or (1, size) for all points, to at most so many records of each."""
        inputs = [np.ascontiguousarray(argument, dtype=float) for argument in arguments]
        count = max(map(len, inputs))
        if len(inputs[0]) < count:
            inputs[0] = np.tile(inputs[0], (count, 1))
        capacity = min(self._capacity, most)
        found = Iterated(*self._iterated(inputs, capacity))
        if capacity < most and (found.going & (found.counts == capacity)).any():
            found = self._continued(inputs, found, capacity, most)
        if largest := int(found.counts.max(initial=0)):
            most_room = SCRATCH // (8 * max(1, sum(self.sizes_out[1:-2])))
            self._capacity = max(FIRST_CAPACITY, min(largest + 2, most_room))
        return found

    def _continued(self, inputs: list[np.ndarray], found: Iterated, capacity: int, most: int) -> Iterated:
        """Iterate those points to their ends that had room for too few records."""
        (z, records, counts, going), owners = found, [np.repeat(np.arange(len(found.z)), found.counts)]
        parts, full = [records], counts == capacity
        while len(left := np.flatnonzero(going & full & (counts < most))):  # all of them have as many records
            interrupts.check()
            capacity = min(2 * capacity, most - int(counts[left[0]]))
            part = [z[left], *(array[left] if len(array) == len(z) else array for array in inputs[1:])]
            z[left], records, taken, going[left] = self._iterated(part, capacity)
            counts[left] += taken
            full[left] = taken == capacity
            owners.append(np.repeat(left, taken))
            parts.append(records)
        order = np.argsort(np.concatenate(owners), kind="stable")
        return Iterated(z, [np.concatenate(pieces)[order] for pieces in zip(*parts, strict=True)], counts, going)

    def _iterated(self, inputs: list[np.ndarray], capacity: int) -> tuple:
        """(last z, records, counts, going) with room for so many records of each point."""
        count, first, cost, parts = len(inputs[0]), 0, 0.0, list[tuple]()
        while self._code is None and first < count:
            # A call that would use up the budget on its own is compiled for at once.
            if self.interpretation_budget < cost * (count - first) and self.compile():
                break
            before = self.interpretation_budget
            parts.append(self._interpret([array[first if len(array) == count else 0] for array in inputs], capacity))
            first, cost = first + 1, before - self.interpretation_budget
        if first < count:
            if self.optimisation_budget < 0:
                self.optimise()
            began = time.perf_counter()
            parts += self._in_lanes([array if len(array) < count else array[first:] for array in inputs], capacity)
            with LOCK:
                self.optimisation_budget -= time.perf_counter() - began
        if len(parts) == 1:
            return parts[0]
        z, records, counts, going = zip(*parts, strict=True)
        joined = [np.concatenate(pieces) for pieces in zip(*records, strict=True)]
        return np.concatenate(z), joined, np.concatenate(counts), np.concatenate(going)

    def _interpret(self, inputs: Sequence[np.ndarray], capacity: int) -> tuple:
        """`_iterated` at one point, by CasADi's virtual machine."""
        with LOCK:
            call = self._interpreted = self._interpreted or BufferedFunction(self.function)
            for memory, array in zip(call.arguments, inputs, strict=True):
                memory[:] = array
            sizes, whole = self.sizes_out, call.whole
            after, values, before, trigger = call.flat[0], whole[sizes[0] : -2], call.arguments[0], call.trigger
            records, count, tried, going = np.empty((capacity, len(values))), 0, 0, True
            while going and count < capacity and tried < LONGEST_RUN:
                trigger()
                tried += 1
                if tried % CHECKED == 0:
                    interrupts.check()
                before[:] = after
                recorded, goes = whole[-2:].tolist()
                going = goes != 0
                if recorded:
                    records[count] = values
                    count += 1
            self.interpretation_budget -= tried * self.seconds_per_step
            z = after[None].copy()
        ends = [*accumulate(sizes[1:-2], initial=0)]
        packed = [records[:count, first:last].copy() for first, last in pairwise(ends)]
        return z, packed, np.array([count]), np.array([going])

    def _in_lanes(self, inputs: list[np.ndarray], capacity: int) -> list[tuple]:
        """`_iterated` by machine code, in parts that the threads share."""
        # This name keeps the code in memory while it runs, even where another thread optimises it meanwhile.
        code = self._code
        assert code is not None
        count, lanes, workers = max(map(len, inputs)), code.lanes, threads()
        row = capacity * sum(self.sizes_out[1:-2])
        size = max(lanes, -(-min(SCRATCH // max(1, row), -(-count // workers)) // lanes) * lanes)
        firsts = range(0, count, size)
        workers = min(workers, len(firsts))
        memory = getattr(_memory, "records", None)
        if memory is None or len(memory) < workers * size * row:
            memory = _memory.records = np.empty(workers * size * row)
        parts: dict[int, tuple] = {}

        def run(worker: int) -> None:
            for first in firsts[worker::workers]:
                last = min(first + size, count)
                part = [array if len(array) == 1 < count else array[first:last] for array in inputs]
                parts[first] = self._chunk(code, part, last - first, capacity, memory[worker * size * row :])

        if workers > 1:
            from concurrent.futures import ThreadPoolExecutor  # slow to import

            with ThreadPoolExecutor(workers) as pool:
                list(pool.map(run, range(workers)))
        else:
            run(0)
        return [parts[first] for first in firsts]

    def _chunk(self, code: MachineCode, inputs: list, count: int, capacity: int, memory: np.ndarray) -> tuple:
        """`_iterated` by one call of machine code, at so many points, with memory for the records."""
        size, *sizes = self.sizes_out[:-2]
        lengths, records, used = [capacity * size for size in sizes], [], 0
        *places, place = (array.__array_interface__["data"][0] for array in (*inputs, memory))
        after = np.empty(count * (size + 2))
        z, ends = after[: count * size].reshape(count, size), after[count * size :].reshape(count, 2)
        places.append(after.__array_interface__["data"][0])
        for length in lengths:
            records.append(memory[used : used + count * length].reshape(count, capacity, length // capacity))
            places.append(place + used * memory.itemsize)
            used += count * length
        places.append(places[len(inputs)] + z.nbytes)
        strides = [size if len(array) == count else 0 for array, size in zip(inputs, self.sizes_in, strict=True)]
        strides += [size, *lengths, 2]
        pointers = (ctypes.c_void_p * len(places))(*places)
        code.run(pointers, (ctypes.c_int64 * len(places))(*strides), count, capacity)
        counts = ends[:, 0].astype(int)
        if count == 1:
            return z, [record[0, : counts[0]].copy() for record in records], counts, ends[:, 1] != 0
        kept = np.arange(capacity) < ends[:, :1]
        return z, [record[kept] for record in records], counts, ends[:, 1] != 0
