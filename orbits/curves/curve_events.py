"""Events between neighbouring points of curves, located on the curves themselves.

Where the gradient of a test is known, its event takes the place of the length in Newton's method. Else a root of the
test is searched along the chord, for all segments and tests together.
"""

from collections.abc import Generator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..numerics import root_search, through
from .bordered_newton import Border, correct
from .protocol import ASKS, Array, Points, Problem, Test
from .step_options import Steps

# An event may lie this share of the chord outside of it, by the rounding of points.
OUTSIDE = 1e-9
# A cubic between points nearer than this share of the chord divides rounding by small differences.
CLOSE = 1e-3
# Points from which an event with singular equations is interpolated, in distances from it.
SIDES = np.array([-2.0, -1.0, 1.0, 2.0])
# These distances shrink once the event is known nearly: the error falls as their fourth power.
NEARER = np.array([1.0, 0.1])
# There the function is 0 up to this share of its values at the nearer points; it is not at a jump or in noise.
ZERO = 1e-2
Column = tuple[Test, int]


class Found(NamedTuple):
    """What happens on a segment: its number, the share of the chord, the kind, the point (1), which is None for the end
    of the segment, and the test and the number of its function; None for what the run itself looks for."""

    segment: int
    share: float
    kind: str
    point: Points | None
    test: Test | None = None
    which: int = 0


class Segments(NamedTuple):
    """Segments (q,) between neighbouring points of curves.

    a, b : their ends (q, n + 1)
    tangents, tangents_b : the tangents there (q, n + 1)
    """

    lanes: Array
    a: Array
    b: Array
    tangents: Array
    tangents_b: Array

    def only(self, which: Any) -> "Segments":
        """The segments with some indices."""
        return Segments(*(each[which] for each in self))

    def rows(self, problem: Problem) -> Array:
        """The rows (q, n + 1) that measure shares of the chords."""
        size = problem.size(self.lanes, self.a)
        chords = (self.b - self.a) / size
        return chords / (chords * chords).sum(1)[:, None] / size

    def at(self, problem: Problem, shares: Array, near: "Segments | None" = None) -> tuple[Array, Border]:
        """Places (q, n + 1) at shares (q,) of the chords, and the borders there, interpolated between the ends, or
        between those of parts of the segments."""
        ends, rows = near or self, self.rows(problem)
        xs, tangents = (np.stack(pair, axis=1) for pair in ((ends.a, ends.b), (ends.tangents, ends.tangents_b)))
        levels = (rows * self.a).sum(1) + shares
        return through(xs, tangents, np.ones(xs.shape[:2]), 1, rows, levels)[0], Border(rows, levels)

    def points(
        self, problem: Problem, shares: Array, options: Steps, *, near: "Segments | None" = None, bare: bool = False,
        least: int = 1,
    ) -> tuple[Array, Points]:  # fmt: skip
        """The points at shares (q,) of the chords, certified if not bare, with the indices (k,) of their segments."""
        guesses, border = self.at(problem, shares, near)
        record = problem.renews or (problem.records and not bare)
        found = correct(problem, self.lanes, guesses, border, self.tangents, options, least=least, record=record)
        return found if bare else certified(problem, *found)

    def share(self, problem: Problem, points: Points) -> Array:
        """The shares (q,) of the chords at which points (q) lie."""
        return (self.rows(problem) * (points.xs - self.a)).sum(1)


def certified(problem: Problem, which: Array, points: Points) -> tuple[Array, Points]:
    """The points that the problem certifies, with their indices."""
    if not len(points):
        return which, points
    points, errors = problem.certify(points)
    sound = np.array([i for i in range(len(points)) if i not in errors], int)
    return (which[sound], points[sound]) if errors else (which, points)


def solved_at(problem: Problem, lanes: Array, xs: Array, border: Border, onward: Array, options: Steps) -> Points:
    """The certified points at a border near places (m, n + 1), fewer where some are not found, with tangents that have
    acute angles with vectors `onward` (m, n + 1)."""
    which, points = correct(problem, lanes, xs, border, onward, options)
    return certified(problem, which, points.having(lengths=np.zeros(len(points))))[1]


def values_of(problem: Problem, points: Points) -> tuple[list[Column], Array]:
    """All functions of all tests (c,), and their values (m, c) at points (m)."""
    parts = [np.reshape(test.values(problem, points), (len(points), -1)) for test in problem.tests]
    columns = [(test, k) for test, part in zip(problem.tests, parts, strict=True) for k in range(part.shape[1])]
    return columns, np.concatenate([np.empty((len(points), 0)), *parts], axis=1)


def changes(tests: Sequence[Test], before: Array, behind: Array) -> Array:
    """Where something may happen (q, c) on segments, by the values (q, c) of the functions of tests (c,) at both ends:
    a function changes its sign, or its value where this is a label, or is negative at the end where it asks."""
    asks = np.array([test.does == ASKS for test in tests], bool)
    labels = np.array([test.places > 1 for test in tests], bool)
    differ = np.where(labels, before != behind, (before >= 0) != (behind >= 0)) & np.isfinite(before + behind)
    return np.where(asks, behind < 0, differ)


def located(
    problem: Problem, columns: Sequence[Column], segments: Segments, before: Array, behind: Array, options: Steps
) -> list[Found]:
    """The events on segments (q,) at whose ends the tests have values (q, c), in order along each segment. An event
    that cannot be located is at the end of its segment."""
    found, searches = list[Found](), dict[tuple[int, int], _Search]()
    for q, c in np.argwhere(changes([test for test, _ in columns], before, behind)).tolist():
        (test, number), own = columns[c], segments.only([q])
        ends = float(before[q, c]), float(behind[q, c])
        if test.does == ASKS:
            found.append(Found(q, 1.0, test.kind, None, test, number))
        elif test.gradient and (at_once := _at_once(problem, test, number, own, ends, options)):
            found.append(Found(q, at_once[0], test.kind, at_once[1], test, number))
        else:
            searches[q, c] = _Search(test, number, own, ends, options)
    run_searches(problem, [*searches.values()], options)
    for (q, c), search in searches.items():
        if result := search.result(problem, options):
            found.append(Found(q, result[0], search.test.kind, result[1], *columns[c]))
    sure = list[Found]()
    for each in sorted(found, key=lambda each: (each.segment, each.share)):
        confirm, kind = each.test.confirmed if each.test else None, each.kind
        name = confirm(problem, each.point, each.which) if confirm and each.point is not None else kind
        sure += [each._replace(kind=name)] if name else []
    return sure


class _Search:
    """The search for a zero of a function of a test on a segment (1), at whose ends it has these values."""

    def __init__(self, test: Test, number: int, segment: Segments, ends: tuple[float, float], options: Steps):
        self.test, self.number, self.segment, self.ends = test, number, segment, ends
        self.width = options.width
        width = test.beside or options.width
        of_labels, by_secants = _label_search(ends[0], test.places, width), _root_search(ends, width)
        self.steps = of_labels if test.places > 1 else by_secants
        self.wanted, self.share, self.failed = np.empty(0), np.nan, False
        try:
            self.wanted = next(self.steps)
        except StopIteration as end:  # the function is 0 at an end
            self.share = end.value
        a, b, t, s = (each[0] for each in segment[1:])
        self.known = [(0.0, a, t), (1.0, b, s)]

    @property
    def goes_on(self) -> bool:
        """Whether more points are wanted."""
        return bool(np.isnan(self.share)) and not self.failed

    def near(self, share: float) -> Segments:
        """The part of the segment between the two known points on either side of a share; between close points it is
        the tangent at the nearer one."""
        i = next((i for i, (other, *_) in enumerate(self.known) if other >= share and i), len(self.known) - 1)
        (low, a, t), (high, b, s) = self.known[i - 1 : i + 1]
        if high - low < CLOSE:
            a, t, b, s = (a, t, a + t, t) if share - low < high - share else (b - s, s, b, s)
        return Segments(self.segment.lanes, *(each[None] for each in (a, b, t, s)))

    def values(self, problem: Problem, points: Points) -> Array:
        """The values (m,) of the function at points (m)."""
        return np.reshape(self.test.values(problem, points), (len(points), -1))[:, self.number]

    def go_on(self, problem: Problem, shares: Array, points: Points) -> None:
        """Take the points found at shares (k,), fewer than wanted where some are not found."""
        if len(points) < len(self.wanted):
            # Singular equations have no solution at the event itself, which the search then has reached.
            if len(self.wanted) > 1:  # one of them may be a place that bisection does not need
                self.steps = _label_search(self.ends[0], 1, self.test.beside or self.width)
                self.wanted = next(self.steps)
                return
            self.failed, self.share = not self.test.beside, float(self.wanted[0]) if self.test.beside else np.nan
            return
        new = zip(shares.tolist(), points.xs, points.tangents, strict=True)
        known = {share: (share, x, t) for share, x, t in [*self.known, *new]}
        self.known = [known[share] for share in sorted(known)]
        try:
            self.wanted = self.steps.send(np.nan_to_num(self.values(problem, points)))
        except StopIteration as end:
            self.share = end.value

    def result(self, problem: Problem, options: Steps) -> tuple[float, Points | None] | None:
        """The share and the point of the zero; None where the function has a pole instead; share 1 without a point
        where points on the way are not found."""
        if self.failed:
            return 1.0, None
        if self.test.beside:
            return self._interpolated(problem, self.share, options)
        which, point = self.segment.points(problem, np.array([self.share]), options, near=self.near(self.share))
        if not len(which):
            return 1.0, None
        # A pole changes the sign too, with values larger than those at the ends.
        pole = self.test.places == 1 and abs(self.values(problem, point)[0]) > abs(self.ends[0]) + abs(self.ends[1])
        return None if pole else (self.share, point)

    def _interpolated(self, problem: Problem, share: float, options: Steps) -> tuple[float, Points | None] | None:
        """The share and the point at which the equations are singular, from points near it, without the point where
        some of these are not found; None where the function is not monotonic there, as at a pole or in noise."""
        segment, row = self.segment, self.segment.rows(problem)
        four = segment.only(np.zeros(4, int))
        for distance in self.test.beside * NEARER:
            which, beside = four.points(problem, share + distance * SIDES, options, least=options.settled)
            if len(which) < 4:
                return 1.0, None
            values = self.values(problem, beside) * np.sign(self.ends[1] - self.ends[0])
            if not (np.diff(values) > 0).all() or not values[0] < 0 < values[-1]:
                return None
            # The place is a polynomial of the value, whose constant term is the place of the zero.
            powers = np.vander(values / values[-1], increasing=True)
            share += distance * float(np.linalg.solve(powers, SIDES)[0])
        level = (row * segment.a).sum(1) + share
        x, _ = through(beside.xs[None], beside.tangents[None], np.ones((1, 4)), 2, row, level)
        tangent = beside.tangents[1] + beside.tangents[2]
        tangent /= np.linalg.norm(tangent / problem.size(segment.lanes, x)[0])
        able, evaluation = problem.evaluate(segment.lanes, x, None, np.zeros(1))
        point = Points(segment.lanes, x, tangent[None], beside.growths[:1], evaluation, np.zeros(1, int))
        if not len(able) or abs(self.values(problem, point)[0]) > ZERO * abs(values[1:3]).min():
            return None
        _, point = certified(problem, able, problem.regular(point))
        return (share, point) if len(point) else None


def run_searches(problem: Problem, searches: Sequence[_Search], options: Steps) -> None:
    """Searches on segments, all together: in each round the points that they want are solved in one call, those of bare
    tests in another one."""
    while going := [each for each in searches if each.goes_on]:
        for bare in (False, True):
            own = [each for each in going if each.test.bare == bare]
            if not own:
                continue
            shares = np.concatenate([each.wanted for each in own])
            of = np.repeat(np.arange(len(own)), [len(each.wanted) for each in own])
            near = _joined([own[i].near(share) for i, share in zip(of, shares.tolist(), strict=True)])
            whole = _joined([own[i].segment for i in of])
            which, points = whole.points(problem, shares, options, near=near, bare=bare)
            for i, each in enumerate(own):
                these = np.flatnonzero(of[which] == i)
                each.go_on(problem, shares[which[these]], points[these])


def _joined(parts: Sequence[Segments]) -> Segments:
    return Segments(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _root_search(ends: tuple[float, float], width: float) -> Generator[Array, Array, float]:
    """`root_search` of a share of a segment with values at its ends; places and values are arrays (1,)."""
    search = root_search(0.0, 1.0, *ends, width=width)
    try:
        share = next(search)
        while True:
            share = search.send(float((yield np.array([share]))[0]))
    except StopIteration as end:
        return float(end.value)


def _label_search(first: float, places: int, width: float) -> Generator[Array, Array, float]:
    """A search for the share at which a label changes for the first time, at several places (places,) at once."""
    low, high = 0.0, 1.0
    while high - low > width:
        shares = np.linspace(low, high, places + 2)
        changed = np.append((yield shares[1:-1]) != first, True)
        low, high = shares[changed.argmax()], shares[changed.argmax() + 1]
    return float(high)


def _at_once(
    problem: Problem, test: Test, number: int, segment: Segments, ends: tuple[float, float], options: Steps
) -> tuple[float, Points] | None:
    """The share and the point at which a function with a gradient vanishes on a segment (1); None where Newton's method
    leads elsewhere, or the gradient is not known."""
    gradient = test.gradient
    guess, border = segment.at(problem, np.array([ends[0] / (ends[0] - ends[1])]))

    def bends(which: Array, xs: Array, evaluation: Any) -> tuple[Array, Array]:
        known = gradient(problem, xs, evaluation, number) if gradient else None
        if known is None:
            return np.full(xs.shape, np.nan), np.full(len(xs), np.nan)
        return known[1], (known[1] * xs).sum(1) - known[0]

    border = border._replace(bends=bends)
    return inside(problem, segment, solved_at(problem, segment.lanes, guess, border, segment.tangents, options))


def inside(problem: Problem, segment: Segments, point: Points) -> tuple[float, Points] | None:
    """The share of a point (1) on a segment (1), and the point; None where there is none, or it lies elsewhere."""
    if not len(point):
        return None
    share = float(segment.share(problem, point)[0])
    return (min(max(share, 0.0), 1.0), point) if -OUTSIDE <= share <= 1 + OUTSIDE else None
