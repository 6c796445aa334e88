"""Ways of the parameters of many machines, along which the orbits of all machines are followed together.

In each round every machine takes a step of its own length along its way: a predictor from the tangents, and Newton's
method back to the orbits. A step is accepted where the predictor was good and the tangents at both ends agree with it,
so that no orbit of another family is mistaken for this one, and where the orientation of the equations stays, so that
none beyond a fold is. Where motions come to amplify small changes they are divided at nodes, since Newton's method
without nodes would lead to other orbits.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ..errors import FlowError, NoOrbit
from ..numerics import TINY, Array, solve
from ..running import interrupts
from ..shooting import DIVISION, NEWTON, Division, NodedSolution, PartsOfArcs, Shooting, Undetermined

# What a `_Stretch` has as `most_growth` where motions pass two unstable equilibria, and why they are not led further.
NOT_DIVIDED = np.inf, DIVISION.sensitive
PASSES_TWO = "the motion passes two unstable equilibria one after the other: follow the family there"


class WayOptions(NamedTuple):
    """Steps along ways, which are shares of them. Errors are shares of the unknowns' sizes, and misses, the changes of
    the equations that belong to them, shares of the largest unknown, since orbits of other families are near where
    motions are long, or amplify small changes: these have other tangents, or lie away from the prediction.

    shortest, most : a way is given up where a step of the shortest length is rejected, or after the most rounds
    shorter, shorten, lengthen : ratio of a step to the rejected one before it, and bounds of that to an accepted one
    moved : largest error and miss of an accepted step, of its prediction and of the mean of the tangents at its ends
    aim : share of these that the next step is to have
    across_branch : where the orientation of the equations changes, a step over a branch point is accepted if the error
        is at most this share of the step; beyond a fold it would be as large as the step
    corrections : largest number of Newton steps
    rough : a Newton step with a smaller error and miss leads to a point that serves for the next step
    contraction : a guess is not in the basin of the orbit if a Newton step shrinks by no more than this
    towards_fold : largest share of the distance to a fold that a step goes over
    same_fold, near_fold : a fold is certain if two successive estimates of its place differ by less than the first
        share of what lies beyond it, and it is nearer than the second
    """

    shortest: float = 1e-9
    most: int = 200
    shorter: float = 0.25
    shorten: float = 0.3
    lengthen: float = 4.0
    moved: float = 0.1
    aim: float = 0.3
    across_branch: float = 0.02
    corrections: int = NEWTON.steps
    rough: float = 1e-2
    contraction: float = 0.3
    towards_fold: float = 0.6
    same_fold: float = 0.02
    near_fold: float = 1e-3


STRAIGHT_WAYS = WayOptions()


class WaysDone(NamedTuple):
    """The result of following ways: the unknowns (m, n) at their ends, NaN for machines that were given up; the shares
    (m,) of the way that are done, and the shares (m,) at which there is a fold, infinite without any; the solutions at
    the ends of those, by index, on which motions were divided; and why others are not led further, by index, where that
    is known."""

    us: Array
    shares: Array
    folds: Array
    noded: dict[int, NodedSolution]
    reasons: dict[int, str]


class _Stretch(NamedTuple):
    """A stretch of the ways of some machines (k,): the shares (k,) where it begins, the unknowns (k, N) there, with the
    nodes of a division, if any; the rounds (k,) that have been needed before; where small changes grow more than the
    first of two numbers a motion is divided, and with more than the second it is not led further."""

    which: Array
    shares: Array
    xs: Array
    rounds: Array
    division: Division | None = None
    most_growth: tuple[float, float] = (DIVISION.growth, DIVISION.sensitive)


def along_ways(
    equations: Shooting, us: Array, starts: Array, ends: Array, vary: tuple[str, ...],
    report: Callable[[int], None] = lambda ended: None, options: WayOptions = STRAIGHT_WAYS,
) -> WaysDone:  # fmt: skip
    """The orbits at the ends of straight ways of the parameters (m, np), from orbits with unknowns (m, n) at their
    starts; the parameters `vary` change along the ways."""
    count = len(us)
    ways = WaysDone(np.full(us.shape, np.nan), np.zeros(count), np.full(count, np.inf), {}, {})
    stretches = [_Stretch(np.arange(count), np.zeros(count), us, np.zeros(count, int))]
    while stretches:
        stretch = stretches.pop()
        which, waiting = stretch.which, sum(len(each.which) for each in stretches)
        here, there = _parameters_at(starts[which], ends[which], stretch.shares), ends[which]
        own = stretch.division.equations if stretch.division else equations
        ended = lambda going, last=count - waiting: report(last - going)  # noqa: E731
        lanes = _went_along(own, stretch, here, there, vary, ended, options)
        done, done_before = lanes.shares == 1.0, stretch.shares
        ways.shares[which] = np.where(done, 1.0, done_before + (1 - done_before) * lanes.shares)
        # Just behind a fold the last point is near the orbits before it, whence Newton's method does not converge.
        beside = done & ~lanes.hangs & (lanes.folds < 1 + options.near_fold)
        folds = np.where(lanes.at_fold | beside, lanes.folds, np.inf)
        certain = folds < np.inf
        ways.folds[which[certain]] = (done_before + (1 - done_before) * np.where(certain, folds, 0.0))[certain]
        for k in np.flatnonzero(done & ~lanes.hangs).tolist():
            i, x = int(which[k]), lanes.us[k]
            anew = stretch.most_growth == NOT_DIVIDED
            if stretch.division is None and not anew:
                ways.us[i] = x
            elif found := _with_nodes(equations, stretch.division, x, there[k], ways.reasons, i, anew, options):
                ways.us[i], ways.noded[i] = found.u, found
        if stretch.most_growth == NOT_DIVIDED:
            lost = np.flatnonzero(~done & ~lanes.at_fold).tolist()
            ways.reasons.update((int(which[k]), PASSES_TWO) for k in lost)
        at = _parameters_at(here, there, lanes.shares)
        stretches += _divided(equations, stretch, lanes, at, ways.shares[which], ways.reasons)
    return ways


def _parameters_at(starts: Array, ends: Array, shares: Array) -> Array:
    """The parameters (m, np) at shares (m,) of ways."""
    return np.where(shares[:, None] == 1.0, ends, starts + shares[:, None] * (ends - starts))


def _went_along(
    equations: Shooting, stretch: _Stretch, starts: Array, ends: Array, vary: tuple[str, ...],
    report: Callable[[int], None], options: WayOptions,
) -> "_Lanes":  # fmt: skip
    """The machines of a stretch, with parameters (k, np) at its start, as far as they get on the rest of their ways;
    `report` is called with the number of machines that are still going."""
    places, lanes = [equations.parameters.index(name) for name in vary], _Lanes(stretch, equations.own, options)
    ways = (ends - starts)[:, places, None]
    which, evaluation = equations.evaluate_lanes(stretch.xs, starts, vary)
    if evaluation is not None:
        lanes.begin(which, evaluation.jacobian, ways[which], evaluation.amplification)
    while len(going := np.flatnonzero(lanes.going & (lanes.rounds < options.most))):
        interrupts.heed()
        new, guesses = lanes.predicted(going)
        ps = _parameters_at(starts[going], ends[going], new)
        solved, found, jacobians, growths = _near_guesses(equations, guesses, ps, vary, lanes.least[going], options)
        lanes.accept(going, new, guesses, solved, found, jacobians, growths, ways)
        report(int(np.count_nonzero(lanes.going)))
    return lanes


def _divided(
    equations: Shooting, stretch: _Stretch, lanes: "_Lanes", ps: Array, shares: Array, reasons: dict[int, str]
) -> Iterator[_Stretch]:
    """The stretches that follow for the machines whose motions come to amplify small changes, with parameters (k, np)
    at shares (k,) of their ways: with nodes, those with as many of them together, or without where these are of no
    use, as where small changes grow within a short time; and where a motion passes two unstable equilibria as far as it
    needs no nodes, since tangents at these have few digits."""
    following = dict[PartsOfArcs, list[tuple[int, NodedSolution]]]()
    for k in np.flatnonzero(lanes.hangs).tolist():
        if stretch.division and lanes.shares[k] == 0:  # it has been divided here already
            continue
        here = lanes.us[k], ps[k], reasons, int(stretch.which[k])
        found = _with_nodes(equations, stretch.division, *here, True, lanes.options)
        passes = found is not None and found.division is not None and found.division.is_uneven
        if found and found.division and not passes:
            following.setdefault(found.division.parts, []).append((k, found))
        elif stretch.division is None:
            alone = stretch.which[[k]], shares[[k]], lanes.us[[k]], lanes.rounds[[k]]
            yield _Stretch(*alone, most_growth=NOT_DIVIDED if passes else (np.inf, np.inf))
    for each in following.values():
        own = [k for k, _ in each]
        xs = np.array([found.x for _, found in each])
        yield _Stretch(stretch.which[own], shares[own], xs, lanes.rounds[own], each[0][1].division)


def _with_nodes(
    equations: Shooting, division: Division | None, x: Array, p: Array, reasons: dict[int, str], which: int,
    anew: bool, options: WayOptions,
) -> NodedSolution | None:  # fmt: skip
    """The solution near unknowns (N,) with the nodes of a division, if any, and parameters (np,): with the nodes that
    it asks for where it is divided `anew`, else with nodes where they are of use. None without one nearby; the reason
    of the machine `which` is noted where there is one that its launch does not determine."""
    own = division.equations if division else equations
    try:
        known = NodedSolution(equations, division, x, p, own.evaluate_all(x[None], p[None]))
        found = known.with_nodes() if anew else known.near(x, p).simplest()
    except Undetermined as error:
        reasons[which] = str(error)
        return None
    except (NoOrbit, FlowError):
        return None
    sizes = sizes_of_unknowns(known.u[None], 0.1 * np.abs(known.u[None, equations.own :]) + TINY)
    return found if (np.abs(found.u - known.u) / sizes).max() < options.moved else None


class _Lanes:
    """The machines (m,) on their ways: whether each is `going`, the share of its way that is done, its unknowns there
    and their derivatives by the share, the same one step before, the length of the next step, the orientation of the
    equations, and the share at which a fold is expected, infinite where none is; the least sizes of those unknowns,
    after the first `own` ones, that are tuned parameters; the rounds needed; and whether its motion `hangs`, that is,
    has come to amplify small changes, and is to be divided before it continues. The shares are those of a stretch."""

    def __init__(self, stretch: _Stretch, own: int, options: WayOptions):
        self.options = options
        us, count = stretch.xs, len(stretch.xs)
        self.rounds, self.hangs = stretch.rounds.copy(), np.zeros(count, bool)
        self.most_growth = stretch.most_growth
        self.least = 0.1 * np.abs(us[:, own:])
        self.us, self.tangents, self.before, self.tangents_before = us.copy(), *np.full((3, *us.shape), np.nan)
        self.shares, self.steps, self.orientations = np.zeros(count), np.ones(count), np.zeros(count)
        self.shares_before, self.folds = np.full(count, np.nan), np.full(count, np.inf)
        self.going, self.at_fold = np.zeros(count, bool), np.zeros(count, bool)

    def begin(self, which: Array, jacobians: Array, ways: Array, growths: Array) -> None:
        """Begin those lanes (k,) at whose starts the equations have these Jacobians, and small changes grow so much."""
        self.hangs[which] = growths > self.most_growth[0]
        self.tangents[which], self.orientations[which] = _tangents(jacobians, ways)
        self.going[which] = np.isfinite(self.tangents[which]).all(1) & ~self.hangs[which]
        tuned = self.least.shape[1]
        changes = np.nan_to_num(np.abs(self.tangents[:, self.tangents.shape[1] - tuned :]))
        self.least = np.maximum(np.maximum(self.least, 0.1 * changes), TINY)

    def predicted(self, lanes: Array) -> tuple[Array, Array]:
        """The shares (k,) to which some lanes step, and the unknowns (k, n) predicted there: on the cubic through the
        last two points with their tangents, or on the tangent."""
        done, left = self.shares[lanes], 1 - self.shares[lanes]
        steps = np.minimum(self.steps[lanes], left)
        new = np.where(steps < left, done + steps, 1.0)
        u, by_share = self.us[lanes], self.tangents[lanes]
        guesses = u + (new - done)[:, None] * by_share
        gaps = (done - self.shares_before[lanes])[:, None]
        ahead = (new - done)[:, None] / gaps
        first = self.before[lanes] - u + gaps * by_share
        second = gaps * (self.tangents_before[lanes] - by_share)
        cubic = guesses + (second + 3 * first) * ahead**2 + (second + 2 * first) * ahead**3
        return new, np.where(np.isfinite(cubic), cubic, guesses)

    def accept(
        self, lanes: Array, new: Array, guesses: Array, solved: Array, found: Array, jacobians: Array, growths: Array,
        ways: Array,
    ) -> None:  # fmt: skip
        """Take the steps of lanes (k,) to shares (k,) that are good, and shorten the others: the `solved` ones, by
        their indices, with the unknowns found, and the Jacobians and the growths of small changes there."""
        self.rounds[lanes] += 1
        options = self.options
        refused, lanes_found, old = np.ones(len(lanes), bool), lanes[solved], self.us[lanes[solved]]
        if len(solved):
            tangents, orientations = _tangents(jacobians, ways[lanes_found])
            taken = new[solved] - self.shares[lanes_found]
            means = taken[:, None] * (tangents + self.tangents[lanes_found]) / 2
            sizes = sizes_of_unknowns(found, self.least[lanes_found])
            changes, shares = (np.abs(found - old) / sizes).max(1), np.zeros(len(solved))
            for error in (found - guesses[solved], found - old - means):
                moved = (np.abs(error) / sizes).max(1)
                misses = _misses((jacobians[:, :, : found.shape[1]] @ error[:, :, None])[:, :, 0], found, self.least)
                shares = np.maximum(shares, np.maximum(moved, misses) / options.moved)
            turned = orientations != self.orientations[lanes_found]
            good = (shares <= 1.0) & np.isfinite(tangents).all(1) & (growths <= self.most_growth[1])
            good &= ~turned | (shares * options.moved <= options.across_branch * np.minimum(changes, 1.0))
            refused[solved[good]] = False
            growth = (options.aim / np.maximum(shares, 1e-12)) ** (1 / 3)
            self._take(
                lanes_found[good], new[solved][good], found[good], tangents[good], orientations[good],
                np.clip(growth[good], options.shorten, options.lengthen),
            )  # fmt: skip
            self._divide(lanes_found[good], growths[good])
        short = lanes[refused]
        self.steps[short] = options.shorter * np.minimum(self.steps[short], 1 - self.shares[short])
        lost = short[self.steps[short] < options.shortest]
        self.going[lost] = False
        self.at_fold[lost] = self.folds[lost] - self.shares[lost] < options.near_fold * self.folds[lost]

    def _take(self, lanes: Array, new: Array, us: Array, tangents: Array, orientations: Array, growth: Array) -> None:
        """Step lanes (k,) to shares (k,)."""
        done, old = self.shares[lanes], self.tangents[lanes]
        # Near a fold the inverse square of the tangent's length falls to zero like a straight line.
        rates = [
            1 / np.maximum(((t / sizes_of_unknowns(u, self.least[lanes])) ** 2).sum(1), TINY)
            for t, u in ((old, self.us[lanes]), (tangents, us))
        ]
        with np.errstate(all="ignore"):
            folds = new + rates[1] * (new - done) / (rates[0] - rates[1])
        folds = np.where(rates[0] > rates[1], folds, np.inf)
        with np.errstate(invalid="ignore"):
            certain = np.abs(folds - self.folds[lanes]) < self.options.same_fold * np.minimum(folds, 1 - folds)
            certain &= folds - new < self.options.near_fold * folds
        self.before[lanes], self.tangents_before[lanes], self.shares_before[lanes] = self.us[lanes], old, done
        self.us[lanes], self.tangents[lanes], self.shares[lanes] = us, tangents, new
        self.orientations[lanes], self.folds[lanes] = orientations, folds
        self.steps[lanes] = np.minimum(growth * (new - done), self.options.towards_fold * (folds - new))
        self.at_fold[lanes] = certain
        self.going[lanes] = (new < 1.0) & ~certain

    def _divide(self, lanes: Array, growths: Array) -> None:
        """Stop those lanes (k,) whose motions are to be divided."""
        hangs = (growths > self.most_growth[0]) & ~self.at_fold[lanes]
        self.hangs[lanes], self.going[lanes] = hangs, self.going[lanes] & ~hangs


def sizes_of_unknowns(us: Array, least: Array) -> Array:
    """The unit of each of the unknowns (m, n), as of a curve's points; the last ones, tuned parameters, have their own
    least sizes (m, t)."""
    sizes, own = np.abs(us), us.shape[1] - least.shape[1]
    sizes[:, :own] = np.maximum(sizes[:, :own], 0.1 * sizes[:, :own].max(1, keepdims=True))
    sizes[:, own:] = np.maximum(sizes[:, own:], least)
    return sizes


def _misses(residuals: Array, us: Array, least: Array) -> Array:
    """The largest of the residuals (m, n) as shares (m,) of the largest of the unknowns (m, n) without tuned ones."""
    return np.abs(residuals).max(1) / np.abs(us[:, : us.shape[1] - least.shape[1]]).max(1)


def _tangents(jacobians: Array, ways: Array) -> tuple[Array, Array]:
    """The derivatives (m, n) of the unknowns by the share of the way, and the orientations (m,) of the equations."""
    n = jacobians.shape[1]
    tangents = -solve(jacobians[:, :, :n], jacobians[:, :, n:] @ ways)[:, :, 0]
    return tangents, np.linalg.slogdet(jacobians[:, :, :n])[0]


def _near_guesses(
    equations: Shooting, guesses: Array, ps: Array, vary: tuple[str, ...], least: Array, options: WayOptions
) -> tuple[Array, Array, Array, Array]:
    """The indices (k,) of guesses (m, n) from which Newton's method converges, the unknowns (k, n) nearly there, and
    the Jacobians (k, n, n + k) and the growths (k,) of small changes at the last points before."""
    us, left, last = guesses.copy(), np.arange(len(guesses)), np.full(len(guesses), np.inf)
    done, jacobians = np.zeros(len(us), bool), np.zeros((len(us), us.shape[1], us.shape[1] + len(vary)))
    growths = np.zeros(len(us))
    for _ in range(options.corrections):
        which, evaluation = equations.evaluate_lanes(us[left], ps[left], vary)
        if evaluation is None:
            break
        left, n = left[which], us.shape[1]
        steps = -solve(evaluation.jacobian[:, :, :n], evaluation.residual[:, :, None])[:, :, 0]
        with np.errstate(invalid="ignore"):
            sizes = (np.abs(steps) / sizes_of_unknowns(us[left], least[left])).max(1)
            misses = _misses(evaluation.residual, us[left], least)
            errors = np.maximum(sizes, misses)
            enough, goes = errors < options.rough, (errors < options.moved) & (sizes < options.contraction * last[left])
        ended = left[enough]
        us[ended] += steps[enough]
        done[ended], jacobians[ended] = True, evaluation.jacobian[enough]
        growths[ended] = evaluation.amplification[enough]
        goes &= ~enough
        us[left[goes]] += steps[goes]
        last[left] = sizes
        left = left[goes]
        if not len(left):
            break
    which = np.flatnonzero(done)
    return which, us[which], jacobians[which], growths[which]
