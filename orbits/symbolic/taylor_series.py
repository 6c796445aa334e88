"""Taylor jets of a CasADi expression graph: the series of the solution of x' = f(x), built by recursion.

The graph of f is walked once per order with the classical product, quotient and power recursions (Jorba and Zou,
"A software package for the numerical integration of ODEs by means of high-order Taylor methods", Exp. Math. 14,
2005), so the size grows with the square of the order, not exponentially as repeated symbolic differentiation does.
"""

import casadi as ca

from .instructions import single_assignment

# Operations that have no Taylor series everywhere: comparison, absolute value, switches, splines.
_NAMES = """
    CONST INPUT OUTPUT PARAMETER ASSIGN ADD SUB MUL DIV NEG SQ TWICE INV SQRT POW CONSTPOW EXP EXPM1 LOG LOG1P
    SIN COS TAN ASIN ACOS ATAN SINH COSH TANH ASINH ACOSH ATANH
"""
SUPPORTED = frozenset(getattr(ca, f"OP_{name}") for name in _NAMES.split())


def has_taylor_series(function: ca.Function) -> bool:
    """Whether every operation of the SX function has a jet recursion."""
    return all(function.instruction_id(i) in SUPPORTED for i in range(function.n_instructions()))


def taylor_coefficients(field: ca.Function, x: ca.SX, p: ca.SX, order: int) -> ca.SX:
    """Taylor coefficients of the solution through `x` and of what is watched along it.

    `field` is an SX function (x, p) -> (x', w): the vector field (n) and watched quantities (m, may be 0).
    Returns an SX matrix (n + m, order + 1); column k holds the coefficients of t**k.
    """
    n, m = field.numel_out(0), field.numel_out(1)
    program = single_assignment(field)
    series = [_Series() for _ in program]
    state = [[x[i]] for i in range(n)]
    watched = [[] for _ in range(m)]
    zero = ca.SX(0)
    for k in range(order + 1):
        derivative = [zero] * n
        for (op, arguments, constant), out in zip(program, series, strict=True):
            if op == ca.OP_INPUT:
                which, element = arguments
                out.append(state[element][k] if which == 0 else p[element] if k == 0 else zero)
            elif op == ca.OP_OUTPUT:
                (source, which, element) = arguments
                if which == 0:
                    derivative[element] = series[source][k]
                else:
                    watched[element].append(series[source][k])
            elif op in (ca.OP_CONST, ca.OP_PARAMETER):
                out.append(ca.SX(constant) if k == 0 else zero)
            else:
                out.append(_coefficient(op, [series[a] for a in arguments], out, k))
        if k < order:
            for i in range(n):
                state[i].append(derivative[i] / (k + 1))
    rows = [ca.horzcat(*row) for row in (*state, *(row or [zero] * (order + 1) for row in watched))]
    return ca.vertcat(*rows)


def variations(field: ca.Function, varied: tuple[int, ...], order: int) -> tuple[ca.Function, ca.Function]:
    """The series of `taylor_coefficients` and, of one column after another, those of dx' = f_x dx + f_p dp.

    varied : the rows of dp that are given, the others being zero

    Returns (x, p) -> coefficients (order + 1, n + m), those of the entries of f_x and f_p; and (the latter, dx (n,), dp
    (rows,)) -> coefficients (order + 1, n).
    """
    x, p = field.sx_in(0), field.sx_in(1)
    rates, watched = field(x, p)
    n, m = rates.numel(), watched.numel()
    slopes = ca.horzcat(ca.jacobian(rates, x), ca.jacobian(rates, p)[:, list(varied)])
    known = ca.vertcat(*slopes.nonzeros())
    together = ca.Function("variations", [x, p], ca.cse([rates, ca.vertcat(watched, known)]))
    c = taylor_coefficients(together, x, p, order)
    entries = ca.sparsify(c[n + m :, :])
    series = ca.Function("series", [x, p], [ca.densify(c[: n + m, :].T), entries])

    a = ca.SX.sym("a", entries.sparsity())
    dx, dp = ca.SX.sym("dx", n), ca.SX.sym("dp", len(varied))
    moved = [[value] for value in ca.vertsplit(dx)] + [[value, *[ca.SX(0)] * order] for value in ca.vertsplit(dp)]
    places = list(zip(*slopes.sparsity().get_triplet(), strict=True))
    for k in range(order):
        rise = [ca.SX(0)] * n
        for entry, (i, j) in enumerate(places):
            rise[i] += _convolve(a[entry, :], moved[j], 0, k, k)
        for i in range(n):
            moved[i].append(rise[i] / (k + 1))
    column = ca.densify(ca.horzcat(*[ca.vertcat(*row) for row in moved[:n]]))
    return series, ca.Function("column", [a, dx, dp], [column])


class _Series(list):
    """Coefficients found so far; `aside` keeps the series a recursion carries along (cos beside sin), `slopes` the
    multiples j a[j] that it uses again and again."""

    aside = None

    def __init__(self, coefficients=()):
        super().__init__(coefficients)
        self.slopes: dict[int, ca.SX] = {}

    def slope(self, j: int) -> ca.SX:
        """j a[j], coefficient j - 1 of the derivative."""
        if j not in self.slopes:
            self.slopes[j] = j * self[j]
        return self.slopes[j]

    def constant(self) -> bool:
        return all(c.is_zero() for c in self[1:])


def _convolve(a, b, low: int, high: int, k: int) -> ca.SX:
    """Sum of a[j] b[k-j] for low <= j <= high."""
    terms = [j for j in range(low, high + 1) if not (a[j].is_zero() or b[k - j].is_zero())]
    if not terms:
        return ca.SX(0)
    return ca.dot(ca.vertcat(*[a[j] for j in terms]), ca.vertcat(*[b[k - j] for j in terms]))


def _weighted(a, b, k: int) -> ca.SX:
    """Sum of j/k a[j] b[k-j] for 1 <= j <= k: the recursion of every function whose derivative is elementary."""
    terms = [j for j in range(1, k + 1) if not (a[j].is_zero() or b[k - j].is_zero())]
    if not terms:
        return ca.SX(0)
    return ca.dot(ca.vertcat(*[a.slope(j) for j in terms]), ca.vertcat(*[b[k - j] for j in terms])) / k


def _coefficient(op: int, arguments: list, out: _Series, k: int) -> ca.SX:
    """Coefficient k of one operation from its arguments up to k and its own result up to k - 1."""
    a = arguments[0]
    b = arguments[-1]
    match op:
        case ca.OP_ASSIGN:
            return a[k]
        case ca.OP_ADD:
            return a[k] + b[k]
        case ca.OP_SUB:
            return a[k] - b[k]
        case ca.OP_NEG:
            return -a[k]
        case ca.OP_TWICE:
            return 2 * a[k]
        case ca.OP_MUL:
            return _convolve(a, b, 0, k, k)
        case ca.OP_SQ:
            half = 2 * _convolve(a, a, 0, (k - 1) // 2, k) if k else ca.SX(0)
            return half + a[k // 2] ** 2 if k % 2 == 0 else half
        case ca.OP_DIV:
            return (a[k] - _convolve(b, out, 1, k, k)) / b[0] if k else a[0] / b[0]
        case ca.OP_INV:
            return -_convolve(a, out, 1, k, k) / a[0] if k else 1 / a[0]
        case ca.OP_SQRT:
            return (a[k] - _convolve(out, out, 1, k - 1, k)) / (2 * out[0]) if k else ca.sqrt(a[0])
        case ca.OP_CONSTPOW | ca.OP_POW:
            return _power(a, b, out, k)
        case ca.OP_EXP:
            return _weighted(a, out, k) if k else ca.exp(a[0])
        case ca.OP_EXPM1:
            return _weighted(a, out, k) + a[k] if k else ca.expm1(a[0])
        case ca.OP_TAN | ca.OP_TANH:
            return _tangent(op, a, out, k)
        case ca.OP_SIN | ca.OP_COS | ca.OP_SINH | ca.OP_COSH:
            return _pair(op, a, out, k)
    return _integral(op, a, out, k)


def _power(a, b, out, k: int) -> ca.SX:
    if k == 0:
        out.aside = [_Series() for _ in _VARIABLE_POWER]
        return a[0] ** b[0]
    if not b.constant():
        for i in range(len(out.aside[0]), k):
            _advance(_VARIABLE_POWER, out.aside, (a, b), i)
        return _advance(_VARIABLE_POWER, out.aside, (a, b), k)
    terms = [j for j in range(1, k + 1) if not a[j].is_zero()]
    return sum((((b[0] + 1) * j / k - 1) * a[j] * out[k - j] for j in terms), ca.SX(0)) / a[0]


def _pair(op: int, a, out, k: int) -> ca.SX:
    """sin with cos, sinh with cosh: each is the other's derivative, up to a sign."""
    functions = (ca.sin, ca.cos) if op in (ca.OP_SIN, ca.OP_COS) else (ca.sinh, ca.cosh)
    first, second = functions if op in (ca.OP_SIN, ca.OP_SINH) else functions[::-1]
    if k == 0:
        out.aside = _Series([second(a[0])])
        return first(a[0])
    value = _weighted(a, out.aside, k)
    other = _weighted(a, out, k)
    out.aside.append(-other if op == ca.OP_SIN else other)
    return -value if op == ca.OP_COS else value


def _tangent(op: int, a, out, k: int) -> ca.SX:
    """t = tan a or tanh a from t' = (1 + t**2) a' or (1 - t**2) a'."""
    if k == 0:
        out.aside = _Series()
        return ca.tan(a[0]) if op == ca.OP_TAN else ca.tanh(a[0])
    square = _convolve(out, out, 0, k - 1, k - 1)
    out.aside.append((k == 1) + (square if op == ca.OP_TAN else -square))
    return _weighted(a, out.aside, k)


def _integral(op: int, a, out, k: int) -> ca.SX:
    """A function whose derivative is algebraic: its coefficients from those of the derivative, one order behind."""
    function, derivative = _INTEGRALS[op]
    if k == 0:
        out.aside = [_Series() for _ in derivative]
        return function(a[0])
    slope = out.aside[derivative[-1][1][0]]
    _advance(derivative, out.aside, (a,), k - 1)
    return _weighted(a, slope, k)


def _advance(program: list[tuple], series: list[_Series], inputs: tuple, k: int) -> ca.SX:
    """Coefficient k of a program with one output, its inputs known up to k; `series` holds what went before."""
    for (op, arguments, constant), out in zip(program, series, strict=True):
        if op == ca.OP_OUTPUT:
            return series[arguments[0]][k]
        if op == ca.OP_INPUT:
            out.append(inputs[arguments[0]][k])
        elif op == ca.OP_CONST:
            out.append(ca.SX(constant) if k == 0 else ca.SX(0))
        else:
            out.append(_coefficient(op, [series[a] for a in arguments], out, k))
    raise AssertionError("a program ends with its output")


def _program(function, count: int) -> list[tuple]:
    symbols = [ca.SX.sym("a") for _ in range(count)]
    return single_assignment(ca.Function("f", symbols, [function(*symbols)]))


def _integral_program(function):
    return function, _program(lambda a: ca.jacobian(function(a), a), 1)


_VARIABLE_POWER = _program(lambda a, b: ca.exp(b * ca.log(a)), 2)
_INTEGRALS = {
    ca.OP_LOG: _integral_program(ca.log),
    ca.OP_LOG1P: _integral_program(ca.log1p),
    ca.OP_ASIN: _integral_program(ca.asin),
    ca.OP_ACOS: _integral_program(ca.acos),
    ca.OP_ATAN: _integral_program(ca.atan),
    ca.OP_ASINH: _integral_program(ca.asinh),
    ca.OP_ACOSH: _integral_program(ca.acosh),
    ca.OP_ATANH: _integral_program(ca.atanh),
}
