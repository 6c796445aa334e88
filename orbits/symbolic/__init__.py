"""Expressions: formulas from text, exact trees, Taylor series, compiled calls, and Ipopt."""
