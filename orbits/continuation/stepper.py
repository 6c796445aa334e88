"""Steps along a curve of orbits, with step-size control, and the points between their ends.

A step of length s along the unit tangent t from X0 is the solution of F(X) = 0, t . (X - X0) = s. It is predicted by
the Hermite interpolant of the last points and tangents. A correction that is large for the step may have led to another
curve, so a shorter step is tried. The curve is then solved at points between the ends of several steps, at least at one
in each step: the interpolant through the ends must lead to the curve there too.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate, groupby, pairwise
from operator import ge

import numpy as np

from ..errors import NoOrbit, OrbitsError
from .corrector import MEMORY, Counts, correct, correct_all, larger_counts, predict_and_correct
from .curve import Curve, CurvePoint, interpolated
from .predictor import around
from .step_control import Options

Points = Sequence[CurvePoint]


class Stepper:
    """Steps along a curve within bounds; `start` is the parameter's first value."""

    def __init__(self, curve: Curve, bounds: tuple[float, float], start: float, options: Options):
        self.curve, self.bounds, self.longest, self.control = curve, bounds, options.longest, options.step_control
        self.asked = np.array([value for value in options.at if value != start])

    def steps(self, ends: Points, length: float, batch_size: int) -> tuple[Points, float, OrbitsError | None]:
        """The ends of the next few steps, of about `batch_size` points, not certified yet; the length of the step after
        these; and the error that allows no further one."""
        new: list[CurvePoint] = []
        while sum(end.parts for end in new) < batch_size:
            try:
                end, length = self._step([*ends, *new][-MEMORY:], length, alone=batch_size == 1)
            except OrbitsError as error:
                return new, length, error
            new.append(end)
            inside = self.bounds[0] < end.value < self.bounds[1]
            if not inside or end.amplification > self.control.largest_amplification:
                break
        return new, length, None

    def _step(self, ends: Points, length: float, alone: bool) -> tuple[CurvePoint, float]:
        """The end of a step and the length of the next; a rejected step is halved. Raises the last one's reason."""
        failure: OrbitsError = NoOrbit("no step is short enough")
        last, rate = ends[-1], ends[-1].tangent[-1]
        bound = self.bounds[int(rate > 0)]
        while length > self.control.shortest_step:
            left = (bound - last.value) / rate if rate else np.inf
            try:
                if 0 < left <= length:
                    try:
                        return self._accepted(ends, length, left, alone, bound)
                    except OrbitsError:  # the curve turns before the bound, or passes it elsewhere
                        return self._accepted(ends, length, min(length, left + self.longest), alone)
                return self._accepted(ends, length, length, alone)
            except OrbitsError as error:
                failure, length = error, 0.5 * length
        try:
            return self._rescued(last), self.control.first_step
        except OrbitsError:
            raise failure from None

    def _accepted(self, ends: Points, planned: float, length: float, alone: bool, value: float | None = None):
        """The end of a step of given length, or of about that to a value of the parameter, and the length of the next;
        `planned` is the length that step-size control allowed. Raises `NoOrbit` for a rejected step."""
        control = self.control
        end, guess, rests = predict_and_correct(self.curve, ends, length, value)
        moved = self._correction(ends[-1], [end], guess[None], np.array([length]))
        parts = max(2, int(np.ceil(length / self.longest)))
        end = replace(end, length=length / parts, parts=parts)
        if alone:  # otherwise the points between the ends of several steps are solved together later
            self.points_between(ends, [end], 1)
        # The interpolant of k points with tangents has an error of order 2k in the step.
        ratio = (control.target_correction / max(moved * np.sqrt(end.amplification), 1e-300)) ** (1 / (2 * rests))
        ratio = min(max(control.safety * ratio, control.largest_shortening), control.largest_lengthening)
        return end, min(max(planned, length) * ratio, max(control.longest_step, self.longest))

    def _rescued(self, last: CurvePoint) -> CurvePoint:
        """The point a first step away, by Ipopt's multiple shooting at a fixed value of the parameter."""
        curve, length = self.curve, self.control.first_step
        row = last.tangent / curve.size(last.x) ** 2
        if abs(last.tangent[-1]) < self.control.steepest_rate * curve.span:
            raise NoOrbit("the parameter's value does not fix the orbit here")
        # Earlier points are left out of the prediction, since they may lie too close.
        guess = interpolated([last], row, np.array([row @ last.x + length]))
        u, _ = curve.equations.multiple_shooting(guess[0, :-1], curve.parameters_at(guess)[0])
        x, along_parameter = np.append(u, guess[0, -1]), np.eye(len(last.x))[-1]
        point = correct(curve, x, along_parameter, x[-1], last.tangent, last.counts)
        self._correction(last, [point], guess, np.array([length]))
        return replace(point, length=length, parts=1)

    def _correction(self, last: CurvePoint, points: Points, guesses, lengths) -> float:
        """The largest correction from guesses (m, n + 1) to points `lengths` (m,) apart; raises `NoOrbit` when that, or
        an angle between neighbouring tangents, is too large for one curve."""
        sizes = self.curve.size(guesses)
        moved = np.linalg.norm((np.array([point.x for point in points]) - guesses) / sizes, axis=1)
        tangents = np.array([point.tangent for point in (last, *points)])
        a, b = tangents[:-1] / sizes, tangents[1:] / sizes
        cosines = np.einsum("mi,mi->m", a, b) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
        turned = float(np.arccos(np.clip(cosines.min(), -1.0, 1.0)))
        if (moved > self.control.largest_correction * lengths).any() or turned > self.control.largest_turn:
            step = f"{moved.max():.1e} in a step of {lengths.min():.1e}"
            raise NoOrbit(f"the corrector moves {step}, the tangent turns by {turned:.2g}")
        return float(moved.max())

    def points_between(self, ends: Points, new: Points, batch_size: int) -> list[CurvePoint]:
        """The points of the steps from the last of `ends` to the `new` ends in turn, solved in few calls; raises
        `NoOrbit` when one of them may lie on another curve."""
        chain = [*ends[-self.control.neighbours :], *new]
        first = len(chain) - len(new) - 1
        steps, guesses, rows, levels = self._targets(chain, first, asked=batch_size > 1)
        tangents = np.array([point.tangent for point in chain[first:-1]])[steps]
        stops = np.searchsorted(steps, np.arange(len(new)), side="right").tolist()
        lengths = np.array([end.length for end in new])[steps].tolist()
        needed = [larger_counts(a.counts, b.counts) for a, b in pairwise(chain[first:])]
        counts = list(accumulate(reversed(needed), self._similar))[::-1]
        solved: list[CurvePoint] = []
        for _, group in groupby(range(len(new)), key=counts.__getitem__):
            *_, step = group
            if len(solved) < stops[step]:
                part = slice(len(solved), stops[step])
                places = guesses[part], rows[part], levels[part], tangents[part]
                solved += correct_all(self.curve, *places, counts[step], lengths[part])
        parts = zip([0, *stops], stops, new, strict=False)
        points = [point for start, stop, end in parts for point in (*solved[start:stop], end)]
        guesses = np.insert(guesses, stops, [end.x for end in new], axis=0)
        self._correction(ends[-1], points, guesses, np.array([point.length for point in points]))
        return points

    def _targets(self, chain: Points, first: int, asked: bool) -> tuple[np.ndarray, ...]:
        """Where the curve is solved between the points of a chain from `first` on, in order: the step (q,), and guess
        (q, n + 1), row (q, n + 1) and level (q,) as in `correct_all`; where `asked`, at the values asked for too."""
        xs, tangents = np.array([point.x for point in chain]), np.array([point.tangent for point in chain])
        side, n = self.control.neighbours, xs.shape[1]
        chords, places = np.diff(xs[first:], axis=0), np.arange(first + 1, len(chain))
        rows = chords / self.curve.size(xs[first:-1]) ** 2
        rows /= np.einsum("gi,gi->g", rows, chords)[:, None]
        starts, parts = np.einsum("gi,gi->g", rows, xs[first:-1]), np.array([end.parts for end in chain[first + 1 :]])
        steps = np.repeat(np.arange(len(parts)), parts - 1)
        shares = np.concatenate([np.arange(1, count) / count for count in parts])
        passed, values = self._passed(xs[first:, -1], tangents[first:, -1], self.asked if asked else self.asked[:0])
        along_parameter = np.tile(np.eye(n)[-1], (len(passed), 1))
        at_values, _ = around(xs, tangents, places[passed], side, side, along_parameter, values)
        taken = np.einsum("qi,qi->q", rows[passed], at_values) - starts[passed]
        crowded = np.abs(shares[:, None] - taken) * parts[steps][:, None] <= self.control.separation
        free = ~(crowded & (steps[:, None] == passed)).any(1)
        steps, shares = steps[free], shares[free]
        levels = starts[steps] + shares
        guesses, _ = around(xs, tangents, places[steps], side, side, rows[steps], levels)
        order = np.lexsort((np.append(shares, taken), np.append(steps, passed)))
        pairs = (steps, passed), (guesses, at_values), (rows[steps], along_parameter), (levels, values)
        return tuple(np.concatenate(pair)[order] for pair in pairs)

    @staticmethod
    def _passed(values: np.ndarray, rates: np.ndarray, asked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The steps (h,) on which the parameter, with these values and rates at their ends, passes a value asked for
        without turning round; and that value (h,)."""
        low, high = np.minimum(values[:-1], values[1:])[:, None], np.maximum(values[:-1], values[1:])[:, None]
        steps, which = np.nonzero((low < asked) & (asked < high) & (rates[:-1] * rates[1:] > 0)[:, None])
        return steps, asked[which]

    def _similar(self, later: Counts, counts: Counts) -> Counts:
        """Numbers of Taylor steps: those of the step after this one where they suffice here and are not many more, so
        that both are solved in one call."""
        if not later or not counts or not all(map(ge, later, counts)):
            return counts
        return later if sum(later) <= self.control.similar_counts * sum(counts) else counts
