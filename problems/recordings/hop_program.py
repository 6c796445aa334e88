"""The nonlinear program of recorded hops: multiple shooting over flights, impacts, contacts and lift-offs.

Unknowns are the parameters, the offsets and the delays of channels, the instant of every event, and the states at the
starts of intervals, which are steps of a Taylor series. Constraints join the intervals and state the events. The cost
is the mean square of the weighted residuals; its second derivatives are those of Gauss and Newton, which leave out
what vanishes with the residuals, so that every step goes down.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from orbits.model import Machine, Model
from orbits.symbolic import Minimiser, Minimum, cached
from orbits.units import Units

from .channels import GROUND_FORCE, SERIES, Channel, series_of_phases

FREE, LAUNCH, LIFTOFF, IMPACT, LANDING = "free", "launch", "lift-off", "impact", "landing"
RESTITUTION, DAMPERS = "restitution", ("damping", "drag")


class ProgramOptions(NamedTuple):
    """The accuracy of a minimum, and what keeps parameters in place that nothing determines."""

    tolerance: float = 1e-8  # the mean square is of order one: its minimum is met to a small share of a deviation
    iterations: int = 60
    # The weight of a change of a parameter by its own size, where samples have the inverse of their deviations. Each
    # round starts from the values of the last, so that parameters that the record determines still converge.
    held: float = 1.0
    smallest: float = 1e-3  # size of a state, without dimensions


PROGRAM = ProgramOptions()


def _tolerances() -> dict[str, Any]:
    """The options of Ipopt."""
    names = ("tol", "constr_viol_tol", "compl_inf_tol")
    return {f"ipopt.{name}": PROGRAM.tolerance for name in names} | {"ipopt.max_iter": PROGRAM.iterations}


class Part(NamedTuple):
    """One phase of a motion.

    contact : whether it is a contact, else a flight
    begins : how it follows from the part before: by a lift-off, an impact or a landing. The first part of a motion is
        free, or begins with a launch, a lift-off after sustained contact, at an instant that is unknown
    intervals : the number of its intervals
    """

    contact: bool
    begins: str
    intervals: int


class Motion(NamedTuple):
    """A motion through parts; states have no dimensions.

    parts : in order, k of them
    edges : (k + 1,), the times at which they begin and the last one ends, in the unit of the record
    nodes : of each part the states (intervals, n) at the starts of its intervals
    """

    parts: tuple[Part, ...]
    edges: np.ndarray
    nodes: list[np.ndarray]


class Samples(NamedTuple):
    """The samples of one channel, of all motions.

    motion : (n,), the number of the motion that each belongs to
    times, values, weights : (n,); a weight is the inverse of a deviation, and 0 for a sample that is left out
    """

    motion: np.ndarray
    times: np.ndarray
    values: np.ndarray
    weights: np.ndarray


class Unknowns(NamedTuple):
    """What a program is about, in addition to its motions.

    machine : with values of all parameters
    names : of the unknown parameters, "restitution" among them
    channels : of the record
    biased : for each channel, whether its offset is unknown
    delayed : for each channel, whether its delay is unknown
    sizes : of each channel, the size of its values
    scales : of each unknown parameter, its size
    """

    machine: Machine
    names: tuple[str, ...]
    channels: tuple[Channel, ...]
    biased: tuple[bool, ...]
    delayed: tuple[bool, ...]
    sizes: tuple[float, ...]
    scales: tuple[float, ...]

    @property
    def values(self) -> dict[str, float]:
        """The values of all parameters, and the restitution."""
        return {**self.machine.values, RESTITUTION: self.machine.restitution}

    @property
    def common(self) -> int:
        """The number of parameters, offsets and delays that are unknown."""
        return len(self.names) + sum(self.biased) + sum(self.delayed)


class Solution(NamedTuple):
    """What the unknowns of a program mean.

    values : of the unknown parameters, by name
    bias : offsets of the channels that have unknown ones, in their sizes
    delay : of the channels that have unknown ones
    motions : the fitted ones
    """

    values: dict[str, float]
    bias: np.ndarray
    delay: np.ndarray
    motions: list[Motion]


@cached
def events_of(model: Model, names: tuple[str, ...]) -> dict[str, ca.Function]:
    """Functions (state at the end of a part, parameters, restitution) -> zeros, and the first state of the next part,
    by how that begins; and that of what vanishes in a launch, (state, parameters) -> zeros."""
    flight, contact = series_of_phases(model, names)
    p, e = ca.SX.sym("p", len(names)), ca.SX.sym("e")
    named, x, y = (
        dict(zip(names, ca.vertsplit(p), strict=True)),
        ca.SX.sym("x", flight.size),
        ca.SX.sym("y", contact.size),
    )
    state = ca.vertsplit(x)
    gap, speed = model.gap(named).at(state), model.speeds_of_landing(state, named)[0]
    landed, bounced = ca.vertcat(*model.landed(state, named)), ca.vertcat(*model.landed(state, named, e))
    force = contact.values(y, p)[[*contact.rows].index(GROUND_FORCE)]
    results: dict[str, tuple[Any, ...]] = {
        LIFTOFF: (y, force, ca.DM(model.embed) @ y),
        IMPACT: (x, gap, bounced),
        LANDING: (x, gap, ca.DM(np.linalg.pinv(model.embed)) @ landed),
    }
    found = {
        kind: ca.Function("event", [end, p, e], [ca.densify(zero), ca.densify(after)])
        for kind, (end, zero, after) in results.items()
    }
    onto = ca.DM(np.linalg.pinv(model.embed)) @ x
    found[LAUNCH] = ca.Function("launch", [x, p], [ca.vertcat(gap, speed, ca.substitute(force, y, onto))])
    return found


class _Intervals(NamedTuple):
    """The intervals of all flights, or of all contacts, N of them, as expressions.

    part, share : the part of each, and its start as a share of that
    starts, lengths : (1, N), its start in the time of the record, and its length without dimensions
    states, ends : (n, N), at its start and its end
    coefficients : of its Taylor series
    """

    part: list[int]
    share: list[float]
    starts: ca.MX
    lengths: ca.MX
    states: ca.MX
    ends: ca.MX
    coefficients: ca.MX

    def first(self, part: int) -> int:
        """The number of the first interval of a part."""
        return self.part.index(part)


class HopProgram:
    """The program of some motions; the weights of the samples are its parameters, so that they may change.

    unknowns : what is fitted
    motions : near the solution; samples belong to the parts and intervals in which they lie there
    samples : of each channel
    delay : of the channels that have unknown ones, near the solution
    """

    def __init__(
        self, unknowns: Unknowns, motions: Sequence[Motion], samples: Sequence[Samples], delay: np.ndarray | None = None
    ):
        self.unknowns, self.motions, self.samples = unknowns, motions, samples
        self.late = np.zeros(len(samples))
        self.late[[*unknowns.delayed]] = 0.0 if delay is None else delay
        machine = unknowns.machine
        self.model, self.names = machine.model, tuple(machine.values)
        self.phases = series_of_phases(self.model, self.names)
        self.time = machine.units.time if machine.units else 1.0
        self.parts = [part for motion in motions for part in motion.parts]
        # Each motion has one edge more than parts.
        self.edge_of = [i + k for i, k in enumerate(k for k, motion in enumerate(motions) for _ in motion.parts)]
        self.free_edges = [i for i, is_event in enumerate(self._are_events()) if is_event]
        self.sizes = [
            np.abs(np.vstack(self._nodes(c) or [np.ones((1, 1))])).max(0) + PROGRAM.smallest for c in (False, True)
        ]
        values = unknowns.values
        self.parameter_sizes = np.array(unknowns.scales)
        self.starts = np.array([values[name] for name in unknowns.names]) / self.parameter_sizes
        self._build()

    def _are_events(self) -> list[bool]:
        """Whether each edge is an event, and neither the end of a motion nor where a free one begins."""
        return [
            i < len(motion.parts) and (i > 0 or motion.parts[0].begins == LAUNCH)
            for motion in self.motions
            for i in range(len(motion.edges))
        ]

    def _nodes(self, contact: bool) -> list[np.ndarray]:
        """The nodes of all flights or contacts."""
        pairs = [pair for motion in self.motions for pair in zip(motion.parts, motion.nodes, strict=True)]
        return [nodes for part, nodes in pairs if part.contact == contact]

    def guess(self, bias: np.ndarray, delay: np.ndarray) -> np.ndarray:
        """The unknowns of the motions and of the machine, with these offsets and delays."""
        edges = np.concatenate([motion.edges for motion in self.motions])[self.free_edges]
        nodes = [(each / size).ravel() for c, size in enumerate(self.sizes) for each in self._nodes(bool(c))]
        return np.concatenate([self.starts, bias, delay / self.time, edges / self.time, *nodes])

    def _build(self) -> None:
        """Build the program and the functions of its unknowns."""
        unknowns = self.unknowns
        counts = [sum(part.intervals for part in self.parts if part.contact == c) for c in (0, 1)]
        theta, bias, delay, instants = (
            ca.MX.sym("z", count)
            for count in (len(unknowns.names), sum(unknowns.biased), sum(unknowns.delayed), len(self.free_edges))
        )
        nodes = [ca.MX.sym("x", phase.size, count) for phase, count in zip(self.phases, counts, strict=True)]
        z, found = ca.vertcat(theta, bias, delay, instants, *map(ca.vec, nodes)), theta * ca.DM(self.parameter_sizes)
        values = {name: ca.MX(value) for name, value in unknowns.values.items()}
        values |= dict(zip(unknowns.names, ca.vertsplit(found), strict=True))
        p, units = ca.vertcat(*(values[name] for name in self.names)), self._units(values)
        edges = ca.MX(np.concatenate([motion.edges for motion in self.motions]))
        if self.free_edges:
            edges[self.free_edges] = instants * self.time
        self.intervals = {bool(c): self._intervals(bool(c), edges, units[1], nodes[c], p) for c in (0, 1) if counts[c]}
        joined, plain = self._joined(p, values[RESTITUTION]), self._residuals(bias, delay, units)
        weights, share = ca.MX.sym("weights", plain.numel()), 1.0 / plain.numel()
        slopes = ca.jacobian(weights * plain, z)
        # A small cost of changes keeps parameters in place that the record does not separate.
        held = ca.diag(ca.sparsify(PROGRAM.held * ca.DM(np.arange(z.numel()) < len(unknowns.names))))
        multipliers = ca.MX.sym("f"), ca.MX.sym("g", joined.numel())
        hessian = ca.Function(
            "gauss_newton", [z, weights, *multipliers], [ca.triu(multipliers[0] * share * (slopes.T @ slopes + held))],
            ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"],
        )  # fmt: skip
        cost = 0.5 * share * (ca.sumsqr(weights * plain) + PROGRAM.held * ca.sumsqr(theta - self.starts))
        self.minimiser = Minimiser(z, weights, cost, joined, {**_tolerances(), "hess_lag": hessian})
        self._plain = ca.Function("plain", [z], [plain])
        self._slopes = ca.Function("slopes", [z, weights], [slopes, ca.jacobian(joined, z)])
        self._at = ca.Function("at", [z], [edges, found, bias, delay, *nodes])

    def _units(self, values: Mapping[str, ca.MX]) -> tuple[Any, Any, Any]:
        """The units of length, time and force as functions of the parameters."""
        if self.model.units is None:
            return 1.0, 1.0, 1.0
        units: Units = self.model.units({name: values[name] for name in self.names})
        return units.length, units.time, units.force

    def _intervals(self, contact: bool, edges: ca.MX, time: Any, nodes: ca.MX, p: ca.MX) -> _Intervals:
        """The intervals of all flights or contacts."""
        phase, size = self.phases[contact], ca.DM(self.sizes[contact])
        own = [
            (i, k / part.intervals, float(part.intervals))
            for i, part in enumerate(self.parts)
            if part.contact == contact
            for k in range(part.intervals)
        ]
        part, share, count = ([*each] for each in zip(*own, strict=True))
        edge = [self.edge_of[i] for i in part]
        begin, span = edges[edge], edges[[i + 1 for i in edge]] - edges[edge]
        starts, lengths = (begin + ca.DM(share) * span).T, (span / ca.DM(count) / time).T
        states = nodes * ca.repmat(size, 1, len(own))
        coefficients = phase.series.map(len(own))(states, ca.repmat(p, 1, len(own)))
        rows = [
            coefficients[k * phase.rows_in_all : k * phase.rows_in_all + phase.size, :] for k in range(SERIES.order + 1)
        ]
        ends, h = rows[-1], ca.repmat(lengths, phase.size, 1)
        for row in reversed(rows[:-1]):
            ends = ends * h + row
        return _Intervals(part, share, starts, lengths, states, ends, coefficients)

    def _joined(self, p: ca.MX, restitution: ca.MX) -> ca.MX:
        """What vanishes between intervals and at events."""
        events, zeros = events_of(self.model, self.names), []
        for i, part in enumerate(self.parts):
            own, size = self.intervals[part.contact], ca.DM(self.sizes[part.contact])
            first, more = own.first(i), part.intervals - 1
            if more:
                gaps = own.ends[:, first : first + more] - own.states[:, first + 1 : first + 1 + more]
                zeros.append(ca.vec(gaps / ca.repmat(size, 1, more)))
            if part.begins == LAUNCH:
                zeros.append(events[LAUNCH](own.states[:, first], p))
            elif part.begins != FREE:
                before = self.intervals[self.parts[i - 1].contact]
                end = before.ends[:, before.first(i - 1) + self.parts[i - 1].intervals - 1]
                zero, after = events[part.begins](end, p, restitution)
                zeros += [zero, (after - own.states[:, first]) / size]
        return ca.vertcat(*zeros)

    def _residuals(self, bias: ca.MX, delay: ca.MX, units: tuple[Any, Any, Any]) -> ca.MX:
        """What was recorded less what the motion shows, channel after channel, flights before contacts."""
        (length, time, force), found, self.order = units, [], list[tuple[int, np.ndarray]]()
        for i, (channel, samples) in enumerate(zip(self.unknowns.channels, self.samples, strict=True)):
            offset = bias[sum(self.unknowns.biased[:i])] * self.unknowns.sizes[i] if self.unknowns.biased[i] else 0.0
            late = delay[sum(self.unknowns.delayed[:i])] * self.time if self.unknowns.delayed[i] else 0.0
            unit = force if channel.quantity == GROUND_FORCE else length / time**channel.order
            for own, shown in self._shown(i, late, time):
                found.append(ca.DM(samples.values[own]) - shown.T * unit - offset)
                self.order.append((i, own))
        return ca.vertcat(*found)

    def _shown(self, i: int, late: Any, time: Any) -> Iterator[tuple[np.ndarray, ca.MX]]:
        """The samples of a channel in flight and in contact, and what the motion shows there (1, n), dimensionless."""
        channel, samples, (part, interval) = self.unknowns.channels[i], self.samples[i], self._places(i)
        contact = np.array([each.contact for each in self.parts])[part]
        for c, intervals in self.intervals.items():
            own = np.flatnonzero((contact == c) & (part >= 0))
            row = self.phases[c].rows.get(channel.quantity)
            if not len(own):
                continue
            if row is None:
                yield own, ca.MX(1, len(own))
                continue
            pairs = zip(part[own].tolist(), interval[own].tolist(), strict=True)
            index = [intervals.first(i) + k for i, k in pairs]
            terms = intervals.coefficients[row :: self.phases[c].rows_in_all, :][:, index]
            since = (ca.DM(samples.times[own]).T - late - intervals.starts[:, index]) / time
            value = ca.MX(1, len(own))
            for k in range(SERIES.order, channel.order - 1, -1):
                value = value * since + float(np.prod(range(k - channel.order + 1, k + 1))) * terms[k, :]
            yield own, value

    def _places(self, i: int) -> tuple[np.ndarray, np.ndarray]:
        """The part (n,) of each sample of a channel, -1 after the end of its motion, and the interval (n,) of that."""
        samples = self.samples[i]._replace(times=self.samples[i].times - self.late[i])
        part, interval, first = np.full(len(samples.times), -1), np.zeros(len(samples.times), int), 0
        for k, motion in enumerate(self.motions):
            own = (samples.motion == k) & (samples.times <= motion.edges[-1])
            place = np.clip(np.searchsorted(motion.edges, samples.times[own], side="right") - 1, 0, None)
            place = np.minimum(place, len(motion.parts) - 1)
            share = (samples.times[own] - motion.edges[place]) / np.diff(motion.edges)[place]
            count = np.array([each.intervals for each in motion.parts])[place]
            part[own], interval[own] = first + place, np.clip((share * count).astype(int), 0, count - 1)
            first += len(motion.parts)
        return part, interval

    def _weights(self, samples: Sequence[Samples]) -> np.ndarray:
        """The weights of all residuals, in their order."""
        return np.concatenate([samples[i].weights[own] for i, own in self.order])

    def solve(self, guess: np.ndarray, samples: Sequence[Samples]) -> Minimum:
        """The minimum near a guess with the weights of these samples."""
        free, zeros = np.full(len(guess), np.inf), np.zeros(self.minimiser.problem["g"].numel())
        return self.minimiser(guess, self._weights(samples), (-free, free), (zeros, zeros))

    def solution(self, z: np.ndarray) -> Solution:
        """What the unknowns mean."""
        edges, found, bias, delay, *nodes = (np.array(each) for each in self._at(z))
        motions, taken, first = list[Motion](), [0, 0], 0
        for motion in self.motions:
            states = []
            for part in motion.parts:
                a = taken[part.contact]
                states.append(nodes[part.contact][:, a : a + part.intervals].T * self.sizes[part.contact])
                taken[part.contact] += part.intervals
            motions.append(Motion(motion.parts, edges.ravel()[first : first + len(motion.edges)], states))
            first += len(motion.edges)
        values = dict(zip(self.unknowns.names, found.ravel().tolist(), strict=True))
        return Solution(values, bias.ravel(), delay.ravel() * self.time, motions)

    def residuals(self, z: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """The residuals (n,) of the samples of each channel, NaN where the motion has ended, and the numbers of the
        parts in which they lie."""
        plain, found = np.array(self._plain(z)).ravel(), [np.full(len(each.times), np.nan) for each in self.samples]
        first = 0
        for i, own in self.order:
            found[i][own] = plain[first : first + len(own)]
            first += len(own)
        return found, [self._places(i)[0] for i in range(len(self.samples))]

    def slopes(self, z: np.ndarray, samples: Sequence[Samples]) -> tuple[np.ndarray, np.ndarray]:
        """The derivatives (r, d) of the weighted residuals, and those (edges, d) of the edges of all motions, by the d
        unknowns that are free where the constraints hold: the common ones, then what begins the motions.

        Raises `numpy.linalg.LinAlgError` where an event is a graze, which has no derivative.
        """
        slopes, joined = (sp.csc_matrix(each.sparse()) for each in self._slopes(z, self._weights(samples)))
        free = self._free()
        others = np.setdiff1d(np.arange(len(z)), free)
        moved = np.zeros((len(z), len(free)))
        moved[free, np.arange(len(free))] = 1.0
        try:
            moved[others] = splu(joined[:, others]).solve(-joined[:, free].toarray())
        except RuntimeError as error:
            raise np.linalg.LinAlgError(str(error)) from None
        edges = np.zeros((sum(len(motion.edges) for motion in self.motions), len(free)))
        first = self.unknowns.common
        edges[self.free_edges] = self.time * moved[first : first + len(self.free_edges)]
        return slopes @ moved, edges

    def errors(self, z: np.ndarray, samples: Sequence[Samples]) -> tuple[np.ndarray, list[np.ndarray]]:
        """The standard deviations of the unknown parameters, and of the edges of each motion, for samples whose weights
        are inverse deviations."""
        slopes, edges = self.slopes(z, samples)
        count = len(self.unknowns.names)
        held = np.diag(np.where(np.arange(slopes.shape[1]) < count, PROGRAM.held, 0.0))
        covariance = np.linalg.pinv(slopes.T @ slopes + held, hermitian=True)
        errors = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", edges, covariance, edges), 0.0))
        of_motions = np.split(errors, np.cumsum([len(motion.edges) for motion in self.motions])[:-1])
        return np.sqrt(np.diag(covariance)[:count]) * self.parameter_sizes, of_motions

    def _free(self) -> list[int]:
        """The numbers of the free unknowns: the first states of free motions, the instants and speeds of launches."""
        common, launched = self.unknowns.common, self.model.flight.states.index(self.model.launched[1])
        free, first = list(range(common)), common + len(self.free_edges)
        for c, intervals in self.intervals.items():
            size = self.phases[c].size
            for i in sorted({*intervals.part}):
                node = first + intervals.first(i) * size
                if self.parts[i].begins == FREE:
                    free += range(node, node + size)
                elif self.parts[i].begins == LAUNCH:
                    free += [common + self.free_edges.index(self.edge_of[i]), node + launched]
            first += size * len(intervals.part)
        return free
