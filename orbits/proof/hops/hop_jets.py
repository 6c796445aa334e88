"""The derivatives of hops that come back along the map, and the statement of a fixed point whose multiplier is -1.

A jet of hops has the derivatives z', z'' by alpha as further unknowns, of the derivatives of F = 0. The derivative of
the last equation is w' - 1, which is -2 where the multiplier w' is -1.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil, log2

from flint import arb, arb_mat

from ...balls import ball_of_fraction
from ...exact import ExactStatement, Unproved, statement_of_jets
from ...symbolic import ExactExpression
from .exact_hops import INJECTION, HopStatement

# The map's derivative in the last equation where the multiplier is -1.
AT_DOUBLING = -2


def doubling_statement(base: HopStatement, inject: ExactExpression) -> ExactStatement:
    """The statement of a fixed point with the multiplier -1, for an injection that is an unknown, in the units of
    rates."""
    first = statement_of_jets(base.statement, 1, base.pace)
    last = first.arcs[-1]
    *others, change = last.conditions
    arcs = (*first.arcs[:-1], replace(last, conditions=[*others, change - AT_DOUBLING * base.pace]))
    return ExactStatement({**first.unknowns, INJECTION: inject}, arcs)


@dataclass(frozen=True)
class Jet:
    """The derivatives of a jet of hops that follow those of lower order.

    unknowns : by name
    last : of the last equation
    """

    unknowns: dict[str, arb]
    last: arb


def next_jet(
    base: ExactStatement, order: int, slopes: arb_mat, values: Mapping[str, arb], pace: Fraction = Fraction(1)
) -> Jet:
    """The derivatives of the order after this one, from enclosures of the unknowns of `statement_of_jets` of a base by
    name, and of the derivatives of its equations by these unknowns, in their order; further columns are ignored.

    Raises `Unproved` where the equations are not proved to determine them."""
    names = [*statement_of_jets(base, order).unknowns]
    free = [names.index("d" * order + each) for each in base.unknowns if each != "alpha"]
    moved = {**values, "dalpha": ball_of_fraction(pace)}
    known = {i: moved[f"d{name}"] for i, name in enumerate(names) if i not in free}
    *events, last = _rows_of_order(base, order)
    table = slopes.tolist()
    changes = [sum((table[row][i] * value for i, value in known.items()), arb(0)) for row in (*events, last)]
    try:
        found = arb_mat([[table[row][i] for i in free] for row in events]).solve(
            arb_mat(len(events), 1, [-each for each in changes[:-1]])
        )
    except ZeroDivisionError:
        raise Unproved("the events of the hop are not proved to be transversal") from None
    following = {f"d{names[i]}": found[k, 0] for k, i in enumerate(free)}
    change = changes[-1] + sum((table[last][i] * following[f"d{names[i]}"] for i in free), arb(0))
    return Jet(following, change)


def pace_of(jet: Mapping[str, arb], base: ExactStatement) -> Fraction:
    """A pace of alpha, a power of 2, at which the derivatives of a jet by alpha become at most about 1: large ones next
    to small ones would shorten the steps along the motion."""
    levels = levels_of(base, 2)
    sizes = [float(abs(value.mid())) ** (1 / levels[name]) for name, value in jet.items() if levels.get(name, 0)]
    return Fraction(1, 2 ** max(0, ceil(log2(max(sizes, default=1.0) or 1.0))))


def levels_of(base: ExactStatement, order: int) -> dict[str, int]:
    """The order of each derivative of the unknowns of a base by name, up to an order."""
    return {"d" * k + name: k for k in range(order + 1) for name in base.unknowns}


def _rows_of_order(base: ExactStatement, order: int) -> list[int]:
    """The rows of the derivatives of this order of a base's equations among those of `statement_of_jets`."""
    rows, first = list[int](), 0
    for arc in base.arcs:
        for count in (len(arc.conditions), len(arc.guards[0])):
            rows += range(first + order * count, first + (order + 1) * count)
            first += (order + 1) * count
    return rows
