"""Families that end in a homoclinic orbit: the motion stays ever longer near an unstable equilibrium.

A motion that is its own mirror image and stays near an equilibrium for the time 2 t comes to the distance e**(-s t) from
it, where s is the smallest eigenvalue above 0 of the equilibrium. Its launch is by the square of this distance away from
that of the motion which never leaves, and so is the parameter of the family: with its limit p*, the period grows as
-log|p - p*|/s. Hence dp/dt falls as e**(-2 s t), by which s is measured along the family. Source: Kuznetsov, Elements of
Applied Bifurcation Theory, section 6.2.
"""

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..flow.flow import Flow
from ..numerics.roots import Array
from ..symbolic.caches import cached
from ..symbolic.calls import BufferedFunction
from ..units import FREQUENCY, Message, Quantity, described
from .curve import Curve, CurvePoint, CurvePoints

# The change of the parameter with the duration, both relative, where its decay is measured: beyond rounding, and where
# further terms are small. There are this many points or more, over which it falls by this factor or more.
DECAYING, FEWEST_POINTS, LEAST_DECAY = (1e-12, 1e-5), 4, 20.0
# The measured decay is exponential where its logarithm is straight up to this.
STRAIGHT = 0.1
# The equilibrium lies within this distance of the motion, relative to its states; the steps of Newton's method to it.
NEAR, STEPS_TO_REST = 0.05, 30
# An eigenvalue is above 0 where it is a larger share of the largest one.
UNSTABLE = 1e-6

Way = Sequence[tuple[Sequence[float], Sequence[float]]]


class Homoclinic(NamedTuple):
    """The homoclinic orbit that a family tends to.

    name, limit, error : of the parameter that settles, its limit, and an estimate of its error
    eigenvalue : the smallest one above 0 of the equilibrium, per unit of time
    measured : the same by the growth of the period along the family
    reason : all of it in words
    """

    name: str
    limit: float
    error: float
    eigenvalue: float
    measured: float
    reason: Message


def homoclinic(curve: Curve, last: CurvePoint, way: Way) -> Homoclinic | None:
    """The homoclinic orbit that a curve of half orbits tends to, None where it tends to none.

    way : the unknowns (n,) and the tangents (n + 1,) of its points in order, up to `last`
    """
    statement = curve.equations_of_orbits.statement
    names, us, tangents = statement.unknowns, *map(np.array, zip(*way, strict=True))
    times = [i for i, name in enumerate(names) if name in statement.durations and name != "alpha"]
    if not times or not curve.machine.model.reversor or (at_rest := _equilibrium(curve, last)) is None:
        return None
    i = max(times, key=lambda i: abs(tangents[-1, i] / us[-1, i]))
    settling = {name: names.index(name) for name in statement.tuned}
    settling |= {curve.along: -1} if curve.along in curve.machine.values else {}
    values, p = np.column_stack([us, np.zeros(len(us))]), last.value
    values[:, -1] = p  # its latest value, where its change is compared with it
    for name, place in settling.items():
        rates = np.abs(tangents[:, place] / tangents[:, i])
        if (decay := _decay(us[:, i], rates, rates * us[:, i] / np.abs(values[:, place]))) is None:
            continue
        limit = values[-1, place] + tangents[-1, place] / tangents[-1, i] / decay
        error = abs(rates[-1] / decay) + float(np.spacing(abs(limit)))
        place_at_rest, eigenvalue = at_rest
        text = "the orbit becomes homoclinic: it stays ever longer near the unstable equilibrium {place}, whose smallest "
        text += "eigenvalue above 0 is {eigenvalue:.6g}; its period grows as -log|{name} - {limit:.10g}|/{measured:.6g}"
        sizes = {"eigenvalue": eigenvalue, "measured": decay / 2}
        numbers = {each: Quantity(size, FREQUENCY) for each, size in sizes.items()}
        reason = Message(text, place=place_at_rest, name=name, limit=limit, **numbers)
        return Homoclinic(name, limit, error, eigenvalue, decay / 2, reason)
    return None


def _decay(t: Array, rates: Array, relative: Array) -> float | None:
    """The rate at which positive rates (m,) fall exponentially as t (m,) grows, in the last stretch in which they are
    small, `relative` (m,) to their unit, and no rounding; None where they do not."""
    last = len(t) - 1 - int(np.argmin((np.diff(t) > 0)[::-1])) if (np.diff(t) <= 0).any() else 0
    chosen = np.flatnonzero((relative > DECAYING[0]) & (relative < DECAYING[1]))
    chosen = chosen[chosen >= last]
    if len(chosen) < FEWEST_POINTS:
        return None
    t, logs = t[chosen], np.log(rates[chosen])
    slope, start = np.polyfit(t, logs, 1)
    straight = np.abs(logs - start - slope * t).max() < STRAIGHT
    return float(-slope) if straight and logs[0] - logs[-1] > np.log(LEAST_DECAY) else None


def _equilibrium(curve: Curve, last: CurvePoint) -> tuple[Message, float] | None:
    """The equilibrium in words that the motions at a point come nearest to, and its smallest eigenvalue above 0; None
    where they come near none that is unstable."""
    evaluation, p = CurvePoints.of([last]).own_evaluation, curve.parameters_at(last.x[None])
    best, found = np.inf, None
    for flow, motions in zip(curve.equations.flows, evaluation.trajectories, strict=True):
        states, rates = motions.coefficients[:, : flow.size, 0], motions.coefficients[:, : flow.size, 1]
        speeds = np.abs(rates).max(1) / np.abs(states).max()
        if speeds.min() < best:
            best, found = speeds.min(), (flow, states[speeds.argmin()], np.abs(states).max())
    if found is None:
        return None
    flow, x, size = found
    data, start = flow.data(x[None], p[0])[0], x
    for _ in range(STEPS_TO_REST):
        rates, slopes = _linearised(flow)(x, data)
        step = np.linalg.lstsq(slopes, -rates[:, 0], rcond=None)[0]
        x = x + step
        if np.abs(step).max() < 1e-13 * size:
            break
    if not np.abs(x - start).max() < NEAR * size:
        return None
    above = np.linalg.eigvals(_linearised(flow)(x, data)[1]).real
    above = above[above > UNSTABLE * np.abs(above).max()]
    return (described(flow.phase.states, x), float(above.min())) if len(above) else None


@cached
def _linearised(flow: Flow) -> BufferedFunction:
    """The rates of a flow and their derivatives by the states, (states, parameters with the data of a piece)."""
    field = flow.vector_field
    rates = field.field(field.x, field.p)[0]
    slopes = ca.jacobian(rates, field.x)
    return BufferedFunction(ca.Function("linearised", [field.x, field.p], [ca.densify(rates), ca.densify(slopes)]))
