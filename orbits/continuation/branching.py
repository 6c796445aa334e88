"""Branch points: the other curve of orbits that goes through one."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..errors import InputError, NoOrbit, finite_number
from ..model.machine import Machine
from ..symbolic import interrupts
from .checkpoint import collect_family
from .corrector import correct
from .curve import Curve, CurvePoint, Watch, machine_at
from .family import Family, Point
from .step_control import Options, StepControl, checked_options
from .tracer import Tracer

# The first point of the other curve may lie this many steps away, since the curves need not meet at a right angle.
LONGEST_FIRST_STEP = 10.0


def _first_point(curve: Curve, x, direction, row, first_step: float) -> CurvePoint:
    """The first point of the other curve, one step from `x` across, a shorter one where that leads elsewhere."""
    size = curve.size(x)
    for length in first_step * np.logspace(0, -3, 4):
        try:
            step = correct(curve, x + length * direction, row, row @ x + length, direction)
        except NoOrbit:
            continue
        if np.linalg.norm((step.x - x) / size) < LONGEST_FIRST_STEP * length:
            return step
    raise NoOrbit(f"no other curve is found beside {curve.along} = {x[-1]:.10g}")


def follow_branch(
    machine: Machine,
    branch: Point,
    along: str,
    stop: float,
    *,
    upper: bool = True,
    at: Sequence[float] = Options.at,
    watch: Watch | None = None,
    longest: float = Options.longest,
    most: int = Options.most,
    step_control: StepControl = Options.step_control,
    method: str | None = None,
    output: str | Path | None = None,
) -> Family:
    """Follow the other curve through a branch point of a family, from a first step on.

    machine, along, method : as the family was followed with; method None for the simplest
    branch : the point of a "branch point" event
    stop : value of the parameter to go on to; the curve also ends where it comes back to the branch point's
    upper : whether to set out towards higher launch speeds or towards lower ones
    at, watch, longest, most, step_control, output : as in `follow`

    The direction is the one across the curve in which the equations do not change to first order (Keller 1977). Raises
    `NoOrbit` when no other curve goes through the point, and `InputError` when it goes away from `stop`.
    """
    machine, method = machine_at(machine, branch, along, method)
    options, stop = checked_options(at, watch, longest, most, False, step_control), finite_number("stop", stop)
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
        step = _first_point(curve, x, across * size, across / size, step_control.first_step)
        if (step.value - branch.value) * (stop - branch.value) < 0:
            way = f"towards {'higher' if upper else 'lower'} launch speeds {along} goes to {step.value:.6g}, away from"
            raise InputError(f"{way} stop = {stop:g}: give upper = {not upper} or a stop on the other side")
        tracer = Tracer(curve, curve.certify(step), branch.value, stop, options)
    return collect_family(tracer, output=output)
