"""The stages of a hop and of a start from rest, as `steer` takes them: their conditions, bounds and costs."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from orbits.control import ELAPSED, Stage
from orbits.laws import Algebraic, Parameters, Scalars
from orbits.model import Affine, Model

from .actuated import Drive
from .actuator_bounds import product
from .prescribed import launch_number

# A little effort is added to positive work and to the peak rate, so that their minima are unique.
EFFORT_WEIGHTS = {"work": 1e-3, "peak": 1e-6}
# In a start from rest the contact force keeps this distance from 0, in units of the actuator's spring force, wherever
# contact is to last: driven open loop, the machine would lift off where the force touches zero.
CONTACT_FORCE_MARGIN = 1e-7
# Bounds of the durations, as shares of those of the lossless orbit.
SHORTEST_SHARE, LONGEST_SHARE = 0.1, 4.0


def parameter_of_rest(model: Model, name: str) -> str:
    """The parameter that is the place of rest of a coordinate."""
    return "rest" if name == model.launched[0] else f"rest {name}"


@lru_cache(maxsize=32)
def hop_stages(
    drive: Drive, gap, intervals, times, limits, cost, lossless, periodic, prescribed: tuple[str, ...] = ()
) -> tuple[Stage, Stage]:
    """Flight and contact, as `steer` takes them; the same hop has the same stages, with their compiled functions.

    A hop that is not periodic goes from the parameter "launch" to "aim"; of a periodic one, "speed" or "height" and the
    "period" may be prescribed.
    """
    model = drive.model
    force, identity, onto = model.contact.watch["contact force"], np.eye(len(model.embed)), np.linalg.pinv(model.embed)
    bounds, inputs = [(SHORTEST_SHARE * time, LONGEST_SHARE * time) for time in times], limits.inputs(drive, cost)

    def gap_speed(x, p):
        p = {**p, drive.actuator.rate: 0.0}
        return Affine(gap.weights).at(model.flight.field(x, p, model.flight.data(x, p)))

    def force_at(x, p):
        p = {**p, drive.actuator.rate: 0.0}
        return force(x, p, model.contact.data(x, p))

    def lifted(x, before, p):
        if periodic:  # Spring's end and motion could be moved together: the end is at 0 where the cycle begins.
            return [*_difference(x, product(model.embed, before)), x[-1]]
        others = {name: p[f"launch {name}"] for name in model.launch_unknowns[2:]}
        return _difference(x, model.launch({"liftoff": p["liftoff"], "alpha": p["launch"], **others}, p))

    def landed(x, p):
        return [gap.at(x), *([gap_speed(x, p), force_at(product(onto, x), p)] if lossless else [])]

    def stuck(x, before, p):
        speed = gap_speed(before, p)
        return _difference(x, product(onto, _difference(before, [speed * share for share in model.impact(before, p)])))

    def launched(x, p):
        flown = product(model.embed, x)
        own = {name: p[ELAPSED] if name == "period" else launch_number(drive, name, flown, p) for name in prescribed}
        wanted = [number - p[name] for name, number in own.items()]
        return [force_at(x, p), *(wanted if periodic else _reached(model, x, p))]

    def approaching(x, p):
        return [] if lossless else [-gap_speed(x, p)]

    def final(x, p):
        return p["peak"] if cost == "peak" else 0.0

    path = {"gap": lambda x, p, q: gap.at(x), **limits.path(drive, identity, cost)}
    running = _running_cost(cost, drive, identity)
    flight = Stage(model.flight, intervals[0], bounds[0], inputs, lifted, landed, path, running, final, approaching)
    path = {"contact force": force, **limits.path(drive, model.embed, cost)}
    running = _running_cost(cost, drive, model.embed)
    contact = Stage(model.contact, intervals[1], bounds[1], inputs, stuck, launched, path, running)
    return flight, contact


@lru_cache(maxsize=32)
def swing_stages(drive: Drive, pumps, intervals, limits, time) -> tuple[Stage, ...]:
    """Contact from rest to lift-off, in swings down and up in turn; `time` is that of the lossless orbit's contact."""
    model = drive.model
    force, speed, states = model.contact.watch["contact force"], model.contact_speed, model.contact.states
    bounds, inputs = (SHORTEST_SHARE * time, LONGEST_SHARE * time), limits.inputs(drive, "effort")
    running = _running_cost("effort", drive, model.embed)
    places = {name: parameter_of_rest(model, name) for name in states if f"{name}'" in states}

    def stage(index: int) -> Stage:
        last, name, sign = index == 2 * pumps - 1, *(("rise", 1.0) if index % 2 else ("fall", -1.0))
        margin = 0.0 if last else CONTACT_FORCE_MARGIN

        def start(x, before, p):
            return _difference(x, before if index else [p[places[name]] if name in places else 0.0 for name in states])

        def end(x, p):
            p = {**p, drive.actuator.rate: 0.0}
            pressed = force(x, p, model.contact.data(x, p))
            return [pressed, *_reached(model, x, p)] if last else [speed.at(x)]

        path = {
            "contact force": lambda x, p, q: force(x, p, q) - margin,
            **limits.path(drive, model.embed, "effort"),
            name: lambda x, p, q: sign * speed.at(x),
        }
        return Stage(model.contact, intervals, bounds, inputs, start, end, path, running)

    return tuple(stage(index) for index in range(2 * pumps))


def _reached(model: Model, x: Scalars, p: Parameters) -> list[Algebraic]:
    """What vanishes in a contact state where the contact force does, if it is the lift-off that is aimed at."""
    others = (x[model.contact.states.index(name)] - p[f"aim {name}"] for name in model.launch_unknowns[2:])
    return [model.contact_speed.at(x) - p["aim"], *others, x[-1]]


def _running_cost(kind: str, drive: Drive, embed: np.ndarray) -> Callable:
    """The cost's rate; positive work is rounded by the parameter "round", see `ROUNDINGS`."""

    def rate(x, p, q):
        effort = EFFORT_WEIGHTS.get(kind, 1.0) * (x[-1] if drive.actuator.is_force else p[drive.actuator.rate]) ** 2
        if kind != "work":
            return effort
        power = drive.power(product(embed, x), p, q)
        return 0.5 * (power + (power**2 + p["round"] ** 2) ** 0.5) + effort

    return rate


def _difference(a, b):
    return [one - other for one, other in zip(a, b, strict=True)]
