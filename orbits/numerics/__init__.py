"""Plain numerical methods on NumPy arrays: Bernstein polynomials, roots, quadrature."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .common_zeros import near_common_zeros
    from .exclusion import HIGHEST_ORDER, NEGLIGIBLE, TINY, bernstein_coefficients
    from .hermite import at_level, slopes, through
    from .polynomial_roots import (
        POLYNOMIALS,
        Crossings,
        PiecewisePolynomials,
        derivative,
        evaluate,
        lowest,
        piecewise_roots,
        powers,
        roots_within,
        shifted,
    )
    from .quadrature import GAUSS_PLACES, GAUSS_WEIGHTS
    from .roots import (
        ROOTS,
        Array,
        bracketed_root,
        enclosed_ends,
        enclosed_sign_changes,
        estimated_roots,
        newton_root,
        resolved,
        root_search,
        solve,
    )
    from .sobol import sobol_points

__all__ = [*public_names(__name__)]
