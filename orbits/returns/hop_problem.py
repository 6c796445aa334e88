"""Hops with a word that return as equations in all of their unknowns and in parameters: the problem of their curves.

The unknowns are those of each hop in turn, and behind them the parameters. The equations of each hop are those of
`hop_statement`, and that the next launch, with the injection, is that of the hop behind it.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from ..curves import Points, Problem
from ..errors import NoOrbit
from ..flow import Trajectories
from ..hops import LIFTOFF_ORDER
from ..numerics import ROOTS, evaluate, solve
from ..shooting import Evaluation
from .hop_statement import (
    CONTACT,
    FORCE,
    GAP,
    ORDER_OF_IMPACT,
    REST,
    SPEED,
    HopEquations,
    Slack,
    Word,
    forces_in_contact,
    slacks_of,
)
from .hops_along import INJECT, HopsAlong

Array = np.ndarray
ROUNDED_GAP = 1e-14  # gaps are rounded by less, which counts in short flights
AHEAD = 1e-5  # a step along a tangent for differences
# The shares of the time of an arc at which gap and force are sampled, more densely towards its ends.
SHARES_OF_ARC = 0.5 - 0.5 * np.cos(np.pi * (np.arange(128) + 0.5) / 128)


class HopValues(NamedTuple):
    """The equations at points (m, n + 1).

    residual, jacobian : (m, n), (m, n, n + 1)
    slacks, steps : (m, k), those with a row in the statement, and their derivatives (m, k, n + 1)
    slopes : derivatives (m, period, d, d) of each next launch by the launch before it
    xs : the points
    first : (m, period, 2), the speed of the gap at the first landing of each hop and the force after it
    hops : the equations of the hops of all points by their number of impacts
    """

    residual: Array
    jacobian: Array
    slacks: Array
    slopes: Array
    steps: Array
    xs: Array
    first: Array
    hops: Mapping[int, Evaluation]

    @property
    def amplification(self) -> Array:
        """The growths (m,) of small changes: hops are short motions, and amplify nothing."""
        return np.ones(len(self.residual))


class SameHops(NamedTuple):
    """The hops (h,) of a word with the same number of impacts.

    blocks, unknowns, columns : the places of their own unknowns (h, n), of those with the parameters that are unknowns
        of their equations, and of these with the varied ones
    slacks, rows, signs : the places of their slacks (h, k), and the rows (k,) and signs (k,) of these
    """

    impacts: int
    hops: Array
    equations: HopEquations
    blocks: Array
    unknowns: Array
    columns: Array
    slacks: Array
    rows: Array
    signs: Array


class HopProblem(Problem):
    """The equations of hops with a word that return.

    hops : the machines along a parameter
    word : the numbers of impacts
    names : of the parameters behind the unknowns of the hops
    equations : number of impacts -> the equations of a hop
    """

    def __init__(self, hops: HopsAlong, word: Word, names: tuple[str, ...], equations: Callable[[int], HopEquations]):
        self.hops, self.word, self.names, self.equations = hops, word, names, equations
        self.period, self.d = len(word), len(hops.free)
        self.vary = tuple(name for name in names if name != INJECT)
        sizes = [len(equations(count).rows) for count in word]
        ends = np.cumsum(sizes)
        self.count = int(ends[-1])  # of the unknowns of the hops
        self.blocks = [np.arange(end - size, end) for end, size in zip(ends, sizes, strict=True)]
        self.free = np.array([own[equations(c).free] for own, c in zip(self.blocks, word, strict=True)])  # (period, d)
        self.speed = hops.free.index("alpha")
        self.speeds = self.free[:, self.speed]
        self.slacks = slacks_of(word)
        self.exact = sum(each.kind in (FORCE, SPEED, REST) for each in self.slacks)
        self.groups = [self._group(impacts) for impacts in sorted({*word})]
        # The last rows of each hop are those of its next launch.
        self.last = np.array([own[-self.d :] for own in self.blocks])

    def _group(self, impacts: int) -> "SameHops":
        """The hops of the word with a number of impacts."""
        hops, equations = np.flatnonzero(np.array(self.word) == impacts), self.equations(impacts)
        last = np.arange(impacts) + 1 == impacts
        rows = np.concatenate([equations.forces, equations.speeds[~last], equations.next[[self.speed]]])
        signs = np.concatenate([np.where(last, 1.0, -1.0), np.full(impacts - 1, -1.0), [1.0]])
        kinds = slacks_of((impacts,))[: len(rows)]
        own = [[self.slacks.index(each._replace(hop=int(hop))) for each in kinds] for hop in hops]
        blocks = np.array([self.blocks[hop] for hop in hops])
        # The parameters are behind the unknowns of the hops: those of the equations, and others that vary.
        among = [self.count + i for i in range(len(self.names))]
        known = [k for k, name in zip(among, self.names, strict=True) if name in equations.equations.statement.unknowns]
        varied = [k for k, name in zip(among, self.names, strict=True) if name in self.vary]
        unknowns, columns = (np.column_stack([blocks, np.tile(more, (len(hops), 1))]) if more else blocks
                             for more in (known, known + varied))  # fmt: skip
        return SameHops(impacts, hops, equations, blocks, unknowns, columns, np.array(own), rows, signs)

    def evaluate(
        self, lanes: Array, xs: Array, known: object = None, moved: Array | None = None
    ) -> tuple[Array, HopValues | None]:
        """The equations at points (m, n + 1), without those at which a hop cannot be followed."""
        m, n, d = len(xs), xs.shape[1] - 1, self.d
        ps, (injected, rates) = self.parameters(xs), self.injection(xs)
        residual, jacobian = np.zeros((m, n)), np.zeros((m, n, n + 1))
        slacks, steps = np.zeros((m, self.exact)), np.zeros((m, self.exact, n + 1))
        slopes, first = np.zeros((m, self.period, d, d)), np.zeros((m, self.period, 2))
        bends, found = np.zeros((m, self.period, n + 1)), dict[int, Evaluation]()
        for group in self.groups:
            equations, count = group.equations, len(group.hops)
            own, of_hops = xs[:, group.unknowns].reshape(m * count, -1), np.repeat(ps, count, axis=0)
            with np.errstate(all="ignore"):
                done, evaluation = equations.equations.evaluate_lanes(own, of_hops, self.vary, fewest=True)
            if evaluation is None or len(done) < len(own):
                able = np.setdiff1d(np.arange(m), np.setdiff1d(np.arange(len(own)), done) // count)
                which, others = self.evaluate(lanes[able], xs[able]) if len(able) else (able, None)
                return able[which], others
            found[group.impacts] = evaluation
            rows = evaluation.residual.reshape(m, count, -1)
            changes = evaluation.jacobian.reshape(m, count, rows.shape[2], -1)
            if equations.slope is None:
                slopes[:, group.hops] = equations.derivatives(evaluation.jacobian).reshape(m, count, d, d)
            else:
                slopes[:, group.hops] = rows[:, :, equations.slope, None, None]
                bends[:, group.hops[:, None], group.columns] = changes[:, :, equations.slope]
            first[:, group.hops] = rows[:, :, [equations.speeds[0], equations.forces[0]]]
            residual[:, group.blocks] = rows[:, :, equations.rows]
            jacobian[:, group.blocks[:, :, None], group.columns[:, None]] = changes[:, :, equations.rows]
            slacks[:, group.slacks] = group.signs * rows[:, :, group.rows]
            signed = group.signs[:, None] * changes[:, :, group.rows]
            steps[:, group.slacks[:, :, None], group.columns[:, None]] = signed
        following, last = np.roll(self.free, -1, axis=0), self.last[:, self.speed]
        residual[:, self.last] -= xs[:, following]
        residual[:, last] += injected[:, None]
        for hop in range(self.period):
            jacobian[:, self.last[hop], following[hop]] -= 1.0
        jacobian[:, last, n + 1 - rates.shape[1] :] += rates[:, None]
        values = HopValues(residual, jacobian, slacks, slopes, steps, xs.copy(), first, found)
        self.close(values, bends)
        return np.arange(m), values

    def parameters(self, xs: Array) -> Array:
        """The parameters (m, np) of the machine at points (m, n + 1)."""
        raise NotImplementedError

    def injection(self, xs: Array) -> tuple[Array, Array]:
        """The injection (m,) without units at points, and its derivatives (m, k) by the k last components."""
        raise NotImplementedError

    def close(self, values: HopValues, bends: Array) -> None:
        """Complete the equations; `bends` are the derivatives (m, period, n + 1) of the slopes where these are
        known."""

    def time(self, hop: int, flight: int) -> int:
        """The place among the unknowns of the time of a flight, or behind the last one of the contact."""
        return int(self.blocks[hop][flight] + len(self.hops.model.launch_unknowns))

    def rounding(self, evaluation: HopValues, rows: Array) -> Array | float:
        """Equations are rounded as the products of their derivatives and the unknowns are, and the more the shorter the
        flights or the nearer the launches are by which they are divided."""
        bordered = np.concatenate([evaluation.jacobian, rows[:, None]], axis=1)
        noise = ROOTS.unit * (np.abs(evaluation.jacobian) @ np.abs(evaluation.xs)[:, :, None])
        inverses = np.abs(solve(bordered, np.tile(np.eye(rows.shape[1]), (len(rows), 1, 1))))
        return (inverses[:, :, :-1] @ noise)[:, :, 0]

    def sampled(self, points: Points) -> Array:
        """The least gaps in flights and forces in contacts (m, k) at points, as the slacks behind the exact ones."""
        m, model = len(points), self.hops.model
        sampled = np.empty((m, len(self.slacks) - self.exact))
        ps, force = self.parameters(points.xs), forces_in_contact(model, self.hops.names)
        for group in self.groups:
            count = len(group.hops)
            which = (points.places[:, None] * count + np.arange(count)).ravel()
            many = np.repeat(ps, count * len(SHARES_OF_ARC), axis=0)
            named = dict(zip(self.hops.names, many.T, strict=True))
            for i, motions in enumerate(points.evaluation.hops[group.impacts].trajectories):
                flies = i < group.impacts
                phase = model.flight if flies else model.contact
                x = rows_within(motions[which], SHARES_OF_ARC, len(phase.states))
                values = model.gap(named).at([*x.T]) if flies else force(x, many)[0]
                least = _least(self._divided(np.reshape(values, (m, count, -1)), i if flies else None))
                slacks = [Slack(GAP, hop, i) if flies else Slack(CONTACT, hop) for hop in group.hops.tolist()]
                sampled[:, [self.slacks.index(each) - self.exact for each in slacks]] = least
        return sampled

    @staticmethod
    def _divided(values: Array, flight: int | None) -> Array:
        """The gaps in a flight, or the forces in contact for None, at the shares (..., k) of an arc, divided by their
        zeros at its ends."""
        order = 0 if flight is None else ORDER_OF_IMPACT if flight else LIFTOFF_ORDER
        return (values + ROUNDED_GAP) / (SHARES_OF_ARC**order * (1.0 - SHARES_OF_ARC))

    def _motions(self, xs: Array, slack: Slack, flight: int) -> Any:
        """The motions of a flight of the hop of a slack at X (1, n + 1)."""
        _, found = self.evaluate(np.zeros(1, int), xs)
        if found is None:
            raise NoOrbit(f"the hops cannot be followed near {self.names[-1]} = {xs[0, -1]:g}")
        count = self.word[slack.hop]
        hops = [each for each, other in enumerate(self.word) if other == count]
        return found.hops[count].trajectories[flight][np.array([hops.index(slack.hop)])]

    def landing(self, point: Points, slack: Slack) -> Array:
        """The flight state (n,) before the impact of a slack at a point (1)."""
        return self._motions(point.xs, slack, slack.impact).finals[0, : len(self.hops.model.flight.states)]

    def lowest(self, point: Points, slack: Slack) -> float:
        """The time in the flight of a slack at which the gap is least, nearly."""
        motions, model = self._motions(point.xs, slack, slack.impact), self.hops.model
        p = dict(zip(self.hops.names, self.parameters(point.xs)[0], strict=True))
        gaps = model.gap(p).at([*rows_within(motions, SHARES_OF_ARC, len(model.flight.states)).T])
        return float(SHARES_OF_ARC[int(np.argmin(self._divided(gaps, slack.impact)))] * motions.ends[0])

    def grows(self, point: Points, slack: Slack) -> bool:
        """Whether a slack that is sampled grows along the tangent at a point (1)."""
        values = list[float]()
        for xs in (point.xs, point.xs + AHEAD * point.tangents):
            _, found = self.evaluate(np.zeros(1, int), xs)
            if found is None:
                raise NoOrbit(f"the hops cannot be followed near {self.names[-1]} = {xs[0, -1]:g}")
            columns = self.sampled(point.having(xs=xs, evaluation=found, places=np.zeros(1, int)))
            values.append(float(columns[0, self.slacks.index(slack) - self.exact]))
        return values[1] > values[0]


def _least(values: Array) -> Array:
    """The least values (...) of functions with these values (..., k) at the shares of an arc, by the parabolas through
    three of them, which are exact near a lossless hop."""
    widths, middle = np.diff(SHARES_OF_ARC), values[..., 1:-1]
    slopes = np.diff(values) / widths
    bend = np.diff(slopes) / (widths[1:] + widths[:-1])
    slope = slopes[..., :-1] + bend * widths[:-1]
    inside = (middle <= values[..., :-2]) & (middle <= values[..., 2:]) & (bend > 0)
    deeper = middle - np.where(inside, slope**2, 0.0) / np.where(inside, 4 * bend, 1.0)
    return np.minimum(values.min(-1), deeper.min(-1))


def rows_within(motions: Trajectories, shares: Array, count: int) -> Array:
    """The first rows (m k, count) of motions (m,) at k shares of the time of each."""
    places, apart = shares * motions.ends[:, None], 2.0 * float(motions.ends.max())
    each = apart * np.arange(len(motions))
    step = np.searchsorted(motions.starts + apart * motions.owner, places + each[:, None], side="right") - 1
    return evaluate(motions.coefficients[step.ravel(), :count], (places - motions.starts[step]).ravel()[:, None])
