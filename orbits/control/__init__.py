"""Optimal control of motions through several phases."""
