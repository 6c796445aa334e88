"""One lossless periodic orbit: its equations, their solution, its certificate."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .along_energy import follow_energy
    from .branch_points import BranchPoint, Lateral, branch_point, find_branch_points
    from .certificate import Certificate as Certificate, mass_of_landing
    from .certification import (
        Certified,
        Solved,
        certified,
        certified_orbit,
        known_solutions,
        orbit_from,
        orbit_of_solved,
    )
    from .continued import (
        AT_FOLD,
        NOT_REACHED,
        Continued,
        continued,
        continued_orbits,
        continued_tuned,
        orbit_from_unknowns,
    )
    from .cycle_shape import relabelled_back
    from .energy_changes import gradients
    from .family_orbits import another_family, family_number, lowest_of_family, solve_family
    from .find import find, find_all, start_or_own
    from .fold_statement import fold_statement as fold_statement
    from .linear_hops import LinearSearch
    from .loss_coefficient import (
        LOSSES,
        bounce_factors,
        by_launch_speed,
        hand_over_factors,
        jerk_jumps,
        landing_factors,
        launch_power,
        loss_coefficient,
    )
    from .lossless_speeds import lossless_speeds
    from .motion_conditions import STATIONARY
    from .orbit import OTHER_EQUATIONS, Orbit, certificate_in_units, is_orbit_of, orbit_of, start_in_file
    from .orbit_found import solve_near, unknowns_of_hop
    from .orbits_at_once import certified_near, lowest_orbits, motions_together, orbits_near
    from .oscillations import (
        Oscillation as Oscillation,
        OscillationEvent as OscillationEvent,
        OscillationFamily as OscillationFamily,
    )
    from .parameter_paths import along_ways
    from .quantities import (
        CERTIFIED,
        FRICTION_LEFT,
        OF_CERTIFICATE,
        OF_LOSS,
        OF_RUNS,
        PLANAR,
        QUANTITIES,
        VARIATIONAL,
        absent_quantities,
        beyond_model,
        dimension_of,
        motion_numbers,
        names_of_many,
        numbers_of,
        quantity_names,
        speed_in_flight,
        step_of,
        unknown_quantity,
    )
    from .saved_orbit import SavedLaws, with_note
    from .start import LONGEST_START, StartLike, check_start, in_units_of, stated_unknowns, unknowns_of_start
    from .swing import Swing as Swing, SwingFamily as SwingFamily
    from .swings import follow_swings, grip_of
    from .tuned_orbits import (
        METHOD,
        OF_STEPS,
        PRESCRIBED,
        Tuning,
        check_count,
        check_determined,
        counts,
        errors_of_tuned,
        is_quantity,
        prescribable,
        solved_near,
        tuned_equations,
        tuned_names,
        tuned_statement,
        tuned_values,
        tuning_of,
    )
    from .tuned_search import first_tuned

__all__ = [*public_names(__name__)]
