"""Lossless periodic orbits of machines with plastic contact: found, certified, followed, controlled and designed."""

from .check import Checked, check
from .continuation.family import Family
from .continuation.folds import follow_fold
from .continuation.follow import follow, follow_branch, orbit_at, trace
from .continuation.point import End, Event, Point
from .continuation.starts import start_from_rest, starts
from .continuation.step_control import StepControl
from .control.control import Control
from .control.stage import Input, Stage
from .control.steer import Guess, steer
from .design.optimality import Active, Design
from .design.optimize import optimize
from .design.pareto import Front, pareto
from .design.sensitivities import quantities, sensitivities
from .errors import FlowError, InconsistentModel, InputError, NoOrbit, OrbitsError, OutOfRange
from .exact.bounds import Enclosure
from .io import version
from .mechanics.elements import Damper, Force, Inerter, Mass, Potential, Spring, Weight
from .mechanics.mechanism import Mechanism
from .model.machine import Machine
from .model.model import Model
from .model.modes import Modes, linear_modes
from .model.phase import Affine, Arc, Phase, Pieces, Statement
from .model.relative import Reduction
from .model.state_formula import StateFormula
from .periodic.certificate import Certificate
from .periodic.find import find, find_all
from .periodic.fold_statement import fold_statement
from .periodic.orbit import Orbit
from .proof.prove import prove, prove_absence, prove_fold
from .proof.theorem import Proof
from .return_map.bifurcations import bifurcations
from .return_map.diagram import Bifurcation, BifurcationDiagram, Branch, BranchEnd
from .return_map.proofs import prove_doubling, prove_fixed_point
from .return_map.return_map import FixedPoint, Hops, ReturnMap
from .running.time_limit import time_limit
from .shooting.formulations import METHODS
from .simulation.multiplier import multiplier
from .simulation.simulated import Simulation
from .simulation.simulation import simulate
from .sweeps.existence import Existence, existence
from .sweeps.sweep import SweepProgress, sweep
from .sweeps.sweep_result import Sweep
from .sweeps.uncertainty import Uncertainty, uncertainty
from .units import Units

__all__ = [
    "METHODS", "Active", "Affine", "Arc", "Bifurcation", "BifurcationDiagram", "Branch", "BranchEnd", "Certificate",
    "Checked", "Control", "Damper", "Design", "Enclosure", "End", "Event", "Existence", "Family", "FixedPoint",
    "FlowError", "Force", "Front", "Guess", "Hops", "InconsistentModel", "Inerter", "Input", "InputError", "Machine",
    "Mass", "Mechanism", "Model", "Modes", "NoOrbit", "Orbit", "OrbitsError", "OutOfRange", "Phase", "Pieces", "Point",
    "Potential", "Proof", "Reduction", "ReturnMap", "Simulation", "Spring", "Stage", "StateFormula", "Statement",
    "StepControl", "Sweep", "SweepProgress", "Uncertainty", "Units", "Weight", "__version__", "bifurcations", "check",
    "existence", "find", "find_all", "fold_statement", "follow", "follow_branch", "follow_fold", "linear_modes",
    "multiplier", "optimize", "orbit_at", "pareto", "prove", "prove_absence", "prove_doubling", "prove_fixed_point",
    "prove_fold", "quantities", "sensitivities", "simulate", "start_from_rest", "starts", "steer", "sweep",
    "time_limit", "trace", "uncertainty",
]  # fmt: skip


def __getattr__(name: str) -> str:
    if name == "__version__":  # takes too long to look up in every process
        return version("persistent-orbits")
    raise AttributeError(f"module 'orbits' has no attribute '{name}'")
