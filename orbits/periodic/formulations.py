"""What is solved for an orbit of a model: the boundary value statements, and which of them a method takes."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..errors import InputError
from ..model.model import Model, Reduction
from ..model.phase import Arc, Phase, Statement
from .single_shooting import Shooting, shooting_equations


def reduction_of(model: Model, method: str) -> Reduction | None:
    """The reduction in whose coordinates a method solves, None where it solves in the flight states."""
    return model.reduction if method in ("closed form", "relative") else None


def equations_of(model: Model, method: str, parameters: tuple[str, ...]) -> Shooting:
    """The equations that a method solves."""
    if reduction := reduction_of(model, method):
        return shooting_equations(reduction.statement, parameters)
    return shooting_equations(half_orbit(model) if model.reversor else whole_flight(model), parameters)


@lru_cache(maxsize=64)
def half_orbit(model: Model) -> Statement:
    """Half of an orbit that is its own mirror image: from the launch set to a state that the reversor leaves alone.

    The unknowns are those of the launch and half the flight time. Where a launch has more of them than extension and
    speed, the contact after the mirrored landing has to reach such a state too, and half its time is a further unknown.
    Raises `InputError` for a model without a reversor.
    """
    if model.reversor is None:
        raise InputError("half an orbit needs a model with a reversor")

    def at_rest(reversor: tuple[int, ...]) -> Callable:
        return lambda u, x, p: [value for value, sign in zip(x, reversor, strict=True) if sign < 0]

    flight = Arc(
        model.flight,
        start=lambda u, before, p: model.launch(u, p),
        duration=lambda u, p: u["duration"],
        conditions=at_rest(model.reversor),
        guard=lambda u, x, p, q: [model.liftoff(u, p, q)],
    )
    if model.one_speed:
        return Statement("half orbit", model.half_unknowns, (flight,), ("alpha", "duration"))
    contact = Arc(
        model.contact,
        start=lambda u, before, p: model.touchdown(u, p),
        duration=lambda u, p: u["contact_duration"],
        conditions=at_rest(contact_reversor(model.reversor, model.embed)),
    )
    return Statement("half orbit", model.half_unknowns, (flight, contact), ("duration", "contact_duration"))


def contact_reversor(reversor: tuple[int, ...], embed: np.ndarray) -> tuple[int, ...]:
    """The sign of each contact state under time reversal, from those of the flight states."""
    return tuple(int(reversor[i]) for i in np.abs(embed).argmax(0))


@lru_cache(maxsize=64)
def whole_flight(model: Model) -> Statement:
    """From the launch set to a lossless landing, for a model without a reversor.

    Launch speed and flight time are two unknowns for three landing conditions. All three can hold only because energy
    is conserved and because of whatever symmetry the motion has, so the equations are made square by an unfolding: a
    multiple of the energy's gradient is added to the field. That multiple is a further unknown, and it vanishes on an
    orbit.
    """
    flight = model.flight

    def field(x, p, q):
        *state, unfolding = x
        gradient = model.flight_gradient(state, p, q)
        rates = [f + unfolding * g for f, g in zip(flight.field(state, p, q), gradient, strict=True)]
        return [*rates, 0 * unfolding]

    pieces = flight.pieces and replace(flight.pieces, coordinate=(*flight.pieces.coordinate, 0.0))
    arc = Arc(
        Phase(flight.name, (*flight.states, "unfolding"), field, pieces=pieces),
        start=lambda u, before, p: [*model.launch(u, p), u["unfolding"]],
        duration=lambda u, p: u["duration"],
        conditions=lambda u, x, p: model.landing(u, x[:-1], p),
        guard=lambda u, x, p, q: [model.liftoff(u, p, q)],
    )
    return Statement("whole flight", ("liftoff", "alpha", "duration", "unfolding"), (arc,), ("alpha", "duration"))
