"""Starts for `find_all` of machines whose launch has more unknowns than a speed: their hops with linear springs,
followed to the springs' own laws."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import FlowError, InputError, NoOrbit, finite_number
from ..flow.flow import flow_of
from ..laws.law import Algebraic, Law, Parameters, from_key
from ..laws.law_statement import from_formula
from ..mechanics.elements import Damper, Force, Spring
from ..mechanics.mechanism import Mechanism
from ..model.machine import Machine
from ..periodic.find import find
from ..periodic.linear_hops import linear_hops
from .follow import follow

# The homotopy parameter, which goes from straight lines at 0 to the springs' own laws at 1.
LAW_SHARE = "share_of_the_springs_own_law"
# The longest step along it, as a share, and the most points: hops that need more points are left out, and so are hops
# that have not reached the least share after the first points.
LONGEST_LAW_STEP, MOST_LAW_POINTS = 0.1, 200
FIRST_LAW_POINTS, LEAST_LAW_SHARE = 40, 1e-5
# A hop of the own laws that differs by less than this share, in its launch and in its times, from a linear hop is taken
# for the continuation of that hop.
SAME_HOP = 0.1
SAME_START = 1e-6  # two hops whose unknowns differ by a smaller share are the same
# The zero of a law is searched up to this distance from rest, in units of the force divided by its slope at rest.
FURTHEST_ZERO, ZERO_SAMPLES = 4.0, 801


class _StraightLine(NamedTuple):
    """The force slope (r - zero), to which a law is tangent at a zero of its force."""

    slope: float
    zero: float

    def law(self, place: int) -> Law:
        """The straight line as the law of the spring with index `place`."""
        slope, zero = f"slope_{place}", f"zero_{place}"
        return from_formula(f"{slope}*(r - {zero})", "r", {slope: self.slope, zero: self.zero})


def starts(machine: Mechanism, half_contact: float, half_flight: float, seed: int = 0) -> list[dict[str, float]]:
    """Starts for `find_all`: the lossless hops of a mechanism with half durations of contact and flight up to these.

    half_contact, half_flight : the longest half durations of contact and of flight, in the machine's units
    seed : of the quasi-random pairs of times from which the search starts; another seed may find some more hops

    Returns the unknowns of each hop, by name. For linear springs the hops are those of `linear_hops`. They are initial
    guesses for the hops of other springs. Where Newton's method does not reach these directly, the hop is followed in
    steps of a homotopy to the laws, from straight lines through the zero of each force that is nearest to its rest.
    Hops that end before the last step are left out, as are hops that no linear one leads to. Raises `InputError` for
    laws in pieces, dampers and other forces, gravity that varies, and extensions that are not linear in the
    coordinates. Source: for linear springs, after Pankov 2024, arXiv 2402.16010.
    """
    springs = _springs_of(machine)
    laws = [from_key(spring.force, machine.values) for spring in springs]
    straight = [spring.force.degree() == 1 for spring in springs]
    lines = [None if own else _straight_line(law) for law, own in zip(laws, straight, strict=True)]
    pairs = list(zip(laws, lines, strict=True))
    linear = machine.with_springs([line.law(i) if line else law for i, (law, line) in enumerate(pairs)])
    hops = linear_hops(*linear.linear_equations(), linear.gap_weights, half_contact, half_flight, seed)
    found = [start_from(machine, hop.liftoff, *hop[:2]) for hop in hops]
    if all(straight):
        return found
    mixed, own = machine.with_springs([_mixed(law, line) if line else law for law, line in pairs]), list[dict]()
    for start in found:
        if hop := _found_directly(machine, start, own) or _followed_to_own_laws(mixed, start):
            own.append(hop)
    return own


def _springs_of(machine: Mechanism) -> list[Spring]:
    """The springs of a machine whose hops may be followed from linear ones; raises `InputError` for another machine."""
    if not isinstance(machine, Mechanism):
        raise InputError(f"starts are those of a Mechanism, not of a {type(machine).__name__}")
    springs = [element for element in machine.elements if isinstance(element, Spring)]
    remedy = "starts are led there from linear hops; give find a start instead, such as that of start_from_rest"
    for element in machine.elements:
        if isinstance(element, Damper | Force):
            raise InputError(
                f"the {machine.name} has a {type(element).__name__}: it has no lossless hops to start from"
            )
    for spring in springs:
        if spring.force.pieces:
            raise InputError(f"spring '{spring.force.text}' is in pieces: {remedy}")
    if machine.gravity.degree() > 0:
        raise InputError(f"gravity '{machine.gravity.text}' varies: {remedy}")
    return springs


def _straight_line(law: Law) -> _StraightLine:
    """The tangent of a law at the zero of its force that is nearest to its rest."""
    from scipy.optimize import brentq  # takes long to import

    rest = law.rest()
    value, slope = (float(each) for each in law.with_slope(rest))
    zero = rest
    if value != 0 and np.isfinite(value) and slope != 0:
        places = rest + abs(value / slope) * np.linspace(-FURTHEST_ZERO, FURTHEST_ZERO, ZERO_SAMPLES)
        places = np.unique(np.clip(places, *law.range()))
        forces = law(places)
        changes = np.flatnonzero(forces[:-1] * forces[1:] <= 0)
        if not changes.size:
            raise InputError(f"spring '{law.text}' has the force {value:g} at rest, and none near it where it vanishes")
        nearest = changes[np.abs(places[changes] - rest).argmin()]
        zero = float(brentq(lambda r: float(law(r)), *places[nearest : nearest + 2], xtol=1e-15))
        slope = float(law.with_slope(zero)[1])
    if not finite_number(f"the slope of spring '{law.text}' where it is unloaded", slope) > 0:
        raise InputError(f"spring '{law.text}' has the slope {slope:g} where it is unloaded, not above 0")
    return _StraightLine(slope, zero)


def start_from_rest(
    machine: Machine, positions: Sequence[float], half_contact: float, half_flight: float
) -> dict[str, float]:
    """A start for `find`, the unknowns by name, from a guess of the state of rest in mid-contact and of the durations.

    positions : (n - 1,), of the coordinates of the contact
    half_contact, half_flight : half durations of contact and of flight

    All numbers are in the machine's units. Raises `NoOrbit` when the motion from there cannot be integrated.
    """
    contact, values, count = machine.model.contact, machine.values, len(machine.model.contact.states) // 2
    if np.shape(positions) != (count,):
        raise InputError(f"positions = {positions!r}; they are {count} numbers, from the top")
    for name, time in (("half_contact", half_contact), ("half_flight", half_flight)):
        if not finite_number(name, time) > 0:
            raise InputError(f"{name} = {time:g} is out of bounds; it lies above 0")
    rest = np.zeros(2 * count)
    rest[::2] = positions
    try:
        path, _ = flow_of(contact, tuple(values)).run(rest, list(values.values()), half_contact)
    except FlowError as error:
        raise NoOrbit(f"the contact cannot be followed from rest at {positions}: {error}") from None
    return start_from(machine, machine.model.embed @ path.end[: 2 * count], half_contact, half_flight)


def start_from(machine: Machine, liftoff: np.ndarray, half_contact: float, half_flight: float) -> dict[str, float]:
    """The unknowns of half an orbit from the flight state (2n,) at lift-off."""
    times = {"duration": half_flight, "contact_duration": half_contact}
    return machine.model.launch_at(liftoff.tolist()) | times


def _mixed(law: Law, line: _StraightLine) -> Law:
    """A law that goes from a straight line to a spring's own as the parameter `LAW_SHARE` goes from 0 to 1."""

    def expression(x: Algebraic, p: Parameters, q: Algebraic) -> Algebraic:
        return p[LAW_SHARE] * law.key.expression(x, p, q) + (1 - p[LAW_SHARE]) * line.slope * (x - line.zero)

    return Law(law.text, "r", expression, {**law.parameters, LAW_SHARE: 0.0})


def _found_directly(machine: Mechanism, start: Mapping[str, float], known: Sequence[dict]) -> dict[str, float] | None:
    """The start of the hop of the own laws that Newton's method finds from a hop of straight lines; None where there is
    none, where it is far from that hop, and where it is known already."""
    try:
        orbit = find(machine, start=start)
    except NoOrbit:
        return None
    if orbit.contact_time is None:
        return None
    own = start_from(machine, orbit(0.0), orbit.contact_time / 2, orbit.flight_time / 2)
    launch, linear = (np.array([each[name] for name in machine.model.launch_unknowns]) for each in (own, start))
    times = ("duration", "contact_duration")
    near = all(abs(own[name] - start[name]) <= SAME_HOP * start[name] for name in times)
    near = near and np.linalg.norm(launch - linear) <= SAME_HOP * np.linalg.norm(linear)
    is_known = any(np.allclose([*own.values()], [*each.values()], rtol=SAME_START) for each in known)
    return own if near and not is_known else None


def _followed_to_own_laws(mixed: Mechanism, start: Mapping[str, float]) -> dict[str, float] | None:
    """The start of the hop that is followed from one of the straight springs; None where the family ends before."""
    try:
        orbit = find(mixed, start=start)
        for most in (FIRST_LAW_POINTS, MOST_LAW_POINTS):
            family = follow(mixed, LAW_SHARE, 1.0, orbit=orbit, longest=LONGEST_LAW_STEP, most=most)
            if family.end.kind != "stopped" or family[-1].value < LEAST_LAW_SHARE:
                break
    except NoOrbit:
        return None
    return dict(zip(mixed.model.half_unknowns, family[-1].u, strict=True)) if family.end.kind == "reached" else None
