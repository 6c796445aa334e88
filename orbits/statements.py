"""What is solved for an orbit of a model, and what the solution means: the statements, and orbits made from them."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from .accuracy import error_bound
from .certify import Case, certify, follow_contacts
from .errors import NoOrbit
from .model import Arc, Model, Phase, Statement
from .motions import Trajectory
from .orbit import Orbit, Shape
from .shooting import Evaluation, Shooting, shooting, solve

# Energy pumped over a flight, as a share, beyond which the unfolded equations have no orbit but a forced motion.
LARGEST_UNFOLDING = 1e-9
# A contact lasts longer than the flight by the square root of the mass ratio, no more.
LONGEST_CONTACT = 1e7


def equations_of(model: Model, method: str, parameters: tuple[str, ...]) -> Shooting:
    """The equations that a method solves."""
    if method in ("closed form", "relative"):
        return shooting(model.reduction.statement, parameters)
    if model.reversor:
        return shooting(half_orbit(model), parameters)
    return shooting(whole_flight(model), parameters)


@lru_cache(maxsize=64)
def half_orbit(model: Model) -> Statement:
    """From the launch set to a state that the reversor leaves alone: half of an orbit that is its own mirror image.

    Unknowns: those of the launch, half the flight time. Where a launch has more of them than extension and speed, what
    follows the mirrored landing has to come to such a state too: half the contact, its time a further unknown.
    """

    def rest(signs):
        return lambda u, x, p: [value for value, sign in zip(x, signs, strict=True) if sign < 0]

    flight = Arc(
        model.flight,
        start=lambda u, before, p: model.launch(u, p),
        duration=lambda u, p: u["duration"],
        conditions=rest(model.reversor),
        guard=lambda u, x, p, q: [model.liftoff(u, p, q)],
    )
    if model.one_speed:
        return Statement("half orbit", model.half_unknowns, (flight,), ("alpha", "duration"))
    contact = Arc(
        model.contact,
        start=lambda u, before, p: model.touchdown(u, p),
        duration=lambda u, p: u["contact_duration"],
        conditions=rest(contact_reversor(model)),
    )
    return Statement("half orbit", model.half_unknowns, (flight, contact), ("duration", "contact_duration"))


def contact_reversor(model: Model) -> tuple[int, ...]:
    """Sign of each contact state under time reversal."""
    return tuple(int(model.reversor[i]) for i in np.abs(model.embed).argmax(0))


@lru_cache(maxsize=64)
def whole_flight(model: Model) -> Statement:
    """From the launch set to a lossless landing, for a model without a reversor.

    Launch speed and flight time are two unknowns for three landing conditions: that all can hold is the doing of a
    conserved energy and of whatever symmetry the motion has. To make it square the field is unfolded, a multiple of the
    energy's gradient added to it; that multiple is a further unknown, and it vanishes on an orbit.
    """
    flight = model.flight

    def field(x, p, q):
        gradient = model.flight_gradient(x[:-1], p, q)
        return [f + x[-1] * g for f, g in zip(flight.field(x[:-1], p, q), gradient, strict=True)] + [0 * x[-1]]

    pieces = flight.pieces and replace(flight.pieces, coordinate=(*flight.pieces.coordinate, 0.0))
    arc = Arc(
        Phase(flight.name, (*flight.states, "unfolding"), field, pieces=pieces),
        start=lambda u, before, p: [*model.launch(u, p), u["unfolding"]],
        duration=lambda u, p: u["duration"],
        conditions=lambda u, x, p: model.landing(u, x[:-1], p),
        guard=lambda u, x, p, q: [model.liftoff(u, p, q)],
    )
    return Statement("whole flight", ("liftoff", "alpha", "duration", "unfolding"), (arc,), ("alpha", "duration"))


@dataclass(frozen=True, eq=False)
class Solution:
    """A solved statement and what it means for the flight.

    u : the unknowns by name
    flight : the first half, in flight states; the whole flight where nothing mirrors it
    parts : the flight from lift-off to its middle and, where it is not its mirror image, from landing backwards
    gap_slope : derivative with respect to alpha of the gap at the landing time
    compiled : whether the equations' flow took long enough to be compiled
    """

    u: Mapping[str, float]
    flight: Trajectory
    parts: tuple[Trajectory, ...]
    gap_slope: float
    residual: float
    error: float
    compiled: bool


def interpret(model: Model, method: str, equations: Shooting, u, here: Evaluation, p: Mapping, error=None) -> Solution:
    """What the solution `u` of a method's equations, evaluated `here`, means for the flight.

    error : of alpha, where it is known; else it is estimated, by `error_bound`
    """
    if error is None:
        error = error_bound(equations, u, vector(p), here)
    (solution,) = interpret_all(model, method, equations, [(u, p, here, error)])
    if isinstance(solution, NoOrbit):
        raise solution
    return solution


def interpret_all(model: Model, method: str, equations: Shooting, points: Sequence[tuple]) -> list[Solution | NoOrbit]:
    """What solutions (u, parameters by name, equations there, error of alpha) of a method's equations mean for the
    flight; for one that means none, the reason."""
    if not points:
        return []
    read = _reduced if method in ("closed form", "relative") else _mirrored if model.reversor else _unmirrored
    named = [equations.named(u) for u, *_ in points]
    ps, heres = [p for _, p, _, _ in points], [here for _, _, here, _ in points]
    return [
        known
        if isinstance(known, NoOrbit)
        else Solution(u, *known, float(np.abs(here.residual).max()), error, equations.compiled)
        for u, known, (_, _, here, error) in zip(named, read(model, named, ps, heres), points, strict=True)
    ]


def as_cases(model: Model, solutions: Sequence[tuple[Solution, Mapping]]) -> list[Case]:
    """What is to be certified of solutions with their parameters, the contacts followed."""
    if not solutions:
        return []
    limits = [
        solution.u.get("contact_duration", LONGEST_CONTACT * (1 + solution.flight.times[-1]))
        for solution, _ in solutions
    ]
    landings = [(solution.u, p, limit) for (solution, p), limit in zip(solutions, limits, strict=True)]
    return [
        Case(known.u, p, known.parts, contact, stopped, known.gap_slope, known.residual, known.error)
        for (known, p), (contact, stopped) in zip(solutions, follow_contacts(model, landings), strict=True)
    ]


def as_orbit(machine, method: str, solution: Solution, began: float) -> Orbit:
    """The certified orbit of a machine; `began` is when the search for it did, by `time.perf_counter`."""
    model, p, u = machine.model, machine.values, solution.u
    (case,) = as_cases(model, [(solution, p)])
    (certificate,) = certify(model, [case])
    if isinstance(certificate, NoOrbit):
        raise certificate
    return Orbit(
        machine=machine.describe(),
        alpha=u["alpha"],
        liftoff_extension=u["liftoff"],
        flight_time=case.flight_time,
        contact_time=case.contact_time,
        flight=solution.flight,
        contact=case.contact,
        shape=_shape(model, p),
        certificate=certificate,
        method=method,
        skipped=_skipped(model, p, method, solution.compiled),
        seconds=time.perf_counter() - began,
        units=machine.units,
    )


# The flight, its parts and the slope of the gap at landing, of several: (model, u by name, p by name, equations there).


def _reduced(model: Model, us, ps, heres: Sequence[Evaluation]) -> list:
    landings = _at_landing(heres, model.reduction.reversor)
    found = []
    for u, p, here, landing in zip(us, ps, heres, landings, strict=True):
        path = here.trajectories[0]
        coefficients = model.reduction.complete(path.times[:-1], path.coefficients, u, p)
        half = Trajectory(path.times, coefficients, model.flight.states)
        found.append((half, (half,), float(model.reduction.gap_slope(2 * path.times[-1], landing[:, 1], p))))
    return found


def _mirrored(model: Model, us, ps, heres: Sequence[Evaluation]) -> list:
    found = []
    for p, here, landing in zip(ps, heres, _at_landing(heres, model.reversor), strict=True):
        half = in_flight_states(model, here.trajectories[0])
        found.append((half, (half,), float(np.array(model.gap(p).weights) @ landing[:, 1])))
    return found


def _unmirrored(model: Model, us, ps, heres: Sequence[Evaluation]) -> list:
    found: list = []
    for u, p, here in zip(us, ps, heres, strict=True):
        flight = in_flight_states(model, here.trajectories[0])
        slope = np.array(model.gap(p).weights) @ (here.transitions[0] @ here.starts[0])[: len(flight.names), 1]
        if abs(u["unfolding"]) * u["duration"] > LARGEST_UNFOLDING:
            reason = f"the landing conditions hold only with the energy pumped at the rate {u['unfolding']:.3g}"
            found.append(NoOrbit(reason + ": this model has no lossless orbit here"))
        else:
            found.append((flight, flight.split(flight.times[-1] / 2), float(slope)))
    return found


def in_flight_states(model: Model, path: Trajectory) -> Trajectory:
    """The rows of the flight states alone."""
    states = model.flight.states
    return Trajectory(path.times, path.coefficients[:, : len(states)], states)


def _at_landing(heres: Sequence[Evaluation], reversor) -> np.ndarray:
    """Derivatives (m, states, unknowns) of the state at landing, of flights whose first halves are `heres`.

    The second half mirrors the first in time, and so does its transition matrix.
    """
    first, starts = (
        np.array([part[0] for part in parts]) for parts in zip(*((h.transitions, h.starts) for h in heres), strict=True)
    )
    mirror = np.array(reversor)[:, None]
    return mirror * solve(first[:, :, : first.shape[1]], mirror * (first @ starts))


def _shape(model: Model, p: Mapping) -> Shape:
    contact = model.reversor and contact_reversor(model)
    return Shape(model.reversor, contact, model.embed, model.heights(p), model.springs)


def vector(p: Mapping) -> np.ndarray:
    """The values of parameters by name, in their order."""
    return np.array(list(p.values()), dtype=float)


def _skipped(model: Model, p: Mapping, method: str, compiled: bool) -> tuple[str, ...]:
    """What the way taken did without, in words."""
    skipped = {
        "closed form": ["flight: closed form, nothing integrated", "search: one scalar equation, no solver"],
        "relative": [
            "flight: the extension alone is integrated, 2 states of 4",
            "flight: half of it, by time reversal",
        ],
        "half orbit": ["flight: half of it, by time reversal"],
        "shooting": ["flight: half of it, by time reversal"] if model.reversor else [],
    }[method]
    if method in ("relative", "half orbit"):
        skipped.append("search: Newton on a few unknowns from a measured guess, no Ipopt")
    if model.contact.closed_form:
        skipped.append("contact: closed form")
    else:
        part = "only its first half" if model.reversor else "once"
        skipped.append(f"contact: {part}, for its duration and the checks, not for the search")
    if model.separation(p) is None:
        skipped.append("separation of the masses: no rest length given")
    if not compiled:
        skipped.append("compilation: nothing that repays it, or no compiler")
    return tuple(skipped)
