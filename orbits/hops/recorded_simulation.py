"""A simulation from recorded arcs: its legs, integrated once more between their known ends, and its events."""

from typing import TypeAlias, cast

import numpy as np

from ..errors import FlowError
from ..model import Machine
from ..units import TIME, Message, Quantity
from .arcs import Arcs, Flown, Rules, integrated
from .hysteresis import Branches
from .impacts import Impacts, status_of_failure
from .points_of_contact import unheld
from .simulated import ContactEvent, Leg, Simulation
from .sticking_contact import FALLS, SLIPS

# An event: the rules there, its kind and time, the states before and after it, its loss, None where the energies show
# it, and the name of the foot.
_Event: TypeAlias = tuple[Impacts, str, float, np.ndarray, np.ndarray, float | None, str]


def recorded(machine: Machine, rules: Rules, hops: Flown, launch: float | None, foothold: float) -> Simulation:
    """The simulation of a machine whose arcs are recorded, from a launch with this speed if it began with one.

    foothold : the place along the ground where what sticks begins

    Raises `InputError` where the branches of a spring with hysteresis are crossed.
    """
    legs, events = list[Leg](), list[_Event]()
    speeds, stance, arcs = [] if launch is None else [launch], 0, hops.arcs
    status, reason, last = str(hops.status[0]), hops.reasons.get(0, ""), float(hops.now[0])
    for arc, again in zip(arcs, integrated(arcs), strict=True):
        impacts, now, before, after = arc.impacts, float(arc.begun[0]), arc.ends[0], arc.after[0]
        (kind,) = np.broadcast_to(arc.kind, 1).tolist()
        if isinstance(again, FlowError):
            status, reason, last = status_of_failure(again, arc.phase.flow.phase.name), again.args[0], now
            break
        if again is not None:
            path, _ = again
            if isinstance(rules, Branches):
                rules.check_width(path.coefficients[:, : arc.phase.flow.size, 0], arc.phase.contact)
            contact, side = arc.phase.contact, arc.phase.side if isinstance(rules, Branches) else None
            name = "contact" if contact else "flight"
            legs.append(Leg(name, now, path, branch=side, stance=stance, foothold=foothold))
            if not contact:
                for when, how in unheld(impacts.model, path, arc.phase.impacts.values):
                    state = path(when)[: impacts.flight.size]
                    events.append((impacts, how, now + when, state, state, 0.0, "standing foot"))
        end, name, loss = now + (0.0 if again is None else float(arc.durations[0])), "", cast("float | None", 0.0)
        if arc.landed is not None:
            name, step = impacts.feet[int(arc.foot[0])].name, int(arc.landed.step[0])
            end, lost = end + float(arc.landed.wait[0]), float(arc.landed.loss[0])
            foothold, stance = foothold + impacts.footing.moved(before, after), stance + step
            let_go = impacts.model.grazes and arc.landed.order[0] == 1  # whose loss is that of all of the energy
            if step and impacts.descends and not let_go:  # on a slope the next foot stands lower
                label = impacts.model.relabelling
                other = (label.inverse if step > 0 else label)(after, impacts.values)
                lost += float(-np.diff(impacts.energies(np.array([other, after])))[0])
            loss = lost
        elif kind == "lift-off":
            name, loss, stance = impacts.feet[arc.foot].name, None, stance + arc.step
            foothold += impacts.footing.moved(before, after)
            speeds.append(arc.speed)
        elif kind == FALLS:
            name = impacts.footing.fallen(before, arc.phase.contact)
        if kind:
            events.append((impacts, kind, end, before, after, loss, name))
    if status in (FALLS, SLIPS):
        reason = _reason_of_fall(events[-1], last) if status == FALLS else _reason_of_slip(arcs[-1], last)
    found = _with_energies(rules, events)
    return Simulation(tuple(legs), found, status, np.array(speeds), last, machine, reason)


def _with_energies(rules: Rules, events: list[_Event]) -> tuple[ContactEvent, ...]:
    """The events with their energies, by the mean law of a spring with hysteresis, and the losses that these show."""
    by = [rules.mean if isinstance(rules, Branches) else event[0] for event in events]
    energies = np.full((len(events), 2), np.nan)
    for impacts in {id(each): each for each in by}.values():
        own = [(i, k) for i, each in enumerate(by) if each is impacts for k in range(1 + (events[i][5] is None))]
        energies[tuple(zip(*own, strict=True))] = impacts.energies(np.array([events[i][3 + k] for i, k in own]))
    found = list[ContactEvent]()
    for (_, kind, time, before, after, loss, name), (first, last) in zip(events, energies.tolist(), strict=True):
        found.append(ContactEvent(kind, time, before, after, first, first - last if loss is None else loss, name))
    return tuple(found)


def _reason_of_fall(event: _Event, now: float) -> Message:
    impacts, name = event[0], event[-1]
    where = "" if name in impacts.footing.heights else ", while another point stands"
    text = "the {name} falls to the ground at t = {time:.6g}{where}"
    return Message(text, name=name, time=Quantity(now, TIME), where=where)


def _reason_of_slip(arc: Arcs, now: float) -> Message:
    how = "" if arc.phase.contact else " as it lands"
    text = "the foot slips{how} at t = {time:.6g}: slipping is not simulated"
    return Message(text, how=how, time=Quantity(now, TIME))
