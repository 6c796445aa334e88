"""Lossless periodic orbits of machines with plastic contact: found, certified, followed, controlled and designed."""

from .continuation.family import End, Event, Family, Point
from .continuation.folds import fold_statement, follow_fold
from .continuation.follow import follow, follow_branch, orbit_at, trace
from .continuation.step_control import StepControl
from .control.rollout import Control
from .control.stage import Input, Stage
from .control.steer import Guess, steer
from .design.optimality import Active, Design
from .design.optimize import optimize
from .design.pareto import Front, pareto
from .design.sensitivities import quantities, sensitivities
from .errors import FlowError, InconsistentModel, InputError, NoOrbit, OrbitsError, OutOfRange
from .hybrid.check import Checked, check
from .hybrid.multiplier import multiplier
from .hybrid.return_map import FixedPoint, Hops, ReturnMap
from .hybrid.simulation import Simulation, simulate
from .io import version
from .model.closed_form import Oscillator
from .model.machine import Machine
from .model.model import Model, Reduction
from .model.phase import Affine, Arc, Phase, Pieces, Statement
from .model.units import Units
from .periodic.certificate import Certificate
from .periodic.find import METHODS, find, find_all
from .periodic.orbit import Orbit
from .sweeps.answer import Sweep
from .sweeps.existence import Existence, existence
from .sweeps.sweep import SweepProgress, sweep
from .sweeps.uncertainty import Uncertainty, uncertainty

__all__ = [
    "METHODS", "Active", "Affine", "Arc", "Certificate", "Checked", "Control", "Design", "End", "Event", "Existence",
    "Family", "FixedPoint", "FlowError", "Front", "Guess", "Hops", "InconsistentModel", "Input", "InputError",
    "Machine", "Model", "NoOrbit", "Orbit", "OrbitsError", "Oscillator", "OutOfRange", "Phase", "Pieces", "Point",
    "Reduction", "ReturnMap", "Simulation", "Stage", "Statement", "StepControl", "Sweep", "SweepProgress",
    "Uncertainty", "Units", "__version__", "check", "existence", "find", "find_all", "fold_statement", "follow",
    "follow_branch", "follow_fold", "multiplier", "optimize", "orbit_at", "pareto", "quantities", "sensitivities",
    "simulate", "steer", "sweep", "trace", "uncertainty",
]  # fmt: skip


def __getattr__(name: str) -> str:
    if name == "__version__":  # takes too long to look up in every process
        return version("persistent-orbits")
    raise AttributeError(f"module 'orbits' has no attribute '{name}'")
