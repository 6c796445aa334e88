"""Verifies a saved proof from its statement alone: a second program, with another method than the one that proved it.

It reads the formulas of the stated machine, derives Lagrange's equations from them, and follows the motions by Taylor
series in Arb's balls with direct bounds: a box B that holds the motion over a step by Picard's inclusion
X + [0, h] f(B) in B, the Taylor coefficients from the box X at its start, and the next one over B as remainder.
Derivatives by the start are carried along as dual numbers; after several steps they are P (1 + E) with a rounded matrix
P and a small E, so that the errors of the steps add and do not multiply. Existence and uniqueness follow from
Krawczyk's test, on the stated enclosures and on these with the radius of uniqueness around them. Signs along the motion
are those of functions, and of their derivatives in time, on parts of steps.

Nothing of `orbits.proof` and nothing of CasADi is used: python-flint and the standard library alone.
"""

import ast
import re
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise, product
from typing import Any

from flint import arb, arb_mat, arb_series, ctx, fmpq

# The order of the Taylor polynomials per bit, halvings of parts of steps, and of intervals of parameters.
ORDER_PER_BIT, MOST_HALVINGS, MOST_SPLITS = 0.3, 16, 3
# What the remainder may be in a derivative.
COARSE = Fraction(1, 2**36)
# Bits beside those of the enclosures, bits for uniqueness, and the shortest step as a share of a phase.
GUARD_BITS, BITS_OF_UNIQUENESS, SHORTEST = 64, 90, Fraction(1, 2**14)
TOKEN = re.compile(
    r"\s*(?:(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)|([A-Za-z_]\w*)|(\*\*|[-+*/()]))", re.ASCII
)
# ("number", Fraction), ("name", text), (function, tree), or (operator, tree, tree).
Tree = tuple
ZERO, ONE, LESS = (("number", Fraction(value)) for value in (0, 1, -1))
OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}


class Unverified(Exception):
    """What cannot be verified, in words."""


def parse(text: str) -> Tree:
    """The tree of a formula; its numerals are the decimals that are written."""
    words, numbers, place = list[str](), list[Fraction](), 0
    while text[place:].strip():
        if not (found := TOKEN.match(text, place)):
            raise Unverified(f"the formula '{text[:60]}' cannot be read")
        if found[1]:
            numbers.append(Fraction(found[1]))
        words.append(f"number_({len(numbers) - 1})" if found[1] else f"{found[2]}_" if found[2] else found[3])
        place = found.end()

    def tree_of(node: ast.AST) -> Tree:
        match node:
            case ast.Call(func=ast.Name(id="number_"), args=[ast.Constant(value=int(i))]):
                return ("number", numbers[i])
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]):
                return (name[:-1], tree_of(argument))
            case ast.Name(id=name):
                return ("name", name[:-1])
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return ("*", LESS, tree_of(operand))
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return tree_of(operand)
            case ast.BinOp(left=left, op=op, right=right):
                return (OPERATORS[type(op)], tree_of(left), tree_of(right))
        raise Unverified(f"the formula '{text[:60]}' cannot be read")

    try:
        return tree_of(ast.parse(" ".join(words), mode="eval").body)
    except SyntaxError:
        raise Unverified(f"the formula '{text[:60]}' cannot be read") from None


@lru_cache(maxsize=100_000)
def slope(tree: Tree, name: str) -> Tree:
    """The derivative of a tree by a name, without what is multiplied by 0."""
    kind = tree[0]
    if kind in ("number", "name"):
        return ONE if tree == ("name", name) else ZERO
    a, da = tree[1], slope(tree[1], name)
    if len(tree) == 2:
        if kind not in FUNCTIONS:
            raise Unverified(f"a formula has {kind}, which is not smooth everywhere or not known")
        return times(FUNCTIONS[kind][1](a, tree), da)
    b, db = tree[2], slope(tree[2], name)
    if kind in ("+", "-"):
        return plus(da, db if kind == "+" else times(LESS, db))
    if kind == "*":
        return plus(times(da, b), times(a, db))
    if kind == "/":
        return plus(("/", da, b) if da != ZERO else ZERO, times(("/", ("*", LESS, tree), b), db))
    lowered = times(("*", b, ("**", a, ("-", b, ONE))), da)
    return plus(lowered, ZERO if db == ZERO else times(("*", tree, ("log", a)), db))


def plus(a: Tree, b: Tree) -> Tree:
    """A sum, without 0."""
    return b if a == ZERO else a if b == ZERO else ("+", a, b)


def times(a: Tree, b: Tree) -> Tree:
    """A product, without 0 and 1."""
    if ZERO in (a, b):
        return ZERO
    return b if a == ONE else a if b == ONE else ("*", a, b)


def replaced(tree: Tree, names: Mapping[str, Tree]) -> Tree:
    """A tree with others in the place of names."""
    if tree[0] == "name":
        return names.get(tree[1], tree)
    return tree if tree[0] == "number" else (tree[0], *(replaced(part, names) for part in tree[1:]))


def constant(tree: Tree) -> Fraction | None:
    """The rational number that a tree of numbers is, None for another tree."""
    if tree[0] == "number":
        return tree[1]
    a, b = (constant(part) for part in tree[1:]) if len(tree) == 3 else (None, None)
    if a is None or b is None or (tree[0] == "/" and not b):
        return None
    if tree[0] == "**":
        return a ** int(b) if b.denominator == 1 and abs(b) <= 64 and (a or b >= 0) else None
    return {"+": a + b, "-": a - b, "*": a * b, "/": a / (b or 1)}[tree[0]]


def folded(tree: Tree) -> Tree:
    """A tree whose parts that are rational numbers are written as such."""
    if (value := constant(tree)) is not None:
        return ("number", value)
    return tree if len(tree) == 2 and tree[0] == "name" else (tree[0], *(folded(part) for part in tree[1:]))


def divided(of: Callable) -> Callable:
    """The derivative of a function, 1 over the tree `of` its argument."""
    return lambda a, f: ("/", ONE, of(a))


def _square(a: Tree, sign: Tree, first: Tree = ONE) -> Tree:
    return ("+", first, ("*", sign, ("*", a, a)))


# Of each function: its value of a ball or a series, its derivative as a tree, and what has to be positive for it.
FUNCTIONS: dict[str, tuple[Callable, Callable, Callable]] = {
    "exp": (lambda v: v.exp(), lambda a, f: f, lambda v: []),
    "expm1": (lambda v: v.exp() - 1, lambda a, f: ("exp", a), lambda v: []),
    "log": (lambda v: v.log(), divided(lambda a: a), lambda v: [v]),
    "log1p": (lambda v: (1 + v).log(), divided(lambda a: ("+", ONE, a)), lambda v: [1 + v]),
    "sqrt": (lambda v: v.sqrt(), lambda a, f: ("/", ("number", Fraction(1, 2)), f), lambda v: [v]),
    "sin": (lambda v: v.sin(), lambda a, f: ("cos", a), lambda v: []),
    "cos": (lambda v: v.cos(), lambda a, f: ("*", LESS, ("sin", a)), lambda v: []),
    "tan": (lambda v: v.sin() / v.cos(), lambda a, f: _square(f, ONE), lambda v: [v.cos() * v.cos()]),
    "sinh": (lambda v: (v.exp() - (-v).exp()) / 2, lambda a, f: ("cosh", a), lambda v: []),
    "cosh": (lambda v: (v.exp() + (-v).exp()) / 2, lambda a, f: ("sinh", a), lambda v: []),
    "tanh": (lambda v: 1 - 2 / ((2 * v).exp() + 1), lambda a, f: _square(f, LESS), lambda v: []),
    "asin": (lambda v: v.asin(), divided(lambda a: ("sqrt", _square(a, LESS))), lambda v: [1 + v, 1 - v]),
    "acos": (
        lambda v: v.acos(), lambda a, f: ("/", LESS, ("sqrt", _square(a, LESS))), lambda v: [1 + v, 1 - v],
    ),
    "atan": (lambda v: v.atan(), divided(lambda a: _square(a, ONE)), lambda v: []),
    "asinh": (lambda v: (v + (v * v + 1).sqrt()).log(), divided(lambda a: ("sqrt", _square(a, ONE))), lambda v: []),
    "acosh": (
        lambda v: (v + (v * v - 1).sqrt()).log(), divided(lambda a: ("sqrt", _square(a, ONE, LESS))), lambda v: [v - 1],
    ),
    "atanh": (lambda v: ((1 + v) / (1 - v)).log() / 2, divided(lambda a: _square(a, LESS)), lambda v: [1 + v, 1 - v]),
}  # fmt: skip
SLOPES = {name: folded(outer(("name", "x"), ("name", "f"))) for name, (_, outer, _) in FUNCTIONS.items()}


class Dual:
    """A value with its derivatives by some variables, balls or power series of balls."""

    __slots__ = ("d", "v")

    def __init__(self, v: Any, d: Sequence[Any]):
        self.v, self.d = v, d

    def __add__(self, other: "Dual") -> "Dual":
        return Dual(self.v + other.v, [a + b for a, b in zip(self.d, other.d, strict=True)])

    def __sub__(self, other: "Dual") -> "Dual":
        return Dual(self.v - other.v, [a - b for a, b in zip(self.d, other.d, strict=True)])

    def __mul__(self, other: "Dual") -> "Dual":
        pairs = zip(self.d, other.d, strict=True)
        return Dual(self.v * other.v, [a * other.v + self.v * b for a, b in pairs])

    def __truediv__(self, other: "Dual") -> "Dual":
        value = self.v / other.v
        return Dual(value, [(a - value * b) / other.v for a, b in zip(self.d, other.d, strict=True)])


def need(what: str, value: Any, positive: bool = True) -> None:
    """Raise `Unverified` where a ball, or the first term of a series, is not positive, or not of one sign."""
    place = value[0] if isinstance(value, arb_series) else value
    if not (place > 0 or (not positive and place < 0)):
        raise Unverified(f"{what} is not shown to have a value all along the motion")


def ball(value: Fraction) -> arb:
    """An enclosure of a fraction."""
    return arb(fmpq(value.numerator, value.denominator))


class Values:
    """What names stand for, and the values of trees of them, each of which is computed once."""

    def __init__(self, named: Mapping[str, Dual], blank: Sequence[Any]):
        self.named, self.blank, self.known = named, blank, dict[int, Dual]()

    def of(self, tree: Tree) -> Dual:
        """The value of a tree; whatever it is made of has to have one."""
        if id(tree) not in self.known:
            self.known[id(tree)] = self._of(tree)
        return self.known[id(tree)]

    def _of(self, tree: Tree) -> Dual:
        kind = tree[0]
        if kind == "number":
            return Dual(ball(tree[1]), self.blank)
        if kind == "name":
            if tree[1] != "pi" and tree[1] not in self.named:
                raise Unverified(f"the statement does not say what '{tree[1]}' is")
            return Dual(arb.pi(), self.blank) if tree[1] == "pi" else self.named[tree[1]]
        x = self.of(tree[1])
        if len(tree) == 2:
            return self._function(kind, x)
        if kind == "**":
            return self._power(x, tree[2])
        y = self.of(tree[2])
        if kind == "/":
            need("a quotient", y.v, positive=False)
        return {"+": Dual.__add__, "-": Dual.__sub__, "*": Dual.__mul__, "/": Dual.__truediv__}[kind](x, y)

    def _function(self, name: str, x: Dual) -> Dual:
        if name not in FUNCTIONS:
            raise Unverified(f"a formula has {name}, which is not smooth everywhere or not known")
        for place in FUNCTIONS[name][2](x.v):
            need(name, place)
        value = FUNCTIONS[name][0](x.v)
        if not x.d:
            return Dual(value, [])
        outer = Values({"x": Dual(x.v, []), "f": Dual(value, [])}, []).of(SLOPES[name]).v
        return Dual(value, [outer * each for each in x.d])

    def _power(self, x: Dual, exponent: Tree) -> Dual:
        whole = constant(exponent)
        if whole is None or whole.denominator != 1:
            need("a power", x.v)
            y = self.of(exponent)
            value, log = (y.v * x.v.log()).exp(), x.v.log()
            return Dual(value, [value * (y.v / x.v * a + log * b) for a, b in zip(x.d, y.d, strict=True)])
        if whole < 0:
            need("a negative power", x.v, positive=False)
        if abs(whole) > 2**16:
            raise Unverified("a power is too large")
        found, size = Dual(repeated(x.v, abs(int(whole))), self.blank), abs(int(whole))
        if size and x.d:
            lowered = size * repeated(x.v, size - 1)
            found = Dual(found.v, [lowered * each for each in x.d])
        return found if whole >= 0 else Dual(arb(1), self.blank) / found


def repeated(x: Any, n: int) -> Any:
    """A whole power, by products."""
    result = arb(1)
    for bit in bin(n)[2:]:
        result = result * result * x if bit == "1" else result * result
    return result


class Machine:
    """The equations of a stated machine, from Lagrange's.

    names : of the coordinates; rates are named with a prime behind
    kept, embed : the numbers of the contact's coordinates, and the exact rows that make all of these
    """

    def __init__(self, stated: Mapping[str, Any], bounds: Mapping[str, tuple[Fraction, Fraction]]):
        self.names = list(stated["coordinates"])
        n = self.size = len(self.names)
        if any(spring["breaks"] for spring in stated["springs"]):
            raise Unverified("a law in pieces is not verified by this program")
        heights = [(parse(h), parse(m)) for h, m in (*stated["masses"], *stated["weights"])]
        moving = [(parse(h), parse(m)) for h, m in (*stated["masses"], *stated["inerters"])]
        gravity = ("*", parse(stated["surface_gravity"]), parse(stated["gravity"]))
        weights = [("*", m, replaced(gravity, {"z": h})) for h, m in heights]
        springs = [(parse(s["extension"]), parse(s["force"][0]), s["potential"]) for s in stated["springs"]]
        laws = [(e, slope(f, "r") if potential else f, f) for e, f, potential in springs]
        pulls = [replaced(force, {"r": e}) for e, force, _ in laws]
        potentials = [parse(each) for each in stated["potentials"]]
        rows = [[parse(entry) for entry in row] for row in stated["inertia"]] or [[ZERO] * n for _ in range(n)]
        self.check_symmetric = [(rows[i][j], rows[j][i]) for i in range(n) for j in range(i)]
        self.inertia = [list(row) for row in rows]
        for h, m in moving:
            g = [slope(h, name) for name in self.names]
            for i, j in product(range(n), repeat=2):
                self.inertia[i][j] = plus(self.inertia[i][j], times(m, times(g[i], g[j])))
        self.forces = [ZERO] * n
        along = [(w, h) for w, (h, _) in zip(weights, heights, strict=True)]
        along += [(pull, e) for pull, (e, *_) in zip(pulls, laws, strict=True)] + [(ONE, each) for each in potentials]
        for i, name in enumerate(self.names):
            for size, place in along:
                self.forces[i] = plus(self.forces[i], times(LESS, times(size, slope(place, name))))
        fixed = {name: ("number", low) for name, (low, high) in bounds.items() if low == high}
        self.turning = [folded(replaced(tree, fixed)) for tree in self._turning()]
        self.forces = [folded(replaced(tree, fixed)) for tree in self.forces]
        self.inertia = [[folded(replaced(tree, fixed)) for tree in row] for row in self.inertia]
        self.gap = self._gap(parse(stated["gap"]))
        self.counts = parse(stated["counts"])
        self.separation = parse(stated["separation"]) if stated["separation"] is not None else None
        # Whatever is stated has to have a value, also where it cancels in the equations.
        self.stated = [t for pair in (*heights, *moving) for t in pair] + weights + pulls + potentials + [self.counts]
        self.stated += [replaced(f, {"r": e}) for e, _, f in laws] + [entry for row in rows for entry in row]
        self.stated += [self.separation] if self.separation else []
        if stated["eliminated"] not in self.names or stated["launch"] not in self.names:
            raise Unverified("the statement names no coordinate that the contact eliminates or launches")
        out = self.names.index(stated["eliminated"])
        if not self.gap[out] or stated["launch"] == stated["eliminated"]:
            raise Unverified("the gap does not determine the coordinate that it is said to")
        self.kept = [i for i in range(n) if i != out]
        self.embed = [[Fraction(int(i == j)) for j in self.kept] for i in range(n)]
        self.embed[out] = [-self.gap[j] / self.gap[out] for j in self.kept]
        self.launch = self.kept.index(self.names.index(stated["launch"]))

    def _turning(self) -> list[Tree]:
        """(d(M v)/dy) v - grad(v' M v)/2, with rates named by a prime."""
        n, found = self.size, [ZERO] * self.size
        for i, j, k in product(range(n), repeat=3):
            rates = ("*", ("name", f"{self.names[j]}'"), ("name", f"{self.names[k]}'"))
            found[i] = plus(found[i], times(slope(self.inertia[i][j], self.names[k]), rates))
            half = times(("number", Fraction(-1, 2)), slope(self.inertia[j][k], self.names[i]))
            found[i] = plus(found[i], times(half, rates))
        return found

    def _gap(self, tree: Tree) -> list[Fraction]:
        weights = [constant(slope(tree, name)) for name in self.names]
        if None in weights or constant(replaced(tree, dict.fromkeys(self.names, ZERO))) != 0:
            raise Unverified("the gap is no sum of coordinates with numbers before them")
        return [each for each in weights if each is not None]

    def motion(self, x: Sequence[Dual], p: Mapping[str, Dual], contact: bool) -> tuple[list[Dual], Dual | None]:
        """The rates of the states of a phase, coordinates before rates, and in contact the contact force."""
        blank = [arb(0)] * len(x[0].d)
        half = len(x) // 2
        y, v = (self.embedded(part, blank) if contact else list(part) for part in (x[:half], x[half:]))
        values = {**p, **dict(zip(self.names, y, strict=True))}
        values |= dict(zip([f"{name}'" for name in self.names], v, strict=True))
        at = Values(values, blank)
        matrix = [[at.of(entry) for entry in row] for row in self.inertia]
        force = [at.of(q) - at.of(c) for q, c in zip(self.forces, self.turning, strict=True)]
        if not contact:
            return [*v, *solve(matrix, force)], None
        exact = [[Dual(ball(each), blank) for each in row] for row in self.embed]
        columns = range(len(self.kept))
        held = [[dot(row, [exact[k][j] for k in range(self.size)]) for j in columns] for row in matrix]
        inside = [
            [dot([exact[k][i] for k in range(self.size)], [row[j] for row in held]) for j in columns] for i in columns
        ]
        along = [dot([exact[k][i] for k in range(self.size)], force) for i in columns]
        rates = solve(inside, along)
        out = next(i for i in range(self.size) if i not in self.kept)
        carried = dot(held[out], rates) - force[out]
        return [*x[half:], *rates], carried * Dual(ball(1 / self.gap[out]), blank)

    def embedded(self, s: Sequence[Dual], blank: Sequence[Any]) -> list[Dual]:
        return [dot([Dual(ball(w), blank) for w in row], s) for row in self.embed]


def dot(a: Sequence[Dual], b: Sequence[Dual]) -> Dual:
    """The sum of products."""
    found = a[0] * b[0]
    for x, y in zip(a[1:], b[1:], strict=True):
        found = found + x * y
    return found


def solve(matrix: list[list[Dual]], right: list[Dual]) -> list[Dual]:
    """The solution of a symmetric system whose matrix is positive definite, which its pivots have to show."""
    rows, n = [[*row, b] for row, b in zip(matrix, right, strict=True)], len(right)
    for k in range(n):
        need("the inverse of the inertia", rows[k][k].v)
        for i in range(k + 1, n):
            factor = rows[i][k] / rows[k][k]
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k], strict=True)]
    found: list[Dual] = [rows[-1][-1]] * n
    for i in reversed(range(n)):
        value = rows[i][n]
        for j in range(i + 1, n):
            value = value - rows[i][j] * found[j]
        found[i] = value / rows[i][i]
    return found


class Part:
    """A step: h, the Taylor coefficients from the box at its start, the remainder's over the whole step, and its order,
    all of states and rates alone."""

    def __init__(self, h: arb, rows: list[list[arb]], rest: list[arb]):
        self.h, self.rows, self.rest = h, rows, rest

    def at(self, t: arb) -> list[arb]:
        """Enclosures of the states at a time, or at all times of a ball, within the step."""
        found = []
        for row, rest in zip(self.rows, self.rest, strict=True):
            value = rest
            for coefficient in reversed(row):
                value = value * t + coefficient
            found.append(value)
        return found


class Phase:
    """A phase of a machine whose time is scaled to run from 0 to 1; its states are followed by the half duration and by
    the places of the interval parameters, which stay. `ranges` has the middle and the half width of each parameter."""

    def __init__(self, machine: Machine, ranges: Mapping[str, tuple[Fraction, Fraction]], contact: bool):
        self.machine, self.contact = machine, contact
        self.fixed = {name: middle for name, (middle, half) in ranges.items() if not half}
        self.wide = {name: pair for name, pair in ranges.items() if pair[1]}
        self.moving = 2 * (len(machine.kept) if contact else machine.size)
        self.size = self.moving + 1 + len(self.wide)

    def parameters(self, places: Sequence[Dual]) -> dict[str, Dual]:
        """What the parameters are, of their places in their intervals."""
        blank = [arb(0)] * len(places[0].d) if places else []
        blank = blank or self.blank
        known = {name: Dual(ball(value), blank) for name, value in self.fixed.items()}
        for (name, (middle, half)), place in zip(self.wide.items(), places, strict=True):
            known[name] = Dual(ball(middle) + ball(half) * place.v, [ball(half) * each for each in place.d])
        return known

    def rates(self, x: Sequence[Dual]) -> tuple[list[Dual], Dual | None]:
        """The rates of the moving states per unit of scaled time, and the contact force."""
        self.blank = [arb(0)] * len(x[0].d)
        found, force = self.machine.motion(x[: self.moving], self.parameters(x[self.moving + 1 :]), self.contact)
        return [x[self.moving] * each for each in found], force

    def coefficients(self, x: Sequence[Dual], order: int) -> tuple[list[list[arb]], list[list[list[arb]]]]:
        """Taylor coefficients of the moving states, and of their derivatives, from these states."""
        m, still = self.moving, list(x[self.moving :])
        values, slopes = [[each.v] for each in x[:m]], [[[d] for d in each.d] for each in x[:m]]
        cap = ctx.cap
        try:
            for k in range(order):
                ctx.cap = k + 1
                series = [
                    Dual(arb_series(row, k + 1), [arb_series(each, k + 1) for each in rows])
                    for row, rows in zip(values, slopes, strict=True)
                ]
                for i, rate in enumerate(self.rates([*series, *still])[0]):
                    values[i].append(_coefficient(rate.v, k) / (k + 1))
                    for row, each in zip(slopes[i], rate.d, strict=True):
                        row.append(_coefficient(each, k) / (k + 1))
        except (ZeroDivisionError, ValueError):
            raise Unverified("the motion comes to where a law has no value") from None
        finally:
            ctx.cap = cap
        return values, slopes

    def duals(self, x: Sequence[arb], derived: bool) -> list[Dual]:
        """States as dual numbers, with derivatives by themselves or without."""
        each = range(self.size if derived else 0)
        return [Dual(value, [arb(int(i == j)) for j in each]) for i, value in enumerate(x)]

    def inclusion(self, x: Sequence[Dual], h: arb) -> list[Dual] | None:
        """States, with derivatives, that hold the motion for a time h from these: Picard's inclusion."""
        m, times, box = self.moving, arb(0).union(h), list(x)
        for _ in range(12):
            rates = self.rates(box)[0]
            new = [Dual(a.v + times * r.v, [p + times * q for p, q in zip(a.d, r.d, strict=True)])
                   for a, r in zip(x[:m], rates, strict=True)]  # fmt: skip
            if all(_inside(a, b) for a, b in zip(new, box[:m], strict=True)):
                return box
            if not all(a.v.is_finite() for a in new):
                return None
            box = [*(Dual(_wider(a.v), [_wider(d) for d in a.d]) for a in new), *x[m:]]
        return None

    def step(
        self, x: Sequence[arb], h: arb, order: int, derived: bool
    ) -> tuple[Part, list[arb], arb_mat | None] | None:
        """A step of length h from a box of states: its part, the states at its end, and their derivatives by all states
        at its start; None where h is too long."""
        start = self.duals(x, derived)
        try:
            box = self.inclusion(start, h)
        except Unverified:
            return None
        if box is None:
            return None
        values, slopes = self.coefficients(start, order - 1)
        rests, rest_slopes = self.coefficients(box, order)
        part = Part(h, values, [row[order] for row in rests])
        end = [*part.at(h), *x[self.moving :]]
        if not derived:
            return part, end, None
        rows = [
            Part(h, of_state, [row[order] for row in rests_of_state]).at(h)
            for of_state, rests_of_state in zip(slopes, rest_slopes, strict=True)
        ]
        size = h**order / ball(COARSE)
        if not all(abs(each[order]) * size < 1 for of_state in rest_slopes for each in of_state):
            return None
        still = [[arb(int(i == j)) for j in range(self.size)] for i in range(self.moving, self.size)]
        return part, end, arb_mat([*rows, *still])

    def lie(
        self, x: Sequence[arb], function: Callable[[Sequence[Dual], Mapping[str, Dual], Any], Dual], order: int
    ) -> arb:
        """A derivative by the scaled time of a function of the states, at all of these states."""
        rows, _ = self.coefficients(self.duals(x, False), order) if order else ([[v] for v in x[: self.moving]], None)
        cap = ctx.cap
        try:
            ctx.cap = order + 1
            series = [Dual(arb_series(row, order + 1) if order else row[0], []) for row in rows]
            states = [*series, *(Dual(v, []) for v in x[self.moving :])]
            force = self.rates(states)[1] if self.contact else None
            found = _coefficient(
                function(states[: self.moving], self.parameters(states[self.moving + 1 :]), force).v, order
            )
        finally:
            ctx.cap = cap
        for k in range(2, order + 1):
            found = found * k
        return found


def _coefficient(value: Any, order: int) -> arb:
    if isinstance(value, arb_series):
        return value[order] if order < value.prec else arb("nan")
    return value if order == 0 else arb(0)


def _inside(inner: Dual, outer: Dual) -> bool:
    pairs = [(inner.v, outer.v), *zip(inner.d, outer.d, strict=True)]
    return all(a.is_finite() and b.contains(a) for a, b in pairs)


def _wider(value: arb) -> arb:
    return value + arb(0, 0.1) * (value - value.mid()) + arb(0, (abs(value) + 1).abs_upper() * arb(2) ** (8 - ctx.prec))


class Passage:
    """A phase followed from the starts c + S w, of deviations w of unknowns and parameters within a box.

    parts : its steps; `first` and `centre` are the ends of the motion from c, `slopes` the derivatives of the
        second by w over the whole box, `start` the box of states at the beginning
    """

    def __init__(self, phase: Phase, centre: Sequence[arb], seeds: arb_mat, reach: arb_mat):
        self.phase, self.parts = phase, list[Part]()
        order, n = max(12, int(ORDER_PER_BIT * ctx.prec)), phase.size
        product_of, error = _unit(n), _zeros(n)
        left = Fraction(1)
        self.first, self.seeds = list(centre), seeds
        self.start = [a + d for a, d in zip(centre, _column(seeds * reach), strict=True)]
        box, length = self.start, Fraction(1, 8)
        while left:
            length = min(length, left)
            h = ball(length)
            done, alone = phase.step(box, h, order, True), phase.step(centre, h, order, False)
            small = arb(2) ** (12 - ctx.prec)
            exact = alone and all(
                d.rad() <= small * (1 + abs(d)) + 4 * c.rad() for c, d in zip(centre, alone[1], strict=True)
            )
            if not (done and alone and exact):
                if length < SHORTEST:
                    raise Unverified(
                        "the motion is not enclosed: it comes to where a law has no value, or spreads too far"
                    )
                length /= 2
                continue
            transition = done[2]
            assert transition is not None
            before, product_of = product_of, (transition.mid() * product_of).mid()
            error = product_of.inv() * (transition * before) * (_unit(n) + error) - _unit(n)
            self.parts.append(done[0])
            left, centre = left - length, alone[1]
            self.slopes = product_of * (_unit(n) + error) * seeds
            box = [a + d for a, d in zip(centre, _column(self.slopes * reach), strict=True)]
            length *= Fraction(3, 2)
        self.centre = centre

    def states(self, part: Part, t: arb) -> list[arb]:
        """All states at a time of a part, or at all times of a ball."""
        return [*part.at(t), *self.start[self.phase.moving :]]

    def positive(self, what: str, function: Callable, at_start: int = 0, at_end: int = 0) -> None:
        """See that a function is positive inside the motion; it has zeros of these orders at its ends."""
        last = len(self.parts) - 1
        for number, part in enumerate(self.parts):
            low, high = arb(0), part.h
            orders = at_start if number == 0 else 0, at_end if number == last else 0
            self._positive(what, function, part, low, high, orders, MOST_HALVINGS)

    def _positive(
        self, what: str, function: Callable, part: Part, low: arb, high: arb, orders: tuple, left: int
    ) -> None:
        x, (at_start, at_end) = self.states(part, low.union(high)), orders
        order = at_start or at_end
        sign = -1 if at_end and order % 2 else 1
        if self.phase.lie(x, function, order) * sign > 0:
            return
        if left == 0:
            raise Unverified(f"{what} is not shown")
        middle = (low + high) / 2
        self._positive(what, function, part, low, middle, (at_start, 0), left - 1)
        self._positive(what, function, part, middle, high, (0, at_end), left - 1)

    def turns(self, function: Callable) -> int:
        """How often a function turns inside the motion, at whose end it is known to turn."""
        marks = list[tuple[int, int]]()  # the sign of its rate, and where that has none the sign of the rate's rate
        for part in self.parts:
            self._mark(function, part, arb(0), part.h, marks, MOST_HALVINGS)
        if not marks[0][0]:
            at_start = self.phase.lie(self.start, function, 1)
            marks.insert(0, (int(at_start > 0) - int(at_start < 0), 0))
        if not marks[0][0] or marks[-1][0]:
            raise Unverified("the extension hangs where the motion begins or ends")
        count, sign, slopes = 0, marks[0][0], set[int]()
        for rate, bend in marks:
            slopes = slopes | {bend} if not rate else slopes
            if rate:
                count, sign, slopes = count + (rate != sign), rate, set()
            if len(slopes) > 1:
                raise Unverified("two turns of the extension are not told apart")
        return count

    def _mark(self, function: Callable, part: Part, low: arb, high: arb, marks: list, left: int) -> None:
        x = self.states(part, low.union(high))
        for order in (1, 2):
            value = self.phase.lie(x, function, order)
            if sign := int(value > 0) - int(value < 0):
                marks.append((sign, 0) if order == 1 else (0, sign))
                return
        if left == 0:
            raise Unverified("the turns of the extension are not told apart")
        middle = (low + high) / 2
        self._mark(function, part, low, middle, marks, left - 1)
        self._mark(function, part, middle, high, marks, left - 1)

    def defined(self, trees: Sequence[Tree], y_of: Callable, left: int = MOST_HALVINGS) -> None:
        """See that formulas have values all along the motion."""
        for part in self.parts:
            waiting = [(arb(0), part.h, left)]
            while waiting:
                low, high, halvings = waiting.pop()
                x = [Dual(v, []) for v in self.states(part, low.union(high))]
                self.phase.blank = []
                values = {**self.phase.parameters(x[self.phase.moving + 1 :]), **y_of(x[: self.phase.moving // 2])}
                try:
                    at = Values(values, [])
                    if not all(at.of(tree).v.is_finite() for tree in trees):
                        raise Unverified("a formula has no value on the motion")
                except Unverified:
                    if halvings == 0:
                        raise
                    middle = (low + high) / 2
                    waiting += [(low, middle, halvings - 1), (middle, high, halvings - 1)]


def _unit(n: int) -> arb_mat:
    return arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])


def _zeros(n: int) -> arb_mat:
    return arb_mat(n, n, [0] * (n * n))


def _column(matrix: arb_mat) -> list[arb]:
    return [row[0] for row in matrix.tolist()]


class Solution:
    """The equations of half an orbit on a box of unknowns, for all values of the parameters: `image` is that of the
    box by Krawczyk's operator."""

    def __init__(self, machine: Machine, ranges: Mapping, names: Sequence[str], box: Sequence[arb]):
        self.machine, self.names, self.box = machine, list(names), list(box)
        m, count = len(machine.kept), len(box)
        self.phases = [Phase(machine, ranges, False)] + (
            [Phase(machine, ranges, True)] if "contact_time" in names else []
        )
        wide = len(self.phases[0].wide)
        centre = [each.mid() for each in box]
        self.reach = arb_mat(
            count + wide, 1, [*(each - c for each, c in zip(box, centre, strict=True)), *[arb(0, 1)] * wide]
        )
        place = {name: i for i, name in enumerate(names)}
        self.s, self.v = (
            [place[kind if i == machine.launch else machine.names[k] + prime] for i, k in enumerate(machine.kept)]
            for kind, prime in (("liftoff", ""), ("alpha", "'"))
        )
        embed = [[ball(w) for w in row] for row in machine.embed]
        plain, zero = [[arb(int(i == j)) for j in range(m)] for i in range(m)], [arb(0)] * m
        rows = {
            False: [*((row, zero) for row in embed), *((zero, row) for row in embed)],
            True: [*((row, zero) for row in plain), *((zero, [-w for w in row]) for row in plain)],
        }
        self.passages = [self._passage(phase, rows[phase.contact], centre, wide) for phase in self.phases]
        lifted = self._lifted([arb(0)] * wide, centre)
        values, slopes = [lifted.v], [self._lifted([arb(0, 1)] * wide, box).d]
        for phase, passage in zip(self.phases, self.passages, strict=True):
            half = phase.moving // 2
            values += passage.centre[half : phase.moving]
            slopes += passage.slopes.tolist()[half : phase.moving]
        by_all = arb_mat([list(row) for row in slopes])
        jacobian = arb_mat([row[:count] for row in by_all.tolist()])
        try:
            inverse = jacobian.mid().inv().mid()
        except ZeroDivisionError:
            raise Unverified("the equations are singular") from None
        by_parameters = (inverse * by_all) * arb_mat(count + wide, 1, [*[arb(0)] * count, *[arb(0, 1)] * wide])
        moved = (_unit(count) - inverse * jacobian) * arb_mat(count, 1, _column(self.reach)[:count])
        moved -= inverse * arb_mat(count, 1, values) + by_parameters
        self.image = [c + d for c, d in zip(centre, _column(moved), strict=True)]
        self.moved = arb_mat(count + wide, 1, [*_column(moved), *[arb(0, 1)] * wide])

    def _passage(self, phase: Phase, rows: list, centre: list[arb], wide: int) -> Passage:
        """The motion of a phase from the launch; its duration is half the whole time."""
        last, count = self.names.index("contact_time" if phase.contact else "flight_time"), len(centre) + wide
        seeds = []
        for places, rates in rows:
            row = [arb(0)] * count
            for weights, columns in ((places, self.s), (rates, self.v)):
                for weight, j in zip(weights, columns, strict=True):
                    row[j] = weight
            seeds.append(row)
        seeds.append([arb(0.5) * int(j == last) for j in range(count)])
        seeds += [[arb(int(j == len(centre) + i)) for j in range(count)] for i in range(wide)]
        matrix = arb_mat(seeds)
        start = _column(matrix * arb_mat(count, 1, [*centre, *[arb(0)] * wide]))
        return Passage(phase, start, matrix, self.reach)

    def _lifted(self, places: Sequence[arb], box: Sequence[arb]) -> Dual:
        """The contact force at the launch, with its derivatives by the unknowns and the parameters."""
        count = len(box) + len(places)
        duals = [Dual(v, [arb(int(i == j)) for j in range(count)]) for i, v in enumerate([*box, *places])]
        phase = Phase(
            self.machine,
            {**self.phases[0].wide, **{n: (v, Fraction(0)) for n, v in self.phases[0].fixed.items()}},
            True,
        )
        blank = Dual(arb(1), [arb(0)] * count)
        force = phase.rates([*(duals[j] for j in (*self.s, *self.v)), blank, *duals[len(box) :]])[1]
        assert force is not None
        return force


def check(document: Mapping[str, Any]) -> list[str]:
    """Why a saved proof is not verified, in words; empty where all of its theorem is."""
    try:
        if document.get("format") != "persistent-orbits proof 2" or document.get("kind") != "orbit":
            return ["this program verifies proofs of orbits, saved by this version"]
        if not document.get("proved"):
            return ["the file itself says that not all is proved"]
        if document.get("attraction_radius") is not None:
            return ["the attraction of launches above alpha is not verified by this program"]
        if "loss_coefficient" in document["enclosures"]:
            return ["the loss coefficient is not verified by this program"]
        _check_parts(document)
        for part in document["parts"]:
            _check_part(document, part, part["parameters"], MOST_SPLITS)
    except Unverified as error:
        return [str(error)]
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError, RecursionError) as error:
        return [f"the file cannot be read as a proof: {type(error).__name__}: {error}"]
    return []


def _bounds(pair: Any) -> tuple[Fraction, Fraction]:
    if isinstance(pair, Mapping):
        pair = pair["low"], pair["high"]
    low, high = (Fraction(each) for each in pair)
    if low > high:
        raise Unverified("an interval has its bounds in the wrong order")
    return low, high


def _check_parts(document: Mapping[str, Any]) -> None:
    """See that the parts cover the parameters, and that what is said of all of them holds what is said of each."""
    whole = {name: _bounds(pair) for name, pair in document["machine"]["parameters"].items()}
    boxes = [{name: _bounds(pair) for name, pair in part["parameters"].items()} for part in document["parts"]]
    if any(box.keys() != whole.keys() for box in boxes):
        raise Unverified("a part has other parameters than the machine")
    edges = [sorted({*whole[n], *(e for box in boxes for e in box[n] if whole[n][0] < e < whole[n][1])}) for n in whole]
    cells = product(*(list(pairwise(each)) or [(each[0], each[0])] for each in edges))
    for cell in cells:
        named = dict(zip(whole, cell, strict=True))
        if not any(all(box[n][0] <= low and high <= box[n][1] for n, (low, high) in named.items()) for box in boxes):
            raise Unverified("the parts do not cover the intervals of the parameters")
    for name in ("alpha", "flight_time", "contact_time"):
        for part in document["parts"]:
            if name in document["enclosures"]:
                inner, outer = _bounds(part["unknowns"][name]), _bounds(document["enclosures"][name])
                if not outer[0] <= inner[0] <= inner[1] <= outer[1]:
                    raise Unverified(f"{name} of a part is not within that of the whole")


def _check_part(document: Mapping[str, Any], part: Mapping[str, Any], parameters: Mapping[str, Any], left: int) -> None:
    """See that the theorem holds for parameters within bounds, which are halved where that is not shown at once."""
    try:
        _check_box(document, part, {name: _bounds(pair) for name, pair in parameters.items()})
    except Unverified:
        bounds = {name: _bounds(pair) for name, pair in parameters.items()}
        widest = max(
            bounds,
            key=lambda n: (bounds[n][1] - bounds[n][0]) / (abs(bounds[n][1]) + abs(bounds[n][0]) or 1),
            default="",
        )
        if left == 0 or not widest or bounds[widest][0] == bounds[widest][1]:
            raise
        low, high = bounds[widest]
        for ends in ((low, (low + high) / 2), ((low + high) / 2, high)):
            _check_part(document, part, {**parameters, widest: ends}, left - 1)


def _check_box(
    document: Mapping[str, Any], part: Mapping[str, Any], bounds: Mapping[str, tuple[Fraction, Fraction]]
) -> None:
    machine = Machine(document["machine"], bounds)
    ranges = {name: ((low + high) / 2, (high - low) / 2) for name, (low, high) in bounds.items()}
    claims = {name: _bounds(pair) for name, pair in part["unknowns"].items()}
    names = [
        "liftoff",
        "alpha",
        *(machine.names[k] + p for i, k in enumerate(machine.kept) if i != machine.launch for p in ("", "'")),
    ]
    names += ["flight_time", *(["contact_time"] if "contact_time" in claims else [])]
    if claims.keys() != {*names} or ((machine.size > 2 or document["motion"]) and "contact_time" not in claims):
        raise Unverified("the theorem does not enclose the unknowns of its equations")
    narrow = min((high - low) / (abs(high) + abs(low) + Fraction(1, 10**9)) for low, high in claims.values())
    if not narrow:
        raise Unverified("an enclosure has no width")
    bits = narrow.denominator.bit_length() - narrow.numerator.bit_length()
    radius = Fraction(part["uniqueness_radius"])
    if radius <= 0:
        raise Unverified("the radius of uniqueness is not positive")
    with ctx.workprec(BITS_OF_UNIQUENESS):
        around = [ball(low - radius).union(ball(high + radius)) for low, high in (claims[name] for name in names)]
        image = Solution(machine, ranges, names, around).image
        if not all(abs(c - each.mid()) < each.rad() for c, each in zip(image, around, strict=True)):
            raise Unverified("the solution is not shown to be the only one within the radius of uniqueness")
    with ctx.workprec(max(BITS_OF_UNIQUENESS, bits + GUARD_BITS)):
        boxes = [ball(low).union(ball(high)) for low, high in (claims[name] for name in names)]
        solution = Solution(machine, ranges, names, boxes)
        for _ in range(3):  # the solution is in the image of the wider box, and so in that of what it is known to be in
            if all(each.contains(c) for c, each in zip(solution.image, boxes, strict=True)):
                break
            solution = Solution(machine, ranges, names, image)
            image = solution.image
        for name, c in zip(names, solution.image, strict=True):
            if not (ball(claims[name][0]) < c and c < ball(claims[name][1])):
                raise Unverified(f"{name} is not shown to lie in its enclosure")
            if name in ("alpha", "flight_time", "contact_time") and not c > 0:
                raise Unverified(f"{name} is not positive")
        _check_motion(document, solution)


def _check_motion(document: Mapping[str, Any], solution: Solution) -> None:
    machine, flight = solution.machine, solution.passages[0]
    n = machine.size

    def named(y: Sequence[Dual]) -> dict[str, Dual]:
        return dict(zip(machine.names, y, strict=True))

    def of(tree: Tree) -> Callable:
        return lambda x, p, force: Values({**p, **named(x[:n])}, []).of(tree)

    def held(tree: Tree) -> Callable:
        return lambda x, p, force: Values({**p, **named(machine.embedded(x[: n - 1], []))}, []).of(tree)

    flight.defined(machine.stated, named)
    for a, b in machine.check_symmetric:
        if a != b:
            raise Unverified("the stated inertia is not plainly symmetric")
    if not document["motion"]:
        return
    contact = solution.passages[1]
    contact.defined(machine.stated, lambda s: named(machine.embedded(s, [])))
    if document["family"] != flight.turns(of(machine.counts)):
        raise Unverified("the family is another one")
    expected = {"clearance", "contact_force", "contact_end", *(["separation"] if machine.separation else [])}
    if document["conditions"] != dict.fromkeys(expected, "proved"):
        raise Unverified("not all conditions of a motion are stated to be proved")
    gap = ("number", Fraction(0))
    for weight, name in zip(machine.gap, machine.names, strict=True):
        gap = plus(gap, times(("number", weight), ("name", name)))
    flight.positive("that the gap stays open in flight", of(gap), at_start=3)
    contact.positive("that the contact pushes", lambda x, p, force: force, at_start=1)
    if machine.separation:
        flight.positive("that the separation is positive in flight", of(machine.separation))
        contact.positive("that the separation is positive in contact", held(machine.separation))
    if n == 2:
        contact.positive("that the contact first rests in its middle", lambda x, p, f: Dual(-x[1].v, []), at_end=1)
    at_end = [c + d for c, d in zip(flight.centre, _column(flight.slopes * solution.moved), strict=True)]
    at_start = [c + d for c, d in zip(flight.first, _column(flight.seeds * solution.moved), strict=True)]
    for name, states in {"liftoff_extension": at_start, "mid_flight_extension": at_end}.items():
        low, high = _bounds(document["enclosures"][name])
        value = flight.phase.lie(states, of(machine.counts), 0)
        if not (ball(low) <= value and value <= ball(high)):
            raise Unverified(f"{name} is not shown to lie in its enclosure")
