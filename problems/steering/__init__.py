"""Optimal control by an actuator: keep a damped machine hopping, bring it back to its hop, start it from rest."""

from typing import TYPE_CHECKING

from orbits.public_names import public_names

if TYPE_CHECKING:
    from .actuated import Actuated as Actuated, Actuator as Actuator
    from .disturbed import Disturbed as Disturbed
    from .driven import Driven as Driven
    from .driven_family import DrivenFamily as DrivenFamily
    from .goals import (
        keep_hopping as keep_hopping,
        missed as missed,
        recover as recover,
        rerun as rerun,
        start_up as start_up,
        work as work,
    )

__all__ = [*public_names(__name__)]
