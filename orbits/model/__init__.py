"""The engine's description of a machine: phases, closed forms, and the model of a hybrid machine."""

from .modes import Modes, linear_modes
from .phase import Affine, Arc, Phase, Pieces, Statement
from .relative import Reduction
from .state_formula import StateFormula

__all__ = ["Affine", "Arc", "Modes", "Phase", "Pieces", "Reduction", "StateFormula", "Statement", "linear_modes"]
