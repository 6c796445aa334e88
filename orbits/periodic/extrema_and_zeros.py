"""Functions on motions with their zeros or stationary points, and their lowest and highest values."""

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ..flow import Trajectories
from ..numerics import PiecewisePolynomials, evaluate
from ..records import NONE

# A stationary point this near to the middle of the motion, as a share of its time, is the middle itself.
MIDDLE = 1e-7
# Up to this many polynomials are searched together; of more, the arrays leave the processor's cache.
MOST_TOGETHER = 6000


class TurnsAndZeros(NamedTuple):
    """A function on m motions, as coefficients (N, K + 1), with its zeros or stationary points (r,).

    owner, times : the motion of each place, and the time in that motion
    rising : whether the function, or its rate, rises there
    values, ends : the function at the places (r,) and at the ends of the motions (m,)
    """

    motions: Trajectories
    series: np.ndarray
    owner: np.ndarray
    times: np.ndarray
    rising: np.ndarray
    values: np.ndarray
    ends: np.ndarray

    def lowest(self, middles: np.ndarray | None = None, sign: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """The lowest value (m,) of the function times a sign on each motion, and its time (m,); with `middles`, that of
        the function's minima alone, `NONE` without one, the ends of these motions (e,) being minima and no others."""
        each, among, starts, ends = np.arange(len(self.ends)), self.inside & self.rising, np.zeros(0, int), middles
        if ends is None:
            among, starts, ends = np.ones(len(self.owner), bool), each, each
        owner = np.concatenate([self.owner[among], starts, ends])
        begins = self.series[self.motions.first[starts], 0]
        values = sign * np.concatenate([self.values[among], begins, self.ends[ends]])
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
        size = self.series.shape[1]
        # The powers of a short step come first: the coefficients of the derivative may be beyond all numbers.
        terms = self.series[self.motions.last, order:] * self.motions.of_lasts[:, : size - order]
        return terms @ _factors(order, size)


@cache
def _factors(order: int, size: int) -> np.ndarray:
    """The factors by which a derivative of this order multiplies `size` coefficients without the first ones."""
    return np.prod([np.arange(order - i, size - i) for i in range(order)], axis=0)


def turns_and_zeros(sought: Mapping[Any, tuple[Trajectories, np.ndarray, bool, int]]) -> dict[Any, TurnsAndZeros]:
    """Functions on motions with their zeros or stationary points, which are all found in one search.

    sought : by name the motions, the function (N, K + 1) on them, whether the zeros of its rate are sought or its own,
        and the order of the zero of the searched function at the start of each motion, which is divided out exactly
    """
    if len(sought) > 1 and sum(len(series) for _, series, *_ in sought.values()) > MOST_TOGETHER:
        return {name: turns_and_zeros({name: one})[name] for name, one in sought.items()}
    motions, series, by_rate, orders = zip(*sought.values(), strict=True)
    firsts = np.cumsum([0, *map(len, motions)])
    parts = zip(*((each.starts, each.steps, each.counts) for each in motions), strict=True)
    starts, steps, counts = map(np.concatenate, parts)
    functions, sizes = np.concatenate(series) if len(series) > 1 else series[0], np.diff(firsts)
    polynomials = PiecewisePolynomials(functions, steps, counts)
    order, rate = (np.array(values).repeat(sizes) for values in (orders, by_rate))
    owner, piece, t = polynomials.roots(order, stationary=rate)
    step, last = polynomials.first[owner] + piece, polynomials.last
    values, times = evaluate(functions[step], t), starts[step] + t
    ends = evaluate(functions[last], steps[last])
    places, found = np.searchsorted(owner, firsts).tolist(), dict[str, TurnsAndZeros]()
    for i, name in enumerate(sought):
        here, each = slice(places[i], places[i + 1]), slice(firsts[i], firsts[i + 1])
        mine = owner[here] - firsts[i], times[here], polynomials.rising[here], values[here]
        found[name] = TurnsAndZeros(motions[i], series[i], *mine, ends[each])
    return found


def extremes(motions: Trajectories, series: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest values (m,) on motions of a function with coefficients (N, K + 1)."""
    curve = turns_and_zeros({"all": (motions, series, True, 0)})["all"]
    return curve.lowest()[0], -curve.lowest(sign=-1.0)[0]
