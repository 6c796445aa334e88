"""One rigorous step of an autonomous system x' = f(x): a Taylor polynomial and a tube around it that is proved.

Let p be the Taylor polynomial of order K, about time 0, of the solution from the centre c. Its coefficients follow one
from another and are enclosed in balls. The defect f(p(t)) - p'(t) has no terms below t**K, so by Lagrange's form of the
remainder it is R t**K, where R is the coefficient of s**K in f(p(t + s)). Let E(t) bound the distance, component by
component, of a solution that starts within E0 of c. While it stays within e of p,

    E(t) <= E0 + integral of (|Df| e + |R| t**K) <= E0 + h |Df| e + |R| h**(K + 1)/(K + 1)   for 0 <= t <= h,

with |Df| taken over the tube p([0, h]) +- e, and |R| over p([0, h]). Where the right hand side is below e in every
component, no solution can leave the tube: one would do so at a first time, up to which the estimate holds. So it exists
on [0, h] and lies in the tube (an argument by continuity; Moore, Kearfott, Cloud, Introduction to Interval Analysis,
2009, chapter 10).
"""

import itertools
import operator
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from flint import arb, arb_poly, arb_series, ctx

from ..exact import Unproved
from .programs import UNDEFINED, BallProgram, Value, coefficient

SPREADING = "the set of motions spreads too far to be enclosed; narrow the intervals of the parameters"


class SetOptions(NamedTuple):
    """How sets of motions are enclosed, step by step, and when they are given up."""

    # Largest growth of a tube over a step, as a share of itself, by which the length of the step is estimated.
    stiffest: float = 0.6
    wider: float = 1.05  # a tried tube is this times as wide as its estimate
    tries: int = 60  # of tubes and lengths of a step
    most_off: float = 16.0  # largest defect relative to the accuracy
    least_share: float = 0.4  # of its length that a step which is too long is shortened to
    small: float = 1e-2  # a state that is a smaller share of the largest is small
    # Order of series up to which Picard's iteration is quicker than Newton's, which needs slopes.
    most_by_picard: int = 40
    shortest: float = 1e-6  # length of a step relative to the longest
    step_bits: int = 16  # of the length of a step, few enough that sums of steps are exact
    order_per_bit: float = 0.36  # of polynomials for the centre: about half of log 2, where steps cost the least
    most_steps: int = 2000  # of a motion
    # Steps whose mean length shows whether a set spreads: near a pole of a law steps are short for a while.
    observed_steps: int = 50
    hopeless: int = 100  # a set is given up where the rest would take this many times the steps that remain
    spread: float = 1e-3  # width of a set that has spread, as a share of its largest state


SETS = SetOptions()


@dataclass(frozen=True)
class System:
    """An autonomous system x' = f(x).

    size : n, the number of states
    rates : program of n rates
    slopes : program of the derivatives of the rates by the states that are not zero throughout
    places : row and column of each of these derivatives
    parts : the moving states: all in one part, or in two where the rates of each depend on no state of its own part,
        as those of positions and of speeds without damping
    """

    size: int
    rates: BallProgram
    slopes: BallProgram
    places: tuple[tuple[int, int], ...]
    parts: tuple["StatesOfPart", ...]


@dataclass(frozen=True)
class StatesOfPart:
    """Some of the states of a system, with the program of their rates.

    states : places of the states
    inputs : places of the states that the rates depend on, in the program's order
    """

    states: tuple[int, ...]
    inputs: tuple[int, ...]
    rates: BallProgram


@dataclass(frozen=True)
class Step:
    """A proved step of length h: each solution from within the spread of the centre lies in
    polynomials(t) +- tube, 0 <= t <= h.

    polynomials : n of them, in the time since the step's beginning, with balls as coefficients
    tube : n radii
    """

    h: arb
    polynomials: list[arb_poly]
    tube: list[arb]

    def at(self, t: arb) -> list[arb]:
        """Enclosures (n,) of the states at a time, or at all times of a ball, within the step."""
        return [widened(p(t), radius) for p, radius in zip(self.polynomials, self.tube, strict=True)]

    def end(self) -> list[arb]:
        """Enclosures (n,) of the states at the end."""
        return self.at(self.h)


def widened(value: arb, radius: arb) -> arb:
    """A ball with another radius added to its own."""
    return value + arb(0, radius.abs_upper())


def between(low: arb, high: arb) -> arb:
    """The ball from one number to another."""
    return low.union(high)


def picard_coefficients(system: System, centre: Sequence[arb], order: int) -> list[list[arb]]:
    """Taylor coefficients (n, order + 1) of the solution from a centre (n,): Picard's iteration on series. Each
    evaluation of the rates of a part determines one more coefficient than the states that they depend on have."""
    found = [[value] for value in centre]
    moving = {i for part in system.parts for i in part.states}
    cap = ctx.cap
    try:
        for part in itertools.cycle(system.parts):
            known = min((len(found[j]) for j in part.inputs if j in moving), default=order)
            ctx.cap = known = min(known, order)
            values = [arb_series(found[j][:known], known) if j in moving else centre[j] for j in part.inputs]
            for i, rate in zip(part.states, part.rates(values), strict=True):
                found[i] += [coefficient(rate, k) / (k + 1) for k in range(len(found[i]) - 1, known)]
            if all(len(found[i]) > order for i in moving):
                break
    except UNDEFINED:
        raise Unproved("the motion reaches a place where a law has no value") from None
    finally:
        ctx.cap = cap
    return [row if i in moving else row + [arb(0)] * order for i, row in enumerate(found)]


def ball_coefficients(system: System, centre: Sequence[arb], order: int) -> list[list[arb]]:
    """Taylor coefficients (n, order + 1) of the solution from a centre (n,): the first ones by Picard's iteration,
    further ones by Newton's, which doubles their number."""
    rows = picard_coefficients(system, centre, min(order, SETS.most_by_picard))
    while len(rows[0]) <= order:
        rows = _newton_coefficients(system, rows, min(2 * len(rows[0]), order + 1))
    return rows


def _newton_coefficients(system: System, rows: list[list[arb]], count: int) -> list[list[arb]]:
    """Taylor coefficients (n, count) from the first k of them, for at most 2 k. The solution is p + t**k e with the
    polynomial p of these, and up to t**(2 k - 1) its rates are those of p and Df(p) t**k e: what they lack is
    quadratic in t**k e. So (k + q) e[q] is the coefficient of t**(k + q - 1) in f(p), and of t**(q - 1) in Df(p) e
    (R. P. Brent, H. T. Kung, Journal of the ACM 25, 1978)."""
    known, cap = len(rows[0]), ctx.cap
    moving = [i for part in system.parts for i in part.states]

    def on_series(program: BallProgram, length: int) -> list[Value]:
        ctx.cap = length
        return program([arb_series(row[:length], length) if i in moving else row[0] for i, row in enumerate(rows)])

    try:
        rates, slopes = on_series(system.rates, count - 1), on_series(system.slopes, known)
    except UNDEFINED:
        raise Unproved("the motion reaches a place where a law has no value") from None
    finally:
        ctx.cap = cap
    by_state = [
        (i, j, [coefficient(slope, q) for q in range(known)] if isinstance(slope, arb_series) else [slope])
        for (i, j), slope in zip(system.places, slopes, strict=True)
        if i in moving and j in moving
    ]
    further: list[list[arb]] = [[] for _ in rows]
    for q in range(count - known):
        sums = [coefficient(rate, known + q - 1) for rate in rates]
        for i, j, slope in by_state if q else ():
            sums[i] = sum(map(operator.mul, slope, further[j][::-1]), sums[i])
        for i, row in enumerate(further):
            row.append(sums[i] / (known + q) if i in moving else arb(0))
    return [[*row, *more] for row, more in zip(rows, further, strict=True)]


def take_step(
    system: System, centre: Sequence[arb], spread: Sequence[arb], longest: arb,
    order: int, accuracy: float,
) -> Step:  # fmt: skip
    """A step of at most the longest length from the states within a spread (n,) of a centre (n,), of a polynomial of
    this order whose last term is about the accuracy; raises `Unproved` where no step is short enough."""
    rows = ball_coefficients(system, centre, order)
    h = _suggested(system, rows, longest, order, accuracy)
    polynomials = [arb_poly(row) for row in rows]
    sizes = _sizes(rows)
    for _ in range(SETS.tries):
        defect = _remainder(system, polynomials, h, order)
        off = max((float(each) / size for each, size in zip(defect, sizes, strict=True)), default=0.0)
        if off > SETS.most_off * accuracy:  # also where it is not a number
            h = with_few_digits(
                float(h) * (max((accuracy / off) ** (1 / order), SETS.least_share) if off < np.inf else 0.5)
            )
            continue
        step = _proved(system, polynomials, spread, defect, h)
        if step is not None:
            return step
        h = h / 2
    if not all(rate.is_finite() for rate in system.rates(centre)):
        raise Unproved("the motion comes near a place where a law has no value")
    raise Unproved(SPREADING)


def _suggested(system: System, rows: list[list[arb]], longest: arb, order: int, accuracy: float) -> arb:
    """A guess of the length of a step, such that a few about equal ones fill the longest. It has so few digits that
    sums of steps are exact."""
    sizes = _sizes(rows)
    # As balls: the last of many coefficients is above the largest float.
    lasts = [max(abs(row[k].mid()) for k in (order - 1, order)) for row in rows]
    last = max((each / size).mid() for each, size in zip(lasts, sizes, strict=True))
    length = accuracy ** (1 / order) / float(last.root(order)) if last > 0 else np.inf
    reach = arb(min(length, float(longest)))
    for t in (arb(0), reach):  # laws stiffen along the step
        places = [arb_poly(row)(t).mid() for row in rows]
        stiffness = _magnitudes(system, system.slopes([*places]))
        with np.errstate(all="ignore"):
            fourth = np.linalg.matrix_power(stiffness, 4)
        if np.isfinite(fourth).all() and (radius := fourth.sum(1).max() ** 0.25) > 0:
            length = min(length, SETS.stiffest / radius)
    whole = float(longest)
    if not length < whole:
        return longest
    count = float(np.ceil(whole / length)) if length > whole * SETS.shortest else 1 / SETS.shortest
    return with_few_digits(whole / count)


def with_few_digits(length: float) -> arb:
    """The next larger length with few digits."""
    mantissa, exponent = np.frexp(length)
    return arb(float(np.ldexp(np.ceil(mantissa * 2**SETS.step_bits), exponent - SETS.step_bits)))


def _sizes(rows: list[list[arb]]) -> list[float]:
    """The sizes of the states (n,), from their values and rates; for states that begin at 0, from the moving states."""
    sizes = [max(abs(float(row[0].mid())), abs(float(row[1].mid()))) for row in rows]
    moving = [size for size, row in zip(sizes, rows, strict=True) if not row[1].is_zero()]
    least = max(SETS.small * max(moving, default=0.0), 1e-30)
    return [max(size, least) for size in sizes]


def _magnitudes(system: System, values: Sequence[arb]) -> np.ndarray:
    """The Jacobian (n, n) in rounded numbers: the magnitudes of balls, for guesses."""
    matrix = np.zeros((system.size, system.size))
    for (i, j), value in zip(system.places, values, strict=True):
        matrix[i, j] += float(value.abs_upper()) if value.is_finite() else np.inf
    return matrix


def _remainder(system: System, polynomials: list[arb_poly], h: arb, order: int) -> list[arb]:
    """|R| h**(K + 1)/(K + 1), n bounds; not finite where the rates are not."""
    cap = ctx.cap
    try:
        ctx.cap = order + 1
        shift = arb_poly([between(arb(0), h), 1])
        moved = [arb_series(p(shift).coeffs(), order + 1) if p.degree() > 0 else p(arb(0)) for p in polynomials]
        rests = [coefficient(rate, order) for rate in system.rates([*moved])]
    except UNDEFINED:
        return [arb("inf")] * system.size
    finally:
        ctx.cap = cap
    scale = h ** (order + 1) / (order + 1)
    return [(rest * scale).abs_upper() if rest.is_finite() else arb("inf") for rest in rests]


def _proved(
    system: System, polynomials: list[arb_poly], spread: Sequence[arb],
    defect: Sequence[arb], h: arb,
) -> Step | None:  # fmt: skip
    """The step, None where its tube cannot be proved."""
    hull = [p(between(arb(0), h)) for p in polynomials]
    if not all(each.is_finite() for each in hull):
        return None
    added = [(start + each).abs_upper() for start, each in zip(spread, defect, strict=True)]
    tube = [2 * each for each in added]
    for _ in range(3):
        slopes = _slopes_on(system, hull, tube)
        if slopes is None:
            return None
        if all(new < old for new, old in zip(_grown(system, slopes, added, tube, h), tube, strict=True)):
            return Step(h, polynomials, tube)
        guess = _fixed_point(system, slopes, added, h)
        if guess is None:
            return None
        tube = guess
    return None


def _slopes_on(system: System, hull: Sequence[arb], tube: Sequence[arb]) -> list[arb] | None:
    """The magnitudes of the derivatives over a tube, None where one is not bounded."""
    inside = [widened(value, radius) for value, radius in zip(hull, tube, strict=True)]
    slopes = [value.abs_upper() for value in system.slopes([*inside])]
    return slopes if all(value.is_finite() for value in slopes) else None


def _grown(system: System, slopes: Sequence[arb], added: Sequence[arb], tube: Sequence[arb], h: arb) -> list[arb]:
    """The right hand side of the estimate."""
    found = list(added)
    for (i, j), slope in zip(system.places, slopes, strict=True):
        found[i] = found[i] + h * slope * tube[j]
    return found


def _fixed_point(system: System, slopes: Sequence[arb], added: Sequence[arb], h: arb) -> list[arb] | None:
    """A guess of a tube that is wider than its estimate: the solution of e = wider (added + h |Df| e)."""
    length = float(h.abs_upper())
    if not np.isfinite(matrix := _magnitudes(system, slopes)).all():
        return None
    # Radii far below the smallest float are represented by their ratio to the largest.
    largest = max(added)
    if not largest > 0:
        largest = arb(2) ** (-4 * ctx.prec)
    shares = np.array([float(each / largest) for each in added]) + 1e-30
    try:
        guess = np.linalg.solve(np.eye(system.size) - SETS.wider * length * matrix, SETS.wider * shares)
    except np.linalg.LinAlgError:
        return None
    if not (guess > 0).all():
        return None
    return [(largest * arb(each)).abs_upper() for each in guess.tolist()]
