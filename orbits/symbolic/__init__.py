"""Expressions: formulas from text, Taylor series, compiled calls, and Ipopt."""
