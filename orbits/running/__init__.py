"""Bounds on a computation while it runs: one lock, interrupts, time limits, and a sign of life."""
