"""Signs of functions along an enclosed motion, for all motions of the set together."""

from collections.abc import Sequence
from dataclasses import dataclass

from flint import arb, ctx

from ..errors import OrbitsError
from ..exact import Undecided, Unproved
from ..symbolic import ExactExpression, along
from .enclosure import Passage, Piece
from .equations import BallLeg
from .programs import BallProgram, EachLaw
from .rigorous_step import between
from .root import FIRST_BITS

# Halvings of a step's time after which a sign is left undecided, in the precision of the first proof.
MOST_BISECTIONS = 14
# Times of a step at which an undecided sign is checked again.
SAMPLES_OF_STEP = 8


class Refuted(OrbitsError):
    """A condition is proved to be violated; the message states where."""


@dataclass(frozen=True)
class Derivatives:
    """A function of the states of a leg and its derivatives by the time of the leg, which lasts from 0 to 1.

    programs : for each law of the leg, those of the function and of its derivatives in ascending order
    """

    programs: EachLaw[tuple[BallProgram, ...]]


@dataclass(frozen=True)
class Motion:
    """An enclosed motion, with the leg that it travels."""

    leg: BallLeg
    passage: Passage

    def chain(self, functions: Sequence[ExactExpression], orders: int) -> Derivatives:
        """A function of the states, one expression for each law, with `orders` derivatives along the motion."""
        state = self.leg.state

        def programs(law: int) -> tuple[BallProgram, ...]:
            each = [functions[law]]
            for _ in range(orders):
                each.append(along(each[-1], state, self.leg.rates[law]))
            return tuple(BallProgram(state, [one]) for one in each)

        return Derivatives(EachLaw(programs))

    def value(self, each: Derivatives, order: int, piece: Piece, t: arb) -> arb:
        """An enclosure of a derivative at a time, or at all times of a ball, within a piece; across a breakpoint of the
        law it holds the derivatives on both sides."""
        return self._on(each, order, piece.laws, piece.step.at(t))

    def first(self, each: Derivatives, order: int) -> arb:
        """An enclosure of a derivative at the start."""
        return self._on(each, order, self.passage.pieces[0].laws, self.passage.start)

    def last(self, each: Derivatives, order: int) -> arb:
        """An enclosure of a derivative at the end."""
        return self._on(each, order, self.passage.pieces[-1].laws[-1:], self.passage.finish)

    @staticmethod
    def _on(each: Derivatives, order: int, laws: Sequence[int], states: Sequence[arb]) -> arb:
        (found,) = each.programs[laws[0]][order](states)
        for law in laws[1:]:
            (other,) = each.programs[law][order](states)
            found = found.union(other)
        return found

    def check_positive(self, each: Derivatives, zero_at_start: int = 0, zero_at_end: int = 0) -> None:
        """Prove that a function is positive inside the motion.

        zero_at_start, zero_at_end : the orders of the zeros that the function is known to have there

        Raises `Refuted` where it is not positive, and `Unproved` where that stays undecided.
        """
        try:
            self._check_pieces(each, zero_at_start, zero_at_end)
        except Unproved:
            for piece in self.passage.pieces:  # the times after an undecided one may refute it
                for i in range(SAMPLES_OF_STEP):
                    if self.value(each, 0, piece, piece.step.h * (i + arb(0.5)) / SAMPLES_OF_STEP) < 0:
                        raise Refuted("it is proved to be negative") from None
            raise

    def _check_pieces(self, each: Derivatives, zero_at_start: int, zero_at_end: int) -> None:
        pieces, opens = self.passage.pieces, bool(zero_at_start)
        for i, piece in enumerate(pieces):
            low, high = arb(0), piece.step.h
            if opens:  # and beyond the first piece, as far as the same derivative is positive
                low = self._beginning(each, zero_at_start, piece, i == 0)
                opens = not low < high
            if i == len(pieces) - 1 and zero_at_end:
                high = self._ending(each, zero_at_end, piece, low)
            if low < high:
                self._check_between(each, piece, low, high, _most_halvings())

    def _beginning(self, each: Derivatives, order: int, piece: Piece, is_first: bool) -> arb:
        """A time up to which the first derivative that is not zero at the start is positive, and so the function; after
        the first piece it may be 0."""
        until = piece.step.h
        for _ in range(_most_halvings()):
            derivative = self.value(each, order, piece, between(arb(0), until))
            if derivative > 0:
                return until
            if not is_first:
                return arb(0)
            if self.value(each, order, piece, arb(0)) < 0:
                raise Refuted("it has the wrong sign as soon as the motion begins")
            until = until / 2
        raise Undecided("its sign at the beginning is not decided")

    def _ending(self, each: Derivatives, order: int, piece: Piece, low: arb) -> arb:
        """A time from which the first derivative that is not zero at the end has the sign of a function that falls to
        its zero there."""
        since, sign = low, (-1) ** order
        for _ in range(_most_halvings()):
            if sign * self.value(each, order, piece, between(since, piece.step.h)) > 0:
                return since
            if sign * self.value(each, order, piece, piece.step.h) < 0:
                raise Refuted("it has the wrong sign just before the motion ends")
            since = (since + piece.step.h) / 2
        raise Undecided("its sign at the end is not decided")

    def _check_between(self, each: Derivatives, piece: Piece, low: arb, high: arb, left: int) -> None:
        times, middle = between(low, high), (low + high) / 2
        if self.value(each, 0, piece, times) > 0:
            return
        at_middle = self.value(each, 0, piece, middle)
        if at_middle < 0:
            raise Refuted("it is proved to be negative")
        if at_middle + self.value(each, 1, piece, times) * (times - middle) > 0:
            return
        if left == 0:
            raise Undecided("its sign is not decided: it comes very near to 0")
        self._check_between(each, piece, low, middle, left - 1)
        self._check_between(each, piece, middle, high, left - 1)

    def count_turns(self, each: Derivatives, turns_at_end: bool = True) -> int:
        """The number of stationary points of a function inside the motion, at whose end it is known to have one, or to
        have none.

        The times are divided into those where its rate has a sign and those where the rate is monotone. Among the
        latter, one after the other, the rate has one zero where its signs before and after differ, and none where they
        agree. The last of them hold the end, and no other zero. Raises `Unproved` where a time is neither.
        """
        marks = list[tuple[int, int]]()  # sign of the rate, 0 where it has none, and of the rate's derivative
        for piece in self.passage.pieces:
            self._mark(each, piece, arb(0), piece.step.h, _most_halvings(), marks)
        if marks[0][0] == 0:
            marks.insert(0, (_sign(self.first(each, 1)), 0))
        if not turns_at_end and marks[-1][0] == 0:
            marks.append((_sign(self.last(each, 1)), 0))
        if marks[0][0] == 0 or (marks[-1][0] != 0) == turns_at_end:
            raise Unproved("the extension is stationary too long where the motion begins or ends")
        turns, before, slope = 0, marks[0][0], 0
        for sign, slope_here in marks:
            if sign == 0:
                if slope not in (0, slope_here):
                    raise Undecided("two turns of the extension come very near to each other")
                slope = slope_here
            else:
                turns += sign != before
                before, slope = sign, 0
        return turns

    def _mark(
        self, each: Derivatives, piece: Piece, low: arb, high: arb, left: int, marks: list[tuple[int, int]]
    ) -> None:
        times = between(low, high)
        if sign := _sign(self.value(each, 1, piece, times)):
            marks.append((sign, 0))
        elif slope := _sign(self.value(each, 2, piece, times)):
            marks.append((0, slope))
        elif left == 0:
            raise Undecided("the turns of the extension cannot be told apart")
        else:
            middle = (low + high) / 2
            self._mark(each, piece, low, middle, left - 1, marks)
            self._mark(each, piece, middle, high, left - 1, marks)


def _most_halvings() -> int:
    """Halvings after which a sign is left undecided: two further bits of a value at a minimum, which is flat, need one
    further halving of the time."""
    return MOST_BISECTIONS + max(ctx.prec - FIRST_BITS, 0) // 2


def _sign(value: arb) -> int:
    return int(value > 0) - int(value < 0)
