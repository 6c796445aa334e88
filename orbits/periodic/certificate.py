"""The certificate of an orbit: what makes it a motion. Nothing here reuses the equations that were solved.

Orbits of one model are checked together, since most of the time would else go into asking for one after the other.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np

from ..errors import FlowError, NoOrbit, OutOfRange
from ..flow.flow import flow_of
from ..flow.trajectory import Trajectories
from ..flow.zero_crossing import first_zero
from ..model.model import Model
from ..model.phase import Affine, Phase
from ..numerics.bernstein import derivative, evaluate
from ..numerics.quadrature import GAUSS, GAUSS_PLACES, GAUSS_WEIGHTS
from ..symbolic.calls import ElementwiseFunction
from .error_bound import DOUBTFUL_RATIO, EPS, NARROW
from .orbit import Certificate

# An energy drift beyond this share, and far beyond what rounding explains, shows that the steps have leapt over a
# feature of a law.
WORST_DRIFT = 1e-8
# A turn this near to the middle of the motion, as a share of its time, is the middle itself.
MIDDLE = 1e-7
# What a certificate tells, in its order.
CERTIFICATE_FIELDS = tuple(Certificate.__dataclass_fields__)
# Stands for a least value that does not exist.
NONE = np.inf


@dataclass(frozen=True, eq=False)
class Solution:
    """Solved orbits (m) of one model, and what they mean for the flight.

    u, p : unknowns and parameters by name, (m,) each
    flight : the first halves, in flight states; whole flights where nothing mirrors them
    parts : of each flight the motion from lift-off to its middle and, where it is not its mirror image, the one from
        landing backwards
    gap_slope : (m,), derivative with respect to alpha of the gap at the orbit's landing time
    residual, error : (m,), largest of the equations, and bound on the error of alpha
    """

    u: Mapping[str, np.ndarray]
    p: Mapping[str, np.ndarray]
    flight: Trajectories
    parts: Trajectories
    gap_slope: np.ndarray
    residual: np.ndarray
    error: np.ndarray


@dataclass(frozen=True, eq=False)
class Cycles(Solution):
    """Solved orbits with their contacts, to be checked together.

    standing : (k,), the orbits whose contact ends; `contacts` are theirs, each up to its middle or, where nothing
        mirrors it, up to lift-off
    stopped : by index of the others, why theirs does not
    """

    standing: np.ndarray
    contacts: Trajectories | None
    stopped: Mapping[int, str]

    def __len__(self) -> int:
        return len(self.error)

    @property
    def count(self) -> int:
        """Parts of each flight; one is half of it."""
        return len(self.parts) // len(self)

    @cached_property
    def flight_times(self) -> np.ndarray:
        """Times (m,) of whole flights."""
        return self.parts.ends.reshape(len(self), -1).sum(1) * (2 if self.count == 1 else 1)

    @cached_property
    def contact_times(self) -> np.ndarray:
        """Times (m,) of whole contacts, `NONE` of those that do not end."""
        times = np.full(len(self), NONE)
        if self.contacts:
            times[self.standing] = self.contacts.ends * (2 if self.count == 1 else 1)
        return times

    @cached_property
    def p_of_parts(self) -> Mapping[str, np.ndarray]:
        """The parameters of each of the `parts`."""
        return {name: np.repeat(values, self.count) for name, values in self.p.items()}

    @cached_property
    def p_of_contacts(self) -> Mapping[str, np.ndarray]:
        """The parameters of each of the `contacts`."""
        return {name: values[self.standing] for name, values in self.p.items()}


def columns(values: Iterable, dtype=float) -> np.ndarray:
    """Rows (m, n) of n values, each (m,) or one for all, but not all of them."""
    values = list(values)
    rows = np.empty((next(len(value) for value in values if np.ndim(value)), len(values)), dtype)
    for i, value in enumerate(values):
        rows[:, i] = value
    return rows


def follow_contacts(model: Model, u: Mapping, p: Mapping, limits) -> dict:
    """The contacts after the lossless landings of orbits: what `Cycles` has more than a `Solution`, by name.

    u, p : unknowns and parameters by name, (m,) each
    limits : times (m,) within which a contact ends; where no speed tells its middle, it is at that time
    """
    along, starts, ps = flow_of(model.contact, tuple(p)), columns(model.touchdown(u, p)), columns(p.values())
    # Without a mirror image the force ends the contact, the first watched row; its zero at landing is left out.
    end = (model.contact_speed, 0) if model.reversor else (Affine((0.0,) * along.size + (1.0,)), 1)
    standing, contacts = along.until_zero(starts, ps, *end) if model.one_speed else (np.zeros(0, int), None)
    if len(standing) == len(starts) and (contacts.ends < limits).all():
        return {"standing": standing, "contacts": contacts, "stopped": {}}
    found = {int(i): contacts[j] for j, i in enumerate(standing) if contacts.ends[j] < limits[i]}
    stopped: dict[int, str] = {}
    for i in sorted({*range(len(starts))} - found.keys()):
        stop = first_zero(*end) if model.one_speed else None
        try:
            path, _ = along.run(starts[i], ps[i], limits[i], stop=stop)
        except FlowError as error:
            stopped[i] = f"contact: {error}" if isinstance(error, OutOfRange) else model.violations["end"]
            continue
        if stop and not path.times[-1] < limits[i]:
            stopped[i] = model.violations["end"]
        else:
            found[i] = path
    order = sorted(found)
    contacts = Trajectories.of([found[i] for i in order]) if found else None
    return {"standing": np.array(order, int), "contacts": contacts, "stopped": stopped}


def certify(model: Model, cases: Cycles) -> list[Certificate]:
    """The certificates of orbits of one model; raises `NoOrbit` about the first that can have none."""
    violations: list[list[str]] = [[] for _ in range(len(cases))]
    jerk, clearance = _flights(model, cases, violations)
    force, peak = _contact_forces(model, cases, violations)
    separation = _separations(model, cases, violations)
    power, changes, floors = _energies(model, cases)
    with np.errstate(all="ignore"):
        launch = 0.5 * cases.u["alpha"] * power
        drift = changes.max(1) / launch
        loss = _losses(model, cases, jerk, power)
    sound = np.isfinite([cases.error, cases.residual, drift, jerk]).all(0)
    sound &= np.array([np.isfinite(values) | (values == NONE) for values in (loss, separation, force)]).all(0)
    leaps = (changes > np.maximum(WORST_DRIFT * launch[:, None], DOUBTFUL_RATIO * floors)).any(1)
    for i in np.flatnonzero(~sound | leaps):
        reason = "its numbers overflow; state the machine in units nearer to 1"
        if sound[i]:
            reason = f"its energy drifts by {drift[i]:.1e}{NARROW}"
        raise NoOrbit(f"the orbit cannot be certified: {reason}").about(i)
    sides = np.where(cases.gap_slope > 0, "above", "below")
    figures = {
        "family": count_families(model, cases.parts, cases.count),
        "residual": cases.residual.tolist(),
        "error": cases.error.tolist(),
        "energy_drift": drift.tolist(),
        "clearance": or_none(clearance),
        "smallest_separation": or_none(separation),
        "smallest_contact_force": or_none(force),
        "largest_contact_force": or_none(peak),
        "landing_jerk": (-jerk).tolist(),
        "loss_coefficient": or_none(loss),
        "stable_side": np.where((loss == NONE) | (loss == 0), None, sides).tolist(),
        "violations": map(tuple, violations),
        "unfolding": cases.u["unfolding"].tolist() if "unfolding" in cases.u else [None] * len(cases),
    }
    return [Certificate(*row) for row in zip(*(figures[name] for name in CERTIFICATE_FIELDS), strict=True)]


def or_none(values) -> list[float | None]:
    """Numbers (m,), None for `NONE`."""
    return [None if value == NONE else value for value in values.tolist()]


def _losses(model: Model, cases: Cycles, jerk, power) -> np.ndarray:
    """Loss coefficients (m,), `NONE` where the gap opens the wrong way or does not change with the launch speed."""
    found, some = np.full(len(cases), NONE), (jerk > 0) & (cases.gap_slope != 0)
    if some.any():
        mass = model.impact_mass({name: values[some] for name, values in cases.p.items()})
        found[some] = loss_coefficient(mass, jerk[some], np.abs(cases.gap_slope[some]), power[some])
        found[found == np.inf] = np.nan  # too large, which is not `NONE`
        found[~some] = NONE
    return found


def loss_coefficient(impact_mass, jerk, gap_slope, power):
    """C of the one-step map alpha + d -> alpha + d - C d**(4/3), of numbers or expressions.

    Beside a lossless landing the gap goes like gap_slope d - jerk t**3/6: what is left of its speed where that vanishes
    is lost, and the launch energy changes by `power` with alpha.
    """
    return impact_mass * jerk**2 / 8 * (6 * gap_slope / jerk) ** (4 / 3) / power


def count_families(model: Model, flights: Trajectories, count: int) -> list[int]:
    """Stationary points of the extension after lift-off up to and with mid-flight, less one; of `count` parts of each
    flight, as in `Cycles`."""
    owner, piece, t = flights.pile(derivative(flights.series(model.extension))).roots()
    inside = flights.time(owner, piece, t) < flights.ends[owner] * (1 - MIDDLE)  # the root left out is mid-flight
    turns = np.bincount(owner[inside] // count, minlength=len(flights) // count)
    return (turns // count).tolist()


# What is checked, each with the violations (m lists) to add to.


def _flights(model: Model, cases: Cycles, violations) -> tuple[np.ndarray, np.ndarray]:
    """Landing jerks (m,) times -1, and lowest interior minima of the gaps (m,), `NONE` without one. Each part of a
    flight starts from a zero of order three of the gap, which is divided out exactly."""
    flights = cases.parts
    gaps = flights.series(model.gap(cases.p_of_parts))
    jerk = (6 * gaps[flights.first, 3]).reshape(-1, cases.count).min(1)
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
    lowest, times = np.full(len(flights), NONE), np.zeros(len(flights))
    order = np.argsort(-heights)  # of several in a part the last counts
    lowest[owner[order]], times[owner[order]] = heights[order], when[order]
    clearance, when = _least(cases, lowest, times)
    for i in np.flatnonzero(jerk <= 0):
        violations[i].append(f"the gap opens the wrong way at landing (landing jerk {-jerk[i]:.3g}, must be negative)")
    for i in np.flatnonzero(clearance <= 0):
        where = f"t = {when[i]:.6g} of the flight (height {clearance[i]:.3g})"
        violations[i].append(f"{model.violations['gap']} at {where}")
    return jerk, clearance


def _least(cases: Cycles, values, times) -> tuple[np.ndarray, np.ndarray]:
    """Of each flight the least (m,) of `values`, one of each part, and when (m,) that is, from `times` in the parts."""
    values, times = values.reshape(-1, cases.count), times.reshape(-1, cases.count)
    part, each = values.argmin(1), np.arange(len(values))
    when = times[each, part]
    return values[each, part], np.where(part == 0, when, cases.flight_times - when)


def _separations(model: Model, cases: Cycles, violations) -> np.ndarray:
    """Least separations (m,) over the cycles, `NONE` where no length is stated or the contact does not end."""
    flights, contacts, standing = cases.parts, cases.contacts, cases.standing
    found = np.full(len(cases), NONE)
    if (distance := model.separation(cases.p_of_parts)) is None:
        return found
    low, piece, t = flights.pile(flights.series(distance)).lowest()
    least, when = _least(cases, low, flights.time(np.arange(len(flights)), piece, t))
    standing_lower = np.zeros(len(cases), bool)
    if contacts:
        low, piece, t = contacts.pile(contacts.series(model.separation(cases.p_of_contacts), model.embed)).lowest()
        lower = low < least[standing]
        these = standing[lower]
        least[these], standing_lower[these] = low[lower], True
        when[these] = contacts.time(np.flatnonzero(lower), piece[lower], t[lower])
    for i in np.flatnonzero(~(least > 0)):
        where = f"t = {when[i]:.6g} of the {'contact' if standing_lower[i] else 'flight'}"
        violations[i].append(f"{model.violations['separation']} at {where} (separation {least[i]:.3g})")
    found[standing] = least[standing]
    return found


def _contact_forces(model: Model, cases: Cycles, violations) -> tuple[np.ndarray, np.ndarray]:
    """Lowest interior minima (m,) of the forces over the (half) contacts, `NONE` without one, and their peaks (m,),
    `NONE` where the contact does not end. The force starts from a simple zero, which is divided out exactly; a whole
    contact ends on another."""
    least, peaks = np.full((2, len(cases)), NONE)
    for i, reason in cases.stopped.items():
        violations[i].append(reason)
    if not cases.contacts:
        return least, peaks
    contacts, half, pulls = cases.contacts, model.reversor is not None, model.violations["pull"]
    force = contacts.coefficients[:, contacts.names.index("contact force")]
    before = contacts.ends * (1 - MIDDLE)
    owner, piece, t = contacts.pile(derivative(force)).roots(rising=True)
    inside = contacts.time(owner, piece, t) < before[owner]
    low = np.full(len(contacts), NONE)
    np.minimum.at(low, owner[inside], evaluate(force[contacts.first[owner] + piece], t)[inside])
    if half:  # mid-contact itself
        last, h = force[contacts.last], contacts.steps[contacts.last]
        rising = evaluate(derivative(derivative(last)), h) > 0
        low = np.where(rising, np.minimum(low, evaluate(last, h)), low)
    least[cases.standing], peaks[cases.standing] = low, -contacts.pile(-force).lowest()[0]
    owner, piece, t = contacts.pile(force).roots(start=1)
    when = contacts.time(owner, piece, t)
    inside = half | (when < before[owner])
    pulling, first = np.unique(owner[inside], return_index=True)
    for i, at in zip(cases.standing[pulling], when[inside][first], strict=True):
        violations[i].append(f"{pulls} in contact at t = {at:.6g}")
    at_once = force[contacts.first, 1] <= 0
    at_once[pulling] = False
    for i in cases.standing[at_once]:
        violations[i].append(f"{pulls} as soon as the contact begins")
    return least, peaks


@lru_cache(maxsize=64)
def gradients(phase: Phase, gradient: Callable, parameters: tuple[str, ...]) -> ElementwiseFunction:
    """An energy gradient of a model at several points, (x, parameters with the data of a piece)."""
    along = flow_of(phase, parameters)
    x = ca.SX.sym("x", along.size)
    p = ca.SX.sym("p", len(parameters) + (phase.pieces.size if phase.pieces else 0))
    return ElementwiseFunction(ca.Function("gradient", [x, p], [ca.vertcat(*gradient(*along.symbols(x, p)))]))


def _energies(model: Model, cases: Cycles) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """dE/dalpha at launch (m,); of each part of the flight and of the contact the largest change of energy
    (m, count + 1), and what rounding of the states makes of it."""
    changes, floors = np.zeros((2, len(cases), cases.count + 1))
    *flown, starts = _work(model.flight, model.flight_gradient, cases.parts, cases.p_of_parts)
    changes[:, :-1], floors[:, :-1] = (values.reshape(len(cases), -1) for values in flown)
    if cases.contacts:
        stood = _work(model.contact, model.contact_gradient, cases.contacts, cases.p_of_contacts)
        changes[cases.standing, -1], floors[cases.standing, -1], _ = stood
    # Launch expressions are plain arithmetic: a complex step is exact.
    direction = columns(model.launch({**cases.u, "alpha": cases.u["alpha"] + 1e-30j}, cases.p), complex).imag * 1e30
    return np.einsum("mi,mi->m", starts[:: cases.count], direction), changes, floors


def _work(
    phase: Phase, gradient: Callable, motions: Trajectories, p: Mapping
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each motion the largest change of energy (m,), that of rounding (m,), and the gradient at its start (m, n).

    The change is the work of the gradient on the straight lines between the nodes.
    """
    along = flow_of(phase, tuple(p))
    n = along.size
    nodes = motions.coefficients[:, :n, 0]
    after = np.roll(nodes, -1, axis=0)
    after[motions.last] = motions.finals[:, :n]
    moves = after - nodes
    data = along.data_of(motions, columns(p.values()))
    points = nodes[:, None] + GAUSS_PLACES[:, None] * moves[:, None]
    call = gradients(phase, gradient, tuple(p))
    rates = call(points.reshape(-1, n), np.repeat(data, GAUSS, axis=0))[0].reshape(-1, GAUSS, n)
    changes = np.cumsum(((GAUSS_WEIGHTS @ rates) * moves).sum(1))
    before = np.where(motions.first > 0, changes[motions.first - 1], 0.0)
    largest = motions.largest(changes - np.repeat(before, motions.counts))
    floors = EPS * motions.largest(nodes) * motions.largest(rates)
    (starts,) = call(nodes[motions.first], data[motions.first])
    return largest, floors, starts
