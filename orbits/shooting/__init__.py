"""The equations of an orbit by shooting: their formulations, residuals and slopes, Newton's method, error bounds."""

from .formulations import METHODS

__all__ = ["METHODS"]
