"""Families that end in a homoclinic orbit: the motion stays ever longer near an unstable equilibrium.

A motion that passes an equilibrium, whose smallest eigenvalue above 0 is s, within the time t comes from a state at the
distance e**(-s t) from those from which it never leaves; the parameter p is at that distance from its limit, too. Half
an orbit that stays there for the time t up to its middle, a state that is its own mirror image, begins at the distance
e**(-2 s t). So the period grows as -n/s log|p - limit|, where the whole orbit passes n times, and dp/dt falls as
e**(-2 s t/n), by which the growth is measured. Source: Kuznetsov, Elements of Applied Bifurcation Theory, section 6.2.
"""

from typing import NamedTuple

import casadi as ca
import numpy as np

from ..curves import Points
from ..flow.flow import Flow
from ..numerics.roots import Array
from ..symbolic.caches import cached
from ..symbolic.calls import BufferedFunction
from ..units import FREQUENCY, TIME, Message, Quantity, described
from .curve import Curve, evaluation_at

# The change of the parameter with the duration, both relative, is rounding below the first number, and has settled
# where it is below the second. Its decay is measured where it falls last by the third factor, by this many points or
# more.
ROUNDED_RATE, SLOW_RATE, DECAY, FEWEST_POINTS = 1e-10, 0.05, 10.0, 4
# The measured decay is exponential where its logarithm is straight up to this.
STRAIGHT = 0.1
# The equilibrium lies within this distance of the motion, relative to its states; the steps of Newton's method to it,
# and those that are rounding, relative to the same.
NEAR, STEPS_TO_REST, SAME_REST = 0.05, 30, 1e-12
# An eigenvalue is above 0 where it is a larger share of the largest one. A motion stays near an equilibrium up to the
# middle of the orbit where the last rates of its half are a smaller share of the largest ones.
UNSTABLE, STILL_IN_MIDDLE = 1e-6, 1e-3


class Homoclinic(NamedTuple):
    """The homoclinic orbit that a family tends to.

    name, limit, error : of the parameter that settles, its limit, and an estimate of its error
    expected, measured : what the period grows by as the distance of the parameter from its limit falls by the factor e,
        by the equilibrium and along the family
    reason : all of it in words
    """

    name: str
    limit: float
    error: float
    expected: float
    measured: float
    reason: Message


class Rest(NamedTuple):
    """An unstable equilibrium in words, its smallest eigenvalue above 0, and how often an orbit passes it."""

    place: Message
    eigenvalue: float
    passages: int


def homoclinic(curve: Curve, last: Points, us: Array, tangents: Array) -> Homoclinic | None:
    """The homoclinic orbit that a curve of half orbits tends to, None where it tends to none.

    us, tangents : the unknowns (m, n) and the tangents (m, n + 1) of its points in order, up to the last one (1)
    """
    statement, names = curve.equations_of_orbits.statement, curve.equations_of_orbits.statement.unknowns
    times = [i for i, name in enumerate(names) if name in statement.durations and name != "alpha"]
    if not times or not curve.machine.model.reversor or (rest := _nearest_rest(curve, last)) is None:
        return None
    i = max(times, key=lambda i: abs(tangents[-1, i] / us[-1, i]))
    settling = {name: names.index(name) for name in statement.tuned}
    settling |= {curve.along: -1} if curve.along in curve.machine.values else {}
    for name, place in settling.items():
        value, rates = last.values[0] if place == -1 else us[-1, place], np.abs(tangents[:, place] / tangents[:, i])
        if (decay := _decay(us[:, i], rates, rates * us[:, i] / abs(value))) is None:
            continue
        ahead = tangents[-1, place] / tangents[-1, i] / decay
        limit, error = float(value + ahead), float(abs(ahead) + np.spacing(abs(value)))
        expected, measured = rest.passages / rest.eigenvalue, 2 / decay
        text = "it becomes homoclinic at {name} = {limit:.10g}: it stays ever longer near the equilibrium {place}, "
        text += "whose smallest eigenvalue above 0 is {eigenvalue:.6g}, and as the distance from there falls by the "
        text += "factor e its period grows by {expected:.6g} (along the family {measured:.6g})"
        growths = {"expected": Quantity(expected, TIME), "measured": Quantity(measured, TIME)}
        eigenvalue = Quantity(rest.eigenvalue, FREQUENCY)
        reason = Message(text, name=name, limit=limit, place=rest.place, eigenvalue=eigenvalue, **growths)
        return Homoclinic(name, limit, error, expected, measured, reason)
    return None


def _decay(t: Array, rates: Array, relative: Array) -> float | None:
    """The rate at which positive rates (m,) fall exponentially as t (m,) grows, measured where they fall last before
    they are rounding; None where they do not. They are `relative` (m,) to their unit."""
    onward = np.append(0, 1 + np.flatnonzero(np.diff(t) <= 0))[-1]
    clear = onward + np.append(np.flatnonzero(relative[onward:] < ROUNDED_RATE), len(t) - onward)[0]
    t, rates, relative = t[onward:clear], rates[onward:clear], relative[onward:clear]
    if len(t) < FEWEST_POINTS or relative[-1] > SLOW_RATE or not rates[0] > DECAY * rates[-1]:
        return None
    first = min(np.flatnonzero(rates > DECAY * rates[-1])[-1], len(t) - FEWEST_POINTS)
    t, logs = t[first:], np.log(rates[first:])
    slope, start = np.polyfit(t, logs, 1)
    return float(-slope) if np.abs(logs - start - slope * t).max() < STRAIGHT else None


def _nearest_rest(curve: Curve, last: Points) -> Rest | None:
    """The equilibrium that the motions at a point come nearest to, None where they come near none that is unstable."""
    evaluation, p = curve.whole(evaluation_at(last)), curve.parameters_at(last.xs)
    best, found = np.inf, None
    for flow, motions in zip(curve.equations_of_orbits.flows, evaluation.trajectories, strict=True):
        states, rates = motions.coefficients[:, : flow.size, 0], motions.coefficients[:, : flow.size, 1]
        size, speeds = np.abs(states).max(), np.abs(rates).max(1)
        if (least := speeds.min() / size) < best:
            i = int(speeds.argmin())
            best, found = least, (flow, states[i], size, bool(speeds[-1] < STILL_IN_MIDDLE * speeds.max()))
    if found is None:
        return None
    flow, x, size, up_to_middle = found
    data, near = flow.data(x[None], p[0])[0], x
    for _ in range(STEPS_TO_REST):
        rates, slopes = _linearised(flow)(x, data)
        step = np.linalg.lstsq(slopes, -rates[:, 0], rcond=None)[0]
        x = x + step
        if np.abs(step).max() < SAME_REST * size:
            break
    above = np.linalg.eigvals(_linearised(flow)(x, data)[1]).real
    above = above[above > UNSTABLE * np.abs(above).max()]
    if not len(above) or np.abs(x - near).max() > NEAR * size:
        return None
    moved = [i for i, value in enumerate(np.abs(x).tolist()) if value > SAME_REST * size]
    place = described([flow.phase.states[i] for i in moved], x[moved]) if moved else Message("at 0")
    return Rest(place, float(above.min()), 1 if up_to_middle else 2)


@cached
def _linearised(flow: Flow) -> BufferedFunction:
    """The rates of a flow and their derivatives by the states, (states, parameters with the data of a piece)."""
    field = flow.vector_field
    rates = field.field(field.x, field.p)[0]
    slopes = ca.jacobian(rates, field.x)
    return BufferedFunction(ca.Function("linearised", [field.x, field.p], [ca.densify(rates), ca.densify(slopes)]))
