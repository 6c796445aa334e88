"""A piece of a curve of solutions, proved: for each value of one coordinate exactly one solution in a thin tube.

The equations F(X) = 0 have one unknown more than there are of them: X is the unknowns of a boundary value statement,
and the parameter. On a piece one of these, X_k, runs through an interval, X_k = c + d s with -1 <= s <= 1, and the
others are sought as p(s) + w with polynomials p. For each s, any matrix Y(s), and w in the box |w| <= W,

    K = -Y(s) F(p(s)) + (1 - Y(s) A) w,    A in F_w(p(s) + [-W, W]),

is Krawczyk's operator: if it is below W in absolute value, there is exactly one solution within W of p(s) for this s,
and it is within |K|. F, F_w and Y are Taylor models in s, so that all s are decided together. 1 - Y A is below 1 in a
norm, so that F_w is regular: by the implicit function theorem the solution is a smooth function of s. Its derivative
w' is that of F_w w' = -F_s with F_s = F_X p'(s), hence |w'| <= v where |Y F_s| + |1 - Y A| v <= v.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from flint import arb, arb_mat

from ..exact import Unproved
from .curve_motion import CurveStep, SpreadTooFar, coefficients_through, follow_curve, places
from .equations import BallLeg
from .taylor_model import CURVES, TaylorModel, as_model

Models = list[TaylorModel]
Matrix = list[Models]


@dataclass(frozen=True)
class CurveValues:
    """The equations along a piece.

    values : F on the polynomials, with the radii of the unknowns that are not solved for
    slopes : (equations, unknowns) F_X, on the whole tube
    steps : of each leg
    starts : of each leg, the states at the start on the whole tube
    """

    values: Models
    slopes: Matrix
    steps: list[list[CurveStep]]
    starts: list[Models]


def evaluate_curve(
    legs: Sequence[BallLeg], polynomials: Sequence[TaylorModel], inner: Sequence[arb], outer: Sequence[arb]
) -> CurveValues:
    """The equations of legs on polynomials for all of their unknowns: their values within the inner radii, and their
    derivatives within the outer ones."""
    points, boxes = ([TaylorModel(p.parts, r.abs_upper()) for p, r in zip(polynomials, radii, strict=True)]
                     for radii in (inner, outer))  # fmt: skip
    values, slopes, all_steps, starts = Models(), Matrix(), list[list[CurveStep]](), list[Models]()
    last = list[tuple[Models, Models]]()
    for leg in legs:
        if len(leg.rates) > 1:
            raise Unproved("the spring's law is in pieces, but a curve can be proved only for smooth laws")
        m, n, columns = leg.variation.moving, leg.variation.size, len(points)
        before = last[-1] if last else ([], [])
        starts_of_both = zip((points, boxes), before, strict=True)
        start = [[*map(as_model, leg.start([*each, *ends]))] for each, ends in starts_of_both]
        by_unknowns = _model_rows(leg.start_slopes([*boxes, *before[1]]), n)
        if not all(each.bound == 0 for row in by_unknowns for each in row[columns:]):
            raise Unproved("a phase must start from the end of the previous one")
        by_unknowns = [row[:columns] for row in by_unknowns]
        spreads = [[_spread_about(each, about) for each, about in zip(one, start[1], strict=True)] for one in start]
        steps = follow_curve(leg.variation, start[1], spreads)
        end, end_box = steps[-1].states(0), steps[-1].states(1)
        transition = steps[-1].slopes()
        all_steps.append(steps)
        starts.append(start[1])
        last.append((end[:m], end_box[:m]))
        if leg.count == 0:
            continue
        values += map(as_model, leg.conditions[0]([*points, *start[0][:m], *end[:m]]))
        inputs = [*boxes, *start[1][:m], *end_box[:m]]
        by_all = _model_rows(leg.condition_slopes[0](inputs), leg.count)
        end_slopes = model_product(transition, by_unknowns)
        whole = [row[:columns] for row in by_all]
        whole = model_sum(whole, model_product([row[columns : columns + m] for row in by_all], by_unknowns[:m]))
        slopes += model_sum(whole, model_product([row[columns + m :] for row in by_all], end_slopes))
    return CurveValues(values, slopes, all_steps, starts)


def _spread_about(model: TaylorModel, about: TaylorModel) -> arb:
    """A bound on the distance of the functions of a model from the polynomial of another one."""
    return (TaylorModel(model.parts) - TaylorModel(about.parts)).polynomial_bound + model.rest


def _model_rows(values: Sequence, rows: int) -> Matrix:
    count, models = len(values) // rows, [*map(as_model, values)]
    return [models[i * count : (i + 1) * count] for i in range(rows)]


def model_product(left: Matrix, right: Matrix) -> Matrix:
    """The product of matrices of models."""
    columns = [*zip(*right, strict=True)]
    return [[_sum_of_models([a * b for a, b in zip(row, column, strict=True)]) for column in columns] for row in left]


def model_sum(left: Matrix, right: Matrix) -> Matrix:
    """The sum of matrices of models."""
    return [[a + b for a, b in zip(one, other, strict=True)] for one, other in zip(left, right, strict=True)]


def _sum_of_models(models: Models) -> TaylorModel:
    found = TaylorModel([])
    for each in models:
        found = found + each
    return found


@dataclass(frozen=True)
class Tube:
    """A proved tube about polynomials.

    polynomials : (unknowns,) of all unknowns in s
    solved : which of them are solved for
    widths : (unknowns,) W, within which the solution is the only one for each s; 0 for unknowns not solved for
    radii : (unknowns,) within which it is; fixed for unknowns not solved for
    slopes : (unknowns,) bounds on the derivatives of w by s
    values : the equations on the tube
    """

    polynomials: Models
    solved: list[int]
    widths: list[arb]
    radii: list[arb]
    slopes: list[arb]
    values: CurveValues

    def at(self, i: int, s: arb) -> arb:
        """An enclosure of an unknown of the solutions at all places of a ball."""
        return self.polynomials[i].on(s) + arb(0, self.radii[i])

    def slope_at(self, i: int, s: arb) -> arb:
        """An enclosure of the derivative of an unknown of the solutions by s."""
        return self.polynomials[i].slope_on_curve().on(s) + arb(0, self.slopes[i])

    def holds(self, values: Sequence[arb], s: arb) -> bool:
        """Whether values (unknowns,) that are solved for are inside the tube, wherever in a ball their place is."""
        return all((values[i] - self.polynomials[i].on(s)).abs_upper() < self.widths[i] for i in self.solved)


def prove_tube(
    legs: Sequence[BallLeg], polynomials: Sequence[TaylorModel], solved: Sequence[int], fixed: Sequence[arb]
) -> Tube:
    """The tube about polynomials in which the equations of legs have solutions, for all values within `fixed` radii of
    the unknowns that are not solved for. Raises `Unproved`."""
    inner = [arb(0) if i in solved else fixed[i] for i in range(len(polynomials))]
    width, reason = CURVES.widest_tube, ""
    for _ in range(CURVES.tubes):
        outer = [arb(width) * (1 + p.polynomial_bound) if i in solved else fixed[i] for i, p in enumerate(polynomials)]
        try:
            return _tube(legs, polynomials, list(solved), inner, [each.abs_upper() for each in outer])
        except TooWide as error:
            width, reason = width * error.share, str(error)
        except SpreadTooFar as error:
            width, reason = width * CURVES.narrower_try, str(error)
    raise Unproved(reason)


class TooWide(Unproved):
    """A tube is too wide, and one of a share of its width may be proved."""

    def __init__(self, share: float):
        super().__init__("the curve is not proved to stay in a tube around its polynomials")
        self.share = share


def _tube(
    legs: Sequence[BallLeg], polynomials: Sequence[TaylorModel], solved: list[int], inner: Sequence[arb],
    outer: list[arb],
) -> Tube:  # fmt: skip
    found = evaluate_curve(legs, polynomials, inner, outer)
    slopes = [[row[i] for i in solved] for row in found.slopes]
    inverse = _inverse_along(slopes)
    off = [row[0].bound for row in model_product(inverse, [[each] for each in found.values])]
    n = range(len(solved))
    left = [[(as_model(arb(int(i == j))) - each).bound for j, each in enumerate(row)]
            for i, row in enumerate(model_product(inverse, slopes))]  # fmt: skip
    widths = [outer[i] for i in solved]

    def image(box: Sequence[arb]) -> list[arb]:
        return [(off[i] + sum((left[i][j] * box[j] for j in n), arb(0))).abs_upper() for i in n]

    radii = image(widths)
    if not all(radius < width for radius, width in zip(radii, widths, strict=True)):
        # The second term of the image is about quadratic in the width, and the first does not depend on it.
        needed = max(float(each / width) for each, width in zip(off, widths, strict=True))
        share = max(float((radius - each) / width) for radius, each, width in zip(radii, off, widths, strict=True))
        if not 4 * needed * share < 1:
            raise Unproved("the curve is not proved to stay in a tube around its polynomials")
        raise TooWide(0.5 / share)
    for _ in range(CURVES.narrowings):
        radii = image(radii)
    along = model_product(found.slopes, [[p.slope_on_curve()] for p in polynomials])
    moved = [row[0].bound for row in model_product(inverse, along)]
    drift = _drift(moved, left)
    widths_of_all, radii_of_all, drifts = [arb(0)] * len(outer), list(inner), [arb(0)] * len(outer)
    for position, i in enumerate(solved):
        widths_of_all[i], radii_of_all[i], drifts[i] = widths[position], radii[position], drift[position]
    return Tube(list(polynomials), solved, widths_of_all, radii_of_all, drifts, found)


def _drift(moved: Sequence[arb], left: Sequence[Sequence[arb]]) -> list[arb]:
    """A bound v with moved + left v <= v."""
    n = range(len(moved))
    floats = np.array([[float(each) for each in row] for row in left])
    guess = np.linalg.solve(np.eye(len(moved)) - 1.1 * floats, 1.1 * np.array([float(each) for each in moved]) + 1e-25)
    bound = [arb(float(each)) for each in guess]
    if not all(moved[i] + sum((left[i][j] * bound[j] for j in n), arb(0)) < bound[i] for i in n):
        raise Unproved("the direction of the curve is not enclosed")
    return bound


def _inverse_along(slopes: Matrix) -> Matrix:
    """Polynomials in s that approximate the inverse of a matrix."""
    n, rows = len(slopes), list[list[arb]]()
    for s in places():
        matrix = arb_mat([[each.on(arb(s)).mid() for each in row] for row in slopes])
        try:
            rows.append([each.mid() for row in matrix.inv().tolist() for each in row])
        except ZeroDivisionError:
            raise Unproved("the equations are singular on this piece") from None
    if not all(each.is_finite() for row in rows for each in row):
        raise Unproved("the equations are singular on this piece")
    columns = [*zip(*coefficients_through(arb_mat(rows)).tolist(), strict=True)]
    models = [TaylorModel.of_curve(column) for column in columns]
    return [models[i * n : (i + 1) * n] for i in range(n)]


def narrowed(legs: Sequence[BallLeg], tube: Tube) -> Tube:
    """A tube with derivatives on a narrower one about the solutions, and so with a better direction of the curve;
    the distance to other solutions is that of the first tube."""
    again = _tube(
        legs, tube.polynomials, tube.solved, [arb(0)] * len(tube.radii),
        [(CURVES.about_enclosure * radius + CURVES.thinnest_tube).abs_upper() for radius in tube.radii],
    )  # fmt: skip
    return replace(again, widths=tube.widths)
