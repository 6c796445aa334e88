"""The machines, each a mechanism on a page, and the common parts of those of two masses."""

from typing import TYPE_CHECKING

from orbits.public_names import public_names

if TYPE_CHECKING:
    from .alternating_hopper import alternating_hopper
    from .brachiator import brachiator
    from .chain import Chain
    from .chain_hand import chain_hand
    from .files import (
        FUNCTIONS,
        GROUND_PARAMETERS,
        KINDS,
        MASSES,
        SAME_IN_SI,
        SI_KEYS,
        SI_KEYS_OF_STEPS,
        SI_PARAMETERS,
        STEPPING,
        MachineOfFile,
        build,
        design,
        machine_stated,
        read,
        search,
        si_keys_of,
        statement_for_file,
    )
    from .heavy_hand import HeavyHand
    from .hopper import Hopper
    from .in_si import AnyMachine, MachineInSI, hopper_in_si, juggler_in_si
    from .inerter import inerter_hopper
    from .juggler import Juggler
    from .knee import knee_hopper
    from .parameters import refuse_taken
    from .plate import plate_hopper
    from .runner import runner
    from .steps import RATIOS, rimless_wheel, rocking_block, shuttle
    from .two_masses import DAMPERS, TwoMasses, TwoMassMachine
    from .walker import walker

__all__ = [*public_names(__name__)]
