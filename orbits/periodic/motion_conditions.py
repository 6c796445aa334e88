"""The conditions of a motion: nothing touches the ground too early, parts do not pass through each other, and no
contact pulls.

They are checked on functions of the motions, by their lowest values and their zeros; the family is counted there too.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..flow import Trajectories, flow_of
from ..laws import Algebraic
from ..model import CONTACT_FORCE, LANDED_FORCE, Affine, Model, StateFormula
from ..records import NONE
from ..shooting import EPS, Cycles, vectors
from ..units import LENGTH, TIME, Message, Quantity
from .extrema_and_zeros import MIDDLE, Sought, TurnsAndZeros, turns_and_zeros
from .loss_coefficient import jerks

# Rounding moves the middle by at most this share, where small changes grow ten million times on the way there.
LARGEST_MIDDLE = 0.1
# What rounding makes of a gap, in last digits of the largest term of its motion.
ROUNDED_STATE = 256.0
# The gap is stationary at the end of a half flight when its rate there, times the time of that half, is below this
# share of the largest gap: in a mirrored motion the rate vanishes up to rounding, which is far smaller.
STATIONARY = 1e-6
Violation = tuple[int, str]  # the index of the orbit, and the violation in words


def checked_functions(model: Model, cycles: Cycles) -> dict[str, TurnsAndZeros]:
    """The functions on the motions that a certificate checks: gap, force, separations and the extension with their
    stationary points, and the forces with their zeros too."""
    halves, contacts, distance = cycles.halves, cycles.contacts, model.separation(cycles.p_of_halves)
    # Each half starts from a zero of order three of the gap, so of order two of its rate, and the contact force from a
    # simple one.
    sought = {
        "gap": Sought(halves, model.height_of(cycles.p_of_halves), order=2),
        "extension": Sought(halves, model.extension),
    }
    if model.landing_gap:
        sought["landing gap"] = Sought(halves, model.landing_gap(cycles.p_of_halves))
    if contacts and (standing := model.standing_gap(cycles.p_of_contacts)):
        sought |= {f"standing gap {i}": Sought(each, standing) for i, each in enumerate(cycles.stood(model))}
    flown = {"separation": distance} if distance else {}
    flown |= _above_ground(model, cycles.p_of_halves)
    for i, motions in enumerate(cycles.flown(model) if flown else ()):
        sought |= {f"{name} {i}": Sought(motions, each) for name, each in flown.items()}
    if contacts:
        for name, order in _forces_of(model).items():
            force = Affine((0.0,) * contacts.names.index(name) + (1.0,))
            sought |= {name: Sought(contacts, force), f"zeros of {name}": Sought(contacts, force, False, order)}
        stood = {"separation": model.separation(cycles.p_of_contacts)} if distance else {}
        stood |= _above_ground(model, cycles.p_of_contacts)
        for i, motions in enumerate(cycles.stood(model) if stood else ()):
            own = {f"{name} in contact {i}": each for name, each in stood.items()}
            sought |= {name: Sought(motions, each, embed=model.embed) for name, each in own.items()}
    return turns_and_zeros(sought)


def _above_ground(model: Model, p: Mapping) -> dict[str, Any]:
    """The heights that have to stay above the ground, by the words of their violation: of machines that move along it
    those of all that does not land."""
    if not model.sticks:
        return {}
    gap, each = model.gap(p), model.heights(p).items()
    return {f"{name} touches the ground": height for name, height in each if not _is_gap(height, gap)}


def _is_gap(height: Affine | StateFormula, gap: Affine) -> bool:
    """Whether a height is the gap, whose weights are numbers."""
    if isinstance(height, StateFormula) or any(map(np.ndim, (*height.weights, height.offset))):
        return False
    return height == gap


def _forces_of(model: Model) -> dict[str, int]:
    """The forces that have to press in contact, each with the order of its zero where the contact begins: only on the
    point that has landed it vanishes there."""
    return {CONTACT_FORCE: 0, LANDED_FORCE: 1} if model.changes_contact else {CONTACT_FORCE: 1}


def count_families(model: Model, halves: Trajectories, per_flight: int) -> np.ndarray:
    """The families of flights: the stationary points of the extension between lift-off and mid-flight; `per_flight` of
    the halves belong to each flight."""
    found = turns_and_zeros({"extension": Sought(halves, model.extension)})
    return families_of(model, found["extension"], per_flight)


def families_of(model: Model, extension: TurnsAndZeros, per_flight: int) -> np.ndarray:
    """`count_families` from the stationary points of the extension. The one left out is mid-flight, where the extension
    is stationary unless the second half has another one."""
    rest, rate, ends = np.abs(extension.at_ends(1)), np.abs(extension.at_ends(2)), extension.motions.ends
    # Rounding moves mid-flight where the extension is nearly constant there.
    moved = np.divide(2 * rest, rate, out=np.zeros(len(ends)), where=rate > 0)
    middle = np.clip(moved, MIDDLE * ends, LARGEST_MIDDLE * ends) if model.turns_midway else 0.0 * ends
    owner = extension.owner[extension.times < (ends - middle)[extension.owner]] // per_flight
    return np.bincount(owner, minlength=len(extension.motions) // per_flight) // per_flight


def gaps_of(
    model: Model, cycles: Cycles, curves: Mapping[str, TurnsAndZeros]
) -> tuple[np.ndarray, np.ndarray, list[Violation]]:
    """Jerks of the gap at lift-off (m,), the lowest interior minima (m,) of the gaps in flight and, of that which lands
    next, in contact, `NONE` without one, and their violations."""
    gap = curves["gap"]
    jerk = (6 * gap.firsts[:, 3]).reshape(-1, cycles.halves_per_flight).min(1)
    if cycles.halves_per_flight == 1 and not flow_of(model.flight, tuple(cycles.p)).is_smooth:
        jerk = _jerks_at_launch(model, cycles)
        gap = _without_rounding(gap, jerk, model.gap(cycles.p).weights)
    middles = np.zeros(0, int) if model.grazes else _lowest_middles(gap)  # where it is 0 in mid-flight, without a force
    clearance, when = _least_of_halves(cycles, *gap.lowest(middles))
    violations = list[Violation]()
    for i in (jerk <= 0).nonzero()[0].tolist():
        text = "the gap opens the wrong way at landing (landing jerk {jerk:.3g}, must be negative)"
        violations.append((i, Message(text, jerk=Quantity(-jerk[i], "landing_jerk"))))
    lowest = {"gap": (clearance, when)}
    if landing := curves.get("landing gap"):  # which is open at the start, and is as wide as the gap in mid-flight
        lowest["landing gap"] = landing.lowest()
        clearance = np.minimum(clearance, landing.lowest(np.zeros(0, int))[0])
    if "standing gap 0" in curves:
        lowest["standing gap"] = _least_in_contact(cycles, curves, "standing gap")
        clearance = np.minimum(clearance, _least_in_contact(cycles, curves, "standing gap", inside=True)[0])
    text = "{meets} at t = {time:.6g} of the {phase} (height {height:.3g})"
    for name, (heights, times) in lowest.items():
        phase, words = "contact" if name == "standing gap" else "flight", model.violations.get(name)
        for i in (heights <= 0).nonzero()[0].tolist():
            numbers = {"time": Quantity(times[i], TIME), "height": Quantity(heights[i], "clearance")}
            meets = words or model.violations["landing gap"]
            violations.append((i, Message(text, meets=meets, phase=phase, **numbers)))
    return jerk, clearance, violations


def _lowest_middles(curve: TurnsAndZeros) -> np.ndarray:
    """The indices (e,) of the halves whose ends, in the middle of a phase, are minima of a function too."""
    motions = curve.motions
    size = motions.largest(curve.function.series(orders=slice(1)))
    still = np.abs(curve.at_ends(1)) * motions.ends < STATIONARY * size
    return np.asarray(((curve.at_ends(2) > 0) & still).nonzero()[0])


def _least_in_contact(
    cycles: Cycles, curves: Mapping[str, TurnsAndZeros], of: str, inside: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """The least values (m,) of a function over the contacts, or of its minima inside these, and their times (m,) in the
    contact; `NONE` where there is none."""
    found, when = np.full(len(cycles), NONE), np.zeros(len(cycles))
    owners, wholes = cycles.with_contact, cycles.contact_times
    for name, mirrored in ((f"{of} 0", False), (f"{of} 1", True)):
        if name in curves:
            values, times = curves[name].lowest(_lowest_middles(curves[name]) if inside else None)
            lower = values < found[owners]
            these, times = owners[lower], wholes[owners] - times if mirrored else times
            found[these], when[these] = values[lower], times[lower]
    return found, when


def _jerks_at_launch(model: Model, cycles: Cycles) -> np.ndarray:
    """The jerks (m,) of the gap at lift-off by the equations of motion."""
    flow, halves = flow_of(model.flight, tuple(cycles.p)), cycles.halves
    x = halves.coefficients[halves.first, : flow.size, 0]
    return jerks(flow, model.gap(cycles.p).weights, x, vectors(cycles.p_of_halves, len(halves)))


def _without_rounding(gap: TurnsAndZeros, jerk: np.ndarray, weights: Sequence[Algebraic]) -> TurnsAndZeros:
    """The gaps, sums of states with these weights, without stationary points at which rounding decides on their signs:
    so soon after lift-off that gaps with these jerks (m,) are less than what rounding makes of the states."""
    terms = np.abs(np.array(weights)) * gap.motions.sizes[:, : len(weights)]
    rounding = ROUNDED_STATE * EPS * terms.max(1)
    opened = np.cbrt(6 * rounding / np.maximum(jerk, rounding))
    later = gap.times > opened[gap.owner]
    owner, times, rising, values = (each[later] for each in (gap.owner, gap.times, gap.rising, gap.values))
    return gap._replace(owner=owner, times=times, rising=rising, values=values)


def _least_of_halves(cycles: Cycles, values: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least (m,) of the values on the halves of each flight, and its time (m,) in the flight."""
    values, times = (array.reshape(-1, cycles.halves_per_flight) for array in (values, times))
    half, each = values.argmin(1), np.arange(len(values))
    when = times[each, half]
    return values[each, half], np.where(half == 0, when, cycles.flight_times - when)


def contact_forces_of(
    model: Model, cycles: Cycles, curves: Mapping[str, TurnsAndZeros]
) -> tuple[np.ndarray, np.ndarray, list[Violation]]:
    """The lowest interior minima (m,) of the contact forces, and their peaks (m,), `NONE` where there are none; and the
    contacts that do not end or that have to pull."""
    (least, peaks), violations = np.full((2, len(cycles)), NONE), [*cycles.without_contact.items()]
    if not cycles.contacts:
        return least, peaks, violations
    these, highest = cycles.with_contact, list[np.ndarray]()
    for name, order in _forces_of(model).items():
        force, zeros = curves[name], curves[f"zeros of {name}"]
        pulls = model.violations["landed pull" if name == LANDED_FORCE else "pull"]
        # Mid-contact itself may be a minimum.
        still = model.reversor is not None and not model.changes_contact
        middles = (force.at_ends(2) > 0).nonzero()[0] if still else np.zeros(0, int)
        least[these] = np.minimum(least[these], force.lowest(middles)[0])
        highest.append(-force.lowest(sign=-1.0)[0])
        # A whole contact ends on another zero of the force than the one that it starts from.
        inside = np.full(len(zeros.times), True) if model.reversor else zeros.inside
        owner, times = zeros.owner[inside][::-1].tolist(), zeros.times[inside][::-1].tolist()
        pulling = dict(zip(owner, times, strict=True))  # the first of each
        at_once = force.firsts[:, order] <= 0
        at_once[[*pulling]] = False
        places = [(int(these[i]), time) for i, time in sorted(pulling.items())]
        text = "{pulls} in contact at t = {time:.6g}"
        violations += [(i, Message(text, pulls=pulls, time=Quantity(time, TIME))) for i, time in places]
        text = "{pulls} as soon as the contact begins"
        violations += [(i, Message(text, pulls=pulls)) for i in these[at_once].tolist()]
    peaks[these] = highest[0] if len(highest) == 1 else np.maximum(*highest)
    return least, peaks, violations


def separations_of(
    model: Model, cycles: Cycles, curves: Mapping[str, TurnsAndZeros]
) -> tuple[np.ndarray, list[Violation]]:
    """Least separations (m,) over the cycles, and the orbits where they, or heights above the ground, are not positive;
    where the contact does not end, the flight is checked all the same."""
    found, violations = np.full(len(cycles), NONE), list[Violation]()
    if "separation 0" in curves:
        found, violations = _least_of_all(cycles, curves, "separation", model.violations["separation"], "separation")
    for name in _above_ground(model, cycles.p):
        violations += _least_of_all(cycles, curves, name, name, "height")[1]
    return found, violations


def _least_of_all(
    cycles: Cycles, curves: Mapping[str, TurnsAndZeros], of: str, words: str, what: str
) -> tuple[np.ndarray, list[Violation]]:
    """The least values (m,) of one function over the cycles, and the values that are not positive as violations in
    words."""
    found = np.full(len(cycles), NONE)
    least, when = _least_of_halves(cycles, *curves[f"{of} 0"].lowest())
    where, others = np.full(len(cycles), "flight", dtype=object), []
    if mirrored := curves.get(f"{of} 1"):
        low, times = mirrored.lowest()
        others.append(("flight", low, cycles.flight_times - times))
    others.append(("contact", *_least_in_contact(cycles, curves, f"{of} in contact")))
    for phase, low, times in others:
        lower = low < least
        least[lower], where[lower], when[lower] = low[lower], phase, times[lower]
    found[cycles.with_contact] = least[cycles.with_contact]
    violations = list[Violation]()
    for i in (~(least > 0)).nonzero()[0].tolist():
        text, time = "{meets} at t = {time:.6g} of the {phase} ({what} {least:.3g})", Quantity(when[i], TIME)
        numbers = {"time": time, "phase": where[i], "what": what, "least": Quantity(least[i], LENGTH)}
        violations.append((i, Message(text, meets=words, **numbers)))
    return found, violations
