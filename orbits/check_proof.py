"""Verifies a saved proof from its statement alone: a second program, with another method than the one that proved it.

It reads the formulas of the stated machine (`parse`), derives Lagrange's equations from them (`Machine`, `Field`), and
follows motions by Taylor series in Arb's balls with direct bounds (`Part`): a box B that holds the motion over a step
by Picard's inclusion X + [0, h] f(B) in B, the Taylor coefficients from the box X at its start, and the next one over B
as remainder. So are the derivatives by the start; over several steps they are P (1 + E) with a rounded matrix P and a
small E (`Leg`), so that the errors of the steps add and do not multiply. By the mean value theorem the states of a set
are those of its centre and the derivatives times the deviations. Existence and uniqueness follow from Krawczyk's test
(`Solution`), on the stated enclosures and on these with the radius of uniqueness around them. Signs along the motion
are those of functions, and of their derivatives by time, on stretches of it (`stretches`).

Contact differs from flight by a force along the gap's gradient that keeps the gap's acceleration 0. A law in pieces
makes legs of a phase, in each of which one law holds. The times of the legs are further unknowns, and equations that
the extension is at the breakpoint at their ends. So each leg is smooth.

Nothing of `orbits.proof` and nothing of CasADi is used: python-flint and the standard library alone. What is verified
is what the file says in fields; its sentences in words are not read.
"""

import ast
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise, product
from typing import Any

from flint import arb, arb_mat, arb_poly, arb_series, ctx, fmpq

# The orders of Taylor polynomials per bit and of those for derivatives, halvings of stretches, and of parameters.
ORDER_PER_BIT, DERIVED_ORDER, MOST_HALVINGS, MOST_SPLITS = 0.3, 14, 16, 3
# The first and the shortest step as shares of a leg, bits beside those of the enclosures, and those for uniqueness.
FIRST, SHORTEST, GUARD_BITS, BITS_OF_UNIQUENESS = Fraction(1, 8), Fraction(1, 2**14), 64, 90
MOST_POWER = 2**16
# The derivatives of functions of x, and functions that these define.
SLOPES = {
    "exp": "exp(x)", "log": "1/x", "sqrt": "1/(2*sqrt(x))", "sin": "cos(x)", "cos": "-sin(x)", "atan": "1/(1 + x**2)",
    "asin": "1/sqrt(1 - x**2)", "asinh": "1/sqrt(1 + x**2)",
}  # fmt: skip
DEFINED = {
    "expm1": "exp(x) - 1", "log1p": "log(1 + x)", "tan": "sin(x)/cos(x)", "acos": "2*atan(1) - asin(x)",
    "sinh": "(exp(x) - exp(-x))/2", "cosh": "(exp(x) + exp(-x))/2", "tanh": "1 - 2/(exp(2*x) + 1)",
    "acosh": "log(x + sqrt(x - 1)*sqrt(x + 1))", "atanh": "log((1 + x)/(1 - x))/2",
}  # fmt: skip


class Unverified(Exception):
    """What cannot be verified, in words."""


class Tree:
    """A formula: `kind` is "number", with a Fraction as its value, "name", with a text, an operation on its parts, or
    the name of a function. Equal ones are one object, see `tree`. The operations leave out 0 + x, 0 x, 1 x, and so on:
    `parse` tells beside a formula what has to have a value."""

    def __init__(self, kind: str, parts: tuple["Tree", ...], value: Any):
        self.kind, self.parts, self.value = kind, parts, value

    def __add__(self, other: "Tree") -> "Tree":
        if self.kind == other.kind == "number":
            return number(self.value + other.value)
        return other if self.value == 0 else self if other.value == 0 else tree("+", self, other)

    def __mul__(self, other: "Tree") -> "Tree":
        if self.kind == other.kind == "number":
            return number(self.value * other.value)
        if self.value == 0 or other.value == 0:
            return ZERO
        return other if self.value == 1 else self if other.value == 1 else tree("*", self, other)

    def __sub__(self, other: "Tree") -> "Tree":
        return self + LESS * other

    def __truediv__(self, other: "Tree") -> "Tree":
        if other.kind == "number":
            return self * number(1 / other.value)
        return self if self.value == 0 else tree("/", self, other)

    def __pow__(self, other: "Tree") -> "Tree":
        if other.kind != "number" or other.value.denominator != 1:
            return tree("exp", other * tree("log", self))
        if abs(other.value) > MOST_POWER:
            raise Unverified(f"the power {other.value} is too large")
        product_of = ONE
        for bit in bin(abs(int(other.value)))[2:]:
            product_of = product_of * product_of * (self if bit == "1" else ONE)
        return product_of if other.value >= 0 else ONE / product_of


@lru_cache(maxsize=None)
def tree(kind: str, *parts: Tree, value: Any = None) -> Tree:
    """The one tree of this kind and these parts."""
    return Tree(kind, parts, value)


def number(value: Fraction | int) -> Tree:
    """The tree of a rational number."""
    return tree("number", value=Fraction(value))


def name_of(text: str) -> Tree:
    """The tree of a name."""
    return tree("name", value=text)


ZERO, ONE, LESS = map(number, (0, 1, -1))
OPERATIONS: dict[Any, Callable] = {
    "+": lambda a, b: a + b, "*": lambda a, b: a * b, "/": lambda a, b: a / b,
    ast.Add: lambda a, b: a + b, ast.Sub: lambda a, b: a - b, ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b, ast.Pow: lambda a, b: a**b,
}  # fmt: skip


def parse(text: str, names: Mapping[str, Tree], needed: list[Tree]) -> Tree:
    """The tree of a formula, with trees in the place of its names; its numerals are the decimals that are written.
    Quotients, roots and whatever else may have no value are added to `needed`, also where they cancel."""
    # An underscore ends each name, as Python's keywords are names like others.
    marked = re.sub(r"(?<![\w.])[A-Za-z_]\w*", r"\g<0>_", " ".join(text.split()), flags=re.ASCII)

    def tree_of(node: ast.AST) -> Tree:
        match node:
            case ast.Constant():
                return number(Fraction(marked[node.col_offset : node.end_col_offset].replace("_", "?")))
            case ast.Name(id=name):
                return names[name[:-1]]
            case ast.UnaryOp(op=ast.USub() | ast.UAdd() as op, operand=operand):
                return (LESS if isinstance(op, ast.USub) else ONE) * tree_of(operand)
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name[:-1] in DEFINED:
                return parse(DEFINED[name[:-1]], {"x": tree_of(argument)}, needed)
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]):
                needed.append(tree(name[:-1], tree_of(argument)) if name[:-1] in SLOPES else names[name])
                return needed[-1]
            case ast.BinOp(left=left, op=op, right=right):
                a, b = tree_of(left), tree_of(right)
                needed.append(tree("/", ONE, b) if isinstance(op, ast.Div) else a)
                needed.append(OPERATIONS[type(op)](a, b))
                return needed[-1]
        raise SyntaxError

    try:
        if not re.fullmatch(r"[\w\s.+*/()-]*", marked, re.ASCII):
            raise SyntaxError
        return tree_of(ast.parse(marked, mode="eval").body)
    except (SyntaxError, ValueError, KeyError, ZeroDivisionError) as error:
        why = f": {error} is not said or not smooth" if isinstance(error, KeyError) else ""
        raise Unverified(f"the formula '{text[:60]}' cannot be read{why}") from None


@lru_cache(maxsize=None)
def slope(of: Tree, by: str) -> Tree:
    """The derivative of a tree by a name."""
    if not of.parts:
        return ONE if of.kind == "name" and of.value == by else ZERO
    (a, da), *rest = [(part, slope(part, by)) for part in of.parts]
    if not rest:
        return parse(SLOPES[of.kind], {"x": a}, []) * da
    b, db = rest[0]
    if of.kind == "+":
        return da + db
    return da * b + a * db if of.kind == "*" else (da - of * db) / b


def dot(a: Sequence[Any], b: Sequence[Any], start: Any = ZERO) -> Any:
    """The sum of products."""
    return sum((x * y for x, y in zip(a, b, strict=True)), start)


def solved(matrix: list[list[Tree]], *right: Sequence[Tree]) -> tuple[list[Tree], list[list[Tree]]]:
    """The pivots of a symmetric matrix, which are positive where it is positive definite, and the solutions of the
    systems with these right hand sides, by elimination."""
    rows, pivots = [[*row, *(each[i] for each in right)] for i, row in enumerate(matrix)], list[Tree]()
    for k in range(len(rows)):
        pivots.append(rows[k][k])
        rows[k] = [each / pivots[k] for each in rows[k]]
        for i in range(len(rows)):
            if i != k:
                rows[i] = [a - rows[i][k] * b for a, b in zip(rows[i], rows[k], strict=True)]
    return pivots, [[row[len(rows) + j] for row in rows] for j in range(len(right))]


class Values(dict[Tree, Any]):
    """Balls, or power series of balls, that enclose trees, each computed once, where names have such values; raises
    `Unverified` where an operation has no finite one."""

    def __missing__(self, of: Tree) -> Any:
        x, *rest = [self[part] for part in of.parts] or [None]
        if of.kind == "number":
            found = ball(of.value)
        elif of.kind in OPERATIONS:
            found = OPERATIONS[of.kind](x, *rest)
        elif of.kind == "asinh" and isinstance(x, arb_series):  # which Arb has of balls alone
            by_x = Values({ONE: x})[parse(SLOPES["asinh"], {"x": ONE}, [])]
            found = (by_x * x.derivative()).integral() + x[0].asinh()
        else:
            found = getattr(x, of.kind)()
        if not coefficient(found, 0).is_finite():
            raise Unverified(f"the motion comes to where a formula has no value ({of.kind})")
        self[of] = found
        return found


def ball(value: Fraction) -> arb:
    """An enclosure of a fraction."""
    return arb(fmpq(value.numerator, value.denominator))


def coefficient(value: Any, order: int) -> arb:
    """A coefficient of a series, no number where that is cut off before, or of a constant."""
    if isinstance(value, arb_series):
        return value[order] if order < value.prec else arb("nan")
    return value if order == 0 else arb(0)


class Machine:
    """Lagrange's equations of a stated machine, with exact bounds of its parameters.

    names, states : of the n coordinates; these, their rates, the time of a leg, and parameters' places in intervals
    inertia, loads, forces : M (n, n); for each law, the forces (n,) of springs, weights and potentials, and these less
        what the rates take, which M y'' is without contact
    needed : for each law, what has to have a value
    edges : the extension less each breakpoint of its law, which changes there
    gap, weights : the gap, and those of the coordinates in it
    unknowns : the names of the places and the rates at the launch of the contact's coordinates, by their numbers
    embedded : the exact matrix (n, n - 1) from the contact's coordinates to all
    """

    def __init__(self, stated: Mapping[str, Any], bounds: Mapping[str, tuple[Fraction, Fraction]]):
        names, needed = list(stated["coordinates"]), list[Tree]()
        n, wide = len(names), {name: f"place of {name}" for name, (low, high) in bounds.items() if low < high}
        self.names, self.states = names, [*names, *(f"{name}'" for name in names), "time of the leg", *wide.values()]
        self.rates = v = [name_of(f"{name}'") for name in names]
        known = {name: number((low + high) / 2) for name, (low, high) in bounds.items()}
        known |= {p: known[p] + number((bounds[p][1] - bounds[p][0]) / 2) * name_of(wide[p]) for p in wide}
        known["pi"] = parse("4*atan(1)", {}, [])
        both = {**dict(zip(names, map(name_of, names), strict=True)), **known}
        masses, weights, inerters = (
            [(parse(size, known, needed), parse(place, both, needed)) for place, size in stated[kind]]
            for kind in ("masses", "weights", "inerters")
        )
        rows = [[parse(entry, both, needed) for entry in row] for row in stated["inertia"]] or [[ZERO] * n] * n
        if any(rows[i][j] is not rows[j][i] for i, j in product(range(n), repeat=2)):
            raise Unverified("the stated inertia is not plainly symmetric")
        twice = sum((rows[i][j] * v[i] * v[j] for i, j in product(range(n), repeat=2)), ZERO)
        twice = sum((mass * self.rate(place) * self.rate(place) for mass, place in masses + inerters), twice)
        self.energy = number(Fraction(1, 2)) * twice
        momentum = [slope(self.energy, each.value) for each in v]
        self.inertia = [[slope(each, rate.value) for rate in v] for each in momentum]
        turning = [self.rate(p) - slope(self.energy, y) for p, y in zip(momentum, names, strict=True)]
        pull = parse(stated["surface_gravity"], both, needed)
        along = [(m * pull * parse(stated["gravity"], {**both, "z": h}, needed), h) for m, h in masses + weights]
        along += [(ONE, parse(each, both, needed)) for each in stated["potentials"]]
        springs = [(each, parse(each["extension"], both, needed)) for each in stated["springs"]]
        in_pieces = [(each["breaks"], e) for each, e in springs if each["breaks"]]
        if len(in_pieces) > 1:
            raise Unverified("more than one spring has a law in pieces")
        self.edges = [e - parse(text, known, needed) for texts, e in in_pieces for text in texts]
        self.counts = parse(stated["counts"], both, needed)
        self.separation = None if stated["separation"] is None else parse(stated["separation"], both, needed)
        self.loads, self.forces, self.needed = list[list[Tree]](), list[list[Tree]](), list[list[Tree]]()
        for law in range(len(self.edges) + 1):
            own, all_along = list(needed), list(along)
            for spring, e in springs:
                found = parse(spring["force"][law if spring["breaks"] else 0], {**known, "r": e}, own)
                all_along.append((ONE, found) if spring["potential"] else (found, e))
            self.loads.append([sum((LESS * size * slope(at, y) for size, at in all_along), ZERO) for y in names])
            self.forces.append([load - c for load, c in zip(self.loads[-1], turning, strict=True)])
            self.needed.append(own)
        self.gap = parse(stated["gap"], both, needed)
        self.weights = [slope(self.gap, name) for name in names]
        at_zero = parse(stated["gap"], {**both, **dict.fromkeys(names, ZERO)}, [])
        if at_zero is not ZERO or any(each.kind != "number" for each in self.weights):
            raise Unverified("the gap is no sum of coordinates with numbers before them")
        out, launch = names.index(stated["eliminated"]), names.index(stated["launch"])
        if self.weights[out] is ZERO or launch == out:
            raise Unverified("the gap does not determine the coordinate that it is said to")
        self.unknowns = {i: (name, f"{name}'") for i, name in enumerate(names) if i != out}
        self.unknowns[launch] = "liftoff", "alpha"
        self.embedded = [[Fraction(int(i == j)) for j in self.unknowns] for i in range(n)]
        self.embedded[out] = [-self.weights[j].value / self.weights[out].value for j in self.unknowns]

    def rate(self, of: Tree) -> Tree:
        """The derivative by time of a function of the coordinates."""
        return dot([slope(of, name) for name in self.names], self.rates)


# Of each state: itself, and where they are followed its derivatives by all states at the start.
Rows = list[list[Any]]


class Field:
    """The motion of the states in a phase of a machine while one law of its spring holds, with time scaled such that a
    leg lasts from 0 to 1. The first 2 n states move, and the time of the leg and the parameters' places stay.

    mobility : the gap's acceleration by a unit force along its gradient
    force : the contact force that keeps the gap's acceleration 0
    rates, slopes : of the moving states, and their derivatives by all states
    """

    def __init__(self, machine: Machine, law: int, contact: bool):
        self.states, self.needed = [name_of(each) for each in machine.states], machine.needed[law]
        self.pivots, (free, pushed) = solved(machine.inertia, machine.forces[law], machine.weights)
        self.mobility = dot(machine.weights, pushed)
        self.force = LESS * dot(machine.weights, free) / self.mobility
        held = [a + self.force * b for a, b in zip(free, pushed, strict=True)] if contact else free
        self.rates = [name_of("time of the leg") * each for each in (*machine.rates, *held)]
        self.slopes = [self.gradient(each) for each in self.rates]

    def gradient(self, of: Tree) -> list[Tree]:
        """The derivatives of a tree by all states."""
        return [slope(of, each.value) for each in self.states]

    def along(self, of: Tree, order: int) -> Tree:
        """A derivative by the scaled time of a function of the states."""
        for _ in range(order):
            of = dot(self.gradient(of)[: len(self.rates)], self.rates)
        return of

    def values(self, x: Sequence[Any]) -> Values:
        """The values of trees at states."""
        return Values(zip(self.states, x, strict=True))

    def linear(self, end: tuple[list[arb], list[arb], arb_mat], of: Tree) -> tuple[arb, list[arb]]:
        """A function of the states at an end of a leg: its value for the centre, and its derivatives by w for all."""
        at = self.values(end[1])
        row = arb_mat([[at[each] for each in self.gradient(of)]]) * end[2]
        return self.values(end[0])[of], row.tolist()[0]

    def motion(self, rows: Rows) -> Rows:
        """The rates of the moving states, and of their derivatives."""
        at, columns = self.values([row[0] for row in rows]), list(zip(*rows, strict=True))[1:]
        found = [[at[rate]] for rate in self.rates]
        for row, slopes in zip(found, self.slopes if columns else [], strict=False):
            places = [k for k, each in enumerate(slopes) if each is not ZERO]
            row += [sum((at[slopes[k]] * each[k] for k in places), arb(0)) for each in columns]
        return found

    def taylor(self, rows: Rows, order: int) -> list[Rows]:
        """Taylor coefficients of the moving rows, one list for each entry."""
        count, cap = len(self.rates), ctx.cap
        found, still = [[[each] for each in row] for row in rows[:count]], rows[count:]
        try:
            for k in range(order):
                ctx.cap = k + 1
                moving = [[arb_series(each, k + 1) for each in row] for row in found]
                for row, rates in zip(found, self.motion([*moving, *still]), strict=True):
                    for each, rate in zip(row, rates, strict=True):
                        each.append(coefficient(rate, k) / (k + 1))
        except (ZeroDivisionError, ValueError):
            raise Unverified("the motion comes to where a formula has no value") from None
        finally:
            ctx.cap = cap
        return found

    def inclusion(self, rows: Rows, h: arb) -> Rows:
        """Rows that hold the motion for a time h from these: Picard's inclusion. All that is needed has a value there,
        and the inertia is positive definite."""
        box, times = rows, arb(0).union(h)
        for _ in range(12):
            rates = self.motion(box)
            new = [[x + times * each for x, each in zip(*both, strict=True)] for both in zip(rows, rates, strict=False)]
            pairs = [pair for both in zip(new, box, strict=False) for pair in zip(*both, strict=True)]
            if all(inner.is_finite() and outer.contains(inner) for inner, outer in pairs):
                at = self.values([row[0] for row in box])
                if all(at[each] > 0 for each in self.pivots) and all(at[each].is_finite() for each in self.needed):
                    return box
            box = [*([wider(each) for each in row] for row in new), *rows[len(new) :]]
        raise Unverified("no box holds the motion, or the inertia is not positive definite")


def wider(value: arb) -> arb:
    """A ball with more room about it, to be tried."""
    return value + arb(0, 0.1) * (value - value.mid()) + arb(0, (abs(value) + 1).abs_upper() * arb(2) ** (8 - ctx.prec))


class Part:
    """A step of length h from rows of balls: their Taylor polynomials, with the next coefficient over the whole step as
    the last; raises `Unverified` where h is too long."""

    def __init__(self, field: Field, rows: Rows, h: arb, order: int):
        self.field, self.h, self.still = field, h, rows[len(field.rates) :]
        rests = field.taylor(field.inclusion(rows, h), order)
        self.polynomials = [
            [arb_poly([*each, rest[order]]) for each, rest in zip(*both, strict=True)]
            for both in zip(field.taylor(rows, order - 1), rests, strict=True)
        ]

    def rows(self, t: arb) -> Rows:
        """Enclosures of the rows at a time within the step."""
        return [[each(t) for each in row] for row in self.polynomials] + self.still

    def states(self, t: arb) -> list[arb]:
        """Enclosures of the states at a time, or at all times of a ball, within the step."""
        return [row[0](t) for row in self.polynomials] + [row[0] for row in self.still]


def unit(n: int, columns: int) -> arb_mat:
    """The first rows of the unit matrix."""
    return arb_mat(n, columns, [int(i == j) for i in range(n) for j in range(columns)])


def moved(values: Sequence[arb], matrix: arb_mat, deviations: Sequence[arb]) -> list[arb]:
    """Values and a matrix times deviations from these."""
    return [value + dot(row, deviations, arb(0)) for value, row in zip(values, matrix.tolist(), strict=True)]


class Leg:
    """The motions of a field over the scaled times from 0 to 1, from the starts c + S w with deviations w in a box.

    parts : its steps
    start, end : at either end, enclosures of the motion from c, of all motions, and of the derivatives by w of all
    """

    def __init__(self, field: Field, centre: Sequence[arb], seeds: arb_mat, reach: Sequence[arb]):
        n, small = len(centre), arb(2) ** (12 - ctx.prec)
        one, rounded, error, slopes = unit(n, n), unit(n, n), arb_mat(n, n, [0] * n**2), seeds
        self.field, self.parts, box = field, list[Part](), moved(centre, seeds, reach)
        self.start, left, length = (list(centre), box, seeds), Fraction(1), FIRST
        while left:
            length = min(length, left)
            try:
                alone = Part(field, [[each] for each in centre], ball(length), int(ORDER_PER_BIT * ctx.prec))
                ends = alone.states(alone.h)
                if any(d.rad() > small * (1 + abs(d)) + 4 * c.rad() for c, d in zip(centre, ends, strict=True)):
                    raise Unverified("the step is too long")
                rows = [[x, *row] for x, row in zip(box, one.tolist(), strict=True)]
                part = Part(field, rows, alone.h, DERIVED_ORDER)
            except Unverified as reason:
                if length < SHORTEST:
                    raise Unverified(f"the motion is not enclosed: {reason}") from None
                length /= 2
                continue
            transition = arb_mat([row[1:] for row in part.rows(part.h)])
            before, rounded = rounded, (transition.mid() * rounded).mid()
            error = rounded.inv() * (transition * before) * (one + error) - one
            slopes, centre = rounded * (one + error) * seeds, ends
            box = moved(centre, slopes, reach)
            self.parts.append(part)
            left, length = left - length, length * Fraction(5, 4)
        self.end = list(centre), box, slopes


def stretches(parts: Sequence[Part], test: Callable[[Field, list[arb], bool, bool], Any], what: str) -> list[Any]:
    """What a test finds on stretches of a motion, one after the other, which are halved where it finds nothing. It
    takes a field, the states on a stretch, and whether that holds the beginning and the end of the motion."""
    found, last = list[Any](), len(parts) - 1
    waiting = [(each, arb(0), each.h, i == 0, i == last, MOST_HALVINGS) for i, each in enumerate(parts)][::-1]
    while waiting:
        part, low, high, begins, ends, left = waiting.pop()
        if result := test(part.field, part.states(low.union(high)), begins, ends):
            found.append(result)
        elif left:
            middle = (low + high) / 2
            waiting += [(part, middle, high, False, ends, left - 1), (part, low, middle, begins, False, left - 1)]
        else:
            raise Unverified(f"{what} is not shown")
    return found


def sign_of(value: arb) -> int:
    """The sign of a ball, 0 where it has none."""
    return int(value > 0) - int(value < 0)


def check_positive(what: str, parts: Sequence[Part], of: Tree | None, at_start: int = 0, at_end: int = 0) -> None:
    """See that a function, the contact force for None, is positive inside the motion. At the ends it is known to have
    zeros of these orders, and is positive beside them where the derivative of that order has the fitting sign."""

    def test(field: Field, x: list[arb], begins: bool, ends: bool) -> bool:
        order, sign = (at_start, 1) if begins and at_start else (at_end, (-1) ** at_end) if ends else (0, 1)
        return sign_of(field.values(x)[field.along(of or field.force, order)]) == sign

    stretches(parts, test, what)


def turns(parts: Sequence[Part], of: Tree) -> int:
    """How often a function turns inside the motion, at whose end it is known to turn. On each stretch its rate has a
    sign, or the rate's rate has: then the rate has one zero there or none, as the signs before and after tell."""

    def test(field: Field, x: list[arb], begins: bool, ends: bool) -> tuple[int, int] | None:
        at = field.values(x)
        rate = sign_of(at[field.along(of, 1)])
        bend = 0 if rate else sign_of(at[field.along(of, 2)])
        return (rate, bend) if rate or bend else None

    marks = stretches(parts, test, "how often the extension turns")
    first = parts[0].field
    before, bends = sign_of(first.values(parts[0].states(arb(0)))[first.along(of, 1)]), set[int]()
    if not before or marks[-1][0]:
        raise Unverified("the extension hangs where the motion begins or ends")
    count = 0
    for rate, bend in marks:
        bends = set() if rate else bends | {bend}
        if len(bends) > 1:
            raise Unverified("two turns of the extension are not told apart")
        count, before = count + (rate not in (0, before)), rate or before
    return count


class Solution:
    """The equations of half an orbit on a box of unknowns, for all values of the parameters, and Krawczyk's image.

    laws : of the legs of the flight, and where the contact is one of the equations, of the contact
    box, image : of the unknowns by name: the launch, the whole times of the phases, (phase, leg) for the times of the
        legs but for the last, and the parameters' places, which the image leaves
    phases : the legs of each
    passed : the extension less its breakpoint, with its derivatives, at the end of the legs that end there
    """

    def __init__(self, machine: Machine, laws: Sequence[Sequence[int]], box: Mapping[Any, arb]):
        self.machine, self.laws, self.box, self.names = machine, laws, box, list(box)
        n, count = len(machine.names), len(box) - len(machine.states[2 * len(machine.names) + 1 :])
        self.centre = [each.mid() for each in box.values()]
        self.reach = [each - c for each, c in zip(box.values(), self.centre, strict=True)]
        self.phases = [self.legs(i) for i in range(len(laws))]
        pairs = [((i, j), min(pair)) for i, own in enumerate(laws) for j, pair in enumerate(pairwise(own))]
        self.passed = {
            (i, j): self.phases[i][j].field.linear(self.phases[i][j].end, machine.edges[edge]) for (i, j), edge in pairs
        }
        launched = Field(machine, laws[0][0], True)
        self.lifted = launched.linear(self.phases[0][0].start, launched.force)
        equations = [self.lifted, *self.passed.values()]
        for legs, those in zip(self.phases, (range(n), machine.unknowns), strict=False):
            equations += [legs[-1].field.linear(legs[-1].end, machine.rates[i]) for i in those]
        by_all = arb_mat([row for _, row in equations])
        try:
            inverse = arb_mat([row[:count] for row in by_all.tolist()]).mid().inv().mid()
        except ZeroDivisionError:
            raise Unverified("the equations are singular") from None
        change = moved([arb(0)] * count, unit(count, len(box)) - inverse * by_all, self.reach)
        change = moved(change, inverse, [-value for value, _ in equations])
        self.moved = [*change, *self.reach[count:]]
        self.image = {name: c + d for name, c, d in zip(self.names, self.centre, self.moved, strict=True)}

    def row(self, weights: Mapping[Any, Fraction]) -> list[arb]:
        """A sum of unknowns by their weights."""
        return [ball(Fraction(weights.get(name, 0))) for name in self.names]

    def legs(self, phase: int) -> list[Leg]:
        """Half a phase from the launch, in contact with the rates turned; the last leg takes what is left of its time."""
        machine, found, places = self.machine, list[Leg](), self.machine.states[2 * len(self.machine.names) + 1 :]
        rows = [
            self.row(
                {pair[i]: -w if i and phase else w for w, pair in zip(each, machine.unknowns.values(), strict=True)}
            )
            for i, each in product((0, 1), machine.embedded)
        ]
        times = [{(phase, i): Fraction(1)} for i in range(len(self.laws[phase]) - 1)]
        times += [
            {
                ("flight_time", "contact_time")[phase]: Fraction(1, 2),
                **{key: Fraction(-1) for each in times for key in each},
            }
        ]
        centre = moved([arb(0)] * len(rows), arb_mat(rows), self.centre)
        for law, time in zip(self.laws[phase], times, strict=True):
            still = [self.row(time), *(self.row({place: Fraction(1)}) for place in places)]
            start = [*centre, *moved([arb(0)] * len(still), arb_mat(still), self.centre)]
            leg = Leg(Field(machine, law, bool(phase)), start, arb_mat([*rows, *still]), self.reach)
            found.append(leg)
            centre, rows = leg.end[0][: len(rows)], leg.end[2].tolist()[: len(rows)]
        return found


def check(document: Mapping[str, Any]) -> list[str]:
    """Why a saved proof is not verified, in words; empty where all of its theorem is."""
    try:
        if document.get("format") != "persistent-orbits proof 2" or document.get("kind") != "orbit":
            return ["this program verifies proofs of orbits, saved by this version"]
        if not document.get("proved"):
            return ["the file itself says that not all is proved"]
        if "loss_coefficient" in document["enclosures"]:
            return ["the loss coefficient is not verified by this program"]
        _check_cells(document)
    except Unverified as error:
        return [str(error)]
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, ArithmeticError, RecursionError) as error:
        return [f"the file cannot be read as a proof: {type(error).__name__}: {error}"]
    return []


Bounds = Mapping[str, tuple[Fraction, Fraction]]


def bounds_of(pairs: Mapping[str, Any]) -> Bounds:
    """The exact bounds of intervals by name."""
    found = {name: (Fraction(low), Fraction(high)) for name, (low, high) in pairs.items()}
    if any(low > high for low, high in found.values()):
        raise Unverified("an interval has its bounds in the wrong order")
    return found


def within(inner: Bounds, outer: Bounds) -> bool:
    """Whether intervals lie in others of the same names."""
    return all(outer[name][0] <= low and high <= outer[name][1] for name, (low, high) in inner.items())


def _check_cells(document: Mapping[str, Any]) -> None:
    """See that the theorem holds in each cell between the bounds of parts, and that each parameter is in a part."""
    whole, said = bounds_of(document["machine"]["parameters"]), bounds_of(document["enclosures"])
    parts = [(bounds_of(part["parameters"]), bounds_of(part["unknowns"]), part) for part in document["parts"]]
    for box, unknowns, _ in parts:
        same = {name: unknowns[name] for name in ("alpha", "flight_time", "contact_time") if name in unknowns}
        if box.keys() != whole.keys() or not within(same, said):
            raise Unverified("a part is one of another machine, or its unknowns are not within those of the whole")
    cuts = [sorted({edge for box in (whole, *(box for box, *_ in parts)) for edge in box[name]}) for name in whole]
    for edges in product(*(list(pairwise(each)) or [(each[0], each[0])] for each in cuts)):
        cell = dict(zip(whole, edges, strict=True))
        those = [(unknowns, part) for box, unknowns, part in parts if within(cell, box)]
        if not those and within(cell, whole):
            raise Unverified("the parts do not cover the intervals of the parameters")
        for unknowns, part in those:
            _check_halved(document, unknowns, Fraction(part["uniqueness_radius"]), cell, MOST_SPLITS)


def _check_halved(document: Mapping[str, Any], claims: Bounds, radius: Fraction, cell: Bounds, left: int) -> None:
    """See that the theorem holds for parameters in a cell, which is halved where that is not shown at once."""
    try:
        _check_motion(document, _solution(document, claims, radius, cell))
    except Unverified:
        widest = max(cell, key=lambda n: (cell[n][1] - cell[n][0]) / (abs(sum(cell[n])) or 1), default=None)
        if left == 0 or widest is None or cell[widest][0] == cell[widest][1]:
            raise
        low, high = cell[widest]
        for ends in ((low, (low + high) / 2), ((low + high) / 2, high)):
            _check_halved(document, claims, radius, {**cell, widest: ends}, left - 1)


def _solution(document: Mapping[str, Any], claims: Bounds, radius: Fraction, cell: Bounds) -> Solution:
    """The solution that is claimed within bounds, shown to exist there and to be the only one within a radius."""
    machine = Machine(document["machine"], cell)
    phases = ["flight_time", *(["contact_time"] if "contact_time" in claims else [])]
    names = [name for pair in machine.unknowns.values() for name in pair] + phases
    if claims.keys() != {*names} or ((len(machine.names) > 2 or document["motion"]) and len(phases) < 2):
        raise Unverified("the theorem does not enclose the unknowns of its equations")
    if radius <= 0 or any(claims[name][0] <= 0 for name in ("alpha", *phases)):
        raise Unverified("the radius of uniqueness, the speed of the launch or a time is not positive")
    narrow = min((high - low) / (abs(high) + abs(low) + Fraction(1, 10**9)) for low, high in claims.values())
    if not narrow:
        raise Unverified("an enclosure has no width")
    bits = narrow.denominator.bit_length() - narrow.numerator.bit_length()
    places = {name: arb(0, 1) for name in machine.states[2 * len(machine.names) + 1 :]}

    def boxes(more: Fraction) -> dict[Any, arb]:
        return {name: ball(claims[name][0] - more).union(ball(claims[name][1] + more)) for name in names}

    with ctx.workprec(BITS_OF_UNIQUENESS):
        laws = [[0] for _ in phases]
        around = {**boxes(radius), **places}
        image = Solution(machine, laws, around).image
        if not all(abs(image[n] - each.mid()) < each.rad() for n, each in around.items() if n not in places):
            raise Unverified("the solution is not shown to be the only one within the radius of uniqueness")
    with ctx.workprec(max(BITS_OF_UNIQUENESS, bits + GUARD_BITS)):
        solution = Solution(machine, laws, {**image, **boxes(Fraction(0))})
        for _ in range(3):  # the solution is in the image of what is known to hold it
            if all(box.contains(solution.image[name]) for name, box in solution.box.items()):
                break
            solution = Solution(machine, laws, image)
            image = solution.image
        for name in names:
            if not (ball(claims[name][0]) < solution.image[name] < ball(claims[name][1])):
                raise Unverified(f"{name} is not shown to lie in its enclosure")
    return solution


def _check_motion(document: Mapping[str, Any], solution: Solution) -> None:
    """See that what is said of the motion holds."""
    machine, said = solution.machine, bounds_of(document["enclosures"])
    flight, contact = ([part for leg in legs for part in leg.parts] for legs in (*solution.phases, [])[:2])
    conditions = {"clearance", "contact_force", "contact_end", *(["separation"] if machine.separation else [])}
    ends = {"liftoff_extension": solution.phases[0][0].start, "mid_flight_extension": solution.phases[0][-1].end}
    expected = {*("alpha", "flight_time", "contact_time")} & set(solution.names) | set(
        ends if document["motion"] else ()
    )
    if said.keys() != expected:
        raise Unverified("other quantities are enclosed than the theorem is about")
    if document["conditions"] != dict.fromkeys(conditions if document["motion"] else (), "proved"):
        raise Unverified("not all conditions of a motion are stated to be proved, or others are")
    if document["family"] != (turns(flight, machine.counts) if document["motion"] else None):
        raise Unverified("the family is another one")
    if not document["motion"]:
        return
    check_positive("that the gap stays open in flight", flight, machine.gap, at_start=3)
    check_positive("that the contact pushes", contact, None, at_start=1)
    if machine.separation:
        check_positive("that the separation is positive", flight, machine.separation)
        check_positive("that the separation is positive in contact", contact, machine.separation)
    if len(machine.names) == 2:
        (falling,) = (LESS * machine.rates[i] for i in machine.unknowns)
        check_positive("that the contact first rests in its middle", contact, falling, at_end=1)
    for name, end in ends.items():
        value, row = flight[0].field.linear(end, machine.counts)
        value = dot(row, solution.moved, value)
        if not (ball(said[name][0]) <= value <= ball(said[name][1])):
            raise Unverified(f"{name} is not shown to lie in its enclosure")
