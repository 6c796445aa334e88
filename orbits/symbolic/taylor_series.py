"""Taylor series of the solutions of x' = f(x, p), by recursion over the expression graph of f.

The graph is traversed once per order with the classical product, quotient and power recursions (Jorba and Zou, "A
software package for the numerical integration of ODEs by means of high-order Taylor methods", Exp. Math. 14, 2005), so
that the result grows with the square of the order, not exponentially as by repeated symbolic differentiation.
"""

from collections.abc import Callable, Sequence
from functools import cache, partial, reduce
from typing import NamedTuple

import casadi as ca

from .calls import Instruction, single_assignment

_ZERO = ca.SX(0)
# The operators of `ca.SX` first try to read their operands as NumPy arrays, which takes ten times as long as these.
_plus, _minus, _times, _over = (partial(ca.SX.binary, op) for op in (ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV))
_whole, _slice = cache(ca.SX), cache(ca.Slice)
# From this many products on, their sum takes less time as a product of columns.
_MANY = 7


def has_taylor_series(function: ca.Function) -> bool:
    """Whether every operation of the SX function has a recursion, as comparisons, switches and splines have not."""
    operations = {function.instruction_id(i) for i in range(function.n_instructions())}
    return operations <= {*_RECURSIONS, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST}


def taylor_coefficients(field: ca.Function, x: ca.SX, p: ca.SX, order: int) -> ca.SX:
    """Taylor coefficients of the solution through `x`, and of the quantities watched along it.

    `field` is an SX function (x, p) -> (x', w): the vector field (n) and watched quantities (m, may be 0).
    Returns an SX matrix (n + m, order + 1); column k holds the coefficients of t**k.
    """
    n, m = field.numel_out(0), field.numel_out(1)
    instructions = single_assignment(field)
    series = [_Series() for _ in instructions]
    state, parameters = [_Series([x[i]]) for i in range(n)], [_still(p[i]) for i in range(p.numel())]
    watched: list[list[ca.SX]] = [[] for _ in range(m)]
    for k in range(order + 1):
        outputs = _advance(instructions, series, (state, parameters), k)
        for i, row in enumerate(watched):
            row.append(outputs.get((1, i), _ZERO))
        for i, row in enumerate(state if k < order else ()):
            row.append(_times(outputs.get((0, i), _ZERO), _whole(1 / (k + 1))))
    return ca.vertcat(*[ca.horzcat(*row) for row in (*state, *watched)])


def driven_coefficients(field: ca.Function, x: ca.SX, p: ca.SX, order: int) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The coefficients of `taylor_coefficients` as base + shares @ series, with the fewest series found.

    Where x' = b + R x + Q f(x) with R R = 0, as without damping under constant gravity, the state is a motion without
    forces, which is short, and Q u + R Q w, with u' = f and w' = u: the motion of a few forces drives all states.
    """
    (rates, watched), n = field(x, p), x.numel()
    parts = separated(rates, x, p)
    linear, count, rows = parts.rates, parts.functions.numel(), n + watched.numel()
    if not 0 < 2 * count < n or (linear @ linear).nnz():
        return ca.SX(rows, order + 1), ca.SX.eye(rows), taylor_coefficients(field, x, p, order)
    # Each force is counted as its acceleration of the first state that it acts on, where it does.
    scales = parts.multiples.nz[parts.multiples.sparsity().colind()[:-1]]
    scales = ca.if_else(scales == 0, 1, scales)
    multiples = parts.multiples @ ca.diag(1 / scales)
    shares = ca.horzcat(linear @ multiples, multiples)
    z, scale, share = ca.SX.sym("z", n + 2 * count), ca.SX.sym("s", count), ca.SX.sym("q", shares.sparsity())
    functions = ca.Function("functions", [x, p], [parts.functions, watched])
    forces, watched = functions(z[:n] + share @ z[n:], p)
    moves = ca.vertcat(linear @ z[:n] + parts.constants, z[n + count :], scale * forces)
    driven = ca.Function("driven", [z, ca.vertcat(p, scale, share.nz[:])], [ca.densify(moves), watched])
    c = taylor_coefficients(driven, ca.vertcat(x, ca.SX.zeros(2 * count)), ca.vertcat(p, scales, shares.nz[:]), order)
    base = ca.vertcat(c[:n, :], ca.SX(rows - n, order + 1))
    return ca.sparsify(base), ca.diagcat(shares, ca.SX.eye(rows - n)), c[n:, :]


def composed_coefficients(function: ca.Function, rows: Sequence[Sequence[ca.SX]], p: ca.SX) -> ca.SX:
    """Taylor coefficients (K + 1,) of the SX function (x, p) -> value along x(t), whose elements have the coefficients
    `rows` (n of K + 1 each)."""
    instructions, orders, rows = single_assignment(function), len(rows[0]), [_Series(row) for row in rows]
    series, parameters = [_Series() for _ in instructions], [_still(p[i]) for i in range(p.numel())]
    found = [_advance(instructions, series, (rows, parameters), k).get((0, 0), _ZERO) for k in range(orders)]
    return ca.vertcat(*found)


def variations(field: ca.Function, varied: tuple[int, ...], columns: int, order: int) -> ca.Function:
    """Taylor series of the solution and of columns of its variational equations dx' = f_x dx + f_p dp.

    varied : the rows of dp that are arguments; the others are zero

    Returns a function from (x, p, dx (n, columns), dp (rows, columns)) to the coefficients (order + 1, n + m) of
    `taylor_coefficients`, transposed, and to those of the columns, (order + 1, n columns).

    f_x = R + Q D A, as in `Separated`: the fewer nonlinear functions of the state there are, the fewer products of
    series a column takes, for a force that pulls at two masses one instead of four.
    """
    x, p = field.sx_in(0), field.sx_in(1)
    n, m = field.numel_out(0), field.numel_out(1)
    parts, extended, slopes_in, forces_in = separated_variations(field, varied)
    c = taylor_coefficients(extended, x, p, order)
    dx, dp = ca.SX.sym("dx", n, columns), ca.SX.sym("dp", len(varied), columns)
    rows = ca.vertsplit(c[n + m :, :])
    slopes = [(i, j, row) for (i, j), row in zip(slopes_in, rows, strict=False)]
    forces = [(i, j, row) for (i, j), row in zip(forces_in, rows[len(slopes) :], strict=True)]
    series, moved = [dx], [ca.SX.zeros(order, columns) for _ in range(parts.arguments.shape[0])]  # from the end back
    for k in range(order if columns else 0):
        for each, row in zip(moved, ca.vertsplit(parts.arguments @ series[k]), strict=True):
            each[order - 1 - k, :] = row
        changes = [ca.SX(1, columns)] * parts.multiples.shape[1]
        for i, j, slope in slopes:
            changes[i] = _plus(changes[i], slope[: k + 1] @ moved[j][order - 1 - k :, :])
        rise = ca.densify(parts.rates @ series[k])
        if changes:
            rise += parts.multiples @ ca.vertcat(*changes)
        for i, j, force in forces:
            rise[i, :] += force[k] * dp[j, :]
        series.append(rise * (1 / (k + 1)))
    results = ca.vertcat(*(ca.vec(each).T for each in series))
    slopes_of_columns = ca.densify(results) if columns else ca.SX(order + 1, 0)
    return ca.Function("variations", [x, p, dx, dp], [ca.densify(c[: n + m, :].T), slopes_of_columns])


def separated_variations(
    field: ca.Function, varied: tuple[int, ...]
) -> tuple["Separated", ca.Function, list[tuple[int, int]], list[tuple[int, int]]]:
    """The separated rates of a field; a function (x, p) -> (x', watched quantities, then the slopes D and the nonzero
    derivatives by the parameters `varied`, one after the other); and the places (row, column) of both."""
    x, p = field.sx_in(0), field.sx_in(1)
    rates, watched = field(x, p)
    parts, by_parameters = separated(rates, x, p), ca.jacobian(rates, p)[:, list(varied)]
    extended = ca.cse([rates, ca.vertcat(watched, *(ca.vec(each.nz[:]) for each in (parts.slopes, by_parameters)))])
    slopes, forces = (list(zip(*each.sparsity().get_triplet(), strict=True)) for each in (parts.slopes, by_parameters))
    return parts, ca.Function("variations", [x, p], extended), slopes, forces


def tangent(field: ca.Function, varied: tuple[int, ...], order: int) -> ca.Function:
    """The function of `variations` for one column, by automatic differentiation: it then takes half the operations."""
    x, p = field.sx_in(0), field.sx_in(1)
    dx, dp, moves = ca.SX.sym("dx", x.numel()), ca.SX.sym("dp", len(varied)), ca.SX(p.numel(), 1)
    moves[list(varied)] = dp
    c = ca.densify(taylor_coefficients(field, x, p, order).T)
    slopes = ca.jtimes(ca.vec(c[:, : x.numel()]), ca.vertcat(x, p), ca.vertcat(dx, moves))
    return ca.Function("tangent", [x, p, dx, dp], [c, ca.densify(ca.reshape(slopes, order + 1, x.numel()))])


class Separated(NamedTuple):
    """Rates R x + b + Q f(A x) that are affine in the state and in nonlinear functions f of a few affine ones of it,
    with their derivative R + Q D A. All but the slopes D, and f, are functions of the parameters alone."""

    constants: ca.SX  # b (n,)
    functions: ca.SX  # f (functions,)
    rates: ca.SX  # R (n, n)
    multiples: ca.SX  # Q (n, functions)
    slopes: ca.SX  # D (functions, arguments)
    arguments: ca.SX  # A (arguments, n)


def separated(rates: ca.SX, x: ca.SX, p: ca.SX) -> Separated:
    """Rates (n,) and their derivative by the state, separated.

    A sum, or a multiple by a factor without the state, is taken apart; a sum of nonlinear functions of one
    argument is one function.
    """
    instructions = single_assignment(ca.Function("rates", [x, p], [ca.densify(rates)]))
    values, degrees = list[ca.SX](), list[int]()  # 0 without the state, 1 for an affine function of it, 2 for others
    arguments: list[set[int]] = []  # of nonlinear functions, the instructions that give their affine arguments
    for op, inputs, constant in instructions:
        value, degree = ca.SX() if constant is None else ca.SX(constant), 0
        if op == ca.OP_INPUT:
            value, degree = (x, p)[inputs[0]][inputs[1]], 1 - inputs[0]
        elif op != ca.OP_OUTPUT and constant is None:
            value, degree = applied(op, [values[i] for i in inputs]), affine_degree(op, [degrees[i] for i in inputs])
        own = (arguments[i] if degrees[i] == 2 else {i} for i in (inputs if degree == 2 else ()) if degrees[i])
        values.append(value)
        degrees.append(degree)
        arguments.append(set[int]().union(*own))
    symbols: dict[int, ca.SX] = {}  # of the affine arguments, by instruction
    functions: dict[int, ca.SX] = {}  # symbols of the nonlinear functions, by instruction

    def affine(i: int) -> ca.SX:
        """The result of an instruction as an affine function of the state and of `functions`."""
        op, inputs, _ = instructions[i]
        varying = [j for j in inputs if degrees[j]] if degrees[i] else []
        if degrees[i] < 2:
            return values[i]
        linear = affine_degree(op, [min(degrees[j], 1) for j in inputs]) == 1
        if linear and (len(varying) == 1 or len(arguments[i]) > 1):
            return applied(op, [affine(j) for j in inputs])
        return functions.setdefault(i, ca.SX.sym("f"))

    def nonlinear(i: int) -> ca.SX:
        """The result of an instruction as a function of the `symbols`."""
        if degrees[i] < 2:
            return symbols.setdefault(i, ca.SX.sym("s")) if degrees[i] else values[i]
        op, inputs, _ = instructions[i]
        return applied(op, [nonlinear(j) for j in inputs])

    sums = ca.SX(rates.numel(), 1)
    for op, inputs, _ in instructions:
        if op == ca.OP_OUTPUT:
            sums[inputs[2]] = affine(inputs[0])
    # A column of none of them is a number to CasADi.
    found, names = (ca.SX(ca.vertcat(*each)) for each in ([nonlinear(i) for i in functions], functions.values()))
    s, at = (ca.SX(ca.vertcat(*each)) for each in (symbols.values(), [values[i] for i in symbols]))
    slopes = ca.substitute(ca.jacobian(found, s), s, at)
    names, forces = ca.vertcat(*functions.values()), ca.vertcat(*(values[i] for i in functions))
    constants = ca.substitute(sums, ca.vertcat(x, names), ca.SX.zeros(x.numel() + names.numel()))
    return Separated(
        constants, ca.SX(forces), ca.jacobian(sums, x), ca.jacobian(sums, names), slopes, ca.jacobian(at, x)
    )


def applied(op: int, inputs: Sequence[ca.SX]) -> ca.SX:
    """The result of an operation of CasADi."""
    return ca.SX.unary(op, inputs[0]) if len(inputs) == 1 else ca.SX.binary(op, *inputs)


def affine_degree(op: int, degrees: Sequence[int]) -> int:
    """The degree of an operation's result as a function of the state, 2 for whatever is not affine."""
    if not any(degrees):
        return 0
    if op in (ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE, ca.OP_ASSIGN):
        return max(degrees)
    by_constant = (op == ca.OP_MUL and 0 in degrees) or (op == ca.OP_DIV and degrees[1] == 0)
    return max(degrees) if by_constant else 2


class _Coefficients(list):
    """The coefficients found so far of a series. For sums of many products they are stored in columns too, one of them
    from its end backwards, which CasADi multiplies without a call for each coefficient."""

    def __init__(self, coefficients: Sequence[ca.SX] = ()):
        super().__init__(coefficients)
        self._columns = ca.SX(0, 1), ca.SX(0, 1)
        self._stored = 0

    def column(self, low: int, high: int) -> ca.SX:
        """The coefficients from `low` to `high`."""
        return self._up_to(high)[0].get_nz(False, _slice(low, high + 1))

    def column_back(self, high: int, low: int) -> ca.SX:
        """The coefficients from `high` down to `low`."""
        column = self._up_to(high)[1]
        end = column.numel()
        return column.get_nz(False, _slice(end - 1 - high, end - low))

    def _up_to(self, high: int) -> tuple[ca.SX, ca.SX]:
        """Both columns, with the coefficients up to one."""
        if high >= (room := self._columns[0].numel()):
            self._columns, self._stored = (ca.SX.zeros(2 * room or 32), ca.SX.zeros(2 * room or 32)), 0
            return self._up_to(high)
        for k in range(self._stored, high + 1):
            self._columns[0].set_nz(self[k], False, _slice(k, k + 1))
            self._columns[1].set_nz(self[k], False, _slice(room - 1 - k, room - k))
        self._stored = max(self._stored, high + 1)
        return self._columns


class _Series(_Coefficients):
    """The coefficients found so far of one result, with the other series that its recursion needs."""

    def __init__(self, coefficients: Sequence[ca.SX] = (), still: bool = False):
        super().__init__(coefficients)
        self.still = still  # whether it does not change with time
        self.slopes = _Coefficients()  # the multiples j a[j] found so far, stored because many sums use them
        self.partner = _Coefficients()  # the series of a second function that it needs, as the cosine beside the sine
        self.inner: list[_Series] = []  # the series of the instructions of a composed operation


def _advance(instructions, series: list[_Series], inputs: Sequence, k: int) -> dict[tuple[int, int], ca.SX]:
    """Append coefficient k of every instruction to its series; returns those of the outputs by (output, element)."""
    outputs = {}
    for (op, arguments, constant), out in zip(instructions, series, strict=True):
        if op == ca.OP_OUTPUT:
            source, which, element = arguments
            outputs[which, element] = series[source][k]
            continue
        taken = [inputs[arguments[0]][arguments[1]]] if op == ca.OP_INPUT else [series[i] for i in arguments]
        if k == 0:
            out.still = all(isinstance(each, _Series) and each.still for each in taken)
        if k and out.still:
            out.append(_ZERO)
        elif op == ca.OP_INPUT:
            out.append(taken[0][k])
        elif constant is not None:
            out.append(ca.SX(constant))
        else:
            out.append(_RECURSIONS[op](taken[0], taken[-1], out, k))
    return outputs


def _still(value: ca.SX) -> _Series:
    """The series of a value that does not change with time."""
    return _Series([value], still=True)


def _convolve(a: _Coefficients, b: _Coefficients, low: int, high: int, k: int) -> ca.SX:
    """Sum of a[j] b[k-j] for low <= j <= high, in this order."""
    if high - low + 1 >= _MANY:
        return ca.dot(a.column(low, high), b.column_back(k - low, k - high))
    pairs = [(a[j], b[k - j]) for j in range(low, high + 1)]
    terms = [_times(x, y) for x, y in pairs if x is not _ZERO and y is not _ZERO]
    return reduce(_plus, terms) if terms else _ZERO


def _weighted(a: _Series, b, k: int) -> ca.SX:
    """Sum of j/k a[j] b[k-j] for 1 <= j <= k: the recursion of every function whose derivative is elementary."""
    a.slopes += [_times(_whole(j), a[j]) for j in range(len(a.slopes), k + 1)]
    return _times(_convolve(a.slopes, b, 1, k, k), _whole(1 / k))


# Each recursion gives coefficient k of an operation from its first argument a and its last argument b, known up to k,
# and from its own result, known up to k - 1.


def _product(a, b, out, k: int) -> ca.SX:
    if a.still or b.still:
        return _times(a[0], b[k]) if a.still else _times(a[k], b[0])
    return _convolve(a, b, 0, k, k)


def _square(a, b, out, k: int) -> ca.SX:
    products = _times(_whole(2), _convolve(a, a, 0, (k - 1) // 2, k)) if k else _ZERO
    return _plus(products, ca.SX.unary(ca.OP_SQ, a[k // 2])) if k % 2 == 0 else products


def _power(a, b, out, k: int) -> ca.SX:
    if k == 0:
        return a[0] ** b[0]
    if not all(c.is_zero() for c in b[1:]):
        return _compose(_VARIABLE_POWER, (a, b), out, k)[0, 0]
    terms, raised = [j for j in range(1, k + 1) if not a[j].is_zero()], _plus(b[0], _whole(1))
    weights = (_minus(_over(_times(raised, _whole(j)), _whole(k)), _whole(1)) for j in terms)
    products = (_times(_times(weight, a[j]), out[k - j]) for weight, j in zip(weights, terms, strict=True))
    return _over(reduce(_plus, products, _ZERO), a[0])


def _with_partner(function: Callable, partner: Callable, signs: tuple[int, int], a, b, out, k: int) -> ca.SX:
    """Functions that are each other's derivatives up to `signs`, as sine and cosine are."""
    if k == 0:
        out.partner.append(partner(a[0]))
        return function(a[0])
    value, beside = _weighted(a, out.partner, k), _weighted(a, out, k)
    out.partner.append(beside if signs[1] > 0 else -beside)
    return value if signs[0] > 0 else -value


def _tangent(function: Callable, sign: int, a, b, out, k: int) -> ca.SX:
    """t = tan a or tanh a from t' = (1 + t**2) a' or (1 - t**2) a'."""
    if k == 0:
        return function(a[0])
    square = _convolve(out, out, 0, k - 1, k - 1)
    out.partner.append((k == 1) + (square if sign > 0 else -square))
    return _weighted(a, out.partner, k)


def _integral(function: Callable, derivative: list[Instruction], a, b, out, k: int) -> ca.SX:
    """A function whose derivative is algebraic: its coefficients follow those of the derivative, one order behind."""
    if k == 0:
        return function(a[0])
    _compose(derivative, (a,), out, k - 1)
    return _weighted(a, out.inner[derivative[-1][1][0]], k)


def _compose(instructions, arguments: tuple, out: _Series, k: int) -> dict[tuple[int, int], ca.SX]:
    """Coefficient k of a function made of `instructions`, after those of lower order that are still missing."""
    out.inner = out.inner or [_Series() for _ in instructions]
    for i in range(len(out.inner[0]), k + 1):
        outputs = _advance(instructions, out.inner, [[argument] for argument in arguments], i)
    return outputs


def _instructions(function: Callable, count: int) -> list[Instruction]:
    symbols = [ca.SX.sym("a") for _ in range(count)]
    return single_assignment(ca.Function("f", symbols, [function(*symbols)]))


_VARIABLE_POWER = _instructions(lambda a, b: ca.exp(b * ca.log(a)), 2)
_RECURSIONS: dict[int, Callable[..., ca.SX]] = {
    ca.OP_ASSIGN: lambda a, b, out, k: a[k],
    ca.OP_ADD: lambda a, b, out, k: _plus(a[k], b[k]),
    ca.OP_SUB: lambda a, b, out, k: _minus(a[k], b[k]),
    ca.OP_NEG: lambda a, b, out, k: ca.SX.unary(ca.OP_NEG, a[k]),
    ca.OP_TWICE: lambda a, b, out, k: _plus(a[k], a[k]),
    ca.OP_MUL: _product,
    ca.OP_SQ: _square,
    ca.OP_DIV: lambda a, b, out, k: _over(a[k] if b.still else _minus(a[k], _convolve(b, out, 1, k, k)), b[0]),
    ca.OP_INV: lambda a, b, out, k: _over(-_convolve(a, out, 1, k, k) if k else _whole(1), a[0]),
    ca.OP_SQRT: lambda a, b, out, k: (a[k] - _convolve(out, out, 1, k - 1, k)) / (2 * out[0]) if k else ca.sqrt(a[0]),
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_EXP: lambda a, b, out, k: _weighted(a, out, k) if k else ca.exp(a[0]),
    ca.OP_EXPM1: lambda a, b, out, k: _weighted(a, out, k) + a[k] if k else ca.expm1(a[0]),
    ca.OP_SIN: partial(_with_partner, ca.sin, ca.cos, (1, -1)),
    ca.OP_COS: partial(_with_partner, ca.cos, ca.sin, (-1, 1)),
    ca.OP_SINH: partial(_with_partner, ca.sinh, ca.cosh, (1, 1)),
    ca.OP_COSH: partial(_with_partner, ca.cosh, ca.sinh, (1, 1)),
    ca.OP_TAN: partial(_tangent, ca.tan, 1),
    ca.OP_TANH: partial(_tangent, ca.tanh, -1),
}
for _name in ("log", "log1p", "asin", "acos", "atan", "asinh", "acosh", "atanh", "erf"):
    _function = getattr(ca, _name)
    _slope = _instructions(lambda a, f=_function: ca.jacobian(f(a), a), 1)
    _RECURSIONS[getattr(ca, f"OP_{_name.upper()}")] = partial(_integral, _function, _slope)
