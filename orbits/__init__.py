"""Lossless periodic orbits of machines with plastic contact: found, certified, followed, controlled and designed."""

from importlib import import_module
from typing import Any

from .check import check
from .continuation.family import Family
from .continuation.folds import follow_fold
from .continuation.follow import follow, follow_branch, orbit_at, trace
from .continuation.starts import start_from_rest, starts
from .control.control import Control
from .control.steer import steer
from .design.optimality import Design
from .design.optimize import optimize
from .design.pareto import Front, pareto
from .design.sensitivities import quantities, sensitivities
from .errors import InputError, NoOrbit, OrbitsError
from .io import version
from .mechanics.mechanism import Mechanism
from .model.machine import Machine
from .model.model import Model
from .periodic.find import find, find_all
from .periodic.orbit import Orbit
from .proof.prove import prove, prove_absence, prove_fold
from .proof.theorem import Proof
from .return_map.bifurcations import bifurcations
from .return_map.diagram import BifurcationDiagram
from .return_map.proofs import prove_doubling, prove_fixed_point
from .return_map.return_map import ReturnMap
from .running.time_limit import time_limit
from .simulation.multiplier import multiplier
from .simulation.simulated import Simulation
from .simulation.simulation import simulate
from .sweeps.existence import Existence, existence
from .sweeps.sweep import sweep
from .sweeps.sweep_result import Sweep
from .sweeps.uncertainty import Uncertainty, uncertainty
from .units import Units

__all__ = [
    "BifurcationDiagram", "Control", "Design", "Existence", "Family", "Front", "InputError", "Machine", "Mechanism",
    "Model", "NoOrbit", "Orbit", "OrbitsError", "Proof", "ReturnMap", "Simulation", "Sweep", "Uncertainty", "Units",
    "__version__", "bifurcations", "check", "existence", "find", "find_all", "follow", "follow_branch",
    "follow_fold", "multiplier", "optimize", "orbit_at", "pareto", "prove", "prove_absence", "prove_doubling",
    "prove_fixed_point", "prove_fold", "quantities", "sensitivities", "simulate", "start_from_rest", "starts",
    "steer", "sweep", "time_limit", "trace", "uncertainty",
]  # fmt: skip

# The rooms or modules of further names, which can be imported from this package too.
PLACE_OF = {
    **dict.fromkeys(("Damper", "Force", "Inerter", "Mass", "Potential", "Spring", "Weight"), "mechanics"),
    **dict.fromkeys(("Affine", "Arc", "Modes", "Phase", "Pieces"), "model"),
    **dict.fromkeys(("Reduction", "StateFormula", "Statement", "linear_modes"), "model"),
    **dict.fromkeys(("Guess", "Input", "Stage"), "control"),
    **dict.fromkeys(("FlowError", "InconsistentModel", "OutOfRange"), "errors"),
    **dict.fromkeys(("End", "Event", "Point"), "continuation.point"),
    **dict.fromkeys(("Bifurcation", "Branch", "BranchEnd"), "return_map.diagram"),
    **dict.fromkeys(("FixedPoint", "Hops"), "return_map.return_map"),
    **{"Active": "design.optimality", "Certificate": "periodic.certificate", "Checked": "check"},
    **{"Enclosure": "exact.bounds", "METHODS": "shooting.formulations", "StepControl": "continuation.step_control"},
    **{"SweepProgress": "sweeps.sweep", "fold_statement": "periodic.fold_statement"},
}


def __getattr__(name: str) -> Any:
    if name == "__version__":  # takes too long to look up in every process
        return version("persistent-orbits")
    if name in PLACE_OF:
        return getattr(import_module(f".{PLACE_OF[name]}", __name__), name)
    raise AttributeError(f"module 'orbits' has no attribute '{name}'")
