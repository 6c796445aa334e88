"""The stages of an optimal control problem: stated, as one nonlinear program, and travelled accurately."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from math import comb

import casadi as ca
import numpy as np

from ..errors import InputError
from ..flow.flow import Flow, flow_of
from ..flow.trajectory import Trajectory
from ..flow.vector_field import runge_kutta
from ..model.phase import Phase
from ..numerics.bernstein import PiecewisePolynomials, powers
from ..numerics.quadrature import GAUSS_PLACES, GAUSS_WEIGHTS
from ..symbolic.ipopt import Minimiser, Minimum
from ..symbolic.taylor_series import taylor_coefficients

# Order of the Taylor steps: twelve costs half of what the accurate flow's costs, and steps get shorter where it is low.
CONTROL_ORDER = 12
# What is this near to a bound, beside its size or one, is at it: an iteration that fails ends no nearer.
AT_BOUND = 1e-4
# Of Ipopt's: where states are large, rounding keeps an iteration from its end, and it would go on for long.
STALLS = {
    "ipopt.acceptable_iter": 15,
    "ipopt.acceptable_tol": 1e-6,
    "ipopt.acceptable_constr_viol_tol": 1e-10,
    "ipopt.acceptable_compl_inf_tol": 1e-8,
}
# Name of the length of an interval among the parameters; no identifier can be that.
LENGTH = "interval's length"


@dataclass(frozen=True)
class Input:
    """What may be done: a polynomial of this degree on each interval of a stage, jumping in between.

    low, high : bounds, numbers or p -> expression; of the polynomial's Bernstein coefficients, so that they hold
        everywhere, and up to degree 1 no more than that is asked
    """

    low: float | Callable = -np.inf
    high: float | Callable = np.inf
    degree: int = 0


@dataclass(frozen=True, eq=False)
class Stage:
    """A phase travelled once; functions are as in `Phase`, with the inputs by name in `p`, and q empty.

    intervals : number of them, all equally long
    duration : its bounds, the lower one above 0
    inputs : by name
    start : (x, before, p) -> zeros at its start, `before` being the end of the stage before, for the first one that of
        the last
    end : (x, p) -> zeros at its end
    path : named (x, p, q) -> what stays at or above zero
    running : (x, p, q) -> the cost's rate
    final : (x, p) -> cost at its end
    above : (x, p) -> what is at or above zero at its end

    Stages compare by identity: what is built from them is kept for the next call.
    """

    phase: Phase
    intervals: int
    duration: tuple[float, float]
    inputs: Mapping[str, Input] = field(default_factory=dict)
    start: Callable = lambda x, before, p: []
    end: Callable = lambda x, p: []
    path: Mapping[str, Callable] = field(default_factory=dict)
    running: Callable = lambda x, p, q: 0.0
    final: Callable = lambda x, p: 0.0
    above: Callable = lambda x, p: []


def coefficient_names(stage: Stage) -> tuple[str, ...]:
    """Names of the Bernstein coefficients of all inputs of a stage, in their order."""
    return tuple(f"{name}[{k}]" for name, given in stage.inputs.items() for k in range(given.degree + 1))


def at_bound(value, bound: float):
    """Whether values (...) are at a bound."""
    return np.abs(value - bound) <= AT_BOUND * (1.0 + np.abs(bound))


@lru_cache(maxsize=64)
def clocked(stage: Stage) -> Phase:
    """A stage's phase over one interval in shares of its length, with two more states: that clock, which the inputs'
    polynomials follow, and the running cost; it watches what stays positive."""
    size = len(stage.phase.states)

    def with_inputs(x, p):
        clock, named = x[size], dict(p)
        for name, given in stage.inputs.items():
            d = given.degree
            shapes = [comb(d, k) * clock**k * (1 - clock) ** (d - k) for k in range(d + 1)] if d else [1.0]
            named[name] = sum(p[f"{name}[{k}]"] * shape for k, shape in enumerate(shapes))
        return x[:size], named

    def field(x, p, q):
        states, named = with_inputs(x, p)
        given = [*stage.phase.field(states, named, q)]
        if len(given) != size:
            raise InputError(f"the field of the {stage.phase.name} gives {len(given)} rates for {size} states")
        rates = [*given, 1.0, stage.running(states, named, q)]
        return [rate if i == size else p[LENGTH] * rate for i, rate in enumerate(rates)]

    watch = {name: lambda x, p, q, of=of: of(*with_inputs(x, p), q) for name, of in stage.path.items()}
    return Phase(stage.phase.name, (*stage.phase.states, "clock", "cost"), field, watch)


@lru_cache(maxsize=64)
def advance(stage: Stage, names: tuple[str, ...], substeps: int) -> ca.Function:
    """(state, share, parameters with length and coefficients) -> state, running cost and path after that share of an
    interval."""
    graph = flow_of(clocked(stage), (*names, LENGTH, *coefficient_names(stage))).vector_field
    size, share = len(stage.phase.states), ca.SX.sym("share")
    if graph.has_series:
        series = taylor_coefficients(graph.field, graph.x, graph.p, CONTROL_ORDER)[: graph.size, :]
        at = lambda t: series @ ca.vertcat(*[t**k for k in range(CONTROL_ORDER + 1)])  # noqa: E731
        end = at(share)
        # A cost with near corners has a short series; by Gauss's rule it stays positive where it is.
        rates = [graph.field(at(share * float(place)), graph.p)[0][size + 1] for place in GAUSS_PLACES]
        end[size + 1] = graph.x[size + 1] + share * ca.dot(ca.vertcat(*rates), ca.DM(GAUSS_WEIGHTS))
    else:
        end = runge_kutta(graph, graph.x, share)
    step = ca.Function("step", [graph.x, share, graph.p], [end])
    x = ca.SX.sym("x", size)
    z = ca.vertcat(x, 0, 0)
    for _ in range(substeps):
        z = step(z, share / substeps, graph.p)
    results = [z[:size], z[size + 1], graph.field(z, graph.p)[1]]
    return ca.Function("advance", [x, share, graph.p], [ca.densify(result) for result in results])


@lru_cache(maxsize=64)
def _conditions(stage: Stage, names: tuple[str, ...], size_before: int) -> ca.Function:
    """(first state, last state, last state before, parameters) -> zeros at the start, zeros at the end, what is
    above zero there, final cost, and bounds of inputs, -inf and inf where they are numbers."""
    size = len(stage.phase.states)
    first, last, before, p = (ca.SX.sym("x", k) for k in (size, size, size_before, len(names)))
    named = dict(zip(names, ca.vertsplit(p), strict=True))
    start = stage.start(ca.vertsplit(first), ca.vertsplit(before), named)
    end, above, final = (of(ca.vertsplit(last), named) for of in (stage.end, stage.above, stage.final))
    lows, highs = (
        ca.vertcat(*[of(named) if callable(of := getattr(given, side)) else none for given in stage.inputs.values()])
        for side, none in (("low", -np.inf), ("high", np.inf))
    )
    results = [ca.vertcat(*start), ca.vertcat(*end), ca.vertcat(*above), final, lows, highs]
    return ca.Function("conditions", [first, last, before, p], [ca.densify(ca.SX(result)) for result in results])


class Transcription:
    """The nonlinear program of stages; its unknowns are those of each stage in turn, its duration, its states
    (n, N + 1) and its inputs' coefficients (m, N), and then the free parameters.

    names : of the parameters, those given and then those free
    substeps : steps that an interval takes, of each stage
    places : (stage, interval) of further places at which paths are asked; where in the interval are parameters
    """

    def __init__(self, stages, fixed: tuple[str, ...], free: tuple[str, ...], substeps, places):
        self.stages, self.fixed, self.free, self.substeps, self.places = stages, fixed, free, substeps, places
        self.names = (*fixed, *free)
        self.shapes = [(len(s.phase.states), s.intervals, len(coefficient_names(s))) for s in stages]
        self._labels: list[str] = []
        self._limits: list[tuple[float, float]] = []
        self._inner: list[int] = []  # constraints that are paths at interval ends within stages
        self._build()

    def _build(self):
        given, freed, shares = (ca.MX.sym("p", k) for k in (len(self.fixed), len(self.free), len(self.places)))
        p, parts, cost, constraints = ca.vertcat(given, freed), [], ca.MX(0), []
        for size, n, m in self.shapes:
            parts.append((ca.MX.sym("T"), ca.MX.sym("x", size, n + 1), ca.MX.sym("w", m, n)))
        data = []
        for i, (stage, (duration, x, w)) in enumerate(zip(self.stages, parts, strict=True)):
            n = stage.intervals
            data.append(ca.vertcat(ca.repmat(p, 1, n), ca.repmat(duration / n, 1, n), w))
            step = advance(stage, self.names, self.substeps[i]).map(n)
            ends, costs, path = step(x[:, :-1], ca.DM.ones(1, n), data[i])
            before = parts[i - 1][1][:, -1]
            conditions = _conditions(stage, self.names, before.numel())
            start, end, above, final, lows, highs = conditions(x[:, 0], x[:, -1], before, p)
            cost += ca.sum2(costs) + final
            constraints += [
                self._held(ca.vec(ends - x[:, 1:]), i, "the motion", 0.0),
                self._held(start, i, "the condition at the start", 0.0),
                self._held(end, i, "the condition at the end", 0.0),
                self._held(above, i, "the bound at the end"),
            ]
            for k, name in enumerate(stage.path):
                self._inner += range(len(self._labels), len(self._labels) + n - 1)
                constraints.append(self._held(path[k, :-1].T, i, f"'{name}'"))
            constraints += self._bounded_inputs(i, w, lows, highs)
        for k, (i, interval) in enumerate(self.places):
            step = advance(self.stages[i], self.names, self.substeps[i])
            path = step(parts[i][1][:, interval], shares[k], data[i][:, interval])[2]
            self._inner += range(len(self._labels), len(self._labels) + path.numel())
            constraints += [self._held(path[j], i, f"'{name}'") for j, name in enumerate(self.stages[i].path)]
        unknowns = ca.veccat(*[piece for part in parts for piece in part], freed)
        scale = ca.MX.sym("scale")
        data = ca.vertcat(given, shares, scale)
        self._minimiser = Minimiser(unknowns, data, cost / scale, ca.vertcat(*constraints), STALLS)

    def _held(self, values: ca.MX, stage: int, what: str, most: float = np.inf) -> ca.MX:
        """Note that `values` stay between 0 and `most`, and what they are."""
        name = f"{what} of stage {stage + 1} ({self.stages[stage].phase.name})"
        self._labels += [name] * values.numel()
        self._limits += [(0.0, most)] * values.numel()
        return values

    def _bounded_inputs(self, i: int, w: ca.MX, lows: ca.MX, highs: ca.MX) -> list[ca.MX]:
        """Bounds of inputs that are functions of the parameters."""
        row, held = 0, []
        for k, (name, given) in enumerate(self.stages[i].inputs.items()):
            mine = ca.vec(w[row : row + given.degree + 1, :])
            row += given.degree + 1
            if callable(given.low):
                held.append(self._held(mine - lows[k], i, f"the lower bound of input '{name}'"))
            if callable(given.high):
                held.append(self._held(highs[k] - mine, i, f"the upper bound of input '{name}'"))
        return held

    def bounds(self, free) -> tuple[np.ndarray, np.ndarray]:
        """Of the unknowns, (n,) each."""
        sides = []
        for side, none in ((0, -np.inf), (1, np.inf)):
            parts = []
            for stage, (size, n, _) in zip(self.stages, self.shapes, strict=True):
                each = []
                for given in stage.inputs.values():
                    bound = (given.low, given.high)[side]
                    each += [none if callable(bound) else bound] * (given.degree + 1)
                parts.append((stage.duration[side], np.full((size, n + 1), none), np.tile(np.c_[each], n)))
            sides.append(self.pack(parts, [bound[side] for bound in free.values()]))
        return sides[0], sides[1]

    def pack(self, parts, free: Sequence[float]) -> np.ndarray:
        """The unknowns (n,) from durations, states and coefficients of each stage, and free parameters."""
        pieces = [np.ravel(piece, order="F") for part in parts for piece in part]
        return np.concatenate([*pieces, np.asarray(free, dtype=float)]).astype(float)

    def unpack(self, x) -> list[tuple[float, np.ndarray, np.ndarray]]:
        """Durations, states (n, N + 1) and coefficients (m, N) of each stage, from the unknowns."""
        parts, k = [], 0
        for size, n, m in self.shapes:
            states, after = k + 1, k + 1 + size * (n + 1)
            nodes = x[states:after].reshape((size, n + 1), order="F")
            parts.append((float(x[k]), nodes, x[after : after + m * n].reshape((m, n), order="F")))
            k = after + m * n
        return parts

    def freed(self, x) -> np.ndarray:
        """The free parameters among the unknowns."""
        return x[len(x) - len(self.free) :]

    def saturated(self, parts, values) -> list[str]:
        """Inputs that are at a numeric bound on most of their intervals, and paths that are at zero somewhere within
        their stage, given the parts of the unknowns and the constraints' values."""
        found = []
        for i, (stage, (*_, w)) in enumerate(zip(self.stages, parts, strict=True), start=1):
            row = 0
            for name, given in stage.inputs.items():
                mine, row = w[row : row + given.degree + 1], row + given.degree + 1
                bounds = [bound for bound in (given.low, given.high) if not callable(bound) and np.isfinite(bound)]
                if np.mean([np.any([at_bound(mine, bound) for bound in bounds], axis=0)]) > 0.5:
                    found.append(f"input '{name}' of stage {i}")
        return [*found, *dict.fromkeys(self._labels[row] for row in self._inner if values[row] < AT_BOUND)]

    def label(self, row: int) -> str:
        """What a constraint is."""
        return self._labels[row]

    def cost(self, x, p) -> float:
        """What unknowns cost, with `p` as in `minimise`."""
        return float(self._minimiser.conditions(x, p, 0.0)[0])

    def minimise(self, x, p, bounds, multipliers) -> Minimum:
        """The minimum near `x` with parameters, places, and what the cost is counted in, `p`."""
        return self._minimiser(x, p, bounds, np.array(self._limits).T, multipliers)

    def padded(self, multipliers):
        """Multipliers of the same problem with fewer places, for this one."""
        bound, held = multipliers
        return bound, np.append(held, np.zeros(len(self._labels) - len(held)))

    def _ends(self, values, ends):
        """Of each stage the conditions at its accurate ends (first, last)."""
        for i, stage in enumerate(self.stages):
            before = ends[i - 1][1]
            yield _conditions(stage, self.names, len(before))(*ends[i], before, values)

    def missed(self, values, ends) -> float:
        """The most by which conditions are missed where stages start and end at states (first, last)."""
        found = [[np.array(part) for part in parts[:3]] for parts in self._ends(values, ends)]
        off = [np.concatenate([*map(np.abs, zeros), -above], axis=None) for *zeros, above in found]
        return max(float(part.max(initial=0.0)) for part in off)

    def costs(self, values, driven) -> float:
        """The cost of stages travelled accurately."""
        finals = self._ends(values, [(drive.first, drive.last) for drive in driven])
        return float(sum(float(found[3]) for found in finals) + sum(drive.cost for drive in driven))


@lru_cache(maxsize=32)
def transcription(stages, fixed, free, substeps=None, places=()) -> Transcription:
    """The nonlinear program of stages, kept for the next call."""
    return Transcription(stages, fixed, free, substeps or (1,) * len(stages), places)


def polynomials(stage: Stage, duration: float, coefficients) -> Trajectory:
    """The inputs of a stage as polynomials of its time, from Bernstein coefficients (m, N) on its intervals."""
    n, most = stage.intervals, 1 + max((given.degree for given in stage.inputs.values()), default=0)
    rows, first = np.zeros((n, len(stage.inputs), most)), 0
    h = duration / n
    for i, given in enumerate(stage.inputs.values()):
        d = given.degree
        ours = coefficients[first : first + d + 1]
        for k in range(d + 1):  # differences of Bernstein coefficients are monomial ones
            rising = sum((-1) ** (k - j) * comb(k, j) * ours[j] for j in range(k + 1))
            rows[:, i, k] = comb(d, k) * rising / h**k
        first += d + 1
    return Trajectory(np.linspace(0, duration, n + 1), rows, tuple(stage.inputs))


@dataclass(frozen=True, eq=False)
class StageRollout:
    """A stage integrated accurately from its first state through all its intervals.

    path : the motion, states and then what stays positive
    nodes : states (n, N + 1) at the interval ends
    cost : the running one
    interval, began : of each step of the motion, (steps,), which interval it is in and at what share of that it begins
    overstepped : the most by which an input leaves its bounds
    """

    stage: Stage
    path: Trajectory
    nodes: np.ndarray
    cost: float
    interval: np.ndarray
    began: np.ndarray
    overstepped: float

    first = property(lambda self: self.nodes[:, 0])
    last = property(lambda self: self.nodes[:, -1])

    def apart(self, nodes) -> float:
        """How far its states are from `nodes` (n, N + 1), beside their size."""
        return float((np.abs(self.nodes - nodes) / (1.0 + np.abs(nodes).max(1, keepdims=True))).max())

    @cached_property
    def _lowest(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Of what stays positive, the least value (N,) on each interval and the share (N,) of it where that is."""
        counts, found = np.bincount(self.interval), {}
        first = np.cumsum(counts) - counts
        h = self.path.times[-1] / self.stage.intervals
        for name in self.stage.path:
            values, piece, t = PiecewisePolynomials(self.path.row(name), self.path.steps, counts).lowest()
            found[name] = values, np.clip(self.began[first + piece] + t / h, 0.0, 1.0)
        return found

    @property
    def violation(self) -> float:
        """The most by which it falls below zero, or an input leaves its bounds."""
        return max([self.overstepped, 0.0, *(-float(values.min()) for values, _ in self._lowest.values())])

    def low(self, tolerance: float) -> list[str]:
        """Names of what falls below zero by more than the tolerance."""
        return [name for name, (values, _) in self._lowest.items() if values.min() < -tolerance]

    def dips(self, tolerance: float) -> list[tuple[int, float]]:
        """Intervals, and shares of them, where something falls below zero by more than the tolerance."""
        found = {
            (int(i), float(shares[i]))
            for values, shares in self._lowest.values()
            for i in np.flatnonzero(values < -tolerance)
        }
        return sorted(found)


def rollout(stage: Stage, names, values, duration: float, nodes, coefficients) -> StageRollout:
    """Integrate a stage of the solved problem accurately, open loop."""
    along = _accurate(stage, names)
    size, n, h = len(stage.phase.states), stage.intervals, duration / stage.intervals
    x, cost, pieces, lengths, interval, began, ends = nodes[:, 0], 0.0, [], [], [], [], [nodes[:, 0]]
    keep = [*range(size), *range(size + 2, len(along.names))]
    for i in range(n):
        path, _ = along.run([*x, 0.0, 0.0], np.concatenate([values, [h], coefficients[:, i]]), 1.0)
        x, cost = path.end[:size], cost + path.end[size + 1]
        ends.append(x)
        pieces.append(path.coefficients[:, keep] / powers(h, path.coefficients.shape[2]))
        lengths.append(path.steps * h)
        interval += [i] * len(path.steps)
        began.append(path.times[:-1])
    times = np.concatenate([[0.0], np.cumsum(np.concatenate(lengths))])
    times[-1] = duration
    dense = Trajectory(times, np.concatenate(pieces), tuple(along.names[i] for i in keep))
    named, over, row = dict(zip(names, values, strict=True)), 0.0, 0
    for given in stage.inputs.values():
        mine = coefficients[row : row + given.degree + 1]
        low, high = (float(bound(named)) if callable(bound) else bound for bound in (given.low, given.high))
        over, row = max(over, float((low - mine).max()), float((mine - high).max())), row + given.degree + 1
    return StageRollout(stage, dense, np.array(ends).T, cost, np.array(interval), np.concatenate(began), over)


@lru_cache(maxsize=64)
def _accurate(stage: Stage, names) -> Flow:
    """The accurate flow of a stage's intervals; see `transcription.clocked`."""
    return flow_of(clocked(stage), (*names, LENGTH, *coefficient_names(stage)))
