"""The equations of an orbit by shooting: their formulations, residuals and slopes, Newton's method, error bounds."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .arc_functions import boundary_functions
    from .cycle_statement import ENERGY_OF_CYCLE, elastic, moving_phase, parameters_of_cycle, whole_cycle
    from .division import (
        Division,
        NodedSolution,
        PartsOfArcs,
        Undetermined,
        are_divided,
        counts_of_parts,
        division_at,
        division_of,
        growths_without_nodes,
        solved,
        solved_with_nodes,
        with_nodes,
    )
    from .error_bound import EPS, ERRORS, NARROW, by_pieces, error_bounds, rounding_of_unknowns
    from .formulations import (
        METHODS as METHODS,
        Cycles,
        columns,
        equations_of,
        half_contact,
        half_flight,
        half_orbit,
        halved,
        interpret,
        iterative,
        method_of,
        reduction_of,
        refused_by_unfolding,
        through_mirror,
        vector,
        vectors,
    )
    from .newton_kernel import NewtonKernel, Solutions, newton_kernel
    from .node_places import DIVISION, growths_along, steady_tangents
    from .single_shooting import NEWTON, Evaluation, Shooting, joined, settles, shooting_equations

__all__ = [*public_names(__name__)]
