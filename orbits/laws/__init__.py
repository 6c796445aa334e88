"""Laws of a force or of gravity: from formulas, potentials, functions and tables, and their features."""
