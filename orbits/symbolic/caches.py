"""Caches of objects that are built for a machine, bounded in number, and all together in memory."""

import gc
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import wraps
from itertools import count
from typing import Any, NamedTuple, TypeVar, cast

import casadi as ca

from ..running import LOCK


class CacheOptions(NamedTuple):
    """When the least recently used half of all results is forgotten."""

    bytes: float = 128e6  # of results that have been built, about
    results: int = 512  # in the caches
    sx_bytes: int = 90  # of an instruction of an SX function with its graph (fitted to the growth of the process)
    mx_bytes: int = 1500  # of an instruction of an MX function with its graph (fitted to the growth of the process)


CACHE = CacheOptions()
_F = TypeVar("_F", bound=Callable)

_cached = dict[tuple, "_Stored"]()  # by function and arguments
_clock = count()
_seen: set[int] = set()
_built = 0.0


def cached(function: _F) -> _F:
    """A function with a cache of its results, which `weigh` may forget; its arguments are hashable."""

    @wraps(function)
    def found(*arguments: Any, **options: Any) -> Any:
        key = (function, *arguments, *options.items()) if options else (function, *arguments)
        with LOCK:  # what is built are graphs
            result = _cached.get(key)
            if result is None:
                if len(_cached) >= CACHE.results:
                    _forget_half()
                result = _cached[key] = _Stored(function(*arguments, **options))
            result.used = next(_clock)
            return result.value

    return cast(_F, found)


@dataclass(slots=True)
class _Stored:
    """A cached result, and when it was used last."""

    value: Any
    used: int = 0


def _forget_half() -> None:
    for key in sorted(_cached, key=lambda key: _cached[key].used)[: (len(_cached) + 1) // 2]:
        del _cached[key]


def weigh(functions: Iterable[ca.Function], size: int = 0) -> None:
    """Count the memory of the functions and `size` bytes more; when that is too much, forget the least used, as if all
    results had equal shares of the memory.

    Code that uses a cached result at the moment has a reference of its own and continues; the next call builds it
    again.
    """
    global _built
    parts = {part.__hash__(): part for function in functions for part in (function, *function.find_functions())}
    new = parts.keys() - _seen
    _seen.update(new)
    for part in (parts[key] for key in new):
        if part.is_a("SXFunction"):
            _built += CACHE.sx_bytes * part.n_instructions()
        elif part.is_a("MXFunction"):
            _built += CACHE.mx_bytes * part.n_instructions()
    _built += size
    if _built > CACHE.bytes:
        _built /= 2
        _seen.clear()
        _forget_half()
        gc.collect()
