"""A machine stated by its mechanics: coordinates, elements and one gap that lands plastically.

    from orbits import Mechanism, find
    from orbits.mechanics import Inerter, Mass, Spring

    hopper = Mechanism(
        coordinates=("body", "foot"),
        elements=[Mass("body", "m1"), Mass("foot", "m2"), Spring("body - foot", "k*r"), Inerter("body - foot", "b")],
        gap="foot",
        parameters={"m1": 1.0, "m2": 1.0, "k": 1.0, "b": 0.2},
    )
    find(hopper)

All that the engine requires of a machine follows from that: the equations of motion in flight and in contact,
launch, lift-off and landing, impacts, energy, closed forms, and the extension that moves alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Self

import numpy as np

from ..errors import InputError, true_or_false
from ..io import one_line
from ..laws import Key, Law, coefficient_of_restitution, key_of, number
from ..model import STEP_LENGTH, Model, Stated
from ..running import exclusive, exclusive_property
from ..symbolic import suggest
from ..units import ANGLE, FORCE, LENGTH, TORQUE, Dimension, Units, unit_text
from .bodies import Body, refuse_misbuilt
from .derived import derived_launch, derived_model, linear_equations, refuse_points, refuse_uneven_tables
from .dimensions import dimensions_of_parameters, length_or_angle
from .drawing import Drawing, refuse_misdrawn
from .elements import Element, Scalar, Spring, expressions_of, names_in
from .grip import Grip, refuse_misheld
from .ground import Ground, on_ground
from .linear import LinearEquations
from .parts import names_of_springs
from .refusals import (
    hint_of_coordinate,
    joined_values,
    listed,
    maps_of_sticking,
    refuse_expressions,
    refuse_misstated,
    refuse_names_of_parameters,
    refuse_values,
)
from .structure import Structure
from .terms import GRAVITY_SHARE
from .upright import upright


@dataclass(frozen=True, repr=False, eq=False)
class Mechanism(Stated):
    """A machine stated by coordinates and elements.

    coordinates : names (n,), from the top
    elements : `Mass`, `Spring`, `Damper`, `Weight`, `Inerter`, `Potential` and `Force`, whose extensions and heights
        are formulas of the coordinates and parameters
    gap : the distance that opens in flight and lands plastically, a linear combination of coordinates with constant
        coefficients, which is 0 where all coordinates are; None for a machine that never lands and only oscillates
    parameters : values of the names in all formulas and laws; the parameters of the laws are added to these
    gravity : the acceleration as a number, or as a formula or law of the height z. Where it varies, `find` first solves
        for constant gravity with the value at z = 0, and continues from there to the law in steps
    surface_gravity : the factor of the law of gravity
    inertia : of the coordinates, in addition to that of masses and inerters: a mapping of coordinates to masses, or
        rows of a symmetric matrix
    counts : the extension whose stationary points count the family; by default that of the first spring
    launch : the coordinate whose value and speed at lift-off are "liftoff" and "alpha"; by default the last one of the
        contact
    heights : for plots, formulas by name, the upper before the lower; by default the coordinates that are lengths
    separation : a distance that must stay positive; None where none is checked
    restitution : of the impacts, 0 <= e <= 1
    in_si : whether all numbers are in SI; the results then have units
    name : of the kind of machine
    energy_unit : the unit of energy in units of force times length
    rest : values of those coordinates that are not 0 where the machine rests with its springs unloaded
    angles : names of the coordinates that are angles, in rad
    knees : for figures, tuples (lower, upper, length): a leg of two links of this length, with a knee between them, is
        drawn from the height named `lower` (None for the ground) to the height named `upper`
    actuators : names of displacements that may occur in extensions, each with the name of its rate, a parameter that is
        0 by default
    ground : a `Ground` that yields, under a gap that is one coordinate; the mechanism adds the ground's coordinate,
        mass and spring to its own. None for rigid ground
    reversor : how time reversal maps the places in flight: formulas, by coordinate, of the coordinates that it changes,
        each the coordinate or its negative plus an amount, such as "2*angle - theta"; None where motions cannot be
        reversed, for example on a slope. Such a machine can only be simulated
    symmetry : such formulas for the relabelling after a landing, after which the point that landed is the one that
        opens next
    gaps : instead of `gap`, two gaps by name: the one that opens, and the one that closes at landing, which is the
        image of the first under the reversor
    friction : the coefficient of friction, for masses with horizontal places: the largest ratio of the force along the
        ground to the force across it. An orbit that needs more is inadmissible. A number, or a formula of parameters
    bounds : the least and the largest value of parameters, by name
    drawing : a `Drawing` of the machine in the plane, for figures; None for masses on one vertical line
    bodies : a list of `Body` with joints, for `export` to simulators; none for masses on one vertical line
    sticks : coordinates that are at rest while the gap is closed, such as that of a foot which does not slide. Nothing
        may depend on the place of such a coordinate along the ground. It is 0 in contact, and a step moves it by
        "step", a quantity of each orbit. A coordinate that `reversor` or `symmetry` maps sticks at any place, on which
        the motion may depend and which is an unknown of each orbit: one of a machine that stands on both feet. Where it
        is not itself the place of the foot along the ground, a mapping of names states this place by a formula
    segments : the angles of limbs by name, sums of coordinates, whose rates in mid-flight orbits report
    grazes : whether the point that swings through passes the ground in mid-flight too, where the reversor turns the
        gap's coordinate over: it touches tangentially and without a force
    grip : the `Grip` of a machine that swings from hold to hold, with gap=None; `find` returns its swings. None for
        other machines
    words : for messages, by key: the name of the force at "liftoff"; the texts of a violated "gap", "pull",
        "separation" and "end"; for a machine that steps also of a violated "landing gap" in flight, "standing gap" in
        contact, "landed pull" and "stance" ("" for a "stance" that is not judged); and the advice where a search finds
        "none"

    Raises `InputError` for an unknown name, for statements that do not describe a mechanism, and for masses, inertias,
    dampers and gravity of a wrong sign as soon as all parameters have values.

    >>> from orbits import Mechanism, find
    >>> from orbits.mechanics import Mass, Spring
    >>> masses = [Mass("body", "m1"), Mass("foot", "m2")]
    >>> elements, numbers = [*masses, Spring("body - foot", "k*r")], {"m1": 1.0, "m2": 1.0, "k": 1.0}
    >>> hopper = Mechanism(("body", "foot"), elements, gap="foot", parameters=numbers, gravity=1.0)
    >>> round(find(hopper).alpha, 6)
    6.354641
    """

    coordinates: Sequence[str]
    elements: Sequence[Element]
    gap: Scalar | None = ""
    parameters: Mapping[str, float] = field(default_factory=dict)
    gravity: Any = "1"
    surface_gravity: Scalar = 1.0
    inertia: Any = ()
    counts: Scalar | None = None
    launch: str | None = None
    heights: Mapping[str, Scalar] | None = None
    separation: Scalar | None = None
    restitution: float = 0.0
    in_si: bool = False
    name: str = "mechanism"
    energy_unit: Scalar = 1.0
    rest: Mapping[str, Scalar] = field(default_factory=dict)
    angles: Sequence[str] = ()
    knees: Sequence[tuple[str | None, str, Scalar]] = ()
    actuators: Mapping[str, str] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)
    ground: Ground | None = None
    reversor: Mapping[str, Scalar] | None = field(default_factory=dict)
    symmetry: Mapping[str, Scalar] = field(default_factory=dict)
    gaps: Mapping[str, Scalar] = field(default_factory=dict)
    friction: Scalar | None = None
    drawing: Drawing | None = None
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    sticks: Any = ()
    bodies: Sequence[Body] = ()
    grazes: bool = False
    segments: Mapping[str, Scalar] = field(default_factory=dict)
    grip: Grip | None = None

    @exclusive
    def __post_init__(self) -> None:
        checked = isinstance(self.bodies, tuple)  # those of a copy are, and an export checks them again
        self._store(
            coordinates=listed("coordinates", self.coordinates), elements=listed("elements", self.elements),
            knees=tuple(listed("knees", knee) for knee in listed("knees", self.knees)),
            angles=listed("angles", self.angles), grazes=true_or_false("grazes", self.grazes),
            sticks=self.sticks if isinstance(self.sticks, Mapping) else {x: x for x in listed("sticks", self.sticks)},
            bodies=listed("bodies", self.bodies), in_si=true_or_false("in_si", self.in_si),
        )  # fmt: skip
        first = next(iter(self.gaps.values()), "") if isinstance(self.gaps, Mapping) else ""
        refuse_expressions("the mechanism", (first, *([] if self.gap is None else [self.gap])))
        if (first != self.gap and "" not in (first, self.gap)) or first == self.gap == "":
            raise InputError(
                f"gap = {self.gap!r}, gaps = {self.gaps!r}: state either gap=, or gaps= by name, the one that opens "
                "first"
            )
        self._store(gap=first if self.gap == "" else self.gap)
        if self.ground is not None:
            stated = self.coordinates, self.elements, self.gap, self.launch, self.heights, self.inertia
            self._store(**on_ground(self.ground, *stated))
        self._store(inertia=self._rows(), heights=self.heights or self._lengths())
        refuse_misstated(self)
        if self.sticks:
            turned, onward = maps_of_sticking(self.stepping)
            back = None if self.reversor is None else {**self.reversor, **turned}
            step = {STEP_LENGTH: 0.0} if turned else {}
            self._store(reversor=back, symmetry={**self.symmetry, **onward}, parameters={**step, **self.parameters})
        numbers = {name: number(name, value) for name, value in self.parameters.items()}
        laws, elements = [self._law(self.gravity, "z", numbers)], list[Element]()
        for element in self.elements:
            if isinstance(element, Spring):
                if isinstance(element.force, Law):
                    element.force.refuse_units(self.in_si)
                laws.append(self._law(element.force, "r", numbers))
                element = replace(element, force=laws[-1][0])
            elements.append(element)
        if self.stepping and any(STEP_LENGTH in key.names for key, _ in laws):
            raise InputError(f"'{STEP_LENGTH}' is a quantity of orbits; rename the law's parameter")
        values = joined_values(((key.text, own) for key, own in laws), numbers)
        rates = {rate: 0.0 for rate in self.actuators.values() if rate not in values}
        self._store(
            elements=tuple(elements), gravity=laws[0][0], parameters=values | rates, actuators=self.actuators,
            words=self.words, rest=self.rest, reversor=self.reversor, symmetry=self.symmetry, gaps=self.gaps,
            restitution=coefficient_of_restitution(self.restitution),
        )  # fmt: skip
        used = self._used_names
        refuse_names_of_parameters(self, [*self.parameters, *(name for key, _ in laws for name in key.names)], used)
        if used <= self.parameters.keys():
            refuse_values(self)
        seen = {*self.coordinates, *self.names, *([STEP_LENGTH] if self.sticks else [])}
        if self.drawing is not None:
            refuse_misdrawn(self.drawing, {*seen, *(self.grip.release if self.grip else ())})
        if self.grip is not None:
            refuse_misheld(self, {*self.names})
        if not checked:
            refuse_misbuilt(self.bodies, seen)

    @classmethod
    def from_lagrangian(
        cls, T: Any, V: Any, coordinates: Sequence[Any], gap: Any, parameters: Mapping[Any, float] | None = None,
        gravity: Any = "g", **stated: Any,
    ) -> "Mechanism":  # fmt: skip
        """A machine from its energies as SymPy expressions; needs the extra `sympy`.

        T : the kinetic energy, quadratic in the speeds y.diff(t); the masses in it may depend on the coordinates
        V : the potential energy, of the coordinates alone
        coordinates : functions of time, as of `dynamicsymbols`
        gap : the distance that closes at landing, or two by name, the one that opens and the one that closes
        parameters : the values of all other symbols, by symbol or name
        gravity : the symbol of the acceleration of gravity in V, or its name; the terms proportional to it are weights
        stated : other arguments of `Mechanism`, in which SymPy expressions may stand for formulas and names;
            `elements`, such as a `Damper`, are added to the elements that follow from the energies

        Raises `InputError` for energies that no such machine has, for a parameter without a value, for functions that
        formulas do not have, and for `sticks` and `friction`, which need the places of masses along the ground.
        """
        from .energies import stated_by_energies

        return cls(
            **stated_by_energies(T, V, coordinates, gap, {} if parameters is None else parameters, gravity, stated)
        )

    def _lengths(self) -> dict[str, str]:
        """The coordinates that are lengths, each by its name; all of them where none is."""
        lengths = [name for name in self.coordinates if name not in self.angles]
        return {name: name for name in lengths or self.coordinates}

    @staticmethod
    def _law(law: Any, variable: str, parameters: Mapping[str, float]) -> tuple[Key, Mapping[str, float]]:
        """The key of a law, and the values that it brings for its parameters."""
        if isinstance(law, Law):
            if law.variable != variable:
                raise InputError(f"'{law.text}' is a law of {law.variable}, but a law of {variable} is needed here")
            return law.key, law.parameters
        try:
            return key_of(law, variable, parameters), {}
        except KeyError as error:  # an argument of a Python function
            name = error.args[0]
            raise InputError(f"'{name}' has no value: give parameters={{'{name}': ...}}") from None

    def _rows(self) -> tuple[tuple[Scalar, ...], ...]:
        """The rows of the inertia."""
        if isinstance(self.inertia, Mapping):
            if unknown := [name for name in self.inertia if name not in self.coordinates]:
                raise InputError(f"inertia of '{unknown[0]}'{suggest(unknown[0], self.coordinates)}")
            each = enumerate(self.coordinates)
            return tuple(
                tuple(self.inertia.get(name, 0.0) if i == j else 0.0 for j in range(len(self.coordinates)))
                for i, name in each
            )
        return tuple(listed("inertia", row) for row in listed("inertia", self.inertia))

    @property
    def stepping(self) -> tuple[str, ...]:
        """The coordinates that stick at 0, and that steps move on."""
        turned, onward = maps_of_sticking(self.sticks)
        mapped = {**turned, **dict(self.reversor or {})}, {**onward, **self.symmetry}
        return tuple(x for x in self.sticks if (turned[x], onward[x]) == (mapped[0][x], mapped[1][x]))

    @property
    def places(self) -> set[str]:
        """The names of the coordinates and of the actuators' displacements."""
        return {*self.coordinates, *self.actuators}

    @property
    def expressions(self) -> list[Any]:
        """The expressions that may depend on parameters, without the laws."""
        return expressions_of(self)

    @property
    def _names_beside_springs(self) -> set[str]:
        """The names of the parameters that formulas and gravity use."""
        found = {name for value in self.expressions for name in names_in(value)}
        return (found | {*self.gravity.names, *self.actuators.values()}) - self.places

    @property
    def _used_names(self) -> set[str]:
        """The names of the parameters that formulas and laws use."""
        springs = [element.force for element in self.elements if isinstance(element, Spring)]
        return self._names_beside_springs | {name for law in springs for name in law.names} - self.places

    @property
    def has_functions(self) -> bool:
        """Whether there is a Python function, which may use any parameter."""
        return any(map(callable, self.expressions))

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all parameters."""
        return tuple(sorted(self._used_names | self.parameters.keys()))

    @property
    def _stated_parameters(self) -> dict[str, float]:
        """The parameters except the step, which is a number of an orbit."""
        return {name: value for name, value in self.parameters.items() if not (self.stepping and name == STEP_LENGTH)}

    @property
    def _missing(self) -> list[str]:
        """The names of the parameters that have no value."""
        return [name for name in self.names if name not in self.parameters]

    @exclusive_property
    def structure(self) -> Structure:
        """The mechanism without its numbers; mechanisms that differ only in numbers share the objects built from it."""
        elements, gravity = self.elements, self.gravity
        springs = [element for element in elements if isinstance(element, Spring)]
        counts = springs[0].extension if self.counts is None and springs else self.counts
        if counts is None and self.gap is None:
            counts = self.coordinates[0]
        if counts is None:
            raise InputError("a mechanism without a spring must say what counts its families: counts=")
        names = self.names if gravity.degree() == 0 else (*self.names, GRAVITY_SHARE)
        return Structure(
            self.name, tuple(self.coordinates), tuple(elements), self.gap, self.inertia, gravity, self.surface_gravity,
            counts, self.launch, tuple((self.heights or {}).items()), self.separation, self.energy_unit,
            tuple(self.rest.items()), tuple(self.knees), tuple(self.actuators.items()), tuple(self.words.items()),
            names, self.reversor if self.reversor is None else tuple(self.reversor.items()),
            tuple(self.symmetry.items()), tuple(self.gaps.items()), self.friction, tuple(self.sticks.items()),
            tuple(name for name in self.sticks if name not in self.stepping), self.grazes,
            tuple(self.segments.items()), self.grip is not None,
        )  # fmt: skip

    @exclusive_property
    def model(self) -> Model:
        """The model derived from the mechanism; mechanisms that differ only in numbers share it."""
        try:
            model = derived_model(self.structure)
            if not model.plain:
                refuse_uneven_tables(self.structure, self.parameters)
                refuse_points(self.structure)
        except InputError as error:
            hints = (hint_of_coordinate(name, self.coordinates) for name in self._missing)
            raise InputError("; ".join([str(error), *filter(None, hints)])) from error
        if not self.in_si:
            return model
        springs = [element for element in self.elements if isinstance(element, Spring)]
        dimensions = [self.dimension_of_force(each.extension) for each in springs]
        return _with_units(model, self.si_units, tuple(zip(names_of_springs(springs), dimensions, strict=True)))

    def dimension_of_force(self, along: Scalar) -> Dimension:
        """The dimension of a force along an extension: a torque where that is an angle."""
        kind = length_or_angle(along, self.places, {*self.angles})
        return () if kind is None else FORCE if kind is LENGTH else TORQUE

    @property
    def si_units(self) -> Units:
        """The units of a machine whose numbers are in SI."""
        launched = self.launch or derived_launch(self.structure)
        angular = self.gap is not None and length_or_angle(self.gap, {*self.coordinates}, {*self.angles}) is ANGLE
        turned = {"liftoff": launched in self.angles, "gap": angular}
        return Units(1.0, 1.0, 1.0, 1.0, (*self.angles, *(name for name, angle in turned.items() if angle)))

    @property
    def gap_weights(self) -> np.ndarray:
        """The weights (n,) of the coordinates in the gap."""
        return np.array(self.model.gap(self.values).weights[: 2 * len(self.coordinates) : 2])

    def linear_equations(self) -> LinearEquations:
        """The matrices M, K (n, n) and the vector f (n,) of M y'' = -K y + f in flight; raises `InputError` where a
        spring is not linear."""
        return linear_equations(self.structure, self.values)

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of the model by name; raises `InputError` where one has no value."""
        if missing := self._missing:
            hints = [hint for name in missing if (hint := hint_of_coordinate(name, self.coordinates))]
            raise InputError([*hints, f"'{missing[0]}' has no value: give parameters={{'{missing[0]}': ...}}"][0])
        return dict(self.parameters) | ({GRAVITY_SHARE: 1.0} if self.model.homotopy else {})

    def with_values(self, **values: float) -> Self:
        """This mechanism with other values of some parameters; raises `InputError` for an unknown name."""
        for name in values:
            if name not in self.names:
                raise InputError(f"this machine has no parameter '{name}'{suggest(name, self.names)}")
        return replace(self, parameters={**self.parameters, **values})

    def upright(self) -> "Mechanism":
        """The machine of the vertical hop near which runs are found, with all lateral places at 0; raises `NoOrbit`
        where there is none."""
        return upright(self)

    def with_springs(self, forces: Sequence[Any]) -> Self:
        """This mechanism with other laws of its springs, without the parameters that these no longer need."""
        new = iter(forces)
        elements = [replace(each, force=next(new)) if isinstance(each, Spring) else each for each in self.elements]
        beside = {name: self.parameters[name] for name in self._names_beside_springs if name in self.parameters}
        other = replace(self, elements=elements, parameters=beside)
        known = [name for name in self.parameters if other.has_functions or name in other._used_names]
        return replace(other, parameters={**{name: self.parameters[name] for name in known}, **other.parameters})

    @property
    def units(self) -> Units | None:
        """SI, for a machine whose numbers are in it."""
        return self.si_units if self.in_si else None

    def stated(self) -> Self:
        """The mechanism itself, as theorems state it."""
        return self

    def dimensionless(self) -> Self:
        """This machine without units."""
        return replace(self, in_si=False)

    @property
    def scheduled(self) -> dict[str, float]:
        """The units of the parameters that a simulation may vary in time."""
        return dict.fromkeys(self.parameters, 1.0)

    @property
    def rest_length(self) -> float | None:
        """The value of the separation where the machine rests with its springs unloaded; None without a separation, and
        for a machine that steps."""
        if self.separation is None or not self.model.plain:
            return None
        at_rest = self.model.rest(self.values) if self.model.rest else np.zeros(len(self.model.flight.states))
        return float(self.model.separation(self.values)(at_rest))

    def describe(self) -> dict[str, Any]:
        """The machine as JSON-ready data."""
        springs = [element.force.text for element in self.elements if isinstance(element, Spring)]
        length = {} if self.rest_length is None else {"rest_length": unit_text(LENGTH)}
        return {
            "machine": self.name,
            "spring": ", ".join(dict.fromkeys(springs)),
            "gravity": self.gravity.text,
            "mass_ratio": self.parameters.get("mass_ratio"),  # files of orbits have this key for any machine
            "rest_length": self.rest_length,
            "restitution": self.restitution,
            "parameters": self._stated_parameters,
            "laws_in": "SI" if self.in_si else "units of the machine",
            **({"units": {**length, **self.units_of_parameters()}} if self.in_si else {}),
        }

    def units_of_parameters(self) -> dict[str, str]:
        """The SI units of those parameters whose dimensions follow from the elements, by name."""
        return {name: unit_text(dimension) for name, dimension in dimensions_of_parameters(self).items()}

    def __repr__(self) -> str:
        return one_line(self, {"name": self.name, "coordinates": self.coordinates, **self._stated_parameters})


@lru_cache(maxsize=64)
def _with_units(model: Model, units: Units, springs: tuple[tuple[str, Dimension], ...]) -> Model:
    """The model with its results in units, and the forces of its springs of these dimensions."""
    return replace(model, units=lambda p: units, spring_dimensions=dict(springs))
