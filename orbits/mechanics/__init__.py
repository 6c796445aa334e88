"""The mechanics of a mechanism: its elements, its equations of motion, and the model that follows from them."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .balance import Balance
    from .bodies import AXES, Body, Joint, bodies_of
    from .derived import derived_launch
    from .dimensions import coefficient_dimensions, length_or_angle
    from .drawing import LANDINGS, REPEATED, Drawing, Outline
    from .elements import Damper, Element, Force, Inerter, Mass, Potential, Scalar, Spring, Weight, names_in, value_of
    from .ground import Ground
    from .kinetics import Closed, ClosedGap, Kinetics, Square
    from .mechanism import Mechanism
    from .refusals import joined_values
    from .terms import moving_masses

__all__ = [*public_names(__name__)]
