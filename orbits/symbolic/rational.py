"""Normal forms of expressions: quotients of polynomials over the rational numbers.

A part of an expression other than + - * / and whole powers is a generator: a symbol, or a function such as
sin or exp of a normal form. A polynomial is a mapping from monomials to rational coefficients that are not 0; its
exponents may be negative, so that only denominators of several terms need a quotient. These are products of factors,
which are divided out of the numerator wherever that leaves no remainder.

Every step is an identity between functions: what is found equal is equal, wherever both are defined. The converse holds
for rational functions, and for those with roots and sines by the two rules that are used, sqrt(a)^2 = a and
cos(a)^2 = 1 - sin(a)^2; any other function is related to nothing but itself, and if it is odd or even to its value at
the negative argument. An operation whose result would have more than `MOST_TERMS` terms is a generator too: what
depends on it is never found to be constant unless it drops out.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from math import isfinite, prod
from typing import TypeAlias

import casadi as ca

from .calls import single_assignment
from .polynomials import (
    MOST_TERMS,
    UNIT_POLYNOMIAL,
    Monomial,
    Number,
    Polynomial,
    divided,
    number_of,
    parts_in,
    primitive,
    share_of,
    times,
    to_power,
    total_of,
)

Factor: TypeAlias = frozenset[tuple[Monomial, Number]]

# A machine's coefficients have a few terms, at most some twenty; sums and products of more than these are left alone.
LONGEST_PRODUCT, HIGHEST_POWER, LONGEST_FRACTION = 2400, 16, 8192


class TooLargeError(Exception):
    """Marks a polynomial of more terms, or a number of more digits, than are worked out."""


@dataclass(frozen=True)
class Ratio:
    """A quotient of polynomials: the numerator, and the factors of the denominator with their powers."""

    numerator: Polynomial
    factors: Mapping[Factor, int] = field(default_factory=dict)

    @property
    def number(self) -> Number | None:
        """The number that it is as it stands, None for another."""
        if not self.numerator:
            return 0
        return self.numerator.get(()) if len(self.numerator) == 1 and not self.factors else None

    @property
    def generators(self) -> set[int]:
        """The generators that occur."""
        terms = [*self.numerator, *(term for factor in self.factors for term, _ in factor)]
        return {generator for term in terms for generator, _ in term}


@dataclass(frozen=True)
class Generator:
    """A symbol, or a function of normal forms.

    variables : the symbols on which it depends
    expression : () -> the CasADi expression, in which symbols may stand that cancel
    square : the expression of its square, where there is a rule; None for the others
    """

    variables: frozenset[int]
    expression: Callable[[], ca.SX]
    square: Polynomial | None = None


class NormalForms:
    """The normal forms of expressions in common generators.

    The first generators are the symbols, in their order.
    """

    def __init__(self, symbols: Iterable[ca.SX]):
        self.generators = [self._symbol(i, symbol) for i, symbol in enumerate(symbols)]
        self.squares: dict[int, Polynomial] = {}
        self._functions: dict[tuple, Ratio] = {}
        self._divisors: dict[Factor, ca.SX] = {}

    @staticmethod
    def _symbol(i: int, symbol: ca.SX) -> Generator:
        return Generator(frozenset([i]), lambda: symbol)

    def symbol(self, i: int) -> Ratio:
        """The normal form of a symbol."""
        return Ratio({((i, 1),): 1})

    def variables(self, a: Ratio) -> set[int]:
        """The symbols on which a normal form depends."""
        return {variable for generator in a.generators for variable in self.generators[generator].variables}

    def add(self, a: Ratio, b: Ratio) -> Ratio:
        """a + b."""
        if a.factors == b.factors:
            return self._cancelled(total_of(a.numerator, b.numerator), a.factors)
        common = {f: max(a.factors.get(f, 0), b.factors.get(f, 0)) for f in {**a.factors, **b.factors}}
        raised = (self._raised(each, common) for each in (a, b))
        return self._cancelled(total_of(*raised), common)

    def _raised(self, a: Ratio, common: Mapping[Factor, int]) -> Polynomial:
        """The numerator of a quotient with a common denominator."""
        missing = {factor: power - a.factors.get(factor, 0) for factor, power in common.items()}
        return self._product(a.numerator, self.expanded(missing))

    def multiply(self, a: Ratio, b: Ratio) -> Ratio:
        """a b."""
        factors = dict(a.factors)
        for factor, power in b.factors.items():
            factors[factor] = factors.get(factor, 0) + power
        return self._cancelled(self._product(a.numerator, b.numerator), factors)

    def inverse(self, a: Ratio) -> Ratio:
        """1 / a; raises `ZeroDivisionError` for 0."""
        if not a.numerator:
            raise ZeroDivisionError
        if len(a.numerator) == 1 and not a.factors:
            ((monomial, coefficient),) = a.numerator.items()
            return Ratio({to_power(monomial, -1): share_of(1, coefficient)})
        coefficient, monomial, rest = primitive(a.numerator)
        numerator = self._product(self.expanded(a.factors), {to_power(monomial, -1): share_of(1, coefficient)})
        return self._cancelled(numerator, {} if rest == UNIT_POLYNOMIAL else {frozenset(rest.items()): 1})

    def power(self, a: Ratio, exponent: int) -> Ratio:
        """a to a whole power."""
        if abs(exponent) > HIGHEST_POWER:
            raise TooLargeError
        result = Ratio(UNIT_POLYNOMIAL)
        for _ in range(abs(exponent)):
            result = self.multiply(result, a)
        return self.inverse(result) if exponent < 0 else result

    def function(self, key: tuple, arguments: Collection[Ratio], expression: Callable, square: bool = False) -> Ratio:
        """A generator for a function of normal forms, the same for equal ones; its square is the one argument where
        `square` says so."""
        known = (*key, *((frozenset(each.numerator.items()), frozenset(each.factors.items())) for each in arguments))
        if known not in self._functions:
            variables = frozenset(variable for each in arguments for variable in self.variables(each))
            (inner, *_) = arguments or [Ratio({})]
            rule = inner.numerator if square and not inner.factors else None
            self._functions[known] = self._new(Generator(variables, expression, rule))
        return self._functions[known]

    def _new(self, generator: Generator) -> Ratio:
        place = len(self.generators)
        self.generators.append(generator)
        if generator.square is not None:
            self.squares[place] = generator.square
        return self.symbol(place)

    def sine(self, a: Ratio, angle: Callable[[], ca.SX]) -> Ratio:
        """The sine of a normal form with this expression."""
        if _leads_below_zero(a):
            return self.multiply(_MINUS, self.sine(self.multiply(_MINUS, a), lambda: -angle()))
        return self.function((ca.OP_SIN,), [a], lambda: ca.sin(angle()))

    def cosine(self, a: Ratio, angle: Callable[[], ca.SX]) -> Ratio:
        """The cosine, whose square is 1 - sin^2."""
        (place,) = self.sine(a, angle).generators
        if (known := (ca.OP_COS, place)) not in self._functions:
            rule: Polynomial = {(): 1, ((place, 2),): -1}
            self._functions[known] = self._new(
                Generator(self.generators[place].variables, lambda: ca.cos(angle()), rule)
            )
        return self._functions[known]

    def is_zero(self, a: Ratio) -> bool:
        """Whether a normal form vanishes everywhere."""
        try:
            return not self._product(a.numerator, self._clearing(a.numerator))
        except TooLargeError:
            return False

    def _clearing(self, *polynomials: Polynomial) -> Polynomial:
        """A factor that makes exponents of generators with rules for squares at least 0: the rules hold for these."""
        terms = [dict(term) for polynomial in polynomials for term in polynomial]
        lowest = {i: min((term.get(i, 0) for term in terms), default=0) for i in sorted(self.squares)}
        return {tuple((i, -e) for i, e in lowest.items() if e < 0): 1}

    def without(self, a: Ratio, variables: Collection[int]) -> Ratio | None:
        """The same function, written without symbols on which it does not depend; None where it depends on them."""
        out = {i for i in a.generators if not self.generators[i].variables.isdisjoint(variables)}
        if not out:
            return a
        if self.is_zero(a):
            return Ratio({})
        try:
            # The quotient is free of them where all its numerator's and its denominator's parts are in one ratio.
            denominator = self.expanded(a.factors)
            clearing = self._clearing(a.numerator, denominator)
            above, below = (parts_in(self._product(each, clearing), out) for each in (a.numerator, denominator))
            part = next(iter(below))
            if part not in above:
                return None
            one, other = above[part], below[part]
            for each in {**above, **below}:
                if self._product(above.get(each, {}), other) != self._product(one, below.get(each, {})):
                    return None
            return self.multiply(Ratio(one), self.inverse(Ratio(other)))
        except TooLargeError:
            return None

    def constant(self, a: Ratio) -> Fraction | None:
        """The number that a normal form is everywhere, None where it is none."""
        found = self.without(a, range(len(self.generators)))
        number = None if found is None else found.number
        return None if number is None else Fraction(number)

    def expanded(self, factors: Mapping[Factor, int]) -> Polynomial:
        """The product of factors."""
        result = UNIT_POLYNOMIAL
        for factor, power in factors.items():
            for _ in range(power):
                result = self._product(result, dict(factor))
        return result

    def _product(self, a: Polynomial, b: Polynomial) -> Polynomial:
        """The product of polynomials, with the rules for squares."""
        if len(a) * len(b) > LONGEST_PRODUCT:
            raise TooLargeError
        result: Polynomial = {}
        for left, c in a.items():
            for right, d in b.items():
                monomial = times(left, right) if left and right else left or right
                result[monomial] = result.get(monomial, 0) + (d if c == 1 else c if d == 1 else c * d)
        result = {monomial: value for monomial, value in result.items() if value}
        squared = {i for monomial in result for i, e in monomial if e > 1 and i in self.squares} if self.squares else ()
        for generator in squared:
            result = self._squared(result, generator)
        if len(result) > MOST_TERMS:
            raise TooLargeError
        return result

    def _squared(self, a: Polynomial, generator: int) -> Polynomial:
        """A polynomial with the square of a generator replaced by its rule."""
        result: Polynomial = {}
        for monomial, value in a.items():
            exponent = next((e for i, e in monomial if i == generator), 0)
            terms: Polynomial = {monomial: value}
            if exponent >= 2:
                rest = times(monomial, ((generator, -2 * (exponent // 2)),))
                squares = self.power(Ratio(self.squares[generator]), exponent // 2).numerator
                terms = self._product({rest: value}, squares)
            result = total_of(result, terms)
        return result

    def _cancelled(self, numerator: Polynomial, factors: Mapping[Factor, int]) -> Ratio:
        """A quotient without the factors that divide its numerator."""
        if len(numerator) > MOST_TERMS or any(_bits(value) > LONGEST_FRACTION for value in numerator.values()):
            raise TooLargeError
        left = dict[Factor, int]()
        for factor, power in factors.items() if numerator else ():
            while power and (quotient := divided(numerator, dict(factor))) is not None:
                numerator, power = quotient, power - 1
            if power:
                left[factor] = power
        return Ratio(numerator, left)

    def operations(self, a: Ratio) -> int:
        """How many operations its expression has, about, beside those of its generators."""
        each = [a.numerator, *(dict(factor) for factor in a.factors)]
        return sum(sum(abs(e) for _, e in term) + (abs(c) != 1) for part in each for term, c in part.items())

    def expression(self, a: Ratio) -> ca.SX:
        """The CasADi expression, its numbers rounded once; raises `OverflowError` for those beyond a double."""
        value = self._polynomial(a.numerator)
        for factor, power in a.factors.items():
            if factor not in self._divisors:
                self._divisors[factor] = self._polynomial(dict(factor))
            value = value / self._divisors[factor] ** power
        return value

    def _polynomial(self, a: Polynomial) -> ca.SX:
        total: ca.SX | None = None
        for monomial, coefficient in a.items():
            value, powers = rounded(coefficient), (list[ca.SX](), list[ca.SX]())
            for generator, exponent in monomial:
                power = self.generators[generator].expression()
                powers[exponent < 0].append(power if abs(exponent) == 1 else power ** abs(exponent))
            above, below = (prod(each[1:], start=each[0]) if each else None for each in powers)
            term = ca.SX(value) if above is None else above if abs(value) == 1 else abs(value) * above
            term = term if below is None else term / below
            if total is None:
                total = -term if value < 0 and above is not None else term
            elif value < 0:
                total = total + term if above is None else total - term
            else:
                total = total + term
        return ca.SX(0) if total is None else total


def rounded(number: Number) -> float:
    """The nearest double; raises `OverflowError` where that is none, or 0 or one of few digits for another number."""
    value = float(number)
    if number and abs(value) < 1e-300:
        raise OverflowError(f"{number} is too small for a double of full precision")
    return value


def _leads_below_zero(a: Ratio) -> bool:
    """Whether the first coefficient is below 0: of a normal form and its negative, unless they vanish, that of one."""
    return bool(a.numerator) and a.numerator[min(a.numerator)] < 0


def _bits(value: Number) -> int:
    return value.numerator.bit_length() + value.denominator.bit_length()


@dataclass(frozen=True)
class Normalised:
    """The normal forms of the results of a function.

    forms : of all symbols of the function in the order of its inputs
    results : one for each element of the one output
    sizes : how many operations each of them has in the function, shared ones counted as often as they are used
    uses : the places of the symbols that each of them has in the function
    """

    forms: NormalForms
    results: list[Ratio]
    sizes: list[int]
    uses: list[set[int]]


def normalised(function: ca.Function, symbols: Collection[ca.SX], exact: Mapping[int, Fraction]) -> Normalised:
    """The normal forms of a function's one output.

    symbols : the scalar symbols that the inputs are made of, one after the other
    exact : the values of those symbols that stand for numbers
    """
    forms, starts = NormalForms(symbols), [0]
    for i in range(function.n_in()):
        starts.append(starts[-1] + function.numel_in(i))
    values, expressions, sizes, uses = list[Ratio](), list[Callable[[], ca.SX]](), list[int](), list[set[int]]()
    source = [0] * function.numel_out(0)
    for operation, places, constant in single_assignment(function):
        size, used = 0, set[int]()
        if operation == ca.OP_INPUT:
            place = starts[places[0]] + places[1]
            value = Ratio(_polynomial_of(exact[place])) if place in exact else forms.symbol(place)
            expression, used = forms.generators[place].expression, {place} - exact.keys()
        elif constant is not None:
            value, expression = _of_constant(forms, constant)
        elif operation == ca.OP_OUTPUT:
            source[places[2]] = before = places[0]
            value, expression, size, used = values[before], expressions[before], sizes[before], uses[before]
        else:
            arguments = [(values[place], expressions[place]) for place in places]
            expression = _lazily(operation, [inner for _, inner in arguments])
            value, size = (
                _form_of_operation(forms, operation, arguments, expression),
                1 + sum(sizes[place] for place in places),
            )
            used = set[int]().union(*(uses[place] for place in places))
        values.append(value)
        expressions.append(expression)
        sizes.append(min(size, 10**6))
        uses.append(used)
    return Normalised(forms, [values[i] for i in source], [sizes[i] for i in source], [uses[i] for i in source])


def _polynomial_of(value: float | Fraction) -> Polynomial:
    return {(): number_of(value)} if value else {}


def _of_constant(forms: NormalForms, constant: float) -> tuple[Ratio, Callable[[], ca.SX]]:
    expression = lambda: ca.SX(constant)  # noqa: E731
    if isfinite(constant):
        return Ratio(_polynomial_of(constant)), expression
    return forms.function(("constant", str(constant)), [], expression), expression


def _lazily(operation: int, arguments: list[Callable[[], ca.SX]]) -> Callable[[], ca.SX]:
    """() -> the expression of an operation, made once."""
    made: list[ca.SX] = []

    def expression() -> ca.SX:
        if not made:
            apply = ca.SX.unary if len(arguments) == 1 else ca.SX.binary
            made.append(apply(operation, *(argument() for argument in arguments)))
        return made[0]

    return expression


def _form_of_operation(
    forms: NormalForms, operation: int, arguments: list[tuple[Ratio, Callable[[], ca.SX]]],
    expression: Callable[[], ca.SX],
) -> Ratio:  # fmt: skip
    """The normal form of an operation on normal forms with their expressions; where none is worked out, a generator."""
    values = [value for value, _ in arguments]
    try:
        if operation in _RATIONAL:
            return _RATIONAL[operation](forms, values[0], values[-1])
        exponent = values[-1].number if operation in (ca.OP_POW, ca.OP_CONSTPOW) else None
        if exponent is not None and Fraction(exponent).denominator == 1:
            return forms.power(values[0], int(exponent))
        if operation in (ca.OP_SIN, ca.OP_COS, ca.OP_TAN):
            return _of_angle(forms, operation, *arguments[0])
    except (TooLargeError, ZeroDivisionError):
        pass
    if operation in _PARITIES and _leads_below_zero(values[0]):
        opposite = [(forms.multiply(_MINUS, values[0]), lambda: -arguments[0][1]())]
        turned = _form_of_operation(forms, operation, opposite, _lazily(operation, [opposite[0][1]]))
        return turned if _PARITIES[operation] > 0 else forms.multiply(_MINUS, turned)
    return forms.function((operation,), values, expression, square=operation == ca.OP_SQRT)


def _of_angle(forms: NormalForms, operation: int, angle: Ratio, expression: Callable[[], ca.SX]) -> Ratio:
    """A sine, a cosine, or a tangent as their quotient, of an angle with this expression."""
    if operation == ca.OP_SIN:
        return forms.sine(angle, expression)
    cosine = forms.cosine(angle, expression)
    return cosine if operation == ca.OP_COS else forms.multiply(forms.sine(angle, expression), forms.inverse(cosine))


# Beside sines, the functions that are odd (-1) and even (1).
_PARITIES = {
    **dict.fromkeys((ca.OP_SINH, ca.OP_TANH, ca.OP_ASIN, ca.OP_ATAN, ca.OP_ASINH, ca.OP_ATANH, ca.OP_ERF), -1),
    **dict.fromkeys((ca.OP_COSH, ca.OP_FABS), 1),
}
_MINUS, _TWO = Ratio({(): -1}), Ratio({(): 2})
_RATIONAL: dict[int, Callable[[NormalForms, Ratio, Ratio], Ratio]] = {
    ca.OP_ADD: lambda forms, a, b: forms.add(a, b),
    ca.OP_SUB: lambda forms, a, b: forms.add(a, forms.multiply(_MINUS, b)),
    ca.OP_MUL: lambda forms, a, b: forms.multiply(a, b),
    ca.OP_DIV: lambda forms, a, b: forms.multiply(a, forms.inverse(b)),
    ca.OP_NEG: lambda forms, a, b: forms.multiply(_MINUS, a),
    ca.OP_SQ: lambda forms, a, b: forms.multiply(a, a),
    ca.OP_TWICE: lambda forms, a, b: forms.multiply(_TWO, a),
    ca.OP_INV: lambda forms, a, b: forms.inverse(a),
}
