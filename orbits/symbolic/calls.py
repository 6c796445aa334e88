"""Two fast ways to call a CasADi function on NumPy arrays: at one point, or mapped over many."""

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..running import LOCK
from .caches import weigh

# A scalar operation of an SX function: its code, its arguments, and the value of an OP_CONST, else None. The arguments
# are the positions of the instructions whose results it takes, those of an OP_INPUT (which input, which element), and
# those of an OP_OUTPUT (source, which output, which element).
Instruction = tuple[int, tuple[int, ...], float | None]


def single_assignment(function: ca.Function) -> list[Instruction]:
    """The instructions of an SX function, with work slots renamed so that no result overwrites another."""
    position: dict[int, int] = {}  # of the instruction whose result each work slot holds
    instructions: list[Instruction] = []
    for i in range(function.n_instructions()):
        op, source, target = function.instruction_id(i), function.instruction_input(i), function.instruction_output(i)
        arguments = tuple(source if op == ca.OP_INPUT else (position[slot] for slot in source))
        if op == ca.OP_OUTPUT:
            arguments += tuple(target)
        else:
            position[target[0]] = i
        instructions.append((op, arguments, function.instruction_constant(i) if op == ca.OP_CONST else None))
    return instructions


def with_common_parts(function: ca.Function) -> ca.Function:
    """An SX function whose equal parts are computed once."""
    arguments = function.sx_in()
    return ca.Function(function.name(), arguments, function.call(arguments), {"cse": True})


class BufferedFunction:
    """A CasADi function on NumPy arrays with its memory laid out once.

    A plain call spends 10 to 20 microseconds on conversions, this one spends a few. Arguments are copied in and results
    are copied out under the lock, so that nothing is shared with the caller or with another thread.
    """

    def __init__(self, function: ca.Function):
        self.function = function
        self.arguments = [np.zeros(function.nnz_in(i)) for i in range(function.n_in())]
        shapes = [function.size_out(i) for i in range(function.n_out())]
        if any(function.nnz_out(i) != rows * columns for i, (rows, columns) in enumerate(shapes)):
            raise ValueError(f"the results of {function.name()} must be dense")
        sizes = [rows * columns for rows, columns in shapes]
        self.whole = np.zeros(sum(sizes))  # all results, one after the other
        self.flat = np.split(self.whole, np.cumsum(sizes)[:-1])
        self.results = [flat.reshape(shape, order="F") for flat, shape in zip(self.flat, shapes, strict=True)]
        self._buffer: Any
        self._buffer, self.trigger = function.buffer()
        for place, arrays in ((self._buffer.set_arg, self.arguments), (self._buffer.set_res, self.flat)):
            for i, array in enumerate(arrays):
                place(i, array.data)
        weigh([function], sum(array.nbytes for array in (*self.arguments, self.whole)))

    def __call__(self, *arguments: ArrayLike) -> list[np.ndarray]:
        """Results as matrices of the function's shapes; arguments of matching sizes, matrices included."""
        with LOCK:
            for memory, argument in zip(self.arguments, arguments, strict=True):
                memory[:] = np.asarray(argument).ravel(order="F")
            self.trigger()
            return [result.copy() for result in self.results]


def room_for(count: int) -> int:
    """The capacity of a batch of `count` points: `count` rounded up to three leading binary digits.

    So few capacities occur that the function built for each can be stored, and at most a quarter is added.
    """
    unit = max(1, 1 << (count - 1).bit_length() >> 3)
    return -(-count // unit) * unit


class MappedFunction:
    """A CasADi function at several points in one call: arguments (m, size) make results (m, rows, columns)."""

    def __init__(self, function: ca.Function):
        self.function = function
        self._batches: dict[int, tuple] = {}  # what `_batch` returns, for each capacity

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """Results of each point; an argument (1, size) is shared by all points."""
        count = max(map(len, arguments))
        capacity = room_for(count)
        with LOCK:
            if capacity not in self._batches:
                self._batches[capacity] = self._batch(capacity)
            call, inputs, outputs = self._batches[capacity]
            for memory, argument in zip(inputs, arguments, strict=True):
                memory[:count] = argument
                if count < capacity:
                    memory[count:] = argument[-1]
            call.trigger()
            return [memory[:count].copy(order="K") for memory in outputs]

    def _batch(self, capacity):
        """The function of a whole batch, with views of its arguments and results by point."""
        call = BufferedFunction(self.function.map(capacity) if capacity > 1 else self.function)
        shapes = [self.function.size_out(i)[::-1] for i in range(self.function.n_out())]
        inputs = [memory.reshape(capacity, -1) for memory in call.arguments]
        outputs = [flat.reshape(capacity, *shape) for flat, shape in zip(call.flat, shapes, strict=True)]
        return call, inputs, [output.swapaxes(1, 2) for output in outputs]
