"""CasADi functions compiled to machine code, where a C compiler is found, and kept on disk for later processes."""

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import casadi as ca

from .store import store, stored

# From this many instructions on, optimising takes the compiler longer than the faster code repays.
LONG = 20_000


def compiler() -> str | None:
    """The C compiler's path: the environment's CC, else cc, gcc or clang; None when there is none."""
    names = [os.environ["CC"]] if os.environ.get("CC") else ["cc", "gcc", "clang"]
    return next((path for name in names if (path := shutil.which(name))), None)


def lengths(function: ca.Function) -> list[int]:
    """The number of instructions of each straight-line (SX) function in a function."""
    return [part.n_instructions() for part in (function, *function.find_functions()) if part.is_a("SXFunction")]


def _optimisation(function: ca.Function) -> str:
    """The compiler's option: beyond -O1, straight-line code gets no faster, and -O1 takes quadratic time."""
    return "-O1" if max(lengths(function), default=0) < LONG else "-O0"


def compile_seconds(function: ca.Function) -> float:
    """About how long `compile_function` takes (fitted to gcc 12 on a server core of 2024)."""
    if _optimisation(function) == "-O0":
        return 6e-5 * sum(lengths(function))
    return 0.05 + sum(n * (6e-5 + 3e-9 * n) for n in lengths(function))


def _name(function: ca.Function, path: str) -> str:
    """The name that machine code is kept under: a hash of the function's graph, the compiler and the machine."""
    machine = [platform.machine(), sys.platform]
    key = "\n".join([function.serialize(), ca.CasadiMeta.version(), path, _optimisation(function), *machine])
    return hashlib.sha256(key.encode()).hexdigest()[:40] + ".so"


def compiled_before(function: ca.Function) -> ca.Function | None:
    """The same function as machine code that an earlier process has kept; None when there is none."""
    path = compiler()
    try:
        if path and (code := stored(_name(function, path))) is not None:
            with tempfile.TemporaryDirectory(prefix="orbits-") as folder:
                # What is loaded is a copy of the verified bytes, as a file may change after it was read.
                copy = Path(folder) / (function.name() + ".so")
                copy.write_bytes(code)
                return ca.external(function.name(), str(copy))
    except (OSError, RuntimeError):
        pass  # There is no room for the copy, or it cannot be loaded: the function is compiled again.
    return None


def compile_function(function: ca.Function) -> ca.Function | None:
    """The same function compiled, kept for later processes and loaded; None when there is no compiler or it fails."""
    if (path := compiler()) is None:
        return None
    with tempfile.TemporaryDirectory(prefix="orbits-") as folder:
        generator = ca.CodeGenerator(function.name() + ".c")
        generator.add(function)
        generator.generate(folder + os.sep)
        source, built = (Path(folder) / (function.name() + ending) for ending in (".c", ".so"))
        command = [path, _optimisation(function), "-fPIC", "-shared", "-w", str(source), "-o", str(built), "-lm"]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=60)
            store(_name(function, path), built.read_bytes())
            return ca.external(function.name(), str(built))
        except (subprocess.SubprocessError, OSError, RuntimeError):
            return None
