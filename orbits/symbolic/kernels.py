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


def _library(function: ca.Function, path: str) -> Path:
    """Where the machine code of a function is kept: the name is a hash of its graph, the compiler and the machine."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    machine = [platform.machine(), sys.platform]
    key = "\n".join([function.serialize(), ca.CasadiMeta.version(), path, _optimisation(function), *machine])
    return root / "persistent-orbits" / f"{hashlib.sha256(key.encode()).hexdigest()[:40]}.so"


def compiled_before(function: ca.Function) -> ca.Function | None:
    """The same function as machine code that an earlier process has kept; None when there is none."""
    path = compiler()
    try:
        if path and (library := _library(function, path)).exists():
            return ca.external(function.name(), str(library))
    except (OSError, RuntimeError):
        pass  # There is no home directory, or the library cannot be loaded: the function is compiled again.
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
            return ca.external(function.name(), str(_kept(built, _library(function, path))))
        except (subprocess.SubprocessError, OSError, RuntimeError):
            return None


def _kept(built: Path, library: Path) -> Path:
    """Move a library to the cache in one atomic step, as other processes may read it; return where it is."""
    try:
        library.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=library.parent, delete=False) as file:
            file.write(built.read_bytes())
        os.replace(file.name, library)
        return library
    except OSError:
        return built
