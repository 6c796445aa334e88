"""Lossless periodic orbits of machines with plastic contact: found, certified, followed."""

from .errors import FlowError, InputError, NoOrbit, OrbitsError, OutOfRange
from .model import Affine, Arc, Model, Oscillator, Phase, Pieces, Reduction, Statement, Units
from .orbit import Certificate, Orbit
from .search import METHODS, find

__all__ = [
    "METHODS",
    "Affine",
    "Arc",
    "Certificate",
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
    "Reduction",
    "Statement",
    "Units",
    "find",
]
