"""What makes a root of the equations a motion: gap, contact force and separation over the cycle, from motions alone."""

import numpy as np

from ..flow.trajectory import Trajectories
from ..model.model import Model
from ..numerics.bernstein import derivative, evaluate
from .formulations import CONTACT_FORCE, NONE, Cycles

# A stationary point this near to the middle of the motion, as a share of its time, is the middle itself.
MIDDLE = 1e-7
# The gap is stationary at the end of a half flight when its rate there, times the time of that half, is below this
# share of the largest gap: in a mirrored motion the rate vanishes but for rounding, which is far smaller.
STATIONARY = 1e-6
Violation = tuple[int, str]  # the index of the orbit, and what is wrong in words


def admissibility(model: Model, cycles: Cycles) -> tuple:
    """What makes m solved orbits of one model motions, and what makes them none.

    Returns (m,) each, `NONE` where there is no such minimum or peak: the jerk of the gap at lift-off, which is minus
    that at landing; the lowest interior minimum of the gap; that of the contact force, and its peak; the least
    separation over the cycle, `NONE` also where no length is stated or the contact does not end; and the violations of
    each orbit, in words.
    """
    jerk, clearance, collisions = _gaps(model, cycles)
    separation, meetings = _separations(model, cycles)
    smallest_force, largest_force, pulls = _contact_forces(model, cycles)
    violations: list[tuple[str, ...]] = [()] * len(cycles)
    for i, reason in (*collisions, *pulls, *meetings):
        violations[i] += (reason,)
    return jerk, clearance, smallest_force, largest_force, separation, violations


def count_families(model: Model, halves: Trajectories, per_flight: int) -> list[int]:
    """The families of flights: the stationary points of the extension after lift-off up to and with mid-flight, less
    one; `per_flight` of the halves belong to each flight."""
    owner, piece, t = halves.pile(derivative(halves.series(model.extension))).roots()
    inside = halves.time(owner, piece, t) < halves.ends[owner] * (1 - MIDDLE)  # the root left out is mid-flight
    turns = np.bincount(owner[inside] // per_flight, minlength=len(halves) // per_flight)
    return (turns // per_flight).tolist()


def _gaps(model: Model, cycles: Cycles) -> tuple[np.ndarray, np.ndarray, list[Violation]]:
    """Jerks of the gap at lift-off (m,), its lowest interior minima (m,), `NONE` without one, and what they violate."""
    halves = cycles.halves
    gaps = halves.series(model.gap(cycles.p_of_halves))
    jerk = (6 * gaps[halves.first, 3]).reshape(-1, cycles.halves_per_flight).min(1)
    clearance, when = _least_of_halves(cycles, *_lowest_minima(halves, gaps))
    opens, meets = "the gap opens the wrong way at landing (landing jerk", model.violations["gap"]
    violations = [(i, f"{opens} {-jerk[i]:.3g}, must be negative)") for i in np.flatnonzero(jerk <= 0).tolist()]
    for i in np.flatnonzero(clearance <= 0).tolist():
        violations.append((i, f"{meets} at t = {when[i]:.6g} of the flight (height {clearance[i]:.3g})"))
    return jerk, clearance, violations


def _lowest_minima(halves: Trajectories, gaps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest minimum (h,) of the gap on each half of a flight, `NONE` without one, and its time (h,)."""
    # Each half starts from a zero of order three of the gap: its rate from one of order two, divided out exactly.
    owner, piece, t = halves.pile(derivative(gaps)).roots(start=2, rising=True)
    times = halves.time(owner, piece, t)
    inside = times < halves.ends[owner] * (1 - MIDDLE)
    heights = evaluate(gaps[halves.first[owner] + piece], t)
    # The end of a half, mid-flight, may be a minimum too.
    last, h = gaps[halves.last], halves.steps[halves.last]
    middle, rate, bend = (evaluate(c, h) for c in (last, derivative(last), derivative(derivative(last))))
    ends = np.flatnonzero((bend > 0) & (np.abs(rate) * halves.ends < STATIONARY * halves.largest(gaps[:, :1])))
    owner, times = np.append(owner[inside], ends), np.append(times[inside], halves.ends[ends])
    heights = np.append(heights[inside], middle[ends])
    lowest, when = np.full(len(halves), NONE), np.zeros(len(halves))
    order = np.argsort(-heights)  # of several assignments to one half the last, the lowest, counts
    lowest[owner[order]], when[owner[order]] = heights[order], times[order]
    return lowest, when


def _least_of_halves(cycles: Cycles, values: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least (m,) of the values on the halves of each flight, and its time (m,) in the flight."""
    values, times = (array.reshape(-1, cycles.halves_per_flight) for array in (values, times))
    half, each = values.argmin(1), np.arange(len(values))
    when = times[each, half]
    return values[each, half], np.where(half == 0, when, cycles.flight_times - when)


def _contact_forces(model: Model, cycles: Cycles) -> tuple[np.ndarray, np.ndarray, list[Violation]]:
    """The lowest interior minima (m,) of the contact forces, and their peaks (m,), `NONE` where there are none; and the
    contacts that do not end or that have to pull."""
    (least, peaks), violations = np.full((2, len(cycles)), NONE), [*cycles.without_contact.items()]
    if not cycles.contacts:
        return least, peaks, violations
    contacts, pulls = cycles.contacts, model.violations["pull"]
    force = contacts.coefficients[:, contacts.names.index(CONTACT_FORCE)]
    owner, piece, t = contacts.pile(derivative(force)).roots(rising=True)
    inside = contacts.time(owner, piece, t) < contacts.ends[owner] * (1 - MIDDLE)
    low = np.full(len(contacts), NONE)
    np.minimum.at(low, owner[inside], evaluate(force[contacts.first[owner] + piece], t)[inside])
    if model.reversor:  # mid-contact itself may be a minimum
        last, h = force[contacts.last], contacts.steps[contacts.last]
        rising = evaluate(derivative(derivative(last)), h) > 0
        low = np.where(rising, np.minimum(low, evaluate(last, h)), low)
    least[cycles.with_contact], peaks[cycles.with_contact] = low, -contacts.pile(-force).lowest()[0]
    # The force starts from a simple zero, which is divided out exactly; a whole contact ends on another one.
    owner, piece, t = contacts.pile(force).roots(start=1)
    times = contacts.time(owner, piece, t)
    inside = np.full(len(times), True) if model.reversor else times < contacts.ends[owner] * (1 - MIDDLE)
    pulling, first = np.unique(owner[inside], return_index=True)
    at_once = force[contacts.first, 1] <= 0
    at_once[pulling] = False
    places = zip(cycles.with_contact[pulling].tolist(), times[inside][first], strict=True)
    violations += [(i, f"{pulls} in contact at t = {time:.6g}") for i, time in places]
    violations += [(i, f"{pulls} as soon as the contact begins") for i in cycles.with_contact[at_once].tolist()]
    return least, peaks, violations


def _separations(model: Model, cycles: Cycles) -> tuple[np.ndarray, list[Violation]]:
    """Least separations (m,) over the cycles, and the orbits where they are not positive; where the contact does not
    end, the flight is checked all the same."""
    halves, contacts = cycles.halves, cycles.contacts
    found = np.full(len(cycles), NONE)
    if (distance := model.separation(cycles.p_of_halves)) is None:
        return found, []
    low, piece, t = halves.pile(halves.series(distance)).lowest()
    least, when = _least_of_halves(cycles, low, halves.time(np.arange(len(halves)), piece, t))
    where = np.full(len(cycles), "flight", dtype=object)
    if contacts:
        low, piece, t = contacts.pile(contacts.series(model.separation(cycles.p_of_contacts), model.embed)).lowest()
        lower = low < least[cycles.with_contact]
        these = cycles.with_contact[lower]
        least[these], where[these] = low[lower], "contact"
        when[these] = contacts.time(np.flatnonzero(lower), piece[lower], t[lower])
    found[cycles.with_contact] = least[cycles.with_contact]
    meets, violations = model.violations["separation"], list[Violation]()
    for i in np.flatnonzero(~(least > 0)).tolist():
        violations.append((i, f"{meets} at t = {when[i]:.6g} of the {where[i]} (separation {least[i]:.3g})"))
    return found, violations
