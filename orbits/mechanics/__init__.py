"""The mechanics of a mechanism: its elements, its equations of motion, and the model that follows from them."""

from .drawing import Drawing, Outline
from .elements import Damper, Force, Inerter, Mass, Potential, Spring, Weight
from .ground import Ground

__all__ = ["Damper", "Drawing", "Force", "Ground", "Inerter", "Mass", "Outline", "Potential", "Spring", "Weight"]
