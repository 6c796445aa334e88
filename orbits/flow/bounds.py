"""The bounds within which motions are integrated, by whatever stepper."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class FlowControl:
    """Bounds on the steps of a motion, and how many of them are taken in one call.

    shortest_step : a step shorter than this, relative to the time, is a singularity of the vector field
    max_steps : steps after which a motion is given up, far more than any that ends
    runaway : a state with a component larger than this has run away
    singular_step : a state that is so large after steps longer than this has run away to infinity, while steps that
        shrink below it lead into a singularity
    look_ahead : steps of one call while a stop is looked for; two such calls are most of an oscillation
    max_block : most steps of one call, since a function of its own is built for each number of steps
    rounding : what is left of a duration is dropped when it is less than this share of it
    """

    shortest_step: float = 1e-15
    max_steps: int = 200_000
    runaway: float = 1e20
    singular_step: float = 1e-3
    look_ahead: int = 6
    max_block: int = 64
    rounding: float = 1e-14


FLOW_CONTROL = FlowControl()
