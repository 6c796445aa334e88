"""Guesses of orbits: the lowest launch speed of a family under constant gravity, from which the search starts."""

from collections.abc import Callable, Generator, Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from ..errors import BreaksDown, FlowError, NoOrbit, OutOfRange
from ..flow import Flow, Watch, first_events, flow_of
from ..laws import from_key, values_and_slopes
from ..model import RELATIVE, Affine, Model, Relative, half_angle, linear_guess, refuse_hysteresis
from ..numerics import Crossings, root_search
from ..shooting import vectors
from ..units import SPEED, Message, Quantity


class GuessOptions(NamedTuple):
    """Where a search for the lowest launch speed begins, its steps, and its accuracy."""

    # The slowest launch, in multiples of the machine's scale of speed: the search starts again there when its first
    # speed is too fast.
    slowest: float = 1e-3
    accuracy: float = 1e-3  # of the estimate, as a share of half an oscillation; Newton's method does the rest
    depth: float = 0.01  # and as a share of the equation's value beyond zero, as another root may be close
    shortest_step: float = 0.02  # as a share of the speed
    # Longest step, as a share of the speed, for a spring with a barrier that can be crossed: where a hop just crosses
    # it the lateness has a narrow peak, and between two peaks it may fall below zero.
    longest_at_barriers: float = 0.1
    # Between samples the curvature of the lateness may be this many times as large as second differences indicate.
    bend_safety: float = 4.0
    longest_flight: float = 1e3  # in search of two turns, per 1 + launch speed; a slower spring does not return


GUESS = GuessOptions()
# Extensions outward on either side, in units of length and multiples of the family, at which barriers are detected.
BARRIER_EXTENSIONS = np.outer([1.0, -1.0], np.geomspace(0.3, 300.0, 100)).ravel()
# Why a motion may break down under a formula with exp.
OVERFLOWS = "; exp(x) may overflow on the way: 1/(1 + exp(x)) is (1 - tanh(x/2))/2"
SPEED_OF_EXTENSION = Affine((0.0, 1.0))  # of the relative motion


class Guesses(NamedTuple):
    """The guesses of many machines with parameters (m,).

    unknowns : by name (m,), NaN where there is none
    own : whether each machine (m,) can be solved together with the others, by this model
    single : whether the family of each machine (m,) has one orbit according to `Model.search`
    refused : the reasons, by index, why a machine has no guess
    """

    unknowns: Mapping[str, Any]
    own: np.ndarray
    single: np.ndarray
    refused: Mapping[int, NoOrbit]


def guess(model: Model, family: int, p: Mapping[str, float]) -> dict[str, float]:
    """The launch and the "duration" of the half flight that follow from a model's relative motion under constant
    gravity, or from its linear hops; raises `NoOrbit` where there is none."""
    refuse_hysteresis(model)
    if not model.conservative:
        raise NoOrbit("a damped machine loses energy on every hop: it has no lossless orbit, but a return map")
    relative = model.relative
    if relative is None and model.is_guessed:
        return linear_guess(model, family, p)
    if relative is None:
        remedy = (
            "" if model.one_speed else ", as one of starts(machine), or search by find_all(machine, starts(machine))"
        )
        raise NoOrbit(f"the model of a {model.name} has no guess of its families: give `find` a start{remedy}")
    p = relative.own(p)
    law, ps = from_key(relative.law, p), {name: np.array([value]) for name, value in p.items()}
    extension, rest = relative.liftoff.extension(law), np.array([law.rest()])
    relative.liftoff.refuse_jump(law, extension)
    slopes = lambda x: law.with_slope(np.clip(x, *law.range()))[1]  # noqa: E731
    single = np.array([relative.search(p).single])
    (alpha,), refused = lowest_launch_speeds(relative, ps, np.array([extension]), family, rest, slopes, single)
    if refused:
        raise refused[0]
    return {"liftoff": extension, "alpha": float(alpha), "duration": float(alpha) * float(relative.time(p))}


def refuse_jump(model: Model, p: Mapping[str, float]) -> None:
    """Raise `NoOrbit` where the force of a model jumps over the level of lift-off."""
    if relative := model.relative:
        law = from_key(relative.law, relative.own(p))
        relative.liftoff.refuse_jump(law, relative.liftoff.extension(law))


def guesses(relative: Relative, family: int, p: Mapping[str, np.ndarray]) -> Guesses:
    """The guesses of many machines with parameters (m,) by name, from their relative motions."""
    p = relative.own(p)
    alpha = np.full(len(next(iter(p.values()))), np.nan)
    extension = relative.liftoff.extensions(relative.law, p)
    own, single = np.isfinite(extension), relative.single(p)
    law, refused = relative.law, dict[int, NoOrbit]()
    if len(rows := np.flatnonzero(own)):
        those, places = {name: values[rows] for name, values in p.items()}, extension[rows]
        slopes = lambda x: values_and_slopes(law, those, x)[1]  # noqa: E731
        if law.degree() == 1:
            alpha[rows] = half_angle(family) * relative.scale(slopes(places[:, None])[:, 0], those)
        else:
            rests = np.zeros(len(rows))
            alpha[rows], none = lowest_launch_speeds(relative, those, places, family, rests, slopes, single[rows])
            refused = {int(rows[i]): error for i, error in none.items()}
    found = {"liftoff": extension, "alpha": alpha, "duration": alpha * relative.time(p)}
    return Guesses(found, own, single, refused)


class _Sample(NamedTuple):
    """The equation at a launch speed: the time from mid-flight to the family's turn, infinite if there is no such turn,
    and half the period of the extension."""

    alpha: float
    lateness: float
    half_period: float = np.inf


class _LowestLaunch(NamedTuple):
    """The result of a search: the launch speed, NaN where there is none; and the last launch speed that was too fast
    for the extension to return, NaN where it always returned."""

    alpha: float
    lost: float = np.nan


def lowest_launch_speeds(
    relative: Relative, p: Mapping[str, np.ndarray], liftoffs: np.ndarray, family: int, rests: np.ndarray,
    slopes: Callable[[np.ndarray], np.ndarray], single: np.ndarray,
) -> tuple[np.ndarray, dict[int, NoOrbit]]:  # fmt: skip
    """The lowest launch speeds (m,) whose half flight ends on the family's turn: time alpha = first turn + family half
    periods; NaN where there is none, and the reasons by index.

    The time of that turn depends on alpha alone, so this is one scalar equation for any spring, and the family is right
    by construction. Each search takes the same launches as it would alone.

    p : parameters (m,) by name
    liftoffs, rests : the extensions (m,) at lift-off and at rest
    slopes : extensions (m, k) -> the slopes (m, k) of the springs there
    single : whether the springs (m,) bend seldom; the fast flights of others take long, and a search follows anyway
    """
    flow, ps = flow_of(relative.phase, tuple(p)), vectors(p, len(liftoffs))
    times, near = np.broadcast_to(relative.time(p), len(ps)), slopes(np.column_stack([liftoffs, rests]))
    steepest = np.where(np.isfinite(near), near, -np.inf).max(axis=1)  # a law has a slope at lift-off, if not at rest
    barriers = crossable_barriers(slopes(np.outer(family / steepest, BARRIER_EXTENSIONS)))
    scales, ends = relative.scale(steepest, p), dict[int, _LowestLaunch]()
    fastest = np.where(single, RELATIVE.fastest, RELATIVE.fastest_in_detail) * family * scales
    each = zip(scales.tolist(), fastest.tolist(), barriers.tolist(), strict=True)
    searches = [_search(family, *one) for one in each]
    wanted = {i: next(search) for i, search in enumerate(searches)}
    oscillations = half_oscillation if len(ps) == 1 else half_oscillations
    while wanted:
        which, alphas = np.array(list(wanted)), np.array(list(wanted.values()))
        starts = np.column_stack([liftoffs[which], alphas])
        longest = GUESS.longest_flight * times[which] * (1 + alphas)
        firsts, halves = oscillations(flow, ps[which], starts, longest) / times[which]
        lateness = np.where(np.isfinite(halves), firsts + family * halves - alphas, np.inf)
        rows, wanted = zip(which.tolist(), alphas.tolist(), lateness.tolist(), halves.tolist(), strict=True), {}
        for i, *values in rows:
            try:
                wanted[i] = searches[i].send(_Sample(*values))
            except StopIteration as end:
                ends[i] = end.value
    found = np.array([ends[i].alpha for i in range(len(scales))])
    none = np.flatnonzero(np.isnan(found))
    those = {name: values[none] for name, values in p.items()}
    refused = _refusals(relative, those, family, liftoffs[none], [ends[i] for i in none.tolist()], fastest[none])
    return found, dict(zip(none.tolist(), refused, strict=True))


def half_oscillation(flow: Flow, ps: np.ndarray, starts: np.ndarray, longest: np.ndarray) -> np.ndarray:
    """The `half_oscillations` (2, 1) of one spring, which passes its first turn without a halt, to save calls."""
    turns, clock, crossings = [], [0.0], Crossings()

    def second_turn(coefficients, steps):
        for i, t in crossings(coefficients[:, 1], steps):
            turns.append(clock[0] + steps[:i].sum() + t)
            if len(turns) == 2:
                return i, t
        clock[0] += steps.sum()
        return None

    with suppress(FlowError):
        flow.run(starts[0], ps[0], longest[0], stop=second_turn)
        if len(turns) == 2:
            return np.array([turns[:1], np.diff(turns)])
    return np.full((2, 1), np.nan)


def half_oscillations(flow: Flow, ps: np.ndarray, starts: np.ndarray, longest: np.ndarray) -> np.ndarray:
    """Times (2, m) from lift-off to the first turn of the extension, and half its periods, of springs with parameters
    (m, np) from states (m, 2); NaN when the extension does not return within times `longest` (m,), or the motion ends
    before."""
    return times_of_turns(flow, ps, starts, SPEED_OF_EXTENSION, longest, 2)[0]


def times_of_turns(
    flow: Flow, ps: np.ndarray, starts: np.ndarray, rate: Affine, longest: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The times (count, m) of the first zero of a rate on motions from states (m, n), and from each zero to the next.

    longest : times (m,) within which each zero has to occur; a time is NaN otherwise

    Returns also the states (m, n) at the last zero that occurs, and whether each motion (m,) breaks off, because it
    runs away or reaches a singularity.
    """
    times, states, going = np.full((count, len(starts)), np.nan), np.array(starts), np.arange(len(starts))
    broken = np.zeros(len(starts), bool)
    for turn in range(count):
        if not len(going):
            break
        some = ps[going] if len(ps) > 1 else ps[0]
        found, _, rows, failed = first_events(
            flow, states[going], some, Watch(flow, [rate]), longest[going], int(turn > 0), reasons=False
        )
        broken[going[[*failed]]], times[turn, going] = True, found
        states[going] = rows[:, : states.shape[1]]
        going = going[np.isfinite(found)]
    return times, states, broken


def _refusals(
    relative: Relative, p: Mapping[str, np.ndarray], family: int, liftoffs: np.ndarray, ends: list[_LowestLaunch],
    fastest: np.ndarray,
) -> list[NoOrbit]:  # fmt: skip
    """The errors of springs with parameters (m,) by name that have no orbit, from the ends of their searches."""
    lost, errors = np.array([end.lost for end in ends]), dict[int, FlowError]()
    if len(known := np.flatnonzero(np.isfinite(lost))):
        those = {name: values[known] for name, values in p.items()}
        flow, ps = flow_of(relative.phase, tuple(p)), vectors(those, len(known))
        starts = np.column_stack([liftoffs[known], lost[known]])
        longest = GUESS.longest_flight * relative.time(those) * (1 + lost[known])
        failed = first_events(flow, starts, ps, Watch(flow, [SPEED_OF_EXTENSION], rising=True), longest).failed
        errors = {int(known[i]): error for i, error in failed.items()}
    refused = list[NoOrbit]()
    for i, (alpha, last) in enumerate(zip(lost.tolist(), fastest.tolist(), strict=True)):
        parts = {"alpha": Quantity(alpha, SPEED), "fastest": Quantity(last, SPEED)}
        if np.isnan(alpha):
            text = "none up to launch speed {fastest:g}"
        elif isinstance(error := errors.get(i), OutOfRange):
            text = "beyond launch speed {alpha:.4g} {error}"
        else:
            text = "at launch speed {alpha:.4g} the extension does not come back" + (": {error}" if error else "")
            text += OVERFLOWS if isinstance(error, BreaksDown) and "exp(" in relative.law.text else ""
        reason = Message(text, error=errors.get(i, ""), **parts)
        text = "{what} has no lossless orbit of family {family} under constant gravity: {reason}"
        refused.append(NoOrbit(Message(text, what=f"spring '{relative.law.text}'", family=family, reason=reason)))
    return refused


def _search(family: int, scale: float, fastest: float, barrier: bool) -> Generator[float, _Sample, _LowestLaunch]:
    """A search of `lowest_launch_speeds`, which yields launch speeds and is sent samples there."""
    samples = [_Sample(0.0, 1.0)]
    slowest = GUESS.slowest * scale
    no_return = np.inf  # the lowest speed from which the extension does not come back
    alpha, lost = 2 * family * scale, np.nan  # low for most springs; if too fast, the search starts at the slowest
    while alpha < fastest and samples[-1].alpha < (1 - 1e-4) * no_return:
        new = yield alpha
        lost = lost if np.isfinite(new.lateness) else alpha
        if len(samples) == 1 and alpha > slowest and not 0 < new.lateness < np.inf:
            alpha, lost = slowest, np.nan
            continue
        if new.lateness <= 0:
            return _LowestLaunch((yield from _estimated_root(samples[-1], new)))
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
                return _LowestLaunch((yield from _estimated_root(samples[-3], lowest)))
        alpha = _next_speed(samples, scale, barrier, no_return)
    return _LowestLaunch(np.nan, lost)


def crossable_barriers(slopes: np.ndarray) -> np.ndarray:
    """Whether springs with these slopes (m, k) at `BARRIER_EXTENSIONS` have a barrier (m,) that a hop can cross.

    There the force falls and then rises again, further out on the same side. Where it only falls, a motion that crosses
    the barrier escapes.
    """
    outward = slopes.reshape(len(slopes), 2, -1)
    return np.any((outward[..., :-1] < 0) & (outward[..., 1:] > 0), axis=(1, 2))


def _estimated_root(early: _Sample, late: _Sample) -> Generator[float, _Sample, float]:
    """The root between a sample where the turn comes too late and a faster one where it comes too early; yields launch
    speeds and is sent samples there."""
    enough, seen = min(GUESS.accuracy * late.half_period, GUESS.depth * abs(late.lateness)), [early, late]
    search = root_search(early.alpha, late.alpha, early.lateness, late.lateness, enough)
    try:
        alpha = next(search)
        while True:
            seen.append((yield alpha))
            alpha = search.send(seen[-1].lateness)
    except StopIteration as end:
        root = end.value
    # The parabola of the speed over the last three values is far more accurate than the secant, often so much that
    # Newton's method takes one step. Where it leads far from the secant's root, it is not used.
    values = {each.lateness: each.alpha for each in seen[-3:] if np.isfinite(each.lateness)}
    if len(values) < 3:
        return root
    (fa, a), (fb, b), (fc, c) = values.items()
    slope, other = (b - a) / (fb - fa), (c - b) / (fc - fb)
    better = c - fc * (other - fb * (other - slope) / (fc - fa))
    return better if abs(better - root) < abs(root - c) else root


def _next_speed(samples: list[_Sample], scale: float, barrier: bool, no_return: float) -> float:
    """The next speed of the search: just past where the last two samples point, so that it brackets the root."""
    before, last = samples[-2:]
    slope = (last.lateness - before.lateness) / (last.alpha - before.alpha) if len(samples) > 2 else 0.0
    ahead = 1.2 * last.lateness / max(-slope, 0.3) if slope < 0 else last.lateness / 1.5
    if barrier:
        ahead = min(ahead, GUESS.longest_at_barriers * (scale + last.alpha))
    alpha = last.alpha + max(ahead, GUESS.shortest_step * (scale + last.alpha))
    return alpha if alpha < no_return else 0.5 * (last.alpha + no_return)


def _golden_section(a: _Sample, b: _Sample) -> Generator[float, _Sample, _Sample]:
    """The lowest sample so far, once it is not above zero, once the minimum between two samples cannot reach zero
    according to second differences, or once half the digits of its speed are known, as no more are determined; yields
    launch speeds and is sent samples there."""
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
    """Whether lateness that is above zero at samples may vanish between them, if its curvature is at most
    `bend_safety` times that of their second differences."""
    alphas, lateness = np.array([[each.alpha, each.lateness] for each in samples]).T
    widths, least = np.diff(alphas), lateness.min()
    with np.errstate(invalid="ignore"):  # some lateness may be infinite
        bends = np.abs(np.diff(np.diff(lateness) / widths)) / (0.5 * (widths[1:] + widths[:-1]))
    return least > 0 and not least > GUESS.bend_safety * bends.max() * widths.max() ** 2 / 8
