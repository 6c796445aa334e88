"""The statement of a machine of two masses: a spring, a gravity, a ratio of masses, and its damping."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar, Self

from orbits.errors import InputError
from orbits.io import one_line
from orbits.laws import Key, Law, LawLike, coefficient_of_restitution, number
from orbits.mechanics import Ground, Mechanism, joined_values
from orbits.model import Model, Stated
from orbits.running import exclusive, exclusive_property
from orbits.symbolic import suggest

from ..laws import as_gravity, as_spring, formula
from .parameters import checked_numbers, refuse_taken

# Beyond these bounds one of the two masses is lost in rounding.
MASS_RATIOS = (1e-12, 1e12)
DAMPERS = ("damping", "drag")
OWN_PARAMETERS = ("mass_ratio", "rest_length", *DAMPERS)
GROUND_MASS = "ground_mass"


def checked_ground(ground: object, parameters: Mapping[str, float], kind: str, in_si: bool = False) -> Ground | None:
    """The ground of a machine with its mass as a number and its spring as a law; raises `InputError` for anything but
    one under a hopper."""
    if ground is None:
        return None
    if not isinstance(ground, Ground):
        raise InputError(f"ground = {ground!r}; it must be a Ground, for example ground=Ground(mass=2.0, spring=100.0)")
    if kind != "hopper":
        raise InputError(f"ground={ground!r}: what lands in a {kind} does not land on the ground; leave it out")
    if ground.name != "ground":
        raise InputError(f"the ground of a {kind} is called 'ground', not '{ground.name}'; leave out its name")
    spring = ground.spring
    if isinstance(spring, Real) and not isinstance(spring, bool):
        spring = formula("ground_stiffness*r", ground_stiffness=number("ground's spring", spring, low=0))
    law = as_spring(spring, parameters, in_si, shared=True)
    law.refuse_units(in_si)
    return Ground(number("ground's mass", ground.mass, low=0), law)


class TwoMasses(Stated):
    """The common parts of machines of two masses, dimensionless or in SI."""

    # Parameters that it takes besides its `values`, which have no damping of 0 and no missing length.
    further_parameters: ClassVar[tuple[str, ...]] = (*DAMPERS, "rest_length")
    rest_length: float | None
    restitution: float
    damping: float
    drag: float
    ground: Any

    @property
    def damped(self) -> bool:
        """Whether the machine loses energy otherwise than by impacts."""
        return self.damping > 0 or self.drag > 0

    @property
    def of_loop(self: Any) -> bool:
        """Whether its spring is one branch of a measured loop."""
        return self.spring is not None and self.spring.loop is not None

    def on_loop(self: Any, alpha: float) -> Any:
        """The `Upkeep` of a hop with a launch speed on the measured loop that has the machine's spring as a branch;
        None if the spring is not a branch of a loop. Raises `NoOrbit` if the hop has no next launch."""
        if not self.of_loop:
            return None
        from orbits.returns import ReturnMap  # most machines need none

        return ReturnMap(replace(self, spring=self.spring.loop())).upkeep(alpha)

    def _store_common(self) -> None:
        """Store length and losses as numbers; raises `InputError` that names an invalid one."""
        length = self.rest_length if self.rest_length is None else number("rest_length", self.rest_length, low=0)
        self._store(rest_length=length, restitution=coefficient_of_restitution(self.restitution))
        for name in DAMPERS:
            self._store(**{name: number(name, getattr(self, name))})
            if getattr(self, name) < 0:
                raise InputError(f"{name} = {getattr(self, name):g} is below 0: it would drive the machine")

    def _with_parts(self: Any, own: Mapping[str, float]) -> dict[str, float]:
        """Every parameter by name: the machine's own numbers, and those of its length, laws, dampers and ground."""
        values = dict(own)
        if self.rest_length is not None:
            values["rest_length"] = self.rest_length
        values |= self.parameters
        if self.damped:
            values |= {name: getattr(self, name) for name in DAMPERS}
        if self.ground:
            values[GROUND_MASS] = self.ground.mass
        return values

    def _described(self: Any, spring: str, laws_in: str) -> dict[str, object]:
        """The machine as JSON-ready data, with its spring in words."""
        return {
            "machine": self.kind,
            "spring": spring,
            "gravity": self.gravity.text,
            "mass_ratio": self.mass_ratio,
            "rest_length": self.rest_length,
            "restitution": self.restitution,
            **({name: getattr(self, name) for name in DAMPERS} if self.damped else {}),
            **({"ground": {"mass": self.ground.mass, "spring": self.ground.spring.text}} if self.ground else {}),
            "parameters": dict(self.parameters),
            "laws_in": laws_in,
        }


@dataclass(frozen=True, repr=False)
class TwoMassMachine(TwoMasses):
    """Two masses, a spring and gravity, in the units of the machine's module.

    spring : a law of `problems.springs`, a formula of the extension r, a law's name, "table:FILE",
        "potential:FORMULA", or a Python function
    gravity : likewise a law of the height z, as a ratio to gravity at the ground; spring and gravity become a `Law`
    mass_ratio : M = m2/m1, above 0
    rest_length : of the spring; None where the masses are assumed never to meet, which constant gravity allows
    restitution : of the impacts, 0 <= e <= 1; a lossless orbit is the same for every value
    damping : coefficient of the damper in parallel with the spring, force over speed, at least 0
    drag : coefficient of the drag on each mass, force over speed, at least 0
    parameters : values of the formulas' other names
    ground : under a hopper, a `Ground` that yields: its mass over the foot's, a parameter "ground_mass", and its spring
        in the units of the machine, a law or a stiffness, which is a parameter "ground_stiffness". A launch is then
        more than a speed. None for rigid ground

    Raises `InputError` for invalid laws and numbers, and for names without values.
    """

    spring: Law = "r"  # type: ignore[assignment]
    gravity: Law = "1"  # type: ignore[assignment]
    mass_ratio: float = 1.0
    rest_length: float | None = None
    restitution: float = 0.0
    damping: float = 0.0
    drag: float = 0.0
    parameters: Mapping[str, float] = field(default_factory=dict)
    ground: Ground | None = None

    if TYPE_CHECKING:  # laws are stated in several ways

        def __init__(
            self, spring: LawLike = "r", gravity: LawLike = "1", mass_ratio: float = 1.0,
            rest_length: float | None = None, restitution: float = 0.0, damping: float = 0.0, drag: float = 0.0,
            parameters: Mapping[str, float] = ..., ground: Ground | None = None,
        ): ...  # fmt: skip

    kind = ""
    # A machine with units is a `units.MachineInSI`.
    units = None

    @exclusive
    def __post_init__(self) -> None:
        self._store(mass_ratio=number("mass_ratio", self.mass_ratio, *MASS_RATIOS))
        self._store_common()
        spring, gravity, ground = self._laws()
        laws = [spring, gravity, *([ground.spring] if ground else [])]
        parameters = joined_values(((law.text, law.parameters) for law in laws), {})
        self._store(spring=spring, gravity=gravity, parameters=parameters, ground=ground)
        if self.rest_length is None and self.varying_gravity:
            high = "the height of the upper mass is its coordinate plus the rest length"
            raise InputError(f"gravity '{gravity.text}' varies with height, and {high}: give the rest length")

    def _laws(self) -> tuple[Law, Law, Ground | None]:
        """The two laws and the ground with its law, each with its own parameters; raises `InputError` for unknown and
        reserved names."""
        values = checked_numbers(self.parameters)
        spring, gravity = as_spring(self.spring, values, shared=True), as_gravity(self.gravity, values, shared=True)
        spring.refuse_units(in_si=False)
        ground = checked_ground(self.ground, values, self.kind)
        known = {**spring.parameters, **gravity.parameters, **(ground.spring.parameters if ground else {})}
        refuse_taken((*OWN_PARAMETERS, GROUND_MASS, "gravity_share"), [*known, *values], "the machine's own name")
        if unknown := [name for name in values if name not in known]:
            raise InputError(f"neither formula has a parameter '{unknown[0]}'{suggest(unknown[0], known)}")
        return spring, gravity, ground

    @exclusive_property
    def model(self) -> Model:
        """The phases and orbits of the machine; machines that differ only in numbers share it."""
        return self.build(*self.keys, self.rest_length is not None, self.damped, *self.ground_keys)

    @property
    def ground_keys(self) -> tuple[Any, ...]:
        """The further arguments of `mechanism` on compliant ground."""
        return () if self.ground is None else (self.ground.spring.key,)

    @classmethod
    def build(cls, *laws: Any) -> Model:
        """The model that follows from `mechanism` with the same arguments."""
        return cls.mechanism(*laws).model

    @property
    def varying_gravity(self) -> Key | None:
        """The key of the gravity law, None where gravity is constant."""
        key = self.gravity.key
        return key if key.degree() > 0 else None

    @property
    def keys(self) -> tuple[Key, Key | None]:
        """The keys of the spring and of `varying_gravity`."""
        return self.spring.key, self.varying_gravity

    @staticmethod
    def mechanism(
        spring: Key, gravity: Key | None, has_length: bool, damped: bool, ground: Key | None = None
    ) -> Mechanism:
        """The mechanism from the keys of the laws (None: constant gravity), and whether there is a rest length and a
        damping; and from the key of the law of compliant ground. Its parameters have no values yet."""
        raise NotImplementedError

    def stated(self) -> Mechanism:
        """The machine as a mechanism, with the values of its parameters."""
        has_length = self.rest_length is not None
        values = {name: value for name, value in self.values.items() if name != self.model.homotopy}
        mechanism = self.mechanism(self.spring.key, self.gravity.key, has_length, self.damped, *self.ground_keys)
        return replace(mechanism, parameters=values)

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of the model by name."""
        values = self._with_parts({"mass_ratio": self.mass_ratio})
        if self.model.homotopy:
            values[self.model.homotopy] = 1.0
        return values

    def with_values(self, **values: float) -> Self:
        """This machine with other values of mass_ratio, rest_length, damping, drag or the formulas' parameters.

        Raises `InputError` for an unknown name.
        """
        own: dict[str, Any] = {name: values.pop(name) for name in OWN_PARAMETERS if name in values}
        if self.ground and GROUND_MASS in values:
            own["ground"] = replace(self.ground, mass=values.pop(GROUND_MASS))
        return replace(self, parameters={**self.parameters, **values}, **own)

    def __repr__(self) -> str:
        laws = {"spring": self.spring.text, "gravity": self.gravity.text}
        own = dict(self.parameters)
        stated_fields = {**laws, **own, **self.__getstate__(), **laws}
        plain = {each.name: each.default for each in fields(self)} | {"spring": None, "parameters": self.parameters}
        shown = {name: value for name, value in stated_fields.items() if name not in plain or value != plain[name]}
        return one_line(self, shown)

    def describe(self) -> dict[str, Any]:
        """The machine as JSON-ready data."""
        return self._described(self.spring.text, "units of the machine")
