"""Lossless periodic orbits of machines with plastic contact: found, certified, followed."""

from .continuation.branching import follow_branch
from .continuation.existence import Existence, existence
from .continuation.family import End, Event, Family, Point
from .continuation.folds import fold_statement, follow_fold
from .continuation.follow import follow, orbit_at, trace
from .continuation.step_control import StepControl
from .control.steer import Control, Guess, steer
from .control.transcription import Input, Stage
from .design.local import Active
from .design.optimize import Design, optimize, quantities, sensitivities
from .design.pareto import Front, pareto
from .errors import FlowError, InputError, NoOrbit, OrbitsError, OutOfRange
from .hybrid.multiplier import multiplier
from .hybrid.return_map import FixedPoint, Hops, ReturnMap
from .hybrid.simulation import Simulation, simulate
from .model.closed_form import Oscillator
from .model.model import Model, Reduction, Units
from .model.phase import Affine, Arc, Phase, Pieces, Statement
from .periodic.find import METHODS, find, find_all
from .periodic.orbit import Certificate, Orbit

__all__ = [
    "METHODS",
    "Active",
    "Affine",
    "Arc",
    "Certificate",
    "Control",
    "Design",
    "End",
    "Event",
    "Existence",
    "Family",
    "FixedPoint",
    "FlowError",
    "Front",
    "Guess",
    "Hops",
    "Input",
    "InputError",
    "Model",
    "NoOrbit",
    "Orbit",
    "OrbitsError",
    "Oscillator",
    "OutOfRange",
    "Phase",
    "Pieces",
    "Point",
    "Reduction",
    "ReturnMap",
    "Simulation",
    "Stage",
    "Statement",
    "StepControl",
    "Units",
    "existence",
    "find",
    "find_all",
    "fold_statement",
    "follow",
    "follow_branch",
    "follow_fold",
    "multiplier",
    "optimize",
    "orbit_at",
    "pareto",
    "quantities",
    "sensitivities",
    "simulate",
    "steer",
    "trace",
]
