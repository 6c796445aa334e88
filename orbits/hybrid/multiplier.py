"""How a small change of the launch speed comes back after a hop: the multiplier of a transversal one, with saltation.

A change grows along each leg by the leg's transition matrix. At an event it is taken to the moved time of the event, by
the field before, and through the reset. On a lossless orbit the foot lands tangentially, that time moves like the cube
root of the change, and there is no multiplier: the map goes like C d**(4/3) instead (`Certificate.loss_coefficient`).
"""

import casadi as ca
import numpy as np

from ..errors import FlowError, InputError, NoOrbit, finite_number
from ..flow.zero_crossing import first_zero
from ..periodic.local_law import loss_coefficient
from .impacts import CAP, LIFTOFF_ORDER, ContactEnd, Impacts

# An impact slower than this, beside the launch speed, is tangential.
TANGENTIAL = 1e-7


def multiplier(machine, alpha: float) -> float:
    """d(next launch speed)/d(launch speed) over the hop that starts with `alpha`.

    Raises `NoOrbit` where there is none: the machine does not lift off again, or lands tangentially.
    """
    rules, alpha = Impacts(machine), finite_number("alpha", alpha)
    if alpha <= 0:
        raise InputError(f"alpha = {alpha:g}; a launch speed is above 0")
    x, change, order = rules.launch(np.array([alpha]))[0], _launched(rules, alpha), LIFTOFF_ORDER
    if not rules.opens(x[None])[0]:
        raise NoOrbit(f"alpha = {alpha:g} is no launch: the damper is too strong for the contact to open")
    for _ in range(CAP):
        x, change = _flown(rules, alpha, x, change, order)
        landing = rules.landing(x[None])
        factor = 1.0 if landing.held[0] else 1.0 + rules.restitution
        change = change - factor * rules.direction * (rules.gap_speed @ change)
        x, order = landing.state[0], rules.bounce_order
        if landing.held[0]:
            return _stood(rules, rules.onto_contact @ x, rules.onto_contact @ change)
    raise NoOrbit(f"after {CAP} impacts the machine has not come to rest on the ground")


def _launched(rules: Impacts, alpha: float) -> np.ndarray:
    """The change of the flight state at lift-off with the launch speed; with damping the extension changes too."""
    step = 1e-5 * alpha
    low, high = rules.launch(np.array([alpha - step, alpha + step]))
    return (high - low) / (2 * step)


def _flown(rules: Impacts, alpha: float, x, change, order: int):
    """State and change where the gap closes next."""
    try:
        limit, closes = float(rules.patience("flight", x)), first_zero(rules.gap, order)
        path, moved = rules.flight.run(x, rules.p, limit, seeds=change[:, None], stop=closes)
    except FlowError as error:
        raise NoOrbit(f"the flight does not end: {error}") from None
    x, change = path.end[: len(x)], moved[:, 0]
    speed = float(rules.gap_speed @ x)
    if order == LIFTOFF_ORDER and abs(speed) < TANGENTIAL * alpha:  # later bounces may be as slow as they like
        raise NoOrbit(
            f"the landing is tangential, at speed {speed:.1e}: no multiplier; {_one_sided(rules, alpha, x, change)}"
        )
    rates = rules.flight.rates(x, rules.flight.data(x[None], rules.p)[0])
    return x, change - rates * (np.array(rules.gap.weights) @ change) / speed


def _one_sided(rules: Impacts, alpha: float, x, change) -> str:
    """What there is instead of a multiplier where a hop lands tangentially at `x`: how its neighbours come back."""
    jerk, slope = -rules.gap_rates(x[None])[0, 0], float(np.array(rules.gap.weights) @ change)
    if not jerk > 0 or slope == 0:
        return "nor a power law"
    c = loss_coefficient(rules.model.impact_mass(rules.values), jerk, abs(slope), rules.power * alpha)
    first, other = ("+", "-") if slope > 0 else ("-", "+")
    return f"alpha {first} d loses {c:.4g} d**(4/3), alpha {other} d {10 * c:.4g} d**(4/3)"


def _stood(rules: Impacts, y, change) -> float:
    """The change of the speed at which the contact ends."""
    contact = rules.contact
    ended = ContactEnd(contact.size, rules.model.contact_speed)
    try:
        path, moved = contact.run(y, rules.p, float(rules.patience("contact", y)), seeds=change[:, None], stop=ended)
    except FlowError as error:
        raise NoOrbit(f"the contact does not end: {error}") from None
    if ended.how != "lifts_off":
        raise NoOrbit("the machine rests: it does not lift off again")
    y, change = path.end[: contact.size], moved[:, 0]
    if not rules.liftoff(y[None])[1][0]:
        raise NoOrbit("the contact ends where no launch does: the map has no next launch speed")
    data = contact.data(y[None], rules.p)[0]
    rates = contact.rates(y, data)
    graph = contact.vector_field
    slope = ca.Function("slope", [graph.x, graph.p], [ca.jacobian(graph.field(graph.x, graph.p)[1][0], graph.x)])
    gradient = np.array(slope(y, data)).ravel()
    change = change - rates * (gradient @ change) / (gradient @ rates)
    return float(np.array(rules.model.contact_speed.weights) @ change)
