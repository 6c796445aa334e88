"""What the solutions of a method's equations mean: the flights, the contacts and the certified orbits."""

import time
from collections.abc import Mapping

import numpy as np

from ..errors import NoOrbit
from ..flow.trajectory import Trajectories
from ..model.machine import Machine
from ..model.model import Model, Reduction
from ..numerics.roots import solve
from .certificate import certify
from .contact import follow_contacts
from .error_bound import error_bounds
from .formulations import Cycles, contact_reversor, equations_of, or_none, reduction_of, vector
from .local_law import landing_gap_slope
from .newton import Evaluation
from .orbit import Orbit, Shape
from .single_shooting import Shooting
from .solution import Solution

# When the unfolding changes the energy over a flight by more than this share, the unfolded equations have no orbit but
# a forced motion. On orbits it is rounding.
LARGEST_UNFOLDING = 1e-9
# A contact lasts longer than the flight by at most about the square root of the mass ratio: a longer one does not end.
LONGEST_CONTACT = 1e7


# The `flight`, the `halves` and the `gap_slope` of a `Solution`.
_Flights = tuple[Trajectories, Trajectories, np.ndarray]


def interpret(
    model: Model,
    method: str,
    equations: Shooting,
    us: np.ndarray,
    ps: np.ndarray,
    evaluation: Evaluation,
    errors: np.ndarray,
) -> Solution:
    """What solutions (m, n) of a method's equations with parameters (m, np) mean for the flight.

    evaluation : the equations there
    errors : bounds (m,) on the errors of alpha

    Raises `NoOrbit` about the first solution that is no orbit.
    """
    u = dict(zip(equations.statement.unknowns, us.T, strict=True))
    p = dict(zip(equations.parameters, ps.T, strict=True))
    if reduction := reduction_of(model, method):
        flights = _reduced_flights(model, reduction, u, p, evaluation)
    elif model.reversor:
        flights = _mirrored_flights(model, model.reversor, p, evaluation)
    else:
        flights = _whole_flights(model, u, p, evaluation)
    return Solution(u, p, *flights, residual=np.abs(evaluation.residual).max(1), error=errors)


def with_contacts(model: Model, solution: Solution) -> Cycles:
    """The solved orbits with their contacts."""
    limits = solution.u.get("contact_duration", LONGEST_CONTACT * (1 + solution.flight.ends))
    return Cycles(**vars(solution), **follow_contacts(model, solution.u, solution.p, limits))


def certified_orbit(
    machine: Machine, method: str, u: np.ndarray, evaluation: Evaluation, error: float | None = None, *, began: float
) -> Orbit:
    """The certified orbit of a solution `u` (n,) of a method's equations, whose evaluation there has one point.

    error : bound on the error of alpha where it is known, else `error_bounds` measures it
    began : when the search for the orbit began, by `time.perf_counter`

    Raises `NoOrbit` when it cannot be certified.
    """
    model, p = machine.model, machine.values
    equations = equations_of(model, method, tuple(p))
    us, ps = np.reshape(u, (1, -1)), vector(p)[None]
    errors = np.array([error])
    if error is None:
        errors, refused = error_bounds(equations, us, ps, evaluation)
        if refused:
            raise refused[0]
    cycles = with_contacts(model, interpret(model, method, equations, us, ps, evaluation, errors))
    (certificate,) = certify(model, cycles)
    return Orbit(
        machine=machine.describe(),
        alpha=float(cycles.u["alpha"][0]),
        liftoff_extension=float(cycles.u["liftoff"][0]),
        flight_time=float(cycles.flight_times[0]),
        contact_time=or_none(cycles.contact_times)[0],
        flight=cycles.flight[0],
        contact=cycles.contacts[0] if cycles.contacts else None,
        shape=_shape(model, p),
        certificate=certificate,
        method=method,
        skipped=_skipped(model, p, method, equations.compiled),
        seconds=time.perf_counter() - began,
        units=machine.units,
    )


def halved(flights: Trajectories) -> Trajectories:
    """The halves of whole flights: of each the first, and the second from landing backwards."""
    paths = [flights[i] for i in range(len(flights))]
    return Trajectories.of([half for path in paths for half in path.split(path.times[-1] / 2)])


def _reduced_flights(model: Model, reduction: Reduction, u: Mapping, p: Mapping, evaluation: Evaluation) -> _Flights:
    """The flights of solutions in the coordinates of a reduction."""
    (motions,) = evaluation.trajectories
    of_steps = ({name: values[motions.owner] for name, values in each.items()} for each in (u, p))
    coefficients = reduction.complete(motions.starts, motions.coefficients, *of_steps)
    flight = Trajectories(motions.starts, motions.ends, coefficients, motions.counts, model.flight.states)
    landing = _landing_by_alpha(evaluation, reduction.reversor)
    return flight, flight, reduction.gap_slope(2 * flight.ends, landing.T, p)


def _mirrored_flights(model: Model, reversor: tuple[int, ...], p: Mapping, evaluation: Evaluation) -> _Flights:
    """The flights of solutions of the `half_orbit` statement."""
    flight = evaluation.trajectories[0].only(model.flight.states)
    return flight, flight, landing_gap_slope(model, _landing_by_alpha(evaluation, reversor).T, p)


def _whole_flights(model: Model, u: Mapping, p: Mapping, evaluation: Evaluation) -> _Flights:
    """The flights of solutions of the `whole_flight` statement."""
    for i in np.flatnonzero(np.abs(u["unfolding"]) * u["duration"] > LARGEST_UNFOLDING).tolist():
        reason = f"with the energy pumped at the rate {u['unfolding'][i]:.3g}: this model has no lossless orbit here"
        raise NoOrbit(f"the landing conditions hold only {reason}").about(i)
    flight = evaluation.trajectories[0].only(model.flight.states)
    landing = (evaluation.transitions[0] @ evaluation.starts[0])[:, :, 1]
    return flight, halved(flight), landing_gap_slope(model, landing.T, p)


def _landing_by_alpha(evaluation: Evaluation, reversor: tuple[int, ...]) -> np.ndarray:
    """Derivatives (m, states) of the state at landing by alpha, the second unknown, of flights whose first halves were
    solved for.

    The second half of the motion is the mirror image of the first, and so is its transition matrix.
    """
    first, start, mirror = evaluation.transitions[0], evaluation.starts[0][:, :, [1]], np.array(reversor)[:, None]
    return (mirror * solve(first[:, :, : first.shape[1]], mirror * (first @ start)))[:, :, 0]


def _shape(model: Model, p: Mapping) -> Shape:
    reversor = contact_reversor(model.reversor, model.embed) if model.reversor else None
    return Shape(model.reversor, reversor, model.embed, model.heights(p), model.springs)


def _skipped(model: Model, p: Mapping, method: str, compiled: bool) -> tuple[str, ...]:
    """What the method did without, in words."""
    mirrored = "flight: half of it, by time reversal"
    skipped = {
        "closed form": ["flight: closed form, nothing integrated", "search: one scalar equation, no solver"],
        "relative": ["flight: the extension alone is integrated, 2 states of 4", mirrored],
        "half orbit": [mirrored],
        "shooting": [mirrored] if model.reversor else [],
    }[method]
    if method in ("relative", "half orbit"):
        skipped.append("search: Newton on a few unknowns from a measured guess, no Ipopt")
    if model.contact.closed_form:
        skipped.append("contact: closed form")
    else:
        share = "only its first half" if model.reversor else "once"
        skipped.append(f"contact: {share}, for its duration and the checks, not for the search")
    if model.separation(p) is None:
        skipped.append("separation of the masses: no rest length given")
    if not compiled:
        skipped.append("compilation: nothing that repays it, or no compiler")
    return tuple(skipped)
