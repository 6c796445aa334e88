"""Branch points: the other curve of orbits that goes through one."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ..errors import InputError, NoOrbit, finite_number
from ..periodic.orbit import Orbit
from ..symbolic import interrupts
from .arguments import checked_options, machine_at
from .corrector import Curve, CurvePoint
from .family import Family, Point
from .follow import collect_family
from .tracer import FIRST_ARC, Options, Tracer

# The other curve may lie askew, its first point this many times as far as the step across.
LONGEST_FIRST_STEP = 10.0


def _across(curve: Curve, x, direction, row) -> CurvePoint:
    """The first point of the other curve, a step across from `x`, shorter ones where that leads elsewhere."""
    size = curve.size(x)
    for length in FIRST_ARC * np.logspace(0, -3, 4):
        try:
            step = curve.correct(x + length * direction, row, row @ x + length, direction)
        except NoOrbit:
            continue
        if np.linalg.norm((step.x - x) / size) < LONGEST_FIRST_STEP * length:
            return step
    raise NoOrbit(f"no other curve is found beside {curve.along} = {x[-1]:.10g}")


def follow_branch(
    machine,
    branch: Point,
    along: str,
    stop: float,
    *,
    upper: bool = True,
    at: Sequence[float] = Options.at,
    watch: Mapping[str, Callable[[Orbit], float]] | None = Options.watch,
    longest: float = Options.longest,
    most: int = Options.most,
    method: str | None = None,
    output=None,
) -> Family:
    """Follow the other curve through a branch point of a family, from a first step on.

    machine, along : as the family was followed with
    branch : the point of a "branch point" event
    stop : value of the parameter to go on to; the curve also ends where it comes back to the branch point's
    upper : whether to set out towards higher launch speeds, or towards lower ones
    at, watch, longest, most, output : as in `follow`
    method : that of the family, "relative" or "half orbit"; None for the simplest

    The direction is the one across the curve in which the equations do not change to first order (Keller 1977). Raises
    `NoOrbit` when no other curve goes through the point, and `InputError` when it goes away from `stop`.
    """
    machine, method = machine_at(machine, branch, along, method)
    options, stop = checked_options(at, watch, longest, most, False), finite_number("stop", stop)
    if stop == branch.value:
        raise InputError(f"stop = {stop:g} is where the branch point lies: there is no way between")
    curve = Curve(machine, along, method, abs(stop - branch.value))
    x, tangent = np.array([*branch.u, branch.value]), np.array(branch.tangent)
    size = curve.size(x)
    with interrupts.deferred():
        *_, first, second = np.linalg.svd(curve.evaluate(x[None]).jacobian[0] * size)[2]
        own = tangent / size
        across = first * (second @ own) - second * (first @ own)
        side = across[curve.equations.statement.unknowns.index("alpha")]
        across *= np.copysign(1.0 / np.linalg.norm(across), side if upper else -side)
        step = _across(curve, x, across * size, across / size)
        if (step.value - branch.value) * (stop - branch.value) < 0:
            raise InputError(
                f"towards {'higher' if upper else 'lower'} launch speeds {along} goes to {step.value:.6g}, away from "
                f"stop = {stop:g}: give upper = {not upper} or a stop on the other side"
            )
        walk = Tracer(curve, curve.check(step), branch.value, stop, options)
    return collect_family(walk, output=output)
