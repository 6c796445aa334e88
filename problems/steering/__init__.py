"""Steering a machine by an actuator: keep it hopping though damped, bring it to its hop, start it from rest."""

from .goals import keep_hopping, missed, recover, rerun, start_up, work

__all__ = ["keep_hopping", "missed", "recover", "rerun", "start_up", "work"]
