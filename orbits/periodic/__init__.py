"""One lossless periodic orbit: its equations, their solution, its certificate."""

from .certificate import Certificate
from .fold_statement import fold_statement

__all__ = ["Certificate", "fold_statement"]
