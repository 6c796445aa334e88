"""CasADi functions as vector machine code: several points side by side, each in a lane of the processor's vectors.

An SX function is written as LLVM's intermediate code, one instruction of its graph in one line, and compiled in this
process by llvmlite; no C compiler is needed and nothing is stored on disk. Processes of the same machine may receive
the code of another one. Sums and products are neither contracted nor reordered, so that the results are those of
CasADi's virtual machine.
"""

import ctypes
import hashlib
import os
import struct
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from itertools import chain
from typing import Any, NamedTuple
from weakref import WeakSet

import casadi as ca

from .calls import single_assignment
from .series_loops import InLoops


class CodeOptions(NamedTuple):
    """The vectors and blocks of machine code, and the processor seconds to make it on a server core of 2024."""

    lanes: int = 8  # numbers of a vector, at most
    # Instructions of a graph after which another block begins: the time to compile one grows with its square.
    block: int = 300
    seconds: float = 4e-3  # of the shortest function
    seconds_plain: float = 1.5e-5  # of each further instruction in code that is not optimised
    seconds_optimised: float = 8e-5  # of each further instruction in optimised code


CODE = CodeOptions()
# Operations on the first and the last value, which are one where there is only one: x * x is the square of x.
_ARITHMETIC = {ca.OP_ADD: "fadd", ca.OP_SUB: "fsub", ca.OP_MUL: "fmul", ca.OP_DIV: "fdiv"}
_ARITHMETIC |= {ca.OP_SQ: "fmul", ca.OP_TWICE: "fadd"}
_COMPARISONS = {ca.OP_LT: "olt", ca.OP_LE: "ole", ca.OP_EQ: "oeq", ca.OP_NE: "une"}
_INTRINSICS = {ca.OP_FABS: "fabs", ca.OP_SQRT: "sqrt", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil"}
_INTRINSICS |= {ca.OP_FMIN: "minnum", ca.OP_FMAX: "maxnum", ca.OP_COPYSIGN: "copysign"}
# Functions of the C library are called lane by lane; a Taylor step has few of them.
_TRIGONOMETRIC = [kind + name + end for name in ("sin", "cos", "tan") for kind in ("", "a") for end in ("", "h")]
_CALLED = [*_TRIGONOMETRIC, "exp", "log", "expm1", "log1p", "erf", "pow", "atan2", "fmod", "hypot", "remainder"]
_LIBRARY = {getattr(ca, f"OP_{name.upper()}"): name for name in _CALLED} | {ca.OP_CONSTPOW: "pow"}
# All operations that have machine code.
_OTHERS = ("ASSIGN", "NEG", "INV", "NOT", "AND", "OR", "IF_ELSE_ZERO", "SIGN", "INPUT", "OUTPUT", "CONST")
OPERATIONS = {*_ARITHMETIC, *_COMPARISONS, *_INTRINSICS, *_LIBRARY, *(getattr(ca, f"OP_{name}") for name in _OTHERS)}
# (addresses of arrays, lengths of their rows, number of points)
Run = Callable[[Any, Any, int], None]
# The code of an object file and whether it is optimised, by a hash of the text that it was compiled from.
Compiled = dict[bytes, tuple[bytes, bool]]

_received: Compiled = {}


@cache
def say_interpreted() -> None:
    """Warn, once in a process, that there is no machine code."""
    message = "no machine code can be made here: motions are interpreted, which takes many times as long; "
    warnings.warn(message + "install llvmlite 0.45 or newer", RuntimeWarning, stacklevel=3)


@cache
def target() -> tuple[Any, int] | None:
    """The module of LLVM and how many numbers a vector of this processor holds; None, with a warning, without both."""
    try:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        features = llvm.get_host_cpu_features()
        return llvm, CODE.lanes if features.get("avx512f") else 4 if features.get("avx2") else 2
    except (ImportError, OSError, RuntimeError):
        say_interpreted()
        return None


@cache
def _c_library() -> ctypes.CDLL:
    return ctypes.CDLL(None if os.name == "posix" else "ucrtbase")


def compile_seconds(instructions: int, optimised: bool = False) -> float:
    """About the seconds to compile this number of instructions of a graph."""
    return CODE.seconds + (CODE.seconds_optimised if optimised else CODE.seconds_plain) * instructions


class MachineCode:
    """The function of a `Kernel` iterated at several points in machine code; `lanes` of them go side by side, and
    its object file has the bytes `compiled`. `optimised` code takes 1.4 to 3.3 times less time, and about five times as
    long to make.

    Raises `NotImplementedError` for an operation that has no machine code, and `RuntimeError` where LLVM fails. It is
    made under the `LOCK` of CasADi, whose graph it reads; LLVM too compiles one function at a time.
    """

    def __init__(self, function: ca.Function | InLoops, optimised: bool = False, row_entry: int | None = None):
        found = target()
        if found is None:
            raise RuntimeError("LLVM is not available")
        llvm, self.lanes = found
        text = _Iteration(self.lanes).text(function, row_entry)
        self.key = hashlib.sha256(text.encode()).digest()
        self.compiled, self.optimised = _received.get(self.key, (b"", False))
        if not self.compiled or optimised > self.optimised:
            # The module lives in a context of its own and is dropped once it is compiled, as its graph is large.
            module = llvm.parse_assembly(text, llvm.create_context())
            level = 2 * (optimised or isinstance(function, InLoops))
            self.compiled, self.optimised = self._processor(llvm, level).emit_object(module), optimised
        # An engine owns its description of the processor, so that each needs one of its own.
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), self._processor(llvm, 0))
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(self.compiled))
        self._engine.finalize_object()
        kind = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 2, ctypes.c_int64)  # it releases the interpreter lock
        self.run: Run = kind(self._engine.get_function_address("run"))
        _in_use.add(self)

    @staticmethod
    def _processor(llvm: Any, level: int) -> Any:
        features = llvm.get_host_cpu_features().flatten()
        triple = llvm.Target.from_default_triple()
        return triple.create_target_machine(cpu=llvm.get_host_cpu_name(), features=features, opt=level, jit=True)


_in_use = WeakSet[MachineCode]()


def compiled_here() -> Compiled:
    """The machine code that is in use in this process, for other processes of the same machine."""
    return {code.key: (code.compiled, code.optimised) for code in list(_in_use)}


def receive(compiled: Compiled) -> None:
    """Use machine code that another process has compiled, instead of compiling it again."""
    _received.update(compiled)


class _Code:
    """The lines of LLVM code on vectors of `lanes` numbers, with the functions that they declare."""

    def __init__(self, lanes: int):
        self.lanes, self.vector = lanes, f"<{lanes} x double>"
        self.masks, self.indices, self.pointers = (f"<{lanes} x {kind}>" for kind in ("i1", "i64", "ptr"))
        self.lines: list[str] = []
        self.declared: set[str] = set()
        self.functions: list[str] = []  # others, which the code calls
        self.entry: list[str] = []  # what the code does once
        self.reserved = 0  # vectors of scratch memory, at %scratch

    def __call__(self, text: str) -> str:
        """Append an instruction; return the name of its result."""
        name = f"%v{len(self.lines)}"
        self.lines.append(f"{name} = {text}")
        return name

    def do(self, *lines: str) -> None:
        """Append instructions without a result or with a name of their own, and labels."""
        self.lines.extend(lines)

    @staticmethod
    def splat(value: float) -> str:
        """The vector with one number in every lane."""
        return f"splat (double 0x{struct.pack('>d', float(value)).hex().upper()})"

    def call(self, result: str, name: str, *arguments: tuple[str, str]) -> str:
        """Call a function with arguments (type, value); return the name of its result, if it has one."""
        self.declared.add(f"declare {result} @{name}({', '.join(kind for kind, _ in arguments)})")
        text = f"call {result} @{name}({', '.join(map(' '.join, arguments))})"
        if result != "void":
            return self(text)
        self.do(text)
        return ""

    def intrinsic(self, name: str, *values: str) -> str:
        """Call an operation of LLVM's own on vectors."""
        return self.call(self.vector, f"llvm.{name}.v{self.lanes}f64", *((self.vector, value) for value in values))

    def library(self, name: str, *values: str) -> str:
        """Call a function of the C library lane by lane."""
        if not hasattr(_c_library(), name):  # LLVM would call address 0
            raise NotImplementedError(f"this C library has no {name}")
        vector = "poison"
        for lane in range(self.lanes):
            numbers = [self(f"extractelement {self.vector} {value}, i32 {lane}") for value in values]
            number = self.call("double", name, *(("double", number) for number in numbers))
            vector = self(f"insertelement {self.vector} {vector}, double {number}, i32 {lane}")
        return vector

    def number(self, mask: str) -> str:
        """A mask as a vector of ones and zeros."""
        return self(f"uitofp {self.masks} {mask} to {self.vector}")

    def compare(self, comparison: str, x: str, y: str) -> str:
        """The mask of the lanes in which a comparison holds."""
        return self(f"fcmp {comparison} {self.vector} {x}, {y}")

    def nonzero(self, x: str) -> str:
        """The mask of the lanes with another number than zero."""
        return self.compare("une", x, self.splat(0))

    def choose(self, mask: str, x: str, y: str) -> str:
        """`x` in the lanes of a mask and `y` elsewhere."""
        return self(f"select {self.masks} {mask}, {self.vector} {x}, {self.vector} {y}")

    def operation(self, op: int, values: Sequence[str]) -> str:
        """One operation of a graph on one value or two."""
        x, y = values[0], values[-1]
        if op in _ARITHMETIC:
            return self(f"{_ARITHMETIC[op]} {self.vector} {x}, {y}")
        if op in _COMPARISONS:
            return self.number(self.compare(_COMPARISONS[op], x, y))
        if op in _INTRINSICS:
            return self.intrinsic(_INTRINSICS[op], *values)
        if op in _LIBRARY:
            return self.library(_LIBRARY[op], *values)
        match op:
            case ca.OP_ASSIGN:
                return x
            case ca.OP_NEG:
                return self(f"fneg {self.vector} {x}")
            case ca.OP_INV:
                return self(f"fdiv {self.vector} {self.splat(1)}, {x}")
            case ca.OP_NOT:
                return self.number(self.compare("oeq", x, self.splat(0)))
            case ca.OP_AND | ca.OP_OR:
                name = "and" if op == ca.OP_AND else "or"
                return self.number(self(f"{name} {self.masks} {self.nonzero(x)}, {self.nonzero(y)}"))
            case ca.OP_IF_ELSE_ZERO:
                return self.choose(self.nonzero(x), y, self.splat(0))
            case ca.OP_SIGN:
                sign = self.choose(self.compare("olt", x, self.splat(0)), self.splat(-1), x)
                return self.choose(self.compare("ogt", x, self.splat(0)), self.splat(1), sign)
        raise NotImplementedError(f"operation {op}")

    def graph(self, function: ca.Function, arguments: Sequence[Sequence]) -> list[list[str]]:
        """The results of an SX function by output and element, from its arguments by input and element, which are
        values, or functions that load them."""
        results = [[self.splat(0)] * function.nnz_out(i) for i in range(function.n_out())]
        values: list[str] = []
        for op, places, constant in single_assignment(function):
            if op == ca.OP_OUTPUT:
                results[places[1]][places[2]] = values[places[0]]
                values.append("")
            elif op == ca.OP_INPUT:
                value = arguments[places[0]][places[1]]
                values.append(value() if callable(value) else value)
            elif constant is not None:
                values.append(self.splat(constant))
            else:
                values.append(self.operation(op, [values[place] for place in places]))
            if len(values) % CODE.block == 0:
                self.do(f"br label %b{len(self.lines)}", f"b{len(self.lines)}:")
        return results

    def plus(self, x: str, y: str) -> str:
        """The sum of two values."""
        return self.operation(ca.OP_ADD, [x, y])

    def minus(self, x: str, y: str) -> str:
        """The difference of two values."""
        return self.operation(ca.OP_SUB, [x, y])

    def times(self, x: str, y: str) -> str:
        """The product of two values."""
        return self.operation(ca.OP_MUL, [x, y])

    def is_one(self, x: str) -> bool:
        """Whether a value is the number 1."""
        return x == self.splat(1)

    def integer(self, operation: str, x: str, y: str | int) -> str:
        """An operation on two whole numbers."""
        return self(f"{operation} i64 {x}, {y}")

    def reserve(self, count: int) -> int:
        """The first of some places in the scratch memory."""
        self.reserved += count
        return self.reserved - count

    def table(self, numbers: Sequence[float]) -> int:
        """The first place of constants in the scratch memory."""
        first = self.reserve(len(numbers))
        for place, number in enumerate(numbers, start=first):
            self.entry.append(f"%t{place} = getelementptr {self.vector}, ptr %scratch, i64 {place}")
            self.entry.append(f"store {self.vector} {self.splat(number)}, ptr %t{place}")
        return first

    def apart(self, body: Callable[[list[list[str]]], object], arguments: Sequence[Sequence[str]]) -> None:
        """Do what `body` appends from values like the arguments in a function of its own, in the same memory."""
        places = [[self.reserve(1) for _ in each] for each in arguments]
        for place, value in zip(chain(*places), chain(*arguments), strict=True):
            self.put(value, self.place(place))
        name, lines, self.lines = f"part{len(self.functions)}", self.lines, []
        body([[self.get(self.place(place)) for place in each] for each in places])
        head = f"define internal void @{name}(ptr %scratch) noinline {{"
        self.functions.append("\n".join([head, "entry:", *self.lines, "ret void", "}"]))
        self.lines = lines
        self.do(f"call void @{name}(ptr %scratch)")

    def place(self, number: int) -> str:
        """The pointer to a place in the scratch memory."""
        return self.moved("%scratch", number)

    def moved(self, pointer: str, count: int) -> str:
        """A pointer that is moved by a number of vectors."""
        return self(f"getelementptr {self.vector}, ptr {pointer}, i64 {count}")

    def offset(self, pointer: str, index: str, scale: int = 1) -> str:
        """A pointer that is moved by a multiple of an index."""
        index = index if scale == 1 else self.integer("mul", index, scale)
        return self(f"getelementptr {self.vector}, ptr {pointer}, i64 {index}")

    def get(self, pointer: str) -> str:
        """The vector at a pointer."""
        return self(f"load {self.vector}, ptr {pointer}")

    def put(self, value: str, pointer: str) -> None:
        """Store a vector at a pointer."""
        self.do(f"store {self.vector} {value}, ptr {pointer}")

    def later(self, place: int) -> Callable[[], str]:
        """A function that loads the vector at a place of the scratch memory."""
        return lambda: self.get(self.place(place))

    def loop(self, first: int, last: str | int, body: Callable[[str, list[str]], list[str]], start: list[str]) -> list:
        """A loop over an index from `first` up to `last`: `body` appends the code of one index from the index and the
        values before it, and returns the values after it. Returns the last values."""
        label = f"l{len(self.lines)}"
        self.do(f"br label %{label}_before", f"{label}_before:", f"br label %{label}", f"{label}:")
        index, values, at = f"%{label}_index", [f"%{label}_{i}" for i in range(len(start))], len(self.lines)
        self.do(*[""] * (1 + len(start)))  # what comes from the end of the body is known after it
        going = self(f"icmp sle i64 {index}, {last}")
        self.do(f"br i1 {going}, label %{label}_body, label %{label}_after", f"{label}_body:")
        ends = body(index, values)
        self.do(f"br label %{label}_next", f"{label}_next:", f"{index}_next = add i64 {index}, 1")
        self.do(f"br label %{label}", f"{label}_after:")
        kinds = ["i64", *[self.vector] * len(start)]
        each = zip(kinds, [index, *values], [first, *start], [f"{index}_next", *ends], strict=True)
        self.lines[at : at + len(kinds)] = [
            f"{name} = phi {kind} [{before}, %{label}_before], [{after}, %{label}_next]"
            for kind, name, before, after in each
        ]
        return values

    def rows(self, array: int, index: str) -> str:
        """Pointers to the rows that the lanes have in an array of the call: row index times row length."""
        pointer = self(f"getelementptr ptr, ptr %arrays, i64 {array}")
        stride = self(f"getelementptr i64, ptr %strides, i64 {array}")
        base, length = self(f"load ptr, ptr {pointer}"), self.spread(self(f"load i64, ptr {stride}"))
        offset = self(f"mul {self.indices} {index}, {length}")
        return self(f"getelementptr double, ptr {base}, {self.indices} {offset}")

    def spread(self, name: str) -> str:
        """The vector with one whole number in every lane."""
        first = self(f"insertelement {self.indices} poison, i64 {name}, i32 0")
        same = f"<{self.lanes} x i32> zeroinitializer"
        return self(f"shufflevector {self.indices} {first}, {self.indices} poison, {same}")

    def load(self, rows: str, element: int) -> str:
        """The vector of one element of each lane's row."""
        places = self(f"getelementptr double, {self.pointers} {rows}, i64 {element}")
        kinds, lanes = (self.pointers, "i32", self.masks, self.vector), f"v{self.lanes}"
        values = places, "8", "splat (i1 1)", "poison"
        return self.call(self.vector, f"llvm.masked.gather.{lanes}f64.{lanes}p0", *zip(kinds, values, strict=True))

    def store(self, rows: str, element: int, vector: str, mask: str = "splat (i1 1)") -> None:
        """Store a vector as one element of each lane's row, in the lanes of a mask."""
        places = self(f"getelementptr double, {self.pointers} {rows}, i64 {element}")
        kinds, lanes = (self.vector, self.pointers, "i32", self.masks), f"v{self.lanes}"
        values = vector, places, "8", mask
        self.call("void", f"llvm.masked.scatter.{lanes}f64.{lanes}p0", *zip(kinds, values, strict=True))


class _Iteration(_Code):
    """The code of `run(arrays, strides, count)`, which iterates a function at `count` points.

    The arrays are the function's inputs, its records, and three numbers of each point: the most records, 1 and the most
    iterations. The code overwrites the first input by the last z, and these numbers by the number of records, whether
    the point has ended, and the number of its iterations.
    """

    def text(self, function: ca.Function | InLoops, row_entry: int | None) -> str:
        """The module of LLVM with the one function `run`; `row_entry` is that of a `Kernel`."""
        n_in, n_out = function.n_in(), function.n_out()
        self.do("br label %block", "block:", "%i = phi i64 [0, %entry], [%next, %end]")
        index = self._points()
        *inputs, ends = (self.rows(i, index) for i in (*range(n_in), n_in + n_out - 3))
        records = [self.rows(n_in + i, index) for i in range(n_out - 3)]
        table = None if row_entry is None else (inputs[-1], row_entry, function.nnz_in(n_in - 1))
        fixed = enumerate(inputs if table is None else inputs[:-1])
        start, *data = [[self.load(rows, j) for j in range(function.nnz_in(i))] for i, rows in fixed]
        bounds = [self(f"fptosi {self.vector} {self.load(ends, j)} to {self.indices}") for j in (0, 2)]
        self._step(function, start, data, table, records, bounds)
        self.do("end:")
        for j in range(len(start)):
            self.store(inputs[0], j, f"%n{j}")
        for j, name in ((0, "taken"), (2, "tried")):
            self.store(ends, j, self(f"uitofp {self.indices} %{name}_next to {self.vector}"))
        self.store(ends, 1, self.choose("%went_next", self.splat(0), self.splat(1)))
        self.do(f"%next = add i64 %i, {self.lanes}")
        self.do(f"br i1 {self('icmp slt i64 %next, %count')}, label %block, label %leave", "leave:")
        self.do(*(["call void @free(ptr %memory)"] if self.reserved else []), "ret void")
        # Beside loops, which take most of the time, straight code is not worth the time to optimise it.
        how = "alignstack(64) noinline optnone" if self.functions else "alignstack(64)"
        head = [*self.functions, f"define void @run(ptr %arrays, ptr %strides, i64 %count) {how} {{", "entry:"]
        if self.reserved:  # of some hundred kilobytes and more, which no stack has to have
            size = 8 * self.lanes
            self.declared |= {"declare ptr @malloc(i64)", "declare void @free(ptr)"}
            self.declared.add("declare ptr @llvm.ptrmask.p0.i64(ptr, i64)")
            head += [
                f"%memory = call ptr @malloc(i64 {size * (self.reserved + 1)})",
                f"%behind = getelementptr i8, ptr %memory, i64 {size - 1}",
                f"%scratch = call ptr @llvm.ptrmask.p0.i64(ptr %behind, i64 {-size})",
            ]
        return "\n".join([*sorted(self.declared), *head, *self.entry, *self.lines, "}\n"])

    def _points(self) -> str:
        """The points of the lanes from %i on; lanes beyond the last point repeat it, and write the same numbers to the
        same place."""
        steps = f"<{', '.join(f'i64 {lane}' for lane in range(self.lanes))}>"
        ahead = self(f"add {self.indices} {self.spread('%i')}, {steps}")
        final = self.spread(self("sub i64 %count, 1"))
        inside = self(f"icmp slt {self.indices} {ahead}, {final}")
        return self(f"select {self.masks} {inside}, {self.indices} {ahead}, {self.indices} {final}")

    def _step(
        self, function: ca.Function | InLoops, start: list[str], data: list, table: tuple[str, int, int] | None,
        records: list, bounds: list[str],
    ) -> None:  # fmt: skip
        """The loop over iterations, which ends when no lane is alive; bounded are records and iterations. Of a `table`
        that each lane has, with the entry of z that states its row and the length of its rows, a row is data."""
        self.do("br label %step", "step:")
        z = [f"%z{j}" for j in range(len(start))]
        self.do(*(f"%z{j} = phi {self.vector} [{value}, %block], [%n{j}, %go]" for j, value in enumerate(start)))
        kinds = {"alive": self.masks, "went": self.masks, "taken": self.indices, "tried": self.indices}
        for name, kind in kinds.items():
            first = "splat (i1 1)" if name == "alive" else "zeroinitializer"
            self.do(f"%{name} = phi {kind} [{first}, %block], [%{name}_next, %go]")
        if table is not None:
            first, row_entry, length = table
            row = self(f"fptosi {self.vector} {z[row_entry]} to {self.indices}")
            offset = self(f"mul {self.indices} {row}, splat (i64 {length})")
            rows = self(f"getelementptr double, {self.pointers} {first}, {self.indices} {offset}")
            data = [*data, [self.load(rows, j) for j in range(length)]]
        results = (
            function.append(self, [z, *data]) if isinstance(function, InLoops) else self.graph(function, [z, *data])
        )
        after, *values, recorded, going = results
        taken = self(f"and {self.masks} %alive, {self.nonzero(recorded[0])}")
        goes = self(f"and {self.masks} %alive, {self.nonzero(going[0])}")
        self.do(f"br i1 {self.any(taken)}, label %record, label %go", "record:")
        for rows, numbers in zip(records, values, strict=True):
            offsets = self(f"mul {self.indices} %taken, splat (i64 {len(numbers)})")
            places = self(f"getelementptr double, {self.pointers} {rows}, {self.indices} {offsets}")
            for j, number in enumerate(numbers):
                self.store(places, j, number, taken)
        self.do("br label %go", "go:")
        for j, value in enumerate(after):
            self.do(f"%n{j} = select {self.masks} %alive, {self.vector} {value}, {self.vector} %z{j}")
        self.do(f"%went_next = select {self.masks} %alive, {self.masks} {goes}, {self.masks} %went")
        alive = goes
        for name, counted, bound in zip(("taken", "tried"), (taken, "%alive"), bounds, strict=True):
            one = self(f"zext {self.masks} {counted} to {self.indices}")
            self.do(f"%{name}_next = add {self.indices} %{name}, {one}")
            alive = self(f"and {self.masks} {alive}, {self(f'icmp slt {self.indices} %{name}_next, {bound}')}")
        self.do(f"%alive_next = and {self.masks} {alive}, %alive")
        self.do(f"br i1 {self.any('%alive_next')}, label %step, label %end")

    def any(self, mask: str) -> str:
        """Whether a mask has a lane."""
        return self(f"icmp ne i{self.lanes} {self(f'bitcast {self.masks} {mask} to i{self.lanes}')}, 0")
