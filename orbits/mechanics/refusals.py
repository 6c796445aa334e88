"""Checks of a mechanism as it is stated: names, shapes, and values that no machine has."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from math import inf
from numbers import Real
from typing import Any, get_args

from ..errors import InputError, finite_number, is_list, takes
from ..model import STEP_LENGTH
from ..symbolic import CONSTANTS, FUNCTIONS, suggest
from .elements import Damper, Element, Force, Inerter, Mass, Scalar, Weight, fields_of, names_in, paths_of, value_of
from .structure import USUAL_WORDS
from .terms import GRAVITY_SHARE

# Names that coordinates cannot have, with what they denote already.
TAKEN_NAMES = {
    **dict.fromkeys(("alpha", "liftoff", "duration", "contact_duration", "unfolding"), "an unknown of every orbit"),
    **dict.fromkeys(FUNCTIONS, "a function in formulas"),
    **dict.fromkeys(CONSTANTS, "a constant in formulas"),
    GRAVITY_SHARE: "the share of gravity that varies",
}
# A name without a value is taken for a misspelt coordinate from this share of equal letters on: "bdy" is one of "body"
# (0.86), "foot_mass" is not a variant of "foot" (0.62).
NEARLY_THE_SAME = 0.75


def refuse_misstated(mechanism: Any) -> None:
    """Raise `InputError` for a `Mechanism` whose names or shapes cannot be, whatever its parameters' values are."""
    m = mechanism
    for name in ("parameters", "rest", "actuators", "words", "heights", "symmetry", "gaps", "segments", "reversor"):
        if name == "reversor" and m.reversor is None:
            continue
        if not isinstance(getattr(m, name), Mapping):
            raise InputError(f"{name} = {getattr(m, name)!r}; it must be a mapping of names")
    if len(m.coordinates) < 2 and (m.gap is not None or not m.coordinates):
        raise InputError(
            f"coordinates = {m.coordinates!r}: a machine with a gap needs at least two, such as ('body', 'foot')"
        )
    if m.gap is None:
        _refuse_contact(m)
    _refuse_names([*m.coordinates, *m.actuators, *m.actuators.values()])
    if odd := [knee for knee in m.knees if len(knee) != 3]:
        raise InputError(f"knees: {odd[0]!r} is not a tuple (lower, upper, length)")
    for element in m.elements:
        if not isinstance(element, Element):
            known = ", ".join(each.__name__ for each in get_args(Element))
            raise InputError(f"{element!r} is not an element; elements are {known}, all in `orbits`")
        if isinstance(element, Force) and not callable(element.force):
            raise InputError(f"{element.force!r} in {element} is not a Python function (y, v, p)")
        refuse_expressions(element, fields_of(element))
    refuse_expressions("the mechanism", m.expressions)
    if unknown := sorted(names_in(m.gap) - {*m.coordinates, *m.parameters}):
        hint = suggest(unknown[0], m.coordinates)
        raise InputError(f"gap '{m.gap}' has '{unknown[0]}', which is neither a coordinate nor a parameter{hint}")
    _refuse_rows(m.inertia, len(m.coordinates))
    _refuse_keys(m)
    _refuse_coordinates_in(m)
    if m.sticks:
        _refuse_sticks(m)
    if m.friction is not None and all(getattr(each, "across", None) is None for each in m.elements):
        raise InputError(
            f"friction = {m.friction!r}: the force along the ground follows from the horizontal places of the masses; "
            "state Mass(height, mass, across=...)"
        )


def _refuse_contact(m: Any) -> None:
    """Refuse what belongs to a contact, or moves it, of a mechanism without a gap."""
    for name in ("gaps", "sticks", "symmetry", "friction", "restitution", "ground", "launch", "actuators"):
        if getattr(m, name):
            raise InputError(f"gap = None, {name} = {getattr(m, name)!r}: a machine without a gap has no {name}")


def _refuse_sticks(m: Any) -> None:
    """Refuse coordinates that stick where the mechanism cannot have a motion along the ground."""
    if len(m.sticks) > 1:
        raise InputError(
            f"sticks = {list(m.sticks)}: the plane has one direction along the ground, so only one coordinate can stick"
        )
    if STEP_LENGTH in m.places and m.stepping:
        raise InputError(f"'{STEP_LENGTH}' is the name of the step of {m.stepping[0]}; rename the coordinate")
    if len(m.gaps) > 1 or m.actuators:
        raise InputError("a machine that sticks must have one gap, which opens and lands again, and no actuators")
    for name in {*m.sticks} - {*m.stepping}:
        if left := [
            each[name] for each in (m.reversor or {}, m.symmetry) if STEP_LENGTH in names_in(each.get(name, 0.0))
        ]:
            raise InputError(
                f"'{name}' sticks, and '{left[0]}' has the {STEP_LENGTH}: leave both of its maps out where "
                "nothing depends on its place, or state both without a step"
            )
    if left := [each for each in m.elements if isinstance(each, Mass) and each.across is None]:
        raise InputError(
            f"{left[0]} has no place along the ground, which is needed since {next(iter(m.sticks))} sticks: state its "
            "across="
        )
    if len(m.coordinates) < 2 + len(m.sticks):
        raise InputError(f"sticks = {list(m.sticks)}: then nothing moves in contact")


def maps_of_sticking(sticks: Sequence[str]) -> tuple[dict[str, str], dict[str, str]]:
    """The formulas of the reversor and of the symmetry for coordinates that stick: a step moves them on."""
    return {x: f"{STEP_LENGTH} - {x}" for x in sticks}, {x: f"{x} - {STEP_LENGTH}" for x in sticks}


def listed(what: str, value: object) -> tuple:
    """Several things as a tuple; raises `InputError` for one alone."""
    if not is_list(value):
        raise InputError(f"{what} = {value!r}; it must be a list, such as [{value!r}]")
    return tuple(value)


def _refuse_names(names: Sequence[object]) -> None:
    """Refuse names of coordinates, actuators and rates that are invalid, have another meaning, or occur twice."""
    for i, name in enumerate(names):
        if not isinstance(name, str) or not (name.isascii() and name.isidentifier()):
            raise InputError(f"{name!r} cannot name a coordinate: use letters, digits and _, as in 'y1'")
        if name in TAKEN_NAMES:
            raise InputError(f"'{name}' is {TAKEN_NAMES[name]}; rename the coordinate")
        if name in names[:i]:
            raise InputError(f"'{name}' is the name of two coordinates or actuators; rename one")


def refuse_expressions(owner: object, expressions: Iterable[object]) -> None:
    """Refuse an expression that is neither formula, number nor function."""
    for each in expressions:
        if not (isinstance(each, str | Real) or takes(each, 2) or takes(each, 3)):
            raise InputError(f"{each!r} in {owner} must be a formula, a number or a function (y, p)")
        if isinstance(each, Real):
            finite_number(f"a number in {owner}", each)


def _refuse_rows(rows: Sequence[Sequence[Scalar]], size: int) -> None:
    """Refuse an inertia that is not a symmetric matrix."""
    if rows and (len(rows) != size or any(len(row) != size for row in rows)):
        raise InputError(f"inertia = {rows!r}: {size} coordinates need {size} rows of {size} entries")
    for i, row in enumerate(rows):
        for j in range(i):
            if row[j] != rows[j][i]:
                apart = f"{row[j]!r} in row {i + 1} and {rows[j][i]!r} in row {j + 1}"
                raise InputError(f"the inertia is not symmetric: {apart}; write the same in both places")


def _refuse_keys(m: Any) -> None:
    """Refuse misspelt names of coordinates, heights, words and displacements."""
    places = (*m.coordinates, *m.actuators)
    joined = [name for knee in m.knees for name in knee[:2] if name is not None]
    for what, kind, names, known in (
        ("rest", "coordinate", m.rest, places),
        ("reversor", "coordinate", m.reversor or (), m.coordinates),
        ("symmetry", "coordinate", m.symmetry, m.coordinates),
        ("angles", "coordinate", m.angles, m.coordinates),
        ("sticks", "coordinate", m.sticks, m.coordinates),
        ("words", "message", m.words, tuple(USUAL_WORDS)),
        ("knees", "height", joined, tuple(m.heights)),
    ):
        if unknown := [name for name in names if name not in known]:
            raise InputError(f"{what}: there is no {kind} '{unknown[0]}'{suggest(unknown[0], known)}")
    used = {name for each in m.expressions for name in names_in(each)} if m.actuators else set()
    if not m.has_functions and (unused := [name for name in m.actuators if name not in used]):
        hint = suggest(unused[0], sorted(used - {*m.coordinates}))
        raise InputError(f"no extension has the actuator's displacement '{unused[0]}'{hint}")


def _refuse_coordinates_in(m: Any) -> None:
    """Refuse coordinates in expressions of parameters alone, as far as formulas show them."""
    places = {*m.coordinates, *m.actuators}
    alone: list[tuple[str, object, str]] = [
        *(("rest", place, "a place of rest must be a number or a parameter") for place in m.rest.values()),
        *(("the length of a knee", length, "a link must be rigid") for *_, length in m.knees),
        ("surface_gravity", m.surface_gravity, "state how gravity varies by a law of the height z"),
        ("energy_unit", m.energy_unit, "it must be the same in all configurations"),
        ("friction", m.friction, "it must be the same in all configurations"),
    ]
    for element in m.elements:
        if isinstance(element, Mass | Weight):
            alone.append(("the mass", element.mass, "state an inertia that varies as inertia="))
        elif isinstance(element, Inerter):
            alone.append(("the inertance", element.inertance, "state an inertia that varies as inertia="))
        elif isinstance(element, Damper):
            alone.append(("the coefficient", element.coefficient, "state a force of place and speed as a Force"))
    for what, expression, remedy in alone:
        if found := sorted(names_in(expression) & places):
            raise InputError(f"{what} '{expression}' depends on the coordinate '{found[0]}': {remedy}")


def joined_values(brought: Iterable[tuple[str, Mapping[str, float]]], numbers: Mapping[str, float]) -> dict[str, float]:
    """The values of the parameters that laws (text, values) bring, with the stated `numbers`; raises `InputError`
    where two of them give one name different values."""
    values, owners = dict(numbers), dict.fromkeys(numbers, "parameters")
    own = dict[str, float]()
    for text, law in brought:
        for name, value in law.items():
            if name in values and values[name] != value:
                apart = f"{values[name]:g} by {owners[name]} and {value:g} by the law '{text}'"
                raise InputError(f"parameter '{name}' has two values, {apart}: give both the same, or rename one")
            values[name] = own[name] = value
            owners.setdefault(name, f"the law '{text}'")
    return {**own, **numbers}


def refuse_names_of_parameters(mechanism: Any, names: Iterable[str], used: Collection[str]) -> None:
    """Raise `InputError` for parameters whose names are those of coordinates, or that nothing uses."""
    if taken := sorted(mechanism.places & {*names}):
        raise InputError(f"'{taken[0]}' is a coordinate; rename the parameter")
    if GRAVITY_SHARE in used:
        raise InputError(f"'{GRAVITY_SHARE}' has a meaning of its own; rename the parameter")
    if not mechanism.has_functions and (unused := [name for name in mechanism.parameters if name not in used]):
        raise InputError(f"no element has a parameter '{unused[0]}'{suggest(unused[0], used)}")


def hint_of_coordinate(name: str, coordinates: Collection[str]) -> str:
    """The hint about a parameter without a value that looks like a misspelt coordinate, '' for another."""
    import difflib

    near = difflib.get_close_matches(name, list(coordinates), n=1, cutoff=NEARLY_THE_SAME)
    return f"'{name}' has no value; did you mean the coordinate '{near[0]}'?" if near else ""


def refuse_values(mechanism: Any) -> None:
    """Raise `InputError` for parameters of a `Mechanism` beyond their bounds, and for masses, inertias, dampers and
    gravity that have wrong signs at their values; expressions of coordinates, and Python functions, are left out."""
    m, p = mechanism, mechanism.parameters
    for name, (low, high) in m.bounds.items():
        if name in p and not low <= p[name] <= high:
            raise InputError(f"{name} = {p[name]:g}; for a {m.name} it must lie between {low:g} and {high:.6g}")
    moving, anything_moves = set[str](), False
    for element in m.elements:
        if isinstance(element, Mass | Weight):
            value = _refuse_sign(element.mass, m, "the mass in", element, above=isinstance(element, Mass))
        elif isinstance(element, Inerter):
            value = _refuse_sign(element.inertance, m, "the inertance in", element)
        elif isinstance(element, Damper):
            _refuse_sign(element.coefficient, m, "the coefficient in", element)
        if isinstance(element, Mass | Inerter) and (value is None or value > 0):
            for place in paths_of(element) if isinstance(element, Mass) else [element.extension]:
                moving |= names_in(place)
                anything_moves |= callable(place)
    for i, name in enumerate(m.coordinates if m.inertia else ()):
        value = _refuse_sign(m.inertia[i][i], m, "the inertia of coordinate", name)
        moving |= {name} if value is None or value > 0 else set()
    if not anything_moves and (still := [name for name in m.coordinates if name not in moving]):
        raise InputError(f"coordinate '{still[0]}' has no inertia: give it a Mass, or state its inertia, above 0")
    if m.friction is not None:
        _refuse_sign(m.friction, m, "the friction of", m.name)
    surface = _value(m.surface_gravity, m.places, p)
    if surface is not None and m.gravity.pieces is None:
        ground = surface * float(m.gravity.expression(0.0, p, []))
        if not 0 < ground < inf:
            law = f"'{m.gravity.text}'" if surface == 1 else f"'{m.gravity.text}' times {m.surface_gravity!r}"
            raise InputError(f"gravity {law} is {ground:g} at z = 0, not above 0: gravity is positive downwards")


def _refuse_sign(expression: Scalar, m: Any, what: str, owner: Any, above: bool = False) -> float | None:
    """The value of an expression, None where it has none; raises `InputError` for one that is infinite, below 0, or 0
    where it must be `above`."""
    value = _value(expression, m.places, m.parameters)
    if value is None or 0 < value < inf or (value == 0 and not above):
        return value
    prefix = f"{expression} = " if isinstance(expression, str) else ""
    raise InputError(f"{prefix}{value:g}: {what} {owner!r} must be a finite number {'above' if above else 'from'} 0")


def _value(expression: Scalar, places: Collection[str], p: Mapping[str, float]) -> float | None:
    """The value of an expression of parameters alone, None for another."""
    if callable(expression) or not names_in(expression).isdisjoint(places):
        return None
    return p[expression] if isinstance(expression, str) and expression in p else float(value_of(expression, {}, p))
