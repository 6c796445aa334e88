"""What a machine of two masses is stated by: spring, gravity, mass ratio, rest length, losses and units."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, Self

from orbits.errors import InputError
from orbits.model.model import Model, Units
from orbits.symbolic.formula import suggest

from . import gravity as gravities
from . import springs
from .gravity import as_gravity
from .laws import Key, Law, coefficient_of_restitution, number, own_parameters
from .springs import as_spring

# Beyond these bounds one of the two masses is lost in rounding.
MASS_RATIOS = (1e-12, 1e12)
DAMPERS = ("damping", "drag")
OWN_PARAMETERS = ("mass_ratio", "rest_length", *DAMPERS)


@dataclass(frozen=True)
class TwoMassMachine:
    """Two masses, a spring and gravity, in the units of the machine's module.

    spring : a law of `problems.springs`, a formula of the extension r, a law's name, "table:FILE",
        "potential:FORMULA", or a Python function
    gravity : likewise a law of the height z, as a ratio to gravity at the ground; both are kept as a `Law`
    mass_ratio : M = m2/m1, above 0
    rest_length : of the spring; None for long enough that the masses never meet, which constant gravity allows
    restitution : of the impacts, 0 <= e <= 1; a lossless orbit is the same for every value
    damping : of the damper beside the spring, force over speed, from 0
    drag : force over speed on each mass, against its motion, from 0
    parameters : values of the formulas' other names
    units : of the numbers in SI, see `units.machine_in_si`; the parameters of the laws are then in SI themselves
    """

    spring: Any = "r"
    gravity: Any = "1"
    mass_ratio: float = 1.0
    rest_length: float | None = None
    restitution: float = 0.0
    damping: float = 0.0
    drag: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    units: Units | None = field(default=None, kw_only=True)

    kind = ""

    def __post_init__(self) -> None:
        number("mass_ratio", self.mass_ratio, *MASS_RATIOS)
        coefficient_of_restitution(self.restitution)
        if self.rest_length is not None:
            number("rest_length", self.rest_length, low=0)
        for name in DAMPERS:
            if not number(name, getattr(self, name)) >= 0:
                raise InputError(f"{name} = {getattr(self, name):g} is below 0: it would drive the machine")
        spring, gravity = self._laws()
        parameters = {**spring.parameters, **gravity.parameters}
        for name, value in (("spring", spring), ("gravity", gravity), ("parameters", parameters)):
            object.__setattr__(self, name, value)
        if self.rest_length is None and self.varying_gravity:
            raise InputError(
                f"gravity '{gravity.text}' varies with height, and the upper mass is as high as its coordinate and the "
                "rest length together: give the rest length"
            )

    def _laws(self) -> tuple[Law, Law]:
        """The two laws, each with its own parameters; raises `InputError` for unknown, reserved and ambiguous names."""
        if not isinstance(self.parameters, Mapping):
            raise InputError(f"parameters = {self.parameters!r}; they are a mapping of names to numbers")
        given = {name: number(name, value) for name, value in self.parameters.items()}
        spring = as_spring(self.spring, own_parameters(self.spring, "r", springs.NAMED, given))
        gravity = as_gravity(self.gravity, own_parameters(self.gravity, "z", gravities.NAMED, given))
        known = {**spring.parameters, **gravity.parameters}
        if taken := [name for name in (*OWN_PARAMETERS, "gravity_share") if name in known or name in given]:
            raise InputError(f"'{taken[0]}' is the machine's own name; call the formula's parameter something else")
        if unknown := [name for name in given if name not in known]:
            raise InputError(f"neither formula has a parameter '{unknown[0]}'{suggest(unknown[0], list(known))}")
        for name in spring.parameters.keys() & gravity.parameters.keys():
            if spring.parameters[name] != gravity.parameters[name]:
                raise InputError(f"spring and gravity both have a parameter '{name}' with different values; rename one")
        return spring, gravity

    @cached_property
    def model(self) -> Model:
        """The phases and orbits of the machine; machines that differ only in numbers share it."""
        return self.build(self.spring.key, self.varying_gravity, self.rest_length is not None, self.damped)

    @property
    def varying_gravity(self) -> Key | None:
        """The key of the gravity law, None where gravity is constant."""
        key = self.gravity.key
        return key if key.degree() > 0 else None

    @property
    def damped(self) -> bool:
        """Whether the machine loses energy otherwise than by impacts."""
        return self.damping > 0 or self.drag > 0

    def build(self, spring: Key, gravity: Key | None, has_length: bool, damped: bool) -> Model:
        """The model from the keys of the laws (None: constant gravity), and whether there is a length, a damping."""
        raise NotImplementedError

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of the model by name."""
        values = {"mass_ratio": self.mass_ratio}
        if self.rest_length is not None:
            values["rest_length"] = self.rest_length
        values |= self.parameters
        if self.damped:
            values |= {name: getattr(self, name) for name in DAMPERS}
        if self.model.homotopy:
            values[self.model.homotopy] = 1.0
        return {name: float(value) for name, value in values.items()}

    def with_values(self, **values: float) -> Self:
        """The same machine with other values of mass_ratio, rest_length, damping, drag or the formulas' parameters.

        Raises `InputError` for an unknown name, and for masses and lengths of a machine in SI: they set the units.
        """
        if self.units and (fixed := values.keys() & {"mass_ratio", "rest_length"}):
            raise InputError(f"'{min(fixed)}' of a machine in SI follows from its masses and lengths: state it anew")
        own: dict[str, Any] = {name: values.pop(name) for name in OWN_PARAMETERS if name in values}
        return replace(self, parameters={**self.parameters, **values}, **own)

    def describe(self) -> dict[str, Any]:
        """The machine as JSON-ready data."""
        return {
            "machine": self.kind,
            "spring": self.spring.text,
            "gravity": self.gravity.text,
            "mass_ratio": float(self.mass_ratio),
            "rest_length": None if self.rest_length is None else float(self.rest_length),
            "restitution": float(self.restitution),
            **({name: float(getattr(self, name)) for name in DAMPERS} if self.damped else {}),
            "parameters": {name: float(value) for name, value in self.parameters.items()},
            "laws_in": "SI" if self.units else "units of the machine",
            **({f"unit_{name}": value for name, value in asdict(self.units).items()} if self.units else {}),
        }
