"""Follow an event of a family in two parameters: where admissibility is lost, a quantity has a value, a fold."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..design import extremes_of
from ..errors import FlowError, InputError, NoOrbit, range_of, whole_number
from ..periodic import Certificate, another_family
from ..result import Progress
from ..running import exclusive, interrupts
from ..symbolic import parse
from ..units import without_units
from .both_ways import both_ways
from .checkpoint import check_output, collect_family
from .curve import check_followed
from .event_curve import EventCondition, EventCurve, EventEndings
from .event_place import quantities_used, statement_of_family, tuned_of_family
from .event_start import EventStart, event_start
from .family import Family
from .family_run import FamilyRun
from .follow import bounds_of, is_range, start_run
from .point import End, Event
from .step_control import Options, StepControl, checked_options

# Values that differ by a larger share are taken at another place of the motion.
SAME_VALUE = 1e-7


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
        and parameters with its value, such as {"clearance": 0.1}; or "extremum of" a formula, such as "extremum of
        alpha", where it is stationary along the family
    second : name of the second parameter, which begins at the machine's own value
    stop : its last value, or a range around it, as in `follow`
    number : index of the event among those of its kind, from 0 in order along the family
    within : bounds of the family's own parameter, at which the curve ends
    locate : whether to locate events on the curve
    at, longest, most, stop_inadmissible, step_control, output : as in `follow`

    Returns a `Family` along `second`, whose points also have the value of the family's own parameter (`column`). Its
    events are a "fold" where `second` turns round, which is a cusp on a curve of folds; the events of orbits by other
    conditions; and "another place", beyond which the extreme of the motion lies elsewhere. The condition itself does
    not make its points inadmissible. Raises `InputError` for an event that has no equation, and `NoOrbit` where there
    is no such event.

    >>> from orbits import follow, follow_event
    >>> from problems import Hopper
    >>> machine = Hopper("r + beta*r**3", rest_length=9.0, parameters={"beta": 0.2})
    >>> family = follow(machine, "beta", -0.006)
    >>> touch = follow_event(family, "masses touch", "rest_length", 8.5, longest=0.1)
    >>> round(float(touch.column("beta")[-1]), 6), touch.end.kind
    (-0.003441, 'reached')
    """
    check_output(output)
    if not isinstance(family, Family):
        if (own := getattr(family, "follow_event", None)) is None:
            raise InputError("the event must come from a family that `follow` returns")
        if number or within is not None or stop_inadmissible or not locate:
            raise InputError("number, within, stop_inadmissible and locate belong to families: leave them out")
        return own(event, second, stop, at=at, longest=longest, most=most, step_control=step_control, output=output)
    options = checked_options(at, None, longest, most, stop_inadmissible, step_control)

    def begun(stop: Any, _: Family | None = None) -> FamilyRun:
        return run_along_event(family, event, second, stop, number, within, locate, options)

    if is_range(stop):
        return both_ways(begun, stop, collected, None, output)
    return collected(begun(stop), None, output)


def run_along_event(
    family: Family, event: Event | str | Mapping[str, float], second: str, stop: float | tuple[float, float],
    number: int, within: tuple[float, float] | None, locate: bool, options: Options,
) -> FamilyRun:  # fmt: skip
    """A run along the curve of an event of a family, with arguments as in `follow_event`."""
    machine = family.source
    if machine is None:
        raise InputError("this family does not know its machine: load it by Family.load(path, machine)")
    check_followed(machine, second)
    if family.settings.get("event"):
        raise InputError("events on curves of events are located, but cannot be followed")
    if second in (family.name, *statement_of_family(machine, family).tuned):
        what = "lies at a value of" if second == family.name else "is on a family that tunes"
        raise InputError(f"the event {what} {second}: follow it along another parameter")
    if within is not None:
        within = range_of("within", within)
    for bound in bounds_of(second, machine.values[second], stop, options.at):
        machine.with_values(**{second: bound})  # an impossible machine is refused before the search
    with interrupts.deferred(), without_units(machine.units):
        begun = event_start(machine, family, event, whole_number("number", number, least=0))
    first = float(begun.x[-1])
    if within is not None and not within[0] <= first <= within[1]:
        raise InputError(f"within = ({within[0]:g}, {within[1]:g}): the curve begins at {family.name} = {first:.10g}")
    names = family.settings["method"], family.name, second
    return _run(*names, stop, begun, options, within, locate, tuned_of_family(family))


def collect_event(
    method: str, along: str, second: str, stop: Any, begun: EventStart, options: Options,
    tuned: tuple[str, ...] = (), output: str | Path | None = None,
) -> Family:  # fmt: skip
    """The curve of an event of a family along a parameter, from its start on."""
    return collected(_run(method, along, second, stop, begun, options, None, True, tuned), None, output)


def _run(
    method: str, along: str, second: str, stop: Any, begun: EventStart, options: Options,
    within: tuple[float, float] | None, locate: bool, tuned: tuple[str, ...],
) -> FamilyRun:  # fmt: skip
    """A run along the curve of an event from its start on."""
    machine, start = begun.machine, begun.machine.values[second]
    behind, stop = bounds_of(second, start, stop, options.at)
    of_family = tuned, begun.tuned_sizes, float(begun.x[-1])
    curve = EventCurve(
        machine, along, second, method, abs(stop - behind), begun.stated, begun.condition, *of_family, within, locate
    )
    try:
        curve, x = curve.begun_near(np.append(begun.x, start))
        run = start_run(curve, x, start, behind, stop, options, kind=EventEndings)
        if curve.division and run.point.family != begun.family:
            raise NoOrbit(another_family(begun.family, run.point.family))
    except (NoOrbit, FlowError) as error:
        name = begun.condition.name
        raise NoOrbit(f"the curve of '{name}' does not begin at {along} = {begun.x[-1]:.10g}: {error}") from None
    return run


def collected(
    run: FamilyRun, resume: Family | None = None, output: str | Path | None = None, progress: Progress = None
) -> Family:
    """The curve that a run finds."""
    assert isinstance(run.curve, EventCurve)
    return _at_its_place(collect_family(run, resume, output, progress), run.curve.condition)


def _at_its_place(family: Family, condition: EventCondition) -> Family:
    """The curve up to where its quantity is no longer that of the orbit, since another place of the motion has it."""
    machine = family.source
    formula = parse(condition.text) if condition.text else None
    if not formula or condition.level is None or machine is None or not family.points:
        return family
    used = quantities_used(machine, formula)
    if condition.text in Certificate.__dataclass_fields__ or not any(map(extremes_of, used)):
        return family
    off = np.abs(family.values_at(family.points, formula.text) - condition.level)
    off = off > SAME_VALUE * max(abs(condition.level or 0.0), 1e-3)
    if not off.any():
        return family
    first = int(off.argmax())
    events = tuple(event for event in family.events if event.after < first)
    where = f"near {family.name} = {family.points[first].value:.6g}"
    end = End(
        "stopped",
        f"{where} the condition passes to another place of the motion: {condition.name} holds at this one only",
    )
    return replace(family, points=family.points[:first], events=events, end=end)
