"""Families of orbits along a parameter: predictor, corrector, step control, events, folds, branches."""
