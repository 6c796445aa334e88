"""The damping with which a goal has no motion, and one with which it has."""

from collections.abc import Callable
from typing import Any

from orbits import NoOrbit
from orbits.mechanics import Damper

from .driven import Driven


def too_much_damping(
    steered: Callable[[Any], Driven], machine: Any, reason: NoOrbit, most: int = 8, apart: float = 0.03
) -> str:
    """The message about a stage that collapses, with a damping that this goal has a motion for: the largest one, by at
    most so many bisections, or until it is this share apart from one that is too large."""
    why, elements = str(reason).rpartition("; ")[0], machine.stated().elements
    named = dict.fromkeys(str(each.coefficient) for each in elements if isinstance(each, Damper))
    dampers = {name: machine.values[name] for name in named if machine.values.get(name, 0.0) > 0}
    low, high = 0.0, 1.0
    for _ in range(most if dampers else 0):
        share = 0.5 * (low + high)
        try:
            steered(machine.with_values(**{name: share * x for name, x in dampers.items()}))
        except NoOrbit:
            high = share
        else:
            low = share
        if low and high - low < apart * high:
            break
    if not low:
        return f"{why}; no such motion is near the lossless hop: ask for a slower launch, or widen the limits"
    units = machine.units_of_parameters() if machine.units else {}
    much, works = (
        ", ".join(f"{name} = {share * x:.3g} {units.get(name, '')}".rstrip() for name, x in dampers.items())
        for share in (1.0, 0.99 * low)  # rounded up it is not above what works
    )
    return f"{why}: {much} is too much; take at most {works}, with which it is found"
