"""Optimal control of motions through several phases."""

from .stage import Input, Stage
from .steer import Guess

__all__ = ["Guess", "Input", "Stage"]
