"""Lossless periodic orbits of machines with plastic contact: found, certified, followed, controlled and designed."""

import ast
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

# The interface file beside this one states each name with its module, which is imported when the name is first used:
# a command that finds an orbit needs half of them.
_INTERFACE = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
PLACE_OF = {each.name: line.module for line in _INTERFACE if isinstance(line, ast.ImportFrom) for each in line.names}
__all__ = next(ast.literal_eval(line.value) for line in _INTERFACE if isinstance(line, ast.Assign))


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from .io import version

        return version("persistent-orbits")
    if name in PLACE_OF:
        value = globals()[name] = getattr(import_module(f".{PLACE_OF[name]}", __name__), name)
        return value
    if name.startswith("_") or find_spec(f"{__name__}.{name}") is None:
        raise AttributeError(f"module 'orbits' has no attribute '{name}'")
    return import_module(f".{name}", __name__)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
