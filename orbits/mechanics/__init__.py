"""The mechanics of a mechanism: its elements, its equations of motion, and the model that follows from them."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .balance import Balance
    from .bodies import AXES, Body as Body, Joint as Joint, bodies_of
    from .derived import derived_launch
    from .dimensions import law_dimensions, length_or_angle
    from .drawing import LANDINGS, REPEATED, Drawing as Drawing, Outline as Outline
    from .elements import (
        Damper as Damper,
        Element,
        Force as Force,
        Inerter as Inerter,
        Mass as Mass,
        Potential as Potential,
        Scalar,
        Spring as Spring,
        Weight as Weight,
        names_in,
        value_of,
    )
    from .grip import HALF_SWING, Grip as Grip
    from .ground import Ground as Ground
    from .kinetics import Closed, ClosedGap, Kinetics, Square
    from .mechanism import Mechanism as Mechanism
    from .refusals import joined_values
    from .terms import moving_masses

__all__ = [*public_names(__name__)]
