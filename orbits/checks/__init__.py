"""Checks of a machine against its statement: masses, heights, laws, gaps and maps."""

from typing import TYPE_CHECKING

from ..public_names import public_names

if TYPE_CHECKING:
    from .checked import Checked as Checked, check

__all__ = [*public_names(__name__)]
