"""Statements with exact numbers: decimals as they are written, in place of the floats that they are rounded to.

Each arc of a boundary value statement becomes a leg, whose states are those of its phase, the time that it takes, in
units of which it is followed, and the parameters that are only known within intervals. The unknowns of a proof are
those of the statement and, after them, these parameters.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Any

import casadi as ca
from flint import arb, arb_mat, fmpq

from ..errors import InputError
from ..model.phase import Arc, Phase, Statement
from ..symbolic.formula import CONSTANTS, symbolic_numerals
from .crossing import Breakpoints
from .enclosure import Passage, Variation, follow_set
from .programs import BallProgram
from .refusal import Unproved
from .step import System, widened

# An exact decimal, a fraction, or the bounds of an interval.
Decimals = str | float | Fraction | tuple[str | float | Fraction, str | float | Fraction]
# A law with more pieces is a table.
MOST_LAWS = 12
# Decimals have at most so many places, before or after the point.
MOST_PLACES = 1500


def exact_fraction(name: str, value: str | float | Fraction) -> Fraction:
    """The exact value of a decimal, given as text, or of the shortest decimal that rounds to a float; raises
    `InputError` for what is no finite number."""
    if isinstance(value, Fraction):
        return value
    try:
        decimal = Decimal(value if isinstance(value, str) else repr(float(value)))
        if not abs(decimal.adjusted()) <= MOST_PLACES or abs(int(decimal.as_tuple().exponent)) > MOST_PLACES:
            raise ValueError
        return Fraction(decimal)
    except (ArithmeticError, ValueError, TypeError):
        raise InputError(f"{name} = {str(value)[:40]!r} is no decimal number that can be computed with") from None


class Numbers:
    """The exact values of parameters, and which of them are known within intervals only.

    values : (low, high) by name; equal for a number
    """

    def __init__(self, values: Mapping[str, float], given: Mapping[str, Decimals]):
        self.values: dict[str, tuple[Fraction, Fraction]] = {}
        for name, value in {**values, **given}.items():
            bounds = value if isinstance(value, tuple | list) else (value, value)
            if len(bounds) != 2:
                raise InputError(f"{name} = {value!r}: an interval has two bounds, (low, high)")
            low, high = (exact_fraction(name, bound) for bound in bounds)
            if low > high:
                raise InputError(f"{name} lies between {bounds[0]} and {bounds[1]}: the first bound is the lower one")
            self.values[name] = low, high

    @property
    def fixed(self) -> list[str]:
        """The names of the parameters with one value."""
        return [name for name, (low, high) in self.values.items() if low == high]

    @property
    def wide(self) -> list[str]:
        """The names of the parameters that are intervals."""
        return [name for name, (low, high) in self.values.items() if low < high]

    def middle(self, name: str) -> arb:
        """The middle of a parameter's interval."""
        low, high = self.values[name]
        return _ball((low + high) / 2)

    def radius(self, name: str) -> arb:
        """How far a parameter may be from a number that its `middle` holds."""
        low, high = self.values[name]
        return (_ball((high - low) / 2) + 2 * self.middle(name).rad()).abs_upper()

    def balls(self) -> list[arb]:
        """Enclosures of the interval parameters."""
        return [self.middle(name) + arb(0, self.radius(name)) for name in self.wide]

    def relative_width(self, name: str) -> float:
        """The width of a parameter's interval, relative to the parameter."""
        low, high = self.values[name]
        return float((high - low) / max(abs(low), abs(high)))

    def floats(self) -> dict[str, float]:
        """The middles as floats, for guesses."""
        return {name: float((low + high) / 2) for name, (low, high) in self.values.items()}


def _ball(value: Fraction) -> arb:
    return arb(fmpq(value.numerator, value.denominator))


class ExactExpressions:
    """Symbols for parameters and numerals, and the programs of expressions of them.

    p : the symbols of all parameters by name, for a model's functions
    """

    def __init__(self, numbers: Numbers):
        self.numbers = numbers
        self.p = {name: ca.SX.sym(name) for name in numbers.values}
        self.wide = [self.p[name] for name in numbers.wide]
        self.numerals: dict[str, ca.SX] = {}

    def program(self, inputs: Sequence[ca.SX], outputs: Sequence[Any]) -> BallProgram:
        """A program of these inputs and, after them, the constants."""
        fixed = [self.p[name] for name in self.numbers.fixed]
        return BallProgram([*inputs, *fixed, *self.numerals.values()], [ca.SX(each) for each in outputs])

    def constants(self) -> list[arb]:
        """Enclosures of the fixed parameters and of the numerals, at the precision of the context."""
        fixed = [self.numbers.middle(name) for name in self.numbers.fixed]
        return [*fixed, *(_numeral_ball(text) for text in self.numerals)]

    def derivatives(self, outputs: Sequence[Any], inputs: Sequence[ca.SX]) -> tuple[list[ca.SX], list[tuple[int, int]]]:
        """The derivatives that are not zero throughout, with their rows and columns."""
        jacobian = ca.jacobian(ca.vertcat(*outputs), ca.vertcat(*inputs))
        rows, columns = jacobian.sparsity().row(), jacobian.sparsity().get_col()
        return [jacobian.nz[i] for i in range(jacobian.nnz())], list(zip(rows, columns, strict=True))


def _numeral_ball(text: str) -> arb:
    if text in CONSTANTS:
        return arb.pi()
    return _ball(exact_fraction("a numeral", text))


class LegExpressions:
    """The expressions of one leg: its states, the rates of a moving phase in units of the leg's duration.

    state : symbols of the m states of the phase, of the duration, and of the interval parameters: n in all
    laws : the data of each piece of a phase that is smooth in pieces, else one without data
    breaks : where one follows the other
    rates : of the states, for each law
    """

    def __init__(self, expressions: ExactExpressions, phase: Phase):
        self.phase, self.laws, self.breaks = phase, [list[Any]()], list[Any]()
        self.weights: tuple[float, ...] = ()
        if phase.pieces:
            self.weights = phase.pieces.coordinate
            table: Any = phase.pieces.table  # of expressions, as of numbers
            breaks, data = table(expressions.p)
            if len(data) > MOST_LAWS or not (breaks[0] == -math.inf and breaks[-1] == math.inf):
                raise Unproved("the spring's law is a table: its numbers are rounded")
            self.laws, self.breaks = [list(row) for row in data], list(breaks[1:-1])
        self.moving = ca.vertsplit(ca.SX.sym("x", len(phase.states)))
        self.duration = ca.SX.sym("duration")
        self.state = [*self.moving, self.duration, *expressions.wide]
        still = [ca.SX(0) for _ in self.state[len(self.moving) :]]
        fields = [phase.field(self.moving, expressions.p, data) for data in self.laws]
        self.rates = [[*(self.duration * ca.SX(rate) for rate in field), *still] for field in fields]

    def jumps(self) -> list[ca.SX]:
        """How much the rates differ on both sides of each breakpoint, as functions of the state; its first state that
        the coordinate depends on is put to where the breakpoint is."""
        found = list[ca.SX]()
        for k, place in enumerate(self.breaks):
            first = next(i for i, weight in enumerate(self.weights) if weight)
            parts = list(zip(self.weights, self.moving, strict=False))
            others = sum((weight * x for i, (weight, x) in enumerate(parts) if i != first), ca.SX(0))
            there = (ca.SX(place) - others) / self.weights[first]
            change = ca.vertcat(*self.rates[k]) - ca.vertcat(*self.rates[k + 1])
            found += ca.vertsplit(ca.substitute(change, self.moving[first], there))
        return found

    def variation(self, expressions: ExactExpressions) -> Variation:
        """The system of the leg with its variational equations."""
        m, n = len(self.moving), len(self.state)
        varied = ca.SX.sym("d", n, m).T
        by_all = ca.vertcat(varied, ca.SX(ca.DM.eye(n)[m:, :]))
        states = [*self.state, *(varied[i, j] for i in range(m) for j in range(n))]  # row by row
        systems, both = list[System](), list[System]()
        for rates in self.rates:
            slopes = ca.jacobian(ca.vertcat(*rates[:m]), ca.vertcat(*self.state)) @ by_all
            systems.append(self._system(expressions, self.state, rates))
            both.append(
                self._system(expressions, states, [*rates, *(slopes[i, j] for i in range(m) for j in range(n))])
            )
        return Variation(m, tuple(systems), tuple(both))

    @staticmethod
    def _system(expressions: ExactExpressions, states: list[ca.SX], rates: list[ca.SX]) -> System:
        slopes, places = expressions.derivatives(rates, states)
        of_rates, of_slopes = (expressions.program(states, each) for each in (rates, slopes))
        return System(len(states), of_rates, of_slopes, tuple(places))


class BallLeg:
    """An arc of a statement as programs.

    start : (unknowns, states at the end of the leg before) -> the states of this leg, n
    conditions : (unknowns, states at the start, states at the end) -> what vanishes, for each law at the start
    The derivatives of each come as a dense matrix, row by row.
    """

    def __init__(self, expressions: ExactExpressions, arc: Arc, unknowns: Mapping[str, ca.SX], before: list[ca.SX]):
        self.graph = LegExpressions(expressions, arc.phase)
        self.expressions, self.before = expressions, before
        self.w = [*unknowns.values(), *expressions.wide]
        p, m = expressions.p, len(self.graph.moving)
        start = [ca.SX(each) for each in arc.start(unknowns, before, p)]
        self._start = [*start, ca.SX(arc.duration(unknowns, p)), *expressions.wide]
        first = ca.vertsplit(ca.SX.sym("first", m))
        conditions = arc.conditions(unknowns, self.graph.moving, p)
        guards = [arc.guard(unknowns, first, p, data) for data in self.graph.laws]
        self._inputs = [*self.w, *first, *self.graph.moving]
        self._conditions = [[*map(ca.SX, conditions), *map(ca.SX, guard)] for guard in guards]

    def compile(self) -> None:
        """Build the programs, once all expressions of the statement have been evaluated."""
        expressions = self.expressions
        self.variation = self.graph.variation(expressions)
        inputs = [*self.w, *self.before]
        self.start, self.start_slopes = expressions.program(inputs, self._start), self._dense(self._start, inputs)
        self.conditions = [expressions.program(self._inputs, each) for each in self._conditions]
        self.condition_slopes = [self._dense(each, self._inputs) for each in self._conditions]
        self.count = len(self._conditions[0])
        self._jumps = expressions.program(self.graph.state, self.graph.jumps())
        self._breaks = expressions.program(expressions.wide, [ca.SX(value) for value in self.graph.breaks])

    def check_continuous(self, states: Sequence[arb]) -> None:
        """Raise `Unproved` where the rates jump at a breakpoint, which continuous laws do by rounding at most."""
        if not all(jump.contains(0) for jump in self._jumps([*states, *self.expressions.constants()])):
            raise Unproved("the spring's force jumps at a breakpoint")

    def breakpoints(self, wide: Sequence[arb]) -> Breakpoints:
        """Where the law changes, for enclosures of the interval parameters."""
        values = self._breaks([*wide, *self.expressions.constants()])
        if not all(low < high for low, high in itertools.pairwise(values)):
            raise Unproved("the breakpoints of the spring's law are not proved to be apart and in order")
        return Breakpoints(self.graph.weights, values)

    def _dense(self, outputs: list[ca.SX], inputs: list[ca.SX]) -> BallProgram:
        jacobian = ca.densify(ca.jacobian(ca.vertcat(*outputs), ca.vertcat(*inputs)))
        rows, columns = range(len(outputs)), range(len(inputs))
        return self.expressions.program(inputs, [jacobian[i, j] for i in rows for j in columns])


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
    """The equations of a boundary value statement, on balls.

    unknowns : their names; the columns of derivatives are these and, after them, the interval parameters
    positive : the names of those that a solution has above 0
    """

    def __init__(self, statement: Statement, numbers: Numbers):
        self.numbers, self.unknowns = numbers, statement.unknowns
        self.positive = {"alpha", *statement.durations}
        self.expressions = ExactExpressions(numbers)
        with symbolic_numerals(self.expressions.numerals):
            u = {name: ca.SX.sym(name) for name in statement.unknowns}
            self.legs, before = list[BallLeg](), list[ca.SX]()
            for arc in statement.arcs:
                self.legs.append(BallLeg(self.expressions, arc, u, before))
                before = ca.vertsplit(ca.SX.sym("before", len(arc.phase.states)))
        for leg in self.legs:
            leg.compile()

    def evaluate(self, centre: Sequence[arb], radii: Sequence[arb], bits: int, wide: bool = True) -> Evaluated:
        """The equations on the box of unknowns within radii of a centre, for all values of the interval parameters, or
        for their middles alone."""
        names = self.numbers.wide
        constants = self.expressions.constants()
        middle = [*centre, *(self.numbers.middle(name).mid() for name in names)]
        reach = [*radii, *(self.numbers.radius(name) if wide else arb(0) for name in names)]
        box = [widened(value, radius) for value, radius in zip(middle, reach, strict=True)]
        deviations = arb_mat(len(reach), 1, [arb(0, each) for each in reach])
        values, rows, passages = list[arb](), list[list[arb]](), list[Passage]()
        last, last_box, last_slopes = list[arb](), list[arb](), None
        for leg in self.legs:
            columns = len(middle)
            start = leg.start([*middle, *last, *constants])
            slopes = _matrix_of(leg.start_slopes([*box, *last_box, *constants]), len(start))
            by_unknowns = columns_of(slopes, 0, columns)
            if last_slopes is not None:
                by_unknowns = by_unknowns + columns_of(slopes, columns, len(last)) * last_slopes
            leg.check_continuous(start)
            breakpoints = leg.breakpoints(box[len(self.unknowns) :])
            passage = follow_set(
                leg.variation, constants, start, by_unknowns, deviations, bits, breakpoints=breakpoints
            )
            law = passage.pieces[0].laws[0]
            m = leg.variation.moving
            end, end_slopes = passage.end[:m], _first_rows(passage.slopes, m)
            start_slopes = _first_rows(by_unknowns, m)
            start_box, end_box = passage.start[:m], passage.finish[:m]
            passages.append(passage)
            last, last_box, last_slopes = end, end_box, end_slopes
            if leg.count == 0:
                continue
            values += leg.conditions[law]([*middle, *start[:m], *end, *constants])
            slopes = _matrix_of(leg.condition_slopes[law]([*box, *start_box, *end_box, *constants]), leg.count)
            total = columns_of(slopes, 0, columns) + columns_of(slopes, columns, m) * start_slopes
            rows += (total + columns_of(slopes, columns + m, m) * end_slopes).tolist()
        return Evaluated(values, arb_mat(rows), passages)


def _matrix_of(values: list[arb], rows: int) -> arb_mat:
    return arb_mat(rows, len(values) // rows, values)


def columns_of(matrix: arb_mat, first: int, count: int) -> arb_mat:
    """So many columns of a matrix, from the first one on."""
    return arb_mat([row[first : first + count] for row in matrix.tolist()])


def _first_rows(matrix: arb_mat, count: int) -> arb_mat:
    """The first rows of a matrix."""
    return arb_mat(matrix.tolist()[:count])
