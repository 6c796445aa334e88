"""The word that follows where a slack of returning hops vanishes: with one impact more or less, or no word.

the force after the last impact : where the foot then presses more and more, the hop gets one impact more, whose
    flight has no duration at first; where it moves away, the map jumps. Where it lands without speed, the hop is
    lossless
the time of a flight after an impact : the hop loses that impact, the other way round
the gap in a flight : the foot grazes the ground, and the hop gets one impact more, without speed at first
the speed of a landing : the foot grazes the ground, and the hop loses that impact
anything else : the curve ends, as the map jumps or the machine comes to rest
"""

from dataclasses import replace

import numpy as np

from ..curves import End, Points, Start
from ..errors import NoOrbit
from ..hops import STATUSES
from .hop_curve import TOLERANCES, HopCurve, turned
from .hop_statement import FORCE, GAP, REST, SPEED, Slack, Word
from .hops_along import INJECT
from .periodic_launch import PeriodicLaunch

COLLISION, NON_SMOOTH_FOLD = COLLISIONS = "border collision", "non-smooth fold"


def beyond(curve: HopCurve, point: Points, slack: Slack) -> Start | End | None:
    """What follows a slack that vanishes at a point (1) of a curve, or where a flight is about to vanish."""
    impacts = curve.word[slack.hop]
    try:
        if slack.kind == FORCE and slack.impact + 1 == impacts and _stays(curve, point, slack):
            return _one_more(curve, point, slack)
        if slack.kind == FORCE and slack.impact + 1 < impacts:
            return _one_less(curve, point, slack)
        if slack.kind == GAP:
            return _touches(curve, point, slack)
        if slack.kind == SPEED and slack.impact + 1 < impacts:
            return _misses(curve, point, slack)
    except NoOrbit as error:
        return End("stuck", f"{error}")
    if slack.kind == REST:
        return End("no launch", f"a hop has no next launch from here on: {STATUSES['rests']}")
    return End("jump", "")


def changed_word(word: Word, hop: int, more: int) -> Word:
    """A word with more impacts in one hop."""
    return tuple(count + more * (i == hop) for i, count in enumerate(word))


def _stays(curve: HopCurve, point: Points, slack: Slack) -> bool:
    """Whether the foot presses more and more after an impact without a force."""
    state = curve.landing(point, slack)
    impacts = curve.hops.impacts_at(float(point.values[0]))
    return bool(impacts.gap_rates(state[None])[0, 0] < 0)


def _one_more(curve: HopCurve, point: Points, slack: Slack) -> Start:
    """The curve of the word with one impact more, where its flight begins."""
    other = curve.of(changed_word(curve.word, slack.hop, 1))
    place = other.time(slack.hop, slack.impact + 1)
    x = np.insert(point.xs[0], place, TOLERANCES.begun)
    x[place + 1] -= TOLERANCES.begun  # of the contact
    row = np.eye(1, len(x), place)[0]
    return Start.at(other, other.solved(x, row, row), _passed(curve, point, slack))


def _one_less(curve: HopCurve, point: Points, slack: Slack) -> Start | End | None:
    """The curve of the word with one impact less, where a flight has no duration any more; None where it has one."""
    place = curve.time(slack.hop, slack.impact + 1)
    time, x = float(point.xs[0, place]), point.xs[0].copy()
    if slack.impact + 2 < curve.word[slack.hop]:
        return None
    other = curve.of(changed_word(curve.word, slack.hop, -1))
    x[place + 1] += time
    x = np.delete(x, place)
    onward = np.delete(point.tangents[0], place)
    try:
        found = other.solved_at_border(x, slack, onward)
    except NoOrbit:
        return None
    if np.abs(found.xs[0] - x).max() > TOLERANCES.short_flight * time:
        return None
    return Start.at(other, found, _passed(other, found, slack))


def _touches(curve: HopCurve, point: Points, slack: Slack) -> Start:
    """The curve of the word with an impact where the foot grazes the ground in a flight."""
    other = curve.of(changed_word(curve.word, slack.hop, 1))
    place, time = curve.time(slack.hop, slack.impact), curve.lowest(point, slack)
    x = np.insert(point.xs[0], place, time)
    x[place + 1] -= time
    onward = np.eye(1, len(x), place)[0]  # at a graze the curve is tangent to the times of the flights
    found = other.solved_at_border(x, Slack(SPEED, slack.hop, slack.impact), onward)
    return Start.at(other, found, _grazes(other, found, point, is_before=True))


def _misses(curve: HopCurve, point: Points, slack: Slack) -> Start:
    """The curve of the word without an impact that only grazes the ground."""
    other = curve.of(changed_word(curve.word, slack.hop, -1))
    place = curve.time(slack.hop, slack.impact)
    x = point.xs[0].copy()
    x[place + 1] += x[place]
    x = np.delete(x, place)
    row = np.eye(1, len(x), len(x) - 1)[0]
    found = other.solved(x, row, row)
    gap = Slack(GAP, slack.hop, slack.impact)
    found = found if other.grows(found, gap) else turned(found)
    return Start.at(other, found, _grazes(curve, point, found, is_before=False))


def _passed(curve: HopCurve, point: Points, slack: Slack) -> tuple[str, Points]:
    """The event at a point (1) of the word with fewer impacts, where a force vanishes after its last one."""
    own, impacts = point.own[0], curve.hops.impacts_at(float(point.values[0]))
    speed = float(curve.landing(point, slack) @ impacts.gap_speed)
    lossless = abs(speed) <= TOLERANCES.without_speed * float(own.launches[slack.hop, curve.speed])
    multiplier, kind = own.multiplier, "lossless" if lossless else "bounce"
    passed = replace(own, border=kind, sides=(multiplier, multiplier))
    if lossless and curve.period == 1:  # it is a fixed point without an injection, exactly
        value = 0.0 if curve.along == INJECT else own.value
        return _event("fold", point, replace(passed, value=value, border="", sides=()))
    return _event(kind_of_border(passed.sides), point, passed)


def _grazes(more: HopCurve, point: Points, other: Points, is_before: bool) -> tuple[str, Points]:
    """The event at a point (1) of the word with more impacts, where one has no speed: on that side the map's slope is
    infinite. The other point (1) is there on the curve of the word with fewer impacts, which comes before or behind."""
    onward = 1.0 if is_before else -1.0
    _, beside = more.evaluate(np.zeros(1, int), point.xs + onward * TOLERANCES.beside * point.tangents)
    steep = np.nan if beside is None else float(more.matrices(beside, np.zeros(1, int))[0, 0, 0])
    infinite = float(np.copysign(np.inf, steep)) if more.d == 1 else np.nan
    sides = infinite, other.own[0].multiplier
    sides = sides[::-1] if is_before else sides
    turns = point.tangents[0, -1] * other.tangents[0, -1] < 0
    passed = replace(point.own[0], multiplier=np.nan, border="graze", sides=sides)
    return _event(NON_SMOOTH_FOLD if turns else COLLISION, point, passed)


def _event(kind: str, point: Points, launch: PeriodicLaunch) -> tuple[str, Points]:
    own = np.empty(1, object)
    own[0] = launch
    return kind, point.having(own=own)


def kind_of_border(sides: tuple[float, ...]) -> str:
    """The kind of a collision with a border by the multipliers on both sides: the launches continue in the parameter,
    or turn round where one multiplier is above 1 and one below."""
    return COLLISION if (sides[0] - 1) * (sides[1] - 1) > 0 else NON_SMOOTH_FOLD
