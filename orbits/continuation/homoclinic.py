"""Families that end in a homoclinic orbit: the motion stays longer and longer near an unstable equilibrium.

Let s be the smallest eigenvalue above 0 of an equilibrium. A motion that passes it within the time t starts at the
distance e**(-s t) from the states that never leave it, and the parameter p has that distance from its limit. If half an
orbit stays there for the time t up to its middle, a state that is its own mirror image, it begins at the distance
e**(-2 s t). So the period grows as -n/s log|p - limit|, where the whole orbit passes n times, and dp/dt falls as e**(-2
s t/n), by which the growth is measured. Source: Kuznetsov, Elements of Applied Bifurcation Theory, section 6.2.
"""

from typing import NamedTuple

import casadi as ca
import numpy as np

from ..curves import Points
from ..flow import Flow
from ..numerics import Array
from ..symbolic import BufferedFunction, cached
from ..units import FREQUENCY, TIME, Message, Quantity, described
from .curve import Curve, evaluation_at


class HomoclinicOptions(NamedTuple):
    """When a family tends to a homoclinic orbit; rates of the parameter with the duration are relative to both.

    rounded, settled : a rate below the first is rounding; the parameter settles where it is below the second
    decay, points : the decay of the rate is measured where it falls last by this factor, by this many points or more
    straight : the decay is exponential where its logarithm is straight up to this
    near : distance of the equilibrium from the motion, relative to its states
    steps, last : steps of Newton's method to it, and the step that is rounding, relative to the same
    unstable : an eigenvalue is above 0 where it is a larger share of the largest one
    still : a motion stays near an equilibrium up to the middle of the orbit where the last rates of its half are a
        smaller share of the largest ones
    """

    rounded: float = 1e-10
    settled: float = 0.05
    decay: float = 10.0
    points: int = 4
    straight: float = 0.1
    near: float = 0.05
    steps: int = 30
    last: float = 1e-12
    unstable: float = 1e-6
    still: float = 1e-3


HOMOCLINIC = HomoclinicOptions()


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


class UnstableEquilibrium(NamedTuple):
    """An unstable equilibrium in words, its smallest eigenvalue above 0, and how often an orbit passes it."""

    place: Message
    eigenvalue: float
    passages: int


def homoclinic(
    curve: Curve, last: Points, us: Array, tangents: Array, *, options: HomoclinicOptions = HOMOCLINIC
) -> Homoclinic | None:
    """The homoclinic orbit that a curve of half orbits tends to, None where it tends to none.

    us, tangents : the unknowns (m, n) and the tangents (m, n + 1) of its points in order, up to the last one (1)
    """
    statement, names = curve.equations_of_orbits.statement, curve.equations_of_orbits.statement.unknowns
    times = [i for i, name in enumerate(names) if name in statement.durations and name != "alpha"]
    if not times or not curve.machine.model.reversor or (rest := _nearest_rest(curve, last, options)) is None:
        return None
    i = max(times, key=lambda i: abs(tangents[-1, i] / us[-1, i]))
    settling = {name: names.index(name) for name in statement.tuned}
    settling |= {curve.along: -1} if curve.along in curve.machine.values else {}
    for name, place in settling.items():
        value, rates = last.values[0] if place == -1 else us[-1, place], np.abs(tangents[:, place] / tangents[:, i])
        if (decay := _decay(us[:, i], rates, rates * us[:, i] / abs(value), options)) is None:
            continue
        ahead = tangents[-1, place] / tangents[-1, i] / decay
        limit, error = float(value + ahead), float(abs(ahead) + np.spacing(abs(value)))
        expected, measured = rest.passages / rest.eigenvalue, 2 / decay
        text = (
            "it becomes homoclinic at {name} = {limit:.10g}: it stays longer and longer near the equilibrium {place}, "
        )
        text += "whose smallest eigenvalue above 0 is {eigenvalue:.6g}, and as the distance from there falls by the "
        text += "factor e its period grows by {expected:.6g} (along the family {measured:.6g})"
        growths = {"expected": Quantity(expected, TIME), "measured": Quantity(measured, TIME)}
        eigenvalue = Quantity(rest.eigenvalue, FREQUENCY)
        reason = Message(text, name=name, limit=limit, place=rest.place, eigenvalue=eigenvalue, **growths)
        return Homoclinic(name, limit, error, expected, measured, reason)
    return None


def _decay(t: Array, rates: Array, relative: Array, options: HomoclinicOptions = HOMOCLINIC) -> float | None:
    """The rate at which positive rates (m,) fall exponentially as t (m,) grows, measured where they fall last before
    they are rounding; None where they do not. They are `relative` (m,) to their unit."""
    onward = np.append(0, 1 + np.flatnonzero(np.diff(t) <= 0))[-1]
    clear = onward + np.append(np.flatnonzero(relative[onward:] < options.rounded), len(t) - onward)[0]
    t, rates, relative = t[onward:clear], rates[onward:clear], relative[onward:clear]
    if len(t) < options.points or relative[-1] > options.settled or not rates[0] > options.decay * rates[-1]:
        return None
    first = min(np.flatnonzero(rates > options.decay * rates[-1])[-1], len(t) - options.points)
    t, logs = t[first:], np.log(rates[first:])
    slope, start = np.polyfit(t, logs, 1)
    return float(-slope) if np.abs(logs - start - slope * t).max() < options.straight else None


def _nearest_rest(curve: Curve, last: Points, options: HomoclinicOptions) -> UnstableEquilibrium | None:
    """The equilibrium that the motions at a point come nearest to, None where they come near none that is unstable."""
    evaluation, p = curve.whole(evaluation_at(last)), curve.parameters_at(last.xs)
    best, found = np.inf, None
    for flow, motions in zip(curve.equations_of_orbits.flows, evaluation.trajectories, strict=True):
        states, rates = motions.coefficients[:, : flow.size, 0], motions.coefficients[:, : flow.size, 1]
        size, speeds = np.abs(states).max(), np.abs(rates).max(1)
        if (least := speeds.min() / size) < best:
            i = int(speeds.argmin())
            best, found = least, (flow, states[i], size, bool(speeds[-1] < options.still * speeds.max()))
    if found is None:
        return None
    flow, x, size, up_to_middle = found
    data, near = flow.data(x[None], p[0])[0], x
    for _ in range(options.steps):
        rates, slopes = _linearised(flow)(x, data)
        step = np.linalg.lstsq(slopes, -rates[:, 0], rcond=None)[0]
        x = x + step
        if np.abs(step).max() < options.last * size:
            break
    above = np.linalg.eigvals(_linearised(flow)(x, data)[1]).real
    above = above[above > options.unstable * np.abs(above).max()]
    if not len(above) or np.abs(x - near).max() > options.near * size:
        return None
    moved = [i for i, value in enumerate(np.abs(x).tolist()) if value > options.last * size]
    place = described([flow.phase.states[i] for i in moved], x[moved]) if moved else Message("at 0")
    return UnstableEquilibrium(place, float(above.min()), 1 if up_to_middle else 2)


@cached
def _linearised(flow: Flow) -> BufferedFunction:
    """The rates of a flow and their derivatives by the states, (states, parameters with the data of a piece)."""
    field = flow.vector_field
    rates = field.field(field.x, field.p)[0]
    slopes = ca.jacobian(rates, field.x)
    return BufferedFunction(ca.Function("linearised", [field.x, field.p], [ca.densify(rates), ca.densify(slopes)]))
