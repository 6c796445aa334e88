"""Steps along curves, each of its own length, and the points between the ends of these steps, all solved together.

A step of length s along the unit tangent t from X0 solves F(X) = 0, row . (X - X0) = s row . t. A correction that is
large relative to s may have led to another curve, so a shorter step is tried.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..numerics import through
from .bordered_newton import Border, correct, some
from .protocol import Array, Barrier, Points, Problem
from .step_options import Steps


class Tails(NamedTuple):
    """The last points of curves (k,), from which their next points are predicted, the latest one last.

    xs, tangents : (k, memory, n + 1)
    known : which of these points there are (k, memory)
    """

    xs: Array
    tangents: Array
    known: Array

    @classmethod
    def of(cls, blocks: Sequence[Points], lanes: Array, memory: int) -> "Tails":
        """The last points of lanes (k,), in blocks of points in order. Blocks of points with other numbers of unknowns
        than the last one are of other problems."""
        n = blocks[-1].xs.shape[1]
        blocks, xs, tangents = [each for each in blocks if each.xs.shape[1] == n], *np.zeros((2, len(lanes), memory, n))
        known = np.zeros((len(lanes), memory), bool)
        for k, lane in enumerate(lanes.tolist()):
            own = [each[each.lanes == lane] for each in blocks]
            last = [np.concatenate(part)[-memory:] for part in ([p.xs for p in own], [p.tangents for p in own])]
            xs[k], tangents[k] = (part[np.maximum(np.arange(len(part) - memory, len(part)), 0)] for part in last)
            known[k, memory - len(last[0]) :] = True
        return cls(xs, tangents, known)

    def of_lanes(self, which: Any) -> "Tails":
        """The tails of some curves."""
        return Tails(self.xs[which], self.tangents[which], self.known[which])

    def with_next(self, which: Array, xs: Array, tangents: Array) -> "Tails":
        """With the next points (j, n + 1) of some curves (j,), in place of their earliest ones."""
        own, following = some(which, len(self.xs)), Tails(*(each.copy() for each in self))
        for whole, before, new in zip(following, self, (xs, tangents, True), strict=True):
            whole[own, :-1], whole[own, -1] = before[own, 1:], new
        return following


class Taken(NamedTuple):
    """Steps of curves (k,).

    which : indices (j,) of the accepted ones
    ends : their ends (j), with the lengths of the steps
    rows, levels : (j, n + 1) and (j,), the borders of these
    lengths : the lengths (k,) of the next steps
    arrives : whether a step ends at the bound or a barrier ahead (j,)
    missed : the distances (k,) to the bound ahead of steps that were to end there and are rejected; else infinite
    reasons : why steps are rejected, by index
    """

    which: Array
    ends: Points
    rows: Array
    levels: Array
    lengths: Array
    arrives: Array
    missed: Array
    reasons: Mapping[int, str]


def step(problem: Problem, lanes: Array, tails: Tails, lengths: Array, bounds: Array, options: Steps) -> Taken:
    """A step of each lane (k,) from the end of its tail, of these lengths (k,), or up to the bound (k, 2) or a barrier
    ahead."""
    xs, tangents, n = tails.xs[:, -1], tails.tangents[:, -1], tails.xs.shape[2]
    rows = tangents / (sizes := problem.size(lanes, xs)) ** 2
    bound = np.where(tangents[:, -1] > 0, bounds[:, 1], bounds[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        left = (bound - xs[:, -1]) / tangents[:, -1]
    lands = (left > 0) & (left <= lengths)
    taken, missed = np.where(lands, left, lengths), np.where(lands, left, np.inf)
    barriers = problem.barriers(lanes, xs, tangents, taken)
    for k, barrier in barriers.items():
        taken[k], lands[k] = barrier.left, False
    straight = xs + taken[:, None] * tangents
    levels = (rows * straight).sum(1)
    if lands.any():
        rows, levels = np.where(lands[:, None], np.eye(1, n, n - 1), rows), np.where(lands, bound, levels)
    guesses, used = _predicted(problem, lanes, tails, rows, levels)
    for k, barrier in barriers.items():
        rows[k], levels[k] = barrier.border(guesses[k])
        guesses[k] += tangents[k] * (levels[k] - rows[k] @ guesses[k]) / (rows[k] @ tangents[k])
    bent = np.sqrt((((guesses - straight) / sizes) ** 2).sum(1))
    i = (np.isfinite(bent) & (bent <= options.bent * taken)).nonzero()[0]
    most, own = np.minimum(options.corrected * taken, options.moved), some(i, len(lanes))
    solved, ends = correct(
        problem,
        lanes[own],
        guesses[own],
        Border(rows[own], levels[own], _bending(barriers, i, rows[own], levels[own])),
        tangents[own],
        options,
        least=options.least,
        rough=np.where(lands, 0.0, options.rough)[own] if options.rough else 0.0,
        reach=options.reach * most[own],
        record=problem.records and not options.divided,
    )
    own = some(i := i[solved], len(lanes))
    for k in barriers.keys() & {*i.tolist()}:
        levels[k] = rows[k] @ ends.xs[np.searchsorted(i, k)]
        lands[k] = True
    moved, turned = _apart(problem, ends, guesses[own], tangents[own])
    good = (moved <= most[own]) & (turned <= options.turned)
    good &= problem.accepts(ends.having(xs=xs[own], tangents=tangents[own], own=None), ends) if good.any() else False
    ratios = options.ratios(moved * np.sqrt(ends.growths), used[own])
    longest = max(options.longest, options.apart) if options.divided else options.longest
    longer = np.minimum(np.maximum(taken, lengths)[own] * ratios, longest)
    if len(i) == len(lanes) and good.all():
        missed[:] = np.inf
        return Taken(i, ends.having(lengths=taken), rows, levels, longer, lands, missed, {})
    following = options.shorter * taken
    following[i[good]] = longer[good]
    reasons = {
        k: f"no point of the curve is found with a step of {taken[k]:.1e}"
        for k in np.delete(np.arange(len(lanes)), i).tolist()
    }
    for j in np.flatnonzero(~good).tolist():
        what = f"the corrector moves {moved[j]:.1e} in a step of {taken[i[j]]:.1e}"
        reasons[int(i[j])] = f"{what}, the tangent turns by {turned[j]:.2g}"
    i, ends = i[good], ends[good]
    missed[i], missed[list(barriers)] = np.inf, np.inf
    return Taken(i, ends.having(lengths=taken[i]), rows[i], levels[i], following, lands[i], missed, reasons)


def _bending(
    barriers: Mapping[int, Barrier], points: Array, rows: Array, levels: Array
) -> Callable[[Array, Array, Any], tuple[Array, Array]] | None:
    """The rows and levels of a `Border` that follow the barriers of points (k,), by their numbers; None where there are
    none."""
    if not barriers or barriers.keys().isdisjoint(points.tolist()):
        return None

    def bends(which: Array, xs: Array, _: Any) -> tuple[Array, Array]:
        own, wanted = rows[which], levels[which]
        for j, k in enumerate(points[which].tolist()):
            if (barrier := barriers.get(k)) is not None:
                own[j], wanted[j] = barrier.border(xs[j])
        return own, wanted

    return bends


def _predicted(problem: Problem, lanes: Array, tails: Tails, rows: Array, levels: Array) -> tuple[Array, Array]:
    """Points (k, n + 1) at levels (k,) of rows beyond the ends of tails, and the numbers (k,) of points used."""
    tangents, known = tails.tangents, tails.known
    if type(problem).steady is not Problem.steady:
        tangents = tangents.copy()
        tangents[known] = problem.steady(np.repeat(lanes, known.sum(1)), tails.xs[known], tangents[known])
    return through(tails.xs, tangents, known, 0, rows, levels)


class Chain(NamedTuple):
    """Points (c,) of curves, in order along each, one lane after another."""

    lanes: Array
    xs: Array
    tangents: Array

    @classmethod
    def of(cls, lanes: Array, tails: Tails, ends: Sequence[Points]) -> tuple["Chain", Array, Array]:
        """The tails of lanes (k,) with the ends of their next steps; the places (g,) of these ends, and the indices
        (g,) of the ends in that order."""
        flat = (each[tails.known] for each in (tails.xs, tails.tangents))
        repeated = np.repeat(lanes, tails.known.sum(1))
        first = len(repeated)
        parts = zip((repeated, *flat), *((each.lanes, each.xs, each.tangents) for each in ends), strict=True)
        arrays = [np.concatenate(part) for part in parts]
        order = np.argsort(arrays[0], kind="stable")
        places = np.flatnonzero(order >= first)
        return cls(*(each[order] for each in arrays)), places, order[places] - first

    def at(self, places: Array, behind: int, ahead: int, rows: Array, levels: Array) -> Array:
        """Points (q, n + 1) at levels (q,) of rows on interpolants of up to `behind` points before a place (q,) and
        `ahead` points from there on, of the same lane."""
        if not len(places):
            return np.empty((0, self.xs.shape[1]))
        indices = places[:, None] + np.arange(-behind, ahead)
        within = np.minimum(np.maximum(indices, 0), len(self.xs) - 1)
        use = (indices == within) & (self.lanes[within] == self.lanes[places - 1][:, None])
        return through(self.xs[within], self.tangents[within], use, ahead, rows, levels)[0]


class Division(NamedTuple):
    """Steps (g,) that are divided: the chain with their ends, the places (g,) of these in it, the borders at which they
    were found (g, n + 1) and (g,), the numbers (g,) of parts, and the requested values of the parameter on each."""

    chain: Chain
    ends: Array
    rows: Array
    levels: Array
    parts: Array
    values: Sequence[Array]


def between(problem: Problem, steps: Division, options: Steps) -> tuple[Points, Array, Array]:
    """The points on steps (g,), up to and including their ends, and at the requested values.

    Returns the points of each lane up to the first one that may lie on another curve, whether each is the end of a
    step, and whether all points of each step (g,) are accepted.
    """
    chain, ends, side = steps.chain, steps.ends, options.beside
    lanes, before = chain.lanes[ends], chain.tangents[ends - 1]
    sizes, chords = problem.size(lanes, chain.xs[ends - 1]), chain.xs[ends] - chain.xs[ends - 1]
    lengths = np.sqrt(((chords / sizes) ** 2).sum(1))
    of, rows, levels, ahead = _places(steps, chords / sizes**2 / (lengths**2)[:, None], options)
    steady = chain._replace(tangents=problem.steady(*chain))
    guesses = np.where(ahead[:, None], 0.0, chain.xs[ends[of]])
    guesses[ahead] = steady.at(ends[of[ahead]], side, side, rows[ahead], levels[ahead])
    most = np.minimum(options.corrected * lengths, options.moved)[of]
    border, reach = Border(rows, levels), options.reach * most
    rough = np.where(ahead, options.rough, np.inf) if options.rough else 0.0  # the ends are solved except for a step
    which, points = correct(problem, lanes[of], guesses, border, before[of], options, rough=rough, reach=reach)
    good, whole = np.zeros(len(of), bool), np.ones(len(ends), bool)
    if len(which):
        tangents = np.concatenate([before[:1], points.tangents[:-1]])
        first = np.flatnonzero(is_first(points.lanes))
        tangents[first] = before[of[which[first]]]
        moved, turned = _apart(problem, points, guesses[which], tangents)
        good[which] = (moved <= most[which]) & (turned <= options.turned)
    np.logical_and.at(whole, of, good)
    sound = up_to_the_first(lanes[of], ~good)[which]
    found = points[sound].having(lengths=(lengths / steps.parts)[of][which][sound])
    return found, ~ahead[which][sound], whole


def _places(steps: Division, rows: Array, options: Steps) -> tuple[Array, Array, Array, Array]:
    """The places (q,) to be solved, in order: the step of each (q,), its border (q, n + 1) and (q,), and whether it
    lies before the step's end (q,). The rows (g, n + 1) measure the share of each chord."""
    chain, ends, parts, n = steps.chain, steps.ends, steps.parts, rows.shape[1]
    starts = (rows * chain.xs[ends - 1]).sum(1)
    each, regular = np.arange(len(ends)), np.repeat(np.arange(len(ends)), parts - 1)
    shares = np.concatenate([np.arange(1, count) / count for count in parts])
    at = np.repeat(each, [len(own) for own in steps.values])
    wanted = np.concatenate([np.empty(0), *steps.values])
    along_parameter = np.tile(np.eye(1, n, n - 1), (len(at), 1))
    found = chain.at(ends[at], options.beside, options.beside, along_parameter, wanted)
    taken = (rows[at] * found).sum(1) - starts[at]
    crowded = np.abs(shares[:, None] - taken) * parts[regular][:, None] <= options.separation
    free = ~(crowded & (regular[:, None] == at)).any(1)
    regular, shares = regular[free], shares[free]
    of = np.concatenate([regular, at, each])
    order = np.lexsort((np.concatenate([shares, taken, np.ones(len(ends))]), of))
    all_rows = np.concatenate([rows[regular], along_parameter, steps.rows])
    levels = np.concatenate([starts[regular] + shares, wanted, steps.levels])
    before_end = np.arange(len(of)) < len(regular) + len(at)
    return of[order], all_rows[order], levels[order], before_end[order]


def is_first(lanes: Array) -> Array:
    """Which points (m,), in order along their lanes (m,), are the first ones of these."""
    first = np.ones(len(lanes), bool)
    first[1:] = lanes[1:] != lanes[:-1]
    return first


def up_to_the_first(lanes: Array, bad: Array) -> Array:
    """Which points (m,), in order along their lanes (m,), come before the first bad one of their lane."""
    first = np.full(int(lanes.max(initial=-1)) + 1, len(lanes))
    np.minimum.at(first, lanes[bad], np.flatnonzero(bad))
    return np.arange(len(lanes)) < first[lanes]


def _apart(problem: Problem, points: Points, guesses: Array, before: Array) -> tuple[Array, Array]:
    """The distances (m,) of points from their guesses (m, n + 1), in units, and the angles (m,) of their tangents with
    those before (m, n + 1)."""
    sizes = problem.size(points.lanes, guesses) if len(points) else guesses
    away, a, b = (points.xs - guesses) / sizes, before / sizes, points.tangents / sizes
    cosines = (a * b).sum(1) / np.sqrt((a * a).sum(1) * (b * b).sum(1))
    return np.sqrt((away * away).sum(1)), np.arccos(np.minimum(np.maximum(cosines, -1.0), 1.0))
