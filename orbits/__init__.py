"""Lossless periodic orbits of machines with plastic contact: found, certified, followed."""

from .branches import follow_branch
from .continuation import follow, trace
from .errors import FlowError, InputError, NoOrbit, OrbitsError, OutOfRange
from .family import End, Event, Family, Point
from .folds import fold_statement, follow_fold
from .model import Affine, Arc, Model, Oscillator, Phase, Pieces, Reduction, Statement, Units
from .orbit import Certificate, Orbit
from .search import METHODS, find

__all__ = [
    "METHODS",
    "Affine",
    "Arc",
    "Certificate",
    "End",
    "Event",
    "Family",
    "FlowError",
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
    "Statement",
    "Units",
    "find",
    "fold_statement",
    "follow",
    "follow_branch",
    "follow_fold",
    "trace",
]
