"""Verifies a saved proof from its statement alone: a second program, with another method than the one that proved it.

It reads the formulas of the stated machine (`parse`), derives Lagrange's equations from them (`Machine`, `Field`), and
follows motions by Taylor series in Arb's balls with direct bounds (`Part`): a box B that holds the motion over a step
by Picard's inclusion X + [0, h] f(B) in B, the Taylor coefficients from the box X at its start, and the next one over B
as remainder. So are the derivatives by the start; over several steps they are P (1 + E) with a rounded matrix P and a
small E (`Passage`), so that the errors of the steps add and do not multiply. By the mean value theorem the states of a
set are those of its centre and the derivatives times the deviations. Existence and uniqueness follow from Krawczyk's
test (`Solution`), on the stated enclosures and on these with the radius of uniqueness around them. Signs along the
motion are those of functions, and of their derivatives by time, on stretches of it (`signs`). Where a law has pieces,
a step stays in one of them, or crosses from one to the next one in the hull of both (`Pair`). Nothing of
the prover and of CasADi is used. What is verified is what the file says in its fields, but for `about`.
"""

import ast
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import groupby, pairwise, product
from operator import add, mul, sub, truediv
from typing import Any

from flint import arb, arb_mat, arb_poly, arb_series, ctx, fmpq

# The orders of Taylor polynomials per bit and of those for derivatives, halvings of stretches, and of parameters.
ORDER_PER_BIT, DERIVED_ORDER, MOST_HALVINGS, MOST_SPLITS = 0.3, 14, 16, 3
# The first and the shortest step as shares of half a phase, and the largest whole power.
FIRST, SHORTEST, MOST_POWER = Fraction(1, 8), Fraction(1, 2**14), 2**16
# Bits beside those of the enclosures, those for uniqueness, and what a step's remainder may be in a derivative.
GUARD_BITS, BITS_OF_UNIQUENESS, COARSE = 64, 90, 2.0**-36
# The coefficients of t**3, t**4 and t**5 of a quintic on [0, 1] with a value, a slope and half a curvature at each end.
QUINTIC = (-10, -6, -3, 10, -4, 1), (15, 8, 3, -15, 7, -2), (-6, -3, -1, 6, -3, 1)
# The derivatives of functions of x, and functions that these define.
SLOPES = {"exp": "exp(x)", "log": "1/x", "sqrt": ".5/sqrt(x)", "sin": "cos(x)", "cos": "-sin(x)", "atan": "1/(1 + x*x)"}
DEFINED = {
    "asin": "atan(x/sqrt(1 - x**2))", "acos": "2*atan(1) - asin(x)", "asinh": "2*atanh(x/(1 + sqrt(1 + x**2)))",
    "expm1": "exp(x) - 1", "log1p": "log(1 + x)", "tan": "sin(x)/cos(x)",
    "sinh": "(exp(x) - exp(-x))/2", "cosh": "(exp(x) + exp(-x))/2", "tanh": "1 - 2/(exp(2*x) + 1)",
    "acosh": "log(x + sqrt(x - 1)*sqrt(x + 1))", "atanh": "log((1 + x)/(1 - x))/2",
}  # fmt: skip
Bounds = Mapping[str, tuple[Fraction, Fraction]]
PHASES, ENDS = ("flight_time", "contact_time"), ("liftoff_extension", "mid_flight_extension")
# What the file says of the machine, of a spring, of a part, and of itself; beside that it repeats what is verified.
FIELDS = [{*names.split()} for names in (
    "name units coordinates parameters masses weights inerters inertia springs potentials surface_gravity gravity gap "
    "launch counts separation eliminated", "extension force breaks potential rows",
    "parameters unknowns uniqueness_radius",
    "format kind proved statement machine about motion parts enclosures family conditions radius digits seconds",
)]  # fmt: skip


class Unverified(Exception):
    """What cannot be verified, in words."""


OPERATIONS: dict[Any, Callable] = {"+": add, "*": mul, "/": truediv}
OPERATIONS |= {ast.Add: add, ast.Sub: sub, ast.Mult: mul, ast.Div: truediv, ast.Pow: pow}


class Tree:
    """A formula: a "number", with a Fraction as its value, a "name", with a text, an operation on its parts, or a
    function. Equal ones are one object, see `tree`. Sums and products leave out 0 and 1."""

    def __init__(self, kind: str, parts: tuple["Tree", ...], value: Any):
        self.kind, self.parts, self.value = kind, parts, value

    def __add__(self, other: "Tree") -> "Tree":
        return other if self is ZERO else self if other is ZERO else tree("+", self, other)

    def __sub__(self, other: "Tree") -> "Tree":
        return self + LESS * other

    def __mul__(self, other: "Tree") -> "Tree":
        if ZERO in (self, other):
            return ZERO
        return other if self is ONE else self if other is ONE else tree("*", self, other)

    def __truediv__(self, other: "Tree") -> "Tree":
        return self if self is ZERO or other is ONE else tree("/", self, other)

    def __pow__(self, other: "Tree") -> "Tree":
        if other.kind != "number" or other.value.denominator != 1:
            return tree("exp", other * tree("log", self))
        if abs(other.value) > MOST_POWER:
            raise Unverified(f"the power {other.value} is too large")
        product_of = ONE
        for bit in bin(abs(int(other.value)))[2:]:
            product_of = product_of * product_of * (self if bit == "1" else ONE)
        return product_of if other.value >= 0 else ONE / product_of


@lru_cache(maxsize=100_000)
def tree(kind: str, *parts: Tree, value: object = None) -> Tree:
    """The one tree of this kind and these parts; a number where they are numbers."""
    if kind in OPERATIONS and parts[0].kind == parts[1].kind == "number":
        return number(OPERATIONS[kind](parts[0].value, parts[1].value))
    return Tree(kind, parts, value)


def number(value: Fraction | int) -> Tree:
    """The tree of a rational number."""
    return tree("number", value=Fraction(value))


ZERO, ONE, LESS = map(number, (0, 1, -1))


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
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name[:-1] in SLOPES:
                needed.append(tree(name[:-1], tree_of(argument)))
                return needed[-1]
            case ast.BinOp(left=left, op=op, right=right):
                a, b = tree_of(left), tree_of(right)
                needed.extend([tree("/", ONE, b) if isinstance(op, ast.Div) else a, OPERATIONS[type(op)](a, b)])
                return needed[-1]
        raise KeyError

    try:
        if not re.fullmatch(r"[\w\s.+*/()-]*", marked, re.ASCII):
            raise SyntaxError
        return tree_of(ast.parse(marked, mode="eval").body)
    except (SyntaxError, ValueError, KeyError, ZeroDivisionError):
        raise Unverified(f"'{text[:50]}' cannot be read, or has what is not stated, or is not smooth") from None


@lru_cache(maxsize=100_000)
def slope(of: Tree, by: str) -> Tree:
    """The derivative of a tree by a name."""
    if not of.parts:
        return ONE if of.kind == "name" and of.value == by else ZERO
    (a, da), *rest = [(part, slope(part, by)) for part in of.parts]
    if not rest:
        return parse(SLOPES[of.kind], {"x": a}, []) * da
    b, db = rest[0]
    return da + db if of.kind == "+" else da * b + a * db if of.kind == "*" else (da - of * db) / b


def dot(a: Sequence[Any], b: Sequence[Any], start: Any = ZERO) -> Any:
    """The sum of products."""
    return sum((x * y for x, y in zip(a, b, strict=True)), start)


def solved(matrix: list[list[Tree]], *right: Sequence[Tree]) -> tuple[list[Tree], list[list[Tree]]]:
    """The pivots of a symmetric matrix, positive where it is positive definite, and the solutions of linear systems."""
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
        function = OPERATIONS.get(of.kind, lambda x: getattr(x, of.kind)())
        found = ball(of.value) if of.kind == "number" else function(x, *rest)
        if not coefficient(found, 0).is_finite():
            raise Unverified(f"a formula ({of.kind}) has no value on the motion, or no motion is in the enclosures")
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


def pieces_of(spring: Mapping[str, Any]) -> int:
    """The number of pieces of a spring's law."""
    return max(len(spring.get("rows", ())) - 1, len(spring["breaks"]) + 1)


def law_on(spring: Mapping[str, Any], piece: int, known: Mapping[str, Tree], r: Tree, needed: list[Tree]) -> Tree:
    """The force of a spring at an extension, or its energy, as it is on a piece of its law. Between two rows (r, value,
    slope, curvature) of a table it is the polynomial of degree 5 with these, times the formula."""
    if not spring.get("rows"):
        return parse(spring["force"][piece], {**known, "r": r}, needed)
    (a, *low), (b, *high) = ([Fraction(each) for each in row] for row in spring["rows"][piece : piece + 2])
    units, polynomial = (Fraction(1), b - a, (b - a) ** 2 / 2), ZERO
    ends = [size * unit for size, unit in zip((*low, *high), units * 2, strict=True)]
    shares = [*ends[:3], *(dot(row, ends, Fraction(0)) for row in QUINTIC)]
    for k in reversed(range(6)):
        polynomial = polynomial * (r - number(a)) + number(shares[k] / (b - a) ** k)
    (scale,) = spring["force"]
    return parse(scale, known, needed) * polynomial


def edges_of(spring: Mapping[str, Any], piece: int, known: Mapping[str, Tree], r: Tree) -> dict[int, Tree]:
    """What is positive on a piece of a law, by the step to the piece beyond: distances of the extension from the ends.
    Raises `Unverified` where the law is not plainly continuous there."""
    if (spring.get("rows") and spring["breaks"]) or (spring["potential"] and pieces_of(spring) > 1):
        raise Unverified("a law in pieces is stated by forces or by rows")
    inner = [parse(each, known, []) for each in spring["breaks"]]
    rows: list[Tree | None] = [number(Fraction(row[0])) for row in spring.get("rows", ())]
    places = rows or [None, *inner, None]
    formulas = 1 if spring.get("rows") else pieces_of(spring)
    if any(each.kind != "number" for each in inner) or len(spring["force"]) != formulas:
        raise Unverified("a breakpoint is no number, or there are more or fewer formulas than pieces")
    low, high = places[piece : piece + 2]
    if low and high and not low.value < high.value:
        raise Unverified("the ends of the pieces of a law are not in order")
    if high and piece + 2 < len(places):
        below, above = (law_on(spring, k, known, high, []) for k in (piece, piece + 1))
        if below is not above and not (below.kind == above.kind == "number" and below.value == above.value):
            raise Unverified("a spring's force is not plainly continuous")
    return ({-1: r - low} if low else {}) | ({1: high - r} if high else {})


class Machine:
    """Lagrange's equations of a stated machine, with exact bounds of its parameters, on a piece of its springs' laws.

    states : the n coordinates, their rates, half a phase's time, and parameters' places in their intervals
    inertia, forces, needed : M (n, n), what M y'' is without contact, and what has to have a value
    weights : of the coordinates in the gap
    unknowns : the names of the places and the rates at the launch of the contact's coordinates, by their numbers
    out, embedded : the coordinate that the closed gap determines, and the matrix (n, n - 1) from the others to all
    launch : of all coordinates and of their rates at the launch, the weights of the unknowns
    edges : what is positive on the piece, by the step to the piece beyond
    """

    def __init__(self, stated: Mapping[str, Any], bounds: Bounds, piece: int = 0):
        names, needed = list(stated["coordinates"]), list[Tree]()
        n, wide = len(names), [name for name, (low, high) in bounds.items() if low < high]
        states = [*names, *(f"{name}'" for name in names), "half time", *(f"place of {name}" for name in wide)]
        self.names, self.needed, self.states = names, needed, [tree("name", value=each) for each in states]
        self.rates, self.places = self.states[n : 2 * n], self.states[2 * n + 1 :]
        if len({*names, *bounds, "pi"}) <= n + len(bounds) or not all(map(str.isidentifier, names)):
            raise Unverified("a name stands for two things, or is none")
        known = {name: number((low + high) / 2) for name, (low, high) in bounds.items()}
        for name, place in zip(wide, self.places, strict=True):
            known[name] += number((bounds[name][1] - bounds[name][0]) / 2) * place
        known["pi"], v = parse("4*atan(1)", {}, []), self.rates
        both = {**dict(zip(names, self.states, strict=False)), **known}
        masses, weights, inerters = (
            [(parse(size, known, needed), parse(place, both, needed)) for place, size in stated[kind]]
            for kind in ("masses", "weights", "inerters")
        )
        rows = [[parse(entry, both, needed) for entry in row] for row in stated["inertia"]] or [[ZERO] * n] * n
        if any(rows[i][j] is not rows[j][i] for i, j in product(range(n), repeat=2)):
            raise Unverified("the stated inertia is not plainly symmetric")

        def rate(of: Tree) -> Tree:
            return dot([slope(of, name) for name in names], v)

        twice = sum((rows[i][j] * v[i] * v[j] for i, j in product(range(n), repeat=2)), ZERO)
        energy = number(Fraction(1, 2)) * sum((m * rate(place) * rate(place) for m, place in masses + inerters), twice)
        momentum = [slope(energy, each.value) for each in v]
        self.inertia = [[slope(each, w.value) for w in v] for each in momentum]
        turning = [rate(p) - slope(energy, y) for p, y in zip(momentum, names, strict=True)]
        pull = parse(stated["surface_gravity"], both, needed)
        along = [(m * pull * parse(stated["gravity"], {**both, "z": h}, needed), h) for m, h in masses + weights]
        along += [(ONE, parse(each, both, needed)) for each in stated["potentials"]]
        self.edges = dict[int, Tree]()
        for spring in stated["springs"]:
            extension, on = parse(spring["extension"], both, needed), piece if pieces_of(spring) > 1 else 0
            law = law_on(spring, on, known, extension, needed)
            along.append((ONE, law) if spring["potential"] else (law, extension))
            self.edges |= edges_of(spring, on, known, extension)
        loads = [sum((LESS * size * slope(at, y) for size, at in along), ZERO) for y in names]
        self.forces = [load - each for load, each in zip(loads, turning, strict=True)]
        self.gap, self.counts = (parse(stated[name], both, needed) for name in ("gap", "counts"))
        self.separation = ONE if stated["separation"] is None else parse(stated["separation"], both, needed)
        self.weights = [slope(self.gap, name) for name in names]
        at_zero = parse(stated["gap"], {**both, **dict.fromkeys(names, ZERO)}, [])
        if at_zero is not ZERO or any(each.kind != "number" for each in self.weights):
            raise Unverified("the gap is no sum of coordinates with numbers before them")
        out, launch = names.index(stated["eliminated"]), names.index(stated["launch"])
        if self.weights[out] is ZERO or launch == out:
            raise Unverified("the gap does not determine the coordinate that it is said to")
        self.unknowns = {i: (name, f"{name}'") for i, name in enumerate(names) if i != out}
        self.unknowns[launch] = "liftoff", "alpha"
        embedded = [[Fraction(int(i == j)) for j in self.unknowns] for i in range(n)]
        embedded[out] = [-self.weights[j].value / self.weights[out].value for j in self.unknowns]
        ends = list(zip(*self.unknowns.values(), strict=True))
        self.launch = [[dict(zip(end, row, strict=True)) for row in embedded] for end in ends]
        self.out, self.embedded = out, [[number(each) for each in row] for row in embedded]


def machines_of(stated: Mapping[str, Any], bounds: Bounds) -> list["Machine"]:
    """A stated machine on each piece of its laws."""
    if sum(pieces_of(spring) > 1 for spring in stated["springs"]) > 1:
        raise Unverified("more than one spring has a law in pieces")
    return [Machine(stated, bounds, k) for k in range(max(map(pieces_of, stated["springs"]), default=1))]


class Field:
    """The motion of the states in half a phase, with time scaled such that it lasts from 0 to 1; the first 2 n move.
    `force` is the contact force that keeps the gap's acceleration 0, `slopes` the derivatives of `rates` by all states.
    """

    def __init__(self, machine: Machine, contact: bool):
        m, time, out = machine, machine.states[2 * len(machine.names)], machine.out
        self.states, self.needed, self.edges = m.states, m.needed, m.edges
        along = list(zip(*m.embedded, strict=True))
        self.pivots, (free,) = solved(m.inertia, m.forces)
        reduced = [[dot(a, [dot(row, b) for row in m.inertia]) for b in along] for a in along]
        _, (inside,) = solved(reduced, [dot(a, m.forces) for a in along])
        held = [dot(row, inside) for row in m.embedded]
        self.force = (dot(m.inertia[out], held) - m.forces[out]) / m.weights[out]
        self.rates = [time * each for each in (*m.rates, *(held if contact else free))]
        self.slopes = [self.gradient(each) for each in self.rates]

    def gradient(self, of: Tree) -> list[Tree]:
        """The derivatives of a tree by all states."""
        return [slope(of, each.value) for each in self.states]

    def along(self, of: Tree, order: int) -> Tree:
        """A derivative by the scaled time of a function of the states."""
        for _ in range(order):
            of = dot(self.gradient(of)[: len(self.rates)], self.rates)
        return of

    def value(self, at: Values, of: Tree | None, order: int) -> arb:
        """A derivative by the scaled time of a function of the states, the contact force for None, at states."""
        return at[self.along(of or self.force, order)]

    def values(self, x: Sequence[Any]) -> Values:
        """The values of trees at states."""
        return Values(zip(self.states, x, strict=True))

    def linear(self, end: tuple[list[arb], list[arb], arb_mat], of: Tree | None) -> tuple[arb, list[arb]]:
        """A function of the states at an end of a passage, the contact force for None: its value for c, and its
        derivatives by w for all."""
        at, centre, of = self.values(end[1]), self.values(end[0]), of or self.force
        return centre[of], (arb_mat([[at[each] for each in self.gradient(of)]]) * end[2]).tolist()[0]

    def motion(self, rows: list[list[Any]]) -> list[list[Any]]:
        """The rates of the moving states, and of their derivatives."""
        at, columns = self.values([row[0] for row in rows]), list(zip(*rows, strict=True))[1:]
        found = [[at[rate]] for rate in self.rates]
        for row, slopes in zip(found, self.slopes if columns else [], strict=False):
            places = [k for k, each in enumerate(slopes) if each is not ZERO]
            row += [sum((at[slopes[k]] * each[k] for k in places), arb(0)) for each in columns]
        return found

    def taylor(self, rows: list[list[Any]], order: int) -> list[list[list[arb]]]:
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

    def inclusion(self, rows: list[list[Any]], h: arb) -> list[list[Any]]:
        """Rows that hold the motion for a time h from these: Picard's inclusion. All that is needed has a value there,
        and the inertia is positive definite."""
        box, times, least = rows, arb(0).union(h), arb(2) ** (8 - ctx.prec)
        for _ in range(12):
            rates = self.motion(box)
            new = [[x + times * each for x, each in zip(*both, strict=True)] for both in zip(rows, rates, strict=False)]
            pairs = [pair for both in zip(new, box, strict=False) for pair in zip(*both, strict=True)]
            if all(inner.is_finite() and outer.contains(inner) for inner, outer in pairs):
                new += rows[len(new) :]
                at = self.values([row[0] for row in new])
                if all(at[each] > 0 for each in self.pivots) and all(at[each].is_finite() for each in self.needed):
                    return new
            box = [[x + arb(0, 0.1) * (x - x.mid()) + arb(0, least) * (abs(x) + 1) for x in row] for row in new]
            box += rows[len(new) :]
        raise Unverified("no box holds the motion, or the inertia is not positive definite")


class Pair(Field):
    """Two laws, for steps across the place where they meet: as the force is continuous there, the motion and the
    differences of two motions obey equations whose rates and derivatives lie in the hull of both laws'."""

    def __init__(self, *fields: Field):
        self.fields, (first, other) = fields, fields
        self.states, self.rates, self.pivots = first.states, first.rates, first.pivots
        self.needed = first.needed + other.needed

    def motion(self, rows: list[list[Any]]) -> list[list[Any]]:
        both = zip(*(each.motion(rows) for each in self.fields), strict=True)
        return [[coefficient(a, 0).union(coefficient(b, 0)) for a, b in zip(*row, strict=True)] for row in both]

    def value(self, at: Values, of: Tree | None, order: int) -> arb:
        first, other = (each.value(at, of, order) for each in self.fields)
        return first.union(other)

    def linear(self, end: tuple[list[arb], list[arb], arb_mat], of: Tree | None) -> tuple[arb, list[arb]]:
        (value, row), (other, another) = (each.linear(end, of) for each in self.fields)
        return value.union(other), [a.union(b) for a, b in zip(row, another, strict=True)]


class Part:
    """A step of length h from rows of balls: their Taylor polynomials, with the next coefficient over the whole step as
    the last; raises `Unverified` where h is too long."""

    def __init__(self, field: Field, rows: list[list[Any]], h: arb, order: int):
        self.field, self.h, self.still = field, h, rows[len(field.rates) :]
        rests = field.taylor(field.inclusion(rows, h), order)
        self.polynomials = [[arb_poly([*each, rest[order]]) for each, rest in zip(*both, strict=True)]
                            for both in zip(field.taylor(rows, order - 1), rests, strict=True)]  # fmt: skip

    def states(self, t: arb) -> list[arb]:
        """Enclosures of the states at a time, or at all times of a ball, within the step."""
        return [row[0](t) for row in self.polynomials] + [row[0] for row in self.still]


class Laws:
    """The fields of a phase on all pieces of its laws, and steps along motions that go from one to another."""

    def __init__(self, machines: Sequence[Machine], contact: bool):
        self.machines, self.contact, self.known = machines, contact, dict[int, Field]()

    def __getitem__(self, piece: int) -> Field:
        if not 0 <= piece < len(self.machines):
            raise Unverified("the motion comes to where a spring's table ends")
        if piece not in self.known:
            self.known[piece] = Field(self.machines[piece], self.contact)
        return self.known[piece]

    def pieces_of(self, x: Sequence[arb]) -> tuple[int, ...]:
        """The piece that states lie in, or the two pieces."""
        at, numbers = self[0].values(x), range(len(self.machines))
        beyond = [{side: not at[edge] > 0 for side, edge in machine.edges.items()} for machine in self.machines]
        for pair in [*((k, k) for k in numbers), *pairwise(numbers)]:
            if not (beyond[pair[0]].get(-1) or beyond[pair[1]].get(1)):
                return tuple(dict.fromkeys(pair))
        raise Unverified("the motion is on several pieces of a law at once, or comes to where a spring's table ends")

    def step(self, rows: list[list[Any]], length: Fraction, order: int) -> tuple[Part, Fraction]:
        """A step from rows, at most as long as said, and its time: within the piece that they lie in, up to its end, or
        across that. Raises `Unverified` where it is too long."""
        start, bit = [row[0] for row in rows], arb(2) ** (16 - ctx.prec)
        (piece, *others), side = self.pieces_of(start), 1
        field = self[piece]
        if not others:
            part, meets, late = Part(field, rows, ball(length), order), Fraction(0), length
            over = [side for side, edge in field.edges.items() if not field.values(part.states(part.h))[edge] > 0]
            if not over:
                return inside(part, field.edges.values()), length
            side = over[0]
            for _ in range(ctx.prec):  # a guess of when the middle of the set comes there
                middle = (meets + late) / 2
                early = field.values(part.states(ball(middle)))[field.edges[side]].mid() > 0
                meets, late = (middle, late) if early else (meets, middle)
            at = field.values(part.states(ball(meets)))
            pace = abs(field.value(at, field.edges[side], 1).mid())
            before = meets - Fraction(float(2 * at[field.edges[side]].rad() / pace + bit))
            if before > meets / 2:
                return inside(Part(field, rows, ball(before), order), field.edges.values()), before
        beyond, at = self[piece + side], field.values(start)
        pace = abs(field.value(at, field.edges[side], 1).mid())
        time = Fraction(float(3 * at[field.edges[side]].abs_upper() / pace + bit))
        outer = [edges[k] for edges, k in ((field.edges, -side), (beyond.edges, side)) if k in edges]
        part = Part(Pair(field, beyond), rows, ball(time), 1)
        if not time <= length or len(self.pieces_of(part.states(part.h))) > 1:
            raise Unverified("the place where two pieces of a law meet is not crossed")
        return inside(part, outer), time

    def steps(self, rows: Callable[[], list[list[Any]]], whole: Fraction, length: Fraction, order: int,
              good: Callable[[Part], bool]) -> Iterator[tuple[Part, Fraction]]:  # fmt: skip
        """Steps over a time, and their times: the first at most of a length, each from what `rows` says then, and such
        that it is good."""
        shortest = SHORTEST * whole
        while whole:
            length = min(length, whole)
            try:
                part, time = self.step(rows(), length, order)
                if not good(part):
                    raise Unverified("the step is too long")
            except Unverified as reason:
                if length < shortest:
                    raise Unverified(f"the motion is not enclosed: {reason}") from None
                length /= 2
                continue
            yield part, time
            whole, length = whole - time, length * Fraction(5, 4)

    def end(self, x: Sequence[arb], whole: Fraction, order: int, good: Callable[[Part], bool]) -> list[arb]:
        """The states after a time, from states; the steps are as in `steps`."""
        ends = list(x)

        def rows() -> list[list[Any]]:
            return [[each] for each in ends]

        for part, _ in self.steps(rows, whole, whole, order, good):
            ends = part.states(part.h)
        return ends


def inside(part: Part, edges: Iterable[Tree]) -> Part:
    """The part, along which all edges are positive."""
    for edge in edges:
        if not all(sign == 1 for _, sign in signs([part], edge, lambda *_: [0], ctx.prec)):
            raise Unverified("the step leaves a piece of a law")
    return part


def moved(values: Sequence[arb], matrix: arb_mat, deviations: Sequence[arb]) -> list[arb]:
    """Values and a matrix times deviations from these."""
    return [value + dot(row, deviations, arb(0)) for value, row in zip(values, matrix.tolist(), strict=True)]


class Passage:
    """The motions of a phase over the scaled times from 0 to 1, from the starts c + S w with deviations w in a box:
    steps, and at either end enclosures of the motion from c, of all motions, and of the derivatives by w of all."""

    def __init__(self, laws: Laws, centre: Sequence[arb], seeds: arb_mat, reach: Sequence[arb]):
        n, small, order = len(centre), arb(2) ** (12 - ctx.prec), int(ORDER_PER_BIT * ctx.prec)
        one, rounded, error, slopes = arb_mat(n, n, 1), arb_mat(n, n, 1), arb_mat(n, n, 0), seeds
        self.parts, box = list[Part](), moved(centre, seeds, reach)
        self.start, first = (list(centre), box, seeds), [laws[piece] for piece in laws.pieces_of(box)]
        self.field = first[0] if len(first) == 1 else Pair(*first)

        def sharp(part: Part) -> bool:
            ends = zip(part.polynomials, part.states(part.h), strict=False)
            return all(d.rad() <= small * (1 + abs(d)) + 4 * row[0](0).rad() for row, d in ends)

        def mild(part: Part) -> bool:
            rests = (each[DERIVED_ORDER] * part.h**DERIVED_ORDER for row in part.polynomials for each in row[1:])
            return all(abs(each) < COARSE for each in rests)

        def rows() -> list[list[Any]]:
            return [[x, *row] for x, row in zip(box, one.tolist(), strict=True)]

        for part, time in laws.steps(rows, Fraction(1), FIRST, DERIVED_ORDER, mild):
            ends = laws.end(centre, time, order, sharp)
            moving = [[each(part.h) for each in row[1:]] for row in part.polynomials]
            transition = arb_mat([*moving, *one.tolist()[len(moving) :]])
            before, rounded = rounded, (transition.mid() * rounded).mid()
            error = rounded.inv() * (transition * before) * (one + error) - one
            slopes, centre = rounded * (one + error) * seeds, ends
            box = moved(centre, slopes, reach)
            self.parts.append(part)
        self.end = list(centre), box, slopes


def signs(
    parts: Sequence[Part], of: Tree | None, orders: Callable[..., Sequence[int]], most: int = MOST_HALVINGS
) -> list[list[int]]:
    """On stretches of a motion, in order, the first of some derivatives of a function, the contact force for None, that
    has a sign there, and that sign. Which orders are tried depends on whether orders above 0 decided all
    stretches before, and whether one holds the end."""
    found, last = list[list[int]](), len(parts) - 1
    waiting = [(each, arb(0), each.h, i == last, most) for i, each in enumerate(parts)][::-1]
    while waiting:
        part, low, high, ends, left = waiting.pop()
        at, field = part.field.values(part.states(low.union(high))), part.field
        values = ((order, field.value(at, of, order)) for order in orders(all(order for order, _ in found), ends))
        if decided := next(([order, 1 if each > 0 else -1] for order, each in values if each > 0 or each < 0), None):
            found.append(decided)
        elif left:
            middle = (low + high) / 2
            waiting += [(part, middle, high, ends, left - 1), (part, low, middle, False, left - 1)]
        else:
            raise Unverified("a sign along the motion is not decided")
    return found


def check_positive(what: str, parts: Sequence[Part], of: Tree | None, at_start: int = 0, at_end: int = 0) -> None:
    """See that a function is positive inside the motion. At one end it may be known to have a zero of some order: it is
    positive beside that by Taylor's formula where the derivative of that order has the fitting sign."""
    found = signs(parts, of, lambda begins, ends: [at_end if ends else 0, *([at_start] if begins and at_start else [])])
    if [sign for _, sign in found] != [1] * (len(found) - 1) + [(-1) ** at_end]:
        raise Unverified(f"{what} is not so")


def turns(parts: Sequence[Part], of: Tree) -> int:
    """How often a function turns inside the motion, at whose end it is known to turn. On each stretch its rate has a
    sign, or the rate's rate has: then the rate has one zero there or none, as the signs before and after tell."""
    found, field = signs(parts, of, lambda *_: (1, 2)), parts[0].field
    start = field.values(parts[0].states(arb(0)))[field.along(of, 1)]
    turned = (order == 2 and len({sign for _, sign in group}) > 1 for order, group in groupby(found, lambda x: x[0]))
    if not (start > 0 or start < 0) or found[-1][0] == 1 or any(turned):
        raise Unverified("turns of the extension are not told apart, or it hangs where the motion begins or ends")
    rates = [1 if start > 0 else -1, *(sign for order, sign in found if order == 1)]
    return sum(a != b for a, b in pairwise(rates))


class Solution:
    """The equations of half an orbit on a box of unknowns, for all values of the parameters, and Krawczyk's image: that
    holds what solutions the box has, and where it is inside, just one.

    common : what box and image have in common: the launch, the times of the phases, and the parameters' places
    moved, inside : how far the image is from the middle of the box, and whether it is in the interior of it
    passages : half a phase each, from the launch, in contact with the rates turned
    """

    def __init__(self, machines: Sequence[Machine], box: Mapping[str, arb]):
        self.machine, names = machines[0], list(box)
        machine = self.machine
        centre = [each.mid() for each in box.values()]
        reach = [each - c for each, c in zip(box.values(), centre, strict=True)]
        self.passages, phases = list[Passage](), [name for name in PHASES if name in names]
        for phase, sign in zip(phases, (1, -1), strict=False):
            rows = [*machine.launch[0], *({name: sign * w for name, w in row.items()} for row in machine.launch[1])]
            rows += [{phase: Fraction(1, 2)}, *({place.value: Fraction(1)} for place in machine.places)]
            seeds = arb_mat([[ball(row.get(name, Fraction(0))) for name in names] for row in rows])
            start = moved([arb(0)] * len(rows), seeds, centre)
            self.passages.append(Passage(Laws(machines, sign < 0), start, seeds, reach))
        equations = [self.passages[0].field.linear(self.passages[0].start, None)]
        for passage, those in zip(self.passages, (range(len(machine.names)), machine.unknowns), strict=False):
            equations += [passage.field.linear(passage.end, machine.rates[i]) for i in those]
        by_all, count = arb_mat([row for _, row in equations]), len(equations)
        try:
            inverse = arb_mat([row[:count] for row in by_all.tolist()]).mid().inv().mid()
        except ZeroDivisionError:
            raise Unverified("the equations are singular") from None
        change = moved([arb(0)] * count, arb_mat(count, len(names), 1) - inverse * by_all, reach)
        change = moved(change, inverse, [-value for value, _ in equations])
        self.moved = [*change, *reach[count:]]
        image = {name: c + d for name, c, d in zip(names, centre, self.moved, strict=True)}
        self.common = {n: image[n].intersection(box[n]) if image[n].overlaps(box[n]) else arb("nan") for n in names}
        self.inside = all(abs(d) < each.rad() for d, each in zip(change, box.values(), strict=False))


def check(document: Mapping[str, object]) -> list[str]:
    """Why a saved proof is not verified, in words; empty where all of its theorem is."""
    try:
        _check_said(document)
        _check_parts(document)
    except Unverified as error:
        return [str(error)]
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, ArithmeticError, RecursionError) as error:
        return [f"the file cannot be read as a proof: {type(error).__name__}: {error}"]
    return []


def bounds_of(pairs: Mapping[str, Any]) -> Bounds:
    """The exact bounds of intervals by name."""
    found = {name: (Fraction(low), Fraction(high)) for name, (low, high) in pairs.items()}
    if any(low > high for low, high in found.values()):
        raise Unverified("an interval has its bounds in the wrong order")
    return found


def within(inner: Bounds, outer: Bounds) -> bool:
    """Whether intervals lie in others of the same names."""
    return all(outer[name][0] <= low and high <= outer[name][1] for name, (low, high) in inner.items())


def _check_said(document: Mapping[str, Any]) -> None:
    """See that the file holds what is verified and no more, and says the same where it repeats it."""
    kind = [document.get(name) for name in ("format", "kind", "proved", "attraction_radius")]
    if kind != ["persistent-orbits proof 2", "orbit", True, None]:
        raise Unverified("this program verifies proofs of orbits, by this version, all proved, without attraction")
    machine, parts, again = document["machine"], document["parts"], dict.fromkeys(("alpha", *PHASES, "bounce_side"))
    said, parameters = ({name: {"low": low, "high": high} for name, (low, high) in pairs.items()}
                        for pairs in (document["enclosures"], machine["parameters"]))  # fmt: skip
    radius = parts[0]["uniqueness_radius"] if len(parts) == 1 else None
    again |= {**said, "parameters": parameters, "units": machine["units"], "uniqueness_radius": radius, "reasons": []}
    if false := [name for name, value in again.items() if document.get(name) != value]:
        raise Unverified(f"'{false[0]}' is not what the file says elsewhere, or this program does not verify it")
    springs = [{"rows": [], **spring} for spring in machine["springs"]]
    groups = [machine], springs, parts, [document.keys() - again.keys() - {"attraction_radius", "digest"}]
    if any({*each} != names for group, names in zip(groups, FIELDS, strict=True) for each in group):
        raise Unverified("the file says more than this program verifies, or less")


def _check_parts(document: Mapping[str, Any]) -> None:
    """See that the theorem holds in each part of the parameters' intervals, and that the parts cover these."""
    whole, said = bounds_of(document["machine"]["parameters"]), bounds_of(document["enclosures"])
    parts = [(bounds_of(part["parameters"]), bounds_of(part["unknowns"]), part) for part in document["parts"]]
    motion, stated = document["motion"], document["machine"]["separation"] is not None
    conditions = [*(["separation"] if stated else []), "clearance", "contact_force", "contact_end"] if motion else []
    if document["conditions"] != dict.fromkeys(conditions, "proved") or (document["family"] is not None) != motion:
        raise Unverified("not all conditions of a motion are said to be proved, or others are")
    for box, unknowns, _ in parts:
        same = {name: unknowns[name] for name in ("alpha", *PHASES) if name in unknowns}
        if said.keys() != {*same, *(ENDS if motion else ())}:
            raise Unverified(f"other quantities are enclosed than this program verifies: {', '.join(said)}")
        if 2 * Fraction(document["radius"]) < said["alpha"][1] - said["alpha"][0]:
            raise Unverified("the radius is less than half the width of the enclosure of alpha")
        if box.keys() != whole.keys() or not (within(box, whole) and within(same, said)):
            raise Unverified("a part has other parameters than the machine, or unknowns outside those of the whole")
    cuts = [sorted({edge for box in (whole, *(box for box, *_ in parts)) for edge in box[name]}) for name in whole]
    for edges in product(*(list(pairwise(each)) or [(each[0], each[0])] for each in cuts)):
        if not any(within(dict(zip(whole, edges, strict=True)), box) for box, *_ in parts):
            raise Unverified("the parts do not cover the intervals of the parameters")
    for box, unknowns, part in parts:
        _check_halved(document, unknowns, Fraction(part["uniqueness_radius"]), box, MOST_SPLITS)


def _check_halved(document: Mapping[str, object], claims: Bounds, radius: Fraction, cell: Bounds, left: int) -> None:
    """See that the theorem holds for parameters in a box, which is halved where that is not shown at once."""
    narrow = min((high - low) / (abs(high) + abs(low) + Fraction(1, 10**9)) for low, high in claims.values())
    if not narrow or radius <= 0:
        raise Unverified("an enclosure has no width, or the radius of uniqueness is not positive")
    bits = narrow.denominator.bit_length() - narrow.numerator.bit_length()
    try:
        with ctx.workprec(max(BITS_OF_UNIQUENESS, bits + GUARD_BITS)):
            solution = _solution(document, claims, radius, cell)
            if document["motion"]:
                _check_motion(document, solution)
    except Unverified:
        widest = max(cell, key=lambda n: (cell[n][1] - cell[n][0]) / (abs(cell[n][0] + cell[n][1]) or 1), default=None)
        if left == 0 or widest is None or cell[widest][0] == cell[widest][1]:
            raise
        middle = (cell[widest][0] + cell[widest][1]) / 2
        for half in ((cell[widest][0], middle), (middle, cell[widest][1])):
            _check_halved(document, claims, radius, {**cell, widest: half}, left - 1)


def _solution(document: Mapping[str, Any], claims: Bounds, radius: Fraction, cell: Bounds) -> Solution:
    """The solution that is claimed within bounds, shown to exist there and to be the only one within a radius."""
    machines = machines_of(document["machine"], cell)
    machine = machines[0]
    phases = [name for name in PHASES if name in claims]
    names = [name for pair in machine.unknowns.values() for name in pair] + phases
    other = claims.keys() != {*names} or ((len(machine.names) > 2 or document["motion"]) and len(phases) < 2)
    if other or any(claims[name][0] <= 0 for name in ("alpha", *phases)):
        raise Unverified("other unknowns are enclosed than the equations have, or the speed or a time is not positive")
    stated, around = ({name: ball(claims[name][0] - more).union(ball(claims[name][1] + more)) for name in names}
                      | {place.value: arb(0, 1) for place in machine.places} for more in (0, radius))  # fmt: skip
    with ctx.workprec(BITS_OF_UNIQUENESS):
        known = Solution(machines, around)
        for _ in range(3):
            known = known if known.inside else Solution(machines, known.common)
    if not known.inside:
        raise Unverified("the solution is not shown to be the only one within the radius of uniqueness")
    solution = Solution(machines, stated)
    for _ in range(3):  # where the enclosures do not suffice, from the boxes that are known to hold the solution
        lies = all(ball(claims[name][0]) < solution.common[name] < ball(claims[name][1]) for name in names)
        if solution.inside and lies:
            return solution
        known = solution = Solution(machines, known.common)
    raise Unverified("the solution is not shown to lie in its enclosures")


def _check_motion(document: Mapping[str, Any], solution: Solution) -> None:
    """See that what is said of the motion holds."""
    machine, passages, said = solution.machine, solution.passages, bounds_of(document["enclosures"])
    flight, contact = (each.parts for each in passages)
    if str(document["family"]) != str(turns(flight, machine.counts)):
        raise Unverified("the family is another one")
    check_positive("that the gap stays open in flight", flight, machine.gap, at_start=3)
    check_positive("that the contact pushes", contact, None, at_start=1)
    check_positive("that the separation is positive in flight", flight, machine.separation)
    check_positive("that the separation is positive in contact", contact, machine.separation)
    if len(machine.names) == 2:
        check_positive("that the contact first rests midway", contact, LESS * machine.rates[1 - machine.out], at_end=1)
    for name, end in zip(ENDS, (passages[0].start, passages[0].end), strict=True):
        value, row = passages[0].field.linear(end, machine.counts)
        value += dot(row, solution.moved, arb(0))
        if not (ball(said[name][0]) <= value <= ball(said[name][1])):
            raise Unverified(f"{name} is not shown to lie in its enclosure")
