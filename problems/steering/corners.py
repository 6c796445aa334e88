"""Steered motions of laws with corners: every stage in parts, each on one smooth piece of the law.

No Taylor step and no derivative crosses a corner. So a stage is divided where its guess passes from one piece to the
next. Each part has a free duration and ends on the breakpoint; in the result the parts of a stage are joined again.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import Any, NamedTuple, cast

import numpy as np

from orbits import Control, NoOrbit, steer
from orbits.control import RUNNING_COST, ControlledLeg, Guess, Stage, as_guess
from orbits.flow import Trajectory
from orbits.laws import Algebraic, Parameters, Scalars
from orbits.model import Affine, Phase, Pieces, weighted_sum
from orbits.numerics import PiecewisePolynomials

# The paths that keep a part on its side of the breakpoints.
ROOMS_AT_CORNERS = ("room above the corner", "room below the corner")


class PartOptions(NamedTuple):
    """How stages are divided."""

    samples: int = 1000  # of a guess, which is on one piece between them: a shorter excursion is left out
    shortest: float = 1e-3  # duration of a part, as a share of that of its stage
    orders: int = 6  # of the pieces that are tried, at most
    solves: int = 20  # of programs, at most, without bounds at the corners for all orders together, then with these


PARTS = PartOptions()


class OnOnePiece(NamedTuple):
    """A part of a motion: the number of the piece that it is on, and the times between which it is there."""

    piece: int
    begin: float
    end: float


def steer_across(
    stages: Sequence[Stage], parameters: Mapping[str, float], *, guess: Any, tolerance: float = 1e-9, **options: Any
) -> Control:
    """Find a motion as `steer` does, through stages whose laws have corners.

    A part goes by the formula of its piece, also beyond the corner, until the motion that is found passes the pieces in
    the order in which it is divided. Where no order leads to itself, parts are bounded by the corners.
    """
    orders, left = list[list[list[int]]](), PARTS.solves
    for _ in range(PARTS.orders):
        pairs = zip(stages, _guesses(stages, guess), strict=True)
        passages = [passages_of(stage.phase, parameters, each) for stage, each in pairs]
        if (order := [[each.piece for each in own] for own in passages]) in orders:
            break
        orders.append(order)
        try:
            found = _in_parts(stages, parameters, passages, guess, False, tolerance=tolerance, rounds=left, **options)
        except NoOrbit:
            break
        left -= found.rounds
        guess = _with_whole_legs(found, [len(own) for own in order])
        if _strayed(stages, parameters, order, found) <= tolerance:
            return guess
        if left <= 0:
            break
    bounded = {"tolerance": tolerance, "rounds": PARTS.solves, **options}
    found = _in_parts(stages, parameters, passages, guess, True, **bounded)
    return _with_whole_legs(found, [len(own) for own in passages])


def _in_parts(
    stages: Sequence[Stage], parameters: Mapping[str, float], passages: Sequence[Sequence[OnOnePiece]], guess: Any,
    bounded: bool, **options: Any,
) -> Control:  # fmt: skip
    """A motion in parts, divided as its guess, and whether these are bounded by the corners."""
    pairs = [*zip(stages, passages, strict=True)]
    parts = tuple(part for stage, own in pairs for part in _parts_of_stage(stage, own, parameters, bounded))
    known = guess.warm_start if isinstance(guess, Control) else None
    if known is None or known.problem.stages != parts:
        shorter = [
            _during(each, one) for each, own in zip(_guesses(stages, guess), passages, strict=True) for one in own
        ]
        legs = cast(Any, tuple(shorter))
        guess = replace(guess, legs=legs, warm_start=None) if isinstance(guess, Control) else shorter
    return steer(parts, parameters, guess=guess, **options)


def _strayed(
    stages: Sequence[Stage], parameters: Mapping[str, float], order: Sequence[Sequence[int]], found: Control
) -> float:
    """The most by which a part of a motion leaves its piece."""
    most, owners = 0.0, [(stage, number) for stage, own in zip(stages, order, strict=True) for number in own]
    for leg, (stage, number) in zip(found.legs, owners, strict=True):
        pieces, counts = cast(Pieces, stage.phase.pieces), np.array([len(leg.path.steps)])
        places = Affine(pieces.coordinate).series(leg.path.coefficients) * pieces.unit(parameters)
        places[:, 0] -= pieces.origin(parameters)
        for sign, level in zip((1.0, -1.0), pieces.table(parameters)[0][number : number + 2], strict=True):
            if np.isfinite(level):
                room = sign * places
                room[:, 0] -= sign * level
                most = max(most, -float(PiecewisePolynomials(room, leg.path.steps, counts).lowest()[0].min()))
    return most


def _guesses(stages: Sequence[Stage], guess: Any) -> list[Guess]:
    """The guess of each stage."""
    legs = guess.legs if isinstance(guess, Control) else guess
    return [as_guess(stage, leg) for stage, leg in zip(stages, legs, strict=True)]


def _during(guess: Guess, passage: OnOnePiece) -> Guess:
    """The part of a guess during a passage."""
    since = passage.begin

    def later(of: Any) -> Any:
        return (lambda t: of(since + t)) if callable(of) else of

    inputs = {name: later(value) for name, value in guess.inputs.items()}
    return Guess(passage.end - since, later(guess.states), inputs)


def passages_of(phase: Phase, parameters: Mapping[str, float], guess: Guess) -> list[OnOnePiece]:
    """The passages of a guess through the pieces of a phase's law."""
    from scipy.optimize import brentq  # takes long to import

    pieces = cast(Pieces, phase.pieces)
    levels = np.array(pieces.table(parameters)[0], dtype=float)[1:-1]
    times = guess.duration * (np.arange(PARTS.samples) + 0.5) / PARTS.samples
    places = pieces.place(np.array([guess.states(t) for t in times.tolist()]), parameters)
    numbers = np.searchsorted(levels, places, "right").tolist()
    on, marks = [numbers[0]], [0.0]
    for (number, after), (low, high) in zip(pairwise(numbers), pairwise(times.tolist()), strict=True):
        way = 1 if after > number else -1
        for k in range(number, after, way):
            level = levels[max(k, k + way) - 1]
            marks.append(brentq(lambda t, level=level: pieces.place(guess.states(t), parameters) - level, low, high))
            on.append(k + way)
    return [OnOnePiece(k, *ends) for k, ends in zip(on, pairwise([*marks, guess.duration]), strict=True)]


def _parts_of_stage(
    stage: Stage, passages: Sequence[OnOnePiece], parameters: Mapping[str, float], bounded: bool
) -> tuple[Stage, ...]:
    """The parts of a stage, which share its intervals by their durations, and whether the corners bound them."""
    whole, levels = passages[-1].end, cast(Pieces, stage.phase.pieces).table(parameters)[0]
    counts = [max(1, round(stage.intervals * (each.end - each.begin) / whole)) for each in passages]
    sides = [tuple((bounded & np.isfinite(levels[each.piece : each.piece + 2])).tolist()) for each in passages]
    return _stages_on_pieces(stage, tuple(each.piece for each in passages), tuple(counts), tuple(sides))


@lru_cache(maxsize=64)
def _stages_on_pieces(
    stage: Stage, numbers: tuple[int, ...], counts: tuple[int, ...], bounded: tuple[tuple[bool, bool], ...]
) -> tuple[Stage, ...]:
    """The parts of a stage on pieces with these numbers, bounded below and above, in these numbers of intervals."""
    phase, last, (shortest, longest) = stage.phase, len(numbers) - 1, stage.duration
    pieces = cast(Pieces, phase.pieces)

    def beyond(x: Scalars, p: Parameters, level: int) -> Algebraic:
        place = weighted_sum(pieces.coordinate, x) * pieces.unit(p) - pieces.origin(p)
        return place - pieces.table(p)[0][level]

    def part(i: int) -> Stage:
        number = numbers[i]

        def on_piece(of: Callable) -> Callable:
            return lambda x, p, q: of(x, p, list(pieces.table(p)[1][number]))

        above, below = lambda x, p, q: beyond(x, p, number), lambda x, p, q: -beyond(x, p, number + 1)
        sides = {
            name: of for name, of, is_end in zip(ROOMS_AT_CORNERS, (above, below), bounded[i], strict=True) if is_end
        }
        path, watch = ({name: on_piece(of) for name, of in each.items()} for each in (stage.path, phase.watch))
        own: dict[str, Any] = {"path": {**path, **sides}, "running": on_piece(stage.running), "intervals": counts[i]}
        own["phase"] = replace(phase, field=on_piece(phase.field), watch=watch, pieces=None)
        if i > 0:
            own["start"] = lambda x, before, p: [one - other for one, other in zip(x, before, strict=True)]
        if i < last:
            own |= {"final": lambda x, p: 0.0, "above": lambda x, p: []}
            own["end"] = lambda x, p: [beyond(x, p, max(number, numbers[i + 1]))]
        return replace(stage, duration=(PARTS.shortest * shortest, longest), **own)

    return tuple(map(part, range(len(numbers))))


def _with_whole_legs(control: Control, counts: Sequence[int]) -> Control:
    """The motion with the parts of each stage, which are these numbers of legs, as one leg."""
    ends = [0, *accumulate(counts)]
    return replace(control, legs=tuple(_as_one(control.legs[a:b]) for a, b in pairwise(ends)))


def _as_one(legs: Sequence[ControlledLeg]) -> ControlledLeg:
    """Legs that follow each other as one, without the rows that keep each on its side of the corner."""
    first, starts = legs[0], np.cumsum([0.0, *(leg.duration for leg in legs)])
    if len(legs) == 1:
        return first
    names = tuple(name for name in first.path.names if name not in ROOMS_AT_CORNERS)
    blocks, spent = [], 0.0
    for leg in legs:
        rows = leg.path.coefficients[:, [leg.path.names.index(name) for name in names]]
        rows[:, names.index(RUNNING_COST), 0] += spent
        spent += leg.path.end[leg.path.names.index(RUNNING_COST)]
        blocks.append(rows)
    inputs = [leg.inputs.coefficients for leg in legs]
    paths, driven = (
        Trajectory(np.append(np.concatenate([at + each.times[:-1] for at, each in parts]), starts[-1]), rows, own)
        for parts, rows, own in (
            ([*zip(starts, [leg.path for leg in legs], strict=False)], np.concatenate(blocks), names),
            ([*zip(starts, [leg.inputs for leg in legs], strict=False)], np.concatenate(inputs), first.inputs.names),
        )
    )
    return replace(first, path=paths, inputs=driven)
