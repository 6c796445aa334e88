"""Expressions: formulas from text, exact trees, Taylor series, compiled calls, and Ipopt."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .caches import cached
    from .calls import BufferedFunction, MappedFunction, single_assignment
    from .formula import BLANKS, CONSTANTS, FUNCTIONS, MAX_LENGTH, Formula, parse, suggest, symbolic_numerals
    from .identities import has_symbols, number_of, simplified, vanishes, without
    from .ipopt import EquationSolver, Minimiser, Minimum
    from .kernels import ElementwiseFunction, Kernel
    from .lane_numbers import Mask, Number
    from .local_scales import Reach, kinks_of, reaches_of
    from .machine_code import CodedFunction, Compiled, compiled_here, receive
    from .quadratic_models import QuadraticModels, Weights
    from .recursion import applied
    from .repeated_steps import repeated
    from .series_loops import VariationSeries, room_of_series
    from .sympy_formulas import abridged, formula_of, name_of_parameter, sympy_package
    from .taylor_series import (
        composed_coefficients,
        has_taylor_series,
        taylor_coefficients,
    )
    from .tracing import Text, traced, traced_of_places
    from .tree import (
        ONE,
        PI,
        SMOOTH_FUNCTIONS,
        ZERO,
        ExactExpression,
        along,
        call,
        depends_on,
        derivative_by,
        exact_number,
        expression,
        in_order,
        jacobian,
        substitute,
        symbol,
        symbols,
        symbols_in,
        total,
    )
    from .tree_casadi import ARITHMETIC, FUNCTION_NAMES, exact_value, lifted, lowered, rounded
    from .tree_formulas import expression_of_nodes
    from .tree_linear import Column, ExactRows, Factors, inner_product, nonzero, rows_of, solved_by_parts
    from .vector_code import OPERATIONS, Block, VectorCode

__all__ = [*public_names(__name__)]
