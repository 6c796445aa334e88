"""Starts for `find_all` of machines whose launch has several unknowns: hops with linear springs, followed to the
springs' own laws."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, overload

import numpy as np

from ..errors import LARGEST_SEED, FlowError, InputError, NoOrbit, finite_number, whole_number
from ..flow import flow_of
from ..laws import Algebraic, Key, Law, Parameters, from_formula, from_key
from ..mechanics import Damper, Force, Mechanism, Spring
from ..model import Machine, check_machine, refuse_hysteresis
from ..periodic import LinearSearch
from ..result import Progress
from ..running import LOGGER, TimeOver, exclusive, interrupts, time_left, time_limit
from ..shooting import equations_of
from .curve import Curve
from .many_curves import WayTogether, follow_together

# The homotopy parameter, which goes from straight lines at 0 to the springs' own laws at 1.
LAW_SHARE = "share_of_the_springs_own_law"
# Why there may be more hops.
LINEAR_STOPPED = "the search for hops with linear springs is not finished"
FOLLOWING_STOPPED = "some hops are not yet continued to the springs' own laws"


class StartOptions(NamedTuple):
    """The ranges and the accuracy of a search for starts."""

    # The share of the work that is the search for linear hops, where these are followed afterwards.
    linear_share: float = 0.1
    same: float = 1e-6  # two hops whose unknowns differ by a smaller share are the same
    # The zero of a law is searched up to this distance from rest, in units of the force divided by its slope at rest.
    furthest_zero: float = 4.0
    zero_samples: int = 801


STARTS = StartOptions()


class _StraightLine(NamedTuple):
    """The force slope (r - zero), which vanishes where that of a law does."""

    slope: float
    zero: float

    def law(self, place: int) -> Law:
        """The straight line as the law of the spring with index `place`."""
        slope, zero = f"slope_{place}", f"zero_{place}"
        return from_formula(f"{slope}*(r - {zero})", "r", {slope: self.slope, zero: self.zero})


class Ended(NamedTuple):
    """A hop with linear springs that leads to no hop with the springs' own laws.

    start : its unknowns by name
    share : the largest share of the springs' own laws for which it was found
    why : why it was not followed further
    """

    start: dict[str, float]
    share: float
    why: str


@dataclass(frozen=True, repr=False)
class Starts(Sequence[dict[str, float]]):
    """Starts for `find_all`, the unknowns of each hop by name.

    found : the starts
    half_contact, half_flight : the longest searched half durations
    periods : the slowest natural periods of contact and of flight with linear springs
    linear : the number of hops found with linear springs
    ended : the linear hops that lead to no hop with the springs' own laws
    stopped : why there may be more hops than these; empty if the search was finished
    """

    found: tuple[dict[str, float], ...]
    half_contact: float
    half_flight: float
    periods: tuple[float, float]
    linear: int
    ended: tuple[Ended, ...] = ()
    stopped: str = ""

    def __len__(self) -> int:
        return len(self.found)

    @overload
    def __getitem__(self, i: int) -> dict[str, float]: ...

    @overload
    def __getitem__(self, i: slice) -> tuple[dict[str, float], ...]: ...

    def __getitem__(self, i: Any) -> Any:
        return self.found[i]

    def __repr__(self) -> str:
        text = f"{len(self)} starts with half contacts up to {self.half_contact:.6g} and half flights up to "
        text += f"{self.half_flight:.6g}, from {self.linear} hops with linear springs"
        text += f"; {len(self.ended)} of these do not reach the springs' own laws" if self.ended else ""
        return f"{text}; not all: {self.stopped}" if self.stopped else text


@exclusive
def starts(
    machine: Any,
    half_contact: float | None = None,
    half_flight: float | None = None,
    seed: int = 0,
    *,
    slope: float = 1.0,
    progress: Progress = None,
    limit: float | None = None,
) -> Starts:
    """Starts for `find_all`: the lossless hops of a mechanism up to some half durations of contact and flight.

    machine : a `Mechanism`, or a machine that is stated as one, such as `problems.Chain`
    half_contact, half_flight : the longest half durations of contact and of flight, in the machine's units; None for
        half the slowest natural period of the contact, and for the slowest natural period of the flight. The number of
        hops grows with the square of these times, divided by the periods of the fastest springs
    seed : of the quasi-random pairs of times from which the search starts; another seed may find more hops
    slope : of the linear springs that the search begins with, as a multiple of the springs' tangents; for springs that
        stiffen, steeper lines lead to more hops, with larger extensions
    progress : called with the share that is done
    limit : time limit in seconds, as in `find`. At the limit, the starts found so far are returned, with the reason in
        `stopped`, and a warning is logged

    Returns the unknowns of each hop, by name. Where springs are not linear, the hops of linear springs are followed
    along a homotopy to the springs' own laws, all together and past folds; each line goes through the zero of its
    spring's force that is nearest to rest. Hops that do not reach the springs' own laws are in `ended`, with the
    reason. A hop is not found if no linear hop leads to it: a spring that stiffens has infinitely many hops with ever
    larger extensions, which come from linear hops of another `slope` or of longer times, or from none. Raises
    `InputError` for dampers and other forces, gravity that varies, and extensions that are not linear in the
    coordinates. Source: for linear springs, after Pankov 2024, arXiv 2402.16010.
    """
    machine = machine.stated() if hasattr(machine, "stated") else machine
    check_machine(machine)
    springs = _springs_of(machine)
    laws = [from_key(spring.force, machine.values) for spring in springs]
    if not finite_number("slope", slope) > 0:
        raise InputError(f"slope = {slope:g} is out of bounds; it must lie above 0")
    seed = whole_number("seed", seed, least=0, most=LARGEST_SEED)
    lines = [
        None if spring.force.degree() == 1 else _straight_line(law, slope)
        for spring, law in zip(springs, laws, strict=True)
    ]
    pairs, ranged = list(zip(laws, lines, strict=True)), bool(np.isfinite([law.range() for law in laws]).any())
    # Springs of one law have one straight line, so that what exchanges them still does.
    forces = [spring.force for spring in springs]
    places = [forces.index(force) for force in forces]
    linear = machine.with_springs([line.law(i) if line else law for i, (law, line) in zip(places, pairs, strict=True)])
    search, mixes = LinearSearch.of(linear), any(lines)
    half_contact, half_flight = (
        longest if stated is None else stated
        for stated, longest in zip((half_contact, half_flight), search.longest, strict=True)
    )
    share, stopped, found = (STARTS.linear_share if mixes else 1.0), "", list[dict[str, float]]()
    way: WayTogether | None = None
    with interrupts.deferred(), time_limit(limit):
        until = time_left() / 2 if mixes else -np.inf  # half of the time is for the way to the springs' own laws
        try:
            for done in search.batches(half_contact, half_flight, seed):
                _report(progress, share * done)
                if done < 1 and time_left() < until:
                    stopped = f"{LINEAR_STOPPED} in half of the time: raise limit=..."
                    break
        except TimeOver as over:
            stopped = f"{LINEAR_STOPPED}: {over}"
        found = [start_from(machine, hop.liftoff, *hop[:2]) for hop in search.hops]
        if mixes and found:
            each = zip(places, pairs, strict=True)
            mixed = machine.with_springs([_mixed(law, line, i) if line else law for i, (law, line) in each])
            try:
                for way in _followed(mixed, found):
                    _report(progress, share + (1 - share) * way.share)
            except TimeOver as over:
                stopped = "; ".join([*filter(None, [stopped]), f"{FOLLOWING_STOPPED}: {over}"])
    own, ended = _own_hops(machine, found, way, ranged) if way else ([] if mixes else found, [])
    if stopped:
        LOGGER.warning("starts: %s", stopped)
    return Starts(tuple(own), half_contact, half_flight, search.periods, len(found), tuple(ended), stopped)


def _report(progress: Progress, share: float) -> None:
    """Call `progress`, and heed interrupts and the time limit."""
    if progress:
        progress(share)
    interrupts.heed()


def _followed(mixed: Mechanism, found: Sequence[Mapping[str, float]]) -> Iterator[WayTogether]:
    """The hops of straight springs on their way to the springs' own laws."""
    curve = Curve(mixed, LAW_SHARE, "half orbit", 1.0)
    us = [[start[name] for name in mixed.model.half_unknowns] for start in found]
    # The shortest hops come first, in case that there is no time for all.
    lengths = [start["duration"] + start["contact_duration"] for start in found]
    return follow_together(curve, np.array(us), np.argsort(lengths, kind="stable"))


def _own_hops(
    machine: Machine, found: Sequence[dict[str, float]], way: WayTogether, ranged: bool
) -> tuple[list[dict], list[Ended]]:
    """The different hops of the springs' own laws that have been reached, and the hops that end before; `ranged` where
    a law has no value beyond some extension."""
    xs = way.xs[way.arrived, :-1]
    same = (np.abs(xs[:, None] - xs) <= STARTS.same * np.abs(xs)).all(2)
    names, different = machine.model.half_unknowns, ~np.tril(same, -1).any(1)
    outside = _outside(machine, xs) if ranged else {}
    why = {i: end.reason for i, end in way.ended.items()} | {
        int(np.flatnonzero(way.arrived)[k]): text for k, text in outside.items()
    }
    own = [
        x for i, x in zip(np.flatnonzero(way.arrived)[different], xs[different].tolist(), strict=True) if i not in why
    ]
    ended = [Ended(found[i], float(way.furthest[i]), text) for i, text in sorted(why.items())]
    return [dict(zip(names, x, strict=True)) for x in own], ended


def _outside(machine: Machine, us: np.ndarray) -> dict[int, str]:
    """The reasons, by index, of those solutions (m, n) whose motions leave the range of a law."""
    names, failures = tuple(machine.values), dict[int, str]()
    equations = equations_of(machine.model, "half orbit", names)
    ps = np.tile([*machine.values.values()], (len(us), 1))
    for i in np.setdiff1d(np.arange(len(us)), equations.evaluate_lanes(us, ps)[0]).tolist():
        try:
            equations.evaluate_all(us[i : i + 1], ps[i : i + 1])
        except FlowError as error:
            failures[i] = str(error)
    return failures


def _springs_of(machine: Mechanism) -> list[Spring]:
    """The springs of a machine whose hops may be followed from linear ones; raises `InputError` for another machine."""
    if not isinstance(machine, Mechanism):
        raise InputError(f"starts takes a Mechanism, not a {type(machine).__name__}")
    refuse_hysteresis(machine.model)
    springs = [element for element in machine.elements if isinstance(element, Spring)]
    remedy = "starts are continued from linear hops; give find a start instead, such as one of start_from_rest"
    for element in machine.elements:
        if isinstance(element, Damper | Force):
            raise InputError(f"the {machine.name} has a {type(element).__name__}, so it has no lossless hops")
    if machine.gravity.degree() > 0:
        raise InputError(f"gravity '{machine.gravity.text}' varies: {remedy}")
    return springs


def _straight_line(law: Law, share: float = 1.0) -> _StraightLine:
    """The line through the zero of a law's force that is nearest to its rest, with this share of its slope there."""
    from scipy.optimize import brentq  # takes long to import

    rest = law.rest()
    value, slope = (float(each) for each in law.with_slope(rest))
    zero = rest
    if value != 0 and np.isfinite(value) and slope != 0:
        shares = np.linspace(-STARTS.furthest_zero, STARTS.furthest_zero, STARTS.zero_samples)
        places = rest + abs(value / slope) * shares
        places = np.unique(np.clip(places, *law.range()))
        forces = law(places)
        changes = np.flatnonzero(forces[:-1] * forces[1:] <= 0)
        if not changes.size:
            raise InputError(
                f"spring '{law.text}' has the force {value:g} at rest, and its force vanishes nowhere nearby"
            )
        nearest = changes[np.abs(places[changes] - rest).argmin()]
        zero = float(brentq(lambda r: float(law(r)), *places[nearest : nearest + 2], xtol=1e-15))
        slope = float(law.with_slope(zero)[1])
    if not finite_number(f"the slope of spring '{law.text}' where it is unloaded", slope) > 0:
        raise InputError(f"spring '{law.text}' has the slope {slope:g} where it is unloaded, not above 0")
    return _StraightLine(share * slope, zero)


def start_from_rest(
    machine: Machine, positions: Sequence[float], half_contact: float, half_flight: float
) -> dict[str, float]:
    """A start for `find`, the unknowns by name, from guesses of the state of rest in mid-contact and of the durations.

    positions : (n - 1,), of the coordinates of the contact
    half_contact, half_flight : half durations of contact and of flight

    All numbers are in the machine's units. Raises `NoOrbit` when the motion from there cannot be integrated.
    """
    refuse_hysteresis(machine.model)
    contact, values, count = machine.model.contact, machine.values, len(machine.model.contact.states) // 2
    if np.shape(positions) != (count,):
        raise InputError(f"positions = {positions!r}; they must be {count} numbers, from the top")
    for name, time in (("half_contact", half_contact), ("half_flight", half_flight)):
        if not finite_number(name, time) > 0:
            raise InputError(f"{name} = {time:g} is out of bounds; it must lie above 0")
    rest = np.zeros(2 * count)
    rest[::2] = [finite_number("positions", each) for each in positions]
    try:
        path, _ = flow_of(contact, tuple(values)).run(rest, list(values.values()), half_contact)
    except FlowError as error:
        raise NoOrbit(f"the contact cannot be followed from rest at {positions}: {error}") from None
    return start_from(machine, machine.model.embed @ path.end[: 2 * count], half_contact, half_flight)


def start_from(machine: Machine, liftoff: np.ndarray, half_contact: float, half_flight: float) -> dict[str, float]:
    """The unknowns of half an orbit from the flight state (2n,) at lift-off."""
    times = {"duration": half_flight, "contact_duration": half_contact}
    return machine.model.launch_at(liftoff.tolist()) | times


def _mixed(law: Law, line: _StraightLine, place: int) -> Law:
    """A law that goes from a straight line to that of the spring with index `place` as the parameter `LAW_SHARE` goes
    from 0 to 1."""
    ends = bool(np.isfinite(law.range()).any())
    key = _mixture(law.key, place, ends)
    straight = line.law(place).parameters
    return Law(law.text, "r", key.expression, {**law.parameters, **straight, LAW_SHARE: 0.0}, key.pieces)


@lru_cache(maxsize=64)
def _mixture(key: Key, place: int, ends: bool) -> Key:
    """The expression and the pieces of a mixed law, the same for all values of parameters. It is continued with the
    slope of the straight line beyond the `ends` of a law's range, which a hop of straight springs may leave."""
    slope, zero, pieces = f"slope_{place}", f"zero_{place}", key.pieces

    def mixed(x: Algebraic, force: Algebraic, p: Parameters) -> Algebraic:
        return p[LAW_SHARE] * force + (1 - p[LAW_SHARE]) * p[slope] * (x - p[zero])

    if pieces is None or not ends:
        return key._replace(expression=lambda x, p, q: mixed(x, key.expression(x, p, q), p))

    def table(p: Parameters) -> tuple[list, list]:
        """A piece has two more data: 1 where it is one of the law, else 0, and where the law ends."""
        breaks, rows = pieces.table(p)
        low, high = ([*row, 0.0, pieces.ends(end, p)] for row, end in ((rows[0], breaks[0]), (rows[-1], breaks[-1])))
        return [-np.inf, *breaks, np.inf], [low, *([*row, 1.0, 0.0] for row in rows), high]

    def expression(x: Algebraic, p: Parameters, q: Algebraic) -> Algebraic:
        *own, inside, end = q
        nearest = inside * x + (1 - inside) * end
        return mixed(x, key.expression(nearest, p, own) + p[slope] * (x - nearest), p)

    own = pieces._replace(size=pieces.size + 2, table=table, noise=None)
    return key._replace(expression=expression, pieces=own)
