"""The flow of one phase: steps with sensitivities, breakpoints, zero crossings, trajectories."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .first_events import Events, FirstOf, first_events, first_zero, recorded_event, until_zero
    from .flow import Flow, StopTest, flow_of
    from .forces import spring_forces, units_of_springs
    from .phase_field import OUT_OF_LAW
    from .same_motion import is_motion_of
    from .sign_tests import sign_tests
    from .taylor import TaylorStepper, coefficients_of
    from .trajectory import Trajectories, Trajectory, begins_of_steps
    from .vector_field import FLOW_CONTROL, TAYLOR, rows_used, runge_kutta_step, symbolic_powers
    from .watch import Watch

__all__ = [*public_names(__name__)]
