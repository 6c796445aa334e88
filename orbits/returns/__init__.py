"""Hops that return: the return map of launches, its values, fixed points, basins and bifurcations."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .basins import Basins as Basins
    from .bifurcation import WORDS_OF_STABILITY, Bifurcation as Bifurcation, name_of_hops
    from .bifurcation_curve import BifurcationCurve
    from .bifurcations import bifurcations
    from .destinations import CHAOS, UNDECIDED
    from .diagram import BifurcationDiagram, Branch as Branch, BranchEnd
    from .hops import FixedPoint, Hops as Hops
    from .launch_cycles import DAMPERS_OF_HOPS, INJECT, RESTITUTION
    from .launch_hops import LaunchHops as LaunchHops
    from .periodic_hop import PeriodicHop
    from .periods import PeriodDiagram, period_diagram
    from .proofs import prove_doubling, prove_fixed_point
    from .return_map import ReturnMap
    from .returning_hops import ReturningHops

__all__ = [*public_names(__name__)]
