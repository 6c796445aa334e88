"""Follow an event of a family in two parameters: where admissibility is lost, a quantity has a value, a fold."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..design.design_point import no_motion
from ..design.design_quantities import ABSENT, COMPOSITION, FRICTION_LEFT, VARIATIONAL, base_statement, extremes_of
from ..design.event_statement import (
    BARRIER,
    EventStatement,
    collapse_statement,
    event_statement,
    names_of_kind,
)
from ..design.extremes import Kind, Place, places_of
from ..design.problem import Outputs, known_formula, names_along
from ..design.sensitivities import quantities
from ..errors import FlowError, InputError, NoOrbit, finite_number, whole_number
from ..flow.flow import flow_of
from ..model.machine import Machine
from ..model.phase import Statement
from ..periodic.certificate import Certificate
from ..periodic.certified import orbit_from
from ..periodic.orbit import Orbit
from ..running import interrupts
from ..running.exclusive import exclusive
from ..shooting.formulations import vector
from ..shooting.single_shooting import shooting_equations
from ..simulation.lossless_hops import CROSSINGS
from ..symbolic.formula import Formula, parse, suggest
from ..units import without_units
from .checkpoint import collect_family
from .curve import TEST_FUNCTIONS, check_followed
from .event_curve import COLLAPSE, LIMITS, EventCondition, EventCurve, EventTracer
from .family import Family
from .follow import bounds_of, start_tracer
from .point import End, Event, Point, point_in_units
from .step_control import OTHER_EVENTS, Options, StepControl, checked_options
from .table import names_of_motions
from .tuned_curve import equations_of_family, values_of

# How the name of an event begins along which a quantity is stationary.
EXTREMUM = "extremum of "
# Why other events are not followed.
NOT_FOLLOWED = {
    "branch point": "two equations hold at it, so that it is isolated in two parameters; where a symmetry holds one of "
    "them, follow_branch_points follows it",
    "law ends": "beyond it there is no motion on one side of which its equation could be solved",
    "family": "the number of a family is counted, and is no equation",
    "value": "the parameter has one value on it: follow(machine, second) goes along it",
}
# Samples of the energy over the places of a contact, in which its barrier is searched, up to these multiples of the
# distance from touchdown to the place of rest; and the largest share of the energy at rest that is left there.
BARRIER_SAMPLES, FURTHEST_BARRIER, ENERGY_LEFT = 4000, (2.0, 8.0, 64.0), 0.2
# A number of the certificate that is larger where its event is located changes its sign by a jump.
JUMPS = 1e-6
# Values that differ by a larger share are taken at another place of the motion.
SAME_VALUE = 1e-7


class EventStart(NamedTuple):
    """Where a curve of events begins: the machine there, its condition, the statement, a guess of the unknowns (n,),
    and the sizes (t,) of the tuned parameters there, or of their changes along the family."""

    machine: Machine
    condition: EventCondition
    stated: EventStatement
    x: np.ndarray
    tuned_sizes: np.ndarray


@exclusive
def follow_event(
    family: Family,
    event: Event | str | Mapping[str, float],
    second: str,
    stop: float | tuple[float, float],
    *,
    number: int = 0,
    within: tuple[float, float] | None = None,
    at: Sequence[float] = Options.at,
    longest: float = Options.longest,
    most: int = Options.most,
    stop_inadmissible: bool = Options.stop_inadmissible,
    locate: bool = True,
    step_control: StepControl = Options.step_control,
    output: str | Path | None = None,
) -> Family:
    """Follow an event of a family as a second parameter goes to `stop`: a curve in two parameters.

    family : as `follow` returns it, or as it is loaded with its machine
    event : one of `family.events` or its kind: "fold", "grazing", "masses touch", "contact pulls", "landing jerk",
        "collapse", "foot lifts", "foot slides", "multiplier 1", "flip", "Neimark-Sacker"; or a formula of quantities
        and parameters with its value, as {"clearance": 0.1}; or where a formula is stationary along the family, as
        "extremum of alpha"
    second : name of the second parameter, which begins at the machine's own value
    stop : its last value, or a pair of bounds, as in `follow`
    number : of the event among those of its kind, from 0 in order along the family
    within : bounds of the family's own parameter, where the curve ends too
    locate : whether to locate the events of the curve
    at, longest, most, stop_inadmissible, step_control, output : as in `follow`

    Returns a `Family` along `second`, whose points have the value of the family's own parameter too (`column`), with
    the events of the curve: "fold" where `second` turns round, which on a curve of folds is a cusp, those of orbits by
    other conditions, and "another place" where the quantity has its value at two places of the motion, beyond which it
    is not that of the orbit. The condition itself does not make its points inadmissible. Raises `InputError` for an
    event that is no equation, and `NoOrbit` where there is none.

    >>> from orbits import follow, follow_event
    >>> from problems import Hopper
    >>> machine = Hopper("r + beta*r**3", rest_length=9.0, parameters={"beta": 0.2})
    >>> family = follow(machine, "beta", -0.006)
    >>> touch = follow_event(family, "masses touch", "rest_length", 8.5, longest=0.1)
    >>> round(float(touch.column("beta")[-1]), 6), touch.end.kind
    (-0.003441, 'reached')
    """
    if not isinstance(family, Family):
        if (own := getattr(family, "follow_event", None)) is None:
            raise InputError("an event is one of a family that `follow` returns")
        if number or within is not None or stop_inadmissible or not locate:
            raise InputError("number, within, stop_inadmissible and locate belong to families: leave them out")
        return own(event, second, stop, at=at, longest=longest, most=most, step_control=step_control, output=output)
    options = checked_options(at, None, longest, most, stop_inadmissible, step_control)
    return collected(run_along_event(family, event, second, stop, number, within, locate, options), output)


def run_along_event(
    family: Family, event: Event | str | Mapping[str, float], second: str, stop: float | tuple[float, float],
    number: int, within: tuple[float, float] | None, locate: bool, options: Options,
) -> EventTracer:  # fmt: skip
    """A run along the curve of an event of a family, with arguments as in `follow_event`."""
    machine = family.source
    if machine is None:
        raise InputError("this family does not know its machine: load it by Family.load(path, machine)")
    check_followed(machine, second)
    if family.settings.get("event"):
        raise InputError("events of curves of events are located, and not followed")
    if second in (family.name, *_statement(machine, family).tuned):
        what = "lies at a value of" if second == family.name else "is on a family that tunes"
        raise InputError(f"the event {what} {second}: it is followed along another parameter")
    if within is not None:
        within = bounds_within(family.name, within)
    for bound in bounds_of(second, machine.values[second], stop, options.at):
        machine.with_values(**{second: bound})  # an impossible machine is refused before the search
    with interrupts.deferred(), without_units(machine.units):
        begun = _begun(machine, family, event, whole_number("number", number, least=0))
    first = float(begun.x[-1])
    if within is not None and not within[0] <= first <= within[1]:
        raise InputError(f"within = ({within[0]:g}, {within[1]:g}): the curve begins at {family.name} = {first:.10g}")
    names = family.settings["method"], family.name, second
    return _tracer(*names, stop, begun, options, within, locate, _tuned(family))


def collect_event(
    method: str, along: str, second: str, stop: Any, begun: EventStart, options: Options,
    tuned: tuple[str, ...] = (), output: str | Path | None = None,
) -> Family:  # fmt: skip
    """The curve of an event of a family along a parameter, from its start on."""
    return collected(_tracer(method, along, second, stop, begun, options, None, True, tuned), output)


def _tracer(
    method: str, along: str, second: str, stop: Any, begun: EventStart, options: Options,
    within: tuple[float, float] | None, locate: bool, tuned: tuple[str, ...],
) -> EventTracer:  # fmt: skip
    """A run along the curve of an event from its start on."""
    machine, start = begun.machine, begun.machine.values[second]
    behind, stop = bounds_of(second, start, stop, options.at)
    if begun.condition.stationary:  # second derivatives, and their differences, grow as powers of first ones
        control = options.step_control
        growth = max(control.largest_amplification ** (1 / 3), 10.0)
        options = replace(options, step_control=replace(control, largest_amplification=growth))
    of_family = tuned, begun.tuned_sizes, float(begun.x[-1])
    curve = EventCurve(
        machine, along, second, method, abs(stop - behind), begun.stated, begun.condition, *of_family, within, locate
    )
    try:
        tracer = start_tracer(curve, np.append(begun.x, start), start, behind, stop, options, EventTracer)
    except (NoOrbit, FlowError) as error:
        name = begun.condition.name
        raise NoOrbit(f"the curve of '{name}' does not begin at {along} = {begun.x[-1]:.10g}: {error}") from None
    assert isinstance(tracer, EventTracer)
    return tracer


def collected(tracer: EventTracer, output: str | Path | None = None) -> Family:
    """The curve that a run finds."""
    return _at_its_place(collect_family(tracer, output=output), tracer.curve.condition)


def start_of_fold(machine: Machine, base: Statement, point: Point, along: str) -> EventStart:
    """The start of a curve of folds."""
    return _of_orbit(machine, base, point, along, EventCondition(f"fold in {along}", along, None))


def _of_orbit(machine: Machine, base: Statement, point: Point, along: str, condition: EventCondition) -> EventStart:
    """The start of a curve whose condition says something of the equations of an orbit."""
    stated = event_statement(machine.model, base, along, parse(along), (), ())
    known = dict(zip(base.unknowns, point.u, strict=False))
    return _start(machine, condition, stated, base, point, known)


def _start(
    machine: Machine, condition: EventCondition, stated: EventStatement, base: Statement, point: Point,
    known: Mapping[str, float],
) -> EventStart:  # fmt: skip
    """The start of a curve at a point of a family of orbits with a statement, from known unknowns by name."""
    own = slice(len(base.unknowns) - len(base.tuned), len(base.unknowns))
    sizes = np.maximum(np.abs(point.u), np.abs(point.tangent[:-1]))[own]
    return EventStart(machine, condition, stated, _completed(machine, stated, known, point.value), sizes)


def bounds_within(name: str, within: tuple[float, float]) -> tuple[float, float]:
    """Bounds that ascend; raises `InputError` for others."""
    if not isinstance(within, tuple | list) or len(within) != 2:
        raise InputError(f"within = {within!r}; it is a pair of bounds of {name}")
    low, high = (finite_number("within", bound) for bound in within)
    if not low < high:
        raise InputError(f"within = ({low:g}, {high:g}): the first bound of {name} lies below the second")
    return low, high


def _begun(machine: Machine, family: Family, event: Event | str | Mapping[str, float], number: int) -> EventStart:
    """Where the curve of an event of a family begins."""
    if isinstance(event, Mapping):
        if len(event) != 1:
            raise InputError(f"event = {dict(event)!r}: it is one formula with its value")
        ((text, value),) = event.items()
        formula = _known(machine, text)
        level = finite_number(f"event '{text}'", value)
        condition = EventCondition(f"{text} = {level:.10g}", text, level, place=_side_of(machine, text, level))
        return _of_formula(machine, family, _crossing(machine, family, formula, level, number), formula, condition)
    if isinstance(event, str) and event.startswith(EXTREMUM):
        formula = _known(machine, event.removeprefix(EXTREMUM))
        condition = EventCondition(event, formula.text, None)
        return _of_formula(machine, family, _turn(machine, family, formula, number), formula, condition)
    found = _event_of(family, event, number)
    own, here = _bare(machine, family, found.point), machine.with_values(**family._varied(found.point))
    if found.kind == "fold":
        return start_of_fold(here, _statement(machine, family), own, family.name)
    if found.kind in CROSSINGS:
        condition = EventCondition(found.kind, family.name, None, crossing=found.kind)
        return _of_orbit(here, _statement(machine, family), own, family.name, condition)
    if found.kind == COLLAPSE:
        return _of_collapse(machine, family, own)
    limits = {kind: text for text, (kind, _) in LIMITS.items()}
    if found.kind not in limits:
        known = ", ".join(["fold", COLLAPSE, *limits, *CROSSINGS])
        reason = NOT_FOLLOWED.get(found.kind, "of a function that is watched no derivatives are known: state a formula")
        raise InputError(f"a curve of '{found.kind}' is not followed: {reason}; those of {known} are")
    text = limits[found.kind]
    size = getattr(own, text) if text in Certificate.__dataclass_fields__ else 0.0
    if size is None or abs(size) > JUMPS:  # on one side the contact turns back before a barrier, on the other beyond it
        return _of_collapse(machine, family, own)
    condition = EventCondition(found.kind, text, 0.0, place=_side_of(machine, text, 0.0))
    return _of_formula(machine, family, own, _known(machine, text), condition)


def _event_of(family: Family, event: Event | str, number: int) -> Event:
    """An event of a family."""
    if isinstance(event, Event):
        place = event.kind, event.point.value, event.point.u
        if all((each.kind, each.point.value, each.point.u) != place for each in family.events):
            where = f"{family.name} = {event.point.value:.10g}"
            raise InputError(f"the event '{event.kind}' at {where} is none of this family: take one of family.events")
        return event
    found = [each for each in family.events if each.kind == event]
    if number < len(found):
        return found[number]
    counts = Counter(each.kind for each in family.events)
    here = ", ".join(f"{count} '{kind}'" for kind, count in counts.items()) or "none"
    if found:
        raise NoOrbit(f"number = {number}: the family has {here}, and the first is number 0")
    machine, known = family.source, [*TEST_FUNCTIONS, *OTHER_EVENTS, *counts]
    if event in CROSSINGS and "multipliers" not in family.settings:
        here += f"; a '{event}' is located by follow(..., multipliers=True)"
    elif event not in known:
        if machine and event in names_along(machine):
            text = f"'{event}' is no event: a quantity is followed at a value, as {{'{event}': 0.1}}, or where it is"
            raise InputError(f"{text} stationary along the family, as '{EXTREMUM}{event}'")
        near = suggest(event, known)
        raise InputError(f"there is no event '{event}'{near}{'' if near.endswith('?') else '.'} The family has {here}")
    raise NoOrbit(f"the family has no event '{event}'; it has {here}")


def _known(machine: Machine, text: object) -> Formula:
    """A formula of the quantities and parameters of a machine."""
    if not isinstance(text, str):
        raise InputError(f"event = {text!r}; it is a kind of event, or a formula of quantities with its value")
    formula = known_formula(text, names_along(machine), "the event")
    if not formula.names:
        raise InputError(f"the event '{text}' says nothing of the orbit or the machine")
    return formula


def _side_of(machine: Machine, text: str, level: float) -> int:
    """Whether a formula is a quantity that is least at its place (1) or largest (-1), as `EventCondition` has it."""
    signs = [*COMPOSITION.get(text, {}).values()]
    return -signs[0] if len(signs) == 1 and (level == 0 or machine.units is None) else 0


def _values_along(machine: Machine, family: Family, formula: Formula) -> np.ndarray:
    """The values (m,) of a formula at the points of a family."""
    here = [machine.with_values(**family._varied(point)) for point in family.points]
    known, used = {*family._numbers_of(family.points), *names_of_motions(machine)}, _quantities(machine, formula)
    values = {name: family.column(name) for name in used if name in known}
    if FRICTION_LEFT in used and machine.model.planar and machine.model.planar.friction:
        stated = np.array([machine.model.planar.friction(own.values) for own in here])
        values[FRICTION_LEFT], known = stated - family.column("friction_needed"), known | {FRICTION_LEFT}
    if missing := [name for name in used if name not in known]:
        method, each = family.settings["method"], list[list[float]]()
        for own, point in zip(here, family.points, strict=True):
            bare = _bare(machine, family, point)
            try:
                found = quantities(own, orbit_from(own, method, point.u, bare.error), missing)
                each.append([found[name] for name in missing])
            except NoOrbit:
                each.append([np.nan] * len(missing))
        values |= dict(zip(missing, np.transpose(each), strict=True))
    values |= {name: np.array([own.values[name] for own in here]) for name in formula.names if name not in values}
    return formula(**{name: values[name] for name in formula.names})


def _quantities(machine: Machine, formula: Formula) -> list[str]:
    """The quantities that a formula uses."""
    return Outputs((formula,), ()).quantities(machine.model, machine.values)


def _crossing(machine: Machine, family: Family, formula: Formula, level: float, number: int) -> Point:
    """A dimensionless point of a family next to where a formula passes a value."""
    values = _values_along(machine, family, formula) - level
    if (values == values[0]).all():
        raise InputError(f"'{formula.text}' is the same all along the family, {values[0] + level:.10g}")
    with np.errstate(invalid="ignore"):
        found = np.flatnonzero(values[:-1] * values[1:] <= 0)
    if not 0 <= number < len(found):
        if not np.isfinite(values).any():
            raise NoOrbit(f"'{formula.text}' has no value at any orbit of the family")
        low, high = (float(each(values)) + level for each in (np.nanmin, np.nanmax))
        raise NoOrbit(
            f"'{formula.text}' passes {level:g} along the family {len(found)} times: it lies between {low:.6g} and "
            f"{high:.6g}"
        )
    i = int(found[number])
    return _bare(machine, family, family[i if abs(values[i]) <= abs(values[i + 1]) else i + 1])


def _turn(machine: Machine, family: Family, formula: Formula, number: int) -> Point:
    """A dimensionless point of a family next to where a formula is stationary."""
    values = _values_along(machine, family, formula)
    rises = np.diff(values)
    found = np.flatnonzero(rises[:-1] * rises[1:] < 0) + 1
    if not 0 <= number < len(found):
        raise NoOrbit(f"'{formula.text}' has {len(found)} extrema inside the family, and none of number {number}")
    return _bare(machine, family, family[int(found[number])])


def _bare(machine: Machine, family: Family, point: Point) -> Point:
    """A point of a family without dimensions."""
    units = machine.with_values(**family._varied(point)).units
    return point_in_units(point, units and units.inverse())


def _statement(machine: Machine, family: Family) -> Statement:
    """The statement of the family's orbits."""
    return equations_of_family(machine, family.settings["method"], family.name, _tuned(family)).statement


def _tuned(family: Family) -> tuple[str, ...]:
    """The names of the tuned parameters of a family."""
    return tuple(family.settings.get("tune", ()))


def _of_formula(
    machine: Machine, family: Family, point: Point, formula: Formula, condition: EventCondition
) -> EventStart:  # fmt: skip
    """The start of a curve on which a formula has a value or is stationary."""
    here = machine.with_values(**family._varied(point))
    used = tuple(_quantities(here, formula))
    kinds: tuple[Kind, ...] = ()
    times, contact = list[float](), None
    if used:
        if not _tuned(family):
            base_statement(machine.model)  # refuses machines whose orbits are not their own mirror images
        if "landing_sensitivity" in used or "loss_coefficient" in used:
            _check_variational(machine)
        orbit = orbit_from(here, family.settings["method"], point.u, point.error).dimensionless()
        places = _places_on(here, orbit, Outputs((formula,), ()).extremes(here.model, here.values))
        kinds, times = tuple(place.kind for place in places), [place.time for place in places]
        contact = orbit.contact_time
    base = _statement(machine, family)
    stated = event_statement(machine.model, base, family.name, formula, used, kinds)
    known = dict(zip(base.unknowns, point.u, strict=False))
    known |= {names_of_kind(kind)[1]: time for kind, time in zip(kinds, times, strict=True)}
    if "contact_duration" in stated.statement.unknowns and "contact_duration" not in known:
        if contact is None:
            raise NoOrbit("the contact of the orbit at the event does not end, so that it has no time")
        known["contact_duration"] = contact / 2
    return _start(here, condition, stated, base, point, known)


def _check_variational(machine: Machine) -> None:
    """Raise `InputError` where a derivative by the launch speed has no equation."""
    if machine.model.changes_contact or machine.model.flight.pieces:
        raise InputError(
            f"{' and '.join(VARIATIONAL)} are followed for smooth laws and for machines that land on one point alone"
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


def _completed(machine: Machine, stated: EventStatement, known: Mapping[str, float], first: float) -> np.ndarray:
    """The unknowns (n,) of a statement, the last of which is the `first` parameter: those that are values follow from
    the others."""
    names = stated.statement.unknowns
    x = np.array([*(known.get(name, 0.0) for name in names[:-1]), first])
    if stated.rows:
        equations = shooting_equations(
            stated.statement, tuple(dict.fromkeys((*machine.values, *stated.statement.tuned)))
        )
        residual = equations.evaluate(x, values_of(machine, equations.parameters)).residual
        x[[names.index(name) for name in stated.rows]] = residual[[*stated.rows.values()]]
    return x


def _of_collapse(machine: Machine, family: Family, point: Point) -> EventStart:
    """The start of a curve of collapses."""
    here, base = machine.with_values(**family._varied(point)), _statement(machine, family)
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
    for furthest in FURTHEST_BARRIER:
        distances = np.linspace(0.0, furthest * rest, BARRIER_SAMPLES)
        states = np.column_stack([place + side * distances, np.zeros(len(distances))])
        try:
            rates = side * flow.field(states, p)[0][:, 1]
        except FlowError:
            break
        steps = 0.5 * (rates[1:] + rates[:-1]) * np.diff(distances)
        energy = 0.5 * speed**2 + np.append(0.0, np.cumsum(steps))
        turns = np.flatnonzero((rates[:-1] < 0) & (rates[1:] >= 0))
        if len(turns) and energy[turns[0]] < ENERGY_LEFT * energy.max():
            return float(distances[turns[0]])
    raise NoOrbit("the contact has no place near which it would come to rest: its collapse is no barrier")


def _at_its_place(family: Family, condition: EventCondition) -> Family:
    """The curve up to where its quantity is no longer that of the orbit, since another place of the motion has it."""
    machine = family.source
    formula = parse(condition.text) if condition.text else None
    if not formula or condition.level is None or machine is None or not family.points:
        return family
    used = _quantities(machine, formula)
    if condition.text in Certificate.__dataclass_fields__ or not any(map(extremes_of, used)):
        return family
    off = np.abs(_values_along(machine, family, formula) - condition.level)
    off = off > SAME_VALUE * max(abs(condition.level or 0.0), 1e-3)
    if not off.any():
        return family
    first = int(off.argmax())
    events = tuple(event for event in family.events if event.after < first)
    where = f"near {family.name} = {family.points[first].value:.6g}"
    end = End("stopped", f"{where} another place of the motion takes over: {condition.name} holds at this one alone")
    return replace(family, points=family.points[:first], events=events, end=end)
