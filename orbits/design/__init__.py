"""The best design of a machine: problem, sensitivities, local and multistart optimisation, Pareto fronts."""

from .optimality import Active

__all__ = ["Active"]
