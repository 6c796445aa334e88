"""The machines, their springs and their gravity: each module is imported when a name in it is first used."""

from typing import TYPE_CHECKING

from orbits.public_names import public_names

if TYPE_CHECKING:
    from . import steering
    from .explorer import explore
    from .laws import gravity, springs
    from .machines import (
        Chain,
        HeavyHand,
        Hopper,
        Juggler,
        chain_hand,
        hopper_in_si,
        inerter_hopper,
        juggler_in_si,
        knee_hopper,
        plate_hopper,
        rimless_wheel,
        rocking_block,
        runner,
        shuttle,
    )
    from .steering import Actuated, Actuator, Disturbed, Driven, DrivenFamily

__all__ = [*public_names(__name__)]
