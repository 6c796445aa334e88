"""The text of machine code on vectors: several points side by side, each in a lane of the processor's vectors.

Values are names in LLVM's intermediate code. Those of a graph are neither contracted nor reordered, so that they are
those of CasADi's virtual machine; series and polynomials use fused products and sums.
"""

import ctypes
import os
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from .calls import single_assignment


class VectorOptions(NamedTuple):
    """The vectors, how code is parted, and how rough powers are."""

    lanes: int = 8  # numbers of a vector, at most
    # Instructions of a graph after which another block begins: the time to compile one grows with its square.
    block: int = 300
    # Degree of the polynomials of a rough power: 1e-6 relative to it, for lengths of steps.
    degree: int = 6


VECTORS = VectorOptions()
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
_BITS_OF_FRACTION = 52  # of a double, whose exponents are counted from minus this on
_EXPONENT_OF_ONE = 1023


@cache
def _c_library() -> ctypes.CDLL:
    return ctypes.CDLL(None if os.name == "posix" else "ucrtbase")


@cache
def _polynomial(function: Callable, low: float, high: float) -> list[float]:
    """The coefficients of a polynomial that interpolates a function, from the highest on."""
    found = np.polynomial.Chebyshev.interpolate(function, VECTORS.degree, [low, high])
    return found.convert(kind=np.polynomial.Polynomial).coef[::-1].tolist()


@dataclass(frozen=True)
class Block:
    """Vectors of the scratch memory that follow each other, in the number of lanes or a multiple of it."""

    place: int
    count: int


class VectorCode:
    """The lines of LLVM code on vectors of `lanes` numbers, with the functions that they declare."""

    def __init__(self, lanes: int):
        self.lanes, self.vector = lanes, f"<{lanes} x double>"
        self.masks, self.indices, self.pointers = (f"<{lanes} x {kind}>" for kind in ("i1", "i64", "ptr"))
        self.lines: list[str] = []
        self.declared: set[str] = set()
        self.entry: list[str] = []  # what the code does once
        self.reserved = 0  # vectors of scratch memory, at %scratch
        self._tables: dict[tuple[float, ...], int] = {}

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

    def graph(self, function: ca.Function, arguments: "Sequence[Sequence | Block]") -> list[list[str]]:
        """The results of an SX function by output and element, from its arguments by input, which are blocks, or
        sequences of values and of functions that load them."""
        results = [[self.splat(0)] * function.nnz_out(i) for i in range(function.n_out())]
        values: list[str] = []
        for op, places, constant in single_assignment(function):
            if op == ca.OP_OUTPUT:
                results[places[1]][places[2]] = values[places[0]]
                values.append("")
            elif op == ca.OP_INPUT:
                values.append(self._argument(arguments[places[0]], places[1]))
            elif constant is not None:
                values.append(self.splat(constant))
            else:
                values.append(self.operation(op, [values[place] for place in places]))
            if len(values) % VECTORS.block == 0:
                self.do(f"br label %b{len(self.lines)}", f"b{len(self.lines)}:")
        return results

    def _argument(self, values: "Sequence | Block", element: int) -> str:
        if isinstance(values, Block):
            return self.get(self.place(values.place + element))
        value = values[element]
        return value() if callable(value) else value

    def plus(self, x: str, y: str) -> str:
        """The sum of two values."""
        zero = self.splat(0)
        return y if x == zero else x if y == zero else self.operation(ca.OP_ADD, [x, y])

    def times(self, x: str, y: str) -> str:
        """The product of two values."""
        one = self.splat(1)
        return y if x == one else x if y == one else self.operation(ca.OP_MUL, [x, y])

    def fused(self, x: str, y: str, total: str) -> str:
        """The product of two values plus a third one, in one rounding where the processor can."""
        if total == self.splat(0):
            return self.times(x, y)
        if self.splat(0) in (x, y):
            return total
        if self.splat(1) in (x, y):
            return self.plus(total, y if x == self.splat(1) else x)
        return self.intrinsic("fmuladd", x, y, total)

    def polynomial(self, coefficients: Sequence[float], x: str) -> str:
        """A polynomial with these numbers, from the highest on."""
        total = self.splat(coefficients[0])
        for each in coefficients[1:]:
            total = self.fused(total, x, self.splat(each))
        return total

    def rough_power(self, x: str, exponent: str) -> str:
        """A value that is not negative to a power, with an error of 1e-6 relative to it; of infinity and NaN it is
        large."""
        bits = self(f"bitcast {self.vector} {x} to {self.indices}")
        shift, one = _BITS_OF_FRACTION, _EXPONENT_OF_ONE << _BITS_OF_FRACTION
        exponents = self(f"sub {self.indices} {self(f'lshr {self.indices} {bits}, splat (i64 {shift})')}, "
                         f"splat (i64 {_EXPONENT_OF_ONE})")  # fmt: skip
        fraction = self(f"and {self.indices} {bits}, splat (i64 {(1 << shift) - 1})")
        fraction = self(f"or {self.indices} {fraction}, splat (i64 {one})")
        fraction = self(f"bitcast {self.indices} {fraction} to {self.vector}")
        logarithm = self.plus(
            self(f"sitofp {self.indices} {exponents} to {self.vector}"),
            self.polynomial(_polynomial(np.log2, 1.0, 2.0), fraction),
        )
        power, most = self.operation(ca.OP_MUL, [logarithm, exponent]), float(_EXPONENT_OF_ONE - 1)
        power = self.intrinsic("minnum", self.intrinsic("maxnum", power, self.splat(-most)), self.splat(most))
        whole = self.intrinsic("floor", power)
        part = self.polynomial(_polynomial(np.exp2, 0.0, 1.0), self.operation(ca.OP_SUB, [power, whole]))
        whole = self(f"fptosi {self.vector} {whole} to {self.indices}")
        scale = self(f"shl {self.indices} {self(f'add {self.indices} {whole}, splat (i64 {_EXPONENT_OF_ONE})')}, "
                     f"splat (i64 {shift})")  # fmt: skip
        scale = self(f"bitcast {self.indices} {scale} to {self.vector}")
        return self.choose(self.compare("oeq", x, self.splat(0)), self.splat(0), self.times(part, scale))

    def any(self, mask: str) -> str:
        """Whether a mask has a lane."""
        return self(f"icmp ne i{self.lanes} {self(f'bitcast {self.masks} {mask} to i{self.lanes}')}, 0")

    def if_any(self, mask: str, number: int) -> str:
        """A whole number where a mask has a lane, else 0."""
        return self(f"select i1 {self.any(mask)}, i64 {number}, i64 0")

    def integer(self, operation: str, x: str | int, y: str | int) -> str:
        """An operation on two whole numbers."""
        return self(f"{operation} i64 {x}, {y}")

    def reserve(self, count: int) -> int:
        """The first of some places in the scratch memory."""
        self.reserved += count
        return self.reserved - count

    def table(self, numbers: Iterable[float]) -> int:
        """The first place of constants in the scratch memory."""
        if (key := tuple(numbers)) not in self._tables:
            first = self._tables[key] = self.reserve(len(key))
            for place, number in enumerate(key, start=first):
                self.entry.append(f"%t{place} = getelementptr {self.vector}, ptr %scratch, i64 {place}")
                self.entry.append(f"store {self.vector} {self.splat(number)}, ptr %t{place}")
        return self._tables[key]

    def place(self, number: int) -> str:
        """The pointer to a place in the scratch memory."""
        return self.moved("%scratch", number)

    def moved(self, pointer: str, count: int) -> str:
        """A pointer that is moved by a number of vectors."""
        return self(f"getelementptr {self.vector}, ptr {pointer}, i64 {count}")

    def offset(self, pointer: str, index: str | int, scale: int = 1) -> str:
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

    def loop(
        self, first: int | str, last: int | str, body: Callable[[str, list[str]], list[str]],
        start: Sequence[str] = (), while_first: bool = False,
    ) -> list[str]:  # fmt: skip
        """A loop over an index from `first` up to `last`: `body` appends the code of one index from the index and the
        values before it, and returns the values after it. Returns the last values; where both ends are known numbers,
        there has to be an index. With `while_first` it ends where no lane of the first value is positive."""
        label, kinds = f"l{len(self.lines)}", ["i64", *[self.vector] * len(start)]
        runs = isinstance(first, int) and isinstance(last, int)
        self.do(f"br label %{label}_before", f"{label}_before:")
        if runs:
            self.do(f"br label %{label}")
        else:
            self.do(f"br i1 {self(f'icmp sge i64 {last}, {first}')}, label %{label}, label %{label}_after")
        names = [f"%{label}_index", *(f"%{label}_{i}" for i in range(len(start)))]
        at = len(self.lines) + 1
        self.do(f"{label}:", *[""] * len(names))  # what comes from the end of the body is known after it
        ends = body(names[0], names[1:])
        self.do(f"br label %{label}_next", f"{label}_next:", f"{names[0]}_next = add i64 {names[0]}, 1")
        going = self(f"icmp sle i64 {names[0]}_next, {last}")
        if while_first:
            going = self(f"and i1 {going}, {self.any(self.compare('ogt', ends[0], self.splat(0)))}")
        self.do(f"br i1 {going}, label %{label}, label %{label}_after", f"{label}_after:")
        each = zip(kinds, names, [first, *start], [f"{names[0]}_next", *ends], strict=True)
        self.lines[at : at + len(kinds)] = [
            f"{name} = phi {kind} [{before}, %{label}_before], [{after}, %{label}_next]"
            for kind, name, before, after in each
        ]
        if runs:
            return ends
        return [
            self(f"phi {self.vector} [{before}, %{label}_before], [{after}, %{label}_next]")
            for before, after in zip(start, ends, strict=True)
        ]

    def once(self, mask: str, body: Callable[[str, list[str]], list[str]], start: Sequence[str]) -> list[str]:
        """The values that `body` makes of others where a mask has a lane, else these."""
        return self.loop(1, self.if_any(mask, 1), body, start)

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

    def store_block(self, rows: str, block: Block, mask: str) -> None:
        """Store the vectors of a block as the first elements of each lane's row, in the lanes of a mask: as many
        vectors as lanes are transposed, so that each lane stores its numbers together."""
        lanes, idle = self.lanes, self.place(self.reserve(block.count))
        kept = []
        for lane in range(lanes):
            own = self(f"extractelement {self.pointers} {rows}, i32 {lane}")
            used = self(f"extractelement {self.masks} {mask}, i32 {lane}")
            kept.append(self(f"select i1 {used}, ptr {own}, ptr {idle}"))

        def part(index: str, _: list[str]) -> list[str]:
            begin = self.integer("mul", index, lanes)
            first = self.offset(self.place(block.place), begin)
            vectors = self._transposed([self.get(self.moved(first, i)) for i in range(lanes)])
            for pointer, vector in zip(kept, vectors, strict=True):
                target = self(f"getelementptr double, ptr {pointer}, i64 {begin}")
                self.do(f"store {self.vector} {vector}, ptr {target}, align 8")
            return []

        self.loop(0, block.count // lanes - 1, part)

    def load_all(self, rows: str, count: int) -> list[str]:
        """The vectors of the first elements of each lane's row: where their number is that of the lanes, each lane
        loads its numbers together, which is many times faster than one element of all lanes at a time."""
        lanes, vectors = self.lanes, list[str]()
        if count >= lanes:
            own = [self(f"extractelement {self.pointers} {rows}, i32 {lane}") for lane in range(lanes)]
            for first in range(0, count - lanes + 1, lanes):
                places = [self(f"getelementptr double, ptr {pointer}, i64 {first}") for pointer in own]
                loaded = [self(f"load {self.vector}, ptr {place}, align 8") for place in places]
                vectors += self._transposed(loaded)
        return vectors + [self.load(rows, j) for j in range(len(vectors), count)]

    def load_block(self, rows: str, count: int) -> Block:
        """A block of the first elements of each lane's row, which are loaded together in a loop."""
        lanes, block = self.lanes, Block(self.reserve(count), count)
        own = [self(f"extractelement {self.pointers} {rows}, i32 {lane}") for lane in range(lanes)]

        def part(index: str, _: list[str]) -> list[str]:
            begin = self.integer("mul", index, lanes)
            places = [self(f"getelementptr double, ptr {pointer}, i64 {begin}") for pointer in own]
            first = self.offset(self.place(block.place), begin)
            loaded = [self(f"load {self.vector}, ptr {place}, align 8") for place in places]
            for i, vector in enumerate(self._transposed(loaded)):
                self.put(vector, self.moved(first, i))
            return []

        whole = count // lanes
        if whole:
            self.loop(0, whole - 1, part)
        for j in range(whole * lanes, count):
            self.put(self.load(rows, j), self.place(block.place + j))
        return block

    def _transposed(self, vectors: Sequence[str]) -> list[str]:
        """The vectors, one for each lane, with what each has in each lane exchanged."""
        vectors, lanes, half = list(vectors), self.lanes, self.lanes // 2
        while half:
            for i in (i for i in range(lanes) if not i & half):
                pair = vectors[i], vectors[i + half]
                low = [lane if not lane & half else lanes + lane - half for lane in range(lanes)]
                high = [lane + half if not lane & half else lanes + lane for lane in range(lanes)]
                vectors[i], vectors[i + half] = self._shuffled(*pair, low), self._shuffled(*pair, high)
            half //= 2
        return vectors

    def _shuffled(self, x: str, y: str, lanes: Sequence[int]) -> str:
        order = f"<{self.lanes} x i32> <{', '.join(f'i32 {lane}' for lane in lanes)}>"
        return self(f"shufflevector {self.vector} {x}, {self.vector} {y}, {order}")
