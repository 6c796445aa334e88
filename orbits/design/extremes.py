"""Extremes of a motion, such as its highest point: which functions they are of, and where they are on an orbit.

An extreme is located on an orbit by samples of its trajectories. The design statement then has an arc that ends where
the extreme is stationary, so that its value is exact and has derivatives.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ..errors import NoOrbit
from ..flow.trajectory import Trajectory
from ..model.model import Model
from ..model.phase import Affine, Phase
from ..numerics.roots import bracketed_root
from ..periodic.orbit import Orbit

# Samples per step of a trajectory among which an extreme is looked for; it is then found exactly.
SAMPLES_PER_STEP = 24
# What the error says of an orbit without a local extreme.
ABSENT = {
    "gap": "clearance: the gap has no lowest point inside the flight",
    "force": "smallest_contact_force: the force has no lowest value inside the contact",
}


@dataclass(frozen=True)
class Extreme:
    """The largest value that any of several functions of the state takes over the cycle.

    functions : pairs of the phase, "flight" or "contact", and a function (x, p) -> value of its state
    local : whether only local maxima after the start count
    """

    functions: tuple[tuple[str, Callable], ...]
    local: bool = False


@dataclass(frozen=True)
class Place:
    """Where an extreme is taken.

    extreme : its name
    index : which of its functions has the largest value
    kind : "start", "middle" or "inside" of half the phase
    """

    extreme: str
    index: int
    kind: str

    def phase(self, model: Model) -> str:
        """The phase in which the extreme is taken, "flight" or "contact"."""
        return extreme_of(model, self.extreme).functions[self.index][0]

    def function(self, model: Model) -> Callable:
        """The function (x, p) -> value whose maximum the extreme is."""
        return extreme_of(model, self.extreme).functions[self.index][1]


def phase_named(model: Model, name: str) -> Phase:
    """The flight or the contact of a model."""
    return model.flight if name == "flight" else model.contact


def affine(function: Affine, x: Iterable) -> Any:
    """The value of an affine function on a list of numbers or expressions."""
    return sum((w * value for w, value in zip(function.weights, x, strict=False)), function.offset)


def rise_name(height: str) -> str:
    """The name of the quantity that says how far a height rises above its value at lift-off."""
    return f"{height.replace(' ', '_')}_rise"


def height_that_rises(model: Model, name: str, p: Mapping) -> Affine:
    """The height whose rise has this name."""
    return next(height for key, height in model.heights(p).items() if rise_name(key) == name)


@lru_cache(maxsize=256)
def extreme_of(model: Model, name: str) -> Extreme:
    """The extreme of that name: one of those in `quantities.COMPOSITION`, or a rise."""

    def over_cycle(function: Callable) -> tuple:
        """A function of the flight state, over flight and contact."""
        return (("flight", function), ("contact", lambda x, p: function(_embedded(model.embed, x), p)))

    contact_force = lambda x, p: model.contact.watch["contact force"](x, p, [])  # noqa: E731
    match name:
        case "longest":
            return Extreme(over_cycle(lambda x, p: affine(model.extension, x)))
        case "shortest":
            return Extreme(over_cycle(lambda x, p: -affine(model.extension, x)))
        case "gap":
            return Extreme((("flight", lambda x, p: -affine(model.gap(p), x)),), local=True)
        case "separation":
            return Extreme(over_cycle(lambda x, p: -affine(model.separation(p), x)))
        case "force":
            return Extreme((("contact", lambda x, p: -contact_force(x, p)),), local=True)
        case "peak":
            return Extreme((("contact", contact_force),))
        case "tension":
            tension = model.tension
            assert tension is not None  # `quantity_names` leaves it out otherwise
            pull, push = over_cycle(lambda x, p: tension(x, p, [])), over_cycle(lambda x, p: -tension(x, p, []))
            return Extreme((*pull, *push))
    return Extreme((("flight", lambda x, p: affine(height_that_rises(model, name, p), x)),))


def _embedded(matrix: np.ndarray, x: Sequence) -> list:
    """The flight state of a contact state."""
    return [sum((w * value for w, value in zip(row, x, strict=False) if w), 0.0) for row in matrix]


@lru_cache(maxsize=256)
def _value_and_rate(model: Model, names: tuple[str, ...], extreme: str, index: int) -> ca.Function:
    """(x, p) -> value of a function of an extreme, and its rate of change along the motion."""
    name, function = extreme_of(model, extreme).functions[index]
    phase = phase_named(model, name)
    x, p = ca.SX.sym("x", len(phase.states)), ca.SX.sym("p", len(names))
    states, values = ca.vertsplit(x), dict(zip(names, ca.vertsplit(p), strict=True))
    value = ca.SX(function(states, values))
    rate = ca.jacobian(value, x) @ ca.vertcat(*phase.field(states, values, []))
    return ca.Function("extreme", [x, p], [ca.densify(value), rate])


def locate(model: Model, orbit: Orbit, p: Mapping, name: str) -> tuple[Place, float] | None:
    """The place of an extreme on an orbit and its time from the start of the phase, or None if there is none.

    Raises `NoOrbit` for a contact that does not end.
    """
    best, largest, extreme = None, -np.inf, extreme_of(model, name)
    for index, (phase, _) in enumerate(extreme.functions):
        path = orbit.flight if phase == "flight" else orbit.contact
        if path is None:
            raise NoOrbit("; ".join(orbit.violations))
        count = SAMPLES_PER_STEP * len(path.steps)
        t = np.interp(np.arange(count + 1) / SAMPLES_PER_STEP, np.arange(len(path.times)), path.times)
        function = _value_and_rate(model, tuple(p), name, index)
        values = function(path(t)[:, : function.size1_in(0)].T, list(p.values()))[0].full().ravel()
        candidates = np.arange(len(t))
        if extreme.local:
            after = np.append(values[1:], -np.inf)
            candidates = 1 + np.flatnonzero((values[1:] > values[:-1]) & (values[1:] >= after[1:]))
        if not len(candidates):
            continue
        i = int(candidates[np.argmax(values[candidates])])
        if best is None or values[i] > largest:
            # In the middle everything is stationary that depends on positions alone.
            kind = "start" if i == 0 else "middle" if i >= count - 1 else "inside"
            time = _stationary_time(function, p, path, t[i - 1], t[i + 1]) if kind == "inside" else float(t[i])
            best, largest = (Place(name, index, kind), time), values[i]
    return best


def _stationary_time(function: ca.Function, p: Mapping, path: Trajectory, low: float, high: float) -> float:
    """The time between two others at which a function made by `_value_and_rate` is stationary."""
    data = list(p.values())
    rate = lambda t: float(function(path(t)[: function.size1_in(0)], data)[1])  # noqa: E731
    return bracketed_root(rate, float(low), float(high), rate(float(low)), rate(float(high)))


def extreme_values(model: Model, places: Sequence[Place], u: Mapping, ends: Sequence, p: Mapping) -> dict[str, list]:
    """The values of the extremes at their places, by name; the arguments are those of `quantities.expressions`."""
    inside = iter(ends[2:])
    values: dict[str, list] = {}
    for place in places:
        phase = place.phase(model)
        if place.kind == "inside":
            x = next(inside)
        elif place.kind == "start":
            x = model.launch(u, p) if phase == "flight" else model.touchdown(u, p)
        elif phase == "contact":
            x = ends[1]
        else:
            x = ends[-1] if model.reduction else ends[0][: len(model.flight.states)]
        values.setdefault(place.extreme, []).append(place.function(model)(x, p))
    return values


def no_extreme(name: str) -> NoOrbit:
    """The error to raise where an orbit has no local extreme of this name."""
    return NoOrbit(f"the orbit has no {ABSENT[name]}")
