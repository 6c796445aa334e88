"""The way along a curve of orbits, piece after piece, with its folds: each piece is proved to begin where the one
before ends, and to lead onward."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from fractions import Fraction
from functools import partial

import numpy as np
from flint import arb, ctx

from ..balls import FIRST_BITS, ball_of_fraction, narrowed
from ..errors import OrbitsError
from ..exact import TooLong, Unproved
from ..numerics import TINY
from .branch_claim import BranchClaim
from .branch_piece import BRANCHES, CurveEquations, CurvePiece, floats_about, inside, prove_piece, signs_along
from .proved_fold import proved_fold


@dataclass(frozen=True)
class Fold:
    """A proved fold: enclosures by name of the coordinates there, and whether the parameter is largest there."""

    balls: dict[str, arb]
    largest: bool


@dataclass(frozen=True)
class Link:
    """A piece of the curve, with the places between which it is followed, and the folds there in order."""

    piece: CurvePiece
    begin: arb
    end: arb
    folds: tuple[Fold, ...] = ()


class Way:
    """The way along a curve, piece after piece.

    ends : the coordinates at both ends, enclosed, in the units of the equations
    digits : number of digits of the folds
    """

    def __init__(
        self, equations: CurveEquations, claim: BranchClaim, ends: Sequence[list[arb]], digits: int | None = None
    ):
        self.equations, self.claim, self.ends, self.digits = equations, claim, ends, digits
        order = [list(claim.names).index(name) for name in equations.names]
        self._order = order
        self.points = [np.array(row) for row in claim.points[:, order]]
        self._tangents = [np.array(row) for row in claim.tangents[:, order]]
        spans = np.ptp(claim.points[:, order], axis=0)  # of the speed 0, where it does not depend on the parameter
        self._shares = 1.0 / np.maximum(spans[[equations.parameter, equations.speed]], TINY)
        self._inserted = 0

    def solve(self, coordinate: int, values: np.ndarray, guesses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The numerical curve; see `Solver`."""
        reordered = np.empty_like(guesses)
        reordered[:, self._order] = guesses
        rows, halves = self.claim.solve(self._order[coordinate], values, reordered)
        return rows[:, self._order], halves

    def _guess(self, coordinate: int, at: int, to: int, values: np.ndarray) -> np.ndarray:
        """Guesses between two points, and a little beyond, by linear interpolation."""
        chain = np.array(self.points[at : to + 1])
        chain = chain if chain[0, coordinate] < chain[-1, coordinate] else chain[::-1]
        places = np.clip(np.searchsorted(chain[:, coordinate], values), 1, len(chain) - 1)
        low, high = chain[places - 1], chain[places]
        shares = (values - low[:, coordinate]) / (high - low)[:, coordinate]
        return low + shares[:, None] * (high - low)

    def followed(self) -> list[Link]:
        """The pieces from the first end to the last; raises `Unproved` where there is a gap between two."""
        links, at, reach = list[Link](), 0, BRANCHES.first_reach
        while at < len(self.points) - 1:
            to = min(at + reach, len(self.points) - 1)
            try:
                links.append(self._link(links[-1] if links else None, at, to))
            except TooLong:
                raise
            except (Unproved, OrbitsError) as error:
                if to == at + 1:
                    self._insert(at, error)
                reach = max((to - at) // 2, 1)
                continue
            reach, at = BRANCHES.longer * (to - at), to
        return links

    def _insert(self, at: int, error: Exception) -> None:
        """Insert a point of the numerical curve half way to the next one; raises `Unproved`."""
        here, there = self.points[at], self.points[at + 1]
        coordinate = self._coordinate(at, at + 1)
        self._inserted += 1
        place = f"{self.equations.along} = {here[-1]:.9g} and {there[-1]:.9g}"
        message = f"the points of the family at {place} are not proved to be on one curve: {error}"
        if coordinate is None:
            raise Unproved(message)
        middle = (here[coordinate] + there[coordinate]) / 2
        closest = BRANCHES.closest * abs(here[coordinate])
        if self._inserted > BRANCHES.inserted or abs(there - here)[coordinate] < closest:
            raise Unproved(message)
        try:
            rows, _ = self.solve(coordinate, np.array([middle]), (here + there)[None] / 2)
        except OrbitsError as failure:
            raise Unproved(f"between {place} there is no curve to follow: {failure}") from None
        self.points.insert(at + 1, rows[0])
        self._tangents.insert(at + 1, (self._tangents[at] + self._tangents[at + 1]) / 2)

    def _coordinate(self, at: int, to: int, before: Link | None = None) -> int | None:
        """The coordinate along which to follow the curve between two points; None where neither is monotone there."""
        parameter, speed = self.equations.parameter, self.equations.speed
        columns, moves = np.array(self.points[at : to + 1]), np.abs(self._tangents[at : to + 1])
        ratio = moves[:, parameter] * self._shares[0] / np.maximum(moves[:, speed] * self._shares[1], TINY)
        stays = before is not None and before.piece.coordinate == parameter
        share = BRANCHES.share_to_stay if stays else BRANCHES.share_of_parameter
        order = (parameter, speed) if (ratio >= share).all() else (speed, parameter)
        for coordinate in order:
            steps = np.diff(columns[:, coordinate])
            if (steps > 0).all() or (steps < 0).all():
                return coordinate
        return None

    def _link(self, before: Link | None, at: int, to: int) -> Link:
        """The piece from a point to another one, joined to the one before; raises `Unproved`."""
        equations, finish = self.equations, to == len(self.points) - 1
        coordinate = self._coordinate(at, to, before)
        if coordinate is None:
            raise Unproved("neither the parameter nor the launch speed is monotone")
        start, stop = (Fraction(Decimal(repr(float(self.points[i][coordinate])))) for i in (at, to))
        margin, exact = (stop - start) * Fraction(BRANCHES.margin_at_joints), coordinate == equations.parameter
        joined = False
        if before is not None and before.piece.coordinate == coordinate:
            joined, start = True, before.piece.stop
        elif before is not None or not exact:
            start -= margin
        if finish and not exact:
            stop += margin
        guess = partial(self._guess, coordinate, at, to)
        piece = prove_piece(equations, self.solve, guess, coordinate, start, stop)
        if not all(sign for _, _, sign in signs_along(piece, -1.0, 1.0)):
            # The direction of the curve is enclosed better on a narrower tube.
            piece = replace(piece, tube=narrowed(equations.legs, piece.tube))
        at_begin = arb(-1) if joined or (before is None and exact) else None
        joint = self.ends[0] if before is None else before.piece.at(before.end)
        begin = piece.holds(joint, at_begin)
        end = piece.holds(self.ends[1], arb(1) if exact else None) if finish else arb(1)
        if begin is None or end is None or not begin < end:
            raise Unproved("the end of a piece is not proved to be the beginning of the next one")
        self._check_onward(before, piece, begin)
        self._check_points(piece, at, to)
        folds = () if exact else self._folds(piece, begin, end)
        return Link(piece, begin, end, folds)

    @staticmethod
    def _check_onward(before: Link | None, piece: CurvePiece, begin: arb) -> None:
        """Prove that a piece does not lead back along the one before; raises `Unproved`."""
        if before is None:
            return
        if before.piece.coordinate == piece.coordinate:
            onward = before.piece.direction == piece.direction
        else:
            onward = before.piece.turning(before.end) * piece.turning(begin) == 1
        if not onward:
            raise Unproved("a piece is not proved to lead onward from the one before")

    def _check_points(self, piece: CurvePiece, at: int, to: int) -> None:
        """Check that the points of the family between two of them lie in the tube of the piece; raises `Unproved`."""
        for row in self.points[at : to + 1]:
            values = [arb(float(each)) / ball_of_fraction(unit)
                      for each, unit in zip(row, self.equations.units, strict=True)]  # fmt: skip
            place = piece.place(values[piece.coordinate]).mid().max(arb(-1)).min(arb(1))
            if not piece.tube.holds(values, place):
                raise Unproved(f"the point at {self.equations.along} = {row[-1]:.9g} is not on the curve")

    def _folds(self, piece: CurvePiece, begin: arb, end: arb) -> tuple[Fold, ...]:
        """The folds between two places of a piece along the launch speed; raises `Unproved` where not all zeros of the
        parameter's derivative there are proved to be folds."""
        runs, found = signs_along(piece, *floats_about(begin, end)), list[Fold]()
        if len(runs) == 1 and runs[0][2]:
            return ()
        for i, (first, last, sign) in enumerate(runs):
            if sign == 0:
                if i in (0, len(runs) - 1) or runs[i - 1][2] == runs[i + 1][2]:
                    raise Unproved(
                        "a piece ends where the parameter may turn, or the parameter is stationary without turning"
                    )
                fold = self._fold(piece, first, last)
                place = piece.holds(self.equations.balls(fold.balls))
                if place is None or not (begin < place < end):
                    raise Unproved("the fold is not proved to be on the curve, or a piece ends at it")
                found.append(fold)
        return tuple(found)

    def _fold(self, piece: CurvePiece, first: float, last: float) -> Fold:
        """The only fold on a part of a piece; outside this part the parameter does not turn."""
        equations, middle = self.equations, (first + last) / 2
        reach = max(BRANCHES.about_fold, BRANCHES.about_undecided * (last - first))
        half = float(piece.stop - piece.start) / 2
        centre = float(piece.start + piece.stop) / 2 + half * middle
        start, stop = (Fraction(Decimal(repr(centre + side * reach * half))) for side in (-1, 1))
        whole, piece = piece, prove_piece(equations, self.solve, piece.numerical, piece.coordinate, start, stop)
        if not inside(piece, whole):
            raise Unproved("the curve about a fold is not proved to be in its piece")
        # The direction of the curve is enclosed better on a narrower tube.
        piece = replace(piece, tube=narrowed(equations.legs, piece.tube))
        low, high = (float(piece.place(whole.value(each)).mid()) for each in (first, last))
        if not -1 < low - BRANCHES.margin_of_undecided <= high + BRANCHES.margin_of_undecided < 1:
            raise Unproved("the parameter turns too near to the end of a piece")
        runs = signs_along(piece, low - BRANCHES.margin_of_undecided, high + BRANCHES.margin_of_undecided)
        if len(runs) != 3 or runs[0][2] * runs[2][2] != -1:
            raise Unproved("the parameter is not proved to turn once at a fold")
        s, largest = arb(runs[1][0]).union(arb(runs[1][1])), runs[0][2] > 0
        balls = equations.in_machine(piece.at(s))
        by_place = equations.in_machine([piece.tube.slope_at(i, s) for i in range(len(equations.names))])
        directions = {name: each / by_place["alpha"] for name, each in by_place.items() if name != equations.along}
        guess, towards = ({name: float(each.mid()) for name, each in some.items()} for some in (balls, directions))
        value = guess.pop(equations.along)
        seen = balls | {f"d{name}": each for name, each in directions.items() if name != "alpha"}
        with ctx.workprec(FIRST_BITS):
            near = {name: BRANCHES.room_at_fold * each.rad() for name, each in seen.items()}
            fold = proved_fold(equations.stated, guess, towards, equations.along, value, self.digits, near)
        alone = fold.alone_in()
        if not all(box.contains(seen[name]) for name, box in alone.items()):
            raise Unproved("there may be several folds near one another")
        return Fold({name: fold.balls[name] for name in equations.names}, largest)
