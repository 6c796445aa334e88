"""Lagrange's equations of a mechanism in 120 digits, from the texts of its formulas: nothing of the toolkit is used.

A formula is evaluated with its gradient and its second derivatives by the coordinates. With the heights h_k of masses
m_k the kinetic energy is sum m_k (dh_k . v)^2 / 2, beside v^T S(y) v / 2 of a stated inertia, so that

    (sum m dh dh^T + S) a + sum m dh (v^T ddh v) + S' v - (v^T dS v) / 2 = F,

and in contact, where the gap g(y) = w . y stays closed, w lambda is added to F and w . a = 0.
"""

import ast
from dataclasses import dataclass, field

import mpmath

DIGITS = 120


class Jet:
    """A value with its gradient and its second derivatives by n variables."""

    def __init__(self, value, gradient, second):
        self.value, self.gradient, self.second = value, gradient, second
        self.size = len(gradient)

    @classmethod
    def constant(cls, value, size):
        return cls(mpmath.mpf(value), [mpmath.mpf(0)] * size, [[mpmath.mpf(0)] * size for _ in range(size)])

    @classmethod
    def variable(cls, value, place, size):
        jet = cls.constant(value, size)
        jet.gradient[place] = mpmath.mpf(1)
        return jet

    def chain(self, value, slope, bend):
        """A function of the value with these first and second derivatives."""
        n, d, h = range(self.size), self.gradient, self.second
        return Jet(value, [slope * d[i] for i in n], [[slope * h[i][j] + bend * d[i] * d[j] for j in n] for i in n])

    def __add__(self, other):
        n = range(self.size)
        return Jet(
            self.value + other.value,
            [self.gradient[i] + other.gradient[i] for i in n],
            [[self.second[i][j] + other.second[i][j] for j in n] for i in n],
        )

    def __neg__(self):
        return self.chain(-self.value, mpmath.mpf(-1), mpmath.mpf(0))

    def __mul__(self, other):
        n, a, b = range(self.size), self, other
        return Jet(
            a.value * b.value,
            [a.value * b.gradient[i] + b.value * a.gradient[i] for i in n],
            [
                [
                    a.value * b.second[i][j] + b.value * a.second[i][j]
                    + a.gradient[i] * b.gradient[j] + a.gradient[j] * b.gradient[i]
                    for j in n
                ]
                for i in n
            ],
        )  # fmt: skip

    def inverse(self):
        x = self.value
        return self.chain(1 / x, -1 / x**2, 2 / x**3)


CALLS = {
    "sin": lambda x: (mpmath.sin(x), mpmath.cos(x), -mpmath.sin(x)),
    "cos": lambda x: (mpmath.cos(x), -mpmath.sin(x), -mpmath.cos(x)),
    "sqrt": lambda x: (mpmath.sqrt(x), 1 / (2 * mpmath.sqrt(x)), -1 / (4 * mpmath.sqrt(x) ** 3)),
    "exp": lambda x: (mpmath.exp(x),) * 3,
}


def jet(text, variables, parameters):
    """A formula at values of its variables, which are differentiated, and of its parameters; its numerals are the
    decimals that are written."""
    size, places = len(variables), list(variables)

    def of(node):
        if isinstance(node, ast.Constant):
            return Jet.constant(ast.get_source_segment(text, node), size)
        if isinstance(node, ast.Name):
            if node.id in variables:
                return Jet.variable(variables[node.id], places.index(node.id), size)
            return Jet.constant(parameters[node.id], size)
        if isinstance(node, ast.UnaryOp):
            return -of(node.operand)
        if isinstance(node, ast.Call):
            inner = of(node.args[0])
            return inner.chain(*CALLS[node.func.id](inner.value))
        left = of(node.left)
        if isinstance(node.op, ast.Pow):
            power = ast.literal_eval(node.right)
            x = left.value
            return left.chain(x**power, power * x ** (power - 1), power * (power - 1) * x ** (power - 2))
        right = of(node.right)
        if isinstance(node.op, ast.Add):
            return left + right
        if isinstance(node.op, ast.Sub):
            return left + -right
        return left * right if isinstance(node.op, ast.Mult) else left * right.inverse()

    return of(ast.parse(text, mode="eval").body)


@dataclass
class Machine:
    """A mechanism as texts.

    masses : (height, mass, inertia, weight): whether it has inertia, and whether it has weight
    springs : (extension, force as a function of r); dampers : (extension, coefficient)
    potentials : energies
    inertia : rows of a matrix of texts
    gravity : as a function of the height z, times `surface`
    """

    coordinates: tuple
    masses: list
    springs: list
    gap: str
    parameters: dict
    dampers: list = field(default_factory=list)
    potentials: list = field(default_factory=list)
    inertia: list = field(default_factory=list)
    gravity: str = "1"
    surface: str = "1"


@dataclass
class Equations:
    """M a = F at one state, and the weights of the gap; `sizes` are the sums of the magnitudes of the terms of F."""

    inertia: mpmath.matrix
    force: mpmath.matrix
    sizes: mpmath.matrix
    gap: mpmath.matrix

    def flight(self):
        """The accelerations, with the sums of the magnitudes of their terms."""
        inverse = self.inertia**-1
        return inverse * self.force, inverse.apply(abs) * self.sizes

    def contact(self):
        """The accelerations with the gap closed and the contact force, with the magnitudes of their terms."""
        n, inverse = len(self.force), self.inertia**-1
        compliance = (self.gap.T * inverse * self.gap)[0]
        row = (self.gap.T * inverse) / -compliance
        free, free_sizes = self.flight()
        force = (row * self.force)[0]
        size = (row.apply(abs) * self.sizes)[0]
        kick = inverse * self.gap
        return [free[i] + kick[i] * force for i in range(n)], [
            free_sizes[i] + abs(kick[i]) * size for i in range(n)
        ], force, size  # fmt: skip

    def impact(self):
        """The direction of an impact and its mass."""
        kick = self.inertia**-1 * self.gap
        mass = 1 / (self.gap.T * kick)[0]
        return [mass * each for each in kick], mass


class Sum:
    """The inertia and the forces at one state, as they are added."""

    def __init__(self, machine, place, rates):
        self.n, self.v = len(place), [mpmath.mpf(rate) for rate in rates]
        self.y = dict(zip(machine.coordinates, map(mpmath.mpf, place), strict=True))
        self.p = {name: mpmath.mpf(value) for name, value in machine.parameters.items()}
        self.inertia, self.force, self.sizes = (mpmath.zeros(self.n, k) for k in (self.n, 1, 1))

    def push(self, force, gradient):
        for i in range(self.n):
            self.force[i] += force * gradient[i]
            self.sizes[i] += abs(force * gradient[i])

    def at(self, text):
        return jet(text, self.y, self.p)

    def number(self, text, **variable):
        return jet(text, {name: mpmath.mpf(value) for name, value in variable.items()}, self.p).value

    def mass(self, height, mass, moves, pull):
        """A mass with its inertia, where it moves, and its weight under a pull."""
        h, m, n, v = self.at(height), self.number(mass), range(self.n), self.v
        if pull is not None:
            self.push(-m * self.number(pull[0], z=h.value) * self.number(pull[1]), h.gradient)
        if moves:
            self.push(-m * sum(v[i] * h.second[i][j] * v[j] for i in n for j in n), h.gradient)
            for i in n:
                for j in n:
                    self.inertia[i, j] += m * h.gradient[i] * h.gradient[j]

    def entry(self, i, j, text):
        """An entry of a stated inertia."""
        entry, v, unit = self.at(text), self.v, mpmath.eye(self.n)
        self.inertia[i, j] += entry.value
        for k in range(self.n):
            self.push(-entry.gradient[k] * v[k] * v[j], unit[:, i])
            self.push(entry.gradient[k] * v[i] * v[j] / 2, unit[:, k])


def equations(machine, place, rates):
    """The equations at coordinates and their rates."""
    total = Sum(machine, place, rates)
    for height, mass, moves, weighs in machine.masses:
        total.mass(height, mass, moves, (machine.gravity, machine.surface) if weighs else None)
    for i, row in enumerate(machine.inertia):
        for j, text in enumerate(row):
            total.entry(i, j, text)
    for extension, force in machine.springs:
        e = total.at(extension)
        total.push(-total.number(force, r=e.value), e.gradient)
    for extension, coefficient in machine.dampers:
        e = total.at(extension)
        total.push(-total.number(coefficient) * mpmath.fdot(e.gradient, total.v), e.gradient)
    for energy in machine.potentials:
        total.push(-1, total.at(energy).gradient)
    gap = mpmath.matrix(total.at(machine.gap).gradient)
    return Equations(total.inertia, total.force, total.sizes, gap / max(gap))
