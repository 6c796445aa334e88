"""The best design of a machine: problem, sensitivities, local and multistart optimisation, Pareto fronts."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .design_curve import DesignCurve
    from .design_point import no_motion
    from .design_problem import Outputs, formula_names, known_formula, names_along
    from .design_quantities import ABSENT, COMPOSITION, base_statement, extremes_of
    from .designs_at_once import (
        DESIGN_STATUSES,
        columns_of_tuned,
        names_together,
        settled_designs,
        solved_designs,
        tuned_orbit,
    )
    from .event_statement import BARRIER, EventStatement, collapse_statement, event_statement, names_of_kind
    from .extremes import Kind, Place, places_of
    from .optimality import Active as Active, Design
    from .optimize import optimize
    from .orbit_function import orbit_function
    from .pareto import Front, pareto
    from .sensitivities import Sensitivities, quantities, sensitivities, values_at_orbits
    from .traced_designs import DesignEvent
    from .tuned_machine import tuning_of_designs

__all__ = [*public_names(__name__)]
