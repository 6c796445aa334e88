"""Find one lossless orbit: the simplest statement that the machine allows, solved, measured and certified."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from . import interrupts
from .certify import certify, count_family, error_bound, follow_contact
from .errors import InputError, NoOrbit
from .flow import Trajectory
from .model import Arc, Model, Phase, Statement
from .orbit import Orbit, Shape
from .shooting import Evaluation, Shooting, shooting, solve

# Below this the homotopy is stuck at a fold or an end of the family.
MIN_STEP = 1e-4
# A corrector that moves launch speed or time by a larger share may have jumped to another orbit.
MAX_CORRECTION = 0.1
# Energy pumped over a flight, as a share, beyond which the unfolded equations have no orbit but a forced motion.
LARGEST_UNFOLDING = 1e-9
METHODS = ("closed form", "relative", "half orbit", "shooting")
LARGEST_FAMILY = 10_000
# A contact lasts longer than the flight by the square root of the mass ratio, no more.
LONGEST_CONTACT = 1e7


def find(
    machine, family: int = 1, *, method: str | None = None, progress: Callable[[float], None] | None = None
) -> Orbit:
    """Find the lossless orbit of a family, with its certificate.

    machine : a `problems.Hopper`, a `problems.Juggler`, or anything with their `model`, `values`, `describe`, `units`
    family : from 1; family n has n + 1 stationary points of the extension from lift-off to mid-flight
    method : one of `METHODS`, None for the simplest that the machine allows; "shooting" is the general way, multiple
        shooting by Ipopt
    progress : called with the share of the way done, for what takes long

    Where a family has several orbits, this is the one of least launch speed under constant gravity, or what that
    becomes as gravity's variation is brought in. It may be inadmissible: see its `violations`. Raises `NoOrbit` with
    the reason when there is none or a solve ends on another family, and `InputError` for a family or a method that
    cannot be.
    """
    if not all(hasattr(machine, name) for name in ("model", "values", "describe", "units")):
        raise InputError(f"find takes a machine such as problems.Hopper(), not {type(machine).__name__}")
    with interrupts.deferred():
        return _find(machine, family, method, progress)


def _find(machine, family, method, progress) -> Orbit:
    began = time.perf_counter()
    model, p = machine.model, dict(machine.values)
    family, method = _whole(family), _allowed(model, method)
    way = {"closed form": _exact, "relative": _relative, "half orbit": _half_orbit, "shooting": _shooting}[method]
    solution = way(model, family, p, progress)
    u = solution.u
    flight_time = float(sum(part.times[-1] for part in solution.parts)) * (2 if len(solution.parts) == 1 else 1)
    contact, stopped = follow_contact(model, u, p, LONGEST_CONTACT * (1 + flight_time))
    certificate = certify(
        model, u, p, solution.parts, contact, stopped, solution.gap_slope, solution.residual, solution.error
    )
    if certificate.family != family:
        raise NoOrbit(
            f"the solve for family {family} ended on an orbit of family {certificate.family}; try another method"
        )
    return Orbit(
        machine=machine.describe(),
        alpha=u["alpha"],
        liftoff_extension=u["liftoff"],
        flight_time=flight_time,
        contact_time=None if contact is None else float(contact.times[-1]) * (2 if model.reversor else 1),
        flight=solution.flight,
        contact=contact,
        shape=_shape(model, p),
        certificate=certificate,
        method=method,
        skipped=_skipped(model, p, method, solution.compiled),
        seconds=time.perf_counter() - began,
        units=machine.units,
    )


@dataclass(frozen=True, eq=False)
class _Solution:
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


# The four ways, simplest first: (model, family, parameters, progress) -> solution.


def _exact(model: Model, family: int, p: Mapping, progress) -> _Solution:
    u, error = model.reduction.exact(family, p)
    equations = shooting(model.reduction.statement, tuple(p))
    u = np.array(list(u.values()))
    return _reduced(model, equations, u, equations.evaluate(u, _vector(p)), p, error)


def _relative(model: Model, family: int, p: Mapping, progress) -> _Solution:
    start = model.guess(family, p)
    equations = shooting(model.reduction.statement, tuple(p))
    u, here = equations.newton([start["liftoff"], start["alpha"]], _vector(p))
    return _reduced(model, equations, u, here, p)


def _half_orbit(model: Model, family: int, p: Mapping, progress) -> _Solution:
    equations = shooting(half_orbit(model.flight, model.launch, model.liftoff, model.reversor), tuple(p))
    return _mirrored(model, equations, *_along(model, equations, equations.newton, family, p, progress), p)


def _shooting(model: Model, family: int, p: Mapping, progress) -> _Solution:
    if model.reversor:
        statement, interpret = half_orbit(model.flight, model.launch, model.liftoff, model.reversor), _mirrored
    else:
        statement, interpret = whole_flight(model), _unmirrored
    equations = shooting(statement, tuple(p))
    return interpret(model, equations, *_along(model, equations, equations.multiple_shooting, family, p, progress), p)


@lru_cache(maxsize=64)
def half_orbit(flight: Phase, launch: Callable, liftoff: Callable, reversor: tuple[int, ...]) -> Statement:
    """From the launch set to a state that the reversor leaves alone: half of an orbit that is its own mirror image.

    Unknowns: the extension at lift-off, the launch speed, half the flight time.
    """
    arc = Arc(
        flight,
        start=lambda u, before, p: launch(u, p),
        duration=lambda u, p: u["duration"],
        conditions=lambda u, x, p: [value for value, sign in zip(x, reversor, strict=True) if sign < 0],
        guard=lambda u, x, p, q: [liftoff(u, p, q)],
    )
    return Statement("half orbit", ("liftoff", "alpha", "duration"), (arc,), ("alpha", "duration"))


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


def _along(model: Model, equations: Shooting, correct: Callable, family: int, p: Mapping, progress):
    """Solve the model's equations from its guess, led there along the homotopy parameter with step control.

    A step is taken when the corrector ends near where the tangent pointed and the family is still the same.
    """
    start = model.guess(family, {**p, model.homotopy: 0.0} if model.homotopy else p)
    whole = "unfolding" in equations.statement.unknowns
    u = np.array([start["liftoff"], start["alpha"], start["duration"] * (2 if whole else 1)] + [0.0] * whole)
    if model.homotopy is None:
        return correct(u, _vector(p))
    share, step = 0.0, 1.0
    u, here = correct(u, _vector({**p, model.homotopy: 0.0}))
    while share < 1:
        # differenced: a predictor needs no more digits, and its own derivative would take longer to build
        there = equations.evaluate(u, _vector({**p, model.homotopy: share + 1e-6}))
        tangent = solve(here.jacobian, (here.residual - there.residual) / 1e-6)
        step = min(step, 1 - share)
        while True:
            ahead = {**p, model.homotopy: 1.0 if step == 1 - share else share + step}
            try:
                u, here = _corrected(model, equations, correct, u + step * tangent, family, ahead)
                break
            except NoOrbit as error:
                step /= 2
                if step < MIN_STEP:
                    raise NoOrbit(
                        f"no lossless orbit of family {family}: with {100 * share:.3g}% of gravity's variation it is "
                        f"at alpha = {u[1]:.6g}, and it cannot be followed further ({error})"
                    ) from None
        share = ahead[model.homotopy]
        step *= 2
        if progress:
            progress(share)
    return u, here


def _corrected(model, equations, correct, predicted, family, p):
    if not (predicted[1:3] > 0).all():  # nor if they are not numbers
        raise NoOrbit("the step leads to a negative time or speed")
    new, here = correct(predicted, _vector(p))
    if np.max(np.abs(new - predicted)[1:3] / np.abs(new[1:3])) > MAX_CORRECTION:
        raise NoOrbit("the corrector ends far from the predicted orbit")
    flight = _in_flight_states(model, here.trajectories[0])
    parts = flight.split(flight.times[-1] / 2) if "unfolding" in equations.statement.unknowns else (flight,)
    if count_family(model, parts) != family:
        raise NoOrbit("the family changes")
    return new, here


def _reduced(model: Model, equations: Shooting, u, here: Evaluation, p: Mapping, error=None) -> _Solution:
    named = equations.named(u)
    path = here.trajectories[0]
    coefficients = model.reduction.complete(path.times[:-1], path.coefficients, named, p)
    half = Trajectory(path.times, coefficients, model.flight.states)
    landing = _at_landing(here, model.reduction.reversor)
    slope = model.reduction.gap_slope(2 * path.times[-1], landing[:, 1], p)
    error = error_bound(equations, u, _vector(p), here) if error is None else error
    return _Solution(named, half, (half,), slope, np.abs(here.residual).max(), error, equations.compiled)


def _mirrored(model: Model, equations: Shooting, u, here: Evaluation, p: Mapping) -> _Solution:
    half = here.trajectories[0]
    slope = np.array(model.gap(p).weights) @ _at_landing(here, model.reversor)[:, 1]
    error = error_bound(equations, u, _vector(p), here)
    return _Solution(equations.named(u), half, (half,), slope, np.abs(here.residual).max(), error, equations.compiled)


def _unmirrored(model: Model, equations: Shooting, u, here: Evaluation, p: Mapping) -> _Solution:
    named = equations.named(u)
    if abs(named["unfolding"]) * named["duration"] > LARGEST_UNFOLDING:
        raise NoOrbit(
            f"the landing conditions hold only with the energy pumped at the rate {named['unfolding']:.3g}: "
            "this model has no lossless orbit here"
        )
    flight = _in_flight_states(model, here.trajectories[0])
    slope = np.array(model.gap(p).weights) @ (here.transitions[0] @ here.starts[0])[: len(flight.names), 1]
    error = error_bound(equations, u, _vector(p), here)
    parts = flight.split(flight.times[-1] / 2)
    return _Solution(named, flight, parts, slope, np.abs(here.residual).max(), error, equations.compiled)


def _in_flight_states(model: Model, path: Trajectory) -> Trajectory:
    """The rows of the flight states alone."""
    states = model.flight.states
    return Trajectory(path.times, path.coefficients[:, : len(states)], states)


def _at_landing(here: Evaluation, reversor) -> np.ndarray:
    """Derivatives of the state at landing, of a flight whose first half is `here`, with respect to the unknowns.

    The second half mirrors the first in time, and so does its transition matrix.
    """
    first, mirror = here.transitions[0], np.array(reversor)[:, None]
    half = first @ here.starts[0]
    return mirror * np.linalg.solve(first[:, : len(first)], mirror * half)


def _shape(model: Model, p: Mapping) -> Shape:
    contact = model.reversor and tuple(int(model.reversor[i]) for i in np.abs(model.embed).argmax(0))
    return Shape(model.reversor, contact, model.embed, model.heights(p), model.spring_ends)


def _vector(p: Mapping) -> np.ndarray:
    return np.array(list(p.values()), dtype=float)


def _whole(family) -> int:
    if isinstance(family, bool) or not isinstance(family, int | np.integer) or not 1 <= family <= LARGEST_FAMILY:
        raise InputError(f"family = {family!r}; a family is a whole number from 1 to {LARGEST_FAMILY}")
    return int(family)


def _allowed(model: Model, method: str | None) -> str:
    """The method asked for, if the model allows it, or the simplest that it does."""
    possible = {
        "closed form": model.reduction is not None and model.reduction.exact is not None,
        "relative": model.reduction is not None,
        "half orbit": model.reversor is not None,
        "shooting": True,
    }
    if method is None:
        return next(name for name in METHODS if possible[name])
    if method not in METHODS:
        raise InputError(f"unknown method '{method}'; known: {', '.join(METHODS)}")
    if not possible[method]:
        needs = {
            "closed form": "a straight-line spring and constant gravity",
            "relative": "constant gravity",
            "half orbit": "a reversor",
        }
        raise InputError(f"method '{method}' needs {needs[method]}; leave it out for the simplest way")
    return method


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
        part = "its first half" if model.reversor else "the once"
        skipped.append(f"contact: only {part}, for its duration and the checks, not for the search")
    if model.separation(p) is None:
        skipped.append("separation of the masses: no rest length given")
    if not compiled:
        skipped.append("compilation: nothing that repays it, or no compiler")
    return tuple(skipped)
