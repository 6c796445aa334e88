"""Families of orbits along a parameter: predictor, corrector, step control, events, folds, branches."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .branch_curve import follow_branch_points
    from .checkpoint import begun, versions
    from .event_curve import COLLAPSE, LIMITS, EventCurve
    from .families import Families
    from .family import FAMILY_ENDINGS, Family
    from .folds import follow_fold
    from .follow import begin_run, bounds_of, follow, follow_branch, orbit_at, trace
    from .follow_event import collected, follow_event, run_along_event
    from .point import End as End, Event as Event, Point as Point
    from .starts import Starts, start_from_rest, starts
    from .step_control import Options, StepControl as StepControl, checked_options
    from .value_passings import passings

__all__ = [*public_names(__name__)]
