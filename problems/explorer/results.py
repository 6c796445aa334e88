"""What a worker computes for the page: the hop of a scene, its family piece by piece, the return map around it."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any, NamedTuple

import numpy as np

from orbits.continuation import Family, Point, follow
from orbits.curves import End
from orbits.errors import InputError, NoOrbit
from orbits.model import Machine
from orbits.periodic import Orbit, find, stated_unknowns
from orbits.returns import ReturnMap
from orbits.show import FamilyData, HopData, LawData, MapData, family_data, hop_data, law_data, map_data
from orbits.tables import number_text

from .dials import Dial, dials_of
from .scene import RUNNER, STARTS, Scene


class ResultOptions(NamedTuple):
    """The sizes of families and maps on a page."""

    first_piece: int = 12  # points of a family when it is first shown
    piece: int = 60  # points by which a family grows per update
    family: int = 2000  # points of a whole family
    beyond: float = 2.0  # the map is drawn up to this multiple of the hop's launch speed
    slowest: float = 1e-3  # the map is drawn from this multiple of the hop's launch speed on
    cobweb: int = 80  # hops of a cobweb in the map
    trials: int = 16  # runs on the way from one to another whose numbers are far away, some 0.1 s each
    # Launches of a map beside a lossless step, a few first: each takes some 10 ms, and 500 ms where feet take over from
    # each other often.
    samples_beside: tuple[int, ...] = (13, 61)
    hidden: float = 1e-12  # a range that is a smaller share of the launch speed is lost in rounding
    with_bounce: float = 10.0  # factor of a loss with one bounce


RESULTS = ResultOptions()
# The map of a machine that steps is drawn from and to these multiples of the range that leads to its lossless step, by
# whether landings bounce above it, not below.
RANGE_BESIDE = {True: (-1.0, 1.5), False: (-0.1, 1.5)}


@dataclass(frozen=True)
class DialsResult:
    """The sliders of a scene's parameters, which are sent before its hop, also where there is no hop."""

    dials: list[Dial]


@dataclass(frozen=True, eq=False)
class HopResult:
    """A hop as the page shows it.

    scene : the scene, whose start, if it has one, leads to this hop again
    data, law : what the figures show; law is None for a machine whose spring's force is not known on its own
    rows : the certificate, as names and texts
    alpha : launch speed
    violations : why the hop is not a motion, in words; empty if it is one
    """

    scene: Scene
    data: HopData
    law: LawData | None
    rows: list[tuple[str, ...]]
    alpha: float
    violations: tuple[str, ...]


def hop_results(python_machine: object, scene: Scene, with_dials: bool) -> Iterator[DialsResult | HopResult]:
    """The hop of a scene, preceded by the sliders where these are requested; raises `NoOrbit` where there is no hop."""
    machine = scene.build(python_machine)
    if with_dials:
        yield DialsResult(dials_of(machine, scene))
    orbit = _orbit_of_scene(machine, scene)
    if scene.tuned and orbit.source is not None:
        scene = scene.with_numbers(**{name: orbit.source.values[name] for name in scene.tuned})
    if scene.tuned or scene.start is not None:
        scene = replace(scene, start=start_of(machine, orbit))
    try:
        law = law_data(machine, orbit)
    except InputError:
        law = None
    rows = [row for row in orbit.rows() if row[0] != "machine"]  # the fields of the page have its numbers
    yield HopResult(scene, hop_data(orbit), law, rows, orbit.alpha, orbit.violations)


def start_of(machine: Machine, orbit: Orbit | Point) -> tuple[float, ...]:
    """The start that a scene stores to find an `Orbit`, or a family's `Point`, again."""
    names = STARTS[RUNNER] if machine.model.sticks else machine.model.half_unknowns
    known = (
        stated_unknowns(machine.model, orbit)
        if isinstance(orbit, Orbit)
        else {"duration": 0.0, **dict(zip(names, orbit.u, strict=False))}
    )
    start = tuple(known[name] * (machine.units.of(name) if machine.units else 1.0) for name in names)
    return (start[0], orbit.alpha, orbit.flight_time / 2) if machine.model.one_speed else start


@dataclass(frozen=True, eq=False)
class FamilyResult:
    """The part of a family that has been computed, and the status of its ends.

    of : the scene, with the parameter that the family is followed along
    values : of that parameter, at the points in order along the curve, without events, as no hop is found at a fold
    starts : the starts of these points, each as in a scene
    tuned : the tuned numbers at these points, by name
    text : the extent of the family and how it ends, in words
    """

    of: Scene
    data: FamilyData
    values: tuple[float, ...]
    starts: tuple[tuple[float, ...], ...]
    tuned: tuple[Mapping[str, float], ...]
    text: str

    def nearest(self, value: float, alpha: float) -> int:
        """The index of the point nearest to a position in the figure."""
        places = np.array([self.values, [start[1] for start in self.starts]])
        size = np.abs(places).max(axis=1, keepdims=True)
        # A launch speed that does not depend on the parameter still varies by rounding, which must not set the scale.
        scale = np.maximum(np.ptp(places, axis=1, keepdims=True), 1e-6 * size + 1e-300)
        return int(np.hypot(*((places - [[value], [alpha]]) / scale)).argmin())

    def holds(self, scene: Scene) -> bool:
        """Whether this is the family of a scene's hop."""
        return same_family(self.of, scene)

    @property
    def along(self) -> str:
        """The parameter that the family is followed along."""
        return self.of.along


def same_family(scene: Scene, other: Scene) -> bool:
    """Whether two scenes have the same parameter to follow and differ only in its value."""
    return _beside(scene) == _beside(other)


def _beside(scene: Scene) -> Scene:
    """The part of a scene that does not change along a family."""
    others = {name: value for name, value in scene.numbers.items() if name not in (scene.along, *scene.tuned)}
    return replace(scene, start=None, launch=None, numbers=others)


def family_results(python_machine: object, scene: Scene, low: float, high: float) -> Iterator[FamilyResult]:
    """The family through a scene's hop along its parameter, between two values, as it grows from the hop upward and
    then downward."""
    machine, along = scene.build(python_machine), scene.along
    here = scene.prescribed.get(along, machine.values.get(along))
    if here is None:
        raise InputError(f"this machine has no parameter '{along}' to follow")
    hop, bounds = _orbit_of_scene(machine, scene), (min(low, here), max(high, here))
    tune: dict[str, Any] = {"tune": scene.tuned} if scene.tuned else {}
    family = follow(machine, along, bounds, family=hop.family, start=hop, most=RESULTS.first_piece, **tune)
    yield _family_result(machine, scene, family)
    while _is_growing(family):
        family = follow(machine, along, bounds, family=hop.family, resume=family, most=RESULTS.piece, **tune)
        yield _family_result(machine, scene, family)


def _is_growing(family: Family) -> bool:
    ends = family.end, family.beginning
    return any(end and end.kind == "stopped" for end in ends) and len(family) < RESULTS.family


def _orbit_of_scene(machine: Machine, scene: Scene) -> Orbit:
    """The orbit of a scene; raises `NoOrbit`."""
    start = None if scene.start is None else dict(zip(scene.start_names, scene.start, strict=True))
    if not scene.tuned:
        return find(machine, scene.family, start=start)
    try:
        found = _run(machine, scene, start)
    except NoOrbit:  # the start is that of other numbers, which may be far away
        found = _run_led_to(machine, scene)
    _last_run[:] = [(scene, found)]
    return found


def _run(machine: Machine, scene: Scene, start: Any) -> Orbit:
    return find(machine, scene.family, start=start, tune=scene.tuned, at=scene.prescribed)


def _run_led_to(machine: Machine, scene: Scene) -> Orbit:
    """The run of a scene without a start or, where none is found, the one to which the last run leads as the numbers
    change little by little; raises the `NoOrbit` of the former."""
    try:
        return _run(machine, scene, None)
    except NoOrbit as error:
        if not _last_run or _last_run[0][0].numbers.keys() != scene.numbers.keys():
            raise
        reason = error
    (before, run), share, step = _last_run[0], 0.0, 0.5
    for _ in range(RESULTS.trials):
        ahead = min(share + step, 1.0)
        x = {name: (1 - ahead) * before.numbers[name] + ahead * value for name, value in scene.numbers.items()}
        between = scene.with_numbers(**x)
        try:
            run, share = _run(between.build(), between, run), ahead
        except NoOrbit:
            step /= 2
        if share == 1:
            return run
    raise NoOrbit(f"no run is found from the previous run or from the hop in place: {reason}")


# The run found last and its scene, from which one of numbers that are far away is reached.
_last_run: list[tuple[Scene, Orbit]] = []


def _family_result(machine: Machine, scene: Scene, family: Family) -> FamilyResult:
    # From the lower end of a slider a family goes up, and from its upper end down.
    only = "Downward" if family.settings["stop"] < family.settings["start"] else "Upward"
    ends = (
        {"Upward": (-1, family.end), "Downward": (0, family.beginning)}
        if family.beginning
        else {only: (-1, family.end)}
    )
    endings = " ".join(f"{word}: {_ending(family, *end)}." for word, end in ends.items())
    text = f"{len(family)} solutions" + (", still growing." if _is_growing(family) else f". {endings}")
    values, starts = tuple(p.value for p in family.points), tuple(start_of(machine, p) for p in family.points)
    tuned = tuple({name: point.also[name] for name in scene.tuned} for point in family.points)
    data = family_data(family)
    if _is_growing(family):
        there = [kind != "end: stopped" for kind in data.events["kind"]]
        data = replace(data, events={name: [*compress(column, there)] for name, column in data.events.items()})
    return FamilyResult(scene, data, values, starts, tuned, text)


def _ending(family: Family, place: int, end: End) -> str:
    """How a family ends at one of its ends, in words; that may be back at its hop's value on another sheet."""
    last, name = family[place].value, family.name
    if end.kind != "reached" or "again" in end.reason:
        return str(end.reason)
    return f"to the end of the slider, {name.replace('_', ' ')} = {number_text(last, family.units.get(name, ''), 6)}"


def map_results(python_machine: object, scene: Scene) -> Iterator[MapData]:
    """The return map around a scene's hop with its cobweb, then the same with the basin of lossless hops."""
    plain = replace(scene, launch=None, along="")
    machine = scene.build(python_machine)
    if not machine.model.one_speed:
        name = machine.model.name
        raise InputError(f"the launch of a {name} has several numbers, and this page draws the map of a single one")
    orbit = _orbit_of_scene(machine, plain)
    if orbit.shape.steps:
        for samples in RESULTS.samples_beside:
            yield _map_of_steps(ReturnMap(machine), orbit, scene.launch, samples)
        return
    step, low, high = ReturnMap(machine), RESULTS.slowest * orbit.alpha, RESULTS.beyond * orbit.alpha
    known = _last_basin[0][1] if _last_basin and _last_basin[0][0] == plain else None
    yield map_data(step, low, high, basin=known, start=scene.launch, hops=RESULTS.cobweb)
    if known is None and step.machine.model.conservative:
        _last_basin[:] = [(plain, step.basin(low, high))]
        yield map_data(step, low, high, basin=_last_basin[0][1], start=scene.launch, hops=RESULTS.cobweb)


# The basin found last and its scene: another cobweb in the same map needs no new basin.
_last_basin: list[tuple[Scene, Sequence[tuple[float, float]]]] = []


def _map_of_steps(step: ReturnMap, orbit: Orbit, launch: float | None, samples: int) -> MapData:
    """The return map of a machine that steps, near its lossless step, in the range of launches that lead back to it.

    A launch that is faster by d loses K C d^(4/3), or C d^(4/3), and so comes to the lossless step from d <= (K C)^-3;
    launches that are farther away end in many ways within a small range.
    """
    found = orbit.certificate
    if not found.loss_coefficient:
        raise InputError("this step has no loss coefficient, for example because a landing with a speed loses nothing")
    above = found.bounce_side == "above"
    factor = (found.bounce_factor or RESULTS.with_bounce) if above else 1.0
    low, high = (share / (factor * found.loss_coefficient) ** 3 for share in RANGE_BESIDE[above])
    if high < RESULTS.hidden * orbit.alpha:
        raise InputError(
            f"only launches at most {high:.2g} faster come back to this step, and rounding hides such a difference"
        )
    data = map_data(step, low, high, centre=orbit.alpha, start=launch, hops=RESULTS.cobweb, samples=samples)
    faster = data.alpha > 0
    d, left = data.alpha[faster], data.following[faster]
    good = np.logical_and.accumulate((left >= 0) & (left < d))
    return replace(data, basin=np.array([[0.0, d[good].max(initial=0.0)]]))


# The functions of tasks by name; each takes the page's machine that was made in Python and the task's arguments.
COMPUTATIONS: dict[str, Callable[..., Iterator[object]]] = {
    "hop": hop_results,
    "family": family_results,
    "map": map_results,
}
