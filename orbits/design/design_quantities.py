"""The quantities of an orbit that a design may use, as expressions.

Names are those of an orbit's JSON document. A quantity is evaluated at one place of the motion, or is made of extremes,
each the largest value of a function of the state over the cycle.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import casadi as ca

from ..errors import InputError
from ..model import (
    CONTACT_FORCE,
    LANDED_FORCE,
    Arc,
    Model,
    Phase,
    Statement,
    refuse_forward,
)
from ..periodic import (
    FRICTION_LEFT,
    VARIATIONAL,
    by_launch_speed,
    launch_power,
    loss_coefficient,
    speed_in_flight,
    step_of,
)
from ..shooting import half_orbit
from ..units import APEX, OF_HEIGHTS, RISE

# Quantities that depend on the time of the contact, which is not an unknown of the simplest statements.
WITH_CONTACT = ("contact_time", "period", "frequency", "mean_speed", "duty_factor")
# The extremes whose sum is a quantity, each with its sign; of a height one, with the name of its rise. To what
# is left of friction the stated one is added, and the peak in weights is divided by the weight.
COMPOSITION = {
    "stroke": {"longest": 1, "shortest": 1},
    "clearance": {"gap": -1},
    "smallest_separation": {"separation": -1},
    "smallest_contact_force": {"force": -1},
    "largest_contact_force": {"peak": 1},
    "peak_force_in_weights": {"peak": 1},
    "largest_spring_force": {"tension": 1},
    "friction_needed": {"slip": 1},
    FRICTION_LEFT: {"slip": -1},
    "smallest_stance_force": {"stance": -1},
}
# Extremes for which only local maxima after the start count.
LOCAL = ("gap", "force")
# The text of the error for an orbit without an extreme.
ABSENT = {
    "gap": "clearance: the gap has no lowest point inside the flight",
    "force": "smallest_contact_force: the force has no lowest value inside the contact",
    "slip": "friction_needed: the standing foot lifts, or the ground would have to pull",
    "loss": "loss_coefficient: a law has a corner at lift-off, or a landing keeps nearly all of its speed, or the "
    "machine does not state how much it keeps",
}


def extremes_of(name: str) -> tuple[str, ...]:
    """The names of the extremes that a quantity is made of."""
    if name.endswith(OF_HEIGHTS):
        return (f"{name.removesuffix(APEX).removesuffix(RISE)}{RISE}",)
    return tuple(COMPOSITION.get(name, ()))


@lru_cache(maxsize=256)
def extreme_of(model: Model, name: str) -> tuple[tuple[str, Callable], ...]:
    """The functions of the state whose largest value over the cycle an extreme is, each (x, p, q) -> value with its
    phase; the extreme is one of those in `COMPOSITION`, or a rise.

    The motions are the first halves of the phases. A function that has other values in the second half of one occurs
    a second time, of the image of the state.
    """

    def in_flight(function: Callable) -> tuple:
        """A function of the flight state, over the flight."""
        back = None if model.plain else model.reversal
        return ("flight", function), *([("flight", lambda x, p, q: function(back.image(x, p), p, q))] if back else [])

    def in_contact(function: Callable) -> tuple:
        """A function of the flight state, over the contact."""
        embedded = lambda x: [sum((w * v for w, v in zip(row, x, strict=False) if w), 0.0) for row in model.embed]  # noqa: E731
        inside, back = lambda x, p, q: function(embedded(x), p, q), None if model.plain else model.contact_reversal
        image = [("contact", lambda x, p, q: inside(back.image(x, p), p, q))] if back else []
        return ("contact", inside), *image

    def over_cycle(function: Callable) -> tuple:
        """A function of the flight state, over flight and contact."""
        return *in_flight(function), *in_contact(function)

    def negative(functions: tuple) -> tuple:
        return tuple((phase, lambda x, p, q, of=of: -of(x, p, q)) for phase, of in functions)

    landing = model.landing_gap
    gaps = [each for each in (model.height_of, landing) if each]
    watched = [model.contact.watch.get(each) for each in (CONTACT_FORCE, LANDED_FORCE)]
    forces = tuple(("contact", force) for force in watched if force)
    tensions = over_cycle(model.tension or (lambda x, p, q: 0.0))
    # The forces of a law in pieces in the second half of a step are those in the first, or their negatives.
    tensions = tensions[::2] if model.flight.pieces and not model.plain else tensions
    slips = tuple(
        (phase, lambda x, p, q, on=on.watch, n=n, t=t: on[t](x, p, q) / on[n](x, p, q))
        for phase, n, t, _ in model.standing_points
        for on in [getattr(model, phase)]
    )
    stance = tuple(("flight", model.flight.watch[n]) for phase, n, *_ in model.standing_points if phase == "flight")
    functions = {
        "longest": over_cycle(lambda x, p, q: model.extension.at(x)),
        "shortest": over_cycle(lambda x, p, q: -model.extension.at(x)),
        "gap": (
            *(("flight", lambda x, p, q, gap=gap: -gap(p).at(x)) for gap in gaps),
            *(in_contact(lambda x, p, q: -landing(p).at(x)) if landing else ()),
        ),
        "separation": over_cycle(lambda x, p, q: -model.separation(p).at(x)),
        "force": negative(forces + (stance if model.sticks else ())),
        "peak": forces,
        "tension": tensions + negative(tensions),
        "slip": slips + negative(slips),
        "stance": negative(stance),
    }
    return functions.get(name) or in_flight(lambda x, p, q: model.of_heights(p)[name][0].at(x))


def base_statement(model: Model) -> Statement:
    """The simplest statement of a model's orbits; raises `InputError` for a model whose motions are not their own
    mirror images."""
    if not model.reversor:
        raise InputError("a design needs a machine with a reversor: leave out the damping")
    refuse_forward(model)
    return _simplest(model)


def _simplest(model: Model) -> Statement:
    return model.reduction.statement if model.reduction else half_orbit(model)


@lru_cache(maxsize=64)
def variational_arc(model: Model, tuned: Statement | None = None) -> Arc:
    """Half the flight, whose states are those of the simplest statement, or of one with tuned parameters, their
    derivatives by alpha, and the adjoint of the gap at landing, which takes these back over the mirrored half."""
    arc, *_ = (tuned or base_statement(model)).arcs
    reduction = None if tuned else model.reduction
    phase, n = arc.phase, len(arc.phase.states)

    def field(x, p, q):
        rates = ca.vertcat(*phase.field(x[:n], p, q))
        jacobian = ca.jacobian(rates, ca.vertcat(*x[:n]))
        variation, adjoint = jacobian @ ca.vertcat(*x[n : 2 * n]), -jacobian.T @ ca.vertcat(*x[2 * n :])
        return [*ca.vertsplit(rates), *ca.vertsplit(ca.densify(variation)), *ca.vertsplit(ca.densify(adjoint))]

    def start(u, before, p):
        slope = model.liftoff_slope(u, p) if model.liftoff_slope else None
        variation = by_launch_speed(lambda u: arc.start(u, before, p), u, slope)
        weights = _gap_weights(model, reduction, n, p)
        adjoint = [sign * w for sign, w in zip(_reversor(model, reduction), weights, strict=True)]
        return [*arc.start(u, before, p), *variation, *adjoint]

    states = (*phase.states, *(f"d{name}" for name in phase.states), *(f"gap by {name}" for name in phase.states))
    pieces = phase.pieces and replace(phase.pieces, coordinate=(*phase.pieces.coordinate, *[0.0] * (2 * n)))
    longer = Phase(phase.name, states, field, pieces=pieces)
    return Arc(longer, start, arc.duration, lambda u, x, p: [])


def _reversor(model, reduction):
    """The sign of each state of a statement, in a reduction's coordinates if there is one, under time reversal."""
    return reduction.reversor if reduction else model.reversor or ()


def _gap_weights(model, reduction, n, p):
    """Derivatives of the gap at landing by the state of a statement there."""
    if not reduction:
        return list((model.landing_gap or model.gap)(p).weights)
    slope, zero = reduction.gap_slope, [0.0] * n
    return [slope(0.0, [float(i == j) for j in range(n)], p) - slope(0.0, zero, p) for i in range(n)]


def _landing_jerk(model, u, p, q):
    """Third derivative of the gap at landing, which is minus that at lift-off."""
    x = ca.SX.sym("x", len(model.flight.states))
    rates = ca.vertcat(*model.flight.field(ca.vertsplit(x), p, q))
    value = ca.SX(model.height_of(p).at(ca.vertsplit(x)))
    for _ in range(3):
        value = ca.jacobian(value, x) @ rates
    return -ca.substitute(value, x, ca.vertcat(*model.launch(u, p)))


def landing_sensitivity(model: Model, half: Any, end: Sequence, p: Mapping, tuned: Statement | None = None) -> Any:
    """Derivative of the gap at the time of landing by alpha, from half the flight time and the end of `variational_arc`
    there."""
    n, reduction = len(end) // 3, None if tuned else model.reduction
    variation, adjoint = end[n : 2 * n], end[2 * n :]
    carried = sum(a * sign * d for a, sign, d in zip(adjoint, _reversor(model, reduction), variation, strict=True))
    return carried + (reduction.gap_slope(2 * half, [0.0] * n, p) if reduction else 0.0)


def left_at_landing(model: Model, u: Mapping, p: Mapping) -> Any:
    """The share of the gap's speed that is left where another point takes over at landing."""
    return model.share_left(model.relabelling.image(model.reversal.image(model.launch(u, p), p), p), p)


def _loss(model, jerk, slope, u, p, q):
    """C of the map alpha + d -> alpha + d - C d**(4/3), from the landing jerk and the landing sensitivity."""
    gradient = model.flight_gradient(model.launch(u, p), p, q)
    liftoff = model.liftoff_slope(u, p) if model.liftoff_slope else None
    power = launch_power(gradient, by_launch_speed(lambda u: model.launch(u, p), u, liftoff))
    at_landing = model.reversal.image(model.launch(u, p), p)
    return loss_coefficient(model.impact_mass(at_landing, p), -jerk, ca.fabs(slope), power)


def expressions(
    model: Model, names: Sequence[str], extremes: Mapping[str, Any], u: Mapping, slope: Any, factors: Sequence,
    p: Mapping, q: Sequence,
) -> dict[str, Any]:  # fmt: skip
    """The quantities of these names as expressions.

    extremes : values of the extremes that they are made of, by name
    u : the unknowns of the simplest statement, and "contact", half the contact time
    slope, factors : the landing sensitivity, and what landings without and with a bounce lose as multiples of C, see
        `hand_over_factors`, for the quantities that need them
    q : the data of the piece at launch
    """
    half, contact, jerk = _simplest(model).arcs[0].duration(u, p), u["contact"], _landing_jerk(model, u, p, q)
    values = {"alpha": u["alpha"], "liftoff_extension": model.liftoff_extension(u, p), "landing_jerk": jerk}
    values |= {"flight_time": 2 * half, "contact_time": 2 * contact, "period": 2 * (half + contact)}
    values |= {"frequency": 1 / values["period"], "duty_factor": contact / (half + contact)}
    if model.moves_on:
        step, speed = step_of(model, u, p), speed_in_flight(model, u, p, 2 * half)
        values |= {"step": step, "speed": speed, "mean_speed": step / values["period"]}
    if any(name in VARIATIONAL for name in names):
        loss, (late, early) = _loss(model, jerk, slope, u, p, q), factors
        above = ca.if_else(slope > 0, late, early) * loss  # is lost beyond alpha, where hops before a fold land late
        values |= {"landing_sensitivity": slope, "loss_coefficient": late * loss, "robustness": above**-3}
    for name in names:
        if name in COMPOSITION:
            values[name] = sum(sign * extremes[extreme] for extreme, sign in COMPOSITION[name].items())
        elif name not in values:
            height, is_rise = model.of_heights(p)[name]
            values[name] = extremes[extremes_of(name)[0]] - (height.at(model.launch(u, p)) if is_rise else 0.0)
        if name == "peak_force_in_weights":
            values[name] /= model.weight(p)
        if name == FRICTION_LEFT and model.planar and model.planar.friction:
            values[name] += model.planar.friction(p)
    return {name: values[name] for name in names}
