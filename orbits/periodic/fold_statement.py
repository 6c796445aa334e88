"""The statement of a fold: where two orbits of a family meet and vanish as a parameter is varied.

At a fold F(u, a) = 0 and F_u v = 0 for a direction v: one boundary-value statement on phases with twice the states, the
motion and its first variation. Shooting differentiates it as any other: the second derivatives of F are exact.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import casadi as ca

from ..errors import InputError
from ..model import Arc, Phase, Pieces, Statement


@lru_cache(maxsize=64)
def fold_statement(statement: Statement, along: str) -> Statement:
    """The boundary value problem for the folds of another statement F(u, parameter) = 0 in a parameter.

    statement : of n unknowns u, one of them "alpha", on smooth phases
    along : name of the parameter

    The unknowns are u, the parameter, and the null vector v of dF/du without its entry for "alpha", which is never zero
    at a fold and is scaled to 1. The equations are F = 0 and dF/du v = 0 (Moore and Spence 1980). Where a law has
    pieces, the rates of the variation jump at breakpoints. Raises `InputError` where these move with the parameter.
    """
    for pieces in (arc.phase.pieces for arc in statement.arcs if arc.phase.pieces):
        if along in _names_read(pieces):
            raise InputError(
                f"the breakpoints of a law move with {along}: folds and flips in {along} cannot be followed"
            )
    pairs = zip(statement.arcs, (None, *statement.arcs), strict=False)
    arcs = tuple(_doubled(arc, statement.unknowns, along, before) for arc, before in pairs)
    unknowns = (*statement.unknowns, *(f"d{name}" for name in statement.unknowns if name != "alpha"), along)
    return Statement(f"fold of the {statement.name}", unknowns, arcs, statement.durations)


@lru_cache(maxsize=64)
def _doubled_phase(phase: Phase, along: str) -> Phase:
    """A phase whose states are motion, variation and parameter."""
    n = len(phase.states)

    def field(x, p, q):
        rates = phase.field(x[:n], {**p, along: x[-1]}, q)
        return [*_with_variation(rates, x[:n], x[n : 2 * n]), 0 * x[-1]]

    states, pieces = (*phase.states, *(f"d{name}" for name in phase.states), along), phase.pieces
    if pieces:
        pieces = replace(pieces, coordinate=(*pieces.coordinate, *[0.0] * (n + 1)))
    return Phase(phase.name, states, field, pieces=pieces)


def _doubled(arc: Arc, unknowns: tuple[str, ...], along: str, before: Arc | None) -> Arc:
    """An arc whose states are motion, variation and parameter; `before` is the arc before it."""
    n = len(arc.phase.states)

    def split(u, p):
        """The statement's own unknowns by name, as a list, their direction, and the parameters with the varied one."""
        own = [u[name] for name in unknowns]
        direction = [1.0 if name == "alpha" else u[f"d{name}"] for name in unknowns]
        return dict(zip(unknowns, own, strict=True)), own, direction, {**p, along: u[along]}

    def ended(of: Arc, x, named, own, direction, p):
        """The motion at the end of an arc and its variation, as the duration varies too."""
        count, (*_, longer) = len(of.phase.states), _with_variation([of.duration(named, p)], own, direction)
        rates = of.phase.field(x[:count], p, of.phase.data(x[:count], p))
        changes = zip(x[count : 2 * count], rates, strict=True)
        return x[:count], [change + rate * longer for change, rate in changes]

    def start(u, last, p):
        named, own, direction, p = split(u, p)
        motion, moved = ended(before, last, named, own, direction, p) if before else ([], [])
        return [*_with_variation(arc.start(named, motion, p), [*own, *motion], [*direction, *moved]), u[along]]

    def conditions(u, x, p):
        named, own, direction, p = split(u, p)
        end, moved = ended(arc, x, named, own, direction, p)
        return _with_variation(arc.conditions(named, end, p), [*own, *end], [*direction, *moved])

    def guard(u, x, p, q):
        named, own, direction, p = split(u, p)
        return _with_variation(arc.guard(named, x[:n], p, q), [*own, *x[:n]], [*direction, *x[n : 2 * n]])

    doubled = _doubled_phase(arc.phase, along)
    return Arc(doubled, start, lambda u, p: arc.duration(u, {**p, along: u[along]}), conditions, guard)


def _names_read(pieces: Pieces) -> set[str]:
    """The names of the parameters that the places of pieces depend on."""

    class Symbols(dict):
        def __missing__(self, name: str) -> ca.SX:
            self[name] = ca.SX.sym(name)
            return self[name]

    read = Symbols()
    for function in (pieces.table, pieces.unit, pieces.origin):
        function(read)
    return {*read}


def _with_variation(expressions: Sequence, symbols: Sequence, direction: Sequence) -> list:
    """Expressions, and after them their derivatives in a direction of the symbols that they depend on."""
    if (values := ca.vertcat(*expressions)).numel() == 0:
        return []
    derivatives = ca.densify(ca.jacobian(values, ca.vertcat(*symbols)) @ ca.vertcat(*direction))
    return [*ca.vertsplit(values), *ca.vertsplit(derivatives)]
