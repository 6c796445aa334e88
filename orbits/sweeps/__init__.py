"""Sweeps: many orbits of one machine, over its parameters."""

from .sweep import SweepProgress

__all__ = ["SweepProgress"]
