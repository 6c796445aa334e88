"""The damping with which a goal has no motion, and one with which it has."""

from collections.abc import Callable
from typing import Any

from orbits import NoOrbit
from orbits.mechanics import Damper

from .driven import Driven


def too_much_damping(
    steered: Callable[[Any], Driven], machine: Any, reason: NoOrbit, most: int = 8, apart: float = 0.03
) -> str:
    """The message about a stage that collapses, with the largest damping for which this goal has a motion: by `most`
    bisections at most, or until it is the share `apart` from a damping that is too large."""
    why, elements = str(reason).rpartition("; ")[0], machine.stated().elements
    named = dict.fromkeys(str(each.coefficient) for each in elements if isinstance(each, Damper))
    dampers = {name: machine.values[name] for name in named if machine.values.get(name, 0.0) > 0}
    low, high, works = 0.0, 1.0, dict[str, float]()
    for _ in range(most if dampers else 0):
        share = 0.5 * (low + high)
        tried = {name: float(f"{share * x:.3g}") for name, x in dampers.items()}  # as it would be printed
        try:
            steered(machine.with_values(**tried))
        except NoOrbit:
            high = share
        else:
            low, works = share, tried
        if low and high - low < apart * high:
            break
    if not low:
        return f"{why}; no such motion is near the lossless hop: ask for a slower launch, or widen the limits"
    units = machine.units_of_parameters() if machine.units else {}
    much, found = (
        ", ".join(f"{name} = {x:.3g} {units.get(name, '')}".rstrip() for name, x in each.items())
        for each in (dampers, works)
    )
    return f"{why}: {much} is too much; take at most {found}, with which it is found"
