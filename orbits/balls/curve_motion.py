"""Motions of all orbits of a piece of a curve together, as Taylor models in time and along the piece.

The orbits are known by their place s on the piece, -1 <= s <= 1. At a few values of s the motion and its variational
equations are followed in rounded numbers; p(t, s) and P(t, s) are the polynomials through these, P(0, s) being about 1.
A motion of x' = f(x) is then sought as x = p + P c, and its derivative by the start as P (1 + C):

    c' = P^-1 (f(p) - p' + (J P - f_x(p) P) c + (f_x(p) P - P') c),    C' = P^-1 (f_x(x) P - P')(1 + C),

with J in f_x over the segment from p to x. Let d and G bound f(p) - p' and f_x(p) P - P', both found as Taylor models,
N bound P^-1, and B the change of f_x P over the tube |x - p| <= |P| g, which is at most its derivative by x, times that
radius. If for each s

    c0 + h N (d + (B + G) g) < g,    C0 + h N (B + G)(1 + H) < H    in each component,

then the motion exists for the time h of a step with |c| < g and |C| < H: at a first time of leaving these bounds the
estimate would hold. However wide the piece, this is small. A step begins with P(0, s) = Q, a rounded orthogonal matrix
that turns with the motion (R. Lohner's method, as in `enclosure`): at its end the deviation P c is Q' c' with
c' = Q'^-1 P c, and the derivatives by the start of the motion are Q E with models E, which become Q'^-1 P (1 + C) E.
Where the polynomials of the next step differ from these at its beginning, c changes by P^-1 times the difference.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from flint import arb, arb_mat, arb_poly, arb_series

from ..exact import Unproved, check_proof_time
from .enclosure import TOO_LONG, Passage, Piece, Variation, orthogonal_frame
from .rigorous_step import Step, picard_coefficients, widened, with_few_digits
from .taylor_model import ALL_PLACES, ALL_TIMES, CURVES, TaylorModel, as_model

_ZERO_BALL = arb(0)


class SpreadTooFar(Unproved):
    """The motions of starts within wide spreads are not enclosed; those of narrower ones may be."""


@lru_cache(maxsize=1)
def places() -> tuple[float, ...]:
    """The places between -1 and 1 at which polynomials interpolate: zeros of a Chebyshev polynomial."""
    count = CURVES.curve_degree + 1
    return tuple((-np.cos(np.pi * (np.arange(count) + 0.5) / count)).tolist())


@lru_cache(maxsize=1)
def _through_places() -> arb_mat:
    """The matrix from the values at the places to the coefficients of the polynomial."""
    return arb_mat([[arb(s) ** j for j in range(CURVES.curve_degree + 1)] for s in places()]).inv().mid()


def coefficients_through(rows: arb_mat) -> arb_mat:
    """Coefficients (degrees, m), rounded, of polynomials in s through values (places, m)."""
    return (_through_places() * rows).mid()


@dataclass(frozen=True)
class CurveStep:
    """A proved step of length h that begins at a time; the models take t from 0 to 1 in it.

    models : of the n states, p
    derivatives : (m, n) models, the first rows of P
    off : for each set of starts the bounds (n,) of c, g
    turned : (m, n) bounds H of C on the last set of starts, its first rows
    carried : (m, n) models, the first rows of E
    """

    begins: arb
    h: arb
    models: list[TaylorModel]
    derivatives: list[list[TaylorModel]]
    off: list[np.ndarray]
    turned: np.ndarray
    carried: list[list[TaylorModel]]

    def radii(self, number: int) -> list[arb]:
        """Bounds (n,) on the distance of the states of a set of starts from the models."""
        off, sizes = self.off[number], np.array([[each.polynomial_bound for each in row] for row in self.derivatives])
        return [each.abs_upper() for each in (*(sizes @ off), *off[len(sizes) :])]

    def states(self, number: int) -> list[TaylorModel]:
        """The states at the end, of a set of starts."""
        ends = (model.at_end() for model in self.models)
        return [TaylorModel(end.parts, radius) for end, radius in zip(ends, self.radii(number), strict=True)]

    def turned_derivatives(self) -> list[list[TaylorModel]]:
        """P (1 + C) at the end, its first rows (m, n), on the last set of starts."""
        m = len(self.derivatives)
        sizes = np.array([[each.polynomial_bound for each in row[:m]] for row in self.derivatives])
        rests = sizes @ self.turned
        return [
            [TaylorModel(each.at_end().parts, rest.abs_upper()) for each, rest in zip(*both, strict=True)]
            for both in zip(self.derivatives, rests, strict=True)
        ]

    def slopes(self) -> list[list[TaylorModel]]:
        """The derivatives (m, n) of the moving states at the end by the start of the motion, on the last set of
        starts."""
        turned, m, found = self.turned_derivatives(), len(self.derivatives), list[list[TaylorModel]]()
        for row in turned:
            entries = [TaylorModel([])] * m + row[m:]
            for j in range(len(row)):
                for k in range(m):
                    entries[j] = entries[j] + row[k] * self.carried[k][j]
            found.append(entries)
        return found

    def on(self, s: arb) -> Step:
        """The step of the last set of starts for all places of a ball."""
        polynomials = [
            arb_poly([each / self.h**i for i, each in enumerate(model.in_time(s).coeffs())]) for model in self.models
        ]
        return Step(self.h, polynomials, self.radii(-1))


def passage_on(steps: Sequence[CurveStep], s: arb) -> Passage:
    """The motions of the last set of starts for all places of a ball, as one passage."""
    pieces = [Piece(step.begins, step.on(s), (0,)) for step in steps]
    end = pieces[-1].step.end()
    return Passage(pieces, pieces[0].step.at(arb(0)), end, end, arb_mat(0, 0))


def follow_curve(
    variation: Variation, starts: Sequence[TaylorModel], spreads: Sequence[Sequence[arb]]
) -> list[CurveStep]:
    """The steps from the time 0 to 1 of the motions that start within spreads (sets, n) of the polynomials of models
    (n,), whose last one is the widest; raises `Unproved`."""
    m, n = variation.moving, variation.size
    system, left = variation.varied[0], arb(1)
    frame = arb_mat(m, m, [int(i == j) for i in range(m) for j in range(m)])
    carried = [[TaylorModel.of_curve([arb(int(i == j))]) for j in range(n)] for i in range(m)]
    centres = [[start.on(arb(s)).mid() for start in starts] for s in places()]
    before, off, steps = list(starts), [np.array(each) for each in spreads], list[CurveStep]()
    while True:
        if len(steps) == CURVES.steps:
            raise Unproved(TOO_LONG)
        check_proof_time()
        unit = [each for row in frame.tolist() for each in (*row, *[_ZERO_BALL] * (n - m))]
        rows = [
            [[each.mid() for each in row] for row in picard_coefficients(system, [*centre, *unit], CURVES.time_degree)]
            for centre in centres
        ]
        begin = [*before, *(TaylorModel.of_curve([each]) for each in unit)]
        h = _step_length(rows, left)
        for _ in range(CURVES.halved_steps):
            step = _proved_step(variation, _models_through(rows, h), begin, off, carried, 1 - left, h)
            if step is not None:
                break
            h = h / 2
        else:
            raise SpreadTooFar("the motions along a piece of the curve spread too far to be enclosed")
        steps.append(step)
        if not h < left:
            return steps
        centres = [[arb_poly(row)(h).mid() for row in table[:n]] for table in rows]
        before, left = [each.at_end() for each in step.models], left - h
        frame, off, carried = _turned_frame(step)


def _turned_frame(step: CurveStep) -> tuple[arb_mat, list[np.ndarray], list[list[TaylorModel]]]:
    """The orthogonal matrix of the next step, with the bounds of c and the models E in it."""
    m = len(step.derivatives)
    ends = [[each.at_end() for each in row] for row in step.derivatives]
    extents = [float(each) for each in step.off[-1][:m]]
    frame, inverse = orthogonal_frame(arb_mat([[each.on(_ZERO_BALL) for each in row[:m]] for row in ends]), extents)
    turned = np.array([[each.bound for each in row] for row in _number_times_models(inverse, ends)])
    off = [_upper(np.array([*(turned @ each), *each[m:]])) for each in step.off]
    return frame, off, _number_times_models(inverse, step.slopes())


def _number_times_models(matrix: arb_mat, models: Sequence[Sequence[TaylorModel]]) -> list[list[TaylorModel]]:
    """The product of a matrix of numbers (m, m) and one of models (m, n)."""
    found = list[list[TaylorModel]]()
    for weights in matrix.tolist():
        row = [TaylorModel([])] * len(models[0])
        for weight, others in zip(weights, models, strict=True):
            row = [each + other * weight for each, other in zip(row, others, strict=True)]
        found.append(row)
    return found


def _step_length(rows: Sequence[list[list[arb]]], left: arb) -> arb:
    """A guess of the length of a step that suits the first, the middle and the last orbit."""
    share = 0.0
    for table in (rows[0], rows[len(rows) // 2], rows[-1]):
        size = max(abs(float(each)) for row in table for each in row[:2])
        last = max(abs(float(each)) for row in table for each in row[-2:])
        share = max(share, last / size)
    length = CURVES.shorter * (CURVES.accuracy / share) ** (1 / CURVES.time_degree) if share > 0 else np.inf
    if not np.isfinite(share):
        raise Unproved("the motion reaches a place where a law has no value")
    if not length < float(left):
        return left
    return with_few_digits(float(left) / np.ceil(float(left) / length))


def _models_through(rows: Sequence[list[list[arb]]], h: arb) -> list[TaylorModel]:
    """The polynomials in t and s, for t from 0 to 1 in a step of length h, through those in time at the places."""
    length, powers = CURVES.time_degree + 1, [h**i for i in range(CURVES.time_degree + 1)]
    flat = [[each * power for row in table for each, power in zip(row, powers, strict=True)] for table in rows]
    coefficients, models = coefficients_through(arb_mat(flat)).tolist(), list[TaylorModel]()
    for i in range(len(rows[0])):
        columns = [each[i * length : (i + 1) * length] for each in coefficients]
        models.append(TaylorModel([arb_series(column, length) for column in columns]))
    return models


def _proved_step(
    variation: Variation, both: list[TaylorModel], before: Sequence[TaylorModel], off: Sequence[np.ndarray],
    carried: list[list[TaylorModel]], begins: arb, h: arb,
) -> CurveStep | None:  # fmt: skip
    """A step with models of the states and of their derivatives; None where it cannot be proved."""
    m, n = variation.moving, variation.size
    models, derivatives = both[:n], [both[n + i * n : n + (i + 1) * n] for i in range(m)]
    rates = map(as_model, variation.varied[0].rates(both))
    defect, of_derivatives = _by_moving_state(
        [(rate * h - each.slope_in_time()).bound for each, rate in zip(both, rates, strict=True)], m, n
    )
    gap, gap_of_derivatives = _by_moving_state([_gap(old, new) for old, new in zip(before, both, strict=True)], m, n)
    inverse = _inverse_bound([row[:m] for row in derivatives])
    if inverse is None or not all(each.is_finite() for each in (*defect, *of_derivatives.flat)):
        return None
    sizes = np.array([[each.polynomial_bound for each in row] for row in derivatives])
    found, change = list[np.ndarray](), of_derivatives
    for each in off:
        start = each + gap
        start[:m] = each[:m] + inverse @ (gap[:m] + gap_of_derivatives @ each + sizes[:, m:] @ gap[m:])
        tube = start.copy()
        for _ in range(CURVES.widenings):
            tube[:m] = CURVES.wider * tube[:m] + CURVES.thinnest
            change = of_derivatives + h * _change(variation, both, [*(sizes @ tube), *tube[m:]])
            grown = start[:m] + inverse @ (defect[:m] + change @ tube)
            done = all(a < b for a, b in zip(grown, tube[:m], strict=True))
            tube[:m] = grown
            if done:
                break
        else:
            return None
        found.append(_upper(tube))
    begun = inverse @ gap_of_derivatives
    after = begun.copy()
    for _ in range(CURVES.widenings):
        after = CURVES.wider * after + CURVES.thinnest
        grown = begun + inverse @ (change + change[:, :m] @ after)
        if all(a < b for a, b in zip(grown.flat, after.flat, strict=True)):
            return CurveStep(begins, h, models, derivatives, found, _upper(grown), carried)
        after = grown
    return None


def _upper(bounds: np.ndarray) -> np.ndarray:
    """Bounds as exact numbers, without radii of their own."""
    return np.array([each.abs_upper() for each in bounds.flat]).reshape(bounds.shape)


def _gap(old: TaylorModel, new: TaylorModel) -> arb:
    """A bound on the distance of a model's polynomial at its beginning from another one."""
    first = TaylorModel([arb_series(part.coeffs()[:1], CURVES.time_degree + 1) for part in new.parts])
    return (TaylorModel(old.parts) - first).bound


def _by_moving_state(bounds: Sequence[arb], m: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounds (n,) of the states, and (m, n) of the derivatives of the moving ones."""
    return np.array(bounds[:n]), np.array(bounds[n:]).reshape(m, n)


def _change(variation: Variation, both: Sequence[TaylorModel], radii: Sequence[arb]) -> np.ndarray:
    """Bounds (m, n) on the change of the derivatives of the rates, times P, within radii (n,) of the models."""
    n, system = variation.size, variation.varied[0]
    inside = [each.on(ALL_PLACES) for each in both]
    inside[:n] = [widened(value, radius) for value, radius in zip(inside[:n], radii, strict=True)]
    found = np.array([[_ZERO_BALL] * n for _ in range(variation.moving)])
    for (row, column), slope in zip(system.places, system.slopes(inside), strict=True):
        if row >= n and column < n:
            found[divmod(row - n, n)] += slope.abs_upper() * radii[column]
    return found


def _inverse_bound(block: Sequence[Sequence[TaylorModel]]) -> np.ndarray | None:
    """Bounds (m, m) of the inverse of a matrix of models at all times, found on parts of the piece; None where one is
    not regular."""
    m, found, left = len(block), [_ZERO_BALL] * len(block) ** 2, CURVES.singular_parts
    waiting = [
        (s, t)
        for s in _equal_parts(ALL_PLACES, CURVES.parts_of_curve)
        for t in _equal_parts(ALL_TIMES, CURVES.parts_of_time)
    ]
    while waiting:
        s, t = waiting.pop()
        matrix = arb_mat([[each.on(s, t) for each in row] for row in block])
        try:
            sizes = [each.abs_upper() for row in matrix.inv().tolist() for each in row]
        except ZeroDivisionError:
            sizes = [arb("inf")]
        if all(each.is_finite() for each in sizes):
            found = [a.max(b) for a, b in zip(found, sizes, strict=True)]
            continue
        left -= 1
        if left == 0:
            return None
        waiting += [(part, t) for part in _equal_parts(s, 2)]
    return np.array(found).reshape(m, m)


def _equal_parts(ball: arb, count: int) -> list[arb]:
    """Parts of a ball, equally long."""
    low, high = ball.lower(), ball.upper()
    ends = [low + (high - low) * k / count for k in range(count + 1)]
    return [a.union(b) for a, b in itertools.pairwise(ends)]
