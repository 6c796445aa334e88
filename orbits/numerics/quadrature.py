"""Gauss-Legendre quadrature on the unit interval."""

import numpy as np

# Number of points: exact for polynomials of degree 19, which is rounding for a function that is analytic over a step.
GAUSS = 10
GAUSS_PLACES, GAUSS_WEIGHTS = (0.5 * values for values in np.polynomial.legendre.leggauss(GAUSS))
GAUSS_PLACES += 0.5
