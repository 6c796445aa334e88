"""Machines stated in SI."""
