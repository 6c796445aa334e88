"""Orbits with tuned parameters where quantities of the whole motion are prescribed, such as a clearance.

They give no equations of half an orbit, and are reached by Newton's method with differences around the solution of the
equations.
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..errors import FlowError, InputError, NoOrbit
from ..model import Machine
from ..numerics import solve
from ..running import TimeOver
from ..shooting import vector
from .certificate import Certificate
from .certification import known_solutions
from .orbit import Orbit
from .quantities import numbers_of
from .tuned_orbits import METHOD, TUNED, Tuning


class TuningSteps(NamedTuple):
    """Newton's method with differences, in sizes of the parameters.

    change : of a parameter, for the differences
    longest, last : the longest step, and that after which the next one is below rounding
    steady : a step below which the slopes stay
    shortest : share of a step that is tried
    most : number of steps, which lets a parameter grow by 30 decades
    rounding : of a quantity of the motion, relative to it
    """

    change: float = 1e-6
    longest: float = 0.5
    last: float = 1e-14
    steady: float = 1e-4
    shortest: float = TUNED.shortest_way
    most: int = 200
    rounding: float = 1e-14


STEPS_OF_TUNING = TuningSteps()


def with_extremes(
    machine: Machine, tuning: Tuning, first: Orbit, near: Callable[[Machine, Orbit, Tuning], tuple[Orbit, dict]]
) -> tuple[Orbit, dict[str, float]]:
    """The orbit with tuned parameters where quantities of its whole motion are prescribed too, by Newton's method with
    differences, and estimates of the errors of these parameters.

    first : the machine's own orbit
    near : (machine, known orbit, tuning) -> the orbit where only equations are prescribed, and errors, as in `find`

    As many of the parameters as there are such quantities, the last ones for which this is possible, are moved in
    steps; the others are tuned at each step.
    """
    reason: Exception | None = None
    for moved in reversed([*combinations(tuning.names, len(tuning.extremes))]):
        rest = replace(tuning, names=tuple(name for name in tuning.names if name not in moved), extremes={})
        try:
            return _by_moving(machine, moved, rest, tuning.extremes, first, near)
        except NoOrbit as error:
            reason = reason or error
    assert reason is not None
    raise reason


def _by_moving(
    machine, moved, rest, targets, first, near, steps: TuningSteps = STEPS_OF_TUNING
) -> tuple[Orbit, dict[str, float]]:
    """`with_extremes` for the parameters that are `moved` in steps."""
    wanted, x, last = np.array([*targets.values()]), np.array([first.source.values[name] for name in moved]), np.inf
    sizes, slopes = np.maximum(np.abs(wanted), TUNED.smallest), np.zeros((len(x), len(x)))
    found, at = np.full(len(wanted), np.nan), ", ".join(f"{name} = {value:.6g}" for name, value in targets.items())

    def reached() -> tuple[str, str]:
        each = zip(moved, x.tolist(), strict=True), zip(targets, found.tolist(), strict=True)
        ran, here = (", ".join(f"{name} = {value:.6g}" for name, value in pairs) for pairs in each)
        return ran, here

    def solved(values: np.ndarray, known: Orbit) -> tuple[Orbit, dict[str, float], np.ndarray]:
        assert known.source is not None
        others = {name: known.source.values[name] for name in rest.names}
        here = machine.with_values(**others, **dict(zip(moved, values.tolist(), strict=True)))
        try:
            orbit, errors = near(here, known, rest)
            return orbit, errors, np.array([quantity_of(orbit, name) for name in targets])
        except TimeOver as over:
            if np.isnan(found).any():
                raise
            raise over.reached("on the way to {} it reached {}, with {}".format(at, *reached()[::-1])) from None

    def off(found: np.ndarray) -> float:
        return float(np.max(np.abs(found - wanted) / sizes))

    orbit, errors, found = solved(x, first)
    for _ in range(steps.most):
        if last > steps.steady:
            for i, change in enumerate(steps.change * np.where(x == 0, 1.0, x)):
                beside = x + change * (np.arange(len(x)) == i)
                slopes[:, i] = (solved(beside, orbit)[2] - found) / (beside - x)[i]
        if idle := [name for name, slope in zip(targets, slopes, strict=True) if not slope.any()]:
            raise NoOrbit(f"{idle[0]} does not depend on {', '.join(moved)}: tune another number")
        step = solve(slopes, wanted - found)
        size = float(np.max(np.abs(step) / np.where(x == 0, 1.0, np.abs(x))))
        if size < steps.last or (size < steps.steady and size > 0.5 * last):
            noise = np.abs(wanted - found) + steps.rounding * np.abs(found)
            own = np.abs(np.linalg.inv(slopes)) @ noise + np.spacing(np.abs(x))
            return orbit, errors | dict(zip(moved, own.tolist(), strict=True))
        share, last, reason = min(1.0, steps.longest / size), size, "no step comes closer"
        while share > steps.shortest:
            try:
                trial = solved(x + share * step, orbit)
                if size < steps.steady or off(trial[2]) < off(found):
                    x, (orbit, errors, found) = x + share * step, trial
                    break
            except (NoOrbit, FlowError, InputError) as error:
                reason = str(error)
            share /= 2
        else:
            break
    else:
        reason = f"{steps.most} steps did not reach it"
    ran, here = reached()
    raise NoOrbit(f"no orbit with {at} is reached: {ran.replace(' =', ' ran to')}, where {here}, and {reason}")


def quantity_of(orbit: Orbit, name: str) -> float:
    """A quantity of an orbit's whole motion, in the orbit's units; raises `NoOrbit` where it has none."""
    if name in Certificate.__dataclass_fields__:
        value = getattr(orbit.certificate, name)
    elif (time := orbit.dimensionless().contact_time) is None:
        value = None
    else:
        machine, bare = orbit.source, orbit.dimensionless()
        assert machine is not None
        model, times = machine.model, {"duration": bare.flight_time / 2, "contact_duration": time / 2}
        known = model.launch_at(bare.flight.coefficients[0, :, 0].tolist()) | times | {"alpha": bare.alpha}
        us, ps = vector({each: known[each] for each in model.half_unknowns})[None], vector(machine.values)[None]
        cycles = known_solutions(model, METHOD, tuple(machine.values), us, ps, np.array([bare.error])).cycles
        value = numbers_of(model, cycles, None, model.units and model.units(cycles.p), [name])[name][0]
    if value is None:
        why = "; ".join(orbit.violations) or f"in family {orbit.family} it has no such place; a rise is known for each"
        raise NoOrbit(f"an orbit on the way has no {name}: {why}")
    return float(value)
