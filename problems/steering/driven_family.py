"""Hops of an actuated machine of least effort, followed in a number of the machine, such as its damping, or in the
speed or the height that is prescribed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from orbits import InputError
from orbits.control.optimal_family import FixedParameters, OptimalFamily, follow_optimum
from orbits.errors import finite_number
from orbits.model.machine import machine_in_words
from orbits.units import unit_text

from .actuated import Actuated, Actuator
from .driven import Driven
from .goals import dimensions_of_costs, motion_in_si
from .prescribed import LAUNCH_CONDITIONS, check_free_fall

# Steps of the differences that are the slopes of a machine's dimensionless numbers, as a share of the range; numbers
# that are linear to the second share are so exactly.
DIFFERENCE_OF_NUMBERS, LINEAR = 1e-5, 1e-14


@dataclass(frozen=True, repr=False)
class DrivenFamily(OptimalFamily, what="family of motions of a driven machine"):
    """An `OptimalFamily` of hops of a machine with an actuator; `at` gives a `Driven` of the machine with that value.

    source : the machine without its actuator, at the first value; in SI the numbers are in SI
    actuator : the `Actuator`
    """

    source: Any = field(kw_only=True)
    actuator: Actuator = field(default=Actuator(), kw_only=True)

    machine = property(lambda self: machine_in_words(self.source))

    def at(self, value: float) -> Driven:
        """The hop at a value of the parameter, integrated again by the accurate flow; raises as in `OptimalFamily`."""
        control, machine = super().at(value), self.source
        if self.name not in LAUNCH_CONDITIONS or self.name in Actuated(machine, self.actuator).still:
            machine = machine.with_values(**{self.name: value})
        driven = Actuated(machine, self.actuator)
        if driven.units is not None:
            control = motion_in_si(driven, machine, control, "effort")
        return Driven.of(machine, control, self.actuator)


def follow_driven(driven: Driven, name: str, to: float, **options: Any) -> DrivenFamily:
    """Follow a hop of least effort, a result of `keep_hopping`, in a number of its machine or in its prescribed launch.

    name, to : the number, as "damping", or "speed" or "height" where that is prescribed, and its last value
    options : as `at`, `most` and `longest` of `orbits.control.optimal_family.follow_optimum`

    A machine without damping is kept hopping by no control: from there the least effort grows with the square of the
    damping, and with that of the distance of a prescribed speed from the lossless orbit's. Raises `InputError` where
    the motion is none of least effort that repeats itself, where the law has corners, and for a number that changes the
    machine's units.
    """
    source, actuated, to = driven.source, driven.actuated, finite_number("to", to)
    known, bare = driven.dimensionless().warm_start, driven.dimensionless()
    numbers = {**actuated.still, **source.values} if source.units is None else dict(source.values)
    added = [] if known is None else [each for each in known.problem.fixed if each not in actuated.still]
    prescribed = {each: driven.parameters[each] for each in added if each in LAUNCH_CONDITIONS}
    numbers |= prescribed
    if name not in list(numbers):
        if name in list(LAUNCH_CONDITIONS):
            raise InputError(f"the {name} is not prescribed: take keep_hopping(machine, {name}=...)")
        remedy = "; state it above 0 in the machine, to follow it from there" if name == "damping" else ""
        raise InputError(f"'{name}' is no number of the machine; there are: {', '.join(numbers)}{remedy}")
    if known is not None and (len(prescribed) < len(added) or known.problem.free):
        raise InputError("hops of least effort that repeat themselves are followed: take keep_hopping(machine)")
    if actuated.has_corners:
        raise InputError(
            "the law of the spring has corners, which the motion would pass in another order: find each hop"
        )
    if (first := float(numbers[name])) == to:
        raise InputError(f"{name} goes from {first:g} to {to:g}: there is no way between")
    if name in prescribed and not to > 0:
        raise InputError(f"to = {to:g}: a hop has a {name} above 0")
    values = _fixed_parameters(driven, name, first, to, prescribed)
    found = follow_optimum(bare, name, to, parameters=values, start=first, **options)
    own = {each.name: getattr(found, each.name) for each in fields(OptimalFamily)}
    if actuated.units is not None:
        dimension = dimensions_of_costs(actuated)["effort"]
        unit, own_units = actuated.units.of(dimension), dict(machine_in_words(source).get("units") or {})
        of_name = unit_text(LAUNCH_CONDITIONS[name]) if name in prescribed else str(own_units.get(name) or "")
        units = {"cost": unit_text(dimension), name: of_name}
        events = tuple(type(each)(each.kind, each.value, unit * each.cost, each.what) for each in found.events)
        own |= {"costs": unit * found.costs, "slopes": unit * found.slopes, "events": events, "units": units}
    return DrivenFamily(**own, source=source, actuator=driven.actuator)


def _fixed_parameters(
    driven: Driven, name: str, first: float, last: float, prescribed: Mapping[str, float]
) -> FixedParameters:
    """The dimensionless numbers of a machine, and what is prescribed, by one of them, and their derivatives."""
    units = driven.actuated.units
    sizes_of_prescribed = {each: 1.0 if units is None else units.of(LAUNCH_CONDITIONS[each]) for each in prescribed}

    def at(value: float) -> Actuated:
        if name in prescribed:
            return driven.actuated
        return Actuated(driven.source.with_values(**{name: value}), driven.actuator)

    def numbers(value: float) -> np.ndarray:
        wanted = {**prescribed, name: value}
        return np.array([*at(value).still.values(), *(wanted[n] / size for n, size in sizes_of_prescribed.items())])

    ends = [at(first), at(last)]
    sizes = [each.units for each in ends]
    if sizes[0] != sizes[1]:
        raise InputError(f"with {name} the machine's units change: follow that of the machine without units")
    gaps = [each.model.gap(each.values) for each in ends]
    if ends[0].drive != ends[1].drive or gaps[0] != gaps[1]:
        raise InputError(f"with {name} the machine's equations change, not only their numbers: find each hop")
    if "height" in prescribed:
        bare = driven.dimensionless()
        check_free_fall(ends[1], bare(np.linspace(0.0, bare.legs[0].duration, 5))[:, :-1])
    a, b, middle = (numbers(value) for value in (first, last, 0.5 * (first + last)))
    if np.abs(0.5 * (a + b) - middle).max() <= LINEAR * (1 + np.abs(middle).max()):
        rates = (b - a) / (last - first)
        return lambda value: (a + rates * (value - first), rates)
    return _differenced(numbers, DIFFERENCE_OF_NUMBERS * abs(last - first))


def _differenced(numbers: Callable[[float], np.ndarray], step: float) -> FixedParameters:
    return lambda value: (numbers(value), (numbers(value + step) - numbers(value - step)) / (2 * step))
