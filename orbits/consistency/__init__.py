"""Consistency checks of models that are written by hand."""
