"""Lossless periodic orbits of machines with plastic contact: found, certified, followed, controlled and designed."""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from .public_names import public_names

if TYPE_CHECKING:
    from .checks import Checked, check
    from .continuation import (
        End,
        Event,
        Family,
        Point,
        StepControl,
        follow,
        follow_branch,
        follow_branch_points,
        follow_event,
        follow_fold,
        orbit_at,
        start_from_rest,
        starts,
        trace,
    )
    from .control import Control, Guess, Hold, Input, OptimalFamily, Stage, hold, steer
    from .design import (
        Active,
        Design,
        DesignCurve,
        DesignEvent,
        Front,
        optimize,
        orbit_function,
        pareto,
        quantities,
        sensitivities,
    )
    from .errors import FlowError, InconsistentModel, InputError, NoOrbit, OrbitsError, OutOfRange
    from .exact import Enclosure
    from .hops import HopMultipliers, Simulation, multiplier, multipliers, simulate
    from .mechanics import (
        Body,
        Damper,
        Drawing,
        Force,
        Ground,
        Inerter,
        Joint,
        Mass,
        Mechanism,
        Outline,
        Potential,
        Spring,
        Weight,
    )
    from .model import Affine, Arc, Machine, Modes, Phase, Pieces, Reduction, StateFormula, Statement, linear_modes
    from .periodic import BranchPoint, Certificate, Orbit, find, find_all, find_branch_points, fold_statement
    from .proof import Proof, prove, prove_absence, prove_fold
    from .returns import (
        Bifurcation,
        BifurcationCurve,
        BifurcationDiagram,
        Branch,
        BranchEnd,
        FixedPoint,
        Hops,
        LaunchHops,
        PeriodDiagram,
        PeriodicHop,
        ReturningHops,
        ReturnMap,
        bifurcations,
        period_diagram,
        prove_doubling,
        prove_fixed_point,
    )
    from .running import time_limit
    from .shooting import METHODS
    from .sweeps import Existence, Sweep, SweepProgress, Uncertainty, existence, sweep, uncertainty
    from .units import Units

PLACE_OF = public_names(__name__)  # the module or the room of each name
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


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from .io import version

        return version("persistent-orbits")
    if name in PLACE_OF or name.startswith("_") or find_spec(f"{__name__}.{name}") is None:
        raise AttributeError(f"module 'orbits' has no attribute '{name}'")
    return import_module(f".{name}", __name__)
