"""The engine's description of a machine: phases, closed forms, and the model of a hybrid machine."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .casadi_machine import CasadiMachine as CasadiMachine
    from .liftoff import Liftoff
    from .linear_guess import linear_guess, search_of_steps
    from .machine import (
        MACHINE_FIELDS,
        Machine as Machine,
        Stated,
        check_machine,
        check_parameters,
        dimensionless,
        free_parameters,
        machine_in_words,
        refuse_others,
        title_of_machine,
    )
    from .model import (
        CONTACT_FORCE,
        HOLDING_FORCE,
        LANDED_FORCE,
        LANDED_HOLDING,
        STEP_LENGTH,
        Knee,
        Model,
        names_of_holding,
        refuse_forward,
        refuse_hysteresis,
        refuse_one_way,
        refuse_steps,
        reparametrised,
    )
    from .modes import MODES, Modes as Modes, linear_modes as linear_modes, single_mode
    from .phase import (
        Affine as Affine,
        Arc as Arc,
        Phase as Phase,
        Pieces as Pieces,
        Statement as Statement,
        data_at,
        is_used,
        weighted_sum,
    )
    from .planar import NORMAL_FORCE, TANGENTIAL_FORCE, Planar
    from .relative import RELATIVE, Reduction as Reduction, Relative, Search, half_angle, pieces_along, straight_line
    from .state_formula import SavedHeight, StateFormula as StateFormula, height_of
    from .symmetry import SignedShift

__all__ = [*public_names(__name__)]
