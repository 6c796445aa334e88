"""Guesses of orbits: the lowest launch speed of a family under constant gravity, from which the search starts."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..errors import BreaksDown, FlowError, NoOrbit, OrbitsError, OutOfRange
from ..flow import Flow, Watch, first_events, flow_of
from ..laws import from_key, values_and_slopes
from ..model import RELATIVE, Affine, Model, Relative, half_angle, linear_guess, refuse_hysteresis
from ..numerics import estimated_roots
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
OVERFLOWS = "; exp(x) may overflow on the way: write 1/(1 + exp(x)) as (1 - tanh(x/2))/2"
SPEED_OF_EXTENSION = Affine((0.0, 1.0))  # of the relative motion
GOLDEN = (np.sqrt(5) - 1) / 2


class Guesses(NamedTuple):
    """The guesses of many machines with parameters (m,).

    unknowns : by name (m,), NaN where there is none; where a family is searched directly the lift-off alone
    own : whether each machine (m,) can be solved together with the others, by this model
    single : whether the family of each machine (m,) has one orbit according to `Model.search`
    refused : the reasons, by index, why a machine has no guess
    """

    unknowns: Mapping[str, Any]
    own: np.ndarray
    single: np.ndarray
    refused: Mapping[int, OrbitsError]


def guess(model: Model, family: int, p: Mapping[str, float]) -> dict[str, float]:
    """The launch and the "duration" of the half flight that follow from a model's relative motion under constant
    gravity, or from its linear hops; raises `NoOrbit` where there is none."""
    refuse_hysteresis(model)
    if not model.conservative:
        raise NoOrbit("a damped machine loses energy on every hop: it has no lossless orbit; use its return map")
    if not (model.relative or model.is_guessed):
        remedy = (
            ""
            if model.one_speed
            else ", such as one of starts(machine), or search with find_all(machine, starts(machine))"
        )
        raise NoOrbit(f"no guess of the families of a {model.name} is known: give `find` a start{remedy}")
    found = guesses(model, family, {name: np.array([value]) for name, value in p.items()}, 1)
    if found.refused:
        raise found.refused[0]
    return {name: float(values[0]) for name, values in found.unknowns.items()}


def guesses(model: Model, family: int, p: Mapping[str, np.ndarray], count: int) -> Guesses:
    """The guesses of this number of machines of a model, with parameters (m,) by name; there may be none."""
    if model.relative:
        return _by_relative_motion(model.relative, family, p, count)
    found, single, refused = np.full((3, count), np.nan), np.zeros(count, bool), dict[int, OrbitsError]()
    for i in range(count):
        own = {name: float(values[i]) for name, values in p.items()}
        try:
            found[0, i] = model.release(np.ones(1), own)[0]
            if model.is_guessed:
                found[:, i] = [*linear_guess(model, family, own).values()]
                simple = model.plain or model.flight.closed_form is not None
                single[i] = simple and model.search is not None and model.search(own).single
        except OrbitsError as error:
            refused[i] = error
    unknowns = dict(zip(("liftoff", "alpha", "duration"), found, strict=True))
    return Guesses(unknowns, np.isfinite(found[0]), single, refused)


def refuse_jump(model: Model, p: Mapping[str, float]) -> None:
    """Raise `NoOrbit` where the force of a model jumps over the level of lift-off."""
    if relative := model.relative:
        law = from_key(relative.law, relative.own(p))
        relative.liftoff.refuse_jump(law, relative.liftoff.extension(law))


def _by_relative_motion(relative: Relative, family: int, p: Mapping[str, np.ndarray], count: int) -> Guesses:
    """The guesses of many machines with parameters (m,) by name, from their relative motions."""
    p, law = relative.own(p), relative.law
    liftoffs = relative.liftoff.extensions(law, p) if count > 1 else np.full(count, np.nan)
    own, rests, refused = np.isfinite(liftoffs), np.zeros(len(liftoffs)), dict[int, OrbitsError]()
    for i in (~own).nonzero()[0].tolist():
        one = from_key(law, {name: float(values[i]) for name, values in p.items()})
        try:
            liftoff = relative.liftoff.extension(one)
            relative.liftoff.refuse_jump(one, liftoff)
            liftoffs[i], rests[i] = liftoff, one.rest()
        except OrbitsError as error:
            refused[i] = error
    alphas, known = np.full(count, np.nan), np.isfinite(liftoffs)
    if count > 1:
        single = relative.single(p)
    else:
        alone = {name: float(values[0]) for name, values in p.items()}
        single = np.array([known[0] and relative.search(alone).single])
    if len(rows := known.nonzero()[0]):
        these, places = {name: values[rows] for name, values in p.items()}, (liftoffs[rows], rests[rows])
        alphas[rows], none = lowest_launch_speeds(relative, these, *places, family, single[rows])
        refused |= {int(rows[i]): error for i, error in none.items()}
    return Guesses({"liftoff": liftoffs, "alpha": alphas, "duration": alphas * relative.time(p)}, own, single, refused)


def lowest_launch_speeds(
    relative: Relative, p: Mapping[str, np.ndarray], liftoffs: np.ndarray, rests: np.ndarray, family: int,
    single: np.ndarray,
) -> tuple[np.ndarray, dict[int, NoOrbit]]:  # fmt: skip
    """The lowest launch speeds (m,) whose half flight ends on the family's turn: time alpha = first turn + family half
    periods; NaN where there is none, and the reasons by index.

    The time of that turn depends on alpha alone, so this is one scalar equation for any spring, and the family is right
    by construction. Each search takes the same launches as it would alone.

    p : parameters (m,) by name
    liftoffs, rests : the extensions (m,) at lift-off and at rest
    single : whether the springs (m,) bend seldom; the fast flights of others take long, and a search follows anyway
    """
    slopes = lambda x: values_and_slopes(relative.law, p, x)[1]  # noqa: E731
    near = slopes(np.column_stack([liftoffs, rests]))
    steepest = np.where(np.isfinite(near), near, -np.inf).max(axis=1)  # a law has a slope at lift-off, if not at rest
    scales = relative.scale(steepest, p)
    if relative.phase.closed_form:  # eq. (12): a straight line has one orbit in each family
        return half_angle(family) * scales, {}
    barriers = crossable_barriers(slopes(np.outer(family / steepest, BARRIER_EXTENSIONS)))
    fastest = np.where(single, RELATIVE.fastest, RELATIVE.fastest_in_detail) * family * scales
    search = _LaunchSearch(relative, family, p, liftoffs)
    alphas, lost = search.lowest(scales, fastest, barriers)
    if not len(none := np.isnan(alphas).nonzero()[0]):
        return alphas, {}
    these = {name: values[none] for name, values in p.items()}
    refused = _refusals(relative, these, family, liftoffs[none], lost[none], fastest[none])
    return alphas, dict(zip(none.tolist(), refused, strict=True))


class _LaunchSearch:
    """The search for the lowest launch speeds of springs with parameters (m,) by name and extensions (m,) at lift-off.

    The lateness of a launch is the time from mid-flight to the family's turn, infinite without such a turn; it is 1 at
    the speed 0. Up to its first sign change it is sampled at growing speeds.
    """

    def __init__(self, relative: Relative, family: int, p: Mapping[str, np.ndarray], liftoffs: np.ndarray):
        self.family, self.liftoffs, self.flow = family, liftoffs, flow_of(relative.phase, tuple(p))
        self.ps = vectors(p, len(liftoffs))
        self.times = np.broadcast_to(relative.time(p), len(liftoffs))
        self.watch = Watch(self.flow, [SPEED_OF_EXTENSION])

    def samples(self, alphas: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The lateness (k,) and the half periods (k,) of the springs `which` (k,) at launch speeds (k,), infinite and
        NaN where the extension does not return in time, or the motion ends before.

        Before the lift-off the motion is that after a launch with the opposite speed, backwards.
        """
        count, liftoffs, times = len(which), self.liftoffs[which], self.times[which]
        starts, longest = np.empty((2 * count, 2)), np.empty(2 * count)
        for side, speeds in ((slice(count), alphas), (slice(count, None), -alphas)):
            starts[side, 0], starts[side, 1], longest[side] = liftoffs, speeds, GUESS.longest_flight * times
        longest *= 1 + np.abs(starts[:, 1])
        ps = self.ps if len(self.ps) == 1 else self.ps[np.concatenate([which, which])]
        ends = first_events(self.flow, starts, ps, self.watch, longest, reasons=False).times
        firsts = ends[:count] / times
        halves = firsts + ends[count:] / times
        return np.where(np.isfinite(halves), firsts + self.family * halves - alphas, np.inf), halves

    def lowest(self, scales: np.ndarray, fastest: np.ndarray, barriers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The launch speeds (m,), NaN where there is none; and the last speeds (m,) from which the extension did not
        return, NaN where it always did.

        scales, fastest : the scales of speed (m,), and the fastest launches (m,)
        barriers : whether a hop can cross a barrier (m,)
        """
        count, slowest = len(scales), GUESS.slowest * scales
        alphas = 2 * self.family * scales  # low for most springs; if too fast, the search starts at the slowest
        # The last three speeds and their lateness, and the lowest speed from which the extension does not come back.
        speeds, late, taken = np.zeros((count, 3)), np.ones((count, 3)), np.zeros(count, int)
        no_return, lost = np.full(count, np.inf), np.full(count, np.nan)
        brackets = np.full((5, count), np.nan)  # both speeds, their lateness, and the half period at the second
        going = (alphas < fastest).nonzero()[0]
        while len(going):
            at, new = alphas[going], speeds[going]
            value, half = self.samples(at, going)
            comes, over = np.isfinite(value), value <= 0
            early = comes & ~over
            stays, lost_at_last = going[early], np.zeros(len(going), bool)
            if len(stays) < len(going):
                lost[going[~comes]] = at[~comes]
                again = (taken[going] == 0) & (at > slowest[going]) & ~early
                alphas[going[again]], lost[going[again]] = slowest[going[again]], np.nan
                ends = over & ~again
                brackets[:, going[ends]] = new[ends, 2], at[ends], late[going[ends], 2], value[ends], half[ends]
                away = ~comes & ~again
                no_return[going[away]] = at[away]
                lost_at_last = away & (at <= slowest[going])
            for last, added in ((speeds, at), (late, value)):
                last[stays, :2], last[stays, 2] = last[stays, 1:], added[early]
            taken[stays] += 1
            # Near a fold, a pair of roots lies between samples; the start at speed 0 does not count.
            first, middle, latest = late[stays].T
            folds = stays[(taken[stays] > 2) & (first > middle) & (middle <= latest)]
            if len(folds):
                lowest, value, half = self._minima(folds, speeds[folds, ::2], late[folds, ::2])
                under = value <= 0
                own = folds[under]
                brackets[:, own] = speeds[own, 0], lowest[under], late[own, 0], value[under], half[under]
            going = going[np.isnan(brackets[0, going]) & ~lost_at_last]
            if not len(going):
                break
            sought = going[taken[going] > 0]
            alphas[sought] = _next_speeds(
                speeds[sought], late[sought], taken[sought], scales[sought], barriers[sought], no_return[sought]
            )
            going = going[(alphas[going] < fastest[going]) & (speeds[going, 2] < (1 - 1e-4) * no_return[going])]
        return self._roots(brackets), lost

    def _roots(self, brackets: np.ndarray) -> np.ndarray:
        """The launch speeds (m,) at the sign changes of the lateness in brackets (5, m), NaN where there is none."""
        found, which = np.full(brackets.shape[1], np.nan), np.isfinite(brackets[0]).nonzero()[0]
        a, b, fa, fb, half = brackets[:, which]
        enough = np.minimum(GUESS.accuracy * half, GUESS.depth * np.abs(fb))
        found[which] = estimated_roots(lambda alphas, k: self.samples(alphas, which[k])[0], a, b, fa, fb, enough)
        return found

    def _minima(self, which: np.ndarray, ends: np.ndarray, late: np.ndarray) -> np.ndarray:
        """The speeds, lateness and half periods (3, k) of the lowest samples between speeds (k, 2), by golden sections:
        until one is not above zero, until the minimum cannot reach zero according to second differences, or until half
        the digits of its speed are known, as no more are determined."""
        shares = np.array([1 - GOLDEN, GOLDEN])
        # Four speeds each, their lateness and half periods.
        points = np.full((len(which), 3, 4), np.nan)
        points[:, 0, ::3], points[:, 1, ::3] = ends, late
        points[:, 0, 1:3] = ends[:, :1] + shares * (ends[:, 1:] - ends[:, :1])
        for i in (1, 2):
            points[:, 1:, i] = np.transpose(self.samples(points[:, 0, i], which))
        while True:
            a, b = points[:, 0, 0], points[:, 0, 3]
            open_ = (b - a > 1e-8 * (a + b)) & _may_come_to_zero(points[:, 0], points[:, 1])
            if not len(going := open_.nonzero()[0]):
                break
            here = points[going]
            left = here[:, 1, 1] < here[:, 1, 2]  # the minimum is next to the left one of the inner speeds
            here = np.where(left[:, None, None], here[:, :, [0, 1, 1, 2]], here[:, :, [1, 2, 2, 3]])
            ends = here[:, 0, 3] - here[:, 0, 0]
            new = np.where(left, here[:, 0, 3] - GOLDEN * ends, here[:, 0, 0] + GOLDEN * ends)
            added = np.array([new, *self.samples(new, which[going])]).T
            here[left, :, 1], here[~left, :, 2] = added[left], added[~left]
            points[going] = here
        lower = np.where(points[:, 1, 1] < points[:, 1, 2], 1, 2)
        return np.take_along_axis(points, lower[:, None, None], 2)[:, :, 0].T


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
    relative: Relative, p: Mapping[str, np.ndarray], family: int, liftoffs: np.ndarray, lost: np.ndarray,
    fastest: np.ndarray,
) -> list[NoOrbit]:  # fmt: skip
    """The errors of springs with parameters (m,) by name that have no orbit. The extension does not return from speeds
    `lost` (m,), or else the searches ended at the fastest ones (m,)."""
    errors = dict[int, FlowError]()
    if len(known := np.flatnonzero(np.isfinite(lost))):
        these = {name: values[known] for name, values in p.items()}
        flow, ps = flow_of(relative.phase, tuple(p)), vectors(these, len(known))
        starts = np.column_stack([liftoffs[known], lost[known]])
        longest = GUESS.longest_flight * relative.time(these) * (1 + lost[known])
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


def crossable_barriers(slopes: np.ndarray) -> np.ndarray:
    """Whether springs with these slopes (m, k) at `BARRIER_EXTENSIONS` have a barrier (m,) that a hop can cross.

    There the force falls and then rises again, further out on the same side. Where it only falls, a motion that crosses
    the barrier escapes.
    """
    outward = slopes.reshape(len(slopes), 2, -1)
    return np.any((outward[..., :-1] < 0) & (outward[..., 1:] > 0), axis=(1, 2))


def _next_speeds(
    speeds: np.ndarray, late: np.ndarray, taken: np.ndarray, scales: np.ndarray, barriers: np.ndarray,
    no_return: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """The next speeds (m,) of searches that have `taken` (m,) samples: just past where the last two of speeds (m, 3)
    and lateness (m, 3) point, so that they bracket the roots."""
    last, value = speeds[:, 2], late[:, 2]
    rises = last - speeds[:, 1]
    slopes = np.divide(value - late[:, 1], rises, out=np.zeros(len(last)), where=taken > 1)
    ahead = np.where(slopes < 0, 1.2 * value / np.maximum(-slopes, 0.3), value / 1.5)
    ahead = np.where(barriers, np.minimum(ahead, GUESS.longest_at_barriers * (scales + last)), ahead)
    alphas = last + np.maximum(ahead, GUESS.shortest_step * (scales + last))
    return np.where(alphas < no_return, alphas, 0.5 * (last + no_return))


def _may_come_to_zero(alphas: np.ndarray, late: np.ndarray) -> np.ndarray:
    """Whether lateness that is above zero at samples (m, 4) may vanish between them (m,), if its curvature is at most
    `bend_safety` times that of their second differences."""
    widths, least = np.diff(alphas), late.min(axis=1)
    with np.errstate(invalid="ignore"):  # some lateness may be infinite
        bends = np.abs(np.diff(np.diff(late) / widths)) / (0.5 * (widths[:, 1:] + widths[:, :-1]))
    return (least > 0) & ~(least > GUESS.bend_safety * bends.max(axis=1) * widths.max(axis=1) ** 2 / 8)
