"""CasADi functions as vector machine code: several points side by side, each in a lane of the processor's vectors.

An SX function is written as LLVM's intermediate code, one instruction of its graph in one line, and compiled in this
process by llvmlite; no C compiler is needed and nothing is kept on disk. Sums and products are neither contracted nor
reordered, so that the results are those of CasADi's virtual machine.
"""

import ctypes
import os
import struct
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from .calls import single_assignment

# About the seconds that LLVM takes for one instruction of a graph (measured on a server core of 2024).
SECONDS_PER_INSTRUCTION = 7e-5
# So many numbers are recorded at a time, which stay in the processor's cache.
SCRATCH = 400_000

_BINARY = {ca.OP_ADD: "fadd", ca.OP_SUB: "fsub", ca.OP_MUL: "fmul", ca.OP_DIV: "fdiv"}
_COMPARED = {ca.OP_LT: "olt", ca.OP_LE: "ole", ca.OP_EQ: "oeq", ca.OP_NE: "une"}
_INTRINSIC = {ca.OP_FABS: "fabs", ca.OP_SQRT: "sqrt", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil"}
_INTRINSIC |= {ca.OP_FMIN: "minnum", ca.OP_FMAX: "maxnum", ca.OP_COPYSIGN: "copysign"}
# Functions of the C library are called lane by lane; a Taylor step has few of them.
_NAMES = """exp log pow sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh atan2 expm1 log1p erf fmod hypot
remainder""".split()
_LIBRARY = {getattr(ca, f"OP_{name.upper()}"): name for name in _NAMES} | {ca.OP_CONSTPOW: "pow"}


def threads() -> int:
    """How many threads share the points of a call: the environment's ORBITS_THREADS, 1 where it says nothing."""
    text = os.environ.get("ORBITS_THREADS", "1")
    return max(1, int(text)) if text.isdigit() else 1


@cache
def _target() -> Any:
    """The module of LLVM, its description of this processor, and how many numbers a vector holds; None without it."""
    try:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        features = llvm.get_host_cpu_features()
        machine = llvm.Target.from_default_triple().create_target_machine(
            cpu=llvm.get_host_cpu_name(), features=features.flatten(), opt=1, jit=True
        )
    except (ImportError, OSError, RuntimeError):
        return None
    return llvm, machine, 8 if features.get("avx512f") else 4 if features.get("avx2") else 2


def available() -> bool:
    """Whether functions can be compiled on this machine."""
    return _target() is not None


class _Code:
    """The lines of LLVM code on vectors of `lanes` numbers, with the functions that they declare."""

    def __init__(self, lanes: int):
        self.lanes, self.vector = lanes, f"<{lanes} x double>"
        self.lines: list[str] = []
        self.declared: set[str] = set()

    def __call__(self, text: str) -> str:
        """Append an instruction; return the name of its result."""
        name = f"%v{len(self.lines)}"
        self.lines.append(f"{name} = {text}")
        return name

    def do(self, text: str) -> None:
        """Append an instruction without a result, or a label."""
        self.lines.append(text)

    def splat(self, value: float, kind: str = "double") -> str:
        """The vector with one number in every lane."""
        word = f"0x{struct.pack('>d', float(value)).hex().upper()}" if kind == "double" else str(int(value))
        return f"<{', '.join([f'{kind} {word}'] * self.lanes)}>"

    def intrinsic(self, name: str, *values: str) -> str:
        """Call an operation of LLVM's own on vectors."""
        signature = f"@llvm.{name}.v{self.lanes}f64"
        self.declared.add(f"declare {self.vector} {signature}({', '.join([self.vector] * len(values))})")
        return self(f"call {self.vector} {signature}({', '.join(f'{self.vector} {value}' for value in values)})")

    def library(self, name: str, *values: str) -> str:
        """Call a function of the C library lane by lane."""
        self.declared.add(f"declare double @{name}({', '.join(['double'] * len(values))})")
        vector = "undef"
        for lane in range(self.lanes):
            numbers = [self(f"extractelement {self.vector} {value}, i32 {lane}") for value in values]
            number = self(f"call double @{name}({', '.join(f'double {each}' for each in numbers)})")
            vector = self(f"insertelement {self.vector} {vector}, double {number}, i32 {lane}")
        return vector

    def truth(self, comparison: str, x: str, y: str) -> str:
        """A comparison as a vector of ones and zeros."""
        mask = self(f"fcmp {comparison} {self.vector} {x}, {y}")
        return self(f"uitofp <{self.lanes} x i1> {mask} to {self.vector}")

    def nonzero(self, x: str) -> str:
        """The mask of the lanes with another number than zero."""
        return self(f"fcmp une {self.vector} {x}, {self.splat(0)}")

    def choose(self, mask: str, x: str, y: str) -> str:
        """`x` in the lanes of a mask and `y` elsewhere."""
        return self(f"select <{self.lanes} x i1> {mask}, {self.vector} {x}, {self.vector} {y}")

    def operation(self, op: int, x: str, y: str) -> str:
        """One operation of a graph, on its first and its last argument."""
        one, zero = self.splat(1), self.splat(0)
        if op in _BINARY:
            return self(f"{_BINARY[op]} {self.vector} {x}, {y}")
        if op in _COMPARED:
            return self.truth(_COMPARED[op], x, y)
        if op in _INTRINSIC:
            binary = op in (ca.OP_FMIN, ca.OP_FMAX, ca.OP_COPYSIGN)
            return self.intrinsic(_INTRINSIC[op], x, y) if binary else self.intrinsic(_INTRINSIC[op], x)
        if op in _LIBRARY:
            binary = _LIBRARY[op] in ("pow", "atan2", "fmod", "hypot", "remainder")
            return self.library(_LIBRARY[op], x, y) if binary else self.library(_LIBRARY[op], x)
        match op:
            case ca.OP_ASSIGN:
                return x
            case ca.OP_NEG:
                return self(f"fneg {self.vector} {x}")
            case ca.OP_SQ:
                return self(f"fmul {self.vector} {x}, {x}")
            case ca.OP_TWICE:
                return self(f"fadd {self.vector} {x}, {x}")
            case ca.OP_INV:
                return self(f"fdiv {self.vector} {one}, {x}")
            case ca.OP_NOT:
                return self.truth("oeq", x, zero)
            case ca.OP_AND | ca.OP_OR:
                name = "and" if op == ca.OP_AND else "or"
                mask = self(f"{name} <{self.lanes} x i1> {self.nonzero(x)}, {self.nonzero(y)}")
                return self(f"uitofp <{self.lanes} x i1> {mask} to {self.vector}")
            case ca.OP_IF_ELSE_ZERO:
                return self.choose(self.nonzero(x), y, zero)
            case ca.OP_SIGN:
                sign = self.choose(self(f"fcmp olt {self.vector} {x}, {zero}"), self.splat(-1), x)
                return self.choose(self(f"fcmp ogt {self.vector} {x}, {zero}"), one, sign)
        raise NotImplementedError(f"operation {op}")

    def graph(self, function: ca.Function, arguments: Sequence[Sequence[str]]) -> list[list[str]]:
        """The results of an SX function by output and element, from its arguments by input and element."""
        results = [[self.splat(0)] * function.nnz_out(i) for i in range(function.n_out())]
        values: list[str] = []
        for op, places, constant in single_assignment(function):
            if op == ca.OP_OUTPUT:
                results[places[1]][places[2]] = values[places[0]]
                values.append("")
            elif op == ca.OP_INPUT:
                values.append(arguments[places[0]][places[1]])
            elif constant is not None:
                values.append(self.splat(constant))
            else:
                values.append(self.operation(op, values[places[0]], values[places[-1]]))
        return results

    def rows(self, array: int, index: str) -> str:
        """Pointers to the rows that the lanes have in an array of the call: row index times row length."""
        pointer = self(f"getelementptr ptr, ptr %arrays, i64 {array}")
        stride = self(f"getelementptr i64, ptr %strides, i64 {array}")
        base, length = self(f"load ptr, ptr {pointer}"), self.spread(self(f"load i64, ptr {stride}"))
        offset = self(f"mul <{self.lanes} x i64> {index}, {length}")
        return self(f"getelementptr double, ptr {base}, <{self.lanes} x i64> {offset}")

    def spread(self, name: str) -> str:
        """The vector with one whole number in every lane."""
        kind = f"<{self.lanes} x i64>"
        first = self(f"insertelement {kind} undef, i64 {name}, i32 0")
        return self(f"shufflevector {kind} {first}, {kind} undef, <{self.lanes} x i32> zeroinitializer")

    def load(self, rows: str, element: int) -> str:
        """The vector of one element of each lane's row."""
        places = self(f"getelementptr double, <{self.lanes} x ptr> {rows}, i64 {element}")
        name = f"@llvm.masked.gather.v{self.lanes}f64.v{self.lanes}p0"
        types = f"<{self.lanes} x ptr>, i32, <{self.lanes} x i1>, {self.vector}"
        self.declared.add(f"declare {self.vector} {name}({types})")
        mask = f"<{self.lanes} x i1> {self.splat(1, 'i1')}"
        return self(f"call {self.vector} {name}(<{self.lanes} x ptr> {places}, i32 8, {mask}, {self.vector} undef)")

    def store(self, rows: str, element: int, vector: str) -> None:
        """Store a vector as one element of each lane's row."""
        places = self(f"getelementptr double, <{self.lanes} x ptr> {rows}, i64 {element}")
        mask = self.splat(1, "i1")
        name = f"@llvm.masked.scatter.v{self.lanes}f64.v{self.lanes}p0"
        self.declared.add(f"declare void {name}({self.vector}, <{self.lanes} x ptr>, i32, <{self.lanes} x i1>)")
        self.do(f"call void {name}({self.vector} {vector}, <{self.lanes} x ptr> {places}, i32 8, <{self.lanes} x i1> {mask})")


class Kernel:
    """An SX function of vectors iterated at several points, at each until it says that it is done.

    The function takes (z, data, ...) to (z after it, what is to be recorded ..., whether to record it, whether to go
    on). A call takes arrays (m, size), or (1, size) for all points, and returns the last z (m, size); the records, of
    one point after the other, arrays (steps, size); how many (m,) belong to each point; and which points (m,) have
    run out of the `capacity` of so many records and would go on.
    """

    def __init__(self, function: ca.Function):
        llvm, machine, self.lanes = _target()
        self.sizes_in = [function.nnz_in(i) for i in range(function.n_in())]
        self.sizes_out = [function.nnz_out(i) for i in range(function.n_out())]
        module = llvm.parse_assembly(_iteration(function, self.lanes))
        self._engine = llvm.create_mcjit_compiler(module, machine)
        self._engine.finalize_object()
        kind = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 2, *[ctypes.c_int64] * 3)  # it releases the interpreter lock
        self._run = kind(self._engine.get_function_address("run"))
        self._memory = threading.local()  # the arrays that records are written to, kept because new memory is slow

    def __call__(self, *arguments: np.ndarray, capacity: int) -> tuple[np.ndarray, list[np.ndarray], np.ndarray, np.ndarray]:
        inputs = [np.ascontiguousarray(argument, dtype=float) for argument in arguments]
        count = max(len(argument) for argument in inputs)
        z, ends = np.empty((count, self.sizes_out[0])), np.empty((count, 2))
        size = max(self.lanes, SCRATCH // ((capacity + 1) * max(1, sum(self.sizes_out[1:-2]))) // self.lanes * self.lanes)

        def run(first: int) -> list[np.ndarray]:
            last = min(first + size, count)
            part = [array if len(array) == 1 < count else array[first:last] for array in inputs]
            return self._chunk([*part, z[first:last], ends[first:last]], last - first, capacity)

        firsts = range(0, count, size)
        if (workers := min(threads(), len(firsts))) > 1:
            with ThreadPoolExecutor(workers) as pool:
                packed = list(pool.map(run, firsts))
        else:
            packed = [run(first) for first in firsts]
        records = packed[0] if len(packed) == 1 else [np.concatenate(parts) for parts in zip(*packed, strict=True)]
        return z, records, ends[:, 0].astype(int), ends[:, 1] != 0

    def _chunk(self, arrays: list[np.ndarray], count: int, capacity: int) -> list[np.ndarray]:
        """Run so many points of `arrays`, the arguments and the results of each point; return their records."""
        sizes = self.sizes_out[1:-2]
        # One record more is written than counts, by points that are done while their neighbours go on.
        needed = [count * (capacity + 1) * size for size in sizes]
        memory = getattr(self._memory, "records", None)
        if memory is None or any(len(array) < length for array, length in zip(memory, needed, strict=True)):
            memory = self._memory.records = [np.empty(length) for length in needed]
        records = [a[:n].reshape(count, capacity + 1, -1) for a, n in zip(memory, needed, strict=True)]
        arrays[-1:-1] = records
        strides = [size if len(array) == count else 0 for array, size in zip(arrays, self.sizes_in, strict=False)]
        strides += [self.sizes_out[0], *((capacity + 1) * size for size in sizes), 2]
        pointers = (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))
        self._run(pointers, (ctypes.c_int64 * len(arrays))(*strides), 0, count, capacity)
        kept = np.arange(capacity + 1) < arrays[-1][:, :1]
        return [record[kept] for record in records]


def _iteration(function: ca.Function, lanes: int) -> str:
    """The LLVM code of a `Kernel`: `run(arrays, strides, first, last, capacity)` for the points from first to last."""
    code = _Code(lanes)
    vector, indices, masks, n_in = code.vector, f"<{lanes} x i64>", f"<{lanes} x i1>", function.n_in()
    sizes = [function.nnz_out(i) for i in range(function.n_out())]
    code.do("br label %block")
    code.do("block:")
    code.do("%i = phi i64 [%first, %entry], [%next, %end]")
    ahead = code(f"add {indices} {code.spread('%i')}, <{', '.join(f'i64 {lane}' for lane in range(lanes))}>")
    # Lanes beyond the last point repeat it, and write the same numbers to the same place.
    final = code.spread(code("sub i64 %last, 1"))
    index = code(f"select {masks} {code(f'icmp slt {indices} {ahead}, {final}')}, {indices} {ahead}, {indices} {final}")
    inputs = [code.rows(i, index) for i in range(n_in)]
    start = [code.load(inputs[0], j) for j in range(sizes[0])]
    given = [[code.load(rows, j) for j in range(function.nnz_in(i))] for i, rows in enumerate(inputs) if i]
    ends = code.rows(n_in, index)
    records = [code.rows(n_in + i, index) for i in range(1, len(sizes) - 2)]
    counts = code.rows(n_in + len(sizes) - 2, index)
    most = code.spread("%capacity")
    code.do("br label %step")
    code.do("step:")
    for j, value in enumerate(start):
        code.do(f"%z{j} = phi {vector} [{value}, %block], [%n{j}, %step]")
    code.do(f"%alive = phi {masks} [{code.splat(1, 'i1')}, %block], [%alive_next, %step]")
    code.do(f"%taken = phi {indices} [zeroinitializer, %block], [%taken_next, %step]")
    z = [f"%z{j}" for j in range(sizes[0])]
    results = code.graph(function, [z, *given])
    for rows, size, values in zip(records, sizes[1:-2], results[1:-2], strict=True):
        offsets = code(f"mul {indices} %taken, {code.splat(size, 'i64')}")
        places = code(f"getelementptr double, <{lanes} x ptr> {rows}, {indices} {offsets}")
        for j, value in enumerate(values):
            code.store(places, j, value)
    recorded = code(f"and {masks} %alive, {code.nonzero(results[-2][0])}")
    code.do(f"%taken_next = add {indices} %taken, {code(f'zext {masks} {recorded} to {indices}')}")
    going = code(f"and {masks} %alive, {code.nonzero(results[-1][0])}")
    room = code(f"icmp slt {indices} %taken_next, {most}")
    code.do(f"%alive_next = and {masks} {going}, {room}")
    for j, value in enumerate(results[0]):
        code.do(f"%n{j} = select {masks} %alive, {vector} {value}, {vector} %z{j}")
    code.store(counts, 0, code(f"uitofp {indices} %taken_next to {vector}"))
    flags = code(f"select {masks} %alive, {masks} {going}, {masks} %went")
    code.lines[code.lines.index(f"%taken = phi {indices} [zeroinitializer, %block], [%taken_next, %step]")] += (
        f"\n%went = phi {masks} [zeroinitializer, %block], [{flags}, %step]"
    )
    code.store(counts, 1, code(f"uitofp {masks} {flags} to {vector}"))
    for j in range(sizes[0]):
        code.store(ends, j, f"%n{j}")
    whole = code(f"bitcast {masks} %alive_next to i{lanes}")
    code.do(f"br i1 {code(f'icmp ne i{lanes} {whole}, 0')}, label %step, label %end")
    code.do("end:")
    code.do(f"%next = add i64 %i, {lanes}")
    code.do(f"br i1 {code('icmp slt i64 %next, %last')}, label %block, label %leave")
    code.do("leave:")
    code.do("ret void")
    head = "define void @run(ptr %arrays, ptr %strides, i64 %first, i64 %last, i64 %capacity) {\nentry:\n"
    return "\n".join([*sorted(code.declared), head + "\n".join(code.lines), "}\n"])
