"""The subject of a theorem: a machine in words, formulas and exact numbers, from which a reader can rebuild it.

A proof reads only these texts of the machine: no expression that the engine built from them, and no float.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from fractions import Fraction
from itertools import chain, count
from numbers import Rational
from typing import Any

from ..errors import InputError
from ..io import Document
from ..laws import Key
from ..mechanics import Inerter, Mass, Mechanism, Potential, Scalar, Spring, Weight, derived_launch
from ..model import STEP_LENGTH, Machine, free_parameters
from ..symbolic import parse, traced_of_places
from .decimals import decimal_text, exact_fraction, is_decimal
from .refusal import Unproved

# An exact decimal, a fraction, or the bounds of an interval.
ExactNumber = str | float | Decimal | Fraction
Decimals = ExactNumber | tuple[ExactNumber, ExactNumber]
# The lower and the upper bound of a parameter.
Bounds = tuple[Fraction, Fraction]
# A function of the coordinates and the size of an element along it: the formulas of both.
Sized = tuple[str, str]
# What follows the name of a coordinate that sticks in the name of its prescribed place at landing.
AT_LANDING = "_at_landing"
# Names with a fixed meaning in every theorem.
OWN_NAMES = {
    *("alpha", "liftoff", "duration", "contact_duration", "flight_time", "contact_time", "liftoff_extension"),
    *("mid_flight_extension", "loss_coefficient"),
}
# The definitions of quantities that may be prescribed, in addition to alpha and the times of flight and contact.
DEFINED = {
    "speed": "the rate of {centre} at lift-off",
    "liftoff_extension": "{counts} at lift-off",
    "period": "the sum of the flight time and the contact time",
    "frequency": "1 over the sum of the flight time and the contact time",
    "mean_speed": "step over the sum of the flight time and the contact time",
}


@dataclass(frozen=True)
class StatedSpring:
    """A spring along an extension; `force` has a formula of r for each piece, and `breaks` those where they meet.

    potential : whether the force is the derivative of the formula by r
    rows : of a table, (r, value, slope, curvature) as decimals; from each row to the next the force is the polynomial
        of degree 5 with these at both ends, times the only formula in `force`, and elsewhere it has no value
    """

    extension: str
    force: tuple[str, ...]
    breaks: tuple[str, ...] = ()
    potential: bool = False
    rows: tuple[tuple[str, ...], ...] = ()

    @property
    def meetings(self) -> tuple[str, ...]:
        """Formulas of where one piece of the force follows the other; empty for a smooth force."""
        return tuple(row[0] for row in self.rows[1:-1]) or self.breaks

    def document(self) -> Document:
        """The spring for JSON."""
        table = {"rows": [list(row) for row in self.rows]} if self.rows else {}
        own = {"extension": self.extension, "force": list(self.force), "breaks": list(self.breaks)}
        return {**own, "potential": self.potential, **table}

    def words(self) -> str:
        """The spring in words."""
        where = f"along r = {self.extension}"
        if self.rows:
            scale = "f" if self.force[0] == "1" else f"({self.force[0]})*f"
            between = (
                "where f is, from each of these extensions r to the next, the polynomial of degree 5 with the value"
            )
            rows = "; ".join(f"({', '.join(row)})" for row in self.rows)
            return f"a spring with the force {scale} {where}, {between}, slope and curvature in (r, f, f', f''): {rows}"
        if self.potential:
            return f"a spring with the energy {self.force[0]} {where}"
        if not self.breaks:
            return f"a spring with the force {self.force[0]} {where}"
        pieces = [f"{self.force[0]} below {self.breaks[0]}"]
        pieces += [f"{force} from r = {low} on" for force, low in zip(self.force[1:], self.breaks, strict=True)]
        return f"a spring with the force {', '.join(pieces)}, {where}"


@dataclass(frozen=True)
class StatedMachine:
    """A machine as a theorem states it; every text is a formula of the coordinates and the parameters.

    units : "SI" or "dimensionless"
    parameters : the exact bounds of each, equal for a number
    masses, weights, inerters : formulas of the height or extension, and of the mass
    inertia : rows of the inertia matrix stated in addition to these, if any
    potentials : energies
    surface_gravity, gravity : the acceleration is their product, the second a formula of the height z
    launch : the coordinate whose place and rate at lift-off are "liftoff" and "alpha"
    counts : the extension whose stationary points count the family
    reversor, symmetry : the coordinates that are not left as they are, and what they are taken to, see `Mechanism`
    gaps : names and formulas of the gap that opens and that which closes; empty where they have no names
    sticks : the coordinates that rest in contact in addition to the gap, each held there by a force: at 0, except for
        those in `places`
    places : the coordinates that stick at any place, and formulas of where the point that opens is along the ground
    grazes : whether the gap vanishes in mid-flight too, to second order
    heights : names and formulas of the heights of a machine that sticks
    centre : formula of the place of the centre of mass along the ground; None where no masses move along it
    friction : formula of the coefficient of friction, which the forces on what sticks are compared with; None without
    tuned : names of parameters that are unknowns; they have no bounds
    prescribed : names and exact values of quantities of the orbit
    restitution : of the landings
    """

    name: str
    units: str
    coordinates: tuple[str, ...]
    parameters: Mapping[str, Bounds]
    masses: tuple[Sized, ...]
    weights: tuple[Sized, ...]
    inerters: tuple[Sized, ...]
    inertia: tuple[tuple[str, ...], ...]
    springs: tuple[StatedSpring, ...]
    potentials: tuple[str, ...]
    surface_gravity: str
    gravity: str
    gap: str
    launch: str
    counts: str
    separation: str | None
    reversor: tuple[Sized, ...] = ()
    symmetry: tuple[Sized, ...] = ()
    gaps: tuple[Sized, ...] = ()
    sticks: tuple[str, ...] = ()
    heights: tuple[Sized, ...] = ()
    centre: str | None = None
    friction: str | None = None
    tuned: tuple[str, ...] = ()
    prescribed: tuple[tuple[str, Fraction], ...] = ()
    restitution: Fraction = Fraction(0)
    places: tuple[Sized, ...] = ()
    grazes: bool = False

    def with_tuned(self, tuned: Sequence[str], prescribed: Mapping[str, ExactNumber]) -> "StatedMachine":
        """This machine with parameters that are unknowns, where quantities have these values; raises `InputError` for
        values that are not decimals, and `Unproved` for a name that would stand for two things."""
        at_landing = {name: f"{name}{AT_LANDING}" for name, _ in self.places}
        values = tuple((at_landing.get(name, name), exact_bounds(name, value)[0]) for name, value in prescribed.items())
        named = {name for name, _ in values if name != STEP_LENGTH} & {*self.coordinates, *self.parameters}
        if named:
            raise Unproved(f"the name '{min(named)}' stands for a quantity of the orbit: rename it")
        bounds = {name: each for name, each in self.parameters.items() if name not in tuned}
        return replace(self, parameters=bounds, tuned=tuple(tuned), prescribed=values)

    @property
    def steps(self) -> bool:
        """Whether maps are stated, so that the machine may land with another point than opens."""
        return bool(self.reversor or self.symmetry or self.gaps)

    def refuse_steps(self, what: str) -> None:
        """Raise `Unproved` where maps are stated, or parameters are unknowns."""
        if self.tuned:
            raise Unproved(f"{what} can be proved only if no parameter is tuned: pass tune=()")
        if self.steps:
            raise Unproved(f"{what} can be proved only for machines that state no reversor, symmetry or further gap")

    def refuse_names(self, letters: str, what: str) -> None:
        """Raise `Unproved` where a coordinate or a parameter has one of the letters in which something is proved."""
        if both := {*self.coordinates, *self.parameters} & {*letters}:
            raise Unproved(f"the name '{min(both)}' stands for {what}: rename the coordinate or parameter")

    @property
    def points(self) -> tuple[str, str]:
        """Names of the points that open and land, where they may be two."""
        usual = ("point that opens", "point that lands") if self.steps else ("", "")
        opens, lands, *_ = (*(name for name, _ in self.gaps), *usual[len(self.gaps) :])
        return opens, lands

    @property
    def used_names(self) -> set[str]:
        """The names in the formulas that a theorem is about."""
        texts = [*chain(*self.masses, *self.weights, *self.inerters, *self.inertia), *self.potentials]
        texts += [each for spring in self.springs for each in (spring.extension, *spring.force, *spring.breaks)]
        texts += [self.surface_gravity, self.gravity, self.gap, self.counts, *filter(None, [self.separation])]
        texts += [formula for _, formula in (*self.reversor, *self.symmetry, *self.gaps, *self.heights, *self.places)]
        texts += [self.friction] if self.sticks and self.friction is not None else []
        return {name for text in texts for name in parse(text).names}

    @property
    def of_motion(self) -> dict[str, Bounds]:
        """The parameters that the motion depends on: not a coefficient of friction that is in no other formula."""
        others = replace(self, friction=None).used_names
        return {name: each for name, each in self.parameters.items() if name != self.friction or name in others}

    @property
    def wide(self) -> list[str]:
        """The names of the parameters that are intervals."""
        return [name for name, (low, high) in self.parameters.items() if low < high]

    def document(self) -> Document:
        """The machine for JSON."""
        return {
            "name": self.name,
            "units": self.units,
            "coordinates": list(self.coordinates),
            "parameters": {name: [*map(decimal_text, bounds)] for name, bounds in self.parameters.items()},
            **{name: [list(each) for each in getattr(self, name)] for name in ("masses", "weights", "inerters")},
            "inertia": [list(row) for row in self.inertia],
            "springs": [each.document() for each in self.springs],
            "potentials": list(self.potentials),
            **{name: getattr(self, name) for name in ("surface_gravity", "gravity", "gap", "launch", "counts")},
            "separation": self.separation,
            **{name: [list(each) for each in pairs] for name, pairs in self._maps.items() if pairs},
            **{name: list(each) for name, each in (("sticks", self.sticks), ("tuned", self.tuned)) if each},
            **({"prescribed": [[n, decimal_text(value)] for n, value in self.prescribed]} if self.prescribed else {}),
            **({"centre": self.centre} if "speed" in dict(self.prescribed) or (self.places and self.centre) else {}),
            **({"places": [list(each) for each in self.places]} if self.places else {}),
            **({"grazes": True} if self.grazes else {}),
            **({"heights": [list(each) for each in self.heights]} if self.sticks else {}),
            **({"friction": self.friction} if self.sticks and self.friction is not None else {}),
            **({"restitution": decimal_text(self.restitution)} if self.restitution else {}),
        }

    @property
    def _maps(self) -> dict[str, tuple[Sized, ...]]:
        """What is stated only of machines that step."""
        return {"reversor": self.reversor, "symmetry": self.symmetry, "gaps": self.gaps}

    def words(self, free: str | None = None) -> str:
        """The machine as a sentence, without the value of a parameter that is free."""
        parts = [f"the coordinates {', '.join(self.coordinates)}"]
        parts += [f"a mass {mass} at the height {height}" for height, mass in self.masses]
        parts += [f"the weight of a mass {mass} at the height {height}" for height, mass in self.weights]
        parts += [f"an inerter {mass} along {extension}" for extension, mass in self.inerters]
        if self.inertia:
            rows = "; ".join(", ".join(row) for row in self.inertia)
            parts.append(f"the inertia [{rows}]")
        parts += [each.words() for each in self.springs]
        parts += [f"the potential energy {each}" for each in self.potentials]
        parts.append(f"the acceleration of gravity ({self.surface_gravity})*({self.gravity}) at the height z")
        parts += self._gaps_in_words()
        at = {name: f"rests in contact, held by a force of the ground on the point that opens, at the place {place}"
              for name, place in self.places}  # fmt: skip
        parts += [f"the coordinate {x}, which sticks: it {at.get(x, 'is 0 in contact, held by a force of the ground')}"
                  for x in self.sticks]  # fmt: skip
        parts += [f"the height {formula} of the {name}" for name, formula in self.heights]
        if self.sticks and self.friction is not None:
            parts.append(f"the coefficient of friction {self.friction}")
        if self.places and self.centre:
            parts.append(f"the place {self.centre} of the centre of the masses along the ground")
        if self.separation is not None:
            parts.append(f"the separation {self.separation}")
        known = [f"{name} {range_text(bounds)}" for name, bounds in self.parameters.items() if name != free]
        named = ", ".join([*known, *(f"{name} to be found" for name in self.tuned)])
        units = "in SI" if self.units == "SI" else "dimensionless"
        numbers = f", with {named}" if named else ""
        launch = f"{self.launch} and its rate at lift-off are called liftoff and alpha"
        turns = f"{self.counts} is stationary between lift-off and mid-flight as often as the number of its family says"
        turns += "".join(f"; {self._meaning(name)}" for name, _ in self.prescribed if name in DEFINED)
        maps = self._maps_in_words() if self.steps else ""
        return f"Let the {self.name} have {'; '.join(parts)}{numbers}; all is {units}. {maps}{launch}; {turns}."

    def _meaning(self, name: str) -> str:
        """The definition of a quantity that is prescribed, in words."""
        return f"{name.replace('_', ' ')} is {DEFINED[name].format(counts=self.counts, centre=self.centre)}"

    def _gaps_in_words(self) -> list[str]:
        e = decimal_text(self.restitution)
        how = f"with the restitution {e}: its rate v becomes -{e}*v" if self.restitution else "plastically"
        if not self.steps:
            return [f"the gap {self.gap}, which lands {how}"]
        lands = [f"the gap {gap} of the {name}" for name, gap in self.gaps[1:]] or ["its image under R"]
        return [f"the gap {self.gap} of the {self.points[0]}, which opens", f"{lands[0]}, which lands {how}"]

    def _maps_in_words(self) -> str:
        back, anew = (", ".join(f"{name} to {image}" for name, image in pairs) or "each coordinate to itself"
                      for pairs in (self.reversor, self.symmetry))  # fmt: skip
        maps = f"Let R reverse time and take {back}, and let S take {anew}; coordinates without a formula stay"
        taken = {*self.coordinates, *self.parameters, *self.tuned}
        letters = chain(("x", "q", "X", "Q", "state"), map("state_{}".format, count()))
        x = next(letter for letter in letters if letter not in taken)
        forces = "the forces of the ground on the point that opens" if self.places else "all forces of the ground"
        vanish = f", in which {forces} vanish," if self.sticks else ""
        orbit = f"A lossless orbit is launched in a state {x}{vanish} and lands in R {x}; its contact, whose"
        return f"{maps}. {orbit} coordinates are counted anew by S, leads from S R {x} to {x}. "


def range_text(bounds: Bounds) -> str:
    """The exact bounds of a parameter, in words."""
    low, high = map(decimal_text, bounds)
    return f"= {low}" if low == high else f"in [{low}, {high}]"


def exact_bounds(name: str, value: Decimals) -> Bounds:
    """The exact bounds of a parameter; raises `InputError` for anything but a number or an interval."""
    bounds = value if isinstance(value, tuple | list) else (value, value)
    if len(bounds) != 2:
        raise InputError(f"{name} = {value!r}; an interval must have two bounds, (low, high)")
    low, high = (exact_fraction(name, bound) for bound in bounds)
    for bound in (low, high):
        if not is_decimal(bound):
            raise InputError(f"{name} = {bound} is not a decimal: state an interval of decimals that contains it")
    if low > high:
        raise InputError(f"{name} = ({bounds[0]}, {bounds[1]}); low must not be above high")
    return low, high


def exact_values(parameters: object) -> dict[str, Decimals]:
    """Exact values of parameters by name; raises `InputError` unless it is a mapping, or None for no values."""
    if not isinstance(parameters, Mapping | None):
        raise InputError(f"parameters = {parameters!r}; they must map names to decimals, such as {{'beta': '0.3'}}")
    return dict(parameters or {})


def stated_machine(machine: Machine, parameters: Mapping[str, Decimals], along: str | None = None) -> StatedMachine:
    """What a theorem about a machine states, with exact values of some of its parameters; each other one stands for
    the shortest decimal that rounds to it. A parameter that is in no formula of the theorem is left out.

    along : the name of a parameter that the theorem is about

    Raises `InputError` for a machine that states no mechanics and for parameters that it does not have, that are in no
    formula, or with invalid values, and `Unproved` for laws without a formula: a Python function that formulas cannot
    express.
    """
    if not callable(getattr(machine, "stated", None)):
        raise InputError(f"a {machine.model.name} states no mechanics for a proof: state a Mechanism")
    mechanism: Mechanism = machine.stated()  # type: ignore[attr-defined]
    free = free_parameters(machine)
    for name in parameters:
        if name not in free:
            raise InputError(f"the machine has no parameter '{name}'; it has {', '.join(free)}")
    known = mechanism.values
    values = {name: exact_bounds(name, {**known, **parameters}[name]) for name in mechanism.names if name in known}
    for end in (0, 1):
        machine.with_values(**{name: float(values[name][end]) for name in parameters if name in values})
    stated = _of_mechanism(mechanism, values, exact_fraction("restitution", machine.restitution))
    used = stated.used_names
    for name in (*parameters, *([along] if along else [])):
        if name not in used:
            judged = "; friction matters only where a coordinate sticks" if mechanism.friction is not None else ""
            raise InputError(f"no formula of the theorem contains the parameter '{name}': leave it out{judged}")
    stated = replace(stated, parameters={name: each for name, each in stated.parameters.items() if name in used})
    _refuse_two_meanings(stated)
    return stated


def _refuse_two_meanings(stated: StatedMachine) -> None:
    """Raise `Unproved` for a name that would stand for two things in the theorem."""
    names = {*stated.coordinates, *stated.parameters}
    taken = dict.fromkeys(names & OWN_NAMES, "a number that every theorem is about")
    if "r" in names and stated.springs:
        taken["r"] = "the extension in a spring's law"
    if "z" in names and "z" in parse(stated.gravity).names:
        taken["z"] = "the height in the law of gravity"
    if "f" in names and any(each.rows for each in stated.springs):
        taken["f"] = "the polynomials between the rows of a table"
    if stated.steps:
        taken |= dict.fromkeys(names & {"R", "S"}, "a map of the machine's states")
    for name, meaning in sorted(taken.items()):
        raise Unproved(f"the name '{name}' stands for {meaning}: rename the coordinate or parameter")


def _of_mechanism(mechanism: Mechanism, values: Mapping[str, Bounds], restitution: Fraction) -> StatedMachine:
    names = tuple(values)

    def text(expression: Scalar) -> str:
        return _text_of(expression, tuple(mechanism.coordinates), names)

    kinds: dict[type, list[Sized]] = {Mass: [], Weight: [], Inerter: []}
    springs, potentials, masses = list[StatedSpring](), list[str](), list[Sized]()
    for element in mechanism.elements:
        match element:
            case Mass(place, size) | Weight(place, size) | Inerter(place, size):
                kinds[type(element)].append((text(place), text(size)))
                if isinstance(element, Mass) and element.across is not None:  # inertia without weight
                    kinds[Inerter].append((text(element.across), text(size)))
                    masses.append(kinds[Inerter][-1])
            case Spring(extension, law):
                springs.append(_stated_spring(text(extension), law))
            case Potential(energy):
                potentials.append(text(energy))
            case _:
                raise InputError(f"{type(element).__name__} does not conserve energy, so there is no lossless orbit")
    gravity, structure = mechanism.gravity, mechanism.structure
    assert mechanism.gap is not None  # a machine without one has no orbit that is proved
    if gravity.written is None or gravity.written.potential:
        raise Unproved(f"gravity '{gravity.text}' is not a formula, so a theorem cannot state it")
    separation = mechanism.separation
    maps: dict[str, Any] = {
        name: tuple((key, text(value)) for key, value in dict(getattr(mechanism, name) or {}).items())
        for name in ("reversor", "symmetry", "gaps")
    }
    return StatedMachine(
        name=mechanism.name,
        units="SI" if mechanism.in_si else "dimensionless",
        coordinates=tuple(mechanism.coordinates),
        parameters=values,
        masses=tuple(kinds[Mass]),
        weights=tuple(kinds[Weight]),
        inerters=tuple(kinds[Inerter]),
        inertia=tuple(tuple(map(text, row)) for row in mechanism.inertia),
        springs=tuple(springs),
        potentials=tuple(potentials),
        surface_gravity=text(mechanism.surface_gravity),
        gravity=gravity.written.formulas[0],
        gap=text(mechanism.gap),
        launch=derived_launch(structure),
        counts=text(structure.counts),
        separation=None if separation is None else text(separation),
        sticks=tuple(mechanism.sticks),
        places=tuple((x, text(place)) for x, place in mechanism.sticks.items() if x not in mechanism.stepping),
        grazes=mechanism.grazes,
        heights=tuple((name, text(each)) for name, each in (mechanism.heights or {}).items() if mechanism.sticks),
        centre=_centre_formula(masses) if masses and len(masses) == len(kinds[Mass]) else None,
        friction=None if mechanism.friction is None else text(mechanism.friction),
        restitution=restitution,
        **maps,
    )


def _text_of(expression: Scalar, coordinates: tuple[str, ...], names: tuple[str, ...]) -> str:
    """An expression of a mechanism as a formula."""
    if isinstance(expression, str):
        return expression
    if callable(expression):
        found = traced_of_places(expression, coordinates, names)
        if found is None:
            raise Unproved(f"the Python function {expression!r} cannot be written as a formula")
        return found
    if isinstance(expression, Rational):  # whole numbers too, also those of NumPy
        above, below = int(expression.numerator), int(expression.denominator)
        return str(above) if below == 1 else f"{above}/{below}"
    return str(expression) if isinstance(expression, Decimal) else repr(float(expression))


def _centre_formula(masses: Sequence[Sized]) -> str:
    """The formula of the place along the ground of the centre of masses at places along it."""
    moments = " + ".join(f"({mass})*({place})" for place, mass in masses)
    return f"({moments})/({' + '.join(f'({mass})' for _, mass in masses)})"


def _stated_spring(extension: str, law: object) -> StatedSpring:
    assert isinstance(law, Key)
    written = law.written
    if written is None:
        raise Unproved(f"the spring's law '{law.text}' is a function, not a formula")
    along = f"{extension} - {written.shift}" if written.shift else extension
    rows = written.rows() if written.rows else ()
    texts = tuple(tuple(repr(float(each)) for each in row) for row in rows)
    return StatedSpring(along, written.formulas, written.breaks, written.potential, texts)
