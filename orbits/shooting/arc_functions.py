"""The functions at both ends of each arc of a statement."""

import casadi as ca

from ..model import Statement


def boundary_functions(statement: Statement, parameters: tuple[str, ...]) -> list[tuple[ca.Function, ca.Function]]:
    """For each arc of a statement, its start and the residuals at its ends.

    The first function is (u, end of the arc before, p) -> (start, duration). The second is (u, start, end, p, q) ->
    residuals of the guard and of the conditions.
    """
    u, p = ca.SX.sym("u", len(statement.unknowns)), ca.SX.sym("p", len(parameters))
    unknowns = dict(zip(statement.unknowns, ca.vertsplit(u), strict=True))
    values = dict(zip(parameters, ca.vertsplit(p), strict=True))
    functions, size_before = [], 0
    for arc in statement.arcs:
        size = len(arc.phase.states)
        before, x, y = ca.SX.sym("before", size_before), ca.SX.sym("x", size), ca.SX.sym("y", size)
        q = ca.SX.sym("q", arc.phase.pieces.size if arc.phase.pieces else 0)
        start = ca.vertcat(*arc.start(unknowns, ca.vertsplit(before), values))
        guard = arc.guard(unknowns, ca.vertsplit(x), values, ca.vertsplit(q))
        residuals = ca.vertcat(*guard, *arc.conditions(unknowns, ca.vertsplit(y), values))
        leaving = [ca.densify(start), ca.SX(arc.duration(unknowns, values))]
        arrival = ca.Function("arrival", [u, x, y, p, q], [ca.densify(residuals)])
        functions.append((ca.Function("departure", [u, before, p], leaving), arrival))
        size_before = size
    return functions
