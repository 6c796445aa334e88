"""Lossless periodic orbits of machines with plastic contact: found, certified, followed."""

from .branches import follow_branch
from .continuation import follow, orbit_at, trace
from .control import Control, Guess, steer
from .descent import Active
from .design import Design, optimize, quantities, sensitivities
from .errors import FlowError, InputError, NoOrbit, OrbitsError, OutOfRange
from .existence import Existence, existence
from .family import End, Event, Family, Point
from .folds import fold_statement, follow_fold
from .front import Front, pareto
from .model import Affine, Arc, Model, Oscillator, Phase, Pieces, Reduction, Statement, Units
from .orbit import Certificate, Orbit
from .returnmap import FixedPoint, Hops, ReturnMap
from .search import METHODS, find, find_all
from .simulate import Simulation, simulate
from .stability import multiplier
from .transcription import Input, Stage

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
