"""Optimal control of motions through several phases."""

from .holding import Hold, hold
from .stage import Input, Stage
from .steer import Guess

__all__ = ["Guess", "Hold", "Input", "Stage", "hold"]
