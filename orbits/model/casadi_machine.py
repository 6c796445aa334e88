"""A machine as CasADi functions, for users who state larger problems of their own with it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np

from ..errors import InputError
from ..io import fields_in_line
from ..units import ENERGY, FORCE, LENGTH, TIME
from .casadi_functions import FunctionOptions, Symbols, dimension_of_watched


@dataclass(frozen=True, eq=False, repr=False)
class CasadiMachine:
    """A machine as CasADi functions, made by `machine.casadi()`.

    The arguments are columns: `x` (n,), a flight state; `y` (m,), a contact state; `p` (np,), the parameters; and `e`,
    the coefficient of restitution. Their entries have the names and the order below. No function depends on time.
    Numbers are in the machine's units, so in SI for a machine in SI. Derivatives, `expand` and generated code are those
    of any CasADi function of scalar operations.

    name : of the machine
    states, contact_states : names of the entries of `x` and `y`; a speed has the name of its coordinate with an
        apostrophe, and the displacement or force of an actuator comes last
    parameters, values : names of the entries of `p`, and the machine's own values (np,) of them
    restitution : of the machine, for `e`
    units : the SI units of states, parameters, heights and forces by name, and of "time" and "energy"; empty for a
        machine without units
    flight, contact : (x, p) -> x' and (y, p) -> y', the vector fields of the two phases
    flight_guards : by name, (x, p) -> a number that is above 0 during a flight: "landing" is the gap that closes at
        landing, "fall back", of a machine that steps, the gap of the point that opened last, and "separation" the
        distance within the machine, where it is stated. Of a point that passes the ground in mid-flight "landing" is
        the height, which is 0 there too
    contact_guards : by name, (y, p) -> a number that is above 0 during a contact: "lift-off" is the contact force;
        of a machine that steps "step back" is the force on the point that landed, and "standing gap" the gap of the
        point that lands next; "separation" is as in flight
    resets : by the name of the guard that vanishes, the state after the event. "landing" and "fall back" are
        (x, p, e) -> x, an impact after which the gap's speed is -e times that before, and what sticks is at rest, at
        the place 0 unless the motion depends on it; where the contact force then presses and e = 0 or the speed is 0,
        contact follows, from the state `onto_contact(x)`. "lift-off" and "step back" are (y, p) -> x. "hand-over" is
        (x, p) -> x, a landing with a speed of a machine that stands on one point at all times. After a landing and a
        step back the labels are those of the point that then stands, see `relabelling`
    onto_flight, onto_contact : y -> x and x -> y, the embedding of contact states into flight states and its inverse
    energy, contact_energy : (x, p) and (y, p) -> the energy, counted from rest with the springs unloaded; Gauss
        quadrature along straight ways from there, exact to rounding for laws that are polynomials, also in pieces
    energy_gradient : (x, p) -> its gradient (n,), without quadrature
    landing_loss : (x, p) -> the energy that a plastic landing in the flight state x loses
    flight_forces, contact_forces : by name, (x, p) and (y, p) -> the forces of the springs, tension positive. In
        contact they are followed by the "contact force" and the forces that hold what sticks, and wherever a machine
        with places across stands by those of the ground across and along itself
    heights : by name, (x, p) -> a height above the ground or, without a rest length, above its place at rest
    extension : (x, p) -> the extension that counts the families
    reversor, contact_reversor : (x, p) -> x and (y, p) -> y, the maps that turn motions back in time; None if motions
        cannot be turned back, for example with a damper
    relabelling : (x, p) -> x, the relabelling of a machine that steps after a landing, which makes the next point that
        opens the first one; None if the same point lands and opens
    breakpoints : (x, p) -> distances (k,) of the extension from the places where a law in pieces continues to its next
        piece; None for a smooth law. Beyond the first and the last row of a table its outermost pieces continue
    smoothness : the number of continuous derivatives of the vector fields at the breakpoints, -1 where they jump; None
        where they have all derivatives
    """

    name: str
    states: tuple[str, ...]
    contact_states: tuple[str, ...]
    parameters: tuple[str, ...]
    values: np.ndarray
    restitution: float
    units: Mapping[str, str]
    flight: ca.Function
    contact: ca.Function
    flight_guards: Mapping[str, ca.Function]
    contact_guards: Mapping[str, ca.Function]
    resets: Mapping[str, ca.Function]
    onto_flight: ca.Function
    onto_contact: ca.Function
    energy: ca.Function
    contact_energy: ca.Function
    energy_gradient: ca.Function
    landing_loss: ca.Function
    flight_forces: Mapping[str, ca.Function]
    contact_forces: Mapping[str, ca.Function]
    heights: Mapping[str, ca.Function]
    extension: ca.Function
    reversor: ca.Function | None = None
    contact_reversor: ca.Function | None = None
    relabelling: ca.Function | None = None
    breakpoints: ca.Function | None = None
    smoothness: int | None = None

    def __repr__(self) -> str:
        return fields_in_line(self, "name", "states", "contact_states", "parameters")


def casadi_machine(machine: Any, options: FunctionOptions | None = None) -> CasadiMachine:
    """A machine as CasADi functions; raises `InputError` for one that they cannot state."""
    _refuse(machine)
    model, symbols = machine.model, Symbols(machine)
    options, own = options or FunctionOptions(), machine.values
    energy = symbols.energy(options.panels)
    maps = symbols.maps()
    return CasadiMachine(
        name=model.name,
        states=model.flight.states,
        contact_states=model.contact.states,
        parameters=symbols.names,
        values=_read_only([own[name] for name in symbols.names]),
        restitution=float(machine.restitution),
        units=MappingProxyType(_units_in_words(machine)),
        flight=symbols.rates(model.flight, "x"),
        contact=symbols.rates(model.contact, "y"),
        flight_guards=symbols.flight_guards(),
        contact_guards=symbols.contact_guards(),
        resets=symbols.resets(),
        energy=energy,
        contact_energy=symbols.in_contact("contact_energy", energy),
        flight_forces=symbols.forces(model.flight, "x"),
        contact_forces=symbols.forces(model.contact, "y"),
        smoothness=symbols.smoothness(own, options) if model.flight.pieces else None,
        **maps,
    )


def _refuse(machine: Any) -> None:
    model = machine.model
    if model.hysteretic:
        raise InputError(
            f"the spring of this {model.name} has hysteresis: its force depends on the sign of a rate, and where it "
            "sticks on the past, so that no vector field states it; take the law's `.mean`, or the functions of the "
            "machines with its `.extending` and its `.shortening` law, one for each sign"
        )
    if machine.units is not None and model.units is None:
        raise InputError(
            f"the parameters of this {model.name} have no units, and its results are in SI: take "
            "machine.dimensionless().casadi(), or state it as a Mechanism(..., in_si=True)"
        )


def _read_only(values: Iterable[float]) -> np.ndarray:
    array = np.array([*values], dtype=float)
    array.setflags(write=False)
    return array


def _units_in_words(machine: Any) -> dict[str, str]:
    model, units = machine.model, machine.units
    if units is None:
        return {}
    forces = {name: units.text(model.spring_dimensions.get(name, FORCE)) for name in model.spring_forces}
    watched = {name: units.text(dimension_of_watched(name)) for name in (*model.contact.watch, *model.flight.watch)}
    return {
        **{name: units.text(name) for name in (*model.flight.states, *model.contact.states)},
        **(machine.units_of_parameters() if hasattr(machine, "units_of_parameters") else {}),
        **dict.fromkeys(model.heights(machine.values), units.text(LENGTH)),
        **forces, **watched, "time": units.text(TIME), "energy": units.text(ENERGY),
    }  # fmt: skip
