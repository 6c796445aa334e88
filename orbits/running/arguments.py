"""Arguments of public functions, checked by their names and by what their annotations say, before anything is computed:
inside a computation, such an error would look like a failure of the problem."""

from collections.abc import Callable, Mapping
from inspect import unwrap
from typing import Any, get_args

from ..errors import InputError, refuse_machine, takes, true_or_false

# What every machine has.
MACHINE_HAS = ("model", "values", "units", "describe")


def check_machine_parts(name: str, value: object) -> None:
    """Raise `InputError` where something has nothing of a machine."""
    if not hasattr(value, "model"):
        refuse_machine(value, {part: "" for part in MACHINE_HAS if not hasattr(value, part)})


def check_text(name: str, value: object) -> None:
    """Raise `InputError` where an array stands for a text. A function names what it knows where something else does,
    but an array cannot be compared with that."""
    if hasattr(value, "__array__") and not isinstance(value, str):
        raise InputError(f"{name} = {value!r}; it must be text")


def check_report(name: str, value: object) -> None:
    """Raise `InputError` where something is neither None, False nor a function of one argument."""
    if not (value is None or value is False or takes(value, 1)):
        raise InputError(f"{name} = {value!r}; it must be a function of the share that is done")


BY_NAME = {"machine": check_machine_parts, "progress": check_report}
BY_KIND: Mapping[Any, Callable] = {bool: true_or_false, str: check_text, str | None: check_text}


def checks_of(function: Callable) -> Callable[[tuple, Mapping[str, Any]], None]:
    """The checks of a function's arguments: those of a name, and those whose annotation is a text or a truth value."""
    code, kinds = getattr(unwrap(function), "__code__", None), getattr(function, "__annotations__", {})
    names = code.co_varnames[: code.co_argcount] if code else ()
    optional = {name for name, kind in kinds.items() if type(None) in get_args(kind)}
    checks = {name: BY_KIND[kind] for name, kind in kinds.items() if kind in BY_KIND}
    checks |= {name: check for name, check in BY_NAME.items() if name in kinds}

    def check(arguments: tuple, options: Mapping[str, Any]) -> None:
        for name, value in (*zip(names, arguments, strict=False), *options.items()):
            if name in checks and not (value is None and name in optional):
                checks[name](name, value)

    return check
