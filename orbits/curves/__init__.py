"""Curves F(X) = 0 of n equations in n + 1 numbers, the last of which is the parameter.

A problem states its equations, how lengths are measured, and what may happen on its curves. The room follows one curve
or many at once, past folds, with events, exact values of the parameter, changes of the problem, and ends.

Minima of programs are followed by `kkt_curve`, with sparse equations, active limits and steps of their own, to the same
events and ends.
"""

from .bordered_newton import Border, correct
from .curve_events import solved_at
from .curve_run import Run, started
from .protocol import (
    ASKS,
    BRANCH,
    CHANGES,
    FOLD,
    HAPPENS,
    KINDS_OF_END,
    Barrier,
    End,
    Event,
    Points,
    Problem,
    Start,
    Test,
)
from .step_options import Steps

__all__ = [
    "ASKS",
    "BRANCH",
    "CHANGES",
    "FOLD",
    "HAPPENS",
    "KINDS_OF_END",
    "Barrier",
    "Border",
    "End",
    "Event",
    "Points",
    "Problem",
    "Run",
    "Start",
    "Steps",
    "Test",
    "correct",
    "solved_at",
    "started",
]
