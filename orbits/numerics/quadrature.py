"""Gauss-Legendre quadrature on the unit interval."""

import numpy as np

# The number of points. The rule is exact for polynomials of degree 19, and a function that is analytic over a step
# differs from such a polynomial by rounding.
GAUSS = 10
GAUSS_PLACES, GAUSS_WEIGHTS = (0.5 * values for values in np.polynomial.legendre.leggauss(GAUSS))
GAUSS_PLACES += 0.5
