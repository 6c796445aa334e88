"""The theorem in words."""

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from ..model.units import Units
from .decimals import decimal_text
from .exact import Numbers
from .theorem import Enclosure

# What each condition of a motion says, where it is proved.
CONDITIONS = {
    "clearance": "the contact point is above what it lands on throughout the open flight",
    "separation": "the separation stays positive over the whole cycle",
    "contact_force": "the contact pushes throughout the open contact",
    "contact_end": "the contact comes to rest, and ends in a lift-off that is the mirror image of the landing",
}


def machine_sentence(machine: Mapping[str, Any], exact: Mapping[str, str]) -> str:
    """The machine with its exact parameters, in words."""
    numbers = ", ".join(f"{name} {value}" for name, value in exact.items())
    stated = [f"spring {machine['spring']} and gravity {machine['gravity']}", *([numbers] if numbers else [])]
    return f"Let the {machine['machine']} have {', '.join(stated)}."


def root_sentence(names: str, enclosures: Mapping[str, Enclosure], uniqueness: str, each: bool) -> str:
    """What existence and uniqueness say."""
    told = "; ".join(f"{name.replace('_', ' ')} in {value}" for name, value in enclosures.items())
    values = "For each value of the parameters in their intervals the" if each else "The"
    others = f"No other solution has all unknowns ({names}) within {uniqueness} of these enclosures"
    return f"{values} equations of a lossless orbit have a solution with {told}. {others}."


def motion_sentence(family: int | None, conditions: Mapping[str, str]) -> str:
    """What is proved of the motion."""
    told = [CONDITIONS[name] for name, verdict in conditions.items() if verdict == "proved"]
    counted = [] if family is None else [f"it is of family {family}"]
    if not (counted or told):
        return ""
    whole = "It is a motion: " if told and set(conditions.values()) == {"proved"} else "Of the motion: "
    return f"{whole}{'; '.join([*counted, *told])}."


def units_sentence(units: Units | None) -> str:
    """What is said of the units of a theorem about a machine that is stated in SI."""
    return "" if units is None else "Lengths, times and speeds are dimensionless."


def parameter_texts(numbers: Numbers) -> dict[str, str]:
    """What each parameter is, exactly, by name."""
    return {name: _exact_text(bounds) for name, bounds in numbers.values.items()}


def _exact_text(bounds: tuple[Fraction, Fraction]) -> str:
    low, high = (decimal_text(bound) for bound in bounds)
    return f"= {low}" if low == high else f"in [{low}, {high}]"
