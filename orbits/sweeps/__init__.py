"""Sweeps: many orbits of one machine, over its parameters."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .designs import as_numbers, axis_of, read_designs
    from .existence import Existence, existence
    from .progress import SweepProgress as SweepProgress
    from .sweep import sweep
    from .sweep_result import Sweep
    from .uncertainty import Uncertainty, uncertainty

__all__ = [*public_names(__name__)]
