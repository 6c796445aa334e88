"""Motions of an actuated machine of least cost, followed in a number of the machine, such as its damping, or of their
launch: the speed or the height that is prescribed, or what a launch to be recovered from is short of."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from typing import Any

import numpy as np

from orbits import InputError
from orbits.control import FixedParameters, OptimalFamily, follow_optimum, known_program
from orbits.errors import finite_number
from orbits.model import machine_in_words
from orbits.running import exclusive
from orbits.units import LIFTOFF_SPEED, Dimension, unit_text

from .actuated import Actuated, Actuator, undamped
from .actuated_launch import launched_at
from .driven import Driven, work_done
from .goals import dimensions_of_costs, motion_in_si
from .prescribed import LAUNCH_CONDITIONS, OF_THE_ORBIT, check_free_fall

# Steps of the differences that are the slopes of a machine's dimensionless numbers, as a share of the range, or of the
# value if that is larger.
DIFFERENCE_OF_NUMBERS = 1e-5
LINEAR = 1e-14  # numbers that are linear to this share at `LINEAR_AT` are so exactly
LINEAR_AT = (0.3, 0.7)  # shares of the range
# The numbers of a launch that are followed: what is prescribed of a hop, and what is missing of a launch speed.
OF_LAUNCHES: Mapping[str, Dimension] = {**LAUNCH_CONDITIONS, "short": LIFTOFF_SPEED}


@dataclass(frozen=True, repr=False)
class DrivenFamily(OptimalFamily, what="family of motions of a driven machine"):
    """An `OptimalFamily` of motions of a machine with an actuator; `at` returns the `Driven` of the machine there.

    source : the machine without its actuator, at the first value; in SI the numbers are in SI
    actuator : the `Actuator`
    minimised : "effort", "work" or "peak"; the last two with the effort that `keep_hopping` adds, and work rounded as
        at the first motion. The motions of `at` have costs without either
    """

    source: Any = field(kw_only=True)
    actuator: Actuator = field(default=Actuator(), kw_only=True)
    minimised: str = field(default="effort", kw_only=True)

    machine = property(lambda self: machine_in_words(self.source))

    def title(self) -> str:
        return f"motions of locally least {self.minimised} along {self.name}"

    def at(self, value: float) -> Driven:
        """The motion at a value of the parameter, integrated again by the accurate flow; raises as `OptimalFamily`."""
        control, machine = super().at(value), self.source
        if self.name not in OF_LAUNCHES or self.name in Actuated(machine, self.actuator).still:
            machine = machine.with_values(**{self.name: value})
        driven = Actuated(machine, self.actuator)
        if self.minimised == "peak":
            control = replace(control, cost=control.parameters["peak"])
        if self.minimised == "work":
            control = replace(control, cost=work_done(driven.dimensionless(), control)[1])
        if driven.units is not None:
            control = motion_in_si(driven, machine, control, self.minimised)
        return Driven.of(machine, control, self.actuator)


@exclusive
def follow_driven(driven: Driven, name: str, to: float, **options: Any) -> DrivenFamily:
    """Follow a motion of least cost, a result of `keep_hopping`, `recover` or `start_up`, in a number of its machine or
    of its launch.

    name, to : the number, as "damping", "speed" or "height" where that is prescribed, or "short" of a `recover`, and
        its last value
    options : as `at`, `most` and `longest` of `orbits.control.optimal_family.follow_optimum`

    A machine without damping is kept hopping by no control: from there the least effort grows with the square of the
    damping, and with that of the distance of a prescribed speed from the lossless orbit's. A recovery or a start is
    followed as long as the launch stays at which it aims. Raises `InputError` where the law has corners, for a number
    that changes the machine's units or the launch aimed at, and for a landing that is free and goes to no damping,
    where the optimality conditions are singular.
    """
    source, actuated, to = driven.source, driven.actuated, finite_number("to", to)
    bare = driven.dimensionless()
    added = [each for each in known_program(bare).problem.fixed if each not in actuated.still]
    launch = {each: driven.parameters[each] for each in added if each in LAUNCH_CONDITIONS}
    if "launch" in added:
        launch["short"] = driven.parameters["aim"] - driven.parameters["launch"]
    own = actuated.still if source.units is None else {n: x for n, x in actuated.still.items() if x == 0.0}
    numbers = {**own, **source.values, **launch}
    _check_number(driven, name, to, numbers, launch)
    first = float(numbers[name])
    minimised = "work" if "round" in added else "peak" if "peak" in driven.parameters else "effort"
    values = _fixed_parameters(driven, name, first, to, launch)
    found = follow_optimum(bare, name, to, parameters=values, start=first, **options)
    parts = {each.name: getattr(found, each.name) for each in fields(OptimalFamily)}
    if actuated.units is not None:
        dimension = dimensions_of_costs(actuated)[minimised]
        unit, stated = actuated.units.of(dimension), source if name in launch else source.with_values(**{name: to})
        of_machine = dict(machine_in_words(stated).get("units") or {})
        of_name = unit_text(OF_LAUNCHES[name]) if name in launch else str(of_machine.get(name) or "")
        units = {"cost": unit_text(dimension), name: of_name}
        events = tuple(replace(each, cost=unit * each.cost) for each in found.events)
        parts |= {"costs": unit * found.costs, "slopes": unit * found.slopes, "events": events, "units": units}
    return DrivenFamily(**parts, source=source, actuator=driven.actuator, minimised=minimised)


def _check_number(
    driven: Driven, name: str, to: float, numbers: Mapping[str, float], launch: Mapping[str, float]
) -> None:
    """Raise `InputError` for what is not followed: `numbers` are all that could be, with those of the launch."""
    if name not in list(numbers):
        if name in list(LAUNCH_CONDITIONS):
            raise InputError(f"the {name} is not prescribed: take keep_hopping(machine, {name}=...)")
        raise InputError(f"'{name}' is not a number of this motion; it has {', '.join(numbers)}")
    if driven.actuated.has_corners:
        raise InputError(
            "the law of the spring has corners, and the motion may pass them in another order: find each hop"
        )
    aim = driven.parameters["aim"] if name == "short" and name in launch else np.inf
    if abs(numbers[name] - to) <= (OF_THE_ORBIT * aim if aim < np.inf else 0.0):
        raise InputError(f"{name} goes from {to:g} to {to:g}: choose another last value")
    if name in launch and aim == np.inf and not to > 0:
        raise InputError(f"to = {to:g}; the {name} of a hop must be above 0")
    if not to < aim:
        raise InputError(f"to = {to:g} leaves no launch speed: it lies below the speed of the target, {aim:.6g}")


def _fixed_parameters(
    driven: Driven, name: str, first: float, last: float, launch: Mapping[str, float]
) -> FixedParameters:
    """The parameters of the program by one number, and their derivatives: the dimensionless numbers of the machine,
    and those of the launch."""
    units, bare = driven.actuated.units, driven.dimensionless()
    known, problem = bare.parameters, known_program(bare).problem
    sizes_of_launch = {each: 1.0 if units is None else units.of(OF_LAUNCHES[each]) for each in launch}

    @cache
    def at(value: float) -> Actuated:
        if name in launch:
            return driven.actuated
        return Actuated(driven.source.with_values(**{name: value}), driven.actuator)

    def numbers(value: float) -> np.ndarray:
        own = {each: {**launch, name: value}[each] / size for each, size in sizes_of_launch.items()}
        named = {**known, **at(value).still, **own}
        if "short" in launch:
            like = {each.removeprefix("aim "): x for each, x in known.items() if each.startswith("aim ")}
            begun = launched_at(at(value), {**like, "liftoff": known["liftoff"]}, known["aim"] - own["short"])
            named |= {"launch": begun["alpha"], "liftoff": begun["liftoff"]}
        return np.array([named[each] for each in problem.fixed])

    ends = [at(first), at(last)]
    sizes = [each.units for each in ends]
    if sizes[0] != sizes[1]:
        raise InputError(f"with {name} the machine's units change: follow the machine without units")
    gaps = [each.model.gap(each.values) for each in ends]
    if ends[0].drive != ends[1].drive or gaps[0] != gaps[1]:
        raise InputError(f"with {name} the machine's equations change, not only their numbers: find each hop")
    if "aim" in known and undamped(ends[0].machine).values != undamped(ends[1].machine).values:
        raise InputError(f"with {name} the target orbit changes: find each motion")
    landing = f"the condition at the end of stage 1 ({problem.stages[0].phase.name})"
    if not (launch or "aim" in known or ends[1].damped) and problem.labels.count(landing) == 1:
        raise InputError(
            f"to {name} = {last:g}: with a free landing the optimality conditions are singular at 0, where the "
            "landing is lossless: follow to a number above 0"
        )
    if "height" in launch:
        check_free_fall(ends[1], bare(np.linspace(0.0, bare.legs[0].duration, 5))[:, :-1])
    a, b = (numbers(value) for value in (first, last))
    found = [(a + share * (b - a), numbers(first + share * (last - first))) for share in LINEAR_AT]
    if all(np.abs(line - own).max() <= LINEAR * (1 + np.abs(own).max()) for line, own in found):
        rates = (b - a) / (last - first)
        return lambda value: (a + rates * (value - first), rates)
    return _differenced(numbers, *sorted((first, last)))


def _differenced(numbers: Callable[[float], np.ndarray], low: float, high: float) -> FixedParameters:
    """Numbers with their derivatives, which are those of parabolas through three values within a range."""

    def at(value: float) -> tuple[np.ndarray, np.ndarray]:
        step = min(DIFFERENCE_OF_NUMBERS * max(high - low, abs(value)), 0.5 * (high - low))
        middle = min(max(value, low + step), high - step)
        below, here, above = (numbers(each) for each in (middle - step, middle, middle + step))
        bend = (value - middle) / step**2 * (above - 2 * here + below)
        return here if middle == value else numbers(value), (above - below) / (2 * step) + bend

    return at
