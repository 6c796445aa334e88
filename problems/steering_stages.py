"""The stages, as `steer` takes them, of a hop and of a start from rest: boundary conditions, bounds and costs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from orbits import Input, InputError, Stage
from orbits.errors import finite_number
from orbits.model.model import Model
from orbits.model.phase import Affine

from .actuated import RATE, Actuated, along
from .laws import Parameters, Scalars

# A little effort is added to positive work and to the peak rate, so that their minima are unique.
EFFORT_WEIGHTS = {"work": 1e-3, "peak": 1e-6}
# In a start from rest the contact force keeps this distance from 0, in units of the actuator's spring force, wherever
# contact is to last: driven open loop, the machine would lift off where the force touches zero.
CONTACT_FORCE_MARGIN = 1e-7
# Bounds of the durations, as shares of those of the lossless orbit.
SHORTEST_SHARE, LONGEST_SHARE = 0.1, 4.0


@dataclass(frozen=True)
class Limits:
    """Bounds of the actuator's rate and displacement, and the distance that is to stay positive, if it is known."""

    rate: float
    stroke: float
    separation: Affine | None

    def inputs(self, cost: str) -> dict[str, Input]:
        """The rate as the stages' input; for the least peak, the free parameter "peak" bounds it."""
        if cost == "peak":
            return {RATE: Input(lambda p: -p["peak"], lambda p: p["peak"])}
        return {RATE: Input(-self.rate, self.rate)}

    def path(self, embed: np.ndarray) -> dict[str, Callable]:
        """The path constraints on states that `embed` makes flight states."""
        held: dict[str, Callable] = {}
        if np.isfinite(self.stroke):
            held["room to pull"] = lambda x, p, q: self.stroke - x[-1]
            held["room to push"] = lambda x, p, q: self.stroke + x[-1]
        if separation := self.separation:
            held["separation"] = lambda x, p, q: along(separation, _product(embed, x))
        return held


def actuator_limits(driven: Actuated, rate: float, stroke: float) -> Limits:
    """The limits of a machine with these bounds; raises `InputError` for bounds that are not above 0."""
    for name, bound in (("rate", rate), ("stroke", stroke)):
        if not (bound == np.inf or finite_number(name, bound) > 0):
            raise InputError(f"{name} = {bound:g}: the actuator's bound is above 0")
    return Limits(float(rate), float(stroke), driven.model.separation(driven.values))


@dataclass(frozen=True)
class HopStatement:
    """A hop to be steered: flight from lift-off, and the contact after it.

    gap, impact : of the machine's model at its parameter values
    intervals, times : of flight and contact; the times are those of the lossless orbit
    cost : "effort", "work" or "peak"
    lossless : whether the gap's speed and acceleration vanish at landing
    periodic : whether the hop ends as it begins; else it goes from the parameter "launch" to "aim"
    """

    model: Model
    gap: Affine
    impact: tuple[float, ...]
    intervals: tuple[int, int]
    times: tuple[float, float]
    limits: Limits
    cost: str
    lossless: bool
    periodic: bool

    def lifted(self, x: Scalars, before: Scalars, p: Parameters) -> list[Any]:
        """The start of the flight."""
        if self.periodic:
            return _difference(x, _product(self.model.embed, before))
        return _difference(x, self.model.launch({"liftoff": p["liftoff"], "alpha": p["launch"]}, p))

    def landed(self, x: Scalars, p: Parameters) -> list[Any]:
        """The end of the flight."""
        if not self.lossless:
            return [along(self.gap, x)]
        return [along(self.gap, x), self._gap_speed(x, p), self._contact_force(self._standing(x), p)]

    def approaching(self, x: Scalars, p: Parameters) -> list[Any]:
        """What is positive at a plastic landing."""
        return [] if self.lossless else [-self._gap_speed(x, p)]

    def stuck(self, x: Scalars, before: Scalars, p: Parameters) -> list[Any]:
        """The start of the contact, after the impact."""
        speed = self._gap_speed(before, p)
        lost = [speed * share for share in self.impact]
        return _difference(x, self._standing(_difference(before, lost)))

    def launched(self, x: Scalars, p: Parameters) -> list[Any]:
        """The end of the contact."""
        aim = [] if self.periodic else [along(self.model.contact_speed, x) - p["aim"], x[-1]]
        return [self._contact_force(x, p), *aim]

    def _contact_force(self, x: Scalars, p: Parameters) -> Any:
        return self.model.contact.watch["contact force"](x, p, [])

    def _standing(self, x: Scalars) -> list[Any]:
        return _product(np.linalg.pinv(self.model.embed), x)

    def _gap_speed(self, x: Scalars, p: Parameters) -> Any:
        return along(Affine(self.gap.weights), self.model.flight.field(x, {**p, RATE: 0.0}, []))


@lru_cache(maxsize=32)
def hop_stages(hop: HopStatement) -> tuple[Stage, Stage]:
    """Flight and contact of a hop; the same hop has the same stages, so that what is compiled for them is kept."""
    model, limits, cost = hop.model, hop.limits, hop.cost
    identity = np.eye(len(model.embed))
    bounds = [(SHORTEST_SHARE * time, LONGEST_SHARE * time) for time in hop.times]
    flight = Stage(
        model.flight,
        hop.intervals[0],
        bounds[0],
        limits.inputs(cost),
        start=hop.lifted,
        end=hop.landed,
        path={"gap": lambda x, p, q: along(hop.gap, x), **limits.path(identity)},
        running=_running_cost(cost, model, identity),
        final=(lambda x, p: p["peak"]) if cost == "peak" else (lambda x, p: 0.0),
        above=hop.approaching,
    )
    contact = Stage(
        model.contact,
        hop.intervals[1],
        bounds[1],
        limits.inputs(cost),
        start=hop.stuck,
        end=hop.launched,
        path={"contact force": model.contact.watch["contact force"], **limits.path(model.embed)},
        running=_running_cost(cost, model, model.embed),
    )
    return flight, contact


@lru_cache(maxsize=32)
def swing_stages(model: Model, pumps: int, intervals: int, limits: Limits, time: float) -> tuple[Stage, ...]:
    """Contact from rest to lift-off, in swings down and up in turn; `time` is that of the lossless orbit's contact."""
    force, speed = model.contact.watch["contact force"], model.contact_speed

    def stage(index: int) -> Stage:
        last, name, sign = index == 2 * pumps - 1, *(("rise", 1.0) if index % 2 else ("fall", -1.0))
        margin = 0.0 if last else CONTACT_FORCE_MARGIN

        def start(x, before, p):
            return _difference(x, before if index else [p["rest"], 0.0, 0.0])

        def end(x, p):
            return [force(x, p, []), along(speed, x) - p["aim"], x[-1]] if last else [along(speed, x)]

        return Stage(
            model.contact,
            intervals,
            (SHORTEST_SHARE * time, LONGEST_SHARE * time),
            limits.inputs("effort"),
            start,
            end,
            path={
                "contact force": lambda x, p, q: force(x, p, q) - margin,
                **limits.path(model.embed),
                name: lambda x, p, q: sign * along(speed, x),
            },
            running=_running_cost("effort", model, model.embed),
        )

    return tuple(stage(index) for index in range(2 * pumps))


def _running_cost(kind: str, model: Model, embed: np.ndarray) -> Callable:
    """The cost's rate; positive work is rounded by the parameter "round", see `steering.keep_hopping`."""

    def rate(x, p, q):
        effort = EFFORT_WEIGHTS.get(kind, 1.0) * p[RATE] ** 2
        if kind != "work":
            return effort
        power = model.flight_gradient(_product(embed, x), p, q)[-1] * p[RATE]
        return 0.5 * (power + (power**2 + p["round"] ** 2) ** 0.5) + effort

    return rate


def _product(matrix: np.ndarray, x: Sequence[Any]) -> list[Any]:
    """The product of a matrix of numbers with a state's expressions."""
    return [along(Affine(tuple(row)), x) for row in matrix.tolist()]


def _difference(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    return [one - other for one, other in zip(a, b, strict=True)]
