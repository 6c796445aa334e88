"""The statement of a branch point: where lateral motion about an upright orbit begins to close with it.

To first order the lateral states d of a motion about an upright one obey d' = A(y) d, with A the derivative of their
rates by themselves at the upright states y. Half an orbit of them has 2 k launch unknowns, and 2 k + s homogeneous
conditions: s forces along the ground vanish at lift-off, and k places vanish in mid-flight and in mid-contact each. So a
solution other than 0 exists where s + 1 numbers of the machine have certain values. There a branch of orbits that lean
to one side meets its mirror image in the upright orbit: a pitchfork (Golubitsky and Schaeffer 1985, chapter VI).
"""

from collections.abc import Callable, Mapping
from functools import lru_cache

import casadi as ca

from ..laws.law import Algebraic, Parameters, Scalars
from ..model.model import Model, names_of_holding
from ..model.phase import Arc, Phase, Statement, weighted_sum
from .upright import Mirrored, mirrored, upright_model, upright_phase, without_corners


@lru_cache(maxsize=64)
def upright_statement(model: Model) -> Statement:
    """Half an upright orbit with both of its phases, of a model with a mirror."""
    upright = upright_model(model)
    flight = Arc(
        upright.flight,
        start=lambda u, before, p: upright.launch(u, p),
        duration=lambda u, p: u["duration"],
        conditions=lambda u, x, p: upright.reversal.fixed(x, p),
        guard=lambda u, x, p, q: upright.liftoff(u, p, q),
    )
    contact = Arc(
        upright.contact,
        start=lambda u, before, p: upright.touchdown(u, p),
        duration=lambda u, p: u["contact_duration"],
        conditions=lambda u, x, p: upright.contact_reversal.fixed(x, p),
    )
    times = ("duration", "contact_duration")
    return Statement("upright orbit", (*upright.launch_unknowns, *times), (flight, contact), times)


@lru_cache(maxsize=64)
def branch_statement(model: Model, tuned: tuple[str, ...]) -> Statement:
    """Half an upright orbit with a lateral motion about it, whose launch has the length 1, and parameters for which
    that exists among the unknowns; half of what it moves along the ground in a step is left free."""
    m, base, lateral = mirrored(model), upright_statement(model), lateral_unknowns(model)
    own = base.unknowns[:-2]
    flight, contact = (linear_phase(model, phase) for phase in (model.flight, model.contact))
    arcs, count = base.arcs, len(base.arcs[0].phase.states)

    def launch(u: Mapping, before: Scalars, p: Parameters) -> list[Algebraic]:
        return [*arcs[0].start(u, [], p), *_launched(m, u)]

    def touchdown(u: Mapping, before: Scalars, p: Parameters) -> list[Algebraic]:
        return [*arcs[1].start(u, [], p), *_touched_down(m, u)]

    def guard(u: Mapping, x: Scalars, p: Parameters, q: Scalars) -> list[Algebraic]:
        return [*arcs[0].guard(u, x[:count], p, q), *lateral_forces(model, u, p)]

    def mid_flight(u: Mapping, x: Scalars, p: Parameters) -> list[Algebraic]:
        length = sum(u[name] * u[name] for name in lateral) - 1
        return [*arcs[0].conditions(u, x[:count], p), *_places(m, model.flight, x[count:]), length]

    def mid_contact(u: Mapping, x: Scalars, p: Parameters) -> list[Algebraic]:
        before = len(arcs[1].phase.states)
        return [*arcs[1].conditions(u, x[:before], p), *_places(m, model.contact, x[before:])]

    return Statement(
        "branch point",
        (*own, *lateral, *base.durations, *tuned),
        (
            Arc(flight, launch, arcs[0].duration, mid_flight, guard),
            Arc(contact, touchdown, arcs[1].duration, mid_contact),
        ),
        base.durations,
        tuned,
    )  # fmt: skip


def lateral_unknowns(model: Model) -> tuple[str, ...]:
    """The names of the unknowns of a launch that are lateral."""
    m = mirrored(model)
    return tuple(name for name in model.launch_unknowns if name.removesuffix("'") in m.coordinates)


@lru_cache(maxsize=64)
def linear_phase(model: Model, phase: Phase) -> Phase:
    """A phase of upright motions, followed by the lateral states to first order."""
    m, own = mirrored(model), upright_phase(mirrored(model), phase)
    upright, lateral = m.upright(phase), m.lateral(phase)
    count = len(upright)

    def field(x: Scalars, p: Parameters, q: Scalars) -> list[Algebraic]:
        rates = _first_order(m, phase, lambda whole: [phase.field(whole, p, q)[i] for i in lateral], x)
        return [*own.field(x[:count], p, q), *rates]

    states = tuple(phase.states[i] for i in (*upright, *lateral))
    reaches = tuple(((*weights, *[0.0] * len(lateral)), step) for weights, step in own.reaches)
    return Phase(phase.name, states, field, reaches=reaches)


def _first_order(m: Mirrored, phase: Phase, function: Callable, x: Scalars) -> list[Algebraic]:
    """The values to first order in the lateral states of functions of a phase's state that they turn over; `x` are the
    upright and then the lateral states."""
    upright, lateral = m.upright(phase), m.lateral(phase)
    symbols = ca.SX.sym("lateral", len(lateral))
    states = dict(zip((*upright, *lateral), (*x[: len(upright)], *ca.vertsplit(symbols)), strict=True))
    values = ca.vertcat(*function([states[i] for i in range(len(states))]))
    slopes = ca.substitute(ca.jacobian(values, symbols), symbols, ca.SX.zeros(len(lateral)))
    return without_corners(ca.vertsplit(ca.densify(slopes @ ca.vertcat(*x[len(upright) :]))))


def _places(m: Mirrored, phase: Phase, x: Scalars) -> list[Algebraic]:
    """The lateral places of a phase but for those that move on from step to step, from the lateral states."""
    names = [phase.states[i] for i in m.lateral(phase)]
    return [value for name, value in zip(names, x, strict=True) if name in m.coordinates and name not in m.model.sticks]


def _launched(m: Mirrored, u: Mapping) -> list[Algebraic]:
    """The lateral states in flight at a launch."""
    model, contact = m.model, m.lateral(m.model.contact)
    released = [u.get(model.contact.states[i], 0.0) for i in contact]
    return [weighted_sum(model.embed[i, contact].tolist(), released) for i in m.lateral(model.flight)]


def _touched_down(m: Mirrored, u: Mapping) -> list[Algebraic]:
    """The lateral states in contact after a landing, the image of the launch."""
    model = m.model
    each = ((model.contact.states[i], model.mirror[i]) for i in m.lateral(model.contact))
    return [sign * u[name] if name in u else 0.0 for name, sign in each]


def lateral_forces(model: Model, u: Mapping, p: Parameters) -> list[Algebraic]:
    """The forces along the ground at a launch, to first order."""
    m, contact = mirrored(model), model.contact
    upright = upright_model(model)
    own = dict(zip(upright.contact.states, upright.released(u), strict=True))
    x = [*(own[contact.states[i]] for i in m.upright(contact)), *(u.get(contact.states[i], 0.0) for i in m.lateral(contact))]
    names = names_of_holding(model.sticks)
    return _first_order(m, contact, lambda whole: [contact.watch[name](whole, p, []) for name in names], x)


def lateral_speed(model: Model, u: Mapping, p: Parameters) -> Algebraic:
    """The speed of the centre of mass along the ground after a launch, to first order: the momentum of the coordinate
    that sticks, over the mass that it moves."""
    m, flight, upright = mirrored(model), model.flight, upright_model(model)
    rate = flight.states.index(f"{model.sticks[0]}'")
    x = [*upright.launch(u, p), *_launched(m, u)]

    def momentum(whole: Scalars) -> list[Algebraic]:
        return [model.flight_gradient(whole, p, [])[rate]]

    unit = [0.0] * len(x)
    unit[len(m.upright(flight)) + m.lateral(flight).index(rate)] = 1.0
    unit[: len(m.upright(flight))] = x[: len(m.upright(flight))]
    (along,), (mass,) = (_first_order(m, flight, momentum, each) for each in (x, unit))
    return along / mass
