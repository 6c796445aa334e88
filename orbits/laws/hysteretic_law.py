"""A spring with hysteresis: one law while its extension grows, another while it shrinks.

The force is that of one of two branches, by the sign of the rate of extension r':

    phi(r, r') = mean(r) + sign(r') half_width(r),    mean = (extending + shortening)/2, half_width >= 0.

It is independent of the rate: a cycle between two extensions loses the area between the branches, however fast it is.
At a reversal the force jumps from one branch to the other, unless these meet there; no path inside the loop is modelled
(as Masing's rules or a Preisach model would). Where neither branch reverses the extension, the force takes the value
between them that keeps the extension, like dry friction.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

from ..errors import InputError
from ..symbolic import suggest
from .law import Key, Law, LawPieces
from .law_expressions import Expression, break_table
from .law_statement import from_formula

# Measured branches may cross by their noise: by at most this share of the largest width of the loop.
LARGEST_CROSSING = 0.05
# A table of one piece, for a law without pieces.
ONE_PIECE = LawPieces(0, break_table((-math.inf, math.inf)))


@dataclass(frozen=True, repr=False)
class HystereticLaw(Law):
    """Two branches of a spring, made by `hysteretic_law`; as a `Law` it has the values of its mean.

    extending, shortening : the laws while the extension grows and while it shrinks
    mean : the law midway between them, a law like any other, with lossless hops
    """

    extending: Any = None
    shortening: Any = None
    mean: Any = None

    def __reduce__(self) -> Any:
        return hysteretic_law, (self.text, self.extending, self.shortening, self.mean)

    @property
    def key(self) -> Key:
        """The law without its parameters' values: the key of the mean with those of the branches."""
        branches = (self.extending.key, self.shortening.key)
        return Key(self.text, self.variable, self.expression, tuple(self.parameters), self.pieces, branches=branches)

    def with_parameters(self, **values: float) -> "HystereticLaw":
        """This law with other values of some parameters."""
        for name in values:
            if name not in self.parameters:
                raise InputError(f"'{self.text}' has no parameter '{name}'{suggest(name, self.parameters)}")

        def with_own(law: Law) -> Law:
            return law.with_parameters(**{name: x for name, x in values.items() if name in law.parameters})

        return hysteretic_law(self.text, *map(with_own, (self.extending, self.shortening, self.mean)))

    def scaled(self, length: float, force: float | None = None) -> "HystereticLaw":
        """The law in units of `length` and `force`, see `Law.scaled`."""
        laws = (law.scaled(length, force) for law in (self.extending, self.shortening, self.mean))
        return hysteretic_law(self.text, *laws)


def hysteretic_law(text: str, extending: Law, shortening: Law, mean: Law | None = None) -> HystereticLaw:
    """The law with these branches; raises `InputError` where they give one parameter different values.

    mean : their mean, where it is known as a law of its own
    """
    values = dict(extending.parameters)
    for name, value in shortening.parameters.items():
        if values.setdefault(name, value) != value:
            apart = f"{values[name]:g} and {value:g}"
            raise InputError(f"parameter '{name}' has two values in the branches, {apart}: give both the same")
    mean = mean or mean_of(extending, shortening)
    return HystereticLaw(
        text, mean.variable, mean.expression, values, mean.pieces, in_si=extending.in_si,
        extending=extending, shortening=shortening, mean=mean,
    )  # fmt: skip


def mean_of(extending: Law, shortening: Law) -> Law:
    """The law midway between two, as a formula if both are formulas."""
    values = {**extending.parameters, **shortening.parameters}
    if all(law.written and not law.pieces and not law.written.potential for law in (extending, shortening)):
        texts = [law.written.formulas[0] for law in (extending, shortening) if law.written]
        return from_formula(f"(({texts[0]}) + ({texts[1]}))/2", "r", values)
    pieces = merged_pieces(extending, shortening)
    size = extending.pieces.size if extending.pieces else 0
    expression = _half_the_sum(extending.expression, shortening.expression, size)
    text = f"mean of {extending.text} and {shortening.text}"
    return Law(text, "r", expression, values, pieces if extending.pieces or shortening.pieces else None)


def merged_pieces(first: Law, second: Law) -> LawPieces:
    """The pieces of two laws together, where both are stated, each with the data of the first and of the second;
    raises `InputError` where no extension is in both ranges, or where they are counted in different ways."""
    each = [law.pieces or ONE_PIECE for law in (first, second)]
    scales = {(pieces.unit, pieces.origin) for law, pieces in zip((first, second), each, strict=True) if law.pieces}
    if len(scales) > 1:
        raise InputError(f"'{first.text}' and '{second.text}' have different shifts: give both the same one, or none")
    unit, origin = scales.pop() if scales else (None, None)
    places = [[float(x) for x in p.table(law.parameters)[0]] for law, p in zip((first, second), each, strict=True)]
    low, high = max(own[0] for own in places), min(own[-1] for own in places)
    if not low < high:
        raise InputError(f"'{first.text}' and '{second.text}' have no extension in common")
    inside = {x: (k, i) for k in (1, 0) for i, x in enumerate(places[k]) if low <= x <= high}
    ends = sorted(inside)
    indices = [tuple(_piece(own, a, b) for own in places) for a, b in pairwise(ends)]
    table = _merged_table(each[0].table, each[1].table, tuple(inside[x] for x in ends), tuple(indices))
    return LawPieces(each[0].size + each[1].size, table, unit, origin, jumps=any(own.jumps for own in each))


def _piece(places: list[float], a: float, b: float) -> int:
    """The index of the piece between neighbouring places that holds the interval from a to b."""
    inside = a + 1 if b == math.inf and a > -math.inf else b - 1 if a == -math.inf and b < math.inf else 0.5 * (a + b)
    middle = 0.0 if math.isnan(inside) else inside
    return sum(place <= middle for place in places[1:-1])


@lru_cache(maxsize=64)
def _merged_table(first: Callable, second: Callable, breaks: tuple, indices: tuple) -> Expression:
    """The breaks and data of two tables; `breaks` are (table, index), `indices` those of the data of each piece."""

    def merged(p: Mapping) -> tuple[list, list]:
        (places, rows), (others, data) = first(p), second(p)
        return [(places, others)[k][i] for k, i in breaks], [[*rows[i], *data[j]] for i, j in indices]

    return Expression(merged, _merged_table, first, second, breaks, indices)


@lru_cache(maxsize=64)
def _half_the_sum(first: Callable, second: Callable, size: int) -> Expression:
    """Half the sum of two laws; the data of a piece are `size` values of the first, then those of the second."""
    value = lambda x, p, q: (first(x, p, q[:size]) + second(x, p, q[size:])) / 2  # noqa: E731
    return Expression(value, _half_the_sum, first, second, size)


@lru_cache(maxsize=64)
def scaled_branch(mean: Callable, size: int, side: int) -> Expression:
    """The branch (1 + side share s) mean of a law, s = 1 where the mean is in tension and -1 in compression: the last
    value of a piece. The share is pi/2 times the parameter "loss_factor"."""

    def branch(x, p, q):
        return mean(x, p, q[:size]) * (1 + side * (math.pi / 2) * p["loss_factor"] * q[-1])

    return Expression(branch, scaled_branch, mean, size, side)


@lru_cache(maxsize=64)
def sides_of(zero: float) -> Expression:
    """The table of the two sides of the place where a mean law vanishes: -1 in compression, 1 in tension."""
    return Expression(lambda p: ((-math.inf, zero, math.inf), [[-1.0], [1.0]]), sides_of, zero)
