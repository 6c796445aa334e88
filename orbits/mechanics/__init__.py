"""The mechanics of a mechanism: its elements, its equations of motion, and the model that follows from them."""

from .bodies import Body, Joint
from .drawing import Drawing, Outline
from .elements import Damper, Force, Inerter, Mass, Potential, Spring, Weight
from .ground import Ground

__all__ = [
    "Body",
    "Damper",
    "Drawing",
    "Force",
    "Ground",
    "Inerter",
    "Joint",
    "Mass",
    "Outline",
    "Potential",
    "Spring",
    "Weight",
]
