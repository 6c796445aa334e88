"""Optimal control of motions through several phases."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .control import Control as Control, ControlledLeg, control_in_units
    from .held_cycle import Cycle
    from .held_launches import HeldLaunches as HeldLaunches
    from .held_limits import HeldLimits as HeldLimits, limits_in
    from .holding import HOLDING, Hold as Hold, hold as hold, hold_cycle
    from .optimal_family import FixedParameters, OptimalFamily as OptimalFamily, follow_optimum, known_program
    from .stage import ELAPSED, RUNNING_COST, Input as Input, Stage as Stage
    from .steer import CollapsedStage, Guess as Guess, as_guess, steer as steer

__all__ = [*public_names(__name__)]
