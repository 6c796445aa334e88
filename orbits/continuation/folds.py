"""Curves of folds in two parameters: where a family's orbits begin to exist."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..errors import InputError, NoOrbit
from ..model import Machine
from ..running import exclusive
from .curve import check_followed, machine_at, tuned_at
from .event_start import start_of_fold
from .family import Family
from .follow import bounds_of
from .follow_event import collect_event
from .point import Point
from .step_control import Options, StepControl, checked_options
from .tuned_curve import equations_of_family

# At a fold the parameter changes by less than this share when an unknown doubles.
STEEPEST = 1e-3


@exclusive
def follow_fold(
    machine: Machine,
    fold: Point,
    along: str,
    across: str,
    stop: float,
    *,
    at: Sequence[float] = Options.at,
    longest: float = Options.longest,
    most: int = Options.most,
    step_control: StepControl = Options.step_control,
    method: str | None = None,
    output: str | Path | None = None,
) -> Family:
    """Follow the fold of a family in `along` as a second parameter goes to `stop`: a curve in two parameters.

    machine, method : as the family was followed with; method None for the simplest
    fold : the point of a "fold" event of that family
    along, across : names of the parameter that folds, and of the second one
    stop : last value of the parameter `across`
    at, longest, most, step_control, output : as in `follow`

    Returns a `Family` along `across`, whose points have the value of `along` too (`column`); its "fold" events are
    cusps. Raises `InputError` for invalid arguments, and `NoOrbit` where `fold` is not a fold. `follow_event` follows
    other events too.

    >>> from orbits import follow, follow_fold
    >>> from problems import Hopper
    >>> spring = Hopper("r + b*r**3 + d*r**5", rest_length=30.0, parameters={"b": 0.0, "d": 0.0})
    >>> fold = next(event.point for event in follow(spring, "b", -0.02).events if event.kind == "fold")
    >>> folds = follow_fold(spring, fold, "b", "d", 1e-6)
    >>> round(float(folds.column("b")[-1]), 6), folds.end.kind
    (-0.010732, 'reached')
    """
    check_followed(machine, across)
    if along == across:
        raise InputError(f"a fold in '{along}' must be followed along another parameter")
    tuned = tuned_at(machine, fold, along) if isinstance(fold, Point) else ()
    machine, method = machine_at(machine, fold, along, method)
    bounds_of(across, machine.values[across], stop)
    options = checked_options(at=at, longest=longest, most=most, step_control=step_control)
    base = equations_of_family(machine, method, along, tuned).statement
    sizes = np.maximum(np.abs(fold.u), 0.1 * np.abs(fold.u).max())
    most = (np.abs(fold.tangent[:-1]) / sizes).max()
    if not abs(fold.tangent[-1]) < STEEPEST * most * max(abs(fold.value), 1e-3):
        raise NoOrbit(f"this point is not a fold: {along} changes along its family")
    begun = start_of_fold(machine, base, fold, along)
    return collect_event(method, along, across, stop, begun, options, tuned=tuned, output=output)
