"""Caches of objects that are built for a machine, bounded in number, and all together in memory."""

import gc
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any, TypeVar

import casadi as ca

# All caches are cleared once about this number of bytes has been built since the last time.
BUDGET = 128e6
# Bytes that an instruction of an SX and of an MX function takes with its graph (fitted to the growth of the process).
SX_BYTES, MX_BYTES = 90, 1500
_F = TypeVar("_F", bound=Callable)

_caches: list[Any] = []
_seen: set[int] = set()
_built = 0.0


def cached(function: _F, maxsize: int = 64) -> _F:
    """The same function with a cache of its results, which `weigh` may clear; its arguments are hashable."""
    _caches.append(lru_cache(maxsize=maxsize)(function))
    return _caches[-1]


def weigh(functions: Iterable[ca.Function], size: int = 0) -> None:
    """Count the memory of the functions and `size` bytes more; when that is too much, clear all caches.

    Code that uses a cached result at the moment has a reference of its own and goes on; the next call builds it anew.
    """
    global _built
    parts = {part.__hash__(): part for function in functions for part in (function, *function.find_functions())}
    new = parts.keys() - _seen
    _seen.update(new)
    for part in (parts[key] for key in new):
        if part.is_a("SXFunction"):
            _built += SX_BYTES * part.n_instructions()
        elif part.is_a("MXFunction"):
            _built += MX_BYTES * part.n_instructions()
    _built += size
    if _built > BUDGET:
        _built = 0.0
        _seen.clear()
        for cache in _caches:
            cache.cache_clear()
        gc.collect()
