"""Units: the meaning of the numbers of a machine that is stated in SI, and the one place that converts results.

The engine computes without dimensions. A result's number has a dimension by its name (`DIMENSIONS`), a state by the
apostrophe at the end of a speed's name. Where a machine has `Units`, its public results are converted to SI by them,
and where some of its coordinates are angles, the units say so: an angle is the same number in every system of units.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from fractions import Fraction
from functools import wraps
from inspect import signature
from numbers import Real
from typing import Any, NamedTuple, NotRequired, ParamSpec, Self, TypedDict, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from .errors import InputError, OrbitsError, finite_number
from .io import Document, conform
from .records import Records

# Powers of the units of length, time, force and energy, of the extension at lift-off, which is a length or an angle,
# and of angles; those left out at the end are 0.
Dimension = tuple[float, ...]
Record = TypeVar("Record")
_Arguments = ParamSpec("_Arguments")
_Outcome = TypeVar("_Outcome")

STANDARD_GRAVITY = 9.80665  # m/s^2


def _powers(
    *, length: float = 0, time: float = 0, force: float = 0, energy: float = 0, extension: float = 0, angle: float = 0
) -> Dimension:
    """The dimension with these powers of the units."""
    powers = length, time, force, energy, extension, angle
    last = max((count for count, power in enumerate(powers, start=1) if power), default=0)
    return powers[: max(last, 3)]


LENGTH, TIME, FORCE, ENERGY = _powers(length=1), _powers(time=1), _powers(force=1), _powers(energy=1)
FREQUENCY, SPEED = _powers(time=-1), _powers(length=1, time=-1)
ACCELERATION, JERK = _powers(length=1, time=-2), _powers(length=1, time=-3)
MASS, INERTIA = _powers(length=-1, time=2, force=1), _powers(length=1, time=2, force=1)
STIFFNESS = _powers(length=-1, force=1)
TORQUE = _powers(length=1, force=1)  # of a force against an angle
EXTENSION, LIFTOFF_SPEED = _powers(extension=1), _powers(time=-1, extension=1)
LIFTOFF_SPEED_SQUARED = _powers(time=-2, extension=2)
ANGLE, ANGULAR_SPEED = _powers(angle=1), _powers(time=-1, angle=1)
# Dimensions of results by name. The loss coefficient is a loss of speed per speed to the power 4/3; the loss of a hop
# of the map is one of the speed's square.
DIMENSIONS: dict[str, Dimension] = {
    **dict.fromkeys(("alpha", "error", "alpha_noise", "robustness"), LIFTOFF_SPEED),
    "alpha_per_noise": _powers(time=-1, force=-1, extension=1),
    **dict.fromkeys(("flight_time", "contact_time", "period", "half_stance", "half_double_stance"), TIME),
    "frequency": FREQUENCY,
    **dict.fromkeys(("liftoff_extension", "stroke"), EXTENSION),
    **dict.fromkeys(("clearance", "smallest_separation", "step"), LENGTH),
    **dict.fromkeys(("speed", "mean_speed"), SPEED),
    **dict.fromkeys(("smallest_contact_force", "largest_contact_force", "largest_spring_force"), FORCE),
    **{"friction_time": TIME, "smallest_stance_force": FORCE},
    "loop_energy": ENERGY,
    "landing_jerk": JERK,
    "landing_sensitivity": _powers(length=1, time=1, extension=-1),
    **dict.fromkeys(("loss_coefficient", "loss_error"), _powers(time=1 / 3, extension=-1 / 3)),
}
# The ends of the names of quantities of heights: how far one rises in flight above where it lifts off, and its highest.
OF_HEIGHTS = RISE, APEX = "_rise", "_apex"
# Those of a machine whose gap is an angle.
OF_ANGULAR_GAPS: dict[str, Dimension] = {
    **dict.fromkeys(("smallest_contact_force", "largest_contact_force"), TORQUE),
    **{"clearance": ANGLE, "landing_jerk": _powers(time=-3, angle=1)},
    "landing_sensitivity": _powers(time=1, extension=-1, angle=1),
}
# Those of a machine whose extension at lift-off is an angle: its springs have torques.
OF_ANGULAR_EXTENSIONS: dict[str, Dimension] = {
    "largest_spring_force": TORQUE, "alpha_per_noise": _powers(length=-1, time=-1, force=-1, extension=1),
}  # fmt: skip
OF_ANGLES = OF_ANGULAR_GAPS.keys() | OF_ANGULAR_EXTENSIONS.keys()
# Dimensions of the quantities of a return map's hops.
DIMENSIONS_OF_HOPS: dict[str, Dimension] = {
    **{"alpha": LIFTOFF_SPEED, "next": LIFTOFF_SPEED, "loss": LIFTOFF_SPEED_SQUARED}
}
# Dimensions of unknowns, in addition to the flight states, that determine a launch or half an orbit.
UNKNOWNS: dict[str, Dimension] = {
    **dict.fromkeys(("duration", "contact_duration"), TIME),
    **{"alpha": LIFTOFF_SPEED, "liftoff": EXTENSION, "unfolding": ()},
}
LARGEST_DENOMINATOR = 12  # of a power that is written as a fraction
SAME_POWER = 2e-9  # difference of a power from its fraction: powers in formulas have nine digits
# The powers of a unit in a file, are few and stay far from the bounds of numbers.
SMALLEST_SAVED = 1e-50
# Names of composed dimensions.
_NAMES: dict[Dimension, str] = {(0, 0, 0, 0, 0): "", (*MASS, 0, 0): "kg", (*INERTIA, 0, 0): "kg m^2", (*ENERGY, 0): "J"}


@dataclass(frozen=True)
class Units:
    """The units of length, time, force and energy of a dimensionless machine, in SI.

    length, time, force, energy : in m, s, N and J. The unit of energy may differ from force times length; None where it
        is not known
    angles : names of the coordinates that are angles (rad) instead of lengths; also "liftoff" if the extension at
        lift-off is an angle, so that the launch speed is in rad/s, and "gap" if the gap is an angle, so that its
        contact force is a torque
    own : the dimensions by name of states that are neither lengths nor angles nor their speeds

    In `Model.units` the units are expressions of the machine's parameters.
    """

    length: Any
    time: Any
    force: Any
    energy: Any = None
    angles: tuple[str, ...] = ()
    own: tuple[tuple[str, Dimension], ...] = ()

    def resolved(self, dimension: Dimension | str) -> Dimension:
        """The powers of lengths, times, forces, energies and angles of a dimension, or of the state, unknown or result
        of a gap of this name."""
        if isinstance(dimension, str) and dimension in (own := dict(self.own)):
            dimension = own[dimension]
        if isinstance(dimension, str) and dimension in OF_ANGLES and dimension not in self.angles:
            dimension = self._angular.get(dimension, DIMENSIONS[dimension])
        if isinstance(dimension, str):
            angle = ANGULAR_SPEED if dimension.endswith("'") else ANGLE
            known = dimension not in UNKNOWNS and dimension.removesuffix("'") in self.angles
            dimension = angle if known else dimension_of_state(dimension)
        length, time, force, energy, extension, angular = _all_powers(dimension)
        launched = (0, extension) if "liftoff" in self.angles else (extension, 0)
        return length + launched[0], time, force, energy, angular + launched[1]

    @property
    def _angular(self) -> dict[str, Dimension]:
        """The dimensions of results that the angles among gap and extension change, by name."""
        own = {"gap": OF_ANGULAR_GAPS, "liftoff": OF_ANGULAR_EXTENSIONS}
        return {name: each for angle in own if angle in self.angles for name, each in own[angle].items()}

    def of(self, dimension: Dimension | str) -> Any:
        """The unit of a dimension, or of the state or unknown with this name."""
        unit, powers = 1.0, self.resolved(dimension)
        for base, power in zip((self.length, self.time, self.force, self.energy), powers, strict=False):
            unit = unit if power == 0 else unit * base**power
        return unit

    def text(self, dimension: Dimension | str) -> str:
        """The SI unit of a dimension, or of the state or unknown with this name, as text such as "m/s"."""
        length, time, force, energy, angle = self.resolved(dimension)
        return unit_text((length, time, force, energy, 0, angle))

    def texts(self, dimensions: Mapping[str, Dimension] = DIMENSIONS) -> dict[str, str]:
        """The SI units of results by name, as text."""
        return {name: self.text(self._angular.get(name, dimension)) for name, dimension in dimensions.items()}

    def unusual_texts(self) -> dict[str, str]:
        """The entries of `texts`, hops included, that differ from those of a machine whose launch speed is in m/s."""
        known = {**DIMENSIONS, **DIMENSIONS_OF_HOPS}
        return {name: text for name, text in self.texts(known).items() if text != unit_text(known[name])}

    def of_states(self, names: Sequence[str], own: Mapping[str, Dimension] | None = None) -> np.ndarray:
        """The units (n,) of states by name, which are lengths or speeds; `own` has the dimensions of other rows."""
        own = {name: FORCE for name in names if name.startswith(("contact force", "holding force"))} | {**(own or {})}
        return np.array([self.of(own.get(name) or name) for name in names])

    def dimensionless(self, name: str, argument: object, dimension: Dimension = ()) -> Any:
        """The dimensionless value of an argument of this name and dimension in these units. An argument without numbers
        is returned unchanged, for the function to refuse. A mapping has unknowns of a launch or half an orbit by name;
        raises `InputError` if one is not a number."""
        if hasattr(argument, "dimensionless"):
            return argument.dimensionless()
        if hasattr(argument, "in_units"):
            return argument.in_units(self.inverse())
        if isinstance(argument, Mapping):
            return {key: finite_number(f"{name} '{key}'", argument[key]) / self.of(str(key)) for key in argument}
        if isinstance(argument, tuple | list):
            return type(argument)(self.dimensionless(name, each, dimension) for each in argument)
        known = isinstance(argument, Real | np.ndarray) and not isinstance(argument, bool)
        with np.errstate(over="ignore"):  # what is too large for a number is refused as infinite
            return argument / self.of(dimension) if known else argument

    def convert(self, record: Record, **own: Dimension) -> Record:
        """A frozen record of dimensionless numbers, or `Records` for units (m,), converted to SI where the name is
        known; `own` has further dimensions by name."""
        known: dict[str, object] = {}
        several: Any = record if isinstance(record, Records) else None
        for name in several.columns if several else [field.name for field in fields(record)]:  # type: ignore[arg-type]
            dimension = own.get(name) or DIMENSIONS.get(name)
            if dimension and (value := several.column(name) if several else getattr(record, name)) is not None:
                known[name] = value * self.of(dimension)
        return several.replaced(**known) if several else replace(record, **known)  # type: ignore[type-var]

    def convert_motion(self, path: Any, own: Mapping[str, Dimension] | None = None) -> Any:
        """A `Trajectory` in SI; `own` has the dimensions of rows that are not states."""
        with np.errstate(all="ignore"):
            powers = float(self.time) ** -np.arange(path.coefficients.shape[2])
            c = path.coefficients * (self.of_states(path.names, own)[:, None] * powers)
        # The last coefficients may be beyond all numbers: their terms are far below rounding, and are left out.
        return replace(
            path, times=path.times * self.time, coefficients=np.where(np.isfinite(c), c, 0.0), variations=None
        )

    def convert_height(self, height: Any, states: Sequence[str]) -> Any:
        """A function of the state whose value is a length, for states of these names in SI; None for None."""
        return height and height.in_units(self.of_states(states).tolist(), self.length)

    def converted(self, found: object, dimension: Dimension) -> Any:
        """Dimensionless numbers of this dimension in SI, in tuples, lists and mappings too; records as by `convert`."""
        if is_dataclass(found):
            return self.convert(found)
        if isinstance(found, Mapping):
            return {self.converted(key, dimension): self.converted(found[key], dimension) for key in found}
        if isinstance(found, tuple | list):
            return type(found)(self.converted(each, dimension) for each in found)
        return found * self.of(dimension) if dimension else found

    def inverse(self) -> "Units":
        """The units that convert back."""
        return Units(
            1 / self.length, 1 / self.time, 1 / self.force, self.energy and 1 / self.energy, self.angles, self.own
        )

    def saved(self) -> Document:
        """The units for a file, as `SavedUnits`."""
        return {name: value for name, value in vars(self).items() if name not in ("angles", "own") or value}


def dimension_of_state(name: str) -> Dimension:
    """The dimension of a state: that of one of `UNKNOWNS`, of a speed, whose name ends with an apostrophe, or of a
    length."""
    return UNKNOWNS.get(name, SPEED if name.endswith("'") else LENGTH)


class SavedUnits(TypedDict):
    """`Units` in a file."""

    length: float
    time: float
    force: float
    energy: NotRequired[float | None]
    angles: NotRequired[tuple[str, ...]]
    own: NotRequired[tuple[tuple[str, Dimension], ...]]


def saved_units(data: Mapping[str, object]) -> Units:
    """The units that a file states; raises `InputError` where one is not above 0, or so small or so large that results
    in it would be no numbers."""
    units = Units(**conform(dict(data), SavedUnits))
    for name in ("length", "time", "force", "energy"):
        unit = getattr(units, name)
        if unit is not None and not SMALLEST_SAVED < unit < 1 / SMALLEST_SAVED:
            bounds = f"{SMALLEST_SAVED:g} and {1 / SMALLEST_SAVED:g}"
            raise InputError(f"its unit of {name} is {unit:g}; it must lie between {bounds}")
    return units


class Quantity(NamedTuple):
    """A number in a message, with its dimension or the name of the state or result of a gap that it is; `unit` follows
    it once it is in SI."""

    value: float
    dimension: Dimension | str
    unit: str = ""

    def __format__(self, spec: str) -> str:
        return f"{self.value:{spec}} {self.unit}".rstrip()

    def in_units(self, units: Units) -> "Quantity":
        """This quantity in these units; one that has its unit stays as it is."""
        if self.unit:
            return self
        return Quantity(self.value * units.of(self.dimension), self.dimension, units.text(self.dimension))


class Message(str):
    """A text with numbers that have dimensions, which `in_units` states in SI.

    pattern : as for `str.format`
    parts : what its names stand for: quantities, numbers without dimension, texts, other messages, or errors for what
        they say
    """

    pattern: str
    parts: dict[str, Any]

    def __new__(cls, pattern: str, /, **parts: object) -> Self:
        parts = {name: _message_of(part) for name, part in parts.items()}  # no error is stored, nor what it refers to
        text = super().__new__(cls, pattern.format(**parts))
        text.pattern, text.parts = pattern, parts
        return text

    def __getnewargs_ex__(self) -> tuple[tuple[str], dict[str, Any]]:
        return (self.pattern,), self.parts

    @classmethod
    def joined(cls, separator: str, texts: Iterable[str]) -> "Message":
        """Texts, which may be messages, with a separator between."""
        parts = {f"text{i}": text for i, text in enumerate(texts)}
        return cls(separator.join(f"{{{name}}}" for name in parts), **parts)

    def in_units(self, units: Units) -> "Message":
        """This message in these units."""
        return Message(self.pattern, **{name: in_units(part, units) for name, part in self.parts.items()})


def _message_of(part: object) -> object:
    """The message of an error, whole; anything else as it is."""
    return (part.args or ("",))[0] if isinstance(part, OrbitsError) else part


def in_units(part: object, units: Units | None) -> Any:
    """A message, what an error says, or a quantity, in these units; anything else as it is."""
    part = _message_of(part)
    return part.in_units(units) if units and isinstance(part, Message | Quantity) else part


def described(names: Sequence[str], x: ArrayLike) -> Message:
    """The names of states and their numbers (n,)."""
    numbers = zip(names, np.ravel(x).tolist(), strict=False)
    quantities = [(name, Quantity(value, name)) for name, value in numbers]
    return Message.joined(", ", [Message("{name} = {value:.6g}", name=name, value=value) for name, value in quantities])


@contextmanager
def without_units(units: Units | None) -> Iterator[None]:
    """Where a machine with units is computed without: an error states its quantities in the machine's units."""
    try:
        yield
    except OrbitsError as error:
        if units and error.args:
            error.args = (in_units(error, units),)
        raise


def in_own_units(
    result: Dimension | Callable[[Any, Any], Any], **arguments: Dimension | Callable[[Any, Any], Any]
) -> Callable[[Callable[_Arguments, _Outcome]], Callable[_Arguments, _Outcome]]:
    """A function that computes without dimensions as one whose first argument, a machine say, may have units: then
    arguments are converted to the units of the machine's dimensionless self, and results and errors back.

    result : the dimension of the numbers in the result, or (result, machine) -> the result in the machine's units
    arguments : by name the dimension of each that has one, or (argument, machine) -> the argument made dimensionless
    """

    def of_the_machine(function: Callable[_Arguments, _Outcome]) -> Callable[_Arguments, _Outcome]:
        parameters = signature(function)

        @wraps(function)
        def converted(*positional: _Arguments.args, **named: _Arguments.kwargs) -> _Outcome:
            machine: Any = positional[0]
            if (units := getattr(machine, "units", None)) is None:
                return function(*positional, **named)
            bound = parameters.bind(machine.dimensionless(), *positional[1:], **named)
            for name in arguments.keys() & bound.arguments.keys():
                own, argument = arguments[name], bound.arguments[name]
                bare = own(argument, machine) if callable(own) else units.dimensionless(name, argument, own)
                bound.arguments[name] = bare
            with without_units(units):
                found: object = function(*bound.args, **bound.kwargs)
            return result(found, machine) if callable(result) else units.converted(found, result)

        return converted

    return of_the_machine


def _all_powers(dimension: Dimension) -> tuple[float, ...]:
    """The six powers of a dimension."""
    return (*dimension, *(0.0,) * (6 - len(dimension)))


def unit_text(dimension: Dimension) -> str:
    """A dimension in words of SI, as "m/s", its extensions being lengths; nothing for a number's."""
    length, time, force, energy, extension, angle = _all_powers(dimension)
    length += extension
    if (known := (length, time, force, energy, angle)) in _NAMES:
        return _NAMES[known]
    powers = {"N": force, "rad": angle, "m": length, "s": time}
    above = [_text_of_power(name, power) for name, power in powers.items() if power > 0]
    below = [_text_of_power(name, -power) for name, power in powers.items() if power < 0]
    return " ".join(above or ["1"]) + "".join(f"/{part}" for part in below)


def _text_of_power(name: str, power: float) -> str:
    if power == 1:
        return name
    fraction = Fraction(power).limit_denominator(LARGEST_DENOMINATOR)
    if abs(fraction - power) > SAME_POWER:
        return f"{name}^{power:g}"
    return f"{name}^{fraction}" if fraction.denominator == 1 else f"{name}^({fraction})"


# Units of the results of a machine in SI, by name.
UNIT_TEXTS = {name: unit_text(dimension) for name, dimension in DIMENSIONS.items()}
