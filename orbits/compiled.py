"""CasADi functions as machine code, where a C compiler is found; nothing here is ever required."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import casadi as ca


def compiler() -> str | None:
    """The C compiler's path: the environment's CC, else cc, gcc or clang; None when there is none."""
    names = [os.environ["CC"]] if os.environ.get("CC") else ["cc", "gcc", "clang"]
    return next((path for name in names if (path := shutil.which(name))), None)


def compile_function(function: ca.Function) -> ca.Function | None:
    """The same function compiled and loaded, None when there is no compiler or it refuses; takes about 0.4 s."""
    path = compiler()
    if path is None:
        return None
    with tempfile.TemporaryDirectory(prefix="orbits-") as folder:
        source = ca.CodeGenerator(function.name() + ".c")
        source.add(function)
        source.generate(folder + os.sep)
        library = Path(folder) / (function.name() + ".so")
        command = [path, "-O2", "-fPIC", "-shared", "-w", str(library.with_suffix(".c")), "-o", str(library), "-lm"]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=60)
            return ca.external(function.name(), str(library))
        except (subprocess.SubprocessError, OSError, RuntimeError):
            return None
