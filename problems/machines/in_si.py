"""Machines stated in SI: masses in kg, stiffness in N/m, lengths in m, gravity in m/s^2.

A machine in SI is a dimensionless one whose parameters are functions of the SI ones: lengths are in m2 g/k, forces in
m2 g, times in sqrt(m2/k) and, for the hopper, over sqrt(1 + m2/m1) (eq. 2). The units follow masses and gravity as
these change; k is the spring's stiffness at rest as first stated, and stays, since it is free to choose.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Self, TypeAlias

import numpy as np

from orbits import Mechanism
from orbits.errors import InputError
from orbits.laws import UNIT_FORCE, UNIT_LENGTH, WRONG_SIGN, Algebraic, Law, LawLike, Parameters, number
from orbits.mechanics import Ground, Mass, law_dimensions
from orbits.model import Model, reparametrised
from orbits.running import exclusive, exclusive_property
from orbits.symbolic import suggest
from orbits.units import ACCELERATION, LENGTH, MASS, STANDARD_GRAVITY, Dimension, Units, unit_text

from ..laws import as_gravity, as_spring, gravity as gravities, springs
from .hopper import Hopper
from .juggler import Juggler
from .parameters import refuse_taken, stated_numbers
from .two_masses import DAMPERS, GROUND_MASS, TwoMasses, TwoMassMachine, checked_ground

# The parameter that sets the units beside a force law, and changes no motion.
GAUGE, BODY_RADIUS = "unit_stiffness", "body_radius"
# Beyond these, results that have powers of the units overflow.
SIZES_OF_UNITS = 1e-60, 1e60
DIMENSIONS_OF_PARAMETERS: dict[str, Dimension] = {
    **dict.fromkeys(("body_mass", "foot_mass", "ball_mass", "hand_mass", GROUND_MASS), MASS),
    **dict.fromkeys(("rest_length", BODY_RADIUS), LENGTH),
    "surface_gravity": ACCELERATION,
    **dict.fromkeys(("stiffness", "ground_stiffness"), (-1, 0, 1)),
    **dict.fromkeys(DAMPERS, (-1, 1, 1)),
}
STATED_BY_LAWS = {BODY_RADIUS, "ground_stiffness"}
RESERVED = {*DIMENSIONS_OF_PARAMETERS, GAUGE, UNIT_LENGTH, UNIT_FORCE, "mass_ratio", "gravity_share"} - STATED_BY_LAWS


def hopper_in_si(
    body_mass: float, foot_mass: float, *,
    force: LawLike | None = None, stiffness: float | None = None, rest_length: float | None = None,
    surface_gravity: float = STANDARD_GRAVITY, body_radius: float | None = None, gravity: LawLike | None = None,
    restitution: float = 0.0, damping: float = 0.0, drag: float = 0.0, parameters: Mapping[str, float] | None = None,
    ground: Ground | None = None,
) -> "MachineInSI":  # fmt: skip
    """A hopper in SI, whose results are in SI; its masses, lengths and coefficients are parameters like any other.

    body_mass, foot_mass : kg
    force : a spring law in N of the extension in m, in any form that `springs.as_spring` accepts; a table's header may
        name other units of length and force
    stiffness : of a linear spring, N/m, or of a named law or a formula that has this parameter; with another `force`
        only if its slope at rest is 0 and cannot define the units
    rest_length : of the spring, m
    surface_gravity : m/s^2, at the place where gravity's ratio is 1
    body_radius : m, radius of the sphere whose gravity decreases with height
    gravity : instead of body_radius, a ratio as a law of the height in m
    restitution : of the impacts, 0 <= e <= 1
    damping, drag : coefficients of the damper in parallel with the spring and of the drag on each mass, N s/m
    parameters : values of the formulas' other names, in SI
    ground : a compliant `Ground`, its mass in kg and its spring in N of m, or a stiffness in N/m; None for rigid ground

    Returns a `MachineInSI`. Raises `InputError`, which names the invalid argument.

    >>> from orbits import find
    >>> from problems import hopper_in_si
    >>> leg = hopper_in_si(60.0, 3.0, force="k*r + b*r**3", parameters={"k": 8000.0, "b": 2e6}, rest_length=0.8)
    >>> round(find(leg).alpha, 6)  # m/s
    0.851607
    """
    return _machine(
        Hopper, {"body_mass": body_mass, "foot_mass": foot_mass}, force, stiffness, body_radius, gravity, parameters,
        surface_gravity=surface_gravity, rest_length=rest_length, restitution=restitution, damping=damping, drag=drag,
        ground=ground,
    )  # fmt: skip


def juggler_in_si(
    ball_mass: float, hand_mass: float, *,
    force: LawLike | None = None, stiffness: float | None = None, rest_length: float | None = None,
    surface_gravity: float = STANDARD_GRAVITY, body_radius: float | None = None, gravity: LawLike | None = None,
    restitution: float = 0.0, damping: float = 0.0, drag: float = 0.0, parameters: Mapping[str, float] | None = None,
) -> "MachineInSI":  # fmt: skip
    """A juggler in SI from the masses of ball and hand (kg); further arguments and errors are as in `hopper_in_si`.

    >>> from orbits import find
    >>> from problems import juggler_in_si
    >>> round(find(juggler_in_si(0.2923, 0.2657, stiffness=8.8, surface_gravity=0.18)).alpha, 6)  # m/s
    0.140541
    """
    return _machine(
        Juggler, {"ball_mass": ball_mass, "hand_mass": hand_mass}, force, stiffness, body_radius, gravity, parameters,
        surface_gravity=surface_gravity, rest_length=rest_length, restitution=restitution, damping=damping, drag=drag,
    )  # fmt: skip


@dataclass(frozen=True)
class MachineInSI(TwoMasses):
    """A machine of two masses stated in SI, made by `hopper_in_si` or `juggler_in_si`; see there for the arguments.

    base : the class of the dimensionless machine
    masses : of the upper and the lower mass, in kg, by name
    spring : the law in N of m; None for a linear spring
    stiffness : that of the linear spring, or with a law the one that defines the units, in N/m
    """

    base: type[TwoMassMachine]
    masses: Mapping[str, float]
    spring: Law | None
    stiffness: float
    gravity: Law
    surface_gravity: float
    rest_length: float | None = None
    restitution: float = 0.0
    damping: float = 0.0
    drag: float = 0.0
    ground: Any = None

    @exclusive
    def __post_init__(self) -> None:
        self._store(masses={name: number(name, mass, low=0) for name, mass in self.masses.items()})
        for name in ("surface_gravity", "stiffness"):
            self._store(**{name: number(name, getattr(self, name), low=0)})
        if BODY_RADIUS in self.gravity.parameters:
            number(BODY_RADIUS, self.gravity.parameters[BODY_RADIUS], low=0)
        number("mass_ratio", self.mass_ratio, low=0)
        self._store_common()
        self._store(ground=checked_ground(self.ground, {}, self.kind, in_si=True))
        laws = [] if self.spring is None else [name for name in self.spring.parameters if name != "stiffness"]
        laws += [*self.ground.spring.parameters] if self.ground else []
        refuse_taken(RESERVED, [*laws, *self.gravity.parameters], "the machine's own name")
        if self.spring is not None and (k := self.spring.parameters.get("stiffness")) is not None:
            slope = float(self.spring.with_slope(self.spring.rest())[1])
            if not np.isclose(slope, k, rtol=1e-6, atol=0.0):
                conflict = f"stiffness = {k:g}, but the spring '{self.spring.text}' has the slope {slope:g} at rest"
                raise InputError(f"{conflict}: give the parameter another name")
        self.dimensionless()  # raises the errors of the machine itself

    def __repr__(self) -> str:
        units, laws = self.units_of_parameters(), self.describe()
        named = self.stated_values | ({"restitution": self.restitution} if self.restitution else {})
        pull = laws["gravity"] if self.gravity.key.degree() else f"{named.pop('surface_gravity'):g} m/s^2"
        values = [f"{name} = {x:g} {units.get(name, '')}".rstrip() for name, x in named.items()]
        return f"{self.kind} in SI, spring {laws['spring']}, gravity {pull}: {', '.join(values)}"

    @property
    def kind(self) -> str:
        """The kind of machine, in a word."""
        return self.base.kind

    @property
    def mass_ratio(self) -> float:
        """The lower mass over the upper one."""
        upper, lower = self.masses.values()
        return lower / upper

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters of the laws, in SI."""
        own = {"stiffness": self.stiffness} if self.spring is None else self.spring.parameters
        return {**own, **self.gravity.parameters, **(self.ground.spring.parameters if self.ground else {})}

    @exclusive_property
    def values(self) -> dict[str, float]:
        """Every parameter of the model by name, in SI."""
        values = self._with_parts({**self.masses, "surface_gravity": self.surface_gravity})
        if self.spring is not None:
            values[GAUGE] = self.stiffness
        if homotopy := self.dimensionless().model.homotopy:
            values[homotopy] = 1.0
        return values

    @property
    def stated_values(self) -> dict[str, float]:
        """The values, in SI, of the parameters that users state."""
        hidden = (GAUGE, self.model.homotopy)
        return {name: self.values[name] for name in self.values if name not in hidden}

    @exclusive_property
    def units(self) -> Units:
        """The units of the dimensionless machine, in SI."""
        scales = {**self.masses, "surface_gravity": self.surface_gravity, self._stiffness_name: self.stiffness}
        return _units_by(*self._names)(scales)

    @property
    def _stiffness_name(self) -> str:
        return "stiffness" if self.spring is None else GAUGE

    @property
    def _names(self) -> tuple[bool, str, str, str]:
        """The arguments of `_units_by`, which determine the units as functions of the parameters."""
        upper, lower = self.masses
        return issubclass(self.base, Hopper), upper, lower, self._stiffness_name

    @property
    def scheduled(self) -> dict[str, float]:
        """The units of the parameters that a simulation may vary in time, except the ones that define the units."""
        return {name: 1.0 for name in self.parameters if name != "stiffness" or self.spring is not None}

    @property
    def model(self) -> Model:
        """The dimensionless machine's model with parameters in SI; machines that differ only in numbers share it."""
        return _model_in_si(self.dimensionless().model, *self._names)

    def stated(self) -> Mechanism:
        """The machine as a mechanism in SI, with the values of its parameters."""
        hidden = (GAUGE, self.model.homotopy)
        spring = springs.formula("stiffness*r", stiffness=self.stiffness) if self.spring is None else self.spring
        has_length, masses = self.rest_length is not None, iter((*self.masses, GROUND_MASS))
        yields = (self.ground.spring.key,) if self.ground else ()
        plain = self.base.mechanism(spring.key, self.gravity.key, has_length, self.damped, *yields)
        elements = [replace(each, mass=next(masses)) if isinstance(each, Mass) else each for each in plain.elements]
        return replace(
            plain, elements=elements, surface_gravity="surface_gravity", energy_unit=1.0, heights=None, in_si=True,
            parameters={name: value for name, value in self.values.items() if name not in hidden},
        )  # fmt: skip

    def dimensionless(self) -> TwoMassMachine:
        """This machine in dimensionless units; the coefficients of its laws stay in SI, with the units of the laws as
        further parameters."""
        return self._dimensionless

    @exclusive_property
    def _dimensionless(self) -> TwoMassMachine:
        units = self.units
        for name, unit in (("length", units.length), ("time", units.time), ("force", units.force)):
            number(f"the unit of {name}", unit, *SIZES_OF_UNITS)
        stated = _restated(units, {name: getattr(self, name) for name in ("rest_length", *DAMPERS)})
        ground = self.ground
        if ground:
            lower = list(self.masses.values())[1]
            ground = Ground(ground.mass / lower, ground.spring.scaled(units.length, units.force))
        return self.base(
            ground=ground,
            spring="r" if self.spring is None else self.spring.scaled(units.length, units.force),
            gravity=self.gravity.scaled(units.length) if self.gravity.key.degree() > 0 else self.gravity,
            mass_ratio=self.mass_ratio,
            restitution=self.restitution,
            **stated,
        )

    @property
    def following(self) -> dict[str, str]:
        """Why numbers of the machine are not parameters: they follow from others; by name."""
        why = {"mass_ratio": f"in SI it follows from the masses: set {' or '.join(self.masses)}"}
        by_law = dict.fromkeys(("stiffness", GAUGE), "it follows from the law of the spring")
        return why if self.spring is None else why | by_law

    def with_values(self, **values: float) -> Self:
        """This machine with other values of masses, lengths, gravity, damping, drag or the laws' parameters.

        Raises `InputError` for an unknown name.
        """
        changes: dict[str, Any] = {}
        for name, value in values.items():
            if name in self.masses:
                changes["masses"] = {**changes.get("masses", self.masses), name: value}
            elif name in ("surface_gravity", "rest_length", *DAMPERS) or name == self._stiffness_name == "stiffness":
                changes[name] = value
            elif name == GROUND_MASS and self.ground:
                changes["ground"] = replace(changes.get("ground", self.ground), mass=value)
            elif name not in self.parameters:
                why = f": {self.following[name]}" if name in self.following else suggest(name, self.stated_values)
                raise InputError(f"this machine has no parameter '{name}'{why}")
            else:
                for law in ("spring", "gravity"):
                    mine = changes.get(law, getattr(self, law))
                    if mine is not None and name in mine.parameters:
                        changes[law] = mine.with_parameters(**{name: value})
                below = changes.get("ground", self.ground)
                if below and name in below.spring.parameters:
                    changes["ground"] = replace(below, spring=below.spring.with_parameters(**{name: value}))
        return replace(self, **changes)

    def describe(self) -> dict[str, Any]:
        """The machine as JSON-ready data."""
        return {
            **self._described("stiffness*r" if self.spring is None else self.spring.text, "SI"),
            **self.masses,
            "surface_gravity": self.surface_gravity,
            **{f"unit_{name}": value for name, value in self.units.saved().items()},
            "units": self.units_of_parameters(),
        }

    def units_of_parameters(self) -> dict[str, str]:
        """The units of the parameters by name, except coefficients whose unit does not follow from the formula."""
        laws = {} if self.spring is None else law_dimensions(self.spring.key)
        known = {**laws, **DIMENSIONS_OF_PARAMETERS}
        return {name: unit_text(known[name]) for name in self.values if name in known}


AnyMachine: TypeAlias = TwoMassMachine | MachineInSI


def _units_by(hopper: bool, upper: str, lower: str, stiffness: str) -> Callable[[Mapping], Units]:
    """p -> units of a hopper or a juggler with these names of its masses and of the stiffness that sets them."""

    def units(p: Parameters) -> Units:
        weight, k = p[lower] * p["surface_gravity"], p[stiffness]
        length, clock = weight / k, p[lower] / k
        with np.errstate(invalid="ignore"):  # a step may try masses below 0, which are refused then
            time = (clock / (1 + p[lower] / p[upper]) if hopper else clock) ** 0.5
        return Units(length, time, weight, p[upper] * p["surface_gravity"] * length)

    return units


def _restated(units: Units, p: Parameters) -> dict[str, Algebraic]:
    """Rest length and dampers in these units, where they are stated."""
    damper = units.of(DIMENSIONS_OF_PARAMETERS["damping"])
    sizes = {"rest_length": units.length, **dict.fromkeys(DAMPERS, damper)}
    return {name: None if p[name] is None else p[name] / size for name, size in sizes.items() if name in p}


@lru_cache(maxsize=64)
def _model_in_si(model: Model, hopper: bool, upper: str, lower: str, stiffness: str) -> Model:
    """The model of a dimensionless machine, with parameters in SI."""
    units = _units_by(hopper, upper, lower, stiffness)

    def own(p: Parameters) -> dict[str, Algebraic]:
        these = units(p)
        scales = {"mass_ratio": p[lower] / p[upper], UNIT_LENGTH: these.length, UNIT_FORCE: these.force}
        scales |= {GROUND_MASS: p[GROUND_MASS] / p[lower]} if GROUND_MASS in p else {}
        return {**p, **scales, **_restated(these, p)}

    return reparametrised(model, own, units=units, gauge=GAUGE if stiffness == GAUGE else None)


def _machine(
    base: type[TwoMassMachine], masses: dict[str, float], force: LawLike | None, stiffness: float | None,
    body_radius: float | None, gravity: LawLike | None, parameters: object, **numbers: Any,
) -> MachineInSI:  # fmt: skip
    """The machine of these statements; `numbers` are further fields of it."""
    values = stated_numbers(parameters)
    law, stiffness = _spring(force, stiffness, values)
    pull = _gravity_law(gravity, body_radius, values)
    numbers["ground"] = checked_ground(numbers.get("ground"), values, base.kind, in_si=True)
    below = numbers["ground"].spring.parameters if numbers["ground"] else ()
    known = [*(law.parameters if law else ()), *pull.parameters, *below]
    if unknown := [name for name in values if name not in known]:
        raise InputError(f"neither formula has a parameter '{unknown[0]}'{suggest(unknown[0], known)}")
    return MachineInSI(base, masses, law, stiffness, pull, **numbers)


def _gravity_law(gravity: LawLike | None, body_radius: float | None, values: Mapping[str, float]) -> Law:
    """The law of gravity in SI."""
    if body_radius is None:
        return as_gravity("1" if gravity is None else gravity, values, shared=True)
    if gravity is not None:
        raise InputError("give body_radius or gravity, not both")
    return gravities.formula("1/(1 + z/body_radius)**2", body_radius=number(BODY_RADIUS, body_radius, low=0))


def _spring(force: LawLike | None, stiffness: float | None, values: Mapping[str, float]) -> tuple[Law | None, float]:
    """The law in SI, None where it is linear, and the stiffness that sets the units."""
    if force is None:
        if stiffness is None:
            raise InputError("a spring in SI needs its stiffness (N/m) or its force law")
        return None, number("stiffness", stiffness, low=0)
    stated = {"stiffness": stiffness} if isinstance(force, str) and stiffness is not None else {}
    law = as_spring(force, {**stated, **values}, in_si=True, shared=True)
    law.refuse_units(in_si=True)
    slope = float(law.with_slope(law.rest())[1])
    if stiffness is not None:
        k = number("stiffness", stiffness, low=0)
        if 0 < slope < float("inf") and not np.isclose(slope, k, rtol=1e-6, atol=0.0):
            conflict = f"the spring '{law.text}' has stiffness {slope:g} N/m at rest, not {k:g}"
            raise InputError(f"{conflict}: state it in N of m, and leave stiffness out")
        return law, k
    if slope < 0:
        raise InputError(f"the spring '{law.text}' has slope {slope:g} at rest: {WRONG_SIGN}")
    if not 0 < slope < float("inf"):
        raise InputError(f"the spring '{law.text}' has slope {slope:g} at rest: give the stiffness that sets the units")
    return law, slope
