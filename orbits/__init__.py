"""Lossless periodic orbits of machines with plastic contact: found, certified, followed, controlled and designed."""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from .public_names import public_names

if TYPE_CHECKING:
    from .checks import Checked as Checked, check
    from .continuation import (
        End as End,
        Event as Event,
        Families,
        Family,
        Point as Point,
        StepControl as StepControl,
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
    from .control import (
        Control,
        Guess as Guess,
        Hold as Hold,
        Input as Input,
        OptimalFamily,
        Stage as Stage,
        hold as hold,
        steer,
    )
    from .design import (
        Active as Active,
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
    from .errors import (
        FlowError as FlowError,
        InconsistentModel as InconsistentModel,
        InputError,
        NoOrbit,
        OrbitsError,
        OutOfRange as OutOfRange,
    )
    from .exact import Enclosure as Enclosure
    from .hops import HopMultipliers, Simulation, multiplier, multipliers, simulate
    from .mechanics import (
        Body as Body,
        Damper as Damper,
        Drawing as Drawing,
        Force as Force,
        Grip as Grip,
        Ground as Ground,
        Inerter as Inerter,
        Joint as Joint,
        Mass as Mass,
        Mechanism,
        Outline as Outline,
        Potential as Potential,
        Spring as Spring,
        Weight as Weight,
    )
    from .model import (
        Affine as Affine,
        Arc as Arc,
        CasadiMachine as CasadiMachine,
        Machine,
        Modes as Modes,
        Phase as Phase,
        Pieces as Pieces,
        Reduction as Reduction,
        StateFormula as StateFormula,
        Statement as Statement,
        linear_modes as linear_modes,
    )
    from .periodic import (
        BranchPoint,
        Certificate as Certificate,
        Orbit,
        Oscillation,
        OscillationEvent as OscillationEvent,
        OscillationFamily,
        Swing,
        SwingFamily,
        find,
        find_all,
        find_branch_points,
        fold_statement as fold_statement,
    )
    from .proof import Proof, prove, prove_absence, prove_fold
    from .returns import (
        Bifurcation as Bifurcation,
        BifurcationCurve,
        BifurcationDiagram,
        Branch as Branch,
        BranchEnd,
        FixedPoint,
        Hops as Hops,
        LaunchHops as LaunchHops,
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
    from .shooting import METHODS as METHODS
    from .sweeps import Existence, Sweep, SweepProgress as SweepProgress, Uncertainty, existence, sweep, uncertainty
    from .units import Units

    __version__: str

PLACE_OF = public_names(__name__)  # the module or the room of each name
__all__ = [
    "BifurcationCurve", "BifurcationDiagram", "BranchPoint", "Control", "Design", "DesignCurve", "Existence",
    "Families", "Family", "Front", "HopMultipliers", "InputError", "Machine", "Mechanism", "NoOrbit", "OptimalFamily",
    "Orbit", "OrbitsError", "Oscillation", "OscillationFamily", "PeriodDiagram", "Proof", "ReturnMap", "ReturningHops",
    "Simulation", "Sweep", "Swing", "SwingFamily",
    "Uncertainty", "Units", "__version__", "bifurcations", "check", "existence", "find", "find_all",
    "find_branch_points", "follow", "follow_branch", "follow_branch_points", "follow_event", "follow_fold",
    "multiplier", "multipliers", "optimize", "orbit_at", "orbit_function", "pareto", "period_diagram", "prove",
    "prove_absence", "prove_doubling", "prove_fixed_point", "prove_fold", "quantities",
    "sensitivities", "simulate", "start_from_rest", "starts", "steer", "sweep", "time_limit", "trace", "uncertainty",
]  # fmt: skip


if not TYPE_CHECKING:  # which would take any name for one of the package

    def __getattr__(name: str) -> Any:
        if name == "__version__":
            from .io import version

            return version("persistent-orbits")
        if name in PLACE_OF or name.startswith("_") or find_spec(f"{__name__}.{name}") is None:
            raise AttributeError(f"module 'orbits' has no attribute '{name}'")
        return import_module(f".{name}", __name__)
