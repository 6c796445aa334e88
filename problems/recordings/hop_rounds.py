"""The rounds of a fit: the motion grows over the record, and the noise of its channels becomes known.

Each round solves the program of the motions that are known so far, and then simulates the machine with the fitted
values from the fitted start. As far as that simulation follows the record, it is the guess of the next round: so the
order of impacts, landings and lift-offs is always that of a motion of the machine.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from orbits import simulate
from orbits.errors import NoOrbit
from orbits.hops import Simulation
from orbits.model import Machine
from orbits.units import LIFTOFF_SPEED

from .channels import observed
from .hop_guess import GUESS, Start, hop_time, motion_of
from .hop_program import (
    DAMPERS,
    FREE,
    IMPACT,
    LANDING,
    LAUNCH,
    LIFTOFF,
    RESTITUTION,
    HopProgram,
    Motion,
    Part,
    Samples,
    Solution,
    Unknowns,
)
from .hop_record import HopRecord
from .hop_result import PartOfHop


class HopFitOptions(NamedTuple):
    """How the motion grows over the record, which samples are spikes, and when a fit is a good one."""

    again: float = 0.1  # difference of misfits, relative to them, of fits that end in the same way
    rounds: int = 14
    stays: int = 3  # rounds after which a motion that grows no further is given up
    first_deviation: float = 0.05  # of a sample, in sizes of its channel, as long as the noise is not known
    followed: float = 0.15  # rms of the difference in a hop, in sizes, up to which a simulation follows the record
    spike: float = 5.0  # deviations from which on a sample is left out
    window: int = 3  # samples on either side of one, from whose median a spike differs
    spike_of_window: float = 10.0  # median differences from their median by which it does
    median: float = 1.4826  # deviations of a normal distribution in its median absolute difference
    beside: float = 4.0  # deviations of the instant of an impact within which a sample lies on no side of it
    moved: float = 0.2  # deviations by which a parameter may change in the last round
    settled: float = 0.02  # change of the deviations after which they are final
    least_noise: float = 1e-7  # in sizes: the error of the motion is smaller
    correlated: float = (
        5.0  # standard errors of the correlation of neighbouring residuals, above which something is missing
    )
    few: int = 20  # samples whose correlation says nothing
    unlike: float = 0.1  # rms of all residuals, in sizes, above which the record is of another machine
    fewest: int = 3  # samples for each unknown
    damping: float = 0.02  # of the start, where the machine has none, without dimensions
    above: float = 1e-9  # in sizes of the state: how far the foot is above the ground where rounding puts it below


FIT = HopFitOptions()


class Question(NamedTuple):
    """What is fitted to what.

    unknowns : with the machine of the start
    samples : of each channel, with the weights of the start
    noise : the stated deviation of each channel, NaN where it is not known
    """

    unknowns: Unknowns
    samples: tuple[Samples, ...]
    noise: np.ndarray


class Round(NamedTuple):
    """One solution.

    program : with its unknowns z
    solution : what these mean
    machine : with the fitted values
    deviations : of the unknown parameters
    errors : the standard deviations of the edges of each motion
    off : the residuals of each channel, NaN where the motion has ended
    places : the parts in which the samples of each channel lie
    """

    program: HopProgram
    z: np.ndarray
    solution: Solution
    machine: Machine
    deviations: np.ndarray
    errors: list[np.ndarray]
    off: list[np.ndarray]
    places: list[np.ndarray]

    @property
    def moved(self) -> float:
        """The largest change of a parameter in this round, in its deviations."""
        program = self.program
        values = np.array([*self.solution.values.values()])
        return float(np.max(np.abs(values - program.starts * program.parameter_sizes) / self.deviations))

    def used(self) -> list[np.ndarray]:
        """Whether each sample counts."""
        pairs = zip(self.program.samples, self.off, strict=True)
        return [(each.weights > 0) & np.isfinite(off) for each, off in pairs]


class Fitted(NamedTuple):
    """The end of the rounds from one start.

    last : the last round
    sigma : the deviation of a sample of each channel
    whole : whether the motion goes through the whole record
    misfit : the rms of the residuals, in sizes of the channels
    lack : why the machine does not fit, in words
    """

    last: Round
    sigma: np.ndarray
    whole: bool
    misfit: float
    lack: str

    def weighted(self) -> list[Samples]:
        """The samples with the weights of the deviations."""
        pairs = zip(self.last.program.samples, self.sigma, strict=True)
        return [each._replace(weights=(each.weights > 0) / deviation) for each, deviation in pairs]

    def parts(self) -> list[PartOfHop]:
        """The parts of the motions with the rms of their residuals, in deviations."""
        found, first = [], 0
        for k, motion in enumerate(self.last.solution.motions):
            for i, part in enumerate(motion.parts):
                rms = list[float]()
                for off, place, own, sigma in zip(*self._residuals(), self.sigma, strict=True):
                    here = off[own & (place == first + i)] / sigma
                    rms.append(float(np.sqrt(np.mean(here**2))) if len(here) else np.nan)
                start, end = motion.edges[i : i + 2].tolist()
                phase = "contact" if part.contact else "flight"
                found.append(PartOfHop(k + 1, phase, part.begins, start, end, np.array(rms)))
            first += len(motion.parts)
        return found

    def _residuals(self) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
        return self.last.off, self.last.places, self.last.used()


class Fitting:
    """The rounds from one start."""

    def __init__(self, question: Question, records: Sequence[HopRecord], starts: Sequence[Start]):
        unknowns = question.unknowns
        self.question, self.machine, self.samples = question, unknowns.machine, [*question.samples]
        self.ends = [float(record.times[-1]) for record in records]
        self.bias, self.delay = np.zeros(sum(unknowns.biased)), np.zeros(sum(unknowns.delayed))
        self.motions = [_first(start, record) for start, record in zip(starts, records, strict=True)]

    def fitted(self) -> Fitted:
        """The last round; raises `NoOrbit` where a round has no solution."""
        stays, sigma, last, whole, settled = 0, np.full(len(self.samples), np.nan), self._round(), False, False
        solved = list[list[tuple[Part, ...]]]()  # a motion near a graze may have one bounce more or less
        for _ in range(FIT.rounds):
            solved.append([each.parts for each in last.solution.motions])
            ended, stayed = self._grow(last), _stays(last.solution.motions, self.motions)
            whole = ended and stayed
            if not whole:
                stays += stayed
                if stays == FIT.stays:
                    break
            before, sigma = sigma, self._deviations(last)
            same = self._reweigh(last, before, whole) and [each.parts for each in self.motions] in solved
            settled = whole and same and bool((np.abs(sigma / before - 1) < FIT.settled).all())
            if settled and last.moved <= FIT.moved:
                break
            last = self._round()
        sigma = self._deviations(last)
        pairs = zip(last.off, last.used(), self.question.unknowns.sizes, strict=True)
        squares = [np.mean((off[own] / size) ** 2) for off, own, size in pairs if own.any()]
        ends = "" if settled else "the fit did not settle: its samples near impacts, or its noise, still change"
        lack = (self._lack(last, sigma) or ends) if whole else "the machine does not fit: its motion leaves the record"
        return Fitted(last, sigma, whole, float(np.sqrt(np.mean(squares))) if squares else np.inf, lack)

    def _round(self) -> Round:
        """The solution near the present machine and motions."""
        unknowns = self.question.unknowns._replace(machine=self.machine)
        program = HopProgram(unknowns, self.motions, self.samples, self.delay)
        minimum = program.solve(program.guess(self.bias, self.delay), self.samples)
        if minimum.kind != "minimum" and not minimum.feasible:
            raise NoOrbit(minimum.reason)
        solution = program.solution(minimum.x)
        self.bias, self.delay = solution.bias, solution.delay
        self.machine = _with_values(self.machine, solution.values)
        errors = program.errors(minimum.x, self.samples)
        return Round(program, minimum.x, solution, self.machine, *errors, *program.residuals(minimum.x))

    def _grow(self, last: Round) -> bool:
        """Replace the motions by simulations from their starts, as far as these follow the record; whether that is to
        its end, or to that of the hops."""
        found, whole = list[Motion](), True
        for k, (motion, end) in enumerate(zip(last.solution.motions, self.ends, strict=True)):
            begin, first = float(motion.edges[0]), motion.parts[0].begins
            run = _simulated(last.machine, motion, end - begin)
            final = end if run.status == "done" else begin + run.end
            full = motion_of(run, begin, begin, final, first=first)
            if full is None:
                raise NoOrbit("the fitted motion ends where it begins")
            until = max(self._follows(last, full, k, run), min(final, float(motion.edges[-1])))
            whole = whole and until >= final
            found.append(full if until >= final else motion_of(run, begin, begin, until, first=first) or full)
        self.motions = found
        return whole

    def _follows(self, last: Round, full: Motion, k: int, run: Simulation) -> float:
        """The end of the last hop up to which a simulated motion follows record k."""
        unknowns, begin = last.program.unknowns, float(full.edges[0])
        pairs = zip(full.parts, full.edges, strict=False)
        hops = np.array([begin, *(edge for part, edge in pairs if part.begins == LIFTOFF and edge > begin)])
        total, count = np.zeros(len(hops)), np.zeros(len(hops))
        bias, delay = _spread(self.bias, unknowns.biased), _spread(self.delay, unknowns.delayed)
        for i, (channel, samples) in enumerate(zip(unknowns.channels, self.question.samples, strict=True)):
            times = samples.times - delay[i]
            own = (samples.motion == k) & (samples.weights > 0) & (times <= full.edges[-1])
            since = np.clip(times[own] - begin, 0.0, run.end)
            shown = observed(run, {channel.name: channel}, since)[0] + bias[i] * unknowns.sizes[i]
            hop = np.maximum(np.searchsorted(hops, since + begin, side="right") - 1, 0)
            total += np.bincount(hop, ((samples.values[own] - shown) / unknowns.sizes[i]) ** 2, len(hops))
            count += np.bincount(hop, minlength=len(hops))
        bad = np.flatnonzero(total > FIT.followed**2 * np.maximum(count, 1))
        return float(hops[bad[0]] if len(bad) else full.edges[-1])

    def _reweigh(self, last: Round, before: np.ndarray, whole: bool) -> bool:
        """Leave out samples near impacts, and once the motion is whole weigh them by their deviations and leave out
        spikes; whether the deviations were known and the same samples count as before."""
        samples = list[Samples]()
        sigmas, channels = self._deviations(last), self.question.unknowns.channels
        delay = _spread(self.delay, self.question.unknowns.delayed)
        for channel, each, off, sigma, late in zip(
            channels, self.question.samples, last.off, sigmas, delay, strict=True
        ):
            most = FIT.spike * max(sigma, _robust(off))
            weights = np.where(np.abs(off) <= most, 1 / sigma, 0.0) if whole else each.weights
            beside = self._beside_impact(last, each, late) if channel.jumps else np.zeros(len(weights), bool)
            samples.append(each._replace(weights=np.where(beside, 0.0, weights)))
        same = all(np.array_equal(a.weights > 0, b.weights > 0) for a, b in zip(samples, self.samples, strict=True))
        self.samples = samples
        return same and bool(np.isfinite(before).all())

    def _beside_impact(self, last: Round, samples: Samples, late: float) -> np.ndarray:
        """Whether samples (n,) are so near to an impact that its error decides on which side of it they lie."""
        found = np.zeros(len(samples.times), bool)
        for k, (motion, old, errors) in enumerate(zip(self.motions, last.solution.motions, last.errors, strict=True)):
            own = samples.motion == k
            for edge, part in zip(motion.edges, motion.parts, strict=False):
                if part.begins in (IMPACT, LANDING):
                    error = errors[np.argmin(np.abs(old.edges - edge))]
                    found |= own & (np.abs(samples.times - late - edge) <= FIT.beside * error)
        return found

    def _deviations(self, last: Round) -> np.ndarray:
        """The deviation (c,) of a sample of each channel: the stated one, or that of the residuals but spikes."""
        unknowns, found = last.program.unknowns, list[float]()
        free = unknowns.common + 4 * len(self.ends)
        share = 1 - free / max(sum(int(own.sum()) for own in last.used()), 2 * free)
        for off, size, stated in zip(last.off, unknowns.sizes, self.question.noise, strict=True):
            usual = off[np.abs(off) <= FIT.spike * max(_robust(off), FIT.least_noise * size)]
            rms = np.sqrt(np.mean(usual**2) / share) if len(usual) else FIT.first_deviation * size
            found.append(stated if np.isfinite(stated) else max(float(rms), FIT.least_noise * size))
        return np.array(found)

    def _lack(self, last: Round, sigma: np.ndarray) -> str:
        """Why the machine does not fit the record, in words; "" where nothing says so."""
        worst = ("", 0.0, FIT.correlated)
        channels = last.program.unknowns.channels
        for channel, off, own, deviation, stated in zip(
            channels, last.off, last.used(), sigma, self.question.noise, strict=True
        ):
            residuals = off[own] / deviation
            if len(residuals) < FIT.few:
                continue
            square = float(np.mean(residuals**2))
            if np.isfinite(stated) and square > (1 + FIT.correlated / np.sqrt(2 * len(residuals))) ** 2:
                times = f"{np.sqrt(square):.2g} times the stated noise"
                return f"the machine does not fit: the residuals of the {channel.name} are {times}"
            alike = float(np.mean(residuals[1:] * residuals[:-1])) / square
            if (errors := alike * np.sqrt(len(residuals))) > worst[2]:
                worst = channel.name, alike, errors
        if not worst[0]:
            return ""
        return (
            f"the machine, or a filter of the sensor, does not fit: neighbouring residuals of the {worst[0]} are alike "
            f"(correlation {worst[1]:.2f}), so they are not noise; the deviations do not include the missing part"
        )


def _robust(off: np.ndarray) -> float:
    """The deviation of residuals (n,); some may be spikes or missing."""
    here = off[np.isfinite(off)]
    return FIT.median * float(np.median(np.abs(here))) if len(here) else 0.0


def usual(values: np.ndarray) -> np.ndarray:
    """Which samples (n,) of a channel are near the median of those around them: a single spike is not."""
    width = 2 * FIT.window + 1
    if len(values) < width:
        return np.ones(len(values), bool)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(values, FIT.window, mode="reflect"), width)
    middle = np.median(around, axis=1)
    spread = np.median(np.abs(around - middle[:, None]), axis=1)
    return np.abs(values - middle) <= FIT.spike_of_window * (spread + np.median(np.abs(values - middle)))


def _first(start: Start, record: HopRecord) -> Motion:
    """The beginning of a motion, as long as it was compared with the record."""
    begin, hop = float(record.times[0]), hop_time(start.run) * start.factor
    end = min(begin + GUESS.window * hop, start.launched + start.factor * start.run.end, float(record.times[-1]))
    is_launch = start.launched >= begin - GUESS.launch * hop
    begin, first = (start.launched, LAUNCH) if is_launch else (begin, FREE)
    motion = motion_of(start.run, start.launched, begin, end, start.factor, first)
    if motion is None:
        raise NoOrbit("the start is over before the record begins")
    return motion


def _stays(motions: Sequence[Motion], others: Sequence[Motion]) -> bool:
    """Whether motions end when others do, up to rounding."""
    ends = [
        (motion.edges[-1], other.edges[-1], np.ptp(other.edges)) for motion, other in zip(motions, others, strict=True)
    ]
    return all(abs(end - other) <= FIT.above * span for end, other, span in ends)


def _spread(values: np.ndarray, which: Sequence[bool]) -> np.ndarray:
    """Values of some channels, 0 for the others."""
    found = np.zeros(len(which))
    found[np.array(which, bool)] = values
    return found


def _with_values(machine: Any, values: Mapping[str, float]) -> Machine:
    """The machine with fitted values; a damper that its error puts below 0 is almost none."""
    own = {name: value for name, value in values.items() if name != RESTITUTION}
    own |= {name: max(own[name], FIT.above * abs(getattr(machine, name))) for name in DAMPERS if name in own}
    machine = machine.with_values(**own) if own else machine
    return replace(machine, restitution=float(np.clip(values[RESTITUTION], 0, 1))) if RESTITUTION in values else machine


def _simulated(machine: Machine, motion: Motion, time: float) -> Simulation:
    """The simulation of a machine from the start of a motion."""
    model, x = machine.model, motion.nodes[0][0]
    if motion.parts[0].begins == LAUNCH:
        speed = float(x[model.flight.states.index(model.launched[1])])
        return simulate(machine, speed * (machine.units.of(LIFTOFF_SPEED) if machine.units else 1.0), time=time)
    sizes = machine.units.of_states(model.flight.states) if machine.units else 1.0
    return simulate(machine, state=_opened(machine, x, motion.parts[0].contact) * sizes, time=time)


def _opened(machine: Machine, x: np.ndarray, contact: bool) -> np.ndarray:
    """A first state as a flight state, whose gap is not below 0 in flight."""
    model = machine.model
    if contact:
        return model.embed @ x
    gap, least = model.gap(machine.values), FIT.above * (np.abs(x).max() + 1)
    weights, found = np.array(gap.weights), x.copy()
    if (low := least - float(gap(x))) > 0:
        found += low * weights / (weights @ weights)
        rates = np.array(model.speeds_of_landing(list(np.eye(len(x))), machine.values)[0], dtype=float)
        found += max(least - float(rates @ x), 0.0) * rates / (rates @ rates)
    return found
