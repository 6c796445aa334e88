"""The options of curves of minima: their steps, and how the points on them are found."""

from typing import NamedTuple

import numpy as np

from .step_options import Steps

# In lengths the parameter counts as a share of its range, unknowns relative to one plus their size, and multipliers
# relative to the largest one. Each step is a point: there are none between.
STEPS_OF_MINIMA = Steps(
    first=0.01, shortest=1e-7, longest=0.1, apart=np.inf, shorter=0.25, shorten=0.3, lengthen=2.5, safety=0.8, aim=1e-4,
    corrected=0.5, memory=3, corrections=12, most=1000,
)  # fmt: skip


class KktOptions(NamedTuple):
    """Points of curves of minima, their active limits, and the linear conditions at them.

    exact : whether the tangent of each point is exact, for programs whose second derivatives come with the first
    steep : ratio of the parameter to the fastest unknown in a tangent below which that unknown is held in its place
    harmless : a correction of less than this many times the aim is accepted on steps of any length
    crowd : number of events at one place after which limits enter and leave without end
    last : Newton step, relative to the sizes of the unknowns, after which the next one is below rounding
    small : a Newton step below this that is not much shorter than the one before is rounding itself
    stale : contraction of Newton steps above which their matrix is renewed
    near : distance from a prediction to its point up to which the tangent at the first one serves
    dual, least_dual : multipliers below this share of the Hessian, and below this size, are rounding
    tolerated, tolerated_at_start : distance beyond a limit, or of a multiplier beyond 0, that counts as none
    weak : distance within which both a limit and its multiplier may be 0 at the first point
    most_weak : number of such limits that are examined: the sets of active ones are tried in turn
    changes_at_start : largest number of active limits that change at the first point
    dependent, nearly_dependent : a gradient depends on others if a smaller share of it is independent of them; and if
        no minimum is found otherwise
    weights : of the active gradients in the shifted matrix, tried in turn: where one is too small, or too large
        compared with rounding, there seem to be more negative eigenvalues than there are
    refined : a refinement of a solution is the last one if the next would change less than this share of it
    contracts, refinements : a refinement fails if it does not shrink by this factor, or after this number of steps
    """

    exact: bool = False
    steep: float = 0.2
    harmless: float = 50.0
    crowd: int = 12
    last: float = 1e-10
    small: float = 1e-8
    stale: float = 0.1
    near: float = 1e-5
    dual: float = 1e-4
    least_dual: float = 1e-12
    tolerated: float = 1e-10
    tolerated_at_start: float = 1e-9
    weak: float = 1e-6
    most_weak: int = 8
    changes_at_start: int = 30
    dependent: float = 1e-8
    nearly_dependent: float = 1e-3
    weights: tuple[float, ...] = (1e6, 1e4)
    refined: float = 1e-10
    contracts: float = 0.3
    refinements: int = 12


POINTS_OF_MINIMA = KktOptions()
