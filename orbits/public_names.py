"""The public names of a package, each imported when it is first used, since a command that finds an orbit needs only
half of them.

A package states them once, as imports from its modules below `if TYPE_CHECKING`, which type checkers read as they are.
Names that users import are written `Name as Name`: strict type checkers refuse what a package does not export so.
"""

import ast
import sys
from importlib import import_module
from types import ModuleType
from typing import Any


class Package(ModuleType):
    """A package whose public names are imported when they are first used."""

    _places: dict[str, str]

    def __getattr__(self, name: str) -> Any:
        if name not in self._places:
            raise AttributeError(f"module '{self.__name__}' has no attribute '{name}'")
        value = import_module(f"{self.__name__}.{self._places[name]}")
        setattr(self, name, value)  # of a module of the same name this makes the name in it
        return vars(self)[name]

    def __setattr__(self, name: str, value: Any) -> None:
        if isinstance(value, ModuleType) and name in self._places:
            # Python binds each module that it has imported to its package, where a name in it may be called as it is.
            value = getattr(value, name, value)
        super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        """The public names, and none that the package itself uses, for completion."""
        own = vars(self)
        return sorted({*own.get("__all__", self._places), *(name for name in own if name.startswith("__"))})


def public_names(package: str) -> dict[str, str]:
    """Let a package import its public names when they are first used; returns them with their modules in it."""
    module = sys.modules[package]
    with open(str(module.__file__), encoding="utf-8") as file:
        lines = ast.parse(file.read()).body
    stated = [line for block in lines if isinstance(block, ast.If) for line in block.body]
    imports = [line for line in stated if isinstance(line, ast.ImportFrom)]
    places = {each.name: line.module or each.name for line in imports for each in line.names}
    vars(module)["_places"] = places
    module.__class__ = Package
    return places
