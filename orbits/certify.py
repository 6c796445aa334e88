"""The certificate of an orbit: what makes it a motion. Nothing here reuses the equations that were solved.

Orbits of one model are checked together, since most of the time would else go into asking for one after the other.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from .accuracy import EPS, FAR, GAUSS, GAUSS_PLACES, GAUSS_WEIGHTS, NARROW
from .elementwise import Rows
from .errors import FlowError, NoOrbit, OutOfRange
from .flow import Flow, first_zero, flow
from .model import Affine, Model, Phase
from .motions import Motions, Trajectory
from .orbit import Certificate
from .polynomial import derivative, evaluate

# An energy drift beyond this share, and far beyond what rounding explains, shows that the steps have leapt over a
# feature of a law.
WORST_DRIFT = 1e-8
# A turn this near to the middle of the motion, as a share of its time, is the middle itself.
MIDDLE = 1e-7


def follow_contacts(model: Model, orbits: Sequence[tuple]) -> list[tuple[Trajectory | None, str]]:
    """The contacts after the lossless landings of orbits (u, p, limit), unknowns and parameters by name.

    Each up to its middle or, where nothing mirrors it, up to lift-off; None with the reason when it has not come there
    within the time `limit`. Where no speed tells the middle, it is at that time.
    """
    along = flow(model.contact, tuple(orbits[0][1]))
    if not model.one_speed:
        return [_half_contact(model, along, *orbit) for orbit in orbits]
    starts = np.array([model.touchdown(u, p) for u, p, _ in orbits], dtype=float)
    ps = np.array([list(p.values()) for _, p, _ in orbits])
    # Without a mirror image the force ends the contact, the first watched row; its zero at landing is left out.
    end = (model.contact_speed, 0) if model.reversor else (Affine((0.0,) * along.size + (1.0,)), 1)
    found = along.until_zero(starts, ps, *end)
    return [
        (path, "")
        if path and path.times[-1] < limit
        else _slow_contact(model, along, start, p, limit, first_zero(*end))
        for path, start, p, (_, _, limit) in zip(found, starts, ps, orbits, strict=True)
    ]


def _half_contact(model: Model, along: Flow, u, p, duration: float) -> tuple[Trajectory | None, str]:
    """One of `follow_contacts`, for a known time."""
    try:
        return along.run(model.touchdown(u, p), list(p.values()), duration)[0], ""
    except FlowError:
        return None, model.violations["end"]


def _slow_contact(model: Model, along: Flow, start, p, limit: float, stop: Callable) -> tuple[Trajectory | None, str]:
    """One of `follow_contacts`, step by step."""
    try:
        path, _ = along.run(start, p, limit, stop=stop)
    except OutOfRange as error:
        return None, f"contact: {error}"
    except FlowError:
        return None, model.violations["end"]
    return (path, "") if path.times[-1] < limit else (None, model.violations["end"])


@dataclass(frozen=True, eq=False)
class Case:
    """A solved orbit to be checked.

    u, p : unknowns and parameters by name
    parts : the flight from lift-off to its middle, and, where it is not its mirror image, from landing backwards
    contact : as `follow_contacts` gives it, None when it does not end, and then `stopped` says why
    gap_slope : derivative with respect to alpha of the gap at the orbit's landing time
    residual, error : of the equations, and of alpha
    """

    u: Mapping[str, float]
    p: Mapping[str, float]
    parts: tuple[Trajectory, ...]
    contact: Trajectory | None
    stopped: str
    gap_slope: float
    residual: float
    error: float

    @property
    def flight_time(self) -> float:
        """Time of the whole flight; a single part is half of it."""
        return float(sum(part.times[-1] for part in self.parts)) * (2 if len(self.parts) == 1 else 1)

    @property
    def contact_time(self) -> float | None:
        """Time of the whole contact, None when it does not end."""
        return None if self.contact is None else float(self.contact.times[-1]) * (2 if len(self.parts) == 1 else 1)


def certify(model: Model, cases: Sequence[Case]) -> list[Certificate | NoOrbit]:
    """Check orbits of one model: the certificate of each, or the error that tells why there is none."""
    if not cases:
        return []
    flights = Motions([part for case in cases for part in case.parts])
    standing = [case for case in cases if case.contact is not None]
    contacts = Motions([case.contact for case in standing]) if standing else None
    measured = zip(
        cases,
        count_families(model, flights, len(cases[0].parts)),
        _flights(model, cases, flights),
        _contact_forces(model, cases, contacts),
        _separations(model, cases, flights, contacts),
        _energies(model, cases, flights, contacts),
        strict=True,
    )
    return [_certificate(model, *figures) for figures in measured]


def loss_coefficient(impact_mass, jerk, gap_slope, power):
    """C of the one-step map alpha + d -> alpha + d - C d**(4/3), of numbers or expressions.

    Beside a lossless landing the gap goes like gap_slope d - jerk t**3/6: what is left of its speed where that vanishes
    is lost, and the launch energy changes by `power` with alpha.
    """
    return impact_mass * jerk**2 / 8 * (6 * gap_slope / jerk) ** (4 / 3) / power


def _certificate(model: Model, case: Case, family: int, flight, contact, separation, energy) -> Certificate | NoOrbit:
    """The certificate of a case from its figures, each with the violations that it makes."""
    (jerk, clearance, in_flight), (force, peak, in_contact), (least, touching) = flight, contact, separation
    power, changes = energy
    start = 0.5 * case.u["alpha"] * power
    drift = max(change for change, _ in changes) / start
    loss = None
    if jerk > 0 and case.gap_slope != 0:
        loss = loss_coefficient(model.impact_mass(case.p), jerk, abs(case.gap_slope), power)
    figures = (case.error, drift, case.residual, jerk, *(x for x in (loss, least, force) if x is not None))
    if not all(map(math.isfinite, figures)):
        return NoOrbit("the orbit cannot be certified: its numbers overflow; state the machine in units nearer to 1")
    if any(change > max(WORST_DRIFT * start, FAR * floor) for change, floor in changes):
        return NoOrbit(f"the orbit cannot be certified: its energy drifts by {drift:.1e}{NARROW}")
    return Certificate(
        family=family,
        residual=float(case.residual),
        error=float(case.error),
        energy_drift=float(drift),
        clearance=clearance,
        smallest_separation=least,
        smallest_contact_force=force,
        largest_contact_force=peak,
        landing_jerk=-float(jerk),
        loss_coefficient=loss and float(loss),
        stable_side=loss and ("above" if case.gap_slope > 0 else "below"),
        violations=(*in_flight, *in_contact, *touching),
        unfolding=case.u.get("unfolding"),
    )


def count_families(model: Model, flights: Motions, parts: int) -> list[int]:
    """Stationary points of the extension after lift-off up to and with mid-flight, less one; `parts` of a flight, as in
    `Case`, follow each other."""
    owner, piece, t = flights.pile(derivative(flights.series(model.extension))).roots()
    inside = flights.time(owner, piece, t) < flights.ends[owner] * (1 - MIDDLE)  # the root left out is mid-flight
    turns = np.bincount(owner[inside] // parts, minlength=len(flights.ends) // parts)
    return (turns // parts).tolist()


def _flights(model: Model, cases: Sequence[Case], flights: Motions) -> list[tuple]:
    """Of each case the landing jerk (times -1), the lowest interior minimum of the gap (None without one), and the
    violations in flight. Each part starts from a zero of order three of the gap, which is divided out exactly."""
    parts = len(cases[0].parts)
    gaps = flights.series([model.gap(case.p) for case in cases for _ in case.parts])
    jerks = (6 * gaps[flights.first, 3]).reshape(-1, parts).min(1)
    owner, piece, t = flights.pile(derivative(gaps)).roots(start=2, rising=True)
    when = flights.time(owner, piece, t)
    inside = when < flights.ends[owner] * (1 - MIDDLE)
    heights = evaluate(gaps[flights.first[owner] + piece], t)
    # The very end of a part may be a minimum too, the middle of the flight.
    slope = derivative(gaps[flights.last])
    h = flights.steps[flights.last]
    middle, rate, bend = (evaluate(c, h) for c in (gaps[flights.last], slope, derivative(slope)))
    ends = np.flatnonzero((bend > 0) & (np.abs(rate) * flights.ends < 1e-6 * flights.largest(gaps[:, :1])))
    owner, when = np.append(owner[inside], ends), np.append(when[inside], flights.ends[ends])
    heights = np.append(heights[inside], middle[ends])
    lowest: list = [(None, None)] * len(cases)
    for i in np.argsort(-heights):  # the lowest last
        index, backwards = divmod(int(owner[i]), parts)
        lowest[index] = float(heights[i]), cases[index].flight_time - when[i] if backwards else when[i]
    answers = []
    for jerk, (clearance, at) in zip(jerks.tolist(), lowest, strict=True):
        violations = []
        if jerk <= 0:
            violations.append(f"the gap opens the wrong way at landing (landing jerk {-jerk:.3g}, must be negative)")
        if clearance is not None and clearance <= 0:
            violations.append(f"{model.violations['gap']} at t = {at:.6g} of the flight (height {clearance:.3g})")
        answers.append((jerk, clearance, violations))
    return answers


def _separations(model: Model, cases: Sequence[Case], flights: Motions, contacts: Motions | None) -> list[tuple]:
    """Of each case the least separation over the cycle, None where no length is stated or the contact does not end,
    and the violation where it is not positive."""
    if model.separation(cases[0].p) is None:
        return [(None, [])] * len(cases)
    distances, parts = [model.separation(case.p) for case in cases], len(cases[0].parts)
    least, piece, t = flights.pile(flights.series([d for d in distances for _ in range(parts)])).lowest()
    when = flights.time(np.arange(len(least)), piece, t)
    found = [min(range(i, i + parts), key=least.__getitem__) for i in range(0, len(least), parts)]
    answers: list = []
    for case, i in zip(cases, found, strict=True):
        answers.append((float(least[i]), case.flight_time - when[i] if i % parts else when[i], "flight"))
    standing = [i for i, case in enumerate(cases) if case.contact is not None]
    if standing:
        embedded = [Affine(tuple(np.array(distances[i].weights) @ model.embed), distances[i].offset) for i in standing]
        least, piece, t = contacts.pile(contacts.series(embedded)).lowest()
        when = contacts.time(np.arange(len(least)), piece, t)
        for i, *other in zip(standing, least.tolist(), when, strict=True):
            answers[i] = min(answers[i], (*other, "contact"))
    word = model.violations["separation"]
    return [
        (
            least if case.contact is not None else None,
            [] if least > 0 else [f"{word} at t = {when:.6g} of the {where} (separation {least:.3g})"],
        )
        for case, (least, when, where) in zip(cases, answers, strict=True)
    ]


def _contact_forces(model: Model, cases: Sequence[Case], contacts: Motions | None) -> list[tuple]:
    """Of each case the lowest interior minimum of the force over the (half) contact, None without one, its peak, and a
    violation where it pulls or the contact does not end. The force starts from a simple zero, which is divided out
    exactly; a whole contact ends on another."""
    answers: list = [(None, None, [case.stopped]) for case in cases]
    if contacts is None:
        return answers
    half, pulls = model.reversor is not None, model.violations["pull"]
    force = contacts.coefficients[:, contacts.names.index("contact force")]
    before = contacts.ends * (1 - MIDDLE)
    owner, piece, t = contacts.pile(derivative(force)).roots(rising=True)
    inside = contacts.time(owner, piece, t) < before[owner]
    least = np.full(len(before), np.inf)
    np.minimum.at(least, owner[inside], evaluate(force[contacts.first[owner] + piece], t)[inside])
    if half:  # mid-contact itself
        last, h = force[contacts.last], contacts.steps[contacts.last]
        rising = evaluate(derivative(derivative(last)), h) > 0
        least = np.where(rising, np.minimum(least, evaluate(last, h)), least)
    owner, piece, t = contacts.pile(force).roots(start=1)
    when = contacts.time(owner, piece, t)
    crossed = {int(o): time for o, time in zip(owner[::-1], when[::-1], strict=True) if half or time < before[o]}
    peaks = -contacts.pile(-force).lowest()[0]
    rates = force[contacts.first, 1]
    standing = [i for i, case in enumerate(cases) if case.contact is not None]
    for j, (i, low, peak) in enumerate(zip(standing, least.tolist(), peaks.tolist(), strict=True)):
        violations = [f"{pulls} in contact at t = {crossed[j]:.6g}"] if j in crossed else []
        if not violations and rates[j] <= 0:
            violations = [f"{pulls} as soon as the contact begins"]
        answers[i] = (low if low < np.inf else None, peak, violations)
    return answers


@lru_cache(maxsize=64)
def gradients(phase: Phase, gradient: Callable, parameters: tuple[str, ...]) -> Rows:
    """An energy gradient of a model at several points, (x, parameters with the data of a piece)."""
    along = flow(phase, parameters)
    x = ca.SX.sym("x", along.size)
    p = ca.SX.sym("p", len(parameters) + (phase.pieces.size if phase.pieces else 0))
    return Rows(ca.Function("gradient", [x, p], [ca.vertcat(*gradient(*along.symbols(x, p)))]))


def _energies(model: Model, cases: Sequence[Case], flights: Motions, contacts: Motions | None) -> list[tuple]:
    """Of each case dE/dalpha at launch, and for each of its motions the largest change of energy, with what rounding of
    the states makes of it."""
    parts, standing = len(cases[0].parts), [case for case in cases if case.contact is not None]
    owners = [case for case in cases for _ in case.parts]
    changes, starts = _work(model.flight, model.flight_gradient, flights, owners)
    others = iter(_work(model.contact, model.contact_gradient, contacts, standing)[0] if standing else ())
    # Launch expressions are plain arithmetic: a complex step is exact.
    directions = [model.launch({**case.u, "alpha": case.u["alpha"] + 1e-30j}, case.p) for case in cases]
    powers = np.einsum("mi,mi->m", starts[::parts], np.array(directions).imag * 1e30)
    answers = []
    for i, (case, power) in enumerate(zip(cases, powers.tolist(), strict=True)):
        drifts = changes[i * parts : (i + 1) * parts]
        answers.append((power, drifts if case.contact is None else [*drifts, next(others)]))
    return answers


def _work(phase: Phase, gradient: Callable, motions: Motions, cases: Sequence[Case]):
    """Of each motion of cases the largest change of energy and that of rounding, and the gradients (m, n) at the
    starts.

    The change is the work of the gradient on the straight lines between the nodes.
    """
    names = tuple(cases[0].p)
    along = flow(phase, names)
    n = along.size
    nodes = motions.coefficients[:, :n, 0]
    after = np.roll(nodes, -1, axis=0)
    after[motions.last] = motions.finals[:, :n]
    moves = after - nodes
    data = along.data_of(motions, np.array([list(case.p.values()) for case in cases]))
    points = nodes[:, None] + GAUSS_PLACES[:, None] * moves[:, None]
    call = gradients(phase, gradient, names)
    rates = call(points.reshape(-1, n), np.repeat(data, GAUSS, axis=0))[0].reshape(-1, GAUSS, n)
    changes = np.cumsum(((GAUSS_WEIGHTS @ rates) * moves).sum(1))
    before = np.where(motions.first > 0, changes[motions.first - 1], 0.0)
    largest = motions.largest(changes - np.repeat(before, motions.counts))
    floors = EPS * motions.largest(nodes) * motions.largest(rates)
    (starts,) = call(nodes[motions.first], data[motions.first])
    return list(zip(largest.tolist(), floors.tolist(), strict=True)), starts
