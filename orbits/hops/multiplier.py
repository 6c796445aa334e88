"""The multiplier of a hop: the derivative of the next launch speed with respect to the launch speed.

A perturbation grows along each phase by the transition matrix of that phase. The saltation matrix carries it through an
event: the field before shifts the event in time, and the reset follows. On a lossless orbit the foot lands
tangentially, so that the time of landing moves like the cube root of the perturbation. Then there is no multiplier, and
the map behaves like C d**(4/3) instead (`Certificate.loss_coefficient`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias, cast

import numpy as np

from ..errors import FlowError, InputError, NoOrbit, finite_number
from ..flow import Flow
from ..model import Affine, Machine
from ..periodic import LOSSES, bounce_factors, hand_over_factors, jerk_jumps, loss_coefficient, mass_of_landing
from ..running import exclusive
from ..units import DIMENSIONS, LIFTOFF_SPEED, SPEED, Message, Quantity, in_own_units
from .arcs import Arcs, Flown, Rules, integrated
from .flyer import Flyer
from .hand_over import Landed, share_left, standing
from .hysteresis import Branches
from .impacts import CAP, FASTEST_LAUNCH, STATUSES, ContactStop, Impacts, impacts_of, no_launch
from .points_of_contact import LIFTS_OFF, REVERSES, STEPS_BACK, Foot
from .sticking_contact import FALLS, SLIPS

RESTS = "the machine rests: it does not lift off again"
SLOWEST_LAUNCH_VARIED = 1e-150  # the square of a slower launch, and its inverse, are not finite
TANGENTIAL = 1e-7  # an impact slower than this, relative to the launch speed, is tangential


# The state at the first landing, the speed of the gap, its derivatives there, and the foot.
_FirstLanding: TypeAlias = tuple[np.ndarray, float, np.ndarray, Foot]


@exclusive
def multiplier(machine: Machine, alpha: float) -> float:
    """The multiplier d(next launch speed)/d(launch speed) of the hop that starts with `alpha`.

    machine : as for `ReturnMap`
    alpha : launch speed, in the machine's units

    It follows from the variational equations with saltation at impacts (Aizerman and Gantmakher 1958). Raises `NoOrbit`
    where there is none: the machine does not lift off again, or lands tangentially, and `InputError` for an invalid
    launch speed.

    >>> from orbits import multiplier
    >>> from problems import Hopper
    >>> round(multiplier(Hopper(), 4.6), 6)
    -1.616561
    """
    if not machine.model.one_speed:
        raise InputError(
            f"a launch of a {machine.model.name} has several numbers: multipliers(machine, launch) returns all "
            "multipliers"
        )
    alpha = finite_number("alpha", alpha)
    if alpha <= 0:
        raise InputError(f"alpha = {alpha:g}; a launch speed must be above 0")
    return _slope_of_hop(machine, alpha)


@in_own_units((), alpha=LIFTOFF_SPEED)
def _slope_of_hop(machine: Machine, alpha: float) -> float:
    """The `multiplier` of the hop that starts with a speed above 0."""
    if not SLOWEST_LAUNCH_VARIED <= alpha <= FASTEST_LAUNCH:
        text = "alpha = {alpha:g}; to be varied, a launch speed must lie between {low:g} and {high:g}"
        bounds = {"alpha": alpha, "low": SLOWEST_LAUNCH_VARIED, "high": FASTEST_LAUNCH}
        raise InputError(Message(text, **{name: Quantity(x, LIFTOFF_SPEED) for name, x in bounds.items()}))
    return slope_of_hop(Branches(machine) if machine.model.hysteretic else impacts_of(machine), alpha)


def slope_of_hop(rules: Rules, alpha: float) -> float:
    """The `multiplier` of the hop of a dimensionless machine with these impacts."""
    impacts = rules.first()
    x = impacts.launch(np.array([alpha]))[0]
    step = 1e-5 * alpha  # The extension of the launch state depends on the launch speed too where there is damping.
    low, high = impacts.launch(np.array([alpha - step, alpha + step]))
    if not impacts.opens(x[None])[0]:
        raise NoOrbit(no_launch(alpha))
    hop = hop_derivative(rules, x, (high - low)[:, None] / (2 * step))
    if hop.tangential:
        text, law = "the landing is tangential, at speed {speed:.1e}, so there is no multiplier", None
        if rules is impacts:
            text, law = text + "; {law}", _one_sided(impacts, alpha, hop)
        raise NoOrbit(Message(text, speed=Quantity(hop.speed, SPEED), law=law))
    if not hop.impacts.liftoff(hop.liftoff[None])[1][0]:
        raise NoOrbit("the contact ends where no launch begins: the map has no next launch speed")
    return float(np.array(impacts.model.contact_speed.weights) @ hop.derivative[:, 0])


@dataclass(frozen=True, eq=False)
class HopDerivative:
    """A hop with the derivative of its end by c numbers that its launch depends on.

    liftoff : the contact state (k,) at the next lift-off
    derivative : of that state (k, c), on the surface where the contact force vanishes
    tangential : whether the first landing is tangential, as that of a lossless hop
    landing, speed, gap_slopes : flight state (n,) at the first landing, the speed of the gap, and the derivative (c,)
        of the gap at the time of that landing
    foot : that touches at that landing
    impacts : the rules at the lift-off
    """

    liftoff: np.ndarray
    derivative: np.ndarray
    tangential: bool
    landing: np.ndarray
    speed: float
    gap_slopes: np.ndarray
    foot: Foot
    impacts: Impacts


def hop_derivative(rules: Rules, x: np.ndarray, change: np.ndarray) -> HopDerivative:
    """The hop from a flight state (n,) at lift-off, and its derivative along changes (n, c) of that state.

    Raises `NoOrbit` where the machine does not lift off again.
    """
    launch_speed = float(np.abs(x[[name.endswith("'") for name in rules.first().flight.phase.states]]).max())
    if launch_speed < SLOWEST_LAUNCH_VARIED:
        text = "the launch has no speed above {low:g}: a slower one cannot be varied"
        raise NoOrbit(Message(text, low=Quantity(SLOWEST_LAUNCH_VARIED, SPEED)))
    hops = Flown.begun(rules, x[None], record=True)
    flyer, first, change = Flyer(rules, hops, thorough=True), cast("_FirstLanding | None", None), np.array(change)
    flyer.to_contact()
    for arc, derivative in _derivatives(hops.arcs, rules):
        impacts, end, start = arc.phase.impacts, arc.ends[0], change
        if not arc.phase.side:
            raise NoOrbit("the spring sticks in flight: no multiplier is computed there")
        change = derivative @ change
        if arc.landed is not None:
            foot = impacts.feet[int(arc.foot[0])]
            speed = float(foot.speed @ end)
            # Later bounces may be arbitrarily slow.
            if (first is None or speed == 0) and abs(speed) < TANGENTIAL * launch_speed:
                landing = end, speed, np.array(foot.gap.weights) @ change, foot
                if not isinstance(rules, Branches):
                    stood = tangential_landing(impacts, (arc.starts[0], start), float(arc.durations[0]), end, foot)
                    end, change = through_contact(impacts, *stood, grazes=True)
                return HopDerivative(end, change, True, *landing, impacts)
            first = first or (end, speed, np.array(foot.gap.weights) @ change, foot)
            change = _through_impact(arc, arc.landed, _at_landing(impacts, foot, end, change))
    flights = len(hops.arcs)
    flyer.fly()
    if hops.status[0] != LIFTS_OFF or first is None:
        raise NoOrbit(_reason(hops, rules.first()))
    change = rules.first().onto_contact @ change
    for _, derivative in _derivatives(hops.arcs[flights:], rules):
        change = derivative @ change
    impacts = hops.arcs[-1].phase.impacts
    if hops.arcs[-1].step:
        signs = np.array(impacts.model.relabelling.signs)[:, None]
        change = impacts.onto_contact @ (signs * (impacts.model.embed @ change))
    return HopDerivative(hops.ends[0], _at_liftoff(impacts, hops.ends[0], change), False, *first, impacts)


def _derivatives(arcs: Sequence[Arcs], rules: Rules) -> Iterator[tuple[Arcs, np.ndarray]]:
    """Arcs of one motion, with the derivatives (k, k) of their ends by their starts: at a fixed time, or where the
    spring reverses."""
    for arc, again in zip(arcs, integrated(arcs, sensitive=True), strict=True):
        if isinstance(again, FlowError):
            raise NoOrbit(Message("the {name} does not end: {error}", name=arc.phase.flow.phase.name, error=again))
        derivative = np.eye(arc.phase.flow.size) if again is None else again[1]
        if arc.kind == REVERSES and isinstance(rules, Branches):
            derivative = _at_reversal(arc, rules.rates[arc.phase.contact], derivative)
        yield arc, derivative


def _reason(hops: Flown, impacts: Impacts) -> str | Message:
    """Why a motion does not lift off again."""
    status, phase = str(hops.status[0]), impacts.contact if hops.on_ground[0] else impacts.flight
    if 0 in hops.reasons:
        return Message("the {name} does not end: {error}", name=phase.phase.name, error=hops.reasons[0])
    if status == "cap":
        return f"the machine has not come to rest on the ground after {CAP} impacts"
    if status == "leaves_elsewhere" and np.any(hops.arcs[-1].step):
        return "the contact ends with a step back: the map has no next launch speed"
    if status == "leaves_elsewhere":
        return "the contact ends where no launch begins: the map has no next launch speed"
    return RESTS if status in ("rests", "collapses") else STATUSES[status]


def _at_reversal(arc: Arcs, rate: Affine, change: np.ndarray) -> np.ndarray:
    """The change (k, c) of the state in which a spring with hysteresis reverses, from that at a fixed time."""
    (x,), flow, weights = arc.phase.states(arc.ends), arc.phase.flow, np.array(rate.weights)
    rates = flow.rates(x, flow.data(x[None], arc.phase.impacts.p)[0])
    if (turning_rate := float(weights @ rates)) == 0.0:
        raise NoOrbit("the spring stops without turning: no multiplier is computed there")
    return change - np.outer(rates, weights @ change) / turning_rate


def _at_landing(impacts: Impacts, foot: Foot, x: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The change (n, c) of the state in which the gap of a foot closes, from that at a fixed time."""
    rates, weights = impacts.flight.rates(x, impacts.flight.data(x[None], impacts.p)[0]), np.array(foot.gap.weights)
    return change - np.outer(rates, weights @ change) / float(foot.speed @ x)


def _through_impact(arc: Arcs, landed: Landed, change: np.ndarray) -> np.ndarray:
    """The change (n, c) of the state after a landing, from that of the state in which the gap is closed."""
    impacts, x, held, left = arc.phase.impacts, arc.ends[0], bool(landed.held[0]), float(landed.left[0])
    if impacts.model.grazes:
        return _through_catch(impacts, x, int(arc.foot[0]), landed, change)
    if labels := impacts.feet[int(arc.foot[0])].labels:
        x, change = labels(x, impacts.values), np.array(labels.signs)[:, None] * change
    moved = np.stack([impacts.change_after(x, each, 1.0 - left).full().ravel() for each in change.T], axis=1)
    if left > 0:  # a hand-over, whose share may depend on where it happens
        slope = impacts.share_slope(x).full().ravel() @ change
        moved += float(impacts.gap_speed @ x) * np.outer(impacts.direction(x[None])[0], slope)
    if landed.foot[0] and not held:  # a step back
        moved = np.array(impacts.model.relabelling.signs)[:, None] * moved
    return moved


def _through_catch(impacts: Impacts, x: np.ndarray, foot: int, landed: Landed, change: np.ndarray) -> np.ndarray:
    """The change (n, c) after a landing of feet that stick, from that of the flight state (n,) before it."""
    if landed.order[0] == 1:
        return np.stack([impacts.change_let_go[foot](x, each).full().ravel() for each in change.T], axis=1)
    moved = np.stack([impacts.change_after(x, each, 1.0).full().ravel() for each in change.T], axis=1)
    steps = foot + (int(landed.foot[0]) and not landed.held[0])
    return np.array(impacts.model.relabelling.signs)[:, None] ** steps * moved


def tangential_landing(
    impacts: Impacts, start: tuple, lasted: float, landing: np.ndarray, foot: Foot
) -> tuple[np.ndarray, np.ndarray]:
    """The contact state (k,) after a landing that is tangential, in a flight state (n,), and the change (k, c) of it:
    of a flight from a state and its change (n, c) for about the time `lasted`.

    The time of landing has no derivative there, and moves like the cube root s of the change of the gap. But flight
    and contact have the same rates at the landing, where the contact force vanishes, and differ only in the direction D
    of impacts. Over the time s, impacts change the speed of the gap by some s^2, and its height by s^3 in all. So up to
    s^4 the state is that of the flight, from which multiples of D and of its commutator W with the rates are taken that
    close the gap and stop it: the derivative is this projection onto the contact. It is continuous there. What sticks
    is stopped too, in its own direction, and while the gap closes it goes along by the ratio r of their jerks: the
    multiple of W is one of W + r W_x.
    """
    jerk, snap = foot.rates(landing[None], impacts.p)[:, 0]
    data = impacts.flight.data(landing[None], impacts.p)[0]
    if not jerk < 0:
        raise NoOrbit("the gap closes without a jerk: the landing is tangential to a higher order")
    off = np.finfo(float).eps * lasted * np.abs(landing).max()
    ps, weights = np.atleast_2d(impacts.p), foot.gap.weights
    if jerk_jumps(impacts.flight, weights, landing[None], ps, np.array([jerk]), off).any():
        raise NoOrbit("a law has a corner at lift-off: near this hop there are neither multipliers nor a power law")
    # The landing that rounding lets happen early or late is led to where the acceleration of the gap vanishes.
    late = float(foot.speed @ impacts.flight.rates(landing, data)) / jerk
    if not abs(late) < lasted:
        raise NoOrbit("the flight is so short that rounding decides when it lands: launch faster")
    exact = lasted - late - 0.5 * snap / jerk * late**2
    path, variations = impacts.flight.run(start[0], impacts.p, exact, seeds=start[1])
    x = path.end[: impacts.flight.size]
    shares, two = impacts.shares_of_landing(x[None], foot, impacts.p), impacts.model.grazes
    if foot.labels and not two:
        x, variations = foot.labels(x, impacts.values), np.array(foot.labels.signs)[:, None] * variations
    (taken,), rows = impacts.projection(x[None], shares, impacts.p)
    x, variations = x - taken @ [impacts.gap(x), *(rows[1:] @ x)], variations - taken @ (rows @ variations)
    if foot.labels and two:  # the other foot stands while this one lands
        x, variations = foot.labels(x, impacts.values), np.array(foot.labels.signs)[:, None] * variations
    return impacts.onto_contact @ x, impacts.onto_contact @ variations


def _follow(flow: Flow, p, x, change, limit: float, stop) -> tuple[np.ndarray, np.ndarray, float]:
    """State and change (n, c) where a phase stops, and the time that it lasted."""
    try:
        path, variations = flow.run(x, p, limit, seeds=change, stop=stop)
    except FlowError as error:
        raise NoOrbit(Message("the {name} does not end: {error}", name=flow.phase.name, error=error)) from None
    return path.end[: flow.size], variations, float(path.times[-1])


def losses_beside(impacts: Impacts, hop: HopDerivative, slope: float, power: float) -> tuple[float, float] | None:
    """The coefficients of d**(4/3) in the losses near a hop that lands tangentially, without and with a bounce, where d
    is a number with this slope of the gap and this `power`, the slope of the energy; None where there are none."""
    x, jerk = hop.landing, -float(hop.foot.rates(hop.landing[None], impacts.p)[0, 0])
    if not jerk > 0 or slope == 0:
        return None
    first = impacts.feet[0] if impacts.model.grazes else hop.foot
    thirds = np.array([each.rates(x[None], impacts.p)[0, 0] for each in (first, *impacts.footing.held)])
    mass = mass_of_landing(impacts.model, x, impacts.values, thirds)
    c = loss_coefficient(mass, jerk, abs(slope), power)
    if not impacts.model.changes_contact or impacts.model.sticks:
        if impacts.restitution > LOSSES.most_left**2:
            return None
        late, early = bounce_factors(impacts.restitution)
        return float(c * late), float(c * early)
    z, _ = standing(impacts, x[None], np.array([impacts.feet.index(hop.foot)]))
    rho = float(share_left(impacts, z)[0])
    # Without a loss, and where it is not known, there is no such law.
    if not rho < 1:
        return None
    late, early = hand_over_factors(max(rho, 0.0))
    return float(c * late), float(c * early)


def _one_sided(impacts: Impacts, alpha: float, hop: HopDerivative) -> Message:
    """The power law that replaces the multiplier where a hop lands tangentially."""
    slope = hop.gap_slopes[0]
    if (found := losses_beside(impacts, hop, slope, impacts.launch_inertia * alpha)) is None:
        return Message("there is no power law either")
    text = "a launch at alpha {first} d loses {c:.4g} d**(4/3), a launch at alpha {other} d {more:.4g} d**(4/3)"
    first, other = ("+", "-") if slope > 0 else ("-", "+")
    c, more = (Quantity(loss, DIMENSIONS["loss_coefficient"]) for loss in found)
    return Message(text, first=first, other=other, c=c, more=more)


def through_contact(impacts: Impacts, y: np.ndarray, change: np.ndarray, grazes: bool) -> tuple[np.ndarray, np.ndarray]:
    """The state and its change (k, c) at which the contact ends."""
    contact, model = impacts.contact, impacts.model
    end = ContactStop(impacts, model.contact_speed, (grazes and not model.changes_contact, grazes))
    y, change, _ = _follow(contact, impacts.p, y, change, impacts.longest_contact(y), end)
    if end.outcome in ("stays", SLIPS, FALLS):
        raise NoOrbit(STATUSES[end.outcome])
    if end.outcome not in (LIFTS_OFF, STEPS_BACK):
        raise NoOrbit(RESTS)
    if end.outcome == STEPS_BACK:
        if (way := impacts.exits[1]).foot:
            raise NoOrbit("the contact ends with a step back: the map has no next launch speed")
        y = impacts.onto_contact @ way.opened(model.embed @ y, impacts.values)
        change = impacts.onto_contact @ (np.array(model.relabelling.signs)[:, None] * (model.embed @ change))
    return y, _at_liftoff(impacts, y, change)


def _at_liftoff(impacts: Impacts, y: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The change (k, c) of the state in which the contact ends, from that at a fixed time."""
    gradient = impacts.force_gradient(y)
    rates = impacts.contact.rates(y, impacts.contact.data(y[None], impacts.p)[0])
    return change - np.outer(rates, gradient @ change) / (gradient @ rates)
