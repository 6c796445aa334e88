"""Proofs: theorems about lossless orbits, by interval arithmetic."""
