"""Laws that jump or bend, stated in pieces: a breakpoint lies where the two sides of a comparison are equal.

A series ends at a kink. Steps without series resolve kinks slowly and cannot resolve a jump: a polynomial across it
oscillates, and sensitivities change there by the jump. On a piece the outcome of each comparison is constant, so that
the law is smooth there and also beyond the ends of the piece.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import pairwise, product
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..running import LOCK, exclusive
from ..symbolic import applied, single_assignment
from .features import FEATURES
from .law import Law, LawPieces, Parameters
from .law_expressions import Expression, break_table

# Operations by which a law may jump, and a result that changes only there, from theirs and their arguments.
_STEPS: dict[int, Callable] = {
    **dict.fromkeys((ca.OP_SIGN, ca.OP_LT, ca.OP_LE, ca.OP_FLOOR, ca.OP_CEIL), lambda result, *_: result),
    ca.OP_COPYSIGN: lambda _, a, b: ca.sign(b),
    ca.OP_FMOD: lambda _, a, b: ca.floor(a / b),
    ca.OP_REMAINDER: lambda _, a, b: ca.floor(a / b + 0.5),
}
# Operations with two outcomes: what decides, by its sign, and the result with an outcome s of -1 or 1.
_DECIDED: dict[int, tuple[Callable, Callable]] = {
    ca.OP_SIGN: (lambda a: a, lambda s, a: s),
    ca.OP_FABS: (lambda a: a, lambda s, a: s * a),
    ca.OP_LT: (lambda a, b: b - a, lambda s, a, b: (1 + s) / 2),
    ca.OP_LE: (lambda a, b: b - a, lambda s, a, b: (1 + s) / 2),
    ca.OP_FMIN: (lambda a, b: b - a, lambda s, a, b: (1 + s) / 2 * a + (1 - s) / 2 * b),
    ca.OP_FMAX: (lambda a, b: a - b, lambda s, a, b: (1 + s) / 2 * a + (1 - s) / 2 * b),
}
# Operations on conditions, which are 0 or 1.
_ON_CONDITIONS: dict[int, Callable] = {
    ca.OP_NOT: lambda a: 1 - a,
    ca.OP_AND: lambda a, b: a * b,
    ca.OP_OR: lambda a, b: a + b - a * b,
    ca.OP_IF_ELSE_ZERO: lambda condition, a: condition * a,
}
_CONDITIONS = {ca.OP_LT, ca.OP_LE, ca.OP_NOT, ca.OP_AND, ca.OP_OR}
_UNDECIDED = {ca.OP_FLOOR, ca.OP_CEIL, ca.OP_COPYSIGN, ca.OP_FMOD, ca.OP_REMAINDER, ca.OP_EQ, ca.OP_NE}


class JumpOptions(NamedTuple):
    """How pieces of a formula, and the jumps between them, are found and compared with it."""

    # Comparisons of what others decide, as abs(r) > 1, that are resolved for all of their outcomes.
    most_inside: int = 3
    equal: float = 1e-9  # forces that differ by a smaller share of their size and of 1 are equal
    coincident: float = 1e-14  # places that differ by a smaller share of their size and of 1 are one
    shortest: float = 1e-12  # piece that is compared with the law: in shorter ones samples are rounded
    beside: float = 1e-13  # distance from a breakpoint, a share of its place and of 1, where roundings end
    farther: float = 10.0  # how many times as far from the breakpoint the two sides are compared again
    least_ratio: float = 0.95  # of a jump to the difference of the sides farther away; of abs(r)**0.1 it is 0.8
    farthest: float = 1e12  # from rest at which the sides of a comparison meet: beyond it no motion leads
    # Share by which parameters are moved, and parameters 0 by as much, to tell what holds whatever their values
    # are: a jump of the size 0 is one.
    moved: float = 0.1
    halvings: int = 60  # that bracket a jump without a formula of its place


JUMPS = JumpOptions()
# Where a piece is compared with the law: shares of its length, or of this length where it has no end.
COMPARED_SHARES = np.linspace(0.001, 0.999, 200)
# Jumps without a formula of their place are searched for at these extensions.
PLACES_OF_JUMPS = np.linspace(-FEATURES.farthest, FEATURES.farthest, 4002)


@exclusive
def in_pieces(law: Law, breakpoints: Sequence[float] = ()) -> Law:
    """The law in pieces where it jumps or bends, or where breakpoints are stated; else the law itself.

    Raises `InputError` for gravity that jumps, and for a law that jumps where neither breakpoints nor comparisons of
    straight lines say.
    """
    stated, graph = tuple(sorted(breakpoints)), (law.expression, law.variable, tuple(law.parameters))
    plain = replace(law, pieces=LawPieces(0, break_table((-np.inf, *stated, np.inf)))) if stated else law
    parts = _Parts(*graph)
    if not parts.compares:
        return plain
    values = np.array([*law.parameters.values()], dtype=float)
    moved = values + JUMPS.moved * np.cos(np.arange(len(values))) * np.where(values == 0, 1.0, values)
    breaks = parts.breaks([values, moved], stated) if parts.smooth is not None else ()
    if not breaks:
        if not stated and parts.steps:
            parts.refuse_jump(law, values)
        return plain
    table = _table(*graph, breaks)
    jumps = any(parts.jumps(table, each) for each in (values, moved))
    if jumps and law.variable != "r":
        raise InputError(f"gravity '{law.text}' jumps; write it as one smooth formula of {law.variable}")
    if law.variable == "r" and all(parts.are_smooth(table, each) for each in (values, moved)):
        pieces = LawPieces(len(parts.outcomes), table, jumps=jumps, exact=True)
        return replace(law, expression=_smooth(*graph), pieces=pieces)
    if stated or not jumps:
        return plain
    places = ", ".join(f"{float(x):.6g}" for x in table(law.parameters)[0][1:-1])
    raise InputError(
        f"the law '{law.text[:60]}' jumps. At one of its comparisons it has no derivative, or the formula of one side "
        "has no value on the other: round the law there, or state all its jumps, for example "
        f"springs.function(force, breakpoints=({places},))"
    )


def switches(function: ca.Function, arguments: Sequence[ca.SX]) -> list[ca.SX]:
    """The expressions in the arguments of an SX function whose signs decide its comparisons, where it has corners."""
    values, found = list[ca.SX](), list[ca.SX]()
    for op, places, constant in single_assignment(function):
        if op == ca.OP_INPUT:
            values.append(arguments[places[0]][places[1]])
        elif op == ca.OP_OUTPUT:
            values.append(values[places[0]])
        else:
            own = [values[place] for place in places]
            found += [_DECIDED[op][0](*own)] if op in _DECIDED else []
            values.append(applied(op, own) if constant is None else ca.SX(constant))
    return found


class _Parts:
    """A law taken apart at its comparisons.

    outcomes : of each comparison the expression that decides by its sign, in x and p; the same in x, p and the outcomes
        of comparisons inside; and the symbol of its outcome, -1 or 1
    steps : the results of operations that jump
    smooth : the law with the symbols of outcomes; None where it has other operations that jump
    """

    def __init__(self, expression: Callable, variable: str, names: tuple[str, ...]):
        self.x, self.p, self.names = ca.SX.sym(variable), ca.SX.sym("p", len(names)), names
        symbols = dict(zip(names, ca.vertsplit(self.p) if names else [], strict=True))
        self.law = ca.SX(expression(self.x, symbols, []))
        self.tape = single_assignment(ca.Function("law", [self.x, *symbols.values()], [self.law]))
        self.compares = any(op in _STEPS or op in _DECIDED for op, *_ in self.tape)
        self.outcomes: list[tuple[ca.SX, ca.SX, ca.SX]] = []
        self.steps: list[ca.SX] = []
        self.smooth = self._taken_apart([self.x, *symbols.values()]) if self.compares else self.law

    def _taken_apart(self, arguments: list[ca.SX]) -> ca.SX | None:
        """The law with symbols for the outcomes of its comparisons."""
        plain, smooth, conditions, complete = list[ca.SX](), list[ca.SX](), set[int](), True
        for i, (op, places, constant) in enumerate(self.tape):
            if op == ca.OP_OUTPUT:
                return smooth[places[0]] if complete else None
            if op in (ca.OP_INPUT, ca.OP_CONST):
                plain.append(arguments[places[0]] if constant is None else ca.SX(constant))
                smooth.append(plain[-1])
                continue
            own, others = ([each[place] for place in places] for each in (plain, smooth))
            plain.append(applied(op, own))
            if not ca.depends_on(plain[-1], self.x):
                smooth.append(plain[-1])
                continue
            self.steps += [_STEPS[op](plain[-1], *own)] if op in _STEPS else []
            conditions |= {i} if op in _CONDITIONS else set()
            if op in _DECIDED:
                decides, result = _DECIDED[op]
                smooth.append(result(self._outcome(decides(*own), decides(*others)), *others))
            elif op in _ON_CONDITIONS:
                complete &= {*(places[:1] if op == ca.OP_IF_ELSE_ZERO else places)} <= conditions
                smooth.append(_ON_CONDITIONS[op](*others))
            else:
                complete &= op not in _UNDECIDED
                smooth.append(applied(op, others))
        raise AssertionError("a function has a result")

    def _outcome(self, decides: ca.SX, line: ca.SX) -> ca.SX:
        """The symbol of the outcome of a comparison, the same for equal ones."""
        for known, _, symbol in self.outcomes:
            if ca.is_equal(known, decides, 20):
                return symbol
        self.outcomes.append((decides, line, ca.SX.sym(f"outcome_{len(self.outcomes)}")))
        return self.outcomes[-1][-1]

    @cached_property
    def roots(self) -> list[ca.SX] | None:
        """Where comparisons change their outcomes, for each outcome of those inside, at `JUMPS.farthest` where they do
        not; None where one is not of straight lines."""
        found = list[ca.SX]()
        for _, line, _ in self.outcomes:
            inside = [symbol for *_, symbol in self.outcomes if ca.depends_on(line, symbol)]
            slope = ca.jacobian(line, self.x)
            if len(inside) > JUMPS.most_inside or ca.depends_on(slope, self.x):
                return None
            level = ca.substitute(line, self.x, 0)
            nowhere = JUMPS.farthest * ca.fabs(slope) <= ca.fabs(level)
            root = ca.if_else(nowhere, JUMPS.farthest, -level / ca.if_else(nowhere, 1.0, slope))
            for outcomes in product((-1.0, 1.0), repeat=len(inside)):
                found.append(ca.substitute(root, ca.vertcat(*inside), ca.vertcat(*outcomes)) if inside else root)
        return found

    def breaks(self, values: Sequence[np.ndarray], stated: tuple[float, ...]) -> tuple[int | float, ...]:
        """The breakpoints: whole numbers are those of `roots`, and the stated ones follow, unless they are roots at the
        first of the values of the parameters; those alone where not all comparisons are of straight lines."""
        if self.roots is None:
            return stated
        function, found = ca.Function("roots", [self.p], [ca.vertcat(*self.roots)]), list[int]()
        places = np.hstack([function(each).full() for each in values])
        for i, each in enumerate(places):
            if np.isnan(each).any():
                return stated
            if (each < JUMPS.farthest).any() and not any(
                _are_near(places[k], each, JUMPS.coincident).all() for k in found
            ):
                found.append(i)
        return *found, *(x for x in stated if not any(_are_near(x, places[k, 0], JUMPS.coincident) for k in found))

    def jumps(self, table: Callable, values: np.ndarray) -> bool:
        """Whether the law jumps at a breakpoint of the table, at values of the parameters."""
        ends = np.array(table(dict(zip(self.names, values.tolist(), strict=True)))[0][1:-1])
        ends = ends[np.abs(ends) < JUMPS.farthest]
        if not len(ends):
            return False
        distances = JUMPS.beside * np.array([[1.0], [JUMPS.farther]]) * (1 + np.abs(ends))
        below, above = (
            self._law_at((ends + side * distances).reshape(1, -1), values).full().reshape(distances.shape)
            for side in (-1, 1)
        )
        near, far = np.abs(above - below)
        # What the slopes on both sides, or roots there, add to a difference shrinks with the distance.
        return bool(((near > JUMPS.equal * (1 + np.abs(below[0]))) & (near > JUMPS.least_ratio * far)).any())

    def are_smooth(self, table: Callable, values: np.ndarray) -> bool:
        """Whether the pieces are the law, and have derivatives at their ends, at values of the parameters."""
        levels, rows = table(dict(zip(self.names, values.tolist(), strict=True)))
        for low, high, row in zip(levels[:-1], levels[1:], rows, strict=True):
            ends = [x for x in (low, high) if abs(x) < JUMPS.farthest]
            if not ends or _are_near(low, high, JUMPS.shortest):
                continue
            first = low if low in ends else high - FEATURES.farthest
            inside = first + ((high if high in ends else low + FEATURES.farthest) - first) * COMPARED_SHARES
            own, law = self._on_piece(inside[None], values, row).full(), self._law_at(inside[None], values).full()
            at_ends = self._on_piece(np.array([ends]), values, row).full()
            if not np.isfinite(at_ends).all() or not (_are_near(own[0], law[0], JUMPS.equal) | np.isnan(law[0])).all():
                return False
        return True

    @cached_property
    def _on_piece(self) -> ca.Function:
        """(x, p, outcomes) -> the law on a piece, and its first three derivatives."""
        found = [self.law if self.smooth is None else self.smooth]
        for _ in range(3):
            found.append(ca.jacobian(found[-1], self.x))
        return ca.Function("piece", [self.x, self.p, self.symbols], [ca.densify(ca.vertcat(*found))])

    @cached_property
    def _law_at(self) -> ca.Function:
        return ca.Function("law", [self.x, self.p], [self.law])

    @property
    def symbols(self) -> ca.SX:
        """The symbols of the outcomes."""
        return ca.vertcat(*[symbol for *_, symbol in self.outcomes])

    def refuse_jump(self, law: Law, values: np.ndarray) -> None:
        """Raise `InputError` for a law that jumps at an extension within those `PLACES_OF_JUMPS`."""
        function = ca.Function("steps", [self.x, self.p], [ca.vertcat(*self.steps)])
        steps = lambda places: function(places[None], values).full()  # noqa: E731
        found = steps(PLACES_OF_JUMPS)
        cells = (found[:, :-1] != found[:, 1:]).any(0).nonzero()[0]
        if not len(cells):
            return
        low, high = PLACES_OF_JUMPS[cells], PLACES_OF_JUMPS[cells + 1]
        for _ in range(JUMPS.halvings):
            middle = 0.5 * (low + high)
            before = (steps(middle) == found[:, cells]).all(0)
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        below, above = (self._law_at(places[None], values).full()[0] for places in (low, high))
        jumps = (np.abs(above - below) > JUMPS.equal * (1 + np.abs(below))).nonzero()[0]
        if len(jumps):
            nearest = jumps[np.abs(high[jumps]).argmin()]
            raise InputError(
                f"the law '{law.text[:60]}' jumps at {law.variable} = {high[nearest]:.6g}, from {below[nearest]:.4g} "
                f"to {above[nearest]:.4g}, and no comparison of straight lines shows where: state all its jumps, for "
                f"example springs.function(force, breakpoints=({high[nearest]:.6g},))"
            )


@lru_cache(maxsize=64)
def _smooth(expression: Callable, variable: str, names: tuple[str, ...]) -> Expression:
    """The expression of a law whose data are the outcomes of its comparisons."""
    parts = _Parts(expression, variable, names)
    assert parts.smooth is not None
    function = ca.Function("smooth", [parts.x, parts.p, parts.symbols], [parts.smooth])
    value = lambda x, p, q: function(x, ca.vertcat(*[p[name] for name in names]), ca.vertcat(*q))  # noqa: E731
    return Expression(value, _smooth, expression, variable, names)


@lru_cache(maxsize=64)
def _table(expression: Callable, variable: str, names: tuple[str, ...], breaks: tuple[int | float, ...]) -> Expression:
    """The table of the pieces between breakpoints, whose data are the outcomes of comparisons."""
    parts = _Parts(expression, variable, names)
    levels = [(parts.roots or [])[each] if isinstance(each, int) else ca.SX(each) for each in breaks]
    for last in range(len(levels) - 1, 0, -1):
        for i in range(last):
            levels[i : i + 2] = ca.fmin(*levels[i : i + 2]), ca.fmax(*levels[i : i + 2])
    below, above = levels[0] - (1 + ca.fabs(levels[0])), levels[-1] + (1 + ca.fabs(levels[-1]))
    middles = [below, *(0.5 * (low + high) for low, high in pairwise(levels)), above]
    decides = ca.vertcat(*[ca.sign(decides) for decides, *_ in parts.outcomes])
    rows = [ca.substitute(decides, parts.x, middle) for middle in middles]
    function = ca.Function("pieces", [parts.p], [ca.densify(ca.vertcat(*levels)), ca.densify(ca.horzcat(*rows))])

    def table(p: Parameters) -> tuple[list, list]:
        with LOCK:
            found, columns = function(ca.vertcat(*[p[name] for name in names]))
        if isinstance(found, ca.DM):
            return [-np.inf, *found.full()[:, 0].tolist(), np.inf], columns.full().T.tolist()
        return [-np.inf, *ca.vertsplit(found), np.inf], [ca.vertsplit(row) for row in ca.horzsplit(columns)]

    return Expression(table, _table, expression, variable, names, breaks)


def _are_near(a: ArrayLike, b: ArrayLike, share: float) -> np.ndarray:
    """Which numbers differ by at most this share of their size and of 1."""
    return np.abs(np.subtract(a, b)) <= share * (1 + np.abs(b))
