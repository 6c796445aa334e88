"""Families of orbits along a parameter: predictor, corrector, step control, events, folds, branches."""

from .point import End, Event, Point
from .step_control import StepControl

__all__ = ["End", "Event", "Point", "StepControl"]
