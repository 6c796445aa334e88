"""The machines, their springs and their gravity."""

from . import gravity, springs
from .hopper import Hopper
from .juggler import Juggler

__all__ = ["Hopper", "Juggler", "gravity", "springs"]
