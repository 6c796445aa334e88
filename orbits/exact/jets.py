"""Statements with derivatives of their equations: along the curve on which a launch moves, and at a fold."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from ..symbolic import ZERO, ExactExpression, along, exact_number, substitute, symbol, symbols
from .exact_mechanics import Column, unknown
from .statement import ExactArc, ExactStatement


def statement_of_jets(statement: ExactStatement, order: int, pace: Fraction = Fraction(1)) -> ExactStatement:
    """A statement with the derivatives up to an order of its equations along the curve on which "alpha" moves at a
    pace and the other unknowns follow it; their derivatives are unknowns too: "dname", "ddname". The equations of each
    arc are those at its end, with all derivatives, and then those at its start."""
    jets = [dict(statement.unknowns)]
    for k in range(order):
        named = {each: unknown("d" * (k + 1) + each) for each in jets[0]}
        jets.append({**named, "alpha": ZERO if k else exact_number(pace)})
    own = {jets[k][each]: jets[k + 1][each] for k in range(order) for each in jets[0] if not jets[k][each].is_number}
    arcs, last = list[ExactArc](), _EndStates((), [])
    for arc in statement.arcs:
        found, last = _jet(arc, own, order, last)
        arcs.append(found)
    names = {"d" * k + each: jets[k][each] for k in range(order + 1) for each in jets[0]}
    return ExactStatement({name: each for name, each in names.items() if not each.is_number}, tuple(arcs))


def statement_of_folds(statement: ExactStatement, parameter: ExactExpression) -> ExactStatement:
    """The statement of the folds of a statement in a parameter, stated by its symbol: F(u, a) = 0 and F_u v = 0 for a
    direction v (G. Moore, A. Spence, SIAM Journal on Numerical Analysis 17, 1980). Its unknowns are u, the entries of v
    except that of "alpha", which is 1, and the parameter a."""
    jets, folded = statement_of_jets(statement, 1), unknown(parameter.value)
    arcs = tuple(_with_parameter(arc, parameter, folded) for arc in jets.arcs)
    return ExactStatement({**jets.unknowns, parameter.value: folded}, arcs)


@dataclass(frozen=True)
class _EndStates:
    """The last states of an arc with their derivatives up to some order, and the derivatives of all but the highest of
    these as the unknowns vary, and the time of the arc with them."""

    states: tuple[ExactExpression, ...]
    changes: Column


def _jet(
    arc: ExactArc, own: Mapping[ExactExpression, ExactExpression], order: int, last: _EndStates
) -> tuple[ExactArc, _EndStates]:
    """An arc with the derivatives of its states, for unknowns with these derivatives, and the end states."""
    size = len(arc.states)
    states = [*arc.states, *(symbol(f"{'d' * k}({each.value})") for k in range(1, order + 1) for each in arc.states)]
    lower, higher = states[: order * size], states[size:]
    places, changes = [*own], [*own.values()]

    def with_derivatives(of: Column, moving: Sequence[ExactExpression], rates: Column) -> Column:
        found = list(of)
        for k in range(order):
            found += [along(each, moving, rates) for each in found[k * len(of) :]]
        return found

    rates = [with_derivatives(law, lower, higher) for law in arc.rates]
    start = with_derivatives(arc.start, [*places, *last.states[: len(last.changes)]], [*changes, *last.changes])
    longer = along(arc.duration, places, changes)
    at_end = [change + rate * longer for change, rate in zip(higher, rates[0], strict=False)]
    conditions = with_derivatives(arc.conditions, [*places, *lower], [*changes, *at_end])
    guards = [with_derivatives(law, [*places, *lower], [*changes, *higher]) for law in arc.guards]
    before = symbols("before", len(states))
    ends = _EndStates(tuple(before), substitute(at_end, dict(zip(states, before, strict=True))))
    found = replace(
        arc, states=states, rates=rates, start=start, guards=guards, conditions=conditions, before=last.states
    )
    return found, ends


def _with_parameter(arc: ExactArc, parameter: ExactExpression, folded: ExactExpression) -> ExactArc:
    """An arc of a smooth law with a parameter, whose value is an unknown, as its last state."""
    *start, duration = substitute([*arc.start, arc.duration], {parameter: folded})
    # The states of the arc before end with the parameter too.
    also = (symbol(f"{parameter.value} before"),) if arc.before else ()
    return replace(
        arc,
        states=[*arc.states, parameter],
        rates=[[*law, ZERO] for law in arc.rates],
        start=[*start, folded],
        duration=duration,
        guards=[substitute(law, {parameter: folded}) for law in arc.guards],
        conditions=substitute(arc.conditions, {parameter: folded}),
        before=(*arc.before, *also),
        weights=(),
        breaks=(),
        constants=(),
    )
