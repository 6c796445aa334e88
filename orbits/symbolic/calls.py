"""CasADi functions called fast: with fixed memory, and as machine code where a C compiler is found."""

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import casadi as ca
import numpy as np

# Instructions from which on optimisation takes longer than it repays.
LONG = 20_000


class BufferedFunction:
    """A CasADi function on NumPy arrays with its memory laid out once.

    A plain call costs 10 to 20 microseconds in conversions, this one a few. Arguments are copied in and results copied
    out under a lock, so nothing is shared with the caller or with another thread.
    """

    def __init__(self, function: ca.Function):
        self.function = function
        self.lock = threading.RLock()
        self.arguments = [np.zeros(function.nnz_in(i)) for i in range(function.n_in())]
        shapes = [function.size_out(i) for i in range(function.n_out())]
        if any(function.nnz_out(i) != rows * columns for i, (rows, columns) in enumerate(shapes)):
            raise ValueError(f"the results of {function.name()} must be dense")
        self.flat = [np.zeros(rows * columns) for rows, columns in shapes]
        self.results = [flat.reshape(shape, order="F") for flat, shape in zip(self.flat, shapes, strict=True)]
        self._buffer, self.trigger = function.buffer()
        for i, array in enumerate(self.arguments):
            self._buffer.set_arg(i, memoryview(array))
        for i, array in enumerate(self.flat):
            self._buffer.set_res(i, memoryview(array))

    def __call__(self, *arguments) -> list[np.ndarray]:
        """Results as matrices of the function's shapes; arguments of matching sizes, matrices included."""
        with self.lock:
            for memory, argument in zip(self.arguments, arguments, strict=True):
                memory[:] = np.asarray(argument).ravel(order="F")
            self.trigger()
            return [result.copy() for result in self.results]


def room_for(count: int) -> int:
    """A number not much more than `count`, of few numbers, so that what is built for each can be kept: those of three
    binary digits, and zeros."""
    unit = max(1, 1 << (count - 1).bit_length() >> 3)
    return -(-count // unit) * unit


class MappedFunction:
    """A CasADi function at several points in one call: arguments (m, size) make results (m, rows, columns)."""

    def __init__(self, function: ca.Function):
        self.function = function
        self._shapes = [function.size_out(i)[::-1] for i in range(function.n_out())]
        self._calls: dict[int, BufferedFunction] = {}

    def __call__(self, *arguments) -> list[np.ndarray]:
        """Results of each point; an argument (1, size) is that of all."""
        count = max(len(argument) for argument in arguments)
        room = room_for(count)
        if room not in self._calls:
            self._calls[room] = BufferedFunction(self.function.map(room) if room > 1 else self.function)
        call = self._calls[room]
        with call.lock:
            for memory, argument in zip(call.arguments, arguments, strict=True):
                memory = memory.reshape(room, -1)
                memory[:count] = argument
                memory[count:] = argument[-1]
            call.trigger()
            return [
                flat.reshape(room, *shape)[:count].copy().swapaxes(1, 2)
                for flat, shape in zip(call.flat, self._shapes, strict=True)
            ]


def compiler() -> str | None:
    """The C compiler's path: the environment's CC, else cc, gcc or clang; None when there is none."""
    names = [os.environ["CC"]] if os.environ.get("CC") else ["cc", "gcc", "clang"]
    return next((path for name in names if (path := shutil.which(name))), None)


def lengths(function: ca.Function) -> list[int]:
    """Instructions of each piece of straight-line code in a function."""
    return [part.n_instructions() for part in (function, *function.find_functions()) if part.is_a("SXFunction")]


def _effort(function: ca.Function) -> str:
    """More than -O1 makes long straight-line code no faster, and its time grows with the square of the length."""
    return "-O1" if max(lengths(function), default=0) < LONG else "-O0"


def compile_seconds(function: ca.Function) -> float:
    """About how long `compile_function` takes (measured with gcc 12 on a 2024 server core)."""
    if _effort(function) == "-O0":
        return 6e-5 * sum(lengths(function))
    return 0.05 + sum(n * (6e-5 + 3e-9 * n) for n in lengths(function))


def _library(function: ca.Function, path: str) -> Path:
    """Where the machine code of a function is kept: by what it computes, the compiler and the machine."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    what = "\n".join([function.serialize(), ca.__version__, path, _effort(function), platform.machine(), sys.platform])
    return root / "persistent-orbits" / f"{hashlib.sha256(what.encode()).hexdigest()[:40]}.so"


def compiled_before(function: ca.Function) -> ca.Function | None:
    """The same function as machine code that an earlier process has kept, None when there is none."""
    path = compiler()
    try:
        if path and (library := _library(function, path)).exists():
            return ca.external(function.name(), str(library))
    except (OSError, RuntimeError):
        pass  # no home, or a library that cannot be loaded: it is compiled again
    return None


def compile_function(function: ca.Function) -> ca.Function | None:
    """The same function compiled, kept for later processes and loaded; None when there is no compiler or it refuses."""
    path = compiler()
    if path is None:
        return None
    with tempfile.TemporaryDirectory(prefix="orbits-") as folder:
        source = ca.CodeGenerator(function.name() + ".c")
        source.add(function)
        source.generate(folder + os.sep)
        code, made = (Path(folder) / (function.name() + ending) for ending in (".c", ".so"))
        command = [path, _effort(function), "-fPIC", "-shared", "-w", str(code), "-o", str(made), "-lm"]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=60)
            return ca.external(function.name(), str(_kept(made, _library(function, path))))
        except (subprocess.SubprocessError, OSError, RuntimeError):
            return None


def _kept(made: Path, library: Path) -> Path:
    """A library moved to where it is kept, in one go since others may look; where it is when it cannot be."""
    try:
        library.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=library.parent, delete=False) as file:
            file.write(made.read_bytes())
        os.replace(file.name, library)
        return library
    except OSError:
        return made
