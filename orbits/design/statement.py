"""The design statement: a boundary value statement whose arcs give all quantities of an orbit that are asked for.

Its first arc is half the flight by the simplest statement that the model allows, the second half the contact. Further
arcs end at the extremes. For the loss coefficient the first arc carries its variation with respect to alpha, and the
adjoint that takes it back over the mirrored half.
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache

import casadi as ca

from ..errors import InputError
from ..model.model import Model
from ..model.phase import Arc, Phase, Statement
from ..periodic.formulations import half_orbit
from ..periodic.local_law import by_launch_speed, launch_power, loss_coefficient
from .extremes import Place, affine, phase_named


def base_statement(model: Model) -> Statement:
    """The simplest statement of a model's orbits."""
    return model.reduction.statement if model.reduction else half_orbit(model)


@lru_cache(maxsize=128)
def design_statement(model: Model, variational: bool, places: tuple[Place, ...]) -> Statement:
    """The statement of an orbit together with its extremes at these places.

    variational : whether the first arc carries its variation and its adjoint

    Unknowns: those of the simplest statement; "contact", half the contact time; "at 0", ..., the times of the places
    inside. Raises `InputError` for a model whose motions are not their own mirror images, or have breakpoints.
    """
    if not model.reversor:
        raise InputError("a design needs a machine whose motion is its own mirror image in time: leave out the damping")
    if model.flight.pieces or model.contact.pieces:
        raise InputError(
            "a law in pieces cannot be designed: it has no second derivatives everywhere; write it as one formula"
        )
    base = base_statement(model)
    (arc,) = base.arcs
    contact = Arc(
        model.contact,
        start=lambda u, before, p: model.touchdown(u, p),
        duration=lambda u, p: u["contact"],
        conditions=lambda u, x, p: [affine(model.contact_speed, x)],
    )
    inside = {f"at {i}": place for i, place in enumerate(places) if place.kind == "inside"}
    arcs = [_variational(model, arc) if variational else arc, contact]
    arcs += [_to_place(model, place, time) for time, place in inside.items()]
    if model.reduction and any(place.kind == "middle" and place.phase(model) == "flight" for place in places):
        # The reduced state does not tell the flight state in the middle, so the flight itself is integrated to there.
        arcs.append(Arc(model.flight, lambda u, before, p: model.launch(u, p), arc.duration, lambda u, x, p: []))
    return Statement("design", (*base.unknowns, "contact", *inside), tuple(arcs), (*base.durations, "contact", *inside))


def _to_place(model: Model, place: Place, time: str) -> Arc:
    """An arc of this duration that ends where an extreme is stationary."""
    function, name = place.function(model), place.phase(model)
    phase, start = phase_named(model, name), model.launch if name == "flight" else model.touchdown

    def rate(u, x, p):
        value = ca.SX(function(x, p))
        return [ca.jacobian(value, ca.vertcat(*x)) @ ca.vertcat(*phase.field(x, p, []))]

    return Arc(phase, lambda u, before, p: start(u, p), lambda u, p: u[time], rate)


def _variational(model: Model, arc: Arc) -> Arc:
    """An arc whose states are those of `arc`, their derivatives by alpha, and the adjoint of the gap at landing."""
    phase, n = arc.phase, len(arc.phase.states)
    signs = _reversor(model)

    def field(x, p, q):
        state = ca.vertcat(*x[:n])
        rates = ca.vertcat(*phase.field(x[:n], p, q))
        jacobian = ca.jacobian(rates, state)
        variation, adjoint = jacobian @ ca.vertcat(*x[n : 2 * n]), -jacobian.T @ ca.vertcat(*x[2 * n :])
        return [*ca.vertsplit(rates), *ca.vertsplit(ca.densify(variation)), *ca.vertsplit(ca.densify(adjoint))]

    def start(u, before, p):
        variation = by_launch_speed(lambda u: arc.start(u, before, p), u)
        adjoint = [sign * w for sign, w in zip(signs, _gap_weights(model, n, p), strict=True)]
        return [*arc.start(u, before, p), *variation, *adjoint]

    states = (*phase.states, *(f"d{name}" for name in phase.states), *(f"gap by {name}" for name in phase.states))
    return Arc(
        Phase(phase.name, states, field),
        start,
        arc.duration,
        lambda u, x, p: arc.conditions(u, x[:n], p),
        lambda u, x, p, q: arc.guard(u, x[:n], p, q),
    )


def _reversor(model: Model) -> tuple[int, ...]:
    """The sign of each state of the simplest statement under time reversal."""
    return model.reduction.reversor if model.reduction else model.reversor or ()


def _gap_weights(model: Model, n: int, p: Mapping) -> list:
    """Derivatives of the gap at landing by the state of the simplest statement there."""
    if not model.reduction:
        return list(model.gap(p).weights)
    slope, zero = model.reduction.gap_slope, [0.0] * n
    return [slope(0.0, [float(i == j) for j in range(n)], p) - slope(0.0, zero, p) for i in range(n)]


def landing_jerk(model: Model, u: Mapping, p: Mapping) -> ca.SX:
    """Third derivative of the gap at landing, which is minus that at lift-off."""
    x = ca.SX.sym("x", len(model.flight.states))
    rates = ca.vertcat(*model.flight.field(ca.vertsplit(x), p, []))
    value = ca.SX(affine(model.gap(p), ca.vertsplit(x)))
    for _ in range(3):
        value = ca.jacobian(value, x) @ rates
    return -ca.substitute(value, x, ca.vertcat(*model.launch(u, p)))


def landing_sensitivity(model: Model, half: ca.SX, end: Sequence, p: Mapping) -> ca.SX:
    """Derivative of the gap at the time of landing by alpha, from half the flight time and the end of the first arc."""
    n = len(end) // 3
    variation, adjoint = end[n : 2 * n], end[2 * n :]
    carried = sum(a * sign * d for a, sign, d in zip(adjoint, _reversor(model), variation, strict=True))
    return carried + (model.reduction.gap_slope(2 * half, [0.0] * n, p) if model.reduction else 0.0)


def loss(model: Model, jerk: ca.SX, slope: ca.SX, u: Mapping, p: Mapping) -> ca.SX:
    """C of the map alpha + d -> alpha + d - C d**(4/3), from the landing jerk and the landing sensitivity."""
    gradient = model.flight_gradient(model.launch(u, p), p, [])
    power = launch_power(gradient, by_launch_speed(lambda u: model.launch(u, p), u))
    return loss_coefficient(model.impact_mass(p), -jerk, ca.fabs(slope), power)
