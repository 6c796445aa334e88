"""The machines, their springs and their gravity: each module is imported when a name in it is first used."""

from typing import TYPE_CHECKING

from orbits.public_names import public_names

if TYPE_CHECKING:
    from . import recordings as recordings, steering as steering
    from .explorer import explore as explore
    from .laws import gravity as gravity, springs as springs
    from .machines import (
        Chain as Chain,
        HeavyHand as HeavyHand,
        Hopper as Hopper,
        Juggler as Juggler,
        alternating_hopper as alternating_hopper,
        brachiator as brachiator,
        chain_hand as chain_hand,
        hopper_in_si as hopper_in_si,
        inerter_hopper as inerter_hopper,
        juggler_in_si as juggler_in_si,
        knee_hopper as knee_hopper,
        plate_hopper as plate_hopper,
        rimless_wheel as rimless_wheel,
        rocking_block as rocking_block,
        runner as runner,
        shuttle as shuttle,
        walker as walker,
    )
    from .steering import (
        Actuated as Actuated,
        Actuator as Actuator,
        Disturbed as Disturbed,
        Driven as Driven,
        DrivenFamily as DrivenFamily,
    )

__all__ = [*public_names(__name__)]
