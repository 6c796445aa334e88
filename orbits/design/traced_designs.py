"""Curves of best designs, traced in smooth pieces: where a corner or a demand becomes active, another piece begins."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np

from ..curves import ENDS_OF_MINIMA, STEPS_OF_MINIMA, CriticalPoint, End, Event, KktOptions, MinimumCurve, Steps
from ..errors import NoOrbit, OrbitsError
from ..model import Machine
from ..periodic import Orbit
from ..result import Progress
from ..running import interrupts
from .design_point import Case, DesignPoint, design_points, no_motion
from .design_problem import DesignProblem, Outputs
from .extreme_corners import SAME_EXTREME, Corner
from .moving_design import MovingDesign
from .moving_number import Moving
from .optimality import AT_TWO_PLACES, constraint_sizes, demands_of


@dataclass(frozen=True, kw_only=True)
class Tracing:
    """Curves of designs in smooth pieces; `steps` and `points` are those of `MinimumCurve`."""

    # Steps are long, since each evaluation of a design is costly and its predictions are good.
    steps: Steps = field(default=replace(STEPS_OF_MINIMA, first=0.1, longest=1.0))
    points: KktOptions = field(default=KktOptions(exact=True))
    # A curve ends if its multipliers have grown by this factor and become infinite within this share of the way.
    grown: float = 10.0
    near_pole: float = 1e-3
    same: float = 1e-12  # points whose shares of the way differ by no more are one
    together: int = 4  # rounds in which designs are evaluated together
    most: int = 50  # programs that one curve may lead through, with other demands and corners
    left_corner: float = 1e-3  # share by which the values at the two places of a corner differ where it is left
    beside_corner: float = 1e-5  # and that from where on it may become active


TRACING = Tracing()


DesignEvent = Event  # the name that pickled curves have for the class of their events


class _Piece(NamedTuple):
    """A smooth piece of a curve: its program, the curve, its points, and the shares of the way in it."""

    program: MovingDesign
    curve: MinimumCurve
    points: list[CriticalPoint]

    def exact(self, shares: Sequence[float], rounds: int) -> list[CriticalPoint]:
        """The points at shares within the piece: Newton's method begins at interpolated ones, and the designs that it
        needs for all of them are evaluated together, in a number of rounds."""
        values, last = [each.value for each in self.points], len(self.points) - 1
        near = list[CriticalPoint]()
        for share in shares:
            after = min(max(int(np.searchsorted(values, share)), 1), last)
            near.append(self.curve.between(self.points[max(after - 2, 0) : after + 2], share))
        wanted, found = [np.append(each.x, each.value) for each in near], dict[int, CriticalPoint]()
        for _ in range(rounds):
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
    """The points of a curve of designs in ascending order, each with its program; the events; and the end: "reached" at
    the last share of the way, else with the reason in words."""

    points: list[tuple[MovingDesign, CriticalPoint]]
    events: list[Event]
    end: End


def program_about(
    machine: Machine,
    orbit: Orbit,
    problem: DesignProblem,
    moving: Moving,
    active: Sequence[str],
    idle: Sequence[str],
) -> MovingDesign:
    """The program of a problem with one moving number, about the optimum at a machine's dimensionless orbit.

    active : texts of the constraints, bounds and conditions of a motion that are active there
    idle : names of the parameters without effect
    """
    known = [text.removesuffix(" > 0") for text in active if text.endswith(" > 0")]
    demands = demands_of(machine, orbit, [name for name in known if name != "-landing_jerk"])
    whole, *_ = moving.as_bound(problem)
    (point,) = design_points([Case(machine, orbit, Outputs(whole.formulas, whole.names, demands), {})])
    if isinstance(point, OrbitsError):
        raise point
    flat = np.isin(problem.names, idle)
    program = MovingDesign(problem, moving, point, flat, constraint_sizes(whole, point), demands)
    for _ in range([*active].count(AT_TWO_PLACES)):
        (near,) = program.known
        if corner := program.corners.beside(near.design, share=SAME_EXTREME):
            program = program.with_more(near, corners=(*program.corners.known, corner))
    return program


def traced_designs(
    program: MovingDesign, shares: Sequence[float], progress: Progress = None, options: Tracing = TRACING
) -> TracedDesigns:
    """The curve of a program at shares of the way of its number, in ascending order, and at the events between them.

    It is traced in steps of its own; the designs at the shares lie between its points.
    """
    run = _RunAlongDesigns(progress, options)
    run.trace(program)
    points = list[tuple[MovingDesign, CriticalPoint]]()
    for piece in run.pieces:
        first, last = piece.points[0].value, piece.points[-1].value
        inside = [share for share in shares if first <= share <= last and not any(share == p.value for _, p in points)]
        points += [(piece.program, point) for point in piece.exact(inside, options.together)]
    known = [point.value for _, point in points]
    points += [pair for pair in run.ends if all(abs(pair[1].value - share) > options.same for share in known)]
    return TracedDesigns(sorted(points, key=lambda pair: pair[1].value), run.events, run.end or End("reached"))


# A program from a point on, with the multipliers there.
_Onward: TypeAlias = tuple[MovingDesign, CriticalPoint, np.ndarray]


class _RunAlongDesigns:
    """A run along a curve of designs: its pieces, its events with their points, and the end if it ends early."""

    def __init__(self, progress: Progress, options: Tracing):
        self.progress, self.options, self._good = progress, options, (0, 0, 0, 0)
        self.end: End | None = None
        self.pieces, self.events = list[_Piece](), list[Event]()
        self.ends = list[tuple[MovingDesign, CriticalPoint]]()

    def trace(self, program: MovingDesign) -> None:
        """Follow all programs to the end, whose point is among those of events if it is early."""
        x, multipliers, start = np.zeros(len(program.free)), program.start(), 0.0
        for _ in range(self.options.most):
            onward = self.along(program, x, multipliers, start)
            if onward is None:
                break
            program, point, multipliers = onward
            x, start = point.x, point.value
        self.pieces = [piece for piece in self.pieces if piece.points]
        if self.end and self.pieces:
            self.ends.append((self.pieces[-1].program, self.pieces[-1].points[-1]))

    def along(self, program: MovingDesign, x: np.ndarray, multipliers: np.ndarray, start: float) -> _Onward | None:
        """Follow a program from a point; None at the end, or the program that is to be followed from there."""
        try:
            curve = MinimumCurve(program, x, multipliers, start, 1.0, self.options.steps, self.options.points)
        except NoOrbit:
            if not self.pieces:
                raise
            return None  # for the reason for which the program before this one was left
        self.end, touched = None, False
        self.pieces.append(_Piece(program, curve, []))
        for each in curve.run():
            interrupts.heed()
            passed = self.pieces[-1].points
            if isinstance(each, End):
                if each.kind == "reached":
                    return None
                self.end = program.in_words(each, passed[-1])
                last = program.nearest(passed[-1].x, passed[-1].value).design
                return self._at_corner(program, partial(program.corners.beside, last))
            if isinstance(each, Event):
                self._happens(curve, each)
                continue
            onward = self._left(program, each)
            if onward or self.end:
                return onward
            passed.append(each)
            self._good = len(self.pieces), len(passed), len(self.events), len(self.ends)
            if (left := _left_to_pole(passed, self.options.grown)) < self.options.near_pole:
                self.end = program.excluded(each.value + left)
                return None
            if self.progress:
                self.progress(each.value)
            touched |= bool(program.active_corners(each))
            rows, near = program.rows_of_corners, program.nearest(each.x, each.value)
            if touched and (near.values[1:][rows] < -self.options.left_corner).all():
                own = len(x) + np.arange(rows.start, rows.stop)
                return program.with_more(near, corners=()), each, np.delete(each.multipliers, own)
        return None

    def _happens(self, curve: MinimumCurve, event: Event) -> None:
        """Add an event, in place of the last point, which is that of the event."""
        program, passed, point = self.pieces[-1].program, self.pieces[-1].points, event.point
        text = "" if event.kind in ENDS_OF_MINIMA else program.text(event.which, point)
        self.events.append(Event(event.kind, value=program.value(point.value), text=text))
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
                self.end = End("infeasible", str(no_motion(near.design.machine, near.design.orbit)))
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
            text = f"near {where} the {beyond} occurs at a third place of the motion, or no longer at one of two"
            self.end = End("degenerate", text)
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
            if other.known[0].values[1 + row] < -self.options.beside_corner:
                break
            if len(self.pieces[-1].points) > 1:
                self.pieces[-1].points.pop()
        self._good = pieces, len(self.pieces[-1].points), events, ends
        return other, point, np.insert(point.multipliers, len(program.free) + row, 0.0)


def _left_to_pole(passed: list[CriticalPoint], least: float) -> float:
    """The share of the way from the last point of a curve to where its multipliers become infinite, as the inverse of
    the root of the distance: there the active constraints exclude each other. It is infinite for multipliers that have
    grown by less than this factor."""
    last, largest = passed[-1], np.abs(passed[0].multipliers).max(initial=0.0)
    i = int(np.argmax(np.abs(last.multipliers)))
    multiplier, rate = last.multipliers[i], last.rates[1][i]
    grown = abs(multiplier) > least * max(largest, 1.0) and multiplier * rate > 0
    return float(0.5 * multiplier / rate) if grown else np.inf
