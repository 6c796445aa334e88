"""Bounds on a computation while it runs: one lock, interrupts, time limits, and a sign of life."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from . import heartbeat, interrupts
    from .arguments import check_report
    from .exclusive import CHECK_INTERVAL, LOCK, apart, exclusive, exclusive_property, in_threads, threads
    from .heartbeat import LOGGER, running
    from .interrupts import heed
    from .time_limit import TimeOver, check_time, default_limit, part_limit, time_left, time_limit, time_to_finish

__all__ = [*public_names(__name__)]
