"""Bifurcation diagrams of the return map along the injection, the restitution, or a parameter of the machine.

Fixed points, and hops of longer periods, are searched at some values of the parameter, over the whole range of launch
speeds, and each is followed to both sides. Where a multiplier passes -1, hops of twice the period begin and are
followed too.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..curves import End, Event
from ..errors import InputError, NoOrbit, finite_number, is_list, range_of, whole_number
from ..hops import CAP
from ..model import Machine, machine_in_words
from ..result import Progress
from ..running import exclusive, interrupts
from .bifurcation import Bifurcation, name_of_hops
from .diagram import RESERVED_IN_DIAGRAMS, BifurcationDiagram, Branch
from .launch_branches import tracer_of
from .launch_curve import STEPS_OF_BRANCHES
from .launch_cycles import INJECT, MapsAlong
from .periodic_hop import PeriodicHop, listed_starts
from .periodic_launch import PeriodicLaunch
from .return_map import hops_near

SECTIONS = 9  # values of the parameter at which fixed points are searched for by default
SECTIONS_OF_STARTS = 3  # values of the parameter by default for launches of several numbers
SAME_PLACE = 1e-6  # launches that differ by a smaller share of the range are the same
# What happens where a launch passes a border of the map, by the kind of the border, and by that of the event.
BORDERS_IN_WORDS = {
    "lossless": "a launch is the lossless one, near which the loss grows as the power 4/3: one bounce more or less",
    "graze": "a landing grazes",
    "bounce": "the contact force vanishes at a landing: one bounce more or less",
}
RUN_ON = {"border collision": "persist", "non-smooth fold": "turn round"}
SETTLES = {True: "stable", False: "unstable"}


class Attractor(NamedTuple):
    """The launches that are visited in the long run.

    values, most : number of values of the parameter along the injection by default; and at most, for the memory's sake
    starts : number of launches at each value, evenly between the bounds
    transient, hops : hops until they have reached the attractor, and hops on it that are returned
    together : launches whose hops are computed together
    """

    values: int = 400
    most: int = 100_000
    starts: int = 4
    transient: int = 200
    hops: int = 60
    together: int = 2**14


ATTRACTOR = Attractor()


@exclusive
def bifurcations(
    machine: Machine, along: str, span: tuple[float, float], between: tuple[float, float], *, inject: float = 0.0,
    samples: int = 400, sections: int | None = None, attractor: int | None = None, cap: int = CAP,
    starts: Sequence[Any] | None = None, periods: Sequence[int] = (1,), doublings: int = 1, progress: Progress = None,
) -> BifurcationDiagram:  # fmt: skip
    """Follow the fixed points of a machine's return maps along a parameter, hops of longer periods, and hops of twice
    the period that begin at flips.

    machine : as for `ReturnMap`
    along : "inject", "restitution", or a parameter of the machine, such as "damping"
    span : the range of the parameter
    between : the range of launch speeds
    inject : the injection, if it is not the parameter
    samples : number of launches in the search grid, as in `ReturnMap.fixed_points`
    sections : number of values of the parameter at which fixed points are searched, by default 9, or 3 from `starts`; a
        closed curve of fixed points between two of these values is not found
    attractor : number of values of the parameter at which the attractor is computed; by default 400 along the
        injection, where all are mapped together, and 0 along other parameters, where this takes longer
    cap : number of impacts in one hop after which its computation is ended
    starts : for a machine whose launch has d > 1 numbers, launches or lossless orbits near which Newton's method
        searches fixed points at each section, or `ReturningHops` of a period
    periods : the periods of the hops to search, all hops of each period at each section, see `ReturnMap.periodic_hops`
    doublings : how often to follow hops of twice the period from flips: 1 for period two from flips of fixed points, 2
        also for period four from flips of these, and so on. With 1 or more, hops of period two are also searched at
        each section, since their flips may lie outside the ranges
    progress : called with the completed share

    Launch speeds and the injection are in the machine's units. Folds and flips are located to some 1e-11 of the range,
    in addition to the error of the map. A branch ends where the map is not continuous; its `End` says so. Raises
    `InputError` for an invalid range or name, and if every fixed point is a lossless hop, for which there is `follow`.
    """
    low, high = range_of("span", span)
    slow, fast = range_of("between", between)
    if slow <= 0 and machine.model.one_speed:
        raise InputError(f"between = {between!r}; launch speeds must be above 0")
    several = not machine.model.one_speed
    default = SECTIONS_OF_STARTS if several else SECTIONS
    sections = whole_number("sections", default if sections is None else sections, "values of the parameter", 2)
    maps = MapsAlong(machine, along, low, high, finite_number("inject", inject), cap)
    if along in RESERVED_IN_DIAGRAMS:
        raise InputError(f"a parameter called '{along}' has the name of a column of diagrams; rename it")
    if along == INJECT and inject != 0:
        raise InputError(f"inject = {inject:g}, but the range already states inject: leave it out")
    for end in (low, high):
        maps.at(end)  # an impossible machine is refused before the search
    values = np.linspace(low, high, sections).tolist()
    if along != INJECT and all(maps.lossless(value) for value in values):
        raise InputError("every fixed point here is a lossless hop: follow them with `follow`, or give an injection")
    if not is_list(periods):
        raise InputError(f"periods = {periods!r}; it must be a list of numbers of hops, as ({periods!r},)")
    wanted = sorted({whole_number("periods", period, "hops") for period in periods})
    doublings = whole_number("doublings", doublings, "doublings", 0)
    own: dict[str, Any] = {"inject": maps.inject, "source": machine}
    about = along, (low, high), (slow, fast), machine_in_words(machine)
    if several and (wanted != [1] or doublings > 1):
        raise InputError(
            f"periods = {tuple(wanted)}, doublings = {doublings}: hops of other periods are searched only where a "
            "launch is one speed; give starts=[...] of that period"
        )
    if several:
        listed = _checked_starts(maps, starts, attractor)
        search = _Search(maps, (slow, fast), values, samples, progress, listed)
        search.from_starts()
        visits = np.zeros((0, 2))
        return BifurcationDiagram(*about, tuple(search.branches), search.located(), visits, units=maps.units, **own)
    if starts is not None:
        raise InputError(
            "starts: where a launch is a speed, fixed points are searched in the whole range: leave starts out"
        )
    count = ATTRACTOR.values if along == INJECT else 0
    count = count if attractor is None else whole_number("attractor", attractor, "", 0, ATTRACTOR.most)
    search = _Search(maps, (slow, fast), values, whole_number("samples", samples, "launches", 2), progress)
    maps.resolve(slow, fast)
    for period in wanted:
        search.periodic(period)
        for _ in range(doublings):
            search.doubled(doublings)
    if 1 in wanted and doublings and 2 not in wanted:  # those whose flip is outside of the ranges
        search.periodic(2, depth=1)
    visits = _attractor(maps, (slow, fast), count)
    return BifurcationDiagram(*about, tuple(search.branches), search.located(), visits=visits, units=maps.units, **own)


def _checked_starts(maps: MapsAlong, starts: Any, attractor: int | None) -> list[Any]:
    """The starts of a search for hops from launches of several numbers in a list; raises `InputError` without any."""
    if starts is None:
        raise InputError(
            f"a launch of a {maps.machine.model.name} has {len(maps.at(maps.low).names)} numbers, too many for a"
            " grid: give starts=[...], lossless orbits or periodic hops"
        )
    if attractor:
        raise InputError(
            f"attractor = {attractor}: the attractor is searched only where a launch is one speed; with several "
            "numbers, iterate the ReturnMap instead"
        )
    return listed_starts(starts)


class _Search:
    """The branches found so far, and their events with the index of the branch."""

    def __init__(
        self, maps: MapsAlong, between: tuple[float, float], values: list[float], samples: int, progress: Progress,
        starts: Sequence[Any] = (),
    ):  # fmt: skip
        self.starts, self._done = starts, 0.0
        self.maps, self.between, self.values, self.samples, self.progress = maps, between, values, samples, progress
        self.branches: list[Branch] = []
        self.events: list[tuple[int, Event]] = []
        self.notes: dict[int, str] = {}  # by the identity of a flip's point
        self._depths = list[int]()
        self._followed = 0  # events whose doubled hops are followed

    def _tracer(self, period: int) -> Any:
        return tracer_of(self.maps, self.between, period, tuple(self.values))

    def periodic(self, period: int, depth: int = 0) -> None:
        """Follow the hops of a period that are found in a section and lie on no branch yet, this many doublings away
        from the searched hops. Along the injection the branches of fixed points that begin at lossless hops come
        first."""
        tracer = self._tracer(period)
        for alpha in self._lossless() if period == 1 else []:
            self._store(1, tracer.lossless(alpha))
        starts = list(self._starts(period, sampled=depth > 0))
        for i, (value, launches) in enumerate(starts):
            self._report(0.5 + 0.5 * i / len(starts))
            self._follow(tracer, period, np.reshape(launches, (len(launches), -1)), value, depth)

    def from_starts(self) -> None:
        """Follow the hops of launches of several numbers that are found from starts, each in its period, and lie on no
        branch yet, and those of twice the period from flips of fixed points. Raises `NoOrbit` where none are found."""
        found, refused = list[tuple[float, Any]](), ""
        for i, value in enumerate(value for value in self.values if not self.maps.lossless(value)):
            for start, below in ((start, below) for start in self.starts for below in (False, True)):
                interrupts.heed()
                try:
                    hops = hops_near(
                        self.maps.at(value), start, start.period if isinstance(start, PeriodicHop) else 1, below
                    )
                    found.append((value, hops))
                except NoOrbit as error:
                    refused = str(error)
            self._report(0.5 * (i + 1) / len(self.values))
        for i, (value, hops) in enumerate(found):
            self._report(0.5 + 0.5 * i / len(found))
            tracer = self._tracer(hops.period)
            self._follow(tracer, hops.period, hops.launches, value, depth=0 if hops.period == 1 else 1)
        if not self.branches:
            raise NoOrbit(f"no start leads to hops that come back: {refused}")
        self.doubled(1)
        self._report(1.0)

    def _follow(self, tracer: Any, period: int, launches: np.ndarray, value: float, depth: int) -> None:
        """Follow the branch of hops with launches (h, d) at a value of the parameter to both sides, unless it is
        known."""
        near = SAME_PLACE * (self.between[1] - self.between[0])
        for branch in (branch for branch in self.branches if branch.period == period):
            known = branch.alphas[..., None] if branch.launches is None else branch.launches
            if ((branch.values == value) & (np.abs(known - launches[0]).max(2) <= near).any(1)).any():
                return
        start = tracer.start(launches, value)
        ahead = list(tracer.trace(start, 1))
        back = ahead[-1:] if _ends_as(ahead, "closed") else list(tracer.trace(start, -1))
        self._store(period, [*reversed(back), start, *ahead], depth)

    def _lossless(self) -> list[float]:
        """The lossless launches that are fixed points of a map without injection."""
        maps = self.maps
        if maps.name != INJECT or not maps.low <= 0.0 <= maps.high or not maps.lossless(0.0):
            return []
        step = maps.at(0.0)
        if step.only_gains:  # every launch returns
            return []
        return [point.alpha for point in step.fixed_points(*self.between, self.samples)]

    def _starts(self, period: int, sampled: bool = False) -> Iterator[tuple[float, tuple[float, ...]]]:
        """Periodic launches (value, launch speeds, at least the first one) at the sections, except lossless hops.

        sampled : whether to pass over a section whose sampled launches all become faster, or all slower: a hop of a
            period has both
        """
        for i, value in enumerate(self.values):
            interrupts.heed()
            self._report(0.5 * i / len(self.values))
            if self.maps.lossless(value) or (sampled and not self._step_both_ways(value)):
                continue
            if period == 1 and self.maps.pieces is None:
                for point in self.maps.at(value).fixed_points(*self.between, self.samples):
                    yield value, (point.alpha,)
            else:
                for launches in self.maps.all_cycles(value, self.between, period):
                    yield value, tuple(launches.tolist())

    def _step_both_ways(self, value: float) -> bool:
        """Whether some sampled launches become faster, and others slower."""
        hops = self.maps.at(value)(np.linspace(*self.between, self.samples))
        change = hops.next - hops.alpha  # NaN without a next launch
        return bool((change > 0).any() and (change < 0).any())

    def _report(self, share: float) -> None:
        """Report the completed share, which never falls: half of it is the search at the sections."""
        self._done = max(self._done, min(share, 1.0))
        if self.progress:
            self.progress(self._done)

    def doubled(self, doublings: int) -> None:
        """Follow the hops of twice the period from each flip that was found since the last time, on branches that are
        fewer doublings away from the searched hops."""
        new, self._followed = self.events[self._followed :], len(self.events)
        new = [(branch, event) for branch, event in new if self._depths[branch] < doublings]
        ended = list[PeriodicLaunch]()
        flips = [(self.branches[branch].period, event.point) for branch, event in new if event.kind == "flip"]
        depths = [self._depths[branch] for branch, event in new if event.kind == "flip"]
        for (period, flip), depth in zip(flips, depths, strict=True):
            tracer, name = self._tracer(2 * period), name_of_hops(2 * period)
            if flip in ended:
                self.notes[id(flip)] = f"the {name} end here"
                continue
            try:
                first = tracer.start_beside_flip(flip)
            except NoOrbit as error:
                self.notes[id(flip)] = str(error)
                continue
            side = "greater" if first.value > flip.value else "smaller"
            kind = SETTLES[abs(first.multiplier) < 1]
            self.notes[id(flip)] = f"{name} begin here, {kind}, toward {side} {self.maps.name}"
            items = list(tracer.trace(first, 1))
            same = [other for own, other in flips if own == period]
            if _ends_as(items, "flip") and (other := _flip_beside([first, *items], same, flip)):
                ended.append(other)
                items.insert(-1, _twice(other, first))
            begin = End("flip", f"a flip of the {name_of_hops(period)}")
            self._store(2 * period, [begin, _twice(flip, first), first, *items], depth + 1)

    def _store(self, period: int, items: list, depth: int = 0) -> None:
        """Store a branch from its points, events and ends in order, this many doublings away from one that was searched
        for."""
        self._depths.append(depth)
        ends = [item for item in items if isinstance(item, End)]
        items = _with_events_at_points(items)
        several = not self.maps.one_speed
        points = [(x, x.multiplier) if isinstance(x, PeriodicLaunch) else
                  (x.point, x.point.multiplier if several else _slope(x))
                  for x in items if not isinstance(x, End)]  # fmt: skip
        self.events += [(len(self.branches), item) for item in items if isinstance(item, Event)]
        values, alphas, slopes = zip(*((p.value, p.alphas, slope) for p, slope in points), strict=True)
        columns, both = (np.array(values), np.array(alphas), np.array(slopes)), (ends[0], ends[-1])
        self.branches.append(Branch(period, *columns, both, *self._launches([point for point, _ in points])))

    def _launches(self, points: list[PeriodicLaunch]) -> tuple[Any, ...]:
        """The names of the numbers of a launch, the launches (n, period, d) and the parts (n, d, 2) of the multipliers,
        where launches have several numbers."""
        if self.maps.one_speed:
            return ()
        names, units = self.maps.at(self.values[0]).names, self.maps.machine.model.units
        launches = np.array([point.launches for point in points])
        if units:
            values = [self.maps.machine_at(point.value).values for point in points]
            launches *= np.array([units(own).of_states(names) for own in values])[:, None]
        spectra = np.array([point.spectrum for point in points])
        return names, launches, np.stack([spectra.real, spectra.imag], axis=-1)

    def located(self) -> tuple[Bifurcation, ...]:
        """The events, ascending in the parameter."""
        found = list[Bifurcation]()
        for branch, event in self.events:
            at, note = event.point, self._note(event, branch)
            found.append(Bifurcation(event.kind, at.value, at.alphas, _slope(event), branch, note, at.border, at.sides))
        return tuple(sorted(found, key=lambda event: event.value))

    def _note(self, event: Event, branch: int) -> str:
        period = self.branches[branch].period
        if event.kind == "flip":
            return self.notes.get(id(event.point), f"{name_of_hops(2 * period)} branch off here" if period > 1 else "")
        if event.kind == "Neimark-Sacker":
            spectrum = event.point.spectrum
            near = np.where(spectrum.imag > 0, np.abs(np.abs(spectrum) - 1), np.inf)
            angle = float(np.angle(spectrum[np.argmin(near)]))
            return f"a pair of multipliers exp(+-i {angle:.9g}) crosses the unit circle"
        if event.point.border:
            before, behind = event.point.sides
            slopes = f"multipliers {before:.6g} and {behind:.6g} near it"
            return f"{BORDERS_IN_WORDS[event.point.border]}; the hops {RUN_ON[event.kind]}, {slopes}"
        if event.kind == "fold" and self.maps.lossless(event.point.value):
            return "the lossless hop"
        return "the slope of the map jumps" if event.kind == "border collision" else ""


def _with_events_at_points(items: list) -> list:
    """The items of a branch in order, where points exactly at a multiplier of 1 or -1 become events if the multiplier
    passes it there; the tracer finds those between points."""
    items, places = list(items), [i for i, item in enumerate(items) if not isinstance(item, End)]
    for before, i, behind in zip(places, places[1:], places[2:], strict=False):
        point = items[i]
        if isinstance(point, Event) or point.multiplier not in (1.0, -1.0):
            continue
        (last, first), (following, second) = (
            (x.point, _slope(x)) if isinstance(x, Event) else (x, x.multiplier) for x in (items[before], items[behind])
        )
        if (first - point.multiplier) * (second - point.multiplier) < 0:
            turns = (last.value - point.value) * (following.value - point.value) > 0
            kind = "flip" if point.multiplier < 0 else "fold" if turns else "branch point"
            items[i] = Event(kind, point=point)
    return items


def _ends_as(items: list, kind: str) -> bool:
    """Whether traced items end in this way."""
    return isinstance(items[-1], End) and items[-1].kind == kind


def _twice(flip: PeriodicLaunch, along: PeriodicLaunch) -> PeriodicLaunch:
    """The fixed point at a flip as a point of a branch of period two, from another point `along` that branch."""
    launches, matrix = flip.launches, flip.matrix
    if launches is not None:
        launches, matrix = np.concatenate([launches, launches]), matrix @ matrix
    twice = replace(flip, alphas=flip.alphas * 2, multiplier=1.0, impacts=flip.impacts * 2, tangent=along.tangent)
    return replace(twice, launches=launches, matrix=matrix)


def _flip_beside(items: list, flips: list[PeriodicLaunch], but: PeriodicLaunch) -> PeriodicLaunch | None:
    """The flip, other than `but`, at which a branch of twice the period ends: pairs of its launches lie on both sides
    of those of the flip, at most a step away. None where it is not among the known flips."""
    last = [item for item in items if isinstance(item, PeriodicLaunch)][-1]
    middles, scale = np.reshape(last.alphas, (2, -1)).mean(axis=0), last.place[0] / last.alphas[0]

    def distance(flip: PeriodicLaunch) -> float:
        turned = [np.roll(flip.alphas, k) for k in range(len(flip.alphas))]
        apart = min(float(np.abs(each - middles).max()) for each in turned) * scale
        return max(apart, abs(float(flip.place[1] - last.place[1])))

    nearest = min((flip for flip in flips if flip is not but), key=distance, default=None)
    return nearest if nearest and distance(nearest) <= STEPS_OF_BRANCHES.apart else None


def _slope(event: Event) -> float:
    """The multiplier at an event, by the definition of its kind; NaN where there are two."""
    known = {"fold": 1.0, "branch point": 1.0, "flip": -1.0, "Neimark-Sacker": 1.0}
    return known.get(event.kind, event.point.multiplier if event.point.border else float("nan"))


def _attractor(maps: MapsAlong, between: tuple[float, float], count: int, options: Attractor = ATTRACTOR) -> np.ndarray:
    """Values of the parameter and launch speeds (k, 2) in the range `between` that are visited in the long run."""
    values = np.linspace(maps.low, maps.high, count)
    if maps.name == INJECT and (step := maps.at(0.0).impacts).never_lose and step.one_liftoff:
        values = values[values == 0.0]  # otherwise all launches become faster by the injection, or all slower
    if not len(values):
        return np.zeros((0, 2))
    starts = np.linspace(*between, options.starts + 2)[1:-1]
    repeated = np.repeat(values, len(starts))
    size = max(1, options.together // len(starts)) if maps.name == INJECT else 1
    parts = [values[first : first + size] for first in range(0, len(values), size)]
    found = np.hstack(
        [_long_run(maps, np.tile(starts, len(part)), np.repeat(part, len(starts)), options) for part in parts]
    )
    places = np.broadcast_to(repeated, found.shape)
    inside = (found >= between[0]) & (found <= between[1])
    return np.column_stack([places[inside], found[inside]])


def _long_run(maps: MapsAlong, alpha: np.ndarray, values: np.ndarray, options: Attractor) -> np.ndarray:
    """The launch speeds (hops, m) that are visited after many hops from launches (m,) at values (m,) of the
    parameter, all the same unless it is the injection; NaN where the machine comes to rest."""
    found = np.full((options.hops, len(alpha)), np.nan)
    going, alpha = np.arange(len(alpha)), alpha.copy()
    for hop in range(options.transient + options.hops):
        interrupts.heed()
        following, _ = maps.next(alpha[going], values[going] if maps.name == INJECT else values[0])
        alive = np.isfinite(following)
        settled = np.array_equal(following[alive], alpha[going[alive]])  # every launch comes back to the last bit
        going = going[alive]
        if not len(going):
            break
        alpha[going] = following[alive]
        if settled:
            found[max(hop - options.transient, 0) :, going] = alpha[going]
            break
        if hop >= options.transient:
            found[hop - options.transient, going] = alpha[going]
    return found
