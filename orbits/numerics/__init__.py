"""Plain numerical methods on NumPy arrays: Bernstein polynomials, roots, quadrature."""
