"""The place of an event on a family: a located event, or where a formula has a value or is stationary."""

from collections import Counter

import numpy as np

from ..design import Outputs, known_formula, names_along
from ..errors import InputError, NoOrbit
from ..hops import CROSSINGS
from ..model import Machine, Statement
from ..symbolic import Formula, suggest
from .curve import TEST_FUNCTIONS
from .family import Family, varied_at
from .point import Event, Point, point_in_units
from .step_control import OTHER_EVENTS
from .tuned_curve import equations_of_family

# How the name of an event begins along which a quantity is stationary.
EXTREMUM = "extremum of "


def located_event(family: Family, event: Event | str, number: int) -> Event:
    """An event of a family."""
    if isinstance(event, Event):
        place = event.kind, event.value, getattr(event.point, "u", None)
        if all((each.kind, each.value, each.point.u) != place for each in family.events):
            where = "" if event.value is None else f" at {family.name} = {event.value:.10g}"
            raise InputError(
                f"the event '{event.kind}'{where} does not belong to this family: use one of family.events"
            )
        return event
    found = [each for each in family.events if each.kind == event]
    if number < len(found):
        return found[number]
    counts = Counter(each.kind for each in family.events)
    here = ", ".join(f"{count} '{kind}'" for kind, count in counts.items()) or "no events"
    if found:
        raise NoOrbit(f"number = {number}: the family has {here}, counted from 0")
    machine, known = family.source, [*TEST_FUNCTIONS, *OTHER_EVENTS, *counts]
    if event in CROSSINGS and "multipliers" not in family.settings:
        here += f"; follow(..., multipliers=True) locates a '{event}'"
    elif event not in known:
        if machine and event in names_along(machine):
            text = f"'{event}' is not an event: follow the quantity at a value, {{'{event}': 0.1}}, or where it is"
            raise InputError(f"{text} stationary along the family, '{EXTREMUM}{event}'")
        near = suggest(event, known)
        raise InputError(f"there is no event '{event}'{near}{'' if near.endswith('?') else '.'} The family has {here}")
    raise NoOrbit(f"the family has no event '{event}'; it has {here}")


def crossing_of(machine: Machine, family: Family, formula: Formula, level: float, number: int) -> Point:
    """A dimensionless point of a family next to where a formula passes a value."""
    values = family.values_at(family.points, formula.text) - level
    if (values == values[0]).all():
        raise InputError(f"'{formula.text}' has the same value along the whole family, {values[0] + level:.10g}")
    with np.errstate(invalid="ignore"):
        found = np.flatnonzero(values[:-1] * values[1:] <= 0)
    if not 0 <= number < len(found):
        if not np.isfinite(values).any():
            raise NoOrbit(f"'{formula.text}' has no value at any orbit of the family")
        low, high = (float(each(values)) + level for each in (np.nanmin, np.nanmax))
        raise NoOrbit(
            f"'{formula.text}' passes {level:g} along the family {len(found)} times; it lies between {low:.6g} and "
            f"{high:.6g}"
        )
    i = int(found[number])
    return bare_point(machine, family, family[i if abs(values[i]) <= abs(values[i + 1]) else i + 1])


def turn_of(machine: Machine, family: Family, formula: Formula, number: int) -> Point:
    """A dimensionless point of a family next to where a formula is stationary."""
    values = family.values_at(family.points, formula.text)
    rises = np.diff(values)
    found = np.flatnonzero(rises[:-1] * rises[1:] < 0) + 1
    if not 0 <= number < len(found):
        raise NoOrbit(f"'{formula.text}' has {len(found)} extrema inside the family, so none has the number {number}")
    return bare_point(machine, family, family[int(found[number])])


def known_event(machine: Machine, text: object) -> Formula:
    """A formula of the quantities and parameters of a machine."""
    if not isinstance(text, str):
        raise InputError(f"event = {text!r}; it must be a kind of event, or a formula of quantities with its value")
    formula = known_formula(text, names_along(machine), "the event", machine)
    if not formula.names:
        raise InputError(f"the event '{text}' must contain a quantity of the orbit or a parameter of the machine")
    return formula


def quantities_used(machine: Machine, formula: Formula) -> list[str]:
    """The quantities that a formula uses."""
    return Outputs((formula,), ()).quantities(machine.model, machine.values)


def bare_point(machine: Machine, family: Family, point: Point) -> Point:
    """A point of a family without dimensions."""
    units = machine.with_values(**varied_at(family, point)).units
    return point_in_units(point, units and units.inverse())


def statement_of_family(machine: Machine, family: Family) -> Statement:
    """The statement of the family's orbits."""
    return equations_of_family(machine, family.settings["method"], family.name, tuned_of_family(family)).statement


def tuned_of_family(family: Family) -> tuple[str, ...]:
    """The names of the tuned parameters of a family."""
    return tuple(family.settings.get("tune", ()))
