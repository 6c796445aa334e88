"""Events on a curve of orbits between two neighbouring points: located, certified, in order.

A test function changes its sign at an event: those of orbits (`curve.TEST_FUNCTIONS`), of the multipliers of the map of
launches, and of the user (`watch`), the parameter's share of the tangent at a fold, and the determinant of the bordered
Jacobian at a branch point.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Self

import numpy as np

from ..errors import InputError, NoOrbit, OrbitsError, finite_number
from ..numerics.roots import bracketed_root
from ..periodic.orbit import Orbit
from ..records import NONE
from ..simulation.lossless_hops import CROSSINGS, is_crossing
from ..units import LIFTOFF_SPEED
from .corrector import correct, correct_all
from .curve import TEST_FUNCTIONS, Curve, CurvePoint, CurvePoints, TestFunction, Watch, interpolated

# An event is located to this share of the chord between two points, where rounding begins to show.
WIDTH = 1e-13
# A branch point, where the equations are singular, is interpolated from points at one and two times this share from it.
BRANCH_OFFSET = 0.01
# A value of the parameter is approached from within the segment by at least this share of the chord.
INSIDE = 1e-9
# The test functions that are 1 or -1, for which no secant helps, and the places at which they are evaluated together.
SIGNS_ALONE, PLACES_TOGETHER = ("family", "collapse", "law ends"), 31


class Segment:
    """The curve between two neighbouring certified points; a place on it is stated as its share of the chord."""

    # The test functions of certified orbits, and the share of the chord to which events are located.
    tests: Mapping[str, TestFunction] = TEST_FUNCTIONS
    width = WIDTH

    def __init__(self, curve: Curve, a: CurvePoint, b: CurvePoint):
        self.curve, self.a, self.b = curve, a, b

    @classmethod
    def may_happen(
        cls, curve: Curve, before: CurvePoint, points: Sequence[CurvePoint], requested: tuple[float, ...], watch: Watch
    ) -> np.ndarray:
        """Whether an event may lie between each of certified points (m,) of a curve and the one before it, (m,)."""
        if watch:
            return np.ones(len(points), bool)
        parts = [
            (each.values[:, None], cls._test_signs(curve, each)) for each in map(CurvePoints.of, ([before], points))
        ]
        values, signs = map(np.concatenate, zip(*parts, strict=True))
        low, high = np.minimum(values[:-1], values[1:]), np.maximum(values[:-1], values[1:])
        return (signs[:-1] != signs[1:]).any(1) | ((low <= requested) & (requested <= high)).any(1)

    @cached_property
    def row(self) -> np.ndarray:
        """The row (n + 1,) that measures the share of the chord."""
        size = self.curve.size(self.a.x)
        chord = (self.b.x - self.a.x) / size
        return chord / (chord @ chord) / size

    def __call__(self, share: float) -> CurvePoint:
        """The point of the curve at a share of the chord; between the ends it is not certified."""
        if share in (0.0, 1.0):
            return (self.a, self.b)[int(share)]
        level = float(self.row @ self.a.x) + share
        (guess,) = interpolated((self.a, self.b), self.row, np.array([level]))
        return self._correct(guess, self.row, level)

    def _correct(self, guess, row, level: float) -> CurvePoint:
        return correct(self.curve, guess, row, level, self.a.tangent)

    def sheets(self) -> list[Self]:
        """The segments between the ends and a fold between them."""
        points = [self.a, *([] if self.fold is None else [self(self.fold)]), self.b]
        return [type(self)(self.curve, *ends) for ends in pairwise(points)]

    @cached_property
    def fold(self) -> float | None:
        """The share of the chord at which the parameter has a fold."""
        return self.zero(lambda point: float(point.tangent[-1]))

    def zero(self, test: Callable[[CurvePoint], float | None], width: float | None = None) -> float | None:
        """The share of the chord at which a test function changes its sign, zero counting as positive; None without."""
        width = self.width if width is None else width
        first, last = test(self.a), test(self.b)
        if first is None or last is None or (first >= 0) == (last >= 0):
            return None
        share = bracketed_root(lambda share: test(self(share)) or 0.0, 0.0, 1.0, first, last, width=width)
        value = test(self(share))
        # A pole changes the sign too, but with values larger than those at the ends.
        return None if value is None or abs(value) > abs(first) + abs(last) else share

    def jump(self, kind: str) -> float | None:
        """The share of the chord at which a test function in `SIGNS_ALONE` changes its sign; None without a change."""
        first, last = (self._test(kind, {}, point) for point in (self.a, self.b))
        if first == last:
            return None
        low, high = 0.0, 1.0
        try:
            while high - low > self.width:
                shares = np.linspace(low, high, PLACES_TOGETHER + 2)
                changed = np.append(self._jumps(kind, shares[1:-1]) != first, True)
                place = int(changed.argmax())
                low, high = float(shares[place]), float(shares[place + 1])
        except OrbitsError:  # at a place that bisection may not need
            return self.zero(partial(self._test, kind, {}))
        return high

    def _jumps(self, kind: str, shares: np.ndarray) -> np.ndarray:
        """The values (m,) of a test function among `SIGNS_ALONE` at shares (m,) of the chord."""
        levels, many = float(self.row @ self.a.x) + shares, (len(shares), 1)
        rows, before = np.tile(self.row, many), np.tile(self.a.tangent, many)
        found = correct_all(self.curve, interpolated((self.a, self.b), self.row, levels), rows, levels, before)
        certified, error = self.curve.certify_all(found)
        if error:
            raise error
        points = CurvePoints.of(certified)
        if kind == "family":
            return np.where(points.orbits.column("family") == self.a.point.family, 1.0, -1.0)
        return self.tests[kind](self.curve, points)

    def point_at(self, value: float) -> CurvePoint:
        """The point where the parameter has exactly a value, certified."""
        if self.b.value == value:
            return self.b
        share = (value - self.a.value) / (self.b.value - self.a.value)
        try:
            near = self(float(np.clip(share, INSIDE, 1 - INSIDE)))
            guess = near.x + near.tangent * (value - near.value) / near.tangent[-1]
            near = self._correct(guess, np.eye(len(guess))[-1], value)
        except NoOrbit:
            if (at_value := self.zero(lambda point: point.value - value)) is None:
                raise
            near = self(at_value)  # near a fold the value does not determine the orbit, but its share of the chord does
        return self.curve.certify_at(near, value)

    def events(self, requested: tuple[float, ...], watch: Watch) -> list[tuple[str, CurvePoint]]:
        """The events by kind and point, in order along the curve; with the `requested` values of the parameter."""
        if not self.may_happen(self.curve, self.a, [self.b], requested, watch).any():
            return []
        located = [(kind, share, self.curve.certify(point)) for kind, share, point in self._sign_changes(watch)]
        turns = [0.0, *([] if self.fold is None else [self.fold]), 1.0]
        for (low, high), part in zip(pairwise(turns), self.sheets(), strict=True):
            for value in part._passed(requested):
                share = low + (high - low) * (value - part.a.value) / (part.b.value - part.a.value)
                located.append(("value", share, part.point_at(value)))
        return [(kind, point) for kind, _, point in sorted(located, key=lambda event: event[1])]

    def _sign_changes(self, watch: Watch) -> Iterator[tuple[str, float, CurvePoint]]:
        """The kinds of events whose test functions change their sign, with share and point."""
        if self.fold is not None:
            yield "fold", self.fold, self(self.fold)
        if branch := self._branch_point():
            yield "branch point", *branch
        for kind in ("family", *self.tests, *watch):
            share = self.jump(kind) if kind in SIGNS_ALONE else self.zero(partial(self._test, kind, watch))
            if share is not None:
                point = self(share)
                if kind not in CROSSINGS or is_crossing(kind, self.curve.others(CurvePoints.of([point]))[0]):
                    yield kind, share, point

    def _branch_point(self) -> tuple[float, CurvePoint] | None:
        """The share and point of a branch point; its error is measured without the Jacobian's singular direction."""
        if (share := self.zero(lambda point: point.branch_test, BRANCH_OFFSET)) is None:
            return None
        beside, start = [self(share + side * BRANCH_OFFSET) for side in (-2, -1, 1, 2)], float(self.row @ self.a.x)
        tests = np.vander([point.branch_test for point in beside], increasing=True)
        share = float(np.linalg.solve(tests, np.array([self.row @ point.x - start for point in beside]))[0])
        (x,) = interpolated(beside, self.row, np.array([start + share]))
        evaluation, size = self.curve.evaluate(x[None]), self.curve.size(x)
        u, s, v = np.linalg.svd(evaluation.jacobian[0] * size)
        s[-1] = s[0]
        evaluation = replace(evaluation, jacobian=((u * s) @ v[: len(s)] / size)[None])
        tangent = beside[1].tangent + beside[2].tangent
        return share, CurvePoint(x, tangent / np.linalg.norm(tangent / size), 0.0, evaluation, 0)

    def _passed(self, values: tuple[float, ...]) -> list[float]:
        low, high = sorted((self.a.value, self.b.value))
        return [value for value in values if low < value < high]

    def _test(self, kind: str, watch: Watch, point: CurvePoint) -> float | None:
        """The test function of an event, at a point that is certified first."""
        point = self.curve.certify(point)
        if kind == "family":
            return 1.0 if point.point.family == self.a.point.family else -1.0
        if kind in self.tests:
            value = self.tests[kind](self.curve, CurvePoints.of([point])).item()
            return None if value == NONE else value
        return watched(kind, watch[kind], self.curve.orbit(point))

    @classmethod
    def _test_signs(cls, curve: Curve, points: CurvePoints) -> np.ndarray:
        """The signs (m, k) of the test functions of points, and their families."""
        signs = [(values >= 0) & (values != NONE) for values in cls._test_values(curve, points)]
        signs += [points.tangents[:, -1] >= 0, points.branch_tests >= 0, points.orbits.column("family")]
        return np.array(signs).T

    @classmethod
    def _test_values(cls, curve: Curve, points: CurvePoints) -> list[np.ndarray]:
        """The values (m,) of each test function at points."""
        return [test(curve, points) for test in cls.tests.values()]


def _test_of_crossing(kind: str, curve: Curve, points: CurvePoints) -> np.ndarray:
    """The test function of a crossing of the unit circle by multipliers."""
    return CROSSINGS[kind](curve.others(points))


class SearchedSegment(Segment):
    """A segment that is searched for events whatever its ends say."""

    @classmethod
    def may_happen(
        cls, curve: Curve, before: CurvePoint, points: Sequence[CurvePoint], requested: tuple[float, ...], watch: Watch
    ) -> np.ndarray:
        return np.ones(len(points), bool)


class CrossingSegment(Segment):
    """The same with the crossings of the unit circle by multipliers among the events."""

    tests: Mapping[str, TestFunction] = {
        **TEST_FUNCTIONS,
        **{kind: partial(_test_of_crossing, kind) for kind in CROSSINGS},
    }

    @classmethod
    def _test_values(cls, curve: Curve, points: CurvePoints) -> list[np.ndarray]:
        others = curve.others(points)  # once for all crossings
        return [test(curve, points) for test in TEST_FUNCTIONS.values()] + [test(others) for test in CROSSINGS.values()]


def watched(name: str, function: Callable[[Orbit], float | bool | None], orbit: Orbit) -> float | None:
    """A watched quantity of an orbit; None where the function returns None, divides by zero or requests a quantity that
    the orbit does not have. A truth value counts as 1 or -1. Raises `InputError` when it is not a number."""
    try:
        value = function(orbit)
    except (OrbitsError, ZeroDivisionError):
        return None
    if isinstance(value, bool | np.bool_):
        return 1.0 if value else -1.0
    try:
        return None if value is None else finite_number(name, value)
    except InputError:
        place = f"at alpha = {orbit.alpha:.6g}{f' {orbit.scales.text(LIFTOFF_SPEED)}' if orbit.scales else ''}"
        raise InputError(f"watch '{name}' gives {value!r} {place}: it must give a finite number") from None
