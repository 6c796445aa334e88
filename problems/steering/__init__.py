"""Optimal control by an actuator: keep a damped machine hopping, bring it back to its hop, start it from rest."""

from .goals import keep_hopping, missed, recover, rerun, start_up, work

__all__ = ["keep_hopping", "missed", "recover", "rerun", "start_up", "work"]
