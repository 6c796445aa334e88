"""The quantities of an orbit that a design may use, and the boundary value statement that determines them.

Names are those of an orbit's JSON document. A quantity is evaluated at one place of the motion, or is made of extremes.
These are located on an orbit by samples; the design statement then has an arc that ends where an extreme is stationary,
so that its value is exact and has derivatives.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ..errors import InputError, NoOrbit
from ..model.machine import Machine
from ..model.model import Model
from ..model.phase import Arc, Phase, Statement
from ..numerics.roots import bracketed_root
from ..periodic.loss_coefficient import by_launch_speed, launch_power, loss_coefficient
from ..periodic.orbit import Orbit
from ..periodic.quantities import DESIGNED
from ..shooting.formulations import half_orbit
from ..symbolic.caches import cached
from ..units import Message, in_units

VARIATIONAL = ("landing_sensitivity", "loss_coefficient")  # these need the variation of the flight with alpha
# The extremes whose sum is a quantity, each with its sign; a rise has one extreme, of its own name.
COMPOSITION = {
    "stroke": {"longest": 1, "shortest": 1},
    "clearance": {"gap": -1},
    "smallest_separation": {"separation": -1},
    "smallest_contact_force": {"force": -1},
    "largest_contact_force": {"peak": 1},
    "largest_spring_force": {"tension": 1},
}
# Extremes for which only local maxima after the start count, and the text of the error for an orbit without one.
ABSENT = {
    "gap": "clearance: the gap has no lowest point inside the flight",
    "force": "smallest_contact_force: the force has no lowest value inside the contact",
}
SAMPLES_PER_STEP = 24  # samples per step of a trajectory by which an extreme is bracketed before it is found exactly


@dataclass(frozen=True)
class Place:
    """The place of an extreme."""

    extreme: str  # its name
    index: int  # that of its function with the largest value
    kind: str  # "start", "middle" or "inside" of half the phase

    def function(self, model: Model) -> tuple[str, Callable]:
        """The phase, "flight" or "contact", and the function (x, p) -> value whose maximum the extreme is."""
        return extreme_of(model, self.extreme)[self.index]


def quantity_names(model: Model, p: Mapping) -> list[str]:
    """The quantities of a model's orbits."""
    missing = [] if model.tension else ["largest_spring_force"]
    missing += [] if model.separation(p) is not None else ["smallest_separation"]
    return [name for name in DESIGNED if name not in missing] + list(model.rises(p))


def extremes_of(name: str) -> tuple[str, ...]:
    """The names of the extremes that a quantity is made of."""
    return (name,) if name.endswith("_rise") else tuple(COMPOSITION.get(name, ()))


@lru_cache(maxsize=256)
def extreme_of(model: Model, name: str) -> tuple[tuple[str, Callable], ...]:
    """The functions of the state whose largest value over the cycle an extreme is, each (x, p) -> value with its phase;
    the extreme is one of those in `COMPOSITION`, or a rise."""

    def over_cycle(function: Callable) -> tuple:
        """A function of the flight state, over flight and contact."""
        embedded = lambda x: [sum((w * v for w, v in zip(row, x, strict=False) if w), 0.0) for row in model.embed]  # noqa: E731
        return ("flight", function), ("contact", lambda x, p: function(embedded(x), p))

    force, tension = model.contact.watch["contact force"], model.tension or (lambda x, p, q: 0.0)
    functions = {
        "longest": over_cycle(lambda x, p: model.extension.at(x)),
        "shortest": over_cycle(lambda x, p: -model.extension.at(x)),
        "gap": (("flight", lambda x, p: -model.gap(p).at(x)),),
        "separation": over_cycle(lambda x, p: -model.separation(p).at(x)),
        "force": (("contact", lambda x, p: -force(x, p, [])),),
        "peak": (("contact", lambda x, p: force(x, p, [])),),
        "tension": over_cycle(lambda x, p: tension(x, p, [])) + over_cycle(lambda x, p: -tension(x, p, [])),
    }
    return functions.get(name) or (("flight", lambda x, p: model.rises(p)[name].at(x)),)


def _value_and_rate(phase, function, x, p):
    """A function of the state and its rate of change along a phase, for a list `x` of scalar symbols."""
    value = ca.SX(function(x, p))
    return value, ca.jacobian(value, ca.vertcat(*x)) @ ca.vertcat(*phase.field(x, p, []))


@cached
def _compiled(model, names, extreme, index):
    """(x, p) -> value of a function of an extreme, and its rate of change along the motion."""
    name, function = extreme_of(model, extreme)[index]
    phase = getattr(model, name)
    x, p = ca.SX.sym("x", len(phase.states)), ca.SX.sym("p", len(names))
    value, rate = _value_and_rate(phase, function, ca.vertsplit(x), dict(zip(names, ca.vertsplit(p), strict=True)))
    return ca.Function("extreme", [x, p], [ca.densify(value), rate])


def without_contact(machine: Machine, orbit: Orbit) -> NoOrbit:
    """The error of a dimensionless orbit of a machine whose contact does not end."""
    return NoOrbit(in_units(Message.joined("; ", orbit.violations), machine.units))


def locate(machine: Machine, orbit: Orbit, name: str) -> tuple[Place, float] | None:
    """The place of an extreme on a machine's dimensionless orbit and its time from the start of the phase, or None if
    there is none.

    Raises `NoOrbit` for a contact that does not end.
    """
    model, p = machine.model, machine.values
    best, largest, data = None, -np.inf, list(p.values())
    for index, (phase, _) in enumerate(extreme_of(model, name)):
        if (path := getattr(orbit, phase)) is None:
            raise without_contact(machine, orbit)
        count = SAMPLES_PER_STEP * len(path.steps)
        t = np.interp(np.arange(count + 1) / SAMPLES_PER_STEP, np.arange(len(path.times)), path.times)
        function = _compiled(model, tuple(p), name, index)
        values = function(path(t)[:, : function.size1_in(0)].T, data)[0].full().ravel()
        candidates = np.arange(len(t))
        if name in ABSENT:
            after = np.append(values[1:], -np.inf)
            candidates = 1 + np.flatnonzero((values[1:] > values[:-1]) & (values[1:] >= after[1:]))
        if not len(candidates):
            continue
        i = int(candidates[np.argmax(values[candidates])])
        if best is None or values[i] > largest:
            # In the middle all functions of positions alone are stationary.
            kind = "start" if i == 0 else "middle" if i >= count - 1 else "inside"
            time = _stationary_time(function, data, path, *t[[i - 1, i + 1]].tolist()) if kind == "inside" else t[i]
            best, largest = (Place(name, index, kind), float(time)), values[i]
    return best


def _stationary_time(function, data, path, low, high):
    """The time between two others at which a function made by `_compiled` is stationary."""
    rate = lambda t: float(function(path(t)[: function.size1_in(0)], data)[1])  # noqa: E731
    return bracketed_root(rate, low, high, rate(low), rate(high))


def extreme_values(model: Model, places: Sequence[Place], u: Mapping, ends: Sequence, p: Mapping) -> dict[str, list]:
    """The values of the extremes at their places, by name; the arguments are those of `expressions`."""
    inside, values = iter(ends[2:]), dict[str, list]()
    for place in places:
        phase, function = place.function(model)
        if place.kind == "inside":
            x = next(inside)
        elif place.kind == "start":
            x = model.launch(u, p) if phase == "flight" else model.touchdown(u, p)
        elif phase == "contact":
            x = ends[1]
        else:
            x = ends[-1] if model.reduction else ends[0][: len(model.flight.states)]
        values.setdefault(place.extreme, []).append(function(x, p))
    return values


def base_statement(model: Model) -> Statement:
    """The simplest statement of a model's orbits."""
    return model.reduction.statement if model.reduction else half_orbit(model)


@lru_cache(maxsize=128)
def design_statement(model: Model, variational: bool, places: tuple[Place, ...]) -> Statement:
    """The statement of an orbit together with its extremes at these places.

    variational : whether the first arc carries its variation with respect to alpha, and the adjoint that takes it back
        over the mirrored half, for the loss coefficient

    Its arcs: half the flight by the simplest statement; half the contact; one to each extreme inside. Its unknowns:
    those of the simplest statement; "contact", half the contact time; "at 0", ..., the times of the places inside.
    Raises `InputError` for a model whose motions are not their own mirror images, or have breakpoints.
    """
    if not model.reversor:
        raise InputError("a design needs a machine whose motion is its own mirror image in time: leave out the damping")
    if model.flight.pieces or model.contact.pieces:
        raise InputError(
            "a law in pieces cannot be designed: it has no second derivatives everywhere; write it as one formula"
        )
    base = base_statement(model)
    (arc,) = base.arcs
    middle = lambda u, x, p: [model.contact_speed.at(x)]  # noqa: E731
    contact = Arc(model.contact, lambda u, before, p: model.touchdown(u, p), lambda u, p: u["contact"], middle)
    inside = {f"at {i}": place for i, place in enumerate(places) if place.kind == "inside"}
    arcs = [_variational(model, arc) if variational else arc, contact]
    arcs += [_to_place(model, place, time) for time, place in inside.items()]
    if model.reduction and any(place.kind == "middle" and place.function(model)[0] == "flight" for place in places):
        # The reduced state does not determine the flight state in the middle, so the flight itself is integrated to it.
        arcs.append(Arc(model.flight, lambda u, before, p: model.launch(u, p), arc.duration, lambda u, x, p: []))
    return Statement("design", (*base.unknowns, "contact", *inside), tuple(arcs), (*base.durations, "contact", *inside))


def _to_place(model, place, time):
    """An arc of this duration that ends where an extreme is stationary."""
    name, function = place.function(model)
    phase, start = getattr(model, name), model.launch if name == "flight" else model.touchdown
    stationary = lambda u, x, p: [_value_and_rate(phase, function, x, p)[1]]  # noqa: E731
    return Arc(phase, lambda u, before, p: start(u, p), lambda u, p: u[time], stationary)


def _variational(model, arc):
    """An arc whose states are those of `arc`, their derivatives by alpha, and the adjoint of the gap at landing."""
    phase, n = arc.phase, len(arc.phase.states)

    def field(x, p, q):
        rates = ca.vertcat(*phase.field(x[:n], p, q))
        jacobian = ca.jacobian(rates, ca.vertcat(*x[:n]))
        variation, adjoint = jacobian @ ca.vertcat(*x[n : 2 * n]), -jacobian.T @ ca.vertcat(*x[2 * n :])
        return [*ca.vertsplit(rates), *ca.vertsplit(ca.densify(variation)), *ca.vertsplit(ca.densify(adjoint))]

    def start(u, before, p):
        slope = model.liftoff_slope(u, p) if model.liftoff_slope else None
        variation = by_launch_speed(lambda u: arc.start(u, before, p), u, slope)
        adjoint = [sign * w for sign, w in zip(_reversor(model), _gap_weights(model, n, p), strict=True)]
        return [*arc.start(u, before, p), *variation, *adjoint]

    states = (*phase.states, *(f"d{name}" for name in phase.states), *(f"gap by {name}" for name in phase.states))
    conditions, guard = lambda u, x, p: arc.conditions(u, x[:n], p), lambda u, x, p, q: arc.guard(u, x[:n], p, q)
    return Arc(Phase(phase.name, states, field, reaches=phase.reaches), start, arc.duration, conditions, guard)


def _reversor(model):
    """The sign of each state of the simplest statement under time reversal."""
    return model.reduction.reversor if model.reduction else model.reversor or ()


def _gap_weights(model, n, p):
    """Derivatives of the gap at landing by the state of the simplest statement there."""
    if not model.reduction:
        return list(model.gap(p).weights)
    slope, zero = model.reduction.gap_slope, [0.0] * n
    return [slope(0.0, [float(i == j) for j in range(n)], p) - slope(0.0, zero, p) for i in range(n)]


def _landing_jerk(model, u, p):
    """Third derivative of the gap at landing, which is minus that at lift-off."""
    x = ca.SX.sym("x", len(model.flight.states))
    rates = ca.vertcat(*model.flight.field(ca.vertsplit(x), p, []))
    value = ca.SX(model.gap(p).at(ca.vertsplit(x)))
    for _ in range(3):
        value = ca.jacobian(value, x) @ rates
    return -ca.substitute(value, x, ca.vertcat(*model.launch(u, p)))


def _landing_sensitivity(model, half, end, p):
    """Derivative of the gap at the time of landing by alpha, from half the flight time and the end of the first arc."""
    n = len(end) // 3
    variation, adjoint = end[n : 2 * n], end[2 * n :]
    carried = sum(a * sign * d for a, sign, d in zip(adjoint, _reversor(model), variation, strict=True))
    return carried + (model.reduction.gap_slope(2 * half, [0.0] * n, p) if model.reduction else 0.0)


def _loss(model, jerk, slope, u, p):
    """C of the map alpha + d -> alpha + d - C d**(4/3), from the landing jerk and the landing sensitivity."""
    gradient = model.flight_gradient(model.launch(u, p), p, [])
    liftoff = model.liftoff_slope(u, p) if model.liftoff_slope else None
    power = launch_power(gradient, by_launch_speed(lambda u: model.launch(u, p), u, liftoff))
    at_landing = [sign * x for sign, x in zip(model.reversor, model.launch(u, p), strict=True)]
    return loss_coefficient(model.impact_mass(at_landing, p), -jerk, ca.fabs(slope), power)


def expressions(
    model: Model, names: Sequence[str], extremes: Mapping[str, list], u: Mapping, ends: Sequence[Sequence], p: Mapping
) -> dict[str, Any]:
    """The quantities of these names as expressions.

    extremes : values of the extremes that they are made of, by name, the first at each of their places
    u, p : the unknowns of the design statement and the parameters, scalar symbols by name
    ends : the states at the ends of the design statement's arcs, lists of scalar symbols
    """
    half, contact, jerk = base_statement(model).arcs[0].duration(u, p), u["contact"], _landing_jerk(model, u, p)
    values = {"alpha": u["alpha"], "liftoff_extension": model.liftoff_extension(u, p), "landing_jerk": jerk}
    values |= {"flight_time": 2 * half, "contact_time": 2 * contact, "period": 2 * (half + contact)}
    if any(name in VARIATIONAL for name in names):
        slope = _landing_sensitivity(model, half, ends[0], p)
        values |= {"landing_sensitivity": slope, "loss_coefficient": _loss(model, jerk, slope, u, p)}
    for name in names:
        if name in COMPOSITION:
            values[name] = sum(sign * extremes[extreme][0] for extreme, sign in COMPOSITION[name].items())
        elif name not in values:
            values[name] = extremes[name][0] - model.rises(p)[name].at(model.launch(u, p))
    return {name: values[name] for name in names}
