"""What is built for a machine and kept for the next call: bounded in number, and all together in memory."""

import gc
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any, TypeVar

import casadi as ca

# All that is kept is let go once about so many bytes have been built since the last time.
BUDGET = 128e6
# Bytes that an instruction of an SX and of an MX function takes with its graph (fitted to the growth of the process).
SX_BYTES, MX_BYTES = 90, 1500
_F = TypeVar("_F", bound=Callable)

_caches: list[Any] = []
_seen: set[int] = set()
_built = 0.0


def kept(function: _F, maxsize: int = 64) -> _F:
    """The same function, its results kept until `weigh` lets them go; its arguments are hashable."""
    _caches.append(lru_cache(maxsize=maxsize)(function))
    return _caches[-1]


def weigh(functions: Iterable[ca.Function], size: int = 0) -> None:
    """Count what the functions take and `size` bytes more; when that is too much, let go of all that is kept.

    Whoever uses it at the moment has references of his own and goes on; the next call builds it anew.
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
