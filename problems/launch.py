"""Launches: the extension at which the spring's force, with a constant load, lifts off the foot, and the lowest launch
speed of a family under constant gravity, from which the search of an orbit starts."""

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from orbits.errors import FlowError, InputError, NoOrbit, OutOfRange
from orbits.flow.flow import Flow, flow_of
from orbits.flow.zero_crossing import first_zeros
from orbits.model.phase import Affine, Phase
from orbits.model.units import FORCE, LENGTH, SPEED, STIFFNESS, Message, Quantity
from orbits.numerics.bernstein import Crossings
from orbits.numerics.roots import answered, root_search

from .laws import Key, Law, values_and_slopes

# Below this slope, rounding cannot tell a force that passes the level of lift-off from one that only touches it.
FLATTEST_LIFTOFF = 1e-14
# Distances from rest at which the force is sampled: densely where a spring in its own units lifts off.
SAMPLED_DISTANCES = np.concatenate(
    [[0.0], np.geomspace(1e-9, 1e-3, 50)[:-1], np.geomspace(1e-3, 1e3, 200), np.geomspace(1e3, 1e9, 50)[1:]]
)
# Springs whose lift-off is looked for together, so that their sampled forces stay in the processor's cache.
BLOCK_OF_SPRINGS = 256
# Halvings of an interval after which its ends are neighbouring numbers.
BISECTIONS = 60
# Bounds of the search, in multiples of the machine's own scale of speed. Beyond the fastest, per family, a hop is 5e7
# lengths high and more, which is no machine; from the slowest the search starts again when its first speed is too fast.
FASTEST, SLOWEST = 1e4, 1e-3
# Accuracy of the estimate, as a share of half an oscillation; Newton's method does the rest.
ACCURACY = 1e-3
# The estimate is as accurate as this share of how far the equation goes beyond zero, as another root may be close.
DEPTH = 0.01
# Shortest step of the search, as a share of the speed.
SHORTEST_STEP = 0.02
# Between samples the lateness may bend this many times as much as their second differences say.
FOLD_SAFETY = 4.0
# Time followed in search of two turns, per 1 + launch speed; a spring that takes longer does not return.
LONGEST_FLIGHT = 1e3
SPEED_OF_EXTENSION = Affine((0.0, 1.0))  # of the relative motion


@dataclass(frozen=True)
class Liftoff:
    """The condition force + load + damping * speed = 1 that ends sustained contact.

    load : constant force beside the spring's, 0 for the hopper and the hand's weight 1 for the juggler
    name : the force that lift-off waits for, in words
    """

    load: float
    name: str

    def extension(self, law: Law) -> float:
        """The extension at which force + load = 1 is first reached from rest, the force rising.

        Raises `NoOrbit` where the force never passes that level, `InputError` for a law that is no spring.
        """
        if law.key.degree() == 0:
            raise InputError(f"spring '{law.text}' does not depend on the extension {law.variable}: it is no spring")
        low, high = law.range()
        rest, level = law.rest(), 1.0 - self.load
        rises = float(law(rest)) < level
        extensions, forces = _sampled_from_rest(law, rest, away=1.0 if rises else -1.0)
        if float(forces[0]) == level:
            return self._checked(law, rest)
        beyond = ((forces >= level) == rises).nonzero()[0]
        if not len(beyond):
            text = "spring '{law}' never reaches {level} ({extreme} {force:.4g}{within}): nothing leaves the ground"
            extreme, force = ("largest tension", forces.max()) if rises else ("least force", forces.min())
            bounds = {"low": Quantity(low, LENGTH), "high": Quantity(high, LENGTH)}
            within = Message(" within [{low:g}, {high:g}]", **bounds) if np.isfinite([low, high]).any() else ""
            told = {"level": self.name, "extreme": extreme, "force": Quantity(float(force), FORCE), "within": within}
            raise NoOrbit(Message(text, law=law.text, **told))
        low, high = np.sort(extensions[beyond[0] - 1 : beyond[0] + 1])[:, None]
        return self._checked(law, float(_level_crossings(law.with_slope, np.array([level]), low, high)[0]))

    def extensions(self, key: Key, p: Mapping[str, np.ndarray]) -> np.ndarray:
        """`extension` of smooth springs with parameters (m,) by name, whose force rises or falls all the way from rest
        to the level; NaN for others."""
        count, level = len(next(iter(p.values()))), 1.0 - self.load
        found = np.full(count, np.nan)
        if key.pieces is not None or key.degree() == 0:
            return found
        forces, slopes = values_and_slopes(key, p, np.zeros((count, 1)))
        away = np.where(forces[:, 0] < level, 1.0, -1.0)
        for first in range(0, count, BLOCK_OF_SPRINGS):
            rows = slice(first, first + BLOCK_OF_SPRINGS)
            extensions, block = away[rows, None] * SAMPLED_DISTANCES, {name: values[rows] for name, values in p.items()}
            forces, slopes = values_and_slopes(key, block, extensions)
            with np.errstate(invalid="ignore"):
                beyond, ends_there = (forces >= level) == (away[rows, None] > 0), ~np.isfinite(forces)
                ends_there[:, 1:] |= (slopes[:, :-1] > 0) & (slopes[:, 1:] <= 0)
            cell = beyond.argmax(axis=1)
            each = np.arange(len(cell))
            steady = (cell > 0) & (np.cumsum(ends_there, axis=1)[each, cell] == 0) & (forces[:, 0] != level)
            ends = np.sort([extensions[each, cell - 1][steady], extensions[each, cell][steady]], axis=0)
            found[rows][forces[:, 0] == level] = 0.0
            found[rows][steady] = self._reached(key, {name: values[steady] for name, values in block.items()}, *ends)
        flat = ~(values_and_slopes(key, p, np.nan_to_num(found)[:, None])[1][:, 0] > FLATTEST_LIFTOFF)
        found[flat] = np.nan
        return found

    def _reached(self, key: Key, p: Mapping[str, np.ndarray], low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Where springs with parameters (m,) by name reach the level between extensions (m,)."""

        def force_and_slope(r: np.ndarray) -> list[np.ndarray]:
            return [column[:, 0] for column in values_and_slopes(key, p, r[:, None])]

        return _level_crossings(force_and_slope, np.full(len(low), 1.0 - self.load), low, high) if len(low) else low

    def extensions_at(self, law: Law, damping: float, alpha: ArrayLike) -> np.ndarray:
        """The extensions (m,) at lift-off with speeds `alpha` (m,), with a damper of this coefficient.

        They lie on the rising branch of the force that passes the level at rest; NaN where that branch ends before.
        """
        static, alpha = self.extension(law), np.asarray(alpha, dtype=float)
        if damping == 0.0:
            return np.full(alpha.shape, static)
        level, result = 1.0 - self.load - damping * alpha, np.full(alpha.shape, np.nan)
        extensions, forces = _rising_branch(law, static, up=damping < 0)
        cell = np.searchsorted(forces, level, side="right") - 1
        inside = (cell >= 0) & (cell < len(extensions) - 1)
        if inside.any():
            ends = extensions[cell[inside]], extensions[cell[inside] + 1]
            result[inside] = _level_crossings(law.with_slope, level[inside], *ends)
        return result

    def _checked(self, law: Law, liftoff: float) -> float:
        """The extension at lift-off; raises `NoOrbit` where the force only touches the level there."""
        slope = float(law.with_slope(liftoff)[1])
        if slope > FLATTEST_LIFTOFF:
            return liftoff
        reaches = "spring '{law}' only just reaches {level} at extension {liftoff:.6g}, with slope {slope:.1e}"
        numbers = {"liftoff": Quantity(liftoff, LENGTH), "slope": Quantity(slope, STIFFNESS)}
        raise NoOrbit(Message(reaches + ": nothing lifts off cleanly", law=law.text, level=self.name, **numbers))


def _sampled_from_rest(law: Law, rest: float, away: float) -> tuple[np.ndarray, np.ndarray]:
    """Extensions (n,) away from rest, as far as the force is finite, with its turning points, and the forces there."""
    extensions = np.clip(rest + away * SAMPLED_DISTANCES, *law.range())
    forces, slopes = law.with_slope(extensions)
    count = int(np.argmin(np.append(np.isfinite(forces), False)))
    if count == 0:
        raise InputError(f"spring '{law.text}' has no force at rest (r = {rest:g})")
    extensions, forces, slopes = extensions[:count], forces[:count], slopes[:count]
    cells = ((slopes[:-1] > 0) & (slopes[1:] <= 0)).nonzero()[0]
    if not len(cells):
        return extensions, forces
    turns = _end_of_rise(law, extensions[cells], extensions[cells + 1])
    return np.insert(extensions, cells + 1, turns), np.insert(forces, cells + 1, law(turns))


def _rising_branch(law: Law, static: float, up: bool) -> tuple[np.ndarray, np.ndarray]:
    """Extensions and forces (n,), ascending, from the static lift-off up or down to where the force turns or ends."""
    side = 1.0 if up else -1.0
    extensions = np.unique(np.clip(static + side * SAMPLED_DISTANCES, *law.range()))[:: int(side)]
    forces, slopes = law.with_slope(extensions)
    with np.errstate(invalid="ignore"):
        rises = np.append(True, side * np.diff(forces) > 0)
    fails = (~(rises & (slopes > 0) & np.isfinite(forces))).nonzero()[0]
    if len(fails):
        count = max(int(fails[0]), 1)
        turn = _end_of_rise(law, extensions[count - 1], extensions[count])
        extensions, forces = np.append(extensions[:count], turn), np.append(forces[:count], law(turn))
    return extensions[:: int(side)], forces[:: int(side)]


def _end_of_rise(law: Law, inner: ArrayLike, outer: ArrayLike) -> np.ndarray:
    """The last extensions (m,) with a finite, rising force between `inner` (m,), where it rises, and `outer` (m,)."""
    inner, outer = np.asarray(inner), np.asarray(outer)
    for _ in range(BISECTIONS):
        middle = 0.5 * (inner + outer)
        force, slope = law.with_slope(middle)
        rises = (slope > 0) & np.isfinite(force)
        inner, outer = np.where(rises, middle, inner), np.where(rises, outer, middle)
    return inner


def _level_crossings(force_and_slope: Callable, level: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Where a force, x (m,) -> values and slopes (m,), rises through levels (m,) between extensions (m,): Newton's
    method safeguarded by bisection."""
    r = 0.5 * (low + high)
    for _ in range(200):
        force, slope = force_and_slope(r)
        low, high = np.where(force < level, r, low), np.where(force < level, high, r)
        new = np.divide(level - force, slope, out=low - r, where=slope != 0) + r
        if (np.abs(new - r) <= 4e-16 * np.abs(r)).all():
            break
        r = np.where((low < new) & (new < high), new, 0.5 * (low + high))
    return np.clip(new, low, high)


class _Sample(NamedTuple):
    """The equation at a launch speed: the time by which the family's turn comes after mid-flight, infinite when it
    never comes, and half the period of the extension."""

    alpha: float
    lateness: float
    half_period: float = np.inf


class _End(NamedTuple):
    """What a search ends with: the launch speed, NaN where there is none; and the last one that was too fast for the
    extension to come back, NaN where it always did."""

    alpha: float
    lost: float = np.nan


def lowest_launch_speed(
    phase: Phase, p: dict[str, float], liftoff: float, family: int, scale: float, what: str
) -> float:
    """The lowest launch speed whose half flight ends on the family's turn: alpha = first turn + family half periods.

    The time of that turn depends on alpha alone, so this is one scalar equation for any spring, and the family is right
    by construction.

    phase : the relative motion r'' = -F(r)
    scale : the speed in whose multiples the search goes
    what : the spring, in words

    Raises `NoOrbit` when there is no such speed.
    """

    def sample(alpha: float) -> _Sample:
        try:
            first, half_period = half_oscillations(phase, p, liftoff, alpha)
        except FlowError:
            return _Sample(alpha, np.inf)
        return _Sample(alpha, first + family * half_period - alpha if np.isfinite(first) else np.inf, half_period)

    end = answered(_search(family, scale), sample)
    if np.isnan(end.alpha):
        flow, ps = flow_of(phase, tuple(p)), np.array([list(p.values())])
        raise _refusals(flow, ps, family, np.array([liftoff]), [end], np.array([scale]), what)[0]
    return end.alpha


def lowest_launch_speeds(
    phase: Phase, p: Mapping[str, np.ndarray], liftoffs: np.ndarray, family: int, scales: np.ndarray, what: str
) -> tuple[np.ndarray, dict[int, NoOrbit]]:
    """`lowest_launch_speed` for many springs with parameters (m,) by name, extensions (m,) at lift-off and scales (m,):
    the speeds (m,), NaN where there is none, and by index why not. Each search asks for the same launches as alone."""
    flow, ps = flow_of(phase, tuple(p)), np.column_stack(list(p.values()))
    searches, ends = [_search(family, scale) for scale in scales.tolist()], dict[int, _End]()
    asked = {i: next(search) for i, search in enumerate(searches)}
    while asked:
        which, alphas = np.array(list(asked)), np.array(list(asked.values()))
        firsts, halves = _half_oscillations(flow, ps[which], liftoffs[which], alphas)
        lateness = np.where(np.isfinite(halves), firsts + family * halves - alphas, np.inf)
        rows, asked = zip(which.tolist(), alphas.tolist(), lateness.tolist(), halves.tolist(), strict=True), {}
        for i, *values in rows:
            try:
                asked[i] = searches[i].send(_Sample(*values))
            except StopIteration as end:
                ends[i] = end.value
    found = np.array([ends[i].alpha for i in range(len(scales))])
    none = np.flatnonzero(np.isnan(found))
    refused = _refusals(flow, ps[none], family, liftoffs[none], [ends[i] for i in none.tolist()], scales[none], what)
    return found, dict(zip(none.tolist(), refused, strict=True))


def _half_oscillations(
    flow: Flow, ps: np.ndarray, liftoffs: np.ndarray, alphas: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`half_oscillations` of many springs with parameters (m, np); infinite too where the motion ends before."""
    longest, times = LONGEST_FLIGHT * (1 + alphas), np.full((2, len(alphas)), np.inf)
    going, starts = np.arange(len(alphas)), np.column_stack([liftoffs, alphas])
    for turn in range(2):
        if not len(going):
            break
        found, rows, _ = first_zeros(flow, starts, ps[going], SPEED_OF_EXTENSION, longest[going], turn, told=False)
        back = np.isfinite(found)
        going, starts = going[back], rows[back, :2]
        times[turn, going] = found[back]
    return times[0], times[1]


def _refusals(
    flow: Flow, ps: np.ndarray, family: int, liftoffs: np.ndarray, ends: list[_End], scales: np.ndarray, what: str
) -> list[NoOrbit]:
    """Why springs (m,) have no orbit, whose searches end so."""
    lost, errors = np.array([end.lost for end in ends]), dict[int, FlowError]()
    if len(known := np.flatnonzero(np.isfinite(lost))):
        starts, longest = np.column_stack([liftoffs, lost])[known], LONGEST_FLIGHT * (1 + lost[known])
        *_, failed = first_zeros(flow, starts, ps[known], SPEED_OF_EXTENSION, longest, rising=True)
        errors = {int(known[i]): error for i, error in failed.items()}
    refused = list[NoOrbit]()
    for i, (alpha, scale) in enumerate(zip(lost.tolist(), scales.tolist(), strict=True)):
        parts = {"alpha": Quantity(alpha, SPEED), "fastest": Quantity(FASTEST * family * scale, SPEED)}
        if np.isnan(alpha):
            text = "none up to launch speed {fastest:g}"
        elif isinstance(error := errors.get(i), OutOfRange):
            text = "beyond launch speed {alpha:.4g} {error}"
        else:
            text = "at launch speed {alpha:.4g} the extension does not come back" + (": {error}" if error else "")
        reason = Message(text, error=errors.get(i, ""), **parts)
        text = "{what} has no lossless orbit of family {family} under constant gravity: {reason}"
        refused.append(NoOrbit(Message(text, what=what, family=family, reason=reason)))
    return refused


def _search(family: int, scale: float) -> Generator[float, _Sample, _End]:
    """The search of `lowest_launch_speed`, which yields launch speeds and is sent samples there."""
    samples = [_Sample(0.0, 1.0)]
    fastest, slowest = FASTEST * family * scale, SLOWEST * scale
    no_return = np.inf  # the lowest speed from which the extension does not come back
    alpha, lost = 2 * family * scale, np.nan  # rather low for most springs; where it is too fast, from the slowest
    while alpha < fastest and samples[-1].alpha < (1 - 1e-4) * no_return:
        new = yield alpha
        lost = lost if np.isfinite(new.lateness) else alpha
        if len(samples) == 1 and alpha > slowest and not 0 < new.lateness < np.inf:
            alpha, lost = slowest, np.nan
            continue
        if new.lateness <= 0:
            return _End((yield from _estimated_root(samples[-1], new)))
        if np.isfinite(new.lateness):
            samples.append(new)
        elif alpha > slowest:
            no_return = alpha
        else:
            break
        # Near a fold, a pair of roots lies between samples; the start at speed 0 does not count.
        folds = len(samples) > 3 and samples[-3].lateness > samples[-2].lateness <= samples[-1].lateness
        if folds and new is samples[-1]:
            lowest = yield from _golden_section(samples[-3], samples[-1])
            if lowest.lateness <= 0:
                return _End((yield from _estimated_root(samples[-3], lowest)))
        alpha = _next_speed(samples, scale, no_return)
    return _End(np.nan, lost)


def half_oscillations(phase: Phase, p: dict[str, float], liftoff: float, alpha: float) -> tuple[float, float]:
    """Time from lift-off to the first turn of the extension, and half its period.

    Both are infinite when it does not return within `LONGEST_FLIGHT`. Raises `FlowError` when the motion ends before.
    """
    turns, clock, crossings = [], [0.0], Crossings()

    def second_turn(coefficients, steps):
        for i, t in crossings(coefficients[:, 1], steps):
            turns.append(clock[0] + steps[:i].sum() + t)
            if len(turns) == 2:
                return i, t
        clock[0] += steps.sum()
        return None

    longest = LONGEST_FLIGHT * (1 + alpha)
    flow_of(phase, tuple(p)).run([liftoff, alpha], list(p.values()), longest, stop=second_turn)
    return (turns[0], turns[1] - turns[0]) if len(turns) == 2 else (np.inf, np.inf)


def _estimated_root(early: _Sample, late: _Sample) -> Generator[float, _Sample, float]:
    """The root between a sample where the turn comes too late and a faster one where it comes too early; yields launch
    speeds and is sent samples there."""
    enough, seen = min(ACCURACY * late.half_period, DEPTH * abs(late.lateness)), [early, late]
    search = root_search(early.alpha, late.alpha, early.lateness, late.lateness, enough)
    try:
        alpha = next(search)
        while True:
            seen.append((yield alpha))
            alpha = search.send(seen[-1].lateness)
    except StopIteration as end:
        root = end.value
    # The parabola of the speed over the last three values is far more accurate than the secant, often so much that
    # Newton's method takes one step. Where it leads far from the secant's root, it tells nothing.
    values = {each.lateness: each.alpha for each in seen[-3:] if np.isfinite(each.lateness)}
    if len(values) < 3:
        return root
    (fa, a), (fb, b), (fc, c) = values.items()
    slope, other = (b - a) / (fb - fa), (c - b) / (fc - fb)
    better = c - fc * (other - fb * (other - slope) / (fc - fa))
    return better if abs(better - root) < abs(root - c) else root


def _next_speed(samples: list[_Sample], scale: float, no_return: float) -> float:
    """The next speed of the search: just past where the last two samples point, so that it brackets the root."""
    before, last = samples[-2:]
    slope = (last.lateness - before.lateness) / (last.alpha - before.alpha) if len(samples) > 2 else 0.0
    ahead = 1.2 * last.lateness / max(-slope, 0.3) if slope < 0 else last.lateness / 1.5
    alpha = last.alpha + max(ahead, SHORTEST_STEP * (scale + last.alpha))
    return alpha if alpha < no_return else 0.5 * (last.alpha + no_return)


def _golden_section(a: _Sample, b: _Sample) -> Generator[float, _Sample, _Sample]:
    """The least sample that is known when it is not above zero, when the minimum between two samples cannot come to
    zero, as far as second differences tell, or when half the digits of its speed are known, as no more are determined;
    yields launch speeds and is sent samples there."""
    ratio = (np.sqrt(5) - 1) / 2
    left = yield b.alpha - ratio * (b.alpha - a.alpha)
    right = yield a.alpha + ratio * (b.alpha - a.alpha)
    while b.alpha - a.alpha > 1e-8 * (a.alpha + b.alpha) and _may_come_to_zero(a, left, right, b):
        if left.lateness < right.lateness:
            b, right = right, left
            left = yield b.alpha - ratio * (b.alpha - a.alpha)
        else:
            a, left = left, right
            right = yield a.alpha + ratio * (b.alpha - a.alpha)
    return left if left.lateness < right.lateness else right


def _may_come_to_zero(*samples: _Sample) -> bool:
    """Whether lateness that is above zero at samples may vanish between them, where it bends at most `FOLD_SAFETY`
    times as much as their second differences say."""
    alphas, lateness = np.array([[each.alpha, each.lateness] for each in samples]).T
    widths, least = np.diff(alphas), lateness.min()
    with np.errstate(invalid="ignore"):  # some lateness may be infinite
        bends = np.abs(np.diff(np.diff(lateness) / widths)) / (0.5 * (widths[1:] + widths[:-1]))
    return least > 0 and not least > FOLD_SAFETY * bends.max() * widths.max() ** 2 / 8
