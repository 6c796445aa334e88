"""Sweeps: many orbits of one machine, over its parameters."""
