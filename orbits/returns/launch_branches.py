"""Branches of periodic hops whose launches are several numbers: curves in launch and parameter, and their bifurcations.

A curve is followed by steps along its tangent and Newton's method across it. The derivatives by the launch are those of
`derivative_of_hops`; those by the parameter are differences. Where a test function of the multipliers changes its sign
between two points, the bifurcation is located on the curve.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, pairwise
from typing import Any, cast

import numpy as np

from ..continuation.point import End
from ..errors import InputError, NoOrbit, OrbitsError
from ..hops.multipliers import HopsDerivative, derivative_of_hops
from ..numerics.roots import bracketed_root
from ..result import Progress
from ..running import interrupts
from .bifurcation import Bifurcation
from .cycles import INJECT, STEP_ALONG, MapsAlong
from .diagram import Branch
from .periodic_hop import SAME_PERIODIC, PeriodicHop, listed_starts

# Steps along a curve, as shares of the ranges; the cosine of the largest turn in one; and the most points of a curve.
FIRST_LENGTH, LONGEST_LENGTH, SHORTEST_LENGTH, LARGEST_TURN, MOST_LAUNCH_POINTS = 1e-3, 0.05, 1e-6, 0.95, 2000
CORRECTED, MOST_CORRECTIONS = 1e-12, 12  # Newton's method across the curve has converged, or is given up
ROUNDED_EXCESS = 1e-8  # where Newton's method comes no nearer than this, rounding decides
AT_BIFURCATION = 1e-4  # a multiplier that is farther from its value at a bifurcation jumps there
FIRST_DOUBLED = (1e-3, 3e-3, 1e-4)  # from a flip to the first hops of twice the period, as shares of the range


@dataclass(frozen=True, eq=False)
class LaunchPoint:
    """A point of a curve: its place (d + 1,), launch and parameter in shares of the ranges, the unit tangent there, the
    hops, and the derivative (d,) by the parameter of the difference of the last and the first launch."""

    x: np.ndarray
    tangent: np.ndarray
    value: float
    hops: HopsDerivative
    along: np.ndarray

    @cached_property
    def spectrum(self) -> np.ndarray:
        """The multipliers (d,), those of largest modulus first."""
        values = np.linalg.eigvals(self.hops.matrix).astype(complex)
        return values[np.lexsort((-values.imag, -np.abs(values).round(12)))]

    @cached_property
    def tests(self) -> dict[str, float]:
        """Functions that vanish at a bifurcation, by its kind."""
        matrix, one = self.hops.matrix, np.eye(len(self.hops.matrix))
        pairs = np.prod([a * b - 1 for a, b in combinations(self.spectrum, 2)]).real
        found = {"fold": float(self.tangent[-1]), "flip": float(np.linalg.det(matrix + one))}
        return found | {"branch point": float(np.linalg.det(matrix - one)), "Neimark-Sacker": float(pairs)}


class LaunchBranches:
    """The curves of hops of one period along a parameter.

    maps : the maps along the parameter
    between : the range of launch speeds
    """

    def __init__(self, maps: MapsAlong, between: tuple[float, float], period: int):
        self.maps, self.period = maps, period
        self.speed = maps.machine.units.of("alpha") if maps.machine.units else 1.0
        self.between = between[0] / self.speed, between[1] / self.speed
        self.names = maps.at(maps.low).section.names
        self.alpha, self.span = self.names.index("alpha"), maps.high - maps.low
        self.scale = np.append(np.full(len(self.names), self.between[1] - self.between[0]), self.span)

    def _hops(self, launch: np.ndarray, value: float, near: np.ndarray) -> HopsDerivative:
        """The hops from a launch (d,) beside a contact state `near` (k,); raises `NoOrbit`."""
        along = self.maps.name == INJECT
        section = self.maps.at(0.0 if along else value).section
        (y,) = section.states(launch[None], near[[section.places[section.dependent]]])
        if not np.isfinite(y).all():
            raise NoOrbit("there is no such launch")
        return derivative_of_hops(section, y, self.period, (value if along else self.maps.inject) / self.speed)

    def _excess(self, hops: HopsDerivative) -> np.ndarray:
        """The difference (d,) of the last and the first launch."""
        first, last = hops.section.free(hops.launches[[0, -1]])
        return last - first

    def _along(self, launch: np.ndarray, value: float, hops: HopsDerivative) -> np.ndarray:
        """The derivative (d,) of the excess by the parameter."""
        if self.maps.name == INJECT and self.period == 1:
            return np.eye(len(launch))[self.alpha] / self.speed
        step, sides = STEP_ALONG * self.span, list[tuple[float, np.ndarray]]()
        for moved in (value - step, value + step):
            if self.maps.name == INJECT or self.maps.low <= moved <= self.maps.high:
                sides.append((moved, self._excess(self._hops(launch, moved, hops.launches[0]))))
        sides = sides if len(sides) == 2 else [(value, self._excess(hops)), *sides]
        (a, low), (b, high) = sides
        return (high - low) / (b - a)

    def point(self, hops: HopsDerivative, value: float, onward: np.ndarray) -> LaunchPoint:
        """The point of the curve with these hops, and the tangent that points onward."""
        launch = hops.section.free(hops.launches[0])
        along = self._along(launch, value, hops)
        jacobian = np.column_stack([hops.matrix - np.eye(len(launch)), along]) * self.scale
        tangent = np.linalg.svd(jacobian)[2][-1]
        tangent *= 1.0 if tangent @ onward >= 0 else -1.0
        return LaunchPoint(np.append(launch, value) / self.scale, tangent, value, hops, along)

    def corrected(self, x: np.ndarray, row: np.ndarray, near: LaunchPoint) -> LaunchPoint:
        """The point of the curve on the plane through a place (d + 1,) across `row`, by Newton's method; raises
        `NoOrbit` where it does not converge."""
        # The derivative by the parameter decides how fast the method converges, not to which point.
        level, last, along = row @ x, np.inf, near.along
        for _ in range(MOST_CORRECTIONS):
            launch, value = x[:-1] * self.scale[:-1], float(x[-1] * self.span)
            if self.maps.name != INJECT:
                value = float(np.clip(value, self.maps.low, self.maps.high))
            hops = self._hops(launch, value, near.hops.launches[0])
            excess = self._excess(hops) / self.scale[:-1]
            size = float(np.abs(excess).max())
            if size <= CORRECTED or (size <= ROUNDED_EXCESS and size >= 0.5 * last):
                return self.point(hops, value, near.tangent)
            if size > 10 * last:
                break
            jacobian = np.column_stack([hops.matrix - np.eye(len(launch)), along]) * self.scale / self.scale[:-1, None]
            step = np.linalg.lstsq(np.vstack([jacobian, row]), np.append(-excess, level - row @ x), rcond=1e-14)[0]
            if not np.isfinite(step).all() or np.abs(step).max() > 1:
                break
            x, last = x + step, size
        raise NoOrbit("Newton's method does not converge: the map jumps there, or is not smooth")

    def at_value(self, point: LaunchPoint, value: float) -> LaunchPoint:
        """The point of the curve near another one at a value of the parameter."""
        row, x = np.eye(len(point.x))[-1], point.x.copy()
        x[-1] = value / self.span
        return replace(self.corrected(x, row, point), value=value)

    def trace(
        self, start: LaunchPoint, side: int, report: Callable[[], None]
    ) -> Iterator[LaunchPoint | tuple[str, LaunchPoint] | End]:
        """The points, and bifurcations with their kind, from a point along its tangent (`side` 1) or against it (-1);
        an end is last. `report` is called after each point."""
        last, length, count = replace(start, tangent=side * start.tangent), FIRST_LENGTH, 0
        low, high = self.maps.low, self.maps.high
        if start.value == (high if last.tangent[-1] > 0 else low):
            yield self._reached(start.value)
            return
        while count < MOST_LAUNCH_POINTS:
            interrupts.heed()
            guess = last.x + length * last.tangent
            bound = low if guess[-1] * self.span < low else high if guess[-1] * self.span > high else None
            try:
                if bound is not None:
                    new = self.at_value(replace(last, x=last.x + (bound / self.span - last.x[-1])
                                                / last.tangent[-1] * last.tangent), bound)  # fmt: skip
                else:
                    new = self.corrected(guess, last.tangent, last)
                turned = float(new.tangent @ last.tangent)
                if turned < LARGEST_TURN or np.abs(new.x - guess).max() > max(length, 10 * SHORTEST_LENGTH):
                    raise NoOrbit("the curve turns too far in one step")
                events = list(self._events(last, new))
            except (NoOrbit, np.linalg.LinAlgError) as error:
                length *= 0.5
                if length > SHORTEST_LENGTH:
                    continue
                if bound is not None and self.maps.name == INJECT and self.maps.lossless(bound):
                    yield End("reached", f"the lossless hop at {self.maps.in_words(self.maps.name, bound)} is reached")
                else:
                    place = f"{self.maps.in_words(self.maps.name, last.value, 9)}, "
                    place += self.maps.in_words("alpha", last.x[self.alpha] * self.scale[0] * self.speed, 9)
                    yield End("stuck", f"near {place} the curve is lost: {error}")
                return
            count += 1
            yield from events
            alpha = float(new.x[self.alpha] * self.scale[self.alpha])
            yield new
            report()
            if bound is not None:
                yield self._reached(bound)
                return
            if not self.between[0] <= alpha <= self.between[1]:
                speed = self.maps.in_words("alpha", alpha * self.speed)
                yield End("left", f"it leaves the launch speeds of the range at {speed}")
                return
            if count > 3 and np.linalg.norm(new.x - start.x) < length and new.tangent @ start.tangent * side > 0:
                yield End("closed", "it comes back to its first point")
                return
            length = min(LONGEST_LENGTH, length * (1.5 if turned > 0.995 else 1.0))
            last = new
        yield End("stuck", f"it has {MOST_LAUNCH_POINTS} points")

    def _reached(self, bound: float) -> End:
        return End("reached", f"{self.maps.in_words(self.maps.name, bound)} is reached")

    def _events(self, a: LaunchPoint, b: LaunchPoint) -> Iterator[tuple[str, LaunchPoint]]:
        """The bifurcations between two points, with their kinds, in order."""
        found = list[tuple[float, str, LaunchPoint]]()
        chord = b.x - a.x
        for kind, first in a.tests.items():
            second = b.tests[kind]
            if first * second >= 0 or (kind == "branch point" and a.tests["fold"] * b.tests["fold"] < 0):
                continue
            row = chord / np.linalg.norm(chord)

            def between(share: float) -> LaunchPoint:
                return self.corrected(a.x + share * chord, row, a)  # noqa: B023

            def test(share: float) -> float:
                return between(share).tests[kind]  # noqa: B023

            share = bracketed_root(test, 0.0, 1.0, first, second, width=1e-10)
            point = between(share)
            if (name := _confirmed(kind, point)) is not None:
                found.append((share, name, point))
        yield from ((name, point) for _, name, point in sorted(found, key=lambda each: each[0]))

    def beside_flip(self, flip: LaunchPoint) -> LaunchPoint:
        """A first point of the hops of twice the period of a flip, which are this curve's; raises `NoOrbit`."""
        values, vectors = np.linalg.eig(flip.hops.matrix)
        direction = vectors[:, np.argmin(np.abs(values + 1))].real
        row = np.append(direction / np.linalg.norm(direction), 0.0)
        near = replace(flip, tangent=row)
        for step in (side * length for length in FIRST_DOUBLED for side in (1, -1)):
            try:
                return self.corrected(flip.x + step * row, row, near)
            except NoOrbit:
                continue
        raise NoOrbit("no hops of twice the period are found beside the flip")


def _closes(end: object) -> bool:
    """Whether a curve ends at its first point."""
    return isinstance(end, End) and end.kind == "closed"


def _confirmed(kind: str, point: LaunchPoint) -> str | None:
    """The kind of the bifurcation at a point where its test function changes sign; None where there is none, as where
    two real multipliers have the product 1."""
    spectrum = point.spectrum
    if kind == "Neimark-Sacker":
        pair = spectrum[(spectrum.imag > 0) & (np.abs(np.abs(spectrum) - 1) <= AT_BIFURCATION)]
        return kind if len(pair) else None
    level = -1.0 if kind == "flip" else 1.0
    return kind if np.abs(spectrum - level).min() <= AT_BIFURCATION else "border collision"


class LaunchDiagram:
    """The branches and bifurcations found so far, of launches of several numbers."""

    def __init__(self, maps: MapsAlong, between: tuple[float, float], progress: Progress):
        self.maps, self.between, self.report = maps, between, progress or (lambda share: None)
        self.branches, self.events = list[Branch](), list[tuple[int, str, LaunchPoint, str]]()
        self._done = 0.0  # the completed share
        self.refused = ""  # why the last start that leads to no hops does not
        self._points = list[tuple[int, list[LaunchPoint]]]()

    def search(self, starts: list[Any], values: list[float]) -> None:
        """Follow the hops that are found from starts at these values and lie on no branch yet."""
        for i, value in enumerate(values):
            if self.maps.lossless(value):
                continue
            for start in starts:
                step, period = self.maps.at(value), start.period if isinstance(start, PeriodicHop) else 1
                for below in (False, True):
                    try:
                        hop = step._periodic(start, period, below)
                    except NoOrbit as error:
                        self.refused = str(error)
                        continue
                    self._follow(hop, value)
            self._progress((i + 1) / len(values))

    def _progress(self, share: float) -> None:
        """Report a completed share, which never falls."""
        self._done = max(self._done, min(share, 1.0))
        self.report(self._done)

    def _follow(self, hop: PeriodicHop, value: float) -> None:
        """Follow the branch through hops, unless it is known."""
        tracer = LaunchBranches(self.maps, self.between, hop.period)
        section = self.maps.at(value).section
        y = section.launch(hop.launches[0])
        point = tracer.point(tracer._hops(section.free(y), value, y), value, np.eye(len(tracer.scale))[-1])
        if not self._is_known(tracer, point):
            self._store(tracer, point)

    def _store(self, tracer: LaunchBranches, start: LaunchPoint, begin: End | None = None) -> None:
        """Trace a branch to both sides of a point, or from its `begin` on, and store it."""
        report = lambda: self._progress(self._done)  # noqa: E731 - that it goes on, at the same share
        *ahead, end = tracer.trace(start, 1, report)
        *back, first = [begin] if begin else [end] if _closes(end) else tracer.trace(start, -1, report)
        items = [item for item in (*reversed(back), start, *ahead) if not isinstance(item, End)]
        points = [item[1] if isinstance(item, tuple) else item for item in items]
        number, section = len(self.branches), start.hops.section
        launches = np.array([section.free(point.hops.launches[:-1]) * section.unit for point in points])
        spectra = np.array([point.spectrum for point in points])
        dominant = np.where(spectra[:, 0].imag == 0, spectra[:, 0].real, np.abs(spectra[:, 0]))
        columns = np.array([point.value for point in points]), launches[:, :, tracer.alpha], dominant
        ends = cast(Any, (first, end))
        parts = np.stack([spectra.real, spectra.imag], axis=-1)
        self.branches.append(Branch(tracer.period, *columns, ends, tracer.names, launches, parts))
        self._points.append((tracer.period, points))
        flips = [item[1] for item in items if isinstance(item, tuple) and item[0] == "flip"]
        for item in items:
            if isinstance(item, tuple):
                self.events.append((number, *item, ""))
        for flip in flips if tracer.period == 1 else []:
            self._double(flip)

    def _double(self, flip: LaunchPoint) -> None:
        """Follow the hops of period two from a flip."""
        tracer = LaunchBranches(self.maps, self.between, 2)
        try:
            first = tracer.beside_flip(flip)
            if self._is_known(tracer, first):
                note = "hops of period two end here"
            else:
                away = first.x - flip.x
                first = first if first.tangent @ away >= 0 else replace(first, tangent=-first.tangent)
                side = "greater" if first.value > flip.value else "smaller"
                kind = "stable" if np.abs(first.spectrum).max() < 1 else "unstable"
                note = f"hops of period two begin here, {kind}, toward {side} {self.maps.name}"
                self._store(tracer, first, End("flip", "a flip of the fixed points"))
        except OrbitsError as error:
            note = str(error)
        place = next(i for i, event in enumerate(self.events) if event[2] is flip)
        self.events[place] = (*self.events[place][:3], note)

    def _is_known(self, tracer: LaunchBranches, point: LaunchPoint) -> bool:
        """Whether a point lies on a branch of its period."""
        section = point.hops.section
        launches = section.free(point.hops.launches[:-1])
        for period, points in self._points:
            if period != tracer.period:
                continue
            for a, b in pairwise(points):
                if (a.value - point.value) * (b.value - point.value) > 0 or a.value == b.value:
                    continue
                share = (point.value - a.value) / (b.value - a.value)
                place = a.x + share * (b.x - a.x)
                near = np.abs(launches / tracer.scale[:-1] - place[:-1]).max(1).min()
                if near > np.linalg.norm(b.x - a.x):
                    continue
                try:
                    same = tracer.at_value(replace(a, x=place), point.value)
                except NoOrbit:
                    continue
                own = section.free(same.hops.launches[0])
                if np.abs(launches - own).max(1).min() <= 10 * SAME_PERIODIC * (1 + np.abs(own).max()):
                    return True
        return False

    def located(self) -> tuple[Bifurcation, ...]:
        """The bifurcations, ascending in the parameter."""
        known, found = {"fold": 1.0, "branch point": 1.0, "flip": -1.0, "Neimark-Sacker": 1.0}, []
        for branch, kind, point, note in self.events:
            section, place = point.hops.section, point.hops.section.names.index("alpha")
            alphas = section.free(point.hops.launches[:-1])[:, place] * section.unit[place]
            if kind == "Neimark-Sacker":
                near = np.where(point.spectrum.imag > 0, np.abs(np.abs(point.spectrum) - 1), np.inf)
                angle = float(np.angle(point.spectrum[np.argmin(near)]))
                note = f"a pair of multipliers exp(+-i {angle:.9g}) crosses the unit circle"
            found.append(
                Bifurcation(kind, point.value, tuple(alphas.tolist()), known.get(kind, float("nan")), branch, note)
            )
        return tuple(sorted(found, key=lambda event: event.value))


def launch_diagram(
    maps: MapsAlong, between: tuple[float, float], values: list[float], starts: Any, attractor: int | None,
    progress: Progress,
) -> LaunchDiagram:  # fmt: skip
    """The branches of periodic hops that are found from starts at values of the parameter."""
    model = maps.machine.model
    if starts is None:
        raise InputError(
            f"a launch of a {model.name} has {len(maps.at(maps.low).names)} numbers, which no grid covers: give "
            "starts=[...], lossless orbits or periodic hops"
        )
    if attractor:
        raise InputError(
            f"attractor = {attractor}: the attractor is searched for where a launch is a speed; of launches of several "
            "numbers call the ReturnMap again and again"
        )
    found = LaunchDiagram(maps, between, progress)
    found.search(listed_starts(starts), values)
    if not found.branches:
        raise NoOrbit(f"the starts lead to no hops that come back: {found.refused}")
    return found
