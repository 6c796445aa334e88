"""The equations of an orbit of a model, the statement of each method, and the interpretation of its solutions."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy import ndarray

from ..errors import FlowError, InputError, NoOrbit, OutOfRange, one_of
from ..flow import Trajectories, Watch, first_events, first_zero, flow_of, until_zero
from ..laws import Algebraic
from ..model import (
    CONTACT_FORCE,
    Affine,
    Arc,
    Model,
    Phase,
    Reduction,
    SignedShift,
    Statement,
    refuse_hysteresis,
    refuse_one_way,
)
from ..numerics import solve
from ..records import NONE
from ..units import Message
from .cycle_statement import unfolded
from .single_shooting import Evaluation, Shooting, relative, shooting_equations

METHODS = ("closed form", "relative", "half orbit", "shooting")  # the simplest first
# When the unfolding changes the energy over a flight by more than this share, the unfolded equations have no orbit but
# a forced motion. On orbits it is rounding.
LARGEST_UNFOLDING = 1e-9
# A contact lasts longer than the flight by at most about the square root of the mass ratio: a longer one does not end.
LONGEST_CONTACT = 1e7
# A relative change of alpha changes the derivatives at landing by at most this factor times that change, times the
# square of the motion's amplification: measured on motions that amplify changes up to 1e5-fold.
SLOPE_CHANGE = 240.0


def reduction_of(model: Model, method: str) -> Reduction | None:
    """The reduction in whose coordinates a method solves, None where it solves in the flight states."""
    return model.reduction if method in ("closed form", "relative") else None


def method_of(model: Model, method: str | None = None) -> str:
    """The requested method, or for None the simplest that the model allows; raises `InputError` for a method that it
    does not allow."""
    reduction = model.reduction
    needs = {
        "closed form": ("a linear spring and constant gravity", reduction and reduction.exact),
        "relative": ("two masses and constant gravity", reduction),
        "half orbit": ("a reversor", model.reversor),
        "shooting": ("", True),
    }
    if method is None:
        return next(name for name in METHODS if needs[name][1])
    if not needs[one_of("method", method, METHODS)][1]:
        raise InputError(f"method '{method}' needs {needs[method][0]}; leave it out to use the simplest method")
    return method


def iterative(method: str) -> str:
    """The method that solves a method's equations by iteration, from a start."""
    return "relative" if method == "closed form" else method


def equations_of(model: Model, method: str, parameters: tuple[str, ...]) -> Shooting:
    """The equations that a method solves; raises `NoOrbit` for a spring with hysteresis, and as `whole_flight` does."""
    refuse_hysteresis(model)
    if reduction := reduction_of(model, method):
        return shooting_equations(reduction.statement, parameters)
    return shooting_equations(half_orbit(model) if model.reversor else whole_flight(model), parameters)


@lru_cache(maxsize=64)
def half_orbit(model: Model) -> Statement:
    """Half of an orbit that is its own mirror image: from the launch set to a state that is fixed by the reversor.

    The unknowns are those of the launch and half the flight time. Where a launch has more of them than extension and
    speed, the contact after the mirrored landing has to reach such a state too, and half its time is a further unknown.
    Raises `InputError` for a model without a reversor.
    """
    if model.one_speed:
        return Statement("half orbit", model.half_unknowns, (half_flight(model),), ("alpha", "duration"))
    arcs = half_flight(model), half_contact(model)
    return Statement("half orbit", model.half_unknowns, arcs, ("duration", "contact_duration"))


def half_flight(model: Model) -> Arc:
    """The flight from the launch set to a state that is fixed by the reversor."""
    reversal = model.reversal
    return Arc(
        model.flight,
        start=lambda u, before, p: model.launch(u, p),
        duration=lambda u, p: u["duration"],
        conditions=lambda u, x, p: reversal.fixed(x, p),
        guard=lambda u, x, p, q: model.liftoff(u, p, q),
    )


def half_contact(model: Model) -> Arc:
    """The contact from the mirrored landing to a state that is fixed by the reversor."""
    reversal = model.contact_reversal
    return Arc(
        model.contact,
        start=lambda u, before, p: model.touchdown(u, p),
        duration=lambda u, p: u["contact_duration"],
        conditions=lambda u, x, p: reversal.fixed(x, p),
    )


@lru_cache(maxsize=64)
def whole_flight(model: Model) -> Statement:
    """From the launch set to a lossless landing, for a model without a reversor.

    Launch speed and flight time are two unknowns for three landing conditions, which can all hold only since energy is
    conserved and by symmetry. So the equations are made square by an unfolding: a multiple of the energy's gradient,
    a further unknown, is added to the field. It vanishes on an orbit. Raises `NoOrbit` for a model whose launch is more
    than a speed: the landing leaves its other unknowns free.
    """
    refuse_one_way(model)
    if not model.one_speed:
        raise NoOrbit(
            f"a {model.name} has no reversor, for example since it has a damper: where a launch has several numbers, "
            "the search finds only orbits whose halves are mirror images of each other"
        )
    arc = Arc(
        unfolded(replace(model.flight, watch={}), model.flight_gradient),
        start=lambda u, before, p: [*model.launch(u, p), u["unfolding"]],
        duration=lambda u, p: u["duration"],
        conditions=lambda u, x, p: model.landing(u, x[:-1], p),
        guard=lambda u, x, p, q: model.liftoff(u, p, q),
    )
    return Statement("whole flight", ("liftoff", "alpha", "duration", "unfolding"), (arc,), ("alpha", "duration"))


@dataclass(frozen=True, eq=False)
class Cycles:
    """Solved orbits (m) of one model as arrays, on their way from the equations to their certificates.

    u, p : unknowns and parameters by name, (m,) each
    flight : the first halves, in flight states; whole flights where nothing mirrors them
    halves : of each flight the motion from lift-off to its middle and, where that is not its mirror image, the one from
        landing backwards
    gap_slope, slope_error : (m,), derivative with respect to alpha of the gap at the orbit's landing time, and an
        estimate of its error
    residual, error : (m,), the largest residual of the equations, and the bound on the error of alpha
    with_contact : (k,), the orbits whose contact ends; `contacts` are their contacts, each up to its middle or, where
        nothing mirrors it, up to lift-off
    without_contact : by index of the others, the reason why their contact does not end
    """

    u: Mapping[str, ndarray]
    p: Mapping[str, ndarray]
    flight: Trajectories
    halves: Trajectories
    gap_slope: ndarray
    slope_error: ndarray
    residual: ndarray
    error: ndarray
    with_contact: ndarray
    contacts: Trajectories | None
    without_contact: Mapping[int, str]

    def __len__(self) -> int:
        return len(self.error)

    @cached_property
    def halves_per_flight(self) -> int:
        """The number of `halves` of each flight: 1 where the other one is its mirror image, else 2."""
        return len(self.halves) // len(self)

    @cached_property
    def flight_times(self) -> ndarray:
        """Times (m,) of whole flights."""
        return self.halves.ends.reshape(len(self), -1).sum(1) * (2 // self.halves_per_flight)

    @cached_property
    def contact_times(self) -> ndarray:
        """Times (m,) of whole contacts, `NONE` for contacts that do not end."""
        times = np.full(len(self), NONE)
        if self.contacts:
            times[self.with_contact] = self.contacts.ends * (2 // self.halves_per_flight)
        return times

    def flown(self, model: Model) -> list[Trajectories]:
        """The motions that take all values of a function of the places in flight: the halves, and their mirror images
        where these have other places."""
        return [self.halves] if model.plain else [self.halves, _images(self.halves, model.reversal, self.p_of_halves)]

    def stood(self, model: Model) -> list[Trajectories]:
        """The motions that take all values of a function of the places in contact: the contacts, and their images."""
        contacts, p = self.contacts, self.p_of_contacts
        if contacts is None or model.plain:
            return [contacts] if contacts else []
        return [contacts, _images(contacts, model.contact_reversal, p)]

    @cached_property
    def p_of_halves(self) -> Mapping[str, ndarray]:
        """The parameters of each of the `halves`."""
        if self.halves_per_flight == 1:
            return self.p
        return {name: np.repeat(values, self.halves_per_flight) for name, values in self.p.items()}

    @cached_property
    def p_of_contacts(self) -> Mapping[str, ndarray]:
        """The parameters of each of the `contacts`."""
        return {name: values[self.with_contact] for name, values in self.p.items()}


def _images(motions: Trajectories, by: SignedShift, p: Mapping[str, ndarray]) -> Trajectories:
    """The images of motions with parameters (m,)."""
    of_steps = {name: values[motions.owner] for name, values in p.items()}
    return motions.with_rows(by.rows(motions.coefficients, of_steps), motions.names[: len(by.signs)])


def interpret(
    model: Model, method: str, equations: Shooting, us: ndarray, ps: ndarray, evaluation: Evaluation, errors: ndarray
) -> Cycles:
    """The cycles, with the contacts, of solutions (m, n) of a method's equations with parameters (m, np), their
    `evaluation` and the bounds (m,) on their errors of alpha."""
    u = dict(zip(equations.statement.unknowns, us.T, strict=True))
    p = dict(zip(equations.parameters, ps.T, strict=True))
    flight, halves, gap_slope, growth = _flights(model, method, u, p, evaluation)
    gap = flight.with_rows(flight.series(model.landing_gap_of(p))[:, None], ("gap",)).sizes[:, 0]
    # The derivatives change with the error of alpha.
    with np.errstate(over="ignore"):  # nothing is known of a slope that may change without bound
        slope_error = SLOPE_CHANGE * gap * growth * evaluation.relative_growth**2 * errors / np.abs(u["alpha"])
    # Where the launch has several speeds, the contact up to its middle is a part of the equations.
    if len(evaluation.trajectories) > 1:
        contacts: Any = np.arange(len(us)), evaluation.trajectories[1].only(evaluation.trajectories[1].names), {}
    else:
        contacts = _contacts(model, u, p, u.get("contact_duration", LONGEST_CONTACT * (1 + flight.ends)))
    residual = np.abs(evaluation.residual).max(1)
    return Cycles(u, p, flight, halves, gap_slope, slope_error, residual, errors, *contacts)


def refused_by_unfolding(equations: Shooting, us: ndarray) -> dict[int, NoOrbit]:
    """Errors, by index, of solutions (m, n) of unfolded equations that are not orbits: the unfolding pumps energy."""
    u = dict(zip(equations.statement.unknowns, us.T, strict=True))
    pumped, refused = np.abs(u.get("unfolding", np.zeros(1))) * u.get("duration", 0.0), dict[int, NoOrbit]()
    for i in np.flatnonzero(pumped > LARGEST_UNFOLDING).tolist():
        reason = f"{pumped[i]:.1e} of the energy is supplied in the flight: there is no lossless orbit here"
        refused[i] = NoOrbit(f"the landing conditions hold only if {reason}")
    return refused


def _flights(model: Model, method: str, u: Mapping, p: Mapping, evaluation: Evaluation):
    """The `flight`, the `halves` and the `gap_slope` of `Cycles`, and the largest derivative (m,) of a state at landing
    by alpha, relative to its size."""
    motions, alpha = evaluation.trajectories[0], list(u).index("alpha")
    sizes = motions.sizes[:, : evaluation.transitions[0].shape[1]]
    grown = lambda change: relative(change[:, :, None], sizes, np.ones((len(sizes), 1))).max((1, 2))  # noqa: E731
    if reduction := reduction_of(model, method):
        of_steps = ({name: values[motions.owner] for name, values in each.items()} for each in (u, p))
        coefficients = reduction.complete(motions.starts, motions.coefficients, *of_steps)
        flight = motions.with_rows(coefficients, model.flight.states)
        landing = _landing_by(alpha, evaluation, reduction.reversor)
        return flight, flight, reduction.gap_slope(2 * flight.ends, landing.T, p), grown(landing)
    flight = motions.only(model.flight.states)
    if model.reversor:
        flight = motions.only((*flight.names, *model.flight.watch))
        slope = model.liftoff_slope(u, p) if model.liftoff_slope else None
        landing = _landing_by(alpha, evaluation, model.reversor, list(u).index("liftoff"), slope)
        return flight, flight, landing_gap_slope(model, landing.T, p), grown(landing)
    landing = (evaluation.transitions[0] @ evaluation.starts[0])[:, :, alpha]
    return flight, halved(flight), landing_gap_slope(model, landing.T, p), grown(landing)


def landing_gap_slope(model: Model, change: Iterable, p: Mapping) -> Algebraic:
    """Derivative by alpha of the gap at the orbit's landing time, from that of the flight state there, by component."""
    return sum(weight * d for weight, d in zip(model.landing_gap_of(p).weights, change, strict=False))


def halved(flights: Trajectories) -> Trajectories:
    """The halves of whole flights: of each flight the first half, and the second from landing backwards."""
    return Trajectories.of([half for path in flights for half in path.split(path.times[-1] / 2)])


def _landing_by(
    alpha: int, evaluation: Evaluation, reversor: tuple[int, ...], liftoff: int = 0, slope: Algebraic = None
) -> ndarray:
    """Derivatives (m, states) of the state at landing by the unknown with index `alpha`, on which that with index
    `liftoff` depends with slopes (m,); the second half of the motion is the mirror image of the first, and so is its
    transition matrix."""
    start = evaluation.starts[0][:, :, [alpha]]
    if slope is not None:
        start = start + np.reshape(slope, (-1, 1, 1)) * evaluation.starts[0][:, :, [liftoff]]
    return through_mirror(evaluation, 0, start, reversor)[:, :, 0]


def through_mirror(evaluation: Evaluation, arc: int, change: ndarray, signs: tuple[int, ...]) -> ndarray:
    """Changes (m, states, c) at the end of a motion whose first half is an arc, from those (m, states + t, c) at its
    start: the second half is the mirror image of the first, by a reversor of these signs, and so is its transition
    matrix."""
    first, mirror = evaluation.transitions[arc], np.array(signs)[:, None]
    change = mirror * (first[:, :, : change.shape[1]] @ change)
    parts = np.moveaxis(evaluation.parts[arc], 1, 0) if evaluation.parts else [first[:, :, : first.shape[1]]]
    for part in parts[::-1]:
        change = solve(part, change)
    return mirror * change


def contact_force_row(contact: Phase) -> Affine:
    """The contact force as a function of the rows of a trajectory in contact: its states, then watched quantities."""
    row = (*contact.states, *contact.watch).index(CONTACT_FORCE)
    return Affine((0.0,) * row + (1.0,))


def _contacts(model: Model, u: Mapping, p: Mapping, limits: ndarray):
    """The `with_contact`, `contacts` and `without_contact` of `Cycles`; a contact has to end within `limits` (m,), and
    where the launch has several speeds, mid-contact is at that time."""
    flow, starts, ps = flow_of(model.contact, tuple(p)), columns(model.touchdown(u, p)), vectors(p, len(limits))
    # A mirrored contact is followed up to its middle. Otherwise its force ends it, whose zero at landing is left out.
    end = (model.mid_contact(p), 0) if model.reversor else (contact_force_row(model.contact), 1)
    # A middle that differs between motions is searched for one by one.
    together = model.one_speed and not np.any(end[0].offset)
    end = (replace(end[0], offset=0.0), end[1]) if together else end
    done, contacts = until_zero(flow, starts, ps, *end) if together else (np.zeros(0, int), None)
    if contacts and len(done) == len(starts) and (contacts.ends < limits).all():
        return done, contacts, {}
    ended = zip(done.tolist(), contacts or (), strict=True)
    found: dict[int, Any] = {i: contact for i, contact in ended if contact.times[-1] < limits[i]}
    rest = np.array(sorted({*range(len(starts))} - found.keys()), int)
    if len(rest) and together and flow.in_lanes and not flow.phase.closed_form:
        # A contact that never ends takes thousands of steps, so that it is detected without storing them.
        times, *_, failed = first_events(flow, starts[rest], ps[rest], Watch(flow, [end[0]]), limits[rest], end[1])
        found |= {int(rest[k]): _end_of_contact(model, failed.get(k)) for k in (~np.isfinite(times)).nonzero()[0]}
    for i in {*range(len(starts))} - found.keys():
        try:
            own = end if together else (replace(end[0], offset=np.broadcast_to(end[0].offset, len(starts))[i]), end[1])
            path, _ = flow.run(starts[i], ps[i], limits[i], stop=first_zero(*own) if model.one_speed else None)
            found[i] = model.violations["end"] if model.one_speed and not path.times[-1] < limits[i] else path
        except FlowError as error:
            found[i] = _end_of_contact(model, error)
    reasons = {i: contact for i, contact in sorted(found.items()) if isinstance(contact, str)}
    order = sorted(found.keys() - reasons.keys())
    return np.array(order, int), Trajectories.of([found[i] for i in order]) if order else None, reasons


def _end_of_contact(model: Model, error: FlowError | None) -> str:
    """Why a contact does not end, whose motion may have broken off with an error."""
    if isinstance(error, OutOfRange):
        return Message("contact: {error}", error=error)
    return model.violations["end"]


def columns(values: Iterable) -> ndarray:
    """The array (m, n) of n values, each (m,) or one number for all m; at least one is an array."""
    return np.array(np.broadcast_arrays(*values), dtype=float).T.copy()


def vectors(p: Mapping[str, ndarray], count: int) -> ndarray:
    """The array (m, np) of parameters by name, if there are any, (m,) each."""
    return np.array(list(p.values()), dtype=float).reshape(len(p), count).T.copy()


def vector(p: Mapping[str, float]) -> ndarray:
    """The values of parameters by name, in their order."""
    return np.array(list(p.values()), dtype=float)
