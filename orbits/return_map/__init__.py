"""The return map of launch speeds: its values, fixed points, basins and bifurcations."""

from .diagram import Bifurcation, Branch
from .return_map import FixedPoint, Hops

__all__ = ["Bifurcation", "Branch", "FixedPoint", "Hops"]
