"""What may be asked of an orbit while it is designed: its quantities as expressions of what a statement solves for.

The words are those of an orbit's document. A quantity at one place of the motion (its middle, its start) is read there;
an extreme, as the highest point of a mass, is read at the end of an arc of its own that stops where the extreme is
stationary. The loss coefficient needs how the landing depends on the launch: the first variation of half the flight
with respect to alpha, and the adjoint that carries it back over the mirrored half.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from ..errors import InputError, NoOrbit
from ..flow.trajectory import Trajectory
from ..model.model import Model, Units
from ..model.phase import Affine, Arc, Phase, Statement
from ..numerics.roots import bracketed_root
from ..periodic.formulations import half_orbit
from ..periodic.local_law import loss_coefficient
from ..periodic.orbit import Orbit

# Quantities of every orbit and the powers of length, time and force in their units. C is a loss of speed per speed to
# the power 4/3.
DIMENSIONS = {
    "alpha": (1, -1, 0),
    "flight_time": (0, 1, 0),
    "contact_time": (0, 1, 0),
    "period": (0, 1, 0),
    "liftoff_extension": (1, 0, 0),
    "stroke": (1, 0, 0),
    "clearance": (1, 0, 0),
    "smallest_separation": (1, 0, 0),
    "smallest_contact_force": (0, 0, 1),
    "largest_contact_force": (0, 0, 1),
    "largest_spring_force": (0, 0, 1),
    "landing_jerk": (1, -3, 0),
    "landing_sensitivity": (0, 1, 0),
    "loss_coefficient": (-1 / 3, 1 / 3, 0),
}
VARIED = ("landing_sensitivity", "loss_coefficient")
# Samples of a motion's step among which an extreme is looked for; the statement then finds it exactly.
SAMPLES_PER_STEP = 24


@dataclass(frozen=True)
class Extreme:
    """The largest value that any of several functions of the state takes over the cycle.

    over : (phase, function (x, p) -> value) of each, the phase "flight" or "contact"; by index in `named`
    local : only local maxima after the start count
    """

    over: tuple[tuple[str, Callable], ...]
    local: bool = False


@dataclass(frozen=True)
class Place:
    """Where an extreme is: `extreme` by name, which of its functions, and at the "start", "middle" or "inside" of the
    half motion."""

    extreme: str
    index: int
    kind: str


def quantity_names(model: Model, p: Mapping) -> list[str]:
    """The quantities of a model's orbits."""
    missing = [] if model.tension else ["largest_spring_force"]
    missing += [] if model.separation(p) is not None else ["smallest_separation"]
    return [name for name in DIMENSIONS if name not in missing] + [_rise(height) for height in model.heights(p)]


def unit_of(name: str, units: Units) -> float:
    """What one unit of a quantity stands for in SI."""
    a, b, c = DIMENSIONS.get(name, (1, 0, 0))
    return units.length**a * units.time**b * units.force**c


def _rise(height: str) -> str:
    return f"{height.replace(' ', '_')}_rise"


def affine(function: Affine, x):
    """The value of an affine function on a list of expressions."""
    return sum((w * value for w, value in zip(function.weights, x, strict=False)), function.offset)


# Which extremes a quantity is made of, and how.
PARTS = {
    "stroke": ("longest", "shortest"),
    "clearance": ("gap",),
    "smallest_separation": ("separation",),
    "smallest_contact_force": ("force",),
    "largest_contact_force": ("peak",),
    "largest_spring_force": ("tension",),
}


def parts_of(name: str) -> tuple[str, ...]:
    """The extremes that a quantity is made of, by name."""
    return (name,) if name.endswith("_rise") else PARTS.get(name, ())


@lru_cache(maxsize=256)
def extreme_of(model: Model, name: str) -> Extreme:
    """The extreme of that name."""
    matrix = model.embed

    def cycle(function: Callable) -> tuple:
        """A function of the flight state over flight and contact."""
        embedded = lambda x, p: function(_embed(matrix, x), p)  # noqa: E731
        return (("flight", function), ("contact", embedded))

    force = lambda x, p: model.contact.watch["contact force"](x, p, [])  # noqa: E731
    match name:
        case "longest":
            return Extreme(cycle(lambda x, p: affine(model.extension, x)))
        case "shortest":
            return Extreme(cycle(lambda x, p: -affine(model.extension, x)))
        case "gap":
            return Extreme((("flight", lambda x, p: -affine(model.gap(p), x)),), local=True)
        case "separation":
            return Extreme(cycle(lambda x, p: -affine(model.separation(p), x)))
        case "force":
            return Extreme((("contact", lambda x, p: -force(x, p)),), local=True)
        case "peak":
            return Extreme((("contact", force),))
        case "tension":
            pull, push = (lambda x, p, s=s: s * model.tension(x, p, []) for s in (1, -1))
            return Extreme((*cycle(pull), *cycle(push)))
    rising = lambda x, p: affine(next(h for key, h in model.heights(p).items() if _rise(key) == name), x)  # noqa: E731
    return Extreme((("flight", rising),))


def _embed(matrix: np.ndarray, x) -> list:
    return [sum((w * value for w, value in zip(row, x, strict=False) if w), 0.0) for row in matrix]


@lru_cache(maxsize=256)
def _extreme_function(model: Model, names: tuple[str, ...], extreme: str, index: int) -> ca.Function:
    phase, function = extreme_of(model, extreme).over[index]
    x = ca.SX.sym("x", len((model.flight if phase == "flight" else model.contact).states))
    p = ca.SX.sym("p", len(names))
    arguments = ca.vertsplit(x), dict(zip(names, ca.vertsplit(p), strict=True))
    value = ca.SX(function(*arguments))
    field = (model.flight if phase == "flight" else model.contact).field(*arguments, [])
    return ca.Function("extreme", [x, p], [ca.densify(value), ca.jacobian(value, x) @ ca.vertcat(*field)])


def locate(model: Model, orbit: Orbit, p: Mapping, extreme: str) -> tuple[Place, float, float] | None:
    """Where an extreme is on an orbit, the time from the motion's start, and its value; None where it has none."""
    best, what = None, extreme_of(model, extreme)
    for index, (phase, _) in enumerate(what.over):
        path = orbit.flight if phase == "flight" else orbit.contact
        count = SAMPLES_PER_STEP * len(path.steps)
        t = np.interp(np.arange(count + 1) / SAMPLES_PER_STEP, np.arange(len(path.times)), path.times)
        function = _extreme_function(model, tuple(p), extreme, index)
        n, data = function.size1_in(0), list(p.values())
        values = function(path(t)[:, :n].T, data)[0].full().ravel()
        top = np.arange(len(t))
        if what.local:
            ahead = np.append(values[1:], -np.inf)
            top = 1 + np.flatnonzero((values[1:] > values[:-1]) & (values[1:] >= ahead[1:]))
        if not len(top):
            continue
        i = int(top[np.argmax(values[top])])
        # the middle is stationary for all that depends on positions alone
        kind = "start" if i == 0 else "middle" if i >= count - 1 else "inside"
        time = float(t[i])
        if kind == "inside":
            time = _turn(function, data, path, t[i - 1 : i + 2])
        if best is None or values[i] > best[2]:
            best = Place(extreme, index, kind), time, float(values[i])
    return best


def _turn(function: ca.Function, p, path: Trajectory, times) -> float:
    """The time between the first and the last of three at which a function of `_extreme_function` is stationary."""
    rate = lambda t: float(function(path(t)[: function.size1_in(0)], p)[1])  # noqa: E731
    a, b = float(times[0]), float(times[-1])
    return bracketed_root(rate, a, b, rate(a), rate(b))


@lru_cache(maxsize=128)
def design_statement(model: Model, varied: bool, places: tuple[Place, ...]) -> Statement:
    """Half a flight by the simplest statement that the model allows, half the contact, and an arc up to every place
    that has none: all unknowns of an orbit and of what is asked of it.

    Unknowns: those of the simplest statement; "contact", half its time; "at 0", ..., the times of places inside.
    Raises `InputError` for a model whose motions are not their own mirror images, or are in pieces.
    """
    if not model.reversor:
        raise InputError("a design needs a machine whose motion is its own mirror image in time: leave out the damping")
    if model.flight.pieces or model.contact.pieces:
        raise InputError(
            "a law in pieces cannot be designed: it has no second derivatives everywhere; write it as one formula"
        )
    base = base_statement(model)
    (arc,) = base.arcs
    arcs = [_varied(model, arc) if varied else arc]
    arcs.append(
        Arc(
            model.contact,
            start=lambda u, before, p: model.touchdown(u, p),
            duration=lambda u, p: u["contact"],
            conditions=lambda u, x, p: [affine(model.contact_speed, x)],
        )
    )
    times = [f"at {i}" for i, place in enumerate(places) if place.kind == "inside"]
    arcs += [_to_place(model, place, f"at {i}") for i, place in enumerate(places) if place.kind == "inside"]
    if model.reduction and any(_is_middle_of_flight(model, place) for place in places):
        flight = Arc(model.flight, lambda u, before, p: model.launch(u, p), arc.duration, lambda u, x, p: [])
        arcs.append(flight)
    return Statement("design", (*base.unknowns, "contact", *times), tuple(arcs), (*base.durations, "contact", *times))


def base_statement(model: Model) -> Statement:
    """The simplest statement of a model's orbits."""
    if model.reduction:
        return model.reduction.statement
    return half_orbit(model)


def _is_middle_of_flight(model: Model, place: Place) -> bool:
    return place.kind == "middle" and extreme_of(model, place.extreme).over[place.index][0] == "flight"


def _to_place(model: Model, place: Place, time: str) -> Arc:
    where, function = extreme_of(model, place.extreme).over[place.index]
    phase, start = (model.flight, model.launch) if where == "flight" else (model.contact, model.touchdown)

    def rate(u, x, p):
        value = ca.SX(function(x, p))
        return [ca.jacobian(value, ca.vertcat(*x)) @ ca.vertcat(*phase.field(x, p, []))]

    return Arc(phase, lambda u, before, p: start(u, p), lambda u, p: u[time], rate)


def _varied(model: Model, arc: Arc) -> Arc:
    """An arc whose states are the motion, its derivative by alpha, and the adjoint of the gap at landing."""
    phase, n = arc.phase, len(arc.phase.states)
    signs = model.reduction.reversor if model.reduction else model.reversor

    def field(x, p, q):
        motion = ca.vertcat(*x[:n])
        rates = ca.vertcat(*phase.field(x[:n], p, q))
        slope = ca.jacobian(rates, motion)
        change, adjoint = slope @ ca.vertcat(*x[n : 2 * n]), -slope.T @ ca.vertcat(*x[2 * n :])
        return [*ca.vertsplit(rates), *ca.vertsplit(ca.densify(change)), *ca.vertsplit(ca.densify(adjoint))]

    def start(u, before, p):
        at_launch = _by_alpha(lambda u: arc.start(u, before, p), u)
        gap = [sign * w for sign, w in zip(signs, _gap_weights(model, n, p), strict=True)]
        return [*arc.start(u, before, p), *at_launch, *gap]

    states = (*phase.states, *(f"d{name}" for name in phase.states), *(f"gap by {name}" for name in phase.states))
    return Arc(
        Phase(phase.name, states, field),
        start,
        arc.duration,
        lambda u, x, p: arc.conditions(u, x[:n], p),
        lambda u, x, p, q: arc.guard(u, x[:n], p, q),
    )


def _gap_weights(model: Model, n: int, p) -> list:
    """Derivatives of the gap at landing by the state of the simplest statement there."""
    if not model.reduction:
        return list(model.gap(p).weights)
    slope, zero = model.reduction.gap_slope, [0.0] * n
    return [slope(0.0, [float(i == j) for j in range(n)], p) - slope(0.0, zero, p) for i in range(n)]


def _by_alpha(function: Callable, u: Mapping) -> list:
    """Derivative of a list of plain expressions by the launch speed, a number or a symbol."""
    if isinstance(u["alpha"], ca.SX):
        values = ca.vertcat(*function(u))
        return ca.vertsplit(ca.densify(ca.jacobian(values, u["alpha"])))
    return [complex(x).imag * 1e30 for x in function({**u, "alpha": u["alpha"] + 1e-30j})]


def expressions(model: Model, names: list[str], places: tuple[Place, ...], u: Mapping, ends: list, p: Mapping) -> dict:
    """The quantities of these names, from the unknowns, the states at the ends of a design statement's arcs (lists),
    and the parameters; all are scalar symbols."""
    at = extremes(model, places, u, ends, p)
    half, contact = base_statement(model).arcs[0].duration(u, p), u["contact"]
    found = {}
    for name in names:
        parts = [at[part][0] for part in parts_of(name)]
        match name:
            case "alpha":
                value = u["alpha"]
            case "flight_time":
                value = 2 * half
            case "contact_time":
                value = 2 * contact
            case "period":
                value = 2 * (half + contact)
            case "liftoff_extension":
                value = u["liftoff"]
            case "stroke":
                value = parts[0] + parts[1]
            case "clearance" | "smallest_separation" | "smallest_contact_force":
                value = -parts[0]
            case "largest_contact_force" | "largest_spring_force":
                value = parts[0]
            case "landing_jerk":
                value = -_jerk(model, u, p)
            case "landing_sensitivity":
                value = _gap_slope(model, half, ends[0], p)
            case "loss_coefficient":
                value = _loss(model, _jerk(model, u, p), _gap_slope(model, half, ends[0], p), u, p)
            case _:
                height = next(h for key, h in model.heights(p).items() if _rise(key) == name)
                value = parts[0] - affine(height, model.launch(u, p))
        found[name] = value
    return found


def extremes(model: Model, places: tuple[Place, ...], u: Mapping, ends: list, p: Mapping) -> dict[str, list]:
    """The values of the extremes at their places, by name."""
    inside, found = iter(ends[2:]), {}
    for place in places:
        phase, function = extreme_of(model, place.extreme).over[place.index]
        if place.kind == "inside":
            x = next(inside)
        elif place.kind == "start":
            x = model.launch(u, p) if phase == "flight" else model.touchdown(u, p)
        elif phase == "contact":
            x = ends[1]
        else:
            x = ends[-1] if model.reduction else ends[0][: len(model.flight.states)]
        found.setdefault(place.extreme, []).append(function(x, p))
    return found


def _jerk(model: Model, u: Mapping, p: Mapping):
    """Third derivative of the gap at lift-off, which is minus that at landing."""
    x = ca.SX.sym("x", len(model.flight.states))
    rates = ca.vertcat(*model.flight.field(ca.vertsplit(x), p, []))
    value = ca.SX(affine(model.gap(p), ca.vertsplit(x)))
    for _ in range(3):
        value = ca.jacobian(value, x) @ rates
    return ca.substitute(value, x, ca.vertcat(*model.launch(u, p)))


def _gap_slope(model: Model, half, end: list, p: Mapping):
    """Derivative of the gap at the time of landing by alpha, from the end of the varied half flight."""
    n = len(end) // 3
    signs = model.reduction.reversor if model.reduction else model.reversor
    carried = sum(a * sign * d for a, sign, d in zip(end[2 * n :], signs, end[n : 2 * n], strict=True))
    return carried + (model.reduction.gap_slope(2 * half, [0.0] * n, p) if model.reduction else 0.0)


def _loss(model: Model, jerk, slope, u: Mapping, p: Mapping):
    """C of the map alpha + d -> alpha + d - C d**(4/3), as the certificate has it."""
    launch = model.launch(u, p)
    gradient = model.flight_gradient(launch, p, [])
    power = sum(g * d for g, d in zip(gradient, _by_alpha(lambda u: model.launch(u, p), u), strict=True))
    return loss_coefficient(model.impact_mass(p), jerk, ca.fabs(slope), power)


def missing(model: Model, extreme: str) -> NoOrbit:
    """What to say of an extreme that an orbit does not have."""
    what = {"gap": "clearance: the gap has no lowest point inside the flight",
            "force": "smallest_contact_force: the force has no lowest value inside the contact"}  # fmt: skip
    return NoOrbit(f"the orbit has no {what[extreme]}")
