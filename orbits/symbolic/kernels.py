"""Kernels: a function at many points, once or iterated until each is done, in machine code; a graph of CasADi alone is
interpreted until this has taken as long as to compile it."""

import ctypes
import threading
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..errors import NoMachineCode
from ..running import LOCK, apart, interrupts, threads
from .caches import weigh
from .calls import BufferedFunction, MappedFunction, with_common_parts
from .machine_code import CODE, WITHOUT_LLVM, CodedFunction, MachineCode, coded, say_interpreted, target
from .vector_code import VECTORS, VectorCode


class KernelOptions(NamedTuple):
    """When iterations are interpreted, and how many points and records one call has."""

    # Seconds that CasADi's virtual machine takes for one instruction (measured on a server core of 2024).
    seconds_interpreted: float = 3e-9
    seconds_of_call: float = 1e-6  # that an interpreted iteration takes in addition
    seconds_of_point: float = 1e-5  # that a point takes in addition to its iterations
    checked: int = 256  # iterations after which an interrupt of the user may be checked
    longest_run: int = 100_000  # iterations of a point, at most
    points: int = 4096  # of one call of machine code, which nothing can interrupt
    # Points times iterations of a call of machine code, some seconds; but it always iterates `checked` times.
    longest_call: int = 2_000_000
    scratch: int = 4_000_000  # numbers that are recorded at a time, at most
    # Records of a point for which there is room at first; points that need more go on where they stopped.
    first_capacity: int = 16


KERNELS = KernelOptions()

# One record, one end and one iteration of every point.
_ONCE = np.ones(3)
# Of each thread the array `records`, which is reused as new memory is slow to write to.
_memory = threading.local()


class Iterated(NamedTuple):
    """The result of a `Kernel`. A point that has less than the most records and yet is going has used up its
    `KERNELS.longest_run`."""

    z: np.ndarray  # (m, size), the last z
    records: list[np.ndarray]  # (N, size), of one point after the other
    counts: np.ndarray  # (m,), how many of them belong to each point
    going: np.ndarray  # (m,), which points would go on beyond the most records


def _contiguous(arguments: Sequence[np.ndarray], sizes: Sequence[int]) -> tuple[list[np.ndarray], int]:
    """Arguments (m, size), m >= 1, or (1, size) for all points, as contiguous arrays, and m; machine code reads them
    without looking where they end. Raises `ValueError` for others."""
    inputs = [np.ascontiguousarray(argument, dtype=float) for argument in arguments]
    lengths, shapes = [*map(len, inputs)], [array.shape[1:] for array in inputs]
    count = max(lengths)
    if shapes != [(size,) for size in sizes] or not {*lengths} <= {1, count} - {0}:
        found = ", ".join(str(array.shape) for array in inputs)
        raise ValueError(f"arguments of shapes {found}; they must be (m, size) or (1, size) of sizes {sizes}")
    return inputs, count


class _OnePoint:
    """The arguments and results of machine code at one point, which are laid out once: to state where several arrays
    lie takes longer than the code."""

    def __init__(self, inputs: Sequence[int], records: Sequence[int], capacity: int):
        sizes = [*inputs, *(capacity * size for size in records), 3]
        whole = np.zeros(sum(sizes))
        bounds = [*accumulate(sizes, initial=0)]
        parts = [whole[first:last] for first, last in pairwise(bounds)]
        self.inputs, self.records, self.ends = parts[: len(inputs)], parts[len(inputs) : -1], parts[-1]
        self.records = [part.reshape(capacity, -1) for part in self.records]
        self.capacity, begin = capacity, whole.__array_interface__["data"][0]
        places = [begin + first * whole.itemsize for first in bounds[:-1]]
        self._pointers = (ctypes.c_void_p * len(places))(*places)
        self._strides = (ctypes.c_int64 * len(places))(*sizes)

    def run(self, code: MachineCode, inputs: Sequence[np.ndarray], ends: tuple[float, float, float]) -> None:
        """Iterate from arguments (1, size) to bounds as those of `Kernel._iterated`."""
        for memory, array in zip(self.inputs, inputs, strict=True):
            memory[:] = array[0]
        self.ends[:] = ends
        code.run(self._pointers, self._strides, 1)


def _threads(workers: int) -> AbstractContextManager[Any]:
    """The threads that share points, None for one."""
    if workers < 2:
        return nullcontext()
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(workers)


class Kernel:
    """A function of vectors iterated at several points, at each until it says that it is done.

    The function takes (z, data, ...) to (z after it, records ..., whether to record them, whether to continue), all
    dense. A `CodedFunction` is compiled when it is used first. The iterations of a graph are interpreted until that has
    taken as long as compiling it, so that nothing is compiled for a few points; times are those of the processor, so
    that other programs change nothing. Each number is the same either way, and with any number of threads.

    row_entry : an entry of z, a whole number, where the last argument of the function is that row of a table; a call
        then has tables (m, rows size), or (1, rows size) for all points, whose rows follow each other
    """

    def __init__(
        self, function: ca.Function | CodedFunction, row_entry: int | None = None, loop: CodedFunction | None = None
    ):
        self.row_entry, self._loop = row_entry, loop
        self.function: Any = None
        if isinstance(function, CodedFunction):
            own = self.source = function
        else:
            self.function = function.expand()
            own = self.source = coded(self.function)
        self.sizes_in, self.sizes_out = own.sizes_in, own.sizes_out
        self.width = max(1, sum(self.sizes_out[1:-2]))  # numbers in the records of one iteration
        length = self.function.n_instructions() if self.function else 0
        self.seconds_per_step = length * KERNELS.seconds_interpreted
        # The processor time that may be spent on interpreting.
        self.interpretation_budget = CODE.seconds + CODE.seconds_of_instruction * length if self.function else -1.0
        self.interpretation_budget = CODE.seconds_of_loop if loop else self.interpretation_budget
        self._interpreted: BufferedFunction | None = None
        self._code: MachineCode | None = None
        # The number of records of a point with room, learned from earlier calls; no number in a result depends on it.
        self._capacity = KERNELS.first_capacity
        self._points = threading.local()

    @property
    def compiled(self) -> bool:
        """Whether machine code is used."""
        return self._code is not None

    def compile(self) -> bool:
        """Make machine code now, where that is possible; return whether there is some. Raises `NoMachineCode` where
        there is none of a `CodedFunction`, which cannot be interpreted."""
        with LOCK:
            if self._code is None and self.interpretation_budget < np.inf:
                if self.function is not None:
                    self.interpretation_budget = np.inf  # It is tried once.
                self._make_code()
        return self.compiled

    def code_for(self, iterations: int) -> MachineCode | None:
        """The machine code for some iterations at known cost, None where they are to be interpreted."""
        if self._code is None:
            self.interpretation_budget -= iterations * self.seconds_per_step
            if self.interpretation_budget < 0:
                self.compile()
        return self._code

    def _make_code(self) -> None:
        source = self.source
        if self._loop:
            source = _of_kernel(self._loop)
        elif self.function:
            source = coded(with_common_parts(self.function))
        reason = WITHOUT_LLVM
        if target():
            try:
                self._code = MachineCode(source, self.row_entry)
                weigh([], 2 * len(self._code.compiled))
                return
            except NotImplementedError as error:
                reason = f"a law cannot be compiled: {error}"
            except RuntimeError as error:
                reason = f"LLVM cannot make machine code: {error}"
                say_interpreted()
        if self.function is None:
            raise NoMachineCode(reason)

    def __call__(self, *arguments: np.ndarray, most: int = 2**31) -> Iterated:
        """Iterate from arguments (m, size), m >= 1, or (1, size) for all points, to at most `most` records of each."""
        sizes = self.sizes_in if self.row_entry is None else [*self.sizes_in[:-1], arguments[-1].shape[-1]]
        inputs, count = _contiguous(arguments, sizes)
        if (
            count == 1
            and self._code is not None
            and self.row_entry is None
            and (found := self._at_one_point(inputs, most))
        ):
            return found
        inputs[0] = inputs[0].copy() if len(inputs[0]) == count else np.tile(inputs[0], (count, 1))
        room = min(most, max(1, KERNELS.scratch // (VECTORS.lanes * self.width)))
        capacity, rounds = min(self._capacity, room), list[tuple]()
        longest = max(KERNELS.checked, KERNELS.longest_call // min(count, KERNELS.points))
        # The most records of each point, 1, and the most iterations; then the records, whether it has ended, and so on.
        done = np.empty((count, 3))
        done[:] = capacity, 1.0, min(longest, KERNELS.longest_run)
        parts, bounds = self._iterated(inputs, done, capacity), (most, 1.0, KERNELS.longest_run)
        while not done[:, 1].all() and len(left := np.logical_and.reduce(done < bounds, axis=1).nonzero()[0]):
            rounds, capacity = rounds or [(slice(None), done.copy())], min(2 * capacity, room)
            ends = np.minimum(np.array(bounds) - done[left], np.array([capacity, 1.0, longest]))
            some = [array[left] if len(array) == count else array for array in inputs]
            parts += self._iterated(some, ends, capacity)
            inputs[0][left] = some[0]
            done[left] += ends
            rounds.append((left, ends))
        counts = done[:, 0].astype(int)
        records = parts[0] if len(parts) == 1 else [np.concatenate(pieces) for pieces in zip(*parts, strict=True)]
        if rounds:
            owners = [np.arange(count)[points].repeat(ends[:, 0].astype(int)) for points, ends in rounds]
            order = np.argsort(np.concatenate(owners), kind="stable")
            records = [record[order] for record in records]
        if largest := int(counts.max()):
            self._capacity = max(KERNELS.first_capacity, largest + 2)
        return Iterated(inputs[0], records, counts, done[:, 1] == 0)

    def one_point(self, inputs: Sequence[int], capacity: int) -> _OnePoint:
        """This thread's memory for one point."""
        point = getattr(self._points, "point", None)
        if point is None or point.capacity < capacity:
            point = self._points.point = _OnePoint(inputs, self.sizes_out[1:-2], capacity)
        return point

    def _at_one_point(self, inputs: list[np.ndarray], most: int) -> Iterated | None:
        """`__call__` of machine code at one point; None where it needs more room or iterations than usual."""
        point, code = self.one_point(self.sizes_in, min(self._capacity, KERNELS.checked)), self._code
        assert code is not None
        interrupts.heed()
        point.run(code, inputs, (min(most, point.capacity), 1.0, KERNELS.checked))
        count, ended, _ = point.ends.tolist()
        if not ended and count < most:
            return None
        records = [record[: int(count)].copy() for record in point.records]
        return Iterated(point.inputs[0][None].copy(), records, np.array([int(count)]), np.array([not ended]))

    def _iterated(self, inputs: list[np.ndarray], ends: np.ndarray, capacity: int) -> list[list[np.ndarray]]:
        """Iterate points until they end or come to their bounds, with room for `capacity` records of each.

        This changes the first of the inputs to the last z, and `ends` (m, 3) from the most records, 1 and the most
        iterations of each point to the number of its records, whether it has ended, and the number of its iterations.
        Returns the records, in parts for some points after the others.
        """
        count, first, cost, parts = len(ends), 0, 0.0, list[list[np.ndarray]]()
        while self._code is None and first < count:
            # A call that would use up the budget on its own is compiled for immediately.
            if self.interpretation_budget < cost * (count - first) and self.compile():
                break
            before = self.interpretation_budget
            parts.append(self._interpret([array[first if len(array) == count else 0] for array in inputs], ends[first]))
            first, cost = first + 1, before - self.interpretation_budget
        if first < count:
            rest = [array[first:] if len(array) == count else array for array in inputs]
            parts += self._in_lanes(rest, ends[first:], capacity)
        return parts

    def _interpret(self, inputs: Sequence[np.ndarray], ends: np.ndarray) -> list[np.ndarray]:
        """`_iterated` at one point, by CasADi's virtual machine."""
        with LOCK:
            call = self._interpreted = self._interpreted or BufferedFunction(self.function)
            row_entry, fixed = self.row_entry, inputs if self.row_entry is None else inputs[:-1]
            for memory, array in zip(call.arguments, fixed, strict=False):
                memory[:] = array
            sizes, whole = self.sizes_out, call.whole
            after, values, before, trigger = call.flat[0], whole[sizes[0] : -2], call.arguments[0], call.trigger
            (most, _, longest), checked = map(int, ends.tolist()), KERNELS.checked
            records, count, tried, going = np.empty((most, len(values))), 0, 0, True
            while going and count < most and tried < longest:
                if tried % checked == 0:
                    interrupts.heed()
                if row_entry is not None:
                    call.arguments[-1][:] = inputs[-1].reshape(-1, self.sizes_in[-1])[int(before[row_entry])]
                trigger()
                tried += 1
                before[:] = after
                recorded, goes = whole[-2:].tolist()
                going = goes != 0
                if recorded:
                    records[count] = values
                    count += 1
            seconds = tried * (self.seconds_per_step + KERNELS.seconds_of_call) + KERNELS.seconds_of_point
            self.interpretation_budget -= seconds
            inputs[0][:], ends[:] = after, (count, not going, tried)
        places = [*accumulate(sizes[1:-2], initial=0)]
        return [records[:count, first:last].copy() for first, last in pairwise(places)]

    def _in_lanes(self, inputs: list[np.ndarray], ends: np.ndarray, capacity: int) -> list[list[np.ndarray]]:
        """`_iterated` by machine code, in parts that the threads share."""
        code = self._code
        assert code is not None
        count, row = len(ends), capacity * self.width
        workers = min(threads(), max(1, KERNELS.scratch // (row * code.lanes))) if count > code.lanes else 1
        points = min(KERNELS.points, KERNELS.scratch // (workers * row), -(-count // workers) + code.lanes - 1)
        size = max(1, points // code.lanes) * code.lanes
        firsts = range(0, count, size)
        workers = min(workers, len(firsts))
        memory = getattr(_memory, "records", None)
        if memory is None or len(memory) < workers * size * row:
            memory = np.empty(workers * size * row)
            if len(memory) <= KERNELS.scratch:
                _memory.records = memory
        free = [memory[worker * size * row :] for worker in range(workers)]

        def run(first: int) -> list[np.ndarray]:
            if workers > 1 and first and interrupts.pending():
                raise KeyboardInterrupt  # before the loop below can heed it
            part, mine = slice(first, first + size), free.pop()
            own = [array[part] if len(array) == count else array for array in inputs]
            with apart():
                records = self._chunk(code, own, ends[part], capacity, mine)
            free.append(mine)
            return records

        parts = []
        with _threads(workers) as pool:
            for records in (pool.map if pool else map)(run, firsts):
                parts.append(records)
                interrupts.heed()
        return parts

    def _chunk(
        self, code: MachineCode, inputs: list[np.ndarray], ends: np.ndarray, capacity: int, memory: np.ndarray
    ) -> list[np.ndarray]:
        """`_iterated` by one call of machine code, with memory for the records."""
        count, lengths, records, used = len(ends), [capacity * size for size in self.sizes_out[1:-2]], [], 0
        *places, end, start = (array.__array_interface__["data"][0] for array in (*inputs, ends, memory))
        for length in lengths:
            records.append(memory[used : used + count * length].reshape(count, capacity, length // capacity))
            places.append(start + used * memory.itemsize)
            used += count * length
        strides = [array.shape[1] if len(array) == count else 0 for array in inputs]
        strides += [*lengths, 3]
        pointers = (ctypes.c_void_p * len(strides))(*places, end)
        code.run(pointers, (ctypes.c_int64 * len(strides))(*strides), count)
        if count == 1 or not records:
            return [record[0, : int(ends[0, 0])].copy() for record in records]
        recorded = np.arange(capacity) < ends[:, :1]
        return [record[recorded] for record in records]


class ElementwiseFunction(MappedFunction):
    """A function of vectors at several points: arguments (m, size) make results (m, rows).

    As in a `Kernel` an SX function is interpreted at first, and then machine code works on several points side by side.

    loop : code that does the same in a loop, which takes little time to compile
    """

    def __init__(self, function: ca.Function | CodedFunction, loop: CodedFunction | None = None):
        if isinstance(function, CodedFunction):
            self.kernel = Kernel(_of_kernel(function))
            return
        symbols, nothing = function.sx_in(), ca.SX.sym("z", 0)
        results = [ca.densify(result) for result in function.call(symbols)]
        super().__init__(ca.Function("dense", symbols, results))
        self.kernel = Kernel(ca.Function("elementwise", [nothing, *symbols], [nothing, *results, 1, 0]), loop=loop)

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """Results of each point; an argument (1, size) is shared by all points."""
        inputs, count = _contiguous(arguments, self.kernel.sizes_in[1:])
        code = self.kernel.code_for(count)
        if code is None:
            return [np.ascontiguousarray(result[:, :, 0]) for result in super().__call__(*inputs)]
        if count == 1:
            point = self.kernel.one_point(self.kernel.sizes_in, 1)
            point.run(code, (_ONCE[None, :0], *inputs), (1.0, 1.0, 1.0))
            return [result.copy() for result in point.records]
        results = [np.empty((count, size)) for size in self.kernel.sizes_out[1:-2]]
        # There is nothing to iterate, and the numbers of iterations are the same for all points.
        arrays = [_ONCE[:0], *inputs, *results, _ONCE]
        pointers = (ctypes.c_void_p * len(arrays))(*(array.__array_interface__["data"][0] for array in arrays))
        strides = [array.shape[-1] if len(array) == count > 1 else 0 for array in arrays[:-1]]
        code.run(pointers, (ctypes.c_int64 * len(arrays))(*strides), count)
        return results


def _of_kernel(function: CodedFunction) -> CodedFunction:
    """The code of a function as that of a kernel that iterates nothing."""

    def append(code: VectorCode, arguments: Sequence[Sequence[Any]]) -> list[Sequence[Any]]:
        return [[], *function.append(code, arguments[1:]), [code.splat(1)], [code.splat(0)]]

    blocks = tuple(i + 1 for i in function.blocks)
    return CodedFunction([0, *function.sizes_in], [0, *function.sizes_out, 1, 1], append, blocks)
