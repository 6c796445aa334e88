"""The statement of orbits at which a formula of their quantities, or the energy of their contact, is prescribed.

To the equations F(u, p) = 0 of an orbit those are added of what the formula is made of, each on an arc of its own: an
extreme is the value of a function at a time at which it is stationary, and both are unknowns; half the time of a
contact is the unknown at which its middle is reached. The last equation is that of the formula, and the last unknown a
parameter. All derivatives are exact.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca

from ..errors import InputError
from ..model import Arc, Model, Phase, Statement
from ..periodic import VARIATIONAL, dimension_of, landing_factors
from ..symbolic import Formula
from ..units import Units
from .design_quantities import WITH_CONTACT, expressions, extreme_of, landing_sensitivity, variational_arc
from .extremes import Kind, extreme_function, start_function

HALF_CONTACT_TIME, SLOPE = "contact_duration", "landing sensitivity"
# The distance in contact from touchdown to the place at which the machine would be at rest.
BARRIER = "distance to the barrier"


class EventStatement(NamedTuple):
    """The statement; and of those further unknowns that are values of functions, by name, the equations in which they
    are subtracted."""

    statement: Statement
    rows: dict[str, int]


def names_of_kind(kind: Kind) -> tuple[str, str]:
    """The names of the unknowns of an extreme: its value and its time."""
    return f"largest {kind.extreme}", f"time of the largest {kind.extreme}"


@lru_cache(maxsize=64)
def event_statement(
    model: Model, base: Statement, along: str, formula: Formula, used: tuple[str, ...], kinds: tuple[Kind, ...]
) -> EventStatement:
    """The statement of orbits at which a formula has a value.

    base : of the orbits alone, perhaps with tuned parameters
    along : name of the parameter, or of the prescribed quantity, that is an unknown
    used : the quantities that the formula uses, which are made of extremes of these kinds

    The last residual is the value of the formula, from which the prescribed one has to be subtracted.
    """
    arcs, added, durations = [*base.arcs], list[str](), list[str]()
    here: list[Any] = []  # further conditions, (u, p) -> residual, by unknown
    rows, row = dict[str, int](), len(base.unknowns)
    middles = [kind for kind in kinds if kind.where == "middle" and _phase_of_kind(model, kind) == "contact"]
    if HALF_CONTACT_TIME not in base.unknowns and (middles or {*used} & {*WITH_CONTACT}):
        added, durations = [*added, HALF_CONTACT_TIME], [*durations, HALF_CONTACT_TIME]
        arcs, row = (
            [*arcs, _arc(model, "contact", HALF_CONTACT_TIME, lambda x, p: [model.mid_contact(p).at(x)])],
            row + 1,
        )
    for kind in kinds:
        value, time = names_of_kind(kind)
        added, rows[value] = [*added, value], row
        if kind.where == "inside":
            added, durations = [*added, time], [*durations, time]
            arcs, row = [*arcs, _arc_to(model, kind, value, time)], row + 2
        elif kind.where == "middle":
            duration = HALF_CONTACT_TIME if kind in middles else None
            arcs, row = [*arcs, _arc_to(model, kind, value, duration, base)], row + 1
        else:
            rows.pop(value)
            here.append((value, kind))
    if any(name in VARIATIONAL for name in used):
        arc = variational_arc(model)
        at_landing = lambda u, x, p: [landing_sensitivity(model, arc.duration(u, p), x, p) - u[SLOPE]]  # noqa: E731
        arcs, added, rows[SLOPE], row = [*arcs, replace(arc, conditions=at_landing)], [*added, SLOPE], row, row + 1
    rows |= {value: row + i for i, (value, _) in enumerate(here)}
    last = arcs[-1]

    def conditions(u: Mapping, x: Sequence, p: Mapping) -> list:
        starts = [_at_start(model, kind, u, p) - u[value] for value, kind in here]
        return [*last.conditions(u, x, p), *starts, _value_of_formula(model, formula, used, kinds, u, p)]

    arcs[-1] = replace(last, conditions=conditions)
    return EventStatement(_extended(f"{base.name} with {formula.text}", base, arcs, added, durations, along), rows)


def _extended(
    name: str, base: Statement, arcs: Sequence[Arc], added: Sequence[str], durations: Sequence[str], along: str
) -> Statement:
    """A statement with further arcs, unknowns and durations, and with a parameter that is the last unknown, after the
    tuned ones."""
    own, tuned = base.unknowns[: len(base.unknowns) - len(base.tuned)], (*base.tuned, along)
    last = f"prescribed {along}" if along in own else along
    unknowns = (*own, *added, *base.tuned, last)
    return Statement(name, unknowns, tuple(arcs), (*base.durations, *durations), tuned)


def _value_of_formula(
    model: Model, formula: Formula, used: Sequence[str], kinds: Sequence[Kind], u: Mapping, p: Mapping
) -> Any:
    """The value of a formula, of quantities in the machine's units."""
    values = dict(p)
    if used:
        units = model.units(p) if model.units else Units(1.0, 1.0, 1.0)
        extremes = {kind.extreme: u[names_of_kind(kind)[0]] for kind in kinds}
        own, data = dict(u) | {"contact": u.get(HALF_CONTACT_TIME, 0.0)}, model.flight.data(model.launch(u, p), p)
        found = expressions(model, used, extremes, own, u.get(SLOPE, 0.0), landing_factors(0.0)[0], p, data)
        values |= {name: found[name] * units.of(dimension_of(name)) for name in used}
    return formula(**{name: values[name] for name in formula.names})


def _phase_of_kind(model: Model, kind: Kind) -> str:
    """The name of the phase in which an extreme lies."""
    return extreme_of(model, kind.extreme)[kind.function][0]


def _begin(model: Model, kind: Kind, u: Mapping, p: Mapping) -> list:
    """The state in which the phase of an extreme begins."""
    return model.launch(u, p) if _phase_of_kind(model, kind) == "flight" else model.touchdown(u, p)


def _at_start(model: Model, kind: Kind, u: Mapping, p: Mapping) -> Any:
    """The value of the function of an extreme where its phase begins."""
    x = _begin(model, kind, u, p)
    data = getattr(model, _phase_of_kind(model, kind)).data(x, p)
    function = start_function(model, tuple(p), kind.extreme, kind.function)
    return function(ca.vertcat(*map(ca.SX, x)), ca.vertcat(*p.values()), ca.vertcat(*data))


def _function(model: Model, kind: Kind, x: Sequence, p: Mapping) -> list:
    """The function of an extreme, its rate of change along the motion, and the rate of that, in a state."""
    data = getattr(model, _phase_of_kind(model, kind)).data(x, p)
    function = extreme_function(model, tuple(p), kind.extreme, kind.function)
    return function.call([ca.vertcat(*map(ca.SX, x)), ca.vertcat(*p.values()), ca.vertcat(*data)])


def _arc(model: Model, phase: str, duration: str, conditions: Any) -> Arc:
    """An arc of a phase from its beginning for a time that is an unknown, with conditions (x, p) -> residuals."""
    begin = model.launch if phase == "flight" else model.touchdown
    return Arc(
        getattr(model, phase),
        start=lambda u, before, p: begin(u, p),
        duration=lambda u, p: u[duration],
        conditions=lambda u, x, p: conditions(x, p),
    )


def _arc_to(model: Model, kind: Kind, value: str, time: str | None, base: Statement | None = None) -> Arc:
    """The arc that ends at an extreme: after a time that is an unknown, or in the middle of the flight."""

    def conditions(u: Mapping, x: Sequence, p: Mapping) -> list:
        found, rate, _ = _function(model, kind, x, p)
        return [found - u[value], *([rate] if kind.where == "inside" else [])]

    arc = _arc(model, _phase_of_kind(model, kind), time or "", lambda x, p: [])
    half = arc.duration if time else base.arcs[0].duration  # type: ignore[union-attr]
    return replace(arc, conditions=conditions, duration=half)


@lru_cache(maxsize=64)
def collapse_statement(model: Model, base: Statement, along: str, side: float) -> EventStatement:
    """The statement of orbits whose contact comes to rest where it has no acceleration: beyond, it never turns back.

    side : sign of the speed at touchdown

    In a contact of one coordinate y the speed v is a function of the place, v^2/2 = E(y), with E' = a(y), the
    acceleration. Both vanish at the barrier, and E is integrated from touchdown to there. Raises `InputError` for
    contacts of several coordinates, and where the acceleration depends on the speed.
    """
    contact = model.contact
    if len(contact.states) != 2 or not model.plain:
        raise InputError(
            "a collapse can be followed only in contacts of one coordinate: with several, no equation of half an orbit "
            "states how the last contact that ends comes near to rest"
        )
    weight = contact.pieces.coordinate[0] if contact.pieces else 0.0

    def field(x: Sequence, p: Mapping, q: Sequence) -> list:
        return [side + 0 * x[0], side * contact.field([x[0], 0 * x[0]], p, q)[1]]

    pieces = contact.pieces and replace(contact.pieces, coordinate=(weight, 0.0))
    phase = Phase("contact over places", ("place", "energy"), field, pieces=pieces)

    def start(u: Mapping, before: Sequence, p: Mapping) -> list:
        place, speed = model.touchdown(u, p)
        return [place, 0.5 * speed**2]

    def conditions(u: Mapping, x: Sequence, p: Mapping) -> list:
        return [side * field(x, p, phase.data(x, p))[1], x[1]]

    arc = Arc(phase, start, lambda u, p: u[BARRIER], conditions)
    return EventStatement(
        _extended(f"{base.name} before a collapse", base, (*base.arcs, arc), [BARRIER], [BARRIER], along), {}
    )
