"""Curves F(X) = 0 of n equations in n + 1 numbers; the last number is the parameter.

A problem states its equations, how lengths are measured, and what may happen on its curves. The room follows one curve
or many at once, past folds, with events, exact values of the parameter, changes of the problem, and ends.

Minima of programs are followed by `kkt_curve`, with sparse equations, active limits and steps of their own, to the same
events and ends.
"""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .bordered_newton import Border, correct
    from .curve_batch import ANOTHER
    from .curve_events import solved_at
    from .curve_run import Run, started
    from .kkt_conditions import FirstDerivatives, SecondDerivatives, filled
    from .kkt_curve import ENDS_OF_MINIMA, MinimumCurve
    from .kkt_limits import CriticalPoint
    from .kkt_options import STEPS_OF_MINIMA, KktOptions
    from .protocol import ASKS, BRANCH, CHANGES, FOLD, Barrier, End, Event, Points, Problem, Start, Test
    from .step_options import Steps, check_bounds, from_to

__all__ = [*public_names(__name__)]
