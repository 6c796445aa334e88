"""Functions iterated in machine code, several points side by side.

A function is written as LLVM's intermediate code and compiled in this process by llvmlite; no C compiler is needed.
Processes of the same machine may receive the code of another one.
"""

import hashlib
import warnings
from collections.abc import Callable, Sequence
from ctypes import CFUNCTYPE, c_int64, c_void_p
from functools import cache
from typing import Any, NamedTuple
from weakref import WeakSet

import casadi as ca

from .stored_code import load, store
from .vector_code import VECTORS, Block, VectorCode


class CodeOptions(NamedTuple):
    """The processor seconds to make machine code on a server core of 2024."""

    seconds: float = 4e-3  # of the shortest function
    seconds_of_instruction: float = 5e-5  # of a graph
    # Of a loop, spent on interpreting its graph: less than it takes to make its code, as that is stored for later ones.
    seconds_of_loop: float = 1e-3


CODE = CodeOptions()
# (addresses of arrays, lengths of their rows, number of points)
Run = Callable[[Any, Any, int], None]
# The code of an object file, by a hash of the text that it was compiled from.
Compiled = dict[bytes, bytes]

_received: Compiled = {}


LEVEL = 1  # of optimisation: the next one takes longer to compile, for the same code


@cache
def _maker() -> str:
    """What makes code, and for which processor."""
    import llvmlite
    import llvmlite.binding as llvm

    versions = llvmlite.__version__, *llvm.llvm_version_info, LEVEL
    return " ".join(map(str, (*versions, llvm.get_process_triple(), llvm.get_host_cpu_name(), _features(llvm))))


@cache
def _features(llvm: Any) -> str:
    return llvm.get_host_cpu_features().flatten()


WITHOUT_LLVM = "motions by Taylor series need machine code, which cannot be made here: install llvmlite 0.45 or newer"


@cache
def say_interpreted() -> None:
    """Warn, once in a process, that there is no machine code."""
    warnings.warn(f"{WITHOUT_LLVM}; other functions are interpreted, which is many times slower", RuntimeWarning, 3)


@cache
def target() -> tuple[Any, int] | None:
    """The module of LLVM and how many numbers a vector of this processor holds; None, with a warning, without both."""
    try:
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        features = llvm.get_host_cpu_features()
        return llvm, VECTORS.lanes if features.get("avx512f") else 4 if features.get("avx2") else 2
    except (ImportError, OSError, RuntimeError):
        say_interpreted()
        return None


class CodedFunction(NamedTuple):
    """A function whose code is appended to that of a kernel.

    sizes_in, sizes_out : of its arguments and results
    append : (code, arguments by input and element) -> results by output and element; each is a value or a function that
        loads it, and a result may be a `Block` of its size
    blocks : the inputs that are blocks in the scratch memory, as long ones should be; not that which is iterated
    """

    sizes_in: Sequence[int]
    sizes_out: Sequence[int]
    append: Callable[[VectorCode, Sequence[Any]], Sequence[Any]]
    blocks: tuple[int, ...] = ()


def coded(function: ca.Function) -> CodedFunction:
    """An SX function."""
    inputs = [function.nnz_in(i) for i in range(function.n_in())]
    outputs = [function.nnz_out(i) for i in range(function.n_out())]
    return CodedFunction(inputs, outputs, lambda code, arguments: code.graph(function, arguments))


class MachineCode:
    """The function of a `Kernel` iterated at several points in machine code; `lanes` of them go side by side, and its
    object file has the bytes `compiled`.

    Raises `NotImplementedError` for an operation that has no machine code, and `RuntimeError` where LLVM fails. It is
    made under the `LOCK` of CasADi, whose graph it reads; LLVM too compiles one function at a time.
    """

    def __init__(self, function: CodedFunction, row_entry: int | None = None):
        found = target()
        if found is None:
            raise RuntimeError("LLVM is not available")
        llvm, self.lanes = found
        text = _Iteration(self.lanes).text(function, row_entry)
        self.key = hashlib.sha256(f"{_maker()}\n{text}".encode()).digest()
        self.compiled = _received.get(self.key) or load(self.key)
        if not self.compiled:
            # The module lives in a context of its own and is dropped once it is compiled, as its graph is large.
            module = llvm.parse_assembly(text, llvm.create_context())
            self.compiled = self._processor(llvm, LEVEL).emit_object(module)
            store(self.key, self.compiled)
        # An engine owns its description of the processor, so that each needs one of its own.
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), self._processor(llvm, 0))
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(self.compiled))
        self._engine.finalize_object()
        kind = CFUNCTYPE(None, *[c_void_p] * 2, c_int64)  # it releases the interpreter lock
        self.run: Run = kind(self._engine.get_function_address("run"))
        _in_use.add(self)

    @staticmethod
    def _processor(llvm: Any, level: int) -> Any:
        triple, cpu = llvm.Target.from_default_triple(), llvm.get_host_cpu_name()
        return triple.create_target_machine(cpu=cpu, features=_features(llvm), opt=level, jit=True)


_in_use = WeakSet[MachineCode]()


def compiled_here() -> Compiled:
    """The machine code that is in use in this process, for other processes of the same machine."""
    return {code.key: code.compiled for code in list(_in_use)}


def receive(compiled: Compiled) -> None:
    """Use machine code that another process has compiled, instead of compiling it again."""
    _received.update(compiled)


class _Iteration(VectorCode):
    """The code of `run(arrays, strides, count)`, which iterates a function at `count` points.

    The arrays are the function's inputs, its records, and three numbers of each point: the most records, 1 and the most
    iterations. The code overwrites the first input by the last z, and these numbers by the number of records, whether
    the point has ended, and the number of its iterations.
    """

    def text(self, function: CodedFunction, row_entry: int | None) -> str:
        """The module of LLVM with the one function `run`; `row_entry` is that of a `Kernel`."""
        sizes, n_out = function.sizes_in, len(function.sizes_out)
        n_in = len(sizes)
        self.do("br label %block", "block:", "%i = phi i64 [0, %entry], [%next, %end]")
        index = self._points()
        *inputs, ends = (self.rows(i, index) for i in (*range(n_in), n_in + n_out - 3))
        records = [self.rows(n_in + i, index) for i in range(n_out - 3)]
        table = None if row_entry is None else (inputs[-1], row_entry, sizes[-1])
        fixed = enumerate(inputs if table is None else inputs[:-1])
        load: Callable = lambda i: self.load_block if i in function.blocks else self.load_all  # noqa: E731
        start, *data = [load(i)(rows, sizes[i]) for i, rows in fixed]
        bounds = [self(f"fptosi {self.vector} {self.load(ends, j)} to {self.indices}") for j in (0, 2)]
        self.do("br label %loaded", "loaded:")
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
        head = ["define void @run(ptr %arrays, ptr %strides, i64 %count) alignstack(64) {", "entry:"]
        if self.reserved:  # of some hundred kilobytes and more, which may exceed a stack
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
        self, function: CodedFunction, start: list[str], data: list, table: tuple[str, int, int] | None,
        records: list, bounds: list[str],
    ) -> None:  # fmt: skip
        """The loop over iterations, which ends when no lane is alive; bounded are records and iterations. Of a `table`
        that each lane has, with the entry of z that states its row and the length of its rows, a row is data."""
        self.do("br label %step", "step:")
        z = [f"%z{j}" for j in range(len(start))]
        self.do(*(f"%z{j} = phi {self.vector} [{value}, %loaded], [%n{j}, %go]" for j, value in enumerate(start)))
        kinds = {"alive": self.masks, "went": self.masks, "taken": self.indices, "tried": self.indices}
        for name, kind in kinds.items():
            first = "splat (i1 1)" if name == "alive" else "zeroinitializer"
            self.do(f"%{name} = phi {kind} [{first}, %loaded], [%{name}_next, %go]")
        if table is not None:
            first, row_entry, length = table
            row = self(f"fptosi {self.vector} {z[row_entry]} to {self.indices}")
            offset = self(f"mul {self.indices} {row}, splat (i64 {length})")
            rows = self(f"getelementptr double, {self.pointers} {first}, {self.indices} {offset}")
            data = [*data, self.load_all(rows, length)]
        after, *values, recorded, going = function.append(self, [z, *data])
        after, recorded, going = ([_loaded(each) for each in result] for result in (after, recorded, going))
        taken = self(f"and {self.masks} %alive, {self.nonzero(recorded[0])}")
        goes = self(f"and {self.masks} %alive, {self.nonzero(going[0])}")
        self.do(f"br i1 {self.any(taken)}, label %record, label %go", "record:")
        for rows, numbers, size in zip(records, values, function.sizes_out[1:-2], strict=True):
            offsets = self(f"mul {self.indices} %taken, splat (i64 {size})")
            places = self(f"getelementptr double, {self.pointers} {rows}, {self.indices} {offsets}")
            if isinstance(numbers, Block):
                self.store_block(places, numbers, taken)
                continue
            for j, number in enumerate(numbers):
                self.store(places, j, _loaded(number), taken)
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


def _loaded(value: str | Callable[[], str]) -> str:
    """A value, where it has to be loaded."""
    return value() if callable(value) else value
