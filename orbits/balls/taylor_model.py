"""Taylor models: functions of a time and of the place on a curve, as polynomials with a bound on the remainder.

A model of f on 0 <= t <= 1, -1 <= s <= 1 is a polynomial p in t and s with a rest R, such that |f - p| <= R there.
Sums, products and functions of models are models again (M. Berz, K. Makino, Reliable Computing 4, 1998). All
coefficients are balls, so that roundings are bounded too. The terms of a product beyond the degrees are bounded by sums
of the absolute values of coefficients, since |t| <= 1 and |s| <= 1. A function g of a model is its Taylor polynomial
about a centre c with Lagrange's remainder over the range of the model, taken as a model: the sum of g_k (p - c)**k for
k <= L, and g_(L + 1)(range) bound**(L + 1).
"""

import operator
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any, NamedTuple, Union

from flint import arb, arb_poly, arb_series, ctx

from .programs import UNDEFINED, coefficient, series_function


class CurveOptions(NamedTuple):
    """Models of motions in time and along a curve, the steps in which they are proved, and the tubes about them."""

    time_degree: int = 20  # of models in t
    curve_degree: int = 10  # of models in s
    # Degrees of functions of models that are tried in order until the rest is small.
    function_degrees: tuple[int, ...] = (6, 10, 14, 20)
    small_rest: float = 2.0**-56  # of a function of models, relative to its value
    bits: int = 64  # of the balls of coefficients
    accuracy: float = 2.0**-36  # size of the last term of a polynomial in time, relative to the largest
    shorter: float = 0.9  # factor by which steps are shortened for the orbits whose terms are not checked
    steps: int = 400  # of a motion
    halved_steps: int = 3  # halvings of a step that is not proved
    widenings: int = 4  # of a tried tube
    wider: arb = arb(1.5)  # a tried tube is this times as wide as its estimate
    thinnest: arb = arb(2) ** -200  # width of a tried tube
    parts_of_curve: int = 8  # of a piece, for bounds of the inverse of P
    parts_of_time: int = 2  # of a step, for bounds of the inverse of P
    singular_parts: int = 64  # most halvings of parts on which P may be singular
    widest_tube: float = 2.0**-22  # half width of the first tube that is tried, relative to the unknowns
    tubes: int = 3  # that are tried
    narrower_try: float = 2.0**-7  # share of its width with which a tube whose motions spread too far is tried again
    narrowings: int = 4  # of an enclosure by the operator
    about_enclosure: int = 4  # width of the tube about an enclosure, relative to it
    thinnest_tube: arb = arb(2) ** -50  # about an enclosure


CURVES = CurveOptions()
_NO_REST = arb(0)
# The balls of all t, from 0 to 1, and of all s, from -1 to 1.
ALL_TIMES, ALL_PLACES = arb(0).union(arb(1)), arb(0, 1)
_NAN = arb("nan")


ModelOperand = Union["TaylorModel", arb, int]


@contextmanager
def model_arithmetic() -> Iterator[None]:
    """The context in which models are computed: series are truncated at their degree in t."""
    cap = ctx.cap
    try:
        with ctx.workprec(CURVES.bits):
            ctx.cap = CURVES.time_degree + 1
            yield
    finally:
        ctx.cap = cap


class TaylorModel:
    """The functions within `rest` of the sum of parts[j](t) s**j.

    parts : series in t, at most CURVES.curve_degree + 1 of them
    rest : a bound, not below 0; NaN where the functions have no values
    """

    def __init__(self, parts: Sequence[arb_series], rest: arb = _NO_REST):
        if any(part.prec != CURVES.time_degree + 1 for part in parts):
            raise ValueError(f"the parts of a model are computed with ctx.cap = {CURVES.time_degree + 1}")
        self.parts, self.rest = parts, rest

    @classmethod
    def of_curve(cls, coefficients: Sequence[arb], rest: arb = _NO_REST) -> "TaylorModel":
        """The polynomial in s with these coefficients, at all times."""
        return cls([arb_series([each], CURVES.time_degree + 1) for each in coefficients], rest)

    @cached_property
    def _magnitudes(self) -> tuple[list[arb], list[arb]]:
        """Sums of the absolute values of the coefficients, by their degrees in t, and by those in s."""
        by_time, by_curve = [_NO_REST] * (CURVES.time_degree + 1), list[arb]()
        for part in self.parts:
            whole = _NO_REST
            for i, each in enumerate(part.coeffs()):
                size = each.abs_upper()
                by_time[i] = by_time[i] + size
                whole = whole + size
            by_curve.append(whole)
        return by_time, by_curve

    @cached_property
    def polynomial_bound(self) -> arb:
        """A bound on the absolute values of the polynomial."""
        return sum(self._magnitudes[1], _NO_REST).abs_upper()

    @cached_property
    def bound(self) -> arb:
        """A bound on the absolute values of the functions."""
        return (self.polynomial_bound + self.rest).abs_upper()

    def __add__(self, other: ModelOperand) -> "TaylorModel":
        if not isinstance(other, TaylorModel):
            if not self.parts:
                return TaylorModel.of_curve([arb(other)], self.rest)
            return TaylorModel([self.parts[0] + other, *self.parts[1:]], self.rest)
        short, long = sorted((self.parts, other.parts), key=len)
        parts = [*map(operator.add, short, long), *long[len(short) :]]
        return TaylorModel(parts, (self.rest + other.rest).abs_upper())

    __radd__ = __add__

    def __neg__(self) -> "TaylorModel":
        return TaylorModel([-part for part in self.parts], self.rest)

    def __sub__(self, other: ModelOperand) -> "TaylorModel":
        return self + -other

    def __rsub__(self, other: ModelOperand) -> "TaylorModel":
        return -self + other

    def __mul__(self, other: ModelOperand) -> "TaylorModel":
        if not isinstance(other, TaylorModel):
            if other == 0 and self.rest.is_finite():
                return TaylorModel([])
            return TaylorModel([part * other for part in self.parts], (self.rest * other).abs_upper())
        parts = list[arb_series]()
        for j, left in enumerate(self.parts):
            for k, right in enumerate(other.parts[: CURVES.curve_degree + 1 - j]):
                if j + k < len(parts):
                    parts[j + k] = parts[j + k] + left * right
                else:
                    parts.append(left * right)
        degrees = CURVES.time_degree, CURVES.curve_degree
        left_out = sum(map(_beyond_degree, self._magnitudes, other._magnitudes, degrees), _NO_REST)
        rests = self.rest * other.bound + other.rest * self.polynomial_bound
        return TaylorModel(parts, (left_out + rests).abs_upper())

    __rmul__ = __mul__

    def __truediv__(self, other: ModelOperand) -> "TaylorModel":
        if isinstance(other, TaylorModel):
            return self * other.composed(_inverse)
        return self * (1 / arb(other))

    def __rtruediv__(self, other: ModelOperand) -> "TaylorModel":
        return self.composed(_inverse) * other

    def __getattr__(self, name: str) -> Callable[[], "TaylorModel"]:
        """The functions of formulas, as methods."""
        function = series_function(name)
        if function is None:
            raise AttributeError(f"a model has no '{name}'")
        return lambda: self.composed(function)

    def is_finite(self) -> bool:
        """Whether the bound is a number."""
        return bool(self.bound.is_finite())

    def is_nan(self) -> bool:
        """Whether the bound is neither a number nor infinite."""
        return bool(self.bound.is_nan())

    def on(self, s: arb, t: arb = ALL_TIMES) -> arb:
        """An enclosure of the values for all places of a ball, at all times of a ball."""
        found = _NO_REST
        for part in reversed(self.parts):
            found = found * s + arb_poly(part.coeffs())(t)
        return found + arb(0, self.rest.abs_upper())

    def in_time(self, s: arb) -> arb_poly:
        """A polynomial in t whose coefficients hold those of the polynomial for all places of a ball."""
        columns = [part.coeffs() for part in self.parts]
        length = max(map(len, columns), default=0)
        rows = [[row[i] if i < len(row) else _NO_REST for row in columns] for i in range(length)]
        return arb_poly([_on_curve(row, s) for row in rows])

    def at_end(self) -> "TaylorModel":
        """The model at the time 1, the same at all times."""
        return TaylorModel.of_curve([sum(part.coeffs(), _NO_REST) for part in self.parts], self.rest)

    def slope_in_time(self) -> "TaylorModel":
        """The derivative of the polynomial by t."""
        slopes = ([i * each for i, each in enumerate(part.coeffs())][1:] for part in self.parts)
        return TaylorModel([arb_series(each, CURVES.time_degree + 1) for each in slopes])

    def slope_on_curve(self) -> "TaylorModel":
        """The derivative of the polynomial by s."""
        return TaylorModel([part * j for j, part in enumerate(self.parts)][1:])

    def composed(self, function: Callable[[arb_series], Any]) -> "TaylorModel":
        """A function of the model, which is passed as a function of power series."""
        whole = self.on(ALL_PLACES)
        centre, cap = whole.mid(), ctx.cap
        away = self - centre
        bound = (whole - centre).abs_upper()
        if not bound.is_finite():
            return TaylorModel([], _NAN)
        for degree in CURVES.function_degrees:
            try:
                ctx.cap = degree + 2
                last = coefficient(function(arb_series([whole, 1], degree + 2)), degree + 1)
                series = function(arb_series([centre, 1], degree + 2))
            except UNDEFINED:
                return TaylorModel([], _NAN)
            finally:
                ctx.cap = cap
            rest = (last * bound ** (degree + 1)).abs_upper()
            if rest < CURVES.small_rest * (1 + abs(series[0])):
                break
        found = TaylorModel.of_curve([coefficient(series, degree)])
        for k in reversed(range(degree)):
            found = found * away + coefficient(series, k)
        return TaylorModel(found.parts, (found.rest + rest).abs_upper())


def as_model(value: ModelOperand) -> TaylorModel:
    """A result as a model; a ball is the same everywhere."""
    return value if isinstance(value, TaylorModel) else TaylorModel.of_curve([arb(value)])


def _inverse(x: arb_series) -> arb_series:
    return 1 / x


def _beyond_degree(left: Sequence[arb], right: Sequence[arb], degree: int) -> arb:
    """A bound on the products of coefficients whose degrees sum up to more than `degree`, from bounds by degree."""
    tails, found = [_NO_REST], _NO_REST  # tails[k] is the sum of the last k of the right
    for each in reversed(right):
        tails.append(tails[-1] + each)
    for i, each in enumerate(left):
        count = len(right) - (degree + 1 - i)
        if count > 0:
            found = found + each * tails[count]
    return found


def _on_curve(coefficients: Sequence[arb], s: arb) -> arb:
    found = _NO_REST
    for each in reversed(coefficients):
        found = found * s + each
    return found
