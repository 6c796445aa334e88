"""Where the fit of a recorded hop begins: the simulated motions of the machine that are most like the record.

A hop is one number, its launch speed, and the time at which it begins. Where a machine of the same shape has other
masses or another stiffness, its motions are those of this machine with times longer by a factor s, and lengths by s^2,
as gravity is the same. So all launches, times and factors are compared with the beginning of the record.
"""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import NamedTuple

import numpy as np

from orbits import simulate
from orbits.errors import InputError, OrbitsError
from orbits.hops import Simulation
from orbits.model import Machine
from orbits.units import LENGTH, LIFTOFF_SPEED, SPEED, Dimension

from .channels import Channel, observed
from .hop_program import FREE, IMPACT, LANDING, LIFTOFF, Motion, Part


class GuessOptions(NamedTuple):
    """The motions that are compared with a record, and their parts."""

    slowest: float = 0.5  # launch speed, without dimensions
    fastest: float = 60.0
    coarse: int = 12  # launches whose sizes say which are searched
    launches: int = 28  # that are searched
    around: tuple[float, float] = (0.4, 1.8)  # of the launch whose size is that of the record
    factors: tuple[float, float, int] = (0.72, 1.4, 11)  # of the time, and their number
    shifts: int = 48  # of the time of the launch, in a hop
    rows: int = 72  # of the record that are compared
    points: int = 400  # of a simulated motion, between which it is a straight line
    window: float = 1.3  # hops that are compared
    same: float = 0.1  # share of a hop by which its time and its launch differ less in motions that are alike
    best: int = 4  # motions that are returned
    interval: float = 0.5  # the longest one, without dimensions
    launch: float = 0.03  # share of a hop after a launch within which a record begins with that
    shortest_bounce: float = 0.002  # a shorter flight, without dimensions, is left out
    edges: tuple[float, float] = (1.0, 99.0)  # percentiles of what is recorded, which its noise hardly moves


GUESS = GuessOptions()


class Start(NamedTuple):
    """A simulated motion that is like the beginning of a record.

    run : the simulation
    launched : the time of the record at which it begins
    factor : by which its times are longer
    misfit : the mean square of the difference, in sizes of the channels
    """

    run: Simulation
    launched: float
    factor: float
    misfit: float


def sizes_of(values: Sequence[np.ndarray]) -> np.ndarray:
    """The size (c,) of the recorded values of channels: their range, except for a few samples."""
    found = [np.subtract(*np.percentile(each[np.isfinite(each)], GUESS.edges[::-1])) for each in values]
    return np.array([size or 1.0 for size in found])


def starts_of(
    machine: Machine, channels: Mapping[str, Channel], times: np.ndarray, values: Sequence[np.ndarray],
    biased: Sequence[bool],
) -> list[Start]:  # fmt: skip
    """The simulated motions that are most like the beginning of a record, the best first.

    times, values : (n,), and that of each channel, NaN where a sample is missing
    biased : for each channel, whether its offset is unknown
    Raises `InputError` where the machine, as it is stated, has no hops like these.
    """
    sizes = sizes_of(values)
    speed = machine.units.of(LIFTOFF_SPEED) if machine.units else 1.0
    coarse = speed * np.geomspace(GUESS.slowest, GUESS.fastest, GUESS.coarse)
    middle = _launch_of_size(machine, channels, coarse, sizes)
    runs = [_launched(machine, alpha, 3) for alpha in middle * np.geomspace(*GUESS.around, GUESS.launches)]
    found = list[Start]()
    hop = float(np.median([hop_time(run) for run in runs if run]) if any(runs) else np.nan)
    until = times[0] + GUESS.window * hop
    rows = np.flatnonzero(times <= until)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, GUESS.rows).astype(int))]
    for run in runs:
        if run:
            found += _compared(run, channels, times[rows], [each[rows] for each in values], sizes, biased)
    if not found:
        raise InputError(
            "the machine has no hop with a launch like that of the record: state values of its parameters that are "
            "nearer to the machine's, within a third of them"
        )
    return _different(sorted(found, key=lambda start: start.misfit))


def _launch_of_size(machine: Machine, channels: Mapping, alphas: np.ndarray, sizes: np.ndarray) -> float:
    """The launch speed of a hop whose channels range as far as those of the record."""
    logs = []
    for alpha in alphas:
        if run := _launched(machine, alpha, 1):
            shown = observed(run, channels, np.linspace(0.0, run.end, GUESS.points // 4))
            logs.append((np.log(alpha), np.log(np.ptp(shown, axis=1) + 1e-300)))
    if not logs:
        raise InputError(f"no launch of the machine leads to a hop: {machine!r}")
    speeds, ranges = (np.array(each) for each in zip(*logs, strict=True))
    return float(
        np.exp(
            np.median(
                [
                    np.interp(np.log(size), np.maximum.accumulate(own), speeds)
                    for size, own in zip(sizes, ranges.T, strict=True)
                ]
            )
        )
    )


def _launched(machine: Machine, alpha: float, hops: int) -> Simulation | None:
    try:
        run = simulate(machine, float(alpha), hops=hops)
    except OrbitsError:
        return None
    return run if run.legs and run.end > 0 else None


def hop_time(run: Simulation) -> float:
    """The duration of the first hop, to its lift-off after a landing."""
    return next((event.time for event in run.events if event.kind == LIFTOFF), run.end)


def _compared(
    run: Simulation, channels: Mapping[str, Channel], times: np.ndarray, values: list[np.ndarray], sizes: np.ndarray,
    biased: Sequence[bool],
) -> list[Start]:  # fmt: skip
    """The best time of the launch for each factor."""
    grid, found = np.linspace(0.0, run.end, GUESS.points), []
    shown, hop, powers = (
        observed(run, channels, grid),
        hop_time(run),
        [_power(each.dimension) for each in channels.values()],
    )
    for factor in np.geomspace(*GUESS.factors[:2], GUESS.factors[2]):
        launched = times[0] - np.linspace(0.0, 1.0, GUESS.shifts, endpoint=False) * hop * factor
        since = (times - launched[:, None]) / factor
        inside = since <= run.end
        total, count = np.zeros(len(launched)), np.zeros(len(launched))
        for i, own in enumerate(values):
            # Lengths grow from those at lift-off, where the spring is almost as long as at rest.
            still = shown[i][0] if powers[i] == _power(LENGTH) else 0.0
            guess = still + np.interp(since, grid, shown[i] - still) * factor ** powers[i]
            used = inside & np.isfinite(own)
            off = np.where(used, np.nan_to_num(own) - guess, 0.0)
            if biased[i]:
                off = np.where(used, off - off.sum(1, keepdims=True) / np.maximum(used.sum(1), 1)[:, None], 0.0)
            total += np.minimum((off / sizes[i]) ** 2, 1.0).sum(1)
            count += used.sum(1)
        whole = inside.mean(1) > 0.95
        misfit = np.where(whole, total / np.maximum(count, 1), np.inf)
        best = int(np.argmin(misfit))
        if np.isfinite(misfit[best]):
            found.append(Start(run, float(launched[best]), float(factor), float(misfit[best])))
    return found


def _power(dimension: Dimension) -> float:
    """The power of the factor of times by which a channel grows: gravity and weights stay."""
    return {LENGTH: 2.0, SPEED: 1.0}.get(dimension, 0.0)


def _different(starts: list[Start]) -> list[Start]:
    """The best starts, without any that resemble a better one."""
    found = list[Start]()
    for start in starts:
        hop = hop_time(start.run) * start.factor
        others = ((hop_time(each.run) * each.factor - hop, each.launched - start.launched) for each in found)
        if not any(max(map(abs, pair)) < GUESS.same * hop for pair in others):
            found.append(start)
        if len(found) == GUESS.best:
            break
    return found


def motion_of(
    run: Simulation, launched: float, begin: float, end: float, factor: float = 1.0, first: str = FREE
) -> Motion | None:
    """A simulated motion from one time of the record to another as the parts of a program; None where it is over
    before.

    launched : the time of the record at which the simulation begins
    factor : by which the times of the motion are longer than those of the simulation
    first : how its first part begins
    """
    machine = run.source
    time = machine.units.time if machine.units else 1.0
    size = machine.units.of_states(machine.model.flight.states) if machine.units else 1.0
    onto = np.linalg.pinv(machine.model.embed).T
    parts, edges, nodes, kind = list[Part](), list[float](), list[np.ndarray](), first
    for leg, event in zip(run.legs, [*run.events, None], strict=False):
        start = launched + factor * leg.start
        last = start + factor * float(leg.path.times[-1])
        begins, kind = kind, event.kind if event else FREE
        a, b = max(start, begin), min(last, end)
        if last <= begin or a >= b:
            continue
        contact = leg.phase == "contact"
        if (
            begins == IMPACT
            and not contact
            and last < end
            and (last - start) / factor < GUESS.shortest_bounce * time
            and kind in (IMPACT, LANDING)
        ):
            continue
        count = max(1, ceil((b - a) / factor / time / GUESS.interval))
        since = ((a - start) + (b - a) * np.arange(count) / count) / factor
        rows = leg.path(since)
        states = rows[:, : machine.model.embed.shape[int(contact)]]
        bare = size if np.isscalar(size) else size @ np.abs(onto) if contact else size
        parts.append(Part(contact, begins if parts else first, count))
        edges.append(a)
        nodes.append(states / bare)
        final = b
    return Motion(tuple(parts), np.array([*edges, final]), nodes) if parts else None
