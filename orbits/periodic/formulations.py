"""What is solved for an orbit of a model, and what the solution means: the statements, and orbits made from them."""

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..errors import NoOrbit
from ..flow.trajectory import Trajectories
from ..model.model import Model
from ..model.phase import Arc, Phase, Statement
from ..numerics.linear import solve
from .certificate import Cycles, Solution, certify, follow_contacts, or_none
from .error_bound import error_bounds
from .evaluation import Evaluation
from .orbit import Orbit, Shape
from .single_shooting import Shooting, shooting_equations

# Energy pumped over a flight, as a share, beyond which the unfolded equations have no orbit but a forced motion.
LARGEST_UNFOLDING = 1e-9
# A contact lasts longer than the flight by the square root of the mass ratio, no more.
LONGEST_CONTACT = 1e7


def equations_of(model: Model, method: str, parameters: tuple[str, ...]) -> Shooting:
    """The equations that a method solves."""
    if method in ("closed form", "relative"):
        return shooting_equations(model.reduction.statement, parameters)
    if model.reversor:
        return shooting_equations(half_orbit(model), parameters)
    return shooting_equations(whole_flight(model), parameters)


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


def interpret(model: Model, method: str, equations: Shooting, us, ps, here: Evaluation, errors) -> Solution:
    """What solutions (m, n) of a method's equations with parameters (m, np) mean for the flight, from the equations
    `stacked` there and the errors of alpha (m,); raises `NoOrbit` about the first that means none."""
    read = (
        _read_reduced
        if method in ("closed form", "relative")
        else _read_mirrored
        if model.reversor
        else _read_unmirrored
    )
    u = dict(zip(equations.statement.unknowns, us.T, strict=True))
    p = dict(zip(equations.parameters, ps.T, strict=True))
    return Solution(u, p, *read(model, u, p, here), np.abs(here.residual).max(1), errors)


def with_contacts(model: Model, solution: Solution) -> Cycles:
    """What is to be certified, the contacts followed."""
    limits = solution.u.get("contact_duration", LONGEST_CONTACT * (1 + solution.flight.ends))
    return Cycles(**vars(solution), **follow_contacts(model, solution.u, solution.p, limits))


def certified_orbit(machine, method: str, u, here: Evaluation, error: float | None = None, *, began: float) -> Orbit:
    """The certified orbit that a solution `u` (n,) of a method's equations is, which are `here`, stacked.

    error : of alpha, where it is known; else it is measured, by `error_bounds`
    began : when the search for it did, by `time.perf_counter`
    """
    model, p = machine.model, machine.values
    equations = equations_of(model, method, tuple(p))
    us, ps = np.reshape(u, (1, -1)), vector(p)[None]
    errors = np.array([error])
    if error is None:
        errors, refused = error_bounds(equations, us, ps, here)
        if refused:
            raise refused[0]
    solution = interpret(model, method, equations, us, ps, here, errors)
    cases = with_contacts(model, solution)
    (certificate,) = certify(model, cases)
    return Orbit(
        machine=machine.describe(),
        alpha=float(solution.u["alpha"][0]),
        liftoff_extension=float(solution.u["liftoff"][0]),
        flight_time=float(cases.flight_times[0]),
        contact_time=or_none(cases.contact_times)[0],
        flight=solution.flight[0],
        contact=cases.contacts and cases.contacts[0],
        shape=_shape(model, p),
        certificate=certificate,
        method=method,
        skipped=_skipped(model, p, method, equations.compiled),
        seconds=time.perf_counter() - began,
        units=machine.units,
    )


# The flights, their parts and the slopes of the gap at landing: (model, u by name, p by name, equations there).


def _read_reduced(model: Model, u: Mapping, p: Mapping, here: Evaluation) -> tuple:
    (motions,) = here.trajectories
    of_steps = ({name: values[motions.owner] for name, values in each.items()} for each in (u, p))
    coefficients = model.reduction.complete(motions.starts, motions.coefficients, *of_steps)
    flight = Trajectories(motions.starts, motions.ends, coefficients, motions.counts, model.flight.states)
    landing = _at_landing(here, model.reduction.reversor)
    return flight, flight, model.reduction.gap_slope(2 * flight.ends, landing.T, p)


def _read_mirrored(model: Model, u: Mapping, p: Mapping, here: Evaluation) -> tuple:
    flight = here.trajectories[0].only(model.flight.states)
    return flight, flight, _slope(model, p, _at_landing(here, model.reversor))


def _read_unmirrored(model: Model, u: Mapping, p: Mapping, here: Evaluation) -> tuple:
    for i in np.flatnonzero(np.abs(u["unfolding"]) * u["duration"] > LARGEST_UNFOLDING):
        reason = f"with the energy pumped at the rate {u['unfolding'][i]:.3g}: this model has no lossless orbit here"
        raise NoOrbit(f"the landing conditions hold only {reason}").about(i)
    flight = here.trajectories[0].only(model.flight.states)
    return flight, halved(flight), _slope(model, p, (here.transitions[0] @ here.starts[0])[:, :, 1])


def halved(flight: Trajectories) -> Trajectories:
    """Of whole flights the first halves, and the second from landing backwards."""
    return Trajectories.of([half for path in flight for half in path.split(path.times[-1] / 2)])


def _slope(model: Model, p: Mapping, landing) -> np.ndarray:
    """Derivatives (m,) of the gap at landing by alpha, from those of the state (m, states)."""
    return sum(weight * landing[:, i] for i, weight in enumerate(model.gap(p).weights))


def _at_landing(here: Evaluation, reversor) -> np.ndarray:
    """Derivatives (m, states) by alpha, the second unknown, of the state at landing, of flights whose first halves are
    `here`.

    The second half mirrors the first in time, and so does its transition matrix.
    """
    first, start, mirror = here.transitions[0], here.starts[0][:, :, [1]], np.array(reversor)[:, None]
    return (mirror * solve(first[:, :, : first.shape[1]], mirror * (first @ start)))[:, :, 0]


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
