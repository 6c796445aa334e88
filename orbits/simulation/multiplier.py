"""The multiplier of a hop: the derivative of the next launch speed with respect to the launch speed.

A perturbation grows along each phase by the transition matrix of that phase. The saltation matrix carries it through an
event: the field before shifts the event in time, and the reset follows. On a lossless orbit the foot lands
tangentially, so that the time of landing moves like the cube root of the perturbation. Then there is no multiplier, and
the map behaves like C d**(4/3) instead (`Certificate.loss_coefficient`).
"""

import casadi as ca
import numpy as np

from ..errors import FlowError, InputError, NoOrbit, finite_number
from ..flow.flow import Flow
from ..flow.zero_crossing import first_zero
from ..model.machine import Machine
from ..periodic.loss_coefficient import loss_coefficient
from ..running.exclusive import exclusive
from ..units import DIMENSIONS, LIFTOFF_SPEED, SPEED, Message, Quantity, in_own_units
from .impacts import CAP, LIFTOFF_ORDER, ContactEnd, Impacts, no_launch

TANGENTIAL = 1e-7  # an impact slower than this, relative to the launch speed, is tangential


@exclusive
def multiplier(machine: Machine, alpha: float) -> float:
    """The multiplier d(next launch speed)/d(launch speed) of the hop that starts with `alpha`.

    machine : as for `ReturnMap`
    alpha : launch speed, in the machine's units

    It follows from the variational equations with saltation at impacts. Raises `NoOrbit` where there is none: the
    machine does not lift off again, or lands tangentially, and `InputError` for an invalid launch speed.

    >>> from orbits import multiplier
    >>> from problems import Hopper
    >>> round(multiplier(Hopper(), 4.6), 6)
    -1.616561
    """
    alpha = finite_number("alpha", alpha)
    if alpha <= 0:
        raise InputError(f"alpha = {alpha:g}; a launch speed is above 0")
    return _slope_of_hop(machine, alpha)


@in_own_units((), alpha=LIFTOFF_SPEED)
def _slope_of_hop(machine: Machine, alpha: float) -> float:
    """The `multiplier` of the hop that starts with a speed above 0."""
    impacts = Impacts(machine)
    x, order = impacts.launch(np.array([alpha]))[0], LIFTOFF_ORDER
    step = 1e-5 * alpha  # The extension of the launch state depends on the launch speed too where there is damping.
    low, high = impacts.launch(np.array([alpha - step, alpha + step]))
    change = (high - low) / (2 * step)
    if not impacts.opens(x[None])[0]:
        raise NoOrbit(no_launch(alpha))
    for _ in range(CAP):
        x, change = _through_flight(impacts, alpha, x, change, order)
        (held,), (after,), *_ = impacts.landing(x[None])
        factor, order = 1.0 if held else 1.0 + impacts.restitution, impacts.bounce_order
        x, change = after, impacts.change_after(x, change, factor).full().ravel()
        if held:
            return _through_contact(impacts, impacts.onto_contact @ x, impacts.onto_contact @ change)
    raise NoOrbit(f"after {CAP} impacts the machine has not come to rest on the ground")


def _follow(flow: Flow, p, x, change, limit: float, stop) -> tuple[np.ndarray, np.ndarray]:
    """State and change where a phase stops."""
    try:
        path, variations = flow.run(x, p, limit, seeds=change[:, None], stop=stop)
    except FlowError as error:
        raise NoOrbit(Message("the {name} does not end: {error}", name=flow.phase.name, error=error)) from None
    assert variations is not None  # there are seeds
    return path.end[: flow.size], variations[:, 0]


def _through_flight(impacts: Impacts, alpha: float, x, change, order: int) -> tuple[np.ndarray, np.ndarray]:
    """State and change where the gap closes next."""
    limit, closes = float(impacts.longest_flight(x)), first_zero(impacts.gap, order)
    x, change = _follow(impacts.flight, impacts.p, x, change, limit, closes)
    speed = float(impacts.gap_speed @ x)
    if order == LIFTOFF_ORDER and abs(speed) < TANGENTIAL * alpha:  # later bounces may be arbitrarily slow
        law = _one_sided(impacts, alpha, x, change)
        text = "the landing is tangential, at speed {speed:.1e}: no multiplier; {law}"
        raise NoOrbit(Message(text, speed=Quantity(speed, SPEED), law=law))
    rates = impacts.flight.rates(x, impacts.flight.data(x[None], impacts.p)[0])
    return x, change - rates * (np.array(impacts.gap.weights) @ change) / speed


def _one_sided(impacts: Impacts, alpha: float, x, change) -> Message:
    """The power law that replaces the multiplier where a hop lands tangentially at `x`."""
    jerk, slope = -impacts.gap_rates(x[None])[0, 0], float(np.array(impacts.gap.weights) @ change)
    if not jerk > 0 or slope == 0:
        return Message("nor a power law")
    mass = impacts.model.impact_mass(x.tolist(), impacts.values)
    text = "alpha {first} d loses {c:.4g} d**(4/3), alpha {other} d {more:.4g} d**(4/3)"
    c = loss_coefficient(mass, jerk, abs(slope), impacts.launch_inertia * alpha)
    first, other = ("+", "-") if slope > 0 else ("-", "+")
    losses = {name: Quantity(loss, DIMENSIONS["loss_coefficient"]) for name, loss in (("c", c), ("more", 10 * c))}
    return Message(text, first=first, other=other, **losses)


def _through_contact(impacts: Impacts, y, change) -> float:
    """The change of the speed at which the contact ends."""
    contact, end = impacts.contact, ContactEnd(impacts.contact, impacts.model.contact_speed)
    y, change = _follow(contact, impacts.p, y, change, impacts.longest_contact(y), end)
    if end.outcome != "lifts_off":
        raise NoOrbit("the machine rests: it does not lift off again")
    if not impacts.liftoff(y[None])[1][0]:
        raise NoOrbit("the contact ends where no launch does: the map has no next launch speed")
    data, graph = contact.data(y[None], impacts.p)[0], contact.vector_field
    force = graph.field(graph.x, graph.p)[1][impacts.force_index]
    gradient = np.array(ca.Function("slope", [graph.x, graph.p], [ca.jacobian(force, graph.x)])(y, data)).ravel()
    rates = contact.rates(y, data)
    change = change - rates * (gradient @ change) / (gradient @ rates)
    return float(np.array(impacts.model.contact_speed.weights) @ change)
