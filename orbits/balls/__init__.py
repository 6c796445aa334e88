"""Enclosures of numbers and motions in balls: programs, Taylor steps with their tubes, sets of motions, roots and
signs. The room `proof` has the lemmas behind them."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .curve_motion import CurveStep, coefficients_through, follow_curve, passage_on, places
    from .enclosure import COARSE, FINE, follow_set, unit_matrix
    from .equations import BallLeg, Equations, IntervalParameters
    from .motion import Derivatives, Motion, Refuted
    from .programs import UNDEFINED, BallProgram, ball_of_fraction
    from .rigorous_step import between
    from .root import FIRST_BITS, ProvedRoot, evaluated_on, narrowed_root, polished, prove_root
    from .taylor_model import TaylorModel, as_model, model_arithmetic
    from .tube import Tube, narrowed, prove_tube

__all__ = [*public_names(__name__)]
