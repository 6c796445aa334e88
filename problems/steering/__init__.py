"""Optimal control by an actuator: keep a damped machine hopping, bring it back to its hop, start it from rest."""

from typing import TYPE_CHECKING

from orbits.public_names import public_names

if TYPE_CHECKING:
    from .actuated import Actuated, Actuator
    from .disturbed import Disturbed
    from .driven import Driven
    from .driven_family import DrivenFamily
    from .goals import keep_hopping, missed, recover, rerun, start_up, work

__all__ = [*public_names(__name__)]
