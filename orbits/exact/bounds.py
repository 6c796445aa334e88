"""Intervals between two decimals, in which proved numbers are stated."""

from dataclasses import dataclass
from decimal import Decimal


@dataclass(frozen=True)
class Enclosure:
    """An interval that is proved to contain a number; its bounds are decimals rounded outward."""

    low: str
    high: str

    def __contains__(self, value: float | str | Decimal) -> bool:
        """Whether a number, or a decimal as text, lies in the interval."""
        return Decimal(self.low) <= Decimal(value) <= Decimal(self.high)

    @property
    def width(self) -> float:
        """The difference of the bounds."""
        return float(Decimal(self.high) - Decimal(self.low))

    def document(self) -> dict[str, str]:
        """The bounds for JSON."""
        return {"low": self.low, "high": self.high}

    def __str__(self) -> str:
        return f"[{self.low}, {self.high}]"
