"""Normal forms of exact expressions: quotients of polynomials over the rational numbers.

A polynomial is a mapping from monomials, tuples of pairs (generator, exponent), to coefficients that are not 0. A part
of an expression other than + - * / and whole powers is a generator: a symbol or a function value. Exponents may be
negative, so that only a denominator of several terms needs a quotient; it is divided out of the numerator wherever that
leaves no remainder.

Every step is an identity between functions: what is found equal is equal, wherever both are defined. The converse holds
for rational functions, and for those with roots and sines by the rules that are used, sqrt(a)^2 = a, cos(a)^2 = 1 -
sin(a)^2 and tan(a) = sin(a)/cos(a); any other function is related only to itself, and if it is odd or even to its value
at the negative argument. An operation whose result would be larger than `Limits` allow is a generator too: what depends
on it is never found to be constant unless it drops out.
"""

from collections.abc import Collection, Iterable
from fractions import Fraction
from math import prod
from typing import NamedTuple, TypeAlias
from weakref import WeakValueDictionary

from .tree import ZERO, ExactExpression, call, exact_number, noted, parity_of, rebuilt, symbols_in

Number: TypeAlias = int | Fraction
# In the order of the generators, without exponents of 0.
Monomial: TypeAlias = tuple[tuple[ExactExpression, int], ...]
Polynomial: TypeAlias = dict[Monomial, Number]

UNIT: Polynomial = {(): 1}
# The generators by function and normal forms of the arguments.
_functions: "WeakValueDictionary[tuple, ExactExpression]" = WeakValueDictionary()


class Limits(NamedTuple):
    """What is worked out: a machine's coefficients have a few terms, at most some twenty.

    terms, products : the most terms of a polynomial, and the most products of terms in a product of polynomials
    power : the highest whole power
    bits : the most binary digits of a number, of numerator and denominator together
    """

    terms: int = 120
    products: int = 2400
    power: int = 16
    bits: int = 8192


LIMITS = Limits()


class TooLargeError(Exception):
    """Marks a polynomial of more terms, or a number of more digits, than are worked out."""


class Ratio(NamedTuple):
    """A quotient of polynomials; the denominator is 1 or has several terms, no common monomial, and first coefficient
    1."""

    above: Polynomial
    below: Polynomial = UNIT

    @property
    def operations(self) -> int:
        """How many operations its expression has, about, in addition to those of its generators."""
        terms = [*self.above.items(), *self.below.items()]
        return sum(sum(abs(e) for _, e in monomial) + (abs(value) != 1) for monomial, value in terms)


def normal_form(of: ExactExpression) -> Ratio:
    """The normal form of an expression; it is stored with the expression."""
    return noted(of, Ratio, lambda each: _form_of(each, [part.notes[Ratio] for part in each.parts]))


def is_zero(a: Ratio) -> bool:
    """Whether a normal form vanishes everywhere."""
    try:
        return not _product(a.above, _clearing(a.above))
    except TooLargeError:
        return False


def free_of(a: Ratio, symbols: Collection[ExactExpression]) -> Ratio | None:
    """This function, written without symbols on which it does not depend; None where it depends on them."""
    inside, these = symbols_in(_generators(a)), frozenset(symbols)
    return _free_of(a, {each for each in _generators(a) if not inside[each].isdisjoint(these)})


def constant(a: Ratio) -> Fraction | None:
    """The number that a normal form is everywhere, None where it is not a number."""
    found = _free_of(a, _generators(a))
    return None if found is None else Fraction(found.above.get((), 0))


def written(a: Ratio) -> ExactExpression:
    """The expression of a normal form."""
    return _written(a.above) if a.below == UNIT else _written(a.above) / _written(a.below)


def _written(a: Polynomial) -> ExactExpression:
    found = ZERO
    for monomial, coefficient in a.items():
        above = prod((atom**e for atom, e in monomial if e > 0), start=exact_number(coefficient))
        below = [atom**-e for atom, e in monomial if e < 0]
        found = found + (above / prod(below[1:], start=below[0]) if below else above)
    return found


def _generators(a: Ratio) -> set[ExactExpression]:
    return {generator for part in a for monomial in part for generator, _ in monomial}


def _free_of(a: Ratio, out: Collection[ExactExpression]) -> Ratio | None:
    """This function, written without generators; None where it depends on them."""
    if is_zero(a):
        return Ratio({})
    if not out:
        return a
    try:
        # The quotient is free of them where all its numerator's and its denominator's parts are in one ratio.
        clearing = _clearing(*a)
        above, below = (_parts_in(_product(each, clearing), out) for each in a)
        part = next(iter(below))
        if part not in above:
            return None
        one, other = above[part], below[part]
        for each in {**above, **below}:
            if _product(above.get(each, {}), other) != _product(one, below.get(each, {})):
                return None
        return _multiplied(Ratio(one), _inverse(Ratio(other)))
    except TooLargeError:
        return None


def _form_of(each: ExactExpression, parts: list[Ratio]) -> Ratio:
    """The normal form of an operation; where none is worked out, a generator."""
    generator = Ratio({((each, 1),): 1})
    try:
        match each.kind:
            case "number":
                value = each.value
                return Ratio({(): value.numerator if value.denominator == 1 else value} if value else {})
            case "+":
                return _sum(*parts)
            case "*":
                return _multiplied(*parts)
            case "/":
                return _multiplied(parts[0], _inverse(parts[1]))
            case "**":
                return _raised(parts[0], each.value)
            case "tan":
                sine, cosine = (normal_form(call(kind, each.parts[0])) for kind in ("sin", "cos"))
                return _multiplied(sine, _inverse(cosine))
    except (TooLargeError, ZeroDivisionError):
        return generator
    if not parts:
        return generator
    (first, *_), parity = parts, parity_of(each)
    if parity and first.above and first.above[min(first.above)] < 0:
        opposite = normal_form(rebuilt(each, [-each.parts[0]]))
        return opposite if parity > 0 else _multiplied(Ratio({(): -1}), opposite)
    key = (each.kind, each.value, *(frozenset(part.items()) for form in parts for part in form))
    if (known := _functions.get(key)) is None:
        known = _functions[key] = _with_its_symbols(each, parts)
    return Ratio({((known, 1),): 1})


def _with_its_symbols(each: ExactExpression, parts: list[Ratio]) -> ExactExpression:
    """A function value without the symbols that drop out of its arguments: it is that of all expressions with arguments
    of these normal forms, also of machines that do not have these symbols."""
    atoms = {atom for part in parts for atom in _generators(part)}
    own, left = symbols_in([each])[each], symbols_in(atoms)
    if own <= {name for atom in atoms for name in left[atom]}:
        return each
    return rebuilt(each, [written(part) for part in parts])


def _square_of(each: ExactExpression) -> Polynomial | None:
    """What the square of a generator is by a rule, None without one."""
    if each.kind == "cos":
        (sine,) = normal_form(call("sin", each.parts[0])).above
        return {(): 1, tuple((atom, 2 * e) for atom, e in sine): -1}
    inner = normal_form(each.parts[0])
    return inner.above if inner.below == UNIT else None


def _sum(a: Ratio, b: Ratio) -> Ratio:
    if a.below == b.below:
        return _lowest(_total(a.above, b.above), a.below)
    for one, other in ((a, b), (b, a)):
        if (quotient := _divided(one.below, other.below)) is not None:
            return _lowest(_total(one.above, _product(other.above, quotient)), one.below)
    above = _total(_product(a.above, b.below), _product(b.above, a.below))
    return _lowest(above, _product(a.below, b.below))


def _multiplied(a: Ratio, b: Ratio) -> Ratio:
    for one, other in ((a, b), (b, a)):
        if one.below != UNIT and (quotient := _divided(other.above, one.below)) is not None:
            return _lowest(_product(one.above, quotient), other.below)
    return _lowest(_product(a.above, b.above), _product(a.below, b.below))


def _inverse(a: Ratio) -> Ratio:
    """1 / a; raises `ZeroDivisionError` for 0."""
    if not a.above:
        raise ZeroDivisionError
    atoms = {atom for monomial in a.above for atom, _ in monomial}
    common = [(atom, min(dict(monomial).get(atom, 0) for monomial in a.above)) for atom in atoms]
    over: Polynomial = {tuple(sorted((atom, -e) for atom, e in common if e)): 1}
    left, above = _product(a.above, over), _product(a.below, over)
    if len(left) == 1:
        return _lowest(_product(above, {(): _share(1, left[()])}), UNIT)
    share = _share(1, left[max(left)])
    above, left = (_product(each, {(): share}) for each in (above, left))
    for (atom, _), *_ in filter(None, left):
        if atom.kind == "sin" and left == {(): -1, ((atom, 2),): 1}:  # -cos^2
            cosine = call("cos", atom.parts[0])
            return _lowest(_product(above, {((cosine, -2),): -1}), UNIT)
    return _lowest(above, left)


def _raised(a: Ratio, exponent: int) -> Ratio:
    if abs(exponent) > LIMITS.power:
        raise TooLargeError
    result = Ratio(UNIT)
    for _ in range(abs(exponent)):
        result = _multiplied(result, a)
    return _inverse(result) if exponent < 0 else result


def _lowest(above: Polynomial, below: Polynomial) -> Ratio:
    """A quotient without the denominator if that divides the numerator."""
    if len(above) > LIMITS.terms or any(_bits(value) > LIMITS.bits for value in above.values()):
        raise TooLargeError
    if below == UNIT or not above:
        return Ratio(above)
    quotient = _divided(above, below)
    return Ratio(above, below) if quotient is None else Ratio(quotient)


def _bits(value: Number) -> int:
    return value.numerator.bit_length() + value.denominator.bit_length()


def _clearing(*polynomials: Polynomial) -> Polynomial:
    """A factor that makes exponents of generators with rules for squares at least 0: the rules hold for these."""
    lowest = dict[ExactExpression, int]()
    for generator, exponent in (pair for polynomial in polynomials for term in polynomial for pair in term):
        if exponent < 0 and generator.kind in ("cos", "sqrt"):
            lowest[generator] = min(exponent, lowest.get(generator, 0))
    return {tuple((generator, -lowest[generator]) for generator in sorted(lowest)): 1}


def _total(a: Polynomial, b: Polynomial) -> Polynomial:
    result = dict(a)
    for monomial, value in b.items():
        result[monomial] = result.get(monomial, 0) + value
    return {monomial: value for monomial, value in result.items() if value}


def _times(a: Monomial, b: Monomial) -> Monomial:
    if not (a and b):
        return a or b
    powers = dict(a)
    for generator, exponent in b:
        powers[generator] = powers.get(generator, 0) + exponent
    return tuple(sorted((atom, e) for atom, e in powers.items() if e))


def _share(a: Number, b: Number) -> Number:
    share = Fraction(a) / b
    return share.numerator if share.denominator == 1 else share


def _product(a: Polynomial, b: Polynomial) -> Polynomial:
    """The product of polynomials, with the rules for squares."""
    if len(a) * len(b) > LIMITS.products:
        raise TooLargeError
    result = b if a == UNIT else a if b == UNIT else Polynomial()
    if not result:
        for left, c in a.items():
            for right, d in b.items():
                monomial = _times(left, right)
                result[monomial] = result.get(monomial, 0) + (d if c == 1 else c * d)
        result = {monomial: value for monomial, value in result.items() if value}
    squared = {atom for monomial in result for atom, e in monomial if e > 1 and atom.kind in ("cos", "sqrt")}
    for generator in sorted(squared, reverse=True):  # the ones that contain others first
        if (square := _square_of(generator)) is not None:
            result = _with_square(result, generator, square)
    if len(result) > LIMITS.terms:
        raise TooLargeError
    return result


def _with_square(a: Polynomial, generator: ExactExpression, square: Polynomial) -> Polynomial:
    """A polynomial with the square of a generator replaced."""
    result: Polynomial = {}
    for monomial, value in a.items():
        half = dict(monomial).get(generator, 0) // 2
        terms: Polynomial = {_times(monomial, ((generator, -2 * half),)) if half > 0 else monomial: value}
        for _ in range(half):
            terms = _product(terms, square)
        result = _total(result, terms)
    return result


def _divided(a: Polynomial, b: Polynomial) -> Polynomial | None:
    """The quotient of polynomials, b without a common monomial; None where a remainder is left."""
    names = sorted({atom for term in a for atom, _ in term})
    if not {atom for term in b for atom, _ in term} <= {*names}:
        return None
    low = [min(dict(term).get(atom, 0) for term in a) for atom in names]
    rest = {tuple(e - o for e, o in zip(_dense(term, names), low, strict=True)): value for term, value in a.items()}
    divisor = {_dense(term, names): value for term, value in b.items()}
    lead, quotient = max(divisor), dict[tuple, Number]()
    while rest:
        first = max(rest)
        step = tuple(e - o for e, o in zip(first, lead, strict=True))
        if min(step, default=0) < 0 or len(quotient) >= LIMITS.terms:
            return None
        quotient[step] = share = _share(rest[first], divisor[lead])
        for term, value in divisor.items():
            place = tuple(e + o for e, o in zip(term, step, strict=True))
            if left := rest.pop(place, 0) - share * value:
                rest[place] = left
    exponents = lambda term: [e + o for e, o in zip(term, low, strict=True)]  # noqa: E731
    return {
        tuple((n, e) for n, e in zip(names, exponents(t), strict=True) if e): value for t, value in quotient.items()
    }


def _dense(term: Monomial, names: Iterable[ExactExpression]) -> tuple[int, ...]:
    known = dict(term)
    return tuple(known.get(atom, 0) for atom in names)


def _parts_in(a: Polynomial, generators: Collection[ExactExpression]) -> dict[Monomial, Polynomial]:
    """A polynomial in these generators, with coefficients that are polynomials in the others."""
    parts: dict[Monomial, Polynomial] = {}
    for term, value in a.items():
        own = tuple(pair for pair in term if pair[0] in generators)
        parts.setdefault(own, {})[tuple(pair for pair in term if pair[0] not in generators)] = value
    return parts
