"""The mechanics of a mechanism: its elements, its equations of motion, and the model that follows from them."""

from .elements import Damper, Force, Inerter, Mass, Potential, Spring, Weight
from .ground import Ground

__all__ = ["Damper", "Force", "Ground", "Inerter", "Mass", "Potential", "Spring", "Weight"]
