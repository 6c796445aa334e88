"""The names of the package, each with the module that it is loaded from when it is first used."""

from .checks import Checked as Checked, check
from .continuation.branch_curve import follow_branch_points
from .continuation.family import Family
from .continuation.folds import follow_fold
from .continuation.follow import follow, follow_branch, orbit_at, trace
from .continuation.follow_event import follow_event
from .continuation.point import End as End, Event as Event, Point as Point
from .continuation.starts import start_from_rest, starts
from .continuation.step_control import StepControl as StepControl
from .control import Guess as Guess, Hold as Hold, Input as Input, Stage as Stage, hold as hold
from .control.control import Control
from .control.optimal_family import OptimalFamily
from .control.steer import steer
from .design.design_curve import DesignCurve
from .design.optimality import Active as Active, Design
from .design.optimize import optimize
from .design.orbit_function import orbit_function
from .design.pareto import Front, pareto
from .design.sensitivities import quantities, sensitivities
from .design.traced_designs import DesignEvent as DesignEvent
from .errors import (
    FlowError as FlowError,
    InconsistentModel as InconsistentModel,
    InputError,
    NoOrbit,
    OrbitsError,
    OutOfRange as OutOfRange,
)
from .exact.bounds import Enclosure as Enclosure
from .hops.multiplier import multiplier
from .hops.multipliers import HopMultipliers, multipliers
from .hops.simulated import Simulation
from .hops.simulation import simulate
from .mechanics import (
    Body as Body,
    Damper as Damper,
    Drawing as Drawing,
    Force as Force,
    Ground as Ground,
    Inerter as Inerter,
    Joint as Joint,
    Mass as Mass,
    Outline as Outline,
    Potential as Potential,
    Spring as Spring,
    Weight as Weight,
)
from .mechanics.mechanism import Mechanism
from .model import (
    Affine as Affine,
    Arc as Arc,
    Modes as Modes,
    Phase as Phase,
    Pieces as Pieces,
    Reduction as Reduction,
    StateFormula as StateFormula,
    Statement as Statement,
    linear_modes as linear_modes,
)
from .model.machine import Machine
from .periodic.branch_points import BranchPoint, find_branch_points
from .periodic.certificate import Certificate as Certificate
from .periodic.find import find, find_all
from .periodic.fold_statement import fold_statement as fold_statement
from .periodic.orbit import Orbit
from .proof.prove import prove, prove_absence, prove_fold
from .proof.theorem import Proof
from .returns.bifurcation import Bifurcation as Bifurcation
from .returns.bifurcation_curve import BifurcationCurve as BifurcationCurve
from .returns.bifurcations import bifurcations
from .returns.diagram import BifurcationDiagram, Branch as Branch, BranchEnd as BranchEnd
from .returns.hops import FixedPoint as FixedPoint, Hops as Hops
from .returns.launch_hops import LaunchHops as LaunchHops
from .returns.periodic_hop import PeriodicHop as PeriodicHop
from .returns.periods import PeriodDiagram as PeriodDiagram, period_diagram
from .returns.proofs import prove_doubling, prove_fixed_point
from .returns.return_map import ReturnMap
from .returns.returning_hops import ReturningHops
from .running.time_limit import time_limit
from .shooting.formulations import METHODS as METHODS
from .sweeps.existence import Existence, existence
from .sweeps.progress import SweepProgress as SweepProgress
from .sweeps.sweep import sweep
from .sweeps.sweep_result import Sweep
from .sweeps.uncertainty import Uncertainty, uncertainty
from .units import Units

__version__: str
PLACE_OF: dict[str, str]  # the module of each name

__all__ = [
    "BifurcationCurve", "BifurcationDiagram", "BranchPoint", "Control", "Design", "DesignCurve", "Existence",
    "Family", "Front", "HopMultipliers", "InputError", "Machine", "Mechanism", "NoOrbit", "OptimalFamily",
    "Orbit", "OrbitsError", "PeriodDiagram", "Proof", "ReturnMap", "ReturningHops", "Simulation", "Sweep",
    "Uncertainty", "Units", "__version__", "bifurcations", "check", "existence", "find", "find_all",
    "find_branch_points", "follow", "follow_branch", "follow_branch_points", "follow_event", "follow_fold",
    "multiplier", "multipliers", "optimize", "orbit_at", "orbit_function", "pareto", "period_diagram", "prove",
    "prove_absence", "prove_doubling", "prove_fixed_point", "prove_fold", "quantities",
    "sensitivities", "simulate", "start_from_rest", "starts", "steer", "sweep", "time_limit", "trace", "uncertainty",
]  # fmt: skip
