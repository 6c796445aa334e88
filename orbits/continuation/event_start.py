"""Where the curve of an event begins: its condition, its statement, and a guess of its unknowns."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..design import (
    ABSENT,
    BARRIER,
    COMPOSITION,
    EventStatement,
    Kind,
    Outputs,
    Place,
    base_statement,
    collapse_statement,
    event_statement,
    names_of_kind,
    no_motion,
    places_of,
)
from ..errors import FlowError, InputError, NoOrbit, finite_number
from ..flow import flow_of
from ..hops import CROSSINGS
from ..model import Machine, Statement
from ..periodic import VARIATIONAL, Certificate, Orbit, orbit_from
from ..shooting import shooting_equations, vector
from ..symbolic import Formula, parse
from .event_curve import COLLAPSE, LIMITS, EventCondition
from .event_place import (
    EXTREMUM,
    bare_point,
    crossing_of,
    known_event,
    located_event,
    quantities_used,
    statement_of_family,
    tuned_of_family,
    turn_of,
)
from .family import Family, varied_at
from .point import Event, Point
from .tuned_curve import values_of

# Why other events are not followed.
NOT_FOLLOWED = {
    "branch point": "it satisfies two equations, so it is isolated in two parameters; where a symmetry satisfies one "
    "of them, follow_branch_points follows it",
    "corner": "the derivatives of the equations differ on its two sides",
    "law ends": "beyond it there are no motions, so its equation cannot be solved from both sides",
    "family": "the number of a family is a count, not an equation",
    "value": "its parameter has one value: follow(machine, second) follows it",
}


class BarrierOptions(NamedTuple):
    """Where the barrier of a contact is searched, and when a number of the certificate jumps."""

    samples: int = 4000  # of the energy over the places of a contact
    # Up to these multiples of the distance from touchdown to the place of rest.
    furthest: tuple[float, ...] = (2.0, 8.0, 64.0)
    energy_left: float = 0.2  # the largest share of the energy at rest that is left there
    jumps: float = 1e-6  # a number of the certificate that is larger at its event changes its sign by a jump


BARRIER_SEARCH = BarrierOptions()


class EventStart(NamedTuple):
    """Where a curve of events begins: the machine there, its condition, the statement, a guess of the unknowns (n,),
    the sizes (t,) of the tuned parameters there, or of their changes along the family, and the number of the family."""

    machine: Machine
    condition: EventCondition
    stated: EventStatement
    x: np.ndarray
    tuned_sizes: np.ndarray
    family: int


def event_start(machine: Machine, family: Family, event: Event | str | Mapping[str, float], number: int) -> EventStart:
    """Where the curve of an event of a family begins."""
    if isinstance(event, Mapping):
        if len(event) != 1:
            raise InputError(f"event = {dict(event)!r}: it must be one formula with its value")
        ((text, value),) = event.items()
        formula = known_event(machine, text)
        level = finite_number(f"event '{text}'", value)
        condition = EventCondition(f"{text} = {level:.10g}", text, level, place=_side_of(machine, text, level))
        return _of_formula(machine, family, crossing_of(machine, family, formula, level, number), formula, condition)
    if not isinstance(event, str | Event):
        raise InputError(f"event = {event!r}; it must be an event of the family, its kind, or a formula with its value")
    if isinstance(event, str) and event.startswith(EXTREMUM):
        formula = known_event(machine, event.removeprefix(EXTREMUM))
        condition = EventCondition(event, formula.text, None)
        return _of_formula(machine, family, turn_of(machine, family, formula, number), formula, condition)
    found = located_event(family, event, number)
    own, here = bare_point(machine, family, found.point), machine.with_values(**varied_at(family, found.point))
    if found.kind == "fold":
        return start_of_fold(here, statement_of_family(machine, family), own, family.name)
    if found.kind in CROSSINGS:
        condition = EventCondition(found.kind, family.name, None, crossing=found.kind)
        return _of_orbit(here, statement_of_family(machine, family), own, family.name, condition)
    if found.kind == COLLAPSE:
        return _of_collapse(machine, family, own)
    limits = {kind: text for text, (kind, _) in LIMITS.items()}
    if found.kind not in limits:
        known = ", ".join(["fold", COLLAPSE, *limits, *CROSSINGS])
        reason = NOT_FOLLOWED.get(found.kind, "a watched function has no known derivatives: state a formula")
        raise InputError(f"a curve of '{found.kind}' cannot be followed: {reason}; curves of {known} can")
    text = limits[found.kind]
    size = getattr(own, text) if text in Certificate.__dataclass_fields__ else 0.0
    # Where it jumps, the contact turns back before a barrier on one side, and beyond it on the other.
    if size is None or abs(size) > BARRIER_SEARCH.jumps:
        return _of_collapse(machine, family, own)
    condition = EventCondition(found.kind, text, 0.0, place=_side_of(machine, text, 0.0))
    return _of_formula(machine, family, own, known_event(machine, text), condition)


def start_of_fold(machine: Machine, base: Statement, point: Point, along: str) -> EventStart:
    """The start of a curve of folds."""
    return _of_orbit(machine, base, point, along, EventCondition(f"fold in {along}", along, None))


def _of_orbit(machine: Machine, base: Statement, point: Point, along: str, condition: EventCondition) -> EventStart:
    """The start of a curve whose condition says something of the equations of an orbit."""
    stated = event_statement(machine.model, base, along, parse(along), (), ())
    known = dict(zip(base.unknowns, point.u, strict=False))
    return _start(machine, condition, stated, base, point, known)


def _of_formula(
    machine: Machine, family: Family, point: Point, formula: Formula, condition: EventCondition
) -> EventStart:  # fmt: skip
    """The start of a curve on which a formula has a value or is stationary."""
    here = machine.with_values(**varied_at(family, point))
    used = tuple(quantities_used(here, formula))
    kinds: tuple[Kind, ...] = ()
    times, contact = list[float](), None
    if used:
        if not tuned_of_family(family):
            base_statement(machine.model)  # refuses machines whose orbits are not their own mirror images
        if {*VARIATIONAL} & {*used}:
            _check_variational(machine)
        orbit = orbit_from(here, family.settings["method"], point.u, point.error).dimensionless()
        places = _places_on(here, orbit, Outputs((formula,), ()).extremes(here.model, here.values))
        kinds, times = tuple(place.kind for place in places), [place.time for place in places]
        contact = orbit.contact_time
    base = statement_of_family(machine, family)
    stated = event_statement(machine.model, base, family.name, formula, used, kinds)
    known = dict(zip(base.unknowns, point.u, strict=False))
    known |= {names_of_kind(kind)[1]: time for kind, time in zip(kinds, times, strict=True)}
    if "contact_duration" in stated.statement.unknowns and "contact_duration" not in known:
        if contact is None:
            raise NoOrbit("the contact of the orbit at the event does not end, so that it has no time")
        known["contact_duration"] = contact / 2
    return _start(here, condition, stated, base, point, known)


def _side_of(machine: Machine, text: str, level: float) -> int:
    """Whether a formula is a quantity that is least at its place (1) or largest (-1), as `EventCondition` has it."""
    signs = [*COMPOSITION.get(text, {}).values()]
    return -signs[0] if len(signs) == 1 and (level == 0 or machine.units is None) else 0


def _check_variational(machine: Machine) -> None:
    """Raise `InputError` where a derivative by the launch speed has no equation."""
    if machine.model.changes_contact or not flow_of(machine.model.flight, tuple(machine.values)).is_smooth:
        raise InputError(
            f"{' and '.join(VARIATIONAL)} can be followed only for smooth laws and machines that land on one point"
        )


def _places_on(machine: Machine, orbit: Orbit, extremes: Sequence[str]) -> list[Place]:
    """The places of extremes on an orbit; raises `NoOrbit` where there is none."""
    if not extremes:
        return []
    if orbit.contact is None:
        raise no_motion(machine, orbit)
    (found,) = places_of([machine], [orbit], extremes)
    for extreme, place in found.items():
        if place is None:
            raise NoOrbit(f"the orbit at the event has no {ABSENT.get(extreme, extreme)}")
    return [place for place in found.values() if place]


def _of_collapse(machine: Machine, family: Family, point: Point) -> EventStart:
    """The start of a curve of collapses."""
    here, base = machine.with_values(**varied_at(family, point)), statement_of_family(machine, family)
    u = dict(zip(base.unknowns, point.u, strict=False))
    place, speed = map(float, here.model.touchdown(u, here.values))
    side = float(np.sign(speed))
    stated = collapse_statement(machine.model, base, family.name, side)
    known = u | {BARRIER: _barrier(here, stated, place, speed, side)}
    return _start(here, EventCondition(COLLAPSE, ""), stated, base, point, known)


def _barrier(machine: Machine, stated: EventStatement, place: float, speed: float, side: float) -> float:
    """The distance from touchdown to the barrier, where the energy is least and nearly vanishes."""
    flow, p = flow_of(machine.model.contact, tuple(machine.values)), vector(machine.values)
    rest = abs(place) + abs(speed)
    for furthest in BARRIER_SEARCH.furthest:
        distances = np.linspace(0.0, furthest * rest, BARRIER_SEARCH.samples)
        states = np.column_stack([place + side * distances, np.zeros(len(distances))])
        try:
            rates = side * flow.field(states, p)[0][:, 1]
        except FlowError:
            break
        steps = 0.5 * (rates[1:] + rates[:-1]) * np.diff(distances)
        energy = 0.5 * speed**2 + np.append(0.0, np.cumsum(steps))
        turns = np.flatnonzero((rates[:-1] < 0) & (rates[1:] >= 0))
        if len(turns) and energy[turns[0]] < BARRIER_SEARCH.energy_left * energy.max():
            return float(distances[turns[0]])
    raise NoOrbit("the contact comes close to rest at no place: its collapse is not a barrier")


def _start(
    machine: Machine, condition: EventCondition, stated: EventStatement, base: Statement, point: Point,
    known: Mapping[str, float],
) -> EventStart:  # fmt: skip
    """The start of a curve at a point of a family of orbits with a statement, from known unknowns by name."""
    own = slice(len(base.unknowns) - len(base.tuned), len(base.unknowns))
    sizes = np.maximum(np.abs(point.u), np.abs(point.tangent[:-1]))[own]
    return EventStart(machine, condition, stated, _completed(machine, stated, known, point.value), sizes, point.family)


def _completed(machine: Machine, stated: EventStatement, known: Mapping[str, float], first: float) -> np.ndarray:
    """The unknowns (n,) of a statement, with the `first` parameter last: unknowns that are values follow from the
    others."""
    names = stated.statement.unknowns
    x = np.array([*(known.get(name, 0.0) for name in names[:-1]), first])
    if stated.rows:
        equations = shooting_equations(
            stated.statement, tuple(dict.fromkeys((*machine.values, *stated.statement.tuned)))
        )
        residual = equations.evaluate(x, values_of(machine, equations.parameters)).residual
        x[[names.index(name) for name in stated.rows]] = residual[[*stated.rows.values()]]
    return x
