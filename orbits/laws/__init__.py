"""Laws of a force or of gravity: from formulas, potentials, functions and tables, and their features."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from . import law_statement
    from .features import NO_FEATURES, features, features_of_many, sampled_closely, unit_of_length, units_of_length
    from .hysteretic_law import (
        LARGEST_CROSSING,
        ONE_PIECE,
        HystereticLaw,
        hysteretic_law,
        merged_pieces,
        scaled_branch,
        sides_of,
    )
    from .jumps import switches
    from .law import (
        ONE_SIDED,
        WRONG_SIGN,
        Algebraic,
        Key,
        Law,
        LawPieces,
        Parameters,
        PieceTable,
        RowNoise,
        Scalars,
        Written,
        coefficient_of_restitution,
        from_key,
        number,
        positive,
        values_and_slopes,
    )
    from .law_expressions import UNIT_FORCE, UNIT_LENGTH, Expression, symbols_of
    from .law_statement import LawLike, from_formula, key_of

__all__ = [*public_names(__name__)]
