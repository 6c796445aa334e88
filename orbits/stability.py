"""How a small change of the launch speed comes back after a hop: the multiplier of a transversal one, with saltation.

A change grows along each leg by the leg's transition matrix. At an event it is taken to the moved time of the event, by
the field before, and through the reset. On a lossless orbit the foot lands tangentially, that time moves like the cube
root of the change, and there is no multiplier: the map goes like C d**(4/3) instead (`Certificate.loss_coefficient`).
"""

import casadi as ca
import numpy as np

from .errors import FlowError, NoOrbit
from .flow import first_zero
from .impacts import ContactEnd, Impacts

# An impact slower than this, beside the launch speed, is tangential.
TANGENTIAL = 1e-7
LONGEST = 1e6
# Impacts of a hop after which it is given up.
CAP = 10_000


def multiplier(machine, alpha: float) -> float:
    """d(next launch speed)/d(launch speed) over the hop that starts with `alpha`.

    Raises `NoOrbit` where there is none: the machine does not lift off again, or lands tangentially.
    """
    rules = Impacts(machine)
    x, change, skip = rules.launch(np.array([float(alpha)]))[0], _launched(rules, float(alpha)), 3
    for _ in range(CAP):
        x, change = _flown(rules, alpha, x, change, skip)
        landing = rules.landing(x[None])
        factor = 1.0 if landing.held[0] else 1.0 + rules.restitution
        change = change - factor * rules.direction * (rules.gap_speed @ change)
        x, skip = landing.state[0], 1 if rules.restitution > 0 else 2
        if landing.held[0]:
            return _stood(rules, rules.onto_contact @ x, rules.onto_contact @ change)
    raise NoOrbit(f"after {CAP} impacts the machine has not come to rest on the ground")


def _launched(rules: Impacts, alpha: float) -> np.ndarray:
    """The change of the flight state at lift-off with the launch speed; with damping the extension changes too."""
    step = 1e-5 * alpha
    low, high = rules.launch(np.array([alpha - step, alpha + step]))
    return (high - low) / (2 * step)


def _flown(rules: Impacts, alpha: float, x, change, skip: int):
    """State and change where the gap closes next."""
    try:
        path, moved = rules.flight.run(
            x, rules.p, LONGEST, seeds=change[:, None], stop=first_zero(rules.gap, skip)
        )  # fmt: skip
    except FlowError as error:
        raise NoOrbit(f"the flight does not end: {error}") from None
    x, change = path.end[: len(x)], moved[:, 0]
    speed = float(rules.gap_speed @ x)
    if skip == 3 and abs(speed) < TANGENTIAL * alpha:  # later bounces may be as slow as they like
        raise NoOrbit(f"the landing is tangential, at speed {speed:.1e}: there are loss coefficients, no multiplier")
    rates = rules.flight.rates(x, rules.flight.data(x[None], rules.p)[0])
    return x, change - rates * (np.array(rules.gap.weights) @ change) / speed


def _stood(rules: Impacts, y, change) -> float:
    """The change of the speed at which the contact ends."""
    contact = rules.contact
    ended = ContactEnd(contact.size, rules.model.contact_speed)
    try:
        path, moved = contact.run(y, rules.p, LONGEST, seeds=change[:, None], stop=ended)
    except FlowError as error:
        raise NoOrbit(f"the contact does not end: {error}") from None
    if not ended.lifts:
        raise NoOrbit("the machine rests: it does not lift off again")
    y, change = path.end[: contact.size], moved[:, 0]
    data = contact.data(y[None], rules.p)[0]
    rates = contact.rates(y, data)
    graph = contact.graph
    slope = ca.Function("slope", [graph.x, graph.p], [ca.jacobian(graph.field(graph.x, graph.p)[1][0], graph.x)])
    gradient = np.array(slope(y, data)).ravel()
    change = change - rates * (gradient @ change) / (gradient @ rates)
    return float(np.array(rules.model.contact_speed.weights) @ change)
