"""A statement on balls: each arc becomes a leg, a system that is followed for one unit of time, and the conditions at
the ends of the legs become equations with their derivatives.

The states of a leg are the states of its arc, its duration, and the parameters that are known only within intervals.
The unknowns of a proof are those of the statement and, after them, these parameters.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from flint import arb, arb_mat

from ..exact import Bounds, ExactArc, ExactStatement, Unproved, place_of
from ..symbolic import ZERO, ExactExpression, exact_number, jacobian, substitute, symbol, symbols_in, total
from .crossing import Breakpoints
from .enclosure import COARSE, Fineness, Passage, Variation, follow_set
from .programs import BallProgram, EachLaw, ball_of_fraction
from .rigorous_step import StatesOfPart, System, between, widened

# Halvings of a step's time after which it stays undecided whether a law has a value there.
MOST_HALVINGS_OF_DOMAINS = 12


class IntervalParameters:
    """The parameters that are only known within intervals, each by its place there, from -1 to 1.

    symbols : by name
    """

    def __init__(self, parameters: Mapping[str, Bounds]):
        self.symbols = {name: place_of(name) for name, (low, high) in parameters.items() if low < high}

    def __bool__(self) -> bool:
        return bool(self.symbols)

    def __len__(self) -> int:
        return len(self.symbols)

    def middles(self) -> list[arb]:
        """The middles of the places."""
        return [arb(0)] * len(self)

    def radii(self) -> list[arb]:
        """The largest distance of each place from its middle."""
        return [arb(1)] * len(self)

    def balls(self) -> list[arb]:
        """Enclosures of the places."""
        return [arb(0, 1)] * len(self)


class BallLeg:
    """An arc as programs, for interval parameters with these symbols.

    state : symbols of the m moving states, of the duration, of the arc's constants, and of the interval parameters: n
        in all
    rates : (laws, n), for a leg that lasts from 0 to 1
    start : (unknowns, interval parameters, states at the end of the leg before) -> the states of this leg
    conditions : for each law at the start, (the same without the last, states at the start, states at the end) ->
        the values that vanish; the derivatives of each come as a dense matrix, row by row
    """

    def __init__(self, arc: ExactArc, unknowns: Sequence[ExactExpression], intervals: Sequence[ExactExpression]):
        self.arc, self.moving = arc, arc.states
        self.duration = symbol("duration of the leg")
        self.state = [*arc.states, self.duration, *arc.constants, *intervals]
        constant_rates = [ZERO] * (len(self.state) - len(arc.states))
        self.rates = [[*(self.duration * rate for rate in law), *constant_rates] for law in arc.rates]
        inputs = [*unknowns, *intervals, *arc.before]
        start = [*arc.start, arc.duration, *arc.constants, *intervals]
        self.start, self.start_slopes = BallProgram(inputs, start), _dense_program(start, inputs)
        first, last = ([symbol(f"{end} {each.value}") for each in arc.states] for end in ("first", "last"))
        inputs = [*unknowns, *intervals, *first, *last]
        at_end = substitute(arc.conditions, dict(zip(arc.states, last, strict=True)))
        each_law = [[*at_end, *substitute(law, dict(zip(arc.states, first, strict=True)))] for law in arc.guards]
        self.conditions = EachLaw(lambda law: BallProgram(inputs, each_law[law]))
        self.condition_slopes = EachLaw(lambda law: _dense_program(each_law[law], inputs))
        self.count = len(each_law[0])
        self.variation = self._variation()
        self._breaks = BallProgram([*arc.constants, *intervals], arc.breaks)
        self._domains = EachLaw(lambda law: BallProgram(self.state, [each.place for each in arc.domains[law]]))

    def _variation(self) -> Variation:
        """The system of the leg with its variational equations."""
        m, n = len(self.moving), len(self.state)
        varied = [[symbol(f"d {i} {j}") for j in range(n)] for i in range(m)]
        moves = self._influence()
        rows = [[varied[i][j] if moves[i, j] else exact_number(int(i == j)) for j in range(n)] for i in range(n)]
        states = [*self.state, *(each for row in varied for each in row)]

        def varied_system(law: int) -> System:
            slopes = jacobian(self.rates[law][:m], self.state)
            changes = [
                total(slopes[i][k] * rows[k][j] for k in range(n) if slopes[i][k] is not ZERO)
                for i in range(m)
                for j in range(n)
            ]
            return system_of(states, [*self.rates[law], *changes])

        return Variation(n, m, EachLaw(lambda law: system_of(self.state, self.rates[law])), EachLaw(varied_system))

    def _influence(self) -> np.ndarray:
        """Whether (n, n) the derivative of each state by the start of each changes along the motion: where that acts on
        it through a chain of rates. Of laws in pieces, which pass from one to another, each is taken to change."""
        n, m = len(self.state), len(self.moving)
        acts = np.ones((n, n), dtype=bool)
        if len(self.rates) == 1:
            contained = symbols_in(self.rates[0])
            acts = np.array([[state in contained[rate] for state in self.state] for rate in self.rates[0]])
            for _ in range(n.bit_length()):
                acts = acts | (acts @ acts)
        acts[m:] = False
        return acts

    def breakpoints(self, states: Sequence[arb]) -> Breakpoints:
        """The breakpoints of the law, for enclosures (n,) of the states, whose constants they depend on."""
        values = self._breaks(states[len(self.moving) + 1 :])
        if not all(low < high for low, high in itertools.pairwise(values)):
            raise Unproved("the breakpoints of the spring's law are not proved to be apart and in order")
        return Breakpoints(tuple(map(ball_of_fraction, self.arc.weights)), values)

    def check_domains(self, passage: Passage) -> None:
        """Raise `Unproved` where a formula is not proved to have a value along a whole enclosed motion."""
        for piece in passage.pieces:
            for law in piece.laws:
                if self.arc.domains[law]:
                    waiting = [(arb(0), piece.step.h, MOST_HALVINGS_OF_DOMAINS)]
                    while waiting:
                        low, high, left = waiting.pop()
                        values = self._domains[law](piece.step.at(between(low, high)))
                        undecided = [
                            each.what
                            for each, value in zip(self.arc.domains[law], values, strict=True)
                            if not each.holds(value)
                        ]
                        if not undecided:
                            continue
                        if left == 0:
                            raise Unproved(f"the motion comes near a place where {undecided[0]} has no value")
                        middle = (low + high) / 2
                        waiting += [(middle, high, left - 1), (low, middle, left - 1)]


def system_of(states: list[ExactExpression], rates: list[ExactExpression]) -> System:
    """The system with these rates of states, and its derivatives."""
    places, slopes = list[tuple[int, int]](), list[ExactExpression]()
    for i, row in enumerate(jacobian(rates, states)):
        for j, slope in enumerate(row):
            if slope is not ZERO:
                places.append((i, j))
                slopes.append(slope)
    moving = [i for i, rate in enumerate(rates) if rate is not ZERO]
    parts = list[StatesOfPart]()
    # Not the derivatives, since one may vanish where the state does not cancel in the expression itself.
    known = symbols_in(rates)
    contained = [known[rate] for rate in rates]
    needs = [(i, j) for i in moving for j, state in enumerate(states) if state in contained[i]]
    for own in _halves(moving, needs) or [moving]:
        inputs = sorted({j for i, j in needs if i in own})
        program = BallProgram([states[j] for j in inputs], [rates[i] for i in own])
        parts.append(StatesOfPart(tuple(own), tuple(inputs), program))
    return System(len(states), BallProgram(states, rates), BallProgram(states, slopes), tuple(places), tuple(parts))


def _halves(moving: list[int], needs: list[tuple[int, int]]) -> list[list[int]] | None:
    """The moving states in two parts such that the rates of each contain no state of its own part, from the pairs of
    a state and another one that its rate contains; None where there are no such parts."""
    side, neighbours = dict[int, bool](), {i: list[int]() for i in moving}
    for i, j in needs:
        if j in neighbours:
            neighbours[i].append(j)
            neighbours[j].append(i)
    for first in moving:
        waiting = [(first, side.get(first, False))]
        while waiting:
            i, at = waiting.pop()
            if i not in side:
                side[i] = at
                waiting += [(j, not at) for j in neighbours[i]]
            elif side[i] != at:
                return None
    return [part for part in ([i for i in moving if side[i] is at] for at in (False, True)) if part]


def _dense_program(outputs: Sequence[ExactExpression], inputs: Sequence[ExactExpression]) -> BallProgram:
    return BallProgram(inputs, [each for row in jacobian(outputs, inputs) for each in row])


@dataclass(frozen=True)
class Evaluated:
    """The equations on a box of unknowns.

    values : enclosures of the equations at the middle of the box
    slopes : enclosures (equations, unknowns) of their derivatives on all of the box
    """

    values: list[arb]
    slopes: arb_mat
    passages: list[Passage]


class Equations:
    """The equations of a boundary value statement, on balls; the columns of derivatives are the unknowns and, after
    them, the interval parameters."""

    def __init__(self, statement: ExactStatement, intervals: IntervalParameters):
        self.statement, self.intervals, self.unknowns = statement, intervals, tuple(statement.unknowns)
        symbols = [*statement.unknowns.values()], [*intervals.symbols.values()]
        self.legs = [BallLeg(arc, *symbols) for arc in statement.arcs]

    def evaluate(
        self, centre: Sequence[arb], radii: Sequence[arb], bits: int, wide: bool = True, fineness: Fineness = COARSE
    ) -> Evaluated:
        """The equations on the box of unknowns within radii of a centre, for all values of the interval parameters, or
        for their middles alone; their derivatives with this fineness."""
        intervals = self.intervals
        middle = [*centre, *intervals.middles()]
        reach = [*radii, *(each if wide else arb(0) for each in intervals.radii())]
        box = [widened(value, radius) for value, radius in zip(middle, reach, strict=True)]
        deviations = arb_mat(len(reach), 1, [arb(0, each) for each in reach])
        values, rows, passages = list[arb](), list[list[arb]](), list[Passage]()
        last, last_box, last_slopes = list[arb](), list[arb](), None
        for leg in self.legs:
            columns = len(middle)
            start = leg.start([*middle, *last])
            slopes = _matrix_of(leg.start_slopes([*box, *last_box]), len(start))
            by_unknowns = columns_of(slopes, 0, columns)
            if last_slopes is not None:
                by_unknowns = by_unknowns + columns_of(slopes, columns, len(last)) * last_slopes
            breakpoints = leg.breakpoints(leg.start([*box, *last_box]))
            passage = follow_set(leg.variation, start, by_unknowns, deviations, bits, fineness, breakpoints)
            m = leg.variation.moving
            end, end_slopes = passage.end[:m], _first_rows(passage.slopes, m)
            start_slopes = _first_rows(by_unknowns, m)
            start_box, end_box = passage.start[:m], passage.finish[:m]
            passages.append(passage)
            last, last_box, last_slopes = end, end_box, end_slopes
            if leg.count == 0:
                continue
            laws, wide_laws = breakpoints.laws_of(start), breakpoints.laws_of(passage.start)
            values += _united([leg.conditions[law]([*middle, *start[:m], *end]) for law in laws])
            by_laws = [leg.condition_slopes[law]([*box, *start_box, *end_box]) for law in wide_laws]
            slopes = _matrix_of(_united(by_laws), leg.count)
            whole = columns_of(slopes, 0, columns) + columns_of(slopes, columns, m) * start_slopes
            rows += (whole + columns_of(slopes, columns + m, m) * end_slopes).tolist()
        return Evaluated(values, arb_mat(rows), passages)

    def check_domains(self, passages: Sequence[Passage]) -> None:
        """Raise `Unproved` where a formula is not proved to have a value along the whole enclosed motions."""
        for leg, passage in zip(self.legs, passages, strict=True):
            leg.check_domains(passage)


def _united(values: list[list[arb]]) -> list[arb]:
    """Enclosures of several laws' values, from those of each."""
    return [reduce(arb.union, each) for each in zip(*values, strict=True)]


def _matrix_of(values: list[arb], rows: int) -> arb_mat:
    return arb_mat(rows, len(values) // rows, values)


def columns_of(matrix: arb_mat, first: int, count: int) -> arb_mat:
    """`count` columns of a matrix, from column `first` on."""
    return arb_mat([row[first : first + count] for row in matrix.tolist()])


def _first_rows(matrix: arb_mat, count: int) -> arb_mat:
    """The first rows of a matrix."""
    return arb_mat(matrix.tolist()[:count])
