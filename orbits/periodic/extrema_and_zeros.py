"""Functions on motions with their zeros or stationary points, and their lowest and highest values."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np

from ..flow import Trajectories, sign_tests
from ..model import Affine, StateFormula
from ..numerics import POLYNOMIALS, PiecewisePolynomials, evaluate
from ..records import NONE

# A stationary point this near to the middle of the motion, as a share of its time, is the middle itself.
MIDDLE = 1e-7


class Sought(NamedTuple):
    """A function on m motions, whose stationary points or zeros are sought.

    quantity, embed : as `Trajectories.series` takes them
    by_rate : whether the zeros of its rate are sought or its own
    order : of the zero of the searched function at the start of each motion, which is divided out exactly
    """

    motions: Trajectories
    quantity: Affine | StateFormula
    by_rate: bool = True
    order: int = 0
    embed: np.ndarray | None = None

    @classmethod
    def of(cls, motions: Trajectories, series: np.ndarray, by_rate: bool = True, order: int = 0) -> "Sought":
        """The function with coefficients (N, K + 1)."""
        return cls(motions.with_rows(series[:, None], ("value",)), Affine((1.0,)), by_rate, order)

    def whole(self) -> "Sought":
        """The function as a row of its own."""
        return Sought.of(self.motions, self.series(), self.by_rate, self.order)

    def series(self, steps: np.ndarray | slice = slice(None), orders: slice = slice(None)) -> np.ndarray:
        """The coefficients (k, K + 1) of some steps (k,), or those of some `orders`."""
        return self.motions.series(self.quantity, self.embed, steps, orders)

    def of_steps(self) -> tuple[np.ndarray, np.ndarray]:
        """The weights and the offset of an affine function, as `Trajectories.of_steps` returns them."""
        assert isinstance(self.quantity, Affine)
        return self.motions.of_steps(self.quantity, self.embed)


class TurnsAndZeros(NamedTuple):
    """A function on m motions, with its zeros or stationary points (r,).

    owner, times : the motion of each place, and the time in that motion
    rising : whether the function, or its rate, rises there
    values, ends : the function at the places (r,) and at the ends of the motions (m,)
    firsts, lasts : the coefficients (m, K + 1) of the function in the first and the last step of each motion
    """

    motions: Trajectories
    function: Sought
    owner: np.ndarray
    times: np.ndarray
    rising: np.ndarray
    values: np.ndarray
    ends: np.ndarray
    firsts: np.ndarray
    lasts: np.ndarray

    def lowest(self, middles: np.ndarray | None = None, sign: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """The lowest value (m,) of the function times a sign on each motion, and its time (m,); with `middles`, that of
        the function's minima alone, `NONE` without one, the ends of these motions (e,) being minima and no others."""
        each, among, starts, ends = np.arange(len(self.ends)), self.inside & self.rising, np.zeros(0, int), middles
        if ends is None:
            among, starts, ends = np.ones(len(self.owner), bool), each, each
        owner = np.concatenate([self.owner[among], starts, ends])
        values = sign * np.concatenate([self.values[among], self.firsts[starts, 0], self.ends[ends]])
        times = np.concatenate([self.times[among], np.zeros(len(starts)), self.motions.ends[ends]])
        lowest, when = np.full(len(each), NONE), np.zeros(len(each))
        order = np.argsort(-values, kind="stable")  # of several assignments to one motion the last, the lowest, counts
        lowest[owner[order]], when[owner[order]] = values[order], times[order]
        return lowest, when

    @property
    def inside(self) -> np.ndarray:
        """Whether each place (r,) is not the end of its motion."""
        return self.times < self.motions.ends[self.owner] * (1 - MIDDLE)

    def at_ends(self, order: int) -> np.ndarray:
        """The derivative (m,) of this order at the ends of the motions."""
        size = self.lasts.shape[1]
        # The powers of a short step come first: the coefficients of the derivative may be beyond all numbers.
        terms = self.lasts[:, order:] * self.motions.of_lasts[:, : size - order]
        return terms @ _factors(order, size)


@cache
def _factors(order: int, size: int) -> np.ndarray:
    """The factors by which a derivative of this order multiplies `size` coefficients without the first ones."""
    return np.prod([np.arange(order - i, size - i) for i in range(order)], axis=0)


class _Functions(PiecewisePolynomials):
    """Functions on motions, one after the other. Of many steps the coefficients are made where a zero may be."""

    def __init__(self, functions: Sequence[Sought]):
        self.functions = functions
        motions = [each.motions for each in functions]
        self.begins = np.concatenate([each.starts for each in motions])
        self.places = [*accumulate((len(each.starts) for each in motions), initial=0)]
        own = (np.concatenate(each) for each in zip(*((each.steps, each.counts) for each in motions), strict=True))
        self.few, whole = len(self.begins) <= POLYNOMIALS.few_pieces, np.zeros((0, 1))
        if self.few:
            parts = dict[int, np.ndarray]()
            for group, (together, weights, offsets) in self._groups():
                c = weights @ together.coefficients
                c[:, :, 0] += offsets
                parts |= zip(group, c.swapaxes(0, 1), strict=True)
            whole = np.concatenate([parts[i] for i in range(len(functions))])
        super().__init__(whole, *own)

    def _groups(self) -> Iterator[tuple[list[int], tuple[Trajectories, np.ndarray, np.ndarray]]]:
        """The functions on the same motions by their numbers (q,), with the motions, the weights (N, q, rows) and the
        offsets (N, q), those of one step where all have the same."""
        groups = dict[int, list[int]]()
        for i, each in enumerate(self.functions):
            groups.setdefault(id(each.motions), []).append(i)
        for group in groups.values():
            motions = self.functions[group[0]].motions
            own = [self.functions[i].of_steps() for i in group]
            longest = max(max(map(len, each)) for each in own)
            weights = np.zeros((longest, len(own), motions.coefficients.shape[1]))
            offsets = np.empty((longest, len(own)))
            for i, (weight, offset) in enumerate(own):
                weights[:, i, : weight.shape[1]], offsets[:, i] = weight, offset
            yield group, (motions, weights, offsets)

    def series(self, which: np.ndarray, orders: slice = slice(None)) -> np.ndarray:
        if self.few:
            return super().series(which, orders)
        bounds = np.searchsorted(which, self.places).tolist()
        parts = zip(self.functions, self.places, pairwise(bounds), strict=False)
        return np.concatenate([each.series(which[a:b] - first, orders) for each, first, (a, b) in parts])

    def signs(self, orders: np.ndarray, by_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        found = np.empty((3, len(self.begins)))
        for group, (motions, weights, offsets) in self._groups():
            count, rows, size = motions.coefficients.shape
            kinds, fresh = [(self.functions[i].by_rate, self.functions[i].order) for i in group], np.zeros((count, 1))
            fresh[motions.first] = 1.0
            c, lengths = motions.coefficients.reshape(count, -1), motions.steps[:, None]
            tests = sign_tests(rows, size, tuple(kinds))
            (signs,) = tests(c, lengths, fresh, weights.reshape(len(weights), -1), offsets)
            for i, own in zip(group, signs.T.reshape(len(group), 3, count), strict=True):
                found[:, self.places[i] : self.places[i + 1]] = own
        begins, changes, ends = found
        return begins, ends, changes


def turns_and_zeros(sought: Mapping[Any, Sought]) -> dict[Any, TurnsAndZeros]:
    """Functions on motions with their zeros or stationary points, by name, which are all found in one search."""
    functions = [each if isinstance(each.quantity, Affine) else each.whole() for each in sought.values()]
    polynomials, sizes = _Functions(functions), [len(each.motions) for each in functions]
    order, rate = (
        np.repeat(each, sizes) for each in zip(*((each.order, each.by_rate) for each in functions), strict=True)
    )
    begins = [*accumulate(sizes, initial=0)]
    owner, piece, t = polynomials.roots(order, stationary=rate)
    step, last = polynomials.first[owner] + piece, polynomials.last
    values, times = evaluate(polynomials.series(step), t), polynomials.begins[step] + t
    firsts, lasts = polynomials.series(polynomials.first), polynomials.series(last)
    ends = evaluate(lasts, polynomials.steps[last])
    places, found = np.searchsorted(owner, begins).tolist(), dict[str, TurnsAndZeros]()
    for i, (name, function) in enumerate(zip(sought, functions, strict=True)):
        here, each = slice(places[i], places[i + 1]), slice(begins[i], begins[i + 1])
        mine = owner[here] - begins[i], times[here], polynomials.rising[here], values[here]
        found[name] = TurnsAndZeros(function.motions, function, *mine, ends[each], firsts[each], lasts[each])
    return found


def extremes(
    motions: Trajectories, quantity: Affine | StateFormula, embed: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest values (m,) on motions of a function, as `Trajectories.series` takes it."""
    curve = turns_and_zeros({"all": Sought(motions, quantity, embed=embed)})["all"]
    return curve.lowest()[0], -curve.lowest(sign=-1.0)[0]
