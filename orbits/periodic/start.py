"""What a start states: the unknowns of half an orbit by name, or an orbit nearby."""

from collections.abc import Mapping
from pathlib import Path
from typing import TypeAlias

from ..errors import InputError, finite_number
from ..model import STEP_LENGTH, Machine, Model, refuse_hysteresis, refuse_one_way
from ..units import TIME, Message, Quantity
from .linear_hops import LinearSearch
from .orbit import Orbit

# An orbit nearby, the unknowns of a half orbit by name, or the name of a file of an orbit.
StartLike: TypeAlias = Orbit | Mapping[str, float] | str | Path
# A start with a longer time than this describes no machine in its own units, and would take long to integrate.
LONGEST_START = 1e4


def check_start(machine: Machine, start: object) -> None:
    """Raise `InputError` where there is no start and no family of the machine's orbits can be found without one, and
    `NoOrbit` for a spring with hysteresis."""
    model = machine.model
    refuse_hysteresis(model)
    refuse_one_way(model)
    if LinearSearch.finds_families(machine):
        return
    if start is None and model.conservative and not (model.is_guessed or model.search):
        raise InputError(
            f"no guess of the families of a {model.name} is known: give an orbit of it as start="
            + ("" if model.one_speed or model.sticks else ", such as one of find_all(machine, starts(machine))")
        )


def unknowns_of_start(machine: Machine, orbit: Orbit) -> dict[str, float]:
    """The unknowns of a machine's orbit by name, in the machine's units: a start that leads back to it."""
    bare, names = stated_unknowns(machine.model, orbit), {*machine.model.half_unknowns, "contact_duration", STEP_LENGTH}
    return in_units_of(machine, {name: value for name, value in bare.items() if name in names})


def in_units_of(machine: Machine, unknowns: Mapping[str, float]) -> dict[str, float]:
    """Unknowns without dimensions by name, in the machine's units."""
    return {name: value * (machine.units.of(name) if machine.units else 1.0) for name, value in unknowns.items()}


def stated_unknowns(model: Model, start: Orbit | Mapping[str, float]) -> dict[str, float]:
    """The unknowns that a start states, by name; raises `InputError` for an invalid start."""
    if isinstance(start, Orbit):
        start = start.dimensionless()
        if (states := start.flight.names[: len(start.shape.embed)]) != model.flight.states:
            raise InputError(f"start is an orbit of another machine, with the states {', '.join(states)}")
        unknowns = model.launch_at(start.flight.coefficients[0, :, 0].tolist()) | {"alpha": start.alpha}
        unknowns["duration"] = start.flight_time / (2 if start.shape.reversor else 1)
        unknowns["unfolding"] = start.certificate.unfolding or 0.0
        if model.runs:
            assert start.shape.steps is not None
            unknowns[STEP_LENGTH] = start.shape.steps.reversor_shift[model.flight.states.index(model.sticks[0])]
        return unknowns | ({} if start.contact_time is None else {"contact_duration": start.contact_time / 2})
    if not isinstance(start, Mapping):
        raise InputError(f"start = {start!r}; it must be an orbit, or a mapping of unknowns to numbers")
    # Further unknowns may be stated although not every statement has them.
    further = {"contact_duration", "unfolding", *((STEP_LENGTH,) if model.runs else ())}
    if unknown := [name for name in start if name not in {*model.half_unknowns, *further}]:
        raise InputError(f"start has '{unknown[0]}'; the unknowns are {', '.join(model.half_unknowns)}")
    stated = {"unfolding": 0.0, **{name: finite_number(f"start '{name}'", value) for name, value in start.items()}}
    for name in ("duration", "contact_duration"):
        if not 0 < stated.get(name, 1.0) < LONGEST_START:
            text, times = "start '{name}' = {time:g}; it must lie between 0 and {most:g}", (stated[name], LONGEST_START)
            time, most = (Quantity(number, TIME) for number in times)
            raise InputError(Message(text, name=name, time=time, most=most))
    return stated
