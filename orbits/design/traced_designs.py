"""Curves of best designs, traced in smooth pieces: where a corner or a demand becomes active, another one begins."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np

from ..errors import NoOrbit, OrbitsError
from ..model.machine import Machine
from ..numerics.kkt_curve import ENDS_OF_MINIMA, CurveEnd, CurveEvent, CurveOptions, MinimumCurve
from ..numerics.kkt_limits import CriticalPoint
from ..periodic.orbit import Orbit
from ..result import Progress
from ..running import interrupts
from .active_set import AT_TWO_PLACES, constraint_sizes, demands_of
from .design_point import Case, DesignPoint, design_points, no_motion
from .extreme_corners import SAME_EXTREME, Corner
from .moving_design import MovingDesign
from .moving_number import Moving
from .problem import DesignProblem, Outputs

# Steps of a curve are long, since each evaluation of a design is costly and its predictions are good.
OF_DESIGNS = CurveOptions(first_step=0.1, longest_step=1.0, exact=True)
# A curve ends where its multipliers have grown by this factor, and become infinite within this share of the way.
GROWN, NEAR_POLE = 10.0, 1e-3
ONE_POINT = 1e-12  # points whose shares of the way differ by no more are one
ROUNDS_TOGETHER = 4  # rounds in which designs are evaluated together
# Programs that one curve may lead through, with other demands and corners. A corner is left where the values at its two
# places differ by this share, and may become active from where they differ by the next one.
MOST_PROGRAMS, LEFT_CORNER, BESIDE_CORNER = 50, 1e-3, 1e-5


@dataclass(frozen=True)
class DesignEvent:
    """What happens on a curve of designs: a constraint, bound or condition of a motion "enters" or "leaves" the active
    ones at a value of the number that moves; or the curve has a "fold" or a "bifurcation"."""

    value: float
    kind: str
    text: str = ""


class _Piece(NamedTuple):
    """A smooth piece of a curve: its program, the curve, its points, and the shares of the way in it."""

    program: MovingDesign
    curve: MinimumCurve
    points: list[CriticalPoint]

    def exact(self, shares: Sequence[float]) -> list[CriticalPoint]:
        """The points at shares within the piece: Newton's method begins at interpolated ones, and the designs that it
        needs for all of them are evaluated together."""
        values, last = [each.value for each in self.points], len(self.points) - 1
        near = list[CriticalPoint]()
        for share in shares:
            after = min(max(int(np.searchsorted(values, share)), 1), last)
            near.append(self.curve.between(self.points[max(after - 2, 0) : after + 2], share))
        wanted, found = [np.append(each.x, each.value) for each in near], dict[int, CriticalPoint]()
        for _ in range(ROUNDS_TOGETHER):
            self.program.evaluate(wanted)
            wanted = self.program.missed = []
            for i, each in enumerate(near):
                with suppress(NoOrbit):
                    found[i] = found.get(i) or self.curve.at(each.value, each)
            if not wanted:
                break
        self.program.missed = None
        return [found.get(i) or self.curve.at(each.value, each) for i, each in enumerate(near)]


class TracedDesigns(NamedTuple):
    """The points of a curve of designs in ascending order, each with its program; the events; and why the curve ends
    before the last share of the way, "" where it does not."""

    points: list[tuple[MovingDesign, CriticalPoint]]
    events: list[DesignEvent]
    end: str


def program_about(
    machine: Machine,
    orbit: Orbit,
    problem: DesignProblem,
    moving: Moving,
    active: Sequence[str],
    idle: Sequence[str],
) -> MovingDesign:
    """The program of a problem, a number of which moves, about the optimum at a machine's dimensionless orbit.

    active : texts of the constraints, bounds and conditions of a motion that are active there
    idle : names of the parameters without effect
    """
    formulas = problem.formula, *(constraint.formula for constraint in problem.constraints)
    known = [text.removesuffix(" > 0") for text in active if text.endswith(" > 0")]
    demands = demands_of(machine, orbit, [name for name in known if name != "-landing_jerk"])
    (point,) = design_points([Case(machine, orbit, Outputs(formulas, problem.names, demands), {})])
    if isinstance(point, OrbitsError):
        raise point
    flat = np.isin(problem.names, idle)
    program = MovingDesign(problem, moving, point, flat, constraint_sizes(problem, point), demands)
    for _ in range([*active].count(AT_TWO_PLACES)):
        (near,) = program.known
        if corner := program.corners.beside(near.design, share=SAME_EXTREME):
            program = program.with_more(near, corners=(*program.corners.known, corner))
    return program


def traced_designs(program: MovingDesign, shares: Sequence[float], progress: Progress = None) -> TracedDesigns:
    """The curve of a program at shares of the way of its number, in ascending order, and at the events between them.

    It is traced in steps of its own; the designs at the shares lie between its points.
    """
    pieces, events, ends, end = _traced(program, progress)
    points = list[tuple[MovingDesign, CriticalPoint]]()
    for piece in pieces:
        first, last = piece.points[0].value, piece.points[-1].value
        inside = [share for share in shares if first <= share <= last and not any(share == p.value for _, p in points)]
        points += [(piece.program, point) for point in piece.exact(inside)]
    known = [point.value for _, point in points]
    points += [pair for pair in ends if all(abs(pair[1].value - share) > ONE_POINT for share in known)]
    return TracedDesigns(sorted(points, key=lambda pair: pair[1].value), events, end)


def _traced(
    program: MovingDesign, progress: Progress
) -> tuple[list[_Piece], list[DesignEvent], list[tuple[MovingDesign, CriticalPoint]], str]:
    """The smooth pieces of the curve of a program; its events; their points, and the last one where the curve ends
    early; and why it does, "" where it does not."""
    run, x, multipliers, start = _RunAlongDesigns(progress), np.zeros(len(program.free)), program.start(), 0.0
    for _ in range(MOST_PROGRAMS):
        onward = run.along(program, x, multipliers, start)
        if onward is None:
            break
        program, point, multipliers = onward
        x, start = point.x, point.value
    last = next(((piece.program, piece.points[-1]) for piece in reversed(run.pieces) if piece.points), None)
    ends = [*run.ends, last] if run.end and last else run.ends
    return [piece for piece in run.pieces if piece.points], run.events, ends, run.end


# A program from a point on, with the multipliers there.
_Onward: TypeAlias = tuple[MovingDesign, CriticalPoint, np.ndarray]


class _RunAlongDesigns:
    """A run along a curve of designs: its pieces, its events with their points, and why it ends early."""

    def __init__(self, progress: Progress):
        self.progress, self.end, self._good = progress, "", (0, 0, 0, 0)
        self.pieces, self.events = list[_Piece](), list[DesignEvent]()
        self.ends = list[tuple[MovingDesign, CriticalPoint]]()

    def along(self, program: MovingDesign, x: np.ndarray, multipliers: np.ndarray, start: float) -> _Onward | None:
        """Follow a program from a point; None at the end, or the program that is to be followed from there."""
        try:
            curve = MinimumCurve(program, x, multipliers, start, 1.0, OF_DESIGNS)
        except NoOrbit:
            if not self.pieces:
                raise
            return None  # for the reason for which the program before this one was left
        self.end, touched = "", False
        self.pieces.append(_Piece(program, curve, []))
        for each in curve.run():
            interrupts.heed()
            passed = self.pieces[-1].points
            if isinstance(each, CurveEnd):
                self.end = "" if each.kind == "reached" else program.in_words(each, passed[-1])
                if not self.end:
                    return None
                last = program.nearest(passed[-1].x, passed[-1].value).design
                return self._at_corner(program, partial(program.corners.beside, last))
            if isinstance(each, CurveEvent):
                self._happens(curve, each)
                continue
            onward = self._left(program, each)
            if onward or self.end:
                return onward
            passed.append(each)
            self._good = len(self.pieces), len(passed), len(self.events), len(self.ends)
            if (left := _left_to_pole(passed)) < NEAR_POLE:
                self.end = program.excluded(each.value + left)
                return None
            if self.progress:
                self.progress(each.value)
            touched |= bool(program.active_corners(each))
            rows, near = program.rows_of_corners, program.nearest(each.x, each.value)
            if touched and (near.values[1:][rows] < -LEFT_CORNER).all():
                own = len(x) + np.arange(rows.start, rows.stop)
                return program.with_more(near, corners=()), each, np.delete(each.multipliers, own)
        return None

    def _happens(self, curve: MinimumCurve, event: CurveEvent) -> None:
        """Add an event, in place of the last point, which is that of the event."""
        program, passed, point = self.pieces[-1].program, self.pieces[-1].points, event.point
        text = " and ".join(program.text(i, point) for i in event.limits)
        self.events.append(DesignEvent(program.value(point.value), event.kind, text))
        passed.pop()
        if event.kind in ENDS_OF_MINIMA:
            return
        if passed:  # the same point, with the direction of the curve before the event
            value, x, multipliers = point.value, point.x, point.multipliers
            passed.append(curve.at(value, replace(passed[-1], value=value, x=x, multipliers=multipliers)))
        self.ends.append((program, point))
        self.pieces.append(_Piece(program, curve, [point]))

    def _left(self, program: MovingDesign, point: CriticalPoint) -> _Onward | None:
        """The program that is to be followed from the last point, where this one is of another; the `end` is why."""
        near, passed = program.nearest(point.x, point.value), self.pieces[-1].points
        if not near.design.orbit.admissible:
            demands = program.outputs.demands
            further = demands_of(near.design.machine, near.design.orbit, demands)[len(demands) :]
            if further or not demands:  # at an active demand rounding decides, which the certified design shows
                self.end = str(no_motion(near.design.machine, near.design.orbit))
                last = next((piece.points[-1] for piece in reversed(self.pieces) if piece.points), None)
                if not further or last is None:
                    return None
                place = len(program.free) + program.rows_of_corners.start
                multipliers = np.insert(last.multipliers, place, np.zeros(len(further)))
                return program.with_more(program.nearest(last.x, last.value), further), last, multipliers
        weighty = program.weighty_extremes(point)
        onward = self._at_corner(program, lambda before: program.corners.between(before, near.design, weighty))
        if onward:
            return onward
        if beyond := program.corners.beyond(near.design):
            where = f"{program.moving.label} {program.value(point.value):.6g}"
            self.end = f"near {where} the {beyond} comes to a third place of the motion, or leaves one of two"
            return None
        for number in program.active_corners(point):
            row = len(program.free) + program.rows_of_corners.start + number
            if program.swapped_at(point, number)[1][row] < 0:
                self.end = program.off_corner(point, number)
                if passed and passed[-1].sides[row]:
                    other, multipliers = program.swapped_at(passed[-1], number)
                    return other, passed[-1], multipliers
                passed.append(point)
                return None
        return None

    def _at_corner(self, program: MovingDesign, corner_after: Callable[[DesignPoint], Corner | None]) -> _Onward | None:
        """The program with a further corner, from the last point before it, where there is one right after that."""
        pieces, points, events, ends = self._good
        if not pieces:
            return None
        own, row = self.pieces[pieces - 1], program.rows_of_corners.stop
        before = program.nearest(own.points[points - 1].x, own.points[points - 1].value)
        corner = corner_after(before.design)
        if corner is None:
            return None
        self.pieces[pieces - 1 :] = [own._replace(points=own.points[:points])]
        del self.events[events:], self.ends[ends:]
        for point in reversed(own.points[:points]):  # not so near to the corner that rounding decides where it enters
            near = program.nearest(point.x, point.value)
            other = program.with_more(near, corners=(*program.corners.at(near.design), corner))
            if other.known[0].values[1 + row] < -BESIDE_CORNER:
                break
            if len(self.pieces[-1].points) > 1:
                self.pieces[-1].points.pop()
        self._good = pieces, len(self.pieces[-1].points), events, ends
        return other, point, np.insert(point.multipliers, len(program.free) + row, 0.0)


def _left_to_pole(passed: list[CriticalPoint]) -> float:
    """The share of the way from the last point of a curve to where its multipliers become infinite, as the inverse of
    the root of the distance: there the active constraints exclude each other."""
    last, largest = passed[-1], np.abs(passed[0].multipliers).max(initial=0.0)
    i = int(np.argmax(np.abs(last.multipliers)))
    multiplier, rate = last.multipliers[i], last.rates[1][i]
    grown = abs(multiplier) > GROWN * max(largest, 1.0) and multiplier * rate > 0
    return float(0.5 * multiplier / rate) if grown else np.inf
